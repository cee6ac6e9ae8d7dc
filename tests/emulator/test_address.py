"""The options of an ``emulator:`` URL, and the errors for those that cannot be."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from phasewire.emulator.doors.address import EmulatorUrl
from phasewire.errors import DeviceNotFoundError, InputFileError
from phasewire.protocol.enumeration import FULL_SPEED, HIGH_SPEED
from phasewire.protocol.timing import FIVE_WIRE, TWO_WIRE


def test_a_url_without_options_is_a_fresh_device_with_defaults() -> None:
    assert EmulatorUrl.parse("emulator:") == EmulatorUrl("", FIVE_WIRE, HIGH_SPEED, None, 115_200)


def test_all_options_of_a_fresh_device() -> None:
    url = "emulator:?link=2wire&speed=full&faults=a%20b/c.toml&door=serial&baud=3000000"
    assert EmulatorUrl.parse(url) == EmulatorUrl("", TWO_WIRE, FULL_SPEED, Path("a b/c.toml"), 3_000_000)


def test_a_plugged_in_device_takes_options_of_doors_only() -> None:
    assert EmulatorUrl.parse("emulator:EMU-1?door=serial&baud=9600").serial == "EMU-1"
    assert EmulatorUrl.parse("emulator:EMU-1?door=usb").baud == 115_200


@pytest.mark.parametrize(
    ("url", "message"),
    [
        (
            "emulator:?sped=full",
            "the emulator has no option 'sped'; it has link=5wire or 2wire, speed=high or full, faults=FILE, "
            "door=usb or serial, baud=RATE (of door=serial)",
        ),
        ("emulator:E?sped=1", "no option 'sped'; it has door=usb or serial, baud=RATE (of door=serial)"),
        ("emulator:?link=3wire", "unknown link '3wire'; known are 5wire, 2wire"),
        ("emulator:?speed=low", "unknown speed 'low'; known are high, full"),
        ("emulator:?door=window", "unknown door 'window'; known are usb, serial"),
        ("emulator:?baud=9600", "baud goes with door=serial"),
        ("emulator:?door=serial&baud=0", "baud '0'; a serial line has 1 to 12000000"),
        ("emulator:?door=serial&baud=12000001", "baud '12000001'; a serial line has 1 to 12000000"),
        ("emulator:?door=serial&baud=²", "baud '²'; a serial line has"),
        ("emulator:?door=serial&baud=", "baud ''; a serial line has"),
        ("emulator:EMU-1?link=2wire", "link goes with a fresh emulator, not with one that is plugged in"),
        ("emulator:EMU-1?faults=a.toml", "faults goes with a fresh emulator"),
    ],
)
def test_bad_options_are_named(url: str, message: str) -> None:
    with pytest.raises(DeviceNotFoundError, match=f"{re.escape(repr(url))}.*{re.escape(message)}"):
        EmulatorUrl.parse(url)


def test_a_fresh_device_gets_the_faults_of_its_scenario(tmp_path: Path) -> None:
    scenario = tmp_path / "scenario.toml"
    scenario.write_text('[[fault]]\nname = "dead-processor"\nprocessor = 3\nperiod = 4000\n')
    emulator = EmulatorUrl.parse(f"emulator:?faults={scenario}").make()
    emulator.run_until(3_999)
    assert not emulator.running.faults
    emulator.run_until(8_000)
    assert emulator.running.faults


def test_a_scenario_that_cannot_be_used_is_named(tmp_path: Path) -> None:
    missing = tmp_path / "missing.toml"
    with pytest.raises(InputFileError, match=r"missing\.toml cannot be read: No such file"):
        EmulatorUrl.parse(f"emulator:?faults={missing}").make()
    wrong = tmp_path / "wrong.toml"
    wrong.write_text("[[fault]]\n")
    with pytest.raises(InputFileError, match=r"wrong\.toml, fault 1: it has no name"):
        EmulatorUrl.parse(f"emulator:?faults={wrong}").make()
