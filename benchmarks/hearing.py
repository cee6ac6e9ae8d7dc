"""How loud an unsmoothed square modulation is for a person beside the array, and how long it takes to find out.

``python benchmarks/hearing.py`` lets the emulator play the two halves of the demo's circle in turn, 200 times a second,
for half a second, and judges the bits of its outputs. The times are for one second of outputs that repeat this one, and
of outputs that change in every carrier period, on one thread if the environment says so (`make bench`).
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from bench import median, options, record
from phasewire import Emulator, Pulses, Sphere, TransducerArray, open_device, two_sided
from phasewire.emulator import Capture
from phasewire.feel.exposure import SEATED, exposure_at, seated
from phasewire.feel.hearing import PARTS, audible
from phasewire.feel.power import radiated_power
from phasewire.hil.sound.emission import emitted_waves
from phasewire.host.streaming.frames import Frame

CARRIER = 40_000
SETTLING = 2_000  # periods before what is judged
GOAL_SECONDS = 0.5


def played(frames: list[Frame], steps: list[tuple[int, int]], periods: int) -> tuple[int, Capture]:
    """Let an emulated device repeat frames; the first period to be judged, and the capture."""
    with Emulator() as emulator, open_device(emulator.url) as device:
        for slot, frame in enumerate(frames):
            device.store(slot, frame)
        first = device.play(steps).commit_period + SETTLING
        device.keep_playing((SETTLING + periods) / CARRIER)
        emulator.run_until(first + periods)
        return first, emulator.capture()


def baseline() -> dict[str, Any]:
    """Levels of the square modulation at a seated person."""
    array = TransducerArray.grid()
    frames, steps = two_sided(array, Sphere().sample(), frequency=200).modulation.slots()
    first, capture = played(list(frames), list(steps), CARRIER // 2)
    emitted = emitted_waves(capture, array, first, first + CARRIER // 2)
    heard = audible(array, emitted.waves, emitted.pulses, seated(array))
    exposed = exposure_at(array, emitted.waves)
    places = {
        name: {
            "dBA": round(float(heard.levels_dba[place]), 1),
            "dBA of parts": {part: round(float(heard.weighted(part)[place]), 1) for part in PARTS},
            "ultrasound dB, greatest and mean": np.round(
                [exposed.greatest_db[place], exposed.mean_db[place]], 1
            ).tolist(),
            "loudest": [f"{f:g} Hz {part} {level:.1f} dBA" for f, part, level in heard.strongest(place)],
            "loudest linear": [
                f"{f:g} Hz {level:.1f} dBA" for f, part, level in heard.strongest(place, 200) if part == "linear"
            ][:5],
        }
        for place, name in enumerate(SEATED)
    }
    return {"places": places, "exposure": str(exposed), "power": str(radiated_power(array, emitted.waves))}


def times(slots: int) -> dict[str, float]:
    """Seconds for each step over one second of outputs, which play so many fields, each for one period."""
    rng, array = np.random.default_rng(0), TransducerArray.grid()
    pulses: list[Frame] = [Pulses(rng.integers(0, 100, 320), rng.integers(10, 26, 320)) for _ in range(slots)]
    first, capture = played(pulses, [(slot, 1 if slots > 2 else 100) for slot in range(slots)], CARRIER)
    emitted, at = emitted_waves(capture, array, first, first + CARRIER), seated(array)
    five = np.concatenate([at, np.add(at[:2], (0, 0, 0.1))])
    seconds = {
        "emitted waves": median(lambda: emitted_waves(capture, array, first, first + CARRIER)),
        "audible, 3 places": median(lambda: audible(array, emitted.waves, emitted.pulses, at).levels_dba),
        "audible, 5 places": median(lambda: audible(array, emitted.waves, emitted.pulses, five).levels_dba),
        "exposure, 3 places": median(lambda: exposure_at(array, emitted.waves, at)),
        "exposure, 5 places": median(lambda: exposure_at(array, emitted.waves, five)),
    }
    return seconds | {"all, 5 places": sum(value for name, value in seconds.items() if "3 places" not in name)}


def main() -> None:
    """Measure, and print or write the results."""
    arguments = options(__doc__).parse_args()
    found = {
        "square two-sided modulation, 200 Hz": baseline(),
        "seconds for one second, two fields in turn": times(2),
        "seconds for one second, a field in each period": times(200),
        "goal in seconds": GOAL_SECONDS,
    }
    print(json.dumps(found, indent=2, ensure_ascii=False))
    record(arguments.json, found)


if __name__ == "__main__":
    main()
