"""Four devices around a point, 20 cm from it each, that make one focus there; and what some of them would make alone.

Run it with ``.venv/bin/python examples/ring_rig.py``; the devices are emulated. Real ones are read from a file by
`pw.read_rig`.
"""

import numpy as np
import phasewire as pw
from phasewire.emulator.cluster import Cluster
from phasewire.hil import run_rig
from scipy.spatial.transform import Rotation

FOCUS = np.array([0, 0, 0.2])

board = pw.TransducerArray.grid()
turns = Rotation.from_euler("y", [[0], [90], [180], [270]], degrees=True).as_matrix()
boards = [board.placed(turn, FOCUS - turn @ FOCUS) for turn in turns]
with Cluster(4) as cluster:  # emulated devices on one sync line
    rig = [pw.RigDevice(device.url, there) for device, there in zip(cluster, boards, strict=True)]
    with pw.open_devices(rig) as group:
        print(f"{group.name}: {group.common}.")
        run = run_rig(pw.solve(group.array, [FOCUS]), group, list(cluster))
for count in (1, 2, 4):
    drive = np.where(np.arange(len(group.array)) < count * len(board), run.rebuilt, 0)
    print(f"{count} of them: {abs(pw.pressure(group.array, drive, [FOCUS])[0]):.0f} Pa at the focus, from their bits.")
print("PASS" if run.passed else "FAIL")
