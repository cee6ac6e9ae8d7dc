"""Compiled: drives that follow wanted ones with limited changes. Tested against `rendering.quiet.literal`."""

from __future__ import annotations

import math
from typing import Any

from ...base.compiling import kernel, part

__all__ = ["follow"]

TURN = 2 * math.pi


@part
def _turned(phase: float, towards: float) -> float:
    """The shorter way from a phase to another, in radians."""
    return (towards - phase + math.pi) % TURN - math.pi


@kernel
def follow(
    wanted: Any, amplitude_periods: int, phase_periods: int, amplitude_rate: float, phase_rate: float,
    silent: float, targets: Any, state: Any, steps: Any, drives: Any,
) -> None:  # fmt: skip
    """Write into ``drives`` (t, n) what is emitted in place of the ``wanted`` drives (t, n) of each carrier period.

    A change of amplitude or of phase is completed in a number of periods, or, if that is 0, limited to a rate for each
    period, of the phase in radians. An amplitude below ``silent`` is silence, which has no phase. ``targets`` (n,) are
    the drives that were wanted last, ``state`` (2, n) amplitude and phase that were emitted last, and ``steps`` (2, n)
    their changes in a period; all three are changed.
    """
    for q in range(wanted.shape[1]):
        amplitude, phase = state[0, q], state[1, q]
        aim = complex(targets[q])
        aim_amplitude, aim_phase = abs(aim), math.atan2(aim.imag, aim.real)
        rise, turn = steps[0, q], steps[1, q]
        for t in range(wanted.shape[0]):
            now = complex(wanted[t, q])
            if now != aim:
                aim, aim_amplitude = now, abs(now)
                if aim_amplitude > 0:  # silence has no phase
                    aim_phase = math.atan2(now.imag, now.real)
                if amplitude < silent:
                    phase = aim_phase
                rise, turn = amplitude_rate, phase_rate
                if amplitude_periods:
                    rise = abs(aim_amplitude - amplitude) / amplitude_periods
                if phase_periods:
                    turn = abs(_turned(phase, aim_phase)) / phase_periods
            left = aim_amplitude - amplitude
            amplitude = aim_amplitude if abs(left) <= rise * (1 + 1e-9) else amplitude + math.copysign(rise, left)
            way = _turned(phase, aim_phase)
            phase = aim_phase if abs(way) <= turn * (1 + 1e-9) else phase + math.copysign(turn, way)
            drives[t, q] = complex(amplitude * math.cos(phase), amplitude * math.sin(phase))
        targets[q] = aim
        state[0, q], state[1, q] = amplitude, phase
        steps[0, q], steps[1, q] = rise, turn
