"""Exports of a capture: which outputs, which stretch of time, and a file whose name says the format."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...base.storage import FilePath
from ...protocol.board import BOARDS, CHANNELS, CHANNELS_PER_PROCESSOR, PROCESSORS_PER_BOARD
from ...protocol.wiring import Wiring
from ..trace import Signal
from .excerpt import Excerpt, PortBits
from .sigrok import write_sigrok
from .vcd import write_vcd

__all__ = ["check_export_path", "chosen_channels", "export"]

VCD, SIGROK = ".vcd", ".sr"

_CHOICE = re.compile(r"b(?P<board>\d)(p(?P<processor>\d)(_(?P<bit>\d\d))?)?|t(?P<transducer>\d+)", re.ASCII)


def check_export_path(path: FilePath) -> None:
    """Raise `ValueError` if a path does not end in the name of a format."""
    if Path(path).suffix.lower() not in (VCD, SIGROK):
        raise ValueError(f"{path}: an export's name ends in {VCD} or {SIGROK}")


def chosen_channels(text: str, wiring: Wiring) -> list[int]:
    """The output channels that a user names, such as ``b0,b2p1,b4p0_07,t160``.

    Parameters
    ----------
    text : str
        Boards (``b0``), processors (``b2p1``), outputs (``b4p0_07``) and transducers by their place in array order
        (``t160``), with commas between.
    wiring : Wiring
        The table of the output that drives each transducer.

    Raises
    ------
    ValueError
        If one of them is none, or does not exist.
    """
    return [channel for choice in text.split(",") for channel in _channels(choice.strip(), wiring)]


def _channels(choice: str, wiring: Wiring) -> list[int]:
    found = _CHOICE.fullmatch(choice)
    if found is None:
        raise ValueError(f"{choice!r} chooses no output; b2, b2p1, b2p1_07 or t160 would")
    if (transducer := found["transducer"]) is not None:
        if int(transducer) >= CHANNELS:
            raise ValueError(f"there is no transducer {transducer}; 0 to {CHANNELS - 1}")
        return [int(wiring.channels[int(transducer)])]
    shape = (BOARDS, PROCESSORS_PER_BOARD, CHANNELS_PER_PROCESSOR)
    place = tuple(int(number) for number in found.group("board", "processor", "bit") if number is not None)
    if any(number >= most for number, most in zip(place, shape, strict=False)):
        raise ValueError(
            f"there is no {choice}: boards are 0 to {BOARDS - 1}, processors 0 to {PROCESSORS_PER_BOARD - 1}, "
            f"outputs 00 to {CHANNELS_PER_PROCESSOR - 1}"
        )
    chosen: list[int] = np.atleast_1d(np.arange(CHANNELS).reshape(shape)[place]).ravel().tolist()
    return chosen


def export(
    capture: PortBits,
    path: FilePath,
    channels: Sequence[int] | None = None,
    ticks: tuple[int, int] | None = None,
    signals: Sequence[Signal] = (),
) -> None:
    """Write an excerpt of a capture in the format of the path's suffix.

    Parameters
    ----------
    capture : PortBits
        What was captured.
    path : str or Path
        The file, whose name ends in .vcd (GTKWave) or .sr (sigrok).
    channels : sequence of int, optional
        The outputs, in this order; all by default.
    ticks : (start, stop), optional
        The stretch of time, stop not included; all of it by default.
    signals : sequence of Signal
        What to show beside the outputs, in a VCD file.

    Raises
    ------
    ValueError
        If the suffix or an output is unknown, the stretch is empty or was not captured, a signal is none, or the
        format cannot hold signals.
    OSError
        If the file cannot be written; what stood there is untouched.
    """
    check_export_path(path)
    excerpt = Excerpt.of(capture, channels, ticks)
    if Path(path).suffix.lower() == VCD:
        write_vcd(path, excerpt, signals)
    elif signals:
        raise ValueError(f"{path}: a sigrok session file holds outputs alone; signals need {VCD}")
    else:
        write_sigrok(path, excerpt)
