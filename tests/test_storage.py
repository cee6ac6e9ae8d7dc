from __future__ import annotations

import os
import stat
from collections.abc import Callable
from pathlib import Path
from zipfile import ZipFile

import phasewire as pw
import pytest
from phasewire.emulator.firmware.flash import Flash
from phasewire.emulator.ports.export import export
from phasewire.host.hands.recording import HandRecorder
from phasewire.host.touching.log import TouchLog
from phasewire.storage import check_outputs, open_zip, replacing


def test_a_file_is_replaced_whole(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old")
    with replacing(target) as part:
        part.write_text("new")
        assert target.read_text() == "old"
    assert target.read_text() == "new"
    assert list(tmp_path.iterdir()) == [target]


def test_an_uncompressed_member_is_read_in_pieces(tmp_path: Path) -> None:
    """However much is asked for at once, such as a recording's samples of some periods."""
    data = bytes(range(256)) * 40_000  # 10 MB
    with ZipFile(tmp_path / "run.sr", "w") as archive:
        archive.writestr("logic-1-1", data)
    with open_zip(tmp_path / "run.sr", "damaged") as archive, archive.open("logic-1-1") as member:
        assert member.read(5_000_000) + member.read(5_240_000) == data


def test_a_failure_leaves_the_old_file_alone(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old")

    def fail() -> None:
        with replacing(target) as part:
            part.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_new_file_has_the_usual_mode(tmp_path: Path) -> None:
    plain = tmp_path / "plain"
    plain.touch()
    with replacing(tmp_path / "a.txt") as part:
        part.write_text("x")
    assert stat.S_IMODE((tmp_path / "a.txt").stat().st_mode) == stat.S_IMODE(plain.stat().st_mode)


def test_an_existing_file_keeps_its_mode(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    target.touch(mode=0o600)
    with replacing(target) as part:
        part.write_text("x")
    assert stat.S_IMODE(target.stat().st_mode) == 0o600


def test_a_link_is_followed(tmp_path: Path) -> None:
    target, link = tmp_path / "a.txt", tmp_path / "link"
    link.symlink_to(target)
    for text in ("first", "second"):
        with replacing(link) as part:
            part.write_text(text)
        assert (link.is_symlink(), target.read_text()) == (True, text)


def test_a_pipe_stays_a_pipe(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        check_outputs([pipe])
        with replacing(pipe) as part:
            part.write_text("through")
        assert os.read(reader, 100) == b"through"
    finally:
        os.close(reader)
    assert pipe.is_fifo()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="only Linux has a disk that is always full")
def test_a_full_device_is_named() -> None:
    with pytest.raises(OSError, match="No space left on device: '/dev/full'"), replacing("/dev/full") as part:
        part.write_text("x")


def test_a_name_of_255_characters_works(tmp_path: Path) -> None:
    target = tmp_path / ("n" * 255)
    with replacing(target) as part:
        part.write_text("x")
    assert target.read_text() == "x"


def test_outputs_are_checked_before_any_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("in.csv").touch()
    Path("folder").mkdir()
    Path("link.csv").symlink_to("in.csv")
    check_outputs(["new.json", None, "-", Path("other.npz")], inputs=[Path("in.csv")])
    with pytest.raises(FileNotFoundError, match=r"nowhere/a\.txt cannot be written: there is no folder nowhere"):
        check_outputs(["nowhere/a.txt"])
    for folder in ("folder", "", "."):
        with pytest.raises(IsADirectoryError, match=f"'{folder}' cannot be written: it is a folder"):
            check_outputs([folder])
    for name in ("in.csv", "link.csv", "folder/../in.csv"):
        with pytest.raises(ValueError, match="cannot be written: it is also what is read"):
            check_outputs([name], inputs=[Path("in.csv")])
    with pytest.raises(ValueError, match=r"b\.npz cannot be written: it is to be written twice"):
        check_outputs(["b.npz", Path("folder/../b.npz")])
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(PermissionError, match="its folder is read-only"):
        check_outputs(["new.json"])


# Names as text


@pytest.fixture(scope="module")
def field(sphere_solution: pw.Solution) -> pw.PlaneField:
    return pw.sample_plane(sphere_solution.array, sphere_solution.drive, 0.2, 0.02, 0.01)


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("solved.npz", lambda path, field, solution: pw.save_solution(path, solution)),
        ("field.npz", lambda path, field, _: pw.save_field(path, field)),
        ("field.vti", lambda path, field, _: pw.save_vti(path, field)),
        ("field.png", lambda path, field, _: pw.save_field_picture(path, field, pw.Circle())),
        ("perfect.csv", lambda path, *_: pw.Calibration.perfect(4).save(path)),
        ("a.frames", lambda path, _, solution: pw.record(path, solution.drive[None], 40)),
        ("a.hands", lambda path, *_: HandRecorder(path, 60).__enter__().__exit__(None, None, None)),
        ("b.hands", lambda path, *_: TouchLog(path, 60, "am", "").__enter__().__exit__(None, None, None)),
        ("flash.bin", lambda path, *_: Flash().save(path)),
    ],
)
def test_a_file_may_be_named_by_text(
    name: str,
    write: Callable[[str, pw.PlaneField, pw.Solution], None],
    field: pw.PlaneField,
    sphere_solution: pw.Solution,
    tmp_path: Path,
) -> None:
    write(str(tmp_path / name), field, sphere_solution)
    assert (tmp_path / name).stat().st_size


@pytest.mark.parametrize("name", ["capture.vcd", "capture.sr"])
def test_a_capture_may_be_named_by_text(name: str, emulator: pw.Emulator, tmp_path: Path) -> None:
    emulator.run(2)
    export(emulator.capture(), str(tmp_path / name))
    assert (tmp_path / name).stat().st_size


def test_what_was_written_is_read_by_a_name_as_text(
    sphere_solution: pw.Solution, field: pw.PlaneField, tmp_path: Path
) -> None:
    pw.save_solution(tmp_path / "a.npz", sphere_solution)
    pw.save_field(tmp_path / "b.npz", field)
    assert (pw.load_solution(str(tmp_path / "a.npz")).drive == sphere_solution.drive).all()
    assert (pw.load_field(str(tmp_path / "b.npz")).pressure == field.pressure).all()
