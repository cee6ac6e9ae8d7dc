"""Examples in the documents run, and their links lead to existing files."""

from __future__ import annotations

import ast
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from copy import deepcopy
from pathlib import Path
from types import ModuleType
from typing import Any

import nbformat
import pytest
import typer
import yaml
from nbclient import NotebookClient
from phasewire.__main__ import main
from phasewire.cli.commands import command_line
from phasewire.cli.settings import each_command
from phasewire.hil.conformance.cases import Need
from phasewire.hil.conformance.clauses import requirements
from phasewire.hil.conformance.mutants.catalogue import MUTANTS
from phasewire.hil.conformance.mutants.processors import known_mutants
from phasewire.hil.conformance.running import catalogue
from typer.core import TyperGroup

ROOT = Path(__file__).parents[1]
DOCUMENTS = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "protocol/SPEC.md")),
    *(ROOT / name / "README.md" for name in ("examples", "firmware")),
    *sorted((ROOT / "docs").rglob("*.md")),
]
GUIDES_TO_THE_CODE = ("explanation/architecture", "explanation/maintainer", "how-to/extend", "reference/glossary")
README = (ROOT / "README.md").read_text(encoding="utf-8")
FIRST_STEPS = (ROOT / "docs/tutorial/first-steps.md").read_text(encoding="utf-8")


def test_the_python_of_the_first_steps_runs(capsys: pytest.CaptureFixture[str]) -> None:
    (way,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    solver, touch = re.findall(r"```python\n(.*?)```", FIRST_STEPS, re.DOTALL)
    exec(compile(way, "README.md", "exec"), {})
    first, second = (float(number) for number in re.findall(r"[\d.]+", capsys.readouterr().out))
    assert second / first == pytest.approx(0.5, abs=0.05)
    exec(compile(solver, "first-steps.md", "exec"), {})
    mean, spread = (float(number) for number in re.findall(r"[\d.]+", capsys.readouterr().out))
    assert mean > 1000
    assert spread < 0.5  # per cent
    exec(compile(touch, "first-steps.md", "exec"), {})
    arcs, points = (int(number) for number in re.findall(r"\d+", capsys.readouterr().out))
    assert points > arcs > 0


@pytest.mark.filterwarnings("ignore:backend 'cuda' is replaced by 'cpu'")
@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("explanation/protocol.md", 2),
        ("explanation/emulator.md", 1),
        ("reference/faults.md", 1),
        ("how-to/flashing.md", 1),
        ("how-to/host.md", 3),
        ("how-to/rigs.md", 1),
        ("how-to/conformance.md", 2),
        ("how-to/hands.md", 3),
        ("how-to/view.md", 1),
        ("explanation/touch.md", 3),
        ("explanation/solver.md", 1),
        ("explanation/hardware.md", 1),
        ("explanation/rendering.md", 2),
        ("explanation/quiet-and-safe.md", 1),
        ("explanation/skin.md", 1),
        ("how-to/feel.md", 1),
        ("how-to/sweeps.md", 1),
        ("how-to/gpu.md", 1),
        ("how-to/xs1.md", 1),
    ],
)
def test_the_python_of_the_documents_runs(
    name: str, count: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "my_analyser", ModuleType("my_analyser"))  # of a reader's bench
    guide = (ROOT / "docs" / name).read_text(encoding="utf-8")
    examples = re.findall(r"```python\n(.*?)```", guide, re.DOTALL)
    assert len(examples) == count
    for example in examples:
        exec(compile(example, name, "exec"), {})


@pytest.mark.slow
def test_the_commands_of_the_first_steps_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PHASEWIRE_DEVICE", raising=False)
    shown = re.findall(r"^\.venv/bin/phasewire (.*?)(?: +#.*)?$", README + FIRST_STEPS, re.MULTILINE)
    commands = list(dict.fromkeys(shown))  # each once, in order
    assert len(commands) == 20
    for command in commands:
        arguments = shlex.split(command)
        if "--umockdev" in arguments and shutil.which("umockdev-wrapper") is None:
            continue
        if arguments[0] == "emulate":  # which would serve until Ctrl-C
            arguments += ["--seconds", "0", "--port", "0"]
        if arguments[0] == "view":  # likewise
            arguments += ["--seconds", "0.1", "--no-browser", "--unwatched"]
        with pytest.raises(SystemExit) as exited:
            main(arguments)
        assert not exited.value.code, command


def shown_in(text: str) -> list[str]:
    """Every command line that a text shows: in its blocks of shell, and between backticks."""
    blocks = re.findall(r"```sh\n(.*?)```", text, re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines()]
    inline = re.findall(r"`(phasewire [^`]+)`", re.sub(r"```.*?```", "", text, flags=re.DOTALL))
    typed = (re.search(r"(?:^|[ /])phasewire ([^|>]*)", line) for line in (*lines, *inline))
    return [match[1] for match in typed if match]


def understood(line: str) -> str:
    """The command that a line names, once all its options are known to it."""
    context = typer.Context(command_line(), info_name="phasewire")
    words = shlex.split(line, comments=True)
    while isinstance(context.command, TyperGroup) and words and not words[0].startswith("-"):
        name = words.pop(0)
        assert name in context.command.commands, f"there is no command {name}: {line}"
        context = typer.Context(context.command.commands[name], parent=context, info_name=name)
    context.command.make_parser(context).parse_args(words)  # raises if an option is unknown
    return context.command_path.partition(" ")[2]


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_commands_that_are_shown_exist_with_their_options(document: Path) -> None:
    for line in shown_in(document.read_text(encoding="utf-8")):
        understood(line)


def test_the_workflow_runs_commands_that_exist_and_keeps_what_they_write() -> None:
    workflow = yaml.safe_load((ROOT / "examples/ci/conformance.yml").read_text(encoding="utf-8"))
    steps = workflow["jobs"]["conformance"]["steps"]
    install, *lines = [step["run"] for step in steps if "run" in step]
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    source = r'python -m pip install "phasewire\[(\w+)\] @ \$(\w+)"'  # it is on no package index yet
    extra, variable = re.fullmatch(source, install).groups()  # type: ignore[union-attr]  # None fails, too
    assert extra in extras
    assert workflow["jobs"]["conformance"]["env"][variable].startswith("git+https://")
    assert [understood(line.removeprefix("phasewire ")) for line in lines] == ["doctor", "conformance"]
    (kept,) = [step for step in steps if step.get("uses", "").startswith("actions/upload-artifact@")]
    assert kept["if"] == "always()"
    assert kept["with"]["path"].split() == re.findall(r"--(?:junit|html) (\S+)", lines[-1])


def test_examples_in_the_help_of_commands_exist_with_their_options() -> None:
    for context in each_command(typer.Context(command_line(), info_name="phasewire")):
        example = (context.command.epilog or "").removeprefix("Example: phasewire ")
        assert understood(example) == context.command_path.partition(" ")[2]


def test_the_reference_lists_every_command() -> None:
    reference = (ROOT / "docs/reference/cli.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| `phasewire ([\w -]+)` \|", reference, re.MULTILINE)
    context = typer.Context(command_line(), info_name="phasewire")
    assert sorted(listed) == sorted(each.command_path.partition(" ")[2] for each in each_command(context))


def test_the_index_leads_to_every_document() -> None:
    index = (ROOT / "docs/index.md").read_text(encoding="utf-8")
    named = {(ROOT / "docs" / f"{line}.md").resolve() for line in re.findall(r"^[\w./-]+$", index, re.MULTILINE)}
    tutorials = set((ROOT / "docs/tutorial").glob("*.md"))
    assert named | tutorials | {ROOT / "docs/index.md"} == set(DOCUMENTS)


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_somewhere(document: Path) -> None:
    targets = re.findall(r"\]\((?!https?:)([^)#]+)\)", document.read_text(encoding="utf-8"))
    assert [target for target in targets if not (document.parent / target).exists()] == []


def test_files_and_targets_named_in_the_guides_exist() -> None:
    names = ("CONTRIBUTING.md", *(f"docs/{each}.md" for each in GUIDES_TO_THE_CODE))
    guide = "\n".join((ROOT / name).read_text(encoding="utf-8") for name in names)
    rooms = "base|protocol|solver|emulator|firmware|host|hil|feel|view|cli|tests"
    files = re.findall(rf"`((?:{rooms})/[\w/]+\.\w+)`", guide)
    assert len(files) > 100
    assert [name for name in files if not (ROOT / name).exists()] == []
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"^make ([\w-]+)", guide + README, re.MULTILINE):
        assert f"\n{target}:" in makefile


WORDS = ("ten", "eleven", "twelve", "thirteen", "fourteen", "fifteen")
MANY = r"(\d[\d ]*)"
NUMBERS = {
    ("README.md", r"\[(\w+) examples\]"): "examples",
    ("examples/README.md", r"(\w+) short programs"): "examples",
    ("docs/explanation/proof.md", r"each of the (\d+) sentences with MUST"): "sentences",
    ("docs/explanation/proof.md", rf"can: {MANY} cases"): "cases",
    ("docs/explanation/proof.md", r"(\d+) of them judged by the outputs alone"): "cases that need a capture",
    ("docs/explanation/proof.md", r"of (\d+) emulators that are broken"): "mutants",
    ("docs/explanation/proof.md", r"are among the (\d+) now"): "mutants",
    ("docs/explanation/proof.md", r"(\d+) were put in, in assembly and C"): "mutants of firmware",
    ("docs/explanation/proof.md", r"each of (\d+) bugs in its C"): "mutants of the reference",
    ("docs/how-to/conformance.md", rf"of {MANY} cases are"): "cases",
    ("docs/how-to/conformance.md", rf"Of {MANY} cases and parts"): "cases",
    ("docs/how-to/usb_device.md", rf"Of its\s+{MANY} cases"): "cases",
    ("docs/how-to/usb_device.md", r"cases (\d+) need a capture"): "cases that need a capture",
    ("firmware/README.md", rf"of {MANY} cases pass"): "cases",
}
"""Where documents count, and what they count there."""


def count_of(what: str) -> int:
    match what:
        case "examples":
            return len(list((ROOT / "examples").glob("*.py")))
        case "sentences":
            return len(requirements())
        case "cases":
            return len(catalogue())
        case "cases that need a capture":
            return sum(Need.CAPTURE in each.about.needs for each in catalogue())
        case "mutants":
            return len(MUTANTS)
        case "mutants of firmware":
            return len(known_mutants())
        case _:
            files = sorted((ROOT / "hil/conformance/mutants/core").glob("*.toml"))
            return sum(len(tomllib.loads(file.read_text(encoding="utf-8"))) for file in files)


@pytest.mark.slow  # to collect all cases takes seconds
@pytest.mark.parametrize(("document", "pattern"), NUMBERS)
def test_documents_count_as_the_code_does(document: str, pattern: str) -> None:
    (said,) = re.findall(pattern, (ROOT / document).read_text(encoding="utf-8"))
    number = WORDS.index(said.lower()) + 10 if said.lower() in WORDS else int(said.replace(" ", ""))
    assert number == count_of(NUMBERS[document, pattern])


def test_examples_import_only_what_is_installed_or_name_the_extra() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    known = {"phasewire", *sys.stdlib_module_names}
    known |= {re.match(r"[\w-]+", each)[0] for each in project["dependencies"]}  # type: ignore[index]  # they have names
    for example in (ROOT / "examples").glob("*.py"):
        for each in ast.parse(example.read_text(encoding="utf-8")).body:
            if isinstance(each, ast.Import | ast.ImportFrom):
                names = [each.module or ""] if isinstance(each, ast.ImportFrom) else [one.name for one in each.names]
                assert {name.partition(".")[0] for name in names} <= known, example


@pytest.mark.slow
@pytest.mark.parametrize("example", sorted((ROOT / "examples").glob("*.py")), ids=lambda path: path.name)
def test_examples_are_short_and_run(example: Path, tmp_path: Path) -> None:
    assert len(example.read_text(encoding="utf-8").splitlines()) < 40
    assert f"({example.name})" in (ROOT / "examples/README.md").read_text(encoding="utf-8")
    ended = subprocess.run(
        [sys.executable, str(example)], cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False
    )
    assert (ended.returncode, ended.stderr) == (0, "")


@pytest.mark.slow
def test_the_tour_runs_and_shows_what_it_shows() -> None:
    """`jupyter execute --inplace docs/tutorial/tour.ipynb` stores them."""
    reader: Any = nbformat  # which has no annotations
    stored = reader.read(ROOT / "docs/tutorial/tour.ipynb", as_version=4)
    fresh = NotebookClient(deepcopy(stored), timeout=300, kernel_name="python3").execute()
    for before, after in zip(stored.cells, fresh.cells, strict=True):
        told = [each for each in after.get("outputs", []) if "compiles its kernels" not in each.get("text", "")]
        for one, other in zip(before.get("outputs", []), told, strict=True):
            assert set(one.get("data", {})) == set(other.get("data", {}))
            assert one.get("data", {}).get("text/plain") == other.get("data", {}).get("text/plain")
