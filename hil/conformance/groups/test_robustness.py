"""Robustness: nonsense on every endpoint, reproducible by its seed, between blocks that must be accepted."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import groupby

import pytest
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import Risk, case, expect
from phasewire.hil.conformance.sight.waveforms import check_play, check_silent, expected_words
from phasewire.hil.conformance.tools.forge import FIELDS, forged
from phasewire.hil.conformance.tools.steps import enable, expect_all
from phasewire.protocol.blocks import Block, Body, Clock, Entries, Entry, NoOp, Samples, Slot, Update, pack
from phasewire.protocol.board import TICK_HZ
from phasewire.protocol.codes import (
    BLOCK_BYTES,
    SAMPLES_PER_BLOCK,
    SERIAL_DATA_BYTES,
    AckFlag,
    DfuRequest,
    Feature,
    FrameKind,
    Reason,
    Request,
    State,
)
from phasewire.protocol.framing import DELIMITER, SerialFrame, encode
from phasewire.protocol.pulses import Pulses
from phasewire.protocol.replies import ANSWER_BYTES, Ack, Status, records
from phasewire.protocol.requests import Setup

ENDPOINTS = (0x01, 0x81, 0x82, 0x03, 0x83)
INTERFACES = (0, 1, 2, 3)
SOON = 5.0
COUNTED = ("late", "lost", "missed_commits", "damaged_messages", "faults", "watchdog_ms", "drive_limit", "state")

PRINTABLE = bytes(range(0x20, 0x7F))

STANDARD, CLASS, VENDOR, RESERVED = 0x00, 0x20, 0x40, 0x60
IN = 0x80
KNOWN_STANDARD = {0, 1, 3, 5, 6, 8, 9, 10, 11}
"""Clause USB-014."""
LASTING = {VENDOR: (Request.RESET, Request.REVERT), CLASS: (DfuRequest.DETACH, DfuRequest.DNLOAD)}
"""Requests, by type, that restart a device or change its firmware if it knows them, valid or not."""
LASTS = frozenset({Risk.FLASH, Risk.RESET})


# Checks afterwards


def at_most(bench: Bench, count: int) -> int:
    """So many, or a few of them if the line is slow."""
    return bench.tries(count, max(count // 8, 1), 2)


def check_sound(bench: Bench, before: Status, accepted: int, refused: int) -> None:
    """INFO is unchanged, counts match the acknowledgements, and no endpoint is halted."""
    expect("INFO", bench.ask(Request.INFO), bench.info.encode())
    after, end = bench.status(), bench.line.time.monotonic() + SOON
    while after.free != before.free and bench.line.time.monotonic() < end:  # stores may wait to go onto the chain
        after = bench.status()
    expect_all(
        after,
        free=before.free,
        accepted=(before.accepted + accepted) % 2**32,
        refused=(before.refused + refused) % 2**32,
    )
    for name in COUNTED:
        expect(f"the status' {name}", getattr(after, name), getattr(before, name))
    if bench.line.kind == "usb":
        expect("the configuration", bench.request(Setup(0x80, 8, 0, 0, 1)), b"\x01")
        for endpoint in ENDPOINTS:
            expect(f"the status of endpoint {endpoint:02X}", bench.request(Setup(0x82, 0, 0, endpoint, 2)), bytes(2))


def play(bench: Bench, pulses: Pulses | None = None) -> Ack:
    """An update that plays, with a watchdog time longer than any case."""
    enable(bench)
    ack = bench.must(Update(pulses or bench.weak()))
    bench.wait_until(ack.commit_period)
    return ack


# Blocks


def good_block(bench: Bench) -> bytes:
    """A block that is accepted in every state, whatever plays."""
    bodies: list[Body] = [NoOp(), Clock()]
    if Feature.MODULATION in bench.info.features:
        samples = bench.random.randbytes(bench.random.randint(1, SAMPLES_PER_BLOCK))
        bodies.append(Samples(samples, bench.random.randrange(3000)))
    if Feature.SEQUENCES in bench.info.features:
        bodies.append(Slot(bench.random.randrange(256), bench.weak(0.5)))
        bodies.append(Entries((Entry(bench.random.randrange(256), bench.random.randint(1, 65535)),), 1000))
    return pack(bench.numbered(bench.random.choice(bodies)))


def any_block(bench: Bench) -> bytes:
    """A valid block except for its number."""
    return pack(Block(NoOp(), bench.random.randrange(2**32)))


def noise(bench: Bench) -> tuple[bytes, Reason]:
    """Bytes that are no block."""
    return bench.random.randbytes(BLOCK_BYTES), Reason.CHECKSUM


def uniform(bench: Bench) -> tuple[bytes, Reason]:
    """One repeated byte, as from memory that was never written, or from a line that is stuck."""
    byte = bench.random.choice([0x00, 0xFF, 0x55, 0xAA, bench.random.randrange(256)])
    return bytes([byte] * BLOCK_BYTES), Reason.CHECKSUM


def flipped(bench: Bench) -> tuple[bytes, Reason]:
    """A valid block with one to three bits flipped anywhere, which its checksum always detects."""
    data = bytearray(any_block(bench))
    for at in bench.random.sample(range(8 * BLOCK_BYTES), bench.random.randint(1, 3)):
        data[at // 8] ^= 1 << at % 8
    return bytes(data), Reason.CHECKSUM


def wrong_fields(bench: Bench) -> tuple[bytes, Reason]:
    """A block with a nonsensical header and a valid checksum; the reserved bytes are never 0."""
    names = bench.random.sample([name for name in FIELDS if name not in ("checksum", "reserved")], 5)
    fields = {name: bench.random.randrange(256 ** FIELDS[name][1]) for name in names}
    data = forged(any_block(bench), None, reserved=bench.random.randint(1, 65535), **fields)
    if data[:2] != b"PW":
        return data, Reason.MAGIC
    if not bench.info.oldest_version <= data[2] <= bench.info.newest_version:
        return data, Reason.VERSION
    return data, Reason.FIELD if 1 <= data[3] <= 9 else Reason.KIND


def cut_short(bench: Bench) -> tuple[bytes, Reason]:
    """A packet that ends before a block does."""
    packet = bench.usb.bulk_bytes
    sizes = [size for size in range(1, BLOCK_BYTES) if size % packet]
    return any_block(bench)[: bench.random.choice(sizes)], Reason.LENGTH


KINDS = {
    "noise": noise,
    "one-byte": uniform,
    "flipped-bits": flipped,
    "wrong-fields": wrong_fields,
    "cut-short": cut_short,
}


def send(bench: Bench, blocks: Iterable[bytes]) -> list[Ack]:
    """Send blocks, consecutive whole ones in one go; returns their acknowledgements, in order."""
    acks: list[Ack] = []
    for whole, run in groupby(blocks, lambda block: len(block) == BLOCK_BYTES):
        for piece in [list(run)] if whole else [[block] for block in run]:
            acks += bench.send_raw(*piece)
    return acks


def mixed(bench: Bench, kinds: Iterable[str], count: int) -> tuple[list[bytes], list[Reason]]:
    """Blocks, some of them valid, and the expected reasons of their acknowledgements."""
    names = list(kinds)
    made = [
        (good_block(bench), Reason.ACCEPTED) if number % 3 == 0 else KINDS[bench.random.choice(names)](bench)
        for number in range(count)
    ]
    return [block for block, _ in made], [reason for _, reason in made]


def check_batch(bench: Bench, kinds: Iterable[str], count: int) -> None:
    """Send a mixture; each block must be answered, and the device must be unchanged except for its counts."""
    before = bench.status()
    blocks, reasons = mixed(bench, kinds, count)
    acks = send(bench, blocks)
    expect("the list of reasons", [ack.reason.name for ack in acks], [reason.name for reason in reasons])
    for ack in acks:
        expect(f"the flags of block {ack.sequence}", ack.flags, AckFlag(0))
        expect(f"the state that block {ack.sequence} was judged in", ack.state, before.state)
    nows = [ack.now for ack in acks]
    expect("the times of arrival", nows, sorted(nows))
    good = reasons.count(Reason.ACCEPTED)
    check_sound(bench, before, good, len(reasons) - good)
    expect("the last refusal", bench.status().last_refusal, [reason for reason in reasons if reason][-1])


@case("BLK-003", "BLK-008", "BLK-011", "ACK-001", "ACK-003", "REQ-003")
@pytest.mark.parametrize("kind", ["noise", "one-byte", "flipped-bits", "wrong-fields"])
def test_valid_blocks_get_through_between_wrong_ones(bench: Bench, kind: str) -> None:
    """Among nonsensical blocks each valid one is accepted, each other one refused, and all are counted."""
    bench.must(NoOp())
    for _ in range(at_most(bench, 5)):
        check_batch(bench, [kind], at_most(bench, 36))


@case("USB-015", "USB-017/1", "BLK-008", "ACK-001", line="usb")
def test_valid_blocks_get_through_between_short_packets(bench: Bench) -> None:
    """Among packets of any length each whole block is accepted, and no packet misaligns the next block."""
    bench.must(NoOp())
    for _ in range(5):
        check_batch(bench, ["cut-short", "noise"], 30)


@case("USB-015", "USB-017/1", "ACK-001", "ACK-003", line="usb")
def test_transfers_of_any_length_are_cut_into_blocks(bench: Bench) -> None:
    """A transfer of n random bytes gets one refusal for each 512 of them and one for the rest, and nothing hangs."""
    bench.must(NoOp())
    before, refused = bench.status(), 0
    for _ in range(20):
        size = bench.random.randint(1, 6 * BLOCK_BYTES)
        data, sent, end = bench.random.randbytes(size), 0, bench.line.time.monotonic() + SOON
        while sent < size and bench.line.time.monotonic() < end:
            sent += bench.usb.write(0x01, data[sent:], SOON)
        expect("the count of bytes that were taken", sent, size)
        whole, rest = divmod(size, BLOCK_BYTES)
        if rest and size % bench.usb.bulk_bytes == 0:
            bench.usb.write(0x01, b"", SOON)
        wanted = [Reason.CHECKSUM] * whole + [Reason.LENGTH] * bool(rest)
        found = collect(bench, len(wanted))
        expect(f"the list of reasons for {size} bytes", [ack.reason.name for ack in found], [r.name for r in wanted])
        refused += len(wanted)
        bench.must(NoOp())
    check_sound(bench, before, 20, refused)


def collect(bench: Bench, count: int) -> list[Ack]:
    """So many acknowledgements; fails if they do not come."""
    found: list[Ack] = []
    end = bench.line.time.monotonic() + SOON
    while len(found) < count:
        assert bench.line.time.monotonic() < end, f"{len(found)} of {count} acknowledgements come in {SOON:g} s"
        found += [record for record in records(bench.line.receive_records(SOON)) if isinstance(record, Ack)]
    return found


@case("BLK-008", outputs=("BLK-008", "SAF-002", "SAF-001"))
def test_nonsense_moves_no_output(bench: Bench) -> None:
    """No nonsense raises an output while the outputs are off."""
    bench.must(NoOp())
    first = bench.period()
    for _ in range(at_most(bench, 3)):
        check_batch(bench, ["noise", "flipped-bits", "wrong-fields"], at_most(bench, 30))
    last = bench.period()
    bench.judge(max(first, last - 2000), last, check_silent)


@case("BLK-008", "BLK-003", outputs=("BLK-008", "BLK-003"))
def test_what_plays_goes_on_through_nonsense(bench: Bench) -> None:
    """What plays goes on tick by tick through nonsense of every kind: one flipped bit must not be heard."""
    pulses = bench.weak()
    ack = play(bench, pulses)
    for _ in range(at_most(bench, 3)):
        check_batch(bench, ["noise", "flipped-bits", "wrong-fields"], at_most(bench, 30))
    expect("what plays since", bench.status().since_period, ack.commit_period)
    last = bench.period()
    first = max(ack.commit_period, last - 2000)
    words = expected_words(pulses, bench.wiring)
    bench.judge(first, last, lambda seen: check_play(seen, [(first, words)]))


@case("SAF-003", "BLK-008")
def test_nonsense_is_no_sign_of_life(bench: Bench) -> None:
    """The watchdog fires while only nonsense comes, because the host that sends it is out of control."""
    watchdog = 150 if bench.line.kind == "usb" else 500
    enable(bench, watchdog)
    bench.must(Update(bench.weak()))
    due = bench.clock().now + 3 * watchdog * TICK_HZ // 1000
    while bench.clock().now < due:
        block, _ = bench.random.choice([noise, flipped, wrong_fields])(bench)
        bench.send_raw(block)
        bench.wait(0.005)
    status = bench.status()
    expect("the state", status.state, State.OFF)
    assert status.watchdog_fired, "the watchdog has not fired while nothing but refused blocks came"


# Control requests


def random_setups(bench: Bench) -> Iterator[tuple[Setup, bytes]]:
    """An endless series of requests that no device knows, with data for those that send some."""
    rng = bench.random
    while True:
        kind = rng.choice([STANDARD, CLASS, VENDOR, VENDOR, RESERVED]) | rng.choice([0, IN])
        recipient = rng.randrange(4)
        request = rng.choice([rng.randrange(16), rng.randrange(0x20, 0x24), rng.randrange(256)])
        value = rng.choice([0, 0, 1, rng.randrange(65536)])
        index = {1: rng.choice(INTERFACES), 2: rng.choice(ENDPOINTS)}.get(
            recipient, rng.choice([0, 7, rng.randrange(256)])
        )
        data = b"" if kind & IN else rng.randbytes(rng.choice([0, 0, 1, 7, 64]))
        setup = Setup(
            kind | recipient, request, value, index, rng.choice([1, 64, BLOCK_BYTES]) if kind & IN else len(data)
        )
        lasts = setup.request in LASTING.get(kind & 0x60, ())
        if is_unknown(setup) and (bench.allowed >= LASTS or not lasts):
            yield setup, data


def is_unknown(setup: Setup) -> bool:
    """Whether no value or index lets a device answer this request, by SPEC.md."""
    kind, recipient = setup.request_type & 0x60, setup.request_type & 0x1F
    if kind == STANDARD:
        return setup.request not in KNOWN_STANDARD
    if kind == VENDOR and recipient == 0:
        return setup.request != 0x20
    if kind == VENDOR and recipient == 1:
        return setup.index != 0 or setup.request not in set(Request)
    if kind == CLASS and recipient == 1:
        return setup.index in (0, 2) or (setup.request not in range(7) and setup.request not in range(0x20, 0x23))
    return True


@case("USB-004", "REQ-001", "USB-014", line="usb")
def test_unknown_requests_stall_between_valid_blocks(bench: Bench) -> None:
    """Random requests that no device knows are answered with STALL, and blocks between them are accepted."""
    play(bench)
    before, setups = bench.status(), random_setups(bench)
    for _ in range(160):
        setup, data = next(setups)
        answer = bench.request(setup, data)
        assert answer is None, f"{setup} with {len(data)} bytes is answered with {answer!r}, should be with STALL"
        expect("the flags", bench.must(NoOp()).flags, AckFlag(0))
    check_sound(bench, before, 160, 0)


@case("REQ-001", "REQ-002", "REQ-003", "REQ-004")
def test_as_much_of_an_answer_comes_as_was_asked_for(bench: Bench) -> None:
    """Each answer is cut to the requested length, however short, and never longer than it is."""
    asked = (Request.INFO, Request.WIRING, Request.STATUS, Request.CLOCK, Request.PROCESSORS)
    sizes = {request: ANSWER_BYTES[request] for request in asked}
    for request, size in sizes.items():
        others = [bench.random.randint(1, SERIAL_DATA_BYTES) for _ in range(at_most(bench, 8))]
        for length in [1, size - 1, size, *others]:
            answer = bench.request(Setup(0xC1, request, 0, 0, length))
            found = None if answer is None else len(answer)
            expect(f"the length of {request.name} with wLength {length}", found, min(size, length))
            if request in (Request.INFO, Request.WIRING):
                expect(f"{length} bytes of {request.name}", answer, bench.ask(request)[:length])


@case("REQ-001", "SAF-002")
def test_orders_with_wrong_values_have_no_effect(bench: Bench) -> None:
    """Commands with values, indices or data that they do not take are answered with STALL and change nothing."""
    before, rng = bench.status(), bench.random
    orders = {
        Request.ENABLE: range(1),
        Request.DISABLE: range(1),
        Request.WATCHDOG: range(10, 60_001),
        Request.LIMIT: range(bench.info.drive_limit + 1),
        Request.CLEAR_FAULTS: range(1),
        Request.IDENTIFY: range(bench.info.boards),
    }
    for request, values in orders.items():
        wrong = [values.stop, 65535, *([values.start - 1] if values.start else [])]
        wrong += [value for value in (rng.randrange(65536) for _ in range(at_most(bench, 8))) if value not in values]
        setups = [(Setup(0x41, request, value, 0, 0), b"") for value in wrong]
        setups += [
            (Setup(0x41, request, values.start, index, 0), b"") for index in (1, 3, 0x0100, rng.randint(1, 65535))
        ]
        setups += [(Setup(0x41, request, values.start, 0, size), rng.randbytes(size)) for size in (1, 64)]
        setups.append((Setup(0xC1, request, values.start, 0, 64), b""))
        for setup, data in setups:
            answer = bench.request(setup, data)
            assert answer is None, f"{setup} with {len(data)} bytes is answered with {answer!r}, should be with STALL"
    check_sound(bench, before, 0, 0)


# All at once


@case("USB-015", "USB-025", "BLK-008", "USB-004", line="usb")
def test_the_device_survives_nonsense_everywhere(bench: Bench) -> None:
    """Valid blocks are accepted among wrong ones, short packets, unknown requests and chatter; playing goes on."""
    first = play(bench)
    setups = random_setups(bench)
    for _ in range(10):
        for setup, data in (next(setups) for _ in range(10)):
            answer = bench.request(setup, data)
            assert answer is None, f"{setup} with {len(data)} bytes is answered with {answer!r}, should be with STALL"
        bench.usb.write(0x03, bench.random.randbytes(bench.random.randint(1, 600)), 0.01)
        bench.usb.read(0x83, 16 * BLOCK_BYTES, 0.01)
        check_batch(bench, KINDS, 20)
    expect_all(bench.status(), state=State.PLAYING, since_period=first.commit_period)


# The console


def chatter(bench: Bench, size: int) -> bytes:
    """Bytes as a wrongly configured terminal might send them: text, ends of lines, zeros, anything."""
    rng = bench.random
    alphabets = [PRINTABLE, b"\r\n\x03\x08\x7f\x15 ", bytes(range(256)), b"\0\1\2\3\xff"]
    return bytes(rng.choice(rng.choice(alphabets)) for _ in range(size))


@case("SER-006", "SER-010/1", "CON-009", "USB-025", features=Feature.CONSOLE)
def test_the_device_survives_noise_on_the_console(bench: Bench) -> None:
    """Any bytes may come by a serial line: none has an effect, and frames work at once when requested."""
    line = bench.serial
    line.enter_frames()
    played = play(bench)
    before = bench.status()
    rounds = at_most(bench, 12)
    for _ in range(rounds):
        for _ in range(4):
            line.write(chatter(bench, bench.random.randint(1, 200)))
            line.read(0.01)
        line.enter_frames()
        expect("INFO by the line", line.request(Setup(0xC1, Request.INFO, 0, 0, 64)), bench.info.encode())
        bench.must(NoOp())
    check_sound(bench, before, rounds, 0)
    expect("what plays since", bench.status().since_period, played.commit_period)


@case("CON-003", "CON-009", "CON-002", features=Feature.CONSOLE)
@pytest.mark.parametrize("size", [81, 256, 257, 1000])
def test_the_console_survives_long_lines(bench: Bench, size: int) -> None:
    """A line of any length is refused and forgotten, and the next one is answered: people lean on keys."""
    line, rng = bench.serial, bench.random
    line.enter_console()
    text = bytes(rng.choice(PRINTABLE) for _ in range(size))
    answer = line.command(text.decode("ascii"))
    assert "error 1 " in answer, (
        f"a line of {size} characters is answered with {answer[-60:]!r}, should be with error 1"
    )
    answer = line.command("faults")
    assert "faults: none" in answer, f"`faults` after it is answered with {answer!r}, should be with `faults: none`"


@case("SER-006", "SER-009/1", "SER-005", features=Feature.CONSOLE)
def test_valid_frames_get_through_between_damaged_ones(bench: Bench) -> None:
    """Among frames with flipped, missing and additional bytes each valid one is answered; no other has an effect."""
    line, rng = bench.serial, bench.random
    line.enter_frames()
    before = bench.status()
    rounds = at_most(bench, 40)
    for number in range(rounds):
        line.write(damaged(bench) + DELIMITER)
        answer = line.request(Setup(0xC1, Request.CLOCK, 0, 0, rng.randint(1, 24)))
        assert answer is not None, "CLOCK is answered with STALL"
        if number % 4 == 0:
            block = pack(bench.numbered(NoOp()))
            line.send_frame(FrameKind.BLOCK, block)
            line.listen(line.patience(BLOCK_BYTES), lambda: bool(acknowledged(line.frames(FrameKind.RECORD))))
            found = acknowledged(line.frames(FrameKind.RECORD))
            expect("the list of reasons", [ack.reason.name for ack in found], ["ACCEPTED"])
            expect("the number", found[0].sequence, int.from_bytes(block[4:8], "little"))
            line.forget()
    accepted = len(range(0, rounds, 4))
    check_sound(bench, before, accepted, 0)
    dropped = (bench.status().dropped_frames - before.dropped_frames) % 2**32
    assert dropped >= rounds, f"{dropped} frames were counted as dropped, should be at least {rounds}"


def acknowledged(bodies: list[bytes]) -> list[Ack]:
    """The acknowledgements among records."""
    return [record for record in records(b"".join(bodies)) if isinstance(record, Ack)]


def damaged(bench: Bench) -> bytes:
    """A valid frame without its zero, with a defect that its checksum detects."""
    rng = bench.random
    setup = Setup(0x41, Request.ENABLE, 0, 0, 0)
    block = pack(Block(NoOp(), rng.randrange(2**32), restart=True))
    frames = [SerialFrame(FrameKind.REQUEST, bytes([7]) + setup.encode()), SerialFrame(FrameKind.BLOCK, block)]
    data = bytearray(encode(rng.choice(frames))[:-1])
    at = rng.randrange(len(data))
    match rng.randrange(3):
        case 0:
            data[at] ^= 1 << rng.randrange(8)
        case 1:
            del data[at : at + rng.randint(1, 3)]
        case _:
            data[at:at] = rng.choices(range(1, 256), k=rng.randint(1, 3))
    return bytes(data)
