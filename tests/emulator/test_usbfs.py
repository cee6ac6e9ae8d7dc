"""usbfs by <linux/usbdevice_fs.h> and the kernel; numbers and structures are literal here."""

from __future__ import annotations

import errno
import struct

import pytest
from phasewire import Emulator
from phasewire.emulator.door import Stall
from phasewire.emulator.doors.usbdevice_fs import Ioctl
from phasewire.emulator.doors.usbfs import KernelDevice
from phasewire.protocol.enumeration import FULL_SPEED

MS = 400_000  # core cycles

# type, endpoint, status, flags, buffer, buffer_length, actual_length, start_frame, packets, errors, signr, usercontext
URB = struct.Struct("<BBxxiIxxxxQiiiiiIQ")
INTERRUPT, CONTROL, BULK = 1, 2, 3
SHORT_NOT_OK, ZERO_PACKET = 0x01, 0x40

GET_DEVICE_DESCRIPTOR = struct.pack("<BBHHH", 0x80, 6, 0x0100, 0, 18)
STALLED = struct.pack("<BBHHH", 0xC1, 0x77, 0, 0, 4)


class Program:
    """A program that has a device open: its memory, and its calls."""

    def __init__(self, device: KernelDevice) -> None:
        self.memory: dict[int, bytearray] = {}
        self._device = device
        self.changes: list[bool] = []
        self.file = device.open(lambda: self.changes.append(self.file.writable))
        self.results: list[int] = []

    def allocate(self, content: bytes) -> int:
        address = 0x7F00_0000_0000 + 0x10000 * len(self.memory)
        self.memory[address] = bytearray(content)
        return address

    def read(self, address: int, size: int) -> bytes:
        return bytes(self._block(address)[address % 0x10000 :][:size])

    def write(self, address: int, data: bytes) -> None:
        at = address % 0x10000
        block = self._block(address)
        assert at + len(data) <= len(block), "written beyond what the program gave"
        block[at : at + len(data)] = data

    def _block(self, address: int) -> bytearray:
        return self.memory[address - address % 0x10000]

    def begin(self, request: int, argument: int | bytes = 0) -> int:
        """Make a call; returns the address of its argument."""
        address = argument if isinstance(argument, int) else self.allocate(argument)
        self.file.ioctl(request, address, self, self.results.append)
        return address

    def call(self, request: int, argument: int | bytes = 0) -> int:
        """The result of a call that returns at once."""
        count = len(self.results)
        self.begin(request, argument)
        assert len(self.results) == count + 1, "the call has not returned"
        return self.results[-1]

    def urb(self, kind: int, endpoint: int, data: bytes, flags: int = 0, length: int | None = None) -> bytes:
        size = len(data) if length is None else length
        return URB.pack(kind, endpoint, 0, flags, self.allocate(data), size, 0, 0, 0, 0, 0, 0x1234)

    def submit(self, kind: int, endpoint: int, data: bytes, flags: int = 0) -> int:
        """Submit a transfer that must be taken; returns its address."""
        address = self.allocate(self.urb(kind, endpoint, data, flags))
        assert self.call(Ioctl.SUBMITURB, address) == 0
        return address

    def reap(self) -> tuple[int, int, bytes]:
        """Address and status of a transfer that has ended, and the bytes transferred."""
        pointer = self.allocate(bytes(8))
        assert self.call(Ioctl.REAPURBNDELAY, pointer) == 0
        address = int.from_bytes(self.read(pointer, 8), "little")
        fields = URB.unpack(self.read(address, URB.size))
        assert fields[-1] == 0x1234
        return address, fields[2], self.read(fields[4], fields[6] + 8)[8 if fields[0] == CONTROL else 0 :][: fields[6]]

    def wait(self, cycles: int = MS) -> None:
        self._device.run_until(self._device.scheduler.now + cycles)


@pytest.fixture
def machine() -> Emulator:
    return Emulator(serial="K-1")


@pytest.fixture
def device(machine: Emulator) -> KernelDevice:
    return KernelDevice(machine.usb, machine.scheduler, address=7)


@pytest.fixture
def program(device: KernelDevice) -> Program:
    return Program(device)


def test_numbers_are_those_of_the_header() -> None:
    """As a C compiler computes them on x86-64."""
    assert {request.name: hex(request) for request in Ioctl} == {
        "CONTROL": "0xc0185500",
        "BULK": "0xc0185502",
        "RESETEP": "0x80045503",
        "SETINTERFACE": "0x80085504",
        "SETCONFIGURATION": "0x80045505",
        "GETDRIVER": "0x41045508",
        "SUBMITURB": "0x8038550a",
        "DISCARDURB": "0x550b",
        "REAPURB": "0x4008550c",
        "REAPURBNDELAY": "0x4008550d",
        "CLAIMINTERFACE": "0x8004550f",
        "RELEASEINTERFACE": "0x80045510",
        "CONNECTINFO": "0x40085511",
        "IOCTL": "0xc0105512",
        "RESET": "0x5514",
        "CLEAR_HALT": "0x80045515",
        "DISCONNECT": "0x5516",
        "CONNECT": "0x5517",
        "GET_CAPABILITIES": "0x8004551a",
        "DISCONNECT_CLAIM": "0x8108551b",
        "GET_SPEED": "0x551f",
    }


def test_a_control_transfer_is_reaped_when_it_has_ended(program: Program) -> None:
    address = program.submit(CONTROL, 0x00, GET_DEVICE_DESCRIPTOR + bytes(18))
    assert program.call(Ioctl.REAPURBNDELAY, bytes(8)) == -errno.EAGAIN
    program.wait()
    assert program.file.writable
    assert program.reap() == (address, 0, Emulator().usb.enumeration.device.encode())
    assert not program.file.writable
    assert program.changes == [True, False]


def test_a_call_can_wait_for_a_transfer(program: Program) -> None:
    pointer = program.begin(Ioctl.REAPURB, bytes(8))
    assert program.results == []
    # Another thread's call; it does not return what the first waits for.
    address = program.submit(CONTROL, 0x80, GET_DEVICE_DESCRIPTOR + bytes(18))
    program.wait()
    assert program.results[-1] == 0
    assert int.from_bytes(program.read(pointer, 8), "little") == address
    assert not program.file.writable


def test_a_transfer_is_cancelled(program: Program) -> None:
    address = program.submit(BULK, 0x81, bytes(64))
    assert program.call(Ioctl.DISCARDURB, address) == 0
    assert program.reap() == (address, -errno.ENOENT, b"")
    assert program.call(Ioctl.DISCARDURB, address) == -errno.EINVAL


@pytest.mark.parametrize(
    ("room", "flags", "status", "received"),
    [(64, 0, 0, 32), (64, SHORT_NOT_OK, -errno.EREMOTEIO, 32), (32, SHORT_NOT_OK, 0, 32), (16, 0, -errno.EOVERFLOW, 0)],
)
def test_the_limit_of_submitted_bytes(program: Program, room: int, flags: int, status: int, received: int) -> None:
    program.submit(BULK, 0x01, bytes(512))
    program.submit(BULK, 0x81, bytes(room), flags)
    program.wait()
    program.reap()
    _, ended, data = program.reap()
    assert (ended, len(data)) == (status, received)


def test_a_stall_is_reported(program: Program) -> None:
    program.submit(CONTROL, 0x00, STALLED + bytes(4))
    program.wait()
    assert program.reap()[1] == -errno.EPIPE
    assert program.call(Ioctl.CLEAR_HALT, struct.pack("<I", 0x81)) == 0
    halt = struct.pack("<BBHHH", 0x02, 3, 0, 0x81, 0)
    program.submit(CONTROL, 0x00, halt)
    program.submit(BULK, 0x81, bytes(64))
    program.wait()
    assert [program.reap()[1] for _ in range(2)] == [0, -errno.EPIPE]


def control(program: Program, setup: bytes, room: int) -> tuple[bytes, int]:
    """struct usbdevfs_ctrltransfer for a second at most, and its buffer."""
    buffer = program.allocate(bytes(room))
    return struct.pack("<8sIxxxxQ", setup, 1000, buffer), buffer


def bulk(program: Program, endpoint: int, data: bytes, timeout_ms: int) -> tuple[bytes, int]:
    """struct usbdevfs_bulktransfer, and its buffer."""
    buffer = program.allocate(data)
    return struct.pack("<IIIxxxxQ", endpoint, len(data), timeout_ms, buffer), buffer


def test_a_program_waits_for_a_control_transfer(program: Program) -> None:
    argument, buffer = control(program, GET_DEVICE_DESCRIPTOR, 18)
    program.begin(Ioctl.CONTROL, argument)
    assert program.results == []
    program.wait()
    assert program.results == [18]
    assert program.read(buffer, 18)[:2] == b"\x12\x01"
    program.begin(Ioctl.CONTROL, control(program, STALLED, 4)[0])
    program.wait()
    assert program.results == [18, -errno.EPIPE]


def test_a_program_waits_for_a_bulk_transfer_until_its_time_out(program: Program) -> None:
    argument, buffer = bulk(program, 0x81, bytes(64), timeout_ms=20)
    program.begin(Ioctl.BULK, argument)
    program.wait(19 * MS)
    assert program.results == []
    program.wait(2 * MS)
    assert program.results == [-errno.ETIMEDOUT]
    program.begin(Ioctl.BULK, bulk(program, 0x01, bytes(512), timeout_ms=20)[0])
    program.begin(Ioctl.BULK, argument)
    program.wait()
    assert program.results[1:] == [512, 32]
    assert program.read(buffer, 2) == b"PA"
    program.wait(30 * MS)  # the time-outs of transfers that have ended are forgotten
    assert len(program.results) == 3


@pytest.mark.parametrize(
    ("request_number", "argument", "code"),
    [
        (0x8038550B, b"", errno.ENOTTY),
        (Ioctl.CLAIMINTERFACE, struct.pack("<I", 4), errno.ENOENT),
        (Ioctl.CLAIMINTERFACE, struct.pack("<I", 64), errno.EINVAL),
        (Ioctl.RELEASEINTERFACE, struct.pack("<I", 4), errno.ENOENT),
        (Ioctl.RELEASEINTERFACE, struct.pack("<I", 0), errno.EINVAL),
        (Ioctl.SETCONFIGURATION, struct.pack("<I", 2), errno.EINVAL),
        (Ioctl.SETINTERFACE, struct.pack("<II", 0, 1), errno.EINVAL),
        (Ioctl.SETINTERFACE, struct.pack("<II", 4, 0), errno.ENOENT),
        (Ioctl.CLEAR_HALT, struct.pack("<I", 0x84), errno.ENOENT),
        (Ioctl.CLEAR_HALT, struct.pack("<I", 0x191), errno.EINVAL),
        (Ioctl.GETDRIVER, struct.pack("<I256x", 0), errno.ENODATA),
        (Ioctl.IOCTL, struct.pack("<iIQ", 0, 0x5516, 0), errno.ENODATA),  # DISCONNECT, and there is no driver
        (Ioctl.IOCTL, struct.pack("<iIQ", 4, 0x5516, 0), errno.EINVAL),
        (Ioctl.IOCTL, struct.pack("<iIQ", 0, 0x5520, 0), errno.ENOTTY),
        (Ioctl.DISCARDURB, b"", errno.EINVAL),
        (Ioctl.BULK, struct.pack("<IIIxxxxQ", 0x02, 0, 0, 0), errno.ENOENT),
    ],
)
def test_impossible_calls_are_refused(program: Program, request_number: int, argument: bytes, code: int) -> None:
    assert program.call(request_number, argument) == -code


@pytest.mark.parametrize(
    ("kind", "endpoint", "data", "flags", "code"),
    [
        (BULK, 0x02, bytes(64), 0, errno.ENOENT),
        (BULK, 0x81, bytes(64), 0x100, errno.EINVAL),
        (0, 0x81, bytes(64), 0, errno.EINVAL),  # isochronous
        (INTERRUPT, 0x81, bytes(64), 0, errno.EINVAL),
        (CONTROL, 0x81, bytes(64), 0, errno.EINVAL),
        (CONTROL, 0x00, bytes(7), 0, errno.EINVAL),
        (CONTROL, 0x00, GET_DEVICE_DESCRIPTOR + bytes(17), 0, errno.EINVAL),
        (CONTROL, 0x00, struct.pack("<BBHHH", 0xA1, 3, 0, 4, 6) + bytes(6), 0, errno.ENOENT),  # to no interface
        (CONTROL, 0x00, struct.pack("<BBHHH", 0x82, 0, 0, 0x84, 2) + bytes(2), 0, errno.ENOENT),  # to no endpoint
    ],
)
def test_invalid_transfers_are_refused(
    program: Program, kind: int, endpoint: int, data: bytes, flags: int, code: int
) -> None:
    assert program.call(Ioctl.SUBMITURB, program.urb(kind, endpoint, data, flags)) == -code


def test_a_bulk_transfer_suits_an_interrupt_endpoint(program: Program) -> None:
    program.submit(BULK, 0x82, bytes(16))
    program.submit(INTERRUPT, 0x82, bytes(16))


def test_an_interface_belongs_to_one_program(device: KernelDevice, program: Program) -> None:
    other = Program(device)
    interface = struct.pack("<I", 0)
    assert program.call(Ioctl.CLAIMINTERFACE, interface) == 0
    assert program.call(Ioctl.CLAIMINTERFACE, interface) == 0
    assert other.call(Ioctl.CLAIMINTERFACE, interface) == -errno.EBUSY
    assert other.call(Ioctl.SUBMITURB, other.urb(BULK, 0x81, bytes(64))) == -errno.EBUSY
    assert other.call(Ioctl.SETCONFIGURATION, struct.pack("<I", 1)) == -errno.EBUSY
    who = other.begin(Ioctl.GETDRIVER, struct.pack("<I256x", 0))
    assert (other.results[-1], other.read(who + 4, 6)) == (0, b"usbfs\0")
    program.file.close()
    assert other.call(Ioctl.CLAIMINTERFACE, interface) == 0


def test_an_interface_that_is_used_is_claimed(device: KernelDevice, program: Program) -> None:
    """As the kernel does, which then complains."""
    other = Program(device)
    program.submit(BULK, 0x81, bytes(64))
    to_interface = struct.pack("<BBHHH", 0x81, 10, 0, 0, 1) + bytes(1)
    assert other.call(Ioctl.SUBMITURB, other.urb(CONTROL, 0x00, to_interface)) == -errno.EBUSY
    vendor = struct.pack("<BBHHH", 0xC1, 1, 0, 0, 64) + bytes(64)
    other.submit(CONTROL, 0x00, vendor)  # vendor requests need no claim


def test_an_interface_is_taken_from_a_program(device: KernelDevice, program: Program) -> None:
    """libusb_detach_kernel_driver, and detach-and-claim: "usbfs" is a driver like any other."""
    other = Program(device)
    disconnect = struct.pack("<iIQ", 0, Ioctl.DISCONNECT, 0)
    connect = struct.pack("<iIQ", 0, Ioctl.CONNECT, 0)
    address = program.submit(BULK, 0x81, bytes(64))
    assert other.call(Ioctl.IOCTL, connect) == -errno.EBUSY
    assert other.call(Ioctl.IOCTL, disconnect) == 0
    assert program.reap() == (address, -errno.ENOENT, b"")
    assert other.call(Ioctl.IOCTL, connect) == 0
    assert program.call(Ioctl.CLAIMINTERFACE, struct.pack("<I", 0)) == 0
    if_other, except_usbfs, if_usbfs = (1, b"cdc_acm"), (2, b"usbfs"), (1, b"usbfs")
    for flags, driver in (if_other, except_usbfs):
        assert other.call(Ioctl.DISCONNECT_CLAIM, struct.pack("<II256s", 0, flags, driver)) == -errno.EBUSY
    flags, driver = if_usbfs
    assert other.call(Ioctl.DISCONNECT_CLAIM, struct.pack("<II256s", 0, flags, driver)) == 0
    assert program.call(Ioctl.CLAIMINTERFACE, struct.pack("<I", 0)) == -errno.EBUSY


def test_releasing_an_interface_ends_its_transfers(program: Program) -> None:
    mine, other = program.submit(BULK, 0x81, bytes(64)), program.submit(BULK, 0x83, bytes(64))
    assert program.call(Ioctl.RELEASEINTERFACE, struct.pack("<I", 0)) == 0
    assert program.reap()[:2] == (mine, -errno.ENOENT)
    assert program.call(Ioctl.REAPURBNDELAY, bytes(8)) == -errno.EAGAIN
    assert program.call(Ioctl.DISCARDURB, other) == 0


def test_calls_that_describe_the_device(machine: Emulator, program: Program) -> None:
    info = program.begin(Ioctl.CONNECTINFO, bytes(8))
    assert struct.unpack("<IB", program.read(info, 5)) == (7, 0)
    capabilities = program.begin(Ioctl.GET_CAPABILITIES, bytes(4))
    assert program.read(capabilities, 4) == struct.pack("<I", 0x01 | 0x04 | 0x10)
    assert program.call(Ioctl.GET_SPEED) == 3
    machine.usb.speed = FULL_SPEED
    assert program.call(Ioctl.GET_SPEED) == 2


@pytest.mark.parametrize("none", [0, -1])
def test_a_configuration_is_chosen(machine: Emulator, program: Program, none: int) -> None:
    assert program.call(Ioctl.SETCONFIGURATION, struct.pack("<i", none)) == 0
    assert machine.usb.configuration == 0
    assert program.call(Ioctl.CLAIMINTERFACE, struct.pack("<I", 0)) == -errno.ENOENT
    assert program.call(Ioctl.SUBMITURB, program.urb(BULK, 0x81, bytes(64))) == -errno.ESRCH
    assert program.call(Ioctl.SETINTERFACE, struct.pack("<II", 0, 0)) == -errno.EHOSTUNREACH
    assert program.call(Ioctl.SETCONFIGURATION, struct.pack("<I", 1)) == 0
    assert program.call(Ioctl.SETINTERFACE, struct.pack("<II", 0, 0)) == 0


def test_a_reset_ends_claims_and_transfers_and_keeps_the_configuration(machine: Emulator, program: Program) -> None:
    address = program.submit(BULK, 0x81, bytes(64))
    before = machine.scheduler.now
    assert program.call(Ioctl.RESET) == 0
    assert machine.scheduler.now - before > 50 * MS
    assert program.reap()[:2] == (address, -errno.ENOENT)
    assert (machine.usb.configuration, machine.usb.address) == (1, 7)
    assert program.call(Ioctl.RELEASEINTERFACE, struct.pack("<I", 0)) == -errno.EINVAL


def test_a_device_that_leaves_on_reset_is_gone(
    machine: Emulator, program: Program, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine.usb, "reset", machine.usb.unplug)
    assert program.call(Ioctl.RESET) == -errno.ENODEV


@pytest.mark.parametrize("comes_back", [False, True])
def test_a_device_that_has_gone(machine: Emulator, device: KernelDevice, program: Program, comes_back: bool) -> None:
    """What comes back is another device; a file that was open stays that of the old one."""
    other = Program(device)
    address = program.submit(BULK, 0x81, bytes(64))
    program.begin(Ioctl.BULK, bulk(program, 0x83, bytes(64), timeout_ms=0)[0])
    other.begin(Ioctl.REAPURB, bytes(8))
    machine.usb.unplug()
    if comes_back:
        machine.usb.plug()
    assert not device.present
    device.disconnect()
    assert (program.results[-1], other.results) == (-errno.ESHUTDOWN, [-errno.ENODEV])
    assert program.call(Ioctl.CLAIMINTERFACE, struct.pack("<I", 0)) == -errno.ENODEV
    assert program.reap()[:2] == (address, -errno.ESHUTDOWN)
    assert program.call(Ioctl.REAPURBNDELAY, bytes(8)) == -errno.ENODEV
    assert program.call(Ioctl.REAPURB, bytes(8)) == -errno.ENODEV


def test_a_program_s_end_releases_everything(machine: Emulator, device: KernelDevice, program: Program) -> None:
    program.submit(BULK, 0x81, bytes(64))
    program.begin(Ioctl.BULK, bulk(program, 0x83, bytes(64), timeout_ms=20)[0])
    results = list(program.results)
    program.file.close()
    other = Program(device)
    incoming = other.submit(BULK, 0x81, bytes(64))
    other.submit(BULK, 0x01, bytes(512))
    other.wait(30 * MS)
    other.reap()
    assert other.reap()[:2] == (incoming, 0)  # no other program got the answer
    assert (program.results, program.changes) == (results, [])
    device.disconnect()


def test_a_device_that_goes_while_it_is_enumerated(machine: Emulator) -> None:
    machine.scheduler.at(51 * MS, machine.usb.unplug)
    with pytest.raises(Stall, match="the device has gone"):
        KernelDevice(machine.usb, machine.scheduler, address=2)
