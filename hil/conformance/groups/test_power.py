"""Power and the bus: restarts, suspend and resume, an unplugged cable; what they reset, and what goes on."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
from phasewire.base.errors import DeviceError
from phasewire.emulator.faults import DeadProcessor
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Inconclusive, Need, Risk, case, expect, unmet
from phasewire.hil.conformance.sight.waveforms import check_play, check_silent, expected_words
from phasewire.hil.conformance.tools.forge import forged
from phasewire.hil.conformance.tools.playing import CLOCK_ERROR, judge_silence_since
from phasewire.hil.conformance.tools.steps import LONG_MS, check_sync, enable, expect_all, known, suspended
from phasewire.protocol.blocks import (
    AmplitudeModulation,
    Entries,
    Entry,
    NoOp,
    PlaySequence,
    Samples,
    Slot,
    Update,
    pack,
)
from phasewire.protocol.board import CARRIER_HZ, PROCESSORS, TICK_HZ
from phasewire.protocol.codes import AckFlag, Fault, Feature, FrameKind, Outcome, Reason, Request, State, StatusFlag
from phasewire.protocol.framing import LineMode, SerialReply
from phasewire.protocol.pulses import Pulses
from phasewire.protocol.replies import Ack, Status
from phasewire.protocol.requests import Setup

RECORDS_IN = 0x81
CONSOLE = 1
MOST_JUDGED = 4000
"""Periods of silence that are examined, out of many."""
SOON = 5.0
LEAVES_SECONDS = 2.0
STARTS_SECONDS = 0.3
"""Within a start that lasts a second or more."""
LINE_CODING = bytes([0x80, 0x25, 0, 0, 2, 1, 7])
LINE_CODING_AT_FIRST = bytes([0x00, 0xC2, 0x01, 0x00, 0, 0, 8])
COUNTERS = ("accepted", "refused", "late", "lost", "missed_commits", "damaged_messages")

# Restarts


def cut_power(bench: Bench) -> None:
    """Cut the power and restore it."""
    if not bench.can(Need.POWER):
        raise Inconclusive(unmet(Need.POWER))
    bench.power_cycle()


Restart = Callable[[Bench], None]
either_restart = pytest.mark.parametrize(
    "restart", [lambda bench: bench.restart(lambda: bench.order(Request.RESET)), cut_power], ids=["reset", "power"]
)


def store_everything(bench: Bench) -> None:
    """An entry of slot 3 at place 7, and two samples at place 9, if the device keeps them."""
    for body in known(bench, Slot(3, bench.weak(0.5)), Entries((Entry(3, 40),), 7), Samples(bytes([255, 128]), 9)):
        bench.must(body)


def play(bench: Bench) -> Ack:
    """An update that plays, with a watchdog time longer than any case."""
    enable(bench)
    ack = bench.must(Update(bench.weak(0.5)))
    bench.wait_until(ack.commit_period)
    expect("the state before", bench.status().state, State.PLAYING)
    return ack


@case("REQ-013", "REQ-003", "STA-006", "SAF-006", "REQ-009", "REQ-010", "TIM-002", allow=(Risk.RESET,))
@either_restart
def test_everything_begins_anew_with_a_restart(bench: Bench, restart: Restart) -> None:
    """After RESET and power-up the device is OFF, and counts, time, watchdog and limit have their initial values."""
    first = bench.must(NoOp())
    bench.must(NoOp(), number=(first.sequence + 5) % 2**32)
    bench.send_raw(forged(pack(bench.numbered(NoOp())), checksum=0))
    bench.order(Request.LIMIT, bench.drive_limit - 1)
    play(bench)
    for body in known(bench, Samples(bytes([255])), AmplitudeModulation(0, 1, 1)):
        bench.must(body)
    began = bench.line.time.monotonic()
    restart(bench)
    status = bench.status()
    passed = bench.line.time.monotonic() - began
    expect_all(
        status, state=State.OFF, faults=Fault(0), last_refusal=Reason.ACCEPTED, flags=StatusFlag(0), since_period=0
    )
    for name in COUNTERS:
        expect(f"the status' {name}", getattr(status, name), 0)
    expect_all(
        status, free=bench.info.queue_blocks, watchdog_ms=bench.info.watchdog_ms, drive_limit=bench.info.drive_limit
    )
    most = passed * (1 + CLOCK_ERROR)
    assert status.now / TICK_HZ <= most, (
        f"the time is {status.now / TICK_HZ:.6f} s, {passed:.6f} s after the restart was requested; should begin at 0"
    )


@case("REQ-002", "REQ-013", "USB-001", allow=(Risk.RESET,))
@either_restart
def test_what_the_device_is_stays_over_a_restart(bench: Bench, restart: Restart) -> None:
    """INFO and WIRING are the same after RESET and power-up: it is the same device."""
    before = [bench.ask(Request.INFO), bench.ask(Request.WIRING)]
    restart(bench)
    expect("INFO", bench.ask(Request.INFO), before[0])
    expect("WIRING", bench.ask(Request.WIRING), before[1])


@case("BLK-013", "REQ-013", "BLK-021", features=Feature.SEQUENCES, allow=(Risk.RESET,))
@either_restart
def test_slots_and_entries_are_empty_after_a_restart(bench: Bench, restart: Restart) -> None:
    """A sequence from before RESET or power-up is refused with EMPTY until entry and slot are stored again."""
    store_everything(bench)
    restart(bench)
    bench.order(Request.LIMIT, bench.drive_limit)
    enable(bench)
    expect("the reason without an entry", bench.send(PlaySequence(7, 1)).reason, Reason.EMPTY)
    bench.must(Entries((Entry(3, 40),), 7))
    expect("the reason without a slot", bench.send(PlaySequence(7, 1)).reason, Reason.EMPTY)
    bench.must(Slot(3, bench.weak(0.5)))
    bench.must(PlaySequence(7, 1))


@case("BLK-021", "REQ-013", features=Feature.MODULATION, allow=(Risk.RESET,))
@either_restart
def test_samples_are_empty_after_a_restart(bench: Bench, restart: Restart) -> None:
    """A modulation of samples from before RESET or power-up is refused with EMPTY until they are stored again."""
    store_everything(bench)
    restart(bench)
    enable(bench)
    expect("the reason without samples", bench.send(AmplitudeModulation(9, 2, 1)).reason, Reason.EMPTY)
    bench.must(Samples(bytes([255]), 9))
    expect("the reason with one of two", bench.send(AmplitudeModulation(9, 2, 1)).reason, Reason.EMPTY)
    bench.must(Samples(bytes([128]), 10))
    bench.must(AmplitudeModulation(9, 2, 1))


@case("NUM-004", allow=(Risk.RESET,))
@either_restart
def test_any_number_is_accepted_after_a_restart(bench: Bench, restart: Restart) -> None:
    """The first block after RESET or power-up is accepted with any number, and the numbering begins with it."""
    old = (bench.must(NoOp()).sequence - 1000) % 2**32
    expect("the reason for an old number", bench.send(NoOp(), number=old).reason, Reason.SEQUENCE)
    restart(bench)
    expect("its flags", bench.must(NoOp(), number=old, restart=False).flags, AckFlag(0))
    expect("the count of lost blocks", bench.status().lost, 0)
    expect("the reason for its number again", bench.send(NoOp(), number=old).reason, Reason.SEQUENCE)


@case("TIM-002/2", "TIM-002/3", "CHN-026", allow=(Risk.RESET,))
@either_restart
def test_a_device_that_answers_counts_periods_and_knows_its_processors(bench: Bench, restart: Restart) -> None:
    """The first answer after RESET or power-up knows all ten processors and a pulse on the sync line."""
    restart(bench)
    clock, reports, status = bench.clock(), bench.processors(), bench.status()
    expect("the count of processors", len(reports), PROCESSORS)
    for place, report in enumerate(reports):
        expect(f"the faults of processor {place}", report.faults, Fault(0))
        assert report.bank is not None, f"processor {place} is not there yet"
        expect(f"the firmware of processor {place}", report.firmware, bench.info.firmware)
    expect("the faults", status.faults, Fault(0))
    assert clock.sync_pulses >= 1, "there was no pulse on the sync line yet, should be one at period 0"
    check_sync(bench)


@case("SAF-001", "REQ-013", "STA-006", needs=(Need.CAPTURE,), allow=(Risk.RESET,))
@either_restart
def test_the_outputs_are_low_after_a_restart(bench: Bench, restart: Restart) -> None:
    """All outputs are low from period 0 on, whatever played before, until a host enables them and sends a change."""
    play(bench)
    restart(bench)
    bench.must(NoOp())
    bench.enable()
    bench.wait_periods(40)
    last = bench.period()
    bench.judge(max(last - MOST_JUDGED, 0), last, check_silent)


@case("SAF-001", "REQ-013", needs=(Need.CAPTURE,), allow=(Risk.RESET,))
@either_restart
def test_the_outputs_are_low_while_a_device_starts(bench: Bench, restart: Restart) -> None:
    """All outputs are low in the first periods after RESET and power-up, before the first request."""
    play(bench)
    restart(bench)
    bench.judge(0, min(bench.period(), MOST_JUDGED), check_silent)


@case("REQ-013", "USB-004", allow=(Risk.RESET,), line="usb")
def test_reset_leaves_the_bus(bench: Bench) -> None:
    """RESET is answered, then the device leaves the bus, so that the host's system forgets its state."""
    bench.order(Request.RESET)
    end, left = bench.line.time.monotonic() + LEAVES_SECONDS, False
    while not left and bench.line.time.monotonic() < end:
        bench.wait(0.01)
        try:
            bench.line.request(Setup(0xC1, Request.STATUS, 0, 0, Status.BYTES))
        except DeviceError:
            left = True
    bench.restart(lambda: None)
    assert left, f"the device still answers on the same bus {LEAVES_SECONDS:g} s after RESET"


@case("REQ-001", "REQ-013", allow=(Risk.RESET,))
@pytest.mark.parametrize(
    "setup",
    [
        Setup(kind, Request.RESET, *rest)
        for kind, *rest in ((0x41, 1, 0, 0), (0x41, 0, 1, 0), (0x41, 0, 0, 1), (0xC1, 0, 0, 1))
    ],
    ids=["value", "index", "data", "in"],
)
def test_what_is_no_reset_restarts_nothing(bench: Bench, setup: Setup) -> None:
    """RESET with a wrong value, index or direction, or with data, is answered with STALL and restarts nothing."""
    bench.must(NoOp())
    before = bench.status()
    answer = bench.request(setup, b"" if setup.is_in else bytes(setup.length))
    assert answer is None, f"{setup} is answered with {answer!r}, should be with STALL"
    bench.wait(0.05)
    after = bench.status()
    expect("the count of accepted blocks", after.accepted, before.accepted)
    assert after.now > before.now, f"the time is {after.now}, should go on from {before.now}"


@case("REQ-013", "SER-010", features=Feature.CONSOLE, allow=(Risk.RESET,))
def test_reset_over_a_serial_line_is_answered_first(bench: Bench) -> None:
    """RESET in a frame is answered with its REPLY, then CONSOLE, and only then does the device restart."""
    bench.must(NoOp())
    line = bench.serial
    line.enter_frames()
    line.send_frame(FrameKind.REQUEST, bytes([0x5A]) + Setup(0x41, Request.RESET, 0, 0, 0).encode())
    try:
        line.listen(line.patience(), lambda: line.mode is LineMode.CONSOLE and line.events != [])
    except DeviceError as error:
        bench.note("the line", error)
    seen, replies = list(line.events), [SerialReply.decode(body) for body in line.frames(FrameKind.REPLY)]
    bench.restart(lambda: None)
    expect("the list of replies", replies, [SerialReply(0x5A, Outcome.DONE)])
    assert seen[-1:] == [LineMode.CONSOLE], f"no CONSOLE follows the reply, but {seen}"
    expect_all(bench.status(), state=State.OFF, accepted=0)


@case("USB-026", "REQ-013", allow=(Risk.RESET,), line="usb")
@either_restart
def test_the_console_is_as_at_first_after_a_restart(bench: Bench, restart: Restart) -> None:
    """Line coding and DTR have their initial values after RESET and power-up."""
    bench.request(Setup(0x21, 0x20, 0, CONSOLE, 7), LINE_CODING)
    restart(bench)
    coding = bench.request(Setup(0xA1, 0x21, 0, CONSOLE, 7))
    if coding != LINE_CODING_AT_FIRST and CONSOLE in bench.usb.from_kernel:
        raise Inconclusive("the computer's serial driver sets the line coding before a program can ask for it")
    expect("the line coding", coding, LINE_CODING_AT_FIRST)


@case("TIM-002", "SER-010", needs=(Need.FAULTS,), features=Feature.CONSOLE, allow=(Risk.RESET,), line="serial", since=3)
def test_what_arrives_while_a_device_starts_is_dropped(bench: Bench) -> None:
    """A damaged frame that arrives while the device looks for the end of its chain is neither counted nor answered."""
    if bench.line.kind == "usb":
        raise Inconclusive("this applies to a device that is used over a serial line alone")
    bench.levers.cause(DeadProcessor(processor=5))  # the one before it waits for a second
    bench.order(Request.RESET)
    bench.wait(STARTS_SECONDS)
    bench.serial.write(b"\0damaged\0" * 3)
    bench.restart(lambda: None)
    expect("dropped_frames", bench.status().dropped_frames, 0)


# Suspend


def play_unattended(bench: Bench, *, periods: int = 40, repeats: int = 0) -> tuple[Ack, Pulses]:
    """An unattended sequence of one slot; returns what it plays."""
    pulses = bench.weak(0.5)
    bench.must(Slot(3, pulses))
    bench.must(Entries((Entry(3, periods),), 7))
    enable(bench)
    ack = bench.must(PlaySequence(7, 1, repeats=repeats, unattended=True))
    bench.wait_until(ack.commit_period)
    expect("the state before", bench.status().state, State.UNATTENDED)
    bench.order(Request.WATCHDOG, bench.info.watchdog_ms)  # which an unattended sequence outlasts
    return ack, pulses


SUSPEND = (Need.SUSPEND,)


@case("USB-020", "ACK-006", needs=SUSPEND, allow=(Risk.RESET,), line="usb")
def test_suspend_keeps_the_records(bench: Bench) -> None:
    """Records that wait survive a suspension, and one status record after them reports the result."""
    blocks = [bench.numbered(NoOp()) for _ in range(3)]
    before = bench.status().accepted
    bench.usb.write(1, b"".join(map(pack, blocks)), SOON)
    enable(bench)
    end = bench.line.time.monotonic() + SOON
    while (accepted := bench.status().accepted) != (before + len(blocks)) % 2**32:
        assert bench.line.time.monotonic() < end, (
            f"{(accepted - before) % 2**32} of {len(blocks)} blocks are accepted {SOON:g} s after they were sent"
        )
    with suspended(bench):
        bench.wait(0.005)
    found = bench.listen(0.05)
    sequences = [record.sequence for record in found if isinstance(record, Ack)]
    expect("the numbers that are acknowledged", sequences, [block.sequence for block in blocks])
    statuses = [record for record in found if isinstance(record, Status)]
    expect("the count of status records", len(statuses), 1)
    expect("the place of the status record", found.index(statuses[0]), len(blocks))
    expect("the state that it says", statuses[0].state, State.OFF)


@case("USB-020", "NUM-004", needs=SUSPEND, allow=(Risk.RESET,), line="usb")
def test_a_device_that_resumes_is_configured_as_before(bench: Bench) -> None:
    """Configuration, halts, numbering, line coding and stores survive a suspension, which changes no host."""
    first = bench.must(NoOp())
    store_everything(bench)
    bench.request(Setup(0x21, 0x20, 0, CONSOLE, 7), LINE_CODING)
    bench.request(Setup(0x02, 3, 0, 0x83, 0))
    last = bench.must(NoOp())
    try:
        with suspended(bench):
            bench.wait(0.02)
        expect("the configuration", bench.request(Setup(0x80, 8, 0, 0, 1)), b"\x01")
        expect("the halt of endpoint 83", bench.request(Setup(0x82, 0, 0, 0x83, 2)), b"\x01\x00")
        expect("the line coding", bench.request(Setup(0xA1, 0x21, 0, CONSOLE, 7)), LINE_CODING)
    finally:
        bench.usb.clear_halt(0x83)
    expect("the reason for an old number", bench.send(NoOp(), number=first.sequence).reason, Reason.SEQUENCE)
    ack = bench.must(NoOp(), number=(last.sequence + 3) % 2**32)
    expect("the flags after two missing numbers", ack.flags, AckFlag.GAP)
    enable(bench)
    if Feature.SEQUENCES in bench.info.features:
        bench.must(PlaySequence(7, 1))


@case("USB-020", "TIM-002", needs=SUSPEND, allow=(Risk.RESET,), line="usb")
def test_time_goes_on_while_the_bus_is_suspended(bench: Bench) -> None:
    """The device counts its periods on while the bus is suspended, because time is never set."""
    before, began = bench.clock().now, bench.line.time.monotonic()
    with suspended(bench):
        bench.wait(0.3)
    passed, ticks = bench.line.time.monotonic() - began, bench.clock().now - before
    assert abs(ticks / TICK_HZ - passed) <= CLOCK_ERROR * passed + 0.02, (
        f"{ticks / TICK_HZ:.4f} s passed for the device, should be {passed:.4f} s"
    )


@case("USB-020", "SAF-004/1", needs=(*SUSPEND, Need.CAPTURE), allow=(Risk.RESET,), line="usb")
def test_the_outputs_are_off_while_the_bus_is_suspended(bench: Bench) -> None:
    """All outputs are low from 10 ms after the last activity on the bus, and stay low after resume."""
    play(bench)
    with suspended(bench):
        began = bench.line.time.monotonic()
        bench.wait(0.05)
    judge_silence_since(bench, began)


@case("USB-020", "SAF-005", "STA-003", needs=SUSPEND, features=Feature.UNATTENDED, allow=(Risk.RESET,), line="usb")
def test_what_plays_unattended_goes_on_while_the_bus_is_suspended(bench: Bench) -> None:
    """An unattended sequence plays on through a suspension, and no status record reports a change."""
    ack, _ = play_unattended(bench)
    bench.listen()
    with suspended(bench):
        bench.wait(0.2)
    expect("what comes unasked", bench.listen(), [])
    expect_all(bench.status(), state=State.UNATTENDED, since_period=ack.commit_period)


@case(
    "USB-020", "SAF-005", needs=(*SUSPEND, Need.CAPTURE), features=Feature.UNATTENDED, allow=(Risk.RESET,), line="usb"
)
def test_the_outputs_go_on_unattended_while_the_bus_is_suspended(bench: Bench) -> None:
    """The outputs play an unattended sequence all through a suspension, without a gap."""
    ack, pulses = play_unattended(bench)
    with suspended(bench):
        bench.wait(0.03)
    last = bench.period()
    first = max(ack.commit_period, last - MOST_JUDGED)
    words = expected_words(pulses, bench.wiring)
    bench.judge(first, last, lambda seen: check_play(seen, [(first, words)]))


@case("STA-004", "SAF-005", needs=SUSPEND, features=Feature.UNATTENDED, allow=(Risk.RESET,), line="usb")
def test_suspend_follows_where_a_sequence_ends_on_a_suspended_bus(bench: Bench) -> None:
    """When an unattended sequence ends while the bus is suspended, the device is suspended too: OFF after resume."""
    play_unattended(bench, periods=2000, repeats=2)
    with suspended(bench):
        bench.wait(0.3)
    expect_all(bench.status(), state=State.OFF, flags=StatusFlag(0))
    found = bench.listen()
    expect("the states of the unsolicited records", [record.state.name for record in found], ["OFF"])


# An unplugged cable


@contextmanager
def unplugged(bench: Bench) -> Iterator[None]:
    """Pull the cable for a while."""
    bench.levers.unplug()
    try:
        yield
    finally:
        bench.levers.plug()
        bench.line.reopen(bench.return_seconds)


PLUG = (Need.PLUG,)


@case("STA-006", "USB-020", "USB-026", "NUM-004", needs=PLUG, allow=(Risk.RESET,), line="usb")
def test_an_unplugged_device_is_found_reset(bench: Bench) -> None:
    """A host that opens the device after it was unplugged finds it off, with an empty queue and no old records."""
    old = (bench.must(NoOp()).sequence - 1000) % 2**32
    store_everything(bench)
    bench.request(Setup(0x21, 0x20, 0, CONSOLE, 7), LINE_CODING)
    play(bench)
    queued = bench.must(Update(bench.weak(), bench.period() + 16_000))
    before = bench.status()
    bench.usb.write(1, pack(bench.numbered(NoOp())), SOON)
    with unplugged(bench):
        bench.wait(0.02)
    after = bench.status()
    expect_all(
        after,
        state=State.OFF,
        since_period=0,
        free=bench.info.queue_blocks,
        accepted=(before.accepted + 1) % 2**32,
        watchdog_ms=LONG_MS,
    )
    assert after.now > before.now, f"the time is {after.now}, should go on from {before.now}"
    expect("what comes unasked", bench.listen(), [])
    expect("the line coding", bench.request(Setup(0xA1, 0x21, 0, CONSOLE, 7)), LINE_CODING_AT_FIRST)
    expect("the flags of any number", bench.must(NoOp(), number=old).flags, AckFlag(0))
    bench.wait_until(queued.commit_period + 2)
    expect("the state after the period of what was queued", bench.status().state, State.OFF)
    bench.enable()
    if Feature.SEQUENCES in bench.info.features:
        bench.must(PlaySequence(7, 1))


@case("STA-006", "USB-020", needs=(*PLUG, Need.CAPTURE), allow=(Risk.RESET,), line="usb")
def test_the_outputs_are_off_once_the_cable_is_pulled(bench: Bench) -> None:
    """All outputs are low from 10 ms after the cable was pulled, and stay low after it is plugged in."""
    play(bench)
    began = bench.line.time.monotonic()
    with unplugged(bench):
        bench.wait(0.05)
    judge_silence_since(bench, began)


@case("SAF-005", "USB-020", "USB-003", needs=PLUG, features=Feature.UNATTENDED, allow=(Risk.RESET,), line="usb")
def test_what_plays_unattended_ends_with_the_next_host(bench: Bench) -> None:
    """An unattended sequence ends when a host configures the device after it was unplugged."""
    play_unattended(bench)
    with unplugged(bench):
        bench.wait(0.02)
    expect_all(bench.status(), state=State.OFF, flags=StatusFlag(0))


@case("SAF-005", "USB-020", needs=(*PLUG, Need.CAPTURE), features=Feature.UNATTENDED, allow=(Risk.RESET,), line="usb")
def test_the_outputs_go_on_unattended_while_the_cable_is_pulled(bench: Bench) -> None:
    """The outputs play an unattended sequence while the cable is pulled, because it needs no host."""
    ack, pulses = play_unattended(bench)
    at, began = bench.period(), bench.line.time.monotonic()
    bench.levers.unplug()
    bench.wait(0.03)
    until = at + int(CARRIER_HZ * (bench.line.time.monotonic() - began) * (1 - CLOCK_ERROR))
    bench.levers.plug()
    bench.line.reopen(bench.return_seconds)
    words = expected_words(pulses, bench.wiring)
    bench.judge(ack.commit_period, until, lambda seen: check_play(seen, [(ack.commit_period, words)]))


# A device on a serial line alone


@case("STA-006", needs=(Need.SUSPEND, Need.PLUG, Need.POWER), allow=(Risk.RESET,), line="serial")
def test_a_bus_that_configured_nothing_suspends_nothing(bench: Bench) -> None:
    """A device that no bus has configured plays on for a serial line, whatever the bus does."""
    needs_serial_alone(bench)
    bench.power_cycle()
    check_plays_on(bench)


@case("STA-006", "STA-003", needs=(Need.SUSPEND, Need.PLUG, Need.BUS), allow=(Risk.RESET,), line="serial")
def test_a_device_that_was_unplugged_is_not_suspended_until_configured(bench: Bench) -> None:
    """Loss of bus voltage ends the configuration: a device that was unplugged and is not configured plays on."""
    needs_serial_alone(bench)
    bench.levers.configure()
    play(bench)
    bench.listen(0.02)
    bench.unasked.clear()
    with suspended(bench):
        bench.wait(0.02)
        expect("the state while a bus that configured it is suspended", bench.status().state, State.SUSPENDED)
    for _ in range(2):
        bench.levers.configure()
        play(bench)
        bench.levers.unplug()
        bench.wait(0.02)
        expect("the state without a cable", bench.status().state, State.OFF)
        bench.levers.plug()
        expect("the state with the cable, before the device is configured", bench.status().state, State.OFF)
        check_plays_on(bench)


def needs_serial_alone(bench: Bench) -> None:
    """Continue only if the line of blocks is serial, so that a bus can come and go."""
    if bench.line.kind != "serial":
        raise Inconclusive("this applies to a device that is used over a serial line alone")


def check_plays_on(bench: Bench) -> None:
    """Fail unless what plays goes on whatever a bus does that has not configured the device."""
    bench.order(Request.LIMIT, bench.drive_limit)
    ack = play(bench)
    with suspended(bench):
        bench.wait(0.02)
        expect("the state while the bus is suspended", bench.status().state, State.PLAYING)
    bench.levers.unplug()
    bench.wait(0.02)
    expect("the state without a cable", bench.status().state, State.PLAYING)
    bench.levers.plug()
    expect_all(bench.status(), state=State.PLAYING, since_period=ack.commit_period)
