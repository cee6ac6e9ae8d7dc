"""Two halves of a circle take turns 200 times a second, from the device's own memory.

Two-sided modulation (section 3.4 of the paper) makes points stronger than switching on and off. Run it with
``.venv/bin/python examples/from_memory.py [URL]``; the default device is emulated.
"""

import sys

import phasewire as pw

array = pw.TransducerArray.grid()
both = pw.two_sided(array, pw.Circle(0.03).sample())
print(both.summary())
frames, turns = both.modulation.slots()
with pw.open_device(sys.argv[1] if len(sys.argv) > 1 else None) as device:
    for slot, frame in enumerate(frames):
        device.store(slot, frame)
    device.play(turns)  # again and again, exact to the carrier period, without the host
    device.keep_playing(1)
    print(f"{device.name}: {device.status().accepted} blocks, {device.status().missed_commits} commits missed.")
