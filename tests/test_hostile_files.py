"""Hostile files: every reader refuses them with a message, and in little memory."""

from __future__ import annotations

import io
import os
import resource
import struct
import sys
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from phasewire import read_mesh, read_rig, read_volume_mesh
from phasewire.base.errors import ImageError, InputFileError
from phasewire.base.storage import FilePath, read_toml
from phasewire.cli.points import spoken
from phasewire.emulator.firmware.flash import Flash
from phasewire.emulator.scenario import read_scenario
from phasewire.firmware.xs1.assembler import AssemblySource
from phasewire.hil.conformance.sight.sigrok import SessionFile
from phasewire.hil.conformance.tables import read_table
from phasewire.hil.sweep.files import read_sweep
from phasewire.hil.sweep.results import read_results
from phasewire.host.firmware.images import read_image
from phasewire.host.firmware.keys import read_private_key, read_public_keys
from phasewire.host.hands.leap_recording import read_leap_recording
from phasewire.host.hands.pose import Pose
from phasewire.host.hands.recording import HandRecording
from phasewire.host.streaming.calibration import Calibration
from phasewire.host.streaming.recording import Recording
from phasewire.solver.acoustics.aperture import Aperture
from phasewire.solver.acoustics.array_files import read_transducers
from phasewire.solver.archives import read_array, read_arrays
from phasewire.solver.shapes.point_files import read_points

READERS: dict[str, Callable[[FilePath], object]] = {
    "settings.toml": read_toml,
    "scenario.toml": read_scenario,
    "sweep.toml": read_sweep,
    "designs.csv": read_sweep,
    "results.parquet": read_results,
    "profile.toml": read_table,
    "points.csv": read_points,
    "transducers.csv": read_transducers,
    "panels.toml": read_transducers,
    "rig.toml": read_rig,
    "points.txt": read_points,
    "points.json": read_points,
    "calibration.csv": Calibration.load,
    "aperture.npy": lambda path: Aperture.from_image(path, 0.01),
    "aperture.png": lambda path: Aperture.from_image(path, 0.01),
    "solved.npz": read_arrays,
    "array.npy": read_array,
    "circle.frames": Recording.open,
    "wave.json": read_leap_recording,
    "wave.json.lz": read_leap_recording,
    "wave.hands": lambda path: list(HandRecording.open(path)),
    "pose.toml": Pose.load,
    "capture.sr": SessionFile.open,
    "image.dfu": read_image,
    "private.pem": read_private_key,
    "public.pem": lambda path: read_public_keys([path]),
    "flash.bin": Flash.load,
    "program.s": AssemblySource.read,
    "cup.stl": read_mesh,
    "cup.obj": read_mesh,
    "cup.ply": read_mesh,
    "cup.glb": read_mesh,
    "ct.npy": lambda path: read_volume_mesh(path, 0, spacing=0.001),
    "ct.npz": lambda path: read_volume_mesh(path, 0, spacing=0.001),
    "ct.nii": lambda path: read_volume_mesh(path, 0),
    "ct.nrrd": lambda path: read_volume_mesh(path, 0),
    "ct.dcm": lambda path: read_volume_mesh(path, 0),
    "DICOMDIR": lambda path: read_volume_mesh(path, 0),
    "cup.3mf": read_mesh,
    "cup.off": read_mesh,
    "ct.nii.gz": lambda path: read_volume_mesh(path, 0),
}


@pytest.fixture(autouse=True)
def a_gibibyte() -> Iterator[None]:
    """The memory that a test may use beyond its mapped memory at the start, which only Linux reports."""
    if sys.platform != "linux":
        yield
        return
    mapped = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (mapped + 2**30, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def refused(name: str, path: Path, message: str = "") -> None:
    with pytest.raises((InputFileError, ImageError), match=rf"^{path}.*{message}"):
        READERS[name](path)


@pytest.mark.parametrize("name", READERS)
def test_six_gibibytes_of_zeros(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.touch()
    os.truncate(path, 6 * 2**30)
    refused(name, path)


@pytest.mark.parametrize("name", READERS)
def test_a_missing_file_named_by_text(name: str, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        READERS[name](str(tmp_path / name))


@pytest.mark.parametrize("name", READERS)
def test_an_endless_device(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.symlink_to("/dev/zero")
    refused(name, path)


@pytest.mark.parametrize(
    "name", sorted(READERS.keys() - {"ct.dcm", "DICOMDIR"})
)  # of a series, which a folder may hold
def test_a_folder(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.mkdir()
    with pytest.raises(IsADirectoryError) as failed:
        READERS[name](path)
    assert failed.value.filename == str(path)


@pytest.mark.parametrize(
    "name", ["solved.npz", "results.parquet", "array.npy", "circle.frames", "wave.hands", "capture.sr", "aperture.png"]
)
def test_a_pipe_without_a_writer(name: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / name)
    refused(name, tmp_path / name, "must be a plain file")


# Text


@pytest.mark.parametrize("name", ["settings.toml", "scenario.toml", "sweep.toml", "profile.toml", "pose.toml"])
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a = " + "[\n" * 50_000, "is nested too deeply"),
        ("a = " + "[" * 20 + "]" * 20, "is nested too deeply"),
        ("a" + ".a" * 400 + " = 1", "is nested too deeply"),
        ("[" + "a." * 400 + "a]", "is nested too deeply"),
        ("a" + ".a" * 100_000 + " = 1", "line 1 has 200005 bytes; at most 1024 may be"),
        ("#\n" * 200_000, "has 400000 bytes; such a file may have at most 262144"),
        ("a = " + "9" * 1000 + "\na = 1", "is no TOML file"),
    ],
)
def test_excessive_toml(name: str, text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    refused(name, tmp_path / name, message)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("points.csv", "1,2,3\n" * 10**6, "has 6000000 bytes; such a file may have at most 4000000"),
        ("points.csv", '"' + "1" * 3_000_000, "field larger than field limit"),
        ("points.json", "[" * 3_000_000, "recursion"),
        ("points.json", '{"positions": [[1, 2, ' + "9" * 1_000_000 + "]]}", "digits"),
        ("calibration.csv", "transducer,gain,phase_deg,polarity,dead\n" + "9" * 5000 + ",1,0,1,0", "digits"),
        ("calibration.csv", "#\n" * 10**6, "has 2000000 bytes; such a file may have at most 1048576"),
    ],
)
def test_excessive_tables(name: str, text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    refused(name, tmp_path / name, message)


def test_a_line_without_end_on_standard_input() -> None:
    with pytest.raises(InputFileError, match="line 1: it has more than 1048576 characters"):
        list(spoken(["[" * 2_000_000]))


LEAP = '{"frames": ['


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (LEAP + "[]," * 3_000_000 + "]]}", "it has 3000002 lists and objects; at most 2097152 may be"),
        (LEAP + "[" * 2_000_000, "it is nested too deeply"),
        (LEAP + "9" * 30_000_000, "digits"),
        (LEAP + " " * 40_000_000, "has 40000012 bytes; such a file may have at most 33554432"),
        (LEAP + '"ab",' * 6_000_000 + "0]}", "frame 0: it is no object"),
        (LEAP + "0.5," * 8_000_000 + "0]}", "frame 0: it is no object"),
    ],
)
def test_excessive_leap_recordings(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "wave.json").write_text(text)
    refused("wave.json", tmp_path / "wave.json", message)


# Archives


def npy(kind: str, shape: str, held: bytes = b"") -> bytes:
    head = f"{{'descr': {kind}, 'fortran_order': False, 'shape': {shape}}}\n".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + held


def archive(path: Path, members: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", method) as file:
        for name, data in members.items():
            file.writestr(name, data)
    return path


@pytest.mark.parametrize(
    "claimed",
    [
        npy("'<f8'", "(1099511627776,)"),
        npy("'<f8'", "(3,)", bytes(23)),
        npy("'<f8'", "(3,)", bytes(25)),
        npy("'V0'", "(99999999999999999,)"),
        npy("'<U99999999'", "(99999999999,)"),
        npy("'O'", "(1,)", b"\x80\x04N."),
        npy("'<f8'", "(-1,)"),
        npy("-" * 9000 + "1", "()"),
        npy("[" * 9000, "()"),
        b"\x93NUMPY\x03\x00" + bytes(100),
    ],
    ids=range(10),
)
def test_arrays_with_false_headers(claimed: bytes, tmp_path: Path) -> None:
    refused("solved.npz", archive(tmp_path / "solved.npz", {"drive.npy": claimed}))
    (tmp_path / "array.npy").write_bytes(claimed)
    refused("array.npy", tmp_path / "array.npy")
    refused("aperture.npy", tmp_path / "array.npy")


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_members_of_other_compression_methods(method: int, tmp_path: Path) -> None:
    for name in ("solved.npz", "capture.sr"):
        packed = {"version": b"2", "metadata": bytes(1000), "drive.npy": npy("'u1'", "(9,)", bytes(9))}
        refused(name, archive(tmp_path / name, packed, method), "is packed by method")


def test_a_small_archive_of_much(tmp_path: Path) -> None:
    much = npy("'u1'", "(200000000,)", bytes(200_000_000))
    refused("solved.npz", archive(tmp_path / "solved.npz", {f"{n}.npy": much for n in range(3)}), "may hold at most")
    meta = {"version": b"2", "metadata": bytes(300_000_000)}
    refused("capture.sr", archive(tmp_path / "capture.sr", meta), "its metadata has more than 65536 bytes")


def test_a_directory_of_an_archive_that_is_too_large(tmp_path: Path) -> None:
    entry = struct.pack("<4s4B4HL2L5H2L", b"PK\x01\x02", 20, 0, 20, 0, 0, 0, 0, 33, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0) + b"a"
    entries = entry * 150_000
    end = struct.pack("<4s4H2LH", b"PK\x05\x06", 0, 0, 0xFFFF, 0xFFFF, len(entries), 0, 0)
    for name in ("solved.npz", "capture.sr"):
        (tmp_path / name).write_bytes(entries + end)
        refused(name, tmp_path / name, "is too large")


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ("unitsize=1\nsamplerate=" + "9" * 5000 + " GHz", "samplerate"),
        ("unitsize=1\nsamplerate=999999999999 GHz", "samplerate"),
        ("unitsize=" + "9" * 5000 + "\nsamplerate=8 MHz", "unitsize"),
        ("unitsize=1000000000\nsamplerate=8 MHz", "unitsize"),
    ],
)
def test_invalid_numbers_of_an_analyser(said: str, message: str, tmp_path: Path) -> None:
    metadata = f"[device 1]\ncapturefile=logic-1\n{said}\n".encode()
    members = {"version": b"2", "metadata": metadata, "logic-1-1": bytes(64)}
    refused("capture.sr", archive(tmp_path / "capture.sr", members), message)


def test_a_picture_of_many_pixels(tmp_path: Path) -> None:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">L", len(data)) + kind + data + struct.pack(">L", zlib.crc32(kind + data))

    picture = io.BytesIO()
    picture.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">LLBBBBB", 9400, 9400, 16, 6, 0, 0, 0)))
    picture.write(chunk(b"IDAT", zlib.compress(bytes(9400 * 8 + 1))) + chunk(b"IEND", b""))
    (tmp_path / "aperture.png").write_bytes(picture.getvalue())
    refused("aperture.png", tmp_path / "aperture.png", r"\(9400, 9400\) pixels is too large; at most 2048 a side")


def test_valid_archives_are_read(tmp_path: Path) -> None:
    values = {
        "a": np.arange(6.0).reshape(2, 3),
        "b": np.array("text"),
        "c": np.asfortranarray(np.eye(3)),
        "d": np.ones(0),
    }
    for save in (np.savez, np.savez_compressed):
        save(tmp_path / "solved.npz", allow_pickle=False, **values)
        found = read_arrays(tmp_path / "solved.npz")
        assert list(found) == list(values)
        for name, value in values.items():
            np.testing.assert_array_equal(found[name], value)


def test_an_archive_without_its_beginning(tmp_path: Path) -> None:
    """Its directory then names places before the file's first byte."""
    members = {"version": b"2", "metadata": b"", "drive.npy": npy("'u1'", "(9,)", bytes(9))}
    for name in ("solved.npz", "capture.sr"):
        path = archive(tmp_path / name, members)
        path.write_bytes(path.read_bytes()[10:])
        refused(name, path)
