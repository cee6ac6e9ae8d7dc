"""The entry of autd3 with its hologram package: naive, GS, GS-PAT and greedy, and its emulator's field.

It runs in the environment of ``autd3.txt`` and may not import phasewire. A hologram is a plain function of a geometry,
so that no device and no link takes part.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import autd3_pattern_holo as holo
import numpy as np
from autd3 import Duration
from autd3.commands import Pattern, SetSilencer
from autd3.geometry import Autd3, Geometry
from autd3.units import Velocity
from autd3_emulator import Emulator, Grid, RmsRecordOption
from autd3_pattern import TransducerMask, wavelength
from contest import SAME_ITERATIONS, Contestant, Entry, Field, Task, main
from numpy.typing import NDArray

MM = 1e3
STEPS = 256  # of a phase; the largest intensity is one less
PERIOD = Duration.from_micros(25)
STRENGTH = 4.386  # Pa·m (peak) of one of its transducers, measured in its own emulator; only the target depends on it


def position(devices: Geometry) -> NDArray[np.float64]:
    """All transducers (n, 3) in its own coordinates, in metres."""
    return np.concatenate([np.asarray(device.positions(), dtype=np.float64) for device in devices]) / MM


class Stage:
    """Two devices, one above the other; as many of their transducers are used as the task has.

    Those nearest to the line between the devices are used, and the origin is put in their middle.
    """

    def __init__(self, task: Task) -> None:
        self.geometry = Geometry([Autd3(origin=[0, 0, 0]), Autd3(origin=[0, Autd3.DEVICE_HEIGHT, 0])])
        self.sound_speed = Velocity.from_m_s(task.wavelength * task.frequency)
        self.wavelength = wavelength(self.sound_speed)
        everywhere = position(self.geometry)
        off_middle = np.abs(everywhere[:, 1] - everywhere[:, 1].mean())
        self.used = np.zeros(len(everywhere), dtype=bool)
        self.used[np.argsort(off_middle, kind="stable")[: len(task.array)]] = True
        self.origin = everywhere[self.used].mean(axis=0)
        self.array = everywhere[self.used] - self.origin
        self.mask = TransducerMask.masked(self.used.reshape(len(self.geometry), -1).tolist())
        self.phases, self.intensities = self.geometry.phase_buffer(), self.geometry.intensity_buffer()

    def foci(self, points: NDArray[np.float64]) -> list[Any]:
        """Control points in its own type, each to get its equal share of the power of all transducers."""
        distance = np.linalg.norm(points[:, None] - self.array, axis=2)
        target = STRENGTH * float((1 / distance).sum(axis=1).mean()) / math.sqrt(len(points))
        return [holo.AmplitudeTarget(point, target * holo.Pa) for point in (points + self.origin) * MM]

    def drive(self, _: Any) -> NDArray[np.complex128]:
        """The drives of the transducers in use, from the bytes in the buffers."""
        phases, intensities = self.phases.to_numpy().ravel(), self.intensities.to_numpy().ravel()
        drive = intensities / (STEPS - 1) * np.exp(2j * np.pi * phases / STEPS)
        return np.asarray(drive[self.used])


def iterative(stage: Stage, name: str, iterations: str, solve: Any, option: Any) -> Contestant:
    """A solver that finds phases and intensities."""

    def prepare(points: NDArray[np.float64]) -> Callable[[], Any]:
        foci = stage.foci(points)
        return lambda: solve(stage.geometry, foci, stage.wavelength, option, stage.phases, stage.intensities)

    return Contestant(f"autd3 {name}", iterations, prepare, stage.drive)


def greedy(stage: Stage) -> Contestant:
    """The solver that finds phases only, in 16 steps, with every transducer at full drive."""
    option = holo.GreedyOption(mask=stage.mask)

    def prepare(points: NDArray[np.float64]) -> Callable[[], Any]:
        foci = stage.foci(points)
        stage.intensities.copy_from(np.full((len(stage.geometry), Autd3.NUM_TRANSDUCERS), STEPS - 1, dtype=np.uint8))
        return lambda: holo.greedy(stage.geometry, foci, stage.wavelength, stage.intensities, option, stage.phases)

    return Contestant("autd3 greedy", "-", prepare, stage.drive)


def field(stage: Stage, task: Task) -> Field:
    """The emulator's RMS pressure over the plane, of all transducers of both devices."""
    phases, intensities = stage.geometry.phase_buffer(), stage.geometry.intensity_buffer()
    intensities.copy_from(np.full((len(stage.geometry), Autd3.NUM_TRANSDUCERS), STEPS - 1, dtype=np.uint8))

    def emit(recorder: Any) -> None:
        recorder.send(SetSilencer.disable())
        recorder.send(Pattern(phases, intensities))
        recorder.tick(PERIOD)

    record = Emulator(stage.geometry).record(emit)
    low, high = ((task.plane[at, at] + stage.origin) * MM for at in (0, -1))
    step = (high[0] - low[0]) / (task.plane.shape[1] - 1)
    grid = Grid((low[0], high[0]), (low[1], high[1]), float(low[2]), step, "xyz")
    option = RmsRecordOption(sound_speed=stage.sound_speed)
    return Field("autd3 emulator, RMS", record.num_transducers(), lambda: record.sound_field(grid, option).next(PERIOD))


def enter(task: Task) -> Entry:
    """Four solvers, two of them in several settings, and the field by the emulator."""
    stage = Stage(task)
    own = {"mask": stage.mask, "parallel": False}
    same, mark = {"repeat": SAME_ITERATIONS, **own}, str(SAME_ITERATIONS)
    normalised = holo.GspatOption(constraint=holo.IntensityConstraint.Normalize, **own)
    directive = holo.GspatOption(
        constraint=holo.IntensityConstraint.Normalize, directivity=holo.Directivity.T4010A1, **own
    )
    default = holo.GspatOption().repeat
    contestants = [
        iterative(stage, "naive", "-", holo.naive, holo.NaiveOption(**own)),
        iterative(stage, "GS", f"{holo.GsOption().repeat}*", holo.gs, holo.GsOption(**own)),
        iterative(stage, "GS", mark, holo.gs, holo.GsOption(**same)),
        iterative(stage, "GS-PAT", f"{default}*", holo.gspat, holo.GspatOption(**own)),
        iterative(stage, "GS-PAT", mark, holo.gspat, holo.GspatOption(**same)),
        iterative(stage, "GS-PAT normalised", f"{default}*", holo.gspat, normalised),
        iterative(stage, "GS-PAT normalised, directive", f"{default}*", holo.gspat, directive),
        greedy(stage),
    ]
    width, height = np.ptp(stage.array[:, :2], axis=0) * MM
    return Entry(
        stage.array,
        contestants,
        [field(stage, task)],
        [
            f"Its devices are fixed, {Autd3.NUM_TRANSDUCERS} transducers at {Autd3.PITCH_MM:.2f} mm: these are "
            f"{len(stage.array)} transducers of two devices, {width:.0f} × {height:.0f} mm with a gap of "
            f"{Autd3.DEVICE_HEIGHT - Autd3.GRID_Y * Autd3.PITCH_MM:.1f} mm between the devices, by its mask.",
            "A call takes a list of foci to phases and intensities of 8 bits each: the native function that computes "
            "the pattern, with transfer matrix and quantisation, without device or link. Its model is that of point "
            "sources, its default; for `directive` it uses its own transducer's directivity.",
            "The wanted pressure at a point is its equal share of the power, and its default constraint clips what "
            "exceeds full drive; `normalised` scales the strongest transducer to full drive instead.",
            "Greedy finds other drives in each call.",
            f"The field is that of all {len(stage.used)} transducers, as RMS values in single precision; a call "
            "contains the placing of the points and the making of a table.",
        ],
    )


if __name__ == "__main__":
    main(enter)
