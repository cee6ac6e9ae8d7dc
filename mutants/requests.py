"""Broken control requests: what they answer, what they judge, and what they carry out (chapter REQ)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..emulator.boards import processor
from ..emulator.control import controller, supervisor
from ..emulator.door import Stall
from ..emulator.interfaces.serial_line import SerialLine
from ..emulator.interfaces.usb_device import UsbDevice
from ..protocol.blocks import unpack_pulses
from ..protocol.board import TICK_HZ, TICKS_PER_PERIOD
from ..protocol.codes import REQUEST_TYPE_IN, REQUEST_TYPE_OUT, Reason, Request
from ..protocol.pulses import Pulses
from ..protocol.requests import DIRECTION_IN, VALUES, Setup
from ..protocol.states import Event
from ..protocol.wiring import Wiring
from .patching import Patch, mutant

Controller = controller.Controller
MOST_BYTES = 2**16 - 1


# INFO and WIRING


@mutant("BLK-024", "REQ-002", wraps=(Controller, "info"))
def info_counts_a_place_too_many(original: Any, self: Any) -> Any:
    """INFO says one more place in the queue than there is: it names the size of a ring of which one stays empty."""
    return replace(original(self), queue_blocks=original(self).queue_blocks + 1)


@mutant("REQ-002", wraps=(Controller, "info"))
def info_counts_seconds_in_its_last_bytes(original: Any, self: Any) -> Any:
    """INFO counts the seconds since power-up in bytes that are 0 in version 1: left there from debugging."""
    return replace(original(self), later=(self.now_tick // TICK_HZ).to_bytes(16, "little"))


@mutant("REQ-002", "REQ-010", wraps=(Controller, "info"))
def info_says_the_limit_that_is_set(original: Any, self: Any) -> Any:
    """The drive limit of INFO is what LIMIT has set, rather than the most that it takes: there is one variable."""
    return replace(original(self), drive_limit=self._drive_limit)


@mutant("REQ-002", "REQ-009", wraps=(Controller, "info"))
def info_says_the_watchdog_time_that_is_set(original: Any, self: Any) -> Any:
    """The watchdog time of INFO is what WATCHDOG has set, rather than that at power-up: there is one variable."""
    return replace(original(self), watchdog_ms=self._watchdog.milliseconds)


@mutant("REQ-004", wraps=(controller, "encode_wiring"))
def wiring_is_answered_the_other_way_round(original: Any, wiring: Any) -> Any:
    """WIRING names the transducer of each output, rather than the output of each transducer."""
    return original(Wiring(np.argsort(wiring.channels)))


# STATUS, CLOCK and PROCESSORS


@mutant("REQ-003", wraps=(Controller, "_answer_status"))
def status_forgets_the_last_refusal_once_it_was_read(original: Any, self: Any, value: int) -> Any:
    """The reason of the last refusal is 0 again after STATUS has told it, as registers clear that are read."""
    status = original(self, value)
    self._last_refusal = Reason.ACCEPTED
    return status


@mutant("REQ-003", wraps=(supervisor.Supervisor, "temperature_c"))
def temperature_is_that_of_the_first_board(_: Any, self: Any) -> Any:
    """STATUS names the temperature of board 0, not of the hottest: the loop over the boards is missing."""
    return self._reports[0].temperature_c if self._reports else 0


@mutant("REQ-003", "REQ-008")
def frost_is_told_as_zero(patch: Patch) -> None:
    """Temperatures below 0 °C are told as 0, in STATUS and PROCESSORS: they are kept without a sign and clipped."""

    def of_status(original: Any) -> Any:
        return lambda self: replace(original(self), temperature_c=max(original(self).temperature_c, 0))

    def of_reports(original: Any) -> Any:
        return lambda reports: original(
            [replace(report, temperature_c=max(report.temperature_c, 0)) for report in reports]
        )

    patch.wrap(Controller, "status", of_status)
    patch.wrap(controller, "encode_reports", of_reports)


@mutant("REQ-003", "CHN-004", wraps=(supervisor.Supervisor, "missed_commits"))
def missed_commits_are_those_of_the_first_processor(_: Any, self: Any) -> Any:
    """STATUS counts the missed commits of processor 0 alone, not of all ten."""
    return self._reports[0].missed_commits if self._reports else 0


@mutant("REQ-006", wraps=(Controller, "clock"))
def clock_tells_periods(original: Any, self: Any) -> Any:
    """CLOCK answers the period instead of the tick in which it arrived."""
    return replace(original(self), now=self.now_tick // TICKS_PER_PERIOD)


@mutant("REQ-006", "CHN-026", wraps=(Controller, "clock"))
def sync_pulses_are_not_counted(original: Any, self: Any) -> Any:
    """The count of sync pulses stays at the first: only the start of period 0 counts one."""
    return replace(original(self), sync_pulses=1)


@mutant("REQ-008", wraps=(controller, "encode_reports"))
def processors_are_told_from_the_far_end(original: Any, reports: Any) -> Any:
    """PROCESSORS answers the reports in the opposite order of the chain: they are pushed onto a stack."""
    return original(reports[::-1])


# PULSES


@mutant("REQ-007", wraps=(Controller, "_read_back"))
def read_back_is_modulated(original: Any, self: Any) -> Any:
    """PULSES answers the widths as they are under the modulation: they are read off what the port plays."""
    found = original(self)
    _, samples = self._chain.processors[0].reel.segments().rows(found.read_period, found.read_period + 1)
    return replace(found, pulses=found.pulses.modulated(int(samples[0])))


@mutant("REQ-007", wraps=(Controller, "_read_back"))
def read_back_tells_what_was_queued_last(original: Any, self: Any) -> Any:
    """PULSES answers the newest update of the queue instead of what plays: the controller keeps the last it sorted."""
    found, wiring = original(self), self._identification.wiring
    packed = [last for item in self._agenda if (last := _last_packed(item)) is not None]
    if not packed:
        return found
    pulses = unpack_pulses(packed[-1])
    return replace(found, pulses=Pulses(wiring.unsort(pulses.phase), wiring.unsort(pulses.width)))


def _last_packed(item: Any) -> bytes | None:
    """The last pulses of something that is planned."""
    packed = item.packed
    return bytes(packed[-1]) if isinstance(packed, np.ndarray) else packed


@mutant("REQ-007", wraps=(Controller, "_read_back"))
def read_back_plays_since_it_was_read(original: Any, self: Any) -> Any:
    """PULSES says that the pulses play since the period in which they were read: one field is copied to both places."""
    found = original(self)
    return replace(found, since_period=found.read_period) if found.since_period else found


# What is judged


@mutant("REQ-001", "USB-004", wraps=(Controller, "request"))
def unknown_requests_are_acknowledged(original: Any, self: Any, setup: Setup, data: bytes, door: Any) -> Any:
    """A vendor request with an unknown number is answered with nothing instead of STALL: the switch has no default."""
    return original(self, setup, data, door) if setup.request in set(Request) else b""


@mutant("REQ-001", wraps=(Controller, "request"))
def values_of_requests_are_not_checked(original: Any, self: Any, setup: Setup, data: bytes, door: Any) -> Any:
    """Requests without a value, such as CLEAR_FAULTS, are carried out whatever their value: nobody looks at it."""
    value = setup.value if setup.request in VALUES else 0
    return original(self, replace(setup, value=value), data, door)


@mutant("REQ-001", "USB-004")
def index_of_requests_is_not_checked(patch: Patch) -> None:
    """A vendor request is carried out whatever its index: it is told by its type alone, before the interface."""

    @patch.around(UsbDevice, "_function")
    def of_device(original: Any, self: UsbDevice, setup: Setup) -> Any:
        is_vendor = setup.request_type in (REQUEST_TYPE_IN, REQUEST_TYPE_OUT)
        return original(self, replace(setup, index=0) if is_vendor else setup)

    def of_controller(original: Any) -> Any:
        return lambda self, setup, data, door: original(self, replace(setup, index=0), data, door)

    patch.wrap(Controller, "request", of_controller)


@mutant("REQ-001", wraps=(Controller, "request"))
def orders_with_data_are_carried_out(original: Any, self: Any, setup: Setup, data: bytes, door: Any) -> Any:
    """An order that is sent with data is carried out and the data are dropped, instead of STALL."""
    if setup.request_type == REQUEST_TYPE_OUT:
        setup, data = replace(setup, length=0), b""
    return original(self, setup, data, door)


def _answer_at_most(patch: Patch, most: Any) -> None:
    """Let vendor requests be answered with as many bytes as a function of wLength says, on all doors."""

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
    """A vendor request is answered with all that there is, however little was asked for: wLength is not heeded."""
    _answer_at_most(patch, lambda _: MOST_BYTES)


@mutant("REQ-001", "SER-008")
def answers_are_cut_a_byte_too_late(patch: Patch) -> None:
    """A vendor request is answered with a byte more than was asked for, where there is one: a comparison is off."""
    _answer_at_most(patch, lambda length: min(length + 1, MOST_BYTES))


@mutant("REQ-012")
def identify_takes_board_5(patch: Patch) -> None:
    """IDENTIFY takes a board that is not there: the comparison is off by one."""
    patch.replace(controller, "VALUES", {**VALUES, Request.IDENTIFY: range(6)})


@mutant("REQ-009")
def watchdog_takes_9_ms(patch: Patch) -> None:
    """WATCHDOG takes less than the least time: the comparison is off by one."""
    patch.replace(controller, "VALUES", {**VALUES, Request.WATCHDOG: range(9, 60_001)})


@mutant("REQ-010")
def limit_takes_a_transducer_too_many(patch: Patch) -> None:
    """LIMIT takes one transducer more than INFO says."""
    patch.replace(controller, "VALUES", {**VALUES, Request.LIMIT: range(322)})


# What is carried out


@mutant("REQ-011")
def temperature_is_cleared_without_hysteresis(patch: Patch) -> None:
    """TEMPERATURE can be cleared as soon as the board is not above 85 °C: there is one limit instead of two."""
    patch.replace(controller, "CLEARED_BELOW_C", processor.TEMPERATURE_LIMIT_C + 1)


@mutant("REQ-013", wraps=(Controller, "_depart"))
def reset_only_disables(_: Any, self: Any, _restart: Any) -> None:
    """RESET turns the outputs off and restarts nothing: what to call at the end of the request was never set."""
    self._happen(Event.DISABLE, self._now)
