"""The end-to-end check of touch: the outputs over one period of the modulation, compared with the intent.

Two drives alternate, and skin feels the change of the intensity at 200 Hz. So the judge rebuilds the drive of every
carrier period from the captured bits, and demodulates the intensity at the control points itself. As in `end_to_end`,
it takes from the emulator only the bits and the wiring.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...emulator import Capture, Emulator
from ...host import open_device
from ...host.streaming.frames import Frame
from ...protocol.board import CARRIER_HZ, PROCESSORS, TICKS_PER_PERIOD
from ...protocol.pulses import Pulses
from ...protocol.replies import Ack
from ...solver import Modulation, TransducerArray, TwoSided, intensity_component, pressure, transfer_matrix
from .end_to_end import NUMERICAL, Check, CheckedRun, emission, nearest_emission

__all__ = ["TouchRun", "as_emitted", "run_touch"]


@dataclass(frozen=True, eq=False)
class TouchRun(CheckedRun):
    """What was intended, what was played, and the difference.

    Parameters
    ----------
    intended : TwoSided
        Both drives, before they become pulses, and the control points.
    ack : Ack
        The device's answer to the sequence of both.
    capture : Capture
        Its outputs.
    """

    intended: TwoSided
    ack: Ack
    capture: Capture

    def __repr__(self) -> str:
        return f"TouchRun({self.intended}, {self.capture})"

    @property
    def array(self) -> TransducerArray:
        """The transducers."""
        return self.intended.first.array

    @cached_property
    def wanted(self) -> NDArray[np.complex128]:
        """The intended drive of each carrier period of one cycle of the modulation, (k, n)."""
        modulation = self.intended.modulation
        return np.repeat(modulation.weights @ modulation.drives, modulation.periods, axis=0)

    @cached_property
    def rebuilt(self) -> NDArray[np.complex128]:
        """The same drives as emitted, (k, n), from the captured bits of the first cycle."""
        first = self.ack.commit_period * TICKS_PER_PERIOD
        bits = self.capture.bits(first, first + len(self.wanted) * TICKS_PER_PERIOD)
        periods = bits.reshape(len(self.wanted), TICKS_PER_PERIOD, PROCESSORS)
        return np.stack([emission(period, self.capture.wiring) for period in periods])

    @property
    def emitted(self) -> Modulation:
        """The modulation as emitted: of each sample the drive in its first carrier period."""
        wanted = self.intended.modulation
        drives = self.rebuilt[:: wanted.periods]
        return Modulation(drives, np.eye(len(drives)), wanted.frequency, wanted.carrier)

    def pressures(self, drives: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Pressure at the control points in each carrier period, (k, m) complex in Pa."""
        at, medium = self.intended.points.positions, self.intended.first.medium
        distinct, rows = np.unique(drives, axis=0, return_inverse=True)
        return np.stack([pressure(self.array, drive, at, medium) for drive in distinct])[rows.ravel()]

    def felt(self, drives: NDArray[np.complex128]) -> NDArray[np.float64]:
        """How strongly the intensity at each control point changes at the modulation's frequency, (m,) in Pa².

        Notes
        -----
        The Fourier coefficient in continuous time of an intensity that is constant in each of k carrier periods:
        A = 2·|Σ_j I_j·e^{-2πij/k}|/k · sinc(1/k).
        """
        k = len(drives)
        turns = np.exp(-2j * np.pi * np.arange(k) / k)
        return np.asarray(2 * np.abs(turns @ np.abs(self.pressures(drives)) ** 2) / k * np.sinc(1 / k))

    def checks(self) -> list[Check]:
        """All requirements; the verdict is good if all are met."""
        boundary = self.ack.commit_period * TICKS_PER_PERIOD
        began = [next((tick for tick in latches if tick >= boundary), 0) for latches in self.capture.latches]
        before = self.capture.bits(max(0, boundary - TICKS_PER_PERIOD), boundary)
        modulation = self.intended.modulation
        halves = modulation.weights @ modulation.drives
        explained = np.repeat([np.abs(nearest_emission(half) - half) for half in halves], modulation.periods, axis=0)
        at, medium = self.intended.points.positions, self.intended.first.medium
        # An error e of the pressure p changes the intensity |p|² by at most 2·|p|·e + e², and the amplitude of a
        # cosine by at most twice the mean of that.
        error = (explained + NUMERICAL) @ np.abs(transfer_matrix(self.array, at, medium)).T
        allowed = 2 * (2 * np.abs(self.pressures(self.wanted)) * error + error**2).mean(axis=0)
        felt = intensity_component(self.array, modulation, at, medium=medium)
        wrong = np.abs(self.felt(self.rebuilt) - felt)
        worst = int((wrong / allowed).argmax())
        percent = 100 / felt.max()
        return [
            Check("processors off their tick", sum(tick != boundary for tick in began), 0, f"of {PROCESSORS}"),
            Check("outputs high before that tick", int(np.bitwise_count(before).sum()), 0, "bits"),
            Check(
                "drive error beyond quantisation, worst period",
                float((np.abs(self.rebuilt - self.wanted) - explained).max()),
                NUMERICAL,
                "of full drive",
            ),
            Check(
                f"change of intensity at {modulation.true_frequency:g} Hz, worst point",
                float(wrong[worst] * percent),
                float(allowed[worst] * percent),
                "% of strongest",
            ),
        ]


def run_touch(intended: TwoSided, emulator: Emulator) -> TouchRun:
    """Play a two-sided modulation on an emulator, which must be plugged in, by the real host driver and pyusb.

    Raises
    ------
    ValueError
        If the number of drives differs from that of the device's transducers.
    DeviceError
        If the device cannot be reached.
    """
    drives, steps = intended.modulation.slots()
    return TouchRun(intended, *_played(drives, steps, emulator))


def as_emitted(frames: Sequence[Pulses], hold: int) -> Modulation:
    """The drives that an emulated device emits for 1 to 256 frames in turn, rebuilt from the bits of its outputs.

    Each frame is held for so many carrier periods.
    """
    with Emulator() as emulator:
        ack, capture = _played(frames, [(slot, hold) for slot in range(len(frames))], emulator)
    ticks = [(ack.commit_period + number * hold) * TICKS_PER_PERIOD for number in range(len(frames))]
    drives = [emission(capture.bits(tick, tick + TICKS_PER_PERIOD), capture.wiring) for tick in ticks]
    return Modulation(drives, np.eye(len(drives)), CARRIER_HZ / (len(drives) * hold))


def _played(frames: Iterable[Frame], steps: Sequence[tuple[int, int]], emulator: Emulator) -> tuple[Ack, Capture]:
    """Let a device repeat frames for so many periods each, for one cycle."""
    with open_device(emulator.url) as device:
        for slot, frame in enumerate(frames):
            device.store(slot, frame)
        ack = device.play(steps)
        emulator.run_until(ack.commit_period + sum(periods for _, periods in steps))
        return ack, emulator.capture()
