"""Broken firmware upgrade over USB: states, times and refusals (chapter DFU)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from ....emulator.door import Stall
from ....emulator.firmware import dfu
from ....emulator.firmware.dfu import DfuMode
from ....emulator.firmware.flash import CYCLES_PER_MS
from ....emulator.interfaces.usb_functions import DETACH_CYCLES, DfuModeFunction, DfuRunTimeFunction, UsbFunction
from ....protocol.codes import (
    CLASS_REQUEST_TYPE_IN,
    CLASS_REQUEST_TYPE_OUT,
    DFU_TRANSFER_BYTES,
    DfuRequest,
    DfuState,
    DfuStatus,
)
from ....protocol.dfu import TRANSITIONS, DfuEvent, Step
from ....protocol.requests import Setup
from .patching import Patch, mutant

DOWNLOAD = (CLASS_REQUEST_TYPE_OUT, DfuRequest.DNLOAD)
UPLOAD = (CLASS_REQUEST_TYPE_IN, DfuRequest.UPLOAD)
POLL_AT = slice(1, 4)
"""The poll time-out in the answer to GETSTATUS."""
QUIET = (DfuState.DFU_IDLE, DfuState.DNLOAD_IDLE, DfuState.UPLOAD_IDLE)
BUSY = (DfuState.DNBUSY, DfuState.MANIFEST)


def _lead(patch: Patch, steps: dict[tuple[DfuState, DfuEvent], DfuState]) -> None:
    """Let events lead to other states, without STALL."""
    patch.replace(dfu, "TRANSITIONS", TRANSITIONS | {pair: Step(state) for pair, state in steps.items()})


def handle(patch: Patch, replacement: Callable[..., bytes], request: tuple[int, int]) -> None:
    """Put a handler before the one for requests in DFU mode; it takes that one first."""
    handlers = vars(dfu)["_HANDLERS"]
    patch.replace(dfu, "_HANDLERS", {**handlers, request: partial(replacement, handlers[request])})


# The way there


@mutant("DFU-002", "USB-024", wraps=(DfuRunTimeFunction, "detach"))
def detach_does_not_silence(_: Any, self: Any, _door: Any) -> None:
    """DETACH leaves the outputs on until the device has left the bus, and longer."""
    self._detaching = True
    self._state = DfuState.APP_DETACH
    self._scheduler.at(self._scheduler.now + DETACH_CYCLES, self._leave)


@mutant("DFU-006", "DFU-002")
def refused_request_calls_off_a_detach(patch: Patch) -> None:
    """A refused request between DETACH and leaving the bus cancels the DETACH, and the device stays."""

    @patch.around(DfuRunTimeFunction, "detach")
    def of_detach(original: Any, self: Any, door: Any) -> None:
        leave = self._leave
        self._leave = lambda: leave() if self._detaching else None
        original(self, door)

    @patch.around(DfuRunTimeFunction, "request")
    def of_request(original: Any, self: Any, setup: Setup, data: bytes) -> Any:
        try:
            return original(self, setup, data)
        except Stall:
            self._detaching = False
            raise


@mutant("DFU-002")
def detach_waits_for_a_bus_reset(patch: Patch) -> None:
    """After DETACH the device waits for a bus reset, although it says that it detaches by itself."""

    @patch.around(DfuRunTimeFunction, "__init__")
    def of_init(original: Any, self: Any, scheduler: Any, controller: Any, door: Any, leave: Any) -> None:
        original(self, scheduler, controller, door, lambda: leave() if self.was_reset else None)
        self.was_reset = False

    @patch.around(DfuRunTimeFunction, "bus_reset")
    def of_reset(original: Any, self: Any) -> None:
        self.was_reset = True
        original(self)


@mutant("DFU-015", "DFU-016", wraps=(DfuMode, "bus_reset"))
def reset_of_enumeration_boots(original: Any, self: Any, _configured: Any) -> Any:
    """Every bus reset in DFU mode boots the device, even those with which a host begins enumeration."""
    return original(self, True)


# States


@mutant("DFU-006")
def clrstatus_is_taken_in_every_quiet_state(patch: Patch) -> None:
    """CLRSTATUS leads to dfuIDLE from any state that waits for the host, not only from dfuERROR."""
    _lead(patch, {(state, DfuEvent.CLRSTATUS): DfuState.DFU_IDLE for state in QUIET})


@mutant("DFU-006")
def abort_goes_on_with_the_download(patch: Patch) -> None:
    """ABORT in dfuDNLOAD-IDLE is acknowledged, and the device stays there."""
    _lead(patch, {(DfuState.DNLOAD_IDLE, DfuEvent.ABORT): DfuState.DNLOAD_IDLE})


@mutant("DFU-006")
def abort_clears_an_error(patch: Patch) -> None:
    """ABORT in dfuERROR leads to dfuIDLE, as CLRSTATUS does."""
    _lead(patch, {(DfuState.ERROR, DfuEvent.ABORT): DfuState.DFU_IDLE})


@mutant("DFU-006")
def detach_is_taken_in_dfu_mode(patch: Patch) -> None:
    """DETACH in DFU mode is acknowledged and changes nothing."""
    _lead(patch, {(DfuState.DFU_IDLE, DfuEvent.DETACH): DfuState.DFU_IDLE})


@mutant("DFU-006")
def questions_are_answered_while_busy(patch: Patch) -> None:
    """GETSTATE and GETSTATUS are answered while the device is busy; DFU 1.1 wants STALL and dfuERROR."""
    _lead(patch, {(state, DfuEvent.GETSTATE): state for state in BUSY})


@mutant("DFU-009", "DFU-006", by=partial(handle, request=DOWNLOAD))
def download_of_nothing_is_taken_in_idle(original: Any, self: Any, setup: Setup, data: bytes) -> Any:
    """DNLOAD without data in dfuIDLE is acknowledged and does nothing."""
    return original(self, setup, data) if data or self.state is not DfuState.DFU_IDLE else b""


@mutant("DFU-009", by=partial(handle, request=DOWNLOAD))
def numbers_of_blocks_are_not_checked(original: Any, self: Any, setup: Setup, data: bytes) -> Any:
    """Each DNLOAD counts as the next block, whatever its number: the device counts by itself."""
    begins = self.state is DfuState.DFU_IDLE
    number = 0 if begins or not data else self._received // DFU_TRANSFER_BYTES
    return original(self, replace(setup, value=number), data)


@mutant("DFU-009", "DFU-006", by=partial(handle, request=DOWNLOAD))
def download_goes_on_after_clrstatus(original: Any, self: Any, setup: Setup, data: bytes) -> Any:
    """After an error and CLRSTATUS a download goes on with its next block: the block count is kept."""
    if self.state is DfuState.DFU_IDLE and data and 0 < self._received == setup.value * DFU_TRANSFER_BYTES:
        self.state = DfuState.DNLOAD_IDLE
    return original(self, setup, data)


@mutant("DFU-009", wraps=(dfu, "check_block"))
def download_may_end_early(original: Any, number: int, length: int, received: int, total: int) -> DfuStatus:
    """DNLOAD without data ends a download before its last block, and the incomplete image is judged."""
    return original(number, length, received, total) if length else DfuStatus.OK


# Times and answers


@mutant("DFU-008", "DFU-007", by=partial(handle, request=(CLASS_REQUEST_TYPE_IN, DfuRequest.GETSTATUS)))
def poll_time_is_0(original: Any, self: Any, setup: Setup, data: bytes) -> bytes:
    """GETSTATUS allows the host to ask again at once, although the device is busy."""
    answer = bytearray(original(self, setup, data))
    answer[POLL_AT] = bytes(3)
    return bytes(answer)


@mutant("DFU-008", wraps=(DfuMode, "_time_out"))
def busy_state_ends_late(original: Any, self: Any) -> None:
    """The device leaves its busy state 20 ms after the time that it named: it polls the flash every 20 ms."""
    if self._scheduler.now == self._polled_at:
        self._polled_at += 20 * CYCLES_PER_MS
        self._scheduler.at(self._polled_at, lambda: original(self))


@mutant("DFU-006", "DFU-005", wraps=(DfuMode, "_enter"))
def later_errors_replace_the_first(
    original: Any, self: Any, state: DfuState, status: DfuStatus = DfuStatus.OK, string: int = 0
) -> None:
    """In dfuERROR the status is that of the last refused request, not of the first failure."""
    original(self, state, status, string)
    if state is DfuState.ERROR and status is not DfuStatus.OK:
        self._status, self._string = status, string


@mutant("DFU-011", "DFU-013", wraps=(DfuMode, "_fail"))
def errors_of_manifestation_are_swallowed(original: Any, self: Any, status: DfuStatus, string: int) -> None:
    """A bad image at manifestation leads to dfuIDLE with OK; it does not boot, but no error is reported."""
    if self.state in (DfuState.MANIFEST, DfuState.MANIFEST_SYNC):
        self.stop()
    else:
        original(self, status, string)


@mutant("DFU-013", wraps=(DfuMode, "_fail"))
def errors_while_busy_are_swallowed(original: Any, self: Any, status: DfuStatus, string: int) -> None:
    """A flash failure during the busy time of a block is forgotten, and the block is lost."""
    if self.state is DfuState.DNBUSY:
        self.stop()
    else:
        original(self, status, string)


@mutant("DFU-012")
def refused_images_have_no_string(patch: Patch) -> None:
    """GETSTATUS names no string with the reason why an image was refused."""
    patch.replace(dfu, "reason_string", lambda _: 0)


@mutant("DFU-012", wraps=(dfu, "status_of"))
def images_for_others_are_reported_as_bad_files(original: Any, reason: Any) -> DfuStatus:
    """An image for other hardware has the status FILE instead of TARGET."""
    found = original(reason)
    return DfuStatus.FILE if found is DfuStatus.TARGET else found


# Upload


@mutant("DFU-014", by=partial(handle, request=UPLOAD))
def upload_never_ends(original: Any, self: Any, setup: Setup, data: bytes) -> Any:
    """UPLOAD answers whole blocks for ever: after the image comes the rest of the flash, then FF."""
    block = original(self, setup, data)
    self.state = DfuState.UPLOAD_IDLE
    return block.ljust(DFU_TRANSFER_BYTES, b"\xff")


@mutant("DFU-014", by=partial(handle, request=UPLOAD))
def upload_ends_with_a_full_block(original: Any, self: Any, setup: Setup, data: bytes) -> Any:
    """An upload ends with the image's last byte: if the last block is full, no short one follows."""
    block = original(self, setup, data)
    if self._next_upload * DFU_TRANSFER_BYTES >= len(self._upload):
        self.state = DfuState.DFU_IDLE
    return block


@mutant("DFU-014", by=partial(handle, request=UPLOAD))
def upload_takes_any_length(original: Any, self: Any, setup: Setup, data: bytes) -> Any:
    """UPLOAD of fewer bytes than a block is answered with that many bytes instead of ADDRESS."""
    return original(self, replace(setup, length=DFU_TRANSFER_BYTES), data)


@mutant("DFU-014", by=partial(handle, request=UPLOAD))
def upload_takes_any_number(original: Any, self: Any, setup: Setup, data: bytes) -> Any:
    """UPLOAD answers any block number, even out of order."""
    if self.state is DfuState.UPLOAD_IDLE:
        self._next_upload = setup.value
    return original(self, setup, data)


@mutant("DFU-016", "DFU-006", wraps=(UsbFunction, "suspend"))
def suspend_gives_up_a_download(original: Any, self: Any) -> None:
    """In DFU mode suspend ends a download, as it ends playing at run time: the device returns to dfuIDLE."""
    original(self)
    upgrade = self._upgrade if isinstance(self, DfuModeFunction) else None
    if isinstance(upgrade, DfuMode) and upgrade.state is DfuState.DNLOAD_IDLE:
        upgrade.stop()
        upgrade.state = DfuState.DFU_IDLE
