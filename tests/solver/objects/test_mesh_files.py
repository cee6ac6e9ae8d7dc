from __future__ import annotations

import io
import json
import struct
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import pytest
import trimesh
from phasewire import Hand, Mesh
from phasewire.base.errors import InputFileError
from phasewire.solver.contact.cut import cut
from phasewire.solver.objects.mesh_files import MESH_FILES, MOST_PARTS, read_mesh
from phasewire.solver.objects.parsing import parse_object

from tests.solver.contact.cuts import in_trimesh

SHAPE = trimesh.creation.icosphere(subdivisions=2, radius=0.05)
CUBE = Mesh.cube()


def binary_stl(mesh: Mesh) -> bytes:
    """As the format's description has it, without trimesh."""
    records = np.zeros(len(mesh.faces), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    records["corners"] = mesh.vertices[mesh.faces]
    return bytes(80) + struct.pack("<I", len(records)) + records.tobytes()


def exported(shape: Any, kind: str) -> bytes:
    data = shape.export(file_type=kind)
    return data if isinstance(data, bytes) else data.encode()


def written(folder: Path, kind: str, data: bytes) -> Path:
    path = folder / f"object.{kind.partition('_')[0]}"
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("kind", ["stl", "stl_ascii", "obj", "ply", "ply_ascii", "off", "glb"])
@pytest.mark.parametrize("upper", [False, True])
def test_files_written_by_trimesh_are_read(kind: str, upper: bool, tmp_path: Path) -> None:
    data = exported(SHAPE, kind) if kind != "ply_ascii" else SHAPE.export(file_type="ply", encoding="ascii")
    path = written(tmp_path, kind.upper() if upper else kind, data)
    said: list[str] = []
    mesh = read_mesh(str(path), status=said.append)
    assert mesh.repairs == ()
    assert len(mesh.faces) == len(SHAPE.faces)
    assert in_trimesh(mesh).is_watertight
    assert in_trimesh(mesh).volume == pytest.approx(SHAPE.volume, rel=1e-5)
    np.testing.assert_allclose(in_trimesh(mesh).bounds, SHAPE.bounds, atol=1e-7)
    assert said == [f"reading {path}", f"{path}: checking 320 faces"]


def test_a_scene_is_flattened_with_its_places(tmp_path: Path) -> None:
    scene: Any = trimesh.Scene()
    box = trimesh.creation.box(extents=(0.1, 0.1, 0.1))
    mirrored = np.diag([-1.0, 1, 1, 1])
    mirrored[:3, 3] = 0.5, 0, 0
    scene.add_geometry(box, node_name="one", geom_name="box")
    scene.add_geometry(box, node_name="two", geom_name="box", transform=mirrored)
    mesh = read_mesh(written(tmp_path, "glb", scene.export(file_type="glb")), scale=1)
    assert mesh.repairs == ()
    assert in_trimesh(mesh).volume == pytest.approx(2e-3)
    np.testing.assert_allclose(in_trimesh(mesh).bounds, [[-0.05, -0.05, -0.05], [0.55, 0.05, 0.05]], atol=1e-7)


def test_an_obj_with_polygons_materials_and_other_files(tmp_path: Path) -> None:
    lines = ["mtllib /etc/passwd", "o cube", *(f"v {x} {y} {z}" for x, y, z in CUBE.vertices)]
    lines += ["vt 0 0", "usemtl red", *(f"f {a + 1}/1 {b + 1}/1 {c + 1}/1" for a, b, c in CUBE.faces[:6])]
    lines += ["usemtl blue", *(f"f {a + 1}/1 {b + 1}/1 {c + 1}/1" for a, b, c in CUBE.faces[6:])]
    mesh = read_mesh(written(tmp_path, "obj", "\n".join(lines).encode()))
    assert len(mesh.vertices) == 8
    assert in_trimesh(mesh).volume == pytest.approx(1e-3)
    square = ["f 1 2 4 3", "f 5 7 8 6", "f 1 5 6 2", "f 3 4 8 7", "f 1 3 7 5", "f 2 6 8 4"]
    corners = [f"v {x} {y} {z}" for x in (0, 0.1) for y in (0, 0.1) for z in (0, 0.1)]
    mesh = read_mesh(written(tmp_path, "obj", "\n".join(corners + square).encode()))
    assert in_trimesh(mesh).volume == pytest.approx(1e-3)


@pytest.mark.parametrize(
    ("size", "message"),
    [
        (80, r"is 80 × 80 × 80 as metres, larger than 2 m; it looks like millimetres: pass scale=0.001 "),
        (5e7, r"is 5e\+07 × 5e\+07 × 5e\+07 as metres, too large in any unit: check its coordinates"),
        (8, r"is 8 × 8 × 8 as metres, .* centimetres or millimetres: pass scale=0.01 or scale=0.001 "),
        (8e-5, r"is 8e-05 × 8e-05 × 8e-05 as metres, too small to be felt"),
    ],
)
@pytest.mark.parametrize("kind", ["stl", "glb"])
def test_an_unlikely_size_is_refused_with_a_scale(size: float, message: str, kind: str, tmp_path: Path) -> None:
    path = written(tmp_path, kind, exported(trimesh.creation.box(extents=[size] * 3), kind))
    with pytest.raises(InputFileError, match=message):
        read_mesh(path)
    mesh = read_mesh(path, scale=0.08 / size)
    assert in_trimesh(mesh).volume == pytest.approx(0.08**3, rel=1e-5)


def test_an_open_mesh_is_refused_by_name_with_a_way_on(tmp_path: Path) -> None:
    path = written(tmp_path, "stl", binary_stl(Mesh.of(CUBE.vertices, CUBE.faces[1:])))
    with pytest.raises(InputFileError, match=rf"^{path}: it is not closed: it has 1 hole.*object.stl:open=yes"):
        read_mesh(path)
    mesh = read_mesh(path, open=True)
    assert (len(mesh.faces), mesh.repairs) == (11, ("3 open edges left: it is a surface, no body",))
    assert parse_object(f"{path}:open=yes").mesh.repairs == mesh.repairs


def test_a_sheet_that_may_be_open_is_cut(tmp_path: Path) -> None:
    """By a hand at z = 0.17 m in a vertical sheet at x = 0.01 m: all its arcs lie at this x."""
    corners = np.array([[0.01, y, z] for y in (-0.2, 0.2) for z in (0.1, 0.3)])
    sheet = Mesh.of(corners, [[0, 1, 2], [1, 3, 2]])
    path = written(tmp_path, "stl", binary_stl(sheet))
    with pytest.raises(InputFileError, match=r"it is not closed|it encloses no volume"):
        read_mesh(path)
    arcs = cut(Hand.flat((0, 0, 0.17)).quads, read_mesh(path, open=True))
    assert np.ptp(arcs.vertices[:, 1]) > 0.05
    np.testing.assert_allclose(arcs.vertices[:, 0], 0.01, atol=1e-8)


@pytest.mark.parametrize("separator", ["\n", "\r\n"])
def test_faces_that_count_backwards_are_those_that_count_forwards(separator: str, tmp_path: Path) -> None:
    lines = ["vt 0 0", "vn 0 0 1"]
    for count, corners in enumerate(CUBE.vertices[CUBE.faces]):
        lines += [f"v {x} {y} {z}" for x, y, z in corners]
        lines.append("f -3/-1/-1 -2/-1/-1 -1/-1/-1" if count % 2 else f"f {3 * count + 1}//1 -2//1 {3 * count + 3}//1")
    mesh = read_mesh(written(tmp_path, "obj", separator.join(lines).encode()))
    assert (len(mesh.faces), mesh.repairs) == (12, ())
    assert in_trimesh(mesh).volume == pytest.approx(1e-3)


@pytest.mark.parametrize(("unit", "metres"), [("millimeter", 1e-3), ("inch", 0.0254), ("meter", 1.0), (None, 1e-3)])
def test_a_3mf_has_its_unit_and_its_places(unit: str | None, metres: float, tmp_path: Path) -> None:
    pytest.importorskip("lxml")
    size = 0.08 / metres
    box = trimesh.creation.box(extents=(size, size, size))
    corners = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in box.vertices)
    faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in box.faces)
    placed = f'<component objectid="1"/><component objectid="1" transform="1 0 0 0 1 0 0 0 1 {2 * size} 0 0"/>'
    data = three_mf(
        f'<object id="1"><mesh><vertices>{corners}</vertices><triangles>{faces}</triangles></mesh></object>'
        f'<object id="2"><components>{placed}</components></object>',
        '<item objectid="2"/>',
        "" if unit is None else f' unit="{unit}"',
    )
    mesh = read_mesh(written(tmp_path, "3mf", data))
    np.testing.assert_allclose(in_trimesh(mesh).bounds, [[-0.04] * 3, [0.2, 0.04, 0.04]], atol=1e-7)
    assert in_trimesh(mesh).volume == pytest.approx(2 * 0.08**3)
    assert np.ptp(read_mesh(tmp_path / "object.3mf", scale=metres / 2).vertices[:, 0]) == pytest.approx(0.12)


def test_a_large_object_is_a_warning_with_its_extent_and_unit(tmp_path: Path) -> None:
    path = written(tmp_path, "stl", exported(trimesh.creation.box(extents=[1.5, 0.2, 0.3]), "stl"))
    assert [note.partition("; pass")[0] for note in read_mesh(path).repairs] == [
        "it is 1.5 × 0.2 × 0.3 m large, and a hand 0.19 m: it looks like decimetres, or like no unit"
    ]
    assert read_mesh(path, scale=1).repairs == ()


def three_mf(objects: str, items: str, said: str = "", before: str = "") -> bytes:
    core = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
    model = f'{before}<model xmlns="{core}"{said}><resources>{objects}</resources><build>{items}</build></model>'
    data = io.BytesIO()
    with ZipFile(data, "w") as archive:
        archive.writestr("3D/3dmodel.model", model)
    return data.getvalue()


def glb(content: dict[str, Any], binary: bytes = b"") -> bytes:
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text
    body += struct.pack("<I4s", len(binary), b"BIN\0") + binary if binary else b""
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


def ply(vertices: str, form: str = "binary_little_endian", body: bytes = b"") -> bytes:
    head = f"ply\nformat {form} 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n"
    return f"{head}element face {vertices}\nproperty list uchar int vertex_indices\nend_header\n".encode() + body


ACCESSOR = {"componentType": 5126, "type": "VEC3", "count": 3}
HOSTILE = {
    "an off that is none": ("off", b"NOFF\n3 1 0\n", "does not begin with OFF"),
    "an obj before its first vertex": ("obj", b"v 0 0 0\nf -1 -2 -1\nv 1 1 1\n", "names vertex -2, after 1 vertices"),
    "a 3mf that is no archive": ("3mf", b"<model/>", "File is not a zip file"),
    "a 3mf that places itself": (
        "3mf",
        three_mf('<object id="1"><components><component objectid="1"/></components></object>', '<item objectid="1"/>'),
        "nested deeper than",
    ),
    "a 3mf that doubles": (
        "3mf",
        three_mf(
            "".join(
                f'<object id="{n}"><components>{f"""<component objectid="{n + 1}"/>""" * 2}</components></object>'
                for n in range(1, 15)
            ),
            '<item objectid="1"/>',
        ),
        "places more than 1000 parts",
    ),
    "a 3mf with entities": (
        "3mf",
        three_mf("&a;", "", before='<!DOCTYPE model [<!ENTITY a "b">]>'),
        "it declares a document type",
    ),
    "an stl of four billion triangles": ("stl", bytes(80) + b"\xff\xff\xff\xff" + bytes(500), "is not that of the tri"),
    "an stl without triangles": ("stl", bytes(84), "holds no triangles"),
    "an stl of nothing": ("stl", b"", "its length is not"),
    "an stl without an end": ("stl", b"solid a\nfacet normal 0 0 1\n", "the line endsolid, is missing"),
    "an stl with words for numbers": ("stl", b"solid\nvertex a b c\nendsolid\n", "could not be read"),
    "an stl of many solids": ("stl", b"solid\nendsolid\n" * (MOST_PARTS + 1), "it has 1001 solids"),
    "an obj of nothing": ("obj", b"", "holds no triangles"),
    "an obj of many lines": ("obj", b"f\n" * 3_000_000, "it has 3000000 lines"),
    "an obj of one line": ("obj", b"f" + b" 1" * 10_000, "one of its lines has 10000 bytes or more"),
    "an obj with a vertex too few": ("obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "IndexError"),
    "an obj that is not finite": ("obj", b"v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n", "must be finite"),
    "an obj beyond all bounds": ("obj", b"v 0 0 0\nv 1e308 0 0\nv -1e308 1 0\nf 1 2 3\n", "at most 10"),
    "a ply of four billion vertices": ("ply", ply("4294967295"), "unexpected length"),
    "a ply of a number without end": ("ply", ply("9" * 5000), "digits"),
    "a ply without an end": ("ply", b"ply\nformat ascii 1.0\n" + b"comment\n" * 10**5, "the end of its header"),
    "a ply of lists of four billion": ("ply", ply("0").replace(b"uchar", b"uint") + b"\xff" * 99, "C int"),
    "a ply of many lines": ("ply", ply("3", "ascii", b"\n" * 3_000_000), "lines; at most"),
    "a glb of nothing": ("glb", b"", "does not begin with glTF"),
    "a glb of the first version": ("glb", b"glTF" + struct.pack("<II", 1, 20) + bytes(8), "announces version 1"),
    "a glb whose text is longer": ("glb", b"glTF" + struct.pack("<III4s", 2, 20, 10**9, b"JSON"), "of 1000000000"),
    "a glb without accessors": ("glb", glb({}), "holds no triangles"),
    "a glb of another file": ("glb", glb({"buffers": [{"uri": "/etc/passwd", "byteLength": 9}]}), "in another file"),
    "a glb of the network": (
        "glb",
        glb({"buffers": [{"uri": "http://example.org/a", "byteLength": 9}]}),
        "another file",
    ),
    "a compressed glb": ("glb", glb({"extensionsRequired": ["KHR_draco_mesh_compression"]}), "the extension KHR_draco"),
    "a sparse glb": ("glb", glb({"accessors": [ACCESSOR]}), "sparse or missing"),
    "a glb of many items": (
        "glb",
        glb({"accessors": [ACCESSOR | {"bufferView": 0, "count": 10**12}]}),
        "1000000000000 items",
    ),
    "a glb that hides its items": (
        "glb",
        glb({"accessors": [ACCESSOR | {"bufferView": 0, "count": count} for count in (10**12, -(10**12))]}),
        "2000000000000 items",
    ),
    "a glb of many views": (
        "glb",
        glb({"bufferViews": [{"buffer": 0, "byteLength": 10**8}] * 3, "accessors": []}),
        "300000000 bytes of views",
    ),
    "a glb of many places": ("glb", glb({"nodes": [{"children": [0] * 3000}]}), "3001 places; at most 2000"),
    "a glb nested without end": ("glb", glb({}).replace(b"{}  ", b"[[[["), "JSONDecodeError|Expecting"),
    "a glb of lists": ("glb", glb({"meshes": [3]}), "TypeError"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_invalid_mesh_files_are_refused_by_name(name: str, tmp_path: Path) -> None:
    kind, data, message = HOSTILE[name]
    path = written(tmp_path, kind, data)
    with pytest.raises(InputFileError, match=rf"(?s)^{path}.*({message})"):
        read_mesh(path)


def test_logs_of_trimesh_are_not_printed(tmp_path: Path) -> None:
    path = written(tmp_path, "stl", b"solid\nfacet normal a b c\nvertex 0 0 0\nvertex 0 0 1\nvertex 0 1 0\nendsolid\n")
    code = (
        f"import phasewire as p; from contextlib import suppress\nwith suppress(ValueError): p.read_mesh({str(path)!r})"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert ended.stderr == ""


@pytest.mark.parametrize("name", ["cup.step", "cup", "cup.stl.gz"])
def test_other_formats_are_refused(name: str) -> None:
    with pytest.raises(InputFileError, match=f"{name}: meshes are read from .stl, .obj, .ply, .off, .glb, .3mf files"):
        read_mesh(name)


@pytest.mark.parametrize("kind", [suffix[1:] for suffix in MESH_FILES] + ["stl_ascii"])
def test_a_file_cut_off_anywhere_is_refused_or_whole(kind: str, tmp_path: Path) -> None:
    whole = exported(trimesh.creation.box(extents=(0.1, 0.1, 0.1)), kind)
    for end in range(0, len(whole), 1 + len(whole) // 60):
        path = written(tmp_path, kind, whole[:end])
        with suppress(InputFileError):
            assert in_trimesh(read_mesh(path)).volume == pytest.approx(1e-3)


def test_a_million_faces_are_read_and_more_are_refused(tmp_path: Path) -> None:
    faces = np.zeros((1_000_001, 3), dtype=np.int64)
    records = np.zeros(len(faces), dtype="V50").tobytes()
    path = written(tmp_path, "stl", bytes(80) + struct.pack("<I", len(faces)) + records)
    with pytest.raises(InputFileError, match="its parts have 1000001 faces together; at most 1000000 are possible"):
        read_mesh(path)
    path = written(tmp_path, "stl", bytes(80) + struct.pack("<I", len(faces) - 1) + records[50:])
    with pytest.raises(InputFileError, match="too small"):
        read_mesh(path)


def test_no_other_file_is_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.mtl").write_text("newmtl a\nmap_Kd a.png\n")
    text = b"mtllib a.mtl\nusemtl a\n" + exported(SHAPE, "obj")
    path = written(tmp_path, "obj", text)
    import trimesh as loaded_before  # noqa: F401 - so that what follows opens no module

    opened: list[str] = []
    real = io.open

    def listening(file: Any, *arguments: Any, **options: Any) -> Any:
        opened.append(str(file))
        return real(file, *arguments, **options)

    monkeypatch.setattr("io.open", listening)
    monkeypatch.setattr("builtins.open", listening)
    read_mesh(path)
    assert opened == [str(path)]
