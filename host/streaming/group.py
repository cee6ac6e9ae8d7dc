"""Several open devices that play as one array: one frame for one period on all of them, and one stop."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from functools import partial
from math import ceil
from threading import RLock
from types import TracebackType
from typing import Self, TypeAlias, TypeVar
from warnings import warn

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import whole
from ...base.errors import DeviceError, DeviceRefusedError
from ...protocol.board import CARRIER_HZ
from ...protocol.codes import NOW, AckFlag, Reason
from ...protocol.pulses import Pulses
from ...protocol.quantise import PulseFrames
from ...protocol.replies import Ack, Status
from ...solver import Solution, TransducerArray
from ..transports.transport import Timekeeper
from .calibration import COLUMNS, Calibration
from .common_clock import CommonClock, common_time
from .device import Device, lane_of, open_device, streaming
from .envelopes import Envelope
from .frames import Frame, Frames, differences, frame_source, to_pulses
from .lanes import naming
from .rig import RigDevice, check_rig
from .streaming import FIRST_READINGS, LOOK_AHEAD_SECONDS, Stream, StreamReport, most_blocks_per_second, time_to_play

__all__ = ["AnyDevice", "DeviceGroup", "open_devices"]

MOST_ROUNDS = 5
"""Of readings in search of a common sync line: on a busy computer the first ones may be too slow."""
BLOCKS_AT_ONCE = 4
"""As many as a call sends to a device before all begin, as a rule."""
ATTEMPTS = 3
"""To begin together, each a little later."""

Result = TypeVar("Result")


def open_devices(devices: Sequence[RigDevice], *, observe: bool = False) -> DeviceGroup:
    """Open devices that make one array: all of them, or none.

    Parameters
    ----------
    devices : sequence of RigDevice
        Their URLs, and where their transducers are; `read_rig` reads them from a file.
    observe : bool
        Whether to leave unchanged what they play, now and at the end.

    Returns
    -------
    DeviceGroup
        Use it in a ``with`` statement: the outputs of all are off when it ends, however it ends.

    Raises
    ------
    ValueError
        If there are none, one is named twice, or one has another number of transducers than it should.
    DeviceError
        If one cannot be opened; it is named.
    """
    check_rig(devices)
    with ExitStack() as stack:
        opened = []
        for each in devices:
            with naming(each.name):
                opened.append(stack.enter_context(open_device(each.url, observe=observe)))
        group = DeviceGroup(devices, opened)
        stack.pop_all()
    if not group.common.shared:
        warn(f"{group.name}: {group.common}", stacklevel=2)
    return group


class DeviceGroup:
    """Devices that play as one array.

    What it has in common with `Device` has the same arguments, results and errors. A *frame* is for the transducers of
    all, device after device. A *period* is one of the first device's clock; all devices begin in it. If that is no
    longer possible they begin together later, and the acknowledgement says so. If one of them fails or refuses, the
    outputs of all are turned off, and the error names it.

    Parameters
    ----------
    members : sequence of RigDevice
        Their descriptions.
    devices : sequence of Device
        The open devices.

    Attributes
    ----------
    members, devices : tuple
        As given.
    array : TransducerArray
        All transducers, in place.
    calibration : Calibration or None
        The calibration of all transducers.
    common : CommonClock
        How the devices' periods are related: by a sync line, or by estimate, with its error.
    time : Timekeeper
        The clock of all: that of an emulated device in this process is moved with the others'.
    """

    def __init__(self, members: Sequence[RigDevice], devices: Sequence[Device]) -> None:
        self.members, self.devices = tuple(members), tuple(devices)
        for member, device in zip(members, devices, strict=True):
            _check_channels(member, device)
        self.array = TransducerArray.joined([member.array for member in members])
        self.calibration = _joined([(len(member.array), member.calibration) for member in members])
        keepers = [device.time for device in devices]
        if len({keeper is time for keeper in keepers}) > 1:
            raise DeviceError(
                "emulated devices of this process have a time of their own and cannot play with real ones; serve them "
                "by `phasewire emulate`, and name their usbip: URLs"
            )
        self.time: Timekeeper = common_time(keepers)
        self._lanes = [lane_of(device) for device in devices]
        for member, lane in zip(members, self._lanes, strict=True):
            lane.name = member.name
        self._lock = RLock()
        self._enabled = False
        self._stops = 0
        self._compared: TransducerArray | None = None
        self.common = CommonClock([member.name for member in members], [device.clock() for device in devices])
        for _ in range(MOST_ROUNDS):
            self.time.sleep(0)
            for lane in self._lanes * FIRST_READINGS:
                with naming(lane.name):
                    lane.read_clock()
            if self.common.meet([lane.clock for lane in self._lanes], self.time.monotonic()):
                break

    def __repr__(self) -> str:
        return f"DeviceGroup({self.name})"

    def __len__(self) -> int:
        return len(self.devices)

    @property
    def name(self) -> str:
        """How many there are, and their serial numbers."""
        return f"rig of {len(self)} devices ({', '.join(device.serial or device.name for device in self.devices)})"

    @property
    def channels(self) -> int:
        """How many transducers they have together."""
        return len(self.array)

    @property
    def slots(self) -> int:
        """How many frames each can store."""
        return min(device.info.slots for device in self.devices)

    @property
    def most_updates_per_second(self) -> float:
        """How many frames the devices and the lines to them can take."""
        lines = most_blocks_per_second([lane.session for lane in self._lanes])
        return min(lines, *(device.info.max_updates_per_second for device in self.devices))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._stops += 1
        stack = ExitStack()
        for member, device in zip(reversed(self.members), reversed(self.devices), strict=True):
            stack.push(partial(_left, member.name, device))
        stack.__exit__(kind, error, traceback)

    def close(self) -> None:
        """Close the lines and leave the devices as they are, even playing; ``with`` then ends without a stop."""
        for device in self.devices:
            device.close()

    # State and switches

    def status(self) -> list[Status]:
        """The state of each device; a sign of life to their watchdogs."""
        return self._each(lambda device: device.status())

    def enable(self) -> None:
        """Enable the outputs of all, which `show`, `play` and `stream` do by themselves."""
        self._enable(self._stops)

    def _enable(self, stops: int) -> None:
        for place, device in enumerate(self.devices):
            self._unless_stopped(stops, place, device.enable)
        self._enabled = True

    def stop(self) -> None:
        """Turn all outputs off and drop what is queued, on every device, even if one fails.

        A call in another thread that plays ends in a `DeviceRefusedError`, as a stream does.
        """
        self._stops += 1  # before any device is off, so that no call turns one on again
        self._enabled = False
        with ExitStack() as stack:
            for member, device in zip(reversed(self.members), reversed(self.devices), strict=True):
                stack.callback(_named, member.name, device.stop)

    def set_watchdog(self, seconds: float) -> None:
        """How long each device waits for a sign of life before it turns its outputs off, 0.01 to 60 s."""
        self._each(lambda device: device.set_watchdog(seconds))

    # Playing

    def show(self, frame: Frame, period: int = NOW) -> Ack:
        """Play a frame on all devices from one period on, until something else follows or the host falls silent.

        See `Device.show`.

        Returns
        -------
        Ack
            Contains the common period, and whether it is later than requested.
        """
        parts = self._parts(frame)
        return self._together(lambda place, begin: self.devices[place].show(parts[place], begin), period)

    def store(self, slot: int, frame: Frame) -> None:
        """Store a frame in a numbered slot of all devices, for `play`."""
        for device, part in zip(self.devices, self._parts(frame), strict=True):
            self._guarded(device, partial(device.store, slot, part))

    def play(
        self, steps: Iterable[tuple[int, int]], *, repeats: int = 0, unattended: bool = False, period: int = NOW
    ) -> Ack:
        """Play stored slots one after the other on all devices in step; see `Device.play`."""
        kept = tuple(steps)

        def begin_on(place: int, begin: int) -> Ack:
            return self.devices[place].play(kept, repeats=repeats, unattended=unattended, period=begin)

        return self._together(begin_on, period)

    def modulate(self, samples: Sequence[int] | bytes, hold: int, period: int = NOW) -> Ack:
        """Modulate whatever plays on all devices in step; see `Device.modulate`."""
        return self._together(lambda place, begin: self.devices[place].modulate(samples, hold, begin), period)

    def end_modulation(self, period: int = NOW) -> Ack:
        """End the modulation of what plays, on all devices in one period."""
        return self._together(lambda place, begin: self.devices[place].end_modulation(begin), period)

    def silence(self, period: int = NOW) -> Ack:
        """End what plays, and its modulation, on all devices in one period; the outputs stay enabled."""
        return self._together(lambda place, begin: self.devices[place].silence(begin), period)

    def keep_playing(self, seconds: float) -> None:
        """Let what plays go on for a time, with signs of life to all devices, and a look at their common clock.

        Raises
        ------
        DeviceRefusedError
            If a device has turned its outputs off meanwhile.
        DeviceError
            If a device has lost the sync line.
        """
        end = self.time.monotonic() + time_to_play(seconds)
        while (left := end - self.time.monotonic()) > 0:
            self.time.sleep(min(left, *(lane.session.pause_seconds for lane in self._lanes)))
            for device, lane in zip(self.devices, self._lanes, strict=True):
                if not self._guarded(device, lane.read_clock).enabled:
                    self._guarded(device, lane.session.check_enabled)
            self._guarded(None, self._follow)

    def stream(
        self,
        source: Frames,
        rate: float,
        *,
        look_ahead: float = LOOK_AHEAD_SECONDS,
        envelope: Envelope | None = None,
        on_progress: Callable[[StreamReport], None] | None = None,
    ) -> StreamReport:
        """Play frames one after the other at a rate, each on all devices in its own period, to the end of the last.

        See `Device.stream`. If source, host or a device is late, what follows is moved on all alike. A lost device, or
        a refused frame, ends the stream on all.

        Returns
        -------
        StreamReport
            The worst of each device, and how far apart their clocks may be.
        """
        frames = frame_source(source, self.calibration, self.channels)
        lanes = [lane_of(device) for device in self.devices]
        for lane, member, part in zip(lanes, self.members, self._cuts(), strict=True):
            lane.name, lane.part = member.name, part
        if envelope is not None:
            lanes[-1].begin = partial(self._modulate_first, envelope)
        stream = Stream(lanes, frames, rate, look_ahead=look_ahead, common=self.common)
        try:
            with ExitStack() as stack:
                for member, device, lane in zip(self.members, self.devices, lanes, strict=True):
                    with naming(member.name):
                        stack.enter_context(streaming(device, lane))
                return stream.run(on_progress)
        except BaseException:
            self._enabled = False
            raise
        finally:
            if on_progress is not None:
                on_progress(stream.report)

    def _modulate_first(self, envelope: Envelope) -> None:
        """Enable and modulate all devices, and wait until that has begun: a frame before it would be late."""
        self.enable()  # one may have turned its outputs off meanwhile
        begins = self.modulate(*envelope).commit_period
        self.time.sleep(max(self._lanes[0].clock.moment_of(begins) - self.time.monotonic(), 0))

    # In step

    def _cuts(self) -> list[Callable[[PulseFrames], PulseFrames]]:
        """For each device a function that cuts its part from the pulses of all."""
        ends = np.cumsum([len(member.array) for member in self.members])
        return [
            partial(_cut, slice(end - len(member.array), end), member.channels, device.info.channels)
            for member, device, end in zip(self.members, self.devices, ends.tolist(), strict=True)
        ]

    def _parts(self, frame: Frame) -> list[Pulses]:
        """The pulses of each device."""
        if isinstance(frame, Solution) and frame.array is not self._compared:  # once for all of a live solver
            self._compared = frame.array
            for difference in differences(frame.array, frame.medium, self.devices[0].info, self.array):
                warn(f"the solution was made for something else: {difference}", stacklevel=3)
        pulses = to_pulses(frame, self.calibration, self.channels)
        frames = PulseFrames(pulses.phase[None], pulses.width[None])
        return [cut(frames).pulses(0) for cut in self._cuts()]

    def _together(self, begin_on: Callable[[int, int], Ack], period: int) -> Ack:
        """Begin something on all devices in one period, later if that is over; on each by its own count.

        If the host was held up so long that a device was late, all begin once more.
        """
        period, stops = whole("period", period, 0, 2**64 - 1), self._stops
        with self._lock:
            if not self._enabled:
                self._enable(stops)
            lead = self._lead()
            for _ in range(ATTEMPTS):
                common = max(period, self._look() + lead)
                begins = [common + offset for offset in self.common.offsets]
                acks = list[Ack]()
                for place, begin in enumerate(begins):
                    try:
                        acks.append(self._unless_stopped(stops, place, partial(begin_on, place, begin)))
                    except ValueError:
                        if acks:  # earlier devices have begun
                            self._quieten()
                        raise
                late = [ack.commit_period - begin for ack, begin in zip(acks, begins, strict=True) if ack.commit_period]
                if not any(late):
                    flags = acks[0].flags | (AckFlag.LATE if NOW != period < common else AckFlag(0))
                    return replace(acks[0], commit_period=common, flags=flags)
                lead += max(late)
            self._quieten()
        raise DeviceError(
            f"{self.name} did not begin together: one was {max(late)} periods late; this computer is too busy"
        )

    def _unless_stopped(self, stops: int, place: int, step: Callable[[], Result]) -> Result:
        """Take a step that turns a device's outputs on, unless all were stopped since a call began."""
        device = self.devices[place]

        def permitted() -> Result:
            with self._lanes[place].session.lock:  # a stop that comes now waits, and then turns them off
                if self._stops != stops:
                    raise DeviceRefusedError("its outputs are off: the rig was stopped", Reason.DISABLED)
                return step()

        return self._guarded(device, permitted)

    def _lead(self) -> int:
        """Periods from now until all devices can have received what they begin with."""
        blocks = sum(BLOCKS_AT_ONCE / lane.session.line().most_blocks_per_second for lane in self._lanes)
        answers = BLOCKS_AT_ONCE * sum(lane.clock.longest for lane in self._lanes)
        return ceil((LOOK_AHEAD_SECONDS + blocks + answers) * CARRIER_HZ)

    def _look(self) -> int:
        """Read all clocks; returns the first device's present period."""
        self.time.sleep(0)
        for device, lane in zip(self.devices, self._lanes, strict=True):
            self._guarded(device, lane.read_clock)
        self._guarded(None, self._follow)
        return ceil(self._lanes[0].clock.period_at(self.time.monotonic()))

    def _follow(self) -> None:
        self.common.follow([lane.clock for lane in self._lanes], self.time.monotonic())

    def _each(self, step: Callable[[Device], Result]) -> list[Result]:
        """Take a step with each device."""
        return [self._guarded(device, partial(step, device)) for device in self.devices]

    def _guarded(self, device: Device | None, step: Callable[[], Result]) -> Result:
        """Take a step with one device, or with all; if it fails, the outputs of all are off."""
        try:
            with naming(self.members[self.devices.index(device)].name if device else ""):
                return step()
        except ValueError:  # of a wrong argument: nothing was sent
            raise
        except BaseException:
            self._quieten()
            raise

    def _quieten(self) -> None:
        with suppress(DeviceError):  # out of reach: its watchdog does it
            self.stop()


def _left(
    name: str,
    device: Device,
    kind: type[BaseException] | None,
    error: BaseException | None,
    traceback: TracebackType | None,
) -> None:
    with naming(name):
        device.__exit__(kind, error, traceback)


def _named(name: str, step: Callable[[], None]) -> None:
    with naming(name):
        step()


def _cut(columns: slice, channels: NDArray[np.intp] | None, count: int, frames: PulseFrames) -> PulseFrames:
    """The pulses of a device with so many channels, of those of all."""
    tables = []
    for table in frames:
        own = np.ascontiguousarray(table[:, columns])
        if channels is not None:
            spread = np.zeros((len(table), count), table.dtype)
            spread[:, channels] = own
            own = spread
        tables.append(own)
    return PulseFrames(*tables)


def _check_channels(member: RigDevice, device: Device) -> None:
    """Raise `ValueError` if a device has other transducers than a rig says; warn if they are elsewhere."""
    there, info = len(member.array), device.info
    if member.channels is None and there != info.channels:
        raise ValueError(
            f"{member.name} has {info.channels} transducers, not {there}; channels says which of them are there"
        )
    if member.channels is not None and member.channels.max() >= info.channels:
        raise ValueError(
            f"{member.name} has the channels 0 to {info.channels - 1}, and no {member.channels.max()}; correct channels"
        )
    own = TransducerArray.grid(info.columns, info.rows, info.pitch).positions
    own, placed = own if member.channels is None else own[member.channels], member.array.positions
    if not np.allclose(np.linalg.norm(own - own[0], axis=1), np.linalg.norm(placed - placed[0], axis=1), atol=1e-6):
        warn(
            f"{member.name} has {info.columns} × {info.rows} transducers, {info.pitch * 1e3:g} mm apart, and not at "
            "the places that the rig says",
            stacklevel=4,
        )


def _joined(calibrations: Sequence[tuple[int, Calibration | None]]) -> Calibration | None:
    """The calibration of all transducers, None if none is calibrated."""
    if all(calibration is None for _, calibration in calibrations):
        return None
    parts = [Calibration.perfect(count) if own is None else own for count, own in calibrations]
    return Calibration(*(np.concatenate([getattr(each, name) for each in parts]) for name in COLUMNS[1:]))


AnyDevice: TypeAlias = Device | DeviceGroup
"""One device, or several that play as one."""
