"""``phasewire emulate`` that writes down what its device did, for tests that need more than exit codes.

Its first argument is the file; the others are those of the command line.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from phasewire.__main__ import main
from phasewire.cli import emulate as cli
from phasewire.emulator.machine import Emulator
from phasewire.protocol.board import CARRIER_HZ, TICKS_PER_PERIOD


class Witness(Emulator):
    """A device that keeps all changes of its outputs, across restarts too."""

    def __init__(self, **settings: Any) -> None:
        self.played: list[tuple[float, float]] = []
        super().__init__(**{**settings, "history_periods": None})
        seen.append(self)

    def _stop(self) -> None:
        self.look()
        super()._stop()

    def look(self) -> None:
        """Enter each change of the outputs: seconds since the start, and the loudest drive."""
        if self.controller is None:
            return
        capture = self.capture()
        for period in (tick // TICKS_PER_PERIOD for tick in capture.latches[0]):
            self.played.append((period / CARRIER_HZ, round(float(abs(capture.drive(period)).max()), 3)))


seen: list[Witness] = []

if __name__ == "__main__":
    vars(cli)["Emulator"] = Witness  # of which the command makes its device
    try:
        main(sys.argv[2:])
    finally:
        (machine,) = seen
        machine.look()
        record = {"events": [event.what for event in machine.events], "played": machine.played}
        Path(sys.argv[1]).write_text(json.dumps(record))
