"""Time as tests count it: core cycles since period 0."""

from __future__ import annotations

from phasewire import Emulator


def pass_until(emulator: Emulator, cycle: int) -> None:
    """Let time pass until a core cycle after period 0 began."""
    emulator.scheduler.run_until(emulator.running.time.origin + cycle)


def now(emulator: Emulator) -> int:
    """Core cycles since period 0."""
    return emulator.scheduler.now - emulator.running.time.origin
