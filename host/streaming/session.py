"""A session with one device: blocks numbered and answered, requests in between, by one thread at a time.

Only the session knows sequence numbers, how many blocks may be on their way, and which acknowledgement belongs to which
block. The purpose of the blocks is its callers' business.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from math import ceil
from threading import RLock
from typing import NoReturn, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...base.errors import (
    DeviceError,
    DeviceLostError,
    DeviceRefusedError,
    DeviceStalledError,
    DeviceTimeoutError,
    DeviceVersionError,
    ReplyError,
)
from ...protocol.blocks import Block, Body, NoOp, Slot, Update, pack
from ...protocol.codes import BLOCK_BYTES, PROTOCOL_VERSION, AckFlag, Reason, Request, State
from ...protocol.plain import flag_names
from ...protocol.replies import ANSWER_BYTES, Ack, Info, Status, decode_acks, records
from ..transports.transport import Timekeeper, Transport, understood
from .ledger import DAMAGE, NUMBERS, Answers, Ledger, Parcel

__all__ = ["Answers", "Parcel", "Session"]

Answer = TypeVar("Answer")

PATIENCE_SECONDS = 1.0
"""How long no block may make progress before all are given up."""
WATCHDOG_BLOCKS = 20
"""How many blocks a line must be able to carry in the watchdog's time."""
ATTEMPTS = 3
"""How often a block is sent that was damaged or lost on the way."""
COMES_BACK_SECONDS = 10.0
"""The longest start of a device."""
LEAVES_SECONDS = 0.5
"""How long a device may take to leave its line after a command to restart."""


def watchdog_ms(most_blocks_per_second: float) -> int:
    """The watchdog's time that a line needs at least (clause SER-014)."""
    return ceil(WATCHDOG_BLOCKS / most_blocks_per_second * 1000)


class Session:
    """A session with the device at the end of a line.

    Parameters
    ----------
    transport : Transport
        The line; the session closes it. Before `begin` the device is only asked for its INFO.

    Attributes
    ----------
    info : Info
        The device's description of itself.
    found : Status
        Its state when it was opened, before `begin` changed anything.
    closed : bool
        Whether the line was closed.

    Raises
    ------
    DeviceVersionError
        If host and device have no version of the protocol in common.
    DeviceError
        If the line or the device fails.
    """

    def __init__(self, transport: Transport) -> None:
        self._line = transport
        self.closed = False
        self._lock = RLock()
        self._owner = os.getpid()
        self._depth = 0
        self._begun = self._closing = False
        self._ledger = Ledger(transport.lossy)
        self._meet()

    @property
    def lock(self) -> AbstractContextManager[bool]:
        """To be held while the line is in use, also over several steps in a row.

        It returns whether this thread already held it, as in a signal's handler, which runs within the call that it
        interrupts and cannot wait for its lock.
        """
        return self._turn()

    @property
    def foreign(self) -> bool:
        """Whether another process has opened it, which os.fork has copied: the device is that one's alone."""
        return os.getpid() != self._owner

    @contextmanager
    def _turn(self) -> Iterator[bool]:
        if self.foreign:  # its lock may be held by a thread that was not copied
            raise DeviceError(
                f"{self.name} was opened by process {self._owner}, which has forked this one; open it in this process"
            )
        with self._lock:
            before = self._depth
            self._depth += 1
            try:
                yield before > 0
            finally:
                self._depth = before
                if self._closing and not before:
                    self._close_what_was_interrupted()

    def _meet(self) -> None:
        """Read the device's INFO."""
        self._ledger.clear()
        self._number = 0
        self._restart = True
        self._free: int | None = None
        self._heard_at = 0
        self.info = self.query(Info.decode, Request.INFO)
        if not self.info.speaks(PROTOCOL_VERSION):
            older = "firmware" if self.info.newest_version < PROTOCOL_VERSION else "phasewire"
            raise DeviceVersionError(
                f"{self.name} speaks versions {self.info.oldest_version} to {self.info.newest_version} of the "
                f"protocol, this is version {PROTOCOL_VERSION}; update the {older}, which is the older"
            )
        self.found = self.status()  # the watchdog's time may differ from that at power-up

    def begin(self) -> None:
        """Stop the device, because a queue left full by an earlier host takes no block, and restart the numbering.

        On a slow line the watchdog's time is extended if necessary (clause SER-014).
        """
        with self.lock:
            self._begun = True
            self.command(Request.DISABLE)
            least_ms = watchdog_ms(self._line.most_blocks_per_second)
            if self._watchdog < least_ms / 1000:
                self.command(Request.WATCHDOG, least_ms)
            self.send(NoOp())

    @property
    def name(self) -> str:
        """A name of the device, for people."""
        return self._line.name

    @property
    def serial(self) -> str:
        """Serial number, empty if the line does not provide it."""
        return self._line.serial

    @property
    def time(self) -> Timekeeper:
        """The clock for all waiting on the line."""
        return self._line.time

    def line(self) -> Transport:
        """The line; raises `DeviceError` if the session is closed."""
        if self.closed or self._closing:
            raise DeviceError(f"{self.name} is closed; open it again")
        return self._line

    def close(self) -> None:
        """Close the line.

        If this thread is in the middle of a call, as when a signal's handler requests this, that call still needs the
        line: its remaining steps fail, then the outputs are turned off, and then the line is closed. A copy of the
        process by os.fork leaves it to the other.
        """
        if self.foreign:
            self.closed = True
            return
        with self._lock:
            if self._depth:
                self._closing = True
            else:
                self.end()

    def end(self) -> None:
        """Close the line at once; for a caller that has the lock and no longer needs the line."""
        self.closed, self._closing = True, False
        self._line.close()

    def _close_what_was_interrupted(self) -> None:
        try:
            if self._begun:  # otherwise another program plays
                with suppress(DeviceError):  # out of reach: its watchdog does it
                    self._line.command(Request.DISABLE)
        finally:
            self.end()

    def reopen(self, seconds: float = COMES_BACK_SECONDS) -> None:
        """Start again with the same device, which was lost or has restarted, when it comes back.

        Raises
        ------
        DeviceLostError
            If it does not come back in time.
        """
        with self.lock:
            line = self.line()
            end = line.time.monotonic() + seconds
            while True:
                line.reopen(max(end - line.time.monotonic(), 0))
                try:
                    self._meet()
                    self.begin()
                except (DeviceLostError, DeviceStalledError, DeviceTimeoutError):  # it left again
                    if line.time.monotonic() >= end:
                        raise
                    continue
                return

    def wait_until_gone(self) -> None:
        """Wait until a restarting device no longer answers; a serial line only gets a moment to notice."""
        with self.lock:
            line = self.line()
            end = line.time.monotonic() + LEAVES_SECONDS
            with suppress(DeviceError):
                while line.time.monotonic() < end:
                    if not line.lossy:
                        self.status()
                    line.time.sleep(LEAVES_SECONDS / 50)

    @property
    def pause_seconds(self) -> float:
        """The longest time without a sign of life for a waiting host, at most a third of a second."""
        return min(self._watchdog, PATIENCE_SECONDS) / 3

    # Requests

    def query(self, decode: Callable[[bytes], Answer], request: Request) -> Answer:
        """Make a control request and read its answer; raises `DeviceError` if that breaks the protocol."""
        with self.lock:
            return self._read(decode, self.line().query(request, ANSWER_BYTES[request]))

    def command(self, request: Request, value: int = 0) -> None:
        """Make a control request without an answer."""
        with self.lock:
            self.line().command(request, value)
            if request is Request.WATCHDOG:
                self._watchdog = value / 1000

    def status(self) -> Status:
        """The state of the device; a sign of life to it.

        Raises
        ------
        DeviceLostError
            If it has restarted meanwhile, which a serial line does not report by itself.
        """
        with self.lock:
            status = self.query(Status.decode, Request.STATUS)
            self._watchdog = status.watchdog_ms / 1000
            restarted, self._heard_at = status.now < self._heard_at, status.now
        if restarted:
            raise DeviceLostError(f"{self.name} has restarted, with its outputs off and its stores empty")
        return status

    # Blocks

    def send(self, *bodies: Body) -> list[Ack]:
        """Send blocks one after the other, each after the one before was accepted.

        A block that was damaged or lost on the way is sent again under its number (clause SER-012). If only its
        acknowledgement was lost, `Ack.commit_period` is 0.

        Raises
        ------
        DeviceRefusedError
            If the device refuses one; those after it are not sent.
        DeviceError
            If the line or the device fails.
        """
        with self.lock:
            if self._restart and not isinstance(bodies[0], NoOp):
                self._send(NoOp())  # the numbering begins with a block that may arrive twice without harm (SER-012)
            return [self._send(body) for body in bodies]

    def _send(self, body: Body) -> Ack:
        number = self._number
        block = pack(Block(body, number, self._restart))
        lost = False
        for _ in range(ATTEMPTS):
            answers = Answers.none(1)
            self._transfer(block, Parcel(number, answers))
            self._number = number  # until it is known to have been accepted
            if not answers.answered[0]:
                lost = True
                continue
            ack = Ack.of(answers.acks[0])
            if ack.reason in DAMAGE:
                continue
            self._number = (number + 1) % NUMBERS
            if ack.reason is Reason.SEQUENCE and lost:  # the first of the two had arrived
                return Ack(Reason.ACCEPTED, number, 0, ack.now, AckFlag(0), ack.free, ack.state)
            self.check(ack, body)
            return ack
        self._number = (number + 1) % NUMBERS
        raise DeviceTimeoutError(
            f"{self.name} did not receive a block that was sent {ATTEMPTS} times; check the line, and its rate"
        )

    def check_enabled(self) -> None:
        """Give a sign of life; raises `DeviceRefusedError` if the outputs are no longer enabled."""
        if not self.status().enabled:
            self._say_disabled()

    def check(self, ack: Ack, body: Body | None = None) -> None:
        """Raise `DeviceRefusedError` for the acknowledgement of a refused block, whose body is given if it is known."""
        if ack.reason in (Reason.DISABLED, Reason.FAULT):
            self._say_disabled()
        if ack.reason is not Reason.ACCEPTED:
            why = ack.reason.text
            if ack.reason is Reason.DRIVE and isinstance(body, Update | Slot):
                why = ack.reason.with_values(drive=body.pulses.total_drive / 1000, limit=self.status().drive_limit)
            raise DeviceRefusedError(f"{self.name} refuses block {ack.sequence}: {why}", ack.reason)

    def _say_disabled(self) -> NoReturn:
        """Raise a `DeviceRefusedError` with the reason why the outputs are off."""
        status = self.status()
        if status.state is State.FAULT:
            faults = flag_names(status.faults)
            raise DeviceRefusedError(
                f"{self.name} is silenced by a fault ({faults}); `phasewire doctor` says what to do", Reason.FAULT
            )
        why = "it was stopped, or its bus was suspended or reset."
        if status.watchdog_fired:
            why = f"it heard nothing for {status.watchdog_ms / 1000:g} s; was this program held up?"
        raise DeviceRefusedError(f"{self.name} has turned its outputs off: {why} Enable them again", Reason.DISABLED)

    @property
    def upcoming(self) -> tuple[int, bool]:
        """Number of the next block, and whether the numbering begins with it."""
        return self._number, self._restart

    def post(self, blocks: NDArray[np.uint8], parcel: Parcel) -> None:
        """Send blocks, as many at a time as the line and the device allow, and wait for their results.

        If the line carries blocks by itself, wait only until it has them.

        Parameters
        ----------
        blocks : (k, 512) uint8
            Numbered from `upcoming` on, as the parcel is.
        parcel : Parcel
            The parcel of these blocks. Results are written there as they come, even after an error; later ones come
            with the next blocks, or by `settle`.

        Raises
        ------
        DeviceTimeoutError
            If nothing moves for a second, or, on a lossless line, an acknowledgement is missing.
        DeviceError
            If the line or the device fails. How much was sent is then unknown, and the numbers are used up.
        """
        with self.lock:
            self._transfer(blocks.tobytes(), parcel, wait=not self._line.posts)

    def settle(self) -> None:
        """Wait for the results of all sent blocks; errors as for `post`."""
        with self.lock:
            self._transfer(b"", Parcel(self._number, Answers.none(0)))

    def _transfer(self, data: bytes, parcel: Parcel, *, wait: bool = True) -> None:
        try:
            self._carry(data, parcel, wait)
        except BaseException:
            self._take_back()
            raise

    def _carry(self, data: bytes, parcel: Parcel, wait: bool) -> None:
        line, ledger = self.line(), self._ledger
        ledger.enter(parcel)
        life = self.pause_seconds  # the device needs signs of life from a host that waits for room
        moved = line.time.monotonic()
        while parcel.sent < parcel.count or (wait and not ledger.settled):
            self.line()  # a signal's handler may have closed it
            progress = False
            room = min(line.window(self._free, self.info.queue_records) - ledger.unanswered, parcel.count - parcel.sent)
            if room > 0:
                at = parcel.sent
                self._number = (parcel.first + at + room) % NUMBERS  # used up, in any case
                self._restart = False
                taken = line.write_blocks(data[at * BLOCK_BYTES : (at + room) * BLOCK_BYTES], life) // BLOCK_BYTES
                parcel.sent += taken
                self._number = (parcel.first + parcel.sent) % NUMBERS
                progress = taken > 0
            if unanswered := ledger.unanswered:
                all_sent = parcel.sent == parcel.count
                progress = self._hear(life if wait or not all_sent else 0) or progress
            if progress or not (wait or parcel.sent < parcel.count):
                moved = line.time.monotonic()
                continue
            status = self.status()
            if line.time.monotonic() - moved > PATIENCE_SECONDS:
                full = not unanswered or (status.free == 0 and (line.lossy or line.posts))  # one waits (SER-011)
                if full or not line.lossy:
                    did_not = (
                        f"did not take a block for {PATIENCE_SECONDS:g} s: its queue is full; wait, or stop it"
                        if full
                        else f"did not acknowledge a block for {PATIENCE_SECONDS:g} s; open it again"
                    )
                    raise DeviceTimeoutError(f"{self.name} {did_not}")
                ledger.give_up()
                moved = line.time.monotonic()

    def _take_back(self) -> None:
        """Give up what the line has not carried yet, after an error."""
        self._ledger.clear()
        with suppress(DeviceError):
            self._number = (self._number - self._line.take_back() // BLOCK_BYTES) % NUMBERS

    def _hear(self, seconds: float) -> bool:
        """Wait for acknowledgements, and match them to their blocks; returns whether any came."""
        packet = self.line().read_records(seconds)
        if not packet or not len(acks := self._acks(packet)):
            return False
        self._free = int(acks["free"][-1])
        try:
            self._ledger.match(acks)
        except ReplyError as error:
            raise DeviceError(f"{self.name} acknowledges {error}; open it again") from error
        return True

    def _acks(self, packet: bytes) -> NDArray[np.void]:
        """The acknowledgements among received records, which may include unsolicited ones."""
        try:
            return decode_acks(packet)
        except ReplyError:
            acks = [record for record in self._read(records, packet) if isinstance(record, Ack)]
            return self._read(decode_acks, b"".join(ack.encode() for ack in acks))

    def _read(self, decode: Callable[[bytes], Answer], data: bytes) -> Answer:
        with understood(self.name):
            return decode(data)
