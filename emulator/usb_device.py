"""The device as a USB host sees it: control requests, endpoints and their handshakes. It knows no transport.

It runs at high speed. Of the console and of DFU there is as much as enumeration needs: no text comes or is taken, and
the device cannot be detached.

Every door (an in-process backend, a network protocol, a simulated kernel) speaks to the device through this class.
"""

from __future__ import annotations

from collections.abc import Callable

from ..protocol.codes import (
    CLASS_REQUEST_TYPE_IN,
    CLASS_REQUEST_TYPE_OUT,
    REQUEST_TYPE_IN,
    REQUEST_TYPE_OUT,
    DfuRequest,
    DfuState,
    DfuStatus,
    Request,
    StandardRequest,
)
from ..protocol.dfu import DfuReply
from ..protocol.enumeration import (
    ARRAY_INTERFACE,
    CONFIGURATION_VALUE,
    CONSOLE_DATA_INTERFACE,
    CONSOLE_ENDPOINT_IN,
    CONSOLE_ENDPOINT_NOTIFICATION,
    CONSOLE_ENDPOINT_OUT,
    CONSOLE_INTERFACE,
    DFU_INTERFACE,
    ENDPOINT_IN,
    ENDPOINT_OUT,
    MS_OS_INDEX,
    MS_OS_VENDOR_CODE,
    run_time,
)
from ..protocol.framing import BAUD
from ..protocol.layout.usb import LINE_CODING
from ..protocol.requests import VALUES, ConsoleRequest, Setup
from .controller import RECORDS, Controller

FIRMWARE = (0, 1, 0)
from collections import deque

from .door import Handshake, Stall

__all__ = ["UsbDevice"]


_STANDARD_IN_DEVICE, _STANDARD_OUT_DEVICE = 0x80, 0x00
_STANDARD_IN_INTERFACE, _STANDARD_OUT_INTERFACE = 0x81, 0x01
_STANDARD_IN_ENDPOINT, _STANDARD_OUT_ENDPOINT = 0x82, 0x02
_VENDOR_IN_DEVICE = 0xC0

_ENDPOINT_HALT = 0
_ENDPOINTS = {
    ARRAY_INTERFACE: {ENDPOINT_OUT, ENDPOINT_IN},
    CONSOLE_INTERFACE: {CONSOLE_ENDPOINT_NOTIFICATION},
    CONSOLE_DATA_INTERFACE: {CONSOLE_ENDPOINT_OUT, CONSOLE_ENDPOINT_IN},
    DFU_INTERFACE: set[int](),
}

# Class requests, by interface, type and number.
_SET_LINE_CODING = (CONSOLE_INTERFACE, CLASS_REQUEST_TYPE_OUT, ConsoleRequest.SET_LINE_CODING)
_GET_LINE_CODING = (CONSOLE_INTERFACE, CLASS_REQUEST_TYPE_IN, ConsoleRequest.GET_LINE_CODING)
_SET_CONTROL_LINE_STATE = (CONSOLE_INTERFACE, CLASS_REQUEST_TYPE_OUT, ConsoleRequest.SET_CONTROL_LINE_STATE)
_DFU_GETSTATUS = (DFU_INTERFACE, CLASS_REQUEST_TYPE_IN, DfuRequest.GETSTATUS)
_DFU_GETSTATE = (DFU_INTERFACE, CLASS_REQUEST_TYPE_IN, DfuRequest.GETSTATE)
_115200_8N1 = {"dwDTERate": BAUD, "bCharFormat": 0, "bParityType": 0, "bDataBits": 8}
_DFU_OK_IN_APP_IDLE = DfuReply(DfuStatus.OK, 0, DfuState.APP_IDLE).encode()
_DFU_APP_IDLE = bytes([DfuState.APP_IDLE])


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
        self.enumeration = run_time(FIRMWARE, "phasewire five-board array (emulated)", serial)
        self.configuration = 0
        self._halted: set[int] = set()
        self._records = deque()
        self._unasked = b""
        controller.attach(self)
        self._line_coding = bytes(LINE_CODING.build(_115200_8N1))
        self._handlers: dict[tuple[int, int], Callable[[Setup], bytes]] = {
            (_STANDARD_IN_DEVICE, StandardRequest.GET_STATUS): lambda _: b"\x01\x00",  # self-powered
            (_STANDARD_IN_DEVICE, StandardRequest.GET_DESCRIPTOR): self._descriptor,
            (_STANDARD_IN_DEVICE, StandardRequest.GET_CONFIGURATION): lambda _: bytes([self.configuration]),
            (_STANDARD_OUT_DEVICE, StandardRequest.SET_CONFIGURATION): self._set_configuration,
            (_STANDARD_IN_INTERFACE, StandardRequest.GET_STATUS): self._interface_status,
            (_STANDARD_IN_INTERFACE, StandardRequest.GET_INTERFACE): self._interface_setting,
            (_STANDARD_OUT_INTERFACE, StandardRequest.SET_INTERFACE): self._set_interface,
            (_STANDARD_IN_ENDPOINT, StandardRequest.GET_STATUS): self._endpoint_status,
            (_STANDARD_OUT_ENDPOINT, StandardRequest.SET_FEATURE): self._halt,
            (_STANDARD_OUT_ENDPOINT, StandardRequest.CLEAR_FEATURE): self._clear_halt,
            (_VENDOR_IN_DEVICE, MS_OS_VENDOR_CODE): self._ms_os_descriptors,
        }

    def control(self, setup: Setup, data: bytes = b"") -> bytes:
        """Carry out a control transfer with its OUT data stage and return its IN data stage.

        Raises
        ------
        Stall
            Where the device does not know the request.
        """
        if setup.request_type in (CLASS_REQUEST_TYPE_IN, CLASS_REQUEST_TYPE_OUT):
            return self._class_request(setup, data)[: setup.length]
        if setup.request_type in (REQUEST_TYPE_IN, REQUEST_TYPE_OUT):
            if not self.configuration:
                raise Stall("not configured")
            return self._controller.request(setup, data)
        handler = self._handlers.get((setup.request_type, setup.request))
        if handler is None:
            raise Stall(f"request 0x{setup.request:02x} of type 0x{setup.request_type:02x} is unknown")
        is_vendor_request = setup.request_type in (REQUEST_TYPE_IN, REQUEST_TYPE_OUT)
        if is_vendor_request:
            self._check_vendor_request(setup)
        return handler(setup)[: setup.length]

    def _check_vendor_request(self, setup: Setup) -> None:
        request = Request(setup.request)
        values = VALUES.get(request, range(1))
        if not self.configuration:
            raise Stall(f"{request.name} needs a configured device")
        if setup.index or setup.value not in values:
            raise Stall(
                f"{request.name} has index 0 and value {values[0]} to {values[-1]}, not index {setup.index} and value "
                f"{setup.value}"
            )
        if setup.request_type == REQUEST_TYPE_OUT and setup.length:
            raise Stall(f"no vendor request takes data, and this one is sent with {setup.length} bytes")

    def _descriptor(self, setup: Setup) -> bytes:
        kind, index = divmod(setup.value, 256)
        descriptor = self.enumeration.find(kind, index, language=setup.index)
        if descriptor is None:
            raise Stall(f"there is no descriptor {kind}/{index}")
        return descriptor

    def _ms_os_descriptors(self, setup: Setup) -> bytes:
        if (setup.value, setup.index) != (0, MS_OS_INDEX):
            raise Stall(f"Microsoft's descriptors have value 0 and index {MS_OS_INDEX}")
        return self.enumeration.ms_os

    def _set_configuration(self, setup: Setup) -> bytes:
        if setup.value not in (0, CONFIGURATION_VALUE):
            raise Stall(f"there is no configuration {setup.value}")
        self.configuration = setup.value
        self._reset_endpoints()
        return b""

    def _interface_status(self, setup: Setup) -> bytes:
        self._check_interface(setup)
        return b"\x00\x00"

    def _interface_setting(self, setup: Setup) -> bytes:
        self._check_interface(setup)
        return b"\x00"

    def _set_interface(self, setup: Setup) -> bytes:
        self._check_interface(setup)
        if setup.value != 0:
            raise Stall(f"interface {setup.index} has no setting {setup.value}")
        self._halted -= _ENDPOINTS[setup.index]
        if setup.index == ARRAY_INTERFACE:
            self._controller.new_session()
            self._records.clear()
            self._unasked = b""
        return b""

    def _check_interface(self, setup: Setup) -> None:
        if not self.configuration or setup.index not in _ENDPOINTS:
            raise Stall(f"there is no interface {setup.index}, or the device is not configured")

    def _endpoint_status(self, setup: Setup) -> bytes:
        if setup.index & 0x7F:  # the control endpoint is always there, and never halted
            self._check_endpoint(setup)
        return bytes([setup.index in self._halted, 0])

    def _halt(self, setup: Setup) -> bytes:
        self._check_endpoint(setup)
        self._halted.add(setup.index)
        return b""

    def _clear_halt(self, setup: Setup) -> bytes:
        self._check_endpoint(setup)
        self._halted.discard(setup.index)
        return b""

    def _check_endpoint(self, setup: Setup) -> None:
        there = self.configuration and any(setup.index in endpoints for endpoints in _ENDPOINTS.values())
        if not there or setup.value != _ENDPOINT_HALT:
            raise Stall(f"there is no endpoint 0x{setup.index:02x} with feature {setup.value}, or no configuration")

    def _class_request(self, setup: Setup, data: bytes) -> bytes:
        """Carry out a request of the console or of DFU, as far as these are emulated."""
        self._check_interface(setup)
        request = (setup.index, setup.request_type, setup.request)
        if request == _SET_LINE_CODING and len(data) == len(self._line_coding):
            self._line_coding = data
            return b""
        answers = {
            _GET_LINE_CODING: self._line_coding,
            _SET_CONTROL_LINE_STATE: b"",
            _DFU_GETSTATUS: _DFU_OK_IN_APP_IDLE,
            _DFU_GETSTATE: _DFU_APP_IDLE,
        }
        if request not in answers:
            raise Stall(f"interface {setup.index} does not know request 0x{setup.request:02x}, or not like this")
        return answers[request]

    def _status(self, _: Setup) -> bytes:
        self._controller.feed_watchdog()
        return self._controller.status().encode()

    def _set_watchdog(self, setup: Setup) -> bytes:
        self._controller.set_watchdog(setup.value)
        return b""

    def _set_limit(self, setup: Setup) -> bytes:
        if not self._controller.set_limit(setup.value):
            raise Stall("a limit is set while the outputs are off")
        return b""

    def _identify(self, setup: Setup) -> bytes:
        self._controller.identify(setup.value)
        return b""

    @staticmethod
    def _order(action: Callable[[], None]) -> bytes:
        action()
        return b""

    def reset(self) -> None:
        """The bus was reset: not configured any more, and the outputs off."""
        self.configuration = 0
        self._reset_endpoints()

    def _reset_endpoints(self) -> None:
        self._halted.clear()
        self._controller.new_session()
        self._records.clear()
        self._unasked = b""

    def bulk_out(self, endpoint: int, packet: bytes) -> Handshake:
        """Take one packet of at most 512 bytes."""
        if endpoint not in (ENDPOINT_OUT, CONSOLE_ENDPOINT_OUT) or not self._runs(endpoint):
            return Handshake.STALL
        if endpoint == CONSOLE_ENDPOINT_OUT or not self._controller.can_accept or len(self._records) >= RECORDS:
            return Handshake.NAK
        if packet:  # an empty packet carries no block
            self._controller.accept(packet, self)
        return Handshake.ACK

    def bulk_in(self, endpoint: int) -> bytes | Handshake:
        """Give one packet of a bulk or interrupt endpoint, or say why there is none."""
        known = (ENDPOINT_IN, CONSOLE_ENDPOINT_NOTIFICATION, CONSOLE_ENDPOINT_IN)
        if endpoint not in known or not self._runs(endpoint):
            return Handshake.STALL
        if endpoint != ENDPOINT_IN:
            return Handshake.NAK
        packet = b""
        while self._records and len(packet) + 32 <= 512:
            packet += self._records.popleft()
        if len(packet) + len(self._unasked) <= 512:
            packet += self._unasked
            self._unasked = b""
        return packet or Handshake.NAK

    def acknowledge(self, record):
        self._records.append(record)

    def notify(self, record):
        self._unasked = record

    def _runs(self, endpoint: int) -> bool:
        return bool(self.configuration) and endpoint not in self._halted
