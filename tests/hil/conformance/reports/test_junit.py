"""JUnit XML, read by a parser that did not write it."""

from __future__ import annotations

from dataclasses import replace
from signal import SIGTERM
from xml.etree import ElementTree

from phasewire.hil.conformance.reports.junit import junit

from tests.hil.conformance.hand_made_runs import CLEAN, DECISIVE, EVERY

WHOLE = ElementTree.fromstring(junit(EVERY).encode())
CASES = {f"{case.get('classname')}/{case.get('name')}": case for case in WHOLE.iter("testcase")}


def only(case: str) -> str:
    """The result of a case, in JUnit's words."""
    kinds = [part.tag for part in CASES[case] if part.tag in ("failure", "error", "skipped")]
    assert len(kinds) <= 1
    return kinds[0] if kinds else ""


def message(case: str) -> str:
    part = CASES[case].find(only(case))
    assert part is not None
    return part.get("message", "")


def test_each_group_is_a_suite_with_its_numbers() -> None:
    numbers = {
        suite.get("name"): tuple(int(suite.get(key, "")) for key in ("tests", "failures", "errors", "skipped"))
        for suite in WHOLE.findall("testsuite")
    }
    assert numbers == {"blocks": (4, 2, 0, 1), "usb": (4, 0, 0, 3), "serial": (1, 0, 0, 1), "run": (1, 0, 1, 0)}
    assert tuple(WHOLE.get(key) for key in ("tests", "failures", "errors", "skipped")) == ("10", "2", "1", "5")
    assert WHOLE.get("time") == "0.750"


def test_what_breaks_is_a_failure_and_what_is_not_judged_is_skipped() -> None:
    assert {case: only(case) for case in CASES} == {
        "blocks/good": "",
        "blocks/bad[a b]": "failure",
        "blocks/known": "skipped",
        "blocks/healed": "failure",
        "usb/slow": "",
        "usb/lines": "skipped",
        "usb/more": "skipped",
        "usb/cut": "skipped",
        "serial/port": "skipped",
        "run/known failure blocks/ghost names no case": "error",
    }
    assert message("blocks/bad[a b]") == "failed 2 of 2: the state is OFF, should be READY"
    failure = CASES["blocks/bad[a b]"].findtext("failure") or ""
    lines = failure.splitlines()
    assert lines[:8] == [
        "failed 2 of 2: the state is OFF, should be READY",
        "shows BLK-003, ACK-003/1",
        "A bad block is refused, for damage must not play.",
        "Run again with --only 'blocks/bad[a b]': it failed again after a restart",
        "Last before the failure:",
        "records: acknowledgement 7 accepted ✗ ACK-002: it is wrong",
        f"    {DECISIVE.text[:95]}… (606 characters)",
        "Before that, in order:",
    ]
    assert lines[-1] == "… and 4 before these and 1 after the end, in --json"
    assert message("blocks/known") == "known failure: revision C; failed 1 of 2: it did"
    assert message("blocks/healed") == "expected to fail, and did not: revision B"
    assert message("usb/cut") == "inconclusive: needs --allow reset"
    assert message("serial/port") == "not applicable: no UART is fitted"
    assert (CASES["usb/slow"].findtext("system-out") or "").startswith("warn: it took 3 s\n")


def test_clauses_and_provenance_are_properties() -> None:
    bad = [(one.get("name"), one.get("value")) for one in CASES["blocks/bad[a b]"].iter("property")]
    assert bad == [("verdict", "fail"), ("clause", "BLK-003"), ("clause", "ACK-003/1")]
    suite = WHOLE.find("testsuite/properties")
    assert suite is not None
    told = {one.get("name"): one.get("value") for one in suite}
    assert (told["name"], told["unique id"], told["seed"]) == ("Array <b>", "A&B", "7")
    assert told["computer"] == "2 cores, load average 7.9 at the beginning and 8.1 at the end"
    assert (told["allowed"], told["capture"]) == ("reset, drive", "none")
    assert told["levers"] == "command:power=relay {}, scpi:1"


def test_evidence_is_the_output_and_what_xml_forbids_is_left_out() -> None:
    output = CASES["blocks/bad[a b]"].findtext("system-out") or ""
    assert "step 1: 01 00\nstep 2: 02 00\n" in output
    assert "device: <script>alert(1)</script> & \"quoted\" 'text' ]]> [31m [red] Ωµ\n" in output
    assert output.endswith(f"✗ ACK-002: it is wrong\n    {DECISIVE.text}\nstatus at the end: state OFF")


def test_an_interrupted_run_is_an_error() -> None:
    whole = ElementTree.fromstring(junit(replace(CLEAN, signal=SIGTERM)).encode())
    assert (whole.get("errors"), whole.get("name")) == (
        "1",
        "phasewire conformance: INTERRUPTED by SIGTERM: nothing broke so far, 1 passed",
    )
    assert [error.get("message") for error in whole.iter("error")] == ["interrupted by SIGTERM"]
