"""Blocks: what is accepted, what is refused, and with which reason (chapters BLK and ACK)."""

from __future__ import annotations

from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import case, expect
from phasewire.protocol.blocks import NoOp, pack
from phasewire.protocol.codes import Reason


@case("BLK-003", "ACK-003")
def test_a_flipped_bit_is_refused(bench: Bench) -> None:
    """A block with a flipped bit is refused with CHECKSUM and has no other effect: damaged pulses must not play."""
    block = bytearray(pack(bench.numbered(NoOp())))
    block[100] ^= 4
    before = bench.status()
    (ack,) = bench.send_raw(bytes(block))
    expect("the reason", ack.reason, Reason.CHECKSUM)
    after = bench.status()
    expect("the count of refused blocks", after.refused, before.refused + 1)
    expect("the count of accepted blocks", after.accepted, before.accepted)
