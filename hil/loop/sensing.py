"""A cycle of drives as a device emits it: the felt map, the audible sound, the exposure and the power.

The cycle goes the whole way: pulses, blocks, five emulated boards, bits. `feel` judges the waves that the bits make.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...emulator import Emulator
from ...feel.exposure import Exposure, exposure_at, seated
from ...feel.hearing import Audible, audible
from ...feel.perception import EVERY, FeltMap, feel
from ...feel.power import RadiatedPower, radiated_power
from ...feel.unfolding import SkinPlaces, Unfolded
from ...host import open_device
from ...host.streaming.cycles import play_cycle
from ...host.streaming.envelopes import sine
from ...protocol.board import CARRIER_HZ
from ...solver import Cycle, Hand, Medium, Outline, TransducerArray, transfer_matrix
from ...solver.fields.validity import Validity, validity
from ..sound.emission import emitted_waves

__all__ = ["Sensation", "sense", "skin_over"]

LEAST_PERIODS = 4000
"""0.1 s: of a stretch that is judged, at least; it is a whole number of cycles."""
SETTLED_PERIODS = 400
"""10 ms, after which the resonances have forgotten how it began."""
MOST_PERIODS = 80_000
"""2 s: of a cycle, and of its envelope; within them both end as nearly together as they can."""
TRIES = 10
EARS = 2
"""Of the places of `seated`, the first."""


@dataclass(frozen=True, eq=False)
class Sensation:
    """How a cycle is felt and heard.

    Parameters
    ----------
    cycle : Cycle
        As it was played.
    felt : FeltMap
        What skin feels.
    sound : Audible
        The sound at the listeners.
    exposure : Exposure
        There, to ultrasound.
    power : RadiatedPower
        The power that the array radiates.
    validity : Validity
        The validity of the strongest pressure on the skin.
    """

    cycle: Cycle
    felt: FeltMap
    sound: Audible
    exposure: Exposure
    power: RadiatedPower
    validity: Validity

    def record(self) -> dict[str, object]:
        """All numbers for JSON."""
        return {
            "cycle_hz": self.cycle.frequency,
            "frames": len(self.cycle),
            "felt": self.felt.record(),
            "sound": self.sound.record(),
            "exposure": self.exposure.record(),
            "power": self.power.record(),
            "validity": self.validity.record(),
        }


def skin_over(outline: Outline) -> Unfolded:
    """A flat hand whose palm lies over the middle of an outline, facing the array."""
    return Unfolded.of(Hand.flat(outline.points.centre))


def sense(
    cycle: Cycle,
    places: SkinPlaces,
    listeners: NDArray[np.float64] | None = None,
    array: TransducerArray | None = None,
    medium: Medium | None = None,
) -> Sensation:
    """Play a cycle on an emulated device, and judge what its outputs emit.

    Parameters
    ----------
    cycle : Cycle
        A cycle for 320 transducers.
    places : SkinPlaces
        k places of skin.
    listeners : (j, 3) float, optional
        Places, in metres, at which sound and ultrasound are judged; by default the ears of a `seated` person, and for
        ultrasound the nose as well.
    array : TransducerArray, optional
        The array; by default that of the boards.
    medium : Medium, optional
        The air; 20 °C by default.

    Raises
    ------
    ValueError
        If the cycle does not fit the device or takes more than 2 s, or as `feel`.
    """
    array, medium = array or TransducerArray.grid(), medium or Medium()
    head = seated(array)
    ears, exposed = (head[:EARS], head) if listeners is None else (listeners, listeners)
    periods, every = _stretch(cycle)
    with Emulator() as emulator, open_device(emulator.url) as device:
        device.set_watchdog(60.0)
        first = play_cycle(device, cycle).ack.commit_period + SETTLED_PERIODS
        emulator.run_until(first + periods)
        emitted = emitted_waves(emulator.capture(), array, first, first + periods)
    felt = feel(array, emitted.waves, places, medium, every=every)
    peak, where = _strongest(array, emitted.waves[:: every * (1 + periods // LEAST_PERIODS)], places, medium)
    return Sensation(
        cycle,
        felt,
        audible(array, emitted.waves, emitted.pulses, ears, medium),
        exposure_at(array, emitted.waves, exposed, medium),
        radiated_power(array, emitted.waves, medium),
        validity(array, peak, where, medium),
    )


def _stretch(cycle: Cycle) -> tuple[int, int]:
    """Carrier periods to judge of a cycle, with its envelope, and every how many of them its pressure is taken."""
    whole = cycle.periods
    if cycle.envelope:
        envelope = sine(cycle.envelope)
        swing = len(envelope.samples) * envelope.hold
        counts = range(1, max(MOST_PERIODS // whole, 1) + 1)
        whole *= min(counts, key=lambda count: abs(count * whole - max(round(count * whole / swing), 1) * swing))
        if swing > MOST_PERIODS:
            whole = swing
    if whole > MOST_PERIODS:
        raise ValueError(
            f"a cycle that takes {whole / CARRIER_HZ:.3g} s is too long to be judged; at most "
            f"{MOST_PERIODS / CARRIER_HZ:g} s are possible"
        )
    least = -(-LEAST_PERIODS // whole)
    choices = [
        (every, -count * whole)
        for count in range(least, least + TRIES)
        for every in range(1, EVERY + 1)
        if count * whole % every == 0
    ]
    every, periods = max(choices)
    return -periods, every


def _strongest(
    array: TransducerArray, waves: NDArray[np.complex64], places: SkinPlaces, medium: Medium
) -> tuple[float, NDArray[np.float64]]:
    """The greatest peak pressure on skin in Pa, and where it is."""
    field = np.abs(transfer_matrix(array, places.positions, medium).astype(np.complex64) @ waves.T).max(axis=1)
    return float(field.max()), places.positions[field.argmax()]
