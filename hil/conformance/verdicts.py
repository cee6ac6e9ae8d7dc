"""Verdicts: the result of a case with its reason and evidence, and the result of a run."""

from __future__ import annotations

import shlex
import signal
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from .clauses import changes

if TYPE_CHECKING:
    from .matrix import Claim

__all__ = ["AT_THE_OUTPUTS", "Evidence", "Provenance", "Result", "Run", "Verdict", "signal_name"]


AT_THE_OUTPUTS = "#outputs"
"""Marks the part of a case that only the outputs show, after the name of the case."""


class Verdict(StrEnum):
    """The result of a case."""

    PASS = "pass"
    FAIL = "fail"
    """The device breaks a MUST, or a description in the specification."""
    WARN = "warn"
    """It does not do what it SHOULD."""
    INCONCLUSIVE = "inconclusive"
    """It cannot be observed or done here; never counted as a pass."""
    NOT_APPLICABLE = "not applicable"
    """The device lacks it: INFO or its profile says so."""


@dataclass(frozen=True)
class Evidence:
    """Something that was observed.

    Parameters
    ----------
    label : str
        What it is, such as ``sent`` or ``status``.
    text : str
        The value, in words or hexadecimal.
    meaning : str
        A line as of ``phasewire decode`` for each block, record, request and frame in the bytes; empty if they are
        none, or the text is words.
    after : bool
        Whether it came after the failure or the end of the case: it is clean-up.
    """

    label: str
    text: str
    meaning: str = ""
    after: bool = False


@dataclass(frozen=True)
class Result:
    """The result of one case.

    Parameters
    ----------
    case : str
        ``group/name-of-the-case``, with ``[parameter]`` if it has some.
    clauses : tuple of str
        What it shows, such as ``BLK-003`` or, of several MUSTs in a clause, ``BLK-005/1``.
    sentence : str
        What it does and why.
    verdict : Verdict
    reason : str
        The reason, if it is no pass; empty for a pass.
    evidence : tuple of Evidence
        The evidence in order.
    seconds : float
        Duration by the wall clock.
    known : str or None
        Why it is expected to fail, if it is (`known-failures.toml`).
    again : Verdict or None
        The verdict of the second attempt of a case that failed; None without one. A second attempt does not excuse a
        case that failed once: a device with sporadic failures is not sound.
    fresh : bool
        Whether the device was restarted before the second attempt, which then inherited nothing.
    tried : tuple of int, or None
        How many of how many values were tried, if this line was too slow for all.
    """

    case: str
    clauses: tuple[str, ...]
    sentence: str
    verdict: Verdict
    reason: str = ""
    evidence: tuple[Evidence, ...] = ()
    seconds: float = 0.0
    known: str | None = None
    again: Verdict | None = None
    fresh: bool = False
    tried: tuple[int, int] | None = None

    @property
    def tally(self) -> str:
        """How often it failed of how many tries, such as ``failed 1 of 2``; empty if it did not fail."""
        if self.verdict is not Verdict.FAIL:
            return ""
        return f"failed {1 + (self.again is Verdict.FAIL)} of {1 if self.again is None else 2}"

    @property
    def changed(self) -> tuple[str, ...]:
        """If it failed, which of its clauses changed in which revision: the device may keep an older one."""
        return changes(self.clauses) if self.verdict is Verdict.FAIL else ()

    @property
    def run_again(self) -> str:
        """The options that should show a failure again: its case if it failed again after a restart, else its group.

        Empty if it was tried once.
        """
        if not self.tally or self.again is None:
            return ""
        alone = self.fresh and self.again is Verdict.FAIL
        return f"--only {shlex.quote(self.case if alone else self.group)}"

    @property
    def is_partial(self) -> bool:
        """Whether it is a pass that shows less than it says: only a part of its values was tried."""
        return self.verdict is Verdict.PASS and self.tried is not None

    @property
    def group(self) -> str:
        """The file that holds the case."""
        return self.case.partition("/")[0]

    @property
    def whole(self) -> str:
        """The case; for the part that only the outputs show, its whole case."""
        return self.case.replace(AT_THE_OUTPUTS, "", 1)

    @property
    def breaks(self) -> bool:
        """Whether it makes the run fail: an unexpected failure, or an expected one that did not come."""
        if self.known is None:
            return self.verdict is Verdict.FAIL
        return self.verdict in (Verdict.PASS, Verdict.WARN)


@dataclass(frozen=True)
class Provenance:
    """Who tested what, when, and with what.

    Parameters
    ----------
    suite : str
        Version of phasewire.
    specification : str
        Version and revision of the protocol, and the SHA-256 of SPEC.md (its first 16 digits).
    device : mapping of str to str
        The device's description of itself: URL, product, serial number, firmware, protocol, hardware, link.
    began : str
        ISO 8601, in UTC.
    seconds : float
        Duration.
    profile : str
        Name of the device's profile, or ``none``.
    capture : str
        The observer of its outputs: ``emulator``, ``sigrok:FILE`` or ``none``.
    levers : tuple of str
        What could be done to it, such as ``command:power=PROGRAM {}``; those of the emulator are ``emulator``.
    allowed : tuple of str
        Risks that were allowed.
    seed : int
        Seed of all random numbers.
    cores : int
        The cores of the computer that ran the suite.
    load : tuple of float, or None
        Its load average over a minute, when the run began and when it ended; None if its system has no such figure.
    """

    suite: str
    specification: str
    device: dict[str, str]
    began: str
    seconds: float
    profile: str
    capture: str
    levers: tuple[str, ...]
    allowed: tuple[str, ...]
    seed: int
    cores: int
    load: tuple[float, float] | None


@dataclass(frozen=True)
class Run:
    """The result of a run.

    Parameters
    ----------
    provenance : Provenance
    results : tuple of Result
        The results in the order of the cases.
    trouble : tuple of str
        Trouble of the run itself, such as a known failure of no case; it fails the run.
    claims : tuple of Claim
        What all cases claim to show, whether they ran or not.
    signal : int
        Number of the signal that ended the run early, such as ``signal.SIGINT``; 0 if it was completed. Cases that were
        not judged then are inconclusive.
    """

    provenance: Provenance
    results: tuple[Result, ...]
    trouble: tuple[str, ...] = ()
    claims: tuple[Claim, ...] = ()
    signal: int = 0

    @property
    def interrupted_by(self) -> str:
        """What ended the run early, such as ``Ctrl-C`` or ``SIGTERM``; empty if it was completed."""
        return signal_name(self.signal) if self.signal else ""

    @property
    def passed(self) -> bool:
        """Whether the run was completed and the device is sound, as far as it could be observed."""
        return not self.signal and not self.trouble and not any(result.breaks for result in self.results)

    def count(self, verdict: Verdict) -> int:
        """How many cases came to a verdict."""
        return sum(result.verdict is verdict for result in self.results)


def signal_name(number: int) -> str:
    """The usual name of a signal."""
    return "Ctrl-C" if number == signal.SIGINT else signal.Signals(number).name
