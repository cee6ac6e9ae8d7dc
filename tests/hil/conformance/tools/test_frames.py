"""Frames by the words of the specification, against its examples and the cobs package."""

from __future__ import annotations

import pytest
from cobs import cobs
from hypothesis import given
from hypothesis import strategies as st
from phasewire.hil.conformance.tools.frames import console_frame, frame, request_frame, sealed, stuffed, unstuffed
from phasewire.protocol.codes import FrameKind, Request
from phasewire.protocol.requests import Setup

from tests.specification import hex_examples

RUNS = st.lists(st.sampled_from([0, 1, 2, 252, 253, 254, 255, 507, 508, 509]), max_size=4)


@given(RUNS)
def test_a_content_is_stuffed_as_the_cobs_package_does_it(runs: list[int]) -> None:
    content = b"\0".join(b"x" * run for run in runs)
    assert stuffed(content) == cobs.encode(content)
    assert unstuffed(stuffed(content)) == content


@given(st.binary(max_size=700))
def test_bytes_come_back(content: bytes) -> None:
    assert 0 not in stuffed(content)
    assert unstuffed(stuffed(content)) == content


@pytest.mark.parametrize(
    ("coded", "what"),
    [
        (b"\xff" + 254 * b"x" + b"\x01", "one form"),
        (b"\x05abc", "ends within a group of 4 bytes"),
        (b"\x03a\x00", "is 00|one form|ends within"),
        (b"", "one form"),
    ],
)
def test_what_is_no_cobs_is_refused(coded: bytes, what: str) -> None:
    with pytest.raises(AssertionError, match=what):
        unstuffed(coded)


def test_frames_are_those_of_the_specification() -> None:
    setup = Setup(0xC1, Request.STATUS, 0, 0, 64)
    assert request_frame(0x2A, setup) == hex_examples()["SERIAL_STATUS_REQUEST"]
    assert frame(FrameKind.REPLY, bytes([0x2A, 1])) == hex_examples()["SERIAL_STALL_REPLY"]
    assert console_frame() == bytes.fromhex("06 05 02 1b 68 a2 00")
    assert sealed(FrameKind.CONSOLE) == unstuffed(console_frame()[:-1])
