"""A run as one self-contained page of HTML: no font, no other file, no network.

What broke comes first, each failure with its decisive evidence, then what else needs attention; then counts and
provenance, each clause of SPEC.md with its cases, and all cases. The page is complete without its script, which only
searches and filters. It is built from elements, never from pieces of text, so that no answer of a device becomes
markup.
"""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from hashlib import sha256
from itertools import accumulate, groupby
from urllib.parse import quote
from xml.etree.ElementTree import Element, tostring

from ..matrix import Chapter, ClauseRows, Level, Matrix, MatrixRow
from ..verdicts import Evidence, Result, Run, Verdict
from .markup import element
from .script import SCRIPT
from .style import LIGHT, STYLE
from .summary import (
    RunOutcome,
    Standing,
    abridged,
    advice,
    by_reason,
    groups,
    left_out,
    outcome,
    provenance_rows,
    rolled_up,
    standing,
    trail,
    verdict_line,
    why,
)

__all__ = ["page"]

SEALED = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; "
    f"script-src 'sha256-{b64encode(sha256(SCRIPT.encode()).digest()).decode()}'"
)
"""The page may load nothing and run only its own script, whatever text it contains."""
MARKS = {
    Standing.FAIL: "✗",
    Standing.UNEXPECTED_PASS: "✗",
    Standing.WARN: "!",
    Standing.KNOWN_FAILURE: "≈",
    Standing.INCONCLUSIVE: "?",
    Standing.NOT_APPLICABLE: "–",
    Standing.PASS: "✓",
}
ICONS = {"fail": "M5 5 11 11M11 5 5 11", "open": "M4 8H12", "pass": "M4 8.5 7 11.5 12 5"}
"""Strokes of a cross, a dash and a check mark, in a square of 16."""
FINDINGS_BYTES = 250_000
"""All findings share this equally, so that the page stays below 1 MB: clauses and cases take 0.7 MB. JSON holds all."""
WORDS_BYTES, ROW_BYTES = 700, 40
"""The size of a finding without its evidence, and of a piece of evidence without its words."""
LEAST_CHARACTERS = 100
"""The text of a piece of evidence, however little room there is."""
FINDINGS = {Standing.FAIL, Standing.UNEXPECTED_PASS, Standing.WARN, Standing.KNOWN_FAILURE}
"""Results that are told with their evidence."""
ROLL_UP = (
    "A clause fails if one of its cases fails. Otherwise it warns if one warns, passes if one passes, and is "
    "inconclusive if no case that applies could be judged."
)


def page(run: Run, matrix: Matrix) -> str:
    """The whole page."""
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("meta", **{"http-equiv": "Content-Security-Policy", "content": SEALED}),
        element("title", f"{verdict_line(run)} – phasewire conformance"),
        element("link", rel="icon", href=_icon(_tone(run))),
        element("style", STYLE),
    )
    parts = [part for part in _sections(run, matrix) if part is not None]
    links = (element("li", element("a", part[0].text or "", href=f"#{part.attrib['id']}")) for part in parts)
    body = element(
        "body",
        element(
            "header",
            element("p", "phasewire conformance", class_="kicker"),
            element("h1", _device(run)),
            element("p", verdict_line(run), class_=f"verdict {_tone(run)}"),
            element("nav", element("ul", *links), **{"aria-label": "Sections"}),
        ),
        _search(),
        element("main", *parts),
        element("script", SCRIPT),
    )
    return "<!DOCTYPE html>\n" + tostring(element("html", head, body, lang="en"), encoding="unicode", method="html")


def _tone(run: Run) -> str:
    """The colour and the sign of the verdict: a run without a pass is neither good nor bad."""
    if outcome(run) is RunOutcome.FAIL:
        return "fail"
    return "pass" if run.count(Verdict.PASS) else "open"


def _icon(tone: str) -> str:
    """The icon of the tab, as a URL that holds the picture."""
    stroke = f"<path d='{ICONS[tone]}' stroke='#fff' stroke-width='2.2' fill='none'/>"
    disc = f"<circle cx='8' cy='8' r='8' fill='{LIGHT[tone]}'/>"
    return "data:image/svg+xml," + quote(
        f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 16 16'>{disc}{stroke}</svg>"
    )


def _search() -> Element:
    """The field and the filter of the script, which shows them."""
    options = (element("option", f"{MARKS[kind]} {kind.value}", value=kind.value) for kind in Standing)
    return element(
        "search",
        element("label", "Search ", element("input", type="search", placeholder="BLK-003, watchdog, …")),
        element("label", "Verdict ", element("select", element("option", "all", value=""), *options)),
        element("output"),
        hidden="",
    )


def _device(run: Run) -> str:
    device = run.provenance.device
    return device.get("name") or device.get("url") or "A device"


def _sections(run: Run, matrix: Matrix) -> Iterator[Element | None]:
    told = {kind: [result for result in run.results if standing(result) is kind] for kind in Standing}
    room = FINDINGS_BYTES // max(1, sum(len(told[kind]) for kind in FINDINGS)) - WORDS_BYTES
    finding = partial(_finding, room=room)
    yield _listed("broke", "What broke", map(finding, told[Standing.FAIL] + told[Standing.UNEXPECTED_PASS]))
    yield _listed("trouble", "Trouble of the run itself", (element("li", text) for text in run.trouble))
    yield _listed("warnings", "Warnings", map(finding, told[Standing.WARN]))
    yield _listed("inconclusive", "What could not be judged here", _reasons(told[Standing.INCONCLUSIVE]))
    yield _listed("known", "What failed as known", map(finding, told[Standing.KNOWN_FAILURE]))
    yield _listed("not-applicable", "What did not apply", _reasons(told[Standing.NOT_APPLICABLE]))
    yield _section("counts", "Counts", _scrolling(_counts(run)))
    rows = (element("div", element("dt", name), element("dd", text)) for name, text in provenance_rows(run.provenance))
    yield _section("provenance", "Provenance", element("dl", *rows))
    results = {result.case: result for result in run.results}
    yield _section(
        "clauses", "Clauses", element("p", ROLL_UP), *(_chapter(chapter, results) for chapter in matrix.chapters)
    )
    yield _section("cases", "Cases", *(_group(name, found) for name, found in groups(run).items()))


def _section(name: str, heading: str, *content: Element) -> Element:
    return element("section", element("h2", heading), *content, id=name)


def _listed(name: str, heading: str, items: Iterable[Element]) -> Element | None:
    """A section with a list; none if the list is empty."""
    found = list(items)
    return _section(name, heading, element("ul", *found, class_="findings")) if found else None


def _scrolling(table: Element) -> Element:
    """A table that scrolls by itself if the window is narrow; keys reach it too."""
    return element("div", table, class_="scrolling", tabindex="0")


def _badge(kind: Standing) -> Element:
    """A standing in a word; sign and colour only repeat it."""
    return element("b", f"{MARKS[kind]} {kind.value}", class_=kind.name.lower())


def _place(case: str) -> str:
    """The anchor of a case in the page: short, because a case is named in many places, and the same in each run."""
    return sha256(case.encode()).hexdigest()[:10]


def _link(result: Result, text: str = "") -> Element:
    return element("a", text or result.case, href=f"#{_place(result.case)}")


def _finding(result: Result, room: int) -> Element:
    """A result that needs attention, with as much of its evidence as there is room for; open if it broke."""
    shown = element("li", _badge(standing(result)), f" {result.case}", *_about(result))
    shown.attrib |= {"id": _place(result.case), "data-kind": standing(result).value}
    newest = _newest(result, room)
    if newest:
        shown.extend((element("p", "Last before the failure:", class_="small"), _evidence(newest[-1:])))
    if note := left_out(result, len(newest)):
        shown.append(element("p", note, class_="small"))
    if newest[1:]:
        opened = {"open": ""} if result.breaks else {}
        summary = element("summary", "Before that, in order")
        shown.append(element("details", summary, _evidence(newest[:-1]), **opened))
    return shown


def _about(result: Result) -> Iterator[Element]:
    """The reason of the verdict on a case, its sentence, and the clauses that it shows."""
    if told := why(result):
        yield element("p", told, class_="reason")
    if again := advice(result):
        yield element("p", again)
    if result.known is not None:
        yield element("p", f"Expected to fail: {result.known}", class_="reason")
    yield element("p", result.sentence)
    yield element("p", "Shows ", *_clauses(result), f"; took {result.seconds:.3f} s.", class_="small")


def _clauses(result: Result) -> list[Element]:
    """Links to the clauses that a case shows."""
    links = [element("a", clause, href=f"#{clause.partition('/')[0]}") for clause in result.clauses]
    for link in links[:-1]:
        link.tail = ", "
    return links


def _newest(result: Result, room: int) -> list[Evidence]:
    """The newest pieces of the trail for which there is room, each with at most an eighth of it, or the last alone."""
    most = max(room // 8, LEAST_CHARACTERS)
    shown = [abridged(item, most, most) for item in trail(result)]
    sizes = accumulate(ROW_BYTES + sum(map(len, (item.label, item.meaning, item.text))) for item in reversed(shown))
    return shown[-max(1, sum(size <= room for size in sizes)) :]


def _evidence(evidence: Iterable[Evidence]) -> Element:
    """Pieces of evidence; the meaning of bytes stands before them."""
    rows = (element("div", element("dt", item.label), element("dd", *_told(item))) for item in evidence)
    return element("dl", *rows, class_="evidence")


def _told(item: Evidence) -> list[Element | str]:
    return [item.meaning, element("div", item.text, class_="bytes", tabindex="0")] if item.meaning else [item.text]


def _reasons(results: Iterable[Result]) -> Iterator[Element]:
    """How many cases have each reason, and which."""
    for reason, found in by_reason(results).items():
        cases = element("ul", *(element("li", _link(result)) for result in found))
        number = f"{len(found)} {'case' if len(found) == 1 else 'cases'}"
        kind = standing(found[0])
        summary = element("summary", _badge(kind), f" {number}: {reason}")
        yield element("li", element("details", summary, cases), **{"data-kind": kind.value})


def _counts(run: Run) -> Element:
    """How many came to which verdict, in each group and in all."""
    kinds = [Standing(verdict.value) for verdict in Verdict]
    head = element(
        "tr",
        element("th", "group", scope="col"),
        *(element("th", _badge(kind), scope="col") for kind in kinds),
    )
    named = {name: [result.verdict for result in found] for name, found in groups(run).items()}
    rows = [_count_row(name, verdicts) for name, verdicts in named.items()]
    total = _count_row("all", [result.verdict for result in run.results])
    return element("table", element("thead", head), element("tbody", *rows), element("tfoot", total), class_="counts")


def _count_row(name: str, verdicts: list[Verdict]) -> Element:
    counts = map(verdicts.count, Verdict)
    cells = (element("td", str(count), class_="some" if count else "none") for count in counts)
    return element("tr", element("th", name, scope="row"), *cells)


def _chapter(chapter: Chapter, results: Mapping[str, Result]) -> Element:
    """A chapter of SPEC.md: its clauses, the cases of each, and their results."""
    head = element("tr", *(element("th", name, scope="col") for name in ("clause", "says", "shown by", "verdict")))
    bodies = (_clause(clause, results) for clause in chapter.clauses)
    table = element("table", element("thead", head), *bodies, class_="clauses")
    verdict = rolled_up(
        results[case].verdict
        for clause in chapter.clauses
        for row in clause.rows
        for case in row.cases
        if case in results
    )
    badge = [] if verdict is None else [_badge(Standing(verdict.value))]
    title = element("summary", element("b", chapter.name), f" {chapter.title} ", *badge)
    return element("details", title, _scrolling(table))


def _clause(clause: ClauseRows, results: Mapping[str, Result]) -> Element:
    return element("tbody", *(_row(row, results) for row in clause.rows), id=clause.clause.identifier)


def _row(row: MatrixRow, results: Mapping[str, Result]) -> Element:
    found = [results[case] for case in row.cases if case in results]
    verdict = rolled_up(result.verdict for result in found)
    cases = [element("li", *_alike(alike)) for alike in _by_name(found)]
    cases += [element("li", f"{case} (did not run)", class_="small") for case in row.cases if case not in results]
    if verdict is not None:
        came: Element | str = _badge(Standing(verdict.value))
    elif row.cases:
        came = "did not run"
    elif row.reason is not None:
        came = "cannot be seen"
    else:
        came = "no case" if row.level is not Level.NONE else ""
    shown = [element("ul", *cases)] if cases else []
    shown += [element("p", row.reason, class_="small")] if row.reason is not None else []
    made = element(
        "tr",
        element("th", row.name, scope="row"),
        element("td", row.sentence),
        element("td", *shown),
        element("td", came),
    )
    made.attrib["data-kind"] = verdict or ""
    return made


def _by_name(results: Iterable[Result]) -> Iterator[list[Result]]:
    """Neighbours of one name, whatever their parameters, and of one standing."""
    return (
        list(alike) for _, alike in groupby(results, lambda result: (result.case.partition("[")[0], standing(result)))
    )


def _alike(results: list[Result]) -> Iterator[Element | str]:
    """One case, or the number of cases that differ only in their parameters."""
    first = results[0]
    yield _badge(standing(first))
    yield " "
    yield _link(first, first.case.partition("[")[0] if len(results) > 1 else "")
    if len(results) > 1:
        yield f" × {len(results)}"


def _group(name: str, results: Iterable[Result]) -> Element:
    """All cases of a group; neighbours that say and show the same stand together."""
    made = element("section", element("h3", name))
    for (sentence, _), alike in groupby(results, lambda result: (result.sentence, result.clauses)):
        found = list(alike)
        about = element("p", sentence, " ", element("small", *_clauses(found[0])))
        made.append(element("div", about, element("ul", *map(_case, found)), class_="cases"))
    return made


def _case(result: Result) -> Element:
    """One line for a case; a finding has its place above."""
    if standing(result) in FINDINGS:
        made = element("li", _badge(standing(result)), " ", _link(result))
    else:
        part = f": {why(result)}" if result.is_partial else ""
        made = element("li", _badge(standing(result)), f" {result.case}{part}", id=_place(result.case))
    made.attrib["data-kind"] = standing(result).value
    return made
