"""Fixtures for the tests of projects that use phasewire; pytest loads this module if phasewire is installed.

pytest imports it at every start, so it imports nothing else of phasewire until a fixture is used. The conformance suite
has a plugin of its own, `hil/conformance/plugin.py`, and does not load this one.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from ..emulator import Emulator
    from ..host import Device

__all__ = ["phasewire_device", "phasewire_emulator", "pytest_addoption"]

OPTION = "--phasewire-device"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option that names the device under test."""
    parser.getgroup("phasewire").addoption(
        OPTION,
        metavar="URL",
        help="The device of the fixture phasewire_device, such as usb:; by default $PHASEWIRE_DEVICE, else emulator:.",
    )


@pytest.fixture
def phasewire_emulator() -> Iterator[Emulator]:
    """A new emulated device for each test, plugged in to this process; it is unplugged after the test."""
    from ..emulator import Emulator

    with Emulator() as emulator:
        yield emulator


@pytest.fixture
def phasewire_device(request: pytest.FixtureRequest) -> Iterator[Device]:
    """The device under test, opened for each test; after it the outputs are off and the line is closed.

    ``--phasewire-device`` names it, else ``$PHASEWIRE_DEVICE``; by default it is a new emulated device. In a test that
    also uses `phasewire_emulator` it is that emulator, whatever the option says. If it cannot be opened, the test is an
    error.
    """
    from ..base.errors import DeviceError
    from ..host import open_device

    url = request.config.getoption(OPTION)
    if "phasewire_emulator" in request.fixturenames:
        url = f"emulator:{request.getfixturevalue('phasewire_emulator').serial}"
    try:
        device = open_device(url)
    except DeviceError as error:
        pytest.fail(f"phasewire_device: {error}", pytrace=False)
    with device:
        yield device
