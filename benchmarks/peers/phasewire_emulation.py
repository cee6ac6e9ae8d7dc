"""phasewire's own emulator, through the doors that a host uses: blocks over pyusb, and what the outputs played.

It may use public interfaces only: it measures what a user gets.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from emulation import Entry, Scene, main
from phasewire import Capture, Emulator, Pulses, TransducerArray
from phasewire.hil.sound.air import Playback
from phasewire.host.transports.opening import open_transport
from phasewire.protocol import AmplitudeModulation, Block, Entries, PlaySequence, Samples, Slot, pack
from phasewire.protocol.blocks import Entry as Step
from phasewire.protocol.board import CARRIER_HZ, TICKS_PER_PERIOD
from phasewire.protocol.codes import AMPLITUDES, Reason, Request
from phasewire.protocol.replies import Ack, records
from phasewire.solver import transfer_matrix

PATIENCE_SECONDS = 1.0


class Recording(NamedTuple):
    capture: Capture
    begins: int
    """Carrier period at which the field begins."""


def enter(scene: Scene) -> Entry:
    """One device."""
    array = TransducerArray.grid()
    focus = np.array([[0, 0, scene.height]])
    field = Pulses.from_drive(np.exp(-1j * np.angle(transfer_matrix(array, focus)[0])))
    turn = 2 * np.pi * np.arange(scene.samples) / scene.samples
    hold = round(CARRIER_HZ / scene.modulation / scene.samples)
    samples = np.round((AMPLITUDES - 1) / 2 * (1 + np.sin(turn))).astype(np.uint8).tobytes()
    blocks = [
        Block(Slot(0, field), 0, restart=True),
        Block(Entries((Step(0, 1000),)), 1),
        Block(Samples(samples), 2),
        Block(AmplitudeModulation(0, scene.samples, hold), 3),
        Block(PlaySequence(0, 1, unattended=True), 4),
    ]
    axis = np.linspace(-scene.side / 2, scene.side / 2, scene.points)
    x, y = np.meshgrid(axis, axis)
    at = np.stack([x.ravel(), y.ravel(), np.full(x.size, scene.height)], axis=1)

    def periods(recording: Recording, seconds: float) -> tuple[int, int]:
        return recording.begins, recording.begins + round(seconds * CARRIER_HZ)

    def record(seconds: float) -> Recording:
        with Emulator() as emulator:
            transport = open_transport(emulator.url)
            transport.command(Request.ENABLE)
            transport.write_blocks(b"".join(map(pack, blocks)), PATIENCE_SECONDS)
            acks: list[Ack] = []
            while len(acks) < len(blocks):
                acks += [ack for ack in records(transport.read_records(PATIENCE_SECONDS)) if isinstance(ack, Ack)]
            if any(ack.reason is not Reason.ACCEPTED for ack in acks):
                raise RuntimeError(f"refused: {acks}")
            begins = acks[-1].commit_period
            emulator.run_until(begins + round(seconds * CARRIER_HZ))
            capture = emulator.capture()
            transport.close()
        return Recording(capture, begins)

    def drives(recording: Recording, seconds: float) -> Any:
        return recording.capture.drives(*periods(recording, seconds))

    def voltages(recording: Recording, seconds: float) -> Any:
        first, last = periods(recording, seconds)
        return Playback(recording.capture).voltages(first * TICKS_PER_PERIOD, last * TICKS_PER_PERIOD)

    def rms_field(recording: Recording, seconds: float) -> Any:
        peak = np.abs(Playback(recording.capture).phasors(at, *periods(recording, seconds)))
        return np.multiply(peak, np.float32(np.sqrt(0.5)), out=peak)

    def instantaneous_field(recording: Recording, seconds: float) -> Any:
        first, last = periods(recording, seconds)
        return Playback(recording.capture).signal(at, first * TICKS_PER_PERIOD, last * TICKS_PER_PERIOD)

    return Entry(
        len(array),
        record,
        {
            "drives": drives,
            "voltages": voltages,
            "rms field": rms_field,
            "instantaneous field": instantaneous_field,
        },
        [
            "A recording begins with an emulator that starts, and goes through pyusb; then time passes.",
            "Drives are complex numbers, demodulated from the bits. Voltages are sampled at 50 a period.",
        ],
    )


if __name__ == "__main__":
    main(enter)
