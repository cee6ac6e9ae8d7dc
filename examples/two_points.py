"""Two points, one twice as strong as the other, modulated at 200 Hz, and two seconds of them on a device.

Run it with ``.venv/bin/python examples/two_points.py [URL]``; the default device is emulated.
"""

import sys

import phasewire as pw
from phasewire.host import sine

points = pw.ControlPoints([[-0.03, 0, 0.2], [0.03, 0, 0.2]], amplitudes=[1.0, 0.5])
solution = pw.solve(pw.TransducerArray.grid(), points)
with pw.open_device(sys.argv[1] if len(sys.argv) > 1 else None) as device:
    ack = device.show(solution)
    device.modulate(*sine(200))  # skin hardly feels a field that does not change
    print(f"{device.name} plays from carrier period {ack.commit_period}.")
    device.keep_playing(2)  # with signs of life: after 0.1 s without one, the device turns its outputs off
print("The outputs are off.")
