from __future__ import annotations

import io
import shutil
import subprocess

import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.base.errors import InputFileError
from phasewire.hil.traffic.traffic import (
    LONGEST_FRAME_BYTES,
    LineCutter,
    Piece,
    Traffic,
    hex_bytes,
    is_hex,
    read_bytes,
    read_serial,
    read_text,
)
from phasewire.protocol import framing
from phasewire.protocol.codes import FrameKind

BLOCK = b"PW" + bytes(range(255)) * 2
ACK = b"PA" + bytes(30)
STATUS = b"PS" + bytes(range(62))


@given(st.binary(max_size=3000))
def test_no_plain_byte_is_lost(data: bytes) -> None:
    assert b"".join(piece.data for piece in read_bytes(io.BytesIO(data))) == data


NO_OP = framing.encode(framing.SerialFrame(FrameKind.BLOCK, BLOCK))
CONSOLE = framing.encode(framing.CONSOLE_FRAME)


def test_a_serial_line_is_text_until_a_zero_and_after_a_console_frame() -> None:
    line = b"> info\r\n\0\0" + NO_OP + b"damaged\0" + CONSOLE + b"> \0" + NO_OP[:9]
    at = [line.index(part) for part in (b"> info", NO_OP, b"damaged", CONSOLE)] + [len(line) - 12, len(line) - 9]
    assert list(read_serial(io.BytesIO(line))) == [
        Piece(f"offset {offset}", traffic, None, data)
        for offset, traffic, data in zip(
            at,
            [Traffic.TEXT, Traffic.FRAME, Traffic.FRAME, Traffic.FRAME, Traffic.TEXT, Traffic.FRAME],
            [b"> info\r\n", NO_OP[:-1], b"damaged", CONSOLE[:-1], b"> ", NO_OP[:9]],
            strict=True,
        )
    ]


def test_a_recording_may_begin_with_a_frame() -> None:
    (piece,) = read_serial(io.BytesIO(NO_OP))
    assert (piece.traffic, piece.data) == (Traffic.FRAME, NO_OP[:-1])


@given(
    st.lists(
        st.sampled_from([b"", b"\0", b"\1\2", NO_OP, CONSOLE + b"> \0", b"text", bytes(5)]) | st.binary(max_size=9)
    )
)
def test_how_a_line_arrives_changes_no_frame(parts: list[bytes]) -> None:
    line = b"\0" + b"".join(parts)
    cutter, whole = LineCutter(), LineCutter()
    found = [each for part in [b"\0", *parts] for each in cutter.feed(part)] + list(cutter.rest())
    frames = [each for each in found if each[1] is Traffic.FRAME]
    assert frames == [each for each in [*whole.feed(line), *whole.rest()] if each[1] is Traffic.FRAME]
    assert b"".join(data for _, _, data in found) == line.replace(b"\0", b"")
    assert all(line[at : at + len(data)] == data for at, _, data in found)


def test_a_line_without_zero_bytes_is_not_kept() -> None:
    cutter = LineCutter()
    list(cutter.feed(b"\0"))
    sizes = [len(data) for _ in range(10) for _, _, data in cutter.feed(b"x" * LONGEST_FRAME_BYTES)]
    assert sizes == [2 * LONGEST_FRAME_BYTES] * 5


def test_the_longest_frame_is_kept_whole_until_its_zero_comes() -> None:
    cutter, longest = LineCutter(), b"x" * (framing.MAX_FRAME_BYTES - 1)
    assert [*cutter.feed(b"\0"), *cutter.feed(longest)] == []
    assert [data for _, _, data in cutter.feed(b"\0")] == [longest]


@given(st.binary(max_size=200), st.sampled_from(["", " ", ", ", "\n", " 0x", ",0X"]))
def test_hex_digits_come_in_many_dresses(data: bytes, separator: str) -> None:
    lead = separator.strip(", \n")
    text = "# a comment\n\n" + "".join(f"{lead if not i else separator}{byte:02x}" for i, byte in enumerate(data))
    assert hex_bytes(text + "  # the end") == data
    assert hex_bytes(text.upper()) == data


@pytest.mark.parametrize(
    "command", [["xxd"], ["xxd", "-g1", "-u"], ["xxd", "-p"], ["hexdump", "-C"], ["hexdump", "-Cv"]]
)
@pytest.mark.parametrize("data", [BLOCK, BLOCK[:32] + bytes(480), BLOCK[:33], b"a  b|#" * 9], ids=len)
def test_dumps_of_the_usual_programs_are_read(command: list[str], data: bytes) -> None:
    if shutil.which(command[0]) is None:
        pytest.skip(f"there is no {command[0]} here")
    dump = subprocess.run(command, input=data, capture_output=True, check=True, timeout=10).stdout.decode()
    assert is_hex(dump[:4096])
    assert hex_bytes(dump) == data


XXD = """\
# as xxd writes it
00000000: 5057 0107 0300 0000 0000 0000 0000 0000  PW..............
00000010: 0000                                     ..
"""
HEXDUMP = """\
00000000  50 57 01 07 00 00 00 00  00 00 00 00 00 00 00 00  |PW..............|
00000010  00 00 00 00 00 00 00 00  00 00 00 00 00 00 00 00  |................|
*
00000040  7c 7c                                             |\x7c\x7c|
00000042
"""


def test_dumps_by_hand() -> None:
    assert hex_bytes(XXD) == b"PW\1\7\3" + bytes(13)
    assert hex_bytes(HEXDUMP) == b"PW\1\7" + bytes(60) + b"||"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("5057\n50 5", "line 2: '5' is not bytes of two hex digits each"),
        ("# x\nPW", "line 2: 'pw' is not"),
        ("50" * 60 + "g", "line 1: '5050505050505050505050505050505050505050…' is not"),
        ("00000000: 5057\n00000004: 0000", "line 2: offset 0x4 should be 0x2; lines are missing"),
        ("00000000: 5057\nrest", "line 2: 'rest' is no line of a hex dump"),
        ("00000000: 505\n", "line 1: "),
        ("00000000: 5057\n*\nffffffff: 00", "line 3: offset 0xffffffff should be 0x2"),
        ("00000000: 50\n00000001\n*\n00000040: 00", "line 4: offset 0x40 should be 0x1"),
        ("00 × 999999\n" * 65, "line 65: with 999999 more zeros there are more than 64000000 bytes"),
        ("00000000  00\n00000001  " + " " * 100_000 + "g", "line 2: "),  # in less than minutes
    ],
)
def test_bad_hex_is_refused_with_its_line(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=r"^line \d") as refused:
        hex_bytes(text)
    assert str(refused.value).startswith(message)
    with pytest.raises(InputFileError, match=r"^x\.hex: line"):
        read_text(io.BytesIO(text.encode()), "x.hex")


@given(st.binary(max_size=300) | st.text("0123456789abcdef: |*#\n,x", max_size=300).map(str.encode))
def test_no_text_crashes_the_reader(data: bytes) -> None:
    is_hex(data.decode("latin-1"))
    try:
        read_text(io.BytesIO(data), "x")
    except InputFileError:
        assert data
