"""The loop through the emulator, by its own clock: what the outputs did is what counts."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from queue import SimpleQueue
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from phasewire import ControlPoints, Device, Emulator, Mesh, TransducerArray, open_device, pressure
from phasewire.base.errors import DeviceError, DeviceLostError, DeviceRefusedError, DeviceStalledError, TrackerLostError
from phasewire.emulator.faults import HotBoard, InjectedFault, PowerCut, StalledEndpoint, Unplugged
from phasewire.host.hands import leap
from phasewire.host.hands.frames import HandFrame, TrackedHand
from phasewire.host.hands.liveness import STEADY_SECONDS
from phasewire.host.hands.sources import HandSource, PlayedHands, open_hands
from phasewire.host.touching import loop as loop_module
from phasewire.host.touching.fields import PoseSolver, PulseCycle
from phasewire.host.touching.loop import MOST_RAMP_SECONDS, SILENCE_SECONDS, TouchLoop, TouchMoment
from phasewire.host.touching.report import TouchReport
from phasewire.host.touching.turns import Alternation, StoredTurns
from phasewire.solver.contact.touch import Touch, Toucher
from phasewire.solver.methods.split import split
from phasewire.solver.shapes.points import check_reachable
from websockets.sync.server import ServerConnection

from tests.host.hands.clocks import Clock
from tests.host.hands.leap_service import PATIENCE, LeapService, leap_frame

from .ring import POINTS, Ring, frames, hand_at, source

STREAMED, STORED, OTHERS = "two-sided:envelope=square", "stm", ("two-sided", "am", "lm", "auto")
in_each_way = pytest.mark.parametrize(
    "render", [STREAMED, STORED, *(pytest.param(way, marks=pytest.mark.slow) for way in OTHERS)]
)

ARRAY = TransducerArray.grid()
MS = 40
"""Carrier periods."""
SILENCE = round(SILENCE_SECONDS * 1000) * MS

Place = Callable[[float], Sequence[float] | None]


def still(_: float) -> tuple[float, float, float]:
    return (0.01, -0.02, 0.2)


def loop_of(device: Device, hands: Any, **options: Any) -> TouchLoop:
    return TouchLoop(device, hands, [], Ring(), ARRAY, most_points=64, **options)


def amplitudes(emulator: Emulator, begin: int, end: int) -> NDArray[np.float64]:
    """How strongly the outputs sound in each period from one to before another, 0 to 1: by their mean width."""
    bits = emulator.capture().bits(50 * begin, 50 * end)
    high = np.bitwise_count(bits).reshape(-1, 50 * 10).sum(axis=1) / (50 * 320)
    return np.asarray(np.sin(np.pi * high))


def last_sound(emulator: Emulator, begin: int = 0) -> int:
    """The last period, from one on, in which an output was high."""
    capture = emulator.capture()
    sounding = np.flatnonzero(amplitudes(emulator, begin, capture.end_tick // 50))
    return begin + int(sounding[-1]) if len(sounding) else -1


def loudness_of(emulator: Emulator, begin: int, window: int = 100) -> NDArray[np.float64]:
    """The greatest amplitude in each 2.5 ms, half a period of 200 Hz, or another window, from a period on."""
    every = amplitudes(emulator, begin, emulator.capture().end_tick // 50)
    return np.asarray(every[: len(every) // window * window].reshape(-1, window).max(axis=1))


class Noting:
    """The loop's report of each pose, with the device's clock at that moment."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self.moments: list[tuple[int, TouchMoment]] = []

    def __call__(self, moment: TouchMoment) -> None:
        self.moments.append((int(self._device.time.monotonic() * 40_000), moment))


def test_what_a_resting_hand_touches_is_played_in_turn_as_the_solver_has_it() -> None:
    with Emulator() as emulator, open_device(emulator.url) as device:
        noting = Noting(device)
        hands = source(device.time, 200, 0.2, still)
        report = loop_of(device, hands, on_moment=noting).run(0.15)
        capture = emulator.capture()
    _, moment = noting.moments[-1]
    assert (moment.fading.levels == 1).all()
    points = moment.touch.points
    assert points is not None
    halves = split(points).mask
    own, other = [], []
    for (begun, shown), (ends, _) in zip(noting.moments[-6:], noting.moments[-5:], strict=False):
        for period in range(begun + 6, ends - 1):
            assert shown.cycle is not None
            turn = period // 100 % 2
            drive = shown.cycle.frames.pulses(turn).to_drive()
            np.testing.assert_allclose(capture.drive(period), drive, atol=1e-12)
        felt = np.abs(pressure(ARRAY, capture.drive(begun + 10), points.positions))
        first = (begun + 10) // 100 % 2 == 0
        own.append(felt[halves == first].mean())
        other.append(felt[halves != first].mean())
    assert min(own) > 3 * max(other), "each half of the points has the field in its turn"
    assert (report.frames, report.touching, report.points_most) == (31, 31, POINTS)
    assert (report.late, report.slipped, report.stalls, report.held_up, report.dropped) == (0, 0, 0, 0, 0)
    assert report.latency.count == 31


class Watched:
    """Notes each cycle that is stored, with the period from which the device says that it plays."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.cycles: list[PulseCycle] = []
        self.begins: list[int] = []
        show, play = StoredTurns.show, Device.play

        def shown(turns: StoredTurns, cycle: PulseCycle) -> bool:
            self.cycles.append(cycle)
            return show(turns, cycle)

        def begun(device: Device, *steps: Any, **options: Any) -> Any:
            ack = play(device, *steps, **options)
            self.begins.append(ack.commit_period)
            return ack

        monkeypatch.setattr(StoredTurns, "show", shown)
        monkeypatch.setattr(Device, "play", begun)


@pytest.mark.parametrize(
    "line", ["", *(pytest.param(f"?door=serial&baud={baud}", marks=pytest.mark.slow) for baud in (3000000, 921600))]
)
@pytest.mark.parametrize("render", ["two-sided", "am", "lm", "stm", "am:envelope=square", "stm:speed=1"])
def test_in_each_way_the_frames_are_emitted_in_turn_and_the_cycle_keeps_its_phase_from_pose_to_pose(
    render: str, line: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    watched = Watched(monkeypatch)
    with Emulator() as emulator, open_device(emulator.url + line) as device:
        seconds = 0.15 if device.most_updates_per_second > 500 else 0.4
        moving = source(device.time, 100, 1, lambda time: (0.01 + 0.1 * time, 0, 0.2))
        report = loop_of(device, moving, render=render).run(seconds)
        capture = emulator.capture()
    begins, cycles = watched.begins, watched.cycles
    assert len(begins) == len(cycles) > 3
    assert (report.late, report.held_up, report.stored) == (0, 0, True)
    assert len({cycle.periods for cycle in cycles}) == 1
    assert report.frequency_hz == pytest.approx(40_000 / cycles[0].periods)
    emitted = capture.drives(begins[0], begins[-1] + 10)
    assert emitted.any()
    for cycle, begun, ends in zip(cycles, begins, [*begins[1:], begins[-1] + 10], strict=True):
        turns = np.arange(begun, ends) // cycle.hold % len(cycle.frames.phase)
        wanted = np.stack([cycle.frames.pulses(turn).to_drive() for turn in range(len(cycle.frames.phase))])[turns]
        assert np.abs(emitted[begun - begins[0] : ends - begins[0]] - wanted).max() < 1e-5


def test_gains_scale_each_transducer_and_0_silences_it() -> None:
    gains = np.linspace(0, 1, 320, dtype=np.float32)
    loudness = []
    for scaled in (np.ones(320, np.float32), gains):
        with Emulator() as emulator, open_device(emulator.url) as device:
            loop = loop_of(device, source(device.time, 100, 0.3, still))
            assert loop.alternation == Alternation(100)
            loop.set_gains(scaled)
            loop.run()
            last = last_sound(emulator) - 2000
            loudness.append(np.abs(emulator.capture().drives(last - 200, last)).max(axis=0))
    assert np.abs(loudness[1] - gains * loudness[0]).max() < np.sin(
        np.pi / 50
    )  # both are whole ticks: half a step each
    assert loudness[1][0] == 0


@pytest.mark.parametrize("gains", [np.ones(319), np.full(320, 1.01), np.full(320, -0.01), np.full(320, np.nan)])
def test_gains_out_of_range_are_refused(gains: NDArray[np.float64]) -> None:
    with Emulator() as emulator, open_device(emulator.url) as device:
        loop = loop_of(device, source(device.time, 100, 0.1, still))
        with pytest.raises(ValueError, match="320 numbers from 0 to 1"):
            loop.set_gains(gains.astype(np.float32))


@pytest.mark.parametrize("ramp", [0.0, 0.01, 0.02, MOST_RAMP_SECONDS])
@pytest.mark.parametrize("rate", [60, 1000])
def test_contact_and_release_are_ramps_and_silence_comes_in_time(ramp: float, rate: int) -> None:
    contact, release = 0.1, 0.3
    with Emulator() as emulator, open_device(emulator.url) as device:
        begin = device.time.monotonic()

        def place(time: float) -> tuple[float, float, float] | None:
            return still(time) if contact <= time < release else None

        loop_of(device, source(device.time, rate, 0.4, place), ramp=ramp).run()
        loudness = amplitudes(emulator, 0, emulator.capture().end_tick // 50)
    whole = loudness.max()
    begins, ends = int(np.flatnonzero(loudness)[0]), int(np.flatnonzero(loudness)[-1])
    assert 0 <= begins - (begin + contact) * 40_000 < (1 / rate + 0.003) * 40_000
    full = int(np.flatnonzero(loudness > 0.9 * whole)[0])
    assert abs((full - begins) / 40_000 - ramp * 0.8) < 0.003 + ramp * 0.3
    released = (begin + np.ceil(release * rate) / rate) * 40_000
    assert ends - released < SILENCE
    assert abs((ends - released) / 40_000 - ramp) < 0.006
    loudest_step = np.abs(np.diff(loudness[::100])).max()
    assert loudest_step < whole * (1.01 if ramp == 0 else max(0.75 * 2.5e-3 / ramp * 2, 0.12))


class Upright(Ring):
    """The ring stands upright, and its lower part is below the array."""

    def touch(self, hands: Any, objects: Any, time: float | None = None) -> Touch:
        """The ring about the palm of each hand."""
        flat = super().touch(hands, objects, time)
        assert flat.points is not None
        [arc] = flat.arcs
        centre = arc[:-1].mean(axis=0)
        upright = centre + (arc - centre)[:, [0, 2, 1]]
        touch = Touch(flat.cuts, ControlPoints(upright[:-1]), flat.marks)
        touch.__dict__["arcs"] = [upright]
        return touch


@pytest.mark.parametrize(("height", "parts"), [(0.2, 1), (0.01, 2), (-0.02, 1)])
def test_only_what_the_array_reaches_is_drawn(height: float, parts: int, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = []
    genuine = PoseSolver.solve

    def solve(solver: PoseSolver, fading: Any, strokes: Any = ()) -> PulseCycle:
        drawn.append(strokes)
        return genuine(solver, fading, strokes)

    with Emulator() as emulator, open_device(emulator.url) as device:
        hands = PlayedHands("low", frames(100, 0.1, lambda _: (0, 0, height)), 100, device.time)
        loop = TouchLoop(device, hands, [], Upright(), ARRAY, most_points=64, render="stm")
        loop.warm_up()
        monkeypatch.setattr(PoseSolver, "solve", solve)
        loop.run()
    assert drawn
    for strokes in drawn:
        assert len(strokes) == parts
        for stroke in strokes:
            check_reachable(ARRAY, ControlPoints(stroke))


class Stalling(PlayedHands):
    """Gives frames, and from some time on none, though it has not ended."""

    def __init__(self, device: Device, seconds: float, *, blocks: float | None = None, place: Place = still) -> None:
        super().__init__("stalling", frames(100, 10, place), 100, device.time)
        self._device, self._blocks = device, blocks
        self._until = device.time.monotonic() + seconds
        self._stops = device.time.monotonic() + 0.6

    def next_frame(self, timeout: float) -> HandFrame | None:
        now = self._device.time.monotonic()
        if now >= self._stops:
            self.close()
        if now < self._until or (self._blocks is not None and now > self._until + 0.1):
            return super().next_frame(timeout)
        self._device.time.sleep(timeout if self._blocks is None else self._blocks)
        return None


@in_each_way
def test_a_source_that_stalls_is_silenced_in_time_and_counted(render: str) -> None:
    with Emulator() as emulator, open_device(emulator.url) as device:
        heard = []
        hands = Stalling(device, 0.2)
        loop = loop_of(device, hands, render=render, on_moment=lambda moment: heard.append(moment.time))
        report = loop.run()
        assert report.stalls == 1
        assert last_sound(emulator, int(heard[0] * 40_000)) - heard[-1] * 40_000 < SILENCE
        envelope = loudness_of(emulator, int(heard[-1] * 40_000) - 1200)
    assert (np.abs(np.diff(envelope)) < 0.6 * envelope.max()).all(), "it fades"


@in_each_way
def test_a_source_that_does_not_come_back_is_silenced_by_the_watchdog_and_the_loop_goes_on_afterwards(
    render: str,
) -> None:
    with Emulator() as emulator, open_device(emulator.url) as device:
        heard: list[float] = []
        hands = Stalling(device, 0.2, blocks=0.15)
        report = loop_of(device, hands, render=render, on_moment=lambda moment: heard.append(moment.time)).run()
        gap = int(np.argmax(np.diff(heard)))
        before, after = heard[gap], heard[gap + 1]
        loudness = amplitudes(emulator, 0, emulator.capture().end_tick // 50)
    assert report.held_up == 1
    assert after - before > 0.1
    quiet = loudness[int(before * 40_000) + SILENCE + 3 * MS : int(after * 40_000)]
    assert len(quiet) > 30 * MS
    assert not quiet.any()
    assert loudness[int(after * 40_000) + 30 * MS :].any(), "it plays again"


@in_each_way
def test_what_the_watchdog_has_silenced_does_not_come_back_without_a_hand(render: str) -> None:
    with Emulator() as emulator, open_device(emulator.url) as device:
        hands = Stalling(device, 0.2, blocks=0.15, place=lambda time: still(time) if time < 0.25 else None)
        report = loop_of(device, hands, render=render).run()
        assert report.held_up == 1
        assert last_sound(emulator) < 0.3 * 40_000


@in_each_way
def test_it_ends_with_its_time_and_the_outputs_are_off(render: str) -> None:
    with Emulator() as emulator, open_device(emulator.url) as device:
        told: list[TouchReport] = []
        report = loop_of(device, source(device.time, 100, 10, still), render=render).run(0.3, told.append)
        assert not device.status().enabled
        emulator.run(7)
        assert 0.3 * 40_000 < last_sound(emulator) < emulator.capture().end_tick // 50 - 1
        assert 0.3 <= report.seconds < 0.33
        assert told[-1].frames == report.frames == 31
        assert device.status().watchdog_ms == 100, "as it was before"


def test_points_that_the_array_cannot_reach_are_left_out_and_counted() -> None:
    with Emulator() as emulator, open_device(emulator.url) as device:
        hands = PlayedHands("low", frames(100, 0.1, lambda _: (0, 0, -0.01)), 100, device.time)
        report = loop_of(device, hands).run()
        assert not amplitudes(emulator, 0, emulator.capture().end_tick // 50).any()
    assert report.out_of_reach == 10 * POINTS
    assert report.touching == 0


@in_each_way
@pytest.mark.parametrize(
    ("fault", "error"),
    [
        (Unplugged(period=12_000), DeviceLostError),
        (PowerCut(period=12_000), DeviceLostError),
        (StalledEndpoint(period=12_000, endpoint=1), DeviceStalledError),
        (HotBoard(period=12_000, board=1, celsius=90), DeviceRefusedError),
    ],
)
def test_a_device_that_is_lost_ends_the_loop_in_its_error(
    fault: InjectedFault, error: type[DeviceError], render: str
) -> None:
    with Emulator() as emulator:
        emulator.inject(fault)
        device = open_device(emulator.url)
        loop = loop_of(device, source(device.time, 100, 2, still), render=render)
        told: list[TouchReport] = []
        with pytest.raises(error):
            loop.run(on_progress=told.append)
        assert 10 < told[-1].frames < 60
        if not isinstance(fault, PowerCut):
            emulator.run(SILENCE + 7)
            assert last_sound(emulator) < emulator.capture().end_tick // 50 - 5


class Lost(PlayedHands):
    """A tracker that goes away."""

    def next_frame(self, timeout: float) -> HandFrame | None:
        frame = super().next_frame(timeout)
        if frame is not None and frame.number >= 20:
            raise TrackerLostError("the tracker is gone")
        return frame


@in_each_way
def test_a_lost_tracker_lets_the_field_fade_and_ends_in_its_error(render: str) -> None:
    with Emulator() as emulator, open_device(emulator.url) as device:
        heard: list[float] = []
        hands = Lost("lost", frames(100, 1, still), 100, device.time)
        loop = loop_of(device, hands, render=render, on_moment=lambda moment: heard.append(moment.time))
        with pytest.raises(TrackerLostError):
            loop.run()
        assert not device.status().enabled
        emulator.run(200)
        assert last_sound(emulator) - heard[-1] * 40_000 < SILENCE
        envelope = loudness_of(emulator, int(heard[-1] * 40_000))
        assert (np.abs(np.diff(envelope)) < 0.6 * envelope.max()).all(), "it fades"


@in_each_way
def test_stop_from_outside_ends_the_loop(render: str) -> None:
    with Emulator() as emulator, open_device(emulator.url) as device:

        def stop(moment: TouchMoment) -> None:
            if moment.time > 0.2:
                device.stop()

        loop = loop_of(device, source(device.time, 100, 2, still), render=render, on_moment=stop)
        with pytest.raises(DeviceRefusedError, match="it was stopped"):
            loop.run()
        assert not device.status().enabled
        emulator.run(100)
        assert last_sound(emulator) < 0.22 * 40_000


STEP, HANG, BACK = 0.01, 20, 40
"""Seconds from frame to frame; the last frame before a tracker hangs; the first one after it has restarted."""


class Says(NamedTuple):
    """A tracker's frame: its number, its time in seconds, and the service's time of the tracker's begin."""

    number: int
    time: float
    began: float = -5000.0


def jumping(each: int) -> Says:
    back = each - 7 * (each % 2) * (each > HANG)
    return Says(back, back * STEP)


def restarted(each: int) -> Says | None:
    if HANG < each < BACK:
        return None
    return Says(each, each * STEP) if each <= HANG else Says(each - BACK, each * STEP, BACK * STEP)


TRACKERS: dict[str, Callable[[int], Says | None]] = {
    "repeats its last frame": lambda each: Says(min(each, HANG), min(each, HANG) * STEP),
    "freezes the time": lambda each: Says(each, min(each, HANG) * STEP),
    "freezes the number": lambda each: Says(min(each, HANG), each * STEP),
    "jumps back and forth": jumping,
    "sends old frames": lambda each: Says(each, each * STEP - 0.3 * (each > HANG)),
    "restarts": restarted,
    "is well": lambda each: Says(each, each * STEP),
}


class Foreign:
    """A live source of another package, which shares nothing with `LiveHands`; its frames are never late."""

    name, notes, rate, live = "theirs", (), 1 / STEP, True

    def __init__(self, clock: Clock, says: Callable[[int], Says | None], seconds: float) -> None:
        self._clock, self._says, self._begun = clock, says, clock.now
        self._each, self._last = 0, round(seconds / STEP)
        self.sent = 0

    @property
    def ended(self) -> bool:
        return self._each > self._last

    def next_frame(self, timeout: float) -> HandFrame | None:
        due = self._begun + self._each * STEP
        if due > self._clock.now + timeout:
            self._clock.now += max(timeout, 1e-5)  # as a call takes some time
            return None
        self._clock.now = max(self._clock.now, due)
        said = self._says(self._each)
        self._each += 1
        if said is None:
            return None
        self.sent += 1
        return self.frame(said)

    def frame(self, said: Says) -> HandFrame | None:
        return HandFrame(self._begun + said.time, (TrackedHand(hand_at((0.01, -0.02, 0.2)), 1),), said.number)


class ByService(Foreign):
    """The same frames from a Leap service by WebSocket; time stands still while one is on its way."""

    def __init__(self, hands: HandSource, messages: SimpleQueue[str], *rest: Any) -> None:
        super().__init__(*rest)
        self._hands, self._messages = hands, messages

    def frame(self, said: Says) -> HandFrame | None:
        self._messages.put(json.dumps(leap_frame(said.number, round((said.time - said.began) * 1e6))))
        return self._hands.next_frame(PATIENCE)


@contextmanager
def tracker_of(kind: str, clock: Clock, says: Callable[[int], Says | None], seconds: float) -> Iterator[Foreign]:
    messages: SimpleQueue[str] = SimpleQueue()

    def script(connection: ServerConnection) -> None:
        while message := messages.get():
            connection.send(message)

    if kind == "theirs":
        yield Foreign(clock, says, seconds)
        return
    with LeapService(script) as service, open_hands(service.url) as hands:
        yield ByService(hands, messages, clock, says, seconds)
        messages.put("")


@pytest.mark.parametrize("kind", ["theirs", "leap"])
@pytest.mark.parametrize("does", TRACKERS)
def test_only_what_a_tracker_sees_anew_is_played(does: str, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A tracker that hangs may go on sending; the outputs are silent 50 ms after its last news, and stay so.

    The emulated device's time passes as the tracker's does, by a clock of the test instead of the wall's.
    """
    clock, heard, seconds = Clock(), [], 1.6
    monkeypatch.setattr(loop_module, "time", clock)
    monkeypatch.setattr(leap, "time", clock)
    with (
        Emulator() as emulator,
        open_device(emulator.url) as device,
        tracker_of(kind, clock, TRACKERS[does], seconds) as tracker,
    ):
        loop = loop_of(device, tracker, on_moment=lambda moment: heard.append(moment.time))
        loop.warm_up()
        report = loop.run()
        begin = round(heard[0] * 40_000)
        sounds = loudness_of(emulator, begin, window=MS) > 0  # in each ms
    hung, again = round(1000 * HANG * STEP), round(1000 * BACK * STEP)
    assert sounds[30:hung].all()
    assert report.seconds == pytest.approx(clock.now - 1000, abs=0.03)
    assert report.stages["wait"].worst_seconds < 0.02
    assert report.frames + report.stale == tracker.sent
    if does == "is well":
        assert sounds[30:1600].all()
        assert (report.stalls, report.stale) == (0, 0)
        return
    assert report.stalls == 1
    assert not sounds[hung + round(1000 * SILENCE_SECONDS) : again].any()
    if does == "restarts":
        assert sounds[again + 1000 : 1600].all()
        assert 0 < report.stale <= 2 * round(STEADY_SECONDS / STEP) + 2
    else:
        assert not sounds[again:].any()
        assert report.stale == tracker.sent - HANG - 1


@pytest.mark.parametrize("ramp", [-0.01, 0.05, float("nan")])
def test_a_ramp_out_of_range_is_refused(ramp: float) -> None:
    with Emulator() as emulator, open_device(emulator.url) as device, pytest.raises(ValueError, match="a ramp of"):
        loop_of(device, source(device.time, 100, 1, still), ramp=ramp)


def variants() -> dict[str, int]:
    """How many variants of each compiled function have been loaded."""
    return {
        f"{module}.{name}": len(value.signatures)
        for module in sorted(sys.modules)
        if module.startswith(("phasewire.solver", "phasewire.protocol"))
        for name, value in vars(sys.modules[module]).items()
        if isinstance(getattr(value, "signatures", None), list)
    }


@pytest.mark.slow
@in_each_way
def test_nothing_is_compiled_while_hands_are_played(render: str) -> None:
    """The outputs would be silent meanwhile: the first time on a machine that takes seconds."""
    with open_device("emulator:") as device, open_hands("gesture:sweep?rate=50", device.time) as hands:
        loop = TouchLoop(device, hands, [Mesh.cube()], Toucher(), ARRAY, render=render)
        loop.warm_up()
        before = variants()
        report = loop.run(4)
    assert 0 < report.touching < report.frames, "hands come and go"
    assert variants() == before
    assert before["phasewire.solver.contact.feeling.feel"], "what is compiled is counted"
