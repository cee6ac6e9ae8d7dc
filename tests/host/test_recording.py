from __future__ import annotations

import json
import struct
import tracemalloc
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire import Medium, TransducerArray
from phasewire.base.errors import InputFileError
from phasewire.host.streaming.calibration import Calibration
from phasewire.host.streaming.frames import PulseFrames, frame_source
from phasewire.host.streaming.recording import FRAMES_AT_A_TIME, Recording, record

N = 6
GRID = TransducerArray.grid(3, 2, pitch=0.009)
RNG = np.random.default_rng(8)


def some(frames: int, channels: int = N) -> PulseFrames:
    shape = (frames, channels)
    return PulseFrames(RNG.integers(0, 100, shape, dtype=np.uint8), RNG.integers(0, 26, shape, dtype=np.uint8))


LONG = some(3 * FRAMES_AT_A_TIME + 10)
CALIBRATION = Calibration(RNG.uniform(0.5, 2, N), RNG.uniform(-90, 90, N), RNG.choice([1, -1], N), np.arange(N) == 4)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of `LONG`."""
    path = tmp_path_factory.mktemp("recordings") / "long.frames"
    medium = Medium(25.5, 40_000, absorbing=True, humidity=30)
    count = record(
        path, LONG, 1234.5, array=GRID, medium=medium, calibration=CALIBRATION, source="Kreis ø 3 cm, by hand"
    )
    assert count == len(LONG.phase)
    return path


@given(st.integers(0, 800), st.integers(0, 800))
def test_any_part_of_it_can_be_read(path: Path, start: int, stop: int) -> None:
    with Recording.open(path) as recording:
        found = recording.read(start, stop)
        np.testing.assert_array_equal(found.phase, LONG.phase[start:stop])
        np.testing.assert_array_equal(found.width, LONG.width[start:stop])


def test_it_says_what_it_is(path: Path) -> None:
    with Recording.open(path) as recording:
        assert (len(recording), recording.channels, recording.rate) == (778, N, 1234.5)
        assert recording.seconds == pytest.approx(778 / 1234.5)
        assert recording.medium == Medium(25.5, 40_000, absorbing=True, humidity=30)
        assert recording.calibration == CALIBRATION
        assert recording.source == "Kreis ø 3 cm, by hand"
        assert recording.made_by.startswith("phasewire ")
        np.testing.assert_array_equal(recording.array.positions, GRID.positions)
        np.testing.assert_array_equal(recording.array.normals, GRID.normals)


def test_any_program_can_read_it(path: Path) -> None:
    """Only by the table of the module and the standard library's checksums."""
    data = path.read_bytes()
    magic, text_bytes, text_checksum, frames, checksum = struct.unpack_from("<8sIIQI", data)
    text = data[28 : 28 + text_bytes]
    assert (magic, frames, checksum, text_checksum) == (b"PWFRAMES", 778, zlib.crc32(data[:24]), zlib.crc32(text))
    said = json.loads(text)
    assert (said["rate_hz"], said["carrier_hz"], said["ticks_per_period"]) == (1234.5, 40_000, 50)
    assert said["positions"][1][0] - said["positions"][0][0] == pytest.approx(0.009)
    assert said["medium"]["temperature"] == 25.5
    assert said["calibration"]["polarity"] == CALIBRATION.polarity.tolist()
    row = np.dtype([("phase", "u1", N), ("width", "u1", N), ("checksum", "<u4")])
    rows = np.frombuffer(data, row, offset=28 + text_bytes)
    np.testing.assert_array_equal(rows["phase"], LONG.phase)
    np.testing.assert_array_equal(rows["width"], LONG.width)
    pulses = np.concatenate([rows["phase"], rows["width"]], axis=1)
    assert [zlib.crc32(one, number) for number, one in enumerate(pulses)] == rows["checksum"].tolist()


def test_drives_are_recorded_as_the_device_would_get_them(tmp_path: Path) -> None:
    drives = RNG.uniform(-0.7, 0.7, (300, N, 2)) @ [1, 1j]
    played = frame_source(drives, CALIBRATION, N).take(300)
    for frames in (drives, iter(drives)):
        assert record(tmp_path / "made.frames", frames, 500, array=GRID, calibration=CALIBRATION) == 300
        with Recording.open(tmp_path / "made.frames") as recording:
            np.testing.assert_array_equal(recording.read(0, 300), played)
            # No calibration is applied again, whatever the device has.
            np.testing.assert_array_equal(frame_source(recording, CALIBRATION, N).take(300), played)


def test_memory_does_not_grow_with_the_frames(tmp_path: Path) -> None:
    def live(frames: int) -> Iterator[np.ndarray]:
        for _ in range(frames):
            yield np.zeros(320, complex)

    record(tmp_path / "warm.frames", live(10), 1000)
    tracemalloc.start()
    try:
        record(tmp_path / "long.frames", live(3000), 1000)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 1_000_000 < 3000 * 640


# Whole or not at all


def failing() -> Iterator[np.ndarray]:
    for _ in range(FRAMES_AT_A_TIME + 1):
        yield np.zeros(N, complex)
    raise KeyboardInterrupt


def test_what_is_not_finished_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "one.frames"
    record(path, some(1), 100, array=GRID)
    before = path.read_bytes()
    with pytest.raises(KeyboardInterrupt):
        record(path, failing(), 100, array=GRID)
    with pytest.raises(ValueError, match="frame 1: a drive of the shape"):
        record(path, [np.zeros(N, complex), np.zeros(3, complex)], 100, array=GRID)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["one.frames"]


# Damage


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("small") / "small.frames"
    record(path, some(40), 100, array=GRID, calibration=CALIBRATION, source="small")
    return path


def refused(path: Path, message: str) -> None:
    with pytest.raises(InputFileError, match=rf"{path.name}.*{message}"), Recording.open(path) as recording:
        recording.read(0, len(recording))


@pytest.mark.parametrize("flip", [1, 16, 128])
def test_every_byte_has_a_checksum(small: Path, tmp_path: Path, flip: int) -> None:
    good = small.read_bytes()
    path = tmp_path / "damaged.frames"
    for at in range(0, len(good), 7):
        damaged = bytearray(good)
        damaged[at] ^= flip
        path.write_bytes(damaged)
        refused(path, "")


def test_a_frame_in_a_wrong_place_is_noticed(small: Path, tmp_path: Path) -> None:
    good, size = small.read_bytes(), 2 * N + 4
    (tmp_path / "swapped.frames").write_bytes(good[: -2 * size] + good[-size:] + good[-2 * size : -size])
    refused(tmp_path / "swapped.frames", "frame 38 is damaged")
    (tmp_path / "long.frames").write_bytes(good + good[-size:])
    refused(tmp_path / "long.frames", "there is more in it than its 40 frames")


@given(st.floats(0, 1, exclude_max=True))
def test_what_is_cut_off_is_read_up_to_there(
    small: Path, tmp_path_factory: pytest.TempPathFactory, part: float
) -> None:
    path = tmp_path_factory.mktemp("cut") / "cut.frames"
    good = small.read_bytes()
    begin = len(good) - 40 * (2 * N + 4)
    size = int(part * len(good))
    path.write_bytes(good[:size])
    if size < begin:
        refused(path, "cut off|not a recording")
        return
    with Recording.open(path) as cut, Recording.open(small) as whole:
        assert (len(cut), cut.complete) == ((size - begin) // (2 * N + 4), False)
        np.testing.assert_array_equal(cut.read(0, 40), whole.read(0, len(cut)))
        assert whole.complete


def said_otherwise(path: Path, good: bytes, **changes: object) -> None:
    """A recording with other fields in its header, without those that are "gone", and with correct checksums."""
    (size,) = struct.unpack_from("<I", good, 8)
    said = json.loads(good[28 : 28 + size]) | changes
    text = json.dumps({name: value for name, value in said.items() if value != "gone"}).encode()
    path.write_bytes(headed(text, 40) + good[28 + size :])


def headed(text: bytes, frames: int, text_bytes: int | None = None) -> bytes:
    size = len(text) if text_bytes is None else text_bytes
    head = struct.pack("<8sIIQ", b"PWFRAMES", size, zlib.crc32(text), frames)
    return head + zlib.crc32(head).to_bytes(4, "little") + text


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"carrier_hz": 25_000}, "made for a device of carrier_hz 25000; here it is 40000"),
        ({"format": [1, 2]}, "does not say that it is a phasewire-recording-2"),
        ({"rate_hz": -1.0}, "rate -1.0 frames/s"),
        ({"rate_hz": 1e-300}, "rate 1e-300 frames/s must be at least 0.001 frames/s and finite"),
        ({"rate_hz": np.nan}, "rate nan frames/s"),
        ({"rate_hz": 10**400}, "too large"),
        ({"rate_hz": "5"}, "its rate_hz is no float"),
        ({"source": "gone"}, "there is no 'source' in it"),
        ({"source": 5}, "its source is no str"),
        ({"medium": {"temperature": 20.0}}, "there is no 'frequency' in it"),
        ({"medium": None}, "its medium is no dict"),
        ({"positions": GRID.positions[:5].tolist()}, "normals"),
        ({"positions": [[1, 2], [3]]}, "its positions are no table of numbers"),
        ({"positions": [{}]}, "its positions are no table of numbers"),
        ({"positions": []}, "transducer"),
        ({"normals": (2 * GRID.normals).tolist()}, "normal of transducer 0 has length 2"),
        ({"calibration": {"gain": [-1.0] * N}}, "there is no 'phase_deg' in it"),
        (
            {"calibration": {"gain": [-1.0], "phase_deg": [0], "polarity": [1], "dead": [False]}},
            "gain -1 of transducer 0",
        ),
        (
            {"calibration": {"gain": [1.0], "phase_deg": [0], "polarity": [1], "dead": [False]}},
            "calibration of 1 transducers, not 6",
        ),
    ],
)
def test_what_makes_no_sense_is_named(small: Path, tmp_path: Path, changes: dict[str, object], message: str) -> None:
    said_otherwise(tmp_path / "odd.frames", small.read_bytes(), **changes)
    refused(tmp_path / "odd.frames", message)


def test_texts_that_are_too_much_are_refused_before_they_are_read(tmp_path: Path) -> None:
    path = tmp_path / "odd.frames"
    path.write_bytes(headed(b"", 0, 2**32 - 1))
    refused(path, "its text has 4294967295 bytes; it may have at most 1048576")
    path.write_bytes(headed(b"[" * 10**6, 0))
    refused(path, "its text is nested too deeply")
    path.write_bytes(headed(b"\xff", 0))
    refused(path, "no usable recording")


@pytest.mark.parametrize(("name", "at", "value"), [("phase", 0, 100), ("width", N + 3, 26)])
def test_invalid_pulses_are_named(small: Path, tmp_path: Path, name: str, at: int, value: int) -> None:
    data, size = bytearray(small.read_bytes()), 2 * N + 4
    row = data[-size:-4]
    row[at] = value
    data[-size:] = row + zlib.crc32(row, 39).to_bytes(4, "little")
    (tmp_path / "odd.frames").write_bytes(data)
    refused(tmp_path / "odd.frames", f"{name} {value} of transducer {at % N} of frame 39 is above")


def test_reading_a_closed_recording_is_an_error(path: Path) -> None:
    with Recording.open(path) as recording:
        pass
    with pytest.raises(ValueError, match="is closed; open it again"):
        recording.read(0, 1)


def test_frames_of_another_device_are_refused(path: Path) -> None:
    with Recording.open(path) as recording, pytest.raises(ValueError, match="6 transducers for a device with 320"):
        frame_source(recording, None, 320)
