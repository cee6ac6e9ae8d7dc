from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from phasewire.protocol import (
    AmplitudeModulation,
    Block,
    Clock,
    Entries,
    Entry,
    Output,
    PlaySequence,
    Pulses,
    Samples,
    Slot,
    Update,
    pack,
)
from phasewire.protocol.blocks import pack_pulses

SILENT = Pulses.silent(320)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Update(Pulses.silent(319)), "a block carries 320 pulses, not 319"),
        (lambda: Update(SILENT, 2**64), "period 18446744073709551616 must be a whole number"),
        (lambda: Update(SILENT, -1), "period -1"),
        (lambda: Slot(256, SILENT), "slot 256 must be a whole number from 0 to 255"),
        (lambda: Slot(0, Pulses.silent(1)), "320 pulses, not 1"),
        (lambda: Entries((Entry(256, 1),)), "slot 256"),
        (lambda: Entries((Entry(0, 0),)), "number of periods 0 must be a whole number from 1 to 65535"),
        (lambda: Entries((Entry(0, 2**16),)), "number of periods 65536"),
        (lambda: Entries((Entry(0, 1),) * 121), "number of entries 121 must be a whole number from 1 to 120"),
        (lambda: Entries(()), "number of entries 0 must be a whole number from 1 to 120"),
        (lambda: Entries((Entry(0, 1),) * 2, 1023), "first entry 1023 must be a whole number from 0 to 1022"),
        (lambda: PlaySequence(0, 0), "number of entries 0 must be a whole number from 1 to 1024"),
        (lambda: PlaySequence(1000, 25), "first entry 1000 must be a whole number from 0 to 999"),
        (lambda: PlaySequence(0, 1, repeats=2**16), "number of repeats 65536"),
        (lambda: Samples(np.array([0, 256])), "sample 256 must be a whole number from 0 to 255"),  # type: ignore[arg-type]  # no bytes
        (lambda: Samples(bytes(481)), "number of samples 481 must be a whole number from 1 to 480"),
        (lambda: Samples(bytes(2), 4095), "first sample 4095 must be a whole number from 0 to 4094"),
        (lambda: AmplitudeModulation(0, 4097, 1), "number of samples 4097 must be a whole number from 1 to 4096"),
        (lambda: AmplitudeModulation(0, 1, 0), "a sample holds 0 must be a whole number from 1 to 65535"),
        (lambda: Output(4), "4 is not a valid Action"),  # type: ignore[arg-type]  # the wrong value is the point
        (lambda: pack(Block(Clock(), 2**32)), "sequence number 4294967296 must be a whole number"),
        (lambda: pack(Block(Clock(), -1)), "sequence number -1"),
    ],
)
def test_an_error_names_a_value_that_cannot_travel(make: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize(
    "of", [list, bytearray, memoryview, lambda samples: np.frombuffer(samples, np.uint8).astype(">i8")]
)
def test_samples_of_any_type_count_by_their_values(of: Callable[[bytes], Any]) -> None:
    assert Samples(of(b"\0\1\xff")) == Samples(b"\0\1\xff")


@pytest.mark.parametrize("wrong", [3, "loud", np.array([0.5]), None])
def test_samples_are_numbers(wrong: Any) -> None:
    with pytest.raises((ValueError, TypeError)):
        Samples(wrong)


def test_half_a_pair_of_pulses_is_refused() -> None:
    with pytest.raises(ValueError, match="3 pulses are no pairs"):
        pack_pulses(Pulses.silent(3))


def test_other_types_than_pulses_are_refused() -> None:
    for make in (lambda: Update([1] * 320), lambda: Slot(0, bytes(320))):  # type: ignore[arg-type]  # the point
        with pytest.raises(TypeError, match="a block carries Pulses, not"):
            make()
