"""How fast a focus rises: the pressure at a point after an update, from the bits that the outputs played.

Run it with ``.venv/bin/python examples/ring_up.py``; the device is emulated. It draws ``ring_up.png``.
"""

import numpy as np
import phasewire as pw
from matplotlib.figure import Figure
from phasewire.hil import Playback
from phasewire.protocol.board import CARRIER_HZ, TICKS_PER_PERIOD

FOCUS_M, BEFORE, AFTER = [0.0, 0.0, 0.2], 10, 120  # m, carrier periods
MS_PER_PERIOD = 1000 / CARRIER_HZ

array = pw.TransducerArray.grid()
solution = pw.solve(array, pw.ControlPoints([FOCUS_M]))
with pw.Emulator() as emulator, pw.open_device(emulator.url) as device:
    emulator.run(BEFORE)
    update = device.show(solution).commit_period
    emulator.run_until(update + AFTER)
    playback = Playback(emulator.capture(), array)

first, last = update - BEFORE, update + AFTER
wave = playback.signal([FOCUS_M], first * TICKS_PER_PERIOD, last * TICKS_PER_PERIOD)[0]
envelope = np.abs(playback.phasors([FOCUS_M], first, last)[0])
axes = (figure := Figure(layout="constrained")).subplots()
axes.plot(np.arange(-BEFORE, AFTER, 1 / TICKS_PER_PERIOD) * MS_PER_PERIOD, wave, label="every edge followed")
axes.plot(np.arange(-BEFORE, AFTER) * MS_PER_PERIOD, envelope, label="envelope")
axes.axhline(abs(pw.pressure(array, solution.drive, [FOCUS_M])[0]), linestyle=":", label="phasor model")
axes.set(xlabel="time since the update / ms", ylabel="pressure / Pa")
axes.legend()
figure.savefig("ring_up.png", dpi=150)
print(f"Drew ring_up.png: the transducers ring up with τ = {playback.resonator.time_constant * 1000:g} ms.")
