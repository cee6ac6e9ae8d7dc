"""Every reader of files, with any bytes: it reads them, or refuses them with the documented error.

Reading takes little memory whatever a file claims; `python -m tests.fuzz` limits it. Archives and checksums are
also made right around the bytes, because no fuzzer guesses them.
"""

from __future__ import annotations

import atexit
import gzip
import json
import os
import re
import shutil
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any
from unittest.mock import patch

import lzstring
import nibabel
import numpy as np
import trimesh
import typer
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat, PublicFormat
from phasewire import ControlPoints, Mesh, TransducerArray, solve
from phasewire.base.errors import ImageError, InputFileError
from phasewire.cli.commands import command_line
from phasewire.cli.settings import CONFIG_VARIABLE, defaults_from_file
from phasewire.cli.sources import open_file
from phasewire.emulator.scenario import read_scenario
from phasewire.hil.conformance.known import read_known_failures
from phasewire.hil.conformance.profile import read_profile
from phasewire.hil.conformance.sight.sigrok import SessionFile
from phasewire.hil.sweep.files import read_sweep
from phasewire.host.firmware.images import read_firmware
from phasewire.host.firmware.keys import read_private_key, read_public_keys
from phasewire.host.hands import HandFrame, TrackedHand
from phasewire.host.hands.leap_recording import read_leap_recording
from phasewire.host.hands.pose import Pose
from phasewire.host.hands.recording import HandRecorder, HandRecording
from phasewire.host.streaming.calibration import Calibration
from phasewire.host.streaming.recording import Recording, record
from phasewire.host.streaming.rig import read_rig
from phasewire.protocol import PulseFrames
from phasewire.solver.acoustics.aperture import Aperture
from phasewire.solver.acoustics.array_files import read_transducers
from phasewire.solver.contact.hand import Hand
from phasewire.solver.fields.files import save_solution
from phasewire.solver.objects.mesh_files import MESH_FILES, read_mesh
from phasewire.solver.objects.volumes import read_volume_mesh
from phasewire.solver.shapes.point_files import POINT_FILES, read_points
from pydicom.dataset import FileDataset, FileMetaDataset
from pydicom.uid import UID, CTImageStorage, ExplicitVRLittleEndian

from tests.host.hands.leap_service import leap_frame

Nifti1Image: Any = nibabel.Nifti1Image  # it has no types
DOCUMENTS = Path(__file__).parents[2] / "docs"
MOST_SAMPLES = 2**20


@cache
def _folder() -> Path:
    folder = tempfile.mkdtemp(prefix="phasewire-fuzz-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def _attempt(read: Callable[[Path], object], data: bytes, name: str) -> None:
    """Write bytes to a file and read it."""
    path = _folder() / name
    path.write_bytes(data)
    with suppress(InputFileError, ImageError):
        read(path)


def frames(data: bytes) -> None:
    """Recordings, as they are and with right checksums."""
    for piece in (data, _sealed(data)):
        _attempt(_read_frames, piece, "a.frames")


def _read_frames(path: Path) -> None:
    with Recording.open(path) as recording:
        assert len(recording.read(0, 1000).phase) <= len(recording)


def _sealed(data: bytes) -> bytes:
    """A recording whose head and text have the right checksums, whatever else is wrong with it."""
    text = data[28 : 28 + int.from_bytes(data[8:12], "little")]
    head = b"PWFRAMES" + struct.pack("<II", len(text), zlib.crc32(text)) + data[16:24].ljust(8, b"\xff")
    return head + zlib.crc32(head).to_bytes(4, "little") + text + data[28 + len(text) :]


def toml(data: bytes) -> None:
    """All files in TOML: defaults of options, scenarios, profiles, known failures, poses, arrays, rigs, sweeps."""
    for read in (
        read_scenario,
        read_profile,
        read_known_failures,
        Pose.load,
        read_transducers,
        read_rig,
        read_sweep,
        _read_settings,
    ):
        _attempt(read, data, "a.toml")


def _read_settings(path: Path) -> None:
    with patch.dict(os.environ, {CONFIG_VARIABLE: str(path)}):
        defaults_from_file(_commands())


@cache
def _commands() -> typer.Context:
    return typer.Context(command_line(), info_name="phasewire")


def tables(data: bytes) -> None:
    """Points in every format, calibrations, and designs of a sweep."""
    for suffix in POINT_FILES:
        _attempt(read_points, data, f"a{suffix}")
    _attempt(Calibration.load, data, "a.csv")
    _attempt(read_sweep, data, "a.csv")


def session_files(data: bytes) -> None:
    """Logic analysers' files: as they are, and with these bytes for the metadata or the samples."""
    said = b"[device 1]\ncapturefile=logic-1\nunitsize=2\nsamplerate=8 MHz\nprobe1=b0p0_00\n"
    for meta, samples in ((data, b"ab" * 50), (said, data)):
        _attempt(_read_session, _zipped({"version": b"2", "metadata": meta, "logic-1-1": samples}), "a.sr")
    _attempt(_read_session, data, "a.sr")


def _read_session(path: Path) -> None:
    file = SessionFile.open(path)
    for _, samples in file.pieces(0, min(file.samples, MOST_SAMPLES)):
        assert samples.shape[1] == file.unit


def solved(data: bytes) -> None:
    """Solved files and other arrays: as they are, and with these bytes for one of the arrays; apertures."""
    members = {f"{name}.npy": array for name, array in _solved_arrays().items()}
    for name in ("format", "drive", "array_positions", "medium"):
        _attempt(_read_source, _zipped(members | {f"{name}.npy": data}), "a.npz")
    _attempt(_read_source, _zipped({"phase.npy": data, "width.npy": data}), "a.npz")
    _attempt(_read_source, _zipped({"drives.npy": data}), "a.npz")
    _attempt(_read_source, data, "a.npz")
    for suffix in (".npy", ".png"):
        _attempt(lambda path: Aperture.from_image(path, 0.01), data, f"a{suffix}")


def _read_source(path: Path) -> None:
    with open_file(path):
        pass


def leap(data: bytes) -> None:
    """Recordings of the Leap: as they are, and packed."""
    for suffix in (".json", ".json.lz"):
        _attempt(read_leap_recording, data, f"a{suffix}")


def hands(data: bytes) -> None:
    """Recordings of hands: as they are, and with these bytes for the lines after the first."""
    head = b'{"format":"phasewire-hands-1","rate_hz":60}\n'
    for piece in (data, head + data):
        _attempt(_read_hands, piece, "a.hands")


def _read_hands(path: Path) -> None:
    with HandRecording.open(path) as recording:
        for frame in recording:
            assert all(np.isfinite(each.hand.quads).all() for each in frame.hands)


def images(data: bytes) -> None:
    """Firmware images, and keys."""
    _attempt(read_firmware, data, "a.dfu")
    _attempt(read_private_key, data, "a.pem")
    _attempt(lambda path: read_public_keys([path]), data, "a.pem")


def meshes(data: bytes) -> None:
    """Meshes in every format; also with these bytes for the triangles of an STL file and the text of a GLB file."""
    for suffix in MESH_FILES:
        _attempt(read_mesh, data, f"a{suffix}")
    whole = len(data) // 50
    _attempt(read_mesh, bytes(80) + struct.pack("<I", whole) + data[: 50 * whole], "a.stl")
    _attempt(read_mesh, _with_text(data), "a.glb")


def _with_text(text: bytes) -> bytes:
    """A GLB file with a text, and with zeros and ones for its geometry."""
    binary = struct.pack("<I4s", 64, b"BIN\0") + bytes([0, 0, 128, 63]) * 16
    size = 20 + len(text) + len(binary)
    return b"glTF" + struct.pack("<III4s", 2, size, len(text), b"JSON") + text + binary


def volumes(data: bytes) -> None:
    """Volumes: NumPy's and NIfTI, packed too, and a folder with two files that may be DICOM."""
    for name, whole in (
        ("a.npy", data),
        ("a.nii", data),
        ("a.nrrd", data),
        ("a.dcm", data),
        ("DICOMDIR", data),
        ("a.nii.gz", data),
        ("a.nii.gz", gzip.compress(data, 1)),
    ):
        _attempt(_read_volume, whole, name)
    folder = _folder() / "series"
    folder.mkdir(exist_ok=True)
    (folder / "1").write_bytes(data)
    _attempt(lambda _path: _read_volume(folder), _slice(2), "series/2")


def _read_volume(path: Path) -> Mesh:
    return read_volume_mesh(path, 0.5, spacing=None if path.suffix == ".nii" else 0.01)


@cache
def _slice(place: int) -> bytes:
    """A DICOM file of 3 by 3 values, at a place along the patient."""
    meta = FileMetaDataset()
    meta.TransferSyntaxUID = ExplicitVRLittleEndian
    meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID = CTImageStorage, UID(f"1.2.{place}")
    piece = FileDataset("", {}, file_meta=meta, preamble=bytes(128))
    piece.SOPClassUID, piece.SOPInstanceUID, piece.SeriesInstanceUID = CTImageStorage, f"1.2.{place}", "1.2.3"
    piece.Rows, piece.Columns, piece.PixelSpacing = 3, 3, [10, 10]
    piece.ImageOrientationPatient, piece.ImagePositionPatient = [1, 0, 0, 0, 1, 0], [0, 0, 10 * place]
    piece.SamplesPerPixel, piece.PhotometricInterpretation = 1, "MONOCHROME2"
    piece.BitsAllocated, piece.BitsStored, piece.HighBit, piece.PixelRepresentation = 16, 16, 15, 0
    piece.PixelData = bytes([0, 0, 1, 0] * 4 + [0, 0])
    written = BytesIO()
    piece.save_as(written, enforce_file_format=True)
    return written.getvalue()


READERS: dict[str, Callable[[bytes], None]] = {
    group.__name__: group
    for group in (frames, toml, tables, session_files, solved, hands, leap, images, meshes, volumes)
}


# Seeds


def _zipped(members: dict[str, bytes]) -> bytes:
    whole = BytesIO()
    with zipfile.ZipFile(whole, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return whole.getvalue()


@cache
def _solved_file() -> bytes:
    path = _folder() / "solved.npz"
    save_solution(path, solve(TransducerArray.grid(2, 2), ControlPoints([[0, 0, 0.1]])))
    return path.read_bytes()


@cache
def _solved_arrays() -> dict[str, bytes]:
    with zipfile.ZipFile(BytesIO(_solved_file())) as archive:
        return {name.removesuffix(".npy"): archive.read(name) for name in archive.namelist()}


def _recorded() -> bytes:
    path = _folder() / "seed.frames"
    pulses = PulseFrames(*(np.full((3, 4), value, np.uint8) for value in (50, 20)))
    record(path, pulses, 100, array=TransducerArray.grid(2, 2), calibration=Calibration.perfect(4))
    return path.read_bytes()


def _recorded_hands() -> bytes:
    path = _folder() / "seed.hands"
    with HandRecorder(path, 60, pose=Pose.none()) as recorder:
        for number in range(3):
            recorder.write(HandFrame(number / 60, (TrackedHand(Hand.flat(curl=number / 3), 1),), number, ("a note",)))
    return path.read_bytes()


def _mesh_files() -> list[bytes]:
    """A tetrahedron in every format, and the text of a scene."""
    corners = np.concatenate([np.zeros((1, 3)), np.eye(3) / 10])
    tetrahedron: Any = trimesh.Trimesh(corners, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    made = [tetrahedron.export(file_type=kind) for kind in ("stl", "stl_ascii", "obj", "ply", "glb")]
    files = [data if isinstance(data, bytes) else data.encode() for data in made]
    ascii_ply: bytes = tetrahedron.export(file_type="ply", encoding="ascii")
    scene = files[-1]
    return [*files, ascii_ply, scene[20 : 20 + int.from_bytes(scene[12:16], "little")]]


def _cuts(whole: bytes) -> list[bytes]:
    """A file, and beginnings of it."""
    return [whole[: len(whole) * part // 21] for part in range(1, 22)]


def reader_seeds(group: str, firmware: list[bytes]) -> list[bytes]:
    """The first inputs of a group's fuzzer; some are images of firmware."""
    match group:
        case "frames":
            return _cuts(_recorded())
        case "toml":
            documents = "".join(
                (DOCUMENTS / name).read_text()
                for name in (
                    "how-to/conformance.md",
                    "reference/faults.md",
                    "reference/cli.md",
                    "how-to/hands.md",
                    "how-to/any-array.md",
                    "how-to/rigs.md",
                    "how-to/sweeps.md",
                )
            )
            written = re.findall(r"```toml\n(.*?)```", documents, re.DOTALL)
            return [*map(str.encode, written), *_cuts("".join(written).encode())]
        case "tables":
            path = _folder() / "seed.csv"
            Calibration.perfect(4).save(path)
            points = [
                b"x,y,z\n0,0,0.1\n",
                b"source,columns\nstar,10\n",
                b"0 0 0.1 1 # one\n",
                b'{"positions": [[0, 0, 0.1]], "amplitudes": [1]}',
            ]
            return [*points, *_cuts(path.read_bytes())]
        case "session_files":
            metadata = b"[global]\nsigrok version=0.5.2\n[device 1]\ncapturefile=logic-1\nunitsize=1\n"
            metadata += b"total probes=2\nsamplerate=24 MHz\nprobe1=b0p0_00\nprobe2=D1\n"
            return [metadata, *_cuts(_zipped({"version": b"2", "metadata": metadata, "logic-1-1": bytes(64)}))]
        case "hands":
            return _cuts(_recorded_hands())
        case "meshes":
            return [seed for whole in _mesh_files() for seed in _cuts(whole)[::3]]
        case "volumes":
            values = (np.indices((3, 3, 3)).sum(axis=0) % 2).astype(np.float32)
            image: Any = Nifti1Image(values, np.diag([10, 10, 10, 1]))
            image.header.set_xyzt_units("mm")
            array = BytesIO()
            np.save(array, values)
            wholes = (image.to_bytes(), array.getvalue(), _slice(1))
            return [seed for whole in wholes for seed in _cuts(whole)[::2]]
        case "solved":
            return [*_solved_arrays().values(), *_cuts(_solved_file())]
        case "leap":
            plain = json.dumps({"metadata": {}, "frames": [leap_frame(0, 0.0), leap_frame(1, 9e3, {})]}).encode()
            rows = (
                b'{"frames": [["id", "timestamp", {"hands": [["id"]]}, {"pointables": [["id"]]}], [1, 2, [[3]], []]]}'
            )
            compressed = lzstring.LZString().compressToBase64(rows.decode()).encode()
            return [plain, rows, *_cuts(plain), *_cuts(compressed)]
    key = Ed25519PrivateKey.from_private_bytes(bytes(32))
    public = key.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)
    private = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    return [*firmware, *_cuts(public), *_cuts(private)]
