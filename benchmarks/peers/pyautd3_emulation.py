"""autd3's emulator of 2025, ``pyautd3_emulator``. It runs in the environment of ``pyautd3.txt``."""

from __future__ import annotations

from typing import Any

from emulation import TIME_STEP_NS, Entry, Scene, main
from pyautd3 import AUTD3, Duration, Focus, FocusOption, Hz, SamplingConfig, Silencer, Sine, SineOption
from pyautd3_emulator import Emulator, InstantRecordOption, RangeXYZ, RmsRecordOption

MM = 1e3


def duration(seconds: float) -> Duration:
    return Duration.from_micros(round(seconds * 1e6))


def enter(scene: Scene) -> Entry:
    """One device."""
    middle = Emulator([AUTD3(pos=[0, 0, 0])]).center()
    target = [float(middle[0]), float(middle[1]), scene.height * MM]
    sampling = SamplingConfig(scene.modulation * scene.samples * Hz)
    modulation = Sine(round(scene.modulation) * Hz, SineOption(sampling_config=sampling))

    def record(seconds: float) -> Any:
        def emit(controller: Any) -> None:
            controller.send(Silencer.disable())
            controller.send((modulation, Focus(target, FocusOption())))
            controller.tick(duration(seconds))

        return Emulator([AUTD3(pos=[0, 0, 0])]).record(emit)

    def field(option: Any) -> Any:
        half, step = scene.side / 2 * MM, scene.side / (scene.points - 1) * MM
        x, y = ((middle[axis] - half, middle[axis] + half + step / 2) for axis in (0, 1))
        square = RangeXYZ(x=x, y=y, z=(target[2], target[2]), resolution=step)
        return lambda recording, seconds: recording.sound_field(square, option).next(duration(seconds))

    return Entry(
        Emulator([AUTD3(pos=[0, 0, 0])])[0].num_transducers(),
        record,
        {
            "drives": lambda recording, _: (recording.phase(), recording.pulse_width()),
            "voltages": lambda recording, _: recording.output_voltage(),
            "rms field": field(RmsRecordOption()),
            "instantaneous field": field(InstantRecordOption(time_step=Duration.from_nanos(TIME_STEP_NS))),
        },
        ["As autd3."],
    )


if __name__ == "__main__":
    main(enter)
