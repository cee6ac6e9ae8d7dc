"""Serial lines and USB as doors to one whole device (chapters SER and CON), and runs that repeat to the bit."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable

import numpy as np
import pytest
from phasewire import Emulator, Pulses
from phasewire.emulator import Event
from phasewire.emulator.door import Handshake, Stall
from phasewire.emulator.machine import FirmwareChoice
from phasewire.protocol.blocks import (
    AmplitudeModulation,
    Body,
    Clock,
    Entries,
    Entry,
    NoOp,
    Output,
    PlaySequence,
    Samples,
    Slot,
    Update,
)
from phasewire.protocol.codes import Action, Fault, FrameKind, Request
from phasewire.protocol.framing import SerialFrame, encode
from phasewire.protocol.requests import Setup
from phasewire.protocol.timing import FIVE_WIRE, TWO_WIRE, Link

from tests.emulator.hosts import PERIOD, Device, Terminal
from tests.specification import SPEC

# The console (chapter CON)


class UsbTerminal:
    """A terminal at the console of the USB port."""

    def __init__(self, device: Device) -> None:
        self.usb = device.usb
        self.usb.control(Setup(0x21, 0x22, 1, 1, 0))

    def type(self, text: str) -> str:
        assert self.usb.bulk_out(0x03, f"{text}\r".encode("ascii")) is Handshake.ACK
        shown = b""
        while isinstance(packet := self.usb.bulk_in(0x83), bytes):
            shown += packet
        return shown.decode("ascii")


@pytest.mark.parametrize("usb", [False, True], ids=["UART", "USB"])
def test_the_session_of_the_specification_on_a_whole_device(usb: bool) -> None:
    (session,) = re.findall(r"^```console\n(.*?)^```", SPEC, re.MULTILINE | re.DOTALL)
    device = Device(configured=usb)
    terminal = UsbTerminal(device) if usb else Terminal(device.emulator.line)
    shown = terminal.type("")
    for line in re.findall(r"^> (.*)$", session, re.MULTILINE):
        shown += terminal.type(line)
        device.run(20)  # a person does not type faster
    assert shown == "\r\n" + session.replace("\n", "\r\n") + "> "


# The same calls, the same device


class Program:
    """A long random program for a whole device; `heard` keeps all its answers and outputs."""

    def __init__(
        self,
        seed: int,
        *,
        unfolded: bool,
        link: Link = FIVE_WIRE,
        faults: bool = False,
        firmware: FirmwareChoice = "model",
    ) -> None:
        self.random = np.random.default_rng(seed)
        self.device = Device(Emulator(unfolded=unfolded, link=link, serial="SAME", firmware=firmware))
        self.terminal = Terminal(self.device.emulator.line)
        self.terminal.enter_frames()
        self.heard: list[object] = []
        self.steps: list[Callable[[], object]] = [
            *[self.change] * 8,
            *[self.store] * 3,
            *[self.wait] * 6,
            self.enable,
            self.enable,
            self.disable,
            self.ask,
            self.by_line,
            self.suspend,
            self.begin_anew,
        ]
        self.steps += [self.heat] if faults else []

    def run(self, steps: int) -> None:
        self.enable()
        for _ in range(steps):
            self.steps[self.random.integers(len(self.steps))]()
            self.heard += [*self.device.records(), *self.terminal.frames(), self.device.state]
        self.device.run(100)

    def some_pulses(self) -> Pulses:
        return Pulses(self.random.integers(0, 100, 320), self.random.integers(0, 26, 320))

    def some_period(self) -> int:
        named = max(0, self.device.period + int(self.random.integers(-3, 40)))
        return named if self.random.integers(2) else 0

    def change(self) -> None:
        first, count = int(self.random.integers(4)), int(self.random.integers(1, 5))
        bodies: list[Body] = [
            Update(self.some_pulses(), self.some_period()),
            Update(self.some_pulses()),
            PlaySequence(
                first, count, self.some_period(), int(self.random.integers(3)), unattended=bool(self.random.integers(2))
            ),
            AmplitudeModulation(first, count, int(self.random.integers(1, 9)), self.some_period()),
            Output(Action(int(self.random.integers(1, 4))), self.some_period()),
        ]
        self.send(bodies[int(self.random.choice(5, p=[0.3, 0.3, 0.15, 0.15, 0.1]))])

    def store(self) -> None:
        first = int(self.random.integers(5))
        bodies: list[Body] = [
            Slot(first, self.some_pulses()),
            Entries(tuple(Entry(int(slot), int(1 + slot * 3)) for slot in self.random.integers(0, 5, 3)), first),
            Samples(self.random.bytes(3), first),
            NoOp(),
            Clock(),
        ]
        self.send(bodies[self.random.integers(5)])

    def send(self, body: Body) -> None:
        self.heard.append(self.device.usb.bulk_out(0x01, self.device.pack(body)))

    def wait(self) -> None:
        self.device.run_until(self.device.cycle + int(self.random.integers(1, 30 * PERIOD)))

    def enable(self) -> None:
        try:
            self.device.order(Request.ENABLE)
        except Stall:
            self.heard.append("stall")

    def disable(self) -> None:
        self.device.order(Request.DISABLE)

    def ask(self) -> None:
        self.heard += [self.device.ask_status(), self.device.ask(Request.PROCESSORS, 160)]

    def by_line(self) -> None:
        self.terminal.line.receive(encode(SerialFrame(FrameKind.BLOCK, self.device.pack(Update(self.some_pulses())))))

    def suspend(self) -> None:
        self.device.usb.suspend()
        self.wait()
        self.heard.append(self.device.state)
        self.device.usb.resume()

    def begin_anew(self) -> None:
        if self.random.integers(3) == 0:
            self.device.configure()

    def heat(self) -> None:
        self.device.emulator.running.unfold()
        self.device.emulator.processors[4].set_temperature(int(self.random.integers(70, 90)))
        self.device.run_ms(12)
        self.device.order(Request.CLEAR_FAULTS)

    def seen(self) -> str:
        capture = self.device.emulator.capture()
        return hashlib.sha256(capture.bits(0, capture.end_tick).tobytes()).hexdigest()


@pytest.mark.parametrize("seed", range(3))
def test_two_runs_are_the_same_to_the_bit(seed: int) -> None:
    def session() -> tuple[list[object], str, list[Event]]:
        program = Program(seed, unfolded=bool(seed % 2), faults=True)
        program.run(150)
        return program.heard, program.seen(), list(program.device.emulator.events)

    first, second = session(), session()
    assert first == second
    assert len({type(item) for item in first[0]}) >= 4


@pytest.mark.parametrize("link", [FIVE_WIRE, TWO_WIRE], ids=lambda link: link.name)
@pytest.mark.parametrize("seed", range(6))
def test_message_by_message_everything_is_as_if_taken_for_granted(seed: int, link: Link) -> None:
    folded, unfolded = (Program(seed, unfolded=unfolded, link=link) for unfolded in (False, True))
    for program in (folded, unfolded):
        program.run(150)
    assert folded.heard == unfolded.heard
    assert folded.seen() == unfolded.seen()
    assert unfolded.device.status().missed_commits == 0
    assert unfolded.device.status().faults == Fault(0)
    assert max(unfolded.device.high_periods()) > 100
