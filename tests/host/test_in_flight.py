"""Blocks that a line carries by itself while the host goes on: several transfers on their way at a time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from phasewire.base.errors import DeviceLostError, DeviceTimeoutError
from phasewire.host.streaming.ledger import Answers, Parcel
from phasewire.host.streaming.session import Session
from phasewire.protocol.blocks import Block, Body, pack
from phasewire.protocol.codes import AckFlag

from tests.host.session_bench import MS, Once, PostingLine, change, enabled, sample


def post(session: Session, count: int, body: Callable[[int], Body] = sample, first: int = 0) -> Parcel:
    number, restart = session.upcoming
    made = b"".join(pack(Block(body(first + n), number + n, restart and n == 0)) for n in range(count))
    parcel = Parcel(number, Answers.none(count))
    session.post(np.frombuffer(made, np.uint8).reshape(count, 512), parcel)
    return parcel


STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("post"), st.integers(1, 12)),
        st.tuples(st.just("send"), st.just(1)),
        st.tuples(st.just("status"), st.just(0)),
        st.tuples(st.just("pass"), st.integers(1, 5)),
        st.tuples(st.just("write"), st.integers(1, 3)),
        st.tuples(st.just("read"), st.integers(1, 3)),
    ),
    min_size=1,
    max_size=15,
)


@given(STEPS, st.integers(1, 4), st.integers(1, 5), st.sampled_from([0.0, 2 * MS]))
@settings(deadline=None)
def test_whatever_is_done_meanwhile_every_answer_is_its_block_s_and_none_plays_twice(
    steps: list[tuple[str, int]], most: int, per_step: int, stays: float
) -> None:
    """Also if a read fails: what was not carried is taken back, and its numbers are used again."""
    line = PostingLine(most=most, per_step=per_step, stays=stays)
    session = enabled(line)
    place, parcels = 0, list[tuple[int, Parcel]]()
    for what, count in steps:
        try:
            if what == "post":
                number, _ = session.upcoming
                first, place = place, place + count
                made = b"".join(pack(Block(sample(first + n), number + n)) for n in range(count))
                parcels.append((first, Parcel(number, Answers.none(count))))
                session.post(np.frombuffer(made, np.uint8).reshape(count, 512), parcels[-1][1])
            elif what == "send":
                place += 1
                assert session.send(sample(place - 1))[0].commit_period == place - 1
            elif what == "status":
                session.status()
            elif what == "pass":
                for _ in range(count):
                    line.carry()
            else:
                line.fails = Once(what, DeviceLostError("gone"), count)
        except DeviceLostError:
            line.fails = lambda _: None
    line.fails = lambda _: None
    session.settle()
    ack = session.send(sample(4000))[0]
    assert ack.commit_period == 4000
    assert not ack.flags or ("write" in dict(steps)), "of a write that fails nobody knows how much was sent"
    played = [sent.first for sent in line.device.accepted[1:]]
    assert played == sorted(set(played))
    for first, parcel in parcels:
        known = np.flatnonzero(parcel.answers.answered)
        assert parcel.answers.acks["commit_period"][known].tolist() == (first + known).tolist()
        assert set((first + known).tolist()) <= set(played)


def test_a_queue_without_room_is_given_up_and_the_numbers_are_used_again() -> None:
    line = PostingLine(stays=3600)
    session = enabled(line)
    parcel = post(session, 20, change)
    with pytest.raises(DeviceTimeoutError, match="did not take a block for 1 s: its queue is full; wait, or stop it"):
        session.settle()
    assert parcel.answers.answered.tolist() == [True] * 8 + [False] * 12
    line.device.leaving.clear()
    ack = session.send(change(99))[0]
    assert (ack.sequence, ack.flags) == (9, AckFlag(0))
