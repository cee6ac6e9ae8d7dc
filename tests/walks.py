"""Counts the files on the way of an update, from control points to bits: ``python -m tests.walks``.

A reader who follows the way opens each file once, and goes back to one that was left again and again. Both numbers come
from the calls of one update on an emulated device that has played before, so that nothing is loaded or compiled.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType

import phasewire as pw

ROOT = Path(__file__).resolve().parents[1]


def walk(do: Callable[[], object]) -> list[str]:
    """The files of the package that a call enters, in order; a file that calls itself is there once."""
    path: list[str] = []

    def entered(frame: FrameType, event: str, argument: object) -> None:
        source = Path(frame.f_code.co_filename)
        if event == "call" and source.is_relative_to(ROOT):
            file = source.relative_to(ROOT).as_posix()
            if not file.startswith(("tests/", ".venv/")) and path[-1:] != [file]:
                path.append(file)

    sys.setprofile(entered)
    try:
        do()
    finally:
        sys.setprofile(None)
    return path


def main() -> None:
    """Print the two numbers and the files, in the order in which they are entered."""
    array = pw.TransducerArray.grid()
    points = pw.ControlPoints([[0, 0, 0.15]])
    with pw.Emulator() as emulator, pw.open_device(emulator.url) as device:

        def update() -> None:
            ack = device.show(pw.solve(array, points))
            emulator.run_until(ack.commit_period + 1)
            first = ack.commit_period * 50
            emulator.capture().bits(first, first + 50)

        update()
        path = walk(update)
    files = list(dict.fromkeys(path))
    print(*files, sep="\n")
    print(f"{len(files)} files entered, {len(path) - len(files)} returns to a file that was left")


if __name__ == "__main__":
    main()
