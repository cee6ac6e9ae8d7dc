"""The doctor's checks of a device that answers: whether it can do what it is there for.

What transducers make of their pulses no device can see, nor can these checks.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

import numpy as np

from ...protocol.board import BOARDS, CHANNELS_PER_PROCESSOR, PROCESSORS, PROCESSORS_PER_BOARD
from ...protocol.codes import (
    COLLECT_MS,
    COLLECTIONS_MISSED,
    NOW,
    PROTOCOL_VERSION,
    SILENCING_FAULTS,
    Bank,
    Fault,
    Feature,
    Reason,
    State,
)
from ...protocol.pulses import Pulses
from ...protocol.replies import ProcessorReport
from ...protocol.versions import Version
from ..playing.clock import DeviceClock, Reading
from ..playing.device import Device
from .findings import CLEAR_FAULTS, FLASH, RESET, Judgement, fail, listed, ok, skipped, warn

__all__ = ["DEVICE_CHECKS", "QUIET_CHECKS"]

HOT_C, TOO_HOT_C = 80, 85
"""Above the first a TEMPERATURE fault cannot be cleared, above the second it appears (clauses REQ-011 and SAF-008)."""
CRYSTAL_PPM, BROKEN_PPM = 100, 1000
"""What a cheap crystal may be off, and what none is."""
CLOCK_SECONDS = 1.2
AHEAD_SECONDS = 0.1
"""How far ahead the test patterns are named: a serial line of 115 200 baud needs half of it for one."""
LOOK_SECONDS = 0.005
NOTE_SECONDS = 0.02
"""How long each transducer plays."""
QUIET_WIDTH = 2
"""The width at which a transducer is tried alone (clause CON-008); its power is 0.016 of a full one."""


def _place(processor: int) -> str:
    """A processor, numbered along the chain, for people."""
    return "board {} processor {}".format(*divmod(processor, PROCESSORS_PER_BOARD))


def _places(processors: Iterable[int]) -> str:
    """Processors, or boards where it is both of a board."""
    there = sorted(set(processors))
    boards = Counter(processor // PROCESSORS_PER_BOARD for processor in there)
    whole = {board for board, count in boards.items() if count == PROCESSORS_PER_BOARD}
    if len(whole) == BOARDS:
        return "all boards"
    names = (
        f"board {at // PROCESSORS_PER_BOARD}" if at // PROCESSORS_PER_BOARD in whole else _place(at) for at in there
    )
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
    status, info = device.status(), device.info
    seen = f"watchdog {status.watchdog_ms} ms, drive limit {status.drive_limit} transducers"
    if (status.watchdog_ms, status.drive_limit) == (info.watchdog_ms, info.drive_limit):
        return ok(seen)
    return warn(
        f"{seen}; at power-up {info.watchdog_ms} ms and {info.drive_limit}",
        f"another program has set them so; where that is not meant, `{RESET}`",
    )


def _clock(device: Device) -> Judgement:
    clock, readings = DeviceClock(), []
    pulses = []
    for seconds in (0, CLOCK_SECONDS):
        device.time.sleep(seconds)
        before = device.time.monotonic()
        reading = device.clock()
        readings.append(Reading(before, device.time.monotonic(), reading.now))
        clock.add(readings[-1])
        pulses.append(reading.sync_pulses)
    unsure = 1e6 * sum(each.uncertainty for each in readings) / (readings[1].middle - readings[0].middle)
    seen = f"{clock.drift_ppm:+.0f} ppm of the host's clock, ± {unsure:.0f}"
    if pulses[1] == pulses[0]:
        return fail(f"{seen}; no pulses on the sync line", _FAULTS[Fault.SYNC].advice)
    off = abs(clock.drift_ppm) - unsure
    if off > CRYSTAL_PPM:
        return (fail if off > BROKEN_PPM else warn)(seen, "the device's oscillator is off, or this computer's clock")
    return ok(f"{seen}; {pulses[1] - pulses[0]} pulses on the sync line")


def _self_test(device: Device) -> Judgement:
    """Two patterns of phases whose pulses all have no width: they are silent, and come back as they were sent."""
    if blocked := _blocked(device):
        return skipped(blocked)
    channels = device.info.channels
    ramp = np.arange(channels) % 100
    try:
        for phase in (ramp, 99 - ramp):
            period = device.clock().now // device.info.ticks_per_period + round(AHEAD_SECONDS * device.info.carrier_hz)
            if wrong := _try_pulses(device, Pulses(phase, np.zeros(channels, int)), period):
                return fail(wrong, "see chain and faults")
    finally:
        _silence(device)
    back = "came back as sent" if Feature.READ_BACK in device.info.features else "cannot be read back"
    return ok(f"two silent patterns played when they should, and {back}")


def _transducers(device: Device) -> Judgement:
    """Each transducer alone, at a low drive."""
    if blocked := _blocked(device):
        return skipped(blocked)
    before = device.status().drive_limit
    device.set_drive_limit(1)
    try:
        wrong = [transducer for transducer in range(device.info.channels) if not _plays_alone(device, transducer)]
    finally:
        try:
            _silence(device)
        finally:
            device.stop()  # as long as they are enabled the limit stays
            device.set_drive_limit(before)
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
    """Turn the outputs off, whoever enabled them; why nothing may be played now, empty where it may."""
    device.stop()
    status = device.status()
    if status.state is State.OFF:
        return ""
    faults = listed(fault.name or "" for fault in status.faults & SILENCING_FAULTS)
    return f"silenced by {faults}: see faults" if faults else f"nothing plays in the state {status.state.name}"


def _try_pulses(device: Device, pulses: Pulses, period: int) -> str:
    """Play pulses and read them back; what went wrong, empty where nothing did."""
    ack = device.show(pulses, period)
    if period not in (NOW, ack.commit_period):
        return f"a pattern for period {period} was played in {ack.commit_period}"
    for _ in range(round(2 * AHEAD_SECONDS / LOOK_SECONDS)):  # each look is a sign of life
        if (status := device.status()).period > ack.commit_period or not status.enabled:
            break
        device.time.sleep(LOOK_SECONDS)
    if not status.enabled:
        return f"the device turned its outputs off ({status.state.name})"
    if Feature.READ_BACK not in device.info.features:
        return ""
    read = device.read_back()
    differ = np.flatnonzero((read.pulses.phase != pulses.phase) | (read.pulses.width != pulses.width))
    if differ.size:
        places = _places((device.wiring().channels[differ] // CHANNELS_PER_PROCESSOR).tolist())
        return f"{differ.size} pulses came back wrong, from {places}"
    if read.mixed:
        return "the processors did not begin a pattern together"
    if read.since_period != ack.commit_period:
        return f"a pattern for period {ack.commit_period} has played since {read.since_period}"
    return ""


def _temperature(device: Device) -> Judgement:
    status = device.status()
    boards = {
        place // PROCESSORS_PER_BOARD: report.temperature_c
        for place, report in enumerate(device.processors())
        if report.bank is not None
    }
    where = f" on board {max(boards, key=boards.__getitem__)}" if boards else ""
    seen = f"{status.temperature_c} °C at most{where}"
    if status.temperature_c > TOO_HOT_C:
        return fail(seen, _FAULTS[Fault.TEMPERATURE].advice)
    if status.temperature_c > HOT_C:
        return warn(seen, f"above {TOO_HOT_C} °C the outputs go off: let it cool, or blow air at it")
    return ok(seen)


def _chain(device: Device) -> Judgement:
    reports = device.processors()
    missing = [place for place, report in enumerate(reports) if report.bank is None]
    if missing:
        return fail(
            f"{PROCESSORS - len(missing)} of {PROCESSORS} processors answer; missing: {_places(missing)}",
            f"check power and cables of {_place(missing[0])} first, for all behind it hang on it",
        )
    versions = Counter(report.firmware for report in reports)
    if len(versions) > 1:
        usual = versions.most_common(1)[0][0]
        others = (place for place, report in enumerate(reports) if report.firmware != usual)
        return fail(f"not all run {Version(*usual)}: {_places(others)}", f"write the firmware anew: `{FLASH}`")
    if Fault.PROCESSOR in device.status().faults:
        return fail(
            "a processor was lost while the device ran; until it starts anew it cannot say which",
            f"`{RESET}`, and run the doctor again: it then names the board",
        )
    troubled = [text for place, report in enumerate(reports) if (text := _trouble(place, report))]
    if troubled:
        return warn(
            f"{PROCESSORS} processors; {listed(troubled, '; ')}",
            "check the cables between those boards; with the fault OVERRUN it is the firmware",
        )
    return ok(f"{PROCESSORS} processors with the same firmware; no message damaged, no commit missed")


def _trouble(place: int, report: ProcessorReport) -> str:
    """What messages did not reach a processor since power-up; empty where all did."""
    counts = ((report.missed_commits, "missed commits"), (report.damaged_messages, "damaged messages"))
    said = " and ".join(f"{count} {what}" for count, what in counts if count)
    return f"{_place(place)}: {said}" if said else ""


class Meaning(NamedTuple):
    """What a fault means, and what to do about it."""

    meaning: str
    advice: str


_FAULTS: Mapping[Fault, Meaning] = {
    Fault.CHAIN: Meaning(
        "a message on the chain was damaged, or a commit missed",
        f"check the cables between the boards that chain names, then `{CLEAR_FAULTS}`; where it stays, `{RESET}`",
    ),
    Fault.PROCESSOR: Meaning(
        "a processor does not answer, so the outputs are off",
        f"`{RESET}`; where it stays, check power and cables of the board that chain names",
    ),
    Fault.SYNC: Meaning(
        "a board has lost the common clock, so the outputs are off",
        f"check the sync line and the oscillator's cable to each board, then `{RESET}`",
    ),
    Fault.TEMPERATURE: Meaning(
        f"a board is or was above {TOO_HOT_C} °C, so the outputs are off",
        f"let it cool below {HOT_C} °C and blow air at it, then `{CLEAR_FAULTS}`",
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
        places = _places(place for place, report in enumerate(reports) if fault in report.faults)
        said.append(f"{fault.name}{f' ({places})' if places else ''}: {_FAULTS[fault].meaning}")
    advice = "; ".join(dict.fromkeys(_FAULTS[fault].advice for fault in faults))
    return (fail if any(fault in SILENCING_FAULTS for fault in faults) else warn)("; ".join(said), advice)


def _blocks(device: Device) -> Judgement:
    status = device.status()
    seen = f"{status.accepted} accepted, {status.refused} refused, {status.late} late, {status.lost} lost"
    if status.dropped_frames or status.last_refusal in (Reason.LENGTH, Reason.CHECKSUM):
        return warn(
            f"{seen}; {status.dropped_frames} frames damaged, last refusal {status.last_refusal.name}",
            "something damages what arrives: try another cable, and on a serial line its rate",
        )
    return ok(seen)


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
