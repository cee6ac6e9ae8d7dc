"""Serial lines and USB as doors to one whole device (chapters SER and CON), and runs that repeat to the bit."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable

import numpy as np
import pytest
from phasewire import Emulator, Pulses
from phasewire.emulator import Event
from phasewire.emulator.control.agenda import QUEUE_BLOCKS
from phasewire.emulator.door import Handshake, Stall
from phasewire.protocol.blocks import (
    Block,
    Body,
    Clock,
    Entries,
    Entry,
    Modulation,
    NoOp,
    Output,
    Samples,
    Sequence,
    Slot,
    Update,
    pack,
)
from phasewire.protocol.codes import AckFlag, Action, Fault, FrameKind, Outcome, Reason, Request, State
from phasewire.protocol.framing import Frame, SerialRequest, decode, encode
from phasewire.protocol.replies import Ack, Status
from phasewire.protocol.requests import Setup
from phasewire.protocol.timing import FIVE_WIRE, TWO_WIRE, Link

from tests.emulator.hosts import FULL, HALF, PERIOD, Device, Terminal, pulses
from tests.specification import SPEC


def only_ack(records: list[Ack | Status]) -> Ack:
    (ack,) = records
    assert isinstance(ack, Ack)
    return ack


def block(number: int, body: Body | None = None) -> bytes:
    return pack(Block(body or NoOp(), number))


class Both:
    """A device with a host at its USB port and one at its UART, among frames."""

    def __init__(self, *, enabled: bool = True) -> None:
        self.device = Device(enabled=enabled)
        self.terminal = Terminal(self.device.emulator.line)
        self.terminal.enter_frames()
        self.terminal.told()

    def fill(self, first: int = 0) -> int:
        """Fill the queue by USB with changes far ahead; the period of the first."""
        at = self.device.period + 1000
        for n in range(QUEUE_BLOCKS):
            assert self.device.send(Update(HALF, at + n), first + n).reason is Reason.ACCEPTED
        self.terminal.told()
        return at


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


def test_a_test_drives_one_transducer_weakly_and_is_a_block() -> None:
    """Clause CON-008."""
    device = Device(enabled=True)
    terminal = Terminal(device.emulator.line)
    before = device.status()
    assert terminal.type("test 200") == "test 200\r\nok\r\n> "
    device.run(8)
    read = device.read_back().pulses
    assert (np.flatnonzero(read.width).tolist(), read.width[200], read.phase[200]) == ([200], 2, 0)
    after = device.status()
    assert (after.state, after.accepted - before.accepted) == (State.PLAYING, 1)
    assert not any(isinstance(record, Ack) for record in device.records())
    assert device.send(NoOp(), 0).flags == AckFlag(0)  # it had no number


def test_a_test_is_refused_like_an_update() -> None:
    device = Device(Emulator(unfolded=True))
    terminal = Terminal(device.emulator.line)
    assert "error 6 DISABLED: " in terminal.type("test 0")
    device.order(Request.LIMIT, 0)
    device.order(Request.ENABLE)
    assert "error 6 DRIVE: " in terminal.type("test 0")
    assert device.status().last_refusal is Reason.DRIVE
    assert device.status().refused == 2
    device.order(Request.DISABLE)
    device.order(Request.LIMIT, 320)
    device.order(Request.ENABLE)
    for n in range(QUEUE_BLOCKS):
        device.send(Update(HALF, 10**6 + n))
    assert "error 6 " in terminal.type("test 0")
    assert device.status().refused == 2
    device.set_temperature(90)
    assert "error 6 FAULT: " in terminal.type("test 0")


def test_commands_do_what_requests_do() -> None:
    device = Device(configured=False)
    terminal = Terminal(device.emulator.line)
    terminal.type("enable")
    assert device.status().state is State.READY
    assert "error 6" in terminal.type("limit 5")
    terminal.type("stop")
    assert device.status().state is State.OFF
    terminal.type("limit 5")
    terminal.type("watchdog 700")
    assert (device.status().drive_limit, device.status().watchdog_ms) == (5, 700)
    terminal.type("identify 3")
    assert device.emulator.running.blinking == [3]
    assert terminal.type("faults") == "faults\r\nfaults: none\r\nok\r\n> "
    assert f"now: {device.period * 50}\r\n" in terminal.type("clock")
    assert terminal.type("boards").count("temperature_c 25") == 10
    device.set_temperature(90)
    assert "faults: TEMPERATURE\r\n" in terminal.type("faults")
    assert "error 6" in terminal.type("enable")
    device.set_temperature(20)
    terminal.type("clear")
    assert device.status().state is State.OFF


# Frames (chapter SER)


def test_a_line_does_all_that_usb_does() -> None:
    device = Device(configured=False)
    terminal = Terminal(device.emulator.line)
    terminal.enter_frames()
    assert terminal.order(Request.ENABLE) is Outcome.DONE
    assert only_ack(terminal.send(block(0, Slot(0, pulses(7))))).reason is Reason.ACCEPTED
    assert only_ack(terminal.send(block(1, Entries((Entry(0, 10),))))).reason is Reason.ACCEPTED
    ack = only_ack(terminal.send(block(2, Sequence(0, 1, repeats=1))))
    assert (ack.reason, ack.free) == (Reason.ACCEPTED, QUEUE_BLOCKS - 1)
    device.run(30)
    assert [told.state for told in terminal.told()] == [State.READY]
    begins = ack.commit_period
    assert device.widths()[begins - 1 : begins + 11].tolist() == [0] + [7] * 10 + [0]
    assert terminal.request(0xC1, Request.WIRING, length=640).data[:2] == b"\0\0"
    assert terminal.request(0xC1, 77, length=4).outcome is Outcome.STALL
    assert terminal.request(0xC1, Request.INFO, length=10).data == device.emulator.running.info().encode()[:10]


def test_doors_share_the_numbering_and_each_gets_its_own_answers() -> None:
    """Clause SER-016."""
    both = Both()
    assert both.device.send(NoOp(), 5).reason is Reason.ACCEPTED
    assert only_ack(both.terminal.send(block(5))).reason is Reason.SEQUENCE
    ack = only_ack(both.terminal.send(block(7)))
    assert (ack.reason, ack.flags) == (Reason.ACCEPTED, AckFlag.GAP)
    assert both.device.records() == []
    assert both.device.send(NoOp(), 7).reason is Reason.SEQUENCE
    assert both.terminal.records() == []
    assert both.device.status().lost == 1


def test_a_signal_by_any_door_keeps_the_device_awake() -> None:
    both = Both()
    for n in range(4):
        both.device.run_ms(90)
        if n % 2:
            both.device.ask_status()
        else:
            both.terminal.ask_status()
    assert both.device.state is State.READY


def test_a_block_waits_on_the_line_until_the_queue_has_room() -> None:
    """Clause SER-011: it is judged then; requests are answered meanwhile, and a second block is dropped."""
    both = Both()
    at = both.fill()
    assert both.terminal.send(block(QUEUE_BLOCKS, Update(FULL))) == []
    arrived = both.terminal.ask_status()
    assert arrived.free == 0
    assert both.terminal.send(block(QUEUE_BLOCKS + 1)) == []
    assert both.terminal.ask_status().dropped_frames == 1
    both.device.run_until((at - 4) * PERIOD)
    assert both.terminal.records() == []
    both.device.run_until((at - 1) * PERIOD)
    acks = [record for record in both.terminal.records() if isinstance(record, Ack)]
    assert [(ack.sequence, ack.reason, ack.commit_period) for ack in acks] == [
        (QUEUE_BLOCKS, Reason.ACCEPTED, at + QUEUE_BLOCKS)
    ]
    assert acks[0].now == arrived.now
    both.device.run(QUEUE_BLOCKS + 20)
    assert both.device.widths()[at + QUEUE_BLOCKS - 2 :][:4].tolist() == [12, 12, 25, 25]
    assert both.device.send(NoOp(), QUEUE_BLOCKS + 2).flags == AckFlag.GAP  # the one before is lost


def test_a_block_that_waits_is_judged_by_what_holds_then() -> None:
    both = Both()
    both.fill()
    both.terminal.send(block(QUEUE_BLOCKS, Update(FULL)))
    both.terminal.send(block(QUEUE_BLOCKS + 1))
    both.device.order(Request.DISABLE)
    records = both.terminal.records()
    acks = [record for record in records if isinstance(record, Ack)]
    assert [(ack.sequence, ack.reason, ack.state) for ack in acks] == [(QUEUE_BLOCKS, Reason.DISABLED, State.OFF)]
    assert [record.state for record in records if isinstance(record, Status)] == [State.OFF]


def test_a_block_waits_on_the_line_until_a_store_has_gone() -> None:
    both = Both(enabled=False)
    for n in range(16):
        both.device.send(Entries((Entry(1, 1),) * 120), n)
    assert both.terminal.send(block(16)) == []
    both.device.run(6)
    assert only_ack(both.terminal.records()).reason is Reason.ACCEPTED


def test_what_waits_at_two_doors_goes_one_after_the_other() -> None:
    both = Both()
    at = both.fill()
    usb = block(QUEUE_BLOCKS + 1, Update(HALF))
    assert both.terminal.send(block(QUEUE_BLOCKS, Update(FULL))) == []
    assert both.device.usb.bulk_out(0x01, usb) is Handshake.NAK
    both.device.run_until((at - 1) * PERIOD)
    assert only_ack(both.terminal.records()).reason is Reason.ACCEPTED
    both.device.run(1)
    assert both.device.usb.bulk_out(0x01, usb) is Handshake.ACK


def test_a_block_that_waits_outlives_the_host_that_sent_it() -> None:
    """Clause SER-010: its later answer is dropped."""
    both = Both()
    at = both.fill()
    both.terminal.send(block(QUEUE_BLOCKS, Update(FULL)))
    both.terminal.line.hang_up()
    both.terminal.enter_frames()
    both.device.run_until((at + QUEUE_BLOCKS + 20) * PERIOD)
    assert both.device.widths()[-1] == 25
    assert all(isinstance(record, Status) for record in both.terminal.records())


@pytest.mark.parametrize("what", ["checksum", "kind", "direction", "length", "COBS", "request"])
def test_damaged_frames_are_counted_and_have_no_other_effect(what: str) -> None:
    """Clause SER-006; the counter is the device's, whichever door asks."""
    both = Both()
    whole = encode(Frame(FrameKind.BLOCK, block(3)))
    damaged = {
        "checksum": whole[:40] + bytes([whole[40] ^ 0x80 or 1]) + whole[41:],
        "kind": b"\x06\x77\x01\x02\x03\x04\0",
        "direction": encode(Frame(FrameKind.RECORD, bytes(32))),
        "length": b"\x01" * 700 + b"\0",
        "COBS": b"\x09\x01\0",
        "request": encode(Frame(FrameKind.REQUEST, SerialRequest(1, 0xC1, 2, length=64).encode()))[:-3] + b"\x01\0",
    }[what]
    before = both.device.status()
    both.terminal.line.receive(damaged)
    assert both.terminal.frames() == []
    after = both.device.status()
    assert (after.dropped_frames, after.accepted, after.refused) == (1, before.accepted, before.refused)
    assert only_ack(both.terminal.send(block(3))).reason is Reason.ACCEPTED
    assert both.device.ask_status().dropped_frames == both.terminal.ask_status().dropped_frames == 1


def test_a_block_that_is_wrong_in_an_undamaged_frame_is_answered() -> None:
    both = Both()
    broken = bytearray(block(3))
    broken[40] ^= 1
    ack = only_ack(both.terminal.send(bytes(broken)))
    assert (ack.reason, ack.sequence) == (Reason.CHECKSUM, 3)
    assert both.device.status().dropped_frames == 0


def test_a_frame_that_a_break_cut_short_is_counted() -> None:
    both = Both()
    both.terminal.line.receive(encode(Frame(FrameKind.BLOCK, block(3)))[:100])
    both.terminal.line.hang_up()
    assert both.device.status().dropped_frames == 1


def test_two_lines_are_each_in_a_mode_of_their_own() -> None:
    """Clause USB-026: a bus reset and SET_CONFIGURATION return that of USB to its console, and no other."""
    both = Both()
    usb = both.device.usb
    assert UsbTerminal(both.device).type("version").startswith("version\r\noldest_version: 1\r\n")
    assert both.terminal.ask_status().state is State.READY
    usb.bulk_out(0x03, b"\0")
    assert usb.bulk_in(0x83) == b"\0"
    both.device.set_interface()
    told = usb.bulk_in(0x83)
    assert isinstance(told, bytes)
    frame = decode(told)
    assert (frame.kind, Status.decode(frame.body).state) == (FrameKind.RECORD, State.OFF)
    both.device.configure()
    assert UsbTerminal(both.device).type("faults") == "faults\r\nfaults: none\r\nok\r\n> "
    assert both.terminal.ask_status().state is State.OFF


def test_text_needs_a_terminal_on_usb_and_frames_do_not() -> None:
    """Clause USB-023."""
    device = Device()
    device.usb.bulk_out(0x03, b"version\r")
    assert device.usb.bulk_in(0x83) is Handshake.NAK
    device.usb.bulk_out(0x03, b"\0" + encode(Frame(FrameKind.REQUEST, SerialRequest(1, 0x41, Request.ENABLE).encode())))
    answer = device.usb.bulk_in(0x83)
    assert isinstance(answer, bytes)
    assert answer[:1] == b"\0"
    assert decode(answer[1:]).kind is FrameKind.REPLY


def test_a_console_that_is_not_read_delays_nothing_else() -> None:
    """Clause USB-025."""
    device = Device(enabled=True)
    UsbTerminal(device)
    taken = 0
    while device.usb.bulk_out(0x03, b"help\r") is Handshake.ACK:
        taken += 1
        assert taken < 100
    assert device.send(Update(HALF)).reason is Reason.ACCEPTED
    assert Terminal(device.emulator.line).type("faults").endswith("ok\r\n> ")


# The same calls, the same device


class Program:
    """A long random program for a whole device; all that it hears and sees is kept in `heard`."""

    def __init__(self, seed: int, *, unfolded: bool, link: Link = FIVE_WIRE, faults: bool = False) -> None:
        self.random = np.random.default_rng(seed)
        self.device = Device(Emulator(unfolded=unfolded, link=link, serial="SAME"))
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
            Sequence(
                first, count, self.some_period(), int(self.random.integers(3)), unattended=bool(self.random.integers(2))
            ),
            Modulation(first, count, int(self.random.integers(1, 9)), self.some_period()),
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
        self.terminal.line.receive(encode(Frame(FrameKind.BLOCK, self.device.pack(Update(self.some_pulses())))))

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
