"""The reader here follows the format's description; the files were also compared with VTK's own reader by hand."""

from __future__ import annotations

import base64
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from phasewire import Medium, TransducerArray
from phasewire.solver.fields.field import sample_cut, sample_volume
from phasewire.solver.fields.grid import Grid
from phasewire.solver.fields.quantities import intensity, radiation_pressure
from phasewire.solver.pictures.vti import save_vti

SMALL = TransducerArray.grid(4, 3)
DRIVE = np.exp(1j * np.arange(12) ** 2)
GRIDS = {
    "lying": Grid.along("xy", (0.01, 0, 0.1), [0.04, 0.02], 0.01),
    "standing": Grid.along("xz", (0, 0.01, 0.1), [0.04, 0.1], 0.01),
    "oblique": Grid((0, 0, 0.2), [[0.6, 0.0, 0.8], [0.0, 1.0, 0.0]], (5, 2), 0.01),
    "box": Grid.along("xyz", (0, 0, 0.2), [0.02, 0.04, 0.06], 0.01),
}


def numbers(text: str | None) -> np.ndarray:
    return np.array([float(word) for word in (text or "").split()])


@pytest.mark.parametrize("name", GRIDS)
def test_every_sample_is_at_its_place(tmp_path: Path, name: str) -> None:
    grid, air = GRIDS[name], Medium(30)
    field = (sample_volume if name == "box" else sample_cut)(SMALL, DRIVE, grid, air)
    save_vti(tmp_path / "f.vti", field)

    root = ElementTree.parse(tmp_path / "f.vti").getroot()
    assert (root.tag, root.get("type"), root.get("byte_order")) == ("VTKFile", "ImageData", "LittleEndian")
    assert (root.get("header_type"), root.get("compressor")) == ("UInt64", None)
    (image,) = root
    (piece,) = image
    extent = numbers(image.get("WholeExtent")).astype(int).reshape(3, 2)
    assert piece.get("Extent") == image.get("WholeExtent")
    direction = numbers(image.get("Direction")).reshape(3, 3)
    np.testing.assert_allclose(direction.T @ direction, np.eye(3), atol=1e-12)
    assert np.linalg.det(direction) == pytest.approx(1)
    indices = np.stack(np.meshgrid(*(np.arange(a, b + 1) for a, b in extent), indexing="ij"), axis=-1)
    at = numbers(image.get("Origin")) + (indices * numbers(image.get("Spacing"))) @ direction.T

    read = {}
    for array in piece.iterfind("PointData/DataArray"):
        assert (array.get("type"), array.get("format")) == ("Float32", "binary")
        data = base64.b64decode(array.text or "", validate=True)
        assert int.from_bytes(data[:8], "little") == len(data) - 8
        read[array.get("Name")] = np.frombuffer(data[8:], "<f4")
    expected = {
        "pressure_amplitude_pa": np.abs(field.pressure),
        "pressure_real_pa": field.pressure.real,
        "pressure_imaginary_pa": field.pressure.imag,
        "intensity_w_m2": intensity(field.pressure, air),
        "radiation_pressure_pa": radiation_pressure(field.pressure, air),
    }
    assert set(read) == set(expected)
    order = at.transpose(2, 1, 0, 3).reshape(-1, 3)  # x runs fastest
    np.testing.assert_allclose(order, grid.positions().reshape(-1, 3), atol=1e-12)
    for what, values in expected.items():
        np.testing.assert_allclose(read[what], values.ravel(), rtol=1e-6)
    (data_of_points,) = piece.iterfind("PointData")
    assert data_of_points.get("Scalars") in read
