"""Broken control requests: their answers, judgement and effects (chapter REQ)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ....emulator.control import known_faults, requests, supervisor
from ....emulator.control.chain import Chain
from ....emulator.control.requests import Requests
from ....emulator.door import Stall
from ....emulator.interfaces.serial_line import SerialLine
from ....emulator.interfaces.usb_device import UsbDevice
from ....protocol.blocks import unpack_pulses
from ....protocol.board import TICK_HZ, TICKS_PER_PERIOD
from ....protocol.codes import REQUEST_TYPE_IN, REQUEST_TYPE_OUT, TEMPERATURE_LIMIT_C, Reason, Request
from ....protocol.pulses import Pulses
from ....protocol.requests import DIRECTION_IN, VALUES, Setup
from ....protocol.states import StateEvent
from ....protocol.wiring import Wiring
from .patching import Patch, mutant

MOST_BYTES = 2**16 - 1


# INFO and WIRING


@mutant("BLK-024", "REQ-002", wraps=(Requests, "info"))
def info_counts_a_place_too_many(original: Any, self: Any) -> Any:
    """INFO reports one place too many in the queue: it names the size of a ring that keeps one place empty."""
    return replace(original(self), queue_blocks=original(self).queue_blocks + 1)


@mutant("REQ-002", wraps=(Requests, "info"))
def info_counts_seconds_in_its_last_bytes(original: Any, self: Any) -> Any:
    """INFO counts the seconds since power-up in bytes that are 0 in version 1: debugging code was left in."""
    return replace(original(self), later=(self._dispatch.now_tick // TICK_HZ).to_bytes(16, "little"))


@mutant("REQ-002", "FWU-005", wraps=(Requests, "info"))
def info_says_hardware_that_no_one_defined(original: Any, self: Any) -> Any:
    """INFO names hardware 2, which the specification does not have: the field counts the board's revisions."""
    return replace(original(self), hardware=2)


@mutant("REQ-002", "REQ-010", wraps=(Requests, "info"))
def info_says_the_limit_that_is_set(original: Any, self: Any) -> Any:
    """The drive limit in INFO is the one that LIMIT has set, not the greatest possible: one variable serves both."""
    return replace(original(self), drive_limit=self._device.drive_limit)


@mutant("REQ-002", "REQ-009", wraps=(Requests, "info"))
def info_says_the_watchdog_time_that_is_set(original: Any, self: Any) -> Any:
    """The watchdog time in INFO is the one that WATCHDOG has set, not that at power-up: one variable serves both."""
    return replace(original(self), watchdog_ms=self._machine.watchdog.milliseconds)


@mutant("REQ-004", wraps=(requests, "encode_wiring"))
def wiring_is_answered_the_other_way_round(original: Any, wiring: Any) -> Any:
    """WIRING lists the transducer of each output instead of the output of each transducer."""
    return original(Wiring(np.argsort(wiring.channels)))


# STATUS, CLOCK and PROCESSORS


@mutant("REQ-003", wraps=(Requests, "_answer_status"))
def status_forgets_the_last_refusal_once_it_was_read(original: Any, self: Any, value: int) -> Any:
    """STATUS clears the reason of the last refusal, as a register does that is cleared when read."""
    status = original(self, value)
    self._device.last_refusal = Reason.ACCEPTED
    return status


@mutant("REQ-003", wraps=(supervisor.Supervisor, "temperature_c"))
def temperature_is_that_of_the_first_board(_: Any, self: Any) -> Any:
    """STATUS reports the temperature of board 0 instead of the hottest: the loop over the boards is missing."""
    return self._reports[0].temperature_c if self._reports else 0


@mutant("REQ-003", "REQ-008")
def frost_is_told_as_zero(patch: Patch) -> None:
    """Temperatures below 0 °C are reported as 0 in STATUS and PROCESSORS: they are clipped and stored unsigned."""

    def of_status(original: Any) -> Any:
        return lambda self: replace(original(self), temperature_c=max(original(self).temperature_c, 0))

    def of_reports(original: Any) -> Any:
        return lambda reports: original(
            [replace(report, temperature_c=max(report.temperature_c, 0)) for report in reports]
        )

    patch.wrap(Requests, "status", of_status)
    patch.wrap(requests, "encode_reports", of_reports)


@mutant("REQ-003", "CHN-004", wraps=(supervisor.Supervisor, "missed_commits"))
def missed_commits_are_those_of_the_first_processor(_: Any, self: Any) -> Any:
    """STATUS counts the missed commits of processor 0 instead of all ten."""
    return self._reports[0].missed_commits if self._reports else 0


@mutant("REQ-006", wraps=(Requests, "clock"))
def clock_tells_periods(original: Any, self: Any) -> Any:
    """CLOCK answers the period of its arrival instead of the tick."""
    return replace(original(self), now=self._dispatch.now_tick // TICKS_PER_PERIOD)


@mutant("REQ-006", "CHN-026", wraps=(Requests, "clock"))
def sync_pulses_are_not_counted(original: Any, self: Any) -> Any:
    """The count of sync pulses stays at one: only the start of period 0 counts."""
    return replace(original(self), sync_pulses=1)


@mutant("REQ-008", wraps=(requests, "encode_reports"))
def processors_are_told_from_the_far_end(original: Any, reports: Any) -> Any:
    """PROCESSORS answers the reports in reverse order of the chain: they are pushed onto a stack."""
    return original(reports[::-1])


@mutant("REQ-008", wraps=(Chain, "first_report"))
def the_identity_of_a_processor_is_forgotten(original: Any, self: Any, number: int, identity: Any) -> Any:
    """Until a processor has answered a question its firmware is 0.0.0: numbering keeps the number alone."""
    return replace(original(self, number, identity), firmware=(0, 0, 0))


# PULSES


@mutant("REQ-007", wraps=(Requests, "_read_back"))
def read_back_is_modulated(original: Any, self: Any) -> Any:
    """PULSES answers modulated widths: they are read off what the port plays."""
    found = original(self)
    _, samples = self._dispatch.chain.processors[0].history.segments().rows(found.read_period, found.read_period + 1)
    return replace(found, pulses=found.pulses.modulated(int(samples[0])))


@mutant("REQ-007", wraps=(Requests, "_read_back"))
def read_back_tells_what_was_queued_last(original: Any, self: Any) -> Any:
    """PULSES answers the newest update of the queue instead of what plays: the controller keeps the last it sorted."""
    found, wiring = original(self), self._identification.wiring
    packed = [last for item in self._dispatch.agenda if (last := _last_packed(item)) is not None]
    if not packed:
        return found
    pulses = unpack_pulses(packed[-1])
    return replace(found, pulses=Pulses(wiring.unsort(pulses.phase), wiring.unsort(pulses.width)))


def _last_packed(item: Any) -> bytes | None:
    """The last pulses that are planned."""
    packed = item.packed
    return bytes(packed[-1]) if isinstance(packed, np.ndarray) else packed


@mutant("REQ-007", wraps=(Requests, "_read_back"))
def read_back_plays_since_it_was_read(original: Any, self: Any) -> Any:
    """PULSES reports the reading's own period as the begin of the pulses: one field is copied to both places."""
    found = original(self)
    return replace(found, since_period=found.read_period) if found.since_period else found


# Judgement


@mutant("REQ-001", "USB-004", wraps=(Requests, "request"))
def unknown_requests_are_acknowledged(original: Any, self: Any, setup: Setup, data: bytes, door: Any) -> Any:
    """An unknown vendor request gets an empty answer instead of STALL: the switch has no default."""
    return original(self, setup, data, door) if setup.request in set(Request) else b""


@mutant("REQ-001", wraps=(Requests, "request"))
def values_of_requests_are_not_checked(original: Any, self: Any, setup: Setup, data: bytes, door: Any) -> Any:
    """Requests without a value, such as CLEAR_FAULTS, are carried out for any value: it is not checked."""
    value = setup.value if setup.request in VALUES else 0
    return original(self, replace(setup, value=value), data, door)


@mutant("REQ-001", "USB-004")
def index_of_requests_is_not_checked(patch: Patch) -> None:
    """A vendor request is carried out for any index: only its type is checked, not the interface."""

    @patch.around(UsbDevice, "_function")
    def of_device(original: Any, self: UsbDevice, setup: Setup) -> Any:
        is_vendor = setup.request_type in (REQUEST_TYPE_IN, REQUEST_TYPE_OUT)
        return original(self, replace(setup, index=0) if is_vendor else setup)

    def of_controller(original: Any) -> Any:
        return lambda self, setup, data, door: original(self, replace(setup, index=0), data, door)

    patch.wrap(Requests, "request", of_controller)


@mutant("REQ-001", wraps=(Requests, "request"))
def orders_with_data_are_carried_out(original: Any, self: Any, setup: Setup, data: bytes, door: Any) -> Any:
    """A command with data is carried out and the data are dropped, instead of STALL."""
    if setup.request_type == REQUEST_TYPE_OUT:
        setup, data = replace(setup, length=0), b""
    return original(self, setup, data, door)


def _answer_at_most(patch: Patch, most: Any) -> None:
    """Answer vendor requests with as many bytes as a function of wLength returns, on all doors."""

    @patch.around(UsbDevice, "control")
    def of_device(original: Any, self: UsbDevice, setup: Setup, data: bytes = b"") -> Any:
        of_functions = setup.request_type == REQUEST_TYPE_IN
        return original(self, replace(setup, length=most(setup.length)) if of_functions else setup, data)

    @patch.around(SerialLine, "_requested")
    def of_line(_: Any, self: Any, request: Any) -> Any:
        if request.request_type not in (REQUEST_TYPE_IN, REQUEST_TYPE_OUT):
            raise Stall("it is no vendor request")
        length = most(request.length) if request.request_type & DIRECTION_IN else request.length
        return self._controller.request(replace(request.setup, length=length), request.data, self)


@mutant("REQ-001", "SER-008")
def answers_are_not_cut_to_what_was_asked_for(patch: Patch) -> None:
    """A vendor request is answered whole, even if fewer bytes were requested: wLength is ignored."""
    _answer_at_most(patch, lambda _: MOST_BYTES)


@mutant("REQ-001", "SER-008")
def answers_are_cut_a_byte_too_late(patch: Patch) -> None:
    """A vendor request is answered with one byte too many, if there is one: a comparison is off by one."""
    _answer_at_most(patch, lambda length: min(length + 1, MOST_BYTES))


@mutant("REQ-012")
def identify_takes_board_5(patch: Patch) -> None:
    """IDENTIFY accepts a board that does not exist: the comparison is off by one."""
    patch.replace(requests, "VALUES", {**VALUES, Request.IDENTIFY: range(6)})


@mutant("REQ-009")
def watchdog_takes_9_ms(patch: Patch) -> None:
    """WATCHDOG accepts less than the minimum: the comparison is off by one."""
    patch.replace(requests, "VALUES", {**VALUES, Request.WATCHDOG: range(9, 60_001)})


@mutant("REQ-010")
def limit_takes_a_transducer_too_many(patch: Patch) -> None:
    """LIMIT accepts one transducer more than INFO says."""
    patch.replace(requests, "VALUES", {**VALUES, Request.LIMIT: range(322)})


# Effects


@mutant("REQ-011")
def temperature_is_cleared_without_hysteresis(patch: Patch) -> None:
    """TEMPERATURE can be cleared as soon as the board is at 85 °C or below: one limit serves instead of two."""
    patch.replace(known_faults, "CLEARED_BELOW_C", TEMPERATURE_LIMIT_C + 1)


@mutant("REQ-013", wraps=(Requests, "_depart"))
def reset_only_disables(_: Any, self: Any, _restart: Any) -> None:
    """RESET turns the outputs off and restarts nothing: the call at the end of the request was never set."""
    self._machine.happen(StateEvent.DISABLE, self._dispatch.now)
