"""Placements in TOML files: a rotation, and then a translation."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .geometry import as_rotation, rotation_matrix

__all__ = ["PLACEMENT_KEYS", "read_placement", "table_numbers"]

PLACEMENT_KEYS = ("translation_m", "translation_mm", "rotation", "rotation_degrees")
_SHAPES = {(): "a finite number", (3,): "three finite numbers", (3, 3): "three rows of three finite numbers"}


def read_placement(table: dict[str, Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rotation (3, 3) and translation (3,) in metres of a table with the fields `PLACEMENT_KEYS`; each may be absent.

    The rotation is ``rotation``, three rows, or ``rotation_degrees``, angles about x, then y, then z. The translation
    is ``translation_m`` or ``translation_mm``. A `ValueError` names the field that is wrong.
    """
    for one, other in (("translation_m", "translation_mm"), ("rotation", "rotation_degrees")):
        if one in table and other in table:
            raise ValueError(f"{one} and {other} exclude each other; give one of them")
    translation = table_numbers(table, "translation_m", (3,), [0, 0, 0])
    if "translation_mm" in table:
        translation = table_numbers(table, "translation_mm", (3,)) * 1e-3
    rotation = as_rotation(table_numbers(table, "rotation", (3, 3), np.eye(3).tolist()))
    if "rotation_degrees" in table:
        x, y, z = table_numbers(table, "rotation_degrees", (3,))
        rotation = rotation_matrix(z, (0, 0, 1)) @ rotation_matrix(y, (0, 1, 0)) @ rotation_matrix(x, (1, 0, 0))
    return rotation, translation


def table_numbers(
    table: dict[str, Any], key: str, shape: tuple[int, ...], otherwise: object = None
) -> NDArray[np.float64]:
    """A field of numbers of a shape, a key of `_SHAPES`; `ValueError` if it is anything else."""
    given = table.get(key, otherwise)
    try:
        values = np.array(given)
    except ValueError:
        values = np.array(None)
    if values.shape != shape or values.dtype.kind not in "if" or not all(map(math.isfinite, values.flat)):
        raise ValueError(f"{key} is {given!r}; it must be {_SHAPES[shape]}")
    return values.astype(np.float64)
