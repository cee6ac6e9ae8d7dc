"""One client of the USB/IP server: its requests, and the transfers of its attached device.

A client's host controller keeps some information to itself, which is inferred here. It does not report bus resets: a
reset is inferred when a host begins to enumerate, requesting the device descriptor with room for 64 bytes and then for
18, while nothing else is under way. It may cancel a transfer before it submits it, or one of the previous connection.
If a device attaches itself again, it is another one to the client: the connection ends, and the client attaches again.
After a reset, as in DFU, the host notices by itself, because it compares descriptors: its second look waits for the
device and the connection stays. Linux would wait 5 s for an answer if the connection ended in a reset. When its client
leaves, a device is unplugged and plugged in again, so that it waits for the next one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ...protocol.board import CORE_HZ
from ...protocol.codes import DescriptorType, StandardRequest
from ...protocol.requests import DIRECTION_IN, Setup
from ...protocol.usbip import (
    Export,
    Importing,
    ImportStatus,
    Listing,
    Submit,
    Unlink,
    encode_import,
    encode_list,
    encode_submitted,
    encode_unlinked,
    read_command,
    read_request,
)
from .station import Station
from .usb_bus import Peripheral, Transfer, TransferOutcome, UsbBus
from .usb_conversation import UsbConversation

__all__ = ["Exported", "UsbIpSession"]

MOST_TRANSFERS = 4096
MOST_BYTES = 1 << 26
"""How much a client may have under way; Linux allows a quarter of it for all transfers of all programs together."""

MOST_PENDING = 1 << 20
"""After so many pending bytes a client gets no more until it reads some."""

ATTACH_CYCLES = CORE_HZ
"""How long a client waits for a device that is about to attach itself: one second, because it may have to boot."""

_FIRST_LOOK = Setup(DIRECTION_IN, StandardRequest.GET_DESCRIPTOR, DescriptorType.DEVICE << 8, 0, 64)
_SECOND_LOOK = Setup(DIRECTION_IN, StandardRequest.GET_DESCRIPTOR, DescriptorType.DEVICE << 8, 0, 18)


@dataclass(eq=False)
class Exported:
    """A device that a server offers, and whether a client holds it."""

    bus: int
    number: int
    device: Peripheral
    station: Station
    taken: bool = False

    def describe(self) -> Export:
        """Its present description."""
        device = self.device
        return Export(self.bus, self.number, device.enumeration, device.speed, device.configuration)


class UsbIpSession(UsbConversation):
    """A conversation with one client, from its request to the end of its connection."""

    def __init__(self, exports: Mapping[str, Exported]) -> None:
        super().__init__()
        self._exports = exports
        self._exported: Exported | None = None
        self._generation = 0
        self._give_up = 0
        self._transfers: dict[int, Transfer] = {}
        self._bytes = 0
        self._newest: int | None = None
        self._premature: dict[int, int] = {}  # numbers of transfers cancelled before they came, and by which command
        self._looked = False
        self._second_look: Submit | None = None  # waits for a device that has left the bus for a reset

    @property
    def station(self) -> Station | None:
        """The station of the client's device; None before it has one."""
        return self._exported.station if self._exported else None

    @property
    def full(self) -> bool:
        """Whether the client should pause its output."""
        return self._attaching or len(self._pending) > MOST_PENDING

    @property
    def presses(self) -> bool:
        """Whether some data are under way, so that time must pass at the fast pace too."""
        return self._attaching or (self._bus is not None and self._bus.presses and not self.full)

    @property
    def _attaching(self) -> bool:
        return self._exported is not None and self._bus is None

    def receive(self, data: bytes) -> None:
        """Take bytes of the client; it is dropped if they make no sense."""
        if not self.over:
            self._received += data
            self._read()

    def next_time(self, event: int | None) -> int | None:
        """The time of its next action, if no one else acts; the device's own is `event`."""
        if self._attaching:
            return self._give_up if event is None else min(event, self._give_up)
        return None if self._bus is None or self.full else self._bus.next_time(event)

    def run(self) -> None:
        """Perform the actions that are due."""
        if self._attaching:
            self._attach()
        self._check_attachment()  # first: a device that has left the bus answers no more
        if self._bus and not self.full:
            self._bus.run()
            self._check_attachment()

    def _read(self) -> None:
        """Carry out all requests, up to the first one that must wait."""
        while not self.over and not self._attaching:
            try:
                found = read_command(self._received) if self._bus else read_request(self._received)
            except ValueError as error:
                self._leave(f"it sent {error}")
                break
            if found is None:
                break
            message, size = found
            del self._received[:size]
            self._obey(message)
            self._check_attachment()

    def _obey(self, message: Listing | Importing | Submit | Unlink) -> None:
        match message:
            case Listing():
                self._pending += encode_list([each.describe() for each in self._exports.values()])
                self._leave("")
            case Importing():
                self._import(message.bus_id)
            case Submit():
                self._submit(message)
            case Unlink():
                self._unlink(message)

    def _import(self, bus_id: str) -> None:
        exported = self._exports.get(bus_id)
        if exported is None:
            self._refuse(ImportStatus.NO_DEVICE, f"it requested {bus_id!r}; there are {', '.join(self._exports)}")
        elif exported.taken:
            self._refuse(ImportStatus.BUSY, f"it requested {bus_id}, which another client has")
        else:
            exported.taken = True
            exported.station.conversations.append(self)
            self._exported = exported
            self._await_device()

    def _refuse(self, status: ImportStatus, reason: str) -> None:
        self._pending += encode_import(status)
        self._leave(reason)

    def _await_device(self) -> None:
        """Let the client wait until the device is attached."""
        assert self._exported
        self._bus = None
        self._give_up = self._exported.station.scheduler.now + ATTACH_CYCLES
        self._attach()

    def _attach(self) -> None:
        """Give the device to the client as soon as it is attached."""
        assert self._exported
        device, scheduler = self._exported.device, self._exported.station.scheduler
        if device.attached:
            self._bus = UsbBus(device, scheduler)
            self._generation = device.generation
            if self._second_look:
                look, self._second_look = self._second_look, None
                self._begin(look)
            else:
                self._pending += encode_import(ImportStatus.OK, self._exported.describe())
            self._read()
        elif scheduler.now >= self._give_up:
            reason = "the device did not attach itself"
            if self._second_look:
                self._leave(reason, replug=False)
            else:
                self._refuse(ImportStatus.NOT_AVAILABLE, reason)

    def _check_attachment(self) -> None:
        """Drop the client after its device has left."""
        if self._bus and not self._still_there():
            self._leave("the device has left the bus; it can be attached again", replug=False)

    def _still_there(self) -> bool:
        assert self._exported
        device = self._exported.device
        return device.attached and device.generation == self._generation

    def _submit(self, command: Submit) -> None:
        if not self._is_ours(command):
            return
        self._newest = command.number
        if command.number in self._premature:
            self._pending += encode_unlinked(self._premature.pop(command.number), TransferOutcome.TAKEN_BACK)
            return
        if command.number in self._transfers:
            self._leave(f"it sent a second transfer {command.number} while the first was under way")
            return
        self._bytes += len(command.data)
        if len(self._transfers) == MOST_TRANSFERS or self._bytes > MOST_BYTES:
            self._leave(f"it has more than {MOST_TRANSFERS} transfers or {MOST_BYTES} bytes under way")
            return
        is_control = not command.endpoint & ~DIRECTION_IN
        if is_control and self._ends_reset(command.setup):
            assert self._exported
            self._exported.device.reset()
            if not self._still_there():
                self._second_look = command
                self._await_device()
                return
        self._begin(command)

    def _begin(self, command: Submit) -> None:
        assert self._bus
        transfer = Transfer(
            command.endpoint,
            command.length,
            command.data,
            command.setup,
            command.zero_packet,
            command.short_not_ok,
            lambda transfer, outcome: self._answer(command, transfer, outcome),
        )
        self._transfers[command.number] = transfer
        self._bus.submit(transfer)

    def _is_ours(self, command: Submit | Unlink) -> bool:
        assert self._exported
        wanted = self._exported.describe().device_id
        if command.device_id != wanted:
            self._leave(f"it sent a command for device {command.device_id:#x}; its own is {wanted:#x}")
        return command.device_id == wanted

    def _ends_reset(self, setup: Setup) -> bool:
        """Whether the host has reset the bus before this request."""
        ends = setup == _SECOND_LOOK and self._looked and not self._transfers
        self._looked = setup == _FIRST_LOOK
        return ends

    def _answer(self, command: Submit, transfer: Transfer, outcome: TransferOutcome) -> None:
        actual = len(transfer.received) if transfer.is_in else transfer.sent
        self._pending += encode_submitted(command, outcome, actual, transfer.received)
        self._forget(command.number)

    def _forget(self, number: int) -> Transfer:
        transfer = self._transfers.pop(number)
        self._bytes -= len(transfer.data)
        return transfer

    def _unlink(self, command: Unlink) -> None:
        assert self._bus
        if not self._is_ours(command):
            return
        transfer = self._transfers.get(command.target)
        if transfer is not None:
            self._bus.cancel(transfer)
            if transfer.sent or transfer.received:  # the answer to Unlink cannot say how much was carried
                transfer.on_end(transfer, TransferOutcome.TAKEN_BACK)
                self._pending += encode_unlinked(command.number, TransferOutcome.DONE)
            else:
                self._forget(command.target)
                self._pending += encode_unlinked(command.number, TransferOutcome.TAKEN_BACK)
        elif self._newest is None:  # it belongs to the previous connection; a client waits for the answer
            self._pending += encode_unlinked(command.number, TransferOutcome.TAKEN_BACK)
        elif 0 < (command.target - self._newest) % 2**32 < 2**31:
            self._premature[command.target] = command.number
            if len(self._premature) > MOST_TRANSFERS:
                self._leave(f"it cancelled more than {MOST_TRANSFERS} transfers that it never began")
        else:
            self._pending += encode_unlinked(command.number, TransferOutcome.DONE)

    def _leave(self, reason: str, replug: bool = True) -> None:
        """End the conversation with the client."""
        self.over = True
        self.end = self.end or reason
        self._received.clear()
        if self._exported:
            self._exported.station.conversations.remove(self)
            self._exported.taken = False
            if replug:
                self._exported.device.unplug()
                self._exported.device.plug()
            self._exported = self._bus = None
            self._transfers.clear()
