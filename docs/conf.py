"""The site that `make docs` builds from the Markdown of the repository and the docstrings, without a network."""

from __future__ import annotations

import os
import re
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import typer
from phasewire import __version__
from phasewire.cli.commands import command_line
from phasewire.cli.settings import each_command
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

project = "phasewire"
version = release = __version__
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton"]

# The sources are the repository's own documents, so that their links lead to the same places here and there.
root_doc = "docs/index"
include_patterns = ["docs/**.md", "docs/tutorial/tour.ipynb", "*.md", "protocol/SPEC.md", "[ef]*/README.md"]
exclude_patterns = [
    ".venv",
    ".peers",
    "build",
    "typings",
    "tests",
    "solver",
    "emulator",
    "host",
    "hil",
    "cli",
]

myst_heading_anchors = 4
nb_execution_mode = "off"  # its pictures are stored; a test executes it
suppress_warnings = [
    "ref.python",  # words such as "periods" in types of docstrings, which are the names of several properties
    "misc.highlighting_failure",  # blocks of hex and of mermaid, which stay as they are
]
autodoc_default_options = {"members": True, "show-inheritance": True}
autodoc_member_order = "bysource"
autodoc_typehints = "description"
napoleon_google_docstring = False
napoleon_use_rtype = False

html_theme = "furo"
html_title = f"phasewire {__version__}"
html_copy_source = False
html_show_copyright = False
html_static_path = ["static"]
html_css_files = ["site.css"]
html_js_files = ["site.js"]


def _add_help(app: Sphinx, name: str, source: list[str]) -> None:
    """Fill the page of commands with the help of each, as a terminal of 100 columns shows it."""
    if name != "docs/reference/commands":
        return
    for context in each_command(typer.Context(command_line(), info_name="phasewire")):
        with redirect_stdout(StringIO()) as shown:
            shown.write(context.get_help())  # which itself prints what is drawn by rich
        source[0] += f"\n## {context.command_path}\n\n```text\n{shown.getvalue().strip()}\n```\n"


def _escape_bars(app: Sphinx, what: str, name: str, value: object, options: object, lines: list[str]) -> None:
    """Let |p| in a docstring be a magnitude; in reStructuredText it would be a substitution."""
    for index, line in enumerate(lines):
        lines[index] = "".join(
            part if part.startswith("``") else part.replace("|", r"\|") for part in re.split("(``.*?``)", line)
        )


def _lead_to_the_index(app: Sphinx, error: Exception | None) -> None:
    """Let the site's folder itself be its address."""
    if error is None:
        link = f"{root_doc}.html"
        page = f'<!DOCTYPE html>\n<meta charset="utf-8">\n<meta http-equiv="refresh" content="0; url={link}">\n'
        Path(app.outdir, "index.html").write_text(f'{page}<a href="{link}">{html_title}</a>\n', encoding="utf-8")


class _Translator(HTML5Translator):
    """Writes the captions of the table of contents as headings of a level, which a screen reader needs."""

    def starttag(self, node: Any, tagname: str, suffix: str = "\n", empty: bool = False, **attributes: Any) -> str:
        """A tag with its attributes."""
        if attributes.get("ROLE") == "heading":
            attributes["aria-level"] = "2"
        tag: str = super().starttag(node, tagname, suffix, empty, **attributes)
        return tag


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    os.environ.update(COLUMNS="100", NO_COLOR="1")
    app.set_translator("html", _Translator)
    app.connect("source-read", _add_help)
    app.connect("build-finished", _lead_to_the_index)
    app.connect("autodoc-process-docstring", _escape_bars)
