"""What a program sees when a board fails: the outputs go off, the device says why, and plays again when it may.

Run it with ``.venv/bin/python examples/hot_board.py``. Faults need an emulated device.
"""

import phasewire as pw
from phasewire.emulator import faults

solution = pw.solve(pw.TransducerArray.grid(), pw.ControlPoints([[0, 0, 0.2]]))
with pw.Emulator() as emulator, pw.open_device(emulator.url) as device:
    hot_from = device.show(solution).commit_period + 1000
    emulator.inject(faults.HotBoard(board=2, celsius=90, period=hot_from, periods=4000))  # for a tenth of a second
    try:
        device.keep_playing(1)
    except pw.DeviceError as error:
        print(f"Ended: {error}.")
    print(f"It says {device.status().temperature_c} °C, and faults {device.status().faults.name}.")
    emulator.run(8000)  # the board cools down
    device.clear_faults()
    device.enable()  # outputs never come back by themselves
    ack = device.show(solution)
    print(f"It plays again from carrier period {ack.commit_period}.")
