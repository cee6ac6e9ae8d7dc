"""The device as a USB host sees it: attachment, control requests, endpoints, handshakes. It knows no transport.

Every door (an in-process backend, a network protocol, a simulated kernel) speaks to the device through `UsbDevice`,
which does what USB 2.0 asks of any device; what this device does on its interfaces is in `usb_functions`. A door lets
the time pass that the bus takes, and lets a host at the device only while it is attached and the bus not suspended.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import NamedTuple

from ...protocol.board import CYCLES_PER_MS
from ...protocol.codes import (
    CLASS_REQUEST_TYPE_IN,
    CLASS_REQUEST_TYPE_OUT,
    REQUEST_TYPE_IN,
    REQUEST_TYPE_OUT,
    StandardRequest,
)
from ...protocol.descriptors import Endpoint, Interface, descriptors
from ...protocol.enumeration import (
    ARRAY_INTERFACE,
    CONFIGURATION_VALUE,
    CONSOLE_DATA_INTERFACE,
    CONSOLE_INTERFACE,
    DFU_INTERFACE,
    HIGH_SPEED,
    MS_OS_INDEX,
    MS_OS_VENDOR_CODE,
    Enumeration,
    Speed,
    dfu_mode,
    run_time,
)
from ...protocol.requests import Setup
from ..door import Door, Handshake, Stall
from ..scheduler import Scheduler
from ..trace import Tracer
from .usb_functions import (
    ArrayFunction,
    ConsoleFunction,
    ConsoleLine,
    DfuModeFunction,
    DfuRunTimeFunction,
    FirmwareUpgrade,
    UsbController,
    UsbFunction,
    unknown,
)

__all__ = ["Flip", "UsbDevice"]

PRODUCT = "phasewire five-board array (emulated)"
AWAY_CYCLES = 20 * CYCLES_PER_MS
"""Off the bus between run-time mode and DFU mode; clause DFU-002 asks for at least 10 ms."""

_IN_DEVICE, _OUT_DEVICE = 0x80, 0x00
_IN_INTERFACE, _OUT_INTERFACE = 0x81, 0x01
_IN_ENDPOINT, _OUT_ENDPOINT = 0x82, 0x02
_VENDOR_IN_DEVICE = 0xC0
_TO_FUNCTIONS = (REQUEST_TYPE_IN, REQUEST_TYPE_OUT, CLASS_REQUEST_TYPE_IN, CLASS_REQUEST_TYPE_OUT)

_ENDPOINT_HALT, _TEST_MODE = 0, 2  # features (USB 2.0, table 9-6)
_CONTROL_ENDPOINT = (0x00, 0x80)
_GREATEST_ADDRESS = 127
_TESTS = range(1, 5)  # Test_J, Test_K, Test_SE0_NAK, Test_Packet (USB 2.0, table 9-7)
_NO_VERSION = (0, 0, 0)


class _Pipe(NamedTuple):
    """An endpoint of the configuration."""

    interface: int
    function: UsbFunction
    packet_bytes: int


class Flip(NamedTuple):
    """A bit that is wrong in the next packet of an endpoint that is long enough."""

    endpoint: int
    byte: int
    bit: int

    def of(self, packet: bytes) -> bytes:
        """A packet as it arrives."""
        return packet[: self.byte] + bytes([packet[self.byte] ^ 1 << self.bit]) + packet[self.byte + 1 :]


class UsbDevice:
    """The device's USB side. It outlives restarts of the device: whoever drives the machine connects it anew.

    Parameters
    ----------
    scheduler : Scheduler
        The clock of the machine.
    serial : str
        Serial number, in the string descriptors: 1 to 64 letters, digits, dots, hyphens and underscores.
    speed : Speed
        Speed of the bus: `HIGH_SPEED` or `FULL_SPEED` (clause USB-010).
    enter_dfu : callable
        What ends run-time mode and gives what answers in DFU mode; called when the device leaves the bus after DETACH.
    restart : callable
        Boots the device; called when a bus reset ends DFU mode, after the device has left the bus (clause DFU-015).
    tracer : Tracer
        What is told when blocks come.

    Attributes
    ----------
    generation : int
        Grows with each attachment to the bus; a host enumerates anew when it does.
    enumeration : Enumeration
        The descriptors.
    address : int
        The address that SET_ADDRESS gave, 0 after a bus reset.
    configuration : int
        1, or 0 while the device is not configured.
    suspended : bool
        Whether the bus is suspended; it carries nothing then.
    deaf : bool
        Whether nothing that a host sends arrives: packets are answered with NAK, requests with STALL.
    flips : list of Flip
        Bits that will be wrong in packets to come, of each endpoint in this order.

    Raises
    ------
    ValueError
        If the serial number is otherwise.
    """

    def __init__(
        self,
        scheduler: Scheduler,
        serial: str,
        *,
        speed: Speed = HIGH_SPEED,
        enter_dfu: Callable[[], FirmwareUpgrade],
        restart: Callable[[], None],
        tracer: Tracer,
    ) -> None:
        self._scheduler = scheduler
        self._tracer = tracer
        self._serial = serial
        self.speed = speed
        self._enter_dfu = enter_dfu
        self._restart = restart
        self.enumeration = run_time(_NO_VERSION, PRODUCT, serial, speed)
        self.generation = 0
        self.address = 0
        self.configuration = 0
        self.suspended = False
        self.deaf = False
        self.flips: list[Flip] = []
        self._version = _NO_VERSION
        self._plugged = True
        self._pulled_up = False
        self._connection = 0  # advanced whenever the pull-up goes; what an earlier one has scheduled counts no more
        self._functions: Mapping[int, UsbFunction] = {}
        self._dfu: DfuRunTimeFunction | None = None
        self._pipes: Mapping[int, _Pipe] = {}
        self._halted: set[int] = set()
        self._requests: Mapping[tuple[int, int], Callable[[Setup], bytes]] = {
            (_IN_DEVICE, StandardRequest.GET_STATUS): self._device_status,
            (_OUT_DEVICE, StandardRequest.SET_FEATURE): self._test,
            (_OUT_DEVICE, StandardRequest.SET_ADDRESS): self._set_address,
            (_IN_DEVICE, StandardRequest.GET_DESCRIPTOR): self._descriptor,
            (_IN_DEVICE, StandardRequest.GET_CONFIGURATION): self._get_configuration,
            (_OUT_DEVICE, StandardRequest.SET_CONFIGURATION): self._set_configuration,
            (_IN_INTERFACE, StandardRequest.GET_STATUS): self._interface_status,
            (_IN_INTERFACE, StandardRequest.GET_INTERFACE): self._get_interface,
            (_OUT_INTERFACE, StandardRequest.SET_INTERFACE): self._set_interface,
            (_IN_ENDPOINT, StandardRequest.GET_STATUS): self._endpoint_status,
            (_OUT_ENDPOINT, StandardRequest.SET_FEATURE): self._halt,
            (_OUT_ENDPOINT, StandardRequest.CLEAR_FEATURE): self._clear_halt,
            (_VENDOR_IN_DEVICE, MS_OS_VENDOR_CODE): self._ms_os_descriptors,
        }

    # What the machine does with it

    def connect(self, controller: UsbController, line: ConsoleLine, version: tuple[int, int, int]) -> None:
        """Come up in run-time mode.

        Parameters
        ----------
        controller : UsbController
            What stands behind interface 0; it notifies the device from now on.
        line : ConsoleLine
            What stands behind the console.
        version : (int, int, int)
            Version of the firmware that runs.
        """
        self.disconnect()
        array = ArrayFunction(self._scheduler, controller, self.speed.bulk_bytes, self._tracer)
        console = ConsoleFunction(line, self.speed.bulk_bytes)
        leave = partial(self._leave_for_dfu, self._connection)
        self._dfu = DfuRunTimeFunction(self._scheduler, controller, array, leave)
        self._version = version
        functions: dict[int, UsbFunction] = {
            ARRAY_INTERFACE: array,
            CONSOLE_INTERFACE: console,
            CONSOLE_DATA_INTERFACE: console,
            DFU_INTERFACE: self._dfu,
        }
        self._pull_up(run_time(version, PRODUCT, self._serial, self.speed), functions)

    def disconnect(self) -> None:
        """Leave the bus: the device restarts, or has no power. Nothing that was behind the interfaces is told."""
        self._pulled_up = False
        self._connection += 1
        self._functions = {}
        self._dfu = None
        self._pipes = {}
        self._unaddress()

    def detach(self, door: Door) -> None:
        """Do what the request DETACH does, as another door asks (clause DFU-002).

        Raises
        ------
        Stall
            If the device's state does not allow it, or it is not in run-time mode.
        """
        if self._dfu is None:
            raise Stall("only a device in run-time mode can be detached")
        self._dfu.detach(door)

    def _leave_for_dfu(self, connection: int) -> None:
        if connection != self._connection:
            return  # it has restarted, or left already
        self.disconnect()
        come_back = partial(self._come_back, self._connection, self._enter_dfu())
        self._scheduler.at(self._scheduler.now + AWAY_CYCLES, come_back)

    def _come_back(self, connection: int, upgrade: FirmwareUpgrade) -> None:
        if connection == self._connection:
            functions = {0: DfuModeFunction(upgrade, self._boot)}
            self._pull_up(dfu_mode(self._version, PRODUCT, self._serial), functions)

    def _boot(self) -> None:
        self.disconnect()
        self._restart()

    def _pull_up(self, enumeration: Enumeration, functions: Mapping[int, UsbFunction]) -> None:
        self.enumeration = enumeration
        self._functions = functions
        self._pipes = _pipes(enumeration.configuration, functions)
        self._pulled_up = True
        if self._plugged:
            self.generation += 1

    def _unaddress(self) -> None:
        self.address = self.configuration = 0
        self.suspended = False

    # What the bus does

    @property
    def attached(self) -> bool:
        """Whether a host sees it: there is voltage on the bus, and the pull-up is connected (clause USB-022)."""
        return self._plugged and self._pulled_up

    def plug(self) -> None:
        """The bus has voltage."""
        if not self._plugged:
            self._plugged = True
            if self._pulled_up:
                self.generation += 1

    def unplug(self) -> None:
        """The voltage of the bus goes away, and the configuration with it (clause STA-006)."""
        if self._plugged:
            self._plugged = False
            self._unaddress()
            self._tell(lambda function: function.unplug())

    def reset(self) -> None:
        """A bus reset has come to its end; it took 10 ms at least (USB 2.0, 7.1.7.5)."""
        self.resume()
        self._unaddress()
        self._tell(lambda function: function.bus_reset())

    def suspend(self) -> None:
        """The bus has been idle for 3 ms (USB 2.0, 7.1.7.6)."""
        if not self.suspended:
            self.suspended = True
            self._tell(lambda function: function.suspend())

    def resume(self) -> None:
        """The bus is idle no more."""
        if self.suspended:
            self.suspended = False
            self._tell(lambda function: function.resume())

    def halt(self, endpoint: int) -> None:
        """Halt an endpoint without being asked to; nothing happens if the configuration has none like it."""
        if self.configuration and endpoint in self._pipes:
            self._halted.add(endpoint)

    def _tell(self, event: Callable[[UsbFunction], None]) -> None:
        for function in dict.fromkeys(self._functions.values()):  # once each, in the order of their interfaces
            event(function)

    # Transactions

    def bulk_out(self, endpoint: int, packet: bytes) -> Handshake:
        """Take one packet.

        Raises
        ------
        ValueError
            If it is longer than the endpoint's largest.
        """
        pipe = self._running(endpoint)
        if pipe is None or endpoint not in pipe.function.outs:
            return Handshake.STALL
        if len(packet) > pipe.packet_bytes:
            raise ValueError(
                f"a packet to endpoint 0x{endpoint:02x} has at most {pipe.packet_bytes} bytes, not {len(packet)}"
            )
        if self.deaf:
            return Handshake.NAK
        flip = self._flip(endpoint, packet)
        handshake = pipe.function.outs[endpoint](flip.of(packet) if flip else packet)
        if flip and handshake is Handshake.ACK:
            self.flips.remove(flip)
        return handshake

    def stream_out(self, endpoint: int, data: memoryview, began: int, deadline: int) -> tuple[int, int]:
        """Take as many of the packets of a long transfer at once as can be (see `Controller.take`).

        Parameters
        ----------
        endpoint : int
            Address of an OUT endpoint.
        data : memoryview
            What the transfer has left.
        began : int
            Core cycle at which the first of the packets began.
        deadline : int
            Core cycle by which the last must have arrived.

        Returns
        -------
        taken : int
            Bytes; each packet as `bulk_out` would have taken it, in its time. 0 if there is nothing to gain.
        ended : int
            Core cycle at which the last of them had arrived; time may have passed further.
        """
        pipe = self._running(endpoint)
        if pipe is None or endpoint not in pipe.function.streams or self.deaf or self.flips:
            return 0, began
        return pipe.function.streams[endpoint](data, began, deadline)

    def bulk_in(self, endpoint: int) -> bytes | Handshake:
        """Give one packet of a bulk or interrupt endpoint, which may be empty, or say why there is none."""
        pipe = self._running(endpoint)
        if pipe is None or endpoint not in pipe.function.ins:
            return Handshake.STALL
        if self.deaf:
            return Handshake.NAK
        packet = pipe.function.ins[endpoint]()
        flip = self._flip(endpoint, packet) if isinstance(packet, bytes) else None
        if flip is None or not isinstance(packet, bytes):
            return packet
        self.flips.remove(flip)
        return flip.of(packet)

    def _flip(self, endpoint: int, packet: bytes) -> Flip | None:
        return next((flip for flip in self.flips if flip.endpoint == endpoint and flip.byte < len(packet)), None)

    def _running(self, endpoint: int) -> _Pipe | None:
        return self._pipes.get(endpoint) if self.configuration and endpoint not in self._halted else None

    def control(self, setup: Setup, data: bytes = b"") -> bytes:
        """Carry out a control transfer with its OUT data stage and return its IN data stage.

        Raises
        ------
        Stall
            If the device does not know the request, or not with these values, or not now (clause USB-004).
        """
        if self.deaf:
            raise Stall("nothing that the host sends arrives")
        handler = self._requests.get((setup.request_type, setup.request))
        if handler is None:
            answer = self._ask_function(setup, data)
        elif setup.length and not setup.is_in:
            raise Stall(f"a standard request has no data for the device; this one has {setup.length} bytes")
        else:
            answer = handler(setup)
        return answer[: setup.length]

    def _ask_function(self, setup: Setup, data: bytes) -> bytes:
        """Have a class or vendor request to an interface carried out."""
        if setup.request_type not in _TO_FUNCTIONS:
            raise unknown(setup)
        return self._function(setup).request(setup, data)

    def _function(self, setup: Setup) -> UsbFunction:
        """What stands behind the interface that a request goes to."""
        if not self.configuration:
            raise Stall("interfaces need a configured device")
        if setup.index not in self._functions:
            raise Stall(f"there is no interface {setup.index}")
        return self._functions[setup.index]

    def _pipe(self, setup: Setup) -> _Pipe:
        """The endpoint that a request goes to."""
        if not self.configuration:
            raise Stall("endpoints other than the control endpoint need a configured device")
        if setup.index not in self._pipes:
            raise Stall(f"there is no endpoint 0x{setup.index:02x}")
        return self._pipes[setup.index]

    # Standard requests (clause USB-014)

    def _device_status(self, setup: Setup) -> bytes:
        _expect(setup, value=0, index=0)
        return b"\x01\x00"  # self-powered

    def _interface_status(self, setup: Setup) -> bytes:
        self._function(setup)
        _expect(setup, value=0)
        return b"\x00\x00"

    def _endpoint_status(self, setup: Setup) -> bytes:
        if setup.index not in _CONTROL_ENDPOINT:  # which is always there, and never halted
            self._pipe(setup)
        _expect(setup, value=0)
        return bytes([setup.index in self._halted, 0])

    def _test(self, setup: Setup) -> bytes:
        """Enter a test mode: the device answers nothing any more until its power comes back (USB 2.0, 9.4.9)."""
        _expect(setup, value=_TEST_MODE)
        test, rest = divmod(setup.index, 256)
        if test not in _TESTS or rest or self.speed != HIGH_SPEED:
            raise Stall(f"there is no test {test}, or not at this speed")
        self.disconnect()
        return b""

    def _set_address(self, setup: Setup) -> bytes:
        _expect(setup, index=0)
        if setup.value > _GREATEST_ADDRESS:
            raise Stall(f"an address is 0 to {_GREATEST_ADDRESS}, not {setup.value}")
        self.address = setup.value
        return b""

    def _descriptor(self, setup: Setup) -> bytes:
        kind, index = divmod(setup.value, 256)
        descriptor = self.enumeration.find(kind, index, language=setup.index)
        if descriptor is None:
            raise Stall(f"there is no descriptor {kind}/{index}")
        return descriptor

    def _ms_os_descriptors(self, setup: Setup) -> bytes:
        _expect(setup, value=0, index=MS_OS_INDEX)
        return self.enumeration.ms_os

    def _get_configuration(self, setup: Setup) -> bytes:
        _expect(setup, value=0, index=0)
        return bytes([self.configuration])

    def _set_configuration(self, setup: Setup) -> bytes:
        _expect(setup, index=0)
        if setup.value not in (0, CONFIGURATION_VALUE):
            raise Stall(f"there is no configuration {setup.value}")
        self.configuration = setup.value
        self._halted.clear()
        self._tell(lambda function: function.configure(setup.value))
        return b""

    def _get_interface(self, setup: Setup) -> bytes:
        self._function(setup)
        _expect(setup, value=0)
        return b"\x00"

    def _set_interface(self, setup: Setup) -> bytes:
        function = self._function(setup)
        _expect(setup, value=0)
        self._halted -= {endpoint for endpoint, pipe in self._pipes.items() if pipe.interface == setup.index}
        function.set_interface()
        return b""

    def _halt(self, setup: Setup) -> bytes:
        self._pipe(setup)
        _expect(setup, value=_ENDPOINT_HALT)
        self._halted.add(setup.index)
        return b""

    def _clear_halt(self, setup: Setup) -> bytes:
        pipe = self._pipe(setup)
        _expect(setup, value=_ENDPOINT_HALT)
        self._halted.discard(setup.index)
        pipe.function.clear_halt(setup.index)
        return b""


def _expect(setup: Setup, *, value: int | None = None, index: int | None = None) -> None:
    """Refuse a request with another value or index than the only one that it may have."""
    if value not in (None, setup.value) or index not in (None, setup.index):
        raise unknown(setup)


def _pipes(configuration: bytes, functions: Mapping[int, UsbFunction]) -> dict[int, _Pipe]:
    """The endpoints that a configuration describes, by their addresses."""
    return {
        endpoint.bEndpointAddress: _Pipe(interface, functions[interface], endpoint.wMaxPacketSize)
        for interface, endpoint in _endpoints(configuration)
    }


@cache
def _endpoints(configuration: bytes) -> list[tuple[int, Endpoint]]:
    """The endpoints of a configuration, each with the number of its interface."""
    endpoints, interface = [], 0
    for descriptor in descriptors(configuration):
        if isinstance(descriptor, Interface):
            interface = descriptor.bInterfaceNumber
        elif isinstance(descriptor, Endpoint):
            endpoints.append((interface, descriptor))
    return endpoints
