"""Checks of a source of hands: how often it gives them, how late, and whether they can be hands above the array."""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import islice, pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.errors import TrackerError
from ...solver.contact.anatomy import NEUTRAL
from ..hands.frames import HandFrame, TrackedHand
from ..hands.liveness import Liveness, Stale
from ..hands.sources import HandSource
from ..transports.transport import Timekeeper
from .findings import Finding, Judgement, fail, listed, ok, skipped, warn

__all__ = ["TRACKER_CHECKS", "Watched", "examine_tracker", "watch"]

AT_A_TIME = 0.1
"""Seconds for which a frame is waited for, until it is seen whether the source has ended."""
MOST_FRAMES = 100_000
USABLE_RATE, GOOD_RATE = 20.0, 60.0
"""Frames per second: from one to the next a hand at 0.5 m/s moves by 25 mm, and by 8 mm."""
LONGEST_GAP = 0.05
"""Seconds without a new frame, after which touch is silent."""
STALL = 1.0
"""Seconds without a new frame, after which a tracker has stopped."""
MOST_MISSING, FEW_MISSING = 0.2, 0.01
"""Of all frames."""
SOON = 0.03
"""Seconds in which a frame should be here."""
MOSTLY = 0.5
"""Of all frames."""
RENUMBERED = 1000
"""A gap of so many frames in their numbers is a tracker that counts anew."""
SMALLEST, LARGEST = 0.75, 1.3
"""Of palms of grown-up people, as parts of the mean one's."""
BESIDE, NEAREST, FARTHEST = 0.15, 0.05, 0.45
"""Metres from the array's axis, and above the array, where foci are strong enough to be felt."""
HELD = (0.0, 0.0, 0.17)
"""Where a hand would be held, in the array's coordinates, in metres."""
PALM_ENDS = (0, 9)
"""Landmarks: the wrist, and the knuckle of the middle finger."""
_NUMBER = re.compile(r"-?\d+(\.\d+)?(e[+-]\d+)?")

NO_ACCIDENT = "this is in most frames, so it is no accident: see that the source gives what is documented for it"
POSE = "say in a pose file where the tracker is, and give it with --pose; docs/how-to/hands.md describes it"


class FrameLatency(NamedTuple):
    """Of frames, in seconds."""

    median: float
    p99: float
    worst: float


@dataclass(frozen=True)
class Watched:
    """What a source gave for some time.

    Parameters
    ----------
    frames : tuple of HandFrame
        The frames in the array's coordinates.
    arrivals : tuple of float
        When each came, in seconds of the clock that the frames' times are by.
    seconds : float
        How long it was watched, or how much of it was read.
    live : bool
        Whether its frames came by themselves.
    idle : float
        How many of these passed after the last frame of a live source.
    notes : tuple of str
        What is wrong with the source as a whole.
    lost : TrackerError or None
        What ended it.
    stale : mapping
        How many further frames of a live source were no news, by the reason.
    """

    frames: tuple[HandFrame, ...]
    arrivals: tuple[float, ...]
    seconds: float
    live: bool
    idle: float = 0.0
    notes: tuple[str, ...] = ()
    lost: TrackerError | None = None
    stale: Mapping[Stale, int] = field(default_factory=dict)

    @cached_property
    def rate(self) -> float | None:
        """Frames per second; None if there are too few to tell."""
        lasted = self.frames[-1].time - self.frames[0].time if self.frames else 0.0
        return (len(self.frames) - 1) / lasted if lasted > 0 else None

    @cached_property
    def longest_gap(self) -> float:
        """Seconds between two frames, at most, or from the last one on."""
        return max(self.idle, *(after.time - before.time for before, after in pairwise(self.frames)), 0.0)

    @cached_property
    def missing(self) -> int:
        """Frames that the tracker has counted and that did not come."""
        steps = (after.number - before.number - 1 for before, after in pairwise(self.frames))
        return sum(step for step in steps if 0 < step < RENUMBERED)

    @cached_property
    def latency(self) -> FrameLatency | None:
        """From the moment at which each frame was seen until it came; None if none did, or they are only played."""
        if not self.frames or not self.live:
            return None
        seconds = np.array(self.arrivals) - [frame.time for frame in self.frames]
        return FrameLatency(*np.percentile(seconds, [50, 99, 100]).tolist())

    @cached_property
    def hands(self) -> tuple[TrackedHand, ...]:
        """All hands of all frames."""
        return tuple(hand for frame in self.frames for hand in frame.hands)

    @cached_property
    def centres(self) -> NDArray[np.float64]:
        """(k, 3) the middle of the palm of each hand, in metres."""
        return np.array([each.hand.centre for each in self.hands]).reshape(-1, 3)

    @cached_property
    def palm(self) -> float:
        """Length of the palms as a part of the mean hand's, the median of all."""
        wrist, knuckle = PALM_ENDS
        spans = [each.hand.landmarks[knuckle] - each.hand.landmarks[wrist] for each in self.hands]
        return float(np.median(np.linalg.norm(spans, axis=1)) / np.linalg.norm(NEUTRAL[knuckle] - NEUTRAL[wrist]))

    @cached_property
    def complaints(self) -> list[tuple[str, int]]:
        """What was wrong with hands, and how often, the most frequent first; of notes that differ by numbers one."""
        notes: dict[str, list[str]] = {}
        for frame in self.frames:
            for note in frame.notes:
                notes.setdefault(_NUMBER.sub("#", note), []).append(note)
        return sorted(((same[0], len(same)) for same in notes.values()), key=lambda each: -each[1])


def watch(
    source: HandSource,
    seconds: float,
    on_frame: Callable[[HandFrame], None] = lambda _: None,
    clock: Timekeeper = time,
) -> Watched:
    """Take what a source gives for some time, or until it ends. What is only played is read at once.

    Parameters
    ----------
    source : HandSource
        It stays open.
    seconds : float
        How long to watch.
    on_frame : callable
        Gets each frame that is news.
    clock : Timekeeper
        The clock by which a live source gives its frames.
    """
    frames: list[HandFrame] = []
    arrivals: list[float] = []
    liveness, stale = Liveness(), Counter[Stale]()
    lost = None
    begun = clock.monotonic()
    try:
        for frame in _due(source, seconds, clock) if source.live else _played(source, seconds):
            now = clock.monotonic()
            if source.live and (why := liveness.stale(frame, now)) is not None:
                stale[why] += 1
                continue
            arrivals.append(now)
            frames.append(frame)
            on_frame(frame)
    except TrackerError as error:
        lost = error
    if not source.live:
        lasted, idle = (frames[-1].time - frames[0].time if frames else 0.0), 0.0
    else:
        lasted = clock.monotonic() - begun
        idle = begun + lasted - arrivals[-1] if arrivals else lasted
    return Watched(tuple(frames), tuple(arrivals), lasted, source.live, idle, source.notes, lost, stale)


def _due(source: HandSource, seconds: float, clock: Timekeeper) -> Iterator[HandFrame]:
    """The frames of a live source as they come."""
    end = clock.monotonic() + seconds
    while not source.ended and (left := end - clock.monotonic()) > 0:
        if (frame := source.next_frame(min(left, AT_A_TIME))) is not None:
            yield frame


def _played(source: HandSource, seconds: float) -> Iterator[HandFrame]:
    """The frames of a recording up to a time."""
    first = None
    for frame in islice(source, MOST_FRAMES):
        first = frame.time if first is None else first
        if frame.time - first > seconds:
            return
        yield frame


def examine_tracker(watched: Watched) -> Iterator[Finding]:
    """The findings of every check, in the order of `TRACKER_CHECKS`."""
    return (Finding(name, *check(watched)) for name, check in TRACKER_CHECKS.items())


def _source(watched: Watched) -> Judgement:
    if watched.lost is not None:
        return fail(f"lost after {watched.seconds:.1f} s: {watched.lost}", "start it again; look at its cable")
    if watched.notes:
        return warn("; ".join(watched.notes), "see to that first")
    return ok(f"watched for {watched.seconds:.1f} s")


def _news(watched: Watched) -> Judgement:
    if not watched.live:
        return skipped("the source is played, not seen")
    stale = sum(watched.stale.values())
    total = stale + len(watched.frames)
    if not stale:
        return ok("each frame was news")
    seen = f"{stale} of {total} frames were no news: {listed(f'{count} {why}' for why, count in watched.stale.items())}"
    advice = "touch does not play such frames: start the tracker's software again, and close what delays it"
    return fail(seen, advice) if stale > MOST_MISSING * total else warn(seen, advice)


def _rate(watched: Watched) -> Judgement:
    if watched.live and (watched.rate is None or watched.longest_gap > STALL):
        return fail(
            f"{len(watched.frames)} frames came in {watched.seconds:.1f} s, and none for {watched.longest_gap:.1f} s",
            "plug the tracker in again; in its control panel, resume tracking, and allow web and background apps",
        )
    if watched.rate is None:
        return fail("there are too few frames", "record it anew, with every frame of the tracker")
    seen = f"{watched.rate:.0f} frames/s, {watched.longest_gap * 1e3:.0f} ms apart at most"
    advice = (
        "use a port of USB 3, close what else keeps this computer busy, and turn off power saving and low-resource "
        "modes in the tracker's control panel; a camera needs more light"
    )
    if not watched.live:
        advice = "record it anew, with every frame of the tracker"
    if watched.rate < USABLE_RATE:
        return fail(f"{seen}: too few to feel a shape", advice)
    if watched.longest_gap > LONGEST_GAP:
        return warn(f"{seen}; touch is silent after {LONGEST_GAP * 1e3:.0f} ms without one", advice)
    return ok(seen) if watched.rate >= GOOD_RATE else warn(f"{seen}; {GOOD_RATE:.0f} would be smooth", advice)


def _drops(watched: Watched) -> Judgement:
    if len(watched.frames) < 2:
        return skipped("too few frames came")
    part = watched.missing / (watched.missing + len(watched.frames))
    seen = f"{watched.missing} of {watched.missing + len(watched.frames)} frames did not come"
    advice = "close what else keeps this computer or its USB busy"
    if not watched.live:
        advice = "they are not in the recording: some recorders leave frames out"
    if part > MOST_MISSING:
        return fail(seen, advice) if watched.live else warn(seen, advice)
    return warn(seen, advice) if part > FEW_MISSING else ok(seen)


def _latency(watched: Watched) -> Judgement:
    if watched.latency is None:
        return skipped("no frame came" if watched.live else "the source is played, not seen")
    median, late, worst = (f"{seconds * 1e3:.1f} ms" for seconds in watched.latency)
    seen = f"{median} median, {late} for 99 %, {worst} worst, beyond what every frame needs"
    if watched.latency.p99 > SOON:
        return warn(seen, "close what else keeps this computer busy; a tracker on another computer needs a cable")
    return ok(seen)


def _hands(watched: Watched) -> Judgement:
    if not watched.frames:
        return skipped("no frame came")
    part = sum(bool(frame.hands) for frame in watched.frames) / len(watched.frames)
    advice = "hold an open hand over the tracker, 10 to 40 cm away; clean its window; keep sunlight and hot lamps away"
    if not watched.hands and watched.complaints:
        return fail(f"no hand could be used; {watched.complaints[0][0]}", NO_ACCIDENT)
    if not watched.hands:
        return fail("no hand was in view", advice)
    sides = Counter(each.hand.side for each in watched.hands)
    most = max(len(frame.hands) for frame in watched.frames)
    numbers = len({each.id for each in watched.hands})
    seen = (
        f"in view in {part:.0%} of the frames, {most} at a time, "
        f"{' and '.join(f'{side} in {count}' for side, count in sorted(sides.items()))}, "
        f"{numbers} id{'s' * (numbers > 1)}"
    )
    return ok(seen) if part >= MOSTLY else warn(seen, advice)


def _size(watched: Watched) -> Judgement:
    if not watched.hands:
        return skipped("no hand was in view")
    length = watched.palm * float(np.linalg.norm(NEUTRAL[PALM_ENDS[1]] - NEUTRAL[PALM_ENDS[0]]))
    seen = f"palms of {length * 1e3:.0f} mm, {watched.palm:.2f} of the mean hand's"
    if not SMALLEST <= watched.palm <= LARGEST:
        return warn(seen, f"if that is not the hand's size, correct the scale in a pose file: {1 / watched.palm:.2f}")
    return ok(seen)


def _place(watched: Watched) -> Judgement:
    if not watched.hands:
        return skipped("no hand was in view")
    beside, above = np.linalg.norm(watched.centres[:, :2], axis=1), watched.centres[:, 2]
    inside = float(((beside <= BESIDE) & (above >= NEAREST) & (above <= FARTHEST)).mean())
    middle = np.median(watched.centres, axis=0)
    seen = f"palms at {_place_of(middle)}, {inside:.0%} of them where they can feel something"
    if inside >= MOSTLY:
        return ok(seen)
    away = np.array(HELD) - middle
    advice = (
        f"{POSE}; if the hand was held {HELD[2] * 1e3:.0f} mm above the array's middle, move it by {_place_of(away)}"
    )
    return warn(seen, advice) if inside > 0 else fail(seen, advice)


def _place_of(point: NDArray[np.float64]) -> str:
    return "({:.0f}, {:.0f}, {:.0f}) mm".format(*(point * 1e3).tolist())


def _repairs(watched: Watched) -> Judgement:
    if not watched.complaints:
        return ok("nothing was wrong with the hands")
    said = listed(f"{text} ({count} × in {len(watched.frames)} frames)" for text, count in watched.complaints)
    if watched.complaints[0][1] > MOSTLY * len(watched.frames):
        return warn(said, NO_ACCIDENT)
    return warn(said, "one now and then does no harm; keep the hand open, and in the middle of what the tracker sees")


TRACKER_CHECKS: Mapping[str, Callable[[Watched], Judgement]] = {
    "source": _source,
    "news": _news,
    "rate": _rate,
    "drops": _drops,
    "latency": _latency,
    "hands": _hands,
    "size": _size,
    "place": _place,
    "repairs": _repairs,
}
"""The checks by name, in their order."""
