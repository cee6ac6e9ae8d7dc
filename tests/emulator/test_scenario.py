from __future__ import annotations

import re
from pathlib import Path

import pytest
from phasewire import Emulator
from phasewire.base.errors import InputFileError
from phasewire.emulator import Event, faults, read_scenario
from phasewire.protocol import Reason, Update

from tests.emulator.fault_bench import HALF, playing

DOCUMENT = (Path(__file__).parents[2] / "docs" / "reference/faults.md").read_text(encoding="utf-8")

SCENARIO = """
[[fault]]
name = "lost-token"
message = "slice"
processor = 3
period = 200
times = 3

[[fault]]
name = "clock-error"
board = 1
ppm = -20.5
period = 300

[[fault]]
name = "stuck-high"
processor = 5
bit = 7
period = 400
periods = 1000

[[fault]]
name = "power-cut"
period = 9000
periods = 40

[[fault]]
name = "hot-board"
board = 4
celsius = 99
period = 9500
"""


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "scenario.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_scenario_is_a_list_of_faults(tmp_path: Path) -> None:
    assert read_scenario(write(tmp_path, SCENARIO)) == (
        faults.LostToken(message="slice", processor=3, period=200, times=3),
        faults.ClockError(board=1, ppm=-20.5, period=300),
        faults.StuckHigh(processor=5, bit=7, period=400, periods=1000),
        faults.PowerCut(period=9000, periods=40),
        faults.HotBoard(board=4, celsius=99, period=9500),
    )
    assert read_scenario(write(tmp_path, "# nothing goes wrong\n")) == ()


def test_two_runs_of_a_scenario_are_alike(tmp_path: Path) -> None:
    path = write(tmp_path, SCENARIO)

    def run() -> tuple[list[bytes], list[Event]]:
        bench = playing()
        bench.emulator.inject(*read_scenario(path))
        for _ in range(100):
            if bench.send(Update(HALF)).reason is not Reason.ACCEPTED:
                break
            bench.run_ms(1)
        bench.run_ms(150)
        captures = [*bench.emulator.past, bench.emulator.capture()]
        words = [capture.bits(0, capture.end_tick).tobytes() for capture in captures]
        return words, list(bench.emulator.events)

    first, second = run(), run()
    assert len(first[0]) == 2
    assert first == second
    assert sum(event.where == "fault" for event in first[1]) == 7


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (
            '[[fault]]\nname = "stuck-high"\nprocessor = 5\nbit = 40',
            ", fault 1: stuck-high: bit = 40; it must be 0 to 31",
        ),
        ('[[fault]]\nname = "stuck-high"\nprocessor = 5', ", fault 1: stuck-high: there is no bit; it must be 0 to 31"),
        (
            '[[fault]]\nname = "bus-reset"\n[[fault]]\nname = "bus-reset"\nboard = 3',
            ", fault 2: bus-reset: unknown board = 3; it has period",
        ),
        ('[[fault]]\nname = "dead"', ", fault 1: unknown name 'dead'; known are lost-token, doubled-token"),
        ("[[fault]]\nname = 3", ", fault 1: unknown name 3; known are"),
        ("[[fault]]\nperiod = 3", ", fault 1: it has no name; known are"),
        (
            '[[fault]]\nname = "bus-reset"\nperiod = 1.5',
            ", fault 1: bus-reset: period = 1.5; it must be a whole",
        ),
        (
            '[[fault]]\nname = "bus-reset"\nperiod = true',
            ", fault 1: bus-reset: period = True; it must be a whole",
        ),
        ('[[fault]]\nname = "lost-sync"\nboard = "2"', ", fault 1: lost-sync: board = '2'; it must be 0 to 4"),
        ('[fault]\nname = "bus-reset"', ": 'fault' is no list; each fault begins with [[fault]]"),
        ("fault = [3]", ", fault 1: 3 is no table"),
        ("seed = 3", ": unknown 'seed'; a scenario holds nothing but [[fault]] entries"),
        ("[[fault", " is no TOML file: Expected ']]'"),
        ("# \xff", " is no text in UTF-8: 'utf-8' codec can't decode"),
    ],
)
def test_an_error_names_what_is_wrong_with_a_file(tmp_path: Path, text: str, complaint: str) -> None:
    path = tmp_path / "scenario.toml"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(InputFileError, match="^" + re.escape(f"{path}{complaint}")):
        read_scenario(path)


def test_the_examples_of_the_document_run(tmp_path: Path) -> None:
    (python,) = re.findall(r"```python\n(.*?)```", DOCUMENT, re.DOTALL)
    (toml,) = re.findall(r"```toml\n(.*?)```", DOCUMENT, re.DOTALL)
    exec(compile(python, "faults.md", "exec"), {})
    listed = read_scenario(write(tmp_path, toml))
    assert [fault.name() for fault in listed] == ["stuck-high", "lost-token"]
    Emulator().inject(*listed)
