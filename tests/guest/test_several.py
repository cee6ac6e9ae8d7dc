"""Several devices at once, told apart by their serial numbers."""

from __future__ import annotations

import json

import pytest

from .conftest import Bench

pytestmark = pytest.mark.guest


@pytest.mark.parametrize("count", [2, pytest.param(4, marks=pytest.mark.guest_slow)])
def test_several_devices_are_told_apart(bench: Bench, count: int) -> None:
    numbers = [f"EMU-{number:04}" for number in range(1, count + 1)]
    bench.serve("--count", str(count), *(part for number in numbers for part in ("--serial-number", number)))
    bench.attach(count=count)
    listed = json.loads(bench.check("phasewire", "devices", "--json", "-"))["devices"]
    assert sorted(each["serial"] for each in listed if each["url"].startswith("usb:")) == numbers
    consoles = bench.check("ls", "/dev/serial/by-id").split()
    assert all(sum(number in console for console in consoles) == 1 for number in numbers)
    assert bench.complaints() == []
    for number in numbers:
        assert number in bench.check("phasewire", "info", "--device", f"usb:{number}").splitlines()[0]
    ambiguous = bench.run("phasewire", "info", "--device", "usb:")
    assert ambiguous.code == 3
    assert all(number in ambiguous.err for number in numbers)
