"""What goes over a line, in words: the traffic with a device, for whoever looks for what went wrong.

It is logged under the name `TRAFFIC`, at level INFO a line for each transfer, and at DEBUG one for each block and
record too. A line that is opened while nobody listens is not traced and costs nothing. This module changes nothing of
what it sees.
"""

from __future__ import annotations

import logging
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from ...base.errors import DeviceError, ReplyError, visible
from ...protocol.blocks import header_fields
from ...protocol.codes import BLOCK_BYTES, REQUEST_TYPE_IN, REQUEST_TYPE_OUT, STATUS_MAGIC, Kind, Request
from ...protocol.describe import Description, describe_block, describe_record, describe_request
from ...protocol.replies import Ack, Status
from ...protocol.replies import records as decode_records
from ...protocol.requests import Setup
from .transport import Timekeeper, Transport

__all__ = ["TRAFFIC", "TracedTransport", "log_request", "print_traffic", "split_records", "traced"]

TRAFFIC = "phasewire.traffic"
"""Name of the logger."""

_log = logging.getLogger(TRAFFIC)
_BEGAN = time.monotonic()


def traced(transport: Transport) -> Transport:
    """The line itself, or one that logs what goes over it if somebody listens at level INFO."""
    return TracedTransport(transport) if _log.isEnabledFor(logging.INFO) else transport


def log_request(setup: Setup, data: bytes | None, *, stalled: bool = False) -> None:
    """Log a control request that goes past any line, as those of an upgrade do; its time is the program's.

    Parameters
    ----------
    setup : Setup
        What was asked.
    data : bytes or None
        What went with it, either way; None if it failed.
    stalled : bool
        Whether the device answered STALL.
    """
    if _log.isEnabledFor(logging.INFO):
        way = "in" if setup.is_in else "out"
        _log_described(way, describe_request(setup.encode(), data, stalled=stalled), time.monotonic() - _BEGAN)


def _log_described(way: str, description: Description, seconds: float, level: int = logging.INFO) -> None:
    problems = "".join(f" ✗ {' '.join(filter(None, finding))}" for finding in description.findings)
    _log_line(way, description.kind, description.summary + problems, seconds, level)


def _log_line(way: str, kind: str, summary: str, seconds: float, level: int = logging.INFO) -> None:
    _log.log(level, "%12.6f s  %-3s %-16s%s", seconds, way, kind, summary)


class _Lines(logging.Handler):
    """Lines on standard error; if nobody reads them, that is an error like any other."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write a line."""
        sys.stderr.write(f"{visible(record.getMessage())}\n")


_lines = _Lines()


def print_traffic(*, each: bool) -> Callable[[], None]:
    """Print traffic on standard error, with each block and record if so wanted.

    Returns
    -------
    callable
        Ends it.
    """
    before = _log.level
    level = logging.DEBUG if each else logging.INFO
    _log.setLevel(min(level, before or level))
    _log.addHandler(_lines)

    def end() -> None:
        _log.removeHandler(_lines)
        _log.setLevel(before)

    return end


class TracedTransport:
    """A line that logs what goes over it: when, which way, what it is and what it says.

    Parameters
    ----------
    transport : Transport
        The line. Times are its own, in seconds since it was traced.
    """

    def __init__(self, transport: Transport) -> None:
        self._inner = transport
        self.name = transport.name
        self.serial = transport.serial
        self.time: Timekeeper = transport.time
        self.lossy = transport.lossy
        self.posts = transport.posts
        self.most_blocks_per_second = transport.most_blocks_per_second
        self._began = self.time.monotonic()
        self._tell("", "line", f"to {self.name}")

    def window(self, free: int | None, records: int) -> int:
        """How many blocks may be unanswered."""
        return self._inner.window(free, records)

    def write_blocks(self, blocks: bytes, seconds: float) -> int:
        """Send whole blocks."""
        with self._failures("out", "block"):
            sent = self._inner.write_blocks(blocks, seconds)
        each = [blocks[at : at + BLOCK_BYTES] for at in range(0, sent, BLOCK_BYTES)]
        left = (len(blocks) - sent) // BLOCK_BYTES
        self._tell_all("out", each, describe_block, _blocks_in_short)
        if left:
            self._tell("out", "blocks", f"{left} more found no room in time")
        return sent

    def read_records(self, seconds: float) -> bytes:
        """Wait for records."""
        with self._failures("in", "record"):
            data = self._inner.read_records(seconds)
        self._tell_all("in", split_records(data), describe_record, _records_in_short)
        return data

    def take_back(self) -> int:
        """Drop the blocks that the line has not sent yet."""
        with self._failures("out", "block"):
            left = self._inner.take_back()
        if left:
            self._tell("out", "blocks", f"{left // BLOCK_BYTES} were taken back")
        return left

    def query(self, request: Request, size: int) -> bytes:
        """Make a control request with an answer."""
        with self._failures("in", "request", request):
            data = self._inner.query(request, size)
        self._describe("in", describe_request(Setup(REQUEST_TYPE_IN, request, 0, 0, size).encode(), data))
        return data

    def command(self, request: Request, value: int = 0) -> None:
        """Make a control request without an answer."""
        with self._failures("out", "request", request):
            self._inner.command(request, value)
        self._describe("out", describe_request(Setup(REQUEST_TYPE_OUT, request, value, 0, 0).encode(), b""))

    def reopen(self, seconds: float) -> None:
        """Find the same device again."""
        with self._failures("", "line"):
            self._inner.reopen(seconds)
        self._tell("", "line", f"to {self.name}, found again")

    def close(self) -> None:
        """Close the line."""
        self._tell("", "line", "closed")
        self._inner.close()

    @contextmanager
    def _failures(self, way: str, kind: str, request: Request | None = None) -> Iterator[None]:
        """Tell of what fails."""
        try:
            yield
        except DeviceError as error:
            self._tell(way, kind, f"{request.name if request else ''} ✗ {error}".strip())
            raise

    def _tell_all(
        self,
        way: str,
        pieces: Sequence[bytes],
        describe: Callable[[bytes], Description],
        in_short: Callable[[Sequence[bytes]], str],
    ) -> None:
        """A line for all pieces of a transfer, and if somebody wants to know, one for each."""
        if len(pieces) == 1:
            self._describe(way, describe(pieces[0]))
        elif pieces:
            self._tell(way, "transfer", in_short(pieces))
            if _log.isEnabledFor(logging.DEBUG):
                for piece in pieces:
                    self._describe(way, describe(piece), logging.DEBUG)

    def _describe(self, way: str, description: Description, level: int = logging.INFO) -> None:
        _log_described(way, description, self._seconds(), level)

    def _tell(self, way: str, kind: str, summary: str) -> None:
        _log_line(way, kind, summary, self._seconds())

    def _seconds(self) -> float:
        return self.time.monotonic() - self._began


def split_records(data: bytes) -> list[bytes]:
    """The records of a transfer (clause ACK-005); what is cut off stands last."""
    found = []
    while data:
        size = Status.BYTES if data.startswith(STATUS_MAGIC) else Ack.BYTES
        found.append(data[:size])
        data = data[size:]
    return found


def _blocks_in_short(blocks: Sequence[bytes]) -> str:
    headers = [header_fields(block) for block in blocks]
    kinds = Counter(Kind(header["kind"]).name for header in headers)
    return f"{len(blocks)} blocks, {headers[0]['sequence']} to {headers[-1]['sequence']}: {_counted(kinds)}"


def _records_in_short(records: Sequence[bytes]) -> str:
    try:
        read = decode_records(b"".join(records))
    except ReplyError as error:
        return f"{len(records)} records ✗ {error}"
    acks = [record for record in read if isinstance(record, Ack)]
    counted = Counter("STATUS" if isinstance(record, Status) else record.reason.name for record in read)
    counted.update(flag.name or "" for ack in acks for flag in ack.flags)
    summary = f"{len(read)} records: {_counted(counted)}"
    if not acks:
        return summary
    last = acks[-1]
    return (
        f"{summary}; the last for {last.sequence}, period {last.commit_period}, {last.state.name}, room for {last.free}"
    )


def _counted(names: Counter[str]) -> str:
    return ", ".join(f"{count} {name}" for name, count in names.items())
