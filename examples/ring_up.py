"""How fast a focus comes and goes: two updates, each with a focus of its own, and the pressure at both places.

Run it with ``.venv/bin/python examples/ring_up.py [PICTURE]``; the device is emulated, and the pressure comes from the
bits that its outputs played. It draws ``ring_up.png`` unless told otherwise.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from phasewire import ControlPoints, Emulator, Pulses, TransducerArray, open_device, pressure, solve
from phasewire.hil import Playback
from phasewire.protocol.board import CARRIER_HZ, TICKS_PER_PERIOD

FOCI_M = [[-0.02, 0.0, 0.2], [0.02, 0.0, 0.2]]
PERIODS_EACH = 120
PERIODS_BEFORE = 10
MS = 1e3


def main(picture: Path) -> None:
    """Play the two updates, listen at both places, and draw what is heard."""
    array = TransducerArray.grid()
    pulses = [Pulses.from_drive(solve(array, ControlPoints([focus])).drive) for focus in FOCI_M]
    with Emulator() as emulator, open_device(emulator.url) as device:
        boundaries = []
        emulator.run(PERIODS_BEFORE)
        for update in pulses:
            boundaries.append(device.show(update).commit_period)
            emulator.run_until(boundaries[-1] + PERIODS_EACH)
        playback = Playback(emulator.capture(), array)

    first, last = boundaries[0] - PERIODS_BEFORE, boundaries[-1] + PERIODS_EACH
    wave = playback.signal(FOCI_M, first * TICKS_PER_PERIOD, last * TICKS_PER_PERIOD)
    envelope = np.abs(playback.phasors(FOCI_M, first, last))
    ticks = np.arange(first, last, 1 / TICKS_PER_PERIOD) - boundaries[0]

    figure = Figure(figsize=(10, 6), layout="constrained")
    for axes, at, signal, loudness in zip(figure.subplots(2, 1, sharex=True), FOCI_M, wave, envelope, strict=True):
        settled = max(float(np.abs(pressure(array, update.to_drive(), [at])[0])) for update in pulses)
        axes.plot(ticks / CARRIER_HZ * MS, signal, linewidth=0.4, color="C0", label="every edge followed")
        axes.plot((np.arange(first, last) - boundaries[0]) / CARRIER_HZ * MS, loudness, color="C1", label="envelope")
        axes.axhline(settled, color="0.3", linewidth=1, linestyle=":", label="phasor model")
        for number, boundary in enumerate(boundaries):
            time = (boundary - boundaries[0]) / CARRIER_HZ * MS
            axes.axvline(time, color="0.3", linewidth=1, linestyle="--", label=None if number else "updates")
        axes.set(title=f"at x = {at[0] * MS:g} mm, {at[2] * MS:g} mm up".replace("-", "−"), ylabel="pressure / Pa")
        axes.legend(loc="lower right" if at is FOCI_M[0] else "lower left", fontsize="small")
    axes.set(xlabel="time since the first update's boundary / ms", xlim=ticks[[0, -1]] / CARRIER_HZ * MS)
    resonator = playback.resonator
    figure.suptitle(
        f"A focus moves: the sound needs its time, then the transducers ring up (Q = {resonator.quality:.0f}, "
        f"τ = {resonator.time_constant * MS:g} ms; linear model)"
    )
    figure.savefig(picture, dpi=110)
    print(f"Drew {picture}.")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("ring_up.png"))
