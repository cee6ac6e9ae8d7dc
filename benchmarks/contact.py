"""How long it takes from a hand's pose to control points, and where the time goes, with trimesh as the peer.

``make bench`` runs it after the other benchmarks, on one thread. A hand sweeps through each object; each pose is timed
once per round. Wall time shows what else ran on this machine, processor time does not. trimesh cuts with the same
sixteen planes in the same run; it does not cut off what is outside the quadrilaterals, nor join the arcs of a hand.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from time import perf_counter, thread_time
from typing import Any

import numpy as np
import trimesh
from bench import machine, median, options, record
from phasewire.solver.contact.bvh import build
from phasewire.solver.contact.cut import cut
from phasewire.solver.contact.hand import Hand
from phasewire.solver.contact.mesh import Mesh, Solid
from phasewire.solver.contact.touch import Toucher

POSES = 400
CALLS = 4000
PEER_POSES = 5
GOALS = {"small": 0.2e-3, "large": 1e-3}
"""Seconds in which 99 of 100 poses of a small or a large object should have their points."""
SHAPES = ("cube", "sphere", "cone", "pyramid", "horizontal_prism", "vertical_prism")


def objects() -> dict[str, Mesh]:
    """The paper's six, and a ball and a torus of 80 000 to 100 000 faces."""
    ball = trimesh.creation.icosphere(subdivisions=6, radius=0.05)
    torus = trimesh.creation.torus(0.04, 0.02, major_sections=320, minor_sections=156)
    made = {name: getattr(Mesh, name)() for name in SHAPES}
    for name, large in {"ball": ball, "torus": torus}.items():
        made[name] = Mesh.of(large.vertices, large.faces).moved((0, 0, 0.17))
    return made


def landmarks() -> list[np.ndarray]:
    """A hand that sweeps through the objects, turns and bends its fingers."""
    phases = np.linspace(0, 2 * np.pi, POSES, endpoint=False)
    return [
        Hand.flat(
            (0.03 * np.sin(p), -0.03 + 0.05 * np.cos(p), 0.17 + 0.04 * np.sin(3 * p)), curl=0.3 - 0.3 * np.cos(2 * p)
        )
        .rotated(30 * np.sin(p), (1, 1, 0))
        .landmarks
        for p in phases
    ]


def timed(call: Callable[[Any], object], inputs: Sequence[Any], calls: int) -> dict[str, float]:
    """Distribution of the time of a call, which gets the inputs in turn, in seconds."""
    for each in inputs:
        call(each)
    wall, processor = np.empty(calls), np.empty(calls)
    for i in range(calls):
        each = inputs[i % len(inputs)]
        begun, begun_here = perf_counter(), thread_time()
        call(each)
        wall[i], processor[i] = perf_counter() - begun, thread_time() - begun_here
    found = {"median": np.median(wall), "p99": np.quantile(wall, 0.99), "p99_processor": np.quantile(processor, 0.99)}
    return {name: float(value) for name, value in found.items()}


def by_trimesh(mesh: trimesh.Trimesh, quads: np.ndarray) -> list[Any]:
    """Sections of a mesh with sixteen planes."""
    normals = np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return [mesh.section(normal, quad[0]) for normal, quad in zip(normals, quads, strict=True)]


def poses(name: str, mesh: Mesh) -> dict[str, Any]:
    """One object: its cuts, the whole way to points, and the peer's cuts."""
    places = landmarks()
    quads = [np.array(Hand(place).quads) for place in places]
    toucher = Toucher()
    peer = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    some = quads[:: POSES // PEER_POSES]
    begun = perf_counter()
    for each in some:
        by_trimesh(peer, each)
    by_peer = (perf_counter() - begun) / len(some)
    cuts = timed(lambda each: cut(each, mesh, hands=True), quads, CALLS)
    return {
        "name": name,
        "faces": len(mesh.faces),
        "arcs": float(np.mean([len(cut(each, mesh, hands=True)) for each in quads])),
        "vertices": float(np.mean([len(cut(each, mesh, hands=True).vertices) for each in quads])),
        "points": float(np.mean([len(toucher.touch(Hand(place), mesh).ids) for place in places])),
        "cut": cuts,
        "way": timed(lambda place: toucher.touch(Hand(place), mesh), places, CALLS),
        "goal": GOALS["small" if len(mesh.faces) < 10_000 else "large"],
        "trimesh": by_peer,
        "ratio": by_peer / cuts["median"],
    }


def building() -> dict[str, float]:
    """Seconds to prepare 100 000 faces: edges and tree."""
    made = trimesh.creation.torus(0.04, 0.02, major_sections=320, minor_sections=157)
    vertices, faces = np.array(made.vertices), np.array(made.faces)
    solid = Solid(vertices, faces)
    return {
        "faces": len(faces),
        "edges": median(lambda: Solid(vertices, faces).edges),
        "tree": median(lambda: build(solid.vertices, solid.faces)),
    }


def main() -> None:
    arguments = options(__doc__).parse_args()
    print(machine(f"trimesh {trimesh.__version__}"))
    prepared = building()
    edges, tree = prepared["edges"] * 1e3, prepared["tree"] * 1e3
    print(f"{prepared['faces']} faces: edges in {edges:.0f} ms, tree in {tree:.0f} ms (goal 500 ms)")
    print(f"\nSixteen quadrilaterals of a hand, µs; {CALLS} poses each; p99* in processor time")
    print(
        f"{'':18}{'faces':>8}{'pieces':>8}{'points':>8}{'cut':>8}{'p99':>8}{'p99*':>8}"
        f"{'points in':>11}{'p99':>8}{'p99*':>8}{'goal':>7}{'trimesh':>10}{'ratio':>8}"
    )
    rows = []
    for name, mesh in objects().items():
        row = poses(name, mesh)
        rows.append(row)
        whole, way = (
            "".join(f"{row[key][each] * 1e6:>{width}.0f}" for each, width in zip(row[key], (first, 8, 8), strict=True))
            for key, first in (("cut", 8), ("way", 11))
        )
        print(
            f"{name:18}{row['faces']:>8}{row['vertices']:>8.0f}{row['points']:>8.0f}{whole}{way}"
            f"{row['goal'] * 1e6:>7.0f}{row['trimesh'] * 1e6:>10.0f}{row['ratio']:>7.0f}×"
        )
    figures = {"prepared": prepared, "poses": rows}
    record(arguments.json, figures)


if __name__ == "__main__":
    main()
