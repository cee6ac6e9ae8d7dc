"""Names of ports against the list of facts, written by hand from the public header."""

import doctest
import re
import subprocess
import sys

import pytest
from phasewire.firmware.xs1 import names
from phasewire.firmware.xs1.names import PORT_IDS, parse_port, port_name, resource_name
from phasewire.firmware.xs1.resources import find
from phasewire.firmware.xs1.state import PORT_0, PORT_WIDTHS

HEADER = """
32A 0x200000 32B 0x200100 16A 0x100000 16B 0x100100 16C 0x100200 16D 0x100300
8A 0x80000 8B 0x80100 8C 0x80200 8D 0x80300
4A 0x40000 4B 0x40100 4C 0x40200 4D 0x40300 4E 0x40400 4F 0x40500
1A 0x10200 1B 0x10000 1C 0x10100 1D 0x10300 1E 0x10600 1F 0x10400 1G 0x10500 1H 0x10700
1I 0x10A00 1J 0x10800 1K 0x10900 1L 0x10B00 1M 0x10C00 1N 0x10D00 1O 0x10E00 1P 0x10F00
"""


def test_ports_have_the_identifiers_of_the_header() -> None:
    assert dict(PORT_IDS) == {name: int(number, 16) for name, number in re.findall(r"(\w+) (0x\w+)", HEADER)}


def test_every_port_is_one_of_the_core_s() -> None:
    places = [int(find.py_func(identifier)) - PORT_0 for identifier in PORT_IDS.values()]  # type: ignore[attr-defined]
    assert sorted(places) == list(range(len(PORT_WIDTHS)))
    assert [PORT_WIDTHS[place] for place in places] == [identifier >> 16 for identifier in PORT_IDS.values()]


def test_names_are_read_back() -> None:
    for name, identifier in PORT_IDS.items():
        assert port_name(identifier) == name
        assert parse_port(name) == parse_port(name.lower()) == parse_port(f"0x{identifier:x}") == identifier


@pytest.mark.parametrize("text", ["", "1Q", "2A", "32C", "0x10", "0x", "66560", "0x1040000000"])
def test_other_names_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match=rf"unknown port '{text}'; known are 1A to 1P.* such as 0x10400"):
        parse_port(text)


def test_resources_in_words() -> None:
    assert resource_name(0x10400) == "port 1F"
    assert resource_name(0x00FF0702) == "channel end 7"
    assert resource_name(0x301) == "timer 3"
    assert resource_name(0x106) == "clock block 1"
    assert resource_name(0x17) == "0x17"
    assert port_name(0x17) == "0x17"


def test_examples_run() -> None:
    assert doctest.testmod(names).failed == 0


@pytest.mark.parametrize(
    "module",
    [*(f"firmware.xs1.{name}" for name in ("names", "switch", "assembler", "disassembler", "debugger")), "cli.xs1"],
)
def test_only_what_executes_imports_numba(module: str) -> None:
    code = f"import sys, phasewire.{module}; print('numba' in sys.modules)"
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert ended.stdout.strip() == "False"
