"""Reports: the result of a run for a terminal, a program, a CI system and a browser.

They take a `Run` and a `Matrix`, and judge nothing: `verdicts` says what breaks a run, and `summary` holds what all of
them say. Text from a device or a file is never trusted: see `markup`.
"""
