"""The bus of a USB/IP server, against the emulator's own server, an independent client, and scripted servers."""

from __future__ import annotations

import errno
import gc
import signal
import socket
import struct
import threading
import time
from array import array
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Any

import pytest
import usb.core
import usb.util
from phasewire import Emulator, Pulses, open_device
from phasewire.base.errors import DeviceAccessError, DeviceError, DeviceLostError, DeviceNotFoundError, DeviceUrlError
from phasewire.emulator.doors.station import Pace
from phasewire.host.firmware.flashing import find_flashable, flash, revert
from phasewire.host.firmware.images import read_firmware
from phasewire.host.transports import usbip_link
from phasewire.host.transports.usb_find import DFU_MODE, REQUEST_MS, RUN_TIME, UsbFinder
from phasewire.host.transports.usbip import UsbIpDevice, open_backend
from phasewire.host.transports.usbip_link import Urb, UsbIpLink
from phasewire.protocol.blocks import Block, NoOp, Update, pack
from phasewire.protocol.codes import REQUEST_TYPE_IN, REQUEST_TYPE_OUT, AckFlag, DfuRequest, Request, State
from phasewire.protocol.replies import ANSWER_BYTES, Ack
from phasewire.protocol.requests import Setup

from tests.emulator.usbip_client import Client, client_on
from tests.host.serving import LOOPBACK, PATIENCE, Served
from tests.host.upgrades import FILE, NEW

RAMP = Pulses([10] * 320, [2] * 320)
INTERFACE = 0
GET_STATUS = (0x80, 0, 0, 0, 2)


@pytest.fixture(scope="module")
def served() -> Iterator[Served]:
    with Served(pty=True, pace=Pace.WALL) as served:
        yield served


@pytest.fixture
def url(served: Served) -> str:
    return f"usbip:{LOOPBACK}:{served.usbip_port}"


@pytest.fixture
def device(url: str) -> Iterator[usb.core.Device]:
    """The device as pyusb sees it, configured and claimed."""
    bus = UsbFinder(url)
    device = bus.find().device
    device.set_configuration()
    usb.util.claim_interface(device, INTERFACE)
    yield device
    usb.util.dispose_resources(device)
    bus.close()


@contextmanager
def other_client(served: Served) -> Iterator[Client]:
    with socket.create_connection((LOOPBACK, served.usbip_port), timeout=PATIENCE) as line:
        yield client_on(line)


def errno_of(call: Callable[[], object]) -> int | None:
    with pytest.raises(usb.core.USBError) as raised:
        call()
    number: int | None = raised.value.errno
    return number


# URLs and what is missing


@pytest.mark.parametrize(
    ("url", "place"),
    [
        ("usbip:", (LOOPBACK, 3240, "")),
        ("usbip:server", ("server", 3240, "")),
        ("usbip:server:1/2-1.4", ("server", 1, "2-1.4")),
        ("usbip:/1-1", (LOOPBACK, 3240, "1-1")),
        ("usbip::7", (LOOPBACK, 7, "")),
        ("usbip://server:7/EMU-1", ("server", 7, "EMU-1")),
        ("usbip:[::1]:7/", ("::1", 7, "")),
    ],
)
def test_a_url_names_server_port_and_device(url: str, place: tuple[str, int, str]) -> None:
    backend = open_backend(url)
    assert (backend._host, backend._port, backend._bus_id or backend.wanted) == place


@pytest.mark.parametrize(
    "url", ["usbip:a:b", "usbip:a:0", "usbip:a:65536", "usbip:::1", "usbip:a?pace=fast", "usbip:[::1"]
)
def test_a_wrong_url_says_what_is_right(url: str) -> None:
    with pytest.raises(DeviceUrlError, match=r"write usbip:HOST:PORT or usbip:HOST:PORT/BUSID, such as usbip:127"):
        open_device(url)


def test_a_server_that_is_not_there_is_named() -> None:
    with socket.create_server((LOOPBACK, 0)) as listener:
        port = listener.getsockname()[1]
    with pytest.raises(
        DeviceNotFoundError, match=rf"127\.0\.0\.1:{port} cannot be used: .*refused; `phasewire emulate`"
    ):
        open_device(f"usbip:{LOOPBACK}:{port}")


def test_a_device_is_chosen_by_all_that_may_follow_usb(url: str, served: Served) -> None:
    for name in (
        "",
        "/",
        "/1-1",
        f"/{served.emulator.serial}",
        "/1209:0001",
        f"/1209:0001:{served.emulator.serial[:2]}",
    ):
        bus = UsbFinder(url + name)
        seen = bus.find()
        assert (seen.serial, seen.found.url) == (served.emulator.serial, f"{url}/{served.emulator.serial}")
        assert (seen.found.location, seen.full_speed) == ("1-1", False)
        bus.close()


@contextmanager
def answering(*answers: bytes) -> Iterator[tuple[str, list[bytes]]]:
    """The URL of a server that gives each connection an answer, and what came over them."""
    came: list[bytes] = []
    with socket.create_server((LOOPBACK, 0)) as listener:

        def serve() -> None:
            for answer in answers:
                line, _ = listener.accept()
                with line:
                    came.append(line.recv(1000))
                    line.sendall(answer)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield f"usbip:{LOOPBACK}:{listener.getsockname()[1]}", came
        thread.join(PATIENCE)
        assert not thread.is_alive()


def listed(*devices: tuple[bytes, int, int, bytes]) -> bytes:
    """A list of devices by bus id, vendor, product and classes, as the kernel's document has it."""
    answer = struct.pack(">HHII", 0x0111, 0x0005, 0, len(devices))
    for bus_id, vendor, product, classes in devices:
        numbers = (1, 2, 3, vendor, product, 0x0100, 0, 0, 0, 1, 1, len(classes) // 4)
        answer += struct.pack(">256s32sIIIHHHBBBBBB", b"/sys/devices", bus_id, *numbers) + classes
    return answer


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (b"", "cannot be used: it has closed the connection"),
        (b"SSH-2.0-OpenSSH_9.2\r\n", r"cannot be used: it answers with 5353482d, no reply 0x0005 of USB/IP 0x0111"),
        (listed()[:-1], "cannot be used: it has closed the connection"),
        (listed(), "offers no phasewire array: there is nothing"),
        (listed((b"3-2", 0x046D, 0xC077, bytes(4)))[:-1], "cannot be used: it has closed the connection"),
        (
            listed((b"3-2", 0x046D, 0xC077, b"\3\1\2\0"), (b"3-4", 0x1209, 0x0001, bytes.fromhex("FF000000 0A000000"))),
            r"offers no phasewire array: there is 3-2 \(046d:c077\), 3-4 \(1209:0001\)",
        ),
    ],
)
def test_another_server_or_one_without_an_array_is_named_and_no_foreign_device_is_taken(
    answer: bytes, message: str
) -> None:
    with answering(answer) as (url, came), pytest.raises(DeviceNotFoundError, match=message):
        open_device(url)
    assert came == [bytes.fromhex("01118005 00000000")]


@pytest.mark.parametrize(
    ("status", "reason"), [(1, "not available now"), (2, "another client has it"), (9, "status 9")]
)
def test_a_refusal_says_why(status: int, reason: str) -> None:
    offer = listed((b"1-1", 0x1209, 0x0001, bytes.fromhex("FF500100")))
    refusal, message = struct.pack(">HHI", 0x0111, 0x0003, status), f"does not give device 1-1: .*{reason}"
    with answering(offer, refusal) as (url, came), pytest.raises(DeviceNotFoundError, match=message):
        open_device(url)
    assert came[1] == bytes.fromhex("01118003 00000000") + b"1-1".ljust(32, b"\0")


# One client at a time


def test_a_device_of_another_client_is_refused_and_found_when_that_leaves(served: Served, url: str) -> None:
    with other_client(served) as client:
        assert client.attach("1-1") == 0
        with pytest.raises(
            DeviceNotFoundError, match="does not give device 1-1: another client has it; detach it there"
        ):
            open_device(url)
    assert_free(served)


def assert_free(served: Served, bus_id: str = "1-1") -> None:
    """See that the server gives a device to another client, soon."""
    end = time.monotonic() + PATIENCE
    while True:
        with other_client(served) as client:
            if client.attach(bus_id) == 0:
                return
        assert time.monotonic() < end
        time.sleep(0.01)


def test_a_device_belongs_to_others_as_soon_as_it_is_closed(served: Served, url: str) -> None:
    with open_device(url) as device, other_client(served) as client:
        assert client.attach("1-1") == 2  # EBUSY of the kernel's tools
    assert_free(served)
    assert device  # is still referred to


def test_one_process_has_a_device_once_and_an_interface_is_claimed_once(url: str, device: usb.core.Device) -> None:
    with pytest.raises(DeviceAccessError, match="another program is using the device"):
        open_device(url)
    assert device.ctrl_transfer(*GET_STATUS)  # it was not closed


def test_two_devices_of_a_server_are_told_apart() -> None:
    with Served(pty=True, pace=Pace.WALL, count=2) as served:
        url = f"usbip:{LOOPBACK}:{served.usbip_port}"
        one, other = (each.serial for each in served.emulators)
        with pytest.raises(DeviceNotFoundError, match=f"2 devices; name one: {url}/{one} or {url}/{other}"):
            open_device(url)
        with open_device(f"{url}/{one}"), other_client(served) as client:
            assert client.attach("1-2") == 0, "a device that is not the one that is used is held"
        assert_free(served, "1-2")
        with open_device(f"{url}/{one}") as first, open_device(f"{url}/1-2") as second:
            assert [first.serial, second.serial] == [one, other]
            for device in (first, second):
                device.set_watchdog(10)
                assert device.show(RAMP).sequence == 1


# As libusb on Linux


def test_claims_and_configurations_fail_as_libusb_s(url: str, device: usb.core.Device) -> None:
    backend, mine = device.backend, device._ctx.managed_open()
    other = backend.open_device(device._ctx.dev)
    assert errno_of(lambda: backend.claim_interface(other, INTERFACE)) == errno.EBUSY
    assert errno_of(lambda: backend.release_interface(other, INTERFACE)) == errno.ENOENT
    assert errno_of(lambda: backend.claim_interface(other, 9)) == errno.ENOENT
    assert errno_of(lambda: backend.bulk_write(other, 0x01, INTERFACE, array("B", b"x"), 10)) == errno.EBUSY
    assert errno_of(lambda: backend.set_configuration(other, 1)) == errno.EBUSY
    backend.release_interface(mine, INTERFACE)
    backend.claim_interface(other, INTERFACE)
    backend.close_device(other)
    backend.set_configuration(mine, 0)
    assert backend.get_configuration(mine) == 0
    assert errno_of(lambda: backend.claim_interface(mine, INTERFACE)) == errno.ENOENT
    backend.set_configuration(mine, 1)
    backend.set_interface_altsetting(mine, INTERFACE, 0)
    with pytest.raises(NotImplementedError):
        device.is_kernel_driver_active(INTERFACE)


def test_control_requests_of_every_kind(device: usb.core.Device) -> None:
    size = ANSWER_BYTES[Request.INFO]
    assert len(device.ctrl_transfer(REQUEST_TYPE_IN, Request.INFO, 0, 0, size)) == size
    assert len(device.ctrl_transfer(0x80, 6, 0x0100, 0, 4096)) == 18
    assert device.ctrl_transfer(REQUEST_TYPE_OUT, Request.DISABLE, 0, 0) == 0
    coding = struct.pack("<IBBB", 9600, 0, 0, 8)
    assert device.ctrl_transfer(0x21, 0x20, 0, 1, coding) == 7
    assert bytes(device.ctrl_transfer(0xA1, 0x21, 0, 1, 7)) == coding
    assert errno_of(lambda: device.ctrl_transfer(0xC0, 0xEE, 0, 0, 8)) == errno.EPIPE


def test_bulk_transfers_of_every_end(device: usb.core.Device) -> None:
    no_op = pack(Block(NoOp(), 0, True))
    assert device.write(0x01, no_op + pack(Block(NoOp(), 1))) == 1024
    came = bytes(device.read(0x81, 512))
    assert [Ack.decode(came[at : at + 32]).sequence for at in (0, 32)] == [0, 1]
    with pytest.raises(usb.core.USBTimeoutError) as raised:
        device.read(0x81, 512, 20)
    assert raised.value.errno == errno.ETIMEDOUT
    device.write(0x01, pack(Block(NoOp(), 2)))
    assert Ack.decode(bytes(device.read(0x81, 512))).sequence == 2, "a cancelled transfer took no data"
    device.write(0x01, pack(Block(NoOp(), 3)))
    assert errno_of(lambda: device.read(0x81, 10)) == errno.EOVERFLOW
    device.ctrl_transfer(0x02, 3, 0, 0x01)  # SET_FEATURE(ENDPOINT_HALT)
    assert errno_of(lambda: device.write(0x01, no_op)) == errno.EPIPE
    device.clear_halt(0x01)
    assert device.write(0x01, no_op) == 512
    assert errno_of(lambda: device.read(0x82, 64, 20)) == errno.ETIMEDOUT  # an interrupt endpoint
    too_long = array("B", bytes((1 << 24) + 1))
    assert errno_of(lambda: device.write(0x01, too_long)) == errno.ENOMEM
    assert device.ctrl_transfer(*GET_STATUS)


def test_a_write_that_the_device_stops_says_how_much_was_taken(device: usb.core.Device) -> None:
    device.ctrl_transfer(REQUEST_TYPE_OUT, Request.WATCHDOG, 60_000, INTERFACE)
    device.ctrl_transfer(REQUEST_TYPE_OUT, Request.ENABLE, 0, INTERFACE)
    far = 2**31  # periods ahead, so that the queue stays full
    blocks = b"".join(pack(Block(Update(RAMP, far + n), n, n == 0)) for n in range(1000))
    taken = device.write(0x01, blocks, 1000)
    assert 0 < taken < len(blocks)
    assert taken % 512 == 0
    with pytest.raises(usb.core.USBTimeoutError):
        device.write(0x01, blocks[taken : taken + 512], 20)
    device.ctrl_transfer(REQUEST_TYPE_OUT, Request.DISABLE, 0, INTERFACE)
    acks = b""
    while len(acks) < 32 * taken // 512:
        acks += bytes(device.read(0x81, 16384, 1000))
    assert [Ack.decode(acks[at : at + 32]).sequence for at in range(0, len(acks), 32)] == list(range(taken // 512))


def test_a_reset_keeps_the_device_and_its_configuration(device: usb.core.Device, served: Served) -> None:
    backend, handle = device.backend, device._ctx.managed_open()
    device.ctrl_transfer(REQUEST_TYPE_OUT, Request.ENABLE, 0, INTERFACE)
    flight = backend.open_flight(handle)
    assert flight.read(0.01) == b""  # leaves transfers under way, during which no server sees a reset
    resets = served.in_its_thread(lambda: count_resets(served.emulator))
    backend.reset_device(handle)
    assert resets == [1]
    assert served.in_its_thread(lambda: served.emulator.usb.configuration) == 1
    assert served.emulator.controller is not None
    assert served.emulator.controller.state is State.OFF
    assert device.ctrl_transfer(*GET_STATUS)


def count_resets(emulator: Emulator) -> list[int]:
    """How often the bus is reset, as the only number of a list."""
    count, genuine = [0], emulator.usb.reset

    def reset() -> None:
        count[0] += 1
        genuine()

    emulator.usb.reset = reset  # type: ignore[method-assign]
    return count


# A device that leaves and comes back


def test_a_restarted_device_is_found_again(url: str) -> None:
    with open_device(url) as device:
        for _ in range(2):
            device.set_watchdog(10)
            device.show(RAMP)
            device.reset()
            assert device.status().state is State.OFF
        device.set_watchdog(10)
        assert device.show(RAMP).sequence == 1


def test_dfu_mode_and_back_by_a_reset_is_another_device_each_time(url: str, device: usb.core.Device) -> None:
    bus = UsbFinder(f"{url}/1-1")
    known = bus.find()
    backend, handle = device.backend, device._ctx.managed_open()
    device.ctrl_transfer(0x21, DfuRequest.DETACH, 1000, 3)
    end = time.monotonic() + PATIENCE
    while device._ctx.dev.there:
        assert time.monotonic() < end
        time.sleep(0.01)
    assert errno_of(lambda: device.ctrl_transfer(*GET_STATUS)) == errno.ENODEV
    assert errno_of(lambda: backend.open_device(device._ctx.dev)) == errno.ENODEV
    in_dfu = bus.find_again(known, (DFU_MODE,), PATIENCE)
    assert in_dfu.mode == DFU_MODE
    before, stale = in_dfu.device._ctx.dev.link, backend.open_device(in_dfu.device._ctx.dev)
    in_dfu.device.set_configuration()  # only then a reset counts (clause DFU-015)
    assert errno_of(in_dfu.device.reset) == errno.ENOENT
    back = bus.find_again(in_dfu, (RUN_TIME,), PATIENCE)
    assert back.device._ctx.dev.link is before, "a connection outlasts a reset"
    assert errno_of(lambda: backend.clear_halt(handle, 0x01)) == errno.ENODEV
    assert errno_of(lambda: backend.clear_halt(stale, 0x01)) == errno.ENODEV
    bus.close()


def test_a_device_whose_server_refuses_for_a_while_is_waited_for(served: Served, url: str) -> None:
    bus = UsbFinder(url)
    known = bus.find()
    known.device._ctx.dev.link.close()
    bus.close()
    with other_client(served) as client:
        end = time.monotonic() + PATIENCE
        while client.attach("1-1"):
            assert time.monotonic() < end
        with pytest.raises(DeviceLostError, match="has not come back"):
            bus.find_again(known, (RUN_TIME,), 0.2)
        threading.Timer(0.3, client.send, (b"nonsense" * 20,)).start()  # which the server answers by dropping it
        assert bus.find_again(known, (RUN_TIME,), PATIENCE).serial == known.serial
    bus.close()


@pytest.mark.slow
def test_firmware_is_flashed_listed_and_taken_back(tmp_path: Path) -> None:
    (tmp_path / "new.dfu").write_bytes(FILE)
    with Served(pty=True, pace=Pace.WALL) as served:
        url = f"usbip:{LOOPBACK}:{served.usbip_port}"
        report = flash(url, read_firmware(tmp_path / "new.dfu"))
        assert report.firmware == NEW.version
        (found,) = find_flashable(url)
        assert (found.firmware, found.mode) == (NEW.version, RUN_TIME)
        assert revert(url).before == NEW.version


# Streams and interruptions


def test_a_stream_has_several_transfers_under_way_and_ends_at_ctrl_c(url: str) -> None:
    def frames() -> Iterator[Pulses]:
        while True:
            yield RAMP

    with open_device(url) as device:
        line: Any = device._session.line()
        assert line.posts
        device.set_watchdog(10)
        report = device.stream([RAMP] * 400, 400)
        assert (report.accepted, report.unanswered) == (400, 0)
        threading.Timer(0.3, signal.pthread_kill, (threading.main_thread().ident, signal.SIGINT)).start()
        with pytest.raises(KeyboardInterrupt):
            device.stream(frames(), 500)
        assert device.status().state is State.OFF
        assert device.show(RAMP).flags in (AckFlag(0), AckFlag.GAP)


def test_an_exception_in_a_transfer_cancels_it(device: usb.core.Device) -> None:
    class Raised(Exception):
        pass

    def raise_it(_number: int, _frame: FrameType | None) -> None:
        raise Raised

    before = signal.signal(signal.SIGUSR1, raise_it)
    try:
        for _ in range(5):
            threading.Timer(0.05, signal.pthread_kill, (threading.main_thread().ident, signal.SIGUSR1)).start()
            with pytest.raises(Raised):
                device.read(0x81, 512, 10_000)
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert not device._ctx.dev.link._under_way
    device.write(0x01, pack(Block(NoOp(), 0, True)))
    assert Ack.decode(bytes(device.read(0x81, 512))).sequence == 0


# The order of answers, from a scripted server


FIELDS = ("bus", "number", "speed", "vendor", "product", "version", "class", "subclass", "protocol", "configuration",
          "configurations", "interfaces")  # fmt: skip
USUAL = (1, 2, 3, 0x1209, 1, 0, 0, 0, 0, 1, 1, 1)
MOST = (2**32 - 1,) * 3 + (2**16 - 1,) * 3 + (255,) * 6


@pytest.mark.parametrize(
    ("field", "value"),
    [
        *((name, value) for name, most in zip(FIELDS, MOST, strict=True) for value in (0, most)),
        ("bus", 65_536),
        ("number", 65_536),
        ("bus_id", b""),
        ("bus_id", b"\xff" * 32),
        ("bus_id", b"1-" + b"9" * 30),
        ("count", 0),
        ("count", 2**32 - 1),
    ],
)
def test_no_field_of_a_server_s_answers_is_more_than_an_error(field: str, value: Any) -> None:
    numbers = [value if name == field else usual for name, usual in zip(FIELDS, USUAL, strict=True)]
    bus_id = value if field == "bus_id" else b"1-2"
    device = struct.pack(">256s32sIIIHHHBBBBBB", b"", bus_id, *numbers)
    interfaces = b"\xff\x50\x01\0" * numbers[-1]
    answers = {
        0x8005: struct.pack(">HHII", 0x0111, 5, 0, value if field == "count" else 1) + device + interfaces,
        0x8003: struct.pack(">HHI", 0x0111, 3, 0) + device,
    }
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            with suppress(OSError):
                while True:
                    line, _ = listener.accept()
                    with line:
                        line.sendall(answers.get(struct.unpack(">HHI", line.recv(8))[1], b""))
                        line.shutdown(socket.SHUT_WR)
                        line.recv(1000)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        with pytest.raises(DeviceError):
            open_device(f"usbip:127.0.0.1:{listener.getsockname()[1]}")
        listener.shutdown(socket.SHUT_RDWR)
        thread.join(PATIENCE)


class Script:
    """The server's end of a link."""

    def __init__(self) -> None:
        mine, self.line = socket.socketpair()
        self.line.settimeout(PATIENCE)
        self.link = UsbIpLink(mine, 0x10002)

    def command(self) -> tuple[int, int, int]:
        """Code, number and target of the next command, whose data are read."""
        code, number, device_id, is_in, _, target, length = struct.unpack(">7I20x", self.receive(48))
        assert device_id == 0x10002
        self.receive(length if code == 1 and not is_in else 0)
        return code, number, target

    def receive(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            data += self.line.recv(count - len(data))
        return data

    def submitted(self, number: int, status: int, actual: int, data: bytes = b"") -> None:
        self.line.sendall(struct.pack(">5IiIII12x", 3, number, 0, 0, 0, status, actual, 0, 0) + data)

    def unlinked(self, number: int, status: int) -> None:
        self.line.sendall(struct.pack(">5Ii24x", 4, number, 0, 0, 0, status))


@pytest.fixture
def script() -> Iterator[Script]:
    script = Script()
    yield script
    script.line.close()


def carried(script: Script, endpoint: int, data: bytes | int, answer: Callable[[int, int], None]) -> Urb:
    """A transfer whose time passes; the server then answers it and its cancellation."""

    def serve() -> None:
        code, number, _ = script.command()
        unlink, cancelling, target = script.command()
        assert (code, unlink, target) == (1, 2, number)
        answer(number, cancelling)

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    urb = Urb(script.link, endpoint, data)
    script.link.carry(urb, 0.02)
    thread.join(PATIENCE)
    return urb


def test_data_that_cross_the_cancellation_are_not_lost(script: Script) -> None:
    def first(number: int, cancelling: int) -> None:
        script.submitted(number, 0, 5, b"hello")
        script.unlinked(cancelling, 0)

    def last(number: int, cancelling: int) -> None:
        script.unlinked(cancelling, 0)
        time.sleep(0.02)
        script.submitted(number, 0, 5, b"hello")

    for answer in (first, last):
        urb = carried(script, 0x81, 64, answer)
        urb.check()
        assert (urb.received, urb.left) == (b"hello", 59)
    assert not script.link._under_way


def test_a_cancelled_transfer_says_how_much_was_carried(script: Script) -> None:
    urb = carried(script, 0x01, bytes(1024), lambda _, cancelling: script.unlinked(cancelling, -104))
    assert (urb.timed_out, urb.actual) == (True, 0)

    def partly(number: int, cancelling: int) -> None:
        script.submitted(number, -104, 512)
        script.unlinked(cancelling, 0)

    urb = carried(script, 0x01, bytes(1024), partly)
    assert (urb.timed_out, urb.actual, urb.left) == (True, 512, 512)
    urb = carried(script, 0x81, 1024, lambda number, _: script.submitted(number, -104, 3, b"abc"))
    assert (urb.timed_out, urb.received) == (True, b"abc")


def test_a_server_that_does_not_answer_a_cancellation_is_left(script: Script, monkeypatch: pytest.MonkeyPatch) -> None:
    assert REQUEST_MS / 1000 + usbip_link.END_SECONDS <= 2, "so long a server may be silent until it is noticed"
    monkeypatch.setattr(usbip_link, "END_SECONDS", 0.05)
    urb = carried(script, 0x81, 64, lambda *_: None)
    assert errno_of(urb.check) == errno.ENODEV
    assert script.link.over.wait(PATIENCE)
    assert script.line.recv(1) == b""


@pytest.mark.parametrize(
    "nonsense",
    [
        struct.pack(">5IiIII12x", 3, 77, 0, 0, 0, 0, 0, 0, 0),  # the answer to no command
        struct.pack(">5IiIII12x", 3, 1, 0, 0, 0, 0, 65, 0, 0) + bytes(65),  # more than was requested
        struct.pack(">5IiIII12x", 5, 1, 0, 0, 0, 0, 0, 0, 0),  # no answer
        b"",
    ],
)
def test_a_link_that_breaks_ends_every_transfer(script: Script, nonsense: bytes) -> None:
    urbs = [Urb(script.link, 0x81, 64) for _ in range(3)]
    for urb in urbs:
        urb.submit()
    script.receive(3 * 48)
    script.line.sendall(nonsense)
    if not nonsense:
        script.line.shutdown(socket.SHUT_WR)
    for urb in urbs:
        assert urb.wait(PATIENCE)
        assert errno_of(urb.check) == errno.ENODEV
    assert errno_of(Urb(script.link, 0x81, 64).submit) == errno.ENODEV


def test_a_request_without_data_goes_out_as_linux_has_it(script: Script) -> None:
    device = UsbIpDevice.__new__(UsbIpDevice)
    device.link = script.link
    heads: list[bytes] = []

    def serve() -> None:
        for _ in range(2):
            heads.append(script.receive(48))
            script.submitted(len(heads), 0, 0)

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    for length in (0, 2):
        device.control(Setup(0x80, 0, 0, 0, length), b"", 1000)
    thread.join(PATIENCE)
    assert [struct.unpack_from(">I", head, 12) for head in heads] == [(0,), (1,)]


def test_a_link_without_references_is_closed_even_with_transfers_under_way(script: Script) -> None:
    urb = Urb(script.link, 0x81, 64)
    urb.submit()
    del script.link
    gc.collect()
    assert urb.wait(PATIENCE)
    assert errno_of(urb.submit) == errno.ENODEV


# The conformance suite


@pytest.mark.slow
def test_the_conformance_suite_judges_a_device_over_usbip(url: str) -> None:
    from phasewire.hil.conformance.running import RunOptions, run_conformance
    from phasewire.hil.conformance.verdicts import Verdict

    run = run_conformance(RunOptions(url, only=("numbering", "enumeration", "requests/a-")))
    assert [(result.case, result.reason) for result in run.results if result.verdict is Verdict.FAIL] == []
    assert run.count(Verdict.PASS) > 50
