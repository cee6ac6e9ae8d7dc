"""How long the stages of an update take, each beside something to compare it with.

``make bench``; a table of medians in one run. Compare rows of a group, not absolute times.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from phasewire import Circle, Emulator, Pulses, Solver, TransducerArray, open_device, sample_plane, solve
from phasewire.solver.fields.convolution import PlanePropagator

ARRAY = TransducerArray.grid()
POINTS = Circle(radius=0.0765).sample()
SOLUTION = solve(ARRAY, POINTS)
PULSES = Pulses.from_drive(SOLUTION.drive)


@pytest.mark.benchmark(group="the next frame, 32 points and 320 transducers")
class TestSolve:
    """More of this, beside what the arithmetic allows, in solver.py."""

    @pytest.mark.parametrize("method", ["tikhonov", "wgs"])
    def test_single_precision(self, benchmark: Any, method: str) -> None:
        assert len(POINTS) == 32
        benchmark(Solver(ARRAY, method).solve, POINTS)

    @pytest.mark.parametrize("method", ["tikhonov", "wgs"])
    def test_double_precision(self, benchmark: Any, method: str) -> None:
        benchmark(Solver(ARRAY, method, precision="double").solve, POINTS)


@pytest.mark.benchmark(group="the field of one drive, 195 × 195 samples and 320 transducers")
class TestField:
    def test_by_fft(self, benchmark: Any) -> None:
        propagator = PlanePropagator(ARRAY, 0.2)
        assert benchmark(propagator, SOLUTION.drive).pressure.shape == (195, 195)

    def test_peer_direct_sum(self, benchmark: Any) -> None:
        benchmark(sample_plane, ARRAY, SOLUTION.drive, 0.2, step=1.03e-3)


@pytest.mark.benchmark(group="the emulated device")
class TestEmulator:
    def test_a_second_of_a_steady_field(self, benchmark: Any) -> None:
        """40 000 carrier periods with a sign of life every 50 ms, and the drive of the last one."""

        def second() -> np.ndarray:
            with Emulator() as emulator, open_device(emulator.url) as device:
                device.show(PULSES)
                for _ in range(20):
                    emulator.run(2000)
                    device.status()
                capture = emulator.capture()
            return capture.drive(capture.periods - 1)

        np.testing.assert_allclose(benchmark(second), PULSES.to_drive(), atol=1e-12)

    def test_one_update_from_pulses_to_acknowledgement(self, benchmark: Any) -> None:
        with Emulator() as emulator, open_device(emulator.url) as device:
            benchmark.pedantic(device.show, (PULSES,), rounds=200, warmup_rounds=5)
