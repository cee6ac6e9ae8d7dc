"""The chain's messages: damage, values that cannot travel, and items cut into loads."""

from __future__ import annotations

from typing import Any

import pytest
from phasewire.protocol.chain import (
    Collect,
    Commit,
    Identity,
    Load,
    Number,
    Playing,
    Program,
    Report,
    Slice,
)
from phasewire.protocol.codes import ChannelEnd, Memory

# Bits 0, 2, 4 … high from tick 0 for 25 ticks: phase 25, width 25 is 0xC99; the odd ones are silent.


@pytest.mark.parametrize(
    ("make", "complaint"),
    [
        (lambda: Slice(10, bytes(48)), "processor 10 must be a whole number from 0 to 9"),
        (lambda: Slice(0, bytes(47)), "take 48 bytes, not 47"),
        (lambda: Commit.of(2**64, Slice(0, bytes(48))), "period 18446744073709551616 must be a whole number"),
        (lambda: Commit(0, 0, -1), "checksum -1 must be a whole number"),
        (lambda: Load(0, 4, 0, bytes(4)), "4 is no memory of a processor; SLOTS, ENT"),  # type: ignore[arg-type]  # meant
        (lambda: Load(0, Memory.SLOTS, 256, bytes(48)), "first 256 must be a whole number from 0 to 255"),
        (lambda: Load(0, Memory.ENTRIES, 1023, bytes(8)), "first 1023 must be a whole number from 0 to 1022"),
        (lambda: Load(0, Memory.ENTRIES, 0, bytes(6)), "6 bytes are not 1 to 12 items of 4 bytes"),
        (lambda: Load(0, Memory.SAMPLES, 0, b""), "0 bytes are not 1 to 48 items"),
        (lambda: Load(0, Memory.SAMPLES, 0, bytes(49)), "49 bytes are not 1 to 48 items"),
        (lambda: Program(0, Memory.SLOTS, 0, 0, 1), "cannot be started"),
        (lambda: Program(0, Memory.ENTRIES, 0, 0, 1025), "count 1025 must be a whole number from 0 to 1024"),
        (lambda: Program(0, Memory.ENTRIES, 0, 0, 1, hold=1), "hold 1 must be a whole number from 0 to 0"),
        (lambda: Program(0, Memory.SAMPLES, 0, 4095, 1), "hold 0 must be a whole number from 1 to 65535"),
        (
            lambda: Program(0, Memory.SAMPLES, 0, 0, 1, hold=1, repeats=1),
            "repeats 1 must be a whole number from 0 to 0",
        ),
        (lambda: Program(0, Memory.ENTRIES, 0, 1024, 1), "first 1024 must be a whole number from 0 to 1023"),
        (lambda: Program(0, Memory.ENTRIES, 0, 1, 0), "first 1 must be a whole number from 0 to 0"),
        (lambda: Program(0, Memory.ENTRIES, 0, 0, 0, repeats=1), "repeats 1 must be a whole number from 0 to 0"),
        (lambda: Collect(0, ChannelEnd.SLICE), "cannot be asked for"),
        (lambda: Number(10), "processor 10"),
        (lambda: Report(0, 128, 0, (0, 0, 0), 0, 0, 0, 0), "temperature_c 128 must be a whole number from -128 to 127"),
        (lambda: Report(0, 0, 0, (0, 0, 256), 0, 0, 0, 0), "three numbers of 0 to 255"),
        (lambda: Playing(0, -1, bytes(48)), "period -1"),
        (lambda: Identity(0, True, (0, 0, 0), 2**64), "unique_id"),
        (lambda: Identity(0, 2, (0, 0, 0), 0), "last 2 must be a whole number from 0 to 1"),  # type: ignore[arg-type]  # meant
    ],
)
def test_an_error_names_a_value_that_cannot_travel(make: Any, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        make()
