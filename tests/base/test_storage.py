from __future__ import annotations

import errno
import gc
import itertools
import os
import resource
import stat
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from zipfile import ZipFile

import numpy as np
import phasewire as pw
import pytest
from phasewire.base import storage
from phasewire.base.pictures import new_figure, save_figure
from phasewire.base.storage import check_outputs, claimed, open_zip, real_path, replacing
from phasewire.cli.commands import message
from phasewire.cli.console import write_json
from phasewire.emulator.firmware.flash import Flash
from phasewire.emulator.ports.export import export
from phasewire.firmware.xs1.vcd import write_port_vcd
from phasewire.hil.sweep.design import Design
from phasewire.hil.sweep.files import Sweep
from phasewire.hil.sweep.journal import RowResult
from phasewire.hil.sweep.results import write_results
from phasewire.host.hands.frames import HandFrame, TrackedHand
from phasewire.host.hands.recording import HandRecorder, HandRecording
from phasewire.host.streaming.recording import Recording
from phasewire.host.touching.log import TouchLog
from phasewire.protocol.quantise import PulseFrames


def test_an_uncompressed_member_is_read_in_pieces(tmp_path: Path) -> None:
    """However much is asked for at once, such as a recording's samples of some periods."""
    data = bytes(range(256)) * 40_000  # 10 MB
    with ZipFile(tmp_path / "run.sr", "w") as archive:
        archive.writestr("logic-1-1", data)
    with open_zip(tmp_path / "run.sr", "damaged") as archive, archive.open("logic-1-1") as member:
        assert member.read(5_000_000) + member.read(5_240_000) == data


def test_a_new_file_has_the_usual_mode(tmp_path: Path) -> None:
    plain = tmp_path / "plain"
    plain.touch()
    with replacing(tmp_path / "a.txt") as part:
        part.write_text("x")
    assert stat.S_IMODE((tmp_path / "a.txt").stat().st_mode) == stat.S_IMODE(plain.stat().st_mode)


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
    for folder in ("folder", "", "."):
        with pytest.raises(IsADirectoryError, match=f"'{folder}' cannot be written: it is a folder"):
            check_outputs([folder])
    for name in ("in.csv", "link.csv", "folder/../in.csv"):
        with pytest.raises(ValueError, match="cannot be written: it is also what is read"):
            check_outputs([name], inputs=[Path("in.csv")])
    with pytest.raises(ValueError, match=r"b\.npz cannot be written: it is to be written twice"):
        check_outputs(["b.npz", Path("folder/../b.npz")])


# All outputs


@pytest.fixture(scope="module")
def made(sphere_solution: pw.Solution) -> SimpleNamespace:
    """What is written."""
    with pw.Emulator() as emulator:
        emulator.run(2)
        return SimpleNamespace(
            solution=sphere_solution,
            field=pw.sample_plane(sphere_solution.array, sphere_solution.drive, 0.2, 0.02, 0.01),
            capture=emulator.capture(),
        )


FRAME = HandFrame(0.0, (TrackedHand(pw.Hand.flat(), 1),))


def _hands(path: str, _made: object) -> None:
    with HandRecorder(path, 60) as recorder:
        for _ in range(100):
            recorder.write(FRAME)


def _touch(path: str, _made: object) -> None:
    zeros = np.zeros((40, 320), np.uint8)
    fading = SimpleNamespace(ids=np.arange(1), positions=np.zeros((1, 3)), amplitudes=np.ones(1), levels=np.ones(1))
    cycle = SimpleNamespace(frames=PulseFrames(zeros, zeros), hold=1, envelope=0.0)
    with TouchLog(path, 60, "am", "") as log:
        for _ in range(10):
            log(SimpleNamespace(frame=FRAME, time=0.0, fading=fading, cycle=cycle))  # type: ignore[arg-type]


def _frames(path: str, _made: object) -> None:
    pw.record(path, itertools.repeat(np.zeros(320, complex), 3000), 1000)


def _picture(path: str, _made: object) -> None:
    figure = new_figure(1.0, 1.0)
    figure.subplots().plot([0, 1])
    save_figure(figure, path)


def _sweep(path: str, _made: object) -> None:
    pytest.importorskip("pyarrow")
    write_results(path, Sweep((Design(source="point"),), {}), {0: RowResult(None, "why")}, "print")


DOORS: dict[str, Callable[[str, Any], object]] = {
    "a.png": _picture,
    "a.svg": _picture,
    "a.pdf": _picture,
    "solved.npz": lambda path, made: pw.save_solution(path, made.solution),
    "field.vti": lambda path, made: pw.save_vti(path, made.field),
    "perfect.csv": lambda path, _: pw.Calibration.perfect(4).save(path),
    "a.frames": _frames,
    "a.hands": _hands,
    "b.hands": _touch,
    "flash.bin": lambda path, _: Flash().save(path),
    "capture.vcd": lambda path, made: export(made.capture, path),
    "capture.sr": lambda path, made: export(made.capture, path),
    "core.vcd": lambda path, _: write_port_vcd(path, {0x10200: (np.arange(9), np.ones(9, np.uint32))}, 100),
    "r.parquet": _sweep,
    "a.json": lambda path, _: write_json(path, {"format": "some-record-1"}),
}
"""Every writer of a file of its own, by a name for it: the function, which takes the name as text."""


@contextmanager
def _full_disk(most_bytes: int = 16) -> Iterator[None]:
    """The system refuses to let a file grow further, as on a full disk: whatever library writes it."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@contextmanager
def _by_another(path: Path) -> Iterator[None]:
    """Another program claims the file: this one has not."""
    with claimed(path), pytest.MonkeyPatch.context() as patch:
        patch.setattr(storage, "_claims", set())
        patch.setattr(storage, "LOCK_PATIENCE", 0.0)
        yield


@contextmanager
def _read_only_folder(path: Path) -> Iterator[None]:
    """Root may write everywhere, but a system that says no is believed."""
    with pytest.MonkeyPatch.context() as patch:
        access = os.access
        patch.setattr(os, "access", lambda where, mode: where != real_path(path.parent) and access(where, mode))
        yield


@contextmanager
def _instead(path: Path, make: Callable[[Path], object], undo: Callable[[Path], object]) -> Iterator[None]:
    path.unlink()
    make(path)
    try:
        yield
    finally:
        undo(path)
        path.write_text("old")


@contextmanager
def _without_folder(path: Path) -> Iterator[None]:
    path.parent.rename("elsewhere")
    yield
    Path("elsewhere").rename(path.parent)


@contextmanager
def _write_protected(path: Path) -> Iterator[None]:
    path.chmod(0o444)
    yield
    path.chmod(0o644)


TROUBLES: dict[str, tuple[Callable[[Path], Any], str]] = {
    "full disk": (lambda _: _full_disk(), os.strerror(errno.EFBIG)),
    "write-protected": (_write_protected, "it is write-protected; name another file, or allow it by chmod"),
    "read-only folder": (_read_only_folder, "its folder is read-only"),
    "missing folder": (_without_folder, "there is no folder"),
    "loop of links": (lambda path: _instead(path, lambda it: it.symlink_to(it.name), Path.unlink), "back to itself"),
    "a folder": (lambda path: _instead(path, Path.mkdir, Path.rmdir), "it is a folder|must be a plain file"),
    "in use": (_by_another, rf"is in use by process {os.getpid()}; wait until it has ended"),
}


@pytest.mark.slow
@pytest.mark.parametrize("trouble", TROUBLES)
@pytest.mark.parametrize("name", DOORS)
def test_an_output_that_cannot_be_written_stays_as_it_was(
    name: str, trouble: str, made: SimpleNamespace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = Path("folder", name)
    path.parent.mkdir()
    path.write_text("old")
    begin, said = TROUBLES[trouble]
    with begin(path), pytest.raises(OSError, match=said) as error:
        DOORS[name](str(path), made)
    assert str(path) in message(error.value)
    gc.collect()  # a writer that fails a second time when it is deleted becomes an error here
    assert {file.name: file.read_text() for file in path.parent.iterdir()} == {name: "old"}


@pytest.mark.parametrize("name", DOORS)
def test_an_output_is_written_whole_and_named_by_text(name: str, made: SimpleNamespace, tmp_path: Path) -> None:
    (tmp_path / name).write_text("old")
    (tmp_path / name).chmod(0o640)
    DOORS[name](str(tmp_path / name), made)
    assert (tmp_path / name).stat().st_size > 3
    assert stat.S_IMODE((tmp_path / name).stat().st_mode) == 0o640
    assert {file.stem for file in tmp_path.iterdir()} == {Path(name).stem}


@pytest.mark.parametrize("recorder", [HandRecorder(Path("a.hands"), 60), TouchLog(Path("a.hands"), 60, "am", "")])
@pytest.mark.parametrize("failure", [KeyboardInterrupt, pw.PhasewireError])
def test_what_fails_before_the_first_frame_replaces_no_recording(
    recorder: Any, failure: type[BaseException], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("a.hands", "a.touch"):
        Path(name).write_text("old")
    with pytest.raises(failure), recorder:
        raise failure
    assert {file.name: file.read_text() for file in Path().iterdir()} == {"a.hands": "old", "a.touch": "old"}


@pytest.mark.parametrize(("name", "room"), [("a.frames", 700_000), ("a.hands", 20_000), ("b.hands", 100_000)])
def test_what_was_recorded_before_the_disk_was_full_is_kept_beside_the_old_one(
    name: str, room: int, made: SimpleNamespace, tmp_path: Path
) -> None:
    path, log = tmp_path / name, tmp_path / "b.touch"
    kept = path.with_name(f"{path.stem}.part1{path.suffix}")
    old = {path, path.with_name(f"{path.stem}.part{path.suffix}")} | ({log} if name == "b.hands" else set())
    for file in old:
        file.write_text("old")
    with _full_disk(room), pytest.raises(OSError, match=f"what was written is kept in {kept}") as error:
        DOORS[name](str(path), made)
    assert error.value.filename == str(path)
    assert {file.read_text() for file in old} == {"old"}
    beside = {log.with_name("b.part.touch")} if name == "b.hands" else set()
    assert set(tmp_path.iterdir()) == {*old, kept, *beside}
    opened = (Recording if name == "a.frames" else HandRecording).open(kept)
    with opened:
        assert not opened.complete
        assert len(list(opened) if isinstance(opened, HandRecording) else opened) > 1


def test_a_claim_ends_with_its_process_and_is_told_by_its_number(tmp_path: Path) -> None:
    path = tmp_path / "flash.bin"
    code = (
        "import sys; from phasewire.base.storage import claimed\n"
        f"with claimed({str(path)!r}): print('held', flush=True); sys.stdin.read()"
    )
    other = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    try:
        assert other.stdout is not None
        assert other.stdout.readline() == b"held\n"
        with pytest.raises(BlockingIOError, match=f"is in use by process {other.pid};"), claimed(path):
            pass
    finally:
        other.kill()
        other.communicate()
    with claimed(path), replacing(path) as part:  # its own claim does not hinder it
        part.write_text("new")
    assert [file.name for file in tmp_path.iterdir()] == ["flash.bin"]
