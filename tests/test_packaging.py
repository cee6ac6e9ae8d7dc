"""The sdist holds all that is developed, and the wheel made of it the whole package and no other file."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ROOMS = ("base", "protocol", "solver", "firmware", "emulator", "host", "hil", "feel", "view", "cli")
BESIDE = ("benchmarks", "docs", "examples", "tests")
C_DEVICE = {
    f"firmware/{part}" for part in ("build", "core", "cortex_m33", "fuzz", "library", "posix", "python", "tests")
}
LEFT_OUT = {"hil/conformance/mutants", *C_DEVICE}
"""Folders of rooms that the sdist holds and the wheel does not."""
ALONE = {"CHANGELOG.md", "CONTRIBUTING.md", "LICENSE", "Makefile", "README.md", "pyproject.toml"}


@pytest.mark.slow
def test_the_sdist_and_its_wheel_are_whole_and_the_package_runs_without_the_repository(tmp_path: Path) -> None:
    clean, tools = tmp_path / "clean", tmp_path / "tools"
    shutil.copytree(ROOT, clean, ignore=shutil.ignore_patterns(".*", "build", "typings", "*.egg-info", "__pycache__"))
    developed = {path.relative_to(clean).as_posix() for room in (*ROOMS, *BESIDE) for path in (clean / room).rglob("*")}
    pip = [sys.executable, "-m", "pip"]
    get = [*pip, "install", "--quiet", "--target", str(tools), "setuptools>=77"]
    pack = [sys.executable, "-c", "from setuptools import build_meta; build_meta.build_sdist('..')"]
    for command in (get, pack):
        environment = os.environ | {"PYTHONPATH": str(tools)}
        subprocess.run(command, check=True, timeout=300, capture_output=True, cwd=clean, env=environment)
    (sdist,) = tmp_path.glob("phasewire-*.tar.gz")
    with tarfile.open(sdist) as packed_sources:
        there = {name.partition("/")[2] for name in packed_sources.getnames()}
    assert developed | ALONE <= there
    build = [*pip, "wheel", "--quiet", "--no-deps", "--wheel-dir", str(tmp_path), str(sdist)]
    subprocess.run(build, check=True, timeout=300, capture_output=True)
    (wheel,) = tmp_path.glob("phasewire-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        packed = {name for name in archive.namelist() if ".dist-info/" not in name}
        archive.extractall(tmp_path / "site")
    files = [file.relative_to(ROOT) for room in ROOMS for file in (ROOT / room).rglob("*.*") if file.is_file()]
    kept = [file for file in files if not LEFT_OUT & {parent.as_posix() for parent in file.parents}]
    expected = {file.name for file in ROOT.glob("*.py")} | {"__init__.pyi", "py.typed"}
    expected |= {file.as_posix() for file in kept if file.suffix in {".py", ".pyi"}}
    expected |= {file.as_posix() for file in kept if file.suffix in {".bin", ".c", ".h", ".map", ".s", ".sh"}}
    expected |= {"protocol/SPEC.md", "protocol/vectors.json", "host/finding/60-phasewire.rules"}
    expected |= {f"view/page/{name}" for name in ("index.html", "page.css", "page.js", "scene.js")}
    assert packed == {f"phasewire/{name}" for name in expected}

    program = "import phasewire, phasewire.__main__, sys; sys.exit(phasewire.__file__ != sys.argv[1])"
    where = str(tmp_path / "site" / "phasewire" / "__init__.py")
    environment = {"PYTHONPATH": str(tmp_path / "site"), "PATH": ""}
    subprocess.run([sys.executable, "-c", program, where], check=True, timeout=60, cwd=tmp_path, env=environment)
