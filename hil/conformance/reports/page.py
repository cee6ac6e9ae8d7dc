"""A run as one self-contained page of HTML: no script, no font, no picture, no network.

What broke comes first, then each clause of SPEC.md with its cases, then each case with its evidence. The page is built
from elements, never from pieces of text, so that no answer of a device becomes markup.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from urllib.parse import quote
from xml.etree.ElementTree import Element, tostring

from ..matrix import Chapter, ClauseRows, Level, Matrix, MatrixRow
from ..verdicts import Evidence, Result, Run, Verdict
from .markup import element
from .style import STYLE
from .summary import (
    Standing,
    by_reason,
    groups,
    outcome,
    provenance_rows,
    standing,
    verdict_line,
    why,
    worst,
)

__all__ = ["page"]

SEALED = "default-src 'none'; style-src 'unsafe-inline'"
"""The page may load nothing, whatever text it contains."""
MARKS = {
    Standing.FAIL: "✗",
    Standing.UNEXPECTED_PASS: "✗",
    Standing.WARN: "!",
    Standing.KNOWN_FAILURE: "≈",
    Standing.INCONCLUSIVE: "?",
    Standing.NOT_APPLICABLE: "–",
    Standing.PASS: "✓",
}


def page(run: Run, matrix: Matrix) -> str:
    """The whole page."""
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("meta", **{"http-equiv": "Content-Security-Policy", "content": SEALED}),
        element("title", f"{outcome(run).value.upper()} – conformance to the phasewire protocol"),
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
            element("p", verdict_line(run), class_=f"verdict {outcome(run).value}"),
            element("nav", element("ul", *links), **{"aria-label": "Sections"}),
        ),
        element("main", *parts),
    )
    return "<!DOCTYPE html>\n" + tostring(element("html", head, body, lang="en"), encoding="unicode", method="html")


def _device(run: Run) -> str:
    device = run.provenance.device
    return device.get("name") or device.get("url") or "A device"


def _sections(run: Run, matrix: Matrix) -> Iterator[Element | None]:
    told = {kind: [result for result in run.results if standing(result) is kind] for kind in Standing}
    rows = (element("div", element("dt", name), element("dd", text)) for name, text in provenance_rows(run.provenance))
    yield _section("provenance", "Provenance", element("dl", *rows))
    yield _section("counts", "Counts", _scrolling(_counts(run)))
    yield _listed("trouble", "Trouble of the run itself", (element("li", text) for text in run.trouble))
    yield _listed("broke", "What broke", map(_finding, told[Standing.FAIL] + told[Standing.UNEXPECTED_PASS]))
    yield _listed("warnings", "Warnings", map(_finding, told[Standing.WARN]))
    yield _listed("inconclusive", "What could not be judged here", _reasons(told[Standing.INCONCLUSIVE]))
    yield _listed("known", "What failed as known", map(_finding, told[Standing.KNOWN_FAILURE]))
    yield _listed("not-applicable", "What did not apply", _reasons(told[Standing.NOT_APPLICABLE]))
    results = {result.case: result for result in run.results}
    yield _section("clauses", "Clauses", *(_chapter(chapter, results) for chapter in matrix.chapters))
    yield _section("cases", "Cases", *(part for name, found in groups(run).items() for part in _group(name, found)))


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
    sign = element("span", MARKS[kind], **{"aria-hidden": "true"})
    return element("span", sign, f" {kind.value}", class_=f"badge {kind.name.lower()}")


def _place(case: str) -> str:
    """The anchor of a case in the page."""
    return quote(case)


def _link(result: Result) -> Element:
    return element("a", result.case, href=f"#{_place(result.case)}", class_="case")


def _finding(result: Result) -> Element:
    """A result that needs attention."""
    return element("li", _badge(standing(result)), " ", _link(result), *_about(result))


def _about(result: Result) -> Iterator[Element]:
    """The sentence of a case, the reason of its verdict, and its evidence."""
    yield element("p", result.sentence)
    if result.reason:
        yield element("p", why(result), class_="reason")
    if result.known is not None:
        yield element("p", f"Expected to fail: {result.known}", class_="reason")
    links = [element("a", clause, href=f"#{clause.partition('/')[0]}") for clause in result.clauses]
    for link in links[:-1]:
        link.tail = ", "
    yield element("p", "Shows ", *links, f"; took {result.seconds:.3f} s.", class_="small")


def _reasons(results: Iterable[Result]) -> Iterator[Element]:
    """How many cases have each reason, and which."""
    for reason, found in by_reason(results).items():
        cases = element("ul", *(element("li", _link(result)) for result in found))
        number = f"{len(found)} {'case' if len(found) == 1 else 'cases'}"
        kind = _badge(standing(found[0]))
        yield element("li", element("details", element("summary", kind, f" {number}: {reason}"), cases))


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
    verdict = worst(
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
    rows = (_row(row, results) for row in clause.rows)
    return element("tbody", *rows, id=clause.clause.identifier)


def _row(row: MatrixRow, results: Mapping[str, Result]) -> Element:
    found = [results[case] for case in row.cases if case in results]
    verdict = worst(result.verdict for result in found)
    cases = [element("li", _badge(standing(result)), " ", _link(result)) for result in found]
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
    return element(
        "tr",
        element("th", row.name, scope="row"),
        element("td", row.sentence),
        element("td", *shown),
        element("td", came),
    )


def _group(name: str, results: Iterable[Result]) -> Iterator[Element]:
    yield element("h3", name)
    yield from map(_case, results)


def _case(result: Result) -> Element:
    """A case with its evidence; open if it broke."""
    opened = {"open": ""} if result.breaks else {}
    summary = element("summary", _badge(standing(result)), " ", element("span", result.case, class_="case"))
    return element("details", summary, *_about(result), *_evidence(result.evidence), id=_place(result.case), **opened)


def _evidence(evidence: tuple[Evidence, ...]) -> Iterator[Element]:
    if evidence:
        rows = (element("div", element("dt", item.label), element("dd", item.text)) for item in evidence)
        yield element("dl", *rows, class_="evidence")
