"""``phasewire decode``: its output, its files, and its exit codes."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from phasewire import Emulator, Solution, open_device
from phasewire.cli.decode import explain
from phasewire.emulator.doors.backend import EmulatorBackend
from phasewire.hil.traffic.traffic import Piece, Traffic
from phasewire.protocol import Pulses
from phasewire.protocol.codes import AckFlag, FrameKind, Reason, State
from phasewire.protocol.framing import SerialFrame, encode
from phasewire.protocol.replies import Ack

from tests.captures import bulk_in, bulk_out, control, pcapng
from tests.cli.runner import Run
from tests.strategies import update

SILENT = Pulses.silent(320)
GOOD = update(SILENT, 1)
BAD = GOOD[:-1] + b"\1"
ACK = Ack(Reason.ACCEPTED, 1, 300, 14_000, AckFlag(0), 3, State.PLAYING).encode()
GET_INFO = bytes.fromhex("c1 01 0000 0000 4000")


@pytest.fixture
def decode(phasewire: Run) -> Run:
    return partial(phasewire, "decode")


@pytest.fixture
def capture(tmp_path: Path) -> Path:
    path = tmp_path / "c.pcapng"
    packets = [
        *control(1, GET_INFO, status=-32, at=100),
        *bulk_out(2, GOOD + BAD, at=200),
        *bulk_in(3, ACK, at=300),
        *bulk_out(4, b"info\r", at=400, endpoint=0x03),
        *bulk_out(5, GOOD, at=500, captured=64),
        *bulk_out(6, GOOD, at=600)[:1],
        *bulk_out(6, GOOD, at=700),
    ]
    path.write_bytes(pcapng(packets))
    return path


def test_a_capture_is_explained_line_by_line(decode: Run, capture: Path) -> None:
    outcome = decode(capture.name)
    assert outcome.code == 1
    assert [" ".join(line.split()) for line in outcome.out.splitlines()] == [
        "packet 1 0.000060 s in request INFO, answered with STALL",
        "packet 3 0.000100 s out block UPDATE 1: silence as soon as possible",
        "packet 3 +512 0.000100 s out block UPDATE 1",
        "✗ CHECKSUM BLK-003: CRC-32 " + outcome.out.split("CRC-32 ")[1].splitlines()[0],
        "packet 6 0.000300 s in acknowledgement 1 accepted, period 300; PLAYING at tick 14000, room for 3",
        "packet 7 0.000300 s out text info\\r",
        "packet 9 0.000400 s out block UPDATE 1",
        "✗ 448 of its bytes were not recorded",
        "packet 11 0.000500 s out block UPDATE 1: silence as soon as possible",
        "packet 11 0.000500 s out transfer of blocks",
        "✗ its completion was not recorded",
        "packet 12 0.000600 s out block UPDATE 1: silence as soon as possible",
        "1 request, 5 blocks, 1 acknowledgement, 1 text, 1 transfer, 3 invalid",
    ]


def test_an_answer_that_was_not_recorded_whole_is_not_judged() -> None:
    for piece, text in (
        (
            Piece("here", Traffic.REQUEST, "in", bytes(10), setup=GET_INFO, missing=54),
            "54 of its bytes were not recorded",
        ),
        (
            Piece("here", Traffic.REQUEST, "in", bytes(63), setup=GET_INFO, missing=1),
            "1 of its bytes were not recorded",
        ),
        (Piece("here", Traffic.REQUEST, "in", b"", setup=GET_INFO, problem="no answer"), "no answer"),
    ):
        described = explain(piece)
        assert described.summary == "INFO"
        assert [finding.text for finding in described.findings] == [text]


def test_only_what_is_invalid_can_be_shown(decode: Run, capture: Path) -> None:
    outcome = decode(capture.name, "--only-invalid", "--json", "-")
    record = json.loads(outcome.out)
    assert record["format"] == "phasewire-decode-1"
    assert (record["file"], record["invalid"], record["kinds"]["block"]) == ("c.pcapng", 3, 5)
    assert [(piece["where"], piece["valid"]) for piece in record["pieces"]] == [
        ("packet 3 +512", False),
        ("packet 9", False),
        ("packet 11", False),
    ]
    (finding,) = record["pieces"][0]["findings"]
    assert (finding["reason"], finding["clause"]) == ("CHECKSUM", "BLK-003")
    assert "packet 6" not in outcome.err
    assert "3 invalid" in outcome.err


def test_json_has_the_fields_of_each_piece(decode: Run, tmp_path: Path) -> None:
    (tmp_path / "b.bin").write_bytes(GOOD + ACK)
    outcome = decode("b.bin", "--pulses", "--json", "b.json")
    assert outcome.code == 0
    update_, ack = json.loads((tmp_path / "b.json").read_text())["pieces"]
    assert (update_["kind"], update_["time_s"], update_["fields"]["sequence"]) == ("block", None, 1)
    assert (update_["phase"], update_["width"]) == ([0] * 320, [0] * 320)
    assert (ack["direction"], ack["fields"]["state"]) == ("in", "PLAYING")


def test_json_without_pieces_is_valid(decode: Run, tmp_path: Path) -> None:
    (tmp_path / "b.bin").write_bytes(GOOD)
    assert json.loads(decode("b.bin", "--only-invalid", "--json", "-").out)["pieces"] == []


def test_pulses_are_listed_row_by_row(decode: Run) -> None:
    pulses = Pulses([*range(100), *range(100), *range(100), *range(20)], [25] * 320)
    rows = decode("--hex", update(pulses, 1).hex(), "--pulses").out.splitlines()[1:-1]
    assert [len(row.split()) for row in rows] == [20] * 16
    assert rows[1].split() == [f"{phase}/25" for phase in range(20, 40)]


def test_hex_text_is_taken_as_it_is(decode: Run) -> None:
    assert decode("--hex", GOOD.hex()).out.endswith("1 block, 0 invalid\n")
    assert decode("--hex", BAD.hex()).code == 1
    frame = encode(SerialFrame(FrameKind.BLOCK, GOOD)).hex()
    assert "1 block, 0 invalid" in decode("--hex", frame, "--format", "serial").out


def test_standard_input_is_decoded(decode: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(GOOD * 2)))
    outcome = decode("-", "--json", "-")
    assert (outcome.code, json.loads(outcome.out)["file"]) == (0, "standard input")
    assert "2 blocks, 0 invalid" in outcome.err


def test_a_device_can_be_chosen(decode: Run, capture: Path) -> None:
    assert decode(capture.name, "--usb-address", "2.5").code == 1
    outcome = decode(capture.name, "--usb-address", "2.6")
    assert outcome.code == 2
    assert "no device 2.6 shows itself in it; it has traffic of 2.5" in outcome.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "what to decode is named once"),
        (("b.bin", "--hex", "50"), "what to decode is named once"),
        (("missing.bin",), "missing.bin: No such file or directory"),
        (("empty.bin",), "empty.bin is empty"),
        (("noise.bin",), "noise.bin begins like no known recording"),
        (("cut.pcapng",), "cut.pcapng, packet 13: the file ends within it"),
        (("b.bin", "--format", "elf"), "unknown format 'elf'; known are auto, blocks,"),
        (("b.bin", "--usb-address", "1"), "USB address '1' should be the numbers"),
        (("b.bin", "--usb-address", "1.2"), "an address chooses a device in a capture"),
        (("b.bin", "--json", "b.bin"), "b.bin cannot be written: it is also what is read"),
        (("--hex", "5"), "line 1: '5' is not bytes of two hex digits each"),
        (("--hex", ""), "--hex is empty"),
    ],
)
def test_unusable_input_is_code_2(
    decode: Run, capture: Path, tmp_path: Path, arguments: tuple[str, ...], message: str
) -> None:
    (tmp_path / "b.bin").write_bytes(GOOD)
    (tmp_path / "empty.bin").write_bytes(b"")
    (tmp_path / "noise.bin").write_bytes(b"\xff" * 100)
    (tmp_path / "cut.pcapng").write_bytes(capture.read_bytes()[:-5])
    outcome = decode(*arguments)
    assert outcome.code == 2
    assert message in " ".join(outcome.err.split())
    assert "Traceback" not in outcome.err


def test_a_truncated_recording_leaves_no_json(decode: Run, capture: Path, tmp_path: Path) -> None:
    capture.write_bytes(capture.read_bytes()[:-5])
    outcome = decode(capture.name, "--json", "c.json")
    assert outcome.code == 2
    assert outcome.out.startswith("packet 1 ")
    assert decode(capture.name, "--json", "-").out == ""
    assert not (tmp_path / "c.json").exists()


def test_a_whole_session_is_valid(
    decode: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sphere_solution: Solution
) -> None:
    """A session with the emulator, as a bus would have shown it."""
    packets: list[bytes] = []

    def tap(name: str, packed: Callable[..., list[bytes]]) -> None:
        original = getattr(EmulatorBackend, name)

        def tapped(backend: Any, handle: Any, *arguments: Any) -> int:
            moved = int(original(backend, handle, *arguments))
            packets.extend(packed(moved, *arguments))
            return moved

        monkeypatch.setattr(EmulatorBackend, name, tapped)

    def control_packets(moved: int, kind: int, request: int, value: int, index: int, data: Any, _: int) -> list[bytes]:
        fields = [value, index, len(data)]
        setup = bytes([kind, request]) + b"".join(field.to_bytes(2, "little") for field in fields)
        return control(1, setup, bytes(data[:moved]))

    tap("bulk_write", lambda moved, _endpoint, _interface, data, _: bulk_out(2, bytes(data)[:moved]))
    tap("bulk_read", lambda moved, _endpoint, _interface, data, _: bulk_in(3, bytes(data[:moved])))
    tap("ctrl_transfer", control_packets)
    with Emulator(serial="TAPPED") as emulator, open_device(emulator.url) as device:
        device.show(Pulses.from_drive(sphere_solution.drive))
        device.stop()
        device.status()
    (tmp_path / "session.pcapng").write_bytes(pcapng(packets))
    outcome = decode("session.pcapng")
    assert outcome.code == 0, outcome.out
    assert "ENABLE" in outcome.out
    assert "GET_DESCRIPTOR STRING 3: 'TAPPED'" in outcome.out
    assert "1 accepted" in outcome.out
