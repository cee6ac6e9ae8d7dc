"""The conformance suite: what a firmware author runs against a device, and trusts.

Cases stand in `groups`, one file for each chapter or concern of SPEC.md. Each case names the clauses that it shows,
says in a sentence what it does and why, and does everything through a `Bench` and the `tools` that cases share. A bench
joins a device at the end of one of the `transports`, the observation of its outputs (`sight`), the control of its
surroundings (`levers`), and the risks that are allowed. pytest runs the cases, but only `plugin` and `running` know
that. The result is a `Run`, which `reports` turns into text, JSON, JUnit and HTML.
"""

from __future__ import annotations

from .verdicts import Evidence, Provenance, Result, Run, Verdict

__all__ = ["Evidence", "Provenance", "Result", "Run", "Verdict"]
