from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from phasewire import Emulator, Solution, open_device, pressure
from phasewire.base.errors import InputFileError
from phasewire.host.streaming.calibration import Calibration

from tests.strategies import drives

N = 12
GAINS = st.floats(1e-6, 100) | st.just(0.0)


def columns(n: int) -> st.SearchStrategy[tuple[np.ndarray, ...]]:
    return st.tuples(
        hnp.arrays(np.float64, n, elements=GAINS),
        hnp.arrays(np.float64, n, elements=st.floats(-360, 360)),
        hnp.arrays(np.int8, n, elements=st.sampled_from([1, -1])),
        hnp.arrays(np.bool_, n),
    ).filter(lambda values: bool(((values[0] > 0) & ~values[3]).any()))


CALIBRATIONS = columns(N).map(lambda values: Calibration(*values))


@given(CALIBRATIONS, drives(N))
def test_what_is_emitted_is_what_was_wanted(calibration: Calibration, wanted: np.ndarray) -> None:
    """Up to a drive of 1; beyond it the phase is still right, and a dead transducer is silent."""
    sent = calibration.apply(wanted)
    emitted = sent * calibration.response
    assert (np.abs(sent) <= 1 + 1e-12).all()
    dead = calibration.dead | (calibration.gain == 0)
    assert not sent[dead].any()
    beyond = ~dead & (np.abs(wanted) > calibration.gain)
    np.testing.assert_allclose(np.abs(sent[beyond]), 1, rtol=1e-12)
    np.testing.assert_allclose(emitted[beyond] * np.abs(wanted[beyond]), wanted[beyond] * calibration.gain[beyond])
    within = ~dead & ~beyond
    np.testing.assert_allclose(emitted[within], wanted[within], rtol=1e-12, atol=1e-15)


def test_a_response_by_hand() -> None:
    calibration = Calibration([0.5, 1, 2, 1, 0], [0, 90, -180, 360, 0], [1, -1, 1, 1, 1], [0, 0, 0, 1, 0])
    np.testing.assert_allclose(calibration.response, [0.5, -1j, -2, 0, 0], atol=1e-15)
    sent = calibration.apply(np.array([0.25, 0.5, 1j, 1, 1]))
    np.testing.assert_allclose(sent, [0.5, 0.5j, -0.5j, 0, 0], atol=1e-15)
    np.testing.assert_allclose(calibration.apply(np.array([1j, 1, 1, 1, 1]))[0], 1j)


@pytest.mark.parametrize(
    ("drive", "message"),
    [
        ([[0, 0], [0, np.nan]], "drive of transducer 1 of frame 8 is .*nan"),
        ([[0, 0], [1.5, 0]], "drive of transducer 0 of frame 8 has magnitude 1.5"),
        ([[0, 0, 0]], r"drives of the shape \(1, 3\) for a calibration of 2 transducers"),
    ],
)
def test_bad_drives_are_named(drive: list[list[complex]], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Calibration.perfect(2).apply(np.array(drive), first=7)


# Files


@given(calibration=CALIBRATIONS)
def test_a_file_survives_the_way(tmp_path_factory: pytest.TempPathFactory, calibration: Calibration) -> None:
    path = tmp_path_factory.mktemp("calibration") / "array.csv"
    calibration.save(path)
    assert Calibration.load(path) == calibration


GOOD = "transducer,gain,phase_deg,polarity,dead\n0,1,0,1,0\n1,0.5,-90,-1,0\n2,0,0,1,1\n"
AS_READ = Calibration([1, 0.5, 0], [0, -90, 0], [1, -1, 1], [0, 0, 1])


@pytest.mark.parametrize(
    "text",
    [
        GOOD,
        "\ufeff" + GOOD,
        GOOD.replace("\n", "\r\n"),
        '# made in "the lab\n\n' + GOOD.replace("1,0.5", "  # the loose one, twice\n,,,,\n 1 , 5e-1"),
        "transducer,gain,phase_deg,polarity,dead\n2,0,0,+1,1\n0,1,0,1,0\n1,0.5,-90.0,-1,0",
        '"transducer","gain","phase_deg","polarity","dead"\n"0","1","0","1","0"\n1,0.5,-90,-1,0\n2,0,0,1,1\n',
    ],
    ids=["plain", "byte order mark", "other line ends", "comments", "any order", "quoted"],
)
def test_files_of_several_hands(tmp_path: Path, text: str) -> None:
    path = tmp_path / "array.csv"
    path.write_bytes(text.encode())
    assert Calibration.load(path) == AS_READ


HEAD = "transducer,gain,phase_deg,polarity,dead\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "there is no transducer in it; after the line transducer,gain"),
        (HEAD, "there is no transducer in it"),
        ("0,1,0,1,0\n", "line 1: '0,1,0,1,0' must name the columns 'transducer,gain,phase_deg,polarity,dead'"),
        ("# old\ntransducer,gain,phase,polarity,dead\n", "line 2: .* must name the columns"),
        (HEAD + "0,1,0,1\n", "line 2 has 4 cells; it must have 5"),
        (HEAD + "0;1;0;1;0\n", "line 2 has 1 cells"),
        (HEAD + "0,1,0,1,0\n\n1,one,0,1,0\n", "line 4, column gain: 'one' must be 0 or from 1e-06 to 100"),
        (HEAD + "0,nan,0,1,0\n", "line 2, column gain: 'nan' must be"),
        (HEAD + "0,-1,0,1,0\n", "line 2, column gain: '-1' must be"),
        (HEAD + "0,1,400,1,0\n", "line 2, column phase_deg: '400' must be from -360 to 360 degrees"),
        (HEAD + "0,1,,1,0\n", "line 2, column phase_deg: '' must be"),
        (HEAD + "0,1,0,0,0\n", "line 2, column polarity: '0' must be 1 or -1"),
        (HEAD + "0,1,0,1,yes\n", "line 2, column dead: 'yes' must be 0 or 1"),
        (HEAD + "-1,1,0,1,0\n", "line 2, column transducer: '-1' must be a whole number, 0 or more"),
        (HEAD + "0.5,1,0,1,0\n", r"line 2, column transducer: '0\.5' must be a whole number"),
        (HEAD + "0,1,0,1,0\n0,1,0,1,0\n", "line 3: transducer 0 stands in line 2 already"),
        (
            HEAD + "0,1,0,1,0\n7,1,0,1,0\n",
            "transducer 1 is missing, but there is 7 in line 3; all from 0 on are needed",
        ),
        (HEAD + "1,1,0,1,0\n", "transducer 0 is missing, but there is 1 in line 2"),
        (HEAD + "0,1,0,1,1\n", "every transducer is dead"),
        (HEAD + "9" * 5000 + ",1,0,1,0\n", "integer string conversion"),
    ],
)
def test_what_is_wrong_with_a_file_is_named(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "array.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputFileError, match=f"array.csv: .*{message}"):
        Calibration.load(path)


@given(st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(tmp_path_factory: pytest.TempPathFactory, junk: bytes) -> None:
    path = tmp_path_factory.mktemp("junk") / "array.csv"
    for data in (junk, GOOD.encode() + junk):
        path.write_bytes(data)
        with suppress(InputFileError):
            assert len(Calibration.load(path))


# The whole way


@pytest.mark.parametrize("use", [True, False])
def test_a_badly_built_array_gives_the_intended_field(sphere_solution: Solution, use: bool) -> None:
    """A tenth of its transducers flipped, phases within ±60°, gains within ±20 %, three of them dead."""
    rng = np.random.default_rng(2)
    built = Calibration(
        rng.uniform(0.8, 1.2, 320),
        rng.uniform(-60, 60, 320),
        np.where(rng.random(320) < 0.1, -1, 1),
        np.isin(np.arange(320), [3, 77, 200]),
    )
    array, points, air = sphere_solution.array, sphere_solution.points.positions, sphere_solution.medium
    wanted = 0.8 * sphere_solution.drive
    intended = pressure(array, wanted, points, air)
    with Emulator() as emulator, open_device(emulator.url, calibration=built if use else None) as device:
        device.show(wanted)
        emulator.run(5)
        capture = emulator.capture()
        played = capture.drive(capture.periods - 1)
    sounded = pressure(array.calibrated(built.response), played, points, air)
    miss = np.abs(sounded - intended).max() / np.abs(intended).max()
    assert miss < 0.06 if use else miss > 0.3
