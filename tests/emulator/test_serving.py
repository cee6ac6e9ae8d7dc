"""The server with real sockets and pseudo-terminals, on loopback: its loop in a thread, its clients here."""

from __future__ import annotations

import asyncio
import fcntl
import os
import selectors
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from functools import partial
from itertools import pairwise
from pathlib import Path

import pytest
import serial
from phasewire.emulator.door import Handshake
from phasewire.emulator.doors import serving
from phasewire.emulator.doors.serving import Server
from phasewire.emulator.doors.station import Pace, Station
from phasewire.emulator.doors.uart import Uart
from phasewire.emulator.doors.usbip_session import Exported
from phasewire.emulator.doors.waiting import PreciseSelector
from phasewire.emulator.scheduler import Scheduler
from phasewire.protocol.requests import Setup

from tests.attacks import ATTACKS, CROWD, attacked, garbage, half_open, no_files
from tests.emulator.stand_ins import StandInDevice, StandInLine
from tests.emulator.usbip_client import Client, client_on

LOOPBACK = "127.0.0.1"
PATIENCE = 5.0  # seconds


def until(condition: Callable[[], object]) -> None:
    """Wait for a condition, with a limit."""
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


class House:
    """A server of two devices with a serial line each, on all doors."""

    def __init__(self, pace: Pace, patient: bool = False) -> None:
        self.devices = [StandInDevice(), StandInDevice()]
        self.lines = [StandInLine(), StandInLine()]
        self.told: list[str] = []
        self.usbip = 0
        self.tcp = 0
        self.usbredir = 0
        self.pty = ""
        self.error: BaseException | None = None
        self._pace, self._patient = pace, patient
        self._open = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def _run(self) -> None:
        try:
            with asyncio.Runner(loop_factory=serving.precise_loop) as runner:
                runner.run(self._serve())
        except BaseException as error:
            self.error = error
        finally:
            self._open.set()

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        self.schedulers = schedulers = [Scheduler(), Scheduler()]
        stations = {
            f"S-{number}": Station(each, self._pace, patient=lambda: self._patient)
            for number, each in enumerate(schedulers, start=1)
        }
        exports = {
            f"1-{number}": Exported(1, number, device, station)
            for number, (device, station) in enumerate(zip(self.devices, stations.values(), strict=True), start=1)
        }
        async with Server(stations, self.told.append) as self.server:
            self.usbip = await self.server.listen_usbip(exports, LOOPBACK, 0)
            uarts = [
                Uart(partial(self.lines.__getitem__, number), each, 1_000_000) for number, each in enumerate(schedulers)
            ]
            self.tcp = await self.server.listen_serial(uarts[0], stations["S-1"], LOOPBACK, 0)
            self.usbredir = await self.server.listen_usbredir(exports["1-2"], LOOPBACK, 0)
            self.pty = self.server.open_pty(uarts[1], stations["S-2"])
            self._open.set()
            await self.server.serve()

    def __enter__(self) -> House:
        self._thread.start()
        assert self._open.wait(PATIENCE)
        return self

    def __exit__(self, *exception: object) -> None:
        self.call(lambda: self.server.stop())
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()

    def call(self, action: Callable[[], object]) -> None:
        """Do something in the loop's thread."""
        if self._thread.is_alive() and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(action)

    @contextmanager
    def client(self) -> Iterator[Client]:
        with closing(socket.create_connection((LOOPBACK, self.usbip), PATIENCE)) as connection:
            yield client_on(connection)


@pytest.fixture(params=Pace)
def house(request: pytest.FixtureRequest) -> Iterator[House]:
    with House(request.param) as opened:
        yield opened
    assert opened.error is None


def test_devices_are_listed_attached_and_used(house: House) -> None:
    with house.client() as client:
        assert [each.bus_id for each in client.list()] == ["1-1", "1-2"]
        with pytest.raises(EOFError):
            client.receive(1)
    with house.client() as client, house.client() as other:
        assert (client.attach("1-1"), other.attach("1-1"), len(house.devices)) == (0, 2, 2)
        assert client.enumerate() == house.devices[0].enumeration.configuration
        assert client.write(0x01, bytes(200_000))[2:4] == (0, 200_000)
        house.call(lambda: house.devices[0].give(0x81, *[bytes(512)] * 200, b"end"))
        time.sleep(0.02)
        assert len(client.read(0x81, 300_000).data) == 200 * 512 + 3
        waits = client.submit(0x81, 512)
        assert client.wait_for(client.unlink(waits)).status == -104
    until(lambda: house.devices[0].happened == ["reset", "unplug", "plug"])


@pytest.mark.parametrize("data", [b"GET / HTTP/1.1\r\n\r\n", b"\0" * 48])
def test_a_client_that_breaks_the_protocol_is_dropped_and_others_stay(house: House, data: bytes) -> None:
    with house.client() as good:
        good.attach("1-1")
        with house.client() as bad:
            bad.send(data)
            with pytest.raises(EOFError):
                bad.receive(1)
        with house.client() as worse:
            worse.attach("1-2")
            worse.send(b"\xff" * 100)
            with pytest.raises(EOFError):
                worse.receive(1)
        assert good.write(0x01, b"still here").status == 0
    assert any("was dropped: it sent" in line for line in house.told)


def test_a_client_that_only_receives_gets_bytes_soon(house: House) -> None:
    scheduler = house.schedulers[0]

    def say_soon() -> None:
        scheduler.at(scheduler.now + 200_000, lambda: house.devices[0].give(0x81, b"soon"))

    with house.client() as client:
        client.attach("1-1")
        client.write(0x01, bytes(2_000_000))  # takes longer than the server waits for any client
        house.call(say_soon)
        assert client.read(0x81, 512).data == b"soon"


def test_the_wall_clock_goes_on_without_traffic() -> None:
    with House(Pace.WALL) as house, house.client() as client:
        times: list[float] = []

        def note_time(endpoint: int, packet: bytes) -> Handshake:
            times.append(house.schedulers[0].now / 400e6)
            return Handshake.ACK

        house.devices[0].bulk_out = note_time  # type: ignore[method-assign]  # looked on
        client.attach("1-1")

        def a_silence_has_passed() -> bool:
            """In the device's time; a server that was held up in it is late."""
            client.write(0x01, b"now")
            time.sleep(0.1)
            return any(after - before >= 0.1 for before, after in pairwise(times))

        until(a_silence_has_passed)


def test_a_wait_for_a_patient_device_counts_in_its_time_after_a_hold_up() -> None:
    """As in DFU, which refuses a host that asks too early."""
    with House(Pace.WALL, patient=True) as house, house.client() as client:
        times: list[float] = []

        def note_time(endpoint: int, packet: bytes) -> Handshake:
            times.append(house.schedulers[0].now / 400e6)
            return Handshake.ACK

        house.devices[0].bulk_out = note_time  # type: ignore[method-assign]  # looked on
        house.call(lambda: house.schedulers[0].at(10**12, lambda: None))
        client.attach("1-1")
        client.write(0x01, b"write")
        began = time.monotonic()
        house.call(lambda: time.sleep(0.3))
        time.sleep(0.2)
        waited = time.monotonic() - began
        client.write(0x01, b"done?")
    assert times[1] - times[0] >= waited


def speak_usbip(house: House) -> bool:
    with house.client() as client:
        return [each.bus_id for each in client.list()] == ["1-1", "1-2"]


def speak_serial(house: House) -> bool:
    with closing(socket.create_connection((LOOPBACK, house.tcp), PATIENCE)) as line:
        line.sendall(b"a")
        return line.recv(1) == b"A"


def speak_usbredir(house: House) -> bool:
    with closing(socket.create_connection((LOOPBACK, house.usbredir), PATIENCE)) as line:
        line.sendall(struct.pack("<III64sI", 0, 68, 0, b"a test", 0xFE))
        return len(line.recv(1000)) > 79


@pytest.mark.parametrize("attack", ATTACKS, ids=lambda attack: attack.__name__)
@pytest.mark.parametrize(
    ("door", "speak"), [("usbip", speak_usbip), ("tcp", speak_serial), ("usbredir", speak_usbredir)]
)
def test_no_attack_on_a_door_ends_the_service_of_others(
    door: str, speak: Callable[[House], bool], attack: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(serving, "GREETING_SECONDS", 0.05)
    monkeypatch.setattr("asyncio.constants.ACCEPT_RETRY_DELAY", 0.01)

    def is_served() -> bool:
        with suppress(EOFError, OSError):
            return speak(served)
        return False

    with House(Pace.WALL) as served, served.client() as first:
        assert first.attach("1-1") == 0
        with attacked(attack, getattr(served, door)) as crowd:
            assert first.write(0x01, b"still here").status == 0
            if attack is no_files:
                until(lambda: any("no further client" in line for line in served.told))
            if attack is no_files or (door == "tcp" and attack in (half_open, garbage)):
                crowd.close()  # a line is held by the one who speaks
            until(is_served)
            if door == "usbip":
                until(lambda: len(served.server.links) < CROWD)
        until(is_served)
    assert served.error is None
    assert sum("clients have requested nothing yet" in line for line in served.told) <= 1


@pytest.mark.skipif(sys.platform != "linux", reason="the numbers of files have this limit on Linux")
def test_a_precise_wait_takes_any_number_of_files_and_ends_in_time() -> None:
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, min(hard, 2000)), hard))
    reads, writes = os.pipe()
    try:
        high = fcntl.fcntl(reads, fcntl.F_DUPFD, 1100)
        with closing(PreciseSelector()) as selector:
            selector.register(high, selectors.EVENT_READ)

            def waits_exactly() -> bool:
                began = time.monotonic()
                assert selector.select(0.0002) == []
                return 0.0002 <= time.monotonic() - began < 0.001  # never by epoll

            until(waits_exactly)
            os.write(writes, b"x")
            assert [key.fd for key, _ in selector.select(PATIENCE)] == [high]
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
        for number in (reads, writes, high):
            os.close(number)


class Moment:
    """A clock that a test sets, for a station and a loop that do nothing by themselves."""

    def __init__(self) -> None:
        self.now = 100.0

    def time(self) -> float:
        return self.now

    def call_later(self, _seconds: float, _action: Callable[[], None]) -> asyncio.TimerHandle:
        return self  # type: ignore[return-value]  # only cancelled

    def cancel(self) -> None: ...


class Listener(StandInLine):
    """It notes the device's time whenever it receives something; every millisecond it has a turn."""

    pending, full, over, presses, stuck, last_word = 0, False, False, False, False, None

    def __init__(self, scheduler: Scheduler) -> None:
        super().__init__()
        self._scheduler = scheduler
        self.heard_at: list[float] = []

    def receive(self, data: bytes) -> None:
        self.heard_at.append(self._scheduler.now / 400_000)

    def next_time(self, event: int | None) -> int:
        return (self._scheduler.now // 400_000 + 1) * 400_000

    def run(self) -> None: ...
    def take(self, room: int) -> bytes:
        return b""

    def hang_up(self) -> None: ...


@pytest.mark.parametrize(
    ("asleep", "computing", "heard_at"),
    [
        pytest.param(0.0004, 0.0, 1.4, id="in time"),
        pytest.param(0.012, 0.0, 1.0, id="the loop slept too long"),
        pytest.param(0.0001, 0.012, 1.0, id="the model computed for too long"),
    ],
)
def test_bytes_that_waited_during_a_hold_up_arrive_before_time_passes(
    asleep: float, computing: float, heard_at: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bytes that were there at 1 ms of the device's time are for a queue that is empty at 1.8 ms."""
    moment, scheduler = Moment(), Scheduler()
    monkeypatch.setattr("asyncio.get_running_loop", lambda: moment)
    station = Station(scheduler, Pace.WALL, moment.time)
    listener = Listener(scheduler)
    station.conversations.append(listener)
    pulse = serving._Pulse("S-1", station)

    def compute() -> None:
        moment.now += computing

    scheduler.at(400_000, compute)
    moment.now += 0.001
    pulse.beat()
    assert scheduler.now == pytest.approx(400_000, abs=1)
    moment.now += asleep
    pulse.hear(listener, b"blocks")
    assert listener.heard_at == [pytest.approx(heard_at, abs=0.01)]
    assert scheduler.now / 400e6 == pytest.approx(moment.now - 100, abs=1e-6), "then the time that was missed passes"


def test_the_server_goes_on_computing_a_slow_model() -> None:
    with House(Pace.WALL) as house, house.client() as client:
        scheduler, device = house.schedulers[0], house.devices[0]

        def take_long() -> None:
            time.sleep(0.002)  # twice what it models
            if device.generation:
                scheduler.at(scheduler.now + 400_000, take_long)

        house.call(lambda: scheduler.at(scheduler.now, take_long))
        client.attach("1-1")
        number = client.submit(0x81, 512)
        house.call(lambda: scheduler.at(scheduler.now + 20_000_000, lambda: device.give(0x81, b"late")))
        assert client.wait_for(number).data == b"late"
        device.generation = 0


def test_a_line_has_one_client_at_a_time(house: House) -> None:
    address = (LOOPBACK, house.tcp)
    with closing(socket.create_connection(address, PATIENCE)) as first:
        first.sendall(b"a")
        assert first.recv(1) == b"A"
        with closing(socket.create_connection(address, PATIENCE)) as second:
            assert second.recv(1) == b""
        first.sendall(b"b")
        assert first.recv(1) == b"B"
    until(lambda: house.lines[0].hung_up == 1)
    with closing(socket.create_connection(address, PATIENCE)) as third:
        third.sendall(b"c")
        assert third.recv(1) == b"C"


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="this system has no pseudo-terminals")
def test_pyserial_speaks_to_the_line_by_its_path(house: House) -> None:
    for _ in range(2):
        house.lines[1].hung_up = 0
        with serial.Serial(house.pty, 115_200, timeout=PATIENCE) as port:
            port.write(b"a\r\nb\0\x03\x04")  # none of these bytes has a meaning to a terminal
            assert port.read(7) == b"A\r\nB\0\x03\x04"
            data = bytes(range(256)) * 40
            port.write(data)
            assert port.read(len(data)) == data.upper()
        until(lambda: house.lines[1].hung_up == 1)


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="this system has no pseudo-terminals")
def test_a_shell_may_write_to_the_line_and_close_it(house: House) -> None:
    with Path(house.pty).open("wb", buffering=0) as port:
        port.write(b"off\r")
    until(lambda: house.lines[1].hung_up == 1)
    assert house.lines[1].heard == b"off\r"


def test_the_server_removes_everything_at_its_end() -> None:
    with House(Pace.WALL) as house, house.client() as client:
        client.attach("1-1")
        client.submit(0x81, 512)
        house.call(lambda: house.server.stop())
        with pytest.raises(EOFError):
            client.receive(1)
        until(lambda: not Path(house.pty).exists())
    assert house.error is None
    assert house.devices[0].happened == ["unplug", "plug"]
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection((LOOPBACK, house.usbip), PATIENCE)


def test_an_error_of_the_model_is_raised() -> None:
    with House(Pace.WALL) as house, house.client() as client:
        client.attach("1-1")

        def fail(setup: Setup, data: bytes = b"") -> bytes:
            raise ZeroDivisionError

        house.devices[0].control = fail  # type: ignore[method-assign]  # made to fail
        with pytest.raises(EOFError):
            client.descriptor(1, 18)
    assert isinstance(house.error, ZeroDivisionError)
