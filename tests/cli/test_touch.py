"""``phasewire touch``: its output, its files, and its exit codes."""

from __future__ import annotations

import base64
import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import trimesh
from phasewire import Calibration, Emulator, Mesh, TransducerArray
from phasewire.emulator import faults
from phasewire.feel.exposure import exposure_limit
from phasewire.host.hands.frames import HandFrame
from phasewire.host.hands.recording import HandRecording
from phasewire.host.hands.sources import PlayedHands
from phasewire.host.touching.loop import TouchLoop, TouchMoment
from phasewire.view.recordings import open_tape

from tests.cli.runner import Run
from tests.host.hands.leap_service import LeapService, leap_frame

pytestmark = pytest.mark.slow  # each plays for a while


@pytest.fixture
def touch(phasewire: Run) -> Run:
    return partial(phasewire, "touch")


SHORT = ("--hand", "gesture:tap?rate=100", "--seconds", "0.5")
"""A finger that comes down to 17 cm, at the centre of the paper's objects."""


def test_a_touch_is_reported_and_leaves_the_outputs_off(touch: Run) -> None:
    outcome = touch("cube", *SHORT, "--json", "touch.json")
    assert outcome.code == 0
    assert "Ended: after 0.5 s. The outputs are off." in outcome.out
    assert "51 hand frames at 10" in outcome.out
    record = json.loads(Path("touch.json").read_text())
    told = record["touch"]
    assert (record["format"], record["ended"], record["error"]) == ("phasewire-touch-1", "after 0.5 s", None)
    assert record["status"]["state"] == "OFF"
    assert told["frames"] == 51
    assert 0 < told["touching"] <= 51
    assert (told["late"], told["slipped"], told["held_up"], told["dropped"]) == (0, 0, 0, 0)
    assert told["stored"] is False
    assert set(told["stages"]) == {"wait", "cut", "solve", "send"}


def test_repairs_of_an_object_are_reported(touch: Run) -> None:
    cube = Mesh.cube()
    faces = np.concatenate([cube.faces, cube.faces[:2]])
    trimesh.Trimesh(cube.vertices, faces, process=False).export("cube.stl")
    outcome = touch("cube.stl", *SHORT)
    assert outcome.code == 0
    assert "warning: cube.stl: 2 duplicate faces removed" in outcome.err


def test_a_recording_of_hands_can_be_played_again(touch: Run) -> None:
    assert touch("cube", *SHORT, "--record", "tap.hands").code == 0
    with HandRecording.open(Path("tap.hands")) as recording:
        frames = list(recording)
    assert len(frames) == 51
    head, *lines = (json.loads(line) for line in Path("tap.touch").read_text().splitlines())
    assert head["format"] == "phasewire-touch-log-1"
    assert lines
    times = {round(frame.time, 6) for frame in frames}
    for line in lines:
        assert line["time"] in times
        assert len(line["ids"]) == len(line["positions"]) == len(line["amplitudes"]) > 0
        width = np.frombuffer(base64.b64decode(line["width"]), np.uint8).reshape(2, -1)
        phase = np.frombuffer(base64.b64decode(line["phase"]), np.uint8).reshape(2, -1)
        assert width.shape == phase.shape == (2, 320)
        assert width.max() <= 25
        assert phase.max() < 100
    again = touch("cube", "--hand", "recording:tap.hands")
    assert again.code == 0
    assert "Ended: the hands have ended." in again.out


def test_the_picture_is_drawn_at_the_moment_with_the_most_points(touch: Run) -> None:
    approach = ("cube", "--hand", "gesture:approach?rate=50", "--seconds", "2")
    outcome = touch(*approach, "--picture", "t.svg", "--timeline", "w.svg")
    assert outcome.code == 0
    for name in ("t.svg", "w.svg"):
        assert f"Drawn to {name}" in outcome.err
        assert Path(name).read_text().startswith("<?xml")


def test_without_a_touch_no_picture_is_drawn(touch: Run) -> None:
    outcome = touch("cube:x=0.5", *SHORT, "--picture", "t.png", "--timeline", "w.png")
    assert outcome.code == 0
    for name in ("t.png", "w.png"):
        assert f"{name} was not drawn: no hand touched an object" in outcome.err
        assert not Path(name).exists()
    assert "cube:x=0.5 within x 0.450 to 0.550, y -0.050 to 0.050, z 0.120 to 0.220 m" in outcome.err


WAYS = ["two-sided", "am", "lm", "stm", "auto", "stm:speed=3,modulation=150"]


@pytest.mark.parametrize("way", WAYS)
def test_each_way_of_rendering_is_played_recorded_and_drawn(touch: Run, way: str) -> None:
    outcome = touch(
        *("cube", *SHORT, "--render", way, "--json", "t.json", "--record", "tap.hands", "--picture", "t.svg")
    )
    assert outcome.code == 0
    assert "The line is too slow" not in outcome.out
    told = json.loads(Path("t.json").read_text())
    assert told["render"] == way
    assert told["touch"]["stored"] is True
    assert told["touch"]["late"] == 0
    head, *lines = (json.loads(line) for line in Path("tap.touch").read_text().splitlines())
    assert head["render"] == way
    for line in lines:
        width = np.frombuffer(base64.b64decode(line["width"]), np.uint8).reshape(-1, 320)
        phase = np.frombuffer(base64.b64decode(line["phase"]), np.uint8).reshape(-1, 320)
        assert 8 <= len(width) == len(phase) <= 24
        assert line["hold"] >= 1
    assert (150 in [line["envelope"] for line in lines]) == ("modulation" in way)
    with open_tape(Path("tap.touch")) as tape:
        assert tape.at(10**6).drives.shape == (len(width), 320)
    assert Path("t.svg").read_text().startswith("<?xml")


@pytest.mark.parametrize("options", [(), ("--render", "lm"), ("--calibration", "c.csv")])
def test_the_exposure_of_a_sitting_person_is_limited(
    touch: Run, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...]
) -> None:
    Calibration(np.linspace(0.5, 1, 320), np.zeros(320), np.ones(320), np.zeros(320)).save("c.csv")
    seen: list[TouchMoment] = []
    genuine = TouchLoop._take

    def noted(loop: TouchLoop, frame: HandFrame, stamp: float) -> None:
        loop._on_moment = seen.append
        genuine(loop, frame, stamp)

    monkeypatch.setattr(TouchLoop, "_take", noted)
    outcome = touch("cube", *SHORT, *options, "--max-exposure", "120", "--json", "t.json")
    assert outcome.code == 0
    assert "120 dB SPL were kept; drives were turned down by up to" in outcome.out
    told = json.loads(Path("t.json").read_text())
    assert told["max_exposure_db"] == 120
    array = TransducerArray.grid()
    response = np.linspace(0.5, 1, 320) if "c.csv" in options else 1.0
    levels = []
    for moment in seen:
        if moment.cycle is not None:
            frames = moment.cycle.frames
            drives = np.stack([frames.pulses(number).to_drive() for number in range(len(frames.phase))]) * response
            assert exposure_limit(array, None, 120.0)(drives) > 1 - 1e-6
            levels.append(exposure_limit(array, None, 100.0)(drives))
    assert min(levels) < 0.2, "of 20 dB less than a tenth is left: it is near the limit"


def test_a_slow_line_is_reported(touch: Run) -> None:
    outcome = touch("cube", *SHORT, "--device", "emulator:?door=serial&baud=115200")
    assert outcome.code == 0
    assert "The line is too slow for a block in each turn" in " ".join(outcome.out.split())


def test_ctrl_c_is_the_normal_end_without_a_duration(touch: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    genuine = PlayedHands.next_frame

    def interrupted(hands: PlayedHands, timeout: float) -> object:
        frame = genuine(hands, timeout)
        if frame is not None and frame.number >= 30:
            raise KeyboardInterrupt
        return frame

    monkeypatch.setattr(PlayedHands, "next_frame", interrupted)
    outcome = touch("cube", "--hand", "gesture:tap?rate=100", "--json", "t.json")
    assert (outcome.code, "Ended: Ctrl-C. The outputs are off." in outcome.out) == (0, True)
    assert json.loads(Path("t.json").read_text())["ended"] == "Ctrl-C"
    outcome = touch("cube", "--hand", "gesture:tap?rate=100", "--seconds", "9", "--json", "early.json")
    assert (outcome.code, "Ended: Ctrl-C. The outputs are off." in outcome.out) == (130, True)
    assert json.loads(Path("early.json").read_text())["ended"] == "Ctrl-C"


def test_a_lost_device_ends_with_code_4_and_a_record(touch: Run) -> None:
    with Emulator() as emulator:
        emulator.inject(faults.Unplugged(period=10_000))
        outcome = touch("cube", "--hand", "gesture:tap?rate=100", "--device", emulator.url, "--json", "t.json")
    assert outcome.code == 4
    record = json.loads(Path("t.json").read_text())
    assert record["ended"] is None
    assert record["error"]
    assert record["status"] is None
    assert record["touch"]["frames"] > 5
    assert outcome.err.strip().endswith(record["error"])
    assert "The device's watchdog turns the outputs off." in outcome.out


def test_a_lost_tracker_ends_with_code_4_and_the_outputs_off(touch: Run) -> None:
    with LeapService(lambda connection: connection.send(json.dumps(leap_frame()))) as service:
        outcome = touch("cube", "--hand", service.url, "--json", "t.json")
    assert outcome.code == 4
    assert "The outputs are off." in outcome.out
    assert "has closed the connection" in outcome.err
    record = json.loads(Path("t.json").read_text())
    assert (record["ended"], record["status"]["state"]) == (None, "OFF")


def test_an_input_is_not_overwritten(touch: Run) -> None:
    assert touch("cube", *SHORT, "--record", "tap.hands").code == 0
    before = Path("tap.hands").read_bytes()
    again = touch("cube", "--hand", "recording:tap.hands?speed=2", "--record", "tap.hands")
    assert (again.code, "tap.hands cannot be written: it is also what is read" in again.err) == (2, True)
    assert Path("tap.hands").read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "code", "complaint"),
    [
        (("cylinder",), 2, "cylinder"),
        (("cube:colour=red",), 2, "colour"),
        (("nothing.stl",), 2, "nothing.stl"),
        (("cube", "--hand", "telepathy:"), 3, "telepathy:"),
        (("cube", "--hand", "gesture:wave"), 2, "wave"),
        (("cube", "--hand", "recording:nowhere.hands"), 2, "nowhere.hands"),
        (("cube", "--device", "telephone:"), 3, "telephone:"),
        (("cube", "--frequency", "0"), 2, "0"),
        (("cube", "--render", "loud"), 2, "unknown way of rendering 'loud'"),
        (("cube", "--render", "am", "--frequency", "100"), 2, "--frequency has no effect with --render"),
        (("cube", "--render", "am", "--timeline", "t.png"), 2, "leave out --render, or --timeline"),
        (("cube", "--max-exposure", "nan"), 2, "Input should be less than or equal to 200"),
        (("cube", "--method", "magic"), 2, "magic"),
        (("cube", "--ramp", "0.1"), 2, "ramp"),
        (("cube", "--spacing", "nan"), 2, "spacing"),
        (("cube", "--record", "here.json"), 2, ".hands"),
        (("cube", "--picture", "t.txt"), 2, "t.txt"),
        (("cube", "--picture", "t.png", "--json", "t.png"), 2, "twice"),
        (("cube", "--pose", "nowhere.toml"), 2, "nowhere.toml"),
    ],
)
def test_wrong_use_is_refused(
    touch: Run, tmp_path: Path, arguments: tuple[str, ...], code: int, complaint: str
) -> None:
    outcome = touch(*arguments, "--seconds", "0.1")
    assert outcome.code == code
    assert complaint in " ".join(outcome.err.split())
    assert "Traceback" not in outcome.err
    assert list(tmp_path.iterdir()) == []


def test_objects_move_while_they_are_touched(touch: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[TouchMoment] = []
    genuine = TouchLoop._take

    def noted(loop: TouchLoop, frame: HandFrame, stamp: float) -> None:
        loop._on_moment = seen.append
        genuine(loop, frame, stamp)

    monkeypatch.setattr(TouchLoop, "_take", noted)
    assert touch("cube:vx=0.1", *SHORT).code == 0
    first, last = seen[0], seen[-1]
    moved = last.objects[0].centre - first.objects[0].centre
    np.testing.assert_allclose(moved, [0.1 * (last.time - first.time), 0, 0], atol=1e-3)
