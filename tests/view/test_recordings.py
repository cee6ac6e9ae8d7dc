"""Recordings on a page: each moment is what was recorded."""

from __future__ import annotations

import json
from base64 import b64decode, b64encode
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from phasewire import Emulator, Mesh, Pulses, TransducerArray, open_device, record
from phasewire.base.errors import InputFileError
from phasewire.host.hands.sources import open_hands
from phasewire.host.touching.log import TouchLog
from phasewire.host.touching.loop import TouchLoop
from phasewire.solver.contact.touch import Toucher
from phasewire.view import View
from phasewire.view.recordings import open_tape

from .pages import page_of

ARRAY = TransducerArray.grid()
ZEROS = b64encode(bytes(640))
LINE = b'{"time":%s,"ids":[],"positions":[],"amplitudes":[],"phase":"' + ZEROS + b'","width":"' + ZEROS + b'"}\n'


@pytest.fixture(scope="module")
def touched(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session of touch, recorded."""
    path = tmp_path_factory.mktemp("touch") / "wave.hands"
    with Emulator() as emulator, open_device(emulator.url) as device:
        hands = open_hands("gesture:approach?seconds=2&rate=60", device.time)
        with TouchLog(path, 60, "two-sided:envelope=square", "test") as log:
            TouchLoop(device, hands, [Mesh.cube()], Toucher(), ARRAY, on_moment=log).run()
    return path


def test_of_touch_hands_points_and_both_fields_are_shown(touched: Path) -> None:
    lines = [json.loads(line) for line in touched.with_suffix(".touch").read_text().splitlines()[1:]]
    for path in (touched, touched.with_suffix(".touch")):
        with open_tape(path) as tape:
            for line in lines[:: len(lines) // 7]:
                seen = tape.at(round(line["time"] * 40_000))
                [hand] = seen.hands
                assert hand.side == "right"
                if path.suffix == ".touch":
                    np.testing.assert_allclose(seen.points[:, :3], line["positions"])
                    assert seen.drives.shape == (2, 320)
                    pulses = [b64decode(line[name]) for name in ("phase", "width")]
                    phase, width = (np.frombuffer(each, np.uint8).reshape(2, 320) for each in pulses)
                    for drive, *half in zip(seen.drives, phase, width, strict=True):
                        np.testing.assert_allclose(drive, Pulses(*half).to_drive(), atol=1e-6)
                else:
                    assert not seen.drives.any()


def test_a_page_moves_through_it(touched: Path) -> None:
    with (
        open_tape(touched.with_suffix(".touch")) as tape,
        View(tape.emitter, tape=tape, settings=tape.settings) as view,
        page_of(view.url) as page,
    ):
        first = page.frame()
        assert (first["state"], first["oldest"], first["newest"]) == ("recording", *tape.span)
        page.set(at=40_000, running=False)
        frame = page.until(lambda message: message["period"] == 40_000)
        np.testing.assert_allclose(frame.array("landmarks")[0], tape.at(40_000).hands[0].landmarks, atol=1e-6)


def test_it_plays_while_it_runs_and_begins_again(tmp_path: Path) -> None:
    path = tmp_path / "short.frames"
    record(path, [Pulses.silent(320)] * 20, 100.0)
    with open_tape(path) as tape, View(tape.emitter, tape=tape, settings=tape.settings) as view:
        seen: list[int] = []

        def over() -> bool:
            seen.append(view.settings.at or 0)
            return any(later < earlier for earlier, later in pairwise(seen)) or len(seen) > 1000

        tape.run(view, over)
        assert len(seen) < 1000
        assert 0 < max(seen) <= tape.span[1]
        view.settle(lambda settings: replace(settings, running=False, at=7))
        turns = iter(range(5))
        tape.run(view, lambda: next(turns, None) is None)
        assert view.settings.at == 7


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("bad.touch", b""),
        ("bad.touch", b"{}\n"),
        ("bad.touch", b'{"format":"phasewire-touch-log-1"}\n[]\n'),
        ("bad.touch", b'{"format":"phasewire-touch-log-1"}\n{"time":0,"phase":"","width":""}\n'),
        ("bad.touch", b'{"format":"phasewire-touch-log-1"}\n' + b"[" * 10_000 + b"\n"),
        ("bad.touch", b'{"format":"phasewire-touch-log-1"}\n' + LINE % b"NaN"),
        ("bad.touch", b'{"format":"phasewire-touch-log-1"}\n' + LINE % b"1e400"),
        ("bad.touch", b'{"format":"phasewire-touch-log-1"}\n' + LINE % b"2" + LINE % b"1"),
        ("bad.touch", b'{"format":"phasewire-touch-log-1"}\n' + LINE % (b"1" + 400 * b"0")),
        ("bad.touch", b'{"format":"phasewire-touch-log-1"}\n' + LINE % b"-5"),
        ("bad.touch", b'{"format":"phasewire-touch-log-1"}\n' + (LINE % b"1").replace(b"[]", b"[1]", 1)),
        (
            "bad.touch",
            b'{"format":"phasewire-touch-log-1"}\n' + (LINE % b"1").replace(b"[]", b"[1" + 30 * b"0" + b"]", 1),
        ),
        ("bad.touch", b'{"format":"phasewire-touch-log-1"}\n' + (LINE % b"1").replace(ZEROS, b64encode(bytes(320)), 1)),
        ("bad.hands", b"x\n"),
        ("bad.frames", b"x"),
    ],
)
def test_a_damaged_recording_is_named(tmp_path: Path, name: str, content: bytes) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputFileError, match=name), open_tape(path):
        pass


def test_an_empty_recording_is_named(tmp_path: Path) -> None:
    path = tmp_path / "empty.frames"
    record(path, [], 100.0)
    with pytest.raises(InputFileError, match="no frame"), open_tape(path):
        pass
