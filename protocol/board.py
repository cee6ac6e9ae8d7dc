"""The board's numbers. Every other module takes them from here.

Five driver boards with two processors each; every processor drives 32 transducers through one 32-bit port.
A *tick* is one refresh of the outputs (2 MHz); a *period* is one period of the 40 kHz carrier, 50 ticks.
"""

from __future__ import annotations

BOARDS = 5
PROCESSORS_PER_BOARD = 2
CHANNELS_PER_PROCESSOR = 32
PROCESSORS = BOARDS * PROCESSORS_PER_BOARD
CHANNELS = PROCESSORS * CHANNELS_PER_PROCESSOR

COLUMNS = 20
ROWS = 16
PITCH_M = 10.3e-3

CARRIER_HZ = 40_000
TICKS_PER_PERIOD = 50
HALF_TICKS_PER_PERIOD = 2 * TICKS_PER_PERIOD
TICK_HZ = CARRIER_HZ * TICKS_PER_PERIOD
MAX_WIDTH_TICKS = TICKS_PER_PERIOD // 2

CORE_HZ = 400_000_000
CYCLES_PER_MS = CORE_HZ // 1000
CYCLES_PER_TICK = CORE_HZ // TICK_HZ
CYCLES_PER_PERIOD = CYCLES_PER_TICK * TICKS_PER_PERIOD

WATCHDOG_MS = 100
