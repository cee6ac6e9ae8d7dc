"""Steps of several groups: beginning, storing, checking that a refusal changes nothing.

They speak to the device and judge only what they say.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from ....protocol.blocks import (
    AmplitudeModulation,
    Body,
    Clock,
    Entries,
    Entry,
    NoOp,
    Output,
    PlaySequence,
    Samples,
    Slot,
    pack,
)
from ....protocol.board import CHANNELS, TICKS_PER_PERIOD
from ....protocol.codes import (
    BLOCK_BYTES,
    RECORD_BYTES,
    SLOTS,
    SYNC_PERIODS,
    AckFlag,
    Action,
    Feature,
    Reason,
    Request,
    State,
)
from ....protocol.pulses import Pulses
from ....protocol.replies import Status
from ...traffic.traffic import Traffic
from ..bench import TRIED_SECONDS, Bench
from ..cases import Inconclusive, NotApplicable, expect
from .forge import forged
from .player import soon

Item = TypeVar("Item")

LONG_MS = 60_000
"""The longest watchdog time, longer than any case (clause REQ-009)."""
FAR_PERIODS = 2_000_000
"""50 s: a change so far ahead stays in the queue during the whole case."""
LATER_BLOCKS = 12
"""How many a case can send before a period that it names."""
FEW = 6
"""How many values of one sort are tried on the slowest line."""

MOST_ENTRY_PERIODS = 65_535
"""The longest entry of a sequence (clause BLK-014)."""
SILENT = Pulses.silent(CHANNELS)

UNTOUCHED = (
    *("state", "faults", "flags", "since_period", "accepted", "late", "lost", "missed_commits", "damaged_messages"),
    *("free", "watchdog_ms", "drive_limit", "dropped_frames"),
)
"""Fields of a status that neither time nor a refusal changes."""


class Wrong(NamedTuple):
    """A block that must be refused."""

    what: str
    """Its defect."""
    block: bytes
    reason: Reason


def require(bench: Bench, features: Feature) -> None:
    """Continue only if the device has some features; otherwise not applicable."""
    if missing := features & ~bench.info.features:
        raise NotApplicable(f"INFO does not name the feature {missing.name}")


def features_of(body: Body) -> Feature:
    """The features that a block needs (clause VER-005)."""
    match body:
        case PlaySequence(unattended=True):
            return Feature.SEQUENCES | Feature.UNATTENDED
        case Slot() | Entries() | PlaySequence():
            return Feature.SEQUENCES
        case Samples() | AmplitudeModulation() | Output(action=Action.END_MODULATION):
            return Feature.MODULATION
    return Feature(0)


def known(bench: Bench, *bodies: Body) -> list[Body]:
    """Those blocks for which the device has the features."""
    return [body for body in bodies if features_of(body) in bench.info.features]


def enable(bench: Bench, ms: int = LONG_MS) -> None:
    """Enable the outputs, with a watchdog time, a long one by default."""
    bench.order(Request.WATCHDOG, ms)
    bench.enable()


def begin(bench: Bench) -> None:
    """Enable the outputs, with a long watchdog time, and restart the numbering."""
    enable(bench)
    bench.must(NoOp())


IN_WORDS = {
    "accepted": "the count of accepted blocks",
    "dropped_frames": "the count of damaged frames",
    "free": "the free places",
    "late": "the count of late changes",
    "lost": "the count of lost blocks",
    "refused": "the count of refused blocks",
    "sequence": "the number",
    "since_period": "what plays since",
    "watchdog_ms": "the watchdog's time",
}
"""Fields of records as a failure names them, if their own names do not say it."""


def expect_all(record: object, when: str = "", /, **wanted: object) -> None:
    """Fail unless a record has these values; a text tells of which moment."""
    for name, value in wanted.items():
        expect(f"{IN_WORDS.get(name) or f'the {name}'.replace('_', ' ')}{when}", getattr(record, name), value)


def await_state(bench: Bench, state: State) -> None:
    """Wait until the device is in a state."""
    for _ in range(100):
        if bench.status().state is state:
            return
        bench.wait(0.01)
    raise AssertionError(f"the state stays {bench.status().state.name}, should be {state.name}")


@contextmanager
def suspended(bench: Bench) -> Iterator[None]:
    """Suspend the bus for a while."""
    bench.levers.suspend()
    try:
        yield
    finally:
        bench.levers.resume()


def check_refused(bench: Bench, body: Body, reason: Reason) -> None:
    """Send a block that must be refused, and check the reason and the count."""
    before = bench.status()
    expect_all(bench.send(body), f" for {body.KIND.name}", reason=reason, commit_period=0)
    after = bench.status()
    expect("the count of refused blocks", after.refused - before.refused, 1)
    expect("the last refusal", after.last_refusal, reason)


def set_limit(bench: Bench, transducers: int) -> None:
    """Set the limit; inconclusive if it is above what this bench or the device allows."""
    if transducers > bench.drive_limit:
        raise Inconclusive(f"this needs a limit of {transducers} transducers; {bench.drive_limit} are allowed here")
    bench.order(Request.LIMIT, transducers)


def far(bench: Bench) -> int:
    """A period that does not come during the case."""
    return bench.period() + FAR_PERIODS


def later(bench: Bench) -> int:
    """A period that the case can wait for, and before which it can send several blocks."""
    return soon(bench, LATER_BLOCKS)


def some(
    bench: Bench, items: Iterable[Item], least: int = FEW, blocks: float = 1, seconds: float = TRIED_SECONDS
) -> list[Item]:
    """All of them, or those for which the line has the time (`Bench.tries`): the first, the last, and some drawn."""
    every = list(items)
    made = bench.tries(len(every), least, blocks, seconds)
    if made == len(every):
        return every
    inner = bench.random.sample(range(1, len(every) - 1), max(made - 2, 0))
    return [every[index] for index in sorted([0, len(every) - 1, *inner])]


def forge(bench: Bench, body: Body, payload: bytes | None = None, /, **fields: int) -> bytes:
    """A block with the next number and other values in its header, or another payload, with a matching checksum."""
    return forged(pack(bench.numbered(body)), payload, **fields)


def refuse(bench: Bench, blocks: Sequence[Wrong]) -> None:
    """Send blocks that must be refused, each for its reason, and check that they have no other effect."""
    before = bench.status()
    acks = bench.send_raw(*(wrong.block for wrong in blocks))
    after = bench.status()
    time = before.now
    for (what, block, reason), ack in zip(blocks, acks, strict=True):
        if ack.reason is not reason:
            bench.note(f"block with {what}", block, Traffic.BLOCK)
        expect(f"the reason for {what}", ack.reason, reason)
        expect(f"commit_period for {what}", ack.commit_period, 0)
        expect(f"flags for {what}", ack.flags, AckFlag(0))
        expect(f"free for {what}", ack.free, before.free)
        expect(f"state for {what}", ack.state, before.state)
        assert time <= ack.now <= after.now, f"now for {what} is {ack.now}, should be from {time} to {after.now}"
        time = ack.now
    expect_all(after, " in STATUS", refused=(before.refused + len(blocks)) % 2**32, last_refusal=blocks[-1].reason)
    check_same(before, after)


def check_same(before: Status, after: Status, **changes: object) -> None:
    """Fail if two statuses differ in more than time, temperature, refusals and the named changes."""
    for name in UNTOUCHED:
        expect(f"{name} in STATUS", getattr(after, name), changes.get(name, getattr(before, name)))


def check_sync(bench: Bench) -> None:
    """Fail unless CLOCK, request and block, names the newest multiple of 4096 periods, and a pulse for each that began.

    A device that shares its sync line may have counted more, before its own period 0 (clause CHN-026).
    """
    reading = bench.clock()
    if reading.now // TICKS_PER_PERIOD % SYNC_PERIODS in (0, SYNC_PERIODS - 1):  # a pulse comes at this moment
        bench.wait_periods(2)
        reading = bench.clock()
    period = reading.now // TICKS_PER_PERIOD
    expect("sync_period", reading.sync_period, period - period % SYNC_PERIODS)
    ack = bench.must(Clock())
    expect("the period in a CLOCK's acknowledgement", ack.commit_period, ack.now_period - ack.now_period % SYNC_PERIODS)
    least = reading.sync_period // SYNC_PERIODS + 1
    assert reading.sync_pulses >= least, f"sync_pulses is {reading.sync_pulses}, should be at least {least}"


def store_entry(bench: Bench, periods: int, place: int = 0, pulses: Pulses | None = None) -> Pulses:
    """Store an entry of so many periods, and its slot with pulses, weak ones by default; returns them."""
    pulses = bench.weak() if pulses is None else pulses
    bench.must(Slot(place % SLOTS, pulses))
    bench.must(Entries((Entry(place % SLOTS, periods),), place))
    return pulses


def let_stores_go(bench: Bench, queued: int = 0) -> Status:
    """Wait until stores that wait for the chain do not count as a full queue (BLK-024), with so many changes queued."""
    places = bench.info.queue_blocks - queued
    for _ in range(100):
        status = bench.status()
        if status.free == places:
            return status
        bench.outlast(0.005)
    raise AssertionError(f"free is {status.free} half a second after the last store, should be {places} again")


def heavy(transducers: int) -> Pulses:
    """Some transducers driven fully, the others silent."""
    return Pulses([0] * CHANNELS, [25] * transducers + [0] * (CHANNELS - transducers))


def packed(pulses: Iterable[tuple[int, int]]) -> bytes:
    """Any phases and widths, packed as in clause PUL-005; the rest of 320 silent with phase 0."""
    words = [phase | width << 7 for phase, width in pulses]
    words += [0] * (CHANNELS - len(words))
    pairs = zip(words[::2], words[1::2], strict=True)
    return b"".join((first | second << 12).to_bytes(3, "little") for first, second in pairs)


def late_phase(pulses: Pulses) -> bytes:
    """The payload of these pulses, except the last, which has a phase of 127."""
    pairs = list(zip(pulses.phase.tolist(), pulses.width.tolist(), strict=True))
    return packed([*pairs[:-1], (127, 0)])


def raw_records(bench: Bench, blocks: Sequence[bytes], seconds: float = 10.0) -> list[bytes]:
    """Send blocks, at most as many as the device can hold records; returns one answer for each, cut at the magic."""
    bench.note_blocks(blocks)
    found = b""
    data, sent = b"".join(blocks), 0
    end = bench.line.time.monotonic() + seconds + len(blocks) / 10
    at_once = len(data) if bench.line.kind == "usb" else BLOCK_BYTES
    while sent < len(data) or len(found) < 32 * len(blocks):
        if sent < len(data) and (bench.line.kind == "usb" or len(found) >= sent // BLOCK_BYTES * RECORD_BYTES):
            sent += bench.line.send_blocks(data[sent : sent + at_once], 0.1)
        found += bench.line.receive_records(0.01)
        assert len(found) >= 32 * len(blocks) or bench.line.time.monotonic() < end, (
            f"{len(found)} bytes of records came for {len(blocks)} blocks, should be {32 * len(blocks)}"
        )
    bench.note("records", found, Traffic.RECORD)
    return cut(found)


def cut(found: bytes) -> list[bytes]:
    """Cut bytes from bulk IN into records: 64 bytes after the magic of a status, else 32 (clause ACK-005)."""
    records = []
    while found:
        size = 64 if found[:2] == b"PS" else 32
        records.append(found[:size])
        found = found[size:]
    return records


@cache
def vectors(section: str) -> list[dict[str, Any]]:
    """The golden vectors of a section of vectors.json, which were not made by a device."""
    text = (Path(__file__).parents[3] / "protocol" / "vectors.json").read_text()
    found: list[dict[str, Any]] = json.loads(text)[section]["vectors"]
    return found
