"""The end-to-end check: a solution goes to an emulated device, and the played outputs are compared with it.

The judge takes from the emulator only the captured bits and the wiring. The emitted drive follows from the edges of the
bits, and the best possible pulse from trying every pulse in the closed form (2/π)·sin(πw/50).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...emulator import Capture, Emulator
from ...host import open_device
from ...protocol.board import (
    CHANNELS_PER_PROCESSOR,
    HALF_TICKS_PER_PERIOD,
    MAX_WIDTH_TICKS,
    PROCESSORS,
    TICKS_PER_PERIOD,
)
from ...protocol.pulses import Pulses
from ...protocol.replies import Ack
from ...protocol.wiring import Wiring
from ...solver import PlaneField, Solution, TransducerArray, pressure, sample_plane, transfer_matrix

__all__ = ["Check", "CheckedRun", "EndToEnd", "emission", "emission_checks", "nearest_emission", "run_end_to_end"]

PERIODS_WATCHED = 4
NUMERICAL = 1e-9  # of full drive: double precision over the whole path loses less than a millionth of this bound


@dataclass(frozen=True)
class Check:
    """A requirement: a measured value and its upper bound."""

    name: str
    value: float
    limit: float
    unit: str

    @property
    def passed(self) -> bool:
        """Whether it is met."""
        return self.value <= self.limit


class CheckedRun(ABC):
    """What was intended, what was played, and the difference."""

    @abstractmethod
    def checks(self) -> list[Check]:
        """All requirements; the verdict is good if all are met."""

    @property
    def passed(self) -> bool:
        """The verdict."""
        return all(check.passed for check in self.checks())


@dataclass(frozen=True, eq=False)
class EndToEnd(CheckedRun):
    """What was intended, what was played, and the difference.

    Parameters
    ----------
    solution : Solution
        The intended drive and its control points.
    ack : Ack
        The device's answer.
    capture : Capture
        Its outputs.
    """

    solution: Solution
    ack: Ack
    capture: Capture

    def __repr__(self) -> str:
        return f"EndToEnd({self.solution}, {self.capture})"

    @property
    def latch_ticks(self) -> list[int]:
        """Tick at which each of the ten processors began to play."""
        return [latches[-1] if latches else 0 for latches in self.capture.latches]

    @cached_property
    def rebuilt(self) -> NDArray[np.complex128]:
        """The drive as emitted, (n,) complex, from the captured bits of the last whole period."""
        last = self.capture.periods * TICKS_PER_PERIOD
        return emission(self.capture.bits(last - TICKS_PER_PERIOD, last), self.capture.wiring)

    @cached_property
    def nearest(self) -> NDArray[np.complex128]:
        """The best result of any pulses, (n,) complex: what quantisation alone explains."""
        return nearest_emission(self.solution.drive)

    def field(self, height: float) -> PlaneField:
        """The field of the drive as emitted, over a plane at a height in metres."""
        return sample_plane(self.solution.array, self.rebuilt, height, medium=self.solution.medium)

    def pressures(self, drive: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Pressure at the control points, (m,) complex in Pa."""
        return pressure(self.solution.array, drive, self.solution.points.positions, self.solution.medium)

    def differences(self) -> list[dict[str, Any]]:
        """Largest differences from the intended drive: as rebuilt, and as quantisation alone explains them."""
        intended, at_points = self.solution.drive, self.pressures(self.solution.drive)
        strongest = np.abs(at_points).max()

        def errors(emitted: NDArray[np.complex128]) -> list[float]:
            return [
                float(np.abs(emitted - intended).max()),
                _phase_error(emitted, intended),
                float(np.abs(np.abs(emitted) - np.abs(intended)).max()),
                float(np.abs(self.pressures(emitted) - at_points).max() / strongest * 100),
            ]

        labels = [
            ("drive, complex", "of full drive"),
            ("phase", "degrees"),
            ("amplitude", "of full drive"),
            ("pressure at the points", "% of strongest"),
        ]
        return [
            {"what": what, "unit": unit, "rebuilt": rebuilt, "quantisation": explained}
            for (what, unit), rebuilt, explained in zip(labels, errors(self.rebuilt), errors(self.nearest), strict=True)
        ]

    def checks(self) -> list[Check]:
        """All requirements; the verdict is good if all are met."""
        boundary = self.ack.commit_period * TICKS_PER_PERIOD
        before = self.capture.bits(max(0, boundary - TICKS_PER_PERIOD), boundary)
        return [
            Check(
                "processors off their tick",
                sum(tick != boundary for tick in self.latch_ticks),
                0,
                f"of {PROCESSORS}",
            ),
            Check("outputs high before that tick", int(np.bitwise_count(before).sum()), 0, "bits"),
            *emission_checks(self.solution, self.rebuilt, self.nearest),
        ]

    def record(self) -> dict[str, Any]:
        """Everything as numbers, for JSON."""
        intended, rebuilt = self.pressures(self.solution.drive), self.pressures(self.rebuilt)
        return {
            "verdict": "pass" if self.passed else "fail",
            "checks": [vars(check) | {"passed": check.passed} for check in self.checks()],
            "differences": self.differences(),
            "control_points_m": self.solution.points.positions.tolist(),
            "intended_pressure_pa": np.abs(intended).tolist(),
            "rebuilt_pressure_pa": np.abs(rebuilt).tolist(),
            "commit_period": self.ack.commit_period,
            "latch_ticks": self.latch_ticks,
            "captured_periods": self.capture.periods,
        }


def emission_checks(
    solution: Solution,
    rebuilt: NDArray[np.complex128],
    nearest: NDArray[np.complex128],
    built: TransducerArray | None = None,
) -> list[Check]:
    """The requirements on what was emitted, and on what arrives.

    They compare the intended drive with the drive as emitted and with what quantisation alone explains, both (n,)
    complex; `built` is where the transducers really are, if it is not where the solution has them.
    """
    intended = solution.drive
    explained = np.abs(nearest - intended)
    points, medium = solution.points.positions, solution.medium
    at_points = pressure(solution.array, intended, points, medium)
    error = np.abs(pressure(solution.array if built is None else built, rebuilt, points, medium) - at_points)
    allowed = np.abs(transfer_matrix(solution.array, points, medium)) @ (explained + NUMERICAL)
    worst = int((error / allowed).argmax())
    percent = 100 / np.abs(at_points).max()
    return [
        Check(
            "drive error beyond quantisation",
            float((np.abs(rebuilt - intended) - explained).max()),
            NUMERICAL,
            "of full drive",
        ),
        # If every drive is right the pressure must be within this, however the errors of quantisation add up.
        Check(
            "pressure error, worst point",
            float(error[worst] * percent),
            float(allowed[worst] * percent),
            "% of strongest",
        ),
    ]


def emission(bits: NDArray[np.uint32], wiring: Wiring) -> NDArray[np.complex128]:
    """The drive emitted by one carrier period of bits, from the edges of its square waves.

    Parameters
    ----------
    bits : (50, 10) uint32
        Port words of the ten processors.
    wiring : Wiring
        How the transducers are connected.

    Returns
    -------
    (320,) complex
        In array order. A wave that is high from tick r to tick f has the fundamental (2/T)·∫ e^{iωt} dt =
        (e^{iωf} − e^{iωr})/(iπ); in units of the widest pulse's 2/π each edge counts ±e^{iωt}/(2i).
    """
    processor, bit = np.divmod(wiring.channels, CHANNELS_PER_PROCESSOR)
    levels = (bits[:, processor] >> bit.astype(np.uint32) & 1).astype(np.int64)
    rises = levels - np.roll(levels, 1, axis=0)
    turn = np.exp(2j * np.pi * np.arange(TICKS_PER_PERIOD) / TICKS_PER_PERIOD)
    return np.asarray(-(turn @ rises) / 2j)


def nearest_emission(drive: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """For each drive the nearest one that a pulse of whole ticks can emit, by trying all of them.

    Parameters
    ----------
    drive : (n,) complex
        1 is full drive.

    Returns
    -------
    (n,) complex
        Emitted drives: sin(πw/50)·e^{2πi·c/100} for a pulse of w ticks centred at half tick c. A pulse that begins and
        ends on ticks has c even if w is even, and odd if w is odd.
    """
    width, centre = np.meshgrid(np.arange(MAX_WIDTH_TICKS + 1), np.arange(HALF_TICKS_PER_PERIOD), indexing="ij")
    possible = (centre - width) % 2 == 0
    emitted = np.sin(np.pi * width[possible] / TICKS_PER_PERIOD)
    phasors = emitted * np.exp(2j * np.pi * centre[possible] / HALF_TICKS_PER_PERIOD)
    return np.asarray(phasors[np.abs(drive[:, None] - phasors).argmin(axis=1)])


def _phase_error(emitted: NDArray[np.complex128], intended: NDArray[np.complex128]) -> float:
    """Largest difference in phase, in degrees, over the transducers that sound."""
    sounding = (np.abs(emitted) > 0) & (np.abs(intended) > 0)
    return float(np.degrees(np.abs(np.angle(emitted[sounding] / intended[sounding]))).max(initial=0.0))


def run_end_to_end(solution: Solution, emulator: Emulator) -> EndToEnd:
    """Send a solution to an emulator, which must be plugged in, by the real host driver and pyusb.

    Raises
    ------
    ValueError
        If the solution has another number of drives than the device has transducers.
    DeviceError
        If the device cannot be reached.
    """
    pulses = Pulses.from_drive(solution.drive)
    with open_device(emulator.url) as device:
        ack = device.show(pulses)
        emulator.run_until(ack.commit_period + PERIODS_WATCHED)
        capture = emulator.capture()
    return EndToEnd(solution, ack, capture)
