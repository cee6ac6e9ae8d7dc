"""The journal: whatever a kill leaves of it, the next run reads a part of what was written, and no more."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from phasewire.base.errors import InputFileError
from phasewire.hil.sweep.journal import Journal, RowResult
from phasewire.hil.sweep.measures import Measures

ROWS = 9
NUMBERS = st.floats(allow_nan=False)
RESULTS = st.builds(
    RowResult,
    st.builds(Measures, NUMBERS, NUMBERS, NUMBERS, st.none() | NUMBERS, st.integers(0, 2**40), st.none() | NUMBERS),
    st.none(),
) | st.builds(RowResult, st.none(), st.text())


@settings(max_examples=25)
@given(done=st.dictionaries(st.integers(0, ROWS - 1), RESULTS, min_size=1), data=st.data())
def test_a_journal_that_is_cut_anywhere_keeps_every_whole_row_and_goes_on(
    done: dict[int, RowResult], data: st.DataObject
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "r.unfinished"
        with Journal(path, "abc", ROWS) as journal:
            for row, result in done.items():
                journal.add(row, result)
        whole = path.read_bytes()
        ends = [place for place, byte in enumerate(whole) if byte == ord("\n")]
        cut = data.draw(st.integers(0, len(whole)) | st.sampled_from(ends))
        path.write_bytes(whole[:cut] + data.draw(st.sampled_from([b"", b"\0\0\0", b"[7, null\n", b"[3, [1], null]\n"])))
        kept = max(whole[:cut].count(b"\n") - 1, 0)
        if cut > whole.index(b"\n"):
            with Journal(path, "abc", ROWS) as journal:
                assert list(journal.done.items()) == list(done.items())[:kept]
                for row, result in done.items():
                    journal.add(row, result)
            with Journal(path, "abc", ROWS) as journal:
                assert journal.done == done


def test_a_header_that_was_cut_begins_anew(tmp_path: Path) -> None:
    with Journal(tmp_path / "j", "abc", ROWS) as journal:
        journal.add(0, RowResult(None, "why"))
    header = (tmp_path / "j").read_bytes().partition(b"\n")[0]
    for cut in (0, 1, len(header)):
        (tmp_path / "j").write_bytes(header[:cut])
        with Journal(tmp_path / "j", "abc", ROWS) as journal:
            assert journal.done == {}
            journal.add(3, RowResult(None, "why"))
        with Journal(tmp_path / "j", "abc", ROWS) as journal:
            assert journal.done == {3: RowResult(None, "why")}


@pytest.mark.parametrize("content", [b"a text of mine", b"{}\n", b"\x89PNG\r\n\x1a\n", b"[" * 5000, b"null\n" * 3])
def test_a_file_that_is_no_journal_is_refused_and_left_alone(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "j").write_bytes(content)
    with pytest.raises(InputFileError, match="is not of this sweep"):
        Journal(tmp_path / "j", "abc", ROWS)
    assert (tmp_path / "j").read_bytes() == content


@pytest.mark.parametrize(("fingerprint", "rows"), [("abd", ROWS), ("abc", ROWS + 1)])
def test_a_journal_of_another_sweep_is_refused(fingerprint: str, rows: int, tmp_path: Path) -> None:
    with Journal(tmp_path / "j", "abc", ROWS) as journal:
        journal.add(0, RowResult(None, "why"))
    with pytest.raises(InputFileError, match=r"is not of this sweep.*; delete it, or name another output"):
        Journal(tmp_path / "j", fingerprint, rows)


def test_two_runs_cannot_write_one_journal(tmp_path: Path) -> None:
    with Journal(tmp_path / "j", "abc", ROWS) as journal:
        journal.add(0, RowResult(None, "why"))
        with pytest.raises(BlockingIOError, match=r"is in use by process \d+; wait until it has ended"):
            Journal(tmp_path / "j", "abc", ROWS)
    with Journal(tmp_path / "j", "abc", ROWS) as journal:
        assert len(journal.done) == 1


def test_a_folder_and_a_device_are_refused(tmp_path: Path) -> None:
    with pytest.raises(IsADirectoryError):
        Journal(tmp_path, "abc", ROWS)
    (tmp_path / "j").symlink_to("/dev/full")
    with pytest.raises(InputFileError, match="must be a plain file"):
        Journal(tmp_path / "j", "abc", ROWS)


@pytest.mark.parametrize(
    "damaged",
    [
        "{bad",
        "[2, [1.5, 1.0, 0.1, null, true, 40.0], null]",
        "[2, [1.5, 1.0, 0.1, null, 1000000000000000000000, 40.0], null]",
        "[2, [1.5, NaN, 0.1, null, 3, 40.0], null]",
        '[2, null, "\\ud800"]',
    ],
)
def test_a_damaged_row_is_measured_again_and_the_others_stay(damaged: str, tmp_path: Path) -> None:
    with Journal(tmp_path / "j", "abc", ROWS) as journal:
        for row in range(4):
            journal.add(row, RowResult(None, "why"))
    lines = (tmp_path / "j").read_text().splitlines(keepends=True)
    (tmp_path / "j").write_text("".join([*lines[:3], damaged + "\n", *lines[4:]]))
    with Journal(tmp_path / "j", "abc", ROWS) as journal:
        assert list(journal.done) == [0, 1, 3]
