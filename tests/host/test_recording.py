from __future__ import annotations

import tracemalloc
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire import Emulator, Medium, TransducerArray, open_device
from phasewire.errors import InputFileError
from phasewire.host.playing.calibration import Calibration
from phasewire.host.playing.frames import PulseFrames, frame_source
from phasewire.host.playing.recording import CHUNK_FRAMES, Recording, record

N = 6
GRID = TransducerArray.grid(3, 2, pitch=0.009)
RNG = np.random.default_rng(8)


def some(frames: int, channels: int = N) -> PulseFrames:
    shape = (frames, channels)
    return PulseFrames(RNG.integers(0, 100, shape, dtype=np.uint8), RNG.integers(0, 26, shape, dtype=np.uint8))


LONG = some(3 * CHUNK_FRAMES + 10)
CALIBRATION = Calibration(RNG.uniform(0.5, 2, N), RNG.uniform(-90, 90, N), RNG.choice([1, -1], N), np.arange(N) == 4)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of `LONG`."""
    path = tmp_path_factory.mktemp("recordings") / "long.h5"
    medium = Medium(25.5, 40_000, absorbing=True, humidity=30)
    count = record(
        path, LONG, 1234.5, array=GRID, medium=medium, calibration=CALIBRATION, source="Kreis ø 3 cm, by hand"
    )
    assert count == len(LONG.phase)
    return path


@given(takes=st.lists(st.integers(1, 700), min_size=1, max_size=6))
def test_what_is_played_again_is_the_same_bit_by_bit(path: Path, takes: list[int]) -> None:
    with Recording.open(path) as recording:
        source = frame_source(recording, None, N)
        at, turn = 0, 0
        while len((taken := source.take(takes[turn % len(takes)])).phase):
            end = at + takes[turn % len(takes)]
            np.testing.assert_array_equal(taken, PulseFrames(LONG.phase[at:end], LONG.width[at:end]))
            at, turn = min(end, len(recording)), turn + 1
        assert at == len(LONG.phase)


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
    """By names alone, as the module promises, and without plug-ins."""
    with h5py.File(path) as file:
        np.testing.assert_array_equal(file["phase"], LONG.phase)
        np.testing.assert_array_equal(file["width"], LONG.width)
        assert (file["phase"].compression, file["phase"].fletcher32) == ("gzip", True)
        assert (file.attrs["rate_hz"], file.attrs["carrier_hz"], file.attrs["ticks_per_period"]) == (1234.5, 40_000, 50)
        assert file["positions"][1, 0] - file["positions"][0, 0] == pytest.approx(0.009)
        assert file["medium"].attrs["temperature"] == 25.5
        np.testing.assert_array_equal(file["calibration/polarity"], CALIBRATION.polarity)


def test_drives_are_recorded_as_the_device_would_get_them(tmp_path: Path) -> None:
    drives = RNG.uniform(-0.7, 0.7, (300, N, 2)) @ [1, 1j]
    played = frame_source(drives, CALIBRATION, N).take(300)
    for frames in (drives, iter(drives)):
        assert record(tmp_path / "made.h5", frames, 500, array=GRID, calibration=CALIBRATION) == 300
        with Recording.open(tmp_path / "made.h5") as recording:
            np.testing.assert_array_equal(recording.read(0, 300), played)
            # No calibration is applied again, whatever the device has.
            np.testing.assert_array_equal(frame_source(recording, CALIBRATION, N).take(300), played)


def test_by_default_it_is_of_the_board_and_says_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "plain.h5"
    record(path, some(2, 320), 100)
    with Recording.open(path) as recording:
        np.testing.assert_array_equal(recording.array.positions, TransducerArray.grid().positions)
        assert (recording.medium, recording.calibration, recording.source) == (Medium(), None, "")


def test_a_recording_can_be_recorded(path: Path, tmp_path: Path) -> None:
    with Recording.open(path) as recording:
        record(tmp_path / "copy.h5", recording, 1, array=GRID)
    with Recording.open(tmp_path / "copy.h5") as copy:
        np.testing.assert_array_equal(copy.read(0, 1000), LONG)


def test_nothing_can_be_recorded(tmp_path: Path) -> None:
    assert record(tmp_path / "empty.h5", [], 100) == 0
    with Recording.open(tmp_path / "empty.h5") as recording:
        assert frame_source(recording, None, 320).take(4).phase.shape == (0, 320)


def test_it_plays_on_a_device(tmp_path: Path) -> None:
    """What the outputs emit is what was recorded."""
    frames = some(3, 320)
    record(tmp_path / "three.h5", frames, 1000)
    with Recording.open(tmp_path / "three.h5") as recording, Emulator() as emulator:
        with open_device(emulator.url) as device:
            report = device.stream(recording, recording.rate)
        assert report.accepted == 3
        capture = emulator.capture()
        emitted = capture.drive(report.first_period + 45)
    angle = 2 * np.pi * (2 * ((frames.phase[1].astype(int) - frames.width[1]) // 2) + frames.width[1]) / 100
    np.testing.assert_allclose(emitted, np.sin(np.pi * frames.width[1] / 50) * np.exp(1j * angle), atol=1e-9)


def test_memory_does_not_grow_with_the_frames(tmp_path: Path) -> None:
    def live(frames: int) -> Iterator[np.ndarray]:
        for _ in range(frames):
            yield np.zeros(320, complex)

    record(tmp_path / "warm.h5", live(10), 1000)
    tracemalloc.start()
    try:
        record(tmp_path / "long.h5", live(3000), 1000)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 1_000_000 < 3000 * 640


# Whole or not at all


def failing() -> Iterator[np.ndarray]:
    for _ in range(CHUNK_FRAMES + 1):
        yield np.zeros(N, complex)
    raise KeyboardInterrupt


def test_what_is_not_finished_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "one.h5"
    record(path, some(1), 100, array=GRID)
    before = path.read_bytes()
    with pytest.raises(KeyboardInterrupt):
        record(path, failing(), 100, array=GRID)
    with pytest.raises(ValueError, match="frame 1: a drive of the shape"):
        record(path, [np.zeros(N, complex), np.zeros(3, complex)], 100, array=GRID)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["one.h5"]


@pytest.mark.parametrize("rate", [0, -1, np.nan, np.inf])
def test_a_rate_is_positive(tmp_path: Path, rate: float) -> None:
    with pytest.raises(ValueError, match=f"a rate of {rate:g} frames/s must be positive and finite"):
        record(tmp_path / "none.h5", some(1), rate, array=GRID)
    assert not list(tmp_path.iterdir())


def test_a_recording_must_be_a_file(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="a recording must be a plain file"):
        record(Path("/dev/null"), some(1), 100, array=GRID)
    with pytest.raises(OSError, match="a recording must be a plain file"):
        record(tmp_path, some(1), 100, array=GRID)
    with pytest.raises(FileNotFoundError):
        record(tmp_path / "no" / "folder.h5", some(1), 100, array=GRID)


# Damage


def contents(path: Path) -> tuple[object, ...]:
    """All that can be read from a recording."""
    with Recording.open(path) as recording:
        pulses = recording.read(0, len(recording))
        told = (recording.rate, recording.source, recording.made_by, recording.medium)
        tables = (recording.array.positions, recording.array.normals, *pulses)
        assert recording.calibration is not None
        return *told, *(table.tobytes() for table in tables), recording.calibration.response.tobytes()


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("small") / "small.h5"
    record(path, some(300), 100, array=GRID, calibration=CALIBRATION, source="small")
    return path


@given(data=st.data())
def test_damage_is_noticed_wherever_it_is(
    small: Path, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    """A file with other bytes is refused, or all of it reads as before, since some bytes are not used."""
    good = small.read_bytes()
    at = data.draw(st.integers(0, len(good) - 1))
    junk = data.draw(st.binary(min_size=1, max_size=20))
    path = tmp_path_factory.mktemp("damaged") / "damaged.h5"
    path.write_bytes(good[:at] + junk + good[at + len(junk) :])
    with suppress(InputFileError):
        assert contents(path) == contents(small)


@pytest.mark.parametrize("flip", [1, 16, 128])
def test_every_text_and_number_has_a_checksum(small: Path, tmp_path: Path, flip: int) -> None:
    good = small.read_bytes()
    for piece in (
        b"small",
        b"phasewire ",
        np.float64(100).tobytes(),
        CALIBRATION.gain.tobytes(),
        GRID.positions.tobytes(),
    ):
        assert piece in good
        damaged = bytearray(good)
        damaged[good.index(piece) + len(piece) - 2] ^= flip
        (tmp_path / "damaged.h5").write_bytes(damaged)
        with pytest.raises(InputFileError):
            contents(tmp_path / "damaged.h5")


@given(st.floats(0, 1, exclude_max=True))
def test_what_is_cut_off_is_refused(small: Path, tmp_path_factory: pytest.TempPathFactory, part: float) -> None:
    path = tmp_path_factory.mktemp("cut") / "cut.h5"
    good = small.read_bytes()
    path.write_bytes(good[: int(part * len(good))])
    with pytest.raises(InputFileError, match=r"cut.h5 is truncated, corrupted or no recording"):
        Recording.open(path)


def test_a_missing_file_is_no_bad_file(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        Recording.open(tmp_path / "none.h5")


def test_a_foreign_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "text.h5").write_text("phase,width\n")
    with pytest.raises(InputFileError, match=r"text.h5 is truncated, corrupted or no recording"):
        Recording.open(tmp_path / "text.h5")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["phase"] = np.zeros((3, 4))
    with pytest.raises(InputFileError, match=r"other.h5 is not a recording; `phasewire record` makes one"):
        Recording.open(tmp_path / "other.h5")


def replaced(file: h5py.File, name: str, values: np.ndarray) -> None:
    del file[name]
    file[name] = values


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda file: file.attrs.__setitem__("carrier_hz", 25_000),
            "made for a device of carrier_hz 25000; here it is 40000",
        ),
        (lambda file: file.attrs.__setitem__("format", [1, 2]), "no recording"),
        (lambda file: file.attrs.__setitem__("rate_hz", -1.0), "its rate is -1 frames/s"),
        (lambda file: file.attrs.__setitem__("rate_hz", np.nan), "its rate is nan frames/s"),
        (lambda file: file.attrs.__delitem__("source"), "source"),
        (lambda file: file.attrs.__setitem__("source", 5), "no recording"),
        (lambda file: file["medium"].attrs.__setitem__("humidity", 200.0), "humidity"),
        (lambda file: file.__delitem__("medium"), "medium"),
        (lambda file: file.__delitem__("width"), "width"),
        (lambda file: replaced(file, "width", np.zeros((300, N))), "no tables of bytes of one shape"),
        (lambda file: replaced(file, "width", np.zeros((299, N), np.uint8)), "no tables of bytes of one shape"),
        (lambda file: replaced(file, "phase", np.zeros(300, np.uint8)), "no recording"),
        (
            lambda file: replaced(file, "positions", GRID.positions[:5]),
            r"positions has the shape \(5, 3\), not \(6, 3\)",
        ),
        (lambda file: replaced(file, "normals", 2 * GRID.normals), "normal of transducer 0 has length 2"),
        (lambda file: replaced(file, "calibration/gain", np.full(N, -1.0)), "gain -1 of transducer 0"),
        (lambda file: file.__delitem__("calibration/dead"), "dead"),
        (lambda file: file["width"].__setitem__((280, 3), 26), "width 26 of transducer 3 of frame 280 is above 25"),
        (lambda file: file["phase"].__setitem__((7, 0), 100), "phase 100 of transducer 0 of frame 7 is above 99"),
    ],
)
def test_what_makes_no_sense_is_named(small: Path, tmp_path: Path, change: object, message: str) -> None:
    path = tmp_path / "odd.h5"
    path.write_bytes(small.read_bytes())
    with h5py.File(path, "r+") as file:
        change(file)  # type: ignore[operator]
    with pytest.raises(InputFileError, match=f"odd.h5 .*{message}"):
        contents(path)


def test_a_closed_recording_says_so(path: Path) -> None:
    with Recording.open(path) as recording:
        pass
    with pytest.raises(ValueError, match="is closed; open it again"):
        recording.read(0, 1)


def test_frames_of_another_device_are_refused(path: Path) -> None:
    with Recording.open(path) as recording, pytest.raises(ValueError, match="6 transducers for a device with 320"):
        frame_source(recording, None, 320)
