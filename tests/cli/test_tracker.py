from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import pytest
from phasewire.host.finding.tracker_checks import TRACKER_CHECKS
from phasewire.host.hands.recording import HandRecording
from websockets.sync.server import ServerConnection

from tests.cli.runner import Run
from tests.host.hands.leap_service import LeapService, leap_frame, sending


@pytest.fixture
def phasewire(phasewire: Run, monkeypatch: pytest.MonkeyPatch) -> Run:
    monkeypatch.setenv("COLUMNS", "300")
    return partial(phasewire, "tracker")


def leap_file(folder: Path, palm: tuple[float, float, float] = (0, 200, 0)) -> str:
    frames = [leap_frame(number, 9000 * number, palm=palm) for number in range(50)]
    (folder / "wave.json").write_text(json.dumps({"metadata": {}, "frames": frames}))
    return f"leap:{folder / 'wave.json'}"


def test_a_recording_is_judged_and_written_in_our_format(phasewire: Run, tmp_path: Path) -> None:
    target = tmp_path / "copy.hands"
    ended = phasewire(leap_file(tmp_path), "--json", "-", "--record", str(target))
    record = json.loads(ended.out)
    assert ended.code == 0
    assert (record["verdict"], record["frames"], record["latency_s"]) == ("ok", 50, None)
    assert record["rate_hz"] == pytest.approx(1e6 / 9000)
    assert [finding["name"] for finding in record["findings"]] == list(TRACKER_CHECKS)
    assert "copy.hands: 50 frames" in ended.err
    with HandRecording.open(target) as recording:
        assert len(list(recording)) == 50
    again = phasewire(f"recording:{target}")
    assert again.code == 0
    assert "111 frames/s" in again.out
    over = phasewire(f"recording:{target}", "--record", str(target))
    assert (over.code, "it is also what is read" in over.err) == (2, True)


def test_a_pose_file_moves_the_hands(phasewire: Run, tmp_path: Path) -> None:
    source = leap_file(tmp_path, (0, 200, -400))
    ended = phasewire(source)
    assert ended.code == 1
    assert "say in a pose file where the tracker is" in ended.out
    (tmp_path / "pose.toml").write_text("translation_mm = [0, -400, 0]\n")
    moved = phasewire(source, "--pose", str(tmp_path / "pose.toml"))
    assert moved.code == 0
    assert "100% of them where they can feel something" in moved.out


def test_a_live_tracker_is_watched(phasewire: Run, tmp_path: Path) -> None:
    def script(connection: ServerConnection) -> None:
        for number in range(10_000):
            connection.send(json.dumps(leap_frame(number, 9000 * number, palm=(0, 200, 0))))
            if service.over.wait(0.009):
                return

    service = LeapService(script)
    with service:
        ended = phasewire(service.url, "--seconds", "1", "--json", str(tmp_path / "a.json"))
    record = json.loads((tmp_path / "a.json").read_text())
    assert record["live"]
    assert record["frames"] >= 1
    assert record["latency_s"]["median"] >= 0
    assert "beyond what every frame needs" in ended.out


def test_without_a_hand_it_fails(phasewire: Run) -> None:
    with LeapService(sending(leap_frame(hands={}), leap_frame(8, hands={}))) as service:
        ended = phasewire(service.url, "--seconds", "0.2")
    assert ended.code == 1
    assert "no hand was in view" in ended.out


def test_a_lost_tracker_is_reported_after_the_findings(phasewire: Run) -> None:
    def script(connection: ServerConnection) -> None:
        connection.send(json.dumps(leap_frame()))

    with LeapService(script) as service:
        ended = phasewire(service.url, "--seconds", "30")
    assert ended.code == 4
    assert "lost after" in ended.out
    assert "has closed the connection" in ended.err


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (("nonsense:",), 3, "the URL of a tracker begins with one of"),
        (("leap:127.0.0.1:9",), 3, "start the Ultraleap service"),
        (("leap:nowhere.json",), 2, "nowhere.json: No such file"),
        (("leap:a b",), 2, "is no address of a service"),
        (("gesture:dance",), 2, "dance"),
        (("--pose", "pose.toml"), 2, "--pose and --record need a source of hands"),
        (("gesture:grasp", "--pose", "nowhere.toml"), 2, "nowhere.toml: No such file"),
        (("gesture:grasp", "--record", "nowhere/a.hands"), 2, "there is no folder nowhere"),
        (("gesture:grasp", "--seconds", "0"), 2, "--seconds"),
    ],
)
def test_wrong_use(arguments: tuple[str, ...], code: int, message: str, phasewire: Run) -> None:
    ended = phasewire(*arguments)
    assert ended.code == code
    assert message in ended.err
