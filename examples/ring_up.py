"""How fast a focus rises: the pressure at a point after an update, from the bits that the outputs played.

Run it with ``.venv/bin/python examples/ring_up.py``; the device is emulated. It draws ``ring_up.png``.
"""

import numpy as np
import phasewire as pw
from phasewire.base.pictures import BLUE, INK, RED, new_figure, save_figure
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
axes = (figure := new_figure(3.6)).subplots()
times = np.arange(-BEFORE, AFTER, 1 / TICKS_PER_PERIOD) * MS_PER_PERIOD
axes.plot(times, wave / 1000, color=BLUE, linewidth=0.4, label="every edge followed")
axes.plot(times[::TICKS_PER_PERIOD], envelope / 1000, color=RED, label="envelope")
model = abs(pw.pressure(array, solution.drive, [FOCUS_M])[0]) / 1000
axes.axhline(model, color=INK, linestyle="--", linewidth=1, label="phasor model")
title = "A focus 20 cm above the array rises, from the bits that the outputs played"
axes.set(title=title, xlabel="time since the update / ms", ylabel="pressure / kPa", xlim=(times[0], times[-1]))
axes.legend(loc="lower left")
save_figure(figure, "ring_up.png")
print(f"Drew ring_up.png: the transducers ring up with τ = {playback.resonator.time_constant * 1000:g} ms.")
