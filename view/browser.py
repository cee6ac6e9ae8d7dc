"""Browsers: one that is opened for a user, and one without a window that draws a picture."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import time
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..base.errors import MissingExtraError, PhasewireError
from ..base.storage import write_file
from .view import View

__all__ = ["open_page", "saved_from", "suffix_of"]

BROWSERS = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "microsoft-edge",
    "msedge",
    "brave-browser",
)
BROWSER_VARIABLE = "PHASEWIRE_BROWSER"
PICTURE_SUFFIXES, VIDEO_SUFFIX = (".png",), ".webm"
START_SECONDS = 60.0
"""A busy computer needs so long to begin a browser and draw without a graphics processor."""
FLAGS = (
    "--headless=new",
    "--window-size=1280,800",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--mute-audio",
)


def open_page(view: View) -> bool:
    """Open the page in the user's browser; false if there is none."""
    with suppress(webbrowser.Error):
        return webbrowser.open(view.url)
    return False


def suffix_of(path: Path) -> str:
    """The kind of a file to save; `ValueError` if it is none."""
    suffix = path.suffix.lower()
    if suffix not in (*PICTURE_SUFFIXES, VIDEO_SUFFIX):
        raise ValueError(
            f"{path} must end in {', '.join(PICTURE_SUFFIXES)} for a picture or {VIDEO_SUFFIX} for a video"
        )
    return suffix


@contextmanager
def saved_from(view: View, path: Path, seconds: float) -> Iterator[Callable[[], bool]]:
    """A browser without a window shows the page during this block; its picture or video is written at the end.

    The block gets a function that says when it can end. The view was made for saving, ``path`` has a suffix as in
    `suffix_of`, and a video lasts for ``seconds``.

    `MissingExtraError` if no browser is found; `PhasewireError` if the browser has sent no picture; `OSError` if the
    file cannot be written.
    """
    kind = suffix_of(path)[1:]
    url = f"{view.url}&save={kind}&seconds={seconds:g}"
    with tempfile.TemporaryDirectory(prefix="phasewire-browser-", ignore_cleanup_errors=True) as profile:
        command = [_browser(), *FLAGS, f"--user-data-dir={profile}"]
        if hasattr(os, "geteuid") and os.geteuid() == 0:
            command.append("--no-sandbox")  # which Chromium requires of root
        browser = subprocess.Popen([*command, url], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        end = time.monotonic() + START_SECONDS + seconds
        try:
            yield lambda: view.server.received.is_set() or browser.poll() is not None or time.monotonic() > end
        finally:
            browser.terminate()
            with suppress(subprocess.TimeoutExpired):
                browser.wait(5)
            browser.kill()
            browser.wait()
    if not view.server.saved:
        raise PhasewireError(f"{command[0]} has sent no picture of the page")
    write_file(path, view.server.saved[-1])


def _browser() -> str:
    """The program of a browser that can work without a window."""
    named = os.environ.get(BROWSER_VARIABLE)
    for name in (named,) if named else BROWSERS:
        if found := shutil.which(name):
            return found
    wanted = (
        f"{named}, which {BROWSER_VARIABLE} names, is not installed"
        if named
        else "no Chromium, Chrome or Edge is installed"
    )
    raise MissingExtraError(
        f"a picture without a window needs a browser, but {wanted}; {BROWSER_VARIABLE} can name another program"
    )
