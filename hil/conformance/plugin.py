"""The pytest plugin: which cases run, what a case gets, and what became of it.

It alone knows that pytest runs the cases. An unknown clause fails collection, for the decorator `case` refuses it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace

import pytest

from ...errors import DeviceError, ReplyError
from ...protocol.codes import Feature
from .bench import OUTPUTS, Bench, Lost
from .cases import NOT_USB, Case, Inconclusive, Need, NotApplicable, Risk, case_of, not_allowed, unmet
from .clauses import resolve
from .matrix import Claim
from .profile import Profile
from .verdicts import Evidence, Result, Verdict

__all__ = ["Catalogue", "Entry", "Judge", "Watcher", "case_id", "wanted"]

PREFIX = "test_"


@dataclass(frozen=True)
class Entry:
    """A case in the catalogue.

    Parameters
    ----------
    identifier : str
        ``group/name[parameter]``.
    about : Case
        What it says of itself.
    """

    identifier: str
    about: Case

    @property
    def claim(self) -> Claim:
        """What it says that it shows."""
        return Claim(self.identifier, self.about.clauses, self.about.sentence)

    @property
    def group(self) -> str:
        """The file that it stands in."""
        return self.identifier.partition("/")[0]

    @property
    def names(self) -> tuple[str, ...]:
        """What it can be called by: itself, its group, its clauses, their chapters."""
        clauses = [clause.partition("/")[0] for clause in self.about.clauses]
        return (self.identifier, self.group, *self.about.clauses, *clauses, *(clause[:3] for clause in clauses))


def wanted(entry: Entry, only: tuple[str, ...]) -> bool:
    """Whether a case is among those asked for: all where nothing is, else those with a name that begins so."""
    return not only or any(name.startswith(prefix) for name in entry.names for prefix in only)


def case_id(item: pytest.Function) -> str:
    """The identifier of a case."""
    group = item.path.stem.removeprefix(PREFIX).replace("_", "-")
    name, bracket, parameter = item.name.removeprefix(PREFIX).partition("[")
    return f"{group}/{name.replace('_', '-')}{bracket}{parameter}"


class Catalogue:
    """Collects the cases and runs none.

    Attributes
    ----------
    entries : list of Entry
    """

    def __init__(self) -> None:
        self.entries: list[Entry] = []
        self.trouble: list[str] = []

    def pytest_collection_modifyitems(self, items: list[pytest.Function]) -> None:
        """Take note of the cases."""
        self.entries, trouble = _entries(items)
        self.trouble += trouble

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Take note of what cannot be collected."""
        if report.failed:
            self.trouble.append(f"{report.nodeid}: {report.longrepr}")


def _entries(items: list[pytest.Function]) -> tuple[list[Entry], list[str]]:
    entries, trouble = [], []
    for item in items:
        about = case_of(item.function)
        if about is None:
            trouble.append(f"{item.nodeid} is no case: it has no decorator `case`")
        else:
            entries.append(Entry(case_id(item), about))
    return entries, trouble


class Watcher:
    """Told how a run goes on; this one does nothing."""

    def began(self, case: str, number: int, of: int) -> None:
        """A case has begun: the number-th of so many, from 1."""

    def ended(self, result: Result) -> None:
        """A case has ended."""

    def waits(self, what: str) -> None:
        """Somebody has to do something before the run can go on."""


@dataclass
class Judge:
    """Runs the cases against a bench and gathers what came of them.

    Parameters
    ----------
    bench : Bench
    profile : Profile
        What does not apply to the device.
    known : mapping of str to str
        Why cases are known to fail.
    only : tuple of str
        The cases asked for.
    enough : int or None
        After so many cases that break the run no further one is judged; None for all.
    watcher : Watcher
    again : bool
        Whether a case that failed is run once more.

    Attributes
    ----------
    results : list of Result
    trouble : list of str
    claims : tuple of Claim
        Of all cases, asked for or not.
    interruption : BaseException or None
        What ended the run before its time.
    """

    bench: Bench
    profile: Profile
    known: Mapping[str, str]
    only: tuple[str, ...]
    enough: int | None
    watcher: Watcher
    again: bool = True
    results: list[Result] = field(default_factory=list)
    trouble: list[str] = field(default_factory=list)
    claims: tuple[Claim, ...] = ()
    _pending: list[tuple[int, Case, list[Callable[[], str]]]] = field(default_factory=list)
    interruption: BaseException | None = None
    _outcome: tuple[Verdict, str] = (Verdict.PASS, "")
    _asked: list[Entry] = field(default_factory=list)
    _trying: bool = False
    _lost: str | None = None

    def pytest_collection_modifyitems(self, items: list[pytest.Function]) -> None:
        """Leave out what was not asked for."""
        entries, trouble = _entries(items)
        self.claims = tuple(entry.claim for entry in entries)
        self.trouble += trouble
        known = {name for entry in entries for name in (entry.identifier, entry.identifier.partition("[")[0])}
        self.trouble += [f"the known failure {name!r} names no case" for name in self.known if name not in known]
        self.trouble += _naming_nothing(self.profile, known | {entry.group for entry in entries})
        self._asked = [entry for entry in entries if wanted(entry, self.only)]
        asked = {entry.identifier for entry in self._asked}
        items[:] = [item for item in items if case_id(item) in asked]

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Take note of what cannot be collected."""
        if report.failed:
            self.trouble.append(f"{report.nodeid}: {report.longrepr}")

    @pytest.fixture(name="bench")
    def fixture(self, request: pytest.FixtureRequest) -> Iterator[Bench]:
        """The bench, at rest."""
        item = request.node
        about = case_of(item.function)
        assert about is not None
        with ExitStack() as stack:
            # What goes wrong may leave traces in a device for good; where there is one to spare it goes wrong there.
            apart = Need.FAULTS in about.needs and self.bench.can(Need.SPARE)
            bench = stack.enter_context(self.bench.spare()) if apart else self.bench
            try:
                bench.begin_case(case_id(item))
                marked = bench.sight is not None and bench.sight.deferred and Need.CAPTURE in about.needs
                if marked:
                    bench.play_mark()
            except Lost as error:
                self._lost = str(error)
                raise
            yield bench
            if marked:
                bench.play_mark()
            bench.end_case()

    def _check(self, identifier: str, about: Case) -> None:
        """Raise what says that a case is not to be judged."""
        if self._lost is not None:
            raise Inconclusive(self._lost)
        reason = self.profile.reason_for(identifier, identifier.partition("/")[0], about.clauses)
        if reason is not None:
            raise NotApplicable(reason)
        needed = about.features | (Feature.CONSOLE if about.line == "serial" else Feature(0))
        if missing := needed & ~self.bench.info.features:
            raise NotApplicable(f"INFO does not name the feature {missing.name}")
        if about.line == "usb" and self.bench.line.kind != "usb":
            raise Inconclusive(NOT_USB)
        for risk in Risk:
            if risk in about.risks and risk not in self.bench.allowed:
                raise Inconclusive(not_allowed(risk))
        for need in about.needs:
            if not self.bench.can(need):
                raise Inconclusive(unmet(need))

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Function) -> bool | None:
        """Judge one case, from beginning to end; a case that fails is run once more."""
        if self._trying:
            return None  # pytest runs it, as `_try` asks
        identifier, about = case_id(item), case_of(item.function)
        assert about is not None
        self.watcher.began(identifier, len(self.results) + 1, len(self._asked))
        result = self._try(item, Result(identifier, about.clauses, about.sentence, Verdict.PASS), about)
        if self.interruption is not None:
            return True  # nothing was judged
        if result.verdict is Verdict.FAIL and self.again and self._lost is None:
            again = self._try(item, replace(result, verdict=Verdict.PASS, reason=""), about)
            if self.interruption is None:
                result = _twice(result, again)
        elif self.bench.deferred and result.verdict is Verdict.PASS:
            self._pending.append((len(self.results), about, self.bench.deferred))
        result = self._expected(result)
        self.results.append(result)
        self.watcher.ended(result)
        if self.enough is not None and sum(result.breaks for result in self.results) >= self.enough:
            item.session.shouldstop = f"{self.enough} cases broke, which is enough"
        return True

    def _try(self, item: pytest.Function, result: Result, about: Case) -> Result:
        """Run a case once, unless it is clear beforehand that it cannot be judged: then nothing is sent."""
        self.bench.forget()
        began = time.perf_counter()
        try:
            self._check(result.case, about)
        except (Inconclusive, NotApplicable) as error:
            self._outcome = verdict_of(error, about)
        else:
            self._outcome, self._trying = (Verdict.PASS, ""), True
            try:
                item.ihook.pytest_runtest_protocol(
                    item=item, nextitem=None
                )  # the next one may be decided without pytest
            finally:
                self._trying = False
        verdict, reason = self._outcome
        evidence = self.bench.evidence(whole=verdict in (Verdict.FAIL, Verdict.WARN))
        seconds = time.perf_counter() - began
        return replace(result, verdict=verdict, reason=reason, evidence=evidence, seconds=seconds)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(
        self, item: pytest.Function, call: pytest.CallInfo[None]
    ) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        """Keep what the first exception of a case means."""
        report = yield
        if call.excinfo is not None:
            error, about = call.excinfo.value, case_of(item.function)
            assert about is not None
            if not isinstance(error, Exception):  # a signal, which pytest takes for a failure like another
                self.interruption = error
                item.session.shouldstop = "interrupted"
            if self._outcome[0] is Verdict.PASS:
                self._outcome = verdict_of(error, about)
        return report

    @pytest.hookimpl(wrapper=True)
    def pytest_collection(self) -> Generator[None, object, object]:
        """Collect the cases; see `_end_quietly`."""
        return (yield from self._end_quietly())

    @pytest.hookimpl(wrapper=True)
    def pytest_runtestloop(self) -> Generator[None, object, object]:
        """Run all cases; see `_end_quietly`."""
        return (yield from self._end_quietly())

    def _end_quietly(self) -> Generator[None, object, object]:
        """Let a signal that exits the program end pytest as Ctrl-C does, of which it says nothing."""
        try:
            return (yield)
        except SystemExit as error:
            self.interruption = error
            raise pytest.Session.Interrupted("a signal") from error

    def pytest_keyboard_interrupt(self, excinfo: pytest.ExceptionInfo[BaseException]) -> None:
        """Keep that somebody has pressed Ctrl-C; pytest's own end of a session looks like it."""
        if not isinstance(excinfo.value, pytest.Session.Interrupted):
            self.interruption = excinfo.value

    def pytest_internalerror(self, excinfo: pytest.ExceptionInfo[BaseException]) -> bool:
        """Keep what ended everything outside of a case: a signal, or a mistake of the suite."""
        if isinstance(excinfo.value, Exception):
            self.trouble.append(f"the suite failed by itself: {type(excinfo.value).__name__}: {excinfo.value}")
        else:
            self.interruption = excinfo.value
        return True

    @property
    def awaits_recording(self) -> bool:
        """Whether cases can be judged only when a recording is there."""
        return bool(self._pending)

    def finish(self, ended_by: str = "") -> None:
        """Judge what could only be judged after the run, or take note that it was not.

        Parameters
        ----------
        ended_by : str
            What ended the run before its time; empty if it came to its end.
        """
        for index, about, looks in self._pending:
            result, seen = self.results[index], list[Evidence]()
            try:
                if ended_by:
                    raise Inconclusive(f"{ended_by} ended the run before the recording was there")
                seen.extend(Evidence(OUTPUTS, look()) for look in looks)
            except Exception as error:
                verdict, reason = verdict_of(error, about)
                result = replace(result, verdict=verdict, reason=reason)
                if verdict is Verdict.FAIL:
                    seen.append(Evidence("run again", "no: the outputs were judged after the run, from its recording"))
            self.results[index] = self._expected(replace(result, evidence=(*result.evidence, *seen)))
        if ended_by:
            self.results += [
                Result(
                    entry.identifier,
                    entry.about.clauses,
                    entry.about.sentence,
                    Verdict.INCONCLUSIVE,
                    f"{ended_by} ended the run before this was judged",
                )
                for entry in self._asked[len(self.results) :]
            ]
        self.trouble += self._passes()

    def _expected(self, result: Result) -> Result:
        """The same with why it is known to fail, by its whole name or, where it does, by that without parameter."""
        bare = self.known.get(result.case.partition("[")[0]) if result.verdict is Verdict.FAIL else None
        return replace(result, known=self.known.get(result.case, bare))

    def _passes(self) -> Iterator[str]:
        """Known failures by names without parameter of which no part fails any more."""
        for name in self.known:
            parts = [result for result in self.results if result.case.startswith(f"{name}[")]
            verdicts = {result.verdict for result in parts}
            if Verdict.PASS in verdicts and Verdict.FAIL not in verdicts:
                yield f"the known failure {name!r} fails in none of its parts"


def _naming_nothing(profile: Profile, names: set[str]) -> Iterator[str]:
    """What is said of a profile's entries that are neither clause nor group nor case."""
    for name in profile.not_applicable:
        if name not in names:
            try:
                resolve(name)
            except ValueError as error:
                yield f"the profile says that {name!r} does not apply, which is neither a group nor a case: {error}"


def _twice(first: Result, again: Result) -> Result:
    """What came of a case that failed and was run again: it stays a failure, whatever came then."""
    if again.verdict is not Verdict.FAIL:
        then = f"{again.verdict}, {again.reason}" if again.reason else str(again.verdict)
        reason = f"{first.reason}; the second time: {then}"
    elif again.reason != first.reason:
        reason = f"{first.reason}; the second time: {again.reason}"
    else:
        reason = first.reason
    return replace(first, reason=reason, again=again.verdict, seconds=first.seconds + again.seconds)


def verdict_of(error: BaseException, about: Case) -> tuple[Verdict, str]:
    """What an exception of a case means, and why."""
    match error:
        case Inconclusive():
            return Verdict.INCONCLUSIVE, str(error)
        case NotApplicable():
            return Verdict.NOT_APPLICABLE, str(error)
        case Lost():
            return Verdict.FAIL, str(error)
        case AssertionError():
            return (Verdict.WARN if about.should else Verdict.FAIL), str(error) or "an assertion without words failed"
        case DeviceError() | ReplyError():
            return Verdict.FAIL, str(error)
        case _:
            return Verdict.FAIL, f"the suite did not expect this: {type(error).__name__}: {error}"
