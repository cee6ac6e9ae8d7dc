"""The pytest plugin: it selects the cases, gives each its bench, and judges their results.

Only this module knows that pytest runs the cases. An unknown clause fails collection: the decorator `case` refuses it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import reduce
from typing import TYPE_CHECKING

import pytest

from ...base.errors import DeviceError, ReplyError
from ...protocol.codes import Feature
from .bench import OUTPUTS, Bench, Lost
from .cases import NOT_USB, Case, Inconclusive, Need, NotApplicable, Risk, Row, TooSlow, case_of, not_allowed, unmet
from .clauses import resolve
from .matrix import Claim
from .profile import Profile
from .verdicts import AT_THE_OUTPUTS, Evidence, Result, Verdict

if TYPE_CHECKING:
    from .options import RunOptions

__all__ = ["Catalogue", "CatalogueCase", "Judge", "Watcher", "case_id", "selected", "wanted"]

PREFIX = "test_"
CLOCK_CLAUSE = "TIM-002"
"""It holds in every case: see `ClockWatch`."""


@dataclass(frozen=True)
class CatalogueCase:
    """A case in the catalogue, or the part of one that only the outputs show."""

    identifier: str
    """``group/name[parameter]``; for that part ``group/name#outputs[parameter]``."""
    about: Case
    """Its declaration."""

    @property
    def claim(self) -> Claim:
        """What it claims to show."""
        return Claim(self.identifier, self.about.clauses, self.about.sentence)

    @property
    def result(self) -> Result:
        """A pass, unless something was wrong."""
        return Result(self.identifier, self.about.clauses, self.about.sentence, Verdict.PASS)

    @property
    def group(self) -> str:
        """The file that holds it."""
        return self.identifier.partition("/")[0]

    @property
    def names(self) -> tuple[str, ...]:
        """All names that select it: itself, its group, its clauses, their chapters."""
        clauses = [clause.partition("/")[0] for clause in self.about.clauses]
        return (self.identifier, self.group, *self.about.clauses, *clauses, *(clause[:3] for clause in clauses))


def wanted(entry: CatalogueCase, only: tuple[str, ...]) -> bool:
    """Whether a case is selected: all are if no name is given, else those with a name that begins like one given."""
    return not only or any(name.startswith(prefix) for name in entry.names for prefix in only)


def selected(entries: Sequence[CatalogueCase], only: tuple[str, ...]) -> list[CatalogueCase]:
    """The selected cases; raises ValueError if a name selects none."""
    idle = [repr(name) for name in only if not any(wanted(entry, (name,)) for entry in entries)]
    if idle:
        raise ValueError(f"no case begins with {' or '.join(idle)}; --list names all")
    return [entry for entry in entries if wanted(entry, only)]


def case_id(item: pytest.Function) -> str:
    """The identifier of a case."""
    group = item.path.stem.removeprefix(PREFIX).replace("_", "-")
    name, bracket, parameter = item.name.removeprefix(PREFIX).partition("[")
    return f"{group}/{name.replace('_', '-')}{bracket}{parameter}"


def _about(item: pytest.Function) -> Case | None:
    """The declaration of a case, with what the rows of its tables need; None if it is none."""
    about = case_of(item.function)
    if about is None or not hasattr(item, "callspec"):
        return about
    rows = (value for value in item.callspec.params.values() if isinstance(value, Row))
    return reduce(lambda declared, row: row.added_to(declared), rows, about)


class Catalogue:
    """Collects the cases and runs none.

    Attributes
    ----------
    cases : list of tuple of CatalogueCase
        The parts of each case.
    trouble : list of str
        What could not be collected.
    """

    def __init__(self) -> None:
        self.cases: list[tuple[CatalogueCase, ...]] = []
        self.trouble: list[str] = []

    @property
    def entries(self) -> list[CatalogueCase]:
        """The parts of all cases."""
        return [part for parts in self.cases for part in parts]

    def pytest_collection_modifyitems(self, items: list[pytest.Function]) -> None:
        """Note the cases, and an error for anything else."""
        for item in items:
            if _about(item) is None:
                self.trouble.append(f"{item.nodeid} is no case: it has no decorator `case`")
            else:
                self.cases.append(_parts(item))

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Note collection errors."""
        if report.failed:
            self.trouble.append(f"{report.nodeid}: {report.longrepr}")


def _parts(item: pytest.Function) -> tuple[CatalogueCase, ...]:
    """A case and, if it has one, the part of it that only the outputs show."""
    identifier, about = case_id(item), _about(item)
    assert about is not None
    if not about.outputs:
        return (CatalogueCase(identifier, about),)
    name, bracket, parameter = identifier.partition("[")
    outputs = CatalogueCase(f"{name}{AT_THE_OUTPUTS}{bracket}{parameter}", about.at_the_outputs)
    return CatalogueCase(identifier, about), outputs


class Watcher:
    """Receives the progress of a run; this one does nothing."""

    def began(self, case: str, number: int, of: int) -> None:
        """A case has begun: its number, from 1, and how many there are."""

    def ended(self, result: Result) -> None:
        """A case has ended."""

    def waits(self, what: str) -> None:
        """Somebody must do something before the run can go on."""


class Judge(Catalogue):
    """Runs the cases against a bench and collects their results.

    Parameters
    ----------
    bench : Bench
    options : RunOptions
    watcher : Watcher
        Receives the progress.

    Attributes
    ----------
    results : list of Result
    interruption : BaseException or None
        What ended the run early.
    """

    def __init__(self, bench: Bench, options: RunOptions, watcher: Watcher) -> None:
        super().__init__()
        self.bench = bench
        self.options = options
        self.watcher = watcher
        self.results: list[Result] = []
        self.interruption: BaseException | None = None
        self._asked: list[CatalogueCase] = []
        self._pending: list[tuple[int, CatalogueCase, list[Callable[[], str]]]] = []
        self._lost: str | None = None
        # Of the attempt at hand:
        self._outcome = Verdict.PASS, ""
        self._trying = self._too_slow = False

    @property
    def claims(self) -> tuple[Claim, ...]:
        """What each case claims to show, selected or not."""
        return tuple(entry.claim for entry in self.entries)

    def pytest_collection_modifyitems(self, items: list[pytest.Function]) -> None:
        """Leave out what was not selected."""
        super().pytest_collection_modifyitems(items)
        entries, only, known = self.entries, self.options.only, self.options.known
        names = {name for entry in entries for name in (entry.identifier, entry.identifier.partition("[")[0])}
        self.trouble += [f"the known failure {name!r} names no case" for name in known if name not in names]
        self.trouble += _naming_nothing(self.options.profile, names | {entry.group for entry in entries})
        self._asked = [part for parts in self.cases if any(wanted(each, only) for each in parts) for part in parts]
        asked = {entry.identifier for entry in self._asked}
        items[:] = [item for item in items if case_id(item) in asked]

    @pytest.fixture(name="bench")
    def fixture(self, request: pytest.FixtureRequest) -> Iterator[Bench]:
        """The bench in its initial state."""
        item = request.node
        about = _about(item)
        assert about is not None
        with ExitStack() as stack:
            # A fault may damage a device for good; if there is a spare one the fault goes there.
            apart = Need.FAULTS in about.needs and self.bench.can(Need.SPARE)
            bench = stack.enter_context(self.bench.spare()) if apart else self.bench
            try:
                bench.begin_case(case_id(item))
                looks = bool(about.outputs) or Need.CAPTURE in about.needs
                marked = looks and bench.observer is not None and bench.observer.deferred
                if marked:
                    bench.play_mark()
            except Lost as error:
                self._lost = str(error)
                raise
            yield bench
            bench.over()
            if marked:
                bench.play_mark()
            bench.end_case()

    def _check(self, entry: CatalogueCase) -> None:
        """Raise the exception for a case, or a part of one, that is not to be judged."""
        if self._lost is not None:
            raise Inconclusive(self._lost)
        about = entry.about
        reason = self.options.profile.reason_for(entry.identifier, entry.group, about.clauses, about.since)
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
        """Judge one case, from beginning to end.

        A case for which this computer was too slow gets more time in the next attempt; one that fails is run once more,
        after a restart of the device where that is allowed.
        """
        if self._trying:
            return None  # pytest runs it through `_try`
        parts = _parts(item)
        self.watcher.began(parts[0].identifier, len(self.results) + 1, len(self._asked))
        results = self._try(item, parts)
        before = self.bench.slowness
        while self._too_slow and self.bench.slow_down():
            results = self._try(item, parts)
        if self._too_slow:
            self.bench.slowness = before  # more time did not help
        if self.interruption is not None:
            return True  # no verdict was reached
        if any(result.verdict is Verdict.FAIL for result in results) and self.options.again and self._lost is None:
            fresh = self.bench.begin_anew()
            again = self._try(item, parts)
            if self.interruption is None:
                results = [replace(_twice(*tries), fresh=fresh) for tries in zip(results, again, strict=True)]
        elif self._is_deferred and self.bench.looks and results[-1].verdict is Verdict.PASS:
            self._pending.append((len(self.results) + len(parts) - 1, parts[-1], self.bench.looks.copy()))
            waits = "its outputs are judged from the recording"
            results = [*results[:-1], replace(results[-1], verdict=Verdict.INCONCLUSIVE, reason=waits)]
        for result in map(self._expected, results):
            self.results.append(result)
            self.watcher.ended(result)
        enough = self.options.enough
        if enough is not None and len({result.whole for result in self.results if result.breaks}) >= enough:
            item.session.shouldstop = f"{enough} cases broke, which is enough"
        return True

    @property
    def _is_deferred(self) -> bool:
        """Whether outputs are seen only after the run."""
        return self.bench.observer is not None and self.bench.observer.deferred

    def _try(self, item: pytest.Function, parts: Sequence[CatalogueCase]) -> list[Result]:
        """Run a case once, unless it is known beforehand that it cannot be judged: then nothing is sent."""
        self.bench.forget()
        self.bench.tried = [0, 0]
        self.bench.line.watch.begin()
        self._too_slow = False
        began = time.perf_counter()
        case = parts[0]
        try:
            self._check(case)
        except (Inconclusive, NotApplicable) as error:
            self._outcome = verdict_of(error, case.about)
        else:
            self._outcome, self._trying = (Verdict.PASS, ""), True
            try:
                # Without the next item, which may be decided without pytest.
                item.ihook.pytest_runtest_protocol(item=item, nextitem=None)
            finally:
                self._trying = False
        wrong = self.bench.line.watch.wrong
        if wrong and self.options.profile.reason_for("", "", (CLOCK_CLAUSE,)) is None:
            self._outcome = Verdict.FAIL, "; then: ".join(filter(None, (wrong[0], self._outcome[1])))
            self._too_slow = False
        verdict, reason = self._outcome
        results = [replace(case.result, verdict=verdict, reason=reason)]
        if len(parts) > 1:
            results.append(self._of_outputs(parts[1], results[0]))
        elif self.bench.looks and not self._is_deferred:
            seen = _looked(case.result, case.about, self.bench.looks)
            if seen.verdict is not Verdict.PASS or verdict is Verdict.PASS:
                results = [seen]  # the defect was seen before the case itself ended
        whole = any(result.verdict in (Verdict.FAIL, Verdict.WARN) for result in results)
        whole |= self._is_deferred and bool(self.bench.looks)  # which may still fail
        evidence = self.bench.evidence(whole=whole)
        results = [replace(result, evidence=(*evidence, *result.evidence)) for result in results]
        tried, of = self.bench.tried
        results[0] = replace(results[0], seconds=time.perf_counter() - began, tried=(tried, of) if tried < of else None)
        return results

    def _of_outputs(self, part: CatalogueCase, case: Result) -> Result:
        """The verdict on the outputs of a case, as far as they are seen by now."""
        blank = replace(part.result, verdict=case.verdict, reason=case.reason)
        if case.verdict is Verdict.NOT_APPLICABLE:
            return blank
        try:
            self._check(part)
        except (Inconclusive, NotApplicable) as error:
            verdict, reason = verdict_of(error, part.about)
            return replace(blank, verdict=verdict, reason=reason)
        looks = self.bench.looks
        seen = part.result if looks and self._is_deferred else _looked(part.result, part.about, looks)
        if case.verdict is Verdict.PASS or seen.verdict is Verdict.FAIL:
            return seen
        if case.verdict is Verdict.INCONCLUSIVE:
            return blank
        return replace(blank, verdict=Verdict.INCONCLUSIVE, reason="the case failed before its outputs were judged")

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(
        self, item: pytest.Function, call: pytest.CallInfo[None]
    ) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        """Keep the verdict of a case's first exception."""
        report = yield
        if call.excinfo is not None:
            error, about = call.excinfo.value, _about(item)
            assert about is not None
            if not isinstance(error, Exception):  # a signal, which pytest takes for an ordinary failure
                self.interruption = error
                item.session.shouldstop = "interrupted"
            if self._outcome[0] is Verdict.PASS:
                self.bench.over(error)
                self._outcome = verdict_of(error, about)
                self._too_slow = isinstance(error, TooSlow)
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
        """Let a signal that exits the program end pytest as Ctrl-C does, without a message."""
        try:
            return (yield)
        except SystemExit as error:
            self.interruption = error
            raise pytest.Session.Interrupted("a signal") from error

    def pytest_keyboard_interrupt(self, excinfo: pytest.ExceptionInfo[BaseException]) -> None:
        """Note that somebody pressed Ctrl-C; pytest's own end of a session looks the same."""
        if not isinstance(excinfo.value, pytest.Session.Interrupted):
            self.interruption = excinfo.value

    def pytest_internalerror(self, excinfo: pytest.ExceptionInfo[BaseException]) -> bool:
        """Note what ended the run outside a case: a signal, or a defect of the suite."""
        if isinstance(excinfo.value, Exception):
            self.trouble.append(f"the suite failed by itself: {type(excinfo.value).__name__}: {excinfo.value}")
        else:
            self.interruption = excinfo.value
        return True

    @property
    def awaits_recording(self) -> bool:
        """Whether cases can only be judged after a recording is there."""
        return bool(self._pending)

    def look(self) -> None:
        """Judge what needs the recording; the watcher is told of each case once more."""
        of = len(self._pending)
        while self._pending:
            index, part, looks = self._pending[0]
            result = replace(self.results[index], verdict=Verdict.PASS, reason="")
            self.watcher.began(result.case, of - len(self._pending) + 1, of)
            result = _looked(result, part.about, looks)
            if result.verdict is Verdict.FAIL:
                told = Evidence("run again", "no: the outputs were judged after the run, from its recording")
                result = replace(result, evidence=(*result.evidence, told))
            self.results[index] = self._expected(result)
            del self._pending[0]
            self.watcher.ended(self.results[index])

    def finish(self, ended_by: str = "") -> None:
        """Note what was not judged, and known failures that no longer fail.

        Parameters
        ----------
        ended_by : str
            What ended the run early; empty if it was completed.
        """
        for index, _, _ in self._pending:
            reason = f"{ended_by} ended the run before its outputs were judged"
            self.results[index] = replace(self.results[index], reason=reason)
        if ended_by:
            reason = f"{ended_by} ended the run before this was judged"
            left = self._asked[len(self.results) :]
            self.results += [replace(entry.result, verdict=Verdict.INCONCLUSIVE, reason=reason) for entry in left]
        self.trouble += self._passes()

    def _expected(self, result: Result) -> Result:
        """The same with the reason why it is known to fail, by its whole name or, if that fails, without parameter."""
        known = self.options.known
        bare = known.get(result.case.partition("[")[0]) if result.verdict is Verdict.FAIL else None
        return replace(result, known=known.get(result.case, bare))

    def _passes(self) -> Iterator[str]:
        """Known failures without parameter of which no part fails any more."""
        for name in self.options.known:
            parts = [result for result in self.results if result.case.startswith(f"{name}[")]
            verdicts = {result.verdict for result in parts}
            if Verdict.PASS in verdicts and Verdict.FAIL not in verdicts:
                yield f"the known failure {name!r} fails in none of its parts"


def _naming_nothing(profile: Profile, names: set[str]) -> Iterator[str]:
    """Complaints about entries of a profile that are neither clause nor group nor case."""
    for name in profile.not_applicable:
        if name not in names:
            try:
                resolve(name)
            except ValueError as error:
                yield f"the profile says that {name!r} does not apply, which is neither a group nor a case: {error}"


def _looked(result: Result, about: Case, looks: Iterable[Callable[[], str]]) -> Result:
    """A result with the verdict on the outputs, up to the first failed judgement."""
    seen = list[Evidence]()
    try:
        seen.extend(Evidence(OUTPUTS, look()) for look in looks)
        if not seen:
            raise Inconclusive("the case looked at no outputs")
    except Exception as error:
        verdict, reason = verdict_of(error, about)
        result = replace(result, verdict=verdict, reason=reason)
    return replace(result, evidence=(*result.evidence, *seen))


def _twice(first: Result, again: Result) -> Result:
    """The result of a case that was run again because it, or its outputs, failed.

    It stays a failure if it failed once, whatever the other attempt gave.
    """
    if first.verdict is not Verdict.FAIL:
        if again.verdict is not Verdict.FAIL:
            return first
        first, again = again, first
    if again.verdict is not Verdict.FAIL:
        then = f"{again.verdict}, {again.reason}" if again.reason else str(again.verdict)
        reason = f"{first.reason}; the other time: {then}"
    elif again.reason != first.reason:
        reason = f"{first.reason}; the other time: {again.reason}"
    else:
        reason = first.reason
    return replace(first, reason=reason, again=again.verdict, seconds=first.seconds + again.seconds)


def verdict_of(error: BaseException, about: Case) -> tuple[Verdict, str]:
    """The verdict of an exception, and the reason."""
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
