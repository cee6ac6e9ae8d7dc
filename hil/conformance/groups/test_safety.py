"""Safety: silencing and its times, the watchdog, and the limit on the total drive (chapter SAF)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import pytest
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Inconclusive, Need, NotApplicable, Risk, TooSlow, case, expect, not_allowed
from phasewire.hil.conformance.sight.capture import Seen
from phasewire.hil.conformance.sight.waveforms import SILENCE, Words, check_play, check_silent, expected_words, only
from phasewire.hil.conformance.tools.drives import power, widths_for
from phasewire.hil.conformance.tools.forge import forged
from phasewire.hil.conformance.tools.playing import PLAYS, check_falls_silent, play, silent_from
from phasewire.hil.conformance.tools.playing import start as start_playing
from phasewire.hil.conformance.tools.steps import (
    LONG_MS,
    SILENT,
    enable,
    expect_all,
    features_of,
    forge,
    known,
    require,
    set_limit,
    some,
    store_entry,
)
from phasewire.hil.conformance.tools.watchdog import TICKS_PER_MS, await_firing, check_not_yet, far_ahead, patience
from phasewire.protocol.blocks import (
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
    Update,
    pack,
)
from phasewire.protocol.board import CHANNELS, TICKS_PER_PERIOD, WATCHDOG_MS
from phasewire.protocol.codes import (
    BLOCK_BYTES,
    REQUEST_TYPE_IN,
    REQUEST_TYPE_OUT,
    SILENT_PERIODS,
    Action,
    DfuRequest,
    Feature,
    Flag,
    Reason,
    Request,
    StandardRequest,
    State,
    StatusFlag,
)
from phasewire.protocol.enumeration import ENDPOINT_IN, ENDPOINT_OUT
from phasewire.protocol.pulses import Pulses
from phasewire.protocol.replies import ANSWER_BYTES, Ack, Status
from phasewire.protocol.requests import ConsoleRequest, Setup

CAPTURE = (Need.CAPTURE,)
ATTENDED = [what for what in PLAYS if what != "unattended"]
ALL = tuple(PLAYS)


# The watchdog


@pytest.mark.parametrize("what", ["nothing", *ATTENDED])
@case("SAF-003", "ACK-006", "STA-003", outputs=("SAF-004/1",))
def test_the_watchdog_silences_what_plays(bench: Bench, what: str) -> None:
    """Without a sign of life the watchdog fires, not early and at most a period late, and all outputs fall silent."""
    ms = patience(bench)
    enable(bench)
    field = None if what == "nothing" else start_playing(bench, what)
    last = bench.must(NoOp()).now
    bench.order(Request.WATCHDOG, ms)
    check_not_yet(bench, last + ms * TICKS_PER_MS)
    await_firing(bench, last, last, ms)
    expect_all(
        bench.status(), state=State.OFF, since_period=0, flags=StatusFlag.WATCHDOG_FIRED, free=bench.info.queue_blocks
    )
    fires = last + ms * TICKS_PER_MS
    end = fires // TICKS_PER_PERIOD + 100
    if field is None:
        bench.judge(last // TICKS_PER_PERIOD, end, check_silent)
    else:
        words = field.words
        bench.judge(field.period, end, lambda seen: check_falls_silent(seen, words, fires, fires + TICKS_PER_PERIOD))


@case("SAF-003", "REQ-009")
def test_the_watchdog_has_its_default_time(bench: Bench) -> None:
    """The watchdog time at power-up is that of INFO, 100 ms, and it holds without a WATCHDOG request."""
    expect("the watchdog time that INFO tells", bench.info.watchdog_ms, WATCHDOG_MS)
    before = bench.clock().now
    bench.enable()
    last = bench.must(NoOp()).now
    check_not_yet(bench, before + WATCHDOG_MS * TICKS_PER_MS)
    await_firing(bench, last, last, WATCHDOG_MS)


@case("SAF-003", "STA-003")
def test_the_watchdog_starts_with_enable(bench: Bench) -> None:
    """A host that enables the outputs and then falls silent is silenced too, one watchdog time after ENABLE.

    Nothing is left of the watchdog's time before DISABLE.
    """
    ms = patience(bench)
    bench.must(NoOp())
    enable(bench, ms)
    bench.wait(ms / 3000)
    bench.order(Request.DISABLE)
    bench.outlast(2 * ms / 1000)
    bench.unasked.clear()  # a slow line may have let the watchdog fire before DISABLE
    before = bench.clock().now
    bench.enable()
    after = bench.clock().now
    await_firing(bench, before, after, ms)


@case("SAF-003", "REQ-003", "STA-003")
def test_the_watchdog_rests_while_the_outputs_are_off(bench: Bench) -> None:
    """While the outputs are not enabled no watchdog fires, because there is nothing to silence."""
    ms = patience(bench)
    bench.must(NoOp())
    bench.order(Request.WATCHDOG, ms)
    before = bench.clock().now
    bench.enable()
    bench.disable()
    check_not_yet(bench, before + ms * TICKS_PER_MS)
    expect("the unsolicited records", bench.listen(2 * ms / 1000), [])
    expect("the flags", bench.status().flags, StatusFlag(0))


@case("REQ-003", "SAF-003", "REQ-005")
def test_the_status_says_that_the_watchdog_fired_until_enable(bench: Bench) -> None:
    """WATCHDOG_FIRED stays in the status until the outputs are enabled again, so that the host sees it."""
    enable(bench, patience(bench))
    bench.await_unasked(2)
    for _ in range(2):
        assert bench.status().watchdog_fired, "WATCHDOG_FIRED is gone before ENABLE"
    bench.order(Request.DISABLE)
    assert bench.status().watchdog_fired, "WATCHDOG_FIRED is gone after DISABLE, should stay until ENABLE"
    bench.enable()
    expect("the flags after ENABLE", bench.status().flags, StatusFlag(0))
    bench.order(Request.DISABLE)
    expect("the flags after DISABLE", bench.status().flags, StatusFlag(0))


@case("REQ-009", "SAF-003", since=2)
def test_a_shorter_watchdog_time_holds_at_once(bench: Bench) -> None:
    """If the last sign of life is longer ago than the new watchdog time, the watchdog fires with the request."""
    enable(bench)
    bench.must(NoOp())
    bench.outlast(0.05)
    before = bench.clock().now
    bench.order(Request.WATCHDOG, 10)
    after = bench.clock().now
    told = bench.await_unasked(1)
    assert told.watchdog_fired, f"the flags in the record are {told.flags!r}, should have WATCHDOG_FIRED"
    assert before <= told.now <= after + TICKS_PER_PERIOD, (
        f"the watchdog fired at tick {told.now}, should be from {before} to {after + TICKS_PER_PERIOD}"
    )


@case("REQ-009", "SAF-003")
def test_a_longer_watchdog_time_counts_from_the_last_sign_of_life(bench: Bench) -> None:
    """A watchdog time that is extended before it is over counts from the last sign of life, not from the request."""
    short = patience(bench)
    long = 3 * short
    enable(bench)
    last = bench.must(NoOp()).now
    bench.order(Request.WATCHDOG, short)
    bench.wait(short / 3000)
    bench.order(Request.WATCHDOG, long)
    check_not_yet(bench, last + short * TICKS_PER_MS)
    expect("the watchdog time in the status", await_firing(bench, last, last, long).watchdog_ms, long)


KINDS: dict[str, Body] = {
    "update": Update(SILENT),
    "slot": Slot(0, SILENT),
    "entries": Entries((Entry(0, 1),)),
    "sequence": PlaySequence(0, 1),
    "samples": Samples(bytes([255])),
    "modulation": AmplitudeModulation(0, 1, 1),
    "output": Output(Action.SILENCE),
    "clock": Clock(),
    "no-op": NoOp(),
}
"""A block of each kind, which is accepted while something plays."""


def prepare(bench: Bench, kind: str) -> None:
    """Store the data to which a block of a kind refers."""
    require(bench, features_of(KINDS[kind]))
    for store in {"sequence": ("slot", "entries"), "modulation": ("samples",)}.get(kind, ()):
        bench.must(KINDS[store])


@pytest.mark.parametrize("kind", KINDS)
@case("SAF-003", "BLK-019", "BLK-020")
def test_an_accepted_block_is_a_sign_of_life(bench: Bench, kind: str) -> None:
    """An accepted block of this kind restarts the watchdog's full time from its last byte."""
    ms = patience(bench)
    prepare(bench, kind)
    enable(bench)
    first = bench.must(NoOp()).now
    bench.order(Request.WATCHDOG, ms)
    bench.wait(ms / 3000)
    ack = bench.send(KINDS[kind])
    if ack.now >= first + ms * TICKS_PER_MS:
        raise TooSlow("this line is too slow: the watchdog fired before the block arrived")
    expect("the reason", ack.reason, Reason.ACCEPTED)
    await_firing(bench, ack.now, ack.now, ms)


@pytest.mark.parametrize("request_", [Request.STATUS, Request.ENABLE], ids=lambda request: request.name)
@case("SAF-003", "REQ-005")
def test_a_request_that_is_a_sign_of_life(bench: Bench, request_: Request) -> None:
    """STATUS and, while the outputs are enabled, ENABLE restart the watchdog: a host may have nothing to play."""
    ms = patience(bench)
    enable(bench)
    last = bench.must(NoOp()).now
    bench.order(Request.WATCHDOG, ms)
    bench.wait(ms / 2000)
    before = bench.clock().now
    if request_ is Request.STATUS:
        bench.status()
    else:
        bench.enable()
    after = bench.clock().now
    if after >= last + ms * TICKS_PER_MS:
        raise TooSlow("this line is too slow: the watchdog may have fired before the request arrived")
    await_firing(bench, before, after, ms)


@dataclass(frozen=True)
class Refused:
    """Blocks that are refused, given the acknowledgement of the last accepted one.

    `before` may prepare something while the outputs are off; it returns what must be accepted once they are enabled.
    """

    blocks: Callable[[Bench, Ack], list[bytes]]
    before: Callable[[Bench], list[Body]] = lambda _: [NoOp()]


ANY_FLAGS = (0, Flag.RESTART)
"""Flags that every kind may have (clause BLK-011)."""
FLAGS_OF_A_SEQUENCE = (*ANY_FLAGS, Flag.UNATTENDED, Flag.RESTART | Flag.UNATTENDED)


def with_flags(bench: Bench, bodies: Iterable[Body], payload: bytes | None = None, **fields: int) -> list[bytes]:
    """Blocks with the same defect, each with all flags that its kind may have."""
    return [
        forge(bench, body, payload, flags=flags, **fields)
        for body in bodies
        for flags in (FLAGS_OF_A_SEQUENCE if isinstance(body, PlaySequence) else ANY_FLAGS)
    ]


def wrong(kinds: Iterable[str], payload: bytes | None = None, **fields: int) -> Refused:
    """Blocks of some kinds with one defect."""
    return Refused(lambda bench, _: with_flags(bench, [KINDS[kind] for kind in kinds], payload, **fields))


def shortened(bench: Bench, _: Ack) -> list[bytes]:
    """Blocks that end too early, with and without the bytes at their ends."""
    return [pack(bench.numbered(NoOp(), restart=True))[:size] for size in (500, 27, 1)]


def lacking(bench: Bench, _: Ack) -> list[bytes]:
    """Blocks that need a feature which the device lacks."""
    bodies = [*KINDS.values(), PlaySequence(0, 1, unattended=True), Output(Action.END_MODULATION)]
    lacked = [body for body in bodies if features_of(body) & ~bench.info.features]
    if not lacked:
        raise NotApplicable("it has the feature of every block")
    return [block for body in lacked for block in with_flags(bench, [body])]


def numbered_as(bench: Bench, last: Ack) -> list[bytes]:
    """Blocks of all kinds that the device has, with a number that was already accepted."""
    bodies = known(bench, *KINDS.values(), PlaySequence(0, 1, unattended=True))
    return [pack(bench.numbered(body, number=last.sequence)) for body in bodies]


def what_plays(bench: Bench) -> list[Body]:
    """The start of a stored sequence and of a stored modulation."""
    require(bench, Feature.SEQUENCES)
    store_entry(bench, 1000, pulses=SILENT)
    if Feature.MODULATION not in bench.info.features:
        return [PlaySequence(0, 1)]
    bench.must(Samples(bytes([255])))
    return [AmplitudeModulation(0, 1, 1), PlaySequence(0, 1)]


def in_use(bench: Bench, _: Ack) -> list[bytes]:
    """Stores over what plays."""
    return with_flags(bench, known(bench, *(KINDS[kind] for kind in ("slot", "entries", "samples"))))


def named_update(bench: Bench) -> list[Body]:
    """An update for a distant period, on a device that refuses another directly after it."""
    if bench.info.periods_per_update < 2:
        raise NotApplicable("its chain can carry an update in every period")
    return [Update(SILENT, bench.period() + far_ahead(bench))]


def without_drive(bench: Bench) -> list[Body]:
    """None, under a limit that allows only one pulse in a slot that was stored before."""
    for body in known(bench, Slot(0, WEAKEST), KINDS["entries"]):
        bench.must(body)
    bench.order(Request.LIMIT, 0)
    return [NoOp()]


def too_strong(bench: Bench, _: Ack) -> list[bytes]:
    """Blocks that would drive one transducer."""
    return with_flags(bench, known(bench, Update(WEAKEST), Slot(1, WEAKEST), PlaySequence(0, 1)))


def without_stores(bench: Bench) -> list[Body]:
    """None, on a device that has nothing stored."""
    require(bench, Feature.SEQUENCES)
    if Risk.RESET not in bench.allowed:
        raise Inconclusive(not_allowed(Risk.RESET))
    bench.restart(lambda: bench.order(Request.RESET))
    return [NoOp()]


def never_stored(bench: Bench, _: Ack) -> list[bytes]:
    """Blocks that would play empty stores."""
    return with_flags(bench, known(bench, PlaySequence(0, 1), AmplitudeModulation(0, 1, 1)))


WEAKEST = only(CHANNELS - 1, width=1)
FEW_REFUSED = 2
"""Blocks that a slow serial line carries within the watchdog time."""
NAMING = ("update", "sequence", "modulation", "output")
"""Kinds that name a period."""

REFUSED: dict[Reason, Refused] = {
    Reason.LENGTH: Refused(shortened),
    Reason.CHECKSUM: wrong(KINDS, checksum=1),
    Reason.MAGIC: wrong(KINDS, magic=0),
    Reason.VERSION: wrong(KINDS, version=77),
    Reason.KIND: wrong(KINDS, kind=99),
    Reason.FIELD: wrong(KINDS, reserved=1),
    Reason.PULSE: wrong(("update", "slot"), b"\x7f"),
    Reason.UNSUPPORTED: Refused(lacking),
    Reason.SEQUENCE: Refused(numbered_as),
    Reason.HORIZON: Refused(
        lambda bench, _: with_flags(bench, known(bench, *(KINDS[kind] for kind in NAMING)), period=2**62)
    ),
    Reason.RATE: Refused(lambda bench, last: with_flags(bench, [Update(SILENT, last.commit_period + 1)]), named_update),
    Reason.DRIVE: Refused(too_strong, without_drive),
    Reason.EMPTY: Refused(never_stored, without_stores),
    Reason.IN_USE: Refused(in_use, what_plays),
}
"""All reasons except FAULT and DISABLED, with which blocks are refused while no watchdog runs."""


@pytest.mark.parametrize("reason", REFUSED, ids=lambda reason: reason.name.lower())
@case("SAF-003", "BLK-003", "BLK-008")
def test_a_refused_block_is_no_sign_of_life(bench: Bench, reason: Reason) -> None:
    """A host whose blocks are refused counts as silent, whatever their kinds and flags: its wishes do not play."""
    if reason is Reason.LENGTH and bench.line.kind == "serial":
        raise NotApplicable("a frame of another length carries no block")
    ms, refused = patience(bench), REFUSED[reason]
    accepted = refused.before(bench)
    enable(bench)
    last = [bench.must(body) for body in accepted][-1]
    bench.order(Request.WATCHDOG, ms)
    bench.wait(ms / 3000)
    blocks = some(bench, refused.blocks(bench, last), FEW_REFUSED, seconds=ms / 4000)
    at_once = 1 if reason is Reason.LENGTH else len(blocks)
    acks = [ack for at in range(0, len(blocks), at_once) for ack in bench.send_raw(*blocks[at : at + at_once])]
    check_not_yet(bench, last.now + ms * TICKS_PER_MS)
    expect("the reasons", {ack.reason for ack in acks}, {reason})
    await_firing(bench, last.now, last.now, ms)


NO_SIGNS = (
    *(Request.INFO, Request.WIRING, Request.CLOCK, Request.PULSES, Request.PROCESSORS),
    *(Request.WATCHDOG, Request.LIMIT, Request.CLEAR_FAULTS, Request.IDENTIFY),
)


@contextmanager
def no_sign_of_life(bench: Bench) -> Iterator[int]:
    """What is done here must not keep the watchdog from firing, whose time in ms has begun before."""
    ms = patience(bench)
    enable(bench)
    last = bench.must(NoOp()).now
    bench.order(Request.WATCHDOG, ms)
    bench.wait(ms / 3000)
    yield ms
    check_not_yet(bench, last + ms * TICKS_PER_MS)
    await_firing(bench, last, last, ms)


@pytest.mark.parametrize("other", NO_SIGNS, ids=lambda request: request.name.lower().replace("_", "-"))
@case("SAF-003")
def test_another_request_is_no_sign_of_life(bench: Bench, other: Request) -> None:
    """Requests other than STATUS and ENABLE do not restart the watchdog: an observer may send them."""
    if other is Request.PULSES:
        require(bench, Feature.READ_BACK)
    with no_sign_of_life(bench) as ms:
        if other in ANSWER_BYTES:
            bench.ask(other)
        else:
            bench.try_order(other, ms if other is Request.WATCHDOG else 0)


STALLED: dict[str, tuple[Setup, ...]] = {
    "status": (
        Setup(REQUEST_TYPE_IN, Request.STATUS, 1, 0, Status.BYTES),
        Setup(REQUEST_TYPE_IN, Request.STATUS, 0, 0x0100, Status.BYTES),
        Setup(REQUEST_TYPE_OUT, Request.STATUS, 0, 0, 0),
    ),
    "enable": (
        Setup(REQUEST_TYPE_OUT, Request.ENABLE, 1, 0, 0),
        Setup(REQUEST_TYPE_OUT, Request.ENABLE, 0, 0x0100, 0),
        Setup(REQUEST_TYPE_OUT, Request.ENABLE, 0, 0, 4),
    ),
    "others": (Setup(REQUEST_TYPE_OUT, Request.LIMIT, 0, 0, 0), Setup(REQUEST_TYPE_IN, 99, 0, 0, 64)),
}
"""Requests that are answered with STALL while the outputs are enabled."""


@pytest.mark.parametrize("what", STALLED)
@case("SAF-003", "REQ-001")
def test_a_request_that_is_answered_with_stall_is_no_sign_of_life(bench: Bench, what: str) -> None:
    """Requests that are answered with STALL, even STATUS and ENABLE, have no effect and do not restart the watchdog."""
    with no_sign_of_life(bench):
        for setup in STALLED[what]:
            answer = bench.request(setup, b"" if setup.is_in else bytes(setup.length))
            expect(f"the answer to request {setup}", answer, None)


def use_endpoints(bench: Bench) -> None:
    """End a halt, send an empty packet and read."""
    bench.usb.clear_halt(ENDPOINT_OUT)
    bench.usb.write(ENDPOINT_OUT, b"", 0.01)
    bench.usb.read(ENDPOINT_IN, BLOCK_BYTES, 0.001)


def ask_all(*setups: Setup) -> Callable[[Bench], None]:
    """Make requests, and ignore the answers."""

    def ask(bench: Bench) -> None:
        for setup in setups:
            bench.request(setup)

    return ask


ON_THE_BUS: dict[str, Callable[[Bench], None]] = {
    "standard": ask_all(
        Setup(0x80, StandardRequest.GET_STATUS, 0, 0, 2),
        Setup(0x80, StandardRequest.GET_DESCRIPTOR, 0x0100, 0, 18),
        Setup(0x81, StandardRequest.GET_STATUS, 0, 0, 2),
        Setup(0x82, StandardRequest.GET_STATUS, 0, ENDPOINT_OUT, 2),
    ),
    "class": ask_all(Setup(0xA1, ConsoleRequest.GET_LINE_CODING, 0, 1, 7), Setup(0xA1, DfuRequest.GETSTATUS, 0, 3, 6)),
    "endpoints": use_endpoints,
}
"""Actions that are no signs of life."""


@pytest.mark.parametrize("what", ON_THE_BUS)
@case("SAF-003", "USB-014", "USB-015", "USB-018", "USB-023", "USB-024", line="usb")
def test_nothing_else_on_the_bus_is_a_sign_of_life(bench: Bench, what: str) -> None:
    """Standard and class requests, the end of a halt, an empty packet and reading do not restart the watchdog."""
    with no_sign_of_life(bench):
        ON_THE_BUS[what](bench)


# Unattended playing


UNATTENDED = Feature.SEQUENCES | Feature.UNATTENDED


@case("SAF-005", "STA-003", outputs=("SAF-005", "BLK-015"), features=UNATTENDED)
def test_an_unattended_sequence_goes_on_without_its_host(bench: Bench) -> None:
    """An unattended sequence plays on when the host falls silent for many watchdog times."""
    enable(bench)
    field = start_playing(bench, "unattended")
    bench.order(Request.WATCHDOG, 10)
    expect("the unsolicited records", bench.listen(0.2), [])
    expect_all(bench.status(), state=State.UNATTENDED, flags=StatusFlag.SEQUENCE, since_period=field.period)
    bench.judge(field.period, bench.period(), lambda seen: check_play(seen, [(field.period, field.words)]))


ENDS: dict[str, tuple[Callable[[int], Body] | None, State]] = {
    "last-repeat": (None, State.READY),
    "silence": (lambda period: Output(Action.SILENCE, period), State.READY),
    "update": (lambda period: Update(SILENT, period), State.PLAYING),
    "attended-sequence": (lambda period: PlaySequence(0, 1, period), State.PLAYING),
}
"""The block that ends an unattended sequence, and the state after its end."""


@pytest.mark.parametrize("how", ENDS)
@case("SAF-005", "SAF-003", "STA-003", features=UNATTENDED)
def test_the_watchdog_starts_anew_when_an_unattended_sequence_ends(bench: Bench, how: str) -> None:
    """When an unattended sequence ends and the outputs stay enabled, the watchdog time counts from its end."""
    ms = patience(bench)
    body, state = ENDS[how]
    enable(bench)
    store_entry(bench, 8000)
    ended = bench.must(PlaySequence(0, 1, repeats=1 if body is None else 0, unattended=True)).commit_period + 8000
    if body is not None:
        expect("the period at which the end is due", bench.must(body(ended)).commit_period, ended)
    before = bench.status()
    check_not_yet(bench, ended * TICKS_PER_PERIOD, before.now)
    expect("the state before the end", before.state, State.UNATTENDED)
    bench.wait_until(ended)
    bench.order(Request.WATCHDOG, ms)
    check_not_yet(bench, ended * TICKS_PER_PERIOD + ms * TICKS_PER_MS)
    if how == "last-repeat":
        told = bench.await_unasked(1)
        check_not_yet(bench, ended * TICKS_PER_PERIOD + ms * TICKS_PER_MS, told.now)
        expect("the state in the record of the end", told.state, state)
    (refused,) = bench.send_raw(forged(pack(bench.numbered(NoOp())), checksum=1))  # which is no sign of life
    tick = ended * TICKS_PER_PERIOD
    check_not_yet(bench, tick + ms * TICKS_PER_MS, refused.now)
    expect("the state after the end", refused.state, state)
    await_firing(bench, tick, tick, ms)


@case("SAF-005", "SAF-003", "STA-003", features=Feature.SEQUENCES)
def test_the_end_of_an_attended_sequence_is_no_sign_of_life(bench: Bench) -> None:
    """After the last repeat of an attended sequence the watchdog counts on from the host's last sign of life."""
    ms = patience(bench)
    enable(bench)
    store_entry(bench, 200)
    last = bench.must(PlaySequence(0, 1, repeats=2))
    bench.order(Request.WATCHDOG, ms)
    expect("the state in the record of the end", bench.await_unasked(1).state, State.READY)
    await_firing(bench, last.now, last.now, ms)


# DISABLE


@pytest.mark.parametrize("what", PLAYS)
@case("SAF-004", "STA-003", outputs=("SAF-004/1", "BLK-017", "CHN-029"))
def test_disable_silences_what_plays(bench: Bench, what: str) -> None:
    """On DISABLE all outputs fall silent together, at a boundary within six periods, and the queue is empty."""
    enable(bench)
    field = start_playing(bench, what)
    before = bench.clock().now
    bench.order(Request.DISABLE)
    after = bench.clock().now
    expect_all(bench.status(), state=State.OFF, since_period=0, flags=StatusFlag(0), free=bench.info.queue_blocks)
    end = after // TICKS_PER_PERIOD + 100
    bench.judge(field.period, end, lambda seen: check_falls_silent(seen, field.words, before, after))


def check_cut_short(seen: Seen, playing: Words, following: Words, begins: int, fires: int, last_fires: int) -> None:
    """Fail unless what plays, or what was to begin on all outputs at a period, falls silent in time."""
    since = silent_from(seen)
    latest = last_fires // TICKS_PER_PERIOD + SILENT_PERIODS
    assert fires // TICKS_PER_PERIOD < since <= latest, (
        f"the outputs are silent from period {since} on, should be from one of {fires // TICKS_PER_PERIOD + 1} to "
        f"{latest} on"
    )
    steps = [(seen.first_period, playing), (since, SILENCE)]
    if begins < since and ((seen.period(begins) ^ playing) & seen.observed).any():
        steps.insert(1, (begins, following))
    check_play(seen, steps)


@case("SAF-004/2", "SAF-004/1", "CHN-029", needs=CAPTURE)
def test_a_change_close_to_the_end_begins_everywhere_or_nowhere(bench: Bench) -> None:
    """A change due just after the watchdog fires begins on all processors or on none, then all outputs are low.

    The watchdog sets to the tick when the outputs are disabled, however long a request takes on the line.
    """
    found: set[int] = set()
    enable(bench)
    for _ in range(bench.tries(12, 2, 10)):
        bench.enable()
        bench.order(Request.WATCHDOG, LONG_MS)
        field, following = play(bench), bench.weak()
        begins = bench.period() + far_ahead(bench)
        ack = bench.must(Update(following, begins))
        expect("the period at which the change is to begin", ack.commit_period, begins)
        for _ in range(10):
            ahead = (begins * TICKS_PER_PERIOD - ack.now) % TICKS_PER_MS // TICKS_PER_PERIOD
            if ahead < 12 and ahead not in found:
                break
            bench.wait_periods(bench.random.uniform(1, 40))
            ack = bench.must(NoOp())
        ms = (begins * TICKS_PER_PERIOD - ack.now) // TICKS_PER_MS
        if ms < 10:
            raise TooSlow("this line is too slow: the change is due before the watchdog can be set")
        fires = ack.now + ms * TICKS_PER_MS
        bench.order(Request.WATCHDOG, ms)
        check_not_yet(bench, fires)
        await_firing(bench, ack.now, ack.now, ms)
        bench.unasked.clear()
        found.add(ahead)
        words = expected_words(following, bench.wiring)

        def check(
            seen: Seen, playing: Words = field.words, words: Words = words, begins: int = begins, fires: int = fires
        ) -> None:
            check_cut_short(seen, playing, words, begins, fires, fires + TICKS_PER_PERIOD)

        bench.judge(field.period, begins + 60, check)


@case("SAF-004/2", "SAF-004", "REQ-003", "STA-003", outputs=("SAF-004/2",))
def test_what_is_queued_is_dropped_by_disable(bench: Bench) -> None:
    """Changes that were queued at DISABLE never begin, not even after the outputs are enabled again."""
    enable(bench)
    ahead = far_ahead(bench)
    first = bench.period() + ahead
    changes = queue_of_everything(bench, first)
    before = bench.status()
    check_not_yet(bench, first * TICKS_PER_PERIOD, before.now)
    expect("the free places", before.free, bench.info.queue_blocks - changes)
    bench.order(Request.DISABLE)
    check_not_yet(bench, first * TICKS_PER_PERIOD)
    since = bench.period() + SILENT_PERIODS
    expect("the free places", bench.status().free, bench.info.queue_blocks)
    bench.enable()
    bench.wait_periods(ahead + 500)
    after = bench.status()
    expect_all(after, state=State.READY, since_period=0, flags=StatusFlag(0))
    expect_all(after, missed_commits=before.missed_commits, damaged_messages=before.damaged_messages)
    expect("the blocks accepted, refused, late and lost", counts(after), counts(before))
    bench.judge(since, bench.period(), check_silent)


@case("BLK-018", "SAF-004", "STA-003", "REQ-003", outputs=("BLK-018", "SAF-004"))
def test_what_is_accepted_behind_a_disabling_block_is_dropped(bench: Bench) -> None:
    """Changes accepted after a disabling OUTPUT never begin, and are only counted as accepted."""
    enable(bench)
    field = play(bench)
    ends = bench.period() + far_ahead(bench)
    expect("the period of the end", bench.must(Output(Action.DISABLE, ends)).commit_period, ends)
    behind = queue_of_everything(bench, ends + 200)
    before = bench.status()
    check_not_yet(bench, ends * TICKS_PER_PERIOD, before.now)
    expect("the free places", before.free, bench.info.queue_blocks - behind - 1)
    bench.wait_until(ends + 1)
    after = bench.status()
    expect_all(after, state=State.OFF, free=bench.info.queue_blocks)
    expect("the blocks accepted, refused, late and lost", counts(after), counts(before))
    bench.enable()
    bench.wait_until(ends + 400)
    expect_all(bench.status(), state=State.READY, since_period=0)
    steps = [(field.period, field.words), (ends, SILENCE)]
    bench.judge(field.period, ends + 400, lambda seen: check_play(seen, steps))


def queue_of_everything(bench: Bench, period: int) -> int:
    """Queue changes of all kinds that the device knows, the first of them for a period; returns their number."""
    features = bench.info.features
    bodies: list[Callable[[int], Body]] = [lambda at: Update(bench.weak(), at)]
    if Feature.SEQUENCES in features:
        store_entry(bench, 3)
        bodies.append(lambda at: PlaySequence(0, 1, at))
    if Feature.MODULATION in features:
        bench.must(Samples(bytes([200])))
        bodies.append(lambda at: AmplitudeModulation(0, 1, 1, at))
    for number, body in enumerate(bodies):
        bench.must(body(period + 20 * number))
    return len(bodies)


def counts(status: Status) -> tuple[int, int, int, int]:
    """The device's counts of blocks."""
    return status.accepted, status.refused, status.late, status.lost


def silence_by_watchdog(bench: Bench) -> None:
    """Let the watchdog fire."""
    bench.order(Request.WATCHDOG, 10)
    bench.await_unasked(1)
    bench.order(Request.WATCHDOG, LONG_MS)


OFF: dict[str, Callable[[Bench], None]] = {
    "disable": lambda bench: bench.order(Request.DISABLE),
    "output": lambda bench: bench.wait_until(bench.must(Output(Action.DISABLE)).commit_period),
    "watchdog": silence_by_watchdog,
}
"""Ways to disable the outputs."""


@pytest.mark.parametrize("how", OFF)
@case("SAF-004", outputs=("SAF-004", "CHN-012/2"), features=Feature.SEQUENCES)
def test_what_is_stored_stays_when_the_outputs_are_disabled(bench: Bench, how: str) -> None:
    """Slots, entries and samples survive when the outputs are disabled, and play after the next ENABLE."""
    first, second = bench.weak(), bench.weak()
    bench.must(Slot(255, first))
    bench.must(Slot(0, second))
    bench.must(Entries((Entry(255, 30), Entry(0, 10)), 1022))
    enable(bench)
    play(bench)
    OFF[how](bench)
    bench.wait_periods(SILENT_PERIODS)
    bench.enable()
    began = bench.must(PlaySequence(1022, 2)).commit_period
    words = [expected_words(pulses, bench.wiring) for pulses in (first, second)]
    steps = [(began + at, words[at % 40 == 30]) for at in (0, 30, 40, 70, 80, 110)]
    bench.judge(began, began + 120, lambda seen: check_play(seen, steps))


@pytest.mark.parametrize("how", ["begin", *OFF])
@case("SAF-002", "BLK-008", "ACK-003", "STA-003")
def test_changes_are_refused_while_the_outputs_are_off(bench: Bench, how: str) -> None:
    """Every change is refused with DISABLED before ENABLE and after DISABLE; stores, CLOCK and NO_OP are accepted."""
    if how != "begin":
        enable(bench)
        OFF[how](bench)
    bench.unasked.clear()
    for body in known(bench, *(KINDS[kind] for kind in ("clock", "no-op", "slot", "entries", "samples"))):
        ack = bench.must(body)
        expect("the state in the acknowledgement", ack.state, State.OFF)
    before = bench.status()
    distant = PlaySequence(0, 1, repeats=3, period=bench.period() + 10_000)
    refused = known(bench, *(KINDS[kind] for kind in NAMING), distant, *map(Output, Action))
    for body in refused:
        ack = bench.send(body)
        expect(f"the reason for {body.KIND.name}", ack.reason, Reason.DISABLED)
        expect("the state in the acknowledgement", ack.state, State.OFF)
        expect("the period at which it takes effect", ack.commit_period, 0)
    expect_all(
        bench.status(),
        refused=before.refused + len(refused),
        last_refusal=Reason.DISABLED,
        accepted=before.accepted,
        free=bench.info.queue_blocks,
    )
    bench.enable()
    bench.wait_periods(100)
    expect("the state, as nothing of it was queued", bench.status().state, State.READY)
    for body in refused[:1]:
        bench.must(body)


# The limit on the total drive


def pulses_of(bench: Bench, total: int, width: int) -> Pulses:
    """Pulses of a total drive, in thousandths of a transducer, one of them of a given width; scattered at random."""
    widths = np.zeros(CHANNELS, np.uint8)
    used = (width, *widths_for(total - power(width)))
    widths[bench.random.sample(range(CHANNELS), len(used))] = used
    return Pulses([bench.random.randrange(100) for _ in range(CHANNELS)], widths)


@case("SAF-006", "REQ-010", features=Feature.SEQUENCES)
def test_the_power_of_every_width_is_counted(bench: Bench) -> None:
    """A slot exactly at the limit is accepted, one a thousandth above is refused with DRIVE, for all widths."""
    set_limit(bench, 3)
    widths = list(range(1, 26))
    for width in some(bench, widths, 8, 2):
        ack = bench.send(Slot(0, pulses_of(bench, 3000, width)))
        expect(f"the reason for 3000 thousandths with a width of {width}", ack.reason, Reason.ACCEPTED)
        ack = bench.send(Slot(0, pulses_of(bench, 3001, width)))
        expect(f"the reason for 3001 thousandths with a width of {width}", ack.reason, Reason.DRIVE)


@pytest.mark.parametrize("limit", [1, 2, 17, 31])
@case("SAF-006", "REQ-010", "BLK-008", outputs=("SAF-006", "BLK-008"))
def test_an_update_above_the_limit_is_refused(bench: Bench, limit: int) -> None:
    """An update exactly at the limit plays; one slightly above is refused with DRIVE, and what plays goes on."""
    set_limit(bench, limit)
    enable(bench)
    most = np.zeros(CHANNELS, np.uint8)
    most[bench.random.sample(range(CHANNELS), limit)] = 25
    field = play(bench, Pulses(np.zeros(CHANNELS, np.uint8), most))
    more = most.copy()
    more[int(np.flatnonzero(more == 0)[0])] = 1
    before = bench.status()
    expect("the reason", bench.send(Update(Pulses(np.zeros(CHANNELS, np.uint8), more))).reason, Reason.DRIVE)
    expect_all(bench.status(), refused=before.refused + 1, last_refusal=Reason.DRIVE, since_period=field.period)
    bench.judge(field.period, bench.period(), lambda seen: check_play(seen, [(field.period, field.words)]))


@case("SAF-006", "REQ-010", "BLK-008", features=Feature.SEQUENCES)
def test_a_sequence_with_a_slot_above_a_lowered_limit_is_refused(bench: Bench) -> None:
    """A slot that was stored, and played, under a higher limit does not play under a lower one, at any place."""
    set_limit(bench, 3)
    bench.must(Slot(0, pulses_of(bench, 2000, 25)))
    bench.must(Slot(1, pulses_of(bench, 2001, 24)))
    bench.must(Entries((Entry(0, 10), Entry(0, 5), Entry(1, 1))))
    enable(bench)
    bench.must(PlaySequence(0, 3))
    bench.disable()
    set_limit(bench, 2)
    bench.enable()
    for count, reason in ((3, Reason.DRIVE), (2, Reason.ACCEPTED), (3, Reason.DRIVE)):
        expect(f"the reason for {count} entries", bench.send(PlaySequence(0, count)).reason, reason)
    expect("the last refusal", bench.status().last_refusal, Reason.DRIVE)
    expect("the reason for the entry alone", bench.send(PlaySequence(2, 1)).reason, Reason.DRIVE)
    bench.disable()
    set_limit(bench, 3)
    bench.enable()
    expect("the reason under the old limit", bench.send(PlaySequence(0, 3)).reason, Reason.ACCEPTED)


@case("SAF-006", "REQ-010")
def test_a_limit_of_nothing_lets_only_silence_through(bench: Bench) -> None:
    """Under a limit of 0 transducers an update of silence is accepted and the weakest pulse refused with DRIVE."""
    bench.order(Request.LIMIT, 0)
    expect("the limit in the status", bench.status().drive_limit, 0)
    enable(bench)
    expect("the reason for silence", bench.send(Update(SILENT)).reason, Reason.ACCEPTED)
    expect("the reason for one pulse of a tick", bench.send(Update(only(CHANNELS - 1, width=1))).reason, Reason.DRIVE)


@case("REQ-010", "SAF-006")
def test_the_limit_cannot_be_set_while_the_outputs_are_enabled(bench: Bench) -> None:
    """LIMIT is answered with STALL and changes nothing while the outputs are enabled, and above the limit of INFO."""
    set_limit(bench, 2)
    assert not bench.try_order(Request.LIMIT, bench.info.drive_limit + 1), "LIMIT takes more than INFO says"
    expect("the limit in the status", bench.status().drive_limit, 2)
    enable(bench)
    for what in ("nothing", "update"):
        if what == "update":
            play(bench, only(0))
        for limit in (1, 2, 3):
            assert not bench.try_order(Request.LIMIT, limit), f"LIMIT is carried out while {what} plays"
        expect("the limit in the status", bench.status().drive_limit, 2)
    expect("the reason for 2 transducers", bench.send(Update(both(0, 1))).reason, Reason.ACCEPTED)
    bench.disable()
    expect("the limit in the status after DISABLE", bench.status().drive_limit, 2)
    bench.enable()
    expect("the reason for 3 transducers after DISABLE", bench.send(Update(both(0, 1, 2))).reason, Reason.DRIVE)
    bench.disable()
    assert bench.try_order(Request.LIMIT, 1), "LIMIT is answered with STALL after DISABLE"
    expect("the limit in the status", bench.status().drive_limit, 1)


def both(*transducers: int) -> Pulses:
    """The widest pulses of some transducers."""
    width = np.zeros(CHANNELS, np.uint8)
    width[list(transducers)] = 25
    return Pulses(np.zeros(CHANNELS, np.uint8), width)


@case("SAF-006", "REQ-002", allow=(Risk.DRIVE,))
def test_the_limit_holds_for_the_whole_array(bench: Bench) -> None:
    """All transducers at their widest are a drive of 320, which plays under that limit and not under one of 319."""
    full = both(*range(CHANNELS))
    most = bench.info.drive_limit
    assert most <= CHANNELS, f"the limit that INFO tells is {most}, should be {CHANNELS} at most"
    if most < CHANNELS:
        raise Inconclusive(f"this device allows {most} transducers, never all {CHANNELS}")
    bench.must(NoOp())
    bench.order(Request.LIMIT, CHANNELS - 1)
    enable(bench)
    expect("the reason under a limit of 319", bench.send(Update(full)).reason, Reason.DRIVE)
    bench.disable()
    bench.order(Request.LIMIT, CHANNELS)
    bench.enable()
    ack = bench.must(Update(full))
    bench.wait_until(ack.commit_period + 1)
    expect("the state", bench.status().state, State.PLAYING)
