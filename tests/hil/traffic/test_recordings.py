from __future__ import annotations

import io
import os
import threading
from pathlib import Path

import pytest
from phasewire.base.errors import InputFileError
from phasewire.hil.traffic.recordings import open_recording, read_recording
from phasewire.hil.traffic.traffic import LARGEST_WHOLE_BYTES, Piece, Traffic
from phasewire.hil.traffic.usbmon import UsbAddress
from phasewire.protocol import framing
from phasewire.protocol.codes import FrameKind

from tests.captures import bulk_out, pcap, pcapng

BLOCK = b"PW" + bytes(510)
ACK = b"PA" + bytes(30)
FRAME = framing.encode(framing.SerialFrame(FrameKind.RECORD, ACK))


def read(data: bytes, form: str = "auto", address: UsbAddress | None = None) -> list[Piece]:
    return list(read_recording(io.BytesIO(data), "r", form, address))


@pytest.mark.parametrize(
    ("data", "form", "traffic"),
    [
        (pcapng(bulk_out(1, BLOCK)), "pcap", Traffic.BLOCK),
        (pcap(bulk_out(1, BLOCK, order=">"), order=">"), "pcap", Traffic.BLOCK),
        (BLOCK, "blocks", Traffic.BLOCK),
        (ACK, "blocks", Traffic.RECORD),
        (b"PS" + bytes(62), "blocks", Traffic.RECORD),
        (BLOCK.hex(" ").encode(), "hex", Traffic.BLOCK),
        (b"\n# a comment\n" + BLOCK.hex("\n").encode(), "hex", Traffic.BLOCK),
        (b"# an update\n50 57\n00 \xc3\x97 510 # the rest\n", "hex", Traffic.BLOCK),
        (FRAME.hex().encode(), "hex", Traffic.FRAME),
        (b"\0" + FRAME, "serial", Traffic.FRAME),
        (b"> info\r\n\0" + FRAME, "serial", Traffic.TEXT),
        (b"PWFW" + bytes(100), "firmware", Traffic.FIRMWARE),
    ],
)
def test_formats_are_recognised_by_the_content(data: bytes, form: str, traffic: Traffic) -> None:
    assert read(data)[0].traffic is traffic
    assert read(data) == read(data, form)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "r is empty"),
        (b"# nothing\n", "r begins like no known recording"),
        (b"\x89PNG\r\n\x1a\n\0\0", "r begins like no known recording"),
        (b"> info\r\n", "r begins like no known recording"),
        (b"50 57\nPW", "r: line 2: 'pw' is not bytes of two hex digits each"),
    ],
)
def test_what_is_no_recording_is_refused(data: bytes, message: str) -> None:
    with pytest.raises(InputFileError) as refused:
        read(data)
    assert str(refused.value).startswith(message)


def test_a_whole_is_not_read_without_end() -> None:
    with pytest.raises(InputFileError, match=f"at most {LARGEST_WHOLE_BYTES} bytes"):
        read(bytes(LARGEST_WHOLE_BYTES + 1), "firmware")


def test_a_pipe_is_copied_so_that_it_can_be_read_twice(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    capture = pcapng(bulk_out(1, BLOCK))
    writer = threading.Thread(target=pipe.write_bytes, args=(capture,))
    writer.start()
    with open_recording(str(pipe)) as stream:
        assert [piece.data for piece in read_recording(stream, "pipe")] == [BLOCK]
    writer.join()
