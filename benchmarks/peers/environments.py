"""Peers in environments of their own: making these, and running a contestant's script in one, on one thread.

So the imports of a script meet neither those of another one nor this process's own paths.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

__all__ = [
    "QUIET", "ROOT", "UnavailableError", "enter", "environment", "finish", "machine", "options", "print_remarks",
]  # fmt: skip

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
ENVIRONMENTS = ROOT / ".peers"
INSTALL_SECONDS = 1200.0
PROBE_SECONDS = 60.0
QUIET = 0.9
"""Processor time over wall time, below which the machine was busy with something else."""
ONE_THREAD = dict.fromkeys(
    (
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "NUMEXPR_NUM_THREADS",
        "NUMBA_NUM_THREADS",
        "RAYON_NUM_THREADS",
        "POLARS_MAX_THREADS",
    ),
    "1",
)


class UnavailableError(Exception):
    """A contestant cannot take part; the text says why."""


def last_line(text: str) -> str:
    """The last line of a message that says something."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    errors = [line for line in lines if "error" in line.lower()]
    return (errors or lines or ["no reason given"])[-1][:200]


def command(arguments: list[str], seconds: float, **variables: str) -> str:
    """Run a program without this process's Python paths and return its output; `UnavailableError` if it fails."""
    inherited = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}
    try:
        done = subprocess.run(
            arguments,
            capture_output=True,
            text=True,
            timeout=seconds,
            env=inherited | variables,
            cwd=ROOT,
            check=True,
        )
    except subprocess.TimeoutExpired:
        raise UnavailableError(f"not done after {seconds:.0f} s") from None
    except subprocess.CalledProcessError as error:
        raise UnavailableError(last_line(error.stderr or error.stdout)) from None
    except OSError as error:
        raise UnavailableError(str(error)) from None
    return done.stdout


def environment(name: str) -> str:
    """The peer's Python, in an environment that is made anew if the pinned versions have changed."""
    requirements = HERE / f"{name}.txt"
    folder = ENVIRONMENTS / name
    python, ready = folder / "bin" / "python", folder / "ready"
    wanted = f"{platform.python_version()}\n{requirements.read_text(encoding='utf-8')}"
    if not (ready.is_file() and ready.read_text(encoding="utf-8") == wanted):
        print(f"Setting up {folder.relative_to(ROOT)} (once) ...", flush=True)
        shutil.rmtree(folder, ignore_errors=True)
        try:
            command([sys.executable, "-m", "venv", str(folder)], INSTALL_SECONDS)
            install = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "-r", str(requirements)]
            command([str(python), *install], INSTALL_SECONDS)
            ready.write_text(wanted, encoding="utf-8")
        except (UnavailableError, OSError) as error:
            shutil.rmtree(folder, ignore_errors=True)
            raise UnavailableError(f"not installed: {error}") from None
    return str(python)


def enter(script: str, python: str, save: Callable[[Path], None], seconds: float) -> dict[str, Any]:
    """Run ``script TASK RESULT.json`` on a task and return its record, with the versions installed beside it.

    Parameters
    ----------
    script : str
        Name of a script in this folder.
    python : str
        The environment's.
    save : callable
        Writes the task to a path.
    seconds : float
        Time after which it is stopped.
    """
    with tempfile.TemporaryDirectory() as folder:
        task_path, result_path = Path(folder, "task.npz"), Path(folder, "result.json")
        save(task_path)
        command([python, str(HERE / script), str(task_path), str(result_path)], seconds, **ONE_THREAD, MPLBACKEND="Agg")
        record: dict[str, Any] = json.loads(result_path.read_text(encoding="utf-8"))
    versions = command([python, "-m", "pip", "list", "--format=json", "--disable-pip-version-check"], PROBE_SECONDS)
    record["versions"] = {package["name"]: package["version"] for package in json.loads(versions)}
    return record


def machine() -> dict[str, Any]:
    """What the numbers were measured on."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
        model = next(line.partition(":")[2].strip() for line in text.splitlines() if line.startswith("model name"))
    except (OSError, StopIteration):
        model = platform.processor() or "unknown"
    return {
        "processor": model,
        "cores": os.cpu_count(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "load": os.getloadavg()[0],
    }


def options(doc: str | None, name: str) -> argparse.ArgumentParser:
    """A driver's parser; its record is ``build/NAME.json``."""
    parser = argparse.ArgumentParser(description=(doc or "").partition("\n")[0])
    parser.add_argument("--json", type=Path, default=ROOT / "build" / f"{name}.json", help="the record to write")
    return parser


def print_remarks(remarks: Mapping[str, list[str]], about: dict[str, Any], width: int = 0) -> None:
    """What one must know to read each contestant's numbers, and what they were measured on."""
    for name, texts in remarks.items():
        for i, text in enumerate(texts):
            print(f"  {name + ':' if i == 0 else '':{width or len(name) + 1}} {text}")
    print(
        f"  machine: {about['processor']}, {about['cores']} cores, load {about['load']:.1f} before and "
        f"{os.getloadavg()[0]:.1f} after; {about['system']}, Python {about['python']}"
    )


def finish(path: Path, about: dict[str, Any], begun: float, **record: Any) -> None:
    """Write the record, and say where it is."""
    path.parent.mkdir(parents=True, exist_ok=True)
    about["load_after"] = os.getloadavg()[0]
    path.write_text(json.dumps({"machine": about, **record}, indent=1), encoding="utf-8")
    print(f"\n{time.monotonic() - begun:.0f} s in all; all numbers and versions are in {path}")
