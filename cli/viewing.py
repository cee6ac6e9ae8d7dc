"""The option ``--view``, for commands that play: what they play is seen in the browser."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated
from urllib.parse import parse_qsl, urlencode

import typer

from ..base.signals import loading
from ..host.streaming.group import AnyDevice, DeviceGroup
from ..host.transports.opening import is_fresh
from ..solver import TransducerArray
from .console import error_console

if TYPE_CHECKING:
    from ..emulator import Emulator
    from ..view.view import View
    from ..view.watching import Watch

__all__ = ["ViewOption", "opened_page", "viewed_device", "watching"]

ViewOption = Annotated[
    bool,
    typer.Option(
        "--view",
        help="Show it in the browser, at the pace of the wall clock. The page can stop it; so does closing the page.",
    ),
]


@contextmanager
def viewed_device(url: str, *, wanted: bool = True) -> Iterator[tuple[str, Emulator | None]]:
    """The URL of a device, and its emulator if it is a fresh one that is to be seen.

    That one forgets what is older than a page shows.
    """
    if not (wanted and is_fresh(url)):
        yield url, None
        return
    with loading():
        from ..emulator.doors.address import OF_THE_DOOR, EmulatorUrl
        from ..view.past import HISTORY_PERIODS
    emulator = EmulatorUrl.parse(url).make(history_periods=HISTORY_PERIODS)
    door = urlencode([option for option in parse_qsl(url.partition("?")[2]) if option[0] in OF_THE_DOOR])
    with emulator:
        yield f"{emulator.url}?{door}" if door else emulator.url, emulator


@contextmanager
def watching(
    device: AnyDevice, array: TransducerArray, emulator: Emulator | None, *, wanted: bool
) -> Iterator[Watch | None]:
    """A watch over a device whose page is open, None if it is not wanted; a rig has none."""
    if not wanted or isinstance(device, DeviceGroup):
        yield None
        return
    with loading():
        from ..view.watching import watch
    with watch(device, array, emulator) as watching:
        watching.view.warm_up()
        opened_page(watching.view)
        if not watching.wait_for_page():
            error_console().print("No page was opened; it goes on without one", style="yellow")
        yield watching


def opened_page(view: View, *, browser: bool = True) -> None:
    """Print the link of a page, and open it in the user's browser if that is wanted."""
    with loading():
        from ..view.browser import open_page
    error_console().print(f"The page is at {view.url}")
    if browser and not open_page(view):
        error_console().print("No browser could be opened; open the link in one")
