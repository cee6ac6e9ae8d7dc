"""A line of another package, which wraps one of this package: every test of lines holds for it."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from types import SimpleNamespace
from typing import Any, cast

import pytest
from phasewire import Emulator, open_device
from phasewire.base.plugins import entries
from phasewire.host.transports.opening import SCHEMES, open_untraced
from phasewire.host.transports.tracing import TRAFFIC
from phasewire.host.transports.transport import Transport

from tests.host.test_back_to_back import Opened, TestEveryLine, device

__all__ = ["TestEveryLine", "device"]


class Wrapper:
    """A transport that passes everything on to another."""

    def __init__(self, inner: Transport) -> None:
        self._inner = inner

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)


class WrapperScheme:
    """The scheme of ``wrapped:URL``."""

    def open(self, url: str) -> Wrapper:
        return Wrapper(open_untraced(url.removeprefix("wrapped:")))


@pytest.fixture(scope="class")
def url() -> Iterator[str]:
    with pytest.MonkeyPatch.context() as patch, Emulator() as emulator:
        patch.setitem(entries(SCHEMES), "wrapped", cast("EntryPoint", SimpleNamespace(value="", load=WrapperScheme)))
        yield f"wrapped:{emulator.url}"


@pytest.fixture(scope="class")
def opened(url: str) -> Iterator[Opened]:
    line = Opened(url)
    yield line
    line.close()


def test_a_line_that_wraps_another_is_traced_once(url: str, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, logger=TRAFFIC)
    with open_device(url) as opened_device:
        caplog.clear()
        opened_device.clock()
    assert ["CLOCK" in message for message in caplog.messages].count(True) == 1
