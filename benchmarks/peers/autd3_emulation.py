"""autd3's emulator as it is today. It runs in the environment of ``autd3.txt`` and may not import phasewire."""

from __future__ import annotations

from typing import Any

from autd3 import Duration
from autd3.commands import Modulation, Pattern, SetSilencer
from autd3.geometry import Autd3, Geometry
from autd3.units import Hz, Velocity
from autd3.value import Intensity, SamplingConfig
from autd3_emulator import Emulator, Grid, InstantRecordOption, RmsRecordOption
from autd3_modulation import SineOption, modulation_buffer, sine
from autd3_pattern import focus, wavelength
from emulation import TIME_STEP_NS, Entry, Scene, main

MM = 1e3
SOUND_SPEED = Velocity.from_m_s(340)  # its default


def duration(seconds: float) -> Duration:
    return Duration.from_micros(round(seconds * 1e6))


def enter(scene: Scene) -> Entry:
    """One device."""
    geometry = Geometry([Autd3()])
    middle = geometry.center()
    target = [float(middle[0]), float(middle[1]), scene.height * MM]
    phases, samples = geometry.phase_buffer(), modulation_buffer()
    focus(geometry, target, wavelength(SOUND_SPEED), phases)
    sine(scene.modulation * Hz, SineOption(), samples)
    if len(samples) != scene.samples:
        raise ValueError(f"its sine has {len(samples)} samples, not {scene.samples}")

    def record(seconds: float) -> Any:
        def emit(recorder: Any) -> None:
            recorder.send(SetSilencer.disable())
            recorder.send(Modulation(SamplingConfig(scene.modulation * scene.samples * Hz), samples))
            recorder.send(Pattern(phases, Intensity.MAX))
            recorder.tick(duration(seconds))

        return Emulator(geometry).record(emit)

    def field(option: Any) -> Any:
        half, step = scene.side / 2 * MM, scene.side / (scene.points - 1) * MM
        x, y = ((middle[axis] - half, middle[axis] + half + step / 2) for axis in (0, 1))
        grid = Grid(x, y, target[2], step, "xyz")
        return lambda recording, seconds: recording.sound_field(grid, option).next(duration(seconds))

    return Entry(
        geometry.num_transducers(),
        record,
        {
            "drives": lambda recording, _: (recording.phase(), recording.pulse_width()),
            "voltages": lambda recording, _: recording.output_voltage(),
            "rms field": field(RmsRecordOption()),
            "instantaneous field": field(InstantRecordOption(time_step=Duration.from_nanos(TIME_STEP_NS))),
        },
        ["Voltages are sampled at 512 a period. By default it gives fields half as often, in half the time."],
    )


if __name__ == "__main__":
    main(enter)
