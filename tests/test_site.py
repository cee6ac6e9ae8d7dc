"""The site that `make docs` builds, in a browser."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from .chromium import MARKS, PATIENCE, chromium, grave_faults

pytestmark = MARKS
ROOT = Path(__file__).parents[1]
LARGE = {"docs/reference/python.html", "genindex.html"}
"""On each of which axe-core takes half a minute; they have the parts of the others."""


def test_everyone_can_read_every_page(tmp_path: Path) -> None:
    """By axe-core, at a phone's width, at which most scrolls sideways."""
    build = [sys.executable, "-m", "sphinx", "-q", "-W", "-b", "html", "-c", "docs", ".", str(tmp_path)]
    subprocess.run(build, cwd=ROOT, timeout=5 * PATIENCE, check=True)
    pages = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*.html")} - LARGE - {"index.html"}
    assert len(pages) > 40
    with chromium() as browser:
        tab = browser.new_page(viewport={"width": 375, "height": 800})
        faults = {}
        for page in sorted(pages):
            tab.goto((tmp_path / page).as_uri())
            faults[page] = grave_faults(tab)
    assert {page: found for page, found in faults.items() if found} == {}
