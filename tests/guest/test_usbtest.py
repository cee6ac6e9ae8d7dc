"""The kernel's own tests of a USB device, usbtest, on the board and on a device that has all they need."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import pytest
from phasewire.hil.conformance.guest import Guest

from .conftest import FAR, Bench

pytestmark = pytest.mark.guest

PROGRAM = Path(__file__).with_name("usbtest.py")
SOURCE_SINK_PROGRAM = Path(__file__).with_name("source_sink.py")
SECONDS = 120.0
OTHER_INTERFACES = re.compile(r"usbtest.* 1-1:1\.[123].* failed with error -22")
"""Usbtest looks at all interfaces that have no driver yet, and needs a bulk endpoint in either direction."""


@dataclass(frozen=True)
class Case:
    """A case of usbtest and its numbers; what they mean depends on the case."""

    case: int
    iterations: int = 1
    length: int = 0
    vary: int = 0
    count: int = 0
    pattern: int = 0
    hold: bool = False


CONTROL = (Case(0), Case(9, 5), Case(10, 5, count=32))
BOARD = (
    *CONTROL,
    Case(1, 20, 512),
    Case(3, 20, 2048, vary=512),
    Case(5, 5, 1024, count=8),
    Case(7, 5, 1024, vary=512, count=8),
    Case(11, 10, 512),
    Case(17, 10, 512),
    Case(19, 10, 512),
    Case(24, 5, 512, count=8),
    Case(27, 2, 1024, count=8),
    Case(29, 5),
)
"""The board takes blocks and has nothing to say before it was asked."""

SOURCE_SINK = (
    *CONTROL,
    *(Case(number, 20, 4096, pattern=1) for number in (1, 2)),
    Case(3, 20, 4096, vary=421, pattern=1),
    Case(4, 20, 4096, vary=512, pattern=1),
    *(Case(number, 5, 4096, count=16, pattern=1) for number in (5, 6)),
    Case(7, 5, 4096, vary=421, count=16, pattern=1),
    Case(8, 5, 4096, vary=512, count=16, pattern=1),
    *(Case(number, 10, 4096, hold=True) for number in (11, 12)),
    Case(13, 5, pattern=1),
    *(Case(14, 5, length) for length in (1, 63, 64, 65, 512, 4096)),
    *(Case(number, 20, 4096, pattern=1) for number in (17, 18, 19, 20)),
    Case(21, 5, 4096),
    Case(24, 10, 4096, count=16),
    *(Case(number, 20, 512, pattern=1) for number in (25, 26)),
    *(Case(number, 10, 16384, count=16) for number in (27, 28)),
    Case(29, 5, pattern=1),
)


@pytest.fixture
def usbtest(guest: Guest, tmp_path: Path) -> Iterator[Bench]:
    """A guest without a server; the driver usbtest is unloaded at the end."""
    bench = Bench(guest, tmp_path)
    yield bench
    bench.stop()
    bench.check("modprobe", "-r", "usbtest")


def judge(bench: Bench, ids: str, cases: tuple[Case, ...]) -> None:
    """Attach the device, and have the driver carry out the cases."""
    bench.check("phasewire", "attach", FAR)
    bench.check("timeout", "20", "sh", "-c", "until [ -e /sys/bus/usb/drivers/usbtest/*:1.0 ]; do sleep 0.05; done")
    given = json.dumps([asdict(case) for case in cases])
    errors = json.loads(bench.check(sys.executable, str(PROGRAM), ids, given, seconds=SECONDS))
    assert {case.case: error for case, error in zip(cases, errors, strict=True) if error} == {}
    assert [line for line in bench.complaints() if not OTHER_INTERFACES.search(line)] == []


@pytest.mark.parametrize("speed", ["high", pytest.param("full", marks=pytest.mark.guest_slow)])
def test_the_board_passes_the_cases_without_its_data(usbtest: Bench, speed: str) -> None:
    usbtest.serve("--speed", speed)
    usbtest.check("modprobe", "usbtest", "vendor=0x1209", "product=0x0001", "alt=0", "realworld=0")
    judge(usbtest, "1209:0001", BOARD)


@pytest.mark.guest_slow
@pytest.mark.parametrize("speed", ["high", "full"])
def test_a_source_and_sink_passes_all_cases_of_its_endpoints(usbtest: Bench, speed: str) -> None:
    usbtest.serve(speed, program=[str(SOURCE_SINK_PROGRAM)])
    usbtest.check("modprobe", "usbtest", "realworld=0")
    judge(usbtest, "0525:a4a0", SOURCE_SINK)
