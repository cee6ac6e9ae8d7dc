"""Exports, read by a foreign program: sigrok-cli (Debian's package of that name) and its decoder of PWM."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from phasewire import Capture, Emulator, Pulses, Wiring, open_device
from phasewire.emulator.ports.export import check_export_path, chosen_channels, export
from phasewire.emulator.trace import Signal

from tests.hand_made import HandMade

READERS = {".sr": [], ".vcd": ["-I", "vcd:downsample=5"]}  # a tick is 5 times 100 ns
OUTPUTS = {32: range(96, 128), 320: range(320)}


class Played(NamedTuple):
    pulses: Pulses
    capture: Capture
    boundary: int
    """Tick from which the pulses play."""


@pytest.fixture(scope="module")
def played(scrambled: Wiring) -> Played:
    """Every width, and every phase at least twice, spread over the transducers."""
    rng = np.random.default_rng(320)
    pulses = Pulses(rng.permutation(np.arange(320) % 100), rng.permutation(np.arange(320) % 26))
    with Emulator(wiring=scrambled) as emulator, open_device(emulator.url) as device:
        ack = device.show(pulses)
        emulator.run_until(ack.commit_period + 5)
        return Played(pulses, emulator.capture(), ack.commit_period * 50)


def sigrok(path: Path, *arguments: str) -> bytes:
    """The output of sigrok-cli for an export."""
    if shutil.which("sigrok-cli") is None:
        pytest.skip("there is no sigrok-cli here")
    command = ["sigrok-cli", *READERS[path.suffix], "-i", str(path), *arguments]
    run = subprocess.run(command, capture_output=True, timeout=60, check=False)
    assert run.returncode == 0
    assert run.stderr == b""
    return run.stdout


class Cycle(NamedTuple):
    begins: int
    ends: int
    duty: float
    """Per cent."""
    period: str


def cycles(path: Path, names: Sequence[str]) -> dict[str, list[Cycle]]:
    """The pulses from one rise to the next, by sigrok's PWM decoder: one decoder for each output."""
    decoders = [argument for name in names for argument in ("-P", f"pwm:data={name}")]
    told = sigrok(path, *decoders, "-A", "pwm", "--protocol-decoder-samplenum").decode()
    found: dict[str, list[Cycle]] = {name: [] for name in names}
    annotation = r"(\d+)-(\d+) pwm-{0}: (.+)%\n\1-\2 pwm-{0}: (.+)\n"
    for number, name in enumerate(names, start=1):
        of_one = "".join(line for line in told.splitlines(keepends=True) if f" pwm-{number}: " in line)
        for begins, ends, duty, period in re.findall(annotation.format(number), of_one):
            found[name].append(Cycle(int(begins), int(ends), float(duty), period))
    return found


@pytest.mark.parametrize("suffix", READERS)
@pytest.mark.parametrize("outputs", OUTPUTS)
def test_sigrok_reads_the_exported_pulses(
    played: Played, outputs: int, suffix: str, scrambled: Wiring, tmp_path: Path
) -> None:
    """Clause PUL-004: from tick ⌊(phase − width)/2⌋ mod 50 on, `width` ticks of 50, which are 25 µs."""
    path, start = tmp_path / f"a{suffix}", played.boundary - 50
    export(played.capture, path, OUTPUTS[outputs], (start, start + 250))
    by_pin = {scrambled.pin(transducer): transducer for transducer in range(320)}
    transducers = {
        f"b{board}p{processor}_{bit:02}": transducer
        for (board, processor, bit), transducer in by_pin.items()
        if (board * 2 + processor) * 32 + bit in OUTPUTS[outputs]
    }
    assert len(transducers) == outputs
    for name, found in cycles(path, list(transducers)).items():
        phase = int(played.pulses.phase[transducers[name]])
        width = int(played.pulses.width[transducers[name]])
        # A pulse that wraps around the end of the period is cut at the boundary at which it begins to play.
        whole = [cycle for cycle in found if cycle.begins % 50 == (phase - width) // 2 % 50]
        assert len(whole) >= (2 if width else 0), name
        assert len(found) - len(whole) <= (1 if width else 0)
        for cycle in whole:
            assert cycle.ends - cycle.begins == 50
            assert cycle.duty == 2 * width
            assert cycle.period == "25.0 μs"


@pytest.mark.parametrize("channels", [range(320), [319, 0, 167, 31, 32, 5, 6, 8, 200]])
def test_sigrok_reads_every_bit_of_a_session_file(played: Played, channels: Sequence[int], tmp_path: Path) -> None:
    start, stop = played.boundary - 10, played.boundary + 60
    export(played.capture, tmp_path / "a.sr", channels, (start, stop))
    expected = np.packbits(played.capture.channels(start, stop)[:, list(channels)], axis=1, bitorder="little")
    assert sigrok(tmp_path / "a.sr", "-O", "binary") == expected.tobytes()


@pytest.mark.parametrize(
    ("text", "channels"),
    [
        ("b0p0_00", [0]),
        ("b4p1_31, b2p1_07", [319, 167]),
        ("b2p1", list(range(160, 192))),
        ("b4", list(range(256, 320))),
        ("b0,b1,b2,b3,b4", list(range(320))),
    ],
)
def test_outputs_are_chosen_by_name(text: str, channels: list[int], scrambled: Wiring) -> None:
    assert chosen_channels(text, scrambled) == channels


def test_outputs_are_chosen_by_transducer(scrambled: Wiring) -> None:
    chosen = chosen_channels("t0,t319,t160", scrambled)
    assert chosen == [int(scrambled.channels[transducer]) for transducer in (0, 319, 160)]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "'' chooses no output"),
        ("b0,", "'' chooses no output"),
        ("b0p0_7", "'b0p0_7' chooses no output; b2, b2p1, b2p1_07 or t160 would"),
        ("12", "'12' chooses no output"),
        ("b5", "no b5: boards are 0 to 4"),
        ("b0p2", "no b0p2: .* processors 0 to 1"),
        ("b0p0_32", "no b0p0_32: .* outputs 00 to 31"),
        ("t320", "no transducer 320; 0 to 319"),
    ],
)
def test_a_choice_of_no_output_is_refused(text: str, message: str, scrambled: Wiring) -> None:
    with pytest.raises(ValueError, match=message):
        chosen_channels(text, scrambled)


@pytest.mark.parametrize("name", ["a.csv", "a", "a.sr.gz"])
def test_unknown_formats_are_refused(name: str) -> None:
    with pytest.raises(ValueError, match=f"{name}: an export's name ends in .vcd or .sr"):
        check_export_path(Path(name))
    with pytest.raises(ValueError, match="an export's name"):
        export(HandMade.of({0: "01"}), Path(name))


def test_a_suffix_may_be_in_capitals(tmp_path: Path) -> None:
    export(HandMade.of({0: "01"}), tmp_path / "A.SR")
    export(HandMade.of({0: "01"}), tmp_path / "A.VCD")
    assert (tmp_path / "A.SR").read_bytes().startswith(b"PK")
    assert (tmp_path / "A.VCD").read_bytes().startswith(b"$")


def test_a_session_file_cannot_have_signals(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"signals need \.vcd"):
        export(HandMade.of({0: "01"}), tmp_path / "a.sr", signals=[Signal("controller.state", 3, [])])


@pytest.mark.parametrize("name", ["a.sr", "a.vcd"])
def test_a_failed_export_leaves_the_file_that_was_there(name: str, tmp_path: Path) -> None:
    class Failing(HandMade):
        def bits(self, start: int, stop: int) -> np.ndarray:
            raise MemoryError

    (tmp_path / name).write_text("earlier")
    made = HandMade.of({0: "01"})
    with pytest.raises(MemoryError):
        export(Failing(made.words, made.wiring), tmp_path / name)
    assert (tmp_path / name).read_text() == "earlier"
    assert [path.name for path in tmp_path.iterdir()] == [name]
