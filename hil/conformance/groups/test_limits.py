"""Protection of array and amplifiers: the drive limit and the supply (chapter SAF), judged by answers."""

from __future__ import annotations

import numpy as np
import pytest
from phasewire.emulator.faults import WrongSupply
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Need, case, expect
from phasewire.hil.conformance.tools.player import soon
from phasewire.hil.conformance.tools.steps import SILENT, begin, enable, heavy, let_stores_go, set_limit, some
from phasewire.protocol.blocks import Entries, Entry, PlaySequence, Slot, Update
from phasewire.protocol.board import CHANNELS
from phasewire.protocol.codes import Fault, Feature, Reason, Request, State
from phasewire.protocol.pulses import Pulses

LIMIT = 10
POWERS = {
    1: 4,
    2: 16,
    3: 35,
    4: 62,
    5: 95,
    6: 136,
    7: 181,
    8: 232,
    9: 287,
    10: 345,
    11: 406,
    12: 469,
    13: 531,
    14: 594,
    15: 655,
    16: 713,
    17: 768,
    18: 819,
    19: 864,
    20: 905,
    21: 938,
    22: 965,
}
"""Drive of pulses by their widths, in thousandths (clause SAF-006)."""
WIDEST = 25
NOTICED_SECONDS = 0.1
"""Time after which a device has asked its boards for their state."""


@case("SAF-006", "REQ-010")
def test_the_power_of_an_update_is_no_sum_of_widths(bench: Bench) -> None:
    """Of updates with equal sums of widths, wide pulses get DRIVE and narrow ones are accepted: power counts."""
    set_limit(bench, LIMIT)
    begin(bench)
    for width in some(bench, POWERS):
        fits, equal = min(1000 * LIMIT // POWERS[width], CHANNELS), WIDEST * LIMIT // width
        expect(f"the reason for {fits} pulses of {width}", bench.send(many(fits, width)).reason, Reason.ACCEPTED)
        if equal * POWERS[width] > 1000 * LIMIT:
            reason = bench.send(many(equal, width)).reason
            expect(f"the reason for {equal} pulses of {width}, whose widths would fit", reason, Reason.DRIVE)


def many(count: int, width: int) -> Update:
    """So many pulses of a width, the others silent."""
    return Update(Pulses(np.zeros(CHANNELS, int), np.where(np.arange(CHANNELS) < count, width, 0)))


@case("SAF-006", "BLK-008", features=Feature.SEQUENCES | Feature.UNATTENDED)
def test_one_slot_above_the_limit_refuses_its_sequence(bench: Bench) -> None:
    """A SEQUENCE with only its last entry above a lowered limit is refused, for now or later, attended or not."""
    set_limit(bench, LIMIT)
    for store in (Slot(0, SILENT), Slot(7, heavy(LIMIT)), Entries((*(Entry(0, 1),) * 119, Entry(7, 1)))):
        bench.must(store)
    bench.order(Request.LIMIT, LIMIT - 1)
    enable(bench)
    let_stores_go(bench)
    refused = {
        "now": PlaySequence(0, 120),
        "later": PlaySequence(0, 120, soon(bench)),
        "unattended": PlaySequence(0, 120, unattended=True),
    }
    for what, body in refused.items():
        expect(f"the reason for a sequence {what}", bench.send(body).reason, Reason.DRIVE)
    status = bench.status()
    expect("state and what plays since", (status.state, status.since_period), (State.READY, 0))
    expect("the reason without the last entry", bench.send(PlaySequence(0, 119)).reason, Reason.ACCEPTED)


@case("SAF-008", "SAF-007/1", needs=(Need.FAULTS,))
@pytest.mark.parametrize(
    ("millivolts", "is_wrong"),
    [(11_000, True), (13_000, False), (17_000, False), (19_000, True), (24_000, True)],
    ids=["11-V", "13-V", "17-V", "19-V", "24-V"],
)
def test_the_supply_may_have_12_to_18_volts(bench: Bench, millivolts: int, is_wrong: bool) -> None:
    """A supply outside 12 to 18 V is the fault SUPPLY, which silences and stays; one within is no fault."""
    begin(bench)
    bench.must(Update(bench.weak()))
    bench.levers.cause(WrongSupply(millivolts=millivolts))
    bench.wait(NOTICED_SECONDS)
    status = bench.status()
    state, faults = (State.FAULT, Fault.SUPPLY) if is_wrong else (State.PLAYING, Fault(0))
    expect("state and faults", (status.state, status.faults), (state, faults))
    expect("whether ENABLE is accepted", bench.try_order(Request.ENABLE), not is_wrong)
