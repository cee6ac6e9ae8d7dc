"""A session against a device made by hand: numbers, acknowledgements, and everything that a line can do to them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from phasewire.base.errors import (
    DeviceError,
    DeviceLostError,
    DeviceRefusedError,
    DeviceStalledError,
    DeviceTimeoutError,
    DeviceVersionError,
)
from phasewire.host.streaming.session import Answers, Parcel, Session
from phasewire.protocol import NoOp, Reason, State
from phasewire.protocol.blocks import Block, Body, Samples, pack, unpack
from phasewire.protocol.codes import AckFlag, Request

from tests import from_spec as spec
from tests.host.session_bench import (
    INFO,
    BenchLine,
    Fate,
    Once,
    Sent,
    begun,
    change,
    enabled,
    info,
    sample,
)

NUMBERS = 2**32


@pytest.fixture(params=[False, True], ids=["USB", "lossy"])
def line(request: pytest.FixtureRequest) -> BenchLine:
    return BenchLine(lossy=request.param)


def blocks(session: Session, count: int, body: Callable[[int], Body] = sample) -> np.ndarray:
    """The next blocks of a session, (k, 512)."""
    number, restart = session.upcoming
    made = [pack(Block(body(n), (number + n) % NUMBERS, restart and n == 0)) for n in range(count)]
    return np.frombuffer(b"".join(made), np.uint8).reshape(count, 512)


def transfer(session: Session, count: int, body: Callable[[int], Body] = sample) -> Answers:
    answers = Answers.none(count)
    send(session, blocks(session, count, body), answers)
    return answers


def send(session: Session, made: np.ndarray, answers: Answers) -> None:
    """Send blocks; what becomes of them stands in the answers."""
    session.post(made, Parcel(session.upcoming[0], answers))


def nth(*which: int, to: Fate = lambda data: None) -> Fate:
    """The fate of the n-th block or record, counted from 1; the others arrive."""
    passed = [0]

    def fate(data: bytes) -> bytes | None:
        passed[0] += 1
        return to(data) if passed[0] in which else data

    return fate


def flipped(at: int) -> Fate:
    def fate(data: bytes) -> bytes:
        return data[:at] + bytes([data[at] ^ 0x10]) + data[at + 1 :]

    return fate


# Beginning


def test_a_session_stops_the_device_and_begins_the_numbering(line: BenchLine) -> None:
    """Clauses NUM-004 and SER-012: with RESTART, in a block that may come twice."""
    session = begun(line)
    assert line.device.orders == [(Request.DISABLE, 0)]
    first = unpack(line.sent[0])
    assert (first.body, first.sequence, first.restart) == (NoOp(), 0, True)
    assert [ack.sequence for ack in session.send(*map(sample, range(3)))] == [1, 2, 3]
    assert [unpack(block).restart for block in line.sent] == [True, False, False, False]
    assert (session.info, session.name, session.serial, session.time) == (INFO, "bench B-1", "B-1", line.time)


def test_a_session_that_has_not_begun_leaves_the_device_unchanged(line: BenchLine) -> None:
    """An observing host has such a session; if it sends a block after all, the numbering begins first."""
    session = Session(line)
    assert (line.device.orders, line.device.state, line.sent) == ([], State.READY, [])
    session.send(sample(5))
    assert line.device.accepted == [Sent(0, spec.NO_OP, 0), Sent(1, spec.SAMPLES, 5)]
    assert [unpack(block).restart for block in line.sent] == [True, False]


@pytest.mark.parametrize(("blocks_per_second", "watchdog_ms"), [(22.0, 910), (191.0, 105), (2303.0, 100)])
def test_on_a_slow_line_the_watchdog_waits_longer(line: BenchLine, blocks_per_second: float, watchdog_ms: int) -> None:
    """Clause SER-014: for twenty blocks."""
    line.most_blocks_per_second = blocks_per_second
    begun(line)
    assert round(line.device.watchdog * 1000) == watchdog_ms


def test_a_queue_that_the_last_host_left_full_delays_no_session() -> None:
    line = BenchLine(stays=3600)
    line.device.leaving.extend([3600.0] * 8)
    begun(line)
    assert line.device.free == 8


def test_numbers_wrap(line: BenchLine) -> None:
    session = begun(line)
    session._number, line.device.last = NUMBERS - 3, NUMBERS - 4
    assert [ack.sequence for ack in session.send(*map(sample, range(2)))] == [NUMBERS - 3, NUMBERS - 2]
    answers = transfer(session, 5)
    assert answers.acks["sequence"].tolist() == [NUMBERS - 1, 0, 1, 2, 3]
    assert session.upcoming == (4, False)
    assert [sent.number for sent in line.device.accepted[-5:]] == [NUMBERS - 1, 0, 1, 2, 3]


@pytest.mark.parametrize(
    ("oldest", "newest", "older"), [(2, 3, "phasewire"), (0, 0, "firmware"), (9, 1, "phasewire")], ids=str
)
def test_no_version_in_common(line: BenchLine, oldest: int, newest: int, older: str) -> None:
    """Clause VER-006; the error names the side to update, and the device is left alone."""
    line.device.info = info(oldest_version=oldest, newest_version=newest)
    with pytest.raises(
        DeviceVersionError, match=f"speaks versions {oldest} to {newest} of the .* version 1; update the {older},"
    ):
        begun(line)
    assert (line.device.orders, line.sent) == ([], [])


def test_a_device_that_speaks_later_versions_too(line: BenchLine) -> None:
    line.device.info = info(newest_version=7, later=bytes(range(16)))
    assert begun(line).send(NoOp())[0].reason is Reason.ACCEPTED


@pytest.mark.parametrize("answer", [b"", bytes(7), bytes(63), b"\x01" * 64])
def test_an_information_record_that_makes_no_sense(line: BenchLine, answer: bytes) -> None:
    line.device.info = answer
    with pytest.raises(DeviceError, match="bench B-1 answers in a way that breaks the protocol"):
        begun(line)


# Acknowledgements


def test_statuses_in_between_are_passed_over(line: BenchLine) -> None:
    """Clause ACK-006: the device says by itself what has changed."""
    session = begun(line)

    def tell(data: bytes) -> bytes:
        return line.device.status_record() + data + line.device.status_record()

    line.to_host = nth(2, to=tell)
    answers = transfer(session, 5)
    assert answers.acks["commit_period"].tolist() == list(range(5))


@pytest.mark.parametrize("number", [77, 4, 2**31 - 1])
def test_an_acknowledgement_of_a_block_that_was_not_sent(line: BenchLine, number: int) -> None:
    session = begun(line)
    line.device.say(spec.build_ack({"version": 1, "sequence": number}))
    with pytest.raises(DeviceError, match=f"acknowledges block {number} out of turn; open it again"):
        session.send(sample(1))
    assert session.send(sample(2))[0].commit_period == 2


@pytest.mark.parametrize("junk", [b"junk", bytes(32), spec.build_ack({"version": 1, "sequence": 1})[:31] + b"\0"])
def test_records_that_make_no_sense(line: BenchLine, junk: bytes) -> None:
    session = begun(line)
    line.device.say(junk)
    with pytest.raises(DeviceError, match="breaks the protocol"):
        session.send(sample(1))
    assert session.send(sample(2))[0].commit_period == 2


# Refusals


def test_a_refusal_is_an_error_with_its_reason_and_takes_a_number(line: BenchLine) -> None:
    session = enabled(line)
    session.send(sample(1))
    line.device.last = 100
    with pytest.raises(DeviceRefusedError, match="B-1 refuses block 2: the sequence number does not follow") as refused:
        session.send(sample(2), sample(3))
    assert refused.value.reason is Reason.SEQUENCE
    assert session.upcoming == (3, False)
    assert len(line.sent) == 3  # none is sent after the refused one


# Damage and loss on the way


@pytest.mark.parametrize("at", [40, 4, 0, 28], ids=["payload", "number", "magic", "checksum"])
@pytest.mark.parametrize("times", [1, 2])
def test_a_damaged_block_is_sent_again_under_its_number(at: int, times: int) -> None:
    """Its acknowledgement may bear another number then; so on USB its place in line counts."""
    line = BenchLine()
    session = begun(line)
    line.to_device = nth(*range(1, times + 1), to=flipped(at))
    assert session.send(sample(7))[0].sequence == 1
    line.to_device = nth()
    assert session.send(sample(8))[0].flags == AckFlag(0)
    assert line.device.accepted[1:] == [Sent(1, spec.SAMPLES, 7), Sent(2, spec.SAMPLES, 8)]
    assert len(line.sent) == 1 + times + 2


def test_a_block_that_always_comes_damaged() -> None:
    line = BenchLine()
    session = begun(line)
    line.to_device = flipped(40)
    with pytest.raises(DeviceTimeoutError, match="did not receive a block that was sent 3 times; check the line"):
        session.send(sample(7))
    line.to_device = nth()
    ack = session.send(sample(8))[0]
    assert (ack.commit_period, ack.flags) == (8, AckFlag.GAP)


@pytest.mark.parametrize("block", [True, False], ids=["block", "ack"])
@pytest.mark.parametrize("times", [1, 2])
def test_a_lost_block_or_answer_is_sent_again_and_takes_effect_once(block: bool, times: int) -> None:
    """Clause SER-012; if only the answer was lost, the period is unknown."""
    line = BenchLine(lossy=True)
    session = begun(line)
    if block:
        line.to_device = nth(*range(1, times + 1))
    else:
        line.to_host = nth(*range(1, times + 1))
    ack = session.send(sample(7))[0]
    assert (ack.reason, ack.sequence, ack.commit_period) == (Reason.ACCEPTED, 1, 7 if block else 0)
    assert session.send(sample(8))[0].commit_period == 8
    assert line.device.accepted[1:] == [Sent(1, spec.SAMPLES, 7), Sent(2, spec.SAMPLES, 8)]


@pytest.mark.parametrize("block", [True, False], ids=["block", "ack"])
def test_the_first_block_may_be_lost_too(block: bool) -> None:
    line = BenchLine(lossy=True)
    line.device.last = 500
    if block:
        line.to_device = nth(1)
    else:
        line.to_host = nth(1)
    session = begun(line)
    assert [unpack(sent).restart for sent in line.sent] == [True, True]
    assert session.send(sample(1))[0].sequence == 1


def test_a_line_on_which_everything_is_lost_is_given_up() -> None:
    line = BenchLine(lossy=True)
    session = begun(line)
    line.to_device = lambda data: None
    at_first = line.time.now
    with pytest.raises(DeviceTimeoutError, match="did not receive a block that was sent 3 times; check the line"):
        session.send(sample(7))
    assert line.time.now - at_first < 4
    line.to_device = nth()
    ack = session.send(sample(8))[0]
    assert (ack.sequence, ack.commit_period, ack.flags) == (2, 8, AckFlag.GAP)


@pytest.mark.parametrize("place", [1, 3, 6])
def test_of_many_blocks_lost_ones_are_left_unanswered(place: int) -> None:
    line = BenchLine(lossy=True)
    session = begun(line)
    line.to_device = nth(place)
    answers = transfer(session, 6)
    arrived = [n for n in range(6) if n != place - 1]
    assert np.flatnonzero(answers.answered).tolist() == arrived
    assert answers.acks["commit_period"][arrived].tolist() == arrived
    assert [sent.first for sent in line.device.accepted[1:]] == arrived
    line.to_device, line.to_host = nth(), nth(place)
    answers = transfer(session, 6)
    assert np.flatnonzero(answers.answered).tolist() == arrived
    assert len(line.device.accepted) == 1 + 5 + 6


# How much is on its way


def test_usb_keeps_as_many_on_its_way_as_the_device_can_answer() -> None:
    line = BenchLine()
    session = begun(line)
    transfer(session, 200)
    assert line.most_unanswered == INFO.queue_records == 32


@pytest.mark.parametrize(("queue", "most"), [(8, 9), (1, 2)])
def test_a_line_keeps_to_its_credit(queue: int, most: int) -> None:
    """Clause SER-011: one before the first acknowledgement, then as many as were free and one."""
    line = BenchLine(lossy=True, queue=queue)
    session = begun(line)
    assert line.most_unanswered == 1
    transfer(session, 50)
    assert line.most_unanswered == most
    line.device.stays = 0.02
    session.command(Request.ENABLE)
    assert transfer(session, 30, change).answered.all()
    assert line.device.dropped == 0


@pytest.mark.parametrize("watchdog_ms", [100, 10, 60_000])
def test_a_device_hears_of_a_host_that_waits_for_room(line: BenchLine, watchdog_ms: int) -> None:
    """Clause SAF-003: a block that waits is no sign of life."""
    session = enabled(line)
    session.command(Request.WATCHDOG, watchdog_ms)
    line.device.stays = 0.9
    answers = transfer(session, 20, change)
    assert answers.answered.all()
    assert not line.device.fired
    assert line.time.now > 1.7


def test_the_watchdog_s_time_is_learned_from_the_status(line: BenchLine) -> None:
    """Another program may have set it."""
    session = enabled(line)
    line.device.watchdog = 0.01
    session.status()
    line.device.stays = 0.9
    assert transfer(session, 10, change).answered.all()
    assert not line.device.fired


def test_a_device_that_does_not_answer_is_not_waited_for_for_ever() -> None:
    line = BenchLine()
    session = begun(line)
    line.delay = 5.0
    with pytest.raises(DeviceTimeoutError, match="did not acknowledge a block for 1 s; open it again"):
        session.send(sample(1))
    line.time.sleep(5)
    line.delay = 0.0
    assert session.send(sample(2))[0].commit_period == 2


# When something goes wrong in the middle


ERRORS = [DeviceTimeoutError("late"), DeviceStalledError("stalled"), DeviceLostError("gone"), KeyboardInterrupt()]


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
@pytest.mark.parametrize("what", ["write", "read"])
@pytest.mark.parametrize("nth_call", [1, 2, 5])
def test_whatever_happens_the_next_answer_is_the_next_block_s(
    line: BenchLine, error: BaseException, what: str, nth_call: int
) -> None:
    session = begun(line)
    line.at_once, line.delay = 3, 0.002
    line.fails = Once(what, error, nth_call)
    with pytest.raises(type(error)):
        transfer(session, 12)
    for place in (100, 101):
        ack = session.send(sample(place))[0]
        assert (ack.reason, ack.commit_period) == (Reason.ACCEPTED, place)
    firsts = [sent.first for sent in line.device.accepted[1:]]
    assert firsts == sorted(set(firsts))


@pytest.mark.parametrize("error", ERRORS[:3], ids=lambda error: type(error).__name__)
def test_a_status_that_fails_while_it_waits_for_room(error: DeviceError) -> None:
    line = BenchLine(stays=3600)
    session = enabled(line)
    session.send(*map(change, range(8)))
    line.fails = Once("STATUS", error)
    with pytest.raises(type(error)):
        session.send(change(8))
    line.device.leaving.clear()
    assert session.send(change(9))[0].sequence == 9


# Coming back


@pytest.mark.parametrize("what", ["INFO", "STATUS", "DISABLE", "write", "read"])
@pytest.mark.parametrize("error", ERRORS[:3], ids=lambda error: type(error).__name__)
def test_a_device_that_leaves_again_while_it_comes_back_is_waited_for(
    line: BenchLine, what: str, error: DeviceError
) -> None:
    session = begun(line)
    line.fails = Once(what, error)
    session.reopen()
    assert len(line.reopened_within) == 2
    assert session.send(sample(3))[0].commit_period == 3


def test_a_device_that_keeps_leaving_is_given_up() -> None:
    line = BenchLine()
    session = begun(line)

    def fails(what: str) -> None:
        if what == "INFO":
            line.time.sleep(0.5)
            raise DeviceLostError("gone")

    line.fails = fails
    at_first = line.time.now
    with pytest.raises(DeviceLostError, match="gone"):
        session.reopen(3.0)
    assert 3 <= line.time.now - at_first <= 4
    assert line.reopened_within[:6] == pytest.approx([3, 2.5, 2, 1.5, 1, 0.5], abs=0.01)


# Anything

DELAYS = [0.0, 0.0, 0.0, 0.004, 0.3, 0.9, 1.2, 2.5]


@settings(max_examples=300)
@given(
    counts=st.lists(st.integers(0, 12), min_size=1, max_size=12),
    seed=st.integers(0, 2**32),
    loss=st.sampled_from([0.0, 0.05, 0.3, 0.7]),
    queue=st.integers(1, 6),
    stays=st.sampled_from([0.0, 0.01, 0.7, 1.6]),
    lossy=st.booleans(),
)
def test_no_block_takes_effect_twice_or_out_of_order_and_every_answer_is_its_block_s(
    counts: list[int], seed: int, loss: float, queue: int, stays: float, lossy: bool
) -> None:
    """One block by itself for a count of 0, otherwise so many at a time; lines lose both ways, USB damages blocks."""
    rng = np.random.default_rng(seed)
    line = BenchLine(lossy=lossy, queue=queue, stays=stays)
    session = enabled(line)
    session.command(Request.WATCHDOG, 60_000)

    def lose(data: bytes) -> bytes | None:
        return None if rng.random() < loss else data

    if lossy:
        line.to_device = line.to_host = lose
    else:
        line.to_device = lambda data: flipped(int(rng.integers(512)))(data) if rng.random() < loss else data
    place, begun = 0, len(line.device.accepted)
    claimed: list[int] = []
    for count in counts:
        line.delay = float(rng.choice(DELAYS)) if lossy else 0.0
        line.at_once = int(rng.choice([1, 3, 100]))
        bodies = [sample(place + n) if rng.random() < 0.5 else change(place + n) for n in range(max(count, 1))]
        place += len(bodies)
        told = {id(body): n for n, body in enumerate(bodies, place - len(bodies))}
        try:
            if count:
                answers = Answers.none(count)
                number = session.upcoming[0]
                send(session, blocks(session, count, bodies.__getitem__), answers)
                known = np.flatnonzero(answers.answered)
                accepted = [n for n in known.tolist() if answers.acks["reason"][n] == Reason.ACCEPTED]
                assert (answers.acks["sequence"][accepted] == number + np.array(accepted, int)).all()
                for n in accepted:
                    if isinstance(bodies[n], Samples):
                        assert answers.acks["commit_period"][n] == told[id(bodies[n])]
                claimed += [number + n for n in accepted]
                assert lossy or len(known) == count
            else:
                number = session.upcoming[0]
                (ack,) = session.send(bodies[0])
                assert ack.sequence == number
                assert ack.commit_period in (0, told[id(bodies[0])])
                claimed.append(number)
        except DeviceTimeoutError:
            pass
    for _ in range(2):  # the one that waited, and then that one too
        line.time.sleep(20)
        line.device.pass_time()
    numbers = [sent.number for sent in line.device.accepted[begun:]]
    assert numbers == sorted(set(numbers))
    assert set(claimed) <= set(numbers)
    places = [sent.first for sent in line.device.accepted[begun:] if sent.kind == spec.SAMPLES]
    assert places == sorted(set(places))
    line.to_device = line.to_host = nth()
    line.delay = 0.0
    line.time.sleep(20)  # the waiting block has a place in the queue now
    assert session.send(sample(4000))[0].commit_period == 4000
