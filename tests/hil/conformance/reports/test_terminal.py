"""The report of a run, with and without a terminal."""

from __future__ import annotations

import re
from dataclasses import replace
from io import StringIO

from phasewire.hil.conformance.reports.terminal import LiveLine, print_run
from phasewire.hil.conformance.verdicts import Run
from rich.console import Console

from tests.hil.conformance.hand_made_runs import CLEAN, DECISIVE, EVERY


def console(*, terminal: bool, width: int = 100) -> Console:
    return Console(
        file=StringIO(),
        force_terminal=terminal,
        width=width,
        markup=False,
        emoji=False,
        highlight=False,
        soft_wrap=True,
        color_system=None,
        _environ={},
    )


def written(out: Console) -> str:
    assert isinstance(out.file, StringIO)
    return out.file.getvalue()


def told(run: Run) -> str:
    out = console(terminal=False)
    print_run(out, run)
    return written(out)


def watched(out: Console, times: int = 1) -> str:
    with LiveLine(out) as watcher:
        for number, result in list(enumerate(EVERY.results, start=1)) * times:
            watcher.began(result.case, number, len(EVERY.results))
            watcher.ended(result)
    return written(out)


BROKE = ["fail  blocks/bad[a b]: failed 2 of 2: the state is OFF, should be READY", "unexpected pass  blocks/healed"]


def test_without_a_terminal_each_failure_and_each_group_has_a_line_that_stays() -> None:
    assert watched(console(terminal=False)).splitlines() == [
        *BROKE,
        "4/9  blocks: 2 pass, 2 fail",
        "8/9  usb: 1 warn, 3 inconclusive",
        "9/9  serial: 1 not applicable",
    ]


def test_a_step_for_the_user_is_shown_with_and_without_a_terminal() -> None:
    for terminal in (True, False):
        out = console(terminal=terminal)
        LiveLine(out).waits("end the recording")
        assert "Now: end the recording\n" in written(out)


def test_on_a_terminal_one_line_follows_the_cases_and_what_breaks_stays() -> None:
    shown = watched(console(terminal=True))
    assert "2/9  blocks/bad[a b]" in shown
    stays = [line.split("\x1b[2K")[-1] for line in shown.split("\n")]
    assert stays == [*BROKE, ""]
    assert shown.count("\n") == 2


def test_a_failure_is_shown_with_what_a_repair_needs() -> None:
    text = told(EVERY)
    after = text.partition("\nfail  blocks/bad[a b]\n")[2].partition("\n\n")[0].splitlines()
    assert [line.strip() for line in after] == [
        "A bad block is refused, for damage must not play.",
        "failed 2 of 2: the state is OFF, should be READY",
        "Run again with --only 'blocks/bad[a b]': it failed again after a restart",
        "shows BLK-003, ACK-003/1",
        "… and 4 before these and 1 after the end, in --json",
        *(f"step {number}: {number:02x} 00" for number in range(5, 11)),
        "device: <script>alert(1)</script> & \"quoted\" 'text' ]]> [31m [red] Ωµ",
        "records: acknowledgement 7 accepted ✗ ACK-002: it is wrong",
        f"{DECISIVE.text[:95]}… (606 characters)",
    ]


def test_no_control_character_of_a_device_reaches_the_terminal() -> None:
    assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]", told(EVERY))


def test_failures_come_before_warnings_before_what_was_not_judged_and_the_verdict_is_last() -> None:
    text = told(EVERY)
    places = [
        text.index(part)
        for part in (
            "fail  blocks/bad",
            "unexpected pass  blocks/healed",
            "It was expected to fail, and did not: revision B",
            "warn  usb/slow",
            "    2 cases: needs an analyser: --capture X\n    1 case: needs --allow reset\n",
            "    1 case: no UART is fitted\n",
            "    blocks/known: revision C (failed 1 of 2)\n",
            "    known failure blocks/ghost names no case\n",
            "url emulator:, name Array <b>, unique id A&B, firmware 1.2.3\nsuite phasewire 0.1.0",
            "FAIL: 2 of 9 cases broke",
        )
    ]
    assert places == sorted(places)
    assert text.splitlines()[-1].startswith("FAIL: 2 of 9")


def test_a_clean_run_says_little() -> None:
    lines = told(CLEAN).splitlines()
    assert lines[-1] == "PASS: nothing broke; the only case that ran passed"
    assert not any(line.endswith(":") for line in lines)


def test_a_reason_of_several_lines_is_indented_whole_and_wrapped_on_a_terminal_alone() -> None:
    long = "first line\n" + " ".join(50 * ["word"])
    run = replace(CLEAN, results=(replace(EVERY.results[1], reason=long, evidence=()),))
    assert "    failed 2 of 2: first line\n    word word" in told(run)
    assert f"    {long.splitlines()[1]}\n" in told(run)
    out = console(terminal=True, width=60)
    print_run(out, run)
    wrapped = [line for line in written(out).splitlines() if "word" in line]
    assert len(wrapped) == 5
    assert all(line.startswith("    ") and len(line) <= 60 for line in wrapped)
