"""The page: read by a parser of HTML that did not write it."""

from __future__ import annotations

import hashlib
import re
import shutil
import subprocess
from base64 import b64encode
from dataclasses import replace
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from urllib.parse import unquote

import pytest
from phasewire.hil.conformance.matrix import Claim, Matrix
from phasewire.hil.conformance.reports.page import page
from phasewire.hil.conformance.reports.style import DARK, KINDS, LIGHT, STYLE
from phasewire.hil.conformance.reports.summary import verdict_line
from phasewire.hil.conformance.verdicts import Evidence, Run

from tests.hil.conformance.hand_made_runs import CLEAN, DECISIVE, EVERY, MATRIX

CHROMIUM = shutil.which("chromium")
PART = replace(EVERY, results=(EVERY.results[0], EVERY.results[5]), trouble=())
OPEN = replace(PART, results=PART.results[1:])
VOID = ("meta", "br", "hr", "img", "link", "input")


class Reader(HTMLParser):
    """The tags of a page with their attributes and the texts in them; fails if tags do not match."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[tuple[tuple[str, ...], str]] = []
        self._open: list[str] = []
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append((tuple(self._open), data))

    def text(self, tag: str) -> str:
        """All that stands inside tags of a name."""
        return "".join(data for inside, data in self.texts if tag in inside)

    def all(self, attribute: str) -> list[str]:
        return [value for _, attributes in self.tags if (value := attributes.get(attribute)) is not None]


WRITTEN = page(EVERY, MATRIX)
READ = Reader(WRITTEN)


def test_the_page_needs_no_other_file() -> None:
    assert {tag for tag, _ in READ.tags}.isdisjoint({"img", "iframe", "object", "base", "form"})
    assert READ.all("rel") == ["icon"]
    assert all(href.startswith(("#", "data:image/svg+xml,")) for href in READ.all("href"))
    assert READ.all("src") == READ.all("style") == READ.all("onclick") == []
    assert "url(" not in STYLE
    assert "@import" not in STYLE


def test_only_the_page_s_own_script_runs() -> None:
    """Content Security Policy 3: a source may be the digest of the script's text."""
    digest = b64encode(hashlib.sha256(READ.text("script").encode()).digest()).decode()
    assert [tag for tag, _ in READ.tags].count("script") == 1
    (policy,) = (content for content in READ.all("content") if "-src" in content)
    assert policy == f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src 'sha256-{digest}'"


@pytest.mark.parametrize(("run", "tone"), [(EVERY, "fail"), (CLEAN, "pass"), (PART, "pass"), (OPEN, "open")])
def test_the_tab_and_the_body_agree(run: Run, tone: str) -> None:
    read = Reader(page(run, MATRIX))
    assert read.text("title").startswith(verdict_line(run))
    assert verdict_line(run) in read.text("header")
    assert f"verdict {tone}" in read.all("class")
    (icon,) = (href for href in read.all("href") if href.startswith("data:"))
    assert LIGHT[tone] in unquote(icon)


@pytest.mark.skipif(not CHROMIUM, reason="no chromium is installed")
@pytest.mark.slow
def test_the_script_searches_and_filters(tmp_path: Path) -> None:
    """The page in a browser, with a probe after its script; the policy is removed to let the probe run."""
    probe = """<script>
        const shown = [];
        for ([words.value, kind.value] of [["damage", ""], ["", "fail"], ["lines", "inconclusive"], ["x y z", ""]]) {
          search.dispatchEvent(new Event("input"));
          shown.push(told.value, ...[...document.querySelectorAll("section[id]:not([hidden])")].map(part => part.id));
        }
        document.body.textContent = shown.join(" ");
    </script></body>"""
    written = re.sub("<meta http-equiv[^>]*>", "", WRITTEN).replace("</body>", probe)
    (tmp_path / "page.html").write_text(written, "utf-8")
    options = ("--headless=new", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path}", "--dump-dom")
    command = [str(CHROMIUM), *options, (tmp_path / "page.html").as_uri()]
    found = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout
    assert Reader(found).text("body").split() == [
        *["1", "of", "9", "cases", "broke", "trouble", "clauses", "cases"],
        *["1", "of", "9", "cases", "broke", "trouble", "clauses", "cases"],
        *["2", "of", "9", "cases", "trouble", "inconclusive", "clauses", "cases"],
        *["0", "of", "9", "cases", "trouble"],
    ]


def test_all_links_lead_somewhere_and_no_place_stands_twice() -> None:
    places = READ.all("id")
    assert len(places) == len(set(places))
    assert not any(re.search(r"\s", place) for place in places)
    leading = {href[1:] for href in READ.all("href") if href.startswith("#")}
    # The matrix of this test has not every clause that its cases name.
    assert leading - set(places) == {"ACK-003", "USB-003", "SER-001"}


def test_text_of_devices_is_text() -> None:
    texts = [data for _, data in READ.texts]
    assert "<script>alert(1)</script> & \"quoted\" 'text' ]]> [31m [red] Ωµ" in texts
    assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]", WRITTEN)
    WRITTEN.encode("utf-8")


def test_sections_stand_in_the_order_in_which_they_matter() -> None:
    headings = [data for inside, data in READ.texts if inside[-1:] == ("h2",)]
    assert headings == [
        "What broke",
        "Trouble of the run itself",
        "Warnings",
        "What could not be judged here",
        "What failed as known",
        "What did not apply",
        "Counts",
        "Provenance",
        "Clauses",
        "Cases",
    ]
    assert [data for inside, data in READ.texts if "nav" in inside] == headings


def cells(of: str) -> list[list[str]]:
    """The rows of the tables of a class, each cell as plain text."""
    (tables, *_) = [re.findall(rf'<table class="{of}">(.*?)</table>', WRITTEN)]
    rows = [row for table in tables for row in re.findall(r"<tr.*?>(.*?)</tr>", table)]
    found = [re.findall(r"<t[hd].*?>(.*?)</t[hd]>", row) for row in rows]
    return [[" ".join(re.sub(r"<[^>]+>", " ", cell).split()) for cell in row] for row in found]


def test_counts_and_clauses_are_tables_in_words() -> None:
    counts = cells("counts")
    assert ["usb", "0", "0", "1", "3", "0"] in counts
    assert counts[-1] == ["all", "2", "2", "1", "3", "1"]
    clauses = cells("clauses")
    assert [
        "BLK-003",
        "Damage MUST be refused.",
        "✓ pass blocks/good ✗ fail blocks/bad[a b]",
        "✗ fail",
    ] in clauses
    assert ["BLK-006/2", "It MUST not be seen.", "nobody can see it", "cannot be seen"] in clauses
    assert ["BLK-006/3", "It MUST be forgotten.", "", "no case"] in clauses
    assert ["BLK-006", "It is so.", "blocks/left-out (did not run)", "did not run"] in clauses
    assert ["USB-002", "Lines.", "? inconclusive usb/lines ? inconclusive usb/more", "? inconclusive"] in clauses


def test_findings_hold_their_evidence_and_all_cases_are_listed() -> None:
    broke, passed = WRITTEN.index('id="broke"'), WRITTEN.index('id="inconclusive"')
    assert broke < WRITTEN.index("0a 00") < passed
    shown = [data for inside, data in READ.texts if inside[-3:] == ("dl", "div", "dd")]
    last, *before = shown[: len(EVERY.results[1].evidence) - 1]
    assert (last, before[0], before[-2]) == (DECISIVE.meaning, "01 00", "0a 00")
    assert WRITTEN.count(DECISIVE.text) == 1
    assert "state OFF" not in WRITTEN
    assert "… and 1 after the end, in --json" in WRITTEN
    assert [attributes for tag, attributes in READ.tags if tag == "details" and "open" in attributes] == [{"open": ""}]
    listed = WRITTEN[WRITTEN.index('id="cases"') :]
    assert len(re.findall("<li ", listed)) == len(EVERY.results)


@pytest.mark.parametrize(("failures", "whole"), [(1, 60), (5, 31), (200, 0)])
def test_many_failures_leave_room_for_each_other(failures: int, whole: int) -> None:
    """The page stays below 1 MB, of which the 1707 cases of a run and their clauses need 0.7 MB."""
    evidence = tuple(Evidence("block", f"{number:1535}") for number in range(60))
    result = replace(EVERY.results[1], evidence=evidence)
    results = tuple(replace(result, case=f"blocks/{number}") for number in range(failures))
    written = page(replace(EVERY, results=results), MATRIX)
    assert len(written) < 300_000
    assert (f"{59:1535}</dd>" in written) == (whole > 0)
    assert written.count(f"{60 - whole:1535}</dd>") == failures * (whole > 0)
    assert written.count(" before these, in --json") == failures * (whole < 60)


def test_cases_that_differ_only_in_parameters_are_counted() -> None:
    results = tuple(replace(CLEAN.results[0], case=f"blocks/good[{number}]") for number in range(3))
    matrix = Matrix.of(Claim(result.case, result.clauses, result.sentence) for result in results)
    assert "blocks/good</a> × 3" in page(replace(CLEAN, results=results), matrix)


def luminance(colour: str) -> float:
    """Relative luminance as WCAG 2.2 defines it."""
    channels = [int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5)]
    linear = [value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4 for value in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    dark, light = sorted((luminance(one), luminance(other)))
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.parametrize("colours", [LIGHT, DARK], ids=["light", "dark"])
def test_everyone_can_read_the_colours(colours: dict[str, str]) -> None:
    assert contrast("#000000", "#ffffff") == pytest.approx(21)
    pairs = [(name, f"{name}-ground") for name in KINDS.values()]
    pairs += [(name, ground) for name in ("text", "quiet", "link") for ground in ("ground", "raised")]
    for text, ground in pairs:
        assert contrast(colours[text], colours[ground]) >= 4.5, (text, ground)
    assert list(LIGHT) == list(DARK)


def test_headings_do_not_jump() -> None:
    levels = [int(tag[1]) for tag, _ in READ.tags if re.fullmatch(r"h\d", tag)]
    assert levels[0] == 1
    assert all(second <= first + 1 for first, second in pairwise(levels))
