"""Rig files: the devices and places that they name, and an error for each field that is wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from phasewire import Calibration, RigDevice, TransducerArray, read_rig
from phasewire.base.errors import InputFileError
from phasewire.host.streaming.rig import check_rig

EXAMPLES = Path(__file__).parents[2] / "examples/arrays"
TWO = """
[[device]]
url = "usb:A"

[[device]]
url = "usb:B"
translation_mm = [0, 0, 200]
rotation_degrees = [180, 0, 0]
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "rig.toml"
    path.write_text(text)
    return path


def test_a_device_without_panels_is_a_board_in_its_place(tmp_path: Path) -> None:
    below, above = read_rig(written(tmp_path, TWO))
    board = TransducerArray.grid().positions
    assert (below.url, below.name, above.url, above.name) == ("usb:A", "device 1", "usb:B", "device 2")
    np.testing.assert_array_equal(below.array.positions, board)
    np.testing.assert_allclose(above.array.positions, board * [1, -1, -1] + [0, 0, 0.2], atol=1e-15)
    np.testing.assert_allclose(above.array.normals, np.tile([0, 0, -1], (320, 1)), atol=1e-15)


def test_panels_of_a_device_are_placed_and_then_the_device_as_a_whole(tmp_path: Path) -> None:
    (tmp_path / "pair.csv").write_text("x,y,z\n0.01,0,0\n-0.01,0,0\n")
    Calibration.perfect(4).save(tmp_path / "four.csv")
    (rig,) = read_rig(
        written(
            tmp_path,
            '[[device]]\nurl = "usb:A"\nname = "ring"\ncalibration = "four.csv"\nchannels = [7, 5, 300, 0]\n'
            "rotation_degrees = [0, 0, 90]\ntranslation_m = [1, 0, 0]\n"
            '[[device.panel]]\nfile = "pair.csv"\n'
            '[[device.panel]]\nfile = "pair.csv"\ntranslation_mm = [0, 20, 0]\n',
        )
    )
    expected = [[1, 0.01, 0], [1, -0.01, 0], [0.98, 0.01, 0], [0.98, -0.01, 0]]
    np.testing.assert_allclose(rig.array.positions, expected, atol=1e-15)
    assert rig.name == "ring"
    assert rig.calibration == Calibration.perfect(4)
    assert rig.channels is not None
    assert rig.channels.tolist() == [7, 5, 300, 0]


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*devices*.toml")), ids=lambda path: path.name)
def test_the_examples_are_rigs(path: Path) -> None:
    assert len(read_rig(path)) >= 2


FIRST = '[[device]]\nurl = "usb:A"\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[[panel]]\ncolumns = 3\nrows = 2\npitch_mm = 10\n", r"it has no devices; each begins with \[\[device\]\]"),
        ("device = 3\n", r"it has no devices; each begins with \[\[device\]\]"),
        ("device = [3]\n", r"3 is no table; each device begins with \[\[device\]\]"),
        (FIRST + "[[panel]]\ncolumns = 3\n", r"\[\[panel\]\] and \[\[device\]\] exclude each other"),
        ("[[device]]\nname = 'left'\n", "device 1: url is missing; it must be text, such as 'usb:SERIAL'"),
        (TWO + "url2 = 1\n", "device 2: there is no field 'url2'; the fields are url, name, calibration, channels, pa"),
        (FIRST + "name = 3\n", "device 1: name is 3; it must be text, such as 'left'"),
        (FIRST + "calibration = 'no.csv'\n", "device 1: calibration 'no.csv' cannot be read: No such file"),
        (FIRST + "channels = [1, 2]\n", "device 1: channels must be 320 whole numbers from 0 on"),
        (FIRST + "columns = 2\nrows = 1\npitch_mm = 10\nchannels = [4, 4]\n", "device 1: channel 4 is named twice"),
        (
            FIRST + "columns = 2\nrows = 1\npitch_mm = 10\nchannels = 'x'\n",
            "device 1: channels must be 2 whole numbers",
        ),
        (FIRST + "columns = 2\n", "device 1: rows is None; it must be a whole number"),
        (FIRST + "columns = 2\n[[device.panel]]\nrows = 2\n", r"columns and \[\[device.panel\]\] exclude each other"),
        (FIRST + "[[device.panel]]\ncolumns = 2\nrows = 3\n", "device 1: panel 1: it has no pitch"),
        (FIRST + "panel = []\n", r"device 1: it has no panels; each begins with \[\[device.panel\]\]"),
        (FIRST + "rotation_degrees = 3\n", "device 1: rotation_degrees is 3; it must be three finite numbers"),
        (FIRST + FIRST + "translation_mm = [0, 0, 9]\n", "devices 1 and 2 have the same url 'usb:A'"),
        (FIRST + "name='l'\n" + TWO.replace("usb:A", "usb:C") + "name='l'\n", "devices 1 and 3 have the same name 'l'"),
        (TWO.replace("200", "0"), r"transducers \d+ and \d+ are both at"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputFileError, match=rf"rig.toml(, |: ).*{message}"):
        read_rig(written(tmp_path, text.replace("turn = 1\n", "")))


def test_a_calibration_is_for_the_transducers_of_its_device() -> None:
    with pytest.raises(ValueError, match="the calibration is for 4 transducers, there are 320"):
        RigDevice("usb:A", calibration=Calibration.perfect(4))


def test_fresh_emulated_devices_may_have_the_same_url() -> None:
    board = TransducerArray.grid()
    check_rig([RigDevice("emulator:", board), RigDevice("emulator:", board.moved([0, 0, 0.1]))])


@pytest.mark.parametrize("count", [0, 65])
def test_there_are_1_to_64_devices(count: int) -> None:
    with pytest.raises(ValueError, match=f"a rig has 1 to 64 devices, not {count}"):
        check_rig([RigDevice(f"usb:{number}") for number in range(count)])
