"""Further lines of the device under test: which ones a run has, and what it says of those that it lacks."""

from __future__ import annotations

import pytest
from phasewire.emulator import Emulator
from phasewire.hil.conformance.running import RunOptions, open_bench, run_conformance
from phasewire.hil.conformance.verdicts import Verdict

pytestmark = pytest.mark.slow  # each is a run of the suite

CASE = "doors/changes-by-this-door-need-enable"
SERIAL = "?door=serial"


@pytest.mark.parametrize("own", ["", SERIAL])
@pytest.mark.parametrize("further", [True, False], ids=["with-the-other", "alone"])
def test_a_door_that_a_run_lacks_is_not_judged_and_the_run_says_so(
    monkeypatch: pytest.MonkeyPatch, own: str, further: bool
) -> None:
    with Emulator() as emulator:
        if not further:
            monkeypatch.setattr("phasewire.hil.conformance.running._doors", lambda _urls, _own: {})
        run = run_conformance(RunOptions(emulator.url + own, only=(CASE,), groups=("doors",)))
    here = {"usb", "cdc", "cdc-console"} if not own else {"uart", "uart-console"}
    judged = {
        result.case.partition("[")[2].rstrip("]"): result.reason
        for result in run.results
        if result.verdict is Verdict.INCONCLUSIVE
    }
    assert judged.keys() == (set() if further else {"usb", "cdc", "cdc-console", "uart", "uart-console"} - here)
    wanted = ("USB", "usb:", "USB-002") if own else ("UART", "serial:///dev/", "SER-001")
    assert all(word in reason for reason in judged.values() for word in wanted)


def test_a_door_to_another_device_is_refused() -> None:
    with Emulator() as emulator, Emulator() as other:
        with open_bench(RunOptions(emulator.url, doors=(emulator.url + SERIAL,))) as bench, bench.door("uart") as line:
            assert line.kind == "serial"
        with (
            pytest.raises(ValueError, match=r"leads to the device [0-9a-f]{16}, but this run judges [0-9a-f]{16}"),
            open_bench(RunOptions(emulator.url, doors=(other.url + SERIAL,))),
        ):
            pass


@pytest.mark.parametrize("doors", [("",), (SERIAL, SERIAL)], ids=["its-own", "twice"])
def test_a_second_line_of_the_same_kind_is_refused(doors: tuple[str, ...]) -> None:
    with Emulator() as emulator:
        urls = tuple(emulator.url + door for door in doors)
        with (
            pytest.raises(ValueError, match="has a line of that kind"),
            open_bench(RunOptions(emulator.url, doors=urls)),
        ):
            pass
