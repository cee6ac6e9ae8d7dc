"""Devices on all lines, and lines of other people that fail."""

from __future__ import annotations

from importlib.metadata import EntryPoint
from typing import Any

import pytest
from phasewire.base.errors import DeviceNotFoundError
from phasewire.host.finding import discovery
from phasewire.host.finding.discovery import search
from phasewire.host.transports.transport import Found

HERE = Found("own:1", "somebody's array", "1", "run time", "", "shelf")


class Works:
    def find(self) -> list[Found]:
        return [HERE]


class Fails:
    def find(self) -> list[Found]:
        raise RuntimeError("its own bus is on fire")


WORKS, FAILS = Works(), Fails()


@pytest.fixture
def lines(monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """Entry points of the group, by name."""
    known: dict[str, str] = {}

    def entries(group: str) -> dict[str, EntryPoint]:
        assert group == "phasewire.transports"
        return {name: EntryPoint(name, value, group) for name, value in known.items()}

    objects: dict[str, Any] = {"works": WORKS, "fails": FAILS}

    def load(entry: EntryPoint) -> Any:
        if entry.value not in objects:
            raise ModuleNotFoundError(f"No module named {entry.value!r}")
        return objects[entry.value]

    monkeypatch.setattr(discovery, "entries", entries)
    monkeypatch.setattr(EntryPoint, "load", load)
    return known


def test_one_line_that_fails_does_not_hide_the_others(lines: dict[str, str]) -> None:
    lines.update(broken="fails", missing="nowhere", own="works")
    found, failures = search()
    assert found == [HERE]
    assert failures == {"broken": "its own bus is on fire", "missing": "No module named 'nowhere'"}


def test_only_some_lines_may_be_asked(lines: dict[str, str]) -> None:
    lines.update(broken="fails", own="works")
    assert search(["own"]) == ([HERE], {})
    with pytest.raises(DeviceNotFoundError, match="no transport 'usb'; known are broken, own"):
        search(["usb"])
