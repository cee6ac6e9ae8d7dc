"""Emulated devices served to the world outside this process' model: USB/IP, TCP, a pseudo-terminal, and RFC 2217."""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TypeVar

import serial
from phasewire import Emulator
from phasewire.emulator.doors.serving import Server
from phasewire.emulator.doors.station import Pace, Station
from phasewire.emulator.doors.uart import Uart
from phasewire.emulator.doors.usbip_session import Exported
from serial.rfc2217 import PortManager

Result = TypeVar("Result")

LOOPBACK = "127.0.0.1"
PATIENCE = 10.0  # seconds
LONGEST = 600.0
"""A server ends after so many seconds, whatever became of the test that began it."""
BAUD = 3_000_000
HISTORY_PERIODS = 4_000
"""The history of outputs: 0.1 s, so that a long test does not fill the memory."""


class Served:
    """Emulated devices at a port of USB/IP, the first also at another or a pseudo-terminal; all in one thread."""

    def __init__(
        self,
        *,
        pty: bool,
        pace: Pace = Pace.FAST,
        baud: int = BAUD,
        history_periods: int = HISTORY_PERIODS,
        count: int = 1,
    ) -> None:
        self._pty, self._pace, self._baud, self._history_periods = pty, pace, baud, history_periods
        self._count = count
        self._open = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()), daemon=True)

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        self.emulators = [Emulator(history_periods=self._history_periods) for _ in range(self._count)]
        self.emulator = self.emulators[0]
        stations = {each.serial: Station(each.scheduler, self._pace) for each in self.emulators}
        station = stations[self.emulator.serial]
        uart = Uart(lambda: self.emulator.line, self.emulator.scheduler, self._baud)
        async with Server(stations, lambda line: None) as self._server:
            if self._pty:
                self.where = self._server.open_pty(uart, station)
            else:
                self.where = f"{LOOPBACK}:{await self._server.listen_serial(uart, station, LOOPBACK, 0)}"
            exports = {
                f"1-{number}": Exported(1, number, each.usb, stations[each.serial])
                for number, each in enumerate(self.emulators, 1)
            }
            self.usbip_port = await self._server.listen_usbip(exports, LOOPBACK, 0)
            self._open.set()
            await self._server.serve(LONGEST)

    def in_its_thread(self, call: Callable[[], Result]) -> Result:
        """The result of a call that may touch the device."""

        async def called() -> Result:
            return call()

        return asyncio.run_coroutine_threadsafe(called(), self._loop).result(PATIENCE)

    def __enter__(self) -> Served:
        self._thread.start()
        assert self._open.wait(PATIENCE)
        return self

    def __exit__(self, *exception: object) -> None:
        self._loop.call_soon_threadsafe(self._server.stop)
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()


class PlainPty(serial.Serial):  # type: ignore[misc]  # pyserial ships no types
    """A pseudo-terminal has no control lines, which a server of RFC 2217 looks at."""

    cts = dsr = cd = True
    ri = False

    def _update_dtr_state(self) -> None:
        pass

    def _update_rts_state(self) -> None:
        pass

    def _update_break_state(self) -> None:
        pass


class Redirector:
    """A server of RFC 2217 in front of a serial port, one client after the other, by pyserial's half of it."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._listener = socket.create_server((LOOPBACK, 0))
        self._listener.settimeout(0.05)
        self.port = self._listener.getsockname()[1]
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def _run(self) -> None:
        while not self._stopped.is_set():
            with suppress(TimeoutError):
                client, _ = self._listener.accept()
                with client, PlainPty(self._path, timeout=0.005) as port:
                    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    client.settimeout(0.02)
                    self._redirect(client, port)

    def _redirect(self, client: socket.socket, port: serial.Serial) -> None:
        """Carry bytes both ways until the client goes."""
        lock = threading.Lock()
        over = threading.Event()

        class Connection:
            @staticmethod
            def write(data: bytes) -> None:
                with lock, suppress(OSError):
                    client.sendall(data)

        manager = PortManager(port, Connection)

        def carry_back() -> None:
            while not (over.is_set() or self._stopped.is_set()):
                if data := port.read(port.in_waiting or 1):
                    Connection.write(b"".join(manager.escape(data)))

        thread = threading.Thread(target=carry_back, daemon=True)
        thread.start()
        try:
            while not self._stopped.is_set():
                with suppress(TimeoutError):
                    data = client.recv(4096)
                    if not data:
                        break
                    port.write(b"".join(manager.filter(data)))
        except ConnectionError:
            pass
        finally:
            over.set()
            thread.join(PATIENCE)

    def __enter__(self) -> Redirector:
        self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._stopped.set()
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()
        self._listener.close()


@contextmanager
def served_url(scheme: str, *, pace: Pace = Pace.WALL, baud: int = BAUD) -> Iterator[tuple[str, Emulator]]:
    """The URL of a fresh emulated device that is reached by a scheme."""
    with Served(pty=scheme != "socket", pace=pace, baud=baud) as served:
        if scheme == "usbip":
            yield f"usbip:{LOOPBACK}:{served.usbip_port}", served.emulator
            return
        if scheme == "rfc2217":
            with Redirector(served.where) as redirector:
                yield f"rfc2217://{LOOPBACK}:{redirector.port}?baud={baud}", served.emulator
        else:
            yield f"{scheme}://{served.where}?baud={baud}", served.emulator
