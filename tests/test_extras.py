"""What needs a package of an extra says so, and which; a package is hidden as if it were not installed."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.cli.runner import runner


@pytest.mark.parametrize(
    ("package", "extra", "command"),
    [
        ("pytest", "conformance", ["conformance", "--list"]),
        ("cryptography", "signing", ["flash", "plain.dfu", "--key", "key.pem"]),
        ("trimesh", "meshes", ["touch", "cube.stl", "--seconds", "1"]),
    ],
)
def test_a_command_without_its_extra_says_what_to_install(
    package: str,
    extra: str,
    command: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("plain.dfu", "key.pem", "cube.stl"):
        Path(name).write_text("solid a\nendsolid a\n")
    for module in [name for name in sys.modules if name.partition(".")[0] == package]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, package, None)
    done = runner(capsys)(*command)
    assert done.code == 2
    assert f"needs the package {package}" in " ".join(done.err.split())
    assert f"pip install 'phasewire[{extra}]'" in " ".join(done.err.split())
    assert {path.name for path in tmp_path.iterdir()} == {"plain.dfu", "key.pem", "cube.stl"}
