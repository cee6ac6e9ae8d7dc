"""phasewire beside other packages for multi-focus ultrasonic holograms: time, uniformity, fields.

``make bench-peers``. Each peer runs in a process and an environment of its own, ``.peers/<name>``, made once from the
pinned versions in ``<name>.txt``; its script ``<name>_peer.py`` times its calls and returns its drives. This driver
sets the problems and judges all drives by one measure, `phasewire.pressure` on the array that they were really made
for. A peer that cannot be installed or run is a line in the table with the reason. It may not import a peer.
"""

from __future__ import annotations

import dataclasses
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import phasewire
from contest import SAME_ITERATIONS, Task
from environments import QUIET, UnavailableError, enter, environment, finish, machine, options, print_remarks
from numpy.typing import NDArray

PEERS = ("autd3", "acoustools", "levitate")
OURS = "phasewire"
RUN_SECONDS = 280.0  # for everything after the environments exist
CONTESTANT_SECONDS = 100.0
HEIGHT = 0.20  # metres, of all shapes
PLANE_SIDE, PLANE_SAMPLES = 0.2, 200


def circle(radius: float, count: int, x: float = 0.0) -> NDArray[np.float64]:
    """Points (count, 2) around a circle."""
    angle = 2 * np.pi * np.arange(count) / count
    return np.stack([x + radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def star(outer: float, points_per_edge: int) -> NDArray[np.float64]:
    """Points along the outline of a five-pointed star, its ten corners among them."""
    inner = outer * np.sin(np.pi / 10) / np.sin(3 * np.pi / 10)
    angle = np.pi / 2 + np.pi / 5 * np.arange(10)
    corners = np.where(np.arange(10) % 2, inner, outer)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    along = (np.arange(points_per_edge) / points_per_edge)[None, :, None]
    edges = corners[:, None] * (1 - along) + np.roll(corners, -1, axis=0)[:, None] * along
    return np.asarray(edges.reshape(-1, 2))


def asterisk(step: float, arms: int, points_per_arm: int) -> NDArray[np.float64]:
    """A point in the middle and arms of equally spaced points."""
    rays = [circle(step * (i + 1), arms) for i in range(points_per_arm)]
    return np.concatenate([np.zeros((1, 2)), *rays])


def make_problems() -> dict[str, NDArray[np.float64]]:
    """The four shapes of the paper's Figure 6, 8 to 10 cm wide, and random points in a box of 8 × 8 × 4 cm."""
    flat = {
        "rings 16+16": np.concatenate([circle(0.03, 16, -0.015), circle(0.03, 16, 0.015)]),
        "star 30": star(0.05, 3),
        "circles 24+8": np.concatenate([circle(0.045, 24), circle(0.015, 8)]),
        "asterisk 21": asterisk(0.011, 5, 4),
    }
    problems = {name: np.column_stack([points, np.full(len(points), HEIGHT)]) for name, points in flat.items()}
    random = np.random.default_rng(2014)
    for count in (1, 8, 32, 128):
        problems[f"random {count}"] = random.uniform([-0.04, -0.04, 0.18], [0.04, 0.04, 0.22], (count, 3))
    return problems


def make_task(budget: float) -> Task:
    """The problems for the default array in air of 20 °C."""
    array, medium = phasewire.TransducerArray.grid(), phasewire.Medium()
    axis = np.linspace(-PLANE_SIDE / 2, PLANE_SIDE / 2, PLANE_SAMPLES)
    x, y = np.meshgrid(axis, axis)
    plane = np.stack([x, y, np.full_like(x, HEIGHT)], axis=2)
    return Task(
        array.positions,
        make_problems(),
        plane,
        medium.wavelength,
        medium.frequency,
        array.transducer.radius,
        array.transducer.strength,
        budget,
    )


@dataclass(frozen=True)
class Score:
    """What drives are worth: pressure in Pa (peak), its spread over the points and its weakest point, to the mean."""

    mean: float
    spread: float
    weakest: float


def judge(array: phasewire.TransducerArray, drive: NDArray[np.complex128], points: NDArray[np.float64]) -> Score:
    """Score one drive at the control points."""
    magnitude = np.abs(phasewire.pressure(array, drive, points))
    mean = float(magnitude.mean())
    if not mean > 0:
        raise ValueError("the drives are silent")
    return Score(mean, float(magnitude.std()) / mean, float(magnitude.min()) / mean)


def judge_case(array: phasewire.TransducerArray, case: dict[str, Any], points: NDArray[np.float64]) -> dict[str, Any]:
    """Replace a case's drives by their scores: as returned, and with every transducer that sounds at full drive."""
    if "error" in case:
        return case
    real, imaginary = np.array(case["drive"])
    drive = real + 1j * imaginary
    if np.abs(drive).max() > 1 + 1e-4:
        return {"error": f"a drive of {np.abs(drive).max():.3g} is more than full drive"}
    phase_only = np.where(drive == 0, 0, np.exp(1j * np.angle(drive)))
    try:
        scores = {"returned": judge(array, drive, points), "phase_only": judge(array, phase_only, points)}
    except ValueError as error:
        return {"error": str(error)}
    return {
        "times": case["times"],
        "used": case["used"],
        **{name: dataclasses.asdict(score) for name, score in scores.items()},
    }


def judge_record(record: dict[str, Any], task: Task) -> None:
    """Judge all that a package returned, in place, on the array that it used."""
    positions = np.array(record["array"])
    normals = np.tile([0.0, 0.0, 1.0], (len(positions), 1))
    array = phasewire.TransducerArray(positions, normals, phasewire.Transducer(task.radius, task.strength))
    for contestant in record["contestants"]:
        cases = contestant["cases"]
        contestant["cases"] = {name: judge_case(array, cases[name], task.problems[name]) for name in task.problems}


def compete(task: Task, peers: list[str]) -> dict[str, dict[str, Any]]:
    """Let everyone run on the task, and phasewire again on every array that a peer had to use instead."""
    pythons: dict[str, str] = {OURS: sys.executable}
    records: dict[str, dict[str, Any]] = {OURS: {}}
    for name in peers:
        records[name] = {}
        try:
            pythons[name] = environment(name)
        except UnavailableError as error:
            records[name] = {"unavailable": str(error)}
    deadline = time.monotonic() + RUN_SECONDS

    def run(title: str, name: str, to_solve: Task) -> None:
        print(f"{title} ...", flush=True)
        seconds = min(CONTESTANT_SECONDS, max(1.0, deadline - time.monotonic()))
        try:
            record = enter(f"{name}_peer.py", pythons[name], to_solve.save, seconds)
            judge_record(record, to_solve)
        except UnavailableError as error:
            record = {"unavailable": str(error)}
        records[title] = record

    for name in pythons:
        run(name, name, task)
    for name in peers:
        array = np.array(records[name].get("array", task.array))
        if array.shape != task.array.shape or not np.allclose(array, task.array, atol=1e-6):
            run(f"{OURS} on the array of {name}", OURS, dataclasses.replace(task, array=array))
    return records


def milliseconds(case: dict[str, Any]) -> str:
    """Median and half the interquartile range of a case's times; ``~`` if the machine was busy."""
    times = case["times"]
    mark = "~" if times["cpu_share"] < QUIET else ""
    return f"{mark}{short(times['median'])} ±{short((times['high'] - times['low']) / 2)}"


def short(seconds: float) -> str:
    """Milliseconds, with three digits after the point only if there are none before it."""
    return f"{seconds * 1e3:.3f}" if seconds < 1e-3 else f"{seconds * 1e3:.2f}"


def pair(case: dict[str, Any], key: str, factor: float, digits: int) -> str:
    """A score as returned / phase only."""
    return " / ".join(f"{case[kind][key] * factor:.{digits}f}" for kind in ("returned", "phase_only"))


SECTIONS: dict[str, Callable[[dict[str, Any]], str]] = {
    "time of a call in ms, median ± half the interquartile range; ~ too long, for the machine was busy": milliseconds,
    "mean processor time of a call in ms, which a busy machine lengthens less": lambda case: short(
        case["times"]["processor"]
    ),
    "spread, std(|p|)/mean(|p|) in %, as returned / phase only": lambda case: pair(case, "spread", 100, 2),
    "weakest point, min(|p|)/mean(|p|), as returned / phase only": lambda case: pair(case, "weakest", 1, 2),
    "mean |p| in Pa (peak), as returned / phase only": lambda case: pair(case, "mean", 1, 0),
}


def named(entered: dict[str, Any], title: str) -> str:
    """The name of a contestant or of its field, with the array if that is another contestant's."""
    return str(entered["name"]) + title.removeprefix(title.partition(" ")[0])


def print_table(records: dict[str, dict[str, Any]], problems: list[str]) -> None:
    """All contestants, a section for each quantity, a column for each problem."""
    widths = [44, 10] + [max(16, len(problem) + 2) for problem in problems]

    def line(cells: list[str]) -> None:
        print("".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=False)).rstrip())

    for section, cell in SECTIONS.items():
        print(f"\n{section}")
        line(["", "steps", *problems])
        for title, record in records.items():
            if "unavailable" in record:
                line([title, "-", record["unavailable"]])
                continue
            for contestant in record["contestants"]:
                cases = [contestant["cases"][problem] for problem in problems]
                shown = ["failed" if "error" in case else cell(case) for case in cases]
                line([named(contestant, title), contestant["iterations"], *shown])


def print_ratios(records: dict[str, dict[str, Any]], problem: str) -> None:
    """How many times as fast as the fastest peer's GS-PAT each of our own methods is on a problem, and how even."""
    entries = [
        (record is records.get(OURS), contestant["name"], contestant["iterations"], contestant["cases"][problem])
        for record in records.values()
        for contestant in record.get("contestants", [])
        if "error" not in contestant["cases"][problem]
    ]
    rivals = [(case["times"]["median"], name, steps) for ours, name, steps, case in entries if "GS-PAT" in name]
    if not rivals:
        return
    print(f"\n{problem}, updates/s and times as fast as the fastest GS-PAT of a peer, by its default count and by any")
    default = min(rival for rival in rivals if rival[2].endswith("*"))
    for ours, name, steps, case in entries:
        if ours:
            rate, spread = 1 / case["times"]["median"], case["returned"]["spread"]
            print(
                f"{name:44}{steps:10}{rate:9.0f}/s {default[0] * rate:6.1f} × {min(rivals)[0] * rate:6.1f} ×"
                f"   spread {spread:.2%}"
            )
    print(f"    against {default[1]} {default[2]}, and {min(rivals)[1]} {min(rivals)[2]}")


def print_fields(records: dict[str, dict[str, Any]]) -> None:
    """How fast fields are computed."""
    print(f"\nfield of a plane of {PLANE_SAMPLES} × {PLANE_SAMPLES} points, in million point·transducers a second")
    for title, record in records.items():
        for field in record.get("fields", []):
            if "error" in field:
                print(f"{named(field, title):44}failed: {field['error']}")
            else:
                times = field["times"]
                rates = [field["pairs"] / times[key] / 1e6 for key in ("median", "high", "low")]
                mark = "~" if times["cpu_share"] < QUIET else ""
                print(f"{named(field, title):44}{mark}{rates[0]:.1f}  ({rates[1]:.1f} to {rates[2]:.1f})")


def remarks(title: str, record: dict[str, Any]) -> list[str]:
    """What one must know to read a package's numbers: its version, what a call contains, what went wrong."""
    if "unavailable" in record:
        return [record["unavailable"]]
    name = title.partition(" ")[0]
    cases = [(one["name"], key, case) for one in record["contestants"] for key, case in one["cases"].items()]
    shares = [case["times"]["cpu_share"] for _, _, case in cases if "error" not in case]
    used = f"processor time over wall time {min(shares):.2f} to {max(shares):.2f}" if shares else "nothing timed"
    used_steps = [
        f"{one['name']} {one['iterations']} used {', '.join(counts)} iterations."
        for one in record["contestants"]
        if (counts := [str(case["used"]) for case in one["cases"].values() if case.get("used") is not None])
    ]
    failures = [f"{who}, {problem}: {case['error']}" for who, problem, case in cases if "error" in case]
    return [f"version {record['versions'].get(name, 'unknown')}; {used}.", *record["notes"], *used_steps, *failures]


def print_small_print(records: dict[str, dict[str, Any]], about: dict[str, Any]) -> None:
    """The small print."""
    print("\nremarks")
    print(
        f"  steps: iterations, * if they are the package's default; {SAME_ITERATIONS} is phasewire's own count. One "
        "thread each (a processor time over wall time above 1 would betray a second one, below 1 a busy machine)."
    )
    print("  phase only: the same phases with every transducer that sounds at full drive.")
    print_remarks({title: remarks(title, record) for title, record in records.items()}, about)


def main() -> None:
    """Run everything, print the table and write the record."""
    parser = options(__doc__, "bench-peers")
    parser.add_argument("--peers", nargs="*", choices=PEERS, default=list(PEERS), help="those to run; all by default")
    parser.add_argument("--seconds", type=float, default=0.3, help="to spend on timing one case")
    chosen = parser.parse_args()
    about, begun = machine(), time.monotonic()
    task = make_task(chosen.seconds)
    records = compete(task, chosen.peers)
    print_table(records, list(task.problems))
    for problem in ("rings 16+16", "random 32"):
        print_ratios(records, problem)
    print_fields(records)
    print_small_print(records, about)
    parameters = {
        "transducers": len(task.array),
        "wavelength_m": task.wavelength,
        "frequency_hz": task.frequency,
        "radius_m": task.radius,
        "strength_pa_m": task.strength,
        "seconds_per_case": task.budget,
        "problems": {name: points.tolist() for name, points in task.problems.items()},
    }
    finish(chosen.json, about, begun, parameters=parameters, records=records)


if __name__ == "__main__":
    main()
