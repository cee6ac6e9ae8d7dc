"""Rules that hold for every command: what a SOURCE may be, texts that people copy, closed streams, no more threads."""

from __future__ import annotations

import io
import sys
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
from phasewire import ControlPoints, Solution, TransducerArray, solve
from phasewire.emulator.cluster import Cluster
from phasewire.host.streaming.recording import record
from phasewire.solver.fields.files import save_solution
from rich.console import Console

from .runner import Run

# What a SOURCE may be

POINTS_ONLY = "but this command takes points; `phasewire stream"
LINE = '{"positions": [[0, 0, 0.2]]}\n'
SOURCES = {
    "circle:radius=0.02": "shape",
    "points.csv": "points",
    "-": "input",
    "solved.npz": "solved",
    "pulses.npz": "pulses",
    "drives.npz": "drives",
    "a.frames": "recording",
}
WRONG = {
    "circel:radius=0.02": "did you mean circle?",
    "Star": "did you mean star?",
    "no-such.csv": "no-such.csv: No such file",
    "cube": "it is an object for `phasewire touch`",
}
COMMANDS: dict[str, tuple[str, dict[str, str]]] = {
    "solve": ("solve {} -o out.npz", dict.fromkeys(("solved", "pulses", "drives", "recording"), POINTS_ONLY)),
    "field": (
        "field {} -o out.npz --step 0.02",
        {"pulses": "is no", "drives": "is no", "recording": POINTS_ONLY},
    ),
    "focus": ("focus {}", {"pulses": "is no", "drives": "is no", "recording": POINTS_ONLY}),
    "feel": ("feel {} --render lm", dict.fromkeys(("solved", "pulses", "drives", "recording"), POINTS_ONLY)),
    "play": ("play {} --seconds 0", dict.fromkeys(("solved", "pulses", "drives", "recording"), POINTS_ONLY)),
    "show": ("show {} --seconds 0", dict.fromkeys(("drives", "recording"), "holds many frames; `phasewire stream")),
    "stream": ("stream {} --seconds 0.01", {}),
    "record": ("record {} --seconds 0.01 -o out.frames", {}),
}
"""Commands, and their errors about kinds of sources; they take all others."""


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sources")
    solution: Solution = solve(TransducerArray.grid(), ControlPoints([[0, 0, 0.2]]))
    (folder / "points.csv").write_text("0,0,0.2\n")
    save_solution(folder / "solved.npz", solution)
    np.savez(folder / "pulses.npz", phase=np.zeros(320, np.uint8), width=np.full(320, 5, np.uint8))
    np.savez(folder / "drives.npz", drives=np.stack([solution.drive] * 3))
    record(folder / "a.frames", [solution] * 3, 1000.0)
    return folder


def outcome_of(command: str, source: str, phasewire: Run, files: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(files)
    monkeypatch.setattr("sys.stdin", io.StringIO(LINE))
    outcome = phasewire(*COMMANDS[command][0].format(source).split())
    assert outcome.code == (2 if "phasewire: " in outcome.err else 0), outcome.err
    return " ".join(outcome.err.split())


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_says_what_is_wrong_with_a_source(
    command: str, phasewire: Run, files: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    refused = {source: said for source, kind in SOURCES.items() if (said := COMMANDS[command][1].get(kind))}
    for source, said in (WRONG | refused).items():
        assert said in outcome_of(command, source, phasewire, files, monkeypatch), source


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_takes_every_other_kind_of_source(
    command: str, phasewire: Run, files: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for source, kind in SOURCES.items():
        if kind not in COMMANDS[command][1]:
            assert "phasewire: " not in outcome_of(command, source, phasewire, files, monkeypatch), source


# Texts that people copy

SERIAL = "SERIAL-NUMBER-" + 20 * "x"
LISTS: dict[str, tuple[str, ...]] = {
    "devices": (f"emulator:{SERIAL}-0", f"{SERIAL}-0"),
    "devices --rig rig.toml": (f"emulator:{SERIAL}-0", f"{SERIAL}-0"),
    f"flash --list --device emulator:{SERIAL}-0": (f"emulator:{SERIAL}-0",),
    "tracker": ("camera:NUMBER", "recording:FILE"),
    "config": ("conformance", "max-exposure"),
    f"info --device emulator:{SERIAL}-0": (f"{SERIAL}-0",),
}


@pytest.mark.parametrize("terminal", [True, False], ids=["terminal", "pipe"])
@pytest.mark.parametrize("command", LISTS)
def test_what_people_copy_is_whole_at_every_width(
    command: str, terminal: bool, phasewire: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Console, "is_terminal", terminal)
    with Cluster(1, serial=SERIAL) as devices:
        urls = [device.url for device in devices]
        Path("rig.toml").write_text(f'[[device]]\nname = "one"\nurl = "{urls[0]}"\n')
        for columns in ("40", "80", "120"):
            monkeypatch.setenv("COLUMNS", columns)
            outcome = phasewire(*command.split())
            assert outcome.code == 0, outcome.err
            for text in LISTS[command]:
                assert text in outcome.out, columns


# Closed streams, no more threads

READERS = ("stream -", "record - -o out.frames", "decode -", "solve - -o out.npz", "show -", "play -", "focus -")


@pytest.mark.parametrize("command", [*READERS, "feel -", "field - -o out.npz"])
def test_a_closed_standard_input_is_an_error_that_says_so(
    command: str, phasewire: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", None)  # as the interpreter has it after <&-
    outcome = phasewire(*command.split())
    assert outcome.code == 2
    assert "phasewire: standard input is closed; give it a file or a pipe" in " ".join(outcome.err.split())
    assert not list(Path().iterdir())


@pytest.mark.parametrize("stream", ["stdout", "stderr"])
def test_without_an_output_a_command_still_does_its_work(
    stream: str, phasewire: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, stream, None)
    assert phasewire("solve", "circle", "-o", "out.npz").code == 0
    assert phasewire("solve", "circel", "-o", "no.npz").code == 2
    assert [path.name for path in Path().iterdir()] == ["out.npz"]


def test_a_system_without_more_threads_is_an_error_that_says_so(
    phasewire: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def start(_: Thread) -> None:
        raise RuntimeError("can't start new thread")  # as `threading` does at the limit of `ulimit -u`

    monkeypatch.setattr(Thread, "start", start)
    outcome = phasewire("touch", "sphere", "--hand", "gesture:tap?seconds=0.1")
    monkeypatch.undo()
    assert outcome.code == 2
    assert "phasewire: the system starts no more threads for this user" in " ".join(outcome.err.split())
