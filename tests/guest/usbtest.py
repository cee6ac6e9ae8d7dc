"""Runs in the guest: has the kernel's driver usbtest carry out cases of its tests.

``python usbtest.py VENDOR:PRODUCT CASES`` with a JSON list of cases, each ``{"case": 1, "iterations": 10, "length":
512, "vary": 0, "count": 0, "pattern": 0, "hold": false}``, prints a JSON list of the name of each case's error, empty
if it passed. The layouts are those of the kernel's tools/usb/testusb.c and include/uapi/linux/usbdevice_fs.h.
"""

from __future__ import annotations

import ctypes
import errno
import fcntl
import json
import struct
import sys
from pathlib import Path
from typing import Any

USBDEVFS_CONTROL, USBDEVFS_IOCTL = 0xC018_5500, 0xC010_5512
USBTEST_REQUEST = 0xC01C_5564
HOLD = (0x40, 0x5D)  # of source_sink.py
CONTROL_MILLISECONDS = 1000
PATTERN = Path("/sys/module/usbtest/parameters/pattern")


def node(vendor: str, product: str) -> str:
    """The file of the only device with these ids."""
    (found,) = [
        path.parent
        for path in Path("/sys/bus/usb/devices").glob("*/idProduct")
        if (path.read_text().strip(), (path.parent / "idVendor").read_text().strip()) == (product, vendor)
    ]
    numbers = (int((found / name).read_text()) for name in ("busnum", "devnum"))
    return "/dev/bus/usb/{:03}/{:03}".format(*numbers)


def run(device: int, case: dict[str, Any]) -> None:
    """Have a case carried out; raises `OSError` if it fails."""
    PATTERN.write_text(str(case["pattern"]))
    numbers = (case[name] for name in ("case", "iterations", "length", "vary", "count"))
    parameters = ctypes.create_string_buffer(struct.pack("5I2i", *numbers, 0, 0))
    fcntl.ioctl(device, USBDEVFS_IOCTL, struct.pack("iIP", 0, USBTEST_REQUEST, ctypes.addressof(parameters)))


def hold(device: int, value: bool) -> None:
    """Have the device answer NAK on its bulk endpoints, or end that."""
    fcntl.ioctl(device, USBDEVFS_CONTROL, struct.pack("BBHHHI4xP", *HOLD, value, 0, 0, CONTROL_MILLISECONDS, 0))


def main(ids: str, cases: list[dict[str, Any]]) -> list[str]:
    """Carry out all cases, also after one failed."""
    errors = []
    with Path(node(*ids.split(":"))).open("r+b", buffering=0) as file:
        for case in cases:
            try:
                if case["hold"]:
                    hold(file.fileno(), True)
                run(file.fileno(), case)
                errors.append("")
            except OSError as error:
                errors.append(errno.errorcode[error.errno or 0])
            finally:
                if case["hold"]:
                    hold(file.fileno(), False)
    return errors


if __name__ == "__main__":
    sys.stdout.write(json.dumps(main(sys.argv[1], json.loads(sys.argv[2]))))
