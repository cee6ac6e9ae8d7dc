"""The compiled way from many drives to pulses, against every exact pulse and the readable way for one."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from phasewire.protocol import Pulses
from phasewire.protocol.quantise import PulseFrames, quantise

from tests.strategies import drives

ROUNDING = 1e-14
EXACT = np.array([(0, 0), *((w, p) for w in range(1, 26) for p in range(100) if (w - p) % 2 == 0)])
EXACT_PHASORS = np.sin(np.pi * EXACT[:, 0] / 50) * np.exp(2j * np.pi * EXACT[:, 1] / 100)


def chosen(frames: PulseFrames) -> np.ndarray:
    """The phasors of pulses, by their definition; they must be exact, and silence must have one form."""
    sounding = frames.width > 0
    assert (frames.phase % 2 == frames.width % 2)[sounding].all()
    assert not frames.phase[~sounding].any()
    assert frames.phase.max(initial=0) <= 99
    assert frames.width.max(initial=0) <= 25
    return np.asarray(np.sin(np.pi * frames.width / 50) * np.exp(2j * np.pi * frames.phase / 100))


def assert_nearest(drive: np.ndarray) -> None:
    """The pulses of (k, n) drives, in either precision."""
    for given_ in (drive, drive.astype(np.complex64)):
        best = np.abs(EXACT_PHASORS - given_[..., None].astype(np.complex128)).min(axis=-1)
        found = np.abs(chosen(quantise(given_)) - given_)
        np.testing.assert_allclose(found, best, rtol=0, atol=ROUNDING)


@given(st.lists(drives(8), min_size=1, max_size=2))
def test_the_nearest_of_all_exact_pulses(frames: list[np.ndarray]) -> None:
    assert_nearest(np.array(frames))


def test_drives_half_way_between_pulses_and_beside() -> None:
    """A wrong table would err first there."""
    apart = np.abs(EXACT_PHASORS[:, None] - EXACT_PHASORS)
    one, other = np.nonzero((apart > 0) & (apart < 0.07))
    middles = (EXACT_PHASORS[one] + EXACT_PHASORS[other])[one < other][::7] / 2
    for step in (0, 1e-9, 1e-4 - 1e-4j):
        assert_nearest((middles * (1 - abs(step)) + step)[None])


def test_every_exact_pulse_is_its_own_nearest() -> None:
    frames = quantise(EXACT_PHASORS[None])
    np.testing.assert_array_equal(np.stack([frames.width[0], frames.phase[0]], axis=1), EXACT)


@pytest.mark.parametrize(
    "drive",
    [0, -0.0, complex(-0.0, -0.0), 1, -1, 1j, -1j, 1e-320, 1e-320j, 1e-30 + 1e-30j, 1 + 1e-7j, -1 - 9e-7, 0.6 + 0.8j],
)
def test_on_the_axes_and_in_the_middle(drive: complex) -> None:
    assert_nearest(np.full((1, 3), drive))


BAD = [
    (np.nan, "is .*nan.*; it must be finite"),
    (complex(0, np.nan), "is .*nan.*; it must be finite"),
    (np.inf, "is .*inf.*; it must be finite"),
    (complex(0.1, -np.inf), "is .*inf.*; it must be finite"),
    (1.5j, "has magnitude 1.5; at most 1 is possible"),
    (1.00001, "has magnitude 1.00001; at most 1 is possible"),
    (1e30, r"has magnitude 1e\+30; at most 1 is possible"),
]


@pytest.mark.parametrize(("bad", "message"), BAD)
@pytest.mark.parametrize("dtype", [np.complex64, np.complex128])
@pytest.mark.parametrize(("frame", "transducer"), [(0, 0), (2, 319), (4, 7)])
def test_an_error_names_a_bad_drive(bad: complex, message: str, dtype: type, frame: int, transducer: int) -> None:
    drive: np.ndarray = np.zeros((5, 320), dtype)
    drive[frame, transducer] = bad
    with pytest.raises(ValueError, match=f"drive of transducer {transducer} of frame {frame} {message}"):
        quantise(drive)
    with pytest.raises(ValueError, match=f"of frame {100 + frame} "):
        quantise(drive, first=100)
    with pytest.raises(ValueError, match=f"drive of transducer {transducer} {message}"):
        Pulses.from_drive(drive[frame])


def refused(call: Callable[[], object]) -> bool:
    try:
        call()
    except ValueError:
        return True
    return False


@given(hnp.arrays(np.complex128, (2, 3), elements=st.complex_numbers(max_magnitude=1e150)))
def test_the_same_drives_are_refused_as_one_by_one(drive: np.ndarray) -> None:
    assert refused(lambda: quantise(drive)) == any(refused(partial(Pulses.from_drive, row)) for row in drive)


@given(st.floats(-4e-12, 4e-12), st.floats(0, 7))
def test_the_limit_is_the_same_as_one_by_one(beyond: float, angle: float) -> None:
    drive = (1 + 1e-6 + beyond) * np.exp([[1j * angle]])
    beyond_it = refused(lambda: Pulses.from_drive(drive[0]))
    assert refused(lambda: quantise(drive)) == beyond_it
    assert beyond_it or quantise(drive).width[0, 0] >= 24


def test_drives_may_have_any_memory_layout_and_type() -> None:
    drive = np.array([[0.5, -0.7j], [0.1 + 0.2j, 1], [0, 0.3j]])
    whole = quantise(drive)
    frozen = drive.copy()
    frozen.setflags(write=False)
    wide = np.zeros((6, 4), complex)
    wide[::2, ::2] = drive
    for same in (drive.tolist(), frozen, np.asfortranarray(drive), wide[::2, ::2], drive.astype(">c16")):
        np.testing.assert_array_equal(quantise(same), whole)
    np.testing.assert_array_equal(quantise(drive.real), quantise(drive.real + 0j))


@pytest.mark.parametrize("shape", [(0, 320), (3, 0)])
def test_no_drives_become_no_pulses(shape: tuple[int, int]) -> None:
    assert quantise(np.zeros(shape, complex)).phase.shape == shape


@pytest.mark.parametrize("shape", [(), (320,), (1, 2, 3)])
def test_an_error_names_a_wrong_shape(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"drives must have the shape \(k, n\), not \("):
        quantise(np.zeros(shape, complex))


def room(*shape: int, dtype: type = np.uint8) -> np.ndarray:
    return np.full(shape, 111, dtype)


def test_pulses_are_written_to_given_arrays() -> None:
    drive = np.full((2, 4), 0.5j)
    phase, width = room(4, 4), room(4, 4)
    out = PulseFrames(phase[1:3], width[1:3])
    assert quantise(drive, out) is out
    np.testing.assert_array_equal(out, quantise(drive))
    assert (phase[[0, 3]] == 111).all()
    assert (width[[0, 3]] == 111).all()


def read_only(array: np.ndarray) -> np.ndarray:
    array.setflags(write=False)
    return array


@pytest.mark.parametrize(
    ("phase", "width", "message"),
    [
        (room(2, 4), room(2, 3), r"width of out must be contiguous \(2, 4\) uint8, not \(2, 3\) uint8"),
        (room(2, 4, dtype=np.int8), room(2, 4), r"phase of out must be contiguous .* not \(2, 4\) int8"),
        (room(4, 4)[::2], room(2, 4), "phase of out must be contiguous"),
        (room(2, 4), read_only(room(2, 4)), "width of out is read-only"),
    ],
)
def test_an_error_names_an_array_that_does_not_fit(phase: np.ndarray, width: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        quantise(np.zeros((2, 4), complex), PulseFrames(phase, width))
