"""`phasewire show`, `stream`, `play` and `record`: their frames, their files, and wrong use."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from phasewire import (
    Circle,
    ControlPoints,
    Emulator,
    Medium,
    Pulses,
    TransducerArray,
    render,
    solve,
    sound_pressure_level,
)
from phasewire.emulator import faults
from phasewire.host import Calibration, Recording, record
from phasewire.protocol.quantise import PulseFrames, quantise
from phasewire.solver import transfer_matrix
from phasewire.solver.fields.files import save_solution

from .runner import Run

N = 320
QUICK = ("--rate", "1000", "--seconds", "0.01")


def frames(count: int, channels: int = N) -> PulseFrames:
    """Frame k has the width k + 1 in its transducer k and 0 elsewhere."""
    width = np.zeros((count, channels), np.uint8)
    width[range(count), range(count)] = range(1, count + 1)
    return PulseFrames(np.zeros_like(width), width)


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """One of each kind of file."""
    array = TransducerArray.grid()
    save_solution(tmp_path / "solved.npz", solve(array, ControlPoints([[0, 0, 0.2]]), medium=Medium(30)))
    one, many = frames(1), frames(20)
    np.savez(tmp_path / "one.npz", phase=one.phase[0], width=one.width[0])
    np.savez(tmp_path / "many.npz", phase=many.phase.astype(int), width=many.width.astype(int))
    np.savez(tmp_path / "drives.npz", drives=np.full((20, N), 0.5j))
    record(tmp_path / "slow.frames", many, 500, medium=Medium(25), calibration=Calibration.perfect(N))
    Calibration.perfect(N).save(tmp_path / "perfect.csv")
    return tmp_path


# Playing


@pytest.mark.parametrize("name", ["many.npz", "drives.npz", "slow.frames"])
def test_a_file_of_frames_is_streamed_to_its_end(phasewire: Run, files: Path, name: str) -> None:
    stream = json.loads(phasewire("stream", name, "--json", "-").out)["stream"]
    assert (stream["accepted"], stream["rate"]) == (20, 500 if name == "slow.frames" else 1000)


@pytest.mark.parametrize("source", ["solved.npz", "one.npz", "circle"])
def test_an_endless_source_is_streamed_for_a_second(phasewire: Run, files: Path, source: str) -> None:
    stream = json.loads(phasewire("stream", source, "--rate", "40", "--json", "-").out)["stream"]
    assert stream["accepted"] == 40


def test_pulses_of_many_frames_are_played_as_they_are(phasewire: Run, files: Path) -> None:
    with Emulator(serial="MANY") as emulator:
        outcome = phasewire(
            "stream", "many.npz", "--device", "emulator:MANY", "--rate", "4000", "--modulation", "0", "--json", "-"
        )
        captured = emulator.capture()
    first = json.loads(outcome.out)["stream"]["first_period"]
    for k in range(20):
        drive = np.abs(captured.drive(first + 10 * k + 5))
        assert np.flatnonzero(drive).tolist() == [k]
        assert drive[k] == pytest.approx(np.sin(np.pi * (k + 1) / 50))


BAD: dict[str, tuple[dict[str, NDArray[Any]], str]] = {
    "differ.npz": ({"phase": np.zeros((3, N), int), "width": np.zeros((2, N), int)}, "must both be"),
    "deep.npz": ({"phase": np.zeros((3, N, 1), int), "width": np.zeros((3, N, 1), int)}, "must both be"),
    "float.npz": ({"phase": np.zeros((3, N)), "width": np.zeros((3, N))}, "phase must be whole numbers from 0 on"),
    "negative.npz": ({"phase": np.zeros((3, N), int), "width": np.full((3, N), -1)}, "width must be whole numbers"),
    "wide.npz": ({"phase": np.zeros((3, N), int), "width": np.full((3, N), 282)}, "width 282 of transducer 0 of frame"),
    "flat.npz": ({"drives": np.zeros(N)}, "drives must be complex numbers (k, n)"),
    "text.npz": ({"drives": np.full((2, N), "a")}, "drives must be complex numbers (k, n)"),
    "loud.npz": ({"drives": np.full((2, N), 2.0)}, "drive of transducer 0 of frame 0 has magnitude 2"),
    "few.npz": ({"drives": np.zeros((2, 64))}, "is for 64 transducers, but the device has 320"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_file_of_something_else_is_refused(phasewire: Run, tmp_path: Path, name: str) -> None:
    arrays, said = BAD[name]
    np.savez(tmp_path / name, allow_pickle=False, **arrays)
    outcome = phasewire("stream", name)
    assert outcome.code == 2
    assert said in " ".join(outcome.err.split())


def test_every_command_that_plays_a_file_warns_of_another_array(phasewire: Run, tmp_path: Path) -> None:
    other = TransducerArray.grid(16, 20)
    save_solution(tmp_path / "other.npz", solve(other, ControlPoints([[0, 0, 0.2]])))
    record(tmp_path / "other.frames", frames(2), 100, array=other, medium=Medium(frequency=25_000))
    for line in ("show other.npz --seconds 0", "stream other.npz --seconds 0.01", "stream other.frames"):
        assert phasewire(*line.split()).err.count("was made for something else") == 1 + line.endswith("frames")
    assert "40000 Hz, not 25000 Hz" in phasewire("stream", "other.frames").err


def test_a_stream_is_modulated_from_its_first_frame(phasewire: Run, files: Path) -> None:
    said = phasewire("stream", "drives.npz", "-vv").err
    assert said.index(" ENABLE") < said.index(" MODULATION 2") < said.index(" UPDATE 3")
    assert " MODULATION 2" not in phasewire("stream", "drives.npz", "-vv", "--modulation", "0").err


def test_a_stream_that_fails_leaves_its_counts(phasewire: Run, files: Path) -> None:
    with Emulator(serial="FAILS") as emulator:
        emulator.inject(faults.Unplugged(period=200))
        outcome = phasewire("stream", "circle", "--device", "emulator:FAILS", "--json", "counts.json")
    assert outcome.code == 4
    counts = json.loads((files / "counts.json").read_text())
    assert "gone" in counts["error"]
    assert counts["error"] in " ".join(outcome.err.split())
    assert counts["status"] is None
    assert 0 < counts["stream"]["accepted"] < 1000


# Recording


def test_a_recording_is_recorded_as_it_is(phasewire: Run, files: Path) -> None:
    assert phasewire("record", "slow.frames", "-o", "copy.frames").code == 0
    with Recording.open(files / "slow.frames") as old, Recording.open(files / "copy.frames") as new:
        assert (new.rate, new.medium, new.calibration) == (500, Medium(25), old.calibration)
        for kept, copied in zip(old.read(0, 20), new.read(0, 20), strict=True):
            np.testing.assert_array_equal(copied, kept)
    phasewire("record", "slow.frames", "-o", "copy.frames", "--seconds", "0.01", "--rate", "1000")
    with Recording.open(files / "copy.frames") as new:
        assert (len(new), new.rate) == (10, 1000)


def test_a_solution_is_recorded_with_its_array_and_its_air(phasewire: Run, tmp_path: Path) -> None:
    array = TransducerArray.grid(8, 4, 0.012)
    save_solution(tmp_path / "own.npz", solve(array, ControlPoints([[0, 0, 0.1]]), medium=Medium(35)))
    assert phasewire("record", "own.npz", "-o", "own.frames", "--rate", "10").code == 0
    with Recording.open(tmp_path / "own.frames") as recording:
        assert (len(recording), recording.medium) == (10, Medium(35))
        np.testing.assert_array_equal(recording.array.positions, array.positions)


def test_a_calibration_that_was_not_applied_is_not_recorded(
    phasewire: Run, files: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A calibration from a file of defaults corrects drives; pulses have no drives."""
    (files / "mine.toml").write_text('calibration = "perfect.csv"\n')
    monkeypatch.setenv("PHASEWIRE_CONFIG", "mine.toml")
    for source, recorded in (("many.npz", False), ("drives.npz", True)):
        assert phasewire("record", source, "-o", "made.frames").code == 0
        with Recording.open(files / "made.frames") as recording:
            assert (recording.calibration is not None) == recorded


# Wrong use

USELESS = [
    "stream slow.frames --spin 1",
    "stream solved.npz --spin 1",
    "stream - --spin 1",
    "stream slow.frames --method wgs",
    "stream many.npz --method tikhonov",
    "stream slow.frames --calibration perfect.csv",
    "stream many.npz --calibration perfect.csv",
    "show one.npz --calibration perfect.csv",
    "record slow.frames -o x.frames --calibration perfect.csv",
    "record one.npz -o x.frames --spin 2",
    "stream slow.frames --render am",
    "stream circle --render am --modulation 100",
    "stream circle --render stm --spin 1",
    "record circle -o x.frames --render am --spin 1",
    "play circle --render am --modulation 100",
    "play circle --listeners 0:0:1",
    "stream slow.frames --max-exposure 100",
    "stream slow.frames --interpolate",
    "stream circle --interpolate --render am",
    "play circle --unattended --seconds 2",
    "play circle --unattended --forever",
]


@pytest.mark.parametrize("line", USELESS)
def test_an_option_without_effect_is_refused(phasewire: Run, files: Path, line: str) -> None:
    outcome = phasewire(*line.split())
    assert outcome.code == 2
    assert "no effect" in outcome.err
    assert not (files / "x.frames").exists()


NUMBERS = [
    f"{command} {option} {value}"
    for command, options in {
        "stream circle": ("--seconds", "--rate", "--spin", "--modulation", "--look-ahead"),
        "record circle -o x.frames": ("--seconds", "--rate", "--spin"),
        "show one.npz": ("--seconds",),
        "play circle": ("--seconds", "--modulation"),
    }.items()
    for option in options
    for value in ("inf", "nan", "1e300")
]


@pytest.mark.parametrize("line", NUMBERS)
def test_infinite_and_huge_numbers_are_refused(phasewire: Run, files: Path, line: str) -> None:
    outcome = phasewire(*line.split())
    assert outcome.code == 2
    assert not (files / "x.frames").exists()
    said = " ".join(outcome.err.split())
    assert re.search(rf"Invalid value for '{line.split()[-2]}'|{float(line.split()[-1]):g}", said.replace("+", ""))


@pytest.mark.parametrize("way", ["am", "two-sided", "lm:frequency=100", "stm", "auto", "am:envelope=square"])
def test_a_rendered_recording_holds_its_cycle(phasewire: Run, files: Path, way: str) -> None:
    phasewire("record", "circle", "-o", "x.frames", "--render", way, "--seconds", "0.02")
    cycle = render(TransducerArray.grid(), Circle(), way, "tikhonov")
    wanted = quantise(cycle.drives)
    with Recording.open(files / "x.frames") as kept:
        assert kept.rate == 40_000 / cycle.hold
        assert len(kept) == 800 // cycle.hold
        rows = np.arange(len(kept)) % len(cycle)
        read = kept.read(0, len(kept))
        assert (read.phase == wanted.phase[rows]).all()
        assert (read.width == wanted.width[rows]).all()


@pytest.mark.parametrize("options", ["", "--render stm", "--render two-sided"])
def test_an_exposure_is_kept_at_the_listeners(phasewire: Run, files: Path, options: str) -> None:
    """By the pulses that were recorded: each frame's pressure at the place in its steady state."""
    place, line = np.array([[0.1, -0.4, 0.4]]), ["circle", "-o", "x.frames", "--seconds", "0.01", *options.split()]
    loudest = {}
    for name, limit in (("free", ()), ("kept", ("--max-exposure", "125", "--listeners", "0.1:-0.4:0.4"))):
        phasewire("record", *line, *limit)
        with Recording.open(files / "x.frames") as kept:
            drives = [Pulses(*rows).to_drive() for rows in zip(*kept.read(0, len(kept)), strict=True)]
        field = np.abs(np.array(drives) @ transfer_matrix(TransducerArray.grid(), place).T)
        loudest[name] = float(sound_pressure_level(field.max()))
    assert loudest["free"] > 127
    assert 120 < loudest["kept"] <= 125


def test_frames_are_led_over_into_each_other(phasewire: Run, files: Path) -> None:
    """A phase that jumps by a quarter turn from frame to frame turns steadily instead."""
    np.savez("turns.npz", drives=np.repeat(1j ** np.arange(4)[:, None], N, axis=1))
    phasewire("record", "turns.npz", "--rate", "400", "--interpolate", "-o", "x.frames")
    with Recording.open(files / "x.frames") as kept:
        assert (kept.rate, len(kept)) == (40_000, 400)
        phase = kept.read(100, 400).phase[:, 0].astype(int)  # in hundredths of a turn
    assert (np.diff(phase) >= 0).all()
    assert phase == pytest.approx(np.arange(1, 301) / 4, abs=1)


def test_a_rendered_recording_is_not_modulated_again(phasewire: Run, files: Path) -> None:
    phasewire("record", "circle", "-o", "x.frames", "--render", "stm", "--seconds", "0.01")
    assert "modulated already" in phasewire("stream", "x.frames").err
    assert "modulated already" not in phasewire("stream", "x.frames", "--modulation", "200").err


def test_auto_says_what_it_chose(phasewire: Run) -> None:
    assert "auto is stm" in phasewire("play", "circle:radius=0.02", "--render", "auto", "--seconds", "0").err


def test_a_recording_has_no_room_for_an_envelope(phasewire: Run, files: Path) -> None:
    outcome = phasewire("record", "circle", "-o", "x.frames", "--render", "stm:modulation=200")
    assert outcome.code == 2
    assert "leave modulation out" in outcome.err
    assert not (files / "x.frames").exists()


def test_standard_input_is_solved_line_by_line(phasewire: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO('{"positions": [[0, 0, 0.2]]}\n\n{"positions": [[0.01, 0, 0.2]]}\n'))
    assert json.loads(phasewire("stream", "-", *QUICK, "--json", "-").out)["stream"]["accepted"] == 2
    monkeypatch.setattr("sys.stdin", io.StringIO('{"positions": [[0, 0, 0.2]]}\n{"where": []}\n'))
    outcome = phasewire("stream", "-", *QUICK)
    assert (outcome.code, "standard input, line 2: it must be" in outcome.err) == (2, True)


def test_a_truncated_recording_is_played_to_its_last_whole_frame(files: Path, phasewire: Run) -> None:
    whole = Path("slow.frames").read_bytes()
    Path("cut.frames").write_bytes(whole[:-1000])
    ended = phasewire("record", "cut.frames", "-o", "copy.frames")
    assert (ended.code, "18 frames" in ended.out) == (0, True)
    assert "warning: cut.frames was cut off; it is used up to its last whole frame, 18 in all" in ended.err


# Arrays of a file


def test_an_array_of_a_file_is_solved_for(phasewire: Run, tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text("[[panel]]\ncolumns = 16\nrows = 20\npitch_mm = 12\n")
    assert phasewire("record", "circle", "--array", "rig.toml", "--seconds", "0.002", "-o", "a.frames").code == 0
    with Recording.open(tmp_path / "a.frames") as recording:
        np.testing.assert_allclose(recording.array.positions, TransducerArray.grid(16, 20, 0.012).positions)
    for command in (("stream", *QUICK), ("play", "--seconds", "0")):
        outcome = phasewire(command[0], "circle", "--array", "rig.toml", *command[1:])
        assert outcome.code == 0
        assert "--array was made for something else: the device has 20 × 16 transducers" in " ".join(
            outcome.err.split()
        )


@pytest.mark.parametrize("command", ["stream", "play"])
def test_an_array_that_does_not_fit_the_device_is_refused(phasewire: Run, tmp_path: Path, command: str) -> None:
    (tmp_path / "one.csv").write_text("0,0,0\n")
    outcome = phasewire(command, "circle", "--array", "one.csv")
    assert outcome.code == 2
    assert "--array has 1 transducers, but the device has 320" in " ".join(outcome.err.split())
