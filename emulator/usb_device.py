"""The device as a USB host sees it: control requests, endpoints and their handshakes. It knows no transport.

Every door (an in-process backend, a network protocol, a simulated kernel) speaks to the device through this class.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from ..protocol.board import BOARDS, CHANNELS
from ..protocol.codes import BLOCK_BYTES, REQUEST_TYPE_IN, REQUEST_TYPE_OUT, WATCHDOG_MS_RANGE, Request
from ..protocol.descriptors import (
    CONFIGURATION,
    CONFIGURATION_VALUE,
    DEVICE,
    ENDPOINT_IN,
    ENDPOINT_OUT,
    STRING_TYPE,
    configuration_descriptor,
    device_descriptor,
    string_descriptor,
)
from ..protocol.replies import encode_reports, encode_wiring
from .controller import FIRMWARE, Controller

__all__ = ["SET_CONFIGURATION", "Handshake", "Setup", "Stall", "UsbDevice"]


class Handshake(Enum):
    """How a device answers a bulk transaction."""

    ACK = "ack"
    NAK = "nak"
    STALL = "stall"


class Stall(Exception):
    """The device answers a control request with STALL: it does not know it, or not now."""


@dataclass(frozen=True)
class Setup:
    """The eight bytes that begin a control transfer."""

    request_type: int
    request: int
    value: int
    index: int
    length: int


_STANDARD_IN_DEVICE, _STANDARD_OUT_DEVICE = 0x80, 0x00
_STANDARD_IN_INTERFACE, _STANDARD_OUT_INTERFACE = 0x81, 0x01
_GET_STATUS = 0
WITH_VALUE = (Request.WATCHDOG, Request.LIMIT, Request.IDENTIFY)
_GET_DESCRIPTOR, _GET_CONFIGURATION, SET_CONFIGURATION, _GET_INTERFACE, _SET_INTERFACE = 6, 8, 9, 10, 11


class UsbDevice:
    """The device's USB side.

    Parameters
    ----------
    controller : Controller
        What stands behind the endpoints.
    serial : str
        Serial number, in the string descriptors.
    """

    def __init__(self, controller: Controller, serial: str) -> None:
        self._controller = controller
        self._strings = [None, "phasewire", "phasewire five-board array (emulated)", serial]
        self.configuration = 0
        self._handlers: dict[tuple[int, int], Callable[[Setup], bytes]] = {
            (_STANDARD_IN_DEVICE, _GET_STATUS): lambda _: b"\x01\x00",  # self-powered
            (_STANDARD_IN_DEVICE, _GET_DESCRIPTOR): self._descriptor,
            (_STANDARD_IN_DEVICE, _GET_CONFIGURATION): lambda _: bytes([self.configuration]),
            (_STANDARD_OUT_DEVICE, SET_CONFIGURATION): self._set_configuration,
            (_STANDARD_IN_INTERFACE, _GET_INTERFACE): lambda _: b"\x00",
            (_STANDARD_OUT_INTERFACE, _SET_INTERFACE): self._set_interface,
            (REQUEST_TYPE_IN, Request.INFO): lambda _: controller.info().encode(),
            (REQUEST_TYPE_IN, Request.STATUS): self._status,
            (REQUEST_TYPE_IN, Request.WIRING): lambda _: encode_wiring(controller.wiring),
            (REQUEST_TYPE_IN, Request.CLOCK): lambda _: controller.clock().encode(),
            (REQUEST_TYPE_IN, Request.PROCESSORS): lambda _: encode_reports(controller.reports()),
            (REQUEST_TYPE_OUT, Request.ENABLE): lambda _: self._order(controller.enable),
            (REQUEST_TYPE_OUT, Request.DISABLE): lambda _: self._order(controller.disable),
            (REQUEST_TYPE_OUT, Request.CLEAR_FAULTS): lambda _: b"",
            (REQUEST_TYPE_OUT, Request.WATCHDOG): self._set_watchdog,
            (REQUEST_TYPE_OUT, Request.LIMIT): self._set_limit,
            (REQUEST_TYPE_OUT, Request.IDENTIFY): self._identify,
        }

    def control(self, setup: Setup) -> bytes:
        """Carry out a control transfer and return its IN data stage. No request so far has an OUT data stage.

        Raises
        ------
        Stall
            Where the device does not know the request.
        """
        handler = self._handlers.get((setup.request_type, setup.request))
        if handler is None:
            raise Stall(f"request 0x{setup.request:02x} of type 0x{setup.request_type:02x} is unknown")
        is_vendor_request = setup.request_type in (REQUEST_TYPE_IN, REQUEST_TYPE_OUT)
        takes_value = is_vendor_request and Request(setup.request) in WITH_VALUE
        if is_vendor_request and (setup.index or not self.configuration or (setup.value and not takes_value)):
            raise Stall("a vendor request has index 0, value 0 unless it takes one, and needs a configured device")
        return handler(setup)[: setup.length]

    def _descriptor(self, setup: Setup) -> bytes:
        kind, index = divmod(setup.value, 256)
        if kind == DEVICE.kind and index == 0:
            return device_descriptor(FIRMWARE)
        if kind == CONFIGURATION.kind and index == 0:
            return configuration_descriptor()
        if kind == STRING_TYPE and index < len(self._strings):
            return string_descriptor(self._strings[index])
        raise Stall(f"there is no descriptor {kind}/{index}")

    def _set_configuration(self, setup: Setup) -> bytes:
        if setup.value not in (0, CONFIGURATION_VALUE):
            raise Stall(f"there is no configuration {setup.value}")
        self.configuration = setup.value
        self._controller.reset_endpoints()
        return b""

    def _set_interface(self, setup: Setup) -> bytes:
        if setup.index != 0 or setup.value != 0:
            raise Stall(f"there is no interface {setup.index} with setting {setup.value}")
        return b""

    def _status(self, _: Setup) -> bytes:
        self._controller.feed_watchdog()
        return self._controller.status().encode()

    def _set_watchdog(self, setup: Setup) -> bytes:
        least, most = WATCHDOG_MS_RANGE
        if not least <= setup.value <= most:
            raise Stall(f"a watchdog of {setup.value} ms is outside {least} to {most} ms")
        self._controller.set_watchdog(setup.value)
        return b""

    def _set_limit(self, setup: Setup) -> bytes:
        if not setup.value <= CHANNELS or not self._controller.set_limit(setup.value):
            raise Stall(f"a limit is set while the outputs are off, and is at most {CHANNELS}, not {setup.value}")
        return b""

    def _identify(self, setup: Setup) -> bytes:
        if setup.value >= BOARDS:
            raise Stall(f"there is no board {setup.value}")
        self._controller.identify(setup.value)
        return b""

    @staticmethod
    def _order(action: Callable[[], None]) -> bytes:
        action()
        return b""

    def reset(self) -> None:
        """The bus was reset: not configured any more, and the outputs off."""
        self.configuration = 0
        self._controller.reset_endpoints()

    def bulk_out(self, endpoint: int, packet: bytes) -> Handshake:
        """Take one packet of at most 512 bytes."""
        if not self.configuration or endpoint != ENDPOINT_OUT:
            return Handshake.STALL
        if not self._controller.can_accept:
            return Handshake.NAK
        if packet:  # an empty packet carries no block
            self._controller.accept(packet)
        return Handshake.ACK

    def bulk_in(self, endpoint: int) -> bytes | Handshake:
        """Give one packet, or say why there is none."""
        if not self.configuration or endpoint != ENDPOINT_IN:
            return Handshake.STALL
        return self._controller.take_records(BLOCK_BYTES) or Handshake.NAK
