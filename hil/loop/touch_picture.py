"""The picture of touch: object, hand, arcs and control points in space, and the field as emitted on a plane."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...base.pictures import BLUE, GREEN, INK, LANDSCAPE, LIGHT, MM, ON_FIELD, ORANGE, RED, new_figure, save_figure
from ...base.storage import FilePath
from ...solver import Medium, Modulation, PlaneField, TransducerArray, intensity_component, pressure, sample_cut
from ...solver.contact.hand import Hand
from ...solver.contact.mesh import Mesh
from ...solver.contact.silhouette import seen_along
from ...solver.contact.touch import Touch
from ...solver.fields.grid import Grid
from ...solver.geometry import counted

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from mpl_toolkits.mplot3d.axes3d import Axes3D

__all__ = ["outline", "plane_of", "save_touch_picture"]

ELEVATION, AZIMUTH = 24.0, -62.0  # degrees, the direction of view
SHARP = np.cos(np.radians(25.0))  # faces that meet at a larger angle make an edge that is drawn
MARGIN = 0.03  # metres around the control points on the plane of the field
SMALLEST = 0.12  # metres, side of that plane
CLEARANCE = 0.02  # metres between that plane and the array
STEP = 1e-3  # metres
IN_PLANE = 10e-3  # metres from the plane at which a thing is drawn in it

OBJECT, HAND, ARC = INK, ORANGE, BLUE
HALVES = (("points of the first half", RED, "o"), ("points of the second half", GREEN, "^"))
WHOLE = (("control points", RED, "o"),)


def save_touch_picture(
    path: FilePath,
    hands: Sequence[Hand],
    objects: Sequence[Mesh],
    touch: Touch,
    emitted: Modulation,
    array: TransducerArray,
    source: str | None,
) -> None:
    """Draw what touches what, and the resulting field, in the format of the path's suffix.

    Parameters
    ----------
    emitted : Modulation
        What the device plays: its drives rebuilt from bits or from pulses that were read back.
    source : str or None
        What the drives were rebuilt from, for the caption; None if they are as solved.

    Raises
    ------
    ValueError
        If nothing is touched, or the suffix is not that of a picture.
    """
    if touch.points is None:
        raise ValueError("no hand touches an object: there is no field to draw")
    scene = _Scene(hands, objects, touch, touch.points.positions, emitted, array)
    figure = new_figure(5.6, LANDSCAPE)
    sides = figure.add_gridspec(1, 2, width_ratios=[1, 1.08])
    left, right = figure.add_subfigure(sides[0]), figure.add_subfigure(sides[1])
    space: Axes3D = left.add_subplot(projection="3d")
    _draw_scene(space, scene)
    _draw_plane(right.subplots(), scene)
    left.legend(
        *space.get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False, fontsize="small"
    )
    figure.suptitle(f"{counted(len(scene.at), 'control point')} on {counted(len(touch.arcs), 'arc')}")
    figure.supxlabel(_caption(scene, source), fontsize="medium")
    save_figure(figure, path)


@dataclass(frozen=True, eq=False)
class _Scene:
    """What both parts of the picture show."""

    hands: Sequence[Hand]
    objects: Sequence[Mesh]
    touch: Touch
    at: NDArray[np.float64]
    """(m, 3) places of the control points, in metres."""
    emitted: Modulation
    array: TransducerArray

    @cached_property
    def drives(self) -> NDArray[np.complex128]:
        """The drives of all samples that are not silent, (s, n)."""
        drives = self.emitted.weights @ self.emitted.drives
        return drives[drives.any(axis=1)] if drives.any() else drives[:1]

    @cached_property
    def pressures(self) -> NDArray[np.float64]:
        """|p| at the control points by each of these drives, (s, m) in Pa."""
        return np.abs([pressure(self.array, drive, self.at) for drive in self.drives])

    @cached_property
    def grid(self) -> Grid:
        """The plane of the field."""
        return plane_of(self.at, float(self.array.positions[:, 2].max()))

    @property
    def kinds(self) -> Iterator[tuple[str, str, str, NDArray[np.bool_]]]:
        """Label, colour and marker of each kind of control points, and which of them these are."""
        louder = self.pressures.argmax(axis=0)
        in_halves = len(self.pressures) == 2
        for number, (label, colour, marker) in enumerate(HALVES if in_halves else WHOLE):
            yield label, colour, marker, louder == number if in_halves else np.ones(len(self.at), bool)


def plane_of(points: NDArray[np.float64], floor: float) -> Grid:
    """The plane nearest to points (m, 3), as a square that shows them and stays above the array's height, in metres.

    Its normal is the direction in which the points vary least; points that lie on a line get the plane that is the most
    horizontal. Its first axis is as near to x as the plane allows.
    """
    mean = points.mean(axis=0)
    _, extents, directions = np.linalg.svd(points - mean, full_matrices=True)
    spread = np.zeros(3)
    spread[: len(extents)] = extents
    flat = directions[spread < 1e-6]  # directions in which the points vary less than a micrometre
    normal = directions[2] if len(flat) < 2 else flat.T @ flat[:, 2]  # the part of z in these
    if np.linalg.norm(normal) < 1e-9:
        normal = flat[0]
    normal = normal / np.linalg.norm(normal) * (1 if normal[2] >= 0 else -1)
    if normal[2] > 1 - 1e-9:
        first, second = np.eye(3)[:2]
    else:
        first = np.eye(3)[0] - normal[0] * normal
        if np.linalg.norm(first) < 1e-3:  # the plane is that of y and z
            first = np.eye(3)[1] - normal[1] * normal
        first = first / np.linalg.norm(first)
        second = np.cross(normal, first)
    offsets = (points - mean) @ np.array([first, second]).T
    low, high = offsets.min(axis=0), offsets.max(axis=0)
    centre = mean + (low + high) / 2 @ np.array([first, second])
    in_plane = (high - low).max() / 2
    slope = abs(first[2]) + abs(second[2])
    room = (centre[2] - floor - CLEARANCE) / slope if slope > 0 else np.inf
    half = max(min(max(in_plane + MARGIN, SMALLEST / 2), room), 2 * STEP)
    return Grid.spanning(centre, [first, second], [2 * half] * 2, STEP)


def outline(mesh: Mesh, towards: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The edges that show a mesh from a direction (3,): its silhouette, its sharp edges and its borders.

    Lines that are seen and lines that are hidden, (k, 2, 3) each, in metres; hidden ones have both faces turned away.
    """
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    faces = mesh.solid.edge_faces
    border = faces[:, 1] < 0
    facing = (normals @ towards > 0)[faces]
    sharp = np.einsum("ek,ek->e", normals[faces[:, 0]], normals[faces[:, 1]]) < SHARP
    drawn = border | sharp | (facing[:, 0] != facing[:, 1])
    hidden = ~facing.any(axis=1) & ~border
    lines = mesh.vertices[mesh.solid.edges]
    return lines[drawn & ~hidden], lines[drawn & hidden]


def _draw_scene(axes: Axes3D, scene: _Scene) -> None:
    """Draw everything in space, in millimetres, all axes alike."""
    from matplotlib.ticker import MultipleLocator
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    array, grid = scene.array, scene.grid
    elevation, azimuth = np.radians([ELEVATION, AZIMUTH])
    towards = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    axes.scatter(*(array.positions * MM).T, s=4, color="0.75", depthshade=False, label="array")
    for mesh in scene.objects:
        for lines, style in zip(outline(mesh, towards), ("-", ":"), strict=True):
            if len(lines):
                axes.add_collection3d(Line3DCollection(lines * MM, colors=OBJECT, linewidths=1.1, linestyles=style))
    for hand in scene.hands:
        axes.add_collection3d(Poly3DCollection(hand.quads * MM, facecolors=HAND, alpha=0.35, linewidths=0))
    half, (first, second) = grid.offsets(0)[-1], grid.axes
    frame = grid.centre + half * np.array(
        [a * first + b * second for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))]
    )
    axes.plot(*(frame * MM).T, color="0.5", linewidth=0.8, linestyle="--", label="plane of the field")
    for number, arc in enumerate(scene.touch.arcs):
        axes.plot(*(arc * MM).T, color=ARC, linewidth=2, label="arcs" if number == 0 else None)
    for name, colour, marker, mine in scene.kinds:
        axes.scatter(*(scene.at[mine] * MM).T, color=colour, marker=marker, s=34, depthshade=False, label=name)
    axes.plot([], [], color=OBJECT, label="object")
    axes.plot([], [], color=HAND, linewidth=6, alpha=0.4, label="hand")
    shown = [array.positions, *(mesh.vertices for mesh in scene.objects)]
    shown += [hand.quads.reshape(-1, 3) for hand in scene.hands]
    low, high = (getattr(np.concatenate(shown), which)(axis=0) * MM for which in ("min", "max"))
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set(xlabel="x / mm", ylabel="y / mm", zlabel="z / mm")
    axes.set_box_aspect(high - low, zoom=0.9)  # its labels lie outside
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MultipleLocator(50))
        axis.set_pane_color("w")
        axis._axinfo["grid"]["color"] = "0.88"  # a setting of matplotlib otherwise, which all threads share
        axis.set_tick_params(labelsize="small")
    axes.set_proj_type("ortho")
    axes.view_init(ELEVATION, AZIMUTH)


def _draw_plane(axes: Axes, scene: _Scene) -> None:
    """Draw the largest |p| of all fields in turn over the plane, and what lies in it."""
    at, grid = scene.at, scene.grid
    fields = np.stack([sample_cut(scene.array, drive, grid).pressure for drive in scene.drives])
    largest = np.take_along_axis(fields, np.abs(fields).argmax(axis=0)[None], axis=0)[0]
    PlaneField(grid, largest, Medium()).plot(axes)
    shift = np.array([grid.coordinates(axis)[1][0] - grid.offsets(axis)[0] for axis in (0, 1)])

    def flat(places: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(((places - grid.centre) @ grid.axes.T + shift) * MM)

    def near(places: NDArray[np.float64]) -> NDArray[np.bool_]:
        return np.abs((places - grid.centre) @ grid.normal) < IN_PLANE

    for number, hand in enumerate(scene.hands):
        for line in seen_along(hand, grid.axes):
            shown = (line - grid.axes @ grid.centre + shift) * MM
            axes.fill(*shown.T, fill=False, edgecolor="w", alpha=0.8, linewidth=0.9, label=None if number else "hand")
    for number, arc in enumerate(scene.touch.arcs):
        cut = np.where(near(arc)[:, None], flat(arc), np.nan)
        axes.plot(*cut.T, color=LIGHT, linewidth=0.8, label=None if number else "arcs")
    for _, colour, marker, mine in scene.kinds:
        shown = at[mine & near(at)]
        if len(shown):
            axes.plot(*flat(shown).T, marker, mfc=colour, mec="w", ms=8, mew=1)
    away = at[~near(at)]
    if len(away):
        axes.plot(*flat(away).T, "x", color="0.6", ms=6, label=f"points more than {IN_PLANE * MM:g} mm off the plane")
    axes.legend(loc="upper right", **ON_FIELD)
    low, high = flat(grid.positions()[0, 0]), flat(grid.positions()[-1, -1])
    axes.set(title=_name_of(grid, len(fields)), xlim=(low[0], high[0]), ylim=(low[1], high[1]))


def _name_of(grid: Grid, fields: int) -> str:
    tilt = float(np.degrees(np.arccos(min(abs(grid.normal[2]), 1.0))))
    centre = ", ".join(f"{place:.0f}" for place in np.round(grid.centre * MM) + 0.0)
    where = (
        f"{grid.centre[2] * MM:.0f} mm above the array" if tilt < 0.05 else f"tilted by {tilt:.0f}° about ({centre}) mm"
    )
    which = {1: "|p|", 2: "Larger |p| of both halves"}.get(fields, f"Largest |p| of {fields} fields")
    return f"{which} on the plane nearest to the points,\n{where}"


def _caption(scene: _Scene, source: str | None) -> str:
    emitted, loudest = scene.emitted, scene.pressures.max(axis=0)
    length = sum(float(np.linalg.norm(np.diff(arc, axis=0), axis=1).sum()) for arc in scene.touch.arcs)
    harmonics = range(1, max(len(emitted.weights) // 2, 1) + 1)
    changes = [intensity_component(scene.array, emitted, scene.at, harmonic) for harmonic in harmonics]
    strongest = int(np.argmax([change.mean() for change in changes]))
    felt, frequency = changes[strongest], harmonics[strongest] * emitted.true_frequency
    return (
        f"Arcs of {length * MM:.0f} mm. At the points |p| is {loudest.mean():.0f} Pa on average, "
        f"{loudest.min():.0f} to {loudest.max():.0f} Pa (peak, linear model).\nThe intensity changes at "
        f"{frequency:.4g} Hz by {felt.mean() / 1e6:.2f} kPa² on average, {felt.min() / 1e6:.2f} kPa² at "
        f"the weakest.\n"
        + (f"Field as emitted: drives rebuilt from {source}." if source else "Field of the drives as solved.")
    )
