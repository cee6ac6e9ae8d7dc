"""Fields for ParaView and other programs: VTK XML image data, ``.vti``.

The format is that of *VTK File Formats* (kitware.com): one piece, arrays inline as base64 of a 64-bit length and the
numbers. A plane or box at any angle is written with its directions, which readers know from VTK 9 on.
"""

from __future__ import annotations

import base64
import struct
import sys
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import instance_of
from ...base.storage import FilePath, replacing
from ..fields.field import Field, PlaneField, VolumeField
from ..fields.quantities import intensity, radiation_pressure

__all__ = ["save_vti"]


def save_vti(path: FilePath, field: PlaneField | VolumeField) -> None:
    """Write a field as VTK image data, whole or not at all.

    Parameters
    ----------
    path : str or Path
        File to write; VTK's readers expect a name that ends in ``.vti``.
    field : PlaneField or VolumeField
        What to write.

    Notes
    -----
    Lengths are in metres. The arrays, 32-bit floats, are named with their units: the peak pressure's magnitude, real
    and imaginary part in Pa, the intensity in W/m² and the radiation pressure for full reflection in Pa, both averaged
    over the carrier's period.
    """
    grid = instance_of(field, Field, "field", "as in save_vti(path, field)").grid
    counts = [*grid.counts, *[1] * (3 - len(grid.counts))]
    axes = grid.axes if len(grid.axes) == 3 else np.vstack([grid.axes, grid.normal])
    origin = grid.centre + [grid.offsets(axis)[0] for axis in range(len(grid.counts))] @ grid.axes
    whole = " ".join(f"0 {count - 1}" for count in counts)
    root = ElementTree.Element(
        "VTKFile",
        type="ImageData",
        version="1.0",
        byte_order="LittleEndian" if sys.byteorder == "little" else "BigEndian",
        header_type="UInt64",
    )
    image = ElementTree.SubElement(
        root,
        "ImageData",
        WholeExtent=whole,
        Origin=_numbers(origin),
        Spacing=_numbers(np.full(3, grid.step)),
        Direction=_numbers(axes.T),  # a column for each axis
    )
    piece = ElementTree.SubElement(image, "Piece", Extent=whole)
    data = ElementTree.SubElement(piece, "PointData", Scalars="pressure_amplitude_pa")
    for name, values in _arrays(field).items():
        array = ElementTree.SubElement(data, "DataArray", type="Float32", Name=name, format="binary")
        numbers = np.ascontiguousarray(values, dtype=np.float32).tobytes()
        array.text = base64.b64encode(struct.pack("=Q", len(numbers)) + numbers).decode("ascii")
    with replacing(path) as part:
        ElementTree.ElementTree(root).write(part, encoding="utf-8", xml_declaration=True)


def _arrays(field: Field) -> dict[str, NDArray[np.float64]]:
    return {
        "pressure_amplitude_pa": np.abs(field.pressure),
        "pressure_real_pa": field.pressure.real,
        "pressure_imaginary_pa": field.pressure.imag,
        "intensity_w_m2": intensity(field.pressure, field.medium),
        "radiation_pressure_pa": radiation_pressure(field.pressure, field.medium),
    }


def _numbers(values: NDArray[np.float64]) -> str:
    return " ".join(repr(float(value)) for value in values.ravel())
