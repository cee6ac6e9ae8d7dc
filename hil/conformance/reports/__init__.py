"""Reports: what came of a run, as a terminal, a program, a CI system and a browser show it.

They take a `Run` and a `Matrix`, and judge nothing: what breaks a run, `verdicts` says, and what they all say of it is
in `summary`. Text that comes from a device or a file is never trusted: see `markup`.
"""
