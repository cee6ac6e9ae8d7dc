"""Output of findings by commands."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any

from ..host.finding.findings import CheckVerdict, Finding
from .console import console_for

__all__ = ["as_record", "count", "failed", "tell"]

STYLES = {CheckVerdict.OK: "green", CheckVerdict.WARN: "yellow", CheckVerdict.FAIL: "red", CheckVerdict.SKIPPED: "dim"}
MARK = max(map(len, CheckVerdict)) + 2


def tell(finding: Finding, names: Iterable[str], json_target: str | None) -> None:
    """Print a finding, aligned with those of all checks that have these names."""
    label = max(map(len, names)) + 2
    console = console_for(json_target)
    console.print(finding.verdict.value.ljust(MARK), style=STYLES[finding.verdict], end="")
    console.print(f"{finding.name:{label}}{finding.seen}")
    if finding.advice:
        console.print(f"{'':{MARK + label}}→ {finding.advice}")


def count(findings: Iterable[Finding]) -> str:
    """The number of each verdict."""
    verdicts = Counter(finding.verdict for finding in findings)
    return ", ".join(f"{verdicts[verdict]} {verdict.value}" for verdict in CheckVerdict)


def failed(findings: Iterable[Finding]) -> bool:
    """Whether a check failed."""
    return any(finding.verdict is CheckVerdict.FAIL for finding in findings)


def as_record(findings: list[Finding]) -> dict[str, Any]:
    """Findings and their counts as JSON."""
    return {
        "verdict": "fail" if failed(findings) else "ok",
        "findings": [finding._asdict() for finding in findings],
    }
