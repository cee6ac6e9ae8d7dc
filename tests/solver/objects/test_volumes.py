from __future__ import annotations

import gzip
import math
import re
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import nibabel
import nrrd
import numpy as np
import pydicom
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from phasewire import Mesh, read_volume_mesh
from phasewire.base.errors import InputFileError
from phasewire.base.extras import install_command
from phasewire.solver.objects import volumes
from phasewire.solver.objects.parsing import parse_object
from pydicom.dataset import FileDataset, FileMetaDataset
from pydicom.fileset import FileSet

from tests.solver.contact.cuts import in_trimesh

Nifti1Image: Any = nibabel.Nifti1Image  # which has no types
RADIUS = 0.04
CENTRE = np.array([0.045, 0.052, 0.05])


def ball(shape: tuple[int, int, int], steps: NDArray[np.float64]) -> NDArray[np.float32]:
    """Values that fall with the distance from `CENTRE`, 0 at `RADIUS`, in millimetres."""
    places = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1) * steps
    values: NDArray[np.float32] = (1000 * (RADIUS - np.linalg.norm(places - CENTRE, axis=-1))).astype(np.float32)
    return values


STEPS = np.array([0.002, 0.0025, 0.003])
BALL = ball((46, 42, 34), STEPS)


def is_the_ball(mesh: Mesh, centre: NDArray[np.float64] = CENTRE, rough: float = 1e-4) -> None:
    shape = in_trimesh(mesh)
    assert mesh.repairs == ()
    assert shape.is_watertight
    assert shape.is_winding_consistent
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices - centre, axis=1), RADIUS, atol=rough)
    assert shape.volume == pytest.approx(4 / 3 * math.pi * RADIUS**3, rel=100 * rough)
    assert shape.area == pytest.approx(4 * math.pi * RADIUS**2, rel=100 * rough)


def nifti(path: Path, values: NDArray[Any], affine: NDArray[np.float64], unit: str | None = "mm") -> Path:
    image = Nifti1Image(values, affine)
    if unit is not None:
        image.header.set_xyzt_units(unit)
    nibabel.save(image, path)
    return path


def dicom(folder: Path, values: NDArray[np.int16], **changes: dict[int, Any]) -> Path:
    """A series of slices along k, with the names of the files in no order; ``changes`` give a tag by the slice."""
    folder.mkdir(exist_ok=True)
    for k in range(values.shape[2]):
        meta = FileMetaDataset()
        meta.TransferSyntaxUID = pydicom.uid.ExplicitVRLittleEndian
        meta.MediaStorageSOPClassUID = pydicom.uid.CTImageStorage
        meta.MediaStorageSOPInstanceUID = pydicom.uid.generate_uid()
        piece = FileDataset("", {}, file_meta=meta, preamble=bytes(128))
        piece.SOPClassUID, piece.SOPInstanceUID = meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID
        piece.SeriesInstanceUID = "1.2.3"
        piece.Rows, piece.Columns = values.shape[1], values.shape[0]  # a row runs along i, a column along j
        piece.PixelSpacing = [float(STEPS[1] * 1000), float(STEPS[0] * 1000)]
        piece.ImageOrientationPatient = [1, 0, 0, 0, 1, 0]
        piece.ImagePositionPatient = [0, 0, float(k * STEPS[2] * 1000)]
        piece.SamplesPerPixel, piece.PhotometricInterpretation = 1, "MONOCHROME2"
        piece.BitsAllocated = piece.BitsStored = 16
        piece.HighBit, piece.PixelRepresentation = 15, 1
        piece.RescaleSlope, piece.RescaleIntercept = 0.01, -20
        piece.PixelData = np.ascontiguousarray(values[:, :, k].T).tobytes()
        for tag, by_slice in changes.items():
            if k in by_slice:
                setattr(piece, tag, by_slice[k])
        piece.save_as(folder / f"{(7 * k) % values.shape[2]:03d}.dcm", enforce_file_format=True)
    return folder


COUNTS: NDArray[np.int16] = np.round((np.maximum(BALL, -30) + 20) * 100).astype(np.int16)


def test_an_array_and_its_spacing(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", ball((60, 60, 60), np.full(3, 0.0017)))
    said: list[str] = []
    is_the_ball(read_volume_mesh(tmp_path / "a.npy", 0, spacing=0.0017, status=said.append))
    assert said[:2] == [f"reading {tmp_path}/a.npy", f"{tmp_path}/a.npy: making a surface from 216000 values"]
    np.savez_compressed(tmp_path / "a.npz", volume=BALL, spacing=STEPS)
    is_the_ball(read_volume_mesh(str(tmp_path / "a.npz"), 0))


@pytest.mark.parametrize("name", ["a.nii", "a.nii.gz", "A.NII"])
@pytest.mark.parametrize(("unit", "metres"), [("mm", 1e-3), ("meter", 1.0), ("micron", 1e-6)])
def test_nifti(name: str, unit: str, metres: float, tmp_path: Path) -> None:
    affine = np.diag([*STEPS / metres, 1])
    affine[:3, 3] = np.array([0.1, -0.2, 0.3]) / metres
    mesh = read_volume_mesh(nifti(tmp_path / name, BALL, affine, unit), 0)
    is_the_ball(mesh, CENTRE + np.array([0.1, -0.2, 0.3]))


def test_a_mirrored_and_turned_grid(tmp_path: Path) -> None:
    affine = np.eye(4)
    affine[:3, :3] = [[-STEPS[0] * 1000, 0, 0], [0, 0, STEPS[2] * 1000], [0, STEPS[1] * 1000, 0]]
    for sign in (1, -1):
        affine[2] *= sign
        mesh = read_volume_mesh(nifti(tmp_path / "a.nii", BALL, affine), 0)
        is_the_ball(mesh, CENTRE[[0, 2, 1]] * [-1, 1, sign])


def test_nifti_s_values_are_scaled(tmp_path: Path) -> None:
    image = Nifti1Image(COUNTS, np.diag([*STEPS * 1000, 1]))
    image.header.set_xyzt_units("mm")
    image.header.set_slope_inter(0.01, -20)
    nibabel.save(image, tmp_path / "a.nii")
    is_the_ball(read_volume_mesh(tmp_path / "a.nii", 0))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"SeriesInstanceUID": {3: "1.2.4"}}, r"has 2 series: 1.2.3 .33 slices.; .* pass one's number, descr"),
        ({"PixelSpacing": {3: [1, 1]}}, "2 different distances of pixels"),
        ({"ImageOrientationPatient": {0: [0, 1, 0, 1, 0, 0]}}, "2 different orientations"),
        ({"ImagePositionPatient": {3: [0, 0, 0]}}, "two of its slices lie at the same place"),
        ({"ImagePositionPatient": {33: [0, 0, 110]}}, "its slices are 3 mm apart, but 14 mm from 96 to 110 mm"),
        ({"NumberOfFrames": {3: 2}}, "has 2 frames, and does not say where"),
        ({"ImagePositionPatient": {3: None}}, "has no ImagePositionPatient"),
        ({"PixelData": {3: b"12"}}, "pixel data"),
        ({"RescaleSlope": dict.fromkeys(range(34), 0)}, "level 0 must lie between its values"),
    ],
)
def test_an_inconsistent_series_is_refused(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    folder = dicom(tmp_path / "series", COUNTS, **changes)
    with pytest.raises(InputFileError, match=rf"^{folder}.*({message})"):
        read_volume_mesh(folder, 0)


@pytest.mark.parametrize("series", ["7", 7, "soft tissue", "1.2.7", None, "8"])
def test_a_series_is_chosen_by_its_number_description_or_uid(series: Any, tmp_path: Path) -> None:
    """Of two in one folder, of which the other one is empty space."""
    values = np.rint(BALL * 100 + 2000).astype(np.int16)
    slices = range(values.shape[2])
    named: dict[str, Any] = {"SeriesNumber": 7, "SeriesDescription": "soft tissue", "SeriesInstanceUID": "1.2.7"}
    folder = dicom(tmp_path / "study", values, **{tag: dict.fromkeys(slices, value) for tag, value in named.items()})
    for file in folder.iterdir():
        file.rename(folder / f"a{file.name}")
    dicom(folder, np.zeros_like(values))
    if series in (None, "8"):
        with pytest.raises(InputFileError, match=r"has 2 series: .*7 soft tissue .34 slices."):
            read_volume_mesh(folder, 0, series=series)
        return
    is_the_ball(read_volume_mesh(folder, 0, series=series))
    is_the_ball(parse_object(f"{folder}:level=0,series=7").mesh.moved(CENTRE - np.array([0, 0, 0.17])))


@pytest.mark.parametrize("whole", [False, True])
def test_a_dicomdir_names_its_slices(whole: bool, tmp_path: Path) -> None:
    folder = dicom(tmp_path / "slices", np.rint(BALL * 100 + 2000).astype(np.int16))
    made = FileSet()
    for file in folder.iterdir():
        piece = pydicom.dcmread(file)
        piece.PatientID, piece.StudyInstanceUID, piece.Modality, piece.SeriesNumber = "1", "1.2", "CT", 1
        piece.StudyDate, piece.StudyTime, piece.StudyID, piece.InstanceNumber = "20260101", "120000", "1", 1
        made.add(piece)
    made.write(tmp_path / "disc")
    made._stage["t"].cleanup()  # pydicom leaves it to the garbage
    is_the_ball(read_volume_mesh(tmp_path / "disc" if whole else tmp_path / "disc" / "DICOMDIR", 0))


@pytest.mark.parametrize("name", ["../a", "/etc/passwd", ["..", "..", "a"]])
def test_a_dicomdir_names_nothing_outside(name: Any, tmp_path: Path) -> None:
    record = pydicom.Dataset()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        record.ReferencedFileID = name
        listing = pydicom.Dataset()
        listing.DirectoryRecordSequence = [record]
        listing.file_meta = FileMetaDataset()
        listing.file_meta.TransferSyntaxUID = pydicom.uid.ExplicitVRLittleEndian
        listing.file_meta.MediaStorageSOPClassUID = pydicom.uid.MediaStorageDirectoryStorage
        listing.file_meta.MediaStorageSOPInstanceUID = pydicom.uid.UID("1.2")
        listing.save_as(tmp_path / "DICOMDIR", enforce_file_format=True)
    with pytest.raises(InputFileError, match="no file below its folder"):
        read_volume_mesh(tmp_path / "DICOMDIR", 0)


def test_an_enhanced_file_holds_all_its_slices(tmp_path: Path) -> None:
    values = np.rint(BALL * 100 + 2000).astype(np.int16)
    [first, *_] = sorted(dicom(tmp_path / "slices", values).iterdir())
    piece = pydicom.dcmread(first)
    groups: list[pydicom.Dataset] = []
    for k in range(values.shape[2]):
        groups.append(pydicom.Dataset())
        place = pydicom.Dataset()
        place.ImagePositionPatient = [0, 0, float(k * STEPS[2] * 1000)]
        groups[-1].PlanePositionSequence = [place]
    shared, measures = pydicom.Dataset(), pydicom.Dataset()
    measures.PixelSpacing = piece.PixelSpacing
    shared.PixelMeasuresSequence = [measures]
    piece.NumberOfFrames, piece.PerFrameFunctionalGroupsSequence = len(groups), groups
    piece.SharedFunctionalGroupsSequence = [shared]
    del piece.ImagePositionPatient, piece.PixelSpacing
    piece.PixelData = np.ascontiguousarray(values.transpose(2, 1, 0)).tobytes()
    piece.save_as(tmp_path / "whole.dcm")
    is_the_ball(read_volume_mesh(tmp_path / "whole.dcm", 0))
    with pytest.raises(InputFileError, match="it has 1 slices in DICOM files; at least 2 are needed"):
        read_volume_mesh(first.rename(tmp_path / "one.dcm"), 0)


@pytest.mark.parametrize("series", [1, "1", None, 2, "x"])
def test_a_nifti_s_volume_is_chosen_by_its_number(series: Any, tmp_path: Path) -> None:
    path = nifti(tmp_path / "a.nii", np.stack([0 * BALL, BALL], axis=-1), np.diag([*(STEPS * 1000), 1]))
    if str(series) != "1":
        with pytest.raises(InputFileError, match="has 2 volumes: pass series=0 to 1 for one of them"):
            read_volume_mesh(path, 0, series=series)
        return
    is_the_ball(read_volume_mesh(path, 0, series=series))


@pytest.mark.parametrize("encoding", ["raw", "gzip", "bzip2"])
@pytest.mark.parametrize(
    "said", [{"space": "left-posterior-superior"}, {"space dimension": 3, "space units": ["mm"] * 3}, {}]
)
def test_nrrd(encoding: str, said: dict[str, Any], tmp_path: Path) -> None:
    path, header = tmp_path / "a.nrrd", {"encoding": encoding, **said}
    if said:
        header |= {"space directions": np.diag(STEPS * 1000), "space origin": np.array([1.0, 2.0, 3.0])}
    nrrd.write(str(path), BALL, header)
    if encoding == "bzip2" or not said:
        with pytest.raises(InputFileError, match=r"encoding bzip2 is not supported|does not say how far its values"):
            read_volume_mesh(path, 0)
        return
    is_the_ball(read_volume_mesh(path, 0), CENTRE + np.array([0.001, 0.002, 0.003]))


def test_compressed_slices_are_refused_before_they_are_unpacked(tmp_path: Path) -> None:
    folder = dicom(tmp_path / "series", COUNTS)
    piece = pydicom.dcmread(folder / "000.dcm")
    piece.file_meta.TransferSyntaxUID = pydicom.uid.DeflatedExplicitVRLittleEndian
    piece.save_as(folder / "000.dcm")
    with pytest.raises(InputFileError, match=r"000.dcm is compressed \(1.2.840.10008.1.2.1.99\)"):
        read_volume_mesh(folder, 0)


def test_a_larger_step_takes_means(tmp_path: Path) -> None:
    path = nifti(tmp_path / "a.nii", BALL, np.diag([*STEPS * 1000, 1]))
    fine, coarse = read_volume_mesh(path, 0), read_volume_mesh(path, 0, step=2)
    is_the_ball(coarse, rough=6e-4)
    assert len(coarse.faces) < 0.3 * len(fine.faces)


def test_noise_is_refused_with_the_step_that_helps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(volumes, "MOST_FACES", 10_000)
    path = nifti(tmp_path / "a.nii", BALL + np.random.default_rng(0).normal(0, 20, BALL.shape), np.diag([2, 2, 2, 1]))
    with pytest.raises(InputFileError, match=r"faces; at most 10000 are possible: pass a larger step, such as \d"):
        read_volume_mesh(path, 0)


@given(seed=st.integers(0, 2**32 - 1), level=st.sampled_from([0.5, 1.0, 1.5]))
@settings(max_examples=25, deadline=None)
def test_any_values_have_a_closed_surface(seed: int, level: float) -> None:
    values = np.random.default_rng(seed).integers(0, 3, (6, 7, 5)).astype(np.float32)
    volume = volumes.Volume(values, np.zeros(3), np.eye(3) * 0.01)
    mesh = Mesh.of(*volume.surface(level)).repaired()
    faces = mesh.faces
    forward = np.where(faces < np.roll(faces, -1, axis=1), 1, -1)
    assert not np.bincount(mesh.solid.face_edges.ravel(), weights=forward.ravel()).any()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"level": 0, "spacing": 0}, "spacing 0 m must be positive"),
        ({"level": 0, "step": 0}, "step 0 must be a whole number from 1"),
        ({"level": 0, "spacing": 0.002, "step": 30}, "a.npy: step 30 must be a whole number from 1 to 17"),
        ({"level": 900, "spacing": 0.002}, "a.npy: level 900 must lie between its values, which go from -4"),
        ({"level": 0}, "a.npy does not say how far its values are apart: pass spacing"),
        ({"level": 0, "spacing": 1e-9}, "a.npy: it is .* m large, too small to be felt"),
        ({"level": 0, "spacing": 2}, "its surface at 0 is .* m large, .* with values 2 m apart; spacing is in"),
    ],
)
def test_impossible_surfaces_are_refused(options: Any, message: str, tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", BALL)
    with pytest.raises(ValueError, match=message):
        read_volume_mesh(tmp_path / "a.npy", **options)


HOSTILE: dict[str, tuple[str, Any, str]] = {
    "a.npy of two dimensions": ("a.npy", np.zeros((3, 3)), "three dimensions"),
    "a.npy that is thin": ("a.npy", np.zeros((3, 3, 1)), "at least 2 values"),
    "a.npy of complex values": ("a.npy", np.zeros((3, 3, 3), complex), "no numbers of one kind"),
    "a.npy that is not finite": ("a.npy", np.full((3, 3, 3), np.nan), "not finite"),
    "a.npy beyond all bounds": ("a.npy", np.full((3, 3, 3), 1e300), "not finite"),
    "a.nii of nothing": ("a.nii", b"", "no NIfTI header"),
    "a.nii that is cut off": ("a.nii", (348).to_bytes(4, "little"), "NIfTI"),
    "a.nii.gz of another kind": ("a.nii.gz", b"no archive", "cannot be unpacked"),
    "a.nii.gz of nothing": ("a.nii.gz", gzip.compress(b""), "no NIfTI header"),
    "a.png": ("a.png", b"", "volumes are read from .npy, .*, .nii.gz, .nrrd and .dcm files, DICOMDIR, and folders"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_an_invalid_volume_is_refused_by_name(name: str, tmp_path: Path) -> None:
    file, content, message = HOSTILE[name]
    path = tmp_path / file
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        np.save(path, content)
    with pytest.raises(InputFileError, match=rf"^{path}.*{message}"):
        read_volume_mesh(path, 0, spacing=0.001)


def test_messages_of_nibabel_are_not_printed(tmp_path: Path) -> None:
    whole = bytearray(nifti(tmp_path / "a.nii", BALL, np.eye(4)).read_bytes())
    whole[70:72] = bytes(2)  # the type of the values
    (tmp_path / "a.nii").write_bytes(whole)
    code = f"import phasewire\ntry: phasewire.read_volume_mesh({str(tmp_path / 'a.nii')!r}, 0)\n"
    code += "except ValueError as error: print(error)"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert ended.stdout.endswith("NIfTI file: it is damaged (HeaderDataError: data code 0 not supported)\n")
    assert ended.stderr == ""


def test_claims_of_a_nifti_header(tmp_path: Path) -> None:
    whole = bytearray(nifti(tmp_path / "a.nii", BALL, np.eye(4)).read_bytes())
    whole[42:48] = (30000).to_bytes(2, "little") * 3
    (tmp_path / "a.nii").write_bytes(whole)
    with pytest.raises(InputFileError, match=r"it announces \(30000, 30000, 30000\) values"):
        read_volume_mesh(tmp_path / "a.nii", 0)


def test_a_nifti_without_a_unit_is_asked_for_it(tmp_path: Path) -> None:
    path = nifti(tmp_path / "a.nii", ball((60, 60, 60), np.full(3, 0.0017)), np.eye(4), None)
    with pytest.raises(InputFileError, match="does not say its unit of length: pass spacing"):
        read_volume_mesh(path, 0)
    is_the_ball(read_volume_mesh(path, 0, spacing=0.0017))


def test_a_small_archive_of_much(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(volumes, "MOST_BYTES", 10_000_000)
    (tmp_path / "a.nii.gz").write_bytes(gzip.compress(bytes(10_000_001)))
    with pytest.raises(InputFileError, match="unpacked it has more than 10000000 bytes"):
        read_volume_mesh(tmp_path / "a.nii.gz", 0)


@pytest.mark.parametrize(
    ("module", "package"), [("skimage", "scikit-image"), ("nibabel", "nibabel"), ("pydicom", "pydicom")]
)
def test_a_missing_library_is_named(module: str, package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = (
        dicom(tmp_path / "s", COUNTS) if module == "pydicom" else nifti(tmp_path / "a.nii", BALL, np.diag([2, 2, 2, 1]))
    )
    monkeypatch.setitem(sys.modules, module, None)
    message = rf"{package} is needed for this, and is not installed: {re.escape(install_command('volumes'))}"
    with pytest.raises(InputFileError, match=message):
        read_volume_mesh(path, 0)
