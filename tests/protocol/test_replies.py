from __future__ import annotations

import zlib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire.errors import ReplyError
from phasewire.protocol import Ack, Info, Pulses, Reason, State, Status, Wiring
from phasewire.protocol.codes import AckFlag, Bank, Fault, Feature, StatusFlag
from phasewire.protocol.replies import (
    ClockReading,
    ProcessorReport,
    ReadBack,
    decode_acks,
    decode_reports,
    decode_wiring,
    encode_reports,
    encode_wiring,
    records,
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
SIZES = {Ack: 32, Status: 64, Info: 64, ClockReading: 24, ReadBack: 496}


@given(ACKS | STATUSES | INFOS | CLOCKS | READ_BACK)
def test_replies_survive_the_way(reply: Any) -> None:
    data = reply.encode()
    assert len(data) == SIZES[type(reply)] == reply.BYTES
    assert type(reply).decode(data) == reply
    if isinstance(reply, Ack | Status):
        assert int.from_bytes(data[-4:], "little") == zlib.crc32(data[:-4])


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
def test_what_does_not_fit_is_a_wrong_argument(
    reply: st.SearchStrategy[Any], change: dict[str, Any], named: str, data: st.DataObject
) -> None:
    with pytest.raises(ValueError, match=named):
        replace(data.draw(reply), **change).encode()


@given(REPORTS, st.integers(0, 9))
def test_reports_that_do_not_fit_are_wrong_arguments(reports: list[ProcessorReport], number: int) -> None:
    with pytest.raises(ValueError, match=f"(?s){number} reports .*expected 10 elements"):
        encode_reports(reports[:number])
    reports[number] = replace(reports[number], temperature_c=128)
    with pytest.raises(ValueError, match="temperature_c"):
        encode_reports(reports)


@given(REPORTS)
def test_reports_survive_the_way(reports: list[ProcessorReport]) -> None:
    data = encode_reports(reports)
    assert len(data) == 160
    assert decode_reports(data) == reports


def test_the_wiring_table_survives_the_way(scrambled: Wiring) -> None:
    data = encode_wiring(scrambled)
    assert len(data) == 640
    assert int.from_bytes(data[2:4], "little") == scrambled.channels[1]
    assert decode_wiring(data).channels.tolist() == scrambled.channels.tolist()


def test_a_table_that_names_an_output_twice_is_refused() -> None:
    with pytest.raises(ReplyError, match="exactly once"):
        decode_wiring(bytes(640))


def octets(*fields: tuple[int, int]) -> bytes:
    """Values and their sizes, least significant byte first."""
    return b"".join(value.to_bytes(size, "little") for value, size in fields)


def test_an_ack_by_hand() -> None:
    data = Ack(Reason.PULSE, 0x01020304, 5, 6, AckFlag.GAP, 7, State.READY).encode()
    fields = octets((Reason.PULSE, 1), (0x01020304, 4), (5, 8), (6, 8), (2, 1), (7, 1), (1, 1), (0, 1))
    assert data[:28] == b"PA\x01" + fields


def test_a_status_by_hand() -> None:
    faults, flags = Fault.SYNC | Fault.CHAIN, StatusFlag.MODULATION | StatusFlag.WATCHDOG_FIRED
    data = Status(
        *(
            State.FAULT,
            faults,
            Reason.IN_USE,
            flags,
            0x0807060504030201,
            9,
            10,
            11,
            12,
            13,
            14,
            15,
            16,
            -5,
            100,
            320,
            17,
        )
    ).encode()
    counters = [(value, 4) for value in (10, 11, 12, 13, 14, 15)]
    fields = octets((4, 1), (5, 2), (16, 1), (5, 1), (0x0807060504030201, 8), (9, 8), *counters)
    assert data[:60] == b"PS\x01" + fields + octets((16, 1), (251, 1), (100, 2), (320, 2), (17, 4), (0, 2))


def test_an_information_record_by_hand() -> None:
    """Field by field as clause REQ-002 lists them."""
    info = Info(
        *(1, 2, 0x304, (5, 6, 7), 8, bytes(range(16, 24)), 40_000, Feature(3), 320, 20, 16, 10_300, 2, 50, 25, 5, 9),
        *(10, 11, 12, 256, 1024, 4096, 319, 100, bytes(range(32, 48))),
    )
    fields = octets((1, 1), (2, 1), (0x304, 2), (5, 1), (6, 1), (7, 1), (8, 1)) + bytes(range(16, 24))
    fields += octets((40_000, 4), (3, 2), (320, 2), (20, 1), (16, 1), (10_300, 2), (2, 1), (50, 1), (25, 1), (5, 1))
    fields += octets((9, 1), (10, 1), (11, 2), (12, 2), (256, 2), (1024, 2), (4096, 2), (319, 2), (100, 2))
    assert info.encode() == fields + bytes(range(32, 48))
    assert (info.pitch, info.watchdog) == (10.3e-3, 0.1)
    assert [version for version in range(5) if info.speaks(version)] == [1, 2]


def test_a_clock_reading_and_a_report_by_hand() -> None:
    assert ClockReading(1, 2, 3).encode() == octets((1, 8), (2, 8), (3, 4), (0, 4))
    report = ProcessorReport(Fault.OVERRUN, -1, Bank.A, 3, 4, (5, 6, 7))
    fields = octets((32, 2), (255, 1), (2, 1), (3, 4), (4, 4), (5, 1), (6, 1), (7, 1), (0, 1))
    assert encode_reports([report] * 10) == fields * 10


@given(st.lists(ACKS | STATUSES, max_size=12))
def test_records_are_told_apart(sent: list[Ack | Status]) -> None:
    assert records(b"".join(record.encode() for record in sent)) == sent


FIELDS = ("reason", "sequence", "commit_period", "now", "flags", "free", "state")


@given(st.lists(ACKS, max_size=40))
def test_many_acknowledgements_at_once(sent: list[Ack]) -> None:
    data = b"".join(ack.encode() for ack in sent)
    for packets in (data, bytearray(data), memoryview(data)):
        found = decode_acks(packets)
        assert found[list(FIELDS)].tolist() == [tuple(int(getattr(ack, name)) for name in FIELDS) for ack in sent]


def judged(ack: bytes) -> str | None:
    """What `Ack.decode` says of 32 bytes."""
    try:
        Ack.decode(ack)
    except ReplyError as error:
        return str(error)
    return None


def judged_at_once(ack: bytes, good: bytes) -> str | None:
    """What `decode_acks` says of them, alone and among others."""

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


@given(ACKS, st.integers(0, 31), st.binary(max_size=4), st.booleans())
def test_at_once_the_same_is_refused(ack: Ack, at: int, junk: bytes, seal: bool) -> None:
    good = ack.encode()
    damaged = (good[:at] + junk + good[at + len(junk) :])[:32]
    damaged = resealed(damaged[:28]) if seal else damaged
    assert judged_at_once(damaged, good) == judged(damaged)


@pytest.mark.parametrize("at", range(28))
def test_at_once_every_octet_is_judged_alike(at: int) -> None:
    """All 256 values of each, under a right checksum."""
    good = Ack(Reason.DISABLED, 7, 8, 9, AckFlag.LATE, 3, State.SUSPENDED).encode()
    octets = np.tile(np.frombuffer(good, np.uint8), (256, 1))
    octets[:, at] = np.arange(256)
    for row in octets:
        damaged = resealed(row[:28].tobytes())
        assert (judged_at_once(damaged, good) is None) == (judged(damaged) is None)


def test_at_once_every_flipped_bit_is_refused() -> None:
    good = Ack(Reason.ACCEPTED, 7, 8, 9, AckFlag.LATE, 3, State.PLAYING).encode()
    for bit in range(256):
        flipped = (int.from_bytes(good, "little") ^ 1 << bit).to_bytes(32, "little")
        with pytest.raises(ReplyError, match=r"an acknowledgement .* breaks its layout"):
            decode_acks(good + flipped)


@given(ACKS, STATUSES, st.booleans())
def test_at_once_a_status_among_them_is_refused(ack: Ack, status: Status, first: bool) -> None:
    pair = (status, ack) if first else (ack, status)
    with pytest.raises(ReplyError, match="an acknowledgement"):
        decode_acks(b"".join(record.encode() for record in pair))


@given(ACKS, st.integers(1, 31))
def test_at_once_what_is_cut_off_is_refused(ack: Ack, cut: int) -> None:
    with pytest.raises(ReplyError, match=f"{64 - cut} bytes are not some of them"):
        decode_acks((2 * ack.encode())[:-cut])


@given(ACKS, STATUSES, st.integers(1, 63))
def test_a_record_that_is_cut_off_is_refused(ack: Ack, status: Status, cut: int) -> None:
    whole = ack.encode() + status.encode()
    with pytest.raises(ReplyError):
        records(whole[:-cut] if cut != 64 else whole[:-1])


@given(ACKS | STATUSES, st.data())
def test_every_flipped_bit_of_a_record_is_refused(record: Ack | Status, data: st.DataObject) -> None:
    encoded = bytearray(record.encode())
    bit = data.draw(st.integers(0, len(encoded) * 8 - 1))
    encoded[bit // 8] ^= 1 << bit % 8
    with pytest.raises(ReplyError):
        type(record).decode(bytes(encoded))


def reencoded(kind: type, data: bytes) -> bytes:
    if kind is Wiring:
        return encode_wiring(decode_wiring(data))
    if kind is ProcessorReport:
        return encode_reports(decode_reports(data))
    return bytes(kind.decode(data).encode())  # type: ignore[attr-defined]  # the other kinds all have decode


@pytest.mark.parametrize(
    ("kind", "size"), [*SIZES.items(), (Wiring, 640), (ProcessorReport, 160)], ids=lambda value: str(value)
)
@given(data=st.data())
def test_any_bytes_are_read_or_refused(kind: type, size: int, data: st.DataObject) -> None:
    body = data.draw(st.binary(min_size=size, max_size=size) | st.binary(max_size=700))
    if kind in (Ack, Status) and data.draw(st.booleans()):
        body = (b"PA\x01" if kind is Ack else b"PS\x01") + body[3:-4]
        body += zlib.crc32(body).to_bytes(4, "little")
    try:
        back = reencoded(kind, body)
    except ReplyError:
        return
    assert back == body


@pytest.mark.parametrize("state", State)
def test_the_outputs_are_enabled_in_three_states(state: State) -> None:
    status = Status(state, *(Fault(0), Reason.ACCEPTED, StatusFlag(0)), *range(13))
    assert status.enabled == (state.name in ("READY", "PLAYING", "UNATTENDED"))
