"""Recordings of an emulator's outputs by analysers of many kinds, against what the emulator says it did."""

from __future__ import annotations

import shutil
import subprocess
import tracemalloc
from collections.abc import Mapping
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from phasewire import Wiring
from phasewire.base.errors import InputFileError
from phasewire.emulator.ports.export import export
from phasewire.hil.conformance.profile import Profile
from phasewire.hil.conformance.sight import recorded, sigrok
from phasewire.hil.conformance.sight.capture import Seen, Unseen
from phasewire.hil.conformance.sight.recorded import silences
from phasewire.hil.conformance.sight.sigrok import SessionFile, SigrokObserver

from tests.hil.conformance.recorded import Analyser, Played, play, write

NAMES = [f"b{board}p{processor}_{bit:02}" for board in range(5) for processor in range(2) for bit in range(32)]
TWO_BOARDS = {channel: NAMES[channel] for channel in range(64, 192)}
SEVEN = {channel: NAMES[channel] for channel in (5, 40, 70, 167, 200, 260, 319)}


@pytest.fixture(scope="module")
def played() -> Played:
    return play(2, updates=30)


def equal(seen: Seen, played: Played, channels: Mapping[int, object]) -> bool:
    """Whether every bit of these outputs matches the emulator, and the others are marked as not observed."""
    mask = np.zeros(10, np.uint32)
    for channel in channels:
        mask[channel // 32] |= np.uint32(1 << channel % 32)
    bits = played.capture.bits(seen.first_period * 50, seen.last_period * 50)
    assert (bits & mask).any()
    return np.array_equal(seen.observed, mask) and np.array_equal(seen.words, bits & mask)


def record(
    path: Path, played: Played, analyser: Analyser, probes: Mapping[int, str], start: float = 0.0, seed: int = 0
) -> None:
    samples = analyser.sample(played.capture.bits(0, played.capture.end_tick), start, seed)
    parts = sorted(np.random.default_rng(seed).integers(1, len(samples), 12).tolist())
    write(path, analyser.rate, samples, probes, parts)


def test_an_export_that_begins_in_the_middle_is_read_from_its_second_mark(played: Played, tmp_path: Path) -> None:
    begin = played.marks[1].changes[0][0] * 50 + 17
    export(played.capture, tmp_path / "a.sr", ticks=(begin, played.capture.end_tick))
    observer = SigrokObserver(tmp_path / "a.sr", {}, played.marks)
    last = played.stretch[1]
    assert equal(observer.seen(played.marks[1].last_period, last), played, dict.fromkeys(range(320)))
    with pytest.raises(Unseen, match=rf"periods {played.stretch[0]} to {last} lie nowhere in .*a\.sr between"):
        observer.seen(played.stretch[0], last)


@settings(max_examples=15)
@given(
    st.sampled_from([("4 MHz", 2.0), ("6 MHz", 3.0), ("8 MHz", 4.0), ("10 MHz", 5.0), ("16.6 MHz", 8.3)]),
    st.floats(-100, 100),
    st.floats(0, 5000),
    st.integers(0, 2**32 - 1),
)
@example(("10 MHz", 5.0), 68.0, 262.625, 553)  # two edges three samples farther apart than in the device
def test_any_rate_and_any_start_will_do(
    played: Played,
    tmp_path_factory: pytest.TempPathFactory,
    rate: tuple[str, float],
    ppm: float,
    start: float,
    seed: int,
) -> None:
    path = tmp_path_factory.mktemp("any") / "a.sr"
    jitter = rate[1] >= 4
    record(path, played, Analyser(*rate, ppm, jitter), SEVEN, start, seed)
    assert equal(SigrokObserver(path, {}, played.marks).seen(*played.stretch), played, SEVEN)


def test_probes_are_where_the_profile_says(played: Played, tmp_path: Path, scrambled: Wiring) -> None:
    names = {170: "D0", int(scrambled.channels[160]): "left = right", 66: "b1p0_02"}
    record(tmp_path / "a.sr", played, Analyser("10 MHz", 5.0), names)
    channels = Profile(probes={"D0": "b2p1_10", "left = right": "t160"}).channels(scrambled)
    assert channels == {"D0": 170, "left = right": scrambled.channels[160]}
    assert equal(SigrokObserver(tmp_path / "a.sr", channels, played.marks).seen(*played.stretch), played, names)


def test_small_pieces_give_the_same(played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The size of a read bounds the memory; here it is some samples or some ticks."""
    export(played.capture, tmp_path / "a.sr", range(160, 200))
    monkeypatch.setattr(sigrok, "PIECE_BYTES", 999)
    monkeypatch.setattr(recorded, "TICKS_AT_A_TIME", 77)
    observer = SigrokObserver(tmp_path / "a.sr", {}, played.marks)
    first, _ = played.stretch
    assert equal(observer.seen(first - 10, first + 100), played, dict.fromkeys(range(160, 200)))


def test_memory_does_not_grow_with_the_file(tmp_path: Path) -> None:
    path = archive(tmp_path / "a.sr", {"logic-1-1": bytes(2**27)}, ZIP_DEFLATED)
    file = SessionFile.open(path)
    tracemalloc.start()
    assert silences(file, [0], 1.0).tolist() == [[0, 2**26]]
    ((_, last),) = file.pieces(2**26 - 1, 2**26)
    assert not last.any()
    assert tracemalloc.get_traced_memory()[1] < 2**26
    tracemalloc.stop()


@pytest.mark.parametrize("piece", [1, 2, 3, 5, 100])
def test_silences_of_a_recording_written_by_hand(piece: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Most of three outputs are low; a fourth probe is somewhere else."""
    waves = {
        "b0p0_00": "0000110000011000100000",
        "b0p0_01": "0001110000011001100000",
        "b0p0_02": "1001100010010000010000",
        "else": "1111111111111111111111",
    }
    samples = [sum(int(level) << bit for bit, level in enumerate(at)) for at in zip(*waves.values(), strict=True)]
    probes = "".join(f"probe{number}={name}\n" for number, name in enumerate(waves, 1))
    text = METADATA.replace("probe1=b0p0_00\n", probes).replace("unitsize=2", "unitsize=1")
    file = SessionFile.open(archive(tmp_path / "a.sr", {"metadata": text, "logic-1-1": bytes(samples)}))
    monkeypatch.setattr(sigrok, "PIECE_BYTES", piece)
    assert silences(file, [0, 1, 2], 2).tolist() == [[0, 3], [6, 11], [13, 16], [17, 22]]
    assert silences(file, [0, 1, 2], 3).tolist() == [[6, 11], [17, 22]]
    assert silences(file, [3], 0).tolist() == []


def test_a_recording_of_another_run_is_refused_and_looked_through_once(
    played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    export(played.capture, tmp_path / "a.sr", range(64))
    other = play(77, updates=1)
    observer = SigrokObserver(tmp_path / "a.sr", {}, other.marks)
    for _ in range(2):
        with pytest.raises(InputFileError, match=r"a\.sr was not recorded during this run: none of the 3 marks"):
            observer.seen(*other.stretch)
        monkeypatch.delattr(recorded, "silences", raising=False)


def test_a_missing_mark_only_affects_the_stretches_beside_it(played: Played, tmp_path: Path) -> None:
    export(played.capture, tmp_path / "a.sr", range(64))
    foreign = play(77, updates=1).marks[0]
    assert equal(
        SigrokObserver(tmp_path / "a.sr", {}, [played.marks[0], foreign, *played.marks[2:]]).seen(*played.stretch),
        played,
        dict.fromkeys(range(64)),
    )
    with pytest.raises(Unseen, match="nowhere"):
        SigrokObserver(tmp_path / "a.sr", {}, [played.marks[0], foreign]).seen(*played.stretch)


def test_a_restarted_device_passes_the_same_periods_again(tmp_path: Path) -> None:
    """The recording goes on; the marks around a stretch tell which life it belongs to."""
    lives = [play(30, marks=2), play(40, marks=2)]
    words = [life.capture.bits(0, life.capture.end_tick) for life in lives]
    write(tmp_path / "a.sr", "2 MHz", np.concatenate([words[0], np.zeros((1003, 10), np.uint32), words[1]]), SEVEN)
    marks = [mark for life in lives for mark in life.marks]
    observer = SigrokObserver(tmp_path / "a.sr", {}, marks)
    for life in lives:
        assert equal(observer.between(*life.marks).seen(*life.stretch), life, SEVEN)
    first = max(life.stretch[0] for life in lives)
    with pytest.raises(Unseen, match="more than once"):
        observer.seen(first, first + 10)
    with pytest.raises(Unseen, match="nowhere"):
        observer.between(marks[1], marks[2]).seen(first, first + 10)


def test_2_mhz_are_enough_for_the_device_s_own_clock_alone(played: Played, tmp_path: Path) -> None:
    record(tmp_path / "a.sr", played, Analyser("2 MHz", 1.0, 0.0), SEVEN, start=77.3)
    assert equal(SigrokObserver(tmp_path / "a.sr", {}, played.marks).seen(*played.stretch), played, SEVEN)
    record(tmp_path / "b.sr", played, Analyser("2 MHz", 1.0, 60.0), SEVEN, start=77.3)
    with pytest.raises(Unseen, match=r"b\.sr was sampled at 2 MHz by another clock .*; 8 MHz would do"):
        SigrokObserver(tmp_path / "b.sr", {}, played.marks).seen(*played.stretch)


@pytest.mark.parametrize(("rate", "told"), [("5 MHz", "5 MHz"), ("7.999999 MHz", "8 MHz"), ("1 MHz", "1 MHz")])
def test_too_slow_an_analyser_is_refused(played: Played, rate: str, told: str, tmp_path: Path) -> None:
    write(tmp_path / "a.sr", rate, np.zeros((9, 10), np.uint32), SEVEN)
    with pytest.raises(InputFileError, match=rf"a\.sr was sampled at {told}; it must be 8 MHz or more, or 2, 4 or 6"):
        SigrokObserver(tmp_path / "a.sr", {}, played.marks).seen(1, 2)


@pytest.mark.parametrize(
    ("text", "rate"),
    [("24 MHz", 24_000_000), ("12.5 MHz", 12_500_000), ("500 kHz", 500_000), ("1GHz", 10**9), ("24m", 24_000_000)],
)
def test_rates_as_sigrok_writes_them(text: str, rate: int, tmp_path: Path) -> None:
    write(tmp_path / "a.sr", text, np.zeros((9, 10), np.uint32), SEVEN)
    assert SessionFile.open(tmp_path / "a.sr").rate == rate


METADATA = """
[device 1]
capturefile=logic-1
total probes=2
samplerate=24 MHz
probe1=b0p0_00
unitsize=2
"""


def archive(path: Path, members: Mapping[str, str | bytes], compression: int = ZIP_STORED) -> Path:
    """A session file with some of its members replaced, or left out if they are empty."""
    there = {"version": "2", "metadata": METADATA, "logic-1-1": bytes(100), **members}
    with ZipFile(path, "w", compression) as out:
        for name, content in there.items():
            if content:
                out.writestr(name, content)
    return path


def metadata(old: str, new: str) -> dict[str, str | bytes]:
    assert old in METADATA
    return {"metadata": METADATA.replace(old, new)}


@pytest.mark.parametrize(
    ("members", "complaint"),
    [
        ({"version": ""}, "is no sigrok session file: there is no version and metadata"),
        ({"metadata": ""}, "is no sigrok session file: there is no version and metadata"),
        ({"version": "3"}, "version '3'; 1 and 2 are known"),
        ({"metadata": b"\xff\xfe"}, "no text"),
        ({"metadata": "nonsense"}, "its metadata cannot be read"),
        (metadata("[device 1]", "[device 2]"), r"no logic samples; .* \[device 1\]"),
        (metadata("capturefile=logic-1\n", ""), "no logic samples"),
        (metadata("unitsize=2", ""), "unitsize is ''; it must be a whole number from 1 to 1024"),
        (metadata("unitsize=2", "unitsize=0"), "unitsize is '0'"),
        (metadata("24 MHz", "fast"), "samplerate is 'fast'; it must be one such as 24 MHz"),
        (metadata("24 MHz", "0 MHz"), "samplerate is '0 MHz'"),
        (metadata("probe1", "probe17"), "damaged: b0p0_00 is probe 17, but a sample of 2 bytes has 16 bits"),
        (metadata("probe1=b0p0_00", "probe1=b0p0_00\nprobe2=b0p0_00"), "two probes are at output b0p0_00, one of"),
        (metadata("probe1=b0p0_00\n", ""), r"none of its probes \(none\) is known to be at an output"),
        (metadata("b0p0_00", "D0"), r"none of its probes \(D0\) is known .*\[capture.channels\]"),
        ({"logic-1-1": ""}, "no logic samples; there should be a logic-1-1"),
        ({"logic-1-3": bytes(2)}, "damaged: there is no logic-1-2, but 2 parts"),
        ({"logic-1-2": bytes(3)}, "logic-1-2 has 3 bytes, which is no whole number of samples of 2"),
    ],
)
def test_what_is_wrong_with_a_file_is_said(
    members: dict[str, str | bytes], complaint: str, played: Played, tmp_path: Path
) -> None:
    path = archive(tmp_path / "a.sr", members)
    with pytest.raises(InputFileError, match=rf"a\.sr.*{complaint}"):
        SigrokObserver(path, {}, played.marks).seen(1, 2)


def test_a_map_of_other_probes_is_refused(played: Played, tmp_path: Path) -> None:
    path = archive(tmp_path / "a.sr", metadata("probe1=b0p0_00", "probe1=b0p0_00\nprobe2=D1"))
    with pytest.raises(InputFileError, match=r"a\.sr has no probe 'D7'; it has b0p0_00, D1"):
        SigrokObserver(path, {"D7": 5}, played.marks).seen(1, 2)
    with pytest.raises(InputFileError, match=r"a\.sr: two probes are at output b0p0_00"):
        SigrokObserver(path, {"D1": 0}, played.marks).seen(1, 2)


def test_a_flipped_bit_in_the_samples_is_an_error(played: Played, tmp_path: Path) -> None:
    path = archive(tmp_path / "a.sr", {"logic-1-2": bytes(1000) + b"here" + bytes(1000)})
    path.write_bytes(path.read_bytes().replace(b"here", b"hera"))
    with pytest.raises(InputFileError, match=r"a\.sr is damaged: .*logic-1-2"):
        SigrokObserver(path, {}, played.marks).seen(1, 2)


@pytest.mark.slow
def test_what_sigrok_writes_is_read(played: Played, tmp_path: Path) -> None:
    if shutil.which("sigrok-cli") is None:
        pytest.skip("there is no sigrok-cli here")
    export(played.capture, tmp_path / "a.sr", list(TWO_BOARDS))
    command = ["sigrok-cli", "-i", str(tmp_path / "a.sr"), "-o", str(tmp_path / "b.sr")]
    subprocess.run(command, check=True, timeout=60, capture_output=True)
    seen = SigrokObserver(tmp_path / "b.sr", {}, played.marks).seen(*played.stretch)
    assert equal(seen, played, TWO_BOARDS)
