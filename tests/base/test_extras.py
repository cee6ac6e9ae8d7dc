"""What needs a package of an extra says so, and which; a package is hidden as if it were not installed."""

from __future__ import annotations

import json
import sys
from importlib.metadata import PathDistribution
from pathlib import Path

import pytest
from phasewire.base.extras import install_command

from tests.cli.runner import runner


@pytest.mark.parametrize(
    ("origin", "command"),
    [
        (None, "pip install 'phasewire[video]'"),
        ({"url": "file:///home/me/it", "dir_info": {"editable": True}}, "pip install --editable '/home/me/it[video]'"),
        ({"url": "file:///home/me/it", "dir_info": {}}, "pip install 'phasewire[video] @ file:///home/me/it'"),
        (
            {"url": "https://example.org/it.git", "vcs_info": {"vcs": "git", "commit_id": "7" * 40}},
            "pip install 'phasewire[video] @ git+https://example.org/it.git'",
        ),
    ],
)
def test_an_extra_comes_from_where_phasewire_came(
    origin: dict[str, object] | None, command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """PEP 610; a folder of metadata without direct_url.json, as a clone has, does not hide that of another."""
    found = [PathDistribution(tmp_path / "phasewire.egg-info"), PathDistribution(tmp_path)]
    if origin is not None:
        (tmp_path / "direct_url.json").write_text(json.dumps(origin))
    monkeypatch.setattr("importlib.metadata.distributions", lambda name: found)
    assert install_command("video") == command


@pytest.mark.parametrize(
    ("package", "extra", "command"),
    [
        ("pytest", "conformance", ["conformance", "--list"]),
        ("cryptography", "signing", ["flash", "plain.dfu", "--key", "key.pem"]),
        ("trimesh", "meshes", ["touch", "cube.stl", "--seconds", "1"]),
        ("pyarrow", "scale", ["sweep", "designs.csv", "-o", "r.parquet"]),
        ("distributed", "scale", ["sweep", "designs.csv", "-o", "r.parquet"]),
        ("mediapipe", "video", ["touch", "sphere", "--hand", "camera:0"]),
        ("mediapipe", "video", ["tracker", "video:cube.stl"]),
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
    Path("designs.csv").write_text("source\nstar\n")
    for module in [name for name in sys.modules if name.partition(".")[0] == package]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, package, None)
    done = runner(capsys)(*command)
    assert done.code == 2
    assert f"needs the package {package}" in " ".join(done.err.split())
    assert install_command(extra) in " ".join(done.err.split())
    assert {path.name for path in tmp_path.iterdir()} == {"plain.dfu", "key.pem", "cube.stl", "designs.csv"}
