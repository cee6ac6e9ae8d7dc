"""The ledger of blocks on their way, against a plain list of what was sent and what was answered."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from phasewire.base.errors import ReplyError
from phasewire.host.streaming.ledger import NUMBERS, Answers, Ledger, Parcel
from phasewire.protocol.codes import Reason
from phasewire.protocol.replies import ACKS

SIZES = st.lists(st.integers(1, 9), min_size=1, max_size=8)
FIRSTS = st.sampled_from([0, 5, NUMBERS - 7])


def acks(numbers: list[int], reason: int = 0) -> NDArray[np.void]:
    """Acknowledgements of blocks; the commit period repeats the number, by which tests tell them apart."""
    made = np.zeros(len(numbers), ACKS)
    made["sequence"] = np.array(numbers, np.int64) % NUMBERS
    made["commit_period"] = made["sequence"]
    made["reason"] = reason
    return made


def parcels(ledger: Ledger, first: int, sizes: list[int]) -> list[Parcel]:
    """Parcels one after the other, all sent."""
    made = []
    for size in sizes:
        made.append(Parcel(first % NUMBERS, Answers.none(size), sent=size))
        ledger.enter(made[-1])
        first += size
    return made


def answered(made: list[Parcel], first: int) -> list[int]:
    """Which blocks are answered, counted over all parcels; each by its own acknowledgement."""
    flags = np.concatenate([parcel.answers.answered for parcel in made])
    periods = np.concatenate([parcel.answers.acks["commit_period"] for parcel in made])
    places = np.flatnonzero(flags)
    assert (periods[places] == (first + places) % NUMBERS).all()
    return list(map(int, places))


@given(st.booleans(), FIRSTS, SIZES, st.data())
def test_answers_in_turn_find_their_blocks_however_they_are_cut(
    lossy: bool, first: int, sizes: list[int], data: st.DataObject
) -> None:
    ledger = Ledger(lossy)
    made, count, at = parcels(ledger, first, sizes), sum(sizes), 0
    while at < count:
        assert ledger.unanswered == count - at
        assert not ledger.settled
        more = data.draw(st.integers(1, count - at))
        ledger.match(acks(list(range(first + at, first + at + more))))
        at += more
        assert answered(made, first) == list(range(at))
        assert [parcel.settled for parcel in made] == [sum(sizes[: n + 1]) <= at for n in range(len(sizes))]
    assert (ledger.settled, ledger.unanswered) == (True, 0)


@given(FIRSTS, SIZES, st.data())
def test_on_a_lossy_line_those_that_were_passed_over_are_lost(
    first: int, sizes: list[int], data: st.DataObject
) -> None:
    ledger = Ledger(lossy=True)
    made, count = parcels(ledger, first, sizes), sum(sizes)
    arrive = sorted(data.draw(st.sets(st.integers(0, count - 1), min_size=1)))
    ledger.match(acks([first + place for place in arrive]))
    assert answered(made, first) == arrive
    assert ledger.unanswered == count - 1 - arrive[-1]
    ledger.give_up()
    assert ledger.settled


@given(FIRSTS, SIZES, st.data())
def test_on_a_line_that_loses_nothing_only_the_next_may_answer(
    first: int, sizes: list[int], data: st.DataObject
) -> None:
    ledger = Ledger(lossy=False)
    made, count = parcels(ledger, first, sizes), sum(sizes)
    before = data.draw(st.integers(0, count - 1))
    ledger.match(acks(list(range(first, first + before))))
    wrong = data.draw(st.integers(before + 1, count + 3))
    with pytest.raises(ReplyError, match=f"block {(first + wrong) % NUMBERS} out of turn"):
        ledger.match(acks([first + wrong]))
    assert answered(made, first) == list(range(before))
    ledger.match(acks([first - 1, first - 9, first + NUMBERS // 2 + count]))  # of earlier blocks, which were given up
    ledger.match(acks([12345], Reason.CHECKSUM))  # its number is damaged too: the place counts
    flags = np.concatenate([parcel.answers.answered for parcel in made])
    assert flags.tolist() == [place <= before for place in range(count)]


def test_a_parcel_that_is_not_all_sent_waits_for_the_rest() -> None:
    ledger = Ledger(lossy=False)
    parcel = Parcel(3, Answers.none(4), sent=2)
    ledger.enter(parcel)
    ledger.match(acks([3, 4]))
    assert (ledger.unanswered, ledger.settled, parcel.settled) == (0, False, False)
    with pytest.raises(ReplyError, match="block 5 out of turn"):
        ledger.match(acks([5]))
    parcel.sent = 4
    ledger.match(acks([5, 6]))
    assert parcel.settled
