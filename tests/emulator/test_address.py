"""The options of an ``emulator:`` URL, and the errors for those that cannot be."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from phasewire.base.errors import DeviceNotFoundError, ImageError, InputFileError
from phasewire.emulator.boards.executed import ExecutedProcessor
from phasewire.emulator.doors.address import EmulatorUrl
from phasewire.emulator.firmware.loader import DeviceIdentity, boot, make_flash
from phasewire.firmware.xmos.images import device_image
from phasewire.protocol.enumeration import FULL_SPEED
from phasewire.protocol.firmware import build
from phasewire.protocol.timing import TWO_WIRE
from phasewire.protocol.wiring import Wiring


def test_all_options_of_a_fresh_device() -> None:
    url = "emulator:?link=2wire&speed=full&firmware=xs1&faults=a%20b/c.toml&door=serial&baud=3000000"
    assert EmulatorUrl.parse(url) == EmulatorUrl("", TWO_WIRE, FULL_SPEED, "xs1", Path("a b/c.toml"), 3_000_000)
    assert EmulatorUrl.parse("emulator:?firmware=a%20b/new.dfu").firmware == Path("a b/new.dfu")


@pytest.mark.parametrize(
    ("url", "message"),
    [
        (
            "emulator:?sped=full",
            "the emulator has no option 'sped'; it has link=5wire or 2wire, speed=high or full, firmware=model, xs1 or "
            "FILE.dfu, faults=FILE, door=usb or serial, baud=RATE (of door=serial)",
        ),
        ("emulator:E?sped=1", "no option 'sped'; it has door=usb or serial, baud=RATE (of door=serial)"),
        ("emulator:?link=3wire", "unknown link '3wire'; known are 5wire, 2wire"),
        ("emulator:?speed=low", "unknown speed 'low'; known are high, full"),
        ("emulator:?firmware=xs2", "unknown firmware 'xs2'; known are model, xs1 or FILE.dfu"),
        ("emulator:?firmware=", "unknown firmware ''; known are"),
        ("emulator:?door=window", "unknown door 'window'; known are usb, serial"),
        ("emulator:?baud=9600", "baud goes with door=serial"),
        ("emulator:?door=serial&baud=0", "baud '0'; a serial line has 1 to 12000000"),
        ("emulator:?door=serial&baud=12000001", "baud '12000001'; a serial line has 1 to 12000000"),
        ("emulator:?door=serial&baud=²", "baud '²'; a serial line has"),
        ("emulator:?door=serial&baud=", "baud ''; a serial line has"),
        ("emulator:EMU-1?link=2wire", "link goes with a fresh emulator, not with one that is plugged in"),
        ("emulator:EMU-1?firmware=xs1", "firmware goes with a fresh emulator"),
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


def test_a_fresh_device_executes_the_firmware_of_a_file(tmp_path: Path) -> None:
    file = tmp_path / "new.dfu"
    image = device_image((1, 2, 3))
    file.write_bytes(build(image))
    url = EmulatorUrl.parse(f"emulator:?firmware={file}")
    for emulator in (url.make(), url.make(make_flash(DeviceIdentity("FILE-1", Wiring.strips()), image))):
        assert boot(emulator.flash).image == image
        assert all(isinstance(processor, ExecutedProcessor) for processor in emulator.processors)


def test_firmware_that_cannot_be_used_is_named(tmp_path: Path) -> None:
    missing = tmp_path / "missing.dfu"
    with pytest.raises(InputFileError, match=r"missing\.dfu cannot be read: No such file"):
        EmulatorUrl.parse(f"emulator:?firmware={missing}").make()
    wrong = tmp_path / "wrong.dfu"
    wrong.write_bytes(b"no image")
    with pytest.raises(ImageError, match=r"wrong\.dfu: .*suffix"):
        EmulatorUrl.parse(f"emulator:?firmware={wrong}").make()
