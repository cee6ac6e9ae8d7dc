"""A run as a logic analyser would record it: outputs sampled by a clock of its own, written as a sigrok session file.

Shares no code with what reads them, nor with the exporter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from random import Random
from typing import NamedTuple
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
from numpy.typing import NDArray
from phasewire import Capture, Device, Emulator, Pulses, open_device
from phasewire.hil.conformance.sight.marks import MARK_PULSES, Mark


class Played(NamedTuple):
    capture: Capture
    marks: list[Mark]

    @property
    def stretch(self) -> tuple[int, int]:
        """The first and the last period between its marks."""
        return self.marks[0].changes[-1][0], self.marks[-1].changes[0][0]


def play(seed: int, marks: int = 3, updates: int = 60) -> Played:
    """Random pulses between random marks."""
    rng = np.random.default_rng(seed)
    played: list[Mark] = []
    with Emulator() as emulator, open_device(emulator.url) as device:
        played.append(play_mark(emulator, device, Random(seed)))
        for number in range(1, marks):
            for _ in range(updates):
                pulses = Pulses(rng.integers(0, 100, 320), rng.integers(0, 26, 320))
                ack = device.show(pulses)
                emulator.run_until(ack.commit_period + int(rng.integers(1, 8)))
            played.append(play_mark(emulator, device, Random(seed + number)))
        return Played(emulator.capture(), played)


def play_mark(emulator: Emulator, device: Device, random: Random) -> Mark:
    changes: list[tuple[int, bool]] = []
    for gap, on in Mark.plan(random):
        begin = changes[-1][0] if changes else device.status().period + 10
        ack = device.show(MARK_PULSES if on else Pulses.silent(320), begin + gap)
        changes.append((ack.commit_period, on))
    emulator.run_until(changes[-1][0] + 10)
    return Mark(tuple(changes))


class Analyser(NamedTuple):
    rate: str
    """In the notation of a session file."""
    samples_per_tick: float
    """For an exact clock of the analyser."""
    ppm: float = 0.0
    """How fast its clock runs."""
    jitter: bool = False
    """Whether each probe sees half of the samples one sample early or late."""

    def sample(self, words: NDArray[np.uint32], start: float, seed: int = 0) -> NDArray[np.uint32]:
        """Its samples of all outputs from a moment on, in ticks: (samples, 10)."""
        ticks_per_sample = 1 / (self.samples_per_tick * (1 + self.ppm * 1e-6))
        moments = start + np.arange(int((len(words) - start) / ticks_per_sample)) * ticks_per_sample
        seen: NDArray[np.uint32] = words[moments.astype(int)]
        if not self.jitter:
            return seen
        rng = np.random.default_rng(seed)
        shifted, late = rng.integers(0, 2**32, (2, *seen.shape), np.uint32)  # which outputs of which samples
        neighbours = np.roll(seen, 1, axis=0) & late | np.roll(seen, -1, axis=0) & ~late
        return np.asarray(seen & ~shifted | neighbours & shifted)


def write(
    path: Path, rate: str, samples: NDArray[np.uint32], probes: Mapping[int, str], parts: Sequence[int] = ()
) -> None:
    """A session file, as the format's description has it.

    Parameters
    ----------
    path : path
    rate : str
    samples : (n, 10) uint32
        Port words.
    probes : mapping of int to str
        The outputs that have a probe, and its name, in the order of the probes; there are some more probes.
    parts : sequence of int
        Samples at which parts begin.
    """
    unit = (len(probes) + 3 + 7) // 8  # three more: two without a name, one with a square wave
    levels = np.zeros((len(samples), unit * 8), np.uint8)
    levels[:, 0] = np.arange(len(samples)) // 5 % 2
    for bit, channel in enumerate(probes, 3):
        levels[:, bit] = samples[:, channel // 32] >> np.uint32(channel % 32) & 1
    data = np.packbits(levels, axis=1, bitorder="little")
    lines = ["[global]", "sigrok version = 0.6.0", "", "[device 1]", "capturefile = logic-1"]
    lines += [f"total probes = {len(probes) + 3}", f"samplerate = {rate}", "total analog = 0", "probe1 = 1 MHz, 50%"]
    lines += [f"probe{bit + 1} = {name}" for bit, name in enumerate(probes.values(), 3)]
    lines += [f"unitsize = {unit}", ""]
    with ZipFile(path, "w", ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr("version", "2")
        archive.writestr("metadata", "\n".join(lines))
        for number, part in enumerate(np.split(data, list(parts)), 1):
            archive.writestr(f"logic-1-{number}" if parts else "logic-1", part.tobytes())
