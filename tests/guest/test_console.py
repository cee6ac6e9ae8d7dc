"""The kernel's serial driver and the console behind it."""

from __future__ import annotations

import pytest

from .conftest import Bench

pytestmark = pytest.mark.guest


def test_the_console_answers_through_the_kernels_driver(bench: Bench) -> None:
    bench.attach()
    said = bench.python(
        "import serial\n"
        "port = serial.Serial('/dev/ttyACM0', timeout=5)\n"
        "port.write(b'status\\r\\n')\n"
        "print(port.read_until(b'> ').decode(), port.read(200).decode())"
    )
    assert "OFF" in said
    assert bench.complaints() == []


def test_a_program_that_hangs_up_in_mid_answer_leaves_a_console_that_answers(bench: Bench) -> None:
    bench.attach()
    hang_up = "port = serial.Serial('/dev/ttyACM0')\nport.write(b'help\\r\\n' * 20)\nport.read(10)\nport.close()\n"
    ask = (
        "port = serial.Serial('/dev/ttyACM0', timeout=5)\n"
        "port.write(b'\\r\\nstatus\\r\\n')\n"
        "print(port.read(5000).decode())\n"
    )
    assert "OFF" in bench.python("import serial\n" + hang_up * 3 + ask)
    assert bench.complaints() == []
