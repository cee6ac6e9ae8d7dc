"""sigrok session files, against their format; the judge of both exports is sigrok itself, in test_export.py."""

from __future__ import annotations

import configparser
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
from phasewire.emulator.ports import excerpt as excerpts
from phasewire.emulator.ports.excerpt import Excerpt
from phasewire.emulator.ports.sigrok import write_sigrok

from tests.hand_made import HandMade


def test_an_archive_written_by_hand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Version 2: the first probe is the lowest bit of a sample's first byte."""
    monkeypatch.setattr(excerpts, "CHUNK_TICKS", 2)
    capture = HandMade.of({0: "00110", 167: "01010", 319: "00001"})
    write_sigrok(tmp_path / "a.sr", Excerpt.of(capture, [167, 319, 0], (1, 5)))
    with ZipFile(tmp_path / "a.sr") as archive:
        assert archive.namelist() == ["version", "metadata", "logic-1-1", "logic-1-2"]
        assert archive.testzip() is None
        assert archive.read("version") == b"2"
        assert archive.read("logic-1-1") + archive.read("logic-1-2") == bytes([0b001, 0b100, 0b101, 0b010])
        metadata = configparser.ConfigParser()
        metadata.read_string(archive.read("metadata").decode("ascii"))
    assert dict(metadata["device 1"]) == {
        "capturefile": "logic-1",
        "total probes": "3",
        "samplerate": "2 MHz",
        "total analog": "0",
        "probe1": "b2p1_07",
        "probe2": "b4p1_31",
        "probe3": "b0p0_00",
        "unitsize": "1",
    }


def test_320_outputs_make_samples_of_40_bytes(tmp_path: Path) -> None:
    words = np.random.default_rng(1).integers(0, 2**32, (9, 10), np.uint32)
    capture = HandMade(words, HandMade.of({0: "0"}).wiring)
    write_sigrok(tmp_path / "a.sr", Excerpt.of(capture))
    with ZipFile(tmp_path / "a.sr") as archive:
        assert b"unitsize=40\n" in archive.read("metadata")
        assert archive.read("logic-1-1") == words.astype("<u4").tobytes()
