"""The ioctls of Linux's usbfs, answered by a device model instead of a kernel.

A `KernelDevice` is what the kernel keeps of a device that it has enumerated, a `UsbFile` what it keeps of each program
that has opened /dev/bus/usb/BBB/DDD. Structures, numbers and errors are those of <linux/usbdevice_fs.h> and of the
kernel's devio.c, on a little-endian machine of 64 bits. Left out are isochronous transfers, streams, memory that is
mapped, signals and power management. There is no I/O here and no clock: a program's memory is reached through a
`CallerMemory`, and whoever holds the device lets its time pass.
"""

from __future__ import annotations

import errno
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from ctypes import Structure, c_uint32, c_uint64, sizeof
from functools import partial
from typing import NamedTuple, Protocol, TypeVar

from ...protocol.board import CORE_HZ, CYCLES_PER_MS
from ...protocol.codes import DescriptorType, StandardRequest
from ...protocol.descriptors import (
    Configuration,
    Descriptor,
    DeviceDescriptor,
    Endpoint,
    Interface,
    String,
    descriptors,
)
from ...protocol.enumeration import FULL_SPEED, LANGUAGE, Speed
from ...protocol.requests import DIRECTION_IN, Setup
from ...protocol.timing import MICROFRAME_CYCLES
from ..door import Stall
from ..scheduler import Scheduler
from .usb_bus import Peripheral, Transfer, UsbBus
from .usbdevice_fs import (
    BulkTransfer,
    Capability,
    ConnectInfo,
    ControlTransfer,
    DisconnectClaim,
    DriverIoctl,
    GetDriver,
    Ioctl,
    SetInterface,
    UrbFields,
    UrbFlag,
    UrbType,
)

__all__ = ["CallerMemory", "KernelDevice", "UsbFile"]

RESET_CYCLES = CORE_HZ // 20  # 50 ms (USB 2.0, 7.1.7.5)

Fields = TypeVar("Fields", bound=Structure)


_TO_DEVICE, _FROM_DEVICE, _TO_INTERFACE, _TO_ENDPOINT = 0x00, 0x80, 0x01, 0x02  # types of standard requests
_ENDPOINT_HALT = 0
_DEVICE_BYTES, _HEAD_BYTES, _STRING_BYTES = 18, 9, 255  # lengths of descriptors; no string is longer
_NO_SETUP = Setup(0, 0, 0, 0, 0)

_NO_CONFIGURATION = 2**32 - 1  # -1, for devices whose configuration has the value 0
_USBFS = b"usbfs"  # the kernel's name for this driver
_DISCONNECT_CLAIM_IF_DRIVER = 0x01
_SPEED_FULL, _SPEED_HIGH = 2, 3  # enum usb_device_speed, <linux/usb/ch9.h>
_URB_FLAGS = 0xE7  # all that the kernel knows
_MOST_INTERFACES = 64  # bits of the kernel's set of interfaces that a file has claimed

# A request's type (USB 2.0, table 9-2).
_TYPE_MASK, _TYPE_VENDOR = 0x60, 0x40
_RECIPIENT_MASK, _RECIPIENT_INTERFACE, _RECIPIENT_ENDPOINT = 0x1F, 1, 2
_RESERVED_ENDPOINT_BITS = ~0x8F
_TRANSFER_TYPE_MASK, _TRANSFER_TYPE_INTERRUPT = 0x03, 0x03  # bmAttributes of an endpoint


class CallerMemory(Protocol):
    """The memory of a program whose ioctl has not returned yet."""

    def read(self, address: int, size: int) -> bytes:
        """Bytes from an address on."""

    def write(self, address: int, data: bytes) -> None:
        """Write bytes at an address."""


class _Refused(Exception):
    """The kernel refuses an ioctl with an errno."""

    def __init__(self, code: int) -> None:
        super().__init__(errno.errorcode[code])
        self.code = code


class _Call(NamedTuple):
    """An ioctl that waits for its result."""

    argument: int
    memory: CallerMemory
    reply: Callable[[int], None]

    def fetch(self, kind: type[Fields]) -> Fields:
        """The structure to which the argument points."""
        return kind.from_buffer_copy(self.memory.read(self.argument, sizeof(kind)))

    def number(self) -> int:
        """The unsigned int to which the argument points."""
        return int.from_bytes(self.memory.read(self.argument, sizeof(c_uint32)), "little")

    def store(self, data: bytes) -> None:
        """Write to the address in the argument."""
        self.memory.write(self.argument, data)


class KernelDevice:
    """A device from its arrival on the bus until it leaves, in the state of a kernel that has enumerated it.

    Parameters
    ----------
    device : Peripheral
        The device, attached.
    scheduler : Scheduler
        The device's time. Enumeration takes some of it.
    address : int
        The address that it gets, 1 to 127.

    Attributes
    ----------
    descriptor : Device
        The device descriptor.
    head : Configuration
        The descriptor of the first configuration.
    configuration : bytes
        The same with all its subordinate descriptors.
    interfaces : tuple of Interface
        Every setting of every interface in it.
    endpoints : dict of int to (int, Endpoint)
        The number of its interface and its descriptor, for each endpoint's address.
    strings : dict of int to str
        The strings that device and interfaces name.
    chosen : int
        Value of the selected configuration, 0 for none; initially that of the first one.
    on_choice : callable
        A function that is called whenever `chosen` may have changed.

    Raises
    ------
    Stall
        If the device does not know a request that enumeration needs, or leaves meanwhile.
    ReplyError
        If its descriptors make no sense.
    """

    def __init__(self, device: Peripheral, scheduler: Scheduler, address: int) -> None:
        self.scheduler = scheduler
        self.address = address
        self.claims: dict[int, UsbFile] = {}
        self.on_choice: Callable[[], None] = lambda: None
        self._device = device
        self._generation = device.generation
        self._files: list[UsbFile] = []
        self._reset()
        self.descriptor = DeviceDescriptor.decode(self._get(DescriptorType.DEVICE, 0, _DEVICE_BYTES))
        self.head = Configuration.decode(self._get(DescriptorType.CONFIGURATION, 0, _HEAD_BYTES))
        self.configuration = self._get(DescriptorType.CONFIGURATION, 0, self.head.wTotalLength)
        chain = descriptors(self.configuration)
        self.interfaces = tuple(each for each in chain if isinstance(each, Interface))
        self.endpoints = dict(_endpoints(chain))
        named = {self.descriptor.iManufacturer, self.descriptor.iProduct, self.descriptor.iSerialNumber}
        named |= {interface.iInterface for interface in self.interfaces}
        self.strings = {index: self._string(index) for index in sorted(named - {0})}
        self.configure(self.head.bConfigurationValue)
        self.bus = UsbBus(device, scheduler)

    @property
    def present(self) -> bool:
        """Whether the device is still there, in the same attachment."""
        return self._device.attached and self._device.generation == self._generation

    @property
    def speed(self) -> Speed:
        """The speed at which it runs."""
        return self._device.speed

    def open(self, on_change: Callable[[], None]) -> UsbFile:
        """Open its node; `on_change` is called whenever `UsbFile.writable` may have changed."""
        file = UsbFile(self, on_change)
        self._files.append(file)
        return file

    def close(self, file: UsbFile) -> None:
        """Forget a file that a program has closed."""
        self._files.remove(file)

    def next_time(self) -> int | None:
        """The latest time at which time must pass again, in core cycles; None if nothing waits."""
        event = self.scheduler.next_time()
        turn = self.bus.next_time(event)
        return event if turn is None else turn

    def run_until(self, time: int) -> None:
        """Let time pass, with its transfers, until a core cycle or until the device has gone."""
        while self.present:
            turn = self.bus.next_time(self.scheduler.next_time())
            if turn is None or turn > time:
                self._pass(time - self.scheduler.now)
                return
            self._pass(turn - self.scheduler.now)
            if self.present:
                self.bus.run()

    def disconnect(self) -> None:
        """The device has gone: end what waits."""
        for file in self._files:
            file.disconnect()

    def configure(self, value: int) -> None:
        """Select a configuration; raises `Stall`."""
        self._set(StandardRequest.SET_CONFIGURATION, value=value)
        self.chosen = value
        self.on_choice()

    def set_interface(self, interface: int, setting: int) -> None:
        """Select a setting of an interface; raises `Stall`."""
        self._set(StandardRequest.SET_INTERFACE, _TO_INTERFACE, setting, interface)

    def clear_halt(self, endpoint: int) -> None:
        """End the halt of an endpoint; raises `Stall`."""
        self._set(StandardRequest.CLEAR_FEATURE, _TO_ENDPOINT, _ENDPOINT_HALT, endpoint)

    def reset(self) -> None:
        """Reset the bus and configure the device as before, if it is still `present` then; raises `Stall`."""
        self._reset()
        if self.present and self.chosen:
            self.configure(self.chosen)

    def interface_of(self, endpoint: int) -> int:
        """The interface of an endpoint; refused if there is none."""
        if endpoint & _RESERVED_ENDPOINT_BITS:
            raise _Refused(errno.EINVAL)
        if not self.chosen:
            raise _Refused(errno.ESRCH)
        if endpoint not in self.endpoints:
            raise _Refused(errno.ENOENT)
        return self.endpoints[endpoint][0]

    def has_interface(self, number: int) -> bool:
        """Whether there is such an interface, which requires a configured device."""
        return bool(self.chosen) and any(interface.bInterfaceNumber == number for interface in self.interfaces)

    def _reset(self) -> None:
        """Reset the bus and give the device its address."""
        self._pass(RESET_CYCLES)
        self._device.reset()
        if self.present:
            self._set(StandardRequest.SET_ADDRESS, value=self.address)

    def _string(self, index: int) -> str:
        return String.decode(self._get(DescriptorType.STRING, index, _STRING_BYTES, LANGUAGE)).bString

    def _get(self, kind: DescriptorType, index: int, length: int, language: int = 0) -> bytes:
        return self._request(Setup(_FROM_DEVICE, StandardRequest.GET_DESCRIPTOR, kind << 8 | index, language, length))

    def _set(self, request: StandardRequest, recipient: int = _TO_DEVICE, value: int = 0, index: int = 0) -> None:
        self._request(Setup(recipient, request, value, index, 0))

    def _request(self, setup: Setup) -> bytes:
        """Make a request of the kernel itself."""
        self._pass(MICROFRAME_CYCLES)
        if not self.present:
            raise Stall("the device has gone")
        return self._device.control(setup)

    def _pass(self, cycles: int) -> None:
        """Let the remaining time pass, if any."""
        self.scheduler.run_until(self.scheduler.now + max(0, cycles))


class UsbFile:
    """A device's node as opened by one program."""

    def __init__(self, device: KernelDevice, on_change: Callable[[], None]) -> None:
        self._device = device
        self._on_change = on_change
        self._waiting: dict[Transfer, Callable[[int], None]] = {}  # and what to do with the status of each
        self._submitted: dict[int, Transfer] = {}  # those that wait to be reaped, by the program's address of each
        self._unreaped: deque[_Unreaped] = deque()
        self._reaper: _Call | None = None
        self._handlers: dict[int, Callable[[_Call], int | None]] = {
            Ioctl.CONTROL: self._control,
            Ioctl.BULK: self._bulk,
            Ioctl.RESETEP: self._reset_endpoint,
            Ioctl.SETINTERFACE: self._set_interface,
            Ioctl.SETCONFIGURATION: self._set_configuration,
            Ioctl.GETDRIVER: self._get_driver,
            Ioctl.SUBMITURB: self._submit,
            Ioctl.DISCARDURB: self._discard,
            Ioctl.REAPURB: self._reap,
            Ioctl.REAPURBNDELAY: self._reap_without_delay,
            Ioctl.CLAIMINTERFACE: lambda call: self._claim(call.number()),
            Ioctl.RELEASEINTERFACE: lambda call: self._release(call.number()),
            Ioctl.CONNECTINFO: self._connect_info,
            Ioctl.IOCTL: self._driver_ioctl,
            Ioctl.RESET: self._reset,
            Ioctl.CLEAR_HALT: self._clear_halt,
            Ioctl.GET_CAPABILITIES: self._capabilities,
            Ioctl.DISCONNECT_CLAIM: self._disconnect_claim,
            Ioctl.GET_SPEED: lambda _: _SPEED_FULL if device.speed == FULL_SPEED else _SPEED_HIGH,
        }

    @property
    def writable(self) -> bool:
        """Whether poll() signals POLLOUT: a transfer that has ended waits to be reaped."""
        return bool(self._unreaped)

    def ioctl(self, request: int, argument: int, memory: CallerMemory, reply: Callable[[int], None]) -> None:
        """Carry out an ioctl.

        Parameters
        ----------
        request : int
            The number of the ioctl.
        argument : int
            The third argument of the call, a number or an address.
        memory : Memory
            The program's memory, valid until the reply.
        reply : callable
            What takes the result, or the negative errno, at once or when the request has been carried out.
        """
        call = _Call(argument, memory, reply)
        handler = self._handlers.get(request)
        try:
            if not self._device.present and request not in (Ioctl.REAPURB, Ioctl.REAPURBNDELAY):
                raise _Refused(errno.ENODEV)
            if handler is None:
                raise _Refused(errno.ENOTTY)
            result = handler(call)
        except _Refused as refused:
            result = -refused.code
        except Stall:
            result = -errno.EPIPE
        if result is not None:
            reply(result)

    def close(self) -> None:
        """The program has closed it: cancel what waits, release the interfaces, and send no more replies."""
        for transfer in self._waiting:
            self._device.bus.cancel(transfer)
        self._waiting.clear()
        self._unreaped.clear()
        self._reaper = None
        for interface in self._claimed():
            del self._device.claims[interface]
        self._device.close(self)

    def disconnect(self) -> None:
        """The device has gone: end what waits."""
        for transfer in list(self._waiting):
            self._end(transfer, -errno.ESHUTDOWN)
        if self._reaper:
            call, self._reaper = self._reaper, None
            call.reply(-errno.ENODEV)

    def _begin(self, transfer: Transfer, finish: Callable[[int], None]) -> None:
        self._waiting[transfer] = finish
        self._device.bus.submit(transfer)

    def _end(self, transfer: Transfer, status: int) -> None:
        """Cancel a transfer."""
        self._device.bus.cancel(transfer)
        self._ended(transfer, status)

    def _ended(self, transfer: Transfer, status: int) -> None:
        self._waiting.pop(transfer)(status)

    # Interfaces

    def _claimed(self) -> list[int]:
        return [interface for interface, owner in self._device.claims.items() if owner is self]

    def _claim(self, interface: int) -> int:
        if interface >= _MOST_INTERFACES:
            raise _Refused(errno.EINVAL)
        if not self._device.has_interface(interface):
            raise _Refused(errno.ENOENT)
        if self._device.claims.setdefault(interface, self) is not self:
            raise _Refused(errno.EBUSY)
        return 0

    def _require(self, interface: int) -> None:
        """Claim an interface that is about to be used, unless the program has claimed it."""
        if not self._device.chosen:
            raise _Refused(errno.EHOSTUNREACH)
        self._claim(interface)

    def _release(self, interface: int) -> int:
        if interface >= _MOST_INTERFACES:
            raise _Refused(errno.EINVAL)
        if not self._device.has_interface(interface):
            raise _Refused(errno.ENOENT)
        if self._device.claims.get(interface) is not self:
            raise _Refused(errno.EINVAL)
        del self._device.claims[interface]
        for transfer in list(self._submitted.values()):
            if not transfer.is_control and self._device.interface_of(transfer.endpoint) == interface:
                self._end(transfer, -errno.ENOENT)
        return 0

    def _set_interface(self, call: _Call) -> int:
        wanted = call.fetch(SetInterface)
        self._require(wanted.interface)
        settings = {(each.bInterfaceNumber, each.bAlternateSetting) for each in self._device.interfaces}
        if (wanted.interface, wanted.altsetting) not in settings:
            raise _Refused(errno.EINVAL)
        self._device.set_interface(wanted.interface, wanted.altsetting)
        return 0

    def _get_driver(self, call: _Call) -> int:
        wanted = call.fetch(GetDriver)
        if wanted.interface not in self._device.claims:
            raise _Refused(errno.ENODATA)
        wanted.driver = _USBFS
        call.store(bytes(wanted))
        return 0

    def _driver_ioctl(self, call: _Call) -> int:
        wanted = call.fetch(DriverIoctl)
        if not self._device.chosen:
            raise _Refused(errno.EHOSTUNREACH)
        if not self._device.has_interface(wanted.ifno):
            raise _Refused(errno.EINVAL)
        owner = self._device.claims.get(wanted.ifno)
        match wanted.ioctl_code:
            case Ioctl.DISCONNECT:
                if owner is None:
                    raise _Refused(errno.ENODATA)
                owner._release(wanted.ifno)
            case Ioctl.CONNECT:
                if owner:
                    raise _Refused(errno.EBUSY)
            case _:
                raise _Refused(errno.ENOTTY)
        return 0

    def _disconnect_claim(self, call: _Call) -> int:
        wanted = call.fetch(DisconnectClaim)
        owner = self._device.claims.get(wanted.interface)
        if owner:
            is_named = wanted.driver == _USBFS
            if wanted.flags and is_named != bool(wanted.flags & _DISCONNECT_CLAIM_IF_DRIVER):
                raise _Refused(errno.EBUSY)
            owner._release(wanted.interface)
        return self._claim(wanted.interface)

    # The device

    def _set_configuration(self, call: _Call) -> int:
        number = call.number()
        value = 0 if number == _NO_CONFIGURATION else number
        if self._device.claims:
            raise _Refused(errno.EBUSY)
        if value not in (0, self._device.head.bConfigurationValue):
            raise _Refused(errno.EINVAL)
        self._device.configure(value)
        return 0

    def _reset(self, _: _Call) -> int:
        for interface, owner in list(self._device.claims.items()):
            owner._release(interface)
        self._device.reset()
        if not self._device.present:
            raise _Refused(errno.ENODEV)
        return 0

    def _clear_halt(self, call: _Call) -> int:
        endpoint = call.number()
        self._require(self._device.interface_of(endpoint))
        self._device.clear_halt(endpoint)
        return 0

    def _reset_endpoint(self, call: _Call) -> int:
        self._require(self._device.interface_of(call.number()))
        return 0  # a host only has to reset an endpoint's data toggle, and there is none here

    def _connect_info(self, call: _Call) -> int:
        call.store(bytes(ConnectInfo(self._device.address, 0)))
        return 0

    def _capabilities(self, call: _Call) -> int:
        call.store(bytes(c_uint32(sum(Capability))))
        return 0

    # Transfers for which the program waits

    def _control(self, call: _Call) -> None:
        wanted = call.fetch(ControlTransfer)
        setup = Setup(wanted.bRequestType, wanted.bRequest, wanted.wValue, wanted.wIndex, wanted.wLength)
        self._await(call, self._request(call, setup, wanted.data), wanted.data, wanted.timeout)

    def _bulk(self, call: _Call) -> None:
        wanted = call.fetch(BulkTransfer)
        self._await(call, self._transfer(call, wanted.ep, wanted.len, wanted.data), wanted.data, wanted.timeout)

    def _await(self, call: _Call, transfer: Transfer, buffer: int, timeout_ms: int) -> None:
        """Reply when a transfer has ended, or at the time-out, if there is one."""

        def finish(status: int) -> None:
            if status:
                call.reply(status)
                return
            call.memory.write(buffer, bytes(transfer.received))
            call.reply(_actual_length(transfer))

        def give_up() -> None:
            if transfer in self._waiting:
                self._end(transfer, -errno.ETIMEDOUT)

        self._begin(transfer, finish)
        if timeout_ms:
            self._device.scheduler.at(self._device.scheduler.now + timeout_ms * CYCLES_PER_MS, give_up)

    # Transfers that the program reaps

    def _submit(self, call: _Call) -> int:
        fields = call.fetch(UrbFields)
        if fields.flags & ~_URB_FLAGS or (fields.buffer_length > 0 and not fields.buffer):
            raise _Refused(errno.EINVAL)
        is_control = fields.type == UrbType.CONTROL
        transfer = self._submitted_request(call, fields) if is_control else self._submitted_data(call, fields)
        self._submitted[call.argument] = transfer
        self._begin(transfer, partial(self._finish_submitted, call.argument, fields))
        return 0

    def _submitted_request(self, call: _Call, fields: UrbFields) -> Transfer:
        if fields.endpoint & ~DIRECTION_IN:
            self._require(self._device.interface_of(fields.endpoint))
            raise _Refused(errno.EINVAL)  # it is no control endpoint
        if fields.buffer_length < Setup.BYTES:
            raise _Refused(errno.EINVAL)
        setup = Setup.decode(call.memory.read(fields.buffer, Setup.BYTES))
        if fields.buffer_length < Setup.BYTES + setup.length:
            raise _Refused(errno.EINVAL)
        return self._request(call, setup, fields.buffer + Setup.BYTES)

    def _submitted_data(self, call: _Call, fields: UrbFields) -> Transfer:
        transfer = self._transfer(call, fields.endpoint, fields.buffer_length, fields.buffer)
        _, endpoint = self._device.endpoints[fields.endpoint]
        is_interrupt = endpoint.bmAttributes & _TRANSFER_TYPE_MASK == _TRANSFER_TYPE_INTERRUPT
        if fields.type != UrbType.BULK and not (fields.type == UrbType.INTERRUPT and is_interrupt):
            raise _Refused(errno.EINVAL)
        transfer.zero_packet = bool(fields.flags & UrbFlag.ZERO_PACKET)
        transfer.short_not_ok = bool(fields.flags & UrbFlag.SHORT_NOT_OK)
        return transfer

    def _finish_submitted(self, address: int, fields: UrbFields, status: int) -> None:
        transfer = self._submitted.pop(address)
        fields.status, fields.actual_length = status, _actual_length(transfer)
        self._unreaped.append(_Unreaped(address, fields, bytes(transfer.received)))
        if self._reaper:
            call, self._reaper = self._reaper, None
            call.reply(self._reap_without_delay(call))
        self._on_change()

    def _discard(self, call: _Call) -> int:
        if call.argument not in self._submitted:
            raise _Refused(errno.EINVAL)
        self._end(self._submitted[call.argument], -errno.ENOENT)
        return 0

    def _reap(self, call: _Call) -> int | None:
        if not self._unreaped and self._device.present:
            self._reaper = call
            return None
        return self._reap_without_delay(call)

    def _reap_without_delay(self, call: _Call) -> int:
        if not self._unreaped:
            raise _Refused(errno.EAGAIN if self._device.present else errno.ENODEV)
        address, fields, received = self._unreaped.popleft()
        skipped = Setup.BYTES if fields.type == UrbType.CONTROL else 0
        call.memory.write(fields.buffer + skipped, received)
        call.memory.write(address, bytes(fields))
        call.store(bytes(c_uint64(address)))
        self._on_change()
        return 0

    # Both

    def _request(self, call: _Call, setup: Setup, buffer: int) -> Transfer:
        """A control transfer, after the program has claimed the interface that it addresses."""
        recipient, index = setup.request_type & _RECIPIENT_MASK, setup.index & 0xFF
        if setup.request_type & _TYPE_MASK != _TYPE_VENDOR:
            if recipient == _RECIPIENT_INTERFACE:
                self._require(index)
            elif recipient == _RECIPIENT_ENDPOINT and index & ~DIRECTION_IN:
                self._require(self._device.interface_of(index))
        data = b"" if setup.is_in else call.memory.read(buffer, setup.length)
        return Transfer(DIRECTION_IN & setup.request_type, setup.length, data, setup, False, False, self._ended)

    def _transfer(self, call: _Call, endpoint: int, length: int, buffer: int) -> Transfer:
        """A data transfer, after the program has claimed the interface of the endpoint."""
        self._require(self._device.interface_of(endpoint))
        data = b"" if endpoint & DIRECTION_IN else call.memory.read(buffer, length)
        return Transfer(endpoint, length, data, _NO_SETUP, False, False, self._ended)


class _Unreaped(NamedTuple):
    """A transfer that has ended and waits to be reaped."""

    address: int
    fields: UrbFields
    received: bytes


def _endpoints(chain: Iterable[Descriptor]) -> Iterator[tuple[int, tuple[int, Endpoint]]]:
    interface = 0
    for each in chain:
        if isinstance(each, Interface):
            interface = each.bInterfaceNumber
        elif isinstance(each, Endpoint):
            yield each.bEndpointAddress, (interface, each)


def _actual_length(transfer: Transfer) -> int:
    return len(transfer.received) if transfer.is_in else transfer.sent
