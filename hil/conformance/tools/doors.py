"""Doors: a host at any door of the device, by frames, by transfers or by typing (clause SER-016)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from ....protocol.blocks import Body, Update, pack
from ....protocol.codes import REQUEST_TYPE_IN, REQUEST_TYPE_OUT, Reason, Request
from ....protocol.console import COMMANDS
from ....protocol.replies import ANSWER_BYTES, Ack, Status, records
from ....protocol.requests import VALUES, Setup
from ..bench import Bench
from ..cases import Row, expect
from ..sight.waveforms import only
from ..transports.line import RawLine
from ..transports.serial import RawSerialLine
from .steps import features_of
from .watchdog import patience

ACK_SECONDS = 10.0
TESTED = 17
TEST = Update(only(TESTED, width=2))
"""The update that `test 17` stands for (clause CON-008)."""
TYPED_AS = {about.request: name for name, about in reversed([*COMMANDS.items()]) if about.request is not None}
"""The command that stands for a request."""


@dataclass(frozen=True, kw_only=True)
class DoorRow(Row):
    """A door of the device: a line by its name in `Bench.door`, which carries frames or has a console."""

    name: str
    typed: bool = False

    def __str__(self) -> str:
        return f"{self.name}-console" if self.typed else self.name


class Host:
    """Who speaks at a door, in frames or by typing: requests, and blocks as far as the door takes them."""

    def __init__(self, bench: Bench, line: RawLine, *, typed: bool) -> None:
        self.typed = typed
        self._bench = bench
        self._line = line

    @property
    def patience(self) -> int:
        """A watchdog time in ms within which some blocks arrive by this door and by the bench's own line."""
        return max(patience(self._bench), patience(self._bench, self._line))

    def order(self, request: Request, value: int = 0) -> bool:
        """Make a request; returns whether it was carried out."""
        if self.typed:
            return self._type(f"{TYPED_AS[request]} {value if request in VALUES else ''}") is Reason.ACCEPTED
        size = ANSWER_BYTES.get(request, 0)
        setup = Setup(REQUEST_TYPE_IN if size else REQUEST_TYPE_OUT, request, value, 0, size)
        return self._line.request(setup) is not None

    def status(self) -> Status:
        """Ask for STATUS, which must be answered."""
        answer = self._line.request(Setup(REQUEST_TYPE_IN, Request.STATUS, 0, 0, Status.BYTES))
        return Status.decode(answer or b"")

    def able(self, *bodies: Body) -> list[Body]:
        """Those that this door can ask for, on this device: a console the update of `test` alone."""
        lacking = ~self._bench.info.features
        return [body for body in bodies if not features_of(body) & lacking and (not self.typed or body is TEST)]

    def send(self, body: Body) -> Reason:
        """Send a block, or type what stands for it; returns the reason of its acknowledgement."""
        if self.typed:
            assert body is TEST
            return self._type(f"test {TESTED}")
        return self.send_block(pack(self._bench.numbered(body))).reason

    def send_block(self, block: bytes) -> Ack:
        """Send a block; returns its acknowledgement."""
        if self._line is self._bench.line:
            return self._bench.send_raw(block)[0]
        self._bench.note_blocks([block])
        self._line.send_blocks(block, ACK_SECONDS)
        end = self._line.time.monotonic() + ACK_SECONDS
        while (left := end - self._line.time.monotonic()) > 0:
            found = [record for record in records(self._line.receive_records(left)) if isinstance(record, Ack)]
            if found:
                expect(
                    "the block acknowledged", [ack.sequence for ack in found], [int.from_bytes(block[4:8], "little")]
                )
                return found[0]
        raise AssertionError(f"a block by {self._line.name} is not acknowledged within {ACK_SECONDS:g} s")

    def _type(self, command: str) -> Reason:
        """Give a command; returns ACCEPTED, or why an update is refused, or FIELD for any other refusal."""
        assert isinstance(self._line, RawSerialLine)
        self._line.enter_console()
        answer = self._line.command(command.strip())
        if self._line is self._bench.line:
            self._line.enter_frames()  # the bench speaks there too
        if answer.endswith("ok\r\n"):
            return Reason.ACCEPTED
        found = re.match(r"error 6 (\w+)", answer)
        return Reason[found[1]] if found and found[1] in Reason.__members__ else Reason.FIELD


@contextmanager
def at_the_door(bench: Bench, door: DoorRow) -> Iterator[Host]:
    """A host at a door; inconclusive if this run has no such door."""
    with bench.door(door.name) as line:
        yield Host(bench, line, typed=door.typed)
