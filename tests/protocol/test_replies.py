from __future__ import annotations

import zlib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.base.errors import ReplyError
from phasewire.protocol import Ack, Info, Pulses, Reason, State, Status
from phasewire.protocol.codes import AckFlag, Bank, Fault, Feature, StatusFlag
from phasewire.protocol.replies import (
    ClockReading,
    ProcessorReport,
    ReadBack,
    decode_acks,
    decode_wiring,
)

from tests.strategies import pulses

U8, U16, U32, U64 = (st.integers(0, 2**bits - 1) for bits in (8, 16, 32, 64))
S8 = st.integers(-128, 127)
FIRMWARE = st.tuples(U8, U8, U8)
FAULTS = st.integers(0, 127).map(Fault)
ACKS = st.builds(
    Ack, st.sampled_from(Reason), U32, U64, U64, st.integers(0, 3).map(AckFlag), U8, st.sampled_from(State)
)
STATUSES = st.builds(
    Status,
    *(st.sampled_from(State), FAULTS, st.sampled_from(Reason), st.integers(0, 7).map(StatusFlag), U64, U64),
    *(U32, U32, U32, U32, U32, U32, U8, S8, U16, U16, U32),
)
INFOS = st.builds(
    Info,
    *(U8, U8, U16, FIRMWARE, U8, st.binary(min_size=8, max_size=8), U32, U16.map(Feature), U16, U8, U8, U16),
    *(U8, U8, U8, st.sampled_from([2, 5]), U8, U8, U16, U16, U16, U16, U16, U16, U16),
    st.binary(min_size=16, max_size=16),
)
CLOCKS = st.builds(ClockReading, U64, U64, U32)
READ_BACK = st.builds(ReadBack, U64, U64, pulses())
REPORTS = st.lists(
    st.builds(ProcessorReport, FAULTS, S8, st.none() | st.sampled_from(Bank), U32, U32, FIRMWARE),
    min_size=10,
    max_size=10,
)


@pytest.mark.parametrize(
    ("reply", "change", "named"),
    [
        (ACKS, {"free": 256}, "free"),
        (ACKS, {"now": -1}, "now"),
        (ACKS, {"reason": 99}, "reason"),
        (STATUSES, {"temperature_c": 128}, "temperature_c"),
        (INFOS, {"slots": 2**16}, "slots"),
        (CLOCKS, {"sync_pulses": 2**32}, "sync_pulses"),
        (READ_BACK, {"since_period": -1}, "since_period"),
        (READ_BACK, {"read_period": 2**64}, "read_period"),
        (READ_BACK, {"pulses": Pulses.silent(2)}, "320 pulses, not 2"),
    ],
)
@given(data=st.data())
def test_a_value_that_does_not_fit_is_a_wrong_argument(
    reply: st.SearchStrategy[Any], change: dict[str, Any], named: str, data: st.DataObject
) -> None:
    with pytest.raises(ValueError, match=named):
        replace(data.draw(reply), **change).encode()


def test_a_table_that_names_an_output_twice_is_refused() -> None:
    with pytest.raises(ReplyError, match="exactly once"):
        decode_wiring(bytes(640))


def test_information_in_other_units() -> None:
    info = Info(
        *(1, 2, 0x304, (5, 6, 7), 8, bytes(8), 40_000, Feature(3), 320, 20, 16, 10_300, 2, 50, 25, 5, 9),
        *(10, 11, 12, 256, 1024, 4096, 319, 100, bytes(16)),
    )
    assert (info.pitch, info.watchdog) == (10.3e-3, 0.1)
    assert [version for version in range(5) if info.speaks(version)] == [1, 2]


FIELDS = ("reason", "sequence", "commit_period", "now", "flags", "free", "state")


@given(st.lists(ACKS, max_size=40))
def test_many_acknowledgements_at_once(sent: list[Ack]) -> None:
    data = b"".join(ack.encode() for ack in sent)
    for packets in (data, bytearray(data), memoryview(data)):
        found = decode_acks(packets)
        assert found[list(FIELDS)].tolist() == [tuple(int(getattr(ack, name)) for name in FIELDS) for ack in sent]


def judged(ack: bytes) -> str | None:
    """The result of `Ack.decode` for 32 bytes."""
    try:
        Ack.decode(ack)
    except ReplyError as error:
        return str(error)
    return None


def judged_at_once(ack: bytes, good: bytes) -> str | None:
    """The result of `decode_acks` for them, alone and among others."""

    def verdict(packets: bytes, place: int) -> str | None:
        try:
            found = decode_acks(packets)
        except ReplyError as error:
            return str(error)
        assert Ack.of(found[place]) == Ack.decode(ack)
        return None

    alone, among = verdict(ack, 0), verdict(good + ack + good, 1)
    assert alone == among
    return alone


def resealed(body: bytes) -> bytes:
    return body + zlib.crc32(body).to_bytes(4, "little")


@pytest.mark.parametrize("at", range(28))
def test_many_at_once_every_octet_is_judged_alike(at: int) -> None:
    """All 256 values of each, under a right checksum."""
    good = Ack(Reason.DISABLED, 7, 8, 9, AckFlag.LATE, 3, State.SUSPENDED).encode()
    octets = np.tile(np.frombuffer(good, np.uint8), (256, 1))
    octets[:, at] = np.arange(256)
    for row in octets:
        damaged = resealed(row[:28].tobytes())
        assert (judged_at_once(damaged, good) is None) == (judged(damaged) is None)


@pytest.mark.parametrize("state", State)
def test_the_outputs_are_enabled_in_three_states(state: State) -> None:
    status = Status(state, *(Fault(0), Reason.ACCEPTED, StatusFlag(0)), *range(13))
    assert status.enabled == (state.name in ("READY", "PLAYING", "UNATTENDED"))
