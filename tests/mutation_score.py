"""How many small random changes of the product's code the unit tests notice, by room.

Two steps, both on a quiet machine. The first runs the unit tests under coverage and keeps which test reaches which
line; the second makes changes of a fixed seed, one at a time, and runs the tests that reach the changed line::

    python -m tests.mutation_score reach                       # some ten minutes; writes build/mutation/
    python -m tests.mutation_score judge --count 1500 --minutes 90   # goes on where it stopped
    python -m tests.mutation_score judge --count 400 --matrix        # all tests that notice, not only the first
    python -m tests.mutation_score report
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import shutil
import subprocess
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import Queue
from typing import Any, NamedTuple
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parents[1]
BUILD = ROOT / "build" / "mutation"
REACHED, SECONDS = BUILD / "reached.json", BUILD / "seconds.json"
ROOMS = ("protocol", "solver", "emulator", "host", "hil", "view", "feel", "firmware", "cli", "base")
PYTEST = str(Path(sys.executable).with_name("pytest"))
UNIT = "not slow and not guest and not page"
PATIENCE_SECONDS = 60.0
"""For the tests of one change, beyond five times what they take without it: more is an endless loop, and noticed."""
MOST_SECONDS = 90.0
"""Of tests for one change, the quick ones first. What only the others notice counts as not noticed."""

COMPARISONS = {
    ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "==",
    ast.Is: "is not", ast.IsNot: "is", ast.In: "not in", ast.NotIn: "in",
}  # fmt: skip
OPERATIONS = {
    ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.FloorDiv: "*", ast.Mod: "*",
    ast.BitAnd: "|", ast.BitOr: "&", ast.LShift: ">>", ast.RShift: "<<",
}  # fmt: skip


class Change(NamedTuple):
    """A text of a file that becomes another."""

    file: str
    line: int
    start: int
    """In bytes of the file, as is `stop`."""
    stop: int
    text: str

    @property
    def name(self) -> str:
        """Of the change, the same in each run."""
        return f"{self.file}:{self.line}:{self.start}:{self.text}"


def changes_of(file: str, source: str) -> Iterator[Change]:
    """All changes of the bodies of a file's functions."""
    starts = [0]
    for line in source.encode().split(b"\n"):
        starts.append(starts[-1] + len(line) + 1)

    def change(node: Any, text: str, last: Any = None) -> Change:
        last = last or node
        begin = starts[node.lineno - 1] + node.col_offset
        return Change(file, node.lineno, begin, starts[last.end_lineno - 1] + last.end_col_offset, text)

    def words(node: ast.AST) -> str:
        return ast.unparse(node)

    for function in ast.walk(ast.parse(source)):
        if not isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        for node in (each for statement in function.body for each in ast.walk(statement)):
            match node:
                case ast.Compare(left=left, ops=[operator], comparators=[right]):
                    yield change(node, f"({words(left)} {COMPARISONS[type(operator)]} {words(right)})")
                case ast.BinOp(left=left, op=operator, right=right) if type(operator) in OPERATIONS:
                    if not isinstance(left, ast.JoinedStr | ast.Constant) or isinstance(getattr(left, "value", 0), int):
                        yield change(node, f"({words(left)} {OPERATIONS[type(operator)]} {words(right)})")
                case ast.Constant(value=bool(value)):
                    yield change(node, str(not value))
                case ast.Constant(value=int(value)):
                    yield change(node, str(value + 1))
                case ast.If(test=test) | ast.While(test=test) | ast.IfExp(test=test):
                    yield change(test, f"(not ({words(test)}))")
                case ast.BoolOp(op=operator, values=values):
                    joint = " or " if isinstance(operator, ast.And) else " and "
                    yield change(node, "(" + joint.join(f"({words(each)})" for each in values) + ")")
                case ast.Expr(value=ast.Call()) | ast.Assign(targets=[ast.Attribute()]) | ast.AugAssign() | ast.Raise():
                    yield change(node, "pass")


def drawn(count: int, seed: int = 41) -> list[Change]:
    """Changes of a fixed seed, from each room as many as its share of all; each once."""
    found: dict[str, dict[str, Change]] = defaultdict(dict)
    listed = subprocess.run(["git", "ls-files", "*.py"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for file in listed.split():
        room = file.split("/")[0]
        if room in ROOMS and "/mutants/" not in file and "/tests/" not in file:
            for each in changes_of(file, (ROOT / file).read_text(encoding="utf-8")):
                found[room][each.name] = each
    whole = sum(map(len, found.values()))
    chance = random.Random(seed)
    chosen = [
        each
        for room, its in sorted(found.items())
        for each in chance.sample(sorted(its.values()), max(round(count * len(its) / whole), 1))
    ]
    chance.shuffle(chosen)
    return chosen


def reach(jobs: int) -> None:
    """Run the unit tests under coverage; keep the tests that reach each line, and the seconds of each."""
    from coverage import CoverageData

    BUILD.mkdir(parents=True, exist_ok=True)
    data, results = BUILD / "coverage", BUILD / "results.xml"
    command = [PYTEST, "-q", "-n", str(jobs), "-m", UNIT, f"--junitxml={results}", "-o"]
    command += ["junit_family=xunit1", *(f"--cov={room}" for room in ROOMS), "--cov-context=test", "--cov-report="]
    subprocess.run(command, cwd=ROOT, check=False, env=os.environ | {"COVERAGE_FILE": str(data)})
    read = CoverageData(str(data))
    read.read()
    reached: dict[str, dict[int, list[str]]] = {}
    for path in read.measured_files():
        lines = read.contexts_by_lineno(path)
        tests = {line: sorted({name.rpartition("|")[0] for name in names} - {""}) for line, names in lines.items()}
        reached[Path(path).relative_to(ROOT).as_posix()] = tests
    REACHED.write_text(json.dumps(reached))
    seconds = {
        f"{case.get('file')}::{case.get('name')}": float(case.get("time", "0"))
        for case in ElementTree.parse(results).iter("testcase")
        if not list(case)  # neither failed nor skipped
    }
    SECONDS.write_text(json.dumps(seconds))
    print(f"{len(seconds)} tests reach {sum(map(len, reached.values()))} lines")


def tests_for(change: Change, reached: dict[str, dict[str, list[str]]], seconds: dict[str, float]) -> list[str]:
    """The tests that reach a change's line and passed without it, the quick ones first, as far as time allows."""
    tests = [each for each in reached.get(change.file, {}).get(str(change.line), []) if _known(each) in seconds]
    tests.sort(key=lambda each: seconds[_known(each)])
    left, chosen = MOST_SECONDS, list[str]()
    for each in tests:
        left -= seconds[_known(each)] + 0.01
        if left < 0 and chosen:
            break
        chosen.append(each)
    return chosen


def _known(test: str) -> str:
    """A test as results.xml names it: a class of tests is not in its name there."""
    path, *names = test.split("::")
    return f"{path}::{names[-1]}"


def judged(change: Change, tests: list[str], tree: Path, limit: float, whole: bool) -> list[str]:
    """The tests that notice a change in a copy of the house, or why they cannot run; empty if none does."""
    target = tree / change.file
    kept = target.read_bytes()
    target.write_bytes(kept[: change.start] + change.text.encode() + kept[change.stop :])
    names, results = tree / "tests.txt", tree / "results.xml"
    names.write_text("\n".join(tests))
    command = [PYTEST, "-q", "-n", "0", "-p", "no:cacheprovider", f"--junitxml={results}", f"@{names}"]
    command += [] if whole else ["-x"]
    environment = os.environ | {"PYTHONPATH": str(tree / "typings"), "NUMBA_CACHE_DIR": str(tree / "build" / "numba")}
    environment["PYTHONDONTWRITEBYTECODE"] = "1"
    results.unlink(missing_ok=True)
    try:
        done = subprocess.run(command, cwd=tree, env=environment, timeout=limit, capture_output=True, check=False)
    except subprocess.TimeoutExpired:
        return ["no end"]
    finally:
        target.write_bytes(kept)
    if done.returncode == 0:
        return []
    if not results.exists():
        return ["no start"]
    cases = ElementTree.parse(results).iter("testcase")
    found = [f"{case.get('classname')}::{case.get('name')}" for case in cases if list(case)]
    return found or ["no start"]


def judge(count: int, jobs: int, minutes: float, whole: bool) -> None:
    """Judge changes that were not judged yet, for so many minutes."""
    reached, seconds = json.loads(REACHED.read_text()), json.loads(SECONDS.read_text())
    log = BUILD / ("matrix.jsonl" if whole else "score.jsonl")
    done = {json.loads(line)["name"] for line in log.read_text().splitlines()} if log.exists() else set()
    trees: Queue[Path] = Queue()
    for number in range(jobs):
        tree = BUILD / f"house{number}"
        shutil.rmtree(tree, ignore_errors=True)
        tree.mkdir(parents=True)
        archive = subprocess.Popen(["git", "archive", "HEAD"], cwd=ROOT, stdout=subprocess.PIPE)
        subprocess.run(["tar", "x", "-C", tree], stdin=archive.stdout, check=True)
        trees.put(tree)
    end = time.monotonic() + 60 * minutes

    def one(change: Change) -> None:
        tests = tests_for(change, reached, seconds)
        if time.monotonic() > end:
            return
        found = ["not reached"]
        if tests:
            tree = trees.get()
            limit = PATIENCE_SECONDS + 5 * sum(seconds[_known(each)] for each in tests)
            found = judged(change, tests, tree, limit, whole)
            trees.put(tree)
        with log.open("a") as file:
            print(json.dumps({"name": change.name, "tests": len(tests), "found": found}), file=file)

    with ThreadPoolExecutor(jobs) as crew:
        list(crew.map(one, (each for each in drawn(count) if each.name not in done)))
    report()


def report() -> None:
    """Print the share of changes that were noticed, by room."""
    noticed, all_of = Counter[str](), Counter[str]()
    for line in (BUILD / "score.jsonl").read_text().splitlines():
        entry = json.loads(line)
        for room in (entry["name"].split("/")[0], "in all"):
            all_of[room] += 1
            noticed[room] += bool(entry["found"]) and entry["found"] != ["not reached"]
    for room, number in sorted(all_of.items()):
        print(f"{room:10} {noticed[room]:5} of {number:5}  {noticed[room] / number:.1%}")


def main() -> None:
    """Do one step."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("step", choices=["reach", "judge", "report"])
    parser.add_argument("--count", type=int, default=1500)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--matrix", action="store_true")
    chosen = parser.parse_args()
    if chosen.step == "reach":
        reach(chosen.jobs)
    elif chosen.step == "judge":
        judge(chosen.count, chosen.jobs, chosen.minutes, chosen.matrix)
    else:
        report()


if __name__ == "__main__":
    main()
