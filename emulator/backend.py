"""A pyusb backend whose bus holds emulators, so that the real host driver and pyusb run unchanged.

Each transfer takes the time it would take on a high-speed bus at best: 13 bulk packets or one control transfer in a
microframe of 125 µs. A NAK lets the device's time pass until it can answer, or the transfer's time-out is over.
"""

from __future__ import annotations

import errno
from array import array
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from types import SimpleNamespace
from typing import Any, NoReturn, TypeVar
from urllib.parse import parse_qsl

import usb.backend
from usb.core import USBError, USBTimeoutError

from ..errors import DeviceNotFoundError
from ..protocol.board import CORE_HZ
from ..protocol.codes import BLOCK_BYTES, DescriptorType, StandardRequest
from ..protocol.descriptors import Configuration, Descriptor, Endpoint, Interface, descriptors
from ..protocol.requests import Setup
from ..protocol.timing import FIVE_WIRE, LINKS, MICROFRAME_CYCLES, PACKET_CYCLES
from .door import Handshake, Stall
from .machine import Emulator, plugged

__all__ = ["EmulatorBackend", "open_backend"]

RESET_CYCLES = CORE_HZ // 20  # 50 ms, USB 2.0, 7.1.7.5
HIGH_SPEED = 3

Answer = TypeVar("Answer")


def open_backend(url: str) -> EmulatorBackend:
    """The bus for an ``emulator:`` URL.

    Parameters
    ----------
    url : str
        ``emulator:`` plugs in a fresh emulator for whoever asks, with options ``?link=5wire`` or ``2wire``;
        ``emulator:SERIAL`` looks among those that this process has plugged in.

    Raises
    ------
    DeviceNotFoundError
        Where an option is unknown.
    """
    serial, _, query = url.partition(":")[2].partition("?")
    options = dict(parse_qsl(query, keep_blank_values=True))
    link = options.pop("link", FIVE_WIRE.name)
    if options:
        raise DeviceNotFoundError(
            f"{url!r}: the emulator has no option {next(iter(options))!r}; it has link=5wire or 2wire"
        )
    if link not in LINKS:
        raise DeviceNotFoundError(f"{url!r}: unknown link {link!r}; known are {', '.join(LINKS)}")
    if serial and query:
        raise DeviceNotFoundError(f"{url!r}: options go with a fresh emulator, not with one that is plugged in")
    return EmulatorBackend(plugged() if serial else [Emulator(link=LINKS[link])])


class Handle:
    """An opened emulator, as one program holds it. Only one may hold its interface."""

    def __init__(self, emulator: Emulator) -> None:
        self.emulator = emulator

    def check_free(self) -> None:
        """Raise `USBError` (busy) where another handle holds the interface."""
        if self.emulator.claimed_by not in (None, self):
            raise USBError("Resource busy", None, errno.EBUSY)

    def release(self) -> None:
        """Give the interface back."""
        if self.emulator.claimed_by is self:
            self.emulator.claimed_by = None


class EmulatorBackend(usb.backend.IBackend):
    """The bus. What pyusb calls a device is the `Emulator` itself."""

    def __init__(self, emulators: Iterable[Emulator]) -> None:
        super().__init__()
        self._emulators = list(emulators)

    def enumerate_devices(self) -> Iterator[Emulator]:
        """Every emulator on the bus."""
        return iter(self._emulators)

    def get_device_descriptor(self, dev: Emulator) -> SimpleNamespace:
        """The device descriptor, with its place on the bus."""
        address = self._emulators.index(dev) + 1
        place = {"bus": 0, "address": address, "port_number": address, "port_numbers": (address,), "speed": HIGH_SPEED}
        return SimpleNamespace(**vars(_parsed(dev.usb.enumeration.device)), **place)

    def get_configuration_descriptor(self, dev: Emulator, config: int) -> SimpleNamespace:
        """The configuration descriptor."""
        return [fields for fields in _tree(dev) if fields.bDescriptorType == DescriptorType.CONFIGURATION][config]

    def get_interface_descriptor(self, dev: Emulator, intf: int, alt: int, config: int) -> SimpleNamespace:
        """The descriptor of an interface's setting."""
        return _settings(_tree(dev), intf)[alt]

    def get_endpoint_descriptor(self, dev: Emulator, ep: int, intf: int, alt: int, config: int) -> SimpleNamespace:
        """The descriptor of an interface's endpoint."""
        tree = _tree(dev)
        endpoint = tree[tree.index(_settings(tree, intf)[alt]) + 1 + ep]
        return SimpleNamespace(**vars(endpoint), bRefresh=0, bSynchAddress=0)

    def open_device(self, dev: Emulator) -> Handle:
        """A handle of one's own."""
        return Handle(dev)

    def close_device(self, dev_handle: Handle) -> None:
        """Let go of the device, which lives on."""
        dev_handle.release()

    def set_configuration(self, dev_handle: Handle, config_value: int) -> None:
        """Choose a configuration."""
        dev_handle.check_free()
        self.ctrl_transfer(dev_handle, 0x00, StandardRequest.SET_CONFIGURATION, config_value, 0, b"", 1000)

    def get_configuration(self, dev_handle: Handle) -> int:
        """The configuration chosen, 0 for none."""
        return dev_handle.emulator.usb.configuration

    def claim_interface(self, dev_handle: Handle, intf: int) -> None:
        """Hold the interface, so that nobody else can."""
        dev_handle.check_free()
        dev_handle.emulator.claimed_by = dev_handle

    def release_interface(self, dev_handle: Handle, intf: int) -> None:
        """Give the interface back."""
        dev_handle.release()

    def is_kernel_driver_active(self, dev_handle: Handle, intf: int) -> bool:
        """No kernel is involved."""
        return False

    def bulk_write(self, dev_handle: Handle, ep: int, intf: int, data: Any, timeout: int) -> int:
        """Send data in packets; the number of bytes that the device took."""
        payload, sent = bytes(data), 0
        while sent < len(payload):
            packet = payload[sent : sent + BLOCK_BYTES]
            try:
                answer = self._insist(
                    dev_handle.emulator, timeout, partial(dev_handle.emulator.usb.bulk_out, ep, packet)
                )
            except USBTimeoutError:
                if sent:
                    return sent  # as libusb does
                raise
            if answer is Handshake.STALL:
                _stalled(f"endpoint 0x{ep:02x}")
            sent += len(packet)
        return sent

    def bulk_read(self, dev_handle: Handle, ep: int, intf: int, buff: Any, timeout: int) -> int:
        """Receive one packet into the buffer; its length."""
        answer = self._insist(dev_handle.emulator, timeout, partial(dev_handle.emulator.usb.bulk_in, ep))
        if isinstance(answer, Handshake):
            _stalled(f"endpoint 0x{ep:02x}")
        if len(answer) > len(buff) * buff.itemsize:
            raise USBError("Overflow", None, errno.EOVERFLOW)
        buff[: len(answer)] = array("B", answer)
        return len(answer)

    intr_read = bulk_read

    def ctrl_transfer(
        self,
        dev_handle: Handle,
        bmRequestType: int,
        bRequest: int,
        wValue: int,
        wIndex: int,
        data: Any,
        timeout: int,
    ) -> int:
        """Carry out a control transfer; the number of bytes transferred."""
        self._pass(dev_handle.emulator, MICROFRAME_CYCLES)
        incoming = bool(bmRequestType & 0x80)
        setup = Setup(bmRequestType, bRequest, wValue, wIndex, len(data))
        try:
            answer = dev_handle.emulator.usb.control(setup, b"" if incoming else bytes(data))
        except Stall as stall:
            _stalled(str(stall))
        if not incoming:
            return len(data)
        data[: len(answer)] = array("B", answer)
        return len(answer)

    def reset_device(self, dev_handle: Handle) -> None:
        """Reset the port."""
        self._pass(dev_handle.emulator, RESET_CYCLES)
        dev_handle.emulator.usb.reset()

    def clear_halt(self, dev_handle: Handle, ep: int) -> None:
        """End the halt of an endpoint."""
        self.ctrl_transfer(dev_handle, 0x02, StandardRequest.CLEAR_FEATURE, 0, ep, b"", 1000)

    def _pass(self, emulator: Emulator, cycles: int) -> None:
        if emulator.unplugged:
            raise USBError("No such device", None, errno.ENODEV)
        emulator.scheduler.run_until(emulator.scheduler.now + cycles)

    def _insist(self, emulator: Emulator, timeout_ms: int, transact: Callable[[], Answer]) -> Answer:
        """Repeat a bulk transaction until the answer is no NAK."""
        scheduler = emulator.scheduler
        deadline = scheduler.now + (timeout_ms or 10**9) * CORE_HZ // 1000
        self._pass(emulator, PACKET_CYCLES)
        while (answer := transact()) is Handshake.NAK:
            upcoming = scheduler.next_time()
            if upcoming is None or upcoming > deadline:
                scheduler.run_until(deadline)
                raise USBTimeoutError("Operation timed out", None, errno.ETIMEDOUT)
            scheduler.run_until(upcoming)
        return answer


def _stalled(what: str) -> NoReturn:
    raise USBError(f"Pipe error: {what}", None, errno.EPIPE)


def _tree(dev: Emulator) -> list[SimpleNamespace]:
    """Configuration, interfaces and endpoints as pyusb wants them, each with the bytes of what else follows it."""
    tree: list[SimpleNamespace] = []
    for descriptor in descriptors(dev.usb.enumeration.configuration):
        if isinstance(descriptor, Configuration | Interface | Endpoint):
            tree.append(_parsed(descriptor))
        else:
            tree[-1].extra_descriptors.extend(descriptor.encode())
    return tree


def _settings(tree: list[SimpleNamespace], interface: int) -> list[SimpleNamespace]:
    return [
        fields
        for fields in tree
        if fields.bDescriptorType == DescriptorType.INTERFACE and fields.bInterfaceNumber == interface
    ]


def _parsed(descriptor: Descriptor) -> SimpleNamespace:
    """A descriptor as pyusb wants it."""
    size, kind = descriptor.encode()[:2]
    return SimpleNamespace(bLength=size, bDescriptorType=kind, **vars(descriptor), extra_descriptors=array("B"))
