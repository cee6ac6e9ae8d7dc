from __future__ import annotations

import zlib

import pytest
from phasewire.protocol.chain import FIVE_WIRE, TWO_WIRE, ChannelEnd, Commit, Link, Message, periods_per_update
from phasewire.protocol.chain import slices_cycles as cycles

CYCLES_PER_MICROSECOND = 400


@pytest.mark.parametrize(("link", "megabytes_per_second"), [(FIVE_WIRE, 50), (TWO_WIRE, 20)])
def test_links_carry_what_the_hardware_carries(link: Link, megabytes_per_second: float) -> None:
    assert CYCLES_PER_MICROSECOND / link.cycles_per_token == megabytes_per_second


@pytest.mark.parametrize(("link", "microseconds"), [(FIVE_WIRE, 10.4), (TWO_WIRE, 26.0)])
def test_ten_slices_take_what_was_worked_out_for_the_hardware(link: Link, microseconds: float) -> None:
    assert cycles(link) / CYCLES_PER_MICROSECOND == pytest.approx(microseconds)


def test_only_five_wires_hold_an_update_in_every_period() -> None:
    assert periods_per_update(FIVE_WIRE) == 1
    assert periods_per_update(TWO_WIRE) == 2


def test_a_message_costs_its_header_payload_and_end() -> None:
    assert Message(0, ChannelEnd.MAILBOX, bytes(48)).tokens == 3 + 48 + 1


def test_a_commit_names_its_slice() -> None:
    piece = bytes(range(48))
    commit = Commit.of(2**64 - 1, piece)
    assert commit.encode() == b"\xff" * 8 + zlib.crc32(piece).to_bytes(4, "little")
    assert Commit.decode(commit.encode()) == commit
