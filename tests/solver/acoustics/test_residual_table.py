from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire import Medium, Transducer
from phasewire.solver import Aperture, ResidualTable, residual
from phasewire.solver.acoustics import diffraction, residual_table
from phasewire.solver.acoustics.diffraction import KERNELS

RADIUS = 4.5e-3
DISC = {name: Transducer(RADIUS, model=name) for name in KERNELS}
RING = Transducer(model="rayleigh", aperture=Aperture(1 - np.eye(40) - np.eye(40)[::-1] * 0.5, 2e-4))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty cache, on disk and in memory."""
    monkeypatch.setenv("PHASEWIRE_CACHE", str(tmp_path / "cache"))
    residual_table._table.cache_clear()
    yield tmp_path / "cache"
    residual_table._table.cache_clear()


@pytest.fixture
def computed(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many values each computation was for."""
    calls: list[int] = []
    integrate = diffraction.integrate

    def counted(*arguments: Any) -> Any:
        calls.append(len(arguments[2]))
        return integrate(*arguments)

    monkeypatch.setattr(residual_table, "integrate", counted)
    return calls


def test_a_table_has_the_layout_of_the_kernels(folder: Path) -> None:
    found = ResidualTable.of(DISC["rayleigh"])
    assert found.values.shape == (65, 9)
    assert found.values.dtype == np.complex128
    assert found.values.flags.c_contiguous
    assert not found.values.flags.writeable
    assert (found.sine_squared_step, found.inverse_distance_step) == (1 / 64, 2.5)
    row, column = 40, 6
    at = np.sqrt(row * found.sine_squared_step), 1 / (column * found.inverse_distance_step)
    assert found.values[row, column] == pytest.approx(complex(residual(DISC["rayleigh"], *at)), abs=1e-12)
    assert found.values[0, 0] == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize("name", sorted(KERNELS))
@pytest.mark.parametrize("nearest", [0.05, 2 * RADIUS])
@given(st.floats(0, 1), st.floats(0, 1), st.sampled_from([-20.0, 20.0, 50.0]))
def test_a_table_is_the_integral_to_one_part_in_ten_thousand(
    name: str, nearest: float, sine: float, part: float, temperature: float
) -> None:
    """Of the residual on the axis, everywhere from `nearest` to the far field."""
    air = Medium(temperature)
    distance = nearest / max(part, 1e-3)
    scale = float(KERNELS[name].front(np.array(0.0), np.array(distance)))
    found = ResidualTable.of(DISC[name], air, nearest)(sine, distance)
    assert abs(found - residual(DISC[name], sine, distance, air)) < 1e-4 * scale


@given(st.floats(0, 1), st.floats(0.01, 1))
def test_a_table_of_an_image_is_as_accurate(sine: float, part: float) -> None:
    distance = RING.nearest / part
    found = ResidualTable.of(RING, nearest=RING.nearest)
    assert len(found.values) > 65
    assert abs(found(sine, distance) - residual(RING, sine, distance)) < 1e-4


def test_a_table_is_kept_on_disk(folder: Path, computed: list[int]) -> None:
    first = ResidualTable.of(DISC["rayleigh"])
    (kept,) = folder.iterdir()
    assert kept.name.startswith("residual-")
    residual_table._table.cache_clear()
    again = ResidualTable.of(DISC["rayleigh"])
    np.testing.assert_array_equal(again.values, first.values)
    assert again.values.flags.c_contiguous
    assert not again.values.flags.writeable
    assert computed == [65 * 9]


def test_every_parameter_of_the_values_makes_another_table(folder: Path, computed: list[int]) -> None:
    ring = Transducer(RADIUS, model="rayleigh", aperture=Aperture.disc(RADIUS, 5e-4))
    for transducer, air, nearest in (
        (DISC["rayleigh"], Medium(), 0.05),
        (DISC["rayleigh-1"], Medium(), 0.05),
        (DISC["as-printed"], Medium(), 0.05),
        (Transducer(4.4e-3, model="rayleigh"), Medium(), 0.05),
        (DISC["rayleigh"], Medium(20.01), 0.05),
        (DISC["rayleigh"], Medium(20, 41_000), 0.05),
        (DISC["rayleigh"], Medium(), 0.04),
        (ring, Medium(), 0.05),
    ):
        ResidualTable.of(transducer, air, nearest)
    assert len(computed) == len(list(folder.iterdir())) == 8


@pytest.mark.parametrize("damage", ["emptied", "truncated", "flipped", "another shape", "another type", "a folder"])
def test_a_damaged_cache_is_computed_again(folder: Path, computed: list[int], damage: str) -> None:
    first = ResidualTable.of(DISC["rayleigh"])
    (kept,) = folder.iterdir()
    whole = kept.read_bytes()
    if damage == "emptied":
        kept.write_bytes(b"")
    elif damage == "truncated":
        kept.write_bytes(whole[:5000])
    elif damage == "flipped":
        kept.write_bytes(whole[:5000] + bytes([whole[5000] ^ 1]) + whole[5001:])
    elif damage == "another shape":
        np.savez(kept, values=first.values[:5])
    elif damage == "another type":
        np.savez(kept, values=first.values.real)
    else:
        kept.unlink()
        kept.mkdir()
    residual_table._table.cache_clear()
    np.testing.assert_array_equal(ResidualTable.of(DISC["rayleigh"]).values, first.values)
    assert len(computed) == 2
    assert kept.is_dir() or kept.read_bytes() == whole


def test_a_cache_that_cannot_be_written_is_no_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, folder: Path, computed: list[int]
) -> None:
    in_the_way = tmp_path / "file"
    in_the_way.write_text("")
    monkeypatch.setenv("PHASEWIRE_CACHE", str(in_the_way))
    ResidualTable.of(DISC["rayleigh"])
    residual_table._table.cache_clear()
    monkeypatch.setenv("PHASEWIRE_CACHE", str(folder))
    monkeypatch.setattr(residual_table, "replacing", _refuse)
    ResidualTable.of(DISC["rayleigh"])
    assert len(computed) == 2
    assert list(folder.iterdir()) == []


def _refuse(path: Path) -> None:
    raise PermissionError(path)


@pytest.mark.parametrize(
    ("transducer", "nearest", "message"),
    [
        (Transducer(), 0.05, "model 'piston' needs no table; rayleigh, rayleigh-1, as-printed do"),
        (DISC["rayleigh"], 5e-3, r"a table from 0\.005 m on is too near; .* 4\.50 mm needs at least 9\.00 mm"),
        (DISC["rayleigh"], np.nan, "nearest nan m must be"),
        (Transducer(0.1, model="rayleigh"), 0.3, "reaches 100.0 mm needs a table of .* at most 300000 are possible"),
    ],
)
def test_impossible_tables_are_refused(transducer: Transducer, nearest: float, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ResidualTable.of(transducer, nearest=nearest)


@pytest.mark.parametrize(
    ("sine", "distance", "message"),
    [
        ([0.5, 1.2], 1.0, r"sines from 0\.5 to 1\.2 must lie between 0 and 1"),
        (0.5, [1, 0.049], r"a distance of 0\.049 m is nearer than the table's 0\.05 m"),
        (0.5, np.nan, "a distance of nan m"),
    ],
)
def test_a_table_is_not_used_beyond_its_edges(sine: float, distance: float, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ResidualTable.of(DISC["rayleigh"])(sine, distance)
