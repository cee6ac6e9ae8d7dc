"""Objects to be touched, as the command line has them: ``name:parameter=value,…`` or ``file:parameter=value,…``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import FARTHEST, real
from ..contact.mesh import Mesh
from ..contact.solids import SOLIDS
from ..geometry import as_position, frozen
from ..shapes.notation import check, read_parameters, written
from .mesh_files import MESH_FILES, read_mesh
from .volumes import VOLUMES, read_volume_mesh, volume_suffix

__all__ = ["MovingObject", "object_help", "object_name", "parse_object"]


@dataclass(frozen=True, eq=False)
class MovingObject:
    """An object that moves evenly.

    Parameters
    ----------
    mesh : Mesh
        The object as it is at the time 0.
    velocity : (3,) float
        Velocity in metres per second.
    spin : float
        Degrees per second about the vertical through the object's centre, counterclockwise from above.

    Raises
    ------
    ValueError
        If a number is not finite.
    """

    mesh: Mesh
    velocity: NDArray[np.float64]
    spin: float

    def __init__(self, mesh: Mesh, velocity: ArrayLike = (0, 0, 0), spin: float = 0.0) -> None:
        spin = real("spin", spin, unit="degrees per second")
        object.__setattr__(self, "mesh", mesh)
        object.__setattr__(self, "velocity", frozen(as_position(velocity, "velocity")))
        object.__setattr__(self, "spin", spin)

    @property
    def still(self) -> bool:
        """Whether it never moves."""
        return not self.spin and not self.velocity.any()

    def at(self, seconds: float) -> Mesh:
        """The object at a time, finite; it stops `FARTHEST` metres away."""
        if self.still:
            return self.mesh
        turned = self.mesh.rotated(self.spin * seconds)
        return Mesh(
            turned.solid, turned.rotation, np.clip(turned.offset + self.velocity * seconds, -FARTHEST, FARTHEST)
        )


@dataclass(frozen=True)
class Placement:
    """The place and the motion of an object."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.17
    rotation: float = 0.0
    vx: float = 0.0
    vy: float = 0.0
    vz: float = 0.0
    turn: float = 0.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        check(self)

    def put(self, mesh: Mesh) -> MovingObject:
        """An object with its centre here."""
        mesh = mesh.moved(np.array([self.x, self.y, self.z]) - mesh.centre).rotated(self.rotation)
        return MovingObject(mesh, (self.vx, self.vy, self.vz), self.turn)


@dataclass(frozen=True)
class Size:
    """The size of a shape of the paper."""

    size: float = 0.1


@dataclass(frozen=True)
class Scale:
    """The unit of a mesh file, and whether its surface may have holes."""

    scale: float | None = None
    open: bool = False


@dataclass(frozen=True)
class Surface:
    """Which surface of a volume is the object."""

    level: float | None = None
    spacing: float | None = None
    step: int = 1
    series: str | None = None


def object_help() -> str:
    """What an object may be, and its parameters with their defaults, a line each."""
    return f"""{"|".join(SOLIDS)}:{written(Size)}
FILE ({", ".join(MESH_FILES)}):scale=METRES,open=no
    scale is in its unit: 0.001 for millimetres; open=yes takes a surface with holes
FILE (.npy, .npz, .nii, .nii.gz, .nrrd, .dcm), DICOMDIR or DICOM folder:
level=VALUE,spacing=METRES,step=1,series=NAME
    what is above the level in a volume; a larger step is coarser; series names one of several
all: {written(Placement)}
    centre in m, degrees about the vertical, m/s, degrees per second"""


def parse_object(text: str, status: Callable[[str], None] | None = None) -> MovingObject:
    """Read an object such as ``cube``, ``sphere:size=0.06,x=0.02,turn=90``, ``cup.stl:scale=0.001`` or ``ct:level=9``.

    The centre of its bounding box is put at x, y and z, by default those of the paper's shapes. ``status`` is called
    with a line of text for each stage, for people who wait while a file is read.

    `ValueError` if the object or a parameter is unknown, or a value is of the wrong kind; the message names it.
    `InputFileError` or `OSError` if a file cannot be read.
    """
    name = object_name(text)
    parameters = text[len(name) + 1 :]
    if name in SOLIDS:
        values = read_parameters(name, parameters, Size, Placement)
        made: Mesh = getattr(Mesh, name)(values.pop("size", Size.size))
        return Placement(**values).put(made)
    path = Path(name)
    if (kind := _kind(name)) is None:
        raise ValueError(
            f"unknown object {name!r}; known are {', '.join(SOLIDS)}, {', '.join(MESH_FILES)} files, and as volumes "
            f"{VOLUMES}"
        )
    values = read_parameters(path.name, parameters, kind, Placement)
    own = {field.name: values.pop(field.name) for field in fields(kind) if field.name in values}
    place = Placement(**values)
    if kind is Scale:
        return place.put(read_mesh(path, **own, status=status))
    if "level" not in own:
        raise ValueError(f"{name} needs level=…, the value above which the object is")
    return place.put(read_volume_mesh(path, **own, status=status))


def object_name(text: str) -> str:
    """The shape or the file that an object's text names, without its parameters; a file's name may have colons."""
    first, _, _ = text.partition(":")
    if first in SOLIDS:
        return first
    name, colon, _ = text.rpartition(":")
    return text if not colon or _kind(text) else name


def _kind(name: str) -> type[Scale | Surface] | None:
    """What parameters a file or folder has; None if it is of no known kind."""
    if Path(name).suffix.lower() in MESH_FILES:
        return Scale
    return Surface if name and volume_suffix(Path(name)) else None
