"""Texts of peers and files that would steer a terminal: no command shows them raw."""

from __future__ import annotations

import re
import socket
import struct
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.base.errors import visible

from .runner import Run

STEERS = "\x1b]0;owned\x07\x1b[31m\r\x9b2J\x7f\u202e\u2066"
CONTROL = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def file_of(name: str, text: str) -> Callable[[Path], str]:
    def make(folder: Path) -> str:
        (folder / name).write_text(text, encoding="utf-8", newline="")
        return name

    return make


def usbip_server(_folder: Path) -> str:
    """A server whose only device has a bus id that steers."""
    listener = socket.create_server(("127.0.0.1", 0))
    device = struct.pack(">256s32sIIIHHHBBBBBB", b"", STEERS[:12].encode(), 1, 1, 3, 0x1209, 1, 0, 0, 0, 0, 1, 1, 1)

    def serve() -> None:
        with listener:
            listener.settimeout(10)
            line, _ = listener.accept()
            with line:
                line.recv(100)
                line.sendall(struct.pack(">HHII", 0x0111, 5, 0, 1) + device + b"\x03\0\0\0")  # not our class

    threading.Thread(target=serve, daemon=True).start()
    return f"usbip:127.0.0.1:{listener.getsockname()[1]}"


DOORS: dict[str, tuple[list[str], Callable[[Path], str]]] = {
    "usbip": (["info", "--device"], usbip_server),
    "assembly": (["xs1", "asm", "-o", "out"], file_of("a.S", f"  {STEERS} r0, r1\n")),
    "profile": (["conformance", "--profile"], file_of("p.toml", f'"{STEERS[3:9]}\\u001b[31m" = 1\n')),
    "rig": (["devices", "--rig"], file_of("r.toml", '[[device]]\n"\\u001b[31m" = 1\n')),
    "points": (["solve", "-o", "out.npz"], file_of("p.csv", f"x,y,z\n0,0,{STEERS}\n")),
    "known": (["conformance", "--known-failures"], file_of("k.toml", '"\\u001b[31m" = "x"\n')),
    "scenario": (["emulate", "--scenario"], file_of("s.toml", '"\\u001b[31m" = 1\n')),
    "sweep": (["sweep", "-o", "out.parquet"], file_of("w.toml", '"\\u001b[31m" = 1\n')),
    "a name": (["solve", "-o", "out.npz"], lambda _: f"{STEERS}.csv"),
    "a URL": (["info", "--device"], lambda _: f"usb:{STEERS}"),
}


@pytest.mark.parametrize("door", DOORS)
def test_no_command_shows_a_hostile_text_raw(door: str, phasewire: Run, tmp_path: Path) -> None:
    command, make = DOORS[door]
    code, out, err = phasewire(*command, make(tmp_path))
    assert code in (1, 2, 3)
    assert "Usage" not in err
    assert "\\x1b" in out + err, "it is shown, as an escape sequence"
    assert not CONTROL.search(out + err)


@given(st.text())
def test_what_is_visible_has_no_control_character_and_stays_so(text: str) -> None:
    assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]", visible(text))
    assert visible(visible(text)) == visible(text)
    assert text.isprintable() <= (visible(text) == text)
