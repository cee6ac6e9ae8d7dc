"""What is seen of the 320 outputs, by whose eyes, and what should be seen.

An emulator keeps what its outputs did (`capture`); a logic analyser's recording (`sigrok`) is laid beside the device's
time by marks (`marks`). What outputs must do is written from the specification alone (`waveforms`).
"""

from __future__ import annotations
