"""How many lines of tests could go, and how many of the noticed changes would then go unnoticed.

It reads what `tests.mutation_score` has measured. Tests go one after the other, those first that reach and notice the
least for their length; a test stays if a line would be left with fewer than two tests that reach it, or a change of
the first half with none that notices it. The second half says what that costs::

    python -m tests.mutation_score reach
    python -m tests.mutation_score judge --count 1500 --matrix
    python -m tests.mutation_cover
"""

from __future__ import annotations

import ast
import heapq
import json
import random
from collections import Counter, defaultdict

from .mutation_score import BUILD, REACHED, ROOT, function_of

LEAST_REACHING, LEAST_NOTICING = 2, 1
CHANGE_WEIGHT = 20
"""A noticed change counts as so many reached lines."""
STEP_LINES = 1000


def lengths() -> dict[str, int]:
    """Lines of each test function, with its decorators and two empty lines."""
    found = dict[str, int]()
    for path in ROOT.glob("tests/**/test_*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.name.startswith("test_"):
                first = min([node.lineno, *(each.lineno for each in node.decorator_list)])
                found[f"{path.relative_to(ROOT).as_posix()}::{node.name}"] = (node.end_lineno or first) - first + 3
    return found


def main() -> None:
    """Print how many changes of the second half go unnoticed as tests go."""
    size = lengths()
    lines = Counter(
        frozenset(map(function_of, tests)) for of in json.loads(REACHED.read_text()).values() for tests in of.values()
    )
    entries = [json.loads(line)["found"] for line in (BUILD / "matrix.jsonl").read_text().splitlines()]
    noticing = [tests for found in entries if (tests := {function_of(each) for each in found if "::" in each})]
    random.Random(1).shuffle(noticing)
    first, second = noticing[: len(noticing) // 2], noticing[len(noticing) // 2 :]
    left = [(set(tests), weight, LEAST_REACHING) for tests, weight in lines.items() if tests]
    left += [(set(tests), CHANGE_WEIGHT, LEAST_NOTICING) for tests in first]
    least = [min(wanted, len(tests)) for tests, _, wanted in left]
    holds = defaultdict[str, list[int]](list)
    for number, (tests, _, _) in enumerate(left):
        for test in tests & size.keys():
            holds[test].append(number)

    def worth(test: str) -> float:
        return sum(left[number][1] / len(left[number][0]) for number in holds[test]) / size[test]

    waiting = [(worth(test), test) for test in holds]
    heapq.heapify(waiting)
    gone, saved, due = set[str](), 0, STEP_LINES
    while waiting:
        before, test = heapq.heappop(waiting)
        if (now := worth(test)) > 1.02 * before:  # others that reached the same have gone meanwhile
            heapq.heappush(waiting, (now, test))
            continue
        if any(len(left[number][0]) - 1 < least[number] for number in holds[test]):
            continue
        for number in holds[test]:
            left[number][0].discard(test)
        gone.add(test)
        saved += size[test]
        if saved >= due or not waiting:
            unnoticed = sum(tests <= gone for tests in second)
            print(f"{saved:6} lines, {len(gone):5} tests: {unnoticed:4} of {len(second)} changes go unnoticed")
            due += STEP_LINES


if __name__ == "__main__":
    main()
