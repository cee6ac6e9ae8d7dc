"""How many small random changes of the product's code the unit tests notice, by room.

Two steps, both on a quiet machine. The first runs the unit tests under coverage and keeps which test reaches which
line; the second makes changes of a fixed seed, one at a time, and runs the tests that reach the changed line. It does
so in forks of one process that has imported all tests: a fork exchanges the code of the changed functions. What numba
compiles is left out, as the tests compare it with readable oracles::

    python -m tests.mutation_score reach                       # twice as long as `make test`; writes build/mutation/
    python -m tests.mutation_score judge --count 1500 --minutes 90   # goes on where it stopped
    python -m tests.mutation_score judge --count 400 --matrix        # all tests that notice, not only the first
    python -m tests.mutation_score report
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import gc
import importlib
import itertools
import json
import os
import random
import resource
import signal
import subprocess
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from functools import _lru_cache_wrapper, partial
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, NamedTuple
from xml.etree import ElementTree

import pytest
from numba.core.registry import CPUDispatcher

ROOT = Path(__file__).resolve().parents[1]
BUILD = ROOT / "build" / "mutation"
REACHED, SECONDS = BUILD / "reached.json", BUILD / "seconds.json"
ROOMS = ("protocol", "solver", "emulator", "host", "hil", "view", "feel", "firmware", "cli", "base")
LEFT_OUT = ("/mutants/", "/groups/", "/tests/")
"""Folders of what is a test itself."""
PYTEST = str(Path(sys.executable).with_name("pytest"))
UNIT = "not slow and not guest and not page"
PATIENCE_SECONDS = 15.0
"""For the tests of one change, beyond three times what they take without it: more is an endless loop, and noticed."""
MOST_SECONDS = 30.0
"""Of tests for one change, the quick ones first. What only the others notice counts as not noticed."""
MOST_CASES = 3
"""Of one parametrised test for one change: those that take the least time."""
WARMING = 40
"""Files whose first test runs before the changes, so that what is compiled once need not be in each fork."""

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
        """The change's name, the same in each run."""
        return f"{self.file}:{self.line}:{self.start}:{' '.join(self.text.split())}"


def changes_of(file: str, source: str) -> Iterator[Change]:
    """All changes of the bodies of a file's functions."""
    starts = [0]
    for line in source.encode().split(b"\n"):
        starts.append(starts[-1] + len(line) + 1)

    def change(node: Any, text: str) -> Change:
        begin, end = starts[node.lineno - 1] + node.col_offset, starts[node.end_lineno - 1] + node.end_col_offset
        lines = "\n" * (node.end_lineno - node.lineno)  # what follows keeps its line
        return Change(file, node.lineno, begin, end, f"{text[:-1]}{lines})" if text.endswith(")") else text + lines)

    def words(node: ast.AST) -> str:
        return ast.unparse(node)

    for function in ast.walk(ast.parse(source)):
        if not isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        nodes = [each for statement in function.body for each in ast.walk(statement)]
        texts = {id(each) for node in nodes if isinstance(node, ast.JoinedStr) for each in ast.walk(node)}
        for node in (each for each in nodes if id(each) not in texts):  # whose places Python 3.11 does not know
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
        if room in ROOMS and not any(part in file for part in LEFT_OUT):
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
    tests = [each for each in reached.get(change.file, {}).get(str(change.line), []) if known(each) in seconds]
    tests.sort(key=lambda each: seconds[known(each)])
    left, chosen, cases = MOST_SECONDS, list[str](), Counter[str]()
    for each in tests:
        cases[function_of(each)] += 1
        if cases[function_of(each)] > MOST_CASES:
            continue
        left -= seconds[known(each)] + 0.01
        if left < 0 and chosen:
            break
        chosen.append(each)
    return chosen


def function_of(test: str) -> str:
    """The file and the function of a test, without its class and its parameters."""
    path, *names = test.partition("[")[0].split("::")
    return f"{path}::{names[-1]}"


def known(test: str) -> str:
    """A test as results.xml names it: a class of tests is not in its name there."""
    _, bracket, parameters = test.partition("[")
    return function_of(test) + bracket + parameters


class House:
    """Our live functions, whose code can be exchanged without importing anything again."""

    def __init__(self) -> None:
        self._functions: dict[str, list[FunctionType]] = defaultdict(list)
        self._compiled: set[int] = set()
        self._caches = list[Any]()
        for each in gc.get_objects():  # whose types are asked for, as a proxy of what is gone answers nothing
            kind = type(each)
            if kind is FunctionType:
                self._functions[os.path.realpath(each.__code__.co_filename)].append(each)
            elif issubclass(kind, CPUDispatcher):
                self._compiled.add(id(each.py_func))
            elif kind is _lru_cache_wrapper and each.__module__.startswith(("phasewire", "tests")):
                self._caches.append(each)

    def altered(self, change: Change) -> list[tuple[FunctionType, CodeType]] | None:
        """The functions that a change alters, with their new code; None if numba compiled one of them."""
        path = ROOT / change.file
        source = path.read_bytes()
        new = _codes(compile(source[: change.start] + change.text.encode() + source[change.stop :], path, "exec"))
        old = _codes(compile(source, path, "exec"))
        changed = {key for key, code in new.items() if old.get(key) != code}
        names = [(each, _name(each.__code__)) for each in self._functions[str(path)]]
        found = [(each, new[name]) for each, name in names if name in changed]
        return None if any(id(each) in self._compiled for each, _ in found) else found

    def alter(self, altered: list[tuple[FunctionType, CodeType]]) -> None:
        """Give functions their new code in this process."""
        for function, code in altered:
            function.__code__ = code
        for cache in self._caches:
            cache.cache_clear()


def _name(code: CodeType) -> tuple[str, int]:
    return code.co_qualname, code.co_firstlineno


def _codes(code: CodeType) -> dict[tuple[str, int], CodeType]:
    """The code of all functions of a module, by name and line."""
    inner = [each for each in code.co_consts if isinstance(each, CodeType)]
    return {_name(each): each for each in inner} | {key: it for each in inner for key, it in _codes(each).items()}


class Judging:
    """A plug-in of pytest that runs, for each change, the tests that reach it, in a fork of the collected session."""

    def __init__(self, changes: list[Change], whole: bool, log: Path, end: float) -> None:
        self._changes, self._whole, self._log, self._end = changes, whole, log, end
        self._failed = list[str]()

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection(self) -> None:
        """Let no failure be made smaller: only that there is one matters."""
        import hypothesis  # not before pytest, which rewrites it

        phases = [hypothesis.Phase.explicit, hypothesis.Phase.generate]
        hypothesis.settings.register_profile("judging", hypothesis.settings(database=None, phases=phases))
        hypothesis.settings.load_profile("judging")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Keep what failed."""
        if report.failed:
            self._failed.append(report.nodeid)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Judge all changes."""
        reached, seconds = json.loads(REACHED.read_text()), json.loads(SECONDS.read_text())
        items = {each.nodeid: each for each in session.items}
        order = {each: number for number, each in enumerate(items)}
        _run([next(its) for _, its in itertools.groupby(session.items, lambda item: item.path)][:WARMING])
        for each in {change.file for change in self._changes}:
            with contextlib.suppress(ImportError):  # of an extra that is not installed
                importlib.import_module(
                    "phasewire." + each.removesuffix(".py").replace("/", ".").removesuffix(".__init__")
                )
        house = House()
        gc.freeze()  # a fork then copies less
        for change in self._changes:
            if time.monotonic() > self._end:
                break
            chosen = [each for each in tests_for(change, reached, seconds) if each in items]
            tests = sorted(chosen, key=order.__getitem__)
            altered = house.altered(change)
            found = ["compiled"] if altered is None else ["not reached"]
            if tests and altered:
                limit = PATIENCE_SECONDS + 3 * sum(seconds[known(each)] for each in tests)
                found = self._noticed(partial(house.alter, altered), [items[each] for each in tests], limit)
            with self._log.open("a") as file:
                print(json.dumps({"name": change.name, "tests": len(tests), "found": found}), file=file)
        return True

    def _noticed(self, alter: Callable[[], None], items: list[pytest.Item], limit: float) -> list[str]:
        """The tests that notice a change, which `alter` makes; empty if none does."""
        result = Path(f"{self._log}.{os.getpid()}")
        result.unlink(missing_ok=True)
        if not (child := os.fork()):
            with contextlib.suppress(BaseException):
                os.setsid()
                resource.setrlimit(resource.RLIMIT_CPU, (int(limit), int(limit)))
                alter()
                _run(items, stop=lambda: bool(self._failed) and not self._whole)
                result.write_text(json.dumps(sorted(set(self._failed))))
            os._exit(0)
        end = time.monotonic() + 1.5 * limit  # by the wall clock, for what waits without end
        while not os.waitpid(child, os.WNOHANG)[0]:
            if time.monotonic() > end:
                os.killpg(child, signal.SIGKILL)
            time.sleep(0.01)
        return list(json.loads(result.read_text())) if result.exists() else ["no end"]


def _run(items: list[pytest.Item], stop: Callable[[], bool] = bool) -> None:
    for item, following in zip(items, [*items[1:], None], strict=True):
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
        if stop():
            break


def judge(count: int, jobs: int, minutes: float, whole: bool) -> None:
    """Judge changes that were not judged yet, for so many minutes."""
    this = [sys.executable, "-P", __file__, "work", "--count", str(count), "--minutes", str(minutes)]
    this += ["--jobs", str(jobs), *(["--matrix"] if whole else [])]
    environment = os.environ | {"CI": "1", "NUMBA_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    crew = [subprocess.Popen([*this, "--number", str(number)], cwd=ROOT, env=environment) for number in range(jobs)]
    for each in crew:
        each.wait()
    report(_log(whole))


def _log(whole: bool) -> Path:
    return BUILD / ("matrix.jsonl" if whole else "score.jsonl")


def work(count: int, jobs: int, minutes: float, whole: bool, number: int) -> None:
    """Judge one of `jobs` shares of the changes."""
    log = _log(whole)
    done = {json.loads(line)["name"] for line in log.read_text().splitlines()} if log.exists() else set()
    mine = [each for each in drawn(count)[number::jobs] if each.name not in done]
    judging = Judging(mine, whole, log, time.monotonic() + 60 * minutes)
    pytest.main(["-q", "-n", "0", "-p", "no:cacheprovider", "-m", UNIT], plugins=[judging])


def report(log: Path) -> None:
    """Print the share of changes that were noticed, by room."""
    noticed, all_of = Counter[str](), Counter[str]()
    for line in log.read_text().splitlines() if log.exists() else []:
        entry = json.loads(line)
        if entry["found"] == ["compiled"]:
            continue
        for room in (entry["name"].split("/")[0], "in all"):
            all_of[room] += 1
            noticed[room] += bool(entry["found"]) and entry["found"] != ["not reached"]
    for room, number in sorted(all_of.items()):
        print(f"{room:10} {noticed[room]:5} of {number:5}  {noticed[room] / number:.1%}")


def main() -> None:
    """Do one step."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("step", choices=["reach", "judge", "work", "report"])
    parser.add_argument("--count", type=int, default=1500)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--matrix", action="store_true")
    parser.add_argument("--number", type=int, default=0, help="which share of the jobs this process works on")
    chosen = parser.parse_args()
    if chosen.step == "reach":
        reach(chosen.jobs)
    elif chosen.step == "judge":
        judge(chosen.count, chosen.jobs, chosen.minutes, chosen.matrix)
    elif chosen.step == "work":
        work(chosen.count, chosen.jobs, chosen.minutes, chosen.matrix, chosen.number)
    else:
        report(_log(chosen.matrix))


if __name__ == "__main__":
    main()
