"""A watch on the device's clock: in a whole run it never goes back, except by a restart (clause TIM-002)."""

from __future__ import annotations

from contextlib import suppress

from ....base.errors import ReplyError
from ....protocol.codes import REQUEST_TYPE_IN, REQUEST_TYPE_OUT, Request
from ....protocol.replies import Ack, ClockReading, Status, records
from ....protocol.requests import Setup

__all__ = ["ClockWatch"]

TELLING: dict[int, type[Status | ClockReading]] = {Request.STATUS: Status, Request.CLOCK: ClockReading}
RESTARTING = (Request.RESET, Request.REVERT)


class ClockWatch:
    """Follows each tick that a device says on any of its lines.

    An answer is made after everything that came before its request. Records wait in the device: only those of one kind
    on one line are in order.

    Attributes
    ----------
    wrong : list of str
        Since `begin`, when the clock went back: what was said.
    told : tuple of int, str
        The latest tick that was told, and what told it.
    highest : int
        The highest tick that was told since `begin` or the last restart.
    """

    def __init__(self) -> None:
        self.wrong: list[str] = []
        self.restarted()

    def restarted(self) -> None:
        """The device has begun again, or may have."""
        self.highest = 0
        self._forget()

    def begin(self) -> None:
        """Forget what was wrong, so that each case says once what is wrong in it."""
        self.wrong.clear()
        self.highest = self.told[0]

    def _forget(self) -> None:
        self.told = (0, "the start")
        self._newest: dict[tuple[object, type], tuple[int, str]] = {}

    def answered(self, setup: Setup, answer: bytes | None, asked: tuple[int, str]) -> None:
        """Follow an answer, None for STALL, to what was asked when `told` was this."""
        if answer is None:
            return
        if setup.request_type == REQUEST_TYPE_OUT and setup.request in RESTARTING:
            self.restarted()
        elif setup.request_type == REQUEST_TYPE_IN and setup.request in TELLING:
            with suppress(ReplyError):
                self._follow(TELLING[setup.request].decode(answer).now, Request(setup.request).name, asked)

    def came(self, line: object, data: bytes) -> None:
        """Follow records from a line."""
        with suppress(ReplyError):
            for record in records(data):
                key = line, type(record)
                name = f"block {record.sequence}'s ACK" if isinstance(record, Ack) else "STATUS, unasked,"
                self._follow(record.now, name, self._newest.get(key, (0, "")))
                self._newest[key] = record.now, name

    def _follow(self, tick: int, name: str, before: tuple[int, str]) -> None:
        if tick < before[0]:
            self.wrong.append(
                f"the clock went back (TIM-002): {name} names tick {tick}, {before[0] - tick} less than {before[1]} "
                "before it; should be no less"
            )
            self._forget()  # so that each fault is said once
        self.told = max(self.told, (tick, name))
        self.highest = max(self.highest, tick)
