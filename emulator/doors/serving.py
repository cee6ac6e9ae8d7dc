"""Doors of emulated devices to other programs: sockets and pseudo-terminals, and the loop that serves them all.

There is one loop and one thread, because a model of a device is not thread-safe. When data arrive, the device's time
first advances to the present, then the data are handled, then everyone gets a turn. No input of a client ends the
server: at worst that client is dropped. An error of the model does end it, because it is a defect of this program and
must be seen.
"""

from __future__ import annotations

import asyncio
import errno
import os
import select
import socket
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from contextlib import suppress
from math import inf
from typing import Any, Protocol, Self, cast

from .station import Conversation, Station
from .uart import Uart
from .usbip_session import Exported, UsbIpSession
from .usbredir import UsbRedirSession
from .waiting import PreciseSelector

__all__ = ["Server", "precise_loop"]

SLICE_SECONDS = 0.01
"""The longest computation of a model before clients and signals are served again."""

PATIENT_SECONDS = 1.0
"""The longest computation for a patient device before its clients are served."""

HELD_UP_SECONDS = 0.0003
"""A turn later than this was not caused by an inexact sleep alone."""

LOOK_SECONDS = 0.05
"""How often a pseudo-terminal is checked for a program that has opened it."""

CHUNK_BYTES = 1 << 16

MOST_AT_ONCE = 1 << 20
"""The greatest number of bytes read from a client at once. A stream has 20 ms of blocks under way, and after a pause
the missed time passes as soon as bytes were read: this must include all of them."""

GREETING_SECONDS = 5.0
"""How long a client may hold a place without a request."""

MOST_SILENT = 64
"""How many clients may be connected to a server before their first request; then the oldest is dropped."""


class _Link(Protocol):
    """A client at its door."""

    def flush(self) -> None:
        """Send the client its pending data."""

    def close(self) -> None:
        """Drop the client at once."""


class _Pulse:
    """The loop's view of one station: its next turn, and its clients."""

    def __init__(self, name: str, station: Station) -> None:
        self.name = name
        self.station = station
        self.links: list[_Link] = []
        self._next: asyncio.Handle | None = None
        self._turn = inf

    def hear(self, conversation: Conversation, data: bytes) -> None:
        """Pass bytes to a conversation, now; or, if the loop is too late for its turn, at the time of that turn.

        Bytes may have waited as long as the loop was delayed, and a device's queue is empty after 0.8 ms. For a patient
        device time passes first.
        """
        if self.station.patient():
            self.station.pass_time(PATIENT_SECONDS)
        elif asyncio.get_running_loop().time() < self._turn + HELD_UP_SECONDS:
            self.station.pass_time(SLICE_SECONDS)
        conversation.receive(data)
        self.beat()

    def beat(self) -> None:
        """Let time pass, send clients their pending data, and set the next turn."""
        self.rest()
        reached = self.station.pass_time(SLICE_SECONDS)
        for link in tuple(self.links):
            link.flush()
        loop = asyncio.get_running_loop()
        wait = self.station.seconds_to_wait()
        self._turn = inf if wait is None else loop.time() + wait
        if not reached:
            wait = 0.0
        if wait is not None:
            self._next = loop.call_later(max(wait, 0.0), self.beat)

    def rest(self) -> None:
        """Set no further turn."""
        if self._next:
            self._next.cancel()


class _Connection(asyncio.BufferedProtocol, ABC):
    """A client on a socket: what every TCP door has in common."""

    conversation: Conversation

    def __init__(self, server: Server, pulse: _Pulse | None) -> None:
        self._server = server
        self._pulse = pulse
        self._transport: asyncio.Transport | None = None
        self._writable = True
        self._who = ""
        self._buffer: memoryview | None = None
        self.late = False
        """Whether it has had `GREETING_SECONDS` for its first request."""

    @property
    @abstractmethod
    def has_asked(self) -> bool:
        """Whether its first request has come."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Accept a client, or turn it away if another one has its place."""
        self._transport = cast("asyncio.Transport", transport)
        if not self._begin():
            transport.set_protocol(asyncio.Protocol())
            transport.close()
            return
        with suppress(OSError):  # the client has already gone
            transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self._who = "{}:{}".format(*transport.get_extra_info("peername"))
        self._deadline = asyncio.get_running_loop().call_later(GREETING_SECONDS, self._judge)
        self._server.links.append(self)
        if self._pulse:
            self._meet(self._pulse)

    def get_buffer(self, _hint: int) -> memoryview:
        """The buffer for the next bytes, which is made for the first ones: a silent client costs none."""
        self._buffer = self._buffer or memoryview(bytearray(MOST_AT_ONCE))
        return self._buffer

    def buffer_updated(self, count: int) -> None:
        """Handle received bytes."""
        assert self._buffer
        data = bytes(self._buffer[:count])
        if self._pulse:
            self._pulse.hear(self.conversation, data)
        else:
            self.conversation.receive(data)
            self.flush()

    def connection_lost(self, _error: Exception | None) -> None:
        """The client has gone, or was dropped."""
        self._leave()
        if self._pulse:
            self._pulse.beat()
            self._server.tell(f"{self._pulse.name}: {self._who} has gone")

    def pause_writing(self) -> None:
        """The client reads too slowly."""
        self._writable = False

    def resume_writing(self) -> None:
        """The client has caught up."""
        self._writable = True
        if self._pulse:
            self._pulse.beat()
        else:
            self.flush()

    def flush(self) -> None:
        """Send the client its pending data."""
        assert self._transport
        while self._writable and self.conversation.pending:
            self._transport.write(self.conversation.take(CHUNK_BYTES))
        if self.conversation.over and not self.conversation.pending:
            self._transport.close()
        elif self.conversation.full:
            self._transport.pause_reading()
        else:
            self._transport.resume_reading()

    def close(self) -> None:
        """Drop the client at once."""
        assert self._transport
        self._leave()
        self._transport.abort()

    def drop(self, reason: str) -> None:
        """Drop the client at once, and tell why."""
        self._server.tell(f"{self._who} was dropped: {reason}")
        self.close()

    def _begin(self) -> bool:
        """Begin the conversation; returns False if another client has its place."""
        return True

    def _leave(self) -> None:
        """Give the place back, once."""
        if self in self._server.links:
            self._deadline.cancel()
            self._server.links.remove(self)
            if self._pulse:
                self._pulse.links.remove(self)
            self.conversation.hang_up()

    def _judge(self) -> None:
        """Its time for a first request has passed."""
        self.late = True
        if not self.has_asked:
            self.drop(f"it requested nothing within {GREETING_SECONDS:g} s")

    def _meet(self, pulse: _Pulse) -> None:
        self._pulse = pulse
        pulse.links.append(self)
        self._server.tell(f"{pulse.name}: {self._who} has come")


class _UsbIpConnection(_Connection):
    """A client of USB/IP, which names the device that it wants."""

    def __init__(self, server: Server, session: UsbIpSession, pulses: Mapping[Station, _Pulse]) -> None:
        super().__init__(server, None)
        self.conversation = self._session = session
        self._pulses = pulses

    @property
    def has_asked(self) -> bool:
        """Whether it has a device; the answers to all other requests end the connection."""
        return self._pulse is not None

    def buffer_updated(self, count: int) -> None:
        """Handle received bytes; they may request a device."""
        super().buffer_updated(count)
        if not self._pulse and self._session.station:
            pulse = self._pulses[self._session.station]
            self._meet(pulse)
            pulse.beat()

    def connection_lost(self, _error: Exception | None) -> None:
        """The client has gone, or was dropped."""
        if self._session.end:
            self._server.tell(f"{self._who} was dropped: {self._session.end}")
        super().connection_lost(_error)

    def _begin(self) -> bool:
        self._server.make_room()
        return True


class _UsbRedirConnection(_Connection):
    """A host of a device by usbredir; only one at a time has it."""

    def __init__(self, server: Server, exported: Exported, pulse: _Pulse) -> None:
        super().__init__(server, pulse)
        self._exported = exported

    @property
    def has_asked(self) -> bool:
        """Whether its greeting has come."""
        return self._session.greeted

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """A host has come."""
        super().connection_made(transport)
        assert self._pulse
        self._pulse.beat()

    def _begin(self) -> bool:
        if self._exported.taken:
            return False
        self.conversation = self._session = UsbRedirSession(self._exported)
        return True


class _SerialConnection(_Connection):
    """A client of a serial line; only one at a time has it.

    A person may open the line and type later. So a silent client keeps the line until another one comes.
    """

    def __init__(self, server: Server, uart: Uart, pulse: _Pulse) -> None:
        super().__init__(server, pulse)
        self.conversation = self._uart = uart

    @property
    def has_asked(self) -> bool:
        """Whether any byte has come."""
        return self._buffer is not None

    def _begin(self) -> bool:
        assert self._pulse
        for link in tuple(self._pulse.links):
            if isinstance(link, _SerialConnection) and link.late and not link.has_asked:
                link.drop("it has sent nothing yet, and another client has come")
        if self._uart.connected:
            return False
        self._uart.connect()
        return True

    def _judge(self) -> None:
        self.late = True


class _Pty:
    """A pseudo-terminal, for programs that open a serial port by its path."""

    def __init__(self, uart: Uart, pulse: _Pulse) -> None:
        import tty  # missing on some systems

        self._uart = uart
        self._pulse = pulse
        self._loop = asyncio.get_running_loop()
        self._rest = b""
        self._listens = False
        self._fd, theirs = os.openpty()
        tty.setraw(theirs)
        self.path = os.ttyname(theirs)
        os.close(theirs)  # so that the last program's close is noticed
        os.set_blocking(self._fd, False)
        self._poll = select.poll()
        self._poll.register(self._fd, select.POLLIN)
        pulse.links.append(self)
        self._look()

    def flush(self) -> None:
        """Send the program its pending data."""
        if not self._uart.connected:
            return
        while self._rest or self._uart.pending:
            data = self._rest or self._uart.take(CHUNK_BYTES)
            written = 0
            with suppress(BlockingIOError):
                written = os.write(self._fd, data)
            self._rest = data[written:]
            if self._rest:
                self._loop.add_writer(self._fd, self._pulse.beat)
                break
        else:
            self._loop.remove_writer(self._fd)
        self._listen(not self._uart.full)

    def close(self) -> None:
        """Remove the terminal."""
        self._timer.cancel()
        if self._uart.connected:
            self._uart.hang_up()
        self._listen(False)
        self._loop.remove_writer(self._fd)
        os.close(self._fd)

    def _listen(self, wanted: bool) -> None:
        """Turn the loop's watch for readable data on or off; turning it on twice would lose an event."""
        if wanted and not self._listens:
            self._loop.add_reader(self._fd, self._read)
        elif not wanted:
            self._loop.remove_reader(self._fd)
        self._listens = wanted

    def _look(self) -> None:
        """Check whether a program has opened it, or has already written something and closed it."""
        self._timer = self._loop.call_later(LOOK_SECONDS, self._look)
        events = dict(self._poll.poll(0)).get(self._fd, 0)
        if events & select.POLLIN or not events & select.POLLHUP:
            self._timer.cancel()
            self._uart.connect()
            self._listen(True)
            self._pulse.beat()

    def _read(self) -> None:
        try:
            data = os.read(self._fd, CHUNK_BYTES)
        except BlockingIOError:
            return
        except OSError:  # EIO: no program has it open any more
            data = b""
        if data:
            self._pulse.hear(self._uart, data)
            return
        self._listen(False)
        self._loop.remove_writer(self._fd)
        self._rest = b""
        self._uart.hang_up()
        self._pulse.beat()
        self._look()


def precise_loop() -> asyncio.AbstractEventLoop:
    """An event loop whose sleeps are exact to some tens of microseconds."""
    return asyncio.SelectorEventLoop(PreciseSelector())


class Server:
    """Doors of devices, open while this asynchronous context manager is entered.

    Parameters
    ----------
    stations : mapping of str to Station
        The devices, by their serial numbers.
    tell : callable
        Receives a line for people on each event.

    Attributes
    ----------
    links : list
        The clients at the doors.
    """

    def __init__(self, stations: Mapping[str, Station], tell: Callable[[str], None]) -> None:
        self.tell = tell
        self.links: list[_Link] = []
        self._pulses = {station: _Pulse(name, station) for name, station in stations.items()}
        self._listeners: list[asyncio.Server] = []
        self._told = set[str]()

    async def __aenter__(self) -> Self:
        loop = asyncio.get_running_loop()
        self._ended: asyncio.Future[None] = loop.create_future()
        loop.set_exception_handler(self._fail)
        for pulse in self._pulses.values():
            pulse.beat()
        return self

    async def __aexit__(self, *exception: object) -> None:
        for listener in self._listeners:
            listener.close()
        for link in tuple(self.links):
            link.close()
        await asyncio.sleep(0)  # connections end in the loop's next turn
        for pulse in self._pulses.values():
            pulse.rest()
        self.stop()  # from now on errors are of no interest, such as asyncio's own for a listener that is closed

    async def listen_usbip(self, exports: Mapping[str, Exported], host: str, port: int) -> int:
        """Offer devices by USB/IP; returns the port, which the system chooses for 0.

        Raises
        ------
        ValueError
            If that address cannot be used.
        """
        return await self._listen(lambda: _UsbIpConnection(self, UsbIpSession(exports), self._pulses), host, port)

    async def listen_usbredir(self, exported: Exported, host: str, port: int) -> int:
        """Offer a device by usbredir; returns the port, which the system chooses for 0.

        Raises
        ------
        ValueError
            If that address cannot be used.
        """
        pulse = self._pulses[exported.station]
        return await self._listen(lambda: _UsbRedirConnection(self, exported, pulse), host, port)

    async def listen_serial(self, uart: Uart, station: Station, host: str, port: int) -> int:
        """Offer a serial line by TCP; returns the port, which the system chooses for 0.

        Raises
        ------
        ValueError
            If that address cannot be used.
        """
        station.conversations.append(uart)
        pulse = self._pulses[station]
        return await self._listen(lambda: _SerialConnection(self, uart, pulse), host, port)

    def open_pty(self, uart: Uart, station: Station) -> str:
        """Offer a serial line as a pseudo-terminal; returns its path.

        Raises
        ------
        ValueError
            If the system has no pseudo-terminals.
        """
        if not hasattr(os, "openpty"):
            raise ValueError("this system has no pseudo-terminals; offer the serial line by TCP")
        station.conversations.append(uart)
        pty = _Pty(uart, self._pulses[station])
        self.links.append(pty)
        return pty.path

    async def serve(self, seconds: float | None = None) -> None:
        """Serve until `stop`, or for so many seconds.

        Raises
        ------
        Exception
            Any error of a model.
        """
        with suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                await self._ended

    def make_room(self) -> None:
        """Drop the client that has been silent for longest if there are too many; the first time is told."""
        silent = [link for link in self.links if isinstance(link, _Connection) and not link.has_asked]
        if len(silent) >= MOST_SILENT:
            self._tell_once(f"{MOST_SILENT} clients have requested nothing yet: the oldest is dropped for each new one")
            silent[0].close()

    def stop(self) -> None:
        """Make `serve` return."""
        if not self._ended.done():
            self._ended.set_result(None)

    async def _listen(self, meet: Callable[[], asyncio.BaseProtocol], host: str, port: int) -> int:
        try:
            listener = await asyncio.get_running_loop().create_server(meet, host, port)
        except OSError as error:
            raise ValueError(
                f"cannot listen on {host}, port {port} ({error.strerror}); choose another address or port, 0 for any"
            ) from error
        self._listeners.append(listener)
        return int(listener.sockets[0].getsockname()[1])

    def _fail(self, _loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        error = context.get("exception")
        if isinstance(error, OSError) and error.errno in (errno.EMFILE, errno.ENFILE):
            self._tell_once(f"no further client can connect for now: {error.strerror}; `ulimit -n` is the limit")
        if isinstance(error, OSError) or self._ended.done():
            return  # a client's connection broke, or we are about to leave
        self._ended.set_exception(error or RuntimeError(context["message"]))

    def _tell_once(self, line: str) -> None:
        if line not in self._told:
            self._told.add(line)
            self.tell(line)
