"""Two points, one twice as strong as the other, and two seconds of them on a device.

Run it with ``.venv/bin/python examples/two_points.py [URL]``; the default device is emulated.
"""

from __future__ import annotations

import sys
import time

from phasewire import ControlPoints, Pulses, TransducerArray, open_device, solve


def main(url: str | None) -> None:
    """Solve the points and play them."""
    points = ControlPoints([[-0.03, 0, 0.2], [0.03, 0, 0.2]], amplitudes=[1.0, 0.5])
    pulses = Pulses.from_drive(solve(TransducerArray.grid(), points).drive)
    with open_device(url) as device:
        ack = device.show(pulses)
        print(f"{device.name} plays from carrier period {ack.commit_period}")
        end = time.monotonic() + 2
        while time.monotonic() < end:
            time.sleep(device.info.watchdog / 3)
            device.status()  # a sign of life
    print("The outputs are off.")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
