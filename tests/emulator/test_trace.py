from __future__ import annotations

import numpy as np
import pytest
from phasewire import Emulator, Pulses
from phasewire.emulator.control.agenda import QUEUE_BLOCKS
from phasewire.emulator.doors.backend import EmulatorBackend
from phasewire.protocol.codes import Request, State
from phasewire.protocol.requests import Setup
from phasewire.protocol.timing import FIVE_WIRE, TWO_WIRE, Link

from tests.emulator.passing import now, pass_until
from tests.strategies import update
from tests.time_line import one_update

BLOCK = update(Pulses(np.full(320, 25), np.full(320, 25)), 1)


def watched(link: Link) -> Emulator:
    emulator = Emulator(link=link)
    emulator.usb.control(Setup(0x00, 9, 1, 0, 0))
    emulator.usb.control(Setup(0x41, Request.ENABLE, 0, 0, 0))
    emulator.watch()
    return emulator


def write(emulator: Emulator) -> None:
    bus = EmulatorBackend([emulator])
    bus.bulk_write(bus.open_device(next(bus.enumerate_devices())), 0x01, 0, BLOCK, 1000)


@pytest.mark.parametrize("link", [FIVE_WIRE, TWO_WIRE])
def test_the_way_of_an_update_takes_the_times_of_the_specification(link: Link) -> None:
    """All spans of chapter BUD and clause CHN-006, to the core cycle, and no others."""
    emulator = watched(link)
    pass_until(emulator, 123_456)
    write(emulator)
    expected = one_update(link, 123_456)
    pass_until(emulator, max(span.ends for span in expected))
    assert emulator.tracer.spans(emulator.scheduler.now) == sorted(expected)


def test_signals_show_the_queue_the_state_and_every_mailbox() -> None:
    emulator = watched(FIVE_WIRE)
    write(emulator)
    arrived = now(emulator)
    emulator.run(4)
    signals = {signal.name: signal.changes for signal in emulator.tracer.signals()}
    assert signals["controller.queue"] == ((arrived, 1), (arrived + 7000, 0))
    assert [value for _, value in signals["controller.state"]] == [State.READY, State.PLAYING]
    ones = [signals[f"board{board}.processor{number}.mailbox"] for board in range(5) for number in range(2)]
    assert [[value for _, value in changes] for changes in ones] == [[1, 0]] * 10
    # The slice for processor 9 is the tenth: 520 tokens of 8 cycles, and ten switches of 40.
    assert ones[9][0] == (arrived + 7000 + 520 * 8 + 400, 1)


def test_every_value_fits_its_signal_while_the_queue_is_full() -> None:
    emulator = watched(FIVE_WIRE)
    for number in range(QUEUE_BLOCKS):
        emulator.usb.bulk_out(0x01, update(Pulses.silent(320), number, period=10**6))
    signals = {signal.name: signal for signal in emulator.tracer.signals()}
    assert signals["controller.queue"].changes[-1][1] == QUEUE_BLOCKS
    for signal in signals.values():
        signal.check()


def test_the_trace_shows_the_wrap_of_the_port_counter() -> None:
    """204 800 ticks from one pulse of the sync line to the next are 8192 modulo 65 536."""
    emulator = watched(FIVE_WIRE)
    emulator.run_until(10 * 4096 + 1)
    signals = {signal.name: signal.changes for signal in emulator.tracer.signals()}
    assert [value for _, value in signals["board0.processor0.counter"]] == [
        8192 * pulse % 65_536 for pulse in range(1, 11)
    ]


def test_a_device_without_a_tracer_keeps_nothing() -> None:
    emulator = Emulator(unfolded=True)
    emulator.usb.control(Setup(0x00, 9, 1, 0, 0))
    emulator.usb.control(Setup(0x41, Request.ENABLE, 0, 0, 0))
    write(emulator)
    emulator.run(10)
    assert (emulator.tracer.spans(0), emulator.tracer.signals()) == ([], [])
