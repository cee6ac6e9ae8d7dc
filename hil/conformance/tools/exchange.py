"""What a case sends to a device over a serial line, and the answers that must come (chapter SER)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace

from ....protocol.blocks import NoOp, pack
from ....protocol.codes import REQUEST_TYPE_IN, REQUEST_TYPE_OUT, FrameKind, Request
from ....protocol.replies import ANSWER_BYTES, Ack, Status, records
from ....protocol.requests import Setup
from ...traffic.traffic import Traffic
from ..bench import Bench
from ..cases import expect
from ..transports.serial import RawSerialLine
from .filling import fill_queue
from .frames import frame

__all__ = [
    "acks",
    "ask",
    "at_the_console",
    "await_ack",
    "damage",
    "fill",
    "no_op",
    "order",
    "put_to_wait",
    "same_but",
    "send",
    "statuses",
]


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
