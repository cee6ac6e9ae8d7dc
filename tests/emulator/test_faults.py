"""Each fault as a host sees it: the report, the outputs, and what clears it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from phasewire.base.errors import DeviceError, ReplyError
from phasewire.emulator import faults
from phasewire.emulator.door import Handshake, Stall
from phasewire.emulator.faults import FAULTS, InjectedFault
from phasewire.emulator.firmware.loader import FACTORY_IMAGE
from phasewire.protocol import Block, Entries, Entry, PlaySequence, Reason, Slot, State, Update, pack
from phasewire.protocol.blocks import NoOp
from phasewire.protocol.board import WATCHDOG_MS
from phasewire.protocol.codes import COLLECT_MS, DEAF_MS, DfuState, DfuStatus, Fault, Request
from phasewire.protocol.dfu import DfuReply
from phasewire.protocol.requests import Setup

from tests.emulator.fault_bench import HALF, MS, PLAYS, Bench, playing
from tests.emulator.hosts import FULL

CHAIN_BROKEN = Fault.CHAIN | Fault.PROCESSOR

ONE_OF_EACH: dict[str, InjectedFault] = {
    "lost token": faults.LostToken(message="slice", processor=3),
    "lost END": faults.LostToken(message="slice", processor=3, token=51),
    "lost header": faults.LostToken(message="slice", processor=3, token=0),
    "lost token of a question": faults.LostToken(message="collect"),
    "lost END of a report": faults.LostToken(message="report", token=27),
    "lost token of a report": faults.LostToken(message="report", processor=0, times=1000),
    "lost commits": faults.LostToken(message="commit", processor=9, times=1000),
    "doubled token": faults.DoubledToken(message="commit", processor=0),
    "flipped bit": faults.FlippedBit(message="commit", processor=9, bit=3),
    "flipped bit of a node": faults.FlippedBit(message="slice", processor=5, token=1),
    "flipped bit of an answer": faults.FlippedBit(message="report", token=20),
    "slow link": faults.SlowLink(link=3, cycles_per_symbol=100),
    "first link slow": faults.SlowLink(link=0, cycles_per_symbol=100),
    "very slow link": faults.SlowLink(link=3, cycles_per_symbol=2047, token_delay=2047),
    "first processor dead": faults.DeadProcessor(processor=0),
    "processor dead": faults.DeadProcessor(processor=3),
    "last processor dead": faults.DeadProcessor(processor=9),
    "dead board": faults.DeadBoard(board=2),
    "stuck high": faults.StuckHigh(processor=5, bit=7),
    "stuck low": faults.StuckLow(processor=5, bit=7),
    "open transducer": faults.OpenTransducer(transducer=3),
    "fast clock": faults.ClockError(board=1, ppm=100),
    "slow clock": faults.ClockError(board=1, ppm=-100),
    "lost sync": faults.LostSync(),
    "lost sync on a board": faults.LostSync(board=4),
    "hot board": faults.HotBoard(board=0, celsius=90),
    "wrong supply": faults.WrongSupply(millivolts=11_999, board=3),
    "slow processor": faults.SlowProcessor(processor=4, slowness=4),
    "flipped USB bit": faults.FlippedUsbBit(endpoint=0x01, byte=100),
    "stalled endpoint": faults.StalledEndpoint(endpoint=0x01),
    "unplugged": faults.Unplugged(),
    "bus reset": faults.BusReset(),
    "suspended": faults.BusSuspended(),
    "silent host": faults.SilentHost(),
    "power cut": faults.PowerCut(),
    "short power cut": faults.PowerCut(periods=400),
    "power cut in a write": faults.PowerCutInWrite(written_bytes=10),
    "flash write-protected": faults.WriteProtectedFlash(),
    "failing sector": faults.FailingSector(sector=0x200),
    "failing page": faults.FailingPage(page=0x2000),
    "stuck bit of the flash": faults.StuckFlashBit(address=0x101000, bit=4, value=0),
}

ENDS_THE_UNATTENDED = {
    "lost END of a report",
    "lost token of a report",
    "first processor dead",
    "processor dead",
    "last processor dead",
    "dead board",
    "fast clock",
    "slow clock",
    "lost sync",
    "lost sync on a board",
    "hot board",
    "wrong supply",
    "bus reset",
    "power cut",
    "short power cut",
}
"""By clause SAF-005: silencing faults, BUS_RESET and the loss of power."""

SILENCE_CANNOT_ARRIVE = {"lost commits", "slow link", "first link slow", "slow processor"}
"""Commits are missed for as long as the fault lasts; what silences is clause CHN-018, after the question that tells."""


def silent_within_ms(name: str) -> int:
    return WATCHDOG_MS + DEAF_MS + (COLLECT_MS if name in SILENCE_CANNOT_ARRIVE else 0)


@pytest.fixture
def bench() -> Bench:
    return playing()


def outputs_that_stick(fault: InjectedFault) -> np.ndarray:
    """Per processor, the bits that cannot be switched."""
    words = np.zeros(10, np.uint32)
    if isinstance(fault, faults.StuckHigh):
        words[fault.processor] = 1 << fault.bit
    return words


def test_the_table_has_one_of_each_fault() -> None:
    assert {type(fault).name() for fault in ONE_OF_EACH.values()} == set(FAULTS)


@pytest.mark.parametrize("what", PLAYS)
@pytest.mark.parametrize("name", ONE_OF_EACH)
def test_outputs_do_not_stay_on_without_a_host(name: str, what: str) -> None:
    bench, fault = playing(what), ONE_OF_EACH[name]
    bench.emulator.inject(fault)
    bench.run_ms(silent_within_ms(name) + 1)  # six periods (clause SAF-004), and what a message takes
    goes_on = what == "unattended" and name not in ENDS_THE_UNATTENDED
    if bench.emulator.controller is not None:
        end = bench.emulator.capture().end_tick
        bench.run_ms(1)
        words = bench.emulator.capture().bits(end, end + 1000)
        if goes_on:
            assert words.any(axis=0).all()
        else:
            np.testing.assert_array_equal(np.bitwise_or.reduce(words), outputs_that_stick(fault))
    else:
        assert not goes_on


# Damaged messages


def test_a_message_without_a_receiver_blocks_the_chain(bench: Bench) -> None:
    """Node 0003 without its first token is 0301, beyond the end of the chain (clauses CHN-021, CHN-023 and CHN-025)."""
    bench.emulator.inject(faults.LostToken(message="slice", processor=3, token=0))
    bench.send(Update(HALF))
    bench.run_ms(2)
    assert (bench.status().state, bench.status().faults) == (State.FAULT, CHAIN_BROKEN)
    assert bench.loud_now() == [25] * 10
    with pytest.raises(Stall, match="does not say what it plays"):
        bench.emulator.usb.control(Setup(0xC1, Request.PULSES, 0, 0, 496))
    bench.run_ms(DEAF_MS)
    assert bench.loud_now() == [0] * 10
    bench.order(Request.CLEAR_FAULTS)
    assert bench.status().faults == CHAIN_BROKEN
    with pytest.raises(Stall):
        bench.order(Request.ENABLE)
    restart(bench)
    assert bench.status().faults == Fault(0)
    bench.order(Request.ENABLE)
    bench.play("update")
    assert bench.loud_now() == [25] * 10


def restart(bench: Bench) -> None:
    """Send RESET, and wait until the device is configured again."""
    bench.order(Request.RESET)
    bench.run_ms(0.2)
    bench.emulator.run_until_started()
    bench.configure()


def test_a_processor_that_was_given_up_is_asked_again_once_it_plays(bench: Bench) -> None:
    bench.emulator.inject(faults.LostToken(message="slice", processor=8))
    bench.order(Request.DISABLE)
    bench.run_ms(COLLECT_MS + 1)
    bench.order(Request.CLEAR_FAULTS)
    bench.order(Request.ENABLE)
    bench.play("update")
    for _ in range(10):
        bench.run_ms(COLLECT_MS)
        assert bench.status().faults == Fault(0)
    assert bench.loud_now() == [25] * 10


# Links


def test_a_link_that_is_fast_again_carries_updates(bench: Bench) -> None:
    bench.emulator.inject(faults.SlowLink(link=9, cycles_per_symbol=200, periods=400))
    bench.emulator.run(400)
    bench.send(Update(HALF))
    bench.emulator.run(10)
    assert bench.loud_now() == [9] * 10


# Processors and boards


def test_an_output_that_two_faults_hold_is_free_after_both_end(bench: Bench) -> None:
    stuck = faults.StuckHigh(processor=0, bit=0, periods=10)
    bench.emulator.inject(stuck, faults.StuckHigh(processor=0, bit=0, periods=20))
    bench.order(Request.DISABLE)
    first = bench.period
    bench.emulator.run_until(first + 40)
    high = bench.emulator.capture().channels(50 * first, 50 * first + 2000)[:, 0]
    assert high[:1000].all()
    assert not high[1050:].any()


def test_an_open_transducer_emits_nothing_from_its_period_on(bench: Bench) -> None:
    period = bench.period + 10
    bench.emulator.inject(faults.OpenTransducer(transducer=17, period=period))
    bench.emulator.run_until(period + 10)
    capture = bench.emulator.capture()
    drives = capture.drives(period - 3, period + 3)
    silent = [[place for place in range(320) if not abs(drive[place])] for drive in drives]
    assert silent == [[], [], [], [17], [17], [17]]
    assert bench.loud_now() == [25] * 10
    assert bench.status().faults == Fault(0)


@pytest.mark.parametrize("period", [4095, 4096, 9000, 30_000])
def test_a_late_fault_without_a_clock_error_raises_no_sync(period: int) -> None:
    """Pulses came before the fault; ticks since the last of them do not count as an error."""
    bench = playing("unattended")
    bench.emulator.run_until(period)
    bench.emulator.inject(faults.HotBoard(board=1, celsius=40))
    bench.emulator.run_until(period + 2 * 4096)
    bench.run_ms(COLLECT_MS + 1)
    assert bench.emulator.running.faults == Fault(0)
    bench.emulator.inject(faults.ClockError(board=1, ppm=100))
    bench.emulator.run_until(period + 4 * 4096)
    bench.run_ms(COLLECT_MS + 1)
    assert bench.emulator.running.faults == Fault.SYNC


def test_a_device_that_starts_without_its_sync_line_has_a_fault(bench: Bench) -> None:
    bench.emulator.inject(faults.LostSync(board=2))
    restart(bench)
    assert (bench.status().state, bench.status().faults) == (State.FAULT, Fault.SYNC)


def test_a_slow_processor_steps_late_through_a_sequence() -> None:
    """Three times 4400 cycles are 1.32 periods: each table comes one period late."""
    bench = Bench()
    bench.emulator.inject(faults.SlowProcessor(processor=4, slowness=3))
    bench.send(Slot(0, FULL))
    bench.send(Entries((Entry(0, 100),)))
    began = bench.send(PlaySequence(first=0, count=1, repeats=0, period=40)).commit_period
    bench.emulator.run_until(50)
    assert bench.loud(began, began + 1) == [25] * 4 + [0] + [25] * 5
    assert bench.loud(began + 1, began + 2) == [25] * 10
    bench.run_ms(COLLECT_MS)
    assert bench.status().faults == Fault.OVERRUN


# USB


def test_a_record_with_a_wrong_bit_is_refused(bench: Bench) -> None:
    bench.emulator.inject(faults.FlippedUsbBit(endpoint=0x81, byte=16))
    with pytest.raises(ReplyError):
        bench.send(NoOp())
    assert bench.send(NoOp()).reason is Reason.ACCEPTED


def test_a_stream_gets_a_wrong_bit_too(bench: Bench) -> None:
    bench.emulator.inject(faults.FlippedUsbBit(endpoint=0x01, byte=300))
    updates = memoryview(b"".join(pack(Block(Update(HALF), number)) for number in range(1, 9)))
    now = bench.emulator.scheduler.now
    assert bench.emulator.usb.stream_out(0x01, updates, now, now + MS)[0] == 0
    assert bench.send(Update(HALF)).reason is Reason.CHECKSUM
    now = bench.emulator.scheduler.now
    assert bench.emulator.usb.stream_out(0x01, updates, now, now + MS)[0] == len(updates)


# Power and flash


def test_a_device_without_power_does_not_start(bench: Bench) -> None:
    bench.emulator.inject(faults.PowerCut())
    with pytest.raises(DeviceError, match="the device does not start"):
        bench.emulator.run_until_started()
    bench.emulator.power_up()
    bench.emulator.run_until_started()
    bench.configure()
    assert bench.status().state is State.OFF


def enter_dfu(bench: Bench) -> None:
    """Send DETACH, and enumerate the device again."""
    bench.emulator.usb.control(Setup(0x21, 0, 1000, 3, 0))
    bench.run_ms(100)
    bench.emulator.usb.control(Setup(0x00, 9, 1, 0, 0))


def download(bench: Bench) -> DfuReply:
    """Send the factory's image as an upgrade; returns the result."""
    usb, stored = bench.emulator.usb, FACTORY_IMAGE.encode()
    for number, block in enumerate((stored, b"")):
        usb.control(Setup(0x21, 1, number, 0, len(block)), block)
        for _ in range(10):
            reply = DfuReply.decode(usb.control(Setup(0xA1, 3, 0, 0, 6)))
            if not reply.poll_ms:
                break
            bench.run_ms(reply.poll_ms)
        if reply.state is DfuState.ERROR:
            break
    return reply


IMAGE_A = 0x201000


def test_a_flash_that_works_again_takes_the_image(bench: Bench) -> None:
    bench.emulator.inject(faults.WriteProtectedFlash(periods=10))
    enter_dfu(bench)
    assert download(bench).status is DfuStatus.OK


def test_a_device_without_a_bootable_image_stays_off_the_bus(bench: Bench) -> None:
    bench.emulator.inject(faults.StuckFlashBit(address=0x101000, bit=4, value=0))
    bench.order(Request.RESET)
    bench.run_ms(1)
    assert not bench.emulator.usb.attached
    assert "nothing in this flash boots" in bench.emulator.events[-1].what
    with pytest.raises(DeviceError, match="does not start"):
        bench.emulator.run_until_started()


# Faults that outlast the power


@pytest.mark.parametrize(
    ("fault", "found"),
    [
        (faults.SlowProcessor(processor=4, slowness=4), Fault.CHAIN | Fault.OVERRUN),
        (faults.SlowLink(link=9, cycles_per_symbol=200), Fault.CHAIN),
        (faults.LostToken(message="commit", processor=2), Fault.CHAIN),
        (faults.ClockError(board=1, ppm=100), Fault.SYNC),
        (faults.ClockError(board=1, ppm=-100), Fault.SYNC),
        (faults.StuckHigh(processor=0, bit=0), Fault(0)),
        (faults.OpenTransducer(transducer=0), Fault(0)),
    ],
)
def test_a_broken_part_is_still_broken_after_a_power_cut(fault: InjectedFault, found: Fault) -> None:
    bench = Bench()
    bench.emulator.inject(fault)
    bench.emulator.inject(faults.PowerCut(periods=40))
    bench.run_ms(2)
    bench.emulator.run_until_started()
    bench.configure()
    assert bench.status().faults == Fault(0)
    bench.order(Request.ENABLE)
    bench.play("unattended")
    bench.send(Update(HALF))
    bench.play("unattended")
    bench.run_ms(120)
    assert bench.status().faults == found
    if isinstance(fault, faults.StuckHigh):
        assert bench.loud_now() == [50] + [25] * 9
    if isinstance(fault, faults.OpenTransducer):
        assert np.flatnonzero(bench.emulator.capture().drive(0) == 0).size == 320
        assert np.flatnonzero(bench.emulator.capture().drive(bench.period - 1) == 0).tolist() == [0]


# The time of a fault


@pytest.mark.parametrize("ahead", [2, 50, 150])
def test_a_fault_begins_at_its_period_whatever_a_door_does(bench: Bench, ahead: int) -> None:
    """Among updates that a door hands over together, and the controller plans together."""
    period = bench.period + ahead
    bench.emulator.inject(faults.StuckHigh(processor=2, bit=0, period=period))
    bench.emulator.inject(faults.LostToken(message="slice", processor=9, times=3, period=period))
    updates = memoryview(b"".join(pack(Block(Update(HALF), number)) for number in range(1, 201)))
    sent = 0
    while sent < len(updates):
        now = bench.emulator.scheduler.now
        taken, _ = bench.emulator.usb.stream_out(0x01, updates[sent:], now, now + 100 * MS)
        if not taken:
            while bench.emulator.usb.bulk_out(0x01, bytes(updates[sent : sent + 512])) is Handshake.NAK:
                bench.emulator.run(1)
            taken = 512
        sent += taken
    bench.run_ms(COLLECT_MS + 1)
    status = bench.status()
    assert (status.accepted, status.faults, status.missed_commits) == (201, Fault.CHAIN, 3)
    high = bench.emulator.capture().channels(50 * period - 60, 50 * period + 60)[:, 2 * 32]
    assert high[60:].all()
    assert not high[:60].all()


def test_a_fault_in_a_past_period_is_refused() -> None:
    bench = Bench()
    bench.emulator.run_until(20)
    with pytest.raises(ValueError, match="bus-reset: period 19 is over; this is 20"):
        bench.emulator.inject(faults.BusReset(period=19))
    bench.emulator.inject(faults.PowerCut())
    with pytest.raises(ValueError, match="has no power"):
        bench.emulator.inject(faults.BusReset(period=30))


def test_a_restart_does_not_delay_a_fault(bench: Bench) -> None:
    bench.emulator.inject(faults.StuckHigh(processor=0, bit=0, period=bench.period + 400))
    at = bench.emulator.running.time.boundary(bench.period + 400)
    restart(bench)
    tick = bench.emulator.running.time.tick(at)
    bench.emulator.run(500)
    high = bench.emulator.capture().channels(tick - 5, tick + 5)[:, 0]
    assert high.tolist() == [0] * 5 + [1] * 5


@pytest.mark.parametrize(
    ("kind", "fields", "complaint"),
    [
        (faults.StuckHigh, {"processor": 10, "bit": 0}, "stuck-high: processor = 10; it must be 0 to 9"),
        (faults.StuckHigh, {"processor": 0, "bit": 32}, "bit = 32; it must be 0 to 31"),
        (
            faults.StuckHigh,
            {"processor": 0, "bit": 0, "period": -1},
            "period = -1; it must be a whole number",
        ),
        (faults.StuckHigh, {"processor": True, "bit": 0}, "processor = True; it must be 0 to 9"),
        (faults.BusSuspended, {"periods": 0}, "periods = 0; it must be a whole number, 1 or more"),
        (faults.LostToken, {"message": "number", "token": 9}, "token = 9; of a number it must be 0 to 8"),
        (faults.FlippedBit, {"message": "number", "token": 8}, "token = 8; of a number it must be 0 to 7"),
        (faults.DoubledToken, {"message": "report", "token": 2}, "token = 2; of a report it must be 3 to 26"),
        (faults.LostToken, {"message": "hello"}, "message = 'hello'; it must be one of slice, commit, load"),
        (faults.ClockError, {"board": 0, "ppm": float("nan")}, "ppm = nan; it must be a number from -1000 to 1000"),
        (faults.DeadBoard, {"board": 5}, "board = 5; it must be 0 to 4"),
        (faults.StalledEndpoint, {"endpoint": 2}, "endpoint = 2; it must be one of 1, 129, 3, 131"),
        (faults.OpenTransducer, {"transducer": 320}, "transducer = 320; it must be 0 to 319"),
        (faults.SlowLink, {"link": 0, "cycles_per_symbol": 1}, "cycles_per_symbol = 1; it must be 2 to 2047"),
    ],
)
def test_an_error_names_an_impossible_field(kind: type[InjectedFault], fields: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ValueError, match=re.escape(complaint)):
        kind(**fields)


def test_every_fault_is_documented() -> None:
    page = (Path(__file__).parents[2] / "docs" / "reference/faults.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([a-z-]+)` \|", page, re.MULTILINE)
    assert rows == list(FAULTS)
    spec = (Path(__file__).parents[2] / "protocol" / "SPEC.md").read_text(encoding="utf-8")
    clauses = set(re.findall(r"\*\*([A-Z]{3}-\d{3})\*\*", spec))
    assert set(re.findall(r"\b[A-Z]{3}-\d{3}\b", page)) <= clauses
