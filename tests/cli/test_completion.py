"""Completion by shells."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from phasewire.__main__ import main
from phasewire.host.finding.discovery import Search
from phasewire.host.transports.transport import Found
from phasewire.solver import METHODS
from phasewire.solver.shapes.shapes import SHAPES

BASH, ZSH, FISH = "bash", "zsh", "fish"
SLOW = ("numba", "matplotlib", "cryptography")
Offers = Callable[..., list[str]]


@pytest.fixture
def offers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Offers:
    """The completions of bash for the last of some words, in a new folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("_PHASEWIRE_COMPLETE", "complete_bash")

    def ask(*words: str) -> list[str]:
        monkeypatch.setenv("COMP_WORDS", "\n".join(["phasewire", *words]))
        monkeypatch.setenv("COMP_CWORD", str(len(words)))
        with pytest.raises(SystemExit) as exited:
            main([])
        captured = capsys.readouterr()
        assert (exited.value.code, captured.err) == (0, "")
        return captured.out.split()

    return ask


def test_sources_are_shapes_and_files_of_points(offers: Offers, tmp_path: Path) -> None:
    for name in ("points.csv", "star-like.JSON", "solved.npz", "notes.md"):
        (tmp_path / name).touch()
    assert offers("solve", "") == [*SHAPES, "points.csv", "star-like.JSON"]
    assert offers("solve", "star") == ["star", "star-like.JSON"]
    assert offers("stream", "so") == ["solved.npz"]
    assert offers("solve", "folder/") == []  # the shell's own way to files


def test_values_that_have_names_are_offered(offers: Offers) -> None:
    assert offers("solve", "--method", "") == list(METHODS)
    assert offers("solve", "--method", "p") == ["polish", "paper"]
    assert offers("field", "--plane", "x") == ["xy", "xz"]
    assert offers("emulate", "--speed", "") == ["high", "full"]
    assert offers("budget", "--link", "2") == ["2wire"]


def test_devices_are_offered_by_scheme_and_by_name(offers: Offers, monkeypatch: pytest.MonkeyPatch) -> None:
    looked: list[list[str]] = []

    def search(schemes: list[str]) -> Search:
        looked.append(schemes)
        return Search(
            [Found(f"{name}:PLUGGED", "array", "PLUGGED", "run time", "1.0.0", "1-2") for name in schemes], {}
        )

    monkeypatch.setattr("phasewire.cli.completion.search", search)
    assert {"emulator:", "emulator:PLUGGED", "usb:", "usb:PLUGGED"} <= set(offers("info", "--device", ""))
    assert offers("info", "--device", "emu") == ["emulator:", "emulator:PLUGGED"]
    assert offers("info", "--device", "emulator:P") == ["emulator:PLUGGED"]
    assert offers("info", "--device", "nothing:") == []
    assert looked[1:] == [["emulator"], ["emulator"], []]


def test_completion_works_with_an_invalid_file_of_defaults(
    offers: Offers, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "bad.toml").write_text("bad")
    monkeypatch.setenv("PHASEWIRE_CONFIG", str(tmp_path / "bad.toml"))
    assert offers("sh") == ["show"]


def test_completion_imports_no_slow_module() -> None:
    words = {"COMP_WORDS": "phasewire\ninfo\n--device\n", "COMP_CWORD": "3", "_PHASEWIRE_COMPLETE": "complete_bash"}
    code = f"""
import sys
from phasewire.__main__ import main
from phasewire.host.finding.discovery import Search
from phasewire.host.transports.transport import Found
try:
    main([])
finally:
    print([name for name in {SLOW} if name in sys.modules], file=sys.stderr)
"""
    ended = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True, env=os.environ | words
    )
    assert ended.stderr.strip() == "[]"


def script(shell: str) -> str:
    """The completion script that ``--show-completion`` prints in a shell."""
    ended = subprocess.run(
        [shell, "-c", f"{sys.executable} -m phasewire --show-completion; true"],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    return ended.stdout


@pytest.mark.parametrize("shell", [BASH, ZSH, FISH])
def test_each_shell_gets_a_script_that_it_can_read(shell: str, tmp_path: Path) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    path = tmp_path / "script"
    path.write_text(script(shell))
    assert "_PHASEWIRE_COMPLETE" in path.read_text()
    subprocess.run([shell, "-n", str(path)], check=True, timeout=60)


def test_bash_completes(tmp_path: Path) -> None:
    """With a program of that name on the path, as after an installation."""
    program = tmp_path / "phasewire"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m phasewire "$@"\n')
    program.chmod(0o755)
    typed = f"""
{script(BASH)}
COMP_WORDS=(phasewire info --device emul) COMP_CWORD=3
_phasewire_completion phasewire
printf '%s\\n' "${{COMPREPLY[@]}}"
"""
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}"}
    ended = subprocess.run([BASH, "-c", typed], capture_output=True, text=True, timeout=60, check=True, env=environment)
    assert ended.stdout.split()[0] == "emulator:"
