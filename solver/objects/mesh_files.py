"""Meshes from files that anybody may have written: STL, OBJ, PLY, OFF, GLB and 3MF, read by trimesh.

A file is checked before trimesh reads it, because trimesh takes as much memory as some headers claim, reads other files
that a file names, and passes over compressed geometry.
"""

from __future__ import annotations

import json
import logging
import re
import struct
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any
from xml.parsers import expat
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import real
from ...base.errors import InputFileError, MissingExtraError
from ...base.extras import needing
from ...base.storage import FilePath, read_file
from ..contact.mesh import MOST_FACES, Mesh, Solid
from ..contact.repair import OpenSurfaceError

__all__ = ["MESH_FILES", "mesh_of", "read_mesh"]

MOST_BYTES = 100_000_000
"""Of a file: a million triangles have 50 MB in binary STL."""
MOST_LINES = 2_000_000
MOST_LINE_BYTES = 10_000
MOST_HEADER_BYTES = 2**14
MOST_PARTS = 1000
"""Parts of a file, and parts placed in a scene."""
MOST_JSON_BYTES = 2**22
MOST_ITEMS = 8_000_000
"""Of all accessors of a GLB file together."""
LARGEST = 2.0
"""Metres. A larger object is taken to be in another unit: no array reaches so far."""
LARGEST_MILLIMETRES = 2000.0
"""A larger object is too large even in millimetres."""
LARGE = 0.4
"""Metres. An object that is larger without a stated scale is more likely in another unit: a hand has 0.19 m."""
SMALLEST = 1e-3
"""Metres. A smaller object is taken to be in another unit: no hand feels it."""


def read_mesh(
    path: FilePath,
    scale: float | None = None,
    status: Callable[[str], None] | None = None,
    *,
    open: bool = False,  # the command line's name for it
) -> Mesh:
    """Read an object from a file, by the suffix of its name, and repair it (`Mesh.repaired`).

    Its coordinates are the array's, after the scale. A scene becomes one object, each of its parts in its place.

    Parameters
    ----------
    path : str or Path
        An STL, OBJ, PLY, OFF, GLB or 3MF file.
    scale : float, optional
        Metres in the file's unit of length: 0.001 for millimetres. Without it the file must be in metres, as GLB files
        are, or name its unit, as 3MF files do. The object is refused if it would be larger than `LARGEST` or smaller
        than `SMALLEST`, and if it is larger than `LARGE`, its `repairs` say so.
    status : function, optional
        Function that gets a line of text for each stage, for people who wait.
    open : bool
        Whether its surface may have holes, as scans and many models have; otherwise it must bound a body.

    Raises
    ------
    InputFileError
        If the file is damaged, of another kind, too large or in another unit, or does not hold the surface of a body;
        it names the file and says what is wrong.
    MissingExtraError
        If trimesh, or lxml for 3MF, is not installed.
    ValueError
        If the scale is not positive.
    OSError
        If the file cannot be opened.
    """
    path, tell = Path(path), status or (lambda _said: None)
    check = MESH_FILES.get(path.suffix.lower())
    if check is None:
        raise InputFileError(f"{path}: meshes are read from {', '.join(MESH_FILES)} files")
    tell(f"reading {path}")
    data = read_file(path, MOST_BYTES)
    try:
        vertices, faces, unit = _parsed(check(data), path.suffix.lower().removeprefix("."))
    except MissingExtraError:
        raise
    except Exception as error:  # on foreign bytes trimesh raises nearly anything
        reason = str(error) if type(error) is ValueError else f"it is damaged ({type(error).__name__}: {error})"
        raise InputFileError(f"{path} cannot be read as {path.suffix[1:].upper()}: {reason}") from error
    if not len(faces):
        raise InputFileError(f"{path} holds no triangles")
    return mesh_of(vertices, faces, path, unit if scale is None else scale, tell, may_be_open=open)


def mesh_of(
    vertices: NDArray[Any],
    faces: NDArray[Any],
    path: Path,
    scale: float | None,
    tell: Callable[[str], None],
    *,
    may_be_open: bool = False,
) -> Mesh:
    """The object whose surface is a file's triangles; parameters and errors as `read_mesh`."""
    scale = None if scale is None else real("scale", scale, 0, 1e9, above=True)
    tell(f"{path}: checking {len(faces)} faces")
    vertices = np.asarray(vertices, dtype=np.float64)
    with np.errstate(all="ignore"):
        extents = np.ptp(vertices[faces.ravel()], axis=0)
        if scale is None and np.isfinite(extents).all() and not SMALLEST <= extents.max() <= LARGEST:
            raise InputFileError(f"{path} is {_unit_trouble(extents)}, on the command line {path.name}:scale=…")
        scaled = vertices if scale is None else vertices * scale
    notes: tuple[str, ...] = ()
    if scale is None and extents.max() > LARGE:
        notes = (
            f"it is {_size(extents)} m large, and a hand 0.19 m: it looks like decimetres, or like no unit; pass "
            "scale=0.1, or scale=1 if metres are meant",
        )
    try:
        return Mesh(Solid(scaled, faces, notes), np.eye(3), np.zeros(3)).repaired(may_be_open=may_be_open)
    except OpenSurfaceError as error:
        said = f"{error}; pass open=True to touch its surface as it is, on the command line {path.name}:open=yes"
        raise InputFileError(f"{path}: {said}") from error
    except ValueError as error:
        raise InputFileError(f"{path}: {error}") from error


def _size(extents: NDArray[np.float64]) -> str:
    return " × ".join(f"{extent:.4g}" for extent in extents)


def _unit_trouble(extents: NDArray[np.float64]) -> str:
    size = _size(extents)
    if extents.max() < SMALLEST:
        return f"{size} as metres, too small to be felt: pass the metres in its unit as scale=…"
    if extents.max() > LARGEST_MILLIMETRES:
        return (
            f"{size} as metres, too large in any unit: check its coordinates, or pass the metres in its unit as scale=…"
        )
    likely = "millimetres: pass scale=0.001"
    if extents.max() <= 20:
        likely = f"centimetres or millimetres: pass scale=0.01 or {likely.partition('pass ')[2]}"
    return f"{size} as metres, larger than {LARGEST:g} m; it looks like {likely} (or scale=1 if metres are meant)"


def _parsed(data: bytes, kind: str) -> tuple[NDArray[Any], NDArray[Any], float | None]:
    """Vertices and faces of all parts of a file, each in its place, and the metres of its unit if it names one."""
    with needing("meshes", f"reading {kind.upper()}"):
        from trimesh import Trimesh, load_scene  # takes half a second

    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # else Python prints what it logs, with tracebacks
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        warnings.filterwarnings("error", "string or file could not be read", DeprecationWarning)
        with needing("meshes", f"reading {kind.upper()}"):  # lxml is imported when a 3MF is read
            scene = load_scene(BytesIO(data), file_type=kind, process=False, skip_materials=True)
        parts = [(name, *scene.graph[name]) for name in scene.graph.nodes_geometry]
        meshes = [(scene.geometry[geometry], place) for _, place, geometry in parts]
        meshes = [(mesh, place) for mesh, place in meshes if isinstance(mesh, Trimesh) and len(mesh.faces)]
        if (total := sum(len(mesh.faces) for mesh, _ in meshes)) > MOST_FACES:
            raise ValueError(f"its parts have {total} faces together; at most {MOST_FACES} are possible: simplify it")
        unit = METRES[(scene.units or "millimeter").removesuffix("s")] if kind == "3mf" else None
        return *_joined(meshes), unit


def _joined(meshes: list[tuple[Any, NDArray[np.float64]]]) -> tuple[NDArray[Any], NDArray[Any]]:
    vertices, faces, count = [np.empty((0, 3))], [np.empty((0, 3), dtype=np.int64)], 0
    for mesh, place in meshes:
        corners, triangles = np.asarray(mesh.vertices), np.asarray(mesh.faces)
        if triangles.min() < 0 or triangles.max() >= len(corners):
            raise ValueError(f"a face names vertex {triangles.max()} of {len(corners)}")
        mirrored = np.linalg.det(place[:3, :3]) < 0
        vertices.append(corners @ place[:3, :3].T + place[:3, 3])
        faces.append(count + (triangles[:, ::-1] if mirrored else triangles))
        count += len(corners)
    return np.concatenate(vertices), np.concatenate(faces)


# What each format may claim: bytes for trimesh, or ValueError


def _text(data: bytes) -> bytes:
    """A text of bounded lines, in ASCII, so that trimesh does not guess its encoding."""
    if (lines := data.count(b"\n") + data.count(b"\r")) > MOST_LINES:
        raise ValueError(f"it has {lines} lines; at most {MOST_LINES} may be: save it in a binary format")
    if re.search(rb"[^\r\n]{%d}" % MOST_LINE_BYTES, data):
        raise ValueError(f"one of its lines has {MOST_LINE_BYTES} bytes or more")
    return data.decode("ascii", "replace").encode("ascii", "replace")


def _check_stl(data: bytes) -> bytes:
    if len(data) >= 84 and len(data) == 84 + 50 * struct.unpack_from("<I", data, 80)[0]:
        return data
    if not data.lstrip()[:5].lower() == b"solid":
        raise ValueError("its length is not that of the triangles that it announces, and it is no text")
    if (parts := data.lower().count(b"endsolid")) > MOST_PARTS:
        raise ValueError(f"it has {parts} solids; at most {MOST_PARTS} may be")
    if not parts:
        raise ValueError("its end, the line endsolid, is missing")
    return _text(data)


def _check_obj(data: bytes) -> bytes:
    text = _text(data).replace(b"usemtl ", b"# ")  # a part of its own for each material would take long
    if re.search(rb"^f[^\n#]*\s-\d", text, re.MULTILINE):  # trimesh counts them from the file's end
        return b"\n".join(_counted_on(text))
    return text


def _counted_on(text: bytes) -> Iterator[bytes]:
    """The lines of an OBJ, whose faces count vertices from the file's beginning and name nothing else."""
    count = 0
    for line in text.splitlines():
        words = line.partition(b"#")[0].split()
        if words[:1] == [b"f"]:
            numbers = [int(word.partition(b"/")[0]) for word in words[1:]]
            if beyond := [number for number in numbers if not -count <= number]:
                raise ValueError(f"a face names vertex {beyond[0]}, after {count} vertices")
            line = b"f " + b" ".join(b"%d" % (number + count + 1 if number < 0 else number) for number in numbers)
        count += words[:1] == [b"v"]
        yield line


def _check_off(data: bytes) -> bytes:
    if not data.lstrip()[:3] == b"OFF":
        raise ValueError("it does not begin with OFF")
    return _text(data)


def _check_3mf(data: bytes) -> bytes:
    """A zip archive of bounded parts, in which few objects are placed: each may place others any number of times."""
    with ZipFile(BytesIO(data)) as archive:
        members = archive.infolist()
        if (size := sum(member.file_size for member in members)) > MOST_BYTES or len(members) > MOST_PARTS:
            raise ValueError(f"it has {len(members)} parts of {size} bytes; {MOST_PARTS} of {MOST_BYTES} may be")
        if packed := [member for member in members if member.compress_type not in (ZIP_STORED, ZIP_DEFLATED)]:
            raise ValueError(f"{packed[0].filename} is packed by method {packed[0].compress_type}")
        inside: dict[str, list[str]] = {}
        for member in members:
            if member.filename.lower().endswith(".model"):
                _read_placements(archive.read(member), inside)
    _count_placed(inside)
    return data


def _read_placements(model: bytes, inside: dict[str, list[str]]) -> None:
    """Add the objects that each object of a model places, by their ids; those of the whole stand under ""."""
    owners = [""]

    def begin(tag: str, attributes: dict[str, str]) -> None:
        kind = tag.rpartition(":")[2]
        if kind == "object":
            owners.append(attributes.get("id", ""))
        elif kind in ("component", "item"):
            inside.setdefault(owners[-1], []).append(attributes.get("objectid", ""))
        if len(owners) > 2:
            raise ValueError("an object of it stands within another one")

    def end(tag: str) -> None:
        if tag.rpartition(":")[2] == "object":
            owners.pop()

    def refuse(*_: object) -> None:
        raise ValueError("it declares a document type, which no model has")

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler, parser.StartDoctypeDeclHandler = begin, end, refuse
    parser.Parse(model, True)


def _count_placed(inside: dict[str, list[str]]) -> None:
    """Raise `ValueError` if objects that place others make too many parts, or one places itself."""
    placed, level = 0, Counter([""])
    for _ in range(MOST_DEPTH):
        below: Counter[str] = Counter()
        for name, times in level.items():
            for inner in inside.get(name, ()):
                below[inner] += times
        if not below:
            return
        placed, level = placed + below.total(), below
        if placed > MOST_PARTS:
            raise ValueError(f"it places more than {MOST_PARTS} parts")
    raise ValueError(f"its objects are nested deeper than {MOST_DEPTH}, or one holds itself")


def _check_ply(data: bytes) -> bytes:
    end = data[:MOST_HEADER_BYTES].find(b"end_header")
    if end < 0:
        raise ValueError(f"the end of its header is not within {MOST_HEADER_BYTES} bytes")
    return _text(data) if b"ascii" in data[:end] else data


def _check_glb(data: bytes) -> bytes:
    if len(data) < 20 or data[:4] != b"glTF":
        raise ValueError("it does not begin with glTF")
    version, length, size, kind = struct.unpack_from("<4xIII4s", data)
    if version != 2 or length != len(data) or kind != b"JSON" or not size <= min(MOST_JSON_BYTES, length - 20):
        raise ValueError(
            f"it announces version {version}, {length} bytes and a first part {kind!r} of {size} bytes; it must be "
            f"version 2 with {len(data)} bytes and a part b'JSON' of at most {MOST_JSON_BYTES}"
        )
    content = json.loads(data[20 : 20 + size].decode())
    if any("data:" not in buffer.get("uri", "data:")[:5] for buffer in content.get("buffers", [])):
        raise ValueError("its geometry is in another file, which is not read; save it in one")
    if changed := [name for name in content.get("extensionsRequired", []) if not name.startswith(HARMLESS)]:
        raise ValueError(f"it needs the extension {changed[0]}, which is not supported; save it without compression")
    accessors, views = content.get("accessors", []), content.get("bufferViews", [])
    if any("bufferView" not in accessor or "sparse" in accessor for accessor in accessors):
        raise ValueError("its geometry is sparse or missing, which is not supported")
    nodes = content.get("nodes", [])
    parts = sum(len(mesh["primitives"]) for mesh in content.get("meshes", []))
    places = len(nodes) + sum(len(node.get("children", [])) for node in nodes)
    for count, what, most in (
        (parts, "parts", MOST_PARTS),
        (places, "places", 2 * MOST_PARTS),
        (len(accessors) + len(views), "accessors and views", 10 * MOST_PARTS),
        (sum(abs(accessor["count"]) for accessor in accessors), "items", MOST_ITEMS),
        (sum(abs(view["byteLength"]) for view in views), "bytes of views", 2 * MOST_BYTES),
    ):
        if count > most:
            raise ValueError(f"it announces {count} {what}; at most {most} may be")
    return data


MOST_DEPTH = 16
METRES = {"micron": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "inch": 0.0254, "foot": 0.3048, "meter": 1.0}
"""Units of 3MF; its default is the millimetre."""
HARMLESS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_")
"""Extensions of GLB that change nothing of the geometry."""
MESH_FILES: dict[str, Callable[[bytes], bytes]] = {
    ".stl": _check_stl,
    ".obj": _check_obj,
    ".ply": _check_ply,
    ".off": _check_off,
    ".glb": _check_glb,
    ".3mf": _check_3mf,
}
"""What each format may claim, by the suffix of a file's name."""
