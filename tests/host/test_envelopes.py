from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phasewire import InputFileError
from phasewire.host import Envelope, parse_envelope, read_envelope, sine
from phasewire.protocol.board import CARRIER_HZ
from phasewire.protocol.codes import MODULATION_SAMPLES
from scipy.io import wavfile


def spectrum(envelope: Envelope) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies in Hz and complex amplitudes of what is emitted, from the samples alone."""
    levels = np.frombuffer(envelope.samples, np.uint8) / 255
    found = np.fft.rfft(levels) / len(levels)
    found[1:] *= 2
    return np.arange(len(found)) * envelope.frequency, found


@pytest.mark.parametrize(
    ("frequency", "samples", "hold"), [(200, 200, 1), (150, 400, 2), (1, 200, 200), (40, 200, 5), (10_000, 4, 1)]
)
def test_a_frequency_that_fits_the_store_is_exact(frequency: float, samples: int, hold: int) -> None:
    envelope = sine(frequency)
    at, found = spectrum(envelope)
    assert (len(envelope.samples), envelope.hold) == (samples, hold)
    assert at[1 + np.abs(found[1:]).argmax()] == frequency


@given(st.fractions(20, 2000, max_denominator=50))
def test_no_other_number_of_samples_is_nearer_to_a_frequency(frequency: Fraction) -> None:
    """Against exact fractions, of all numbers of samples and periods with the same hold."""
    envelope = sine(float(frequency))
    count, hold = len(envelope.samples), envelope.hold
    assert count <= MODULATION_SAMPLES

    def error(samples: int) -> Fraction:
        cycles = max(1, round(frequency * samples * hold / CARRIER_HZ))
        return abs(Fraction(cycles * CARRIER_HZ, samples * hold) - frequency)

    assert error(count) <= min(map(error, range(2, MODULATION_SAMPLES + 1))) + Fraction(1, 10**9)


def test_several_sines_have_their_phases() -> None:
    at, found = spectrum(sine([150, 250], 0.8, phase=[90, -30]))
    for frequency, phase in ((150, 90), (250, -30)):
        one = found[np.flatnonzero(at == frequency)[0]] * np.exp(-1j * np.pi * frequency / at[1] / len(found) / 2)
        assert abs(one) == pytest.approx(0.2, abs=2e-3)
        assert np.degrees(np.angle(one)) == pytest.approx(phase, abs=1)
    assert found[0].real == pytest.approx(0.6, abs=2e-3)


def test_with_force_the_radiation_pressure_is_a_sine() -> None:
    pushed = (np.frombuffer(sine(200, force=True).samples, np.uint8) / 255) ** 2
    harmonics = np.abs(np.fft.rfft(pushed)) / len(pushed)
    assert harmonics[1] == pytest.approx(0.25, abs=2e-3)
    assert harmonics[2:].max() < 2e-3  # of rounding to 255 levels


@pytest.mark.parametrize("kind", ["uint8", "int16", "int32", "float32"])
def test_a_wav_file_plays_at_the_rate_of_the_device(tmp_path: Path, kind: str) -> None:
    wave = np.cos(2 * np.pi * 170 * np.arange(4410) / 44_100)
    scaled = {"uint8": 127 * wave + 128, "int16": 3e4 * wave, "int32": 2e9 * wave, "float32": wave}[kind]
    wavfile.write(tmp_path / "a.wav", 44_100, scaled.astype(kind))
    envelope = read_envelope(tmp_path / "a.wav")
    at, found = spectrum(envelope)
    strongest = 1 + int(np.abs(found[1:]).argmax())
    assert (len(envelope.samples) * envelope.hold, at[strongest]) == (4000, 170)
    assert abs(found[strongest]) == pytest.approx(0.5, abs=6e-3)
    assert np.abs(np.delete(found, [0, strongest])).max() < 5e-3


def test_a_wav_file_that_cannot_be_played_says_why(tmp_path: Path) -> None:
    files = {"is no WAV file": b"no", "there must be sound": None}
    for name, content in {"long": np.arange(44_100 * 5), "silent": np.zeros(100), "stereo": np.eye(2)}.items():
        wavfile.write(tmp_path / f"{name}.wav", 44_100, content.astype(np.float32))
    (tmp_path / "no.wav").write_bytes(files["is no WAV file"] or b"")
    for name, reason in {
        "long": "lasts 5 s; .* at most 4.1 s",
        "silent": "there must be sound",
        "stereo": "2 channels; an envelope is mono",
        "no": "is no WAV file",
    }.items():
        with pytest.raises(InputFileError, match=reason):
            read_envelope(tmp_path / f"{name}.wav")


def test_an_envelope_is_written_as_it_is_on_the_command_line() -> None:
    assert parse_envelope("0") is None
    assert parse_envelope("200") == sine(200)
    assert parse_envelope("150+250:depth=0.5,phase=90,force=yes") == sine([150, 250], 0.5, phase=90, force=True)
    for wrong, reason in {
        "fast": "must be a frequency in Hz",
        "1_50": "must be a frequency in Hz",
        "200:loud=1": "has no parameter 'loud'",
        "a.wav:depth=1": "force alone",
        "20001": "frequency 20001.0 Hz must be from",
        "0.01+20000": "do not fit 4096 samples",
    }.items():
        with pytest.raises(ValueError, match=reason):
            parse_envelope(wrong)
