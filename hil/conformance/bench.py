"""The bench: a device under test and everything that a case may ask of it.

What they say to each other is in `dialogue`, how they share time in `pacing`. A case gets the device disabled, without
faults and without records that wait; its first block restarts the numbering. A case need not restore what it changes,
except what lasts: firmware, power, the bus.
"""

from __future__ import annotations

import random
import zlib
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from ...base.errors import DeviceError, InputFileError, ReplyError
from ...protocol.blocks import Block, NoOp, Update, pack
from ...protocol.board import CHANNELS, TICK_HZ
from ...protocol.codes import (
    REQUEST_TYPE_IN,
    REQUEST_TYPE_OUT,
    SILENT_PERIODS,
    Request,
    State,
)
from ...protocol.pulses import Pulses
from ...protocol.replies import (
    ANSWER_BYTES,
    Info,
    Status,
    decode_wiring,
)
from ...protocol.requests import VALUES, Setup
from ...protocol.wiring import Wiring
from ..traffic.traffic import Traffic
from .cases import NOT_USB, Inconclusive, Need, Risk, unmet
from .dialogue import QUIET_SECONDS, Dialogue
from .levers import METHODS, LeverFailed, PluggedLevers
from .profile import Profile
from .sight.capture import Observer, Seen, Unseen
from .sight.marks import MARK_PULSES, Mark
from .transports.line import RawLine
from .transports.serial import CdcWire, RawSerialLine
from .transports.usb import RawUsbLine

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey


__all__ = ["OUTPUTS", "TRIED_SECONDS", "Bench", "Lost"]

TRIED_SECONDS = 2.0
"""Time of the line for the values of a case that is the same for each of them."""
MEASURED_BLOCKS = 8
OFF_SECONDS = 0.1
"""How long a device is without power."""
LEAVES_SECONDS = 2.0
"""Time for a device without power or cable to leave the bus."""
OUTPUTS = "outputs"
"""Label of the evidence on judged outputs."""
NO_DOOR = "this run has no {what}: pass --door {url}; if the device has none, let the profile say so under {clause}"
DOORS: Mapping[str, str] = {
    "usb": NO_DOOR.format(what="USB line", url="usb:", clause="USB-002"),
    "cdc": NO_DOOR.format(what="console on USB", url="usb:", clause="USB-002"),
    "uart": NO_DOOR.format(what="UART", url="serial:///dev/…", clause="SER-001"),
}
"""The lines that a device may have, and why one cannot be judged that this run lacks."""


class Lost(Exception):
    """The device cannot be brought back; no further case can be judged."""


class LostByLever(Lost, Inconclusive):
    """The device cannot be brought back, and a lever failed meanwhile: it may not be the device's fault."""


class Bench(Dialogue):
    """A device under test, and what is plugged in.

    Parameters
    ----------
    line : RawLine
        The line for blocks and requests.
    levers : PluggedLevers
        Control of the device's surroundings.
    observer : Observer or None
        Observation of its outputs.
    allowed : frozenset of Risk
        What may be risked.
    seed : int
        Seed of all random numbers.
    profile : Profile
        What the makers declare of the device.
    spare : callable, optional
        Returns, as a context manager, a bench with a fresh device of the same kind, which trusts a key or, given None,
        has no keys.
    doors : mapping of str to callable
        Further lines of the same device by their names in `DOORS`, each opened by a context manager.

    Attributes
    ----------
    marks : list of Mark
        All marks that were played in this run.
    looks : list of callable
        The judgements of the outputs in this case, in order. Each returns what was seen, or raises what was wrong.
    block_seconds : float
        How long a block and its acknowledgement take on this line, as measured at the first case.
    tried : list of int
        The number of values that this case tried, and the number that there are.
    """

    def __init__(
        self,
        line: RawLine,
        levers: PluggedLevers,
        observer: Observer | None,
        allowed: frozenset[Risk],
        seed: int,
        *,
        profile: Profile,
        spare: Callable[[Ed25519PrivateKey | None], AbstractContextManager[Bench]] | None = None,
        free_time: bool = True,
        doors: Mapping[str, Callable[[], AbstractContextManager[RawLine]]] = MappingProxyType({}),
    ) -> None:
        super().__init__(line, allowed, seed)
        self._doors = doors
        self.levers = levers
        levers.done = self._lever_done
        self.observer = observer
        self._seed, self._spare, self._free_time = seed, spare, free_time
        self.profile = profile
        self._serial: RawSerialLine | None = line if isinstance(line, RawSerialLine) else None
        self.looks: list[Callable[[], str]] = []
        self._marks: list[Mark] = []
        self.marks: list[Mark] = []
        self.block_seconds = 0.0
        self.tried = [0, 0]
        self._tried_seconds = 0.0

    # Parts of the bench

    @cached_property
    def wiring(self) -> Wiring:
        """The device's answer to WIRING."""
        return decode_wiring(self.ask(Request.WIRING))

    @property
    def usb(self) -> RawUsbLine:
        """The line as a USB line; inconclusive if it is none."""
        if not isinstance(self.line, RawUsbLine):
            raise Inconclusive(NOT_USB)
        return self.line

    @property
    def serial(self) -> RawSerialLine:
        """A serial line of the device: the line itself, or on USB its console's endpoints, which start as a console."""
        if self._serial is None:
            self._serial = RawSerialLine(CdcWire(self.usb))
            self._serial.watch = self.line.watch
        self._serial.noted = self._note_bytes
        return self._serial

    @contextmanager
    def door(self, name: str) -> Iterator[RawLine]:
        """A line of the device by its name in `DOORS`, a serial one with frames; inconclusive if this run lacks it."""
        opened: AbstractContextManager[RawLine]
        if name == ("usb" if self.line.kind == "usb" else "uart"):
            opened = nullcontext(self.line)
        elif name == "cdc" and self.line.kind == "usb":
            opened = nullcontext(self.serial)
        elif name in self._doors:
            opened = self._doors[name]()
        else:
            raise Inconclusive(DOORS[name])
        with opened as line:
            if line is not self.line:
                line.watch = self.line.watch
            if isinstance(line, RawSerialLine):
                line.noted = self._note_bytes
                line.wire.set_dtr(True)
                line.enter_frames()
            yield line
            if isinstance(line, RawSerialLine):
                self.leave(line)

    def leave(self, line: RawSerialLine) -> None:
        """Leave a serial line in frames if it carries blocks, else as an unused console."""
        if line is self.line:
            line.enter_frames()
        else:
            line.wire.set_dtr(False)
            line.assume_console()

    def check_doors(self) -> None:
        """Raise ValueError if a further line leads to another device."""
        for name in self._doors:
            with self.door(name) as line:
                answer = line.request(Setup(REQUEST_TYPE_IN, Request.INFO, 0, 0, ANSWER_BYTES[Request.INFO]))
                found = Info.decode(answer or b"").unique_id
                if found != self.info.unique_id:
                    raise ValueError(
                        f"--door: {line.name} leads to the device {found.hex()}, but this run judges "
                        f"{self.info.unique_id.hex()}, {self.line.name}"
                    )

    def can(self, need: Need) -> bool:
        """Whether the bench can see or do something."""
        if need is Need.CAPTURE:
            return self.observer is not None or need in self.levers.can
        if need in (Need.SPARE, Need.FREE_TIME):
            return self._spare is not None and (self._free_time or need is Need.SPARE)
        return need in self.levers.can

    @contextmanager
    def spare(self, key: Ed25519PrivateKey | None = None) -> Iterator[Bench]:
        """A bench with a fresh device of the same kind, which may be broken for good; its traffic is logged here too.

        With a key the device trusts only that key, which has signed its firmware (clause FWU-012).
        """
        if self._spare is None:
            raise Inconclusive(unmet(Need.SPARE))
        with self._spare(key) as other:
            other._log, other.looks = self._log, self.looks
            other.line.watch.wrong, other.block_seconds = self.line.watch.wrong, self.block_seconds
            yield other

    # Cases

    def begin_case(self, name: str) -> None:
        """Bring the device to the state in which every case begins; raises `Lost` if no allowed action can do so."""
        self.forget()
        self._marks = []
        if self._serial is not self.line:
            self._serial = None  # whatever an earlier case left
        elif self._serial is not None:
            self._serial.noted = None  # until a case uses the line itself: what it asks of the bench is noted there
        self.random = random.Random(zlib.crc32(name.encode()) ^ self._seed)
        self.tried, self._tried_seconds = [0, 0], 0.0
        try:
            self._settle()
            if not self.block_seconds:
                self._measure()
        except (DeviceError, ReplyError, AssertionError) as first:
            self.note("recovery", f"the device was not as at the start of a case: {first}")
            self._recover()
        self.forget()
        self.unasked.clear()

    def _measure(self) -> None:
        """Find how long a block takes on this line; the device is off, and refuses them."""
        blocks = [pack(Block(NoOp(), number, number == 0)) for number in range(MEASURED_BLOCKS)]
        began = self.line.time.monotonic()
        self.send_raw(*blocks)
        self.block_seconds = max((self.line.time.monotonic() - began) / len(blocks), 1e-9)
        self._settle()

    def tries(self, of: int, least: int, blocks: float = 1, seconds: float = TRIED_SECONDS) -> int:
        """How many of so many tries a case makes: all, or those for which this line has the time, but the least on any.

        A try takes as long as so many blocks. All tries of a case together have so many seconds.
        """
        each = blocks * self.block_seconds
        fit = of if each * of <= (left := seconds - self._tried_seconds) else int(max(left, 0) / each)
        made = min(of, max(least, fit))
        self._tried_seconds += made * each
        self.tried = [self.tried[0] + made, self.tried[1] + of]
        if made < of:
            self.note("tried", f"{made} of {of}: a block takes {1000 * self.block_seconds:.3g} ms on this line")
        return made

    def end_case(self) -> None:
        """Leave the device off."""
        try:
            self.line.request(Setup(REQUEST_TYPE_OUT, Request.DISABLE, 0, 0, 0))
            setup = Setup(REQUEST_TYPE_IN, Request.STATUS, 0, 0, Status.BYTES)
            self.note("status at the end", self.line.request(setup) or "STALL", Traffic.REQUEST, setup.encode())
        except DeviceError as error:
            self.note("end", f"the device cannot be left off: {error}")

    def leave_off(self) -> None:
        """Leave the device as at power-up after the last case, if it can be reached: off, with INFO's limits."""
        with suppress(DeviceError, AssertionError):
            self.try_order(Request.DISABLE)
            self.try_order(Request.WATCHDOG, self.info.watchdog_ms)
            self.try_order(Request.LIMIT, self.info.drive_limit)

    def forget(self) -> None:
        """Start with no evidence."""
        self._log.forget()
        self.looks.clear()

    def _settle(self) -> None:
        """Restore the initial state by requests alone."""
        if isinstance(self.line, RawSerialLine):
            self.line.enter_frames()
        asked = self.line.time.monotonic()
        self.order(Request.DISABLE)
        trip = self.line.time.monotonic() - asked
        self.wait_periods(2 * SILENT_PERIODS)
        for _ in range(1000):
            if not self.line.receive_records(max(QUIET_SECONDS, 2 * trip)):
                break
        status = self.status()
        if status.state is State.FAULT or status.faults:
            self.order(Request.CLEAR_FAULTS)
            status = self.status()
        if status.state is not State.OFF:
            raise DeviceError(f"the device is {status.state.name} after DISABLE and CLEAR_FAULTS")
        self.order(Request.WATCHDOG, self.info.watchdog_ms)
        self.order(Request.LIMIT, self.drive_limit)
        self._number, self._first = None, status

    def _recover(self) -> None:
        """Bring back a device that does not answer properly: open it again, reset the bus, cut its power."""
        ways: list[Callable[[], None]] = [lambda: self.line.reopen(self.return_seconds)]
        if Risk.RESET in self.allowed and isinstance(self.line, RawUsbLine):
            ways.append(self.usb.reset)
        if Risk.RESET in self.allowed and Need.POWER in self.levers.can:
            ways.append(self.power_cycle)
        problems: list[Exception] = []
        for way in ways:
            try:
                way()
                self._settle()
            except (DeviceError, ReplyError, AssertionError, OSError, LeverFailed) as error:
                problems.append(error)
            else:
                return
        lost = LostByLever if any(isinstance(problem, LeverFailed) for problem in problems) else Lost
        raise lost("the device cannot be brought back: " + "; then ".join(map(str, problems)))

    # Restarts

    def restart(self, how: Callable[[], None]) -> None:
        """Restart the device in some way, and find it again."""
        how()
        self.line.reopen(self.return_seconds)
        self._number = None

    def begin_anew(self) -> bool:
        """Restart the device, so that nothing of what was asked of it is left; returns False if this is not allowed.

        It is False also if the device does not take the order or does not come back, which the next case shows.
        """
        if Risk.RESET not in self.allowed:
            return False
        try:
            if isinstance(self.line, RawSerialLine):
                self.line.enter_frames()
            self.restart(lambda: self.order(Request.RESET))
        except (DeviceError, ReplyError, AssertionError):
            return False
        return True

    def power_cycle(self) -> None:
        """Cut the power for a tenth of a second.

        Raises
        ------
        LeverFailed
            If the lever is not the emulator's, and the device's clock ran on meanwhile. A clock that stood still for
            the cut and then went on is a failure of the device, which the case shows.
        """

        def cut() -> None:
            self.levers.power_down()
            self.wait(OFF_SECONDS)
            self.levers.power_up()

        tick, at = self._known_tick, self._known_at
        self.restart(cut)
        if lever := self.levers.outside.get(Need.POWER):
            passed = (self.clock().now - tick) / TICK_HZ
            if passed > self._known_at - at - OFF_SECONDS / 2:
                raise LeverFailed(
                    f"the lever {lever!r} reported success, but the device kept its time: it was not without power"
                )

    def _lever_done(self, action: str, said: str) -> None:
        """Keep an action of a lever as evidence; a device without power or cable must leave the bus."""
        self.note("lever", said)
        for need in self.levers.outside.keys() & {Need.POWER, Need.PLUG}:
            off, on = METHODS[need]
            if action == off and isinstance(self.line, RawUsbLine):
                self._await_leaving(self.line, self.levers.outside[need], getattr(self.levers, on))

    def _await_leaving(self, line: RawUsbLine, lever: str, restore: Callable[[], None]) -> None:
        end = line.time.monotonic() + LEAVES_SECONDS
        while line.is_there:
            if line.time.monotonic() >= end:
                restore()
                raise LeverFailed(f"the lever {lever!r} reported success, but the device is still on the bus")
            self.wait(0.01)

    # Outputs

    def judge(self, first: int, last: int, check: Callable[[Seen], None], *, over: bool = False) -> None:
        """Judge the outputs from a period to another, not included, by a function that fails like a case.

        It waits until the periods are over by the device's clock, unless the caller says that they are, as when the
        device answers no request. The case goes on after a failure, which `looks` keep. If the outputs are only seen
        after the run, the judgement comes then.
        """
        observer, marks = self.observer, self._marks
        if not over:
            self.wait_until(last + 1)

        def look() -> str:
            if observer is None:
                raise Inconclusive(unmet(Need.CAPTURE))
            try:
                part = observer.between(marks[0], marks[-1]) if observer.deferred else observer
                seen = part.seen(first, last)
            except (Unseen, InputFileError, OSError) as error:
                raise Inconclusive(str(error)) from None
            check(seen)
            moved = np.bitwise_count(np.bitwise_or.reduce(seen.words)).sum()
            watched = np.bitwise_count(seen.observed).sum()
            return f"{watched} of {CHANNELS} seen in periods {first} to {last - 1}, {moved} of them high at some time"

        self.looks.append(look if observer is not None and observer.deferred else self._done(look))

    def _done(self, look: Callable[[], str]) -> Callable[[], str]:
        """Judge now, and report later."""
        done = Future[str]()
        try:
            done.set_result(look())
        except Exception as error:
            done.set_exception(error)
            if not isinstance(error, Inconclusive):
                self._log.mark_wrong()
        return done.result

    def play_mark(self) -> None:
        """Let the outputs show a mark, which identifies this case in a recording (see `Mark`).

        Meanwhile the watchdog has its longest time, so that a slow host does not end the mark.
        """
        self._settle()
        self.order(Request.WATCHDOG, VALUES[Request.WATCHDOG][-1])
        self.enable()
        changes = []
        for gap, is_on in Mark.plan(random.Random()):  # never the same, so that another run's recording is refused
            period = self.period() + gap + 8
            ack = self.must(Update(MARK_PULSES if is_on else Pulses.silent(CHANNELS), period))
            self.wait_until(ack.commit_period)
            changes.append((ack.commit_period, is_on))
        self.disable()
        self.order(Request.WATCHDOG, self.info.watchdog_ms)
        self._marks.append(Mark(tuple(changes)))
        self.marks.append(self._marks[-1])
