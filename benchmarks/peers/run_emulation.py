"""phasewire's emulator beside those of autd3: a recording, and the results from it, up to sound in the air.

``make bench-peers``. One scene: a focus above the middle of one device, modulated by a sine of 200 Hz, and a square of
points around it. Each emulator plays it on one thread in an environment of its own, ``<name>_emulation.py``, for the
same stretch of time in each row, a short one if a second takes minutes; the table scales it to a second.
This driver may not import a peer.
"""

from __future__ import annotations

import dataclasses
import sys
import time
from typing import Any

from emulation import FIELDS, Scene
from environments import QUIET, UnavailableError, enter, environment, finish, machine, options, print_remarks

OURS = "phasewire"
PEERS = ("autd3", "pyautd3")
VERSIONS = {"phasewire": "phasewire", "autd3": "autd3-emulator", "pyautd3": "pyautd3_emulator"}
"""The package of each that emulates."""
CONTESTANT_SECONDS = 1200.0
STRETCHES = {"record": 1.0, "drives": 1.0, "voltages": 10e-3, "rms field": 50e-3, "instantaneous field": 5e-3}
SCENE = Scene(height=0.15, side=0.04, points=100, modulation=200.0, samples=20, stretches=STRETCHES, budget=4.0)
ROWS = {
    "record": "recording, from commands to a record",
    "drives": "phases and widths of each period",
    "voltages": "output voltages",
    "rms field": "rms field of each period",
    "instantaneous field": "instantaneous field",
}


def compete(scene: Scene, peers: list[str]) -> dict[str, dict[str, Any]]:
    """Let every emulator play the scene, one after the other."""
    records: dict[str, dict[str, Any]] = {}
    for name in (OURS, *peers):
        print(f"{name} ...", flush=True)
        try:
            python = sys.executable if name == OURS else environment(name)
            records[name] = enter(f"{name}_emulation.py", python, scene.save, CONTESTANT_SECONDS)
        except UnavailableError as error:
            records[name] = {"unavailable": str(error)}
    return records


def per_second(record: dict[str, Any], scene: Scene, row: str) -> float | None:
    """Seconds that a row takes for a second of the device's time, if it could be done."""
    case = record.get("rows", {}).get(row, {})
    return case["times"]["median"] / scene.stretches[row] if "times" in case else None


def shown(seconds: float | None, record: dict[str, Any], row: str) -> str:
    """A time, with three digits; ~ if the machine was busy."""
    if seconds is None:
        return "-" if "unavailable" in record else "failed"
    mark = "~" if record["rows"][row]["times"]["cpu_share"] < QUIET else ""
    return mark + (f"{seconds:.3g}" if seconds < 999.5 else f"{seconds:,.0f}")


def print_table(records: dict[str, dict[str, Any]], scene: Scene) -> None:
    """A row for each result, a column for each emulator, and how many times as fast ours is."""
    peers = [name for name in records if name != OURS]
    headers = ["of", *records, *(f"{name}/{OURS}" for name in peers)]

    def line(what: str, cells: list[str]) -> None:
        print(f"{what:38}" + "".join(f"{cell:>{max(len(h), 7) + 3}}" for cell, h in zip(cells, headers, strict=True)))

    print(f"\nseconds for a second of the device's time, one thread; fields at {scene.points**2:,} points")
    line("", headers)
    for row, what in ROWS.items():
        times = {name: per_second(record, scene, row) for name, record in records.items()}
        ours = times[OURS]
        ratios = ["-" if ours is None or (t := times[name]) is None else f"{t / ours:.1f} ×" for name in peers]
        line(
            what, [f"{scene.stretches[row] * 1e3:g} ms", *(shown(times[n], records[n], row) for n in records), *ratios]
        )
    counts = {name: record["transducers"] for name, record in records.items() if "transducers" in record}
    for name in counts.keys() - {OURS}:
        ratio = counts[OURS] / counts[name]
        print(
            f"{name} emulates {counts[name]} transducers, {OURS} {counts[OURS]}: by transducer {ratio:.2f} times that."
        )


def remarks(name: str, record: dict[str, Any]) -> list[str]:
    """What one must know to read an emulator's numbers."""
    if "unavailable" in record:
        return [record["unavailable"]]
    version = record["versions"].get(VERSIONS[name], "unknown")
    lines = [f"version {version}, {record['transducers']} transducers."]
    for row, case in record["rows"].items():
        if "error" in case:
            lines.append(f"{row}: {case['error']}")
        elif row in FIELDS:
            lines.append(
                f"{row}: {' × '.join(map(str, case['shapes'][0]))} values, loudest at {tuple(case['loudest'])} of the "
                f"square with {case['rms_pa']:.0f} Pa rms."
            )
        elif case["shapes"]:
            lines.append(f"{row}: {' and '.join(' × '.join(map(str, shape)) for shape in case['shapes'])} values.")
    return [*lines, *record["notes"]]


def main() -> None:
    """Run everything, print the table and write the record."""
    parser = options(__doc__, "bench-peers-emulation")
    parser.add_argument("--peers", nargs="*", choices=PEERS, default=list(PEERS), help="those to run; all by default")
    parser.add_argument("--points", type=int, default=SCENE.points, help="along each side of the square")
    parser.add_argument("--scale", type=float, default=1.0, help="of all stretches of time")
    chosen = parser.parse_args()
    stretches = {row: seconds * chosen.scale for row, seconds in STRETCHES.items()}
    scene = dataclasses.replace(SCENE, points=chosen.points, stretches=stretches)
    about, begun = machine(), time.monotonic()
    records = compete(scene, chosen.peers)
    print_table(records, scene)
    print("\nremarks")
    print_remarks({name: remarks(name, each) for name, each in records.items()}, about, 11)
    finish(chosen.json, about, begun, scene=dataclasses.asdict(scene), records=records)


if __name__ == "__main__":
    main()
