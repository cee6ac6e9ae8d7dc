"""Pictures of fields as files, and of several fields side by side."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import instance_of
from ...base.pictures import LANDSCAPE, save_figure
from ...base.storage import FilePath
from ..acoustics.array import TransducerArray
from ..fields.field import Field, PlaneField
from ..fields.quantities import QUANTITIES
from ..fields.validity import validity
from ..methods.solve import Wanted

__all__ = ["compare_fields", "save_field_picture"]


def compare_fields(
    fields: Mapping[str, PlaneField], points: Wanted | None = None, quantity: str = "pressure"
) -> NDArray[Any]:
    """Draw fields side by side in a new figure of pyplot, all on one scale.

    Parameters
    ----------
    fields : mapping of str to PlaneField
        One field or more, by the name of each, such as that of a method.
    points : ControlPoints, Shape or (m, 3) float, optional
        Those in the planes are marked.
    quantity : str
        A key of `QUANTITIES`.

    Returns
    -------
    (n,) matplotlib axes
        The axes, in the order of the fields.

    Raises
    ------
    ValueError
        If there are no fields, or the quantity is unknown.
    """
    from matplotlib import pyplot

    instance_of(fields, Mapping, "fields", 'such as {"wgs": field}')  # type: ignore[type-abstract]  # a check only
    if not fields:
        raise ValueError("there are no fields to compare; give at least one")
    if quantity not in QUANTITIES:
        raise ValueError(f"unknown quantity {quantity!r}; known are {', '.join(QUANTITIES)}")
    what = QUANTITIES[quantity]
    largest = max(float(what.of(field.pressure, field.medium).max()) for field in fields.values())
    figure, grid = pyplot.subplots(1, len(fields), figsize=(LANDSCAPE, 3.6), squeeze=False, layout="compressed")
    for (name, field), axes in zip(fields.items(), grid[0], strict=True):
        field.plot(axes, points=points, quantity=quantity, largest=largest)
        axes.set_title(name)
        if axes is not grid[0, -1]:
            axes.images[0].colorbar.remove()
    figure.suptitle(f"{what.name}, one scale")
    return np.asarray(grid[0])


def save_field_picture(
    path: FilePath,
    field: PlaneField,
    points: Wanted | None = None,
    quantity: str = "pressure",
    array: TransducerArray | None = None,
) -> None:
    """Write a picture of a field with its control points.

    Parameters
    ----------
    path : path
        Its suffix is the format.
    field : PlaneField
        A plane.
    points : ControlPoints, Shape or (m, 3) float, optional
        Those in the plane are marked.
    quantity : str
        A key of `QUANTITIES`, or ``oil``, the surface that the field pushes down.
    array : TransducerArray, optional
        Array that made the field; a line then says how far the linear model holds at its strongest place.
    """
    from matplotlib.figure import Figure  # matplotlib takes as long to import as everything else together

    instance_of(field, Field, "field", "as in save_field_picture(path, field)")
    shape = field.grid.counts[0] / field.grid.counts[1]
    figure = Figure(figsize=(min(max(5.2 * shape, 3.0), 12.0) + 1.8, 6), layout="compressed")
    field.plot(figure.subplots(), points=points, quantity=quantity)
    if array is not None:
        believed = validity(array, *field.strongest(), field.medium)
        figure.supxlabel(f"{believed.brief[0].upper()}{believed.brief[1:]}", fontsize="small")
    save_figure(figure, path)
