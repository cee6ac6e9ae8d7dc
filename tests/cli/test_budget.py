"""``phasewire budget``: its output, its files, and its errors."""

from __future__ import annotations

import re
from functools import partial
from itertools import pairwise
from pathlib import Path

import pytest

from .runner import Run


@pytest.fixture
def budget(phasewire: Run) -> Run:
    return partial(phasewire, "budget")


@pytest.mark.parametrize(
    ("options", "bottleneck", "rate"),
    [
        ((), "boundary", "40,000 updates/s, one every period"),
        (("--link", "2wire"), "links", "20,000 updates/s, one every 2 periods"),
        (("--token-delay", "7"), "links", "20,000 updates/s, one every 2 periods"),
        (("--cycles-per-symbol", "4"), "links", "20,000 updates/s, one every 2 periods"),
        (("--hop-ns", "1081"), "boundary", "20,000 updates/s, one every 2 periods"),
        (("--baud", "115200"), "serial", "22.0994 updates/s, one every 1,810 periods"),
    ],
)
def test_it_names_the_bottleneck_and_the_rate(
    budget: Run, options: tuple[str, ...], bottleneck: str, rate: str
) -> None:
    outcome = budget(*options)
    assert (outcome.code, outcome.err) == (0, "")
    assert f"Bottleneck: {bottleneck}.\nSustained rate: {rate}.\n" in outcome.out
    assert max(len(line) for line in outcome.out.splitlines()) <= 80


def test_the_time_line_is_drawn_in_characters(budget: Run) -> None:
    lines = budget().out.splitlines()
    rows = {line.split()[0]: line for line in lines if re.match(r"\w+ +[\d.]+ +[\d.]+ +[\d.]+ +[\d,]+ ", line)}
    assert list(rows) == ["USB", "sort", "links", "hops", "rasterise", "boundary"]
    assert rows["links"].split()[1:5] == ["27.11", "40.72", "13.60", "73,529"]
    bars = [re.search(r" ([#.]+) *$", row) for row in rows.values()]
    spans = [bar.span(1) for bar in bars if bar is not None]
    assert len(spans) == 6
    for (begin, end), (later_begin, later_end) in pairwise(spans):
        assert (begin, end) < (later_begin, later_end)
        assert later_begin <= end
    assert "." in rows["boundary"].split()[-1]
    assert "Memory of a processor: 56,352 of 65,536 bytes, 86%." in lines
    assert "52.72 µs at best; 77.71 µs just missing a boundary" in "\n".join(lines)


@pytest.mark.parametrize(("name", "begin"), [("b.png", b"\x89PNG"), ("b.svg", b"<?xml")])
def test_the_picture(budget: Run, tmp_path: Path, name: str, begin: bytes) -> None:
    assert budget("--picture", name).code == 0
    assert (tmp_path / name).read_bytes().startswith(begin)


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (("--link", "3wire"), "unknown link '3wire'; known are 5wire, 2wire"),
        (("--cycles-per-symbol", "1"), "2 to 2047"),
        (("--token-delay", "-1"), "0 to 2047"),
        (("--hop-ns", "-1"), "0 to 1000000"),
        (("--hop-ns", "nan"), "0 to 1000000"),
        (("--baud", "0"), "a serial line of 0 baud"),
        (("--picture", "b.txt"), "a picture's name ends in"),
        (("--picture", "nowhere/b.png"), "no folder nowhere"),
        (("--picture", "b.png", "--json", "b.png"), "to be written twice"),
    ],
)
def test_wrong_use_is_refused(budget: Run, tmp_path: Path, options: tuple[str, ...], complaint: str) -> None:
    outcome = budget(*options)
    assert (outcome.code, outcome.out) == (2, "")
    assert complaint in " ".join(outcome.err.split())
    assert list(tmp_path.iterdir()) == []
