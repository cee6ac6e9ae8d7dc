"""Files of sweeps: their rows, and the complaints about bad ones."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest
from phasewire.base.errors import InputFileError
from phasewire.hil.sweep.design import Design
from phasewire.hil.sweep.files import MOST_ROWS, Sweep, read_sweep

SOURCE = 'source = "circle:radius=0.03"\n'


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def read(text: str, name: str = "sweep.toml") -> Sweep:
    Path(name).write_text(text)
    return read_sweep(name)


def refused(text: str, name: str = "sweep.toml") -> str:
    with pytest.raises(InputFileError, match=f"^{name}: ") as raised:
        read(text, name)
    return str(raised.value)


def test_rows_are_the_designs_with_each_value_of_each_axis() -> None:
    sweep = read(
        SOURCE + 'method = "tikhonov"\n[[design]]\ncolumns = 10\nrows = 8\n[[design]]\n'
        "[grid]\npitch_mm = [9, 10.3]\nseed = {from = 1, to = 3, count = 3}\n"
    )
    expected = [
        Design(source="circle:radius=0.03", method="tikhonov", columns=columns, rows=rows, pitch_mm=pitch, seed=seed)
        for (columns, rows), pitch, seed in itertools.product([(10, 8), (20, 16)], [9, 10.3], [1, 2, 3])
    ]
    assert list(sweep.designs) == expected
    assert sweep.swept == ("columns", "rows", "pitch_mm", "seed")
    assert len(sweep.points["circle:radius=0.03"]) == 13


def test_a_table_of_designs_may_stand_alone_or_be_named_and_leaves_empty_cells_as_they_are() -> None:
    table = "# which arrays\nsource, columns , rows,quantisation\nstar,10,8,4\n\nstar,,,pulses\n"
    alone = read(table, "designs.csv")
    assert alone.designs == (
        Design(source="star", columns=10, rows=8, quantisation="4"),
        Design(source="star", quantisation="pulses"),
    )
    named = read('table = "designs.csv"\n[grid]\nseed = [0, 5]\n')
    assert [(design.columns, design.seed) for design in named.designs] == [(10, 0), (10, 5), (20, 0), (20, 5)]


def test_a_file_of_points_is_searched_beside_the_sweep() -> None:
    Path("inner").mkdir()
    Path("inner/two.csv").write_text("x,y,z,amplitude\n0,0,0.2,1\n0.03,0,0.2,0.5\n")
    sweep = read('source = "two.csv"\n', "inner/sweep.toml")
    assert sweep.points["two.csv"].amplitudes.tolist() == [1, 0.5]


def test_all_bad_rows_are_named_by_number_field_value_and_what_would_be_right() -> None:
    said = refused(SOURCE + "[grid]\npitch_mm = [-1, 10.3, 5000]\nquantisation = [1, 4]\n")
    narrow, wide = (f"pitch_mm is {pitch} mm; it must be from 1 to 100 mm" for pitch in ("-1.0", "5000.0"))
    coarse = "quantisation is '1'; it must be none, pulses or a whole number of phases from 2 to 4096"
    assert said.splitlines() == [
        "sweep.toml: 5 of 6 rows cannot be computed",
        f"  row 0: {narrow}; {coarse}",
        f"  row 1: {narrow}",
        f"  row 2: {coarse}",
        f"  row 4: {wide}; {coarse}",
        f"  row 5: {wide}",
    ]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('source = "hexagon"', "row 0: source 'hexagon': unknown shape 'hexagon'"),
        ('source = "none.csv"', "row 0: source 'none.csv': .*No such file"),
        ('source = "circle:height=3"', "row 0: source 'circle:height=3': .* is out of reach"),
        ('source = "circle:height=0.001,radius=0.02"', "closer to a transducer than"),
        ("pitch_mm = 9", "row 0: source is missing; it must be a shape such as"),
        (SOURCE + "colums = 3", "there is no field 'colums'; the fields are grid, design, table, source"),
        (SOURCE + "[grid]\ncolums = [3]", "row 0: there is no field 'colums'; the fields are source"),
        (SOURCE + "[grid]\npitch_mm = []", "the axis pitch_mm must be a list of values, or such as"),
        (SOURCE + "[grid]\npitch_mm = 3", "the axis pitch_mm must be a list of values, or such as"),
        (SOURCE + "[grid]\npitch_mm = {from = 1, to = 2}", "the axis pitch_mm must be a list of values"),
        (SOURCE + "[grid]\npitch_mm = {from = 1, to = 2, count = 1}", "has count 1; it must be a whole number from 2"),
        (SOURCE + "[grid]\npitch_mm = {from = 1, to = nan, count = 3}", "goes from 1 to nan; both must be finite"),
        (
            SOURCE + "[grid]\ncolumns = {from = 1, to = 2, count = 3}",
            "row 1: columns is 1.5; it must be",
        ),
        (
            SOURCE + "pitch_mm = 9\n[grid]\npitch_mm = [9]",
            r"pitch_mm is given at the top and in \[grid\]",
        ),
        (SOURCE + "[[design]]\nseed = 1\n[grid]\nseed = [1]", r"seed is given at \[grid\] and in the designs"),
        (SOURCE + "grid = 3", r"grid must be a table, which begins with \[grid\]"),
        (SOURCE + "design = [3]", r"design must be a list of tables, each of which begins with \[\[design\]\]"),
        (SOURCE + 'table = "x.parquet"', "table is 'x.parquet'; it must be the name of a .csv file"),
        (SOURCE + 'table = "x.csv"', "table 'x.csv' cannot be read: No such file"),
        (SOURCE + 'table = "x.csv"\n[[design]]', r"table and \[\[design\]\] exclude each other"),
        (
            SOURCE + "[grid]\n" + "".join(f"{name} = {{from = 1, to = 9, count = 99}}\n" for name in "abcd"),
            "96059601 rows",
        ),
        (SOURCE + 'columns = 100\nrows = 100\nmethod = "paper"', "transducers are too many"),
    ],
)
def test_what_is_wrong_with_a_file_is_said(text: str, says: str) -> None:
    with pytest.raises(InputFileError, match=rf"(?s)^sweep.toml: .*{says}"):
        read(text)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("source,columns\n", "it has no designs"),
        ("source,colums\nstar,3\n", "line 1: there is no field 'colums'"),
        ("source,source\nstar,star\n", "line 1 names source twice"),
        ("source,columns\nstar\n", "line 2 has 1 cells; it must have 2: source,columns"),
        ("columns\n" + "3\n" * (MOST_ROWS + 1), f"it has {MOST_ROWS + 1} rows; at most {MOST_ROWS}"),
    ],
)
def test_what_is_wrong_with_a_table_is_said(text: str, says: str) -> None:
    assert says in refused(text, "designs.csv")


def test_another_kind_of_file_is_refused() -> None:
    Path("sweep.json").write_text("{}")
    with pytest.raises(InputFileError, match=r"^sweep.json: a sweep is read from a .toml or .csv file"):
        read_sweep("sweep.json")


def test_a_thousand_different_problems_are_named_shortly() -> None:
    said = refused("source,columns\n" + "".join(f"star,{-row - 1}\n" for row in range(1000)), "designs.csv")
    lines = said.splitlines()
    assert len(lines) == 52
    assert lines[-1] == "  rows 50 to 999: similar problems"


def test_a_fingerprint_is_of_rows_points_and_version_not_of_the_text() -> None:
    Path("p.csv").write_text("x,y,z\n0,0,0.2\n")
    first = read('source = "p.csv"\npitch_mm = 9\n').fingerprint("1")
    assert read('# a note\npitch_mm = 9.0\nsource = "p.csv"\n').fingerprint("1") == first
    assert read('source = "p.csv"\npitch_mm = 9\n').fingerprint("2") != first
    assert read('source = "p.csv"\npitch_mm = 9.5\n').fingerprint("1") != first
    Path("p.csv").write_text("x,y,z\n0,0,0.21\n")
    assert read('source = "p.csv"\npitch_mm = 9\n').fingerprint("1") != first
