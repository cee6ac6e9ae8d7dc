from __future__ import annotations

import numpy as np
import pytest
from phasewire import Emulator, Pulses, open_device
from phasewire.base.errors import DeviceNotFoundError
from phasewire.emulator.machine import open_emulators
from phasewire.protocol.codes import Request
from phasewire.protocol.requests import Setup
from phasewire.protocol.timing import Link

from tests.emulator.passing import now, pass_until


def test_it_is_open_within_its_context_only() -> None:
    with Emulator(serial="A") as first, Emulator(serial="B") as second:
        assert open_emulators() == [first, second]
        assert first.url == "emulator:A"
        with pytest.raises(ValueError, match="'A' is already open"):
            Emulator(serial="A").__enter__()
    assert open_emulators() == []


def test_it_stays_open_without_a_context_until_it_is_closed() -> None:
    emulator = Emulator(serial="A")
    for url in ("emulator:A", "emulator:A?door=serial"):
        with pytest.raises(
            DeviceNotFoundError, match=r"an Emulator answers in a with statement, or after its open\(\)"
        ):
            open_device(url)
    with open_device(emulator.open().url) as device:
        assert device.serial == "A"
    for _ in range(2):
        emulator.close()
        assert open_emulators() == []
    with pytest.raises(ValueError, match="this emulator is closed; make a new one"):
        emulator.open()


@pytest.mark.parametrize("offsets", [{5: 1}, {-1: 1}, {0: -1}])
def test_impossible_clock_offsets_are_named(offsets: dict[int, int]) -> None:
    with pytest.raises(ValueError, match="boards are 0 to 4, offsets not negative"):
        Emulator(clock_offset_ticks=offsets)


def test_links_slower_than_info_can_state_are_refused() -> None:
    with Emulator(link=Link("slow", 2, 10, cycles_per_symbol=255)) as emulator, open_device(emulator.url) as device:
        assert device.info.cycles_per_symbol == 255
    with pytest.raises(ValueError, match="256 core cycles a symbol: INFO tells at most 255"):
        Emulator(link=Link("slower", 2, 10, cycles_per_symbol=256))


def test_a_late_board_plays_the_same_wave_later() -> None:
    with Emulator(clock_offset_ticks={3: 2}) as emulator, open_device(emulator.url) as device:
        ack = device.show(Pulses(np.full(320, 25), np.full(320, 25)))
        emulator.run_until(ack.commit_period + 3)
        capture = emulator.capture()
    boundary = ack.commit_period * 50
    bits = capture.bits(boundary, boundary + 100)
    late = np.zeros(10, bool)
    late[6:8] = True
    on_time = bits[:, ~late]
    assert (on_time[:25] == 0xFFFFFFFF).all()
    np.testing.assert_array_equal(bits[2:, late], on_time[:-2, :2])
    assert not bits[:2, late].any()


def test_the_log_is_bounded(emulator: Emulator) -> None:
    emulator.usb.control(Setup(0x00, 9, 1, 0, 0))
    for _ in range(10_001):
        emulator.usb.control(Setup(0x41, Request.IDENTIFY, 0, 0, 0))
    assert len(emulator.events) == 10_000


def test_periods_run_to_their_end(emulator: Emulator) -> None:
    pass_until(emulator, 10_001)
    emulator.run(1)
    assert now(emulator) == 30_000
    emulator.run_until(2)
    assert now(emulator) == 30_000
    emulator.run_until(5)
    assert now(emulator) == 50_000


@pytest.mark.parametrize("serial", ["", "a b", "a?b", "ü", "x" * 65])
def test_serial_numbers_that_no_url_can_name_are_refused(serial: str) -> None:
    with pytest.raises(ValueError, match="must be 1 to 64 letters, digits"):
        Emulator(serial=serial)
