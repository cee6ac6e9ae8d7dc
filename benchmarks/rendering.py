"""How fast the four ways of rendering make frames, and how loud and how strong they are beside each other.

``python benchmarks/rendering.py`` renders a new outline for each cycle: every frame of it is solved afresh. A frame is
held for some carrier periods, so that the table has two rates: frames per second, and carrier periods per second, of
which a device needs 40 000. ``--levels`` plays the ways on the emulator and compares them with AUTD3's silencer.
"""

from __future__ import annotations

import json
import statistics
from time import perf_counter
from typing import Any

import numpy as np
from bench import options
from phasewire import Circle, ControlPoints, Cycle, Outline, TransducerArray, render
from phasewire.hil.loop.sensing import sense, skin_over
from phasewire.solver import Completion, Quieting, Renderer, quieted

CARRIER = 40_000
ROUNDS = 30
ARRAY = TransducerArray.grid()
POINT = ControlPoints([[0, 0, 0.2]])
RING = Circle(radius=0.03)
SECTION = Circle(radius=0.0764)  # 32 points
CASES: dict[str, tuple[Circle | ControlPoints, str]] = {
    "am": (SECTION, "am"),
    "two-sided": (SECTION, "two-sided"),
    "lm, a point": (POINT, "lm"),
    "lm, 13 points": (RING, "lm"),
    "lm, 32 points": (SECTION, "lm"),
    "stm, one focus": (RING, "stm"),
    "stm, 4 foci": (RING, "stm:foci=4"),
}


def rates(what: Circle | ControlPoints, way: str) -> dict[str, Any]:
    """Of a way, on outlines that move."""
    renderer = Renderer(ARRAY, way)
    outline = Outline.of(what)
    moved = [Outline.of(what.moved((1e-4 * step, 0, 0))) for step in range(ROUNDS)]
    cycle = renderer.render(outline)
    seconds = []
    for each in moved:
        before = perf_counter()
        cycle = renderer.render(each)
        seconds.append(perf_counter() - before)
    middle = statistics.median(seconds)
    return {
        "frames of a cycle": len(cycle),
        "held for": cycle.hold,
        "ms a cycle": round(middle * 1e3, 2),
        "frames/s": round(len(cycle) / middle),
        "carrier periods/s": round(cycle.periods / middle),
    }


def quieting_rate() -> int:
    """Carrier periods per second of the rule that spreads changes."""
    cycle = render(ARRAY, RING, "two-sided:envelope=square")
    wanted = np.tile(np.repeat(cycle.drives, cycle.hold, axis=0), (20, 1))
    quieting = Quieting(len(ARRAY), Completion())
    quieting.follow(wanted)
    before = perf_counter()
    quieting.follow(wanted)
    return round(len(wanted) / (perf_counter() - before))


def levels() -> dict[str, dict[str, float]]:
    """What the bits of each way are at a seated person's ears and on a hand."""
    outline = Outline.of(RING)
    switched = render(ARRAY, outline, "two-sided:envelope=square")
    cycles: dict[str, Cycle] = {
        "two-sided:envelope=square": switched,
        "the same, by AUTD3's silencer": quieted(switched, Completion()),
        **{way: render(ARRAY, outline, way) for way in ("two-sided", "am:envelope=square", "am", "lm", "stm")},
    }
    found = {}
    for name, cycle in cycles.items():
        sensed = sense(cycle, skin_over(outline))
        felt = sensed.felt
        found[name] = {
            "heard dB(A)": round(float(sensed.sound.levels_dba.max()), 1),
            "felt, times the threshold": round(float(felt.intensity.max()), 2),
            "felt share of the hand": round(float((felt.intensity >= 1).mean()), 2),
            "ultrasound dB SPL": round(float(sensed.exposure.greatest_db.max()), 1),
            "sound W": round(sensed.power.acoustic, 1),
        }
    return found


def main() -> None:
    """Run it."""
    parser = options(__doc__)
    parser.add_argument("--levels", action="store_true", help="also play the ways, and judge them")
    arguments = parser.parse_args()
    results: dict[str, Any] = {name: rates(what, way) for name, (what, way) in CASES.items()}
    results["changes spread, periods/s"] = quieting_rate()
    if arguments.levels:
        results["levels"] = levels()
    text = json.dumps(results, indent=1)
    print(text)
    if arguments.json:
        arguments.json.write_text(text)


if __name__ == "__main__":
    main()
