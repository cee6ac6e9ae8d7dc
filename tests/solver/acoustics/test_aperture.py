from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from matplotlib.image import imsave
from phasewire import Medium, Transducer
from phasewire.base.errors import InputFileError
from phasewire.solver import Aperture, residual, slice_field
from phasewire.solver.acoustics.diffraction import KERNELS

AIR = Medium()
K = AIR.wavenumber
RADIUS = 4.5e-3


def grille(pixel: float = 2e-4) -> np.ndarray:
    """Three openings of different shapes behind a 9 mm face, none of them in the middle."""
    y, x = np.mgrid[:45, :41] * pixel * 1e3  # mm
    ring = (np.hypot(x - 4, y - 4.4) < 3.8) & (np.hypot(x - 4, y - 4.4) > 2.4) & (x > 4)
    slot = (abs(x - 2) < 0.7) & (abs(y - 4) < 2.9)
    return np.asarray(np.where(ring, 1.0, 0.0) + np.where(slot, 0.6, 0.0) * ~ring)


def literal_wave(aperture: Aperture, at: np.ndarray, name: str = "rayleigh") -> complex:
    """The sum over pixels at one point."""
    y, x = aperture.axes()
    distance = np.sqrt((at[0] - x[None, :]) ** 2 + (at[1] - y[:, None]) ** 2 + at[2] ** 2)
    return complex((aperture.image * KERNELS[name].wave(at[2], distance, K)).sum() / aperture.image.sum())


@example(radius=0.0045461171090614705, fraction=0.37876488978395684)  # its edge meets a pixel's side
@given(st.floats(1e-3, 8e-3), st.floats(0.05, 1))
def test_a_disc_has_the_area_of_a_disc(radius: float, fraction: float) -> None:
    disc = Aperture.disc(radius, fraction * radius)
    assert disc.image.real.sum() * disc.pixel**2 == pytest.approx(np.pi * radius**2, rel=1e-9)
    np.testing.assert_allclose(disc.image, disc.image.T, atol=1e-9)
    np.testing.assert_array_equal(disc.image, disc.image[::-1])


def test_the_image_of_a_disc_radiates_as_the_disc() -> None:
    """In 1000 directions, with pixels of 0.1 mm that are weighted by their area."""
    rng = np.random.default_rng(4)
    sine, r = rng.uniform(0, 1, 1000), 1 / rng.uniform(0, 1 / (2.3 * RADIUS), 1000)
    exact, of_image = (
        residual(Transducer(RADIUS, model="rayleigh", aperture=aperture), sine, r)
        for aperture in (None, Aperture.disc(RADIUS))
    )
    np.testing.assert_allclose(of_image, exact, rtol=0, atol=6e-5)


@pytest.mark.parametrize("name", sorted(KERNELS))
@pytest.mark.parametrize("z", [0.02, 0.2])
def test_a_slice_is_the_rayleigh_integral(name: str, z: float) -> None:
    axis, field = slice_field(Aperture.disc(RADIUS), z, 0.06, AIR, name)
    x, y = np.meshgrid(axis[::25], axis[::25])
    r = np.sqrt(x**2 + y**2 + z**2)
    exact = residual(Transducer(RADIUS, model=name), np.hypot(x, y) / r, r) * np.exp(1j * K * r) / r
    np.testing.assert_allclose(field[::25, ::25], exact, atol=5e-5 * np.abs(exact).max())


@pytest.mark.parametrize("name", sorted(KERNELS))
def test_a_slice_of_any_image_is_its_literal_sum(name: str) -> None:
    """Rows go along y and columns along x, whether their numbers are even or odd."""
    image = grille() * np.exp(1j * np.linspace(0, 1, 41))
    aperture = Aperture(image, 2e-4)
    axis, field = slice_field(aperture, 0.03, 0.02, AIR, name)
    assert field.shape == (len(axis), len(axis)) == (101, 101)
    for row, column in ((0, 0), (0, 100), (7, 60), (50, 50), (100, 3)):
        literal = literal_wave(aperture, np.array([axis[column], axis[row], 0.03]), name)
        assert field[row, column] == pytest.approx(literal, rel=1e-9)


def test_an_image_s_wave_is_its_mean_over_the_azimuth() -> None:
    aperture = Aperture(grille() * np.exp(1j * np.linspace(0, 1, 41)), 2e-4)
    transducer = Transducer(model="rayleigh", aperture=aperture)
    for sine, r in ((0, 0.05), (0.3, 2.1 * aperture.reach), (0.7, 0.1), (1, 0.3)):
        turns = 2 * np.pi * np.arange(40) / 40
        at = r * np.stack([sine * np.cos(turns), sine * np.sin(turns), np.full(40, np.sqrt(1 - sine**2))], axis=1)
        literal = np.mean([literal_wave(aperture, point) for point in at])
        assert residual(transducer, sine, r) * np.exp(1j * K * r) / r == pytest.approx(literal, rel=1e-8)


def test_the_reach_is_the_furthest_open_corner() -> None:
    assert Aperture([[0, 0, 0], [0, 0, 1]], 1e-3).reach == pytest.approx(np.hypot(1e-3, 1.5e-3))
    assert Aperture.disc(RADIUS, RADIUS / 10).reach == pytest.approx(RADIUS, rel=0.15)


def test_a_grille_is_read_from_a_picture(tmp_path: Path) -> None:
    """White is open; width is that of the whole picture."""
    np.save(tmp_path / "grille.npy", grille())
    imsave(tmp_path / "grille.png", grille(), cmap="gray", vmin=0, vmax=1)
    exact = Aperture.from_image(tmp_path / "grille.npy", 8.2e-3)
    assert exact == Aperture(grille(), 8.2e-3 / 41)
    picture = Aperture.from_image(tmp_path / "grille.png", 8.2e-3)
    np.testing.assert_allclose(picture.image, exact.image, atol=1 / 255)
    wave, of_picture = (
        residual(Transducer(model="rayleigh", aperture=aperture), np.linspace(0, 1, 9), 0.1)
        for aperture in (exact, picture)
    )
    np.testing.assert_allclose(of_picture, wave, atol=2e-3)
    disc = residual(Transducer(model="rayleigh"), np.linspace(0, 1, 9), 0.1)
    assert np.abs(wave - disc).max() > 0.02


def test_pictures_have_shades_colours_and_transparency(tmp_path: Path) -> None:
    shades = np.array([[0.0, 0.2], [0.6, 1.0]])
    imsave(tmp_path / "rgba.png", np.dstack([np.ones((2, 2)), np.ones((2, 2)), np.ones((2, 2)), shades]))
    imsave(tmp_path / "rgb.png", np.dstack([shades, shades, shades]))
    for name in ("rgba.png", "rgb.PNG"):
        (tmp_path / name.lower()).rename(tmp_path / name)
        np.testing.assert_allclose(Aperture.from_image(tmp_path / name, 1e-2).image, shades, atol=1 / 255)


@pytest.mark.parametrize(
    ("name", "contents", "message"),
    [
        ("a.png", b"", r"a\.png: "),
        ("a.png", b"\x89PNG\r\n\x1a\nnot much", r"a\.png: "),
        ("a.npy", b"\x93NUMPY", r"a\.npy: "),
        ("a.jpg", b"", r"a\.jpg: apertures are read from \.png or \.npy files"),
    ],
)
def test_invalid_pictures_are_named(tmp_path: Path, name: str, contents: bytes, message: str) -> None:
    (tmp_path / name).write_bytes(contents)
    with pytest.raises(InputFileError, match=message):
        Aperture.from_image(tmp_path / name, 1e-2)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([1, 1], 1e-4), r"must have the shape \(rows, columns\), not \(2,\)"),
        ((np.ones((0, 3)), 1e-4), r"not \(0, 3\)"),
        ((np.ones((1, 2049)), 1e-4), "too large; at most 2048 a side"),
        ((np.ones((2, 2)), 0), "pixel 0 m must be positive"),
        ((np.ones((2, 2)), 1.0), "2 of them in a row at most 1 m"),
        (([[0, 1], [1.5, 0]], 1e-4), r"pixel 1, 0 of an aperture is \(1\.5\+0j\), beyond a magnitude of 1"),
        (([[0, np.nan]], 1e-4), "pixel 0, 1 of an aperture is"),
        (([[1, -1]], 1e-4), "emits nothing along its axis"),
        (([[0, 0]], 1e-4), "emits nothing along its axis"),
    ],
)
def test_impossible_apertures_are_refused(arguments: tuple[Any, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Aperture(*arguments)


@pytest.mark.parametrize(
    ("radius", "pixel", "message"),
    [
        (0, 1e-4, "radius 0 m must be positive"),
        (1e-3, 2e-3, "pixel 0.002 m must be positive and at most 0.001 m"),
        (1e-3, 0, "pixel 0 m must be positive"),
        (0.2, 1e-4, "pixel of 0.0001 m is too small for a radius of 0.2 m"),
    ],
)
def test_impossible_discs_are_refused(radius: float, pixel: float, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Aperture.disc(radius, pixel)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"kernel": "piston"}, "unknown kernel 'piston'; known are rayleigh, rayleigh-1, as-printed"),
        ({"z": 0}, "z 0 m must be positive"),
        ({"extent": 1}, "makes more than 10000000 samples"),
    ],
)
def test_impossible_slices_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        slice_field(Aperture.disc(RADIUS), **({"z": 0.1, "extent": 0.01} | arguments))
