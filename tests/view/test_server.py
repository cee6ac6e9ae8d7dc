"""The server against clients that are slow, silent, strange or hostile."""

from __future__ import annotations

import http.client
import logging
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from phasewire.view import server as module
from phasewire.view.messages import MOST_COMMAND_BYTES, encode
from phasewire.view.server import PageServer, is_loopback
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from tests.attacks import ATTACKS, attacked, no_files

from .pages import PATIENCE, Page, address, page_of


class Heard:
    """What the server told its owner."""

    def __init__(self) -> None:
        self.texts: list[str] = []
        self.gone = threading.Event()


@contextmanager
def serving(**options: Any) -> Iterator[tuple[PageServer, Heard]]:
    heard = Heard()
    server = PageServer(on_message=heard.texts.append, on_page=lambda: None, on_gone=heard.gone.set, **options)
    server.start()
    try:
        yield server, heard
    finally:
        server.close()


@pytest.fixture
def served() -> Iterator[tuple[PageServer, Heard]]:
    with serving() as both:
        yield both


def until(holds: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.005)


def ended(page: Page) -> bool:
    """Whether the server ends the connection of a page."""
    try:
        while True:
            page.socket.recv(timeout=PATIENCE)
    except ConnectionClosed:
        return True


def get(url: str, path: str, **headers: str) -> http.client.HTTPResponse:
    host, _ = address(url)
    connection = http.client.HTTPConnection(host, timeout=PATIENCE)
    connection.request("GET", path, headers=headers)
    response = connection.getresponse()
    response.body = response.read()  # type: ignore[attr-defined]
    return response


def frame(number: int) -> bytes:
    return encode("frame", {"number": number})


def test_the_page_and_what_draws_come_from_here_and_may_load_nothing_else(served: tuple[PageServer, Heard]) -> None:
    url = served[0].url
    for path in module.SOURCES:
        response = get(url, path)
        assert response.status == 200
        assert response.body  # type: ignore[attr-defined]
        policy = {
            rule.split()[0]: rule.split()[1:] for rule in response.getheader("Content-Security-Policy", "").split(";")
        }
        assert policy["default-src"] == ["'none'"]
        assert policy["script-src"] == policy["style-src"] == ["'self'"]
        assert policy["frame-ancestors"] == ["'none'"]
        assert response.getheader("X-Content-Type-Options") == "nosniff"
        assert b"http" not in (response.body if path in ("/", "/page.css") else b"")  # type: ignore[attr-defined]
    assert get(url, "/three.js").body.count(b"InstancedMesh")  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "path", ["/page", "/../server.py", "/page/index.html", "/%2e%2e/server.py", "//etc/passwd", "/ws2"]
)
def test_there_is_nothing_else(served: tuple[PageServer, Heard], path: str) -> None:
    assert get(served[0].url, path).status == 404


def test_it_listens_on_this_computer_only(served: tuple[PageServer, Heard]) -> None:
    host, _ = address(served[0].url)
    assert host.startswith("127.0.0.1:")
    with pytest.raises(OSError, match=r"127\.0\.0\.1"), serving(port=int(host.rpartition(":")[2])):
        pass


@pytest.mark.parametrize(
    ("host", "ours"),
    [
        ("127.0.0.1:{port}", True),
        ("localhost:{port}", True),
        ("LocalHost:{port}", True),
        ("evil.example", False),
        ("evil.example:{port}", False),
        ("127.0.0.1", False),
        ("127.0.0.1:1", False),
        ("localhost.evil.example:{port}", False),
        ("127.0.0.1.evil.example:{port}", False),
        ("x@127.0.0.1:{port}", False),
        ("127.0.0.1:{port}/evil", False),
        ("127.0.0.1:{port}?evil", False),
        ("127.0.0.1:{port}#evil", False),
        ("127.0.0.1:{port}\\evil", False),
        ("127.0.0.1:{port}:{port}", False),
        ("127.0.0.1:{port},evil.example", False),
        ("127.0.0.1 :{port}", False),
        ("127.0.0.1:0{port}", False),
        ("127.0.0.1:+{port}", False),
        ("[127.0.0.1]:{port}", False),
        ("[::1]:{port}", False),
        ("[:{port}", False),
        ("::1:{port}", False),
        ("127.0.0.1:9999999", False),
        (":{port}", False),
        ("", False),
    ],
)
def test_a_host_is_this_server_by_its_address_or_localhost_alone(
    served: tuple[PageServer, Heard], host: str, ours: bool
) -> None:
    port = address(served[0].url)[0].rpartition(":")[2]
    assert get(served[0].url, "/", Host=host.format(port=port)).status == (200 if ours else 403)


@pytest.mark.parametrize(
    ("origin", "token"),
    [
        ("http://evil.example", None),
        ("null", None),
        ("https://{host}", None),
        (None, None),
        ("http://{host}", ""),
        ("http://{host}", "x" * 22),
        ("http://{host}", "ü"),
    ],
)
def test_a_foreign_origin_or_a_wrong_token_opens_no_socket(
    served: tuple[PageServer, Heard], origin: str | None, token: str | None
) -> None:
    host, right = address(served[0].url)
    said = None if origin is None else origin.format(host=host)
    with pytest.raises(InvalidStatus) as refused:
        connect(f"ws://{host}/ws?token={right if token is None else token}", origin=said, proxy=None)  # type: ignore[arg-type]
    assert refused.value.response.status_code == 403
    assert not served[0].seen.is_set()


def test_a_slow_page_gets_the_newest_frame_only(served: tuple[PageServer, Heard]) -> None:
    server, _ = served
    with page_of(server.url) as page:
        assert server.wanted.wait(PATIENCE)
        server.publish(frame(0))
        data = page.socket.recv(timeout=PATIENCE)
        assert b'"number":0' in bytes(data)  # type: ignore[arg-type]
        for number in range(1, 50):
            server.publish(frame(number))
        until(lambda: not server.wanted.is_set())
        page.socket.send("ack")
        assert page.frame()["number"] == 49
        assert server.wanted.wait(PATIENCE)


def test_a_page_that_never_answers_is_lost_and_the_others_are_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PATIENCE_SECONDS", 0.3)
    with serving() as (server, heard), page_of(server.url) as hung, page_of(server.url) as alive:
        until(lambda: server.pages == 2)
        number = 0
        while server.pages == 2:
            server.publish(frame(number))
            assert alive.frame()["number"] >= 0
            number += 1
        assert ended(hung)
        assert not heard.gone.is_set()
        server.publish(frame(-1))
        alive.until(lambda message: message["number"] == -1)


def test_whoever_publishes_never_waits_for_a_page_that_does_not_read(served: tuple[PageServer, Heard]) -> None:
    """The page takes nothing from its socket: frames of a hundred times its buffers are published all the same."""
    server, _ = served
    host, token = address(server.url)
    name, port = host.split(":")
    with socket.create_connection((name, int(port))) as raw:
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        raw.sendall(
            f"GET /ws?token={token} HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\n"
            "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n".encode()
        )
        until(lambda: server.pages == 1)
        large = encode("frame", {"filler": "x" * 2**20})
        for _ in range(100):
            server.publish(large)
        server.close()  # ends, although the page still holds its connection


def test_a_cut_line_counts_as_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    """The page's computer vanishes: nothing comes any more, not even the end of the connection."""
    monkeypatch.setattr(module, "PING_SECONDS", 0.1)
    monkeypatch.setattr(module, "PATIENCE_SECONDS", 0.3)
    with serving() as (server, heard), page_of(server.url) as page:
        until(lambda: server.pages == 1)
        page.socket.protocol.receive_data = lambda data: None  # type: ignore[method-assign]
        assert heard.gone.wait(PATIENCE)


@pytest.mark.parametrize("attack", ATTACKS, ids=lambda attack: attack.__name__)
def test_no_attack_ends_the_service_of_other_pages(
    attack: Callable[..., None], monkeypatch: pytest.MonkeyPatch, served: tuple[PageServer, Heard]
) -> None:
    monkeypatch.setattr("asyncio.constants.ACCEPT_RETRY_DELAY", 0.01)
    server, _ = served
    with page_of(server.url) as first:
        with attacked(attack, server._port) as crowd:
            server.keep("news", encode("news", {}, {}))
            until(lambda: bool(first.receive()))
            if attack is no_files:
                crowd.close()
            with page_of(server.url) as second:
                assert second.receive()["kind"] == "news"
        assert get(server.url, "/").status == http.HTTPStatus.OK


def test_silent_connections_end_and_pages_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PATIENCE_SECONDS", 0.1)
    monkeypatch.setattr(module, "MOST_PAGES", 1)
    with serving() as (server, _):
        with socket.create_connection(("127.0.0.1", server._port), PATIENCE) as silent:
            assert silent.recv(1) == b""
        with page_of(server.url), pytest.raises(InvalidStatus) as refused, page_of(server.url):
            pass
    assert refused.value.response.status_code == http.HTTPStatus.SERVICE_UNAVAILABLE


@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(garbage=st.lists(st.binary(max_size=200) | st.text(max_size=200), max_size=5))
def test_garbage_reaches_the_owner_as_text_or_nobody(
    served: tuple[PageServer, Heard], garbage: list[bytes | str]
) -> None:
    server, heard = served
    before = len(heard.texts)
    with page_of(server.url) as page:
        for each in garbage:
            page.socket.send(each)
        page.socket.send("the end")
        until(lambda: heard.texts[-1:] == ["the end"])
    assert heard.texts[before:-1] == [each for each in garbage if isinstance(each, str) and each != "ack"]
    until(lambda: server.pages == 0)
    heard.texts.clear()


def test_a_text_that_is_too_long_ends_the_connection(served: tuple[PageServer, Heard]) -> None:
    server, heard = served
    with page_of(server.url) as page:
        page.socket.send("x" * (MOST_COMMAND_BYTES + 1))
        assert ended(page)
    assert heard.gone.wait(PATIENCE)
    assert heard.texts == []


@pytest.mark.parametrize("saving", [True, False])
def test_pictures_are_taken_only_if_they_were_asked_for(saving: bool) -> None:
    with serving(saving=saving) as (server, heard), page_of(server.url) as page:
        page.socket.send(b"picture")
        page.socket.send("after it")
        until(lambda: heard.texts == ["after it"])
        assert server.saved == ([b"picture"] if saving else [])


HEAD = "Host: {host}\r\nOrigin: http://{host}\r\n"
UPGRADE = (
    "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
)
OPENED = "GET /ws?token={token} HTTP/1.1\r\n" + HEAD + UPGRADE
STRANGE = {
    "nothing": "",
    "zeros": "\0" * 1000,
    "half a request": "GET / HT",
    "half a head": "GET / HTTP/1.1\r\n" + HEAD,
    "two hosts": "GET / HTTP/1.1\r\nHost: {host}\r\nHost: {host}\r\n\r\n",
    "POST": "POST / HTTP/1.1\r\n" + HEAD + "\r\n",
    "a body": "GET / HTTP/1.1\r\n" + HEAD + "Content-Length: 5\r\n\r\nabcde",
    "a long line": "GET /" + "x" * 100_000,
    "many headers": "GET / HTTP/1.1\r\n" + "A: b\r\n" * 1000 + "\r\n",
    "no colon": "GET / HTTP/1.1\r\nnothing\r\n\r\n",
    "HTTP/2": "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
    "TLS": "\x16\x03\x01\0\xa5\x01\0\0\xa1\x03\x03" + "\xff" * 160,
    "a path that is none": "GET //[ HTTP/1.1\r\n" + HEAD + "\r\n",
    "another version": OPENED.replace(": 13", ": 7"),
    "a bad key": OPENED.replace("A==", "!"),
    "no upgrade": OPENED.replace("Upgrade: websocket", "A: b"),
    "a page and silence": OPENED,
    "a page and zeros": OPENED + "\0" * 100,
    "a page and garbage": OPENED + "\xff" * 100,
    "a page that closes": OPENED + "\x88\x82\0\0\0\0\x03\xe8",
}


def log_nowhere(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a program that sets up no logging: Python prints warnings on standard error."""
    monkeypatch.setattr(logging.getLogger(), "handlers", [])


@pytest.mark.parametrize("end", ["reset", "shut", "close"])
def test_whatever_strangers_send_nothing_is_printed(
    served: tuple[PageServer, Heard], end: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    log_nowhere(monkeypatch)
    host, token = address(served[0].url)
    name, port = host.split(":")
    for said in STRANGE.values():
        with socket.create_connection((name, int(port)), timeout=PATIENCE) as raw:
            raw.sendall(said.replace("{host}", host).replace("{token}", token).encode("latin-1"))
            if end == "reset":
                raw.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            elif end == "shut":
                raw.shutdown(socket.SHUT_WR)
                while raw.recv(4096):
                    pass
    assert get(served[0].url, "/").status == 200
    until(lambda: served[0].pages == 0)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("listen", "alone"),
    [
        ("127.0.0.1", True),
        ("::1", True),
        ("localhost", True),
        ("127.0.0.2", True),
        ("0.0.0.0", False),
        ("::", False),
        ("192.168.1.2", False),
    ],
)
def test_what_others_can_reach_is_known(listen: str, alone: bool) -> None:
    assert is_loopback(listen) == alone


def test_everywhere_means_addresses_and_the_computers_name_but_no_other() -> None:
    with serving(listen="0.0.0.0") as (server, _):
        port = address(server.url)[0].rpartition(":")[2]
        for host, status in (("127.0.0.1", 200), ("10.1.2.3", 200), (socket.gethostname(), 200), ("evil.example", 403)):
            response = http.client.HTTPConnection("127.0.0.1", int(port), timeout=PATIENCE)
            response.request("GET", "/", headers={"Host": f"{host}:{port}"})
            assert response.getresponse().status == status
