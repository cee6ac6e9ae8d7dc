"""The wheel holds the whole package and no other file."""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ROOMS = ("protocol", "solver", "emulator", "host", "hil", "cli")


@pytest.mark.slow
def test_the_wheel_holds_the_package_and_runs_without_the_repository(tmp_path: Path) -> None:
    clean = tmp_path / "clean"
    shutil.copytree(ROOT, clean, ignore=shutil.ignore_patterns(".*", "build", "typings", "*.egg-info"))
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(tmp_path), str(clean)]
    subprocess.run(build, check=True, timeout=300, capture_output=True)
    (wheel,) = tmp_path.glob("phasewire-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        packed = {name for name in archive.namelist() if ".dist-info/" not in name}
        archive.extractall(tmp_path / "site")
    sources = {f"phasewire/{file.name}" for file in ROOT.glob("*.py")}
    sources |= {f"phasewire/{file.relative_to(ROOT)}" for room in ROOMS for file in (ROOT / room).rglob("*.py")}
    data = {"py.typed", "protocol/SPEC.md", "protocol/vectors.json", "host/finding/60-phasewire.rules"}
    data |= {"hil/guest/init.sh", "hil/guest/begin.sh", "__init__.pyi"}
    assert packed == sources | {f"phasewire/{name}" for name in data}

    program = "import phasewire, phasewire.__main__, sys; sys.exit(phasewire.__file__ != sys.argv[1])"
    where = str(tmp_path / "site" / "phasewire" / "__init__.py")
    environment = {"PYTHONPATH": str(tmp_path / "site"), "PATH": ""}
    subprocess.run([sys.executable, "-c", program, where], check=True, timeout=60, cwd=tmp_path, env=environment)
