"""What a case sends to a device over a serial line, and the answers that must come (chapter SER)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace

from ....protocol.blocks import NoOp, Update, pack
from ....protocol.board import CARRIER_HZ
from ....protocol.codes import REQUEST_TYPE_IN, REQUEST_TYPE_OUT, FrameKind, Request
from ....protocol.framing import MAX_FRAME_BYTES
from ....protocol.replies import ANSWER_BYTES, Ack, Status, records
from ....protocol.requests import Setup
from ...traffic.traffic import Traffic
from ..bench import Bench
from ..cases import Inconclusive, expect
from ..transports.serial import RawSerialLine
from .frames import frame
from .steps import SILENT, enable

MOST_SECONDS = 5
"""For how long a queue may be filled."""
FAR_TIMES = 5
"""The factor on the time that a real device's queue is full, because the computer may be busy."""
FAR_SECONDS = 0.03
"""Time for a block and its acknowledgement over a line to a real device, at worst."""


@contextmanager
def at_the_console(bench: Bench) -> Iterator[RawSerialLine]:
    """The bench's serial line at the console's prompt, without echo; then as the next step expects it."""
    line = bench.serial
    line.enter_console()
    yield line
    bench.leave(line)


def ask(line: RawSerialLine, request: Request) -> bytes:
    """Request a whole answer over this line."""
    answer = line.request(Setup(REQUEST_TYPE_IN, request, 0, 0, ANSWER_BYTES[request]))
    assert answer is not None, f"{request.name} is answered with STALL over the serial line"
    return answer


def order(line: RawSerialLine, request: Request, value: int = 0) -> None:
    """Make a request without an answer over this line."""
    done = line.request(Setup(REQUEST_TYPE_OUT, request, value, 0, 0)) is not None
    assert done, f"{request.name} with value {value} is answered with STALL over the serial line"


def acks(line: RawSerialLine) -> list[Ack]:
    """The acknowledgements since `forget`."""
    return [record for body in line.frames(FrameKind.RECORD) for record in records(body) if isinstance(record, Ack)]


def statuses(line: RawSerialLine) -> list[Status]:
    """The status records since `forget`."""
    return [record for body in line.frames(FrameKind.RECORD) for record in records(body) if isinstance(record, Status)]


def send(line: RawSerialLine, block: bytes, seconds: float = 0) -> Ack:
    """Send a block over this line, which may wait for so many seconds; returns its acknowledgement."""
    line.forget()
    line.write(b"\0" + frame(FrameKind.BLOCK, block))
    return await_ack(line, block, seconds)


def await_ack(line: RawSerialLine, block: bytes, seconds: float = 0) -> Ack:
    """The acknowledgement of a block, which must be the only one."""
    seconds += line.patience(len(block))
    line.listen(seconds, lambda: bool(acks(line)))
    found = acks(line)
    number = int.from_bytes(block[4:8], "little")
    assert found, f"block {number} is not acknowledged over the serial line within {seconds:.2f} s"
    expect("the block acknowledged", [ack.sequence for ack in found], [number])
    return found[0]


def same_but(before: Status, after: Status, **changes: int) -> None:
    """Fail if something has changed that need not; time and temperature may."""
    wanted = asdict(replace(before, now=after.now, temperature_c=after.temperature_c))
    wanted |= {name: wanted[name] + change for name, change in changes.items()}
    for name, value in asdict(after).items():
        expect(f"{name} of STATUS", value, wanted[name])


def damage(bench: Bench, line: RawSerialLine, data: bytes, count: int = 1) -> None:
    """Send bytes that end with a zero: so many frames must be dropped and counted, without any other effect."""
    before = bench.status()
    line.forget()
    bench.note("damaged", data, Traffic.FRAME)
    line.write(data)
    bench.wait(line.transit(len(data)))
    expect("the clock", len(ask(line, Request.CLOCK)), 24)  # what follows is understood, and answers keep their order
    expect("the answer to a damaged frame", line.events, [])
    same_but(before, bench.status(), dropped_frames=count)


def no_op(bench: Bench) -> bytes:
    """The next block, which does nothing."""
    return pack(bench.numbered(NoOp()))


def fill_queue(bench: Bench, seconds: float) -> list[Ack]:
    """Enable the outputs, and queue as many silent updates as there is room for; returns their acknowledgements.

    The queue is full for at least so many seconds before the first of them leaves it. It is inconclusive if filling
    takes too long over this line.
    """
    rooms, step = bench.info.queue_blocks, 10 * max(bench.info.periods_per_update, 1)
    carries = bench.line.transit(2 * MAX_FRAME_BYTES) if isinstance(bench.line, RawSerialLine) else 0.0
    fills = rooms * (carries + FAR_SECONDS)
    if fills > MOST_SECONDS:
        raise Inconclusive(f"to fill a queue of {rooms} changes over this line may take {fills:.0f} s")
    enable(bench)
    first = bench.period() + round(CARRIER_HZ * (seconds * (FAR_TIMES if bench.is_far else 1) + fills))
    acks = [bench.must(Update(SILENT, first + step * number)) for number in range(rooms)]
    expect("the free places in the queue", acks[-1].free, 0)
    return acks


def fill(bench: Bench, line: RawSerialLine, seconds: float) -> list[Ack]:
    """Fill the queue by the bench's own line, and forget the records that reached this line."""
    found = fill_queue(bench, seconds)
    line.rest()
    line.forget()
    return found


def put_to_wait(bench: Bench, line: RawSerialLine, block: bytes) -> None:
    """Send a block that must wait for room in the queue: meanwhile requests are answered, the block is not."""
    before = bench.status()
    line.write(b"\0" + frame(FrameKind.BLOCK, block))
    expect("the clock", len(ask(line, Request.CLOCK)), 24)
    expect("the answer to a block while the queue has no room", line.rest(), b"")
    same_but(before, bench.status())
