"""Serve the reference device in C by USB/IP in place of an emulated one; write its port into the file that is named."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import NoReturn

PROGRAM = Path(__file__).parents[2] / "firmware" / "build" / "phasewire-reference"


def serve(where: Path, options: list[str]) -> NoReturn:
    """Serve it until the process is ended."""
    with subprocess.Popen([PROGRAM, "--usbip", "0", *options], stdout=subprocess.PIPE) as device:
        signal.signal(signal.SIGTERM, lambda *_: device.terminate())
        assert device.stdout is not None
        port = json.loads(device.stdout.readline())["usbip"]
        where.write_text(json.dumps({"usbip": {"port": port}}))
        sys.exit(device.wait())


if __name__ == "__main__":
    serve(Path(sys.argv[1]), sys.argv[2:])
