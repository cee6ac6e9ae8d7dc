"""``phasewire view``, and ``--view`` of other commands, as processes that a page speaks with."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from phasewire import Pulses, record

from tests.view.pages import Message, Page, page_of

from .runner import Run

pytestmark = pytest.mark.slow  # each begins processes

PATIENCE = 120.0


@contextmanager
def viewing(*arguments: str, folder: Path | None = None) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A command, and the link that it prints."""
    process = subprocess.Popen(
        [sys.executable, "-m", "phasewire", *arguments],
        cwd=folder,
        env=os.environ | {"BROWSER": "true", "COLUMNS": "200"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stderr is not None
        said = ""
        for line in process.stderr:
            said += line
            if found := re.search(r"http://\S+", line):
                yield process, found[0]
                break
        else:
            raise AssertionError(said)
    finally:
        process.kill()
        process.communicate()


def sounding(frame: Message) -> bool:
    return bool(frame.array("amplitude").any())


def test_the_page_of_a_cube_sounds_and_ctrl_c_ends_it(tmp_path: Path) -> None:
    report = tmp_path / "view.json"
    with viewing("view", "cube", "--no-browser", "--json", str(report)) as (process, url):
        with page_of(url) as page:
            page.until(sounding)
            assert page.kept["setup"]["object_kinds"][0] == "cone"
            process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=PATIENCE)
        assert (process.returncode, "Traceback" in err) == (0, False)
        assert out == "The outputs are off.\n"
    told = json.loads(report.read_text())
    assert told["format"] == "phasewire-view-1"
    assert told["status"]["state"] == "OFF"


def test_a_mesh_file_is_an_object_and_no_other_file_can_be_had(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box((0.05, 0.06, 0.07)).export(tmp_path / "box.stl")
    with viewing("view", "box.stl:scale=1", "--no-browser", folder=tmp_path) as (_, url), page_of(url) as page:
        page.until(sounding)
        assert page.kept["settings"]["values"]["objects"][0]["kind"] == "box.stl"
        page.set(objects=[{"kind": str(tmp_path / "box.stl")}])
        assert "must be one of" in page.notice()


def test_a_recording_is_shown_without_a_device(tmp_path: Path) -> None:
    record(tmp_path / "two.frames", [Pulses(np.full(320, 10), np.full(320, width)) for width in (25, 4)], 1.0)
    with viewing("view", "two.frames", "--no-browser", folder=tmp_path) as (_, url), page_of(url) as page:
        page.set(running=False, at=40_000)
        frame = page.until(lambda message: message["period"] == 40_000)
        assert set(frame.array("amplitude").tolist()) == {round(255 * np.sin(np.pi * 4 / 50))}
        assert frame["state"] == "recording"


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (("touch", "cube", "--hand", "gesture:sweep"), 4),
        (("touch", "cube", "--hand", "gesture:sweep", "--render", "stm"), 4),
        (("play", "circle", "--forever"), 4),
        (("stream", "circle", "--spin", "1", "--forever"), 4),
    ],
    ids=["touch", "touch in another way", "play", "stream"],
)
def test_a_command_is_watched_and_stopped_by_its_page(arguments: tuple[str, ...], code: int) -> None:
    with viewing(*arguments, "--view") as (process, url), page_of(url) as page:
        frame = page.until(sounding)
        assert frame["source"] == "bits of the emulated boards"
        later = page.until(lambda message: message["period"] > frame["period"] + 10_000)
        assert later["figures"]
        page.set(amplitude=0.5)
        assert "only watches" in page.notice()
        page.do("stop")
        drain(page)
        _, err = process.communicate(timeout=PATIENCE)
        assert (process.returncode, "Traceback" in err) == (code, False), err
        assert "stopped" in err or "turned" in err


def drain(page: Page) -> None:
    """Take what comes until the connection ends."""
    for _ in page.socket:
        page.socket.send("ack")


def test_a_page_that_is_closed_stops_the_command_that_it_watched() -> None:
    with viewing("play", "circle", "--forever", "--view") as (process, url):
        with page_of(url) as page:
            page.until(sounding)
        _, err = process.communicate(timeout=PATIENCE)
        assert (process.returncode, "Traceback" in err) == (4, False), err


def test_a_stream_keeps_the_pace_of_the_wall_clock(tmp_path: Path) -> None:
    report = tmp_path / "stream.json"
    command = ("stream", "circle", "--seconds", "2", "--rate", "200", "--view", "--json", str(report))
    with viewing(*command) as (process, url):
        began = time.monotonic()
        with page_of(url) as page:
            first = page.until(sounding)["period"]
            last = page.until(lambda message: message["period"] > first + 40_000)["period"]
            assert 1 < (last - first) / 40_000 < time.monotonic() - began  # by itself it would be faster
            drain(page)
        process.communicate(timeout=PATIENCE)
        assert process.returncode == 0
    told = json.loads(report.read_text())["stream"]
    assert (told["accepted"], told["late"], told["underruns"]) == (400, 0, 0)


@pytest.mark.parametrize(
    "arguments", [("play", "circle", "--forever"), ("stream", "circle", "--forever")], ids=["play", "stream"]
)
def test_a_page_that_is_closed_before_anything_plays_stops_the_command_too(arguments: tuple[str, ...]) -> None:
    with viewing(*arguments, "--view") as (process, url):
        with page_of(url):
            pass
        _, err = process.communicate(timeout=PATIENCE)
        assert (process.returncode, "Traceback" in err) == (4, False), err


def test_the_demo_shows_its_result_until_the_page_is_closed(tmp_path: Path) -> None:
    with viewing("demo", "--view", folder=tmp_path) as (process, url):
        with page_of(url) as page:
            frame = page.until(sounding)
            assert len(frame.array("points")) == 17
            assert process.poll() is None
        assert process.wait(PATIENCE) == 0


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (("view", "cubus"), 2, "unknown object 'cubus'"),
        (("view", "cube", "--save", "cube.gif"), 2, "must end in .png"),
        (("view", "missing.frames"), 2, "missing.frames"),
        (("view", "cube", "--listen", "256.1.1.1", "--no-browser"), 2, "256.1.1.1"),
        (("view", "cube", "--hand", "nothing:", "--no-browser"), 3, "nothing"),
        (("view", "cube", "--device", "usb:nothing", "--no-browser"), 3, "nothing"),
        (("view", "any.frames", "--device", "usb:"), 2, "--device has no effect on a recording"),
        (("view", "any.frames", "cube"), 2, "a recording is shown alone"),
        (("view", "cube", "--listen", "a..b", "--no-browser"), 2, "a..b"),
        (("view", *["cube"] * 9), 2, "at most 8"),
        (("play", "circle", "--unattended", "--view"), 2, "leave out --view"),
    ],
)
def test_what_cannot_be_shown_is_said(phasewire: Run, arguments: tuple[str, ...], code: int, said: str) -> None:
    ended = phasewire(*arguments)
    assert ended.code == code
    assert said in ended.err


def test_a_picture_without_a_browser_says_what_it_needs(
    phasewire: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PHASEWIRE_BROWSER", "no-such-browser")
    ended = phasewire("view", "cube", "--save", str(tmp_path / "cube.png"))
    assert (ended.code, list(tmp_path.iterdir())) == (2, [])
    assert "no-such-browser, which PHASEWIRE_BROWSER names, is not installed" in ended.err


def test_another_address_says_what_it_means(phasewire: Run) -> None:
    ended = phasewire("view", "cube", "--listen", "0.0.0.0", "--no-browser", "--unwatched", "--seconds", "0.1")
    assert ended.code == 0
    assert "can command the device, and the connection is not encrypted" in ended.err
