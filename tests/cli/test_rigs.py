"""Commands with a rig: several devices as one, and a plain word where only one is meant."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from phasewire.emulator.cluster import Cluster
from phasewire.emulator.machine import Emulator

from .runner import Run

RIG = """
[[device]]
name = "below"
url = "emulator:RIG-00"

[[device]]
name = "above"
url = "emulator:RIG-01"
rotation_degrees = [180, 0, 0]
translation_mm = [0, 0, 200]
"""
CIRCLE = "circle:radius=0.02,height=0.1"


@pytest.fixture
def cluster(phasewire: Run, monkeypatch: pytest.MonkeyPatch) -> Iterator[Cluster]:
    """Two devices, and their rig file in the current folder."""
    Path("rig.toml").write_text(RIG)
    monkeypatch.setenv("COLUMNS", "200")
    with Cluster(2, serial="RIG") as devices:
        yield devices


def silent(emulator: Emulator) -> bool:
    emulator.run(7)
    capture = emulator.capture()
    return not capture.bits(capture.end_tick - 50, capture.end_tick).any()


def test_devices_of_a_rig_are_shown_as_one(phasewire: Run, cluster: Cluster) -> None:
    shown = phasewire("devices", "--rig", "rig.toml")
    assert shown.code == 0
    assert re.search(r"above +│ emulator:RIG-01 +│ RIG-01 +│ 320 +│ 0 0 200 +│ 0 0 -1 +│ 0 ", shown.out)
    assert "2 devices, 640 transducers, one clock: the devices share a sync line." in shown.out
    for command in (("devices", "--rig", "rig.toml"), ("info", "--device", "rig:rig.toml")):
        record = json.loads(phasewire(*command, "--json", "-").out)
        assert (record["format"], record["sync_line"], record["apart_seconds"]) == ("phasewire-rig-1", True, 0)
        assert [each["serial"] for each in record["devices"]] == ["RIG-00", "RIG-01"]


def test_a_missing_device_of_a_rig_is_shown_beside_the_others(phasewire: Run, cluster: Cluster) -> None:
    cluster.devices[1].close()
    shown = phasewire("devices", "--rig", "rig.toml", "--json", "seen.json")
    assert shown.code == 3
    assert "above: " in shown.err
    below, above = json.loads(Path("seen.json").read_text())["devices"]
    assert (below["serial"], below["problem"]) == ("RIG-00", None)
    assert above["problem"]


def test_devices_without_a_sync_line_are_told_with_their_error(phasewire: Run, cluster: Cluster) -> None:
    from phasewire.emulator.boards.sync import SyncLine

    with Emulator(serial="ALONE", sync=SyncLine()):  # waits 5 s for a pulse
        Path("rig.toml").write_text(RIG.replace("RIG-01", "ALONE"))
        shown = phasewire("devices", "--rig", "rig.toml", "--json", "seen.json")
        played = phasewire("stop", "--device", "rig:rig.toml")
    assert "silenced by a fault: SYNC" in shown.out
    assert re.search(r"estimated to \d+ µs; .* no coherent focus", shown.out)
    record = json.loads(Path("seen.json").read_text())
    assert not record["sync_line"]
    assert 0 < record["apart_seconds"] < 1e-3
    assert played.code == 0


def test_what_is_solved_for_a_rig_is_shown_on_all_its_devices(phasewire: Run, cluster: Cluster) -> None:
    assert phasewire("solve", CIRCLE, "--array", "rig.toml", "-o", "c.npz").code == 0
    shown = phasewire("show", "c.npz", "--device", "rig:rig.toml", "--seconds", "0.1", "--json", "shown.json")
    assert (shown.code, shown.out) == (0, "Stopped; the outputs are off.\n")
    assert "rig of 2 devices (RIG-00, RIG-01) plays c.npz" in shown.err
    begins = json.loads(Path("shown.json").read_text())["commit_period"]
    one, other = (device.capture() for device in cluster)
    assert one.latches[0][0] == other.latches[0][0] == begins * 50
    drives = [np.abs(capture.drive(begins)) for capture in (one, other)]
    assert all(drive.max() > 0.9 for drive in drives)
    assert all(silent(device) for device in cluster)


@pytest.mark.parametrize(
    "command", [("stream", CIRCLE, "--spin", "5"), ("play", CIRCLE), ("play", CIRCLE, "--render", "stm")]
)
def test_points_are_solved_for_the_rig_and_played_in_step(
    phasewire: Run, cluster: Cluster, command: tuple[str, ...]
) -> None:
    played = phasewire(*command, "--device", "rig:rig.toml", "--seconds", "0.05", "--json", "played.json")
    assert played.code == 0, played.err
    one, other = (device.capture().latches[0] for device in cluster)
    assert one == other
    assert all(silent(device) for device in cluster)


def test_stop_reaches_the_others_if_a_device_is_missing(phasewire: Run, cluster: Cluster) -> None:
    stopped = phasewire("stop", "--device", "rig:rig.toml", "--json", "stopped.json")
    assert stopped.code == 0
    cluster.devices[0].close()
    stopped = phasewire("stop", "--device", "rig:rig.toml", "--json", "stopped.json")
    assert stopped.code == 3
    assert "above: " in stopped.out
    assert "below: " in stopped.err
    missing, stood = json.loads(Path("stopped.json").read_text())["devices"]
    assert "below" in missing["problem"]
    assert stood["status"]["state"] == "OFF"


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("reset --device rig:rig.toml", "is several devices, and this is for one"),
        ("doctor --device rig:rig.toml", "is several devices, and this is for one"),
        ("touch cube --device rig:rig.toml", "is several devices, and this is for one"),
        ("stream circle --view --device rig:rig.toml", "--view is for one device, not for a rig"),
        ("play circle --view --device rig:rig.toml", "--view is for one device, not for a rig"),
        ("stream circle --reconnect --device rig:rig.toml", "--reconnect is for one device, not for a rig"),
        ("stream circle --calibration c.csv --device rig:rig.toml", "in rig.toml each device names its own"),
        ("stream circle --array rig.toml --device rig:rig.toml", "--array has no effect on a rig"),
        ("show one.npz --device rig:rig.toml", "is for 320 transducers, but the rig's 2 devices have 640"),
        ("show one.npz --device rig:none.toml", "none.toml: No such file"),
        ("devices --rig one.npz", "one.npz"),
    ],
)
def test_what_a_rig_cannot_do_is_said_before_anything_is_played(
    phasewire: Run, cluster: Cluster, command: str, message: str
) -> None:
    np.savez("one.npz", phase=np.zeros(320, np.uint8), width=np.zeros(320, np.uint8))
    refused = phasewire(*command.split())
    assert refused.code == 2
    assert message in refused.err
    assert all(not device.capture().latches[0] for device in cluster)
