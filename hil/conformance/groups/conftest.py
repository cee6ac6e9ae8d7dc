"""Serial lines for cases: the line of blocks itself where it is one, else the console's endpoints on USB."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import NotApplicable
from phasewire.hil.conformance.lines.serial import SerialLine
from phasewire.protocol.codes import Feature


@pytest.fixture
def frames(bench: Bench) -> Iterator[SerialLine]:
    """A serial line that carries frames; none of the device's may be damaged."""
    line = _line(bench)
    line.wire.set_dtr(True)
    line.enter_frames()
    yield line
    damaged = list(line.damaged)
    _leave(bench, line)
    assert not damaged, f"{len(damaged)} of the device's own frames were damaged: {damaged[0]}"


@pytest.fixture
def console(bench: Bench) -> Iterator[SerialLine]:
    """A serial line at the console's prompt, without echo."""
    line = _line(bench)
    line.enter_console()
    yield line
    _leave(bench, line)


def _line(bench: Bench) -> SerialLine:
    if bench.line.kind == "usb" and Feature.CONSOLE not in bench.info.features:
        raise NotApplicable("INFO does not name the feature CONSOLE")
    return bench.serial


def _leave(bench: Bench, line: SerialLine) -> None:
    """Leave the line as the next case expects it: in frames where blocks go by it, else as nobody uses it."""
    if line is bench.line:
        line.enter_frames()
    else:
        line.wire.set_dtr(False)
        line.assume_console()
