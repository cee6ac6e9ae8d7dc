"""The conformance suite: what a firmware author runs against a device, and trusts.

Cases stand in `groups`, one file for each chapter or concern of SPEC.md; each names the clauses that it shows, says in
a sentence what it does and why, and asks a `Bench` for all it does, by the `tools` that cases share. A bench is a
device at the end of one of the `lines`, what can be seen of its outputs (`sight`), what can be done to it besides
(`levers`), and what it may not be asked for. pytest runs the cases underneath, which `plugin` and `running` alone
know. What came of a run is a `Run`, which `reports` turns into text, JSON, JUnit and HTML.
"""

from __future__ import annotations

from .verdicts import Evidence, Provenance, Result, Run, Verdict

__all__ = ["Evidence", "Provenance", "Result", "Run", "Verdict"]
