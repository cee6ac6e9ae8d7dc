"""How cases become verdicts, by hand-made cases against an emulated device."""

from __future__ import annotations

import re
import signal
import sys
import textwrap
from collections.abc import Hashable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from phasewire.base.errors import DeviceError, DeviceNotFoundError
from phasewire.emulator import Emulator
from phasewire.emulator.control.requests import Requests
from phasewire.hil.conformance import Result, Run, Verdict, running
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Risk
from phasewire.hil.conformance.plugin import Judge, Watcher
from phasewire.hil.conformance.profile import Profile
from phasewire.hil.conformance.reports.summary import advice
from phasewire.hil.conformance.running import RunOptions, catalogue, run_conformance
from phasewire.hil.conformance.verdicts import Evidence
from phasewire.protocol.codes import State

pytestmark = pytest.mark.slow  # each is a run of the suite

HEAD = """
from __future__ import annotations
import pytest
from phasewire.emulator import faults
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Inconclusive, Need, NotApplicable, Risk, case, expect
from phasewire.protocol.blocks import NoOp, Update
from phasewire.protocol.codes import Feature, Request, State
from phasewire.protocol.pulses import Pulses
"""
ALL_VERDICTS = '''
@case("BLK-020")
def test_that_passes(bench: Bench) -> None:
    """A block that does nothing is accepted, for
    hosts live by it."""
    bench.must(NoOp())

@case("BLK-020", "ACK-001")
def test_that_fails(bench: Bench) -> None:
    """It fails."""
    expect("the state", bench.status().state, State.PLAYING)

@case("BLK-020", should=True)
def test_that_warns(bench: Bench) -> None:
    """It should not be so."""
    assert not bench.info, "there is a device"

@case("BLK-020")
def test_that_cannot_tell(bench: Bench) -> None:
    """It cannot tell."""
    raise Inconclusive("nobody looks")

@case("BLK-020")
def test_that_does_not_apply(bench: Bench) -> None:
    """It does not apply."""
    raise NotApplicable("it has no wheels")

@pytest.mark.parametrize("kind", ["one", "two"])
@case("BLK-020")
def test_of_kinds(bench: Bench, kind: str) -> None:
    """It has parameters."""

@case("BLK-020")
def test_that_is_wrong_itself(bench: Bench) -> None:
    """It is wrong itself."""
    raise TypeError("oh")

@case("BLK-020")
def test_that_asks_in_vain(bench: Bench) -> None:
    """Something is answered with STALL."""
    bench.order(Request.LIMIT, 60_000)
'''


@pytest.fixture
def groups(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of groups, which is empty."""
    monkeypatch.setattr(running, "GROUPS", tmp_path)
    return tmp_path


def write(groups: Path, name: str, cases: str) -> None:
    """Write a group, which pytest must not take for another one of that name."""
    sys.modules.pop(f"test_{name}", None)
    (groups / f"test_{name}.py").write_text(HEAD + textwrap.dedent(cases), encoding="utf-8")


def run_group(
    groups: Path, name: str, cases: str, watcher: Watcher | None = None, url: str = "emulator:", **options: Any
) -> Run:
    """Write a group, and run the folder of groups."""
    write(groups, name, cases)
    return run_conformance(RunOptions(url, **options), watcher)


def judged(run: Run) -> dict[str, Verdict]:
    return {result.case: result.verdict for result in run.results}


def test_what_a_case_does_decides_its_verdict(groups: Path) -> None:
    run = run_group(groups, "some_things", ALL_VERDICTS)
    assert judged(run) == {
        "some-things/that-passes": Verdict.PASS,
        "some-things/that-fails": Verdict.FAIL,
        "some-things/that-warns": Verdict.WARN,
        "some-things/that-cannot-tell": Verdict.INCONCLUSIVE,
        "some-things/that-does-not-apply": Verdict.NOT_APPLICABLE,
        "some-things/of-kinds[one]": Verdict.PASS,
        "some-things/of-kinds[two]": Verdict.PASS,
        "some-things/that-is-wrong-itself": Verdict.FAIL,
        "some-things/that-asks-in-vain": Verdict.FAIL,
    }
    by_name = {result.case.partition("/")[2]: result for result in run.results}
    assert by_name["that-fails"].reason == "the state is OFF, should be PLAYING"
    assert by_name["that-fails"].clauses == ("BLK-020", "ACK-001")
    assert by_name["that-passes"].reason == ""
    assert by_name["that-passes"].sentence == "A block that does nothing is accepted, for hosts live by it."
    assert by_name["that-cannot-tell"].reason == "nobody looks"
    assert by_name["that-is-wrong-itself"].reason == "the suite did not expect this: TypeError: oh"
    assert by_name["that-asks-in-vain"].reason == "LIMIT with value 60000 is answered with STALL"
    assert not run.passed
    assert run.trouble == ()
    assert run.provenance.seed == 1
    assert run.provenance.capture == "emulator"
    assert run.provenance.device["url"] == "emulator:"


def test_a_case_leaves_its_blocks_requests_and_answers_as_evidence(groups: Path) -> None:
    (result,) = run_group(groups, "one", ALL_VERDICTS, only=("one/that-passes",)).results
    labels = [evidence.label for evidence in result.evidence]
    assert labels[:2] == ["block", "acknowledgement"]
    assert result.evidence[0].text.startswith("50 57 01 09 ")
    assert re.fullmatch(r"block NO_OP \d+, numbering anew: a sign of life", result.evidence[0].meaning)
    assert result.evidence[1].text.startswith("50 41 01 00 ")
    assert re.fullmatch(r"acknowledgement \d+ accepted, .*OFF at tick \d+, room for \d+", result.evidence[1].meaning)
    assert labels[-1] == "status at the end"
    assert [evidence.after for evidence in result.evidence] == [False] * (len(labels) - 1) + [True]


@pytest.mark.parametrize("url", ["emulator:", "emulator:?door=serial"])
def test_what_a_case_sends_by_itself_is_evidence_too(groups: Path, url: str) -> None:
    write(
        groups,
        "past",
        '''
        from phasewire.hil.conformance.tools.steps import forge, raw_records

        @case("CON-001")
        def test_text(bench: Bench) -> None:
            """Text of the console."""
            bench.serial.enter_console()
            bench.serial.command("clock")

        @case("BLK-003")
        def test_block(bench: Bench) -> None:
            """A block is refused."""
            raw_records(bench, [forge(bench, NoOp(), checksum=0)])
        ''',
    )
    text, block = (
        [(each.label, each.text, each.meaning) for each in result.evidence]
        for result in run_conformance(RunOptions(url)).results
    )
    sent = text.index(("to the serial line", b"clock\r".hex(" "), r"text clock\r"))
    assert text[sent + 1][0] == "from the serial line"
    assert text[sent + 1][2].startswith("text now: ")
    assert [label for label, _, _ in block] == ["block", "records", "status at the end"]
    assert block[0][1].startswith("50 57 01 09 ")
    assert re.match(r"block NO_OP \d+, .* ✗ CHECKSUM BLK-003: ", block[0][2])
    assert re.match(r"acknowledgement \d+ refused, CHECKSUM: ", block[1][2])


def test_evidence_ends_with_the_decisive_piece_and_the_rest_is_clean_up(groups: Path) -> None:
    """Whatever a case does in `finally`, as putting firmware back, and the bench after it."""
    fails, another, _, looks = run_group(
        groups,
        "past",
        '''
        from phasewire.hil.conformance.tools.steps import forge, pack, raw_records

        @case("BLK-003")
        def test_fails(bench: Bench) -> None:
            """It fails, and puts things back."""
            bench.status()
            try:
                raw_records(bench, [forge(bench, NoOp(), checksum=0)])
                raise AssertionError("a reason")
            finally:
                for _ in range(100):
                    bench.order(Request.WATCHDOG, 100)

        @case("BLK-003")
        def test_hears_another_answer(bench: Bench) -> None:
            """The answer to another block comes."""
            bench.line.send_blocks(pack(bench.numbered(NoOp(), number=7)), 1)
            bench.send(NoOp())

        @case("BLK-020", outputs=("SAF-004/1",))
        def test_looks(bench: Bench) -> None:
            """Its outputs are wrong in the middle."""
            bench.wait_periods(3)
            bench.judge(0, 1, lambda seen: expect("it", 1, 2))
            bench.status()
        ''',
    ).results
    assert [each.label for each in fails.evidence if not each.after] == ["STATUS", "block", "records"]
    assert [each.label for each in fails.evidence][3:5] == ["request", "answer"]
    assert {each.meaning for each in fails.evidence[3:-1:2]} == {"request WATCHDOG 100"}
    assert fails.evidence[-1] == Evidence("…", "144 more", after=True)
    decisive = [each for each in another.evidence if not each.after][-1]
    assert decisive.meaning.startswith("acknowledgement 7 accepted, ")
    assert (looks.verdict, looks.reason) == (Verdict.FAIL, "it is 1, should be 2")
    assert [each.label for each in looks.evidence if each.after] == ["STATUS", "status at the end"]


def test_a_run_may_end_when_enough_broke(groups: Path) -> None:
    run = run_group(groups, "some_things", ALL_VERDICTS, enough=2)
    assert sum(result.breaks for result in run.results) == 2
    assert run.results[-1].case == "some-things/that-is-wrong-itself"


def test_known_failures_do_not_break_a_run_but_their_passes_and_unknown_ones_do(groups: Path) -> None:
    write(groups, "some_things", ALL_VERDICTS)
    known = {f"some-things/{name}": "we know" for name in ("that-fails", "that-is-wrong-itself", "that-asks-in-vain")}
    run = run_conformance(RunOptions("emulator:", known=known))
    assert run.passed
    assert {result.known for result in run.results} == {None, "we know"}
    unexpected = run_conformance(RunOptions("emulator:", known=known | {"some-things/that-passes": "we thought"}))
    assert [result.case for result in unexpected.results if result.breaks] == ["some-things/that-passes"]
    unknown = run_conformance(RunOptions("emulator:", known=known | {"no/such-case": "it was renamed"}))
    assert unknown.trouble == ("the known failure 'no/such-case' names no case",)
    assert not unknown.passed


def test_a_known_failure_without_parameter_stands_for_all_parts(groups: Path) -> None:
    run = run_group(
        groups,
        "parts",
        '''
        @pytest.mark.parametrize("part", ["good", "bad"])
        @case("BLK-020")
        def test_it(bench: Bench, part: str) -> None:
            """One part fails."""
            expect("the part", part, "good")

        @pytest.mark.parametrize("part", ["one", "two"])
        @case("BLK-020")
        def test_that(bench: Bench, part: str) -> None:
            """None fails."""
        ''',
        known={"parts/it": "we know"},
    )
    assert run.passed
    assert [result.known for result in run.results] == [None, "we know", None, None]
    mended = run_conformance(RunOptions("emulator:", known={"parts/it": "we know", "parts/that": "we knew"}))
    assert mended.trouble == ("the known failure 'parts/that' fails in none of its parts",)


def test_a_profile_takes_out_what_does_not_apply(groups: Path) -> None:
    write(groups, "some_things", ALL_VERDICTS)
    profile = Profile("mine", {"ACK-001": "no records", "some-things/that-is-wrong-itself": "gone"})
    run = run_conformance(RunOptions("emulator:", profile=profile))
    verdicts = judged(run)
    assert verdicts["some-things/that-fails"] is Verdict.NOT_APPLICABLE
    assert verdicts["some-things/that-is-wrong-itself"] is Verdict.NOT_APPLICABLE
    assert verdicts["some-things/that-passes"] is Verdict.PASS
    assert run.provenance.profile == "mine"


GATED = '''
@case("SAF-001", allow=(Risk.RESET,))
def test_a_risk(bench: Bench) -> None:
    """It restarts the device."""

@case("SAF-001", needs=(Need.CAPTURE,))
def test_a_need(bench: Bench) -> None:
    """It looks at the outputs."""
    bench.judge(bench.period(), bench.period() + 2, lambda seen: expect("the outputs", seen.words.any(), False))

@case("SAF-001", needs=(Need.FAULTS,))
def test_a_fault(bench: Bench) -> None:
    """It lets something go wrong."""

@case("SAF-001", line="usb")
def test_usb(bench: Bench) -> None:
    """It is about USB."""
    assert bench.usb.serial
'''


def test_what_is_not_allowed_or_not_there_is_inconclusive(groups: Path) -> None:
    allowed = judged(run_group(groups, "gated", GATED))
    assert set(allowed.values()) == {Verdict.PASS}
    run = run_conformance(RunOptions("emulator:?door=serial", capture="none", allowed=frozenset({Risk.DRIVE})))
    assert [(result.verdict, result.reason) for result in run.results] == [
        (Verdict.INCONCLUSIVE, "not allowed: pass --allow reset"),
        (Verdict.INCONCLUSIVE, "needs a capture of the outputs: pass --capture sigrok:FILE"),
        (Verdict.PASS, ""),
        (Verdict.INCONCLUSIVE, "not on this line: it is about USB, and the device is on a serial line"),
    ]


HALF_SEEN = '''
@pytest.mark.parametrize("kind", ["sound", "answers", "outputs", "both", "unsure"])
@case("STA-003", outputs=("SAF-001",))
def test_it(bench: Bench, kind: str) -> None:
    """Answers and outputs each show a part of it."""
    loud = kind in ("outputs", "both")
    bench.judge(bench.period(), bench.period() + 2, lambda seen: expect("the outputs", bool(seen.words.any()), loud))
    if kind == "unsure":
        raise Inconclusive("the line is slow")
    expect("the state", bench.status().state, State.PLAYING if kind in ("answers", "both") else State.OFF)

@case("STA-003", outputs=("SAF-001",))
def test_blind(bench: Bench) -> None:
    """It never looks."""
'''
SILENT = "the outputs is False, should be True"
OFF = "the state is OFF, should be PLAYING"
NOT_SEEN = "needs a capture of the outputs: pass --capture sigrok:FILE"
CUT_SHORT = "the case failed before its outputs were judged"


def test_what_only_the_outputs_show_has_a_verdict_of_its_own(groups: Path) -> None:
    run = run_group(groups, "half", HALF_SEEN, again=False)
    assert {result.case: (result.clauses, result.verdict, result.reason) for result in run.results} == {
        "half/it[sound]": (("STA-003",), Verdict.PASS, ""),
        "half/it#outputs[sound]": (("SAF-001",), Verdict.PASS, ""),
        "half/it[answers]": (("STA-003",), Verdict.FAIL, OFF),
        "half/it#outputs[answers]": (("SAF-001",), Verdict.INCONCLUSIVE, CUT_SHORT),
        "half/it[outputs]": (("STA-003",), Verdict.PASS, ""),
        "half/it#outputs[outputs]": (("SAF-001",), Verdict.FAIL, SILENT),
        "half/it[both]": (("STA-003",), Verdict.FAIL, OFF),
        "half/it#outputs[both]": (("SAF-001",), Verdict.FAIL, SILENT),
        "half/it[unsure]": (("STA-003",), Verdict.INCONCLUSIVE, "the line is slow"),
        "half/it#outputs[unsure]": (("SAF-001",), Verdict.INCONCLUSIVE, "the line is slow"),
        "half/blind": (("STA-003",), Verdict.PASS, ""),
        "half/blind#outputs": (("SAF-001",), Verdict.INCONCLUSIVE, "the case looked at no outputs"),
    }


def test_without_sight_answers_are_judged_and_outputs_are_not(groups: Path) -> None:
    run = run_group(groups, "half", HALF_SEEN, capture="none", again=False)
    answers = [(result.case, result.verdict) for result in run.results if "#" not in result.case]
    assert answers == [
        ("half/it[sound]", Verdict.PASS),
        ("half/it[answers]", Verdict.FAIL),
        ("half/it[outputs]", Verdict.PASS),
        ("half/it[both]", Verdict.FAIL),
        ("half/it[unsure]", Verdict.INCONCLUSIVE),
        ("half/blind", Verdict.PASS),
    ]
    outputs = {(result.verdict, result.reason) for result in run.results if "#" in result.case}
    assert outputs == {(Verdict.INCONCLUSIVE, NOT_SEEN)}


def test_the_part_at_the_outputs_is_called_by_its_name(groups: Path) -> None:
    write(groups, "half", HALF_SEEN)
    assert [entry.identifier for entry in catalogue()][:2] == ["half/it[sound]", "half/it#outputs[sound]"]
    assert len(run_conformance(RunOptions("emulator:", only=("SAF-001",))).results) == 12  # with the cases themselves
    parts = RunOptions("emulator:", only=("half/it#outputs",), known={"half/it#outputs": "we know"})
    known = run_conformance(parts)
    assert [result.case for result in known.results if result.known] == [
        "half/it#outputs[outputs]",
        "half/it#outputs[both]",
    ]
    assert [result.tally for result in known.results if result.known] == ["failed 2 of 2"] * 2
    waived = run_conformance(RunOptions("emulator:", profile=Profile("mine", {"SAF-001": "no outputs"}), again=False))
    assert judged(waived)["half/it[outputs]"] is Verdict.PASS
    assert judged(waived)["half/it#outputs[outputs]"] is Verdict.NOT_APPLICABLE
    cut = run_conformance(RunOptions("emulator:", enough=2, again=False))
    assert [result.whole for result in cut.results if result.breaks] == ["half/it[answers]", "half/it[outputs]"]


@pytest.mark.parametrize(
    ("cases", "what"),
    [
        ('@case("BLK-999")\ndef test_it(bench):\n    """It."""\n', "BLK-999"),
        ('@case("BLK-020")\ndef test_it(bench):\n    pass\n', "no sentence"),
        ("def test_it(bench):\n    pass\n", "no case"),
        ("import wheels\n", "wheels"),
    ],
)
def test_a_case_without_a_clause_or_a_sentence_cannot_be_collected(groups: Path, cases: str, what: str) -> None:
    write(groups, "bad", cases)
    with pytest.raises(RuntimeError, match=what):
        catalogue()
    run = run_group(groups, "bad", cases)
    assert len(run.trouble) == 1
    assert what in run.trouble[0]
    assert not run.passed


LOSING = '''
@case("SAF-001")
def test_first(bench: Bench) -> None:
    """It loses the device."""
    bench.levers.power_down()

@case("SAF-001")
def test_second(bench: Bench) -> None:
    """It finds it again if that is allowed."""
    bench.must(NoOp())

@case("SAF-001")
def test_third(bench: Bench) -> None:
    """So does this."""
    bench.must(NoOp())
'''


def test_a_device_that_is_lost_is_brought_back_if_that_is_allowed(groups: Path) -> None:
    assert list(judged(run_group(groups, "losing", LOSING)).values()) == [Verdict.PASS] * 3
    run = run_conformance(RunOptions("emulator:", allowed=frozenset()))
    assert list(judged(run).values()) == [Verdict.PASS, Verdict.FAIL, Verdict.INCONCLUSIVE]
    assert "cannot be brought back" in run.results[1].reason
    assert not run.passed


DRIVING = '''
@case("SAF-006")
def test_too_much(bench: Bench) -> None:
    """It drives too hard."""
    bench.send(Update(Pulses([0] * 320, [25] * 320)))

@case("SAF-006")
def test_as_much_as_is_allowed(bench: Bench) -> None:
    """It drives as hard as it may."""
    total = bench.weak().total_drive / 1000
    assert 0.9 * bench.drive_limit < total <= bench.drive_limit, f"{total}"
    bench.note("drive limit", bench.drive_limit)
    expect("the limit", bench.status().drive_limit, bench.drive_limit)
'''


def test_the_drive_is_low_unless_more_is_allowed(groups: Path) -> None:
    run = run_group(groups, "driving", DRIVING, allowed=frozenset({Risk.RESET}))
    first, second = run.results
    assert "a case drives 320 transducers; 32 are allowed here" in first.reason
    assert second.verdict is Verdict.PASS
    assert ("drive limit", "32") in [(evidence.label, evidence.text) for evidence in second.evidence]
    assert run_conformance(RunOptions("emulator:")).results[0].verdict is Verdict.PASS


def test_a_device_that_is_not_there_is_no_run(groups: Path) -> None:
    with pytest.raises(DeviceNotFoundError):
        run_conformance(RunOptions("emulator:NO-SUCH"))
    with pytest.raises(ValueError, match="not emulated in this process"):
        run_conformance(RunOptions("usb:", capture="emulator"))


def test_pytest_that_cannot_begin_is_trouble_of_the_run(
    groups: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(running, "GROUPS", groups / "missing")
    run = run_conformance(RunOptions("emulator:"))
    assert not run.passed
    (trouble,) = run.trouble
    assert re.fullmatch(r"pytest \S+ could not begin; standard error says why", trouble)
    assert "missing" in capfd.readouterr().err
    with pytest.raises(RuntimeError, match="could not begin"):
        catalogue()


LEAVING = '''
@case("SAF-003")
def test_changes(bench: Bench) -> None:
    """It leaves the outputs enabled, and other limits."""
    bench.order(Request.WATCHDOG, 10_000)
    bench.order(Request.LIMIT, 7)
    bench.enable()
    raise RuntimeError("and ends so")
'''


def test_a_device_is_left_as_at_power_up(groups: Path) -> None:
    write(groups, "leaving", LEAVING)
    with Emulator() as emulator:
        run_conformance(RunOptions(emulator.url, allowed=frozenset()))
        status = emulator.running.status()
    assert status.state is State.OFF
    assert (status.watchdog_ms, status.drive_limit) == (100, 320)


ENDING = '''
import sys

@case("BLK-020")
def test_first(bench: Bench) -> None:
    """It passes."""

@case("BLK-020")
def test_second(bench: Bench) -> None:
    """A signal comes."""
    END

@case("BLK-020")
def test_third(bench: Bench) -> None:
    """It is not reached."""
'''


@pytest.mark.parametrize(
    ("end", "number", "name"),
    [("sys.exit(143)", signal.SIGTERM, "SIGTERM"), ("raise KeyboardInterrupt", signal.SIGINT, "Ctrl-C")],
)
def test_a_signal_ends_a_run_which_tells_what_was_judged_and_what_was_not(
    groups: Path, end: str, number: int, name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    write(groups, "ending", ENDING.replace("END", end))
    ended: list[str] = []

    class Told(Watcher):
        def ended(self, result: Result) -> None:
            ended.append(result.case)

    with Emulator() as emulator:
        run = run_conformance(RunOptions(emulator.url), Told())
        assert emulator.running.status().state is State.OFF
    assert ended == ["ending/first"]
    assert list(judged(run).values()) == [Verdict.PASS, Verdict.INCONCLUSIVE, Verdict.INCONCLUSIVE]
    assert {result.reason for result in run.results[1:]} == {f"{name} ended the run before this was judged"}
    assert (run.signal, run.interrupted_by, run.passed) == (number, name, False)
    assert capfd.readouterr() == ("", "")  # not a word of pytest's


def test_a_signal_between_cases_ends_a_run_too(groups: Path, capfd: pytest.CaptureFixture[str]) -> None:
    write(groups, "ending", ENDING.replace("END", "pass"))

    class Impatient(Watcher):
        def began(self, case: str, number: int, of: int) -> None:
            if number == 2:
                raise SystemExit(143)

    run = run_conformance(RunOptions("emulator:"), Impatient())
    assert list(judged(run).values()) == [Verdict.PASS, Verdict.INCONCLUSIVE, Verdict.INCONCLUSIVE]
    assert run.signal == signal.SIGTERM
    assert capfd.readouterr() == ("", "")


FLAKY = '''
tries = []

@case("BLK-020")
def test_now_and_then(bench: Bench) -> None:
    """It fails the first time."""
    tries.append(bench.random.random())
    bench.enable()
    expect("the number of tries", len(tries), 2)

@case("BLK-020")
def test_always(bench: Bench) -> None:
    """It finds the device at rest, and fails."""
    expect("the state", bench.status().state, State.PLAYING)

@case("BLK-020")
def test_otherwise(bench: Bench) -> None:
    """It fails in another way each time."""
    tries.append(bench.random.random())
    expect("the number of tries", len(tries), 0)

@case("BLK-020")
def test_the_same_is_drawn(bench: Bench) -> None:
    """Each try draws the same."""
    expect("what was drawn", tries[0], tries[1])
'''


def test_a_case_that_fails_is_run_again_and_stays_a_failure(groups: Path) -> None:
    run = run_group(groups, "flaky", FLAKY, known={"flaky/always": "we know"})
    assert [(result.verdict, result.tally, result.reason) for result in run.results] == [
        (Verdict.FAIL, "failed 1 of 2", "the number of tries is 1, should be 2; the other time: pass"),
        (Verdict.FAIL, "failed 2 of 2", "the state is OFF, should be PLAYING"),
        (
            Verdict.FAIL,
            "failed 2 of 2",
            "the number of tries is 3, should be 0; the other time: the number of tries is 4, should be 0",
        ),
        (Verdict.PASS, "", ""),
    ]
    assert [result.breaks for result in run.results] == [True, False, True, False]


INHERITED = '''
@case("BLK-020")
def test_before(bench: Bench) -> None:
    """It leaves a count behind, which the device keeps until a restart."""
    bench.enable()
    bench.must(NoOp())

@case("BLK-020")
def test_it_needs_what_ran_before(bench: Bench) -> None:
    """It fails after the other case, and not after a restart."""
    accepted = bench.status().accepted
    assert accepted == 0, f"{accepted} blocks were accepted before, should be 0"

@case("BLK-020")
def test_it_needs_nothing(bench: Bench) -> None:
    """It always fails."""
    expect("the state", bench.status().state, State.PLAYING)
'''
REPEATED = [
    (
        frozenset({Risk.RESET}),
        [("failed 1 of 2", True, "--only inherited"), ("failed 2 of 2", True, "--only inherited/it-needs-nothing")],
    ),
    (frozenset[Risk](), [("failed 2 of 2", False, "--only inherited")] * 2),
]


@pytest.mark.parametrize(("allowed", "told"), REPEATED, ids=["reset", "no-reset"])
def test_a_second_try_begins_with_a_restart_and_the_report_says_how_to_run_it_again(
    groups: Path, allowed: frozenset[Risk], told: list[tuple[str, bool, str]]
) -> None:
    run = run_group(groups, "inherited", INHERITED, allowed=allowed)
    failed = run.results[1:]
    assert [(result.tally, result.fresh, result.run_again) for result in failed] == told
    needs = "it did not fail" if allowed else "the device was not restarted"
    assert needs in advice(failed[0])
    assert "may need what ran before it" in advice(failed[0])
    assert advice(run.results[0]) == run.results[0].run_again == ""


def test_a_missing_acknowledgement_is_reported_with_the_counter_that_moved(
    groups: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("phasewire.hil.conformance.dialogue.ACK_SECONDS", 0.1)
    (result,) = run_group(
        groups,
        "lost",
        '''
        @case("BLK-020")
        def test_it(bench: Bench) -> None:
            """Its block is damaged on the way."""
            bench.line.send_blocks = lambda blocks, _: (bench.line.write(b"\\0\\2\\2\\0"), len(blocks))[1]
            bench.must(NoOp())
        ''',
        url="emulator:?door=serial",
        again=False,
    ).results
    assert re.fullmatch(
        r"block \d+ is not acknowledged within 0.1 s; since the case began dropped_frames rose by 1", result.reason
    ), result.reason


def test_a_case_that_cannot_be_judged_sends_nothing(groups: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(groups, "gated", GATED)
    write(groups, "later", '@case("SAF-001")\ndef test_it(bench: Bench) -> None:\n    """It runs after those."""\n')
    begun: list[str] = []
    genuine = Bench.begin_case

    def begin(bench: Bench, name: str) -> None:
        begun.append(name)
        genuine(bench, name)

    monkeypatch.setattr(Bench, "begin_case", begin)
    run = run_conformance(RunOptions("emulator:?door=serial", capture="none", allowed=frozenset({Risk.DRIVE})))
    assert begun == ["gated/a-fault", "later/it"]
    assert run.passed


def test_a_mistake_of_the_suite_is_trouble(groups: Path) -> None:
    write(groups, "ending", ENDING.replace("END", "pass"))

    class Mistaken(Watcher):
        def ended(self, result: Result) -> None:
            raise TypeError("oh")

    run = run_conformance(RunOptions("emulator:"), Mistaken())
    assert run.trouble == ("the suite failed by itself: TypeError: oh",)
    assert not run.passed


def test_an_unknown_name_in_a_profile_is_trouble(groups: Path) -> None:
    write(groups, "some_things", ALL_VERDICTS)
    profile = Profile("mine", {"SER-999": "no", "wheels": "no", "some-things/of-kinds": "no", "SER-001": "no"})
    run = run_conformance(RunOptions("emulator:", profile=profile))
    assert [("SER-999" in text, "wheels" in text) for text in run.trouble] == [(True, False), (False, True)]


@pytest.mark.parametrize("versions", [(2, 3), (0, 0)])
def test_a_device_of_other_versions_is_not_judged(
    groups: Path, monkeypatch: pytest.MonkeyPatch, versions: tuple[int, int]
) -> None:
    write(groups, "some_things", ALL_VERDICTS)
    genuine = Requests.info
    oldest, newest = versions
    monkeypatch.setattr(
        Requests, "info", lambda self: replace(genuine(self), oldest_version=oldest, newest_version=newest)
    )
    with pytest.raises(DeviceError, match="speaks versions"):
        run_conformance(RunOptions("emulator:"))


def test_a_judge_can_be_a_plugin_of_any_pytest() -> None:
    """Before 9.1 pytest keeps plugins in a set."""
    assert issubclass(Judge, Hashable)
