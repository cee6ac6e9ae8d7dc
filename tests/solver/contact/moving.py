"""Hands that move as recorded ones do, with a tracker's noise; and how steady the control points on them are.

``python -m tests.solver.contact.moving`` prints the table of all motions. No recording is needed: motions are sums of
slow waves of random phase, noise is low-passed, and frames come at uneven times.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
import trimesh
from numpy.typing import NDArray
from phasewire import Hand, Mesh, Toucher
from phasewire.solver import Touch

Floats = NDArray[np.float64]

MOTIONS = ("sweep", "flex", "explore", "tremble")
RATES = (100, 200)
SHORT_SECONDS = 0.02
SETTLING_SECONDS = 0.5
SAME_PLACE = 4e-3
"""Distance in metres within which a new point replaces one that ended, and an arc was there a frame before."""
NOISE_SECONDS = 0.016
"""Time constant of a tracker's low-passed error: 10 Hz."""


class Frame(NamedTuple):
    """A hand at a moment in seconds."""

    time: float
    hand: Hand


def objects() -> dict[str, Mesh]:
    """A smooth object, one with corners, and a mesh of 1280 faces that is neither."""
    made = trimesh.creation.icosphere(subdivisions=3, radius=0.045)
    waves = 1 + 0.2 * np.sin(90 * made.vertices).prod(axis=1, keepdims=True)
    return {
        "sphere": Mesh.sphere(),
        "cube": Mesh.cube(),
        "mesh": Mesh.of(made.vertices * waves, made.faces).moved((0, 0, 0.17)),
    }


def moving_hand(motion: str, rate: float, seconds: float, seed: int, noise: float = 0.4e-3) -> Iterator[Frame]:
    """A hand about the middle of the paper's objects.

    Parameters
    ----------
    motion : str
        "sweep", to and fro through the object; "flex", fingers that bend in it; "explore", both, and turns; "tremble",
        a hand at rest.
    rate : float
        Frames a second.
    noise : float
        The noise of each landmark and coordinate, rms in metres.
    """
    rng = np.random.default_rng((MOTIONS.index(motion), seed))
    base = (
        Hand.flat((0, 0, 0)).rotated(rng.uniform(0, 360), (0, 0, 1)).rotated(rng.uniform(-40, 40), rng.normal(size=3))
    )
    turn = np.linalg.lstsq(Hand.flat((0, 0, 0)).landmarks, base.landmarks, rcond=None)[0]
    middle = np.array([0, 0, 0.17]) + rng.uniform(-0.02, 0.02, 3)
    bent, phases = rng.uniform(0.1, 0.4), rng.uniform(0, 2 * np.pi, 16)
    axis, error = rng.normal(size=3), rng.normal(size=(21, 3)) * noise
    way = rng.normal(size=3)
    way /= np.linalg.norm(way)
    last = -1.0
    for k in range(round(seconds * rate)):
        time = (k + rng.uniform(-0.2, 0.2)) / rate
        keep = np.exp(-(time - last) / NOISE_SECONDS)
        error = keep * error + np.sqrt(1 - keep**2) * noise * rng.normal(size=(21, 3))
        last = time
        curl, place, degrees = np.full(5, bent), middle, 0.0
        if motion in ("flex", "explore"):
            curl = bent + 0.1 * np.sin(2 * np.pi * 0.7 * time + phases[:5]) + 0.05 * np.sin(9 * time + phases[5:10])
        if motion == "flex":
            place = middle - 0.1 * turn[1]
        if motion == "sweep":
            place = middle + way * 0.06 * np.sin(2 * np.pi * 0.5 * time + phases[10])
        if motion == "explore":
            place = middle + 0.03 * np.sin(np.array([2.1, 2.9, 1.7]) * time + phases[11:14])
            degrees = 15 * np.sin(2.3 * time + phases[14])
        hand = Hand.flat((0, 0, 0), curl=np.clip(curl, 0, 1)).rotated(degrees, axis)
        yield Frame(k / rate, Hand(hand.landmarks @ turn + place + error, "right"))


@dataclass(frozen=True)
class Steadiness:
    """How steady the points of some frames are. Lengths are in mm, counts in events a second."""

    points: float
    """Mean number."""
    changed: float
    """Share of pairs of frames in which the number of points changes."""
    births: float
    short: float
    """Lives of less than 20 ms that begin and end on arcs that are there a frame before and after."""
    replaced: float
    """New points within 4 mm of one that ended in the same frame."""
    jump: float
    """Motion of a surviving point from frame to frame: the median."""
    jump_95: float
    bare_95: float
    """From a place on an arc to the nearest point: 95 % are less."""
    close_5: float
    """From a point to its nearest neighbour: 95 % are more."""


class Life(NamedTuple):
    """A point from its first frame to its last."""

    first: int
    last: int


def measured(frames: list[tuple[float, Touch]]) -> Steadiness:
    """How steady the points are after `SETTLING_SECONDS`; each frame is its time and its touch."""
    begin = next(i for i, (time, _) in enumerate(frames) if time >= SETTLING_SECONDS)
    seconds = frames[-1][0] - frames[begin][0]
    places = [
        dict(zip(felt.ids.tolist(), felt.points.positions, strict=True)) if felt.points else {} for _, felt in frames
    ]
    lives: dict[int, Life] = {}
    jumps, bare, close = [], [], []
    births = replaced = changed = 0
    for i, here in enumerate(places):
        for identity in here:
            lives[identity] = Life(lives[identity].first if identity in lives else i, i)
        if i <= begin:
            continue
        before = places[i - 1]
        jumps += [float(np.linalg.norm(here[k] - before[k])) for k in here.keys() & before.keys()]
        born, ended = [here[k] for k in here.keys() - before.keys()], [before[k] for k in before.keys() - here.keys()]
        births += len(born)
        changed += len(here) != len(before)
        for place in born:
            apart = [float(np.linalg.norm(place - other)) for other in ended]
            if apart and min(apart) < SAME_PLACE:
                replaced += 1
                del ended[int(np.argmin(apart))]
        if i % 5 == 0 and here:
            at = np.array(list(here.values()))
            bare += [np.linalg.norm(_along(arc)[:, None] - at, axis=2).min(axis=1) for arc in frames[i][1].arcs]
            if len(at) > 1:
                close.append(np.partition(np.linalg.norm(at[:, None] - at, axis=2), 1, axis=1)[:, 1])
    short = sum(
        begin < life.first
        and life.last + 1 < len(frames)
        and frames[life.last][0] - frames[life.first][0] < SHORT_SECONDS - 1e-9
        and _there(frames[life.first - 1][1], places[life.first][identity])
        and _there(frames[life.last + 1][1], places[life.last][identity])
        for identity, life in lives.items()
    )
    return Steadiness(
        float(np.mean([len(here) for here in places[begin:]])),
        changed / (len(frames) - begin - 1),
        births / seconds,
        short / seconds,
        replaced / seconds,
        float(np.median(jumps or [0])) * 1e3,
        float(np.quantile(jumps or [0], 0.95)) * 1e3,
        float(np.quantile(np.concatenate(bare or [np.zeros(1)]), 0.95)) * 1e3,
        float(np.quantile(np.concatenate(close or [np.zeros(1)]), 0.05)) * 1e3,
    )


def _along(arc: Floats) -> Floats:
    """Places on a polyline, 1 mm apart."""
    reached = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(arc, axis=0), axis=1))])
    at = np.arange(0, reached[-1], 1e-3)
    return np.stack([np.interp(at, reached, arc[:, axis]) for axis in range(3)], axis=1)


def _there(felt: Touch, place: Floats) -> bool:
    """Whether an arc passes a place."""
    return any(len(at := _along(arc)) and np.linalg.norm(at - place, axis=1).min() < SAME_PLACE for arc in felt.arcs)


def felt_by(motion: str, mesh: Mesh, rate: float, seconds: float, seed: int, noise: float = 0.4e-3) -> Steadiness:
    """How steady the points on a moving hand are."""
    toucher = Toucher()
    hands = moving_hand(motion, rate, seconds, seed, noise)
    return measured([(frame.time, toucher.touch(frame.hand, mesh, frame.time)) for frame in hands])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=4.0, help="of each motion")
    parser.add_argument("--seeds", type=int, default=4, help="hands of each motion")
    arguments = parser.parse_args()
    names = [field.name for field in fields(Steadiness)]
    print(f"{'':26}" + "".join(f"{name:>10}" for name in names))
    for motion in MOTIONS:
        noise = 0.2e-3 if motion == "tremble" else 0.4e-3
        for name, mesh in objects().items():
            for rate in RATES:
                some = [felt_by(motion, mesh, rate, arguments.seconds, i, noise) for i in range(arguments.seeds)]
                means = [float(np.mean([getattr(one, each) for one in some])) for each in names]
                print(f"{motion:9}{name:8}{rate:5}/s   " + "".join(f"{mean:10.2f}" for mean in means), flush=True)


if __name__ == "__main__":
    main()
