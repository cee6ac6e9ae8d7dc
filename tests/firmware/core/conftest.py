"""The reference device in C as a device in this process."""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any

import pytest
from phasewire.protocol.wiring import Wiring

from tests.firmware.core.building import REFERENCE, build


@pytest.fixture(scope="session")
def machine() -> Callable[..., Any]:
    """Make a device of the library, with a wiring."""
    build("library")
    sys.path.insert(0, str(REFERENCE / "python"))
    try:
        machine_class = import_module("phasewire_reference").Machine
    finally:
        sys.path.pop(0)

    def make(wiring: Wiring) -> Any:
        return machine_class(wiring)

    return make
