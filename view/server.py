"""The server of the page, in a thread of its own. No caller waits for a page.

A page gets every other message in order, but only the newest frame, and only when it has taken in the last one
(`messages.ACK`). A page that does not answer for `PATIENCE_SECONDS` counts as lost. A request must name this server as
its host, and a socket must have the token and this server's page as its origin. So a page of a stranger gets nothing,
nor does a request by a name that a stranger has pointed to this computer.
"""

from __future__ import annotations

import asyncio
import hmac
import http
import ipaddress
import logging
import re
import secrets
import socket
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from importlib.resources import files
from threading import Event, Thread
from typing import Any
from urllib.parse import parse_qs

from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from .messages import ACK, MOST_COMMAND_BYTES

__all__ = ["LOOPBACK", "PATIENCE_SECONDS", "PageServer", "is_loopback"]

_log = logging.getLogger(__name__)
_websockets = logging.getLogger(f"{__name__}.websockets")
_websockets.addHandler(logging.NullHandler())  # else Python prints what strangers send, with tracebacks

LOOPBACK = "127.0.0.1"
EVERYWHERE = {"0.0.0.0": socket.gethostname(), "::": "::1"}
"""Addresses that mean all of a computer's, and the name by which its own browser finds it there."""
PATIENCE_SECONDS = 5.0
PING_SECONDS = 1.0
MOST_PAGES = 32
MOST_SAVED_BYTES = 2**28
MOST_PENDING = 100
DEFAULT_PORT = 80
"""Which a browser leaves out."""
HOST = re.compile(r"(?:\[(?P<six>[0-9a-f:.]+)\]|(?P<name>[0-9a-z._-]+))(?::(?P<port>[1-9][0-9]{0,4}))?", re.ASCII)
"""A Host as a browser sends it, in lower case."""
SOCKET = "/ws"
THREE = ("jupyter_threejs_sage", "static/r130/three.min.js")
"""three.js as SageMath packages it: a script of one file, with the controls of a camera."""
SOURCES: Mapping[str, tuple[tuple[str, str], str]] = {
    "/": ((__package__, "page/index.html"), "text/html"),
    "/page.css": ((__package__, "page/page.css"), "text/css"),
    "/page.js": ((__package__, "page/page.js"), "text/javascript"),
    "/scene.js": ((__package__, "page/scene.js"), "text/javascript"),
    "/three.js": (THREE, "text/javascript"),
}


class _Client:
    """One page."""

    def __init__(self, kept: Mapping[str, bytes]) -> None:
        self.wake = asyncio.Event()
        self.pending: deque[tuple[str, bytes]] = deque(kept.items())
        """What is to be sent before the next frame: the name under which it is kept, or none, and the message."""
        self.frame: bytes | None = None
        self.patient_until: float | None = None
        """Until when it may take in the last frame; None if it has."""
        self.wake.set()


class PageServer:
    """Serves the page and its frames.

    Parameters
    ----------
    listen, port
        Address to listen at; port 0 for any that is free.
    on_message, on_page, on_gone : callable
        Called in the server's thread: with each text from a page, when a page has come, which has no frame yet, and
        when the last page has gone.
    embedded : bool
        Whether another page of this computer, such as a notebook, may show it in a frame.
    saving : bool
        Whether a page may send a picture.

    Attributes
    ----------
    wanted : threading.Event
        Set while a page waits for a frame.
    saved : list of bytes
        Pictures that pages have sent.
    """

    def __init__(
        self,
        *,
        listen: str = LOOPBACK,
        port: int = 0,
        on_message: Callable[[str], None],
        on_page: Callable[[], None],
        on_gone: Callable[[], None],
        embedded: bool = False,
        saving: bool = False,
    ) -> None:
        if not listen:
            raise ValueError("the address to listen at must not be empty; 127.0.0.1 is this computer alone")
        self._listen, self._port = listen, port
        self._on_message, self._on_page, self._on_gone = on_message, on_page, on_gone
        self._embedded, self._saving = embedded, saving
        self._token = secrets.token_urlsafe(16)
        self._kept: dict[str, bytes] = {}
        self._clients: set[_Client] = set()
        self._loop = asyncio.new_event_loop()
        self._loop.set_exception_handler(self._tell_trouble)
        self._troubles: set[str] = set()
        self._stopped = asyncio.Event()
        self._started = Event()
        self._failure: Exception | None = None
        self._thread = Thread(target=self._run, name="phasewire view server", daemon=True)
        self.wanted = Event()
        self.seen = Event()
        """Is set when the first page has come."""
        self.saved: list[bytes] = []
        self.received = Event()
        """Is set when a picture has come."""

    def start(self) -> None:
        """Listen, in a thread of its own; raises `OSError` if the address cannot be used."""
        self._thread.start()
        self._started.wait()
        if self._failure is not None:
            number, why = getattr(self._failure, "errno", 0), getattr(self._failure, "strerror", None)
            said = f"the page cannot be served there: {why or self._failure}"
            raise OSError(number, said, f"{self._listen}:{self._port}") from self._failure

    def close(self) -> None:
        """End the server, and with it the connections of all pages."""
        if self._thread.is_alive():
            with suppress(RuntimeError):  # it ended in between
                self._loop.call_soon_threadsafe(self._stopped.set)
            self._thread.join()

    @property
    def pages(self) -> int:
        """How many pages are connected."""
        return len(self._clients)

    @property
    def url(self) -> str:
        """Where a browser finds the page, with the token, which a browser does not send on with requests."""
        host = EVERYWHERE.get(self._listen, self._listen)
        return f"http://{f'[{host}]' if ':' in host else host}:{self._port}/#{self._token}"

    def keep(self, name: str, message: bytes) -> None:
        """Send a message to all pages, and to each that comes later; it replaces the last one of its name."""
        self._call(self._keep, name, message)

    def tell(self, message: bytes) -> None:
        """Send a message to the pages that are open now."""
        self._call(self._tell, message)

    def publish(self, frame: bytes) -> None:
        """Show a frame on the pages that wait for one; the others get the newest when they do."""
        self._call(self._publish, frame)

    def _call(self, what: Callable[..., None], *arguments: Any) -> None:
        with suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(what, *arguments)

    # In the server's thread

    def _tell_trouble(self, _loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """Say once what fails in the loop, such as an open file too many, instead of asyncio's lines."""
        why = context.get("exception") or context["message"]
        said = f"the page's server is in trouble: {getattr(why, 'strerror', None) or why or repr(why)}"
        if said not in self._troubles:
            self._troubles.add(said)
            _log.warning(said)

    def _run(self) -> None:
        try:
            self._loop.run_until_complete(self._serve())
        finally:
            self._started.set()
            self._loop.close()

    async def _serve(self) -> None:
        try:
            server = await serve(
                self._page,
                self._listen,
                self._port,
                process_request=self._answer,
                compression=None,
                max_size=MOST_SAVED_BYTES if self._saving else MOST_COMMAND_BYTES,
                open_timeout=PATIENCE_SECONDS,
                ping_interval=PING_SECONDS,
                ping_timeout=PATIENCE_SECONDS,
                close_timeout=1.0,
                server_header=None,
                logger=_websockets,
            )
        except (OSError, ValueError, OverflowError) as error:  # the latter two for what is no address
            self._failure = error
            return
        self._port = next(iter(server.sockets)).getsockname()[1]
        self._started.set()
        async with server:
            await self._stopped.wait()

    def _keep(self, name: str, message: bytes) -> None:
        self._kept[name] = message
        for client in self._clients:
            client.pending = deque(each for each in client.pending if each[0] != name)
            client.pending.append((name, message))
            client.wake.set()

    def _tell(self, message: bytes) -> None:
        for client in self._clients:
            if len(client.pending) < MOST_PENDING:  # one that reads nothing gets no more
                client.pending.append(("", message))
                client.wake.set()

    def _publish(self, frame: bytes) -> None:
        for client in self._clients:
            client.frame = frame
            client.wake.set()
        self._note_wanted()

    def _note_wanted(self) -> None:
        if any(client.patient_until is None and client.frame is None for client in self._clients):
            self.wanted.set()
        else:
            self.wanted.clear()

    async def _page(self, connection: ServerConnection) -> None:
        client = _Client(self._kept)
        self._clients.add(client)
        self.seen.set()
        self._note_wanted()
        self._on_page()
        sending = asyncio.create_task(self._send(connection, client))
        try:
            async for message in connection:
                self._hear(client, message)
        except ConnectionClosed:
            pass  # the page, or the line to it, is gone
        finally:
            sending.cancel()
            self._clients.discard(client)
            self._note_wanted()
            if not self._clients:
                self._on_gone()

    def _hear(self, client: _Client, message: str | bytes) -> None:
        if message == ACK:
            client.patient_until = None
            client.wake.set()
            self._note_wanted()
        elif isinstance(message, str):
            self._on_message(message)
        elif self._saving:
            self.saved.append(message)
            self.received.set()

    async def _send(self, connection: ServerConnection, client: _Client) -> None:
        """Send what there is for a page, until its connection ends."""
        with suppress(ConnectionClosed):
            while True:
                try:
                    async with asyncio.timeout_at(client.patient_until):
                        await client.wake.wait()
                except TimeoutError:
                    await connection.close(1008, "no answer to a frame")
                    return
                client.wake.clear()
                while client.pending:
                    await connection.send(client.pending.popleft()[1])
                if client.patient_until is None and client.frame is not None:
                    frame, client.frame = client.frame, None
                    client.patient_until = self._loop.time() + PATIENCE_SECONDS
                    await connection.send(frame)
                    self._note_wanted()

    # Requests

    def _answer(self, _connection: ServerConnection, request: Request) -> Response | None:
        """Answer a request for a file; None lets a page open its socket."""
        try:
            return self._answered(request)
        except (LookupError, ValueError):  # two hosts, or a path that is none
            return self._said(http.HTTPStatus.BAD_REQUEST, "this request is not valid")

    def _answered(self, request: Request) -> Response | None:
        host = request.headers.get("Host", "")
        if not self._is_us(host):
            return self._said(http.HTTPStatus.FORBIDDEN, "the Host of this request is not this server")
        path, _, query = request.path.partition("?")
        if path == SOCKET:
            if request.headers.get("Origin") != f"http://{host}":
                return self._said(http.HTTPStatus.FORBIDDEN, "the Origin of this request is not this server's page")
            given = parse_qs(query).get("token", [""])[-1]
            if not hmac.compare_digest(given.encode(), self._token.encode()):
                return self._said(
                    http.HTTPStatus.FORBIDDEN, "the token is wrong: open the URL that the program printed"
                )
            if len(self._clients) >= MOST_PAGES:
                return self._said(
                    http.HTTPStatus.SERVICE_UNAVAILABLE, f"{MOST_PAGES} pages are open already: close one of them"
                )
            return None
        if path not in SOURCES:
            return self._said(http.HTTPStatus.NOT_FOUND, "there is no such page")
        place, kind = SOURCES[path]
        return self._response(http.HTTPStatus.OK, _source(*place), kind)

    def _is_us(self, host: str) -> bool:
        """Whether a Host names this server; if it listens everywhere, by an address or this computer's name."""
        asked = HOST.fullmatch(host.lower())
        if asked is None or int(asked["port"] or DEFAULT_PORT) != self._port:
            return False
        name = asked["name"] or asked["six"]
        if asked["six"] and (not _is_address(name) or ipaddress.ip_address(name).version == 4):
            return False
        if name in (self._listen.lower(), "localhost"):
            return True
        return self._listen in EVERYWHERE and (name == socket.gethostname().lower() or _is_address(name))

    def _said(self, status: http.HTTPStatus, text: str) -> Response:
        return self._response(status, f"{text}\n".encode(), "text/plain")

    def _response(self, status: http.HTTPStatus, body: bytes, kind: str) -> Response:
        ancestors = (
            "http://localhost:* http://127.0.0.1:* https://localhost:* https://127.0.0.1:*"
            if self._embedded
            else "'none'"
        )
        policy = (
            "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self' ws:; "
            "img-src 'self' data: blob:; media-src blob:; base-uri 'none'; form-action 'none'; "
            f"frame-ancestors {ancestors}"
        )
        headers = {
            "Content-Type": f"{kind}; charset=utf-8",
            "Content-Length": str(len(body)),
            "Content-Security-Policy": policy,
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
            "Cache-Control": "no-store",
            "Connection": "close",
        }
        return Response(status.value, status.phrase, Headers(headers), body)


def is_loopback(listen: str) -> bool:
    """Whether only this computer can reach an address."""
    return listen == "localhost" or (_is_address(listen) and ipaddress.ip_address(listen).is_loopback)


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


@cache
def _source(package: str, path: str) -> bytes:
    return files(package).joinpath(path).read_bytes()
