"""Each fault of the emulator during a stream: the host ends as docs/how-to/host.md says, with the outputs off."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import phasewire.base.errors
import pytest
from phasewire import Emulator, Pulses, open_device
from phasewire.base.errors import DeviceError
from phasewire.emulator.faults import FAULTS, InjectedFault
from phasewire.host.streaming.streaming import StreamReport

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "how-to/host.md"
PERIOD = 3000
LINGERS = {"silent-host": 4100, "dead-processor": 2100, "dead-board": 2100}
"""Periods for which outputs that are out of reach may stay on: the watchdog's time, and 50 ms (CHN-018)."""
FIELDS: dict[str, dict[str, int | str]] = {
    "lost-token": {"message": "slice", "processor": 3, "token": 9},
    "doubled-token": {"message": "slice", "processor": 3, "token": 9},
    "flipped-bit": {"message": "slice", "processor": 3, "token": 9},
    "slow-link": {"link": 4, "cycles_per_symbol": 200, "periods": 200},
    "dead-processor": {"processor": 4},
    "dead-board": {"board": 2},
    "stuck-high": {"processor": 1, "bit": 3},
    "stuck-low": {"processor": 1, "bit": 3},
    "open-transducer": {"transducer": 7},
    "clock-error": {"board": 2, "ppm": 100},
    "hot-board": {"board": 1, "celsius": 90},
    "wrong-supply": {"millivolts": 20_000},
    "slow-processor": {"processor": 3, "slowness": 30, "periods": 400},
    "flipped-usb-bit": {"endpoint": 1, "byte": 100},
    "stalled-endpoint": {"endpoint": 0x81},
    "power-cut-in-write": {"written_bytes": 1},
    "failing-sector": {"sector": 512},
    "failing-page": {"page": 9000},
    "stuck-flash-bit": {"address": 0x200000, "bit": 0, "value": 0},
}


class Row(NamedTuple):
    error: str | None
    says: str


def documented() -> dict[str, Row]:
    table = DOCUMENT.read_text(encoding="utf-8").partition("<!-- faults -->")[2].strip().split("\n\n")[0]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()[2:]]
    return {name.strip("`"): Row(error.strip("`") or None, says) for name, error, says in rows}


DOCUMENTED = documented()


def fault(name: str) -> InjectedFault:
    return FAULTS[name](period=PERIOD, **FIELDS.get(name, {}))


def frames(count: int) -> Iterator[Pulses]:
    for index in range(count):
        yield Pulses(np.full(320, 20 + 2 * (index % 9)), np.full(320, 8))


def high(emulator: Emulator) -> set[tuple[int, int]]:
    """Processors and bits that are high in the last period of what is captured."""
    capture = emulator.capture() if emulator.controller is not None else emulator.past[-1]
    words = np.bitwise_or.reduce(capture.bits(capture.end_tick - 50, capture.end_tick), axis=0)
    return {(processor, bit) for processor, word in enumerate(words) for bit in range(32) if int(word) >> bit & 1}


def test_every_fault_is_documented() -> None:
    assert list(DOCUMENTED) == list(FAULTS)
    assert set(FIELDS) <= set(FAULTS)


@pytest.mark.parametrize("name", FAULTS)
def test_a_stream_ends_as_documented_and_with_the_outputs_off(name: str) -> None:
    row = DOCUMENTED[name]
    reports: list[StreamReport] = []
    with Emulator() as emulator:
        device = open_device(emulator.url)
        emulator.inject(fault(name))
        if row.error:
            with pytest.raises(getattr(phasewire.base.errors, row.error), match=re.escape(row.says)) as raised:
                device.stream(frames(600), 1000, on_progress=reports.append)
            assert type(raised.value).__name__ == row.error
        else:
            device.stream(frames(600), 1000, on_progress=reports.append)
            device.stop()
        report = reports[-1]
        assert report.sent == report.accepted + report.damaged + report.refused + report.unanswered
        assert (report.sent == 600) == (row.error is None)
        assert bool(report.missed_commits) == ("missed commits" in row.says)
        if row.error is None:
            expected = {word.strip(",") for word in row.says.split() if word.strip(",").isupper()}
            assert {found.name for found in report.faults} == expected
            assert report.damaged == ("damaged" in row.says)
        if emulator.controller is not None:
            emulator.run(LINGERS.get(name, 10))
        left = high(emulator) if emulator.controller is not None else set()
        assert left == ({(1, 3)} if name == "stuck-high" else set())


@pytest.mark.parametrize("name", [name for name, row in DOCUMENTED.items() if row.error])
def test_once_the_cause_is_gone_the_same_device_plays_again(name: str) -> None:
    """A lasting fault ends after 0.1 s; if a restart is needed the host can order it."""
    lasting = "periods" in FAULTS[name].__dataclass_fields__
    fields = {**FIELDS.get(name, {}), **({"periods": 4000} if lasting else {})}
    with Emulator() as emulator:
        device = open_device(emulator.url)
        emulator.inject(FAULTS[name](period=PERIOD, **fields))
        with pytest.raises(DeviceError):
            device.stream(frames(600), 1000)
        device.close()
        emulator.scheduler.run_until(emulator.scheduler.now + 400_000_000)
        if name in ("dead-processor", "dead-board"):
            with open_device(emulator.url) as dead:
                assert dead.clear_faults().faults
            return
        with open_device(emulator.url) as again:
            if again.clear_faults().faults:
                again.reset()
            assert not again.status().faults
            assert again.stream(frames(50), 1000).accepted == 50
