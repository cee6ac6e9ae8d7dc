"""A device that keeps chapters NUM and ACK, made by hand, and a line to it that delays and loses."""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from phasewire.host.streaming.session import Session
from phasewire.protocol import Info
from phasewire.protocol.blocks import Output, Samples
from phasewire.protocol.codes import Action, Reason, Request, State
from phasewire.protocol.replies import ClockReading

from tests import from_spec as spec
from tests.emulator.model_controller import ANSWERS
from tests.host.serial_bench import Clock

INFO = Info.decode(ANSWERS["info"])
MS = 0.001
CHANGES = (spec.UPDATE, spec.SEQUENCE, spec.MODULATION, spec.OUTPUT)


class Sent(NamedTuple):
    """A block that the device has accepted."""

    number: int
    kind: int
    first: int
    """A value that tells blocks apart."""


def sample(place: int) -> Samples:
    """A block that tests tell from others by its place."""
    return Samples(b"\x01", place)


def change(place: int) -> Output:
    """A block that takes a place in the queue."""
    return Output(Action.SILENCE, 10**6 + place)


class ModelDevice:
    """It judges blocks by their numbers and answers; a change leaves its queue after some time.

    Its acknowledgements give as `commit_period` the field `first` of the block, by which tests tell blocks apart.
    """

    def __init__(self, time: Clock, *, lossy: bool, queue: int = 8, stays: float = 0.0) -> None:
        self.time, self.lossy, self.queue, self.stays = time, lossy, queue, stays
        self.info = INFO.encode()
        self.state = State.READY
        self.last: int | None = None
        self.accepted: list[Sent] = []
        self.orders: list[tuple[Request, int]] = []
        self.leaving: deque[float] = deque()
        self.waiting: bytes | None = None
        self.dropped = 0
        self.watchdog = INFO.watchdog
        self.fired = False
        self.heard_at = 0.0
        self.says: deque[tuple[float, bytes]] = deque()
        """Records, and when they were said."""

    @property
    def free(self) -> int:
        """Changes that can still be queued."""
        while self.leaving and self.leaving[0] <= self.time.now:
            self.leaving.popleft()
        return self.queue - len(self.leaving)

    def pass_time(self) -> None:
        """Let the watchdog fire, and judge a waiting block (clause SER-011)."""
        if self.time.now - self.heard_at > self.watchdog and self.state is not State.OFF:
            self.state, self.fired = State.OFF, True
            self.leaving.clear()
        if self.waiting is not None and self.free:
            block, self.waiting = self.waiting, None
            self.judge(block)

    def take(self, block: bytes) -> bool:
        """Take a block; returns False if the answer is NAK."""
        self.pass_time()
        if self.free:
            self.judge(block)
        elif not self.lossy:
            return False
        elif self.waiting is None:
            self.waiting = block
        else:
            self.dropped += 1
        return True

    def judge(self, data: bytes) -> None:
        """Accept or refuse, and say so (clauses ACK-003, NUM-002 to NUM-004)."""
        reason, number, flags, effect = spec.judge_block(data), int.from_bytes(data[4:8], "little"), 0, 0
        if not reason:
            block = spec.read_block(data)
            effect = block["first"]
            if block["kind"] in CHANGES and self.state is State.OFF:
                reason = Reason.DISABLED
            elif not block["flags"] & spec.RESTART and self.last is not None:
                if not spec.follows(number, self.last):
                    reason = Reason.SEQUENCE
                elif spec.missing(number, self.last):
                    flags = 2
            if not reason:
                self.last, self.heard_at = number, self.time.now
                self.accepted.append(Sent(number, block["kind"], effect))
                if block["kind"] in CHANGES:
                    self.leaving.append(self.time.now + self.stays)
        period = 0 if reason else effect
        fields = {"version": 1, "reason": reason, "sequence": number, "commit_period": period, "flags": flags}
        self.say(spec.build_ack({**fields, "now": self.now, "free": self.free, "state": self.state}))

    def say(self, record: bytes) -> None:
        self.says.append((self.time.now, record))

    @property
    def now(self) -> int:
        """In ticks."""
        return round(self.time.now * 2e6)

    def query(self, request: Request) -> bytes:
        if request is Request.INFO:
            return self.info
        if request is Request.CLOCK:
            return ClockReading(self.now, 0, 0).encode()
        assert request is Request.STATUS
        self.heard_at = self.time.now
        return self.status_record()

    def status_record(self) -> bytes:
        fields = {"state": self.state, "flags": int(self.fired), "now": self.now, "free": self.free}
        return spec.build_status({**fields, "watchdog_ms": round(self.watchdog * 1000)})

    def command(self, request: Request, value: int) -> None:
        self.orders.append((request, value))
        match request:
            case Request.ENABLE:
                self.state, self.fired, self.heard_at = State.READY, False, self.time.now
            case Request.DISABLE:
                self.state = State.OFF
                self.leaving.clear()
            case Request.WATCHDOG:
                self.watchdog = value / 1000

    def restart(self) -> None:
        """The effect of RESET or of a pulled cable."""
        self.last, self.state, self.waiting = None, State.OFF, None
        self.leaving.clear()
        self.says.clear()


def keep(data: bytes) -> bytes | None:
    return data


Fate = Callable[[bytes], bytes | None]
"""The fate of a block or a record on its way; None if it is lost."""


class BenchLine:
    """A line to a `ModelDevice`, as `host.transport.Transport`."""

    name = "bench B-1"
    serial = "B-1"
    most_blocks_per_second = float("inf")

    def __init__(self, *, lossy: bool = False, queue: int = 8, stays: float = 0.0) -> None:
        self.lossy = lossy
        self.posts = False
        self.time = Clock()
        self.device = ModelDevice(self.time, lossy=lossy, queue=queue, stays=stays)
        self.sent: list[bytes] = []
        self.at_once = 10**9
        """Blocks that one write takes at most."""
        self.most_unanswered = self.unanswered = 0
        self.to_device: Fate = keep
        self.to_host: Fate = keep
        self.delay = 0.0
        """How long a record is on its way."""
        self.fails: Callable[[str], None] = lambda what: None
        """Called before each call, with its name; may raise."""
        self.reopened_within: list[float] = []
        self.closed = 0

    def window(self, free: int | None, records: int) -> int:
        if not self.lossy:
            return records
        return 1 if free is None else free + 1

    def write_blocks(self, blocks: bytes, seconds: float) -> int:
        deadline = self.time.now + seconds
        taken = 0
        for at in range(0, min(len(blocks), 512 * self.at_once), 512):
            self.fails("write")
            block = blocks[at : at + 512]
            assert len(block) == 512
            arrives = self.to_device(block)
            while arrives is not None and not self.device.take(arrives):
                if self.time.now + MS > deadline:
                    return taken
                self.time.sleep(MS)
            self.sent.append(block)
            self.unanswered += 1
            self.most_unanswered = max(self.most_unanswered, self.unanswered)
            taken += 512
        return taken

    def read_records(self, seconds: float) -> bytes:
        deadline = self.time.now + seconds
        while True:
            self.fails("read")
            self.device.pass_time()
            came = b""
            while self.device.says and self.device.says[0][0] + self.delay <= self.time.now:
                record = self.to_host(self.device.says.popleft()[1])
                came += record or b""
                self.unanswered = max(0, self.unanswered - 1)
            if came or self.time.now + MS > deadline:
                return came
            self.time.sleep(MS)

    def take_back(self) -> int:
        return 0

    def query(self, request: Request, size: int) -> bytes:
        self.fails(request.name)
        self.time.sleep(0.1 * MS)
        self.device.pass_time()
        return self.device.query(request)[:size]

    def command(self, request: Request, value: int = 0) -> None:
        self.fails(request.name)
        self.device.command(request, value)

    def reopen(self, seconds: float) -> None:
        self.fails("reopen")
        self.device.says.clear()
        self.reopened_within.append(seconds)

    def close(self) -> None:
        self.closed += 1


class PostingLine(BenchLine):
    """A line that takes blocks before the device does, and carries them as time passes."""

    posts = True

    def __init__(self, *, most: int = 3, queue: int = 8, stays: float = 0.0, per_step: int = 2) -> None:
        super().__init__(queue=queue, stays=stays)
        self.posts = True
        self.most, self.per_step = most, per_step
        self.under_way: deque[bytes] = deque()
        """Transfers."""
        self.most_under_way = 0

    def window(self, free: int | None, records: int) -> int:
        return 4 * records

    def carry(self) -> None:
        """Let a step of time pass, in which the device takes a few blocks."""
        self.time.sleep(MS)
        for _ in range(self.per_step):
            if not self.under_way or not self.device.take(self.under_way[0][:512]):
                break
            self.sent.append(self.under_way[0][:512])
            self.under_way[0] = self.under_way[0][512:]
            if not self.under_way[0]:
                self.under_way.popleft()

    def write_blocks(self, blocks: bytes, seconds: float) -> int:
        self.fails("write")
        deadline = self.time.now + seconds
        while len(self.under_way) == self.most:
            if self.time.now + MS > deadline:
                return 0
            self.carry()
        self.under_way.append(blocks)
        self.most_under_way = max(self.most_under_way, len(self.under_way))
        return len(blocks)

    def read_records(self, seconds: float) -> bytes:
        deadline = self.time.now + seconds
        while True:
            self.fails("read")
            self.device.pass_time()
            came = b"".join(record for _, record in self.device.says)
            self.device.says.clear()
            if came or self.time.now + MS > deadline:
                return came
            self.carry()

    def take_back(self) -> int:
        left = sum(map(len, self.under_way))
        self.under_way.clear()
        return left


def begun(line: BenchLine) -> Session:
    """A session that has begun."""
    session = Session(line)
    session.begin()
    return session


def enabled(line: BenchLine) -> Session:
    """A session with a device whose outputs are enabled."""
    session = begun(line)
    session.command(Request.ENABLE)
    return session


def info(**changed: object) -> bytes:
    """The information record with some fields changed."""
    return dataclasses.replace(INFO, **changed).encode()  # type: ignore[arg-type]  # whatever the test wants


class Once:
    """An error at the n-th call of a kind, and only there."""

    def __init__(self, what: str, error: BaseException, nth: int = 1) -> None:
        self.what, self.error, self.left = what, error, nth

    def __call__(self, what: str) -> None:
        self.left -= what == self.what
        if what == self.what and self.left == 0:
            raise self.error
