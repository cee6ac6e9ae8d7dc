"""The commands of docs/how-to/usb_device.md, in the guest, exactly as on the page."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from .conftest import Bench

pytestmark = [pytest.mark.guest, pytest.mark.guest_slow]

GUIDE = (Path(__file__).parents[2] / "docs/how-to/usb_device.md").read_text(encoding="utf-8")


def blocks() -> list[list[list[str]]]:
    """The words of each command in each block of the page; root needs no sudo."""
    found = []
    for block in re.findall(r"```sh\n(.*?)```", GUIDE, re.DOTALL):
        lines = [line.replace('"$(which phasewire)"', "phasewire").removeprefix("sudo ") for line in block.splitlines()]
        found.append([shlex.split(line, comments=True) for line in lines])
    return found


def test_the_commands_of_the_page_do_what_it_says(bench: Bench) -> None:
    serve, attach, look, terminal, play, record, explain = blocks()
    assert [command[:2] for command in (*serve, attach[1])] == [["phasewire", "emulate"], ["phasewire", "attach"]]
    assert attach[1][2] == "127.0.0.1", "the guest reaches this computer by another address"
    bench.serve(*serve[0][2:])
    bench.check(*attach[0])
    bench.attach(*attach[1][3:])
    said = {" ".join(command): bench.check(*command) for command in look}
    assert "Self Powered" in said["lsusb -v -d 1209:0001"]
    assert "usb:EMU-" in said["phasewire devices"]
    assert "Found Runtime: [1209:0001]" in said["dfu-util --list"]
    keys = "(sleep 1; printf 'status\\r'; sleep 2; printf '\\001\\030') | "
    assert "state: OFF" in bench.check("sh", "-c", keys + shlex.join(terminal[0]))
    bench.check(*record[0])
    recording = bench.guest.start(*record[1], seconds=900)
    bench.check("phasewire", "watchdog", "5", "--device", "usb:")  # as the page advises for a slow computer
    *play, reset = play
    for command in play:
        bench.check(*command, seconds=300)
    bench.guest.signal(recording)
    assert bench.guest.wait(recording).code == 0
    bench.check(*reset)
    whole, nothing = (bench.check(*command) for command in explain)
    assert "acknowledgement" in whole
    assert nothing.endswith(" 0 invalid\n")
    assert nothing.count("\n") == 1
