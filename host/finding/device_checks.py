"""The doctor's checks of a device that answers: whether it can do what it is there for.

What transducers make of their pulses no device can see, nor can these checks.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.errors import DeviceRefusedError
from ...protocol.board import TICK_HZ, TICKS_PER_PERIOD
from ...protocol.codes import (
    CLEARED_BELOW_C,
    COLLECT_MS,
    COLLECTIONS_MISSED,
    NOW,
    PROMISED_PERIODS,
    PROTOCOL_VERSION,
    SILENCING_FAULTS,
    SYNC_PERIODS,
    TEMPERATURE_LIMIT_C,
    Bank,
    Fault,
    Feature,
    State,
)
from ...protocol.pulses import Pulses
from ...protocol.replies import Info, ProcessorReport
from ...protocol.versions import Version
from ..streaming.clock import Reading
from ..streaming.device import Device
from ..streaming.ledger import DAMAGE
from ..streaming.session import watchdog_ms
from .findings import CLEAR_FAULTS, FLASH, RESET, Judgement, fail, listed, ok, skipped, warn

__all__ = ["DEVICE_CHECKS", "QUIET_CHECKS", "as_found"]

CRYSTAL_PPM, BROKEN_PPM = 100, 1000
"""What a cheap crystal may be off, and what none is."""
CLOCK_SECONDS = 1.2
CLOCK_ATTEMPTS = 3
"""A computer that is busy holds up an emulated device for some of the time; an oscillator is off all the time."""
CLOCK_READINGS = 8
"""Of these the quickest counts."""
ASKING_SECONDS = 0.3
AHEAD_SECONDS = (0.1, 0.4, 1.6)
"""How far ahead the test patterns are named, one attempt after the other: a serial line of 115 200 baud needs half of
the first for one, a computer that is busy more."""
PATIENT_WATCHDOG_SECONDS = 2.0
TRIED_BLOCKS = 20
HELD_UP = "this computer or the line is too slow for this check: close what keeps it busy, and run the doctor again"
LOOK_SECONDS = 0.005
NOTE_SECONDS = 0.02
"""How long each transducer plays."""
QUIET_WIDTH = 2
"""The width at which a transducer is tried alone (clause CON-008); its power is 0.016 of a full one."""


def _place(info: Info, processor: int) -> str:
    """A processor, numbered along the chain, for people."""
    return "board {} processor {}".format(*divmod(processor, info.processors_per_board))


def _places(info: Info, processors: Iterable[int]) -> str:
    """Processors, or boards if it is all of a board."""
    there = sorted(set(processors))
    boards = Counter(processor // info.processors_per_board for processor in there)
    whole = {board for board, count in boards.items() if count == info.processors_per_board}
    if len(whole) == info.boards:
        return "all boards"
    board_of = {at: at // info.processors_per_board for at in there}
    names = (f"board {board}" if board in whole else _place(info, at) for at, board in board_of.items())
    return listed(dict.fromkeys(names))


def _protocol(device: Device) -> Judgement:
    info = device.info
    speaks = f"{info.oldest_version}" + f" to {info.newest_version}" * (info.newest_version > info.oldest_version)
    return ok(f"version {PROTOCOL_VERSION}; the device speaks {speaks}")


def _firmware(device: Device) -> Judgement:
    firmware, status = str(Version(*device.info.firmware)), device.status()
    bank = next((report.bank for report in device.processors() if report.bank), None)
    seen = f"{firmware} from the bank {bank.name}" if bank else firmware
    if Fault.FLASH in status.faults:
        return warn(f"{seen}; a newer one could not be loaded", _FAULTS[Fault.FLASH].advice)
    return ok(seen + "; it was never updated" * (bank is Bank.FACTORY))


def _wiring(device: Device) -> Judgement:
    device.wiring()
    return ok("each transducer has an output of its own")


def _settings(device: Device) -> Judgement:
    status, info = device.found, device.info
    seen = f"watchdog {status.watchdog_ms} ms, drive limit {status.drive_limit} transducers"
    if status.watchdog_fired:
        seen += (
            "; the watchdog has turned the outputs off: the program that played was held up, or ended without a stop"
        )
    needed = max(info.watchdog_ms, watchdog_ms(device.most_updates_per_second))
    if status.watchdog_ms in (info.watchdog_ms, needed) and status.drive_limit == info.drive_limit:
        so_long = status.watchdog_ms > info.watchdog_ms
        return ok(seen + "; a line as slow as this needs so long a watchdog time" * so_long)
    return warn(
        f"{seen}; at power-up {info.watchdog_ms} ms and {info.drive_limit}",
        "phasewire or another program has set them so since power-up, as phasewire does with the watchdog time if it "
        f"plays over a slow serial line; if you do not want that, `{RESET}`",
    )


class _Stretch(NamedTuple):
    """Some time of the device beside the same time of the host."""

    ppm: float
    unsure_ppm: float
    ticks: int
    sync_pulses: int

    @property
    def off_ppm(self) -> float:
        """By how much the clocks differ at least."""
        return abs(self.ppm) - self.unsure_ppm


def _reading(device: Device) -> tuple[Reading, int]:
    """The device's clock beside the host's, and its count of synchronisation pulses."""
    before = device.time.monotonic()
    clock = device.clock()
    return Reading(before, device.time.monotonic(), clock.now), clock.sync_pulses


def _quickest(device: Device) -> tuple[Reading, int]:
    return min((_reading(device) for _ in range(CLOCK_READINGS)), key=lambda each: each[0].uncertainty)


def _stretch(device: Device, meanwhile: Callable[[], object]) -> _Stretch:
    """Compare the two clocks over the time that something takes."""
    first, pulses_before = _quickest(device)
    meanwhile()
    last, pulses = _quickest(device)
    seconds, ticks = last.middle - first.middle, last.tick - first.tick
    unsure = first.uncertainty + last.uncertainty
    return _Stretch(1e6 * (ticks / TICK_HZ / seconds - 1), 1e6 * unsure / seconds, ticks, pulses - pulses_before)


def _clock(device: Device) -> Judgement:
    def ask() -> None:
        end = device.time.monotonic() + ASKING_SECONDS
        while device.time.monotonic() < end:
            device.status()

    for _ in range(CLOCK_ATTEMPTS):
        alone = _stretch(device, lambda: device.time.sleep(CLOCK_SECONDS))
        if alone.off_ppm <= CRYSTAL_PPM:
            break
    seen = f"{alone.ppm:+.0f} ppm of the host's clock, ± {alone.unsure_ppm:.0f}"
    if alone.off_ppm > CRYSTAL_PPM:
        asked = _stretch(device, ask)
        if abs(asked.ppm - alone.ppm) > asked.unsure_ppm + alone.unsure_ppm + CRYSTAL_PPM:
            return skipped(
                f"its time passes at {1 + alone.ppm / 1e6:.4g} of the host's while it is left alone, and at "
                f"{1 + asked.ppm / 1e6:.4g} while it is asked: that is no oscillator, but an emulated device at the "
                "pace fast, or one that is computed on a busy computer"
            )
    if not alone.sync_pulses and alone.ticks > 2 * SYNC_PERIODS * TICKS_PER_PERIOD:
        return fail(f"{seen}; no pulses on the sync line", _FAULTS[Fault.SYNC].advice)
    if alone.off_ppm > CRYSTAL_PPM:
        return (fail if alone.off_ppm > BROKEN_PPM else warn)(
            seen, "the device's oscillator is off, or this computer's clock"
        )
    return ok(f"{seen}; {alone.sync_pulses} pulses on the sync line")


class _HeldUp(Exception):
    """The computer or the line was too slow for a check; the text says by what that is known."""


@contextmanager
def as_found(device: Device) -> Iterator[None]:
    """Give the device back the settings with which it was found, however the checks end; its outputs are off then."""
    try:
        yield
    finally:
        device.stop()  # as long as outputs are enabled the limit stays
        device.set_drive_limit(device.found.drive_limit)
        device.set_watchdog(device.found.watchdog_ms / 1000)


@contextmanager
def _patient(device: Device) -> Iterator[None]:
    """Let the watchdog wait longer, so that it does not judge this computer; in the end outputs are off.

    `as_found` puts its time back.

    Raises
    ------
    _HeldUp
        If it has fired all the same.
    """
    device.set_watchdog(PATIENT_WATCHDOG_SECONDS)
    try:
        yield
    except DeviceRefusedError as error:
        _check_watchdog(device)
        raise error
    finally:
        _silence(device)


def _check_watchdog(device: Device) -> None:
    """Raise `_HeldUp` if the watchdog has turned the outputs off."""
    status = device.status()
    if status.watchdog_fired:
        raise _HeldUp(f"the device heard nothing for {status.watchdog_ms / 1000:g} s, so its watchdog fired")


def _self_test(device: Device) -> Judgement:
    """Two patterns of phases whose pulses all have no width: they are silent, and come back as they were sent."""
    if blocked := _blocked(device):
        return skipped(blocked)
    ramp = np.arange(device.info.channels) % 100
    try:
        with _patient(device):
            wrong = next(filter(None, (_try_in_time(device, phase) for phase in (ramp, 99 - ramp))), "")
    except _HeldUp as error:
        return warn(str(error), HELD_UP)
    if wrong:
        return fail(wrong, "see chain and faults")
    back = "came back as sent" if Feature.READ_BACK in device.info.features else "cannot be read back"
    return ok(f"two silent patterns played when they should, and {back}")


def _try_in_time(device: Device, phase: NDArray[np.int64]) -> str:
    """Try phases without width at a period that is far enough ahead; what went wrong, empty if nothing did."""
    for seconds in AHEAD_SECONDS:
        period = device.clock().now // device.info.ticks_per_period + round(seconds * device.info.carrier_hz)
        try:
            return _try_pulses(device, Pulses(phase, np.zeros_like(phase)), period)
        except _HeldUp:
            if seconds == AHEAD_SECONDS[-1]:
                raise
    raise AssertionError


def _transducers(device: Device) -> Judgement:
    """Each transducer alone, at a low drive."""
    if blocked := _blocked(device):
        return skipped(blocked)
    device.set_drive_limit(1)
    try:
        with _patient(device):
            wrong = [transducer for transducer in range(device.info.channels) if not _plays_alone(device, transducer)]
    except _HeldUp as error:
        return warn(str(error), HELD_UP)
    if wrong:
        return fail(f"{len(wrong)} did not play their pulse: {listed(map(str, wrong))}", "see chain and faults")
    return ok(f"{device.info.channels} played, one after the other; whether they sounded only a microphone can tell")


def _plays_alone(device: Device, transducer: int) -> bool:
    """Play one transducer for a moment; whether its pulse came back."""
    width = np.zeros(device.info.channels, int)
    width[transducer] = QUIET_WIDTH
    wrong = _try_pulses(device, Pulses(np.zeros_like(width), width), NOW)
    device.time.sleep(NOTE_SECONDS)
    return not wrong


def _silence(device: Device) -> None:
    """Turn the outputs off, and let the controller hear from its processors what has gone wrong (clause CHN-017)."""
    device.stop()
    device.time.sleep((COLLECTIONS_MISSED + 1) * COLLECT_MS / 1000)


def _blocked(device: Device) -> str:
    """Turn the outputs off, whoever enabled them; why nothing may be played now, empty if it may."""
    device.stop()
    status = device.status()
    if status.state is State.OFF:
        return ""
    faults = listed(fault.name or "" for fault in status.faults & SILENCING_FAULTS)
    return f"silenced by {faults}: see faults" if faults else f"nothing plays in the state {status.state.name}"


def _try_pulses(device: Device, pulses: Pulses, period: int) -> str:
    """Play pulses and read them back; what went wrong, empty if nothing did.

    Raises
    ------
    _HeldUp
        If the computer or the line was too slow to tell.
    """
    ack = device.show(pulses, period)
    if period not in (NOW, ack.commit_period):
        if ack.now_period + PROMISED_PERIODS > period:
            raise _HeldUp(f"a pattern for period {period} arrived in {ack.now_period} only")
        return f"a pattern for period {period} was played in {ack.commit_period}"
    for _ in range(round(2 * AHEAD_SECONDS[-1] / LOOK_SECONDS)):  # each look is a sign of life
        if (status := device.status()).period > ack.commit_period or not status.enabled:
            break
        device.time.sleep(LOOK_SECONDS)
    if not status.enabled:
        _check_watchdog(device)
        return f"the device turned its outputs off ({status.state.name})"
    if Feature.READ_BACK not in device.info.features:
        return ""
    read = device.read_back()
    differ = np.flatnonzero((read.pulses.phase != pulses.phase) | (read.pulses.width != pulses.width))
    if differ.size:
        info = device.info
        per_processor = info.channels // (info.boards * info.processors_per_board)
        places = _places(info, (device.wiring().channels[differ] // per_processor).tolist())
        return f"{differ.size} pulses came back wrong, from {places}"
    if read.mixed:
        return "the processors did not begin a pattern together"
    if read.since_period != ack.commit_period:
        return f"a pattern for period {ack.commit_period} has played since {read.since_period}"
    return ""


def _temperature(device: Device) -> Judgement:
    status = device.status()
    boards = {
        place // device.info.processors_per_board: report.temperature_c
        for place, report in enumerate(device.processors())
        if report.bank is not None
    }
    where = f" on board {max(boards, key=boards.__getitem__)}" if boards else ""
    seen = f"{status.temperature_c} °C at most{where}"
    if status.temperature_c > TEMPERATURE_LIMIT_C:
        return fail(seen, _FAULTS[Fault.TEMPERATURE].advice)
    if status.temperature_c > CLEARED_BELOW_C:
        return warn(seen, f"above {TEMPERATURE_LIMIT_C} °C the outputs go off: let it cool, or blow air at it")
    return ok(seen)


def _chain(device: Device) -> Judgement:
    reports, info = device.processors(), device.info
    missing = [place for place, report in enumerate(reports) if report.bank is None]
    if missing:
        return fail(
            f"{len(reports) - len(missing)} of {len(reports)} processors answer; missing: {_places(info, missing)}",
            f"check power and cables of {_place(info, missing[0])} first, for all behind it hang on it",
        )
    versions = Counter(report.firmware for report in reports)
    if len(versions) > 1:
        usual = versions.most_common(1)[0][0]
        others = (place for place, report in enumerate(reports) if report.firmware != usual)
        return fail(f"not all run {Version(*usual)}: {_places(info, others)}", f"write the firmware anew: `{FLASH}`")
    if Fault.PROCESSOR in device.status().faults:
        return fail(
            "a processor was lost while the device ran; until it starts anew it cannot say which",
            f"`{RESET}`, and run the doctor again: it then names the board",
        )
    troubled = [text for place, report in enumerate(reports) if (text := _trouble(info, place, report))]
    if troubled:
        return warn(
            f"{len(reports)} processors; {listed(troubled, '; ')}",
            "check the cables between those boards; with the fault OVERRUN it is the firmware",
        )
    return ok(f"{len(reports)} processors with the same firmware; no message damaged, no commit missed")


def _trouble(info: Info, place: int, report: ProcessorReport) -> str:
    """What messages did not reach a processor since power-up; empty if all did."""
    counts = ((report.missed_commits, "missed commits"), (report.damaged_messages, "damaged messages"))
    said = " and ".join(f"{count} {what}" for count, what in counts if count)
    return f"{_place(info, place)}: {said}" if said else ""


class Meaning(NamedTuple):
    """What a fault means, and what to do about it."""

    meaning: str
    advice: str


_FAULTS: Mapping[Fault, Meaning] = {
    Fault.CHAIN: Meaning(
        "a message on the chain was damaged, or a commit missed",
        f"check the cables between the boards that chain names, then `{CLEAR_FAULTS}`; if it stays, `{RESET}`",
    ),
    Fault.PROCESSOR: Meaning(
        "a processor does not answer, so the outputs are off",
        f"`{RESET}`; if it stays, check power and cables of the board that chain names",
    ),
    Fault.SYNC: Meaning(
        "a board has lost the common clock, so the outputs are off",
        f"check the sync line and the oscillator's cable to each board, then `{RESET}`",
    ),
    Fault.TEMPERATURE: Meaning(
        f"a board is or was above {TEMPERATURE_LIMIT_C} °C, so the outputs are off",
        f"let it cool below {CLEARED_BELOW_C} °C and blow air at it, then `{CLEAR_FAULTS}`",
    ),
    Fault.SUPPLY: Meaning(
        "the amplifiers' supply is or was outside 12 to 18 V, so the outputs are off",
        f"check the supply and its plugs, then `{CLEAR_FAULTS}`",
    ),
    Fault.OVERRUN: Meaning(
        "a processor could not make its pulses ready in time and played on what it had",
        f"write the newest firmware: `{FLASH}`; play fewer updates a second meanwhile",
    ),
    Fault.FLASH: Meaning(
        "the newest firmware could not be loaded, so an older one or the factory's runs",
        f"write the firmware anew: `{FLASH}`",
    ),
}


def _faults(device: Device) -> Judgement:
    faults = [fault for fault in Fault if fault in device.status().faults]
    if not faults:
        return ok("none")
    reports = device.processors()
    said = []
    for fault in faults:
        places = _places(device.info, (place for place, report in enumerate(reports) if fault in report.faults))
        said.append(f"{fault.name}{f' ({places})' if places else ''}: {_FAULTS[fault].meaning}")
    advice = "; ".join(dict.fromkeys(_FAULTS[fault].advice for fault in faults))
    return (fail if any(fault in SILENCING_FAULTS for fault in faults) else warn)("; ".join(said), advice)


def _blocks(device: Device) -> Judgement:
    """Whether blocks arrive whole now; the counts since power-up may come of what was done before."""
    before = device.status()
    counts = ("accepted", "refused", "late", "lost", "dropped_frames")
    seen = ", ".join(f"{getattr(before, name)} {name.replace('_', ' ')}" for name in counts) + " since power-up"
    if blocked := _blocked(device):
        return ok(f"{seen}; none could be tried: {blocked}")
    try:
        with _patient(device):
            for _ in range(TRIED_BLOCKS):
                device.show(Pulses.silent(device.info.channels))
            after = device.status()
    except _HeldUp as error:
        return warn(str(error), HELD_UP)
    damaged = after.dropped_frames - before.dropped_frames
    if after.last_refusal in DAMAGE:
        damaged += after.refused - before.refused
    if damaged:
        return warn(
            f"{seen}; beside {TRIED_BLOCKS} blocks sent now {damaged} arrived damaged",
            "something damages what arrives: try another cable, and on a serial line its rate",
        )
    return ok(f"{seen}; {TRIED_BLOCKS} sent now arrived whole")


def _outputs(device: Device) -> Judgement:
    device.stop()
    state = device.status().state
    return ok(f"off ({state.name})") if state in (State.OFF, State.FAULT) else fail(state.name, "cut the power")


DEVICE_CHECKS: Mapping[str, Callable[[Device], Judgement]] = {
    "protocol": _protocol,
    "firmware": _firmware,
    "wiring": _wiring,
    "settings": _settings,
    "clock": _clock,
    "self-test": _self_test,
    "transducers": _transducers,
    "temperature": _temperature,
    "chain": _chain,
    "faults": _faults,
    "blocks": _blocks,
    "outputs": _outputs,
}
QUIET_CHECKS: Mapping[str, Callable[[Device], Judgement]] = {
    **DEVICE_CHECKS,
    "transducers": lambda _: skipped("it makes some seconds of soft sound: ask for it with --play"),
}
