"""What cases begin with: a player, or a serial line, which is the line of blocks or the console's endpoints on USB."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from phasewire.hil.conformance.bench import Bench
from phasewire.hil.conformance.cases import NotApplicable
from phasewire.hil.conformance.tools.exchange import at_the_console
from phasewire.hil.conformance.tools.player import Player
from phasewire.hil.conformance.transports.serial import RawSerialLine
from phasewire.protocol.codes import Feature


@pytest.fixture
def player(bench: Bench) -> Player:
    """An enabled device whose watchdog does not interfere."""
    return Player(bench)


@pytest.fixture
def frames(bench: Bench) -> Iterator[RawSerialLine]:
    """A serial line that carries frames; fails if one of the device's frames is damaged."""
    line = _line(bench)
    line.wire.set_dtr(True)
    line.enter_frames()
    yield line
    damaged = list(line.damaged)
    bench.leave(line)
    assert not damaged, f"{len(damaged)} of the device's own frames were damaged: {damaged[0]}"


@pytest.fixture
def console(bench: Bench) -> Iterator[RawSerialLine]:
    """A serial line at the console's prompt, without echo."""
    _line(bench)
    with at_the_console(bench) as line:
        yield line


def _line(bench: Bench) -> RawSerialLine:
    if bench.line.kind == "usb" and Feature.CONSOLE not in bench.info.features:
        raise NotApplicable("INFO does not name the feature CONSOLE")
    return bench.serial
