"""Observation of the 320 outputs: who sees them, and what should be seen.

An emulator keeps its outputs (`capture`); a logic analyser's recording (`sigrok`) is aligned with the device's time by
marks (`marks`). The expected outputs follow from the specification alone (`waveforms`).
"""

from __future__ import annotations
