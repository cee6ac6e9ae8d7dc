"""The command that judges a device: ``conformance``."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from difflib import get_close_matches
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..base.extras import needing
from ..base.signals import SIGNALLED, loading, postponing
from ..base.storage import check_outputs, write_file
from ..hil.conformance.cases import Risk
from ..hil.conformance.known import read_known_failures
from ..hil.conformance.matrix import Matrix
from ..hil.conformance.profile import Profile, read_profile
from ..hil.conformance.reports.junit import junit
from ..hil.conformance.reports.page import page
from ..hil.conformance.reports.records import record
from ..hil.conformance.verdicts import Run, Verdict
from ..host.transports.opening import DEFAULT_URL
from .commands import FAILED, WRONG_USE, complain, message
from .console import JsonOption, among, console_for, error_console, given, print_list, write_json
from .options import DeviceOption, note_where_fresh

if TYPE_CHECKING:
    from ..hil.conformance.mutants.patching import Mutant
    from ..hil.conformance.plugin import Watcher
    from ..hil.conformance.running import RunOptions

__all__ = ["commands"]

EMULATOR, SIGROK, NONE = "emulator", "sigrok:", "none"
LIST_FORMAT = "phasewire-conformance-matrix-1"
NOTHING_SHOWN = (
    "no case passed, so this run shows nothing about the device; choose more cases, or give what they need, such as "
    "--capture or --allow"
)
OF_MUTANTS = ("mutants", "jobs", "thorough", "table", "json_target")

commands = typer.Typer(rich_markup_mode=None)


def _check_mutants_are_here() -> None:
    """Raise ValueError if the mutants are missing: the wheel leaves them out."""
    if find_spec("phasewire.hil.conformance.mutants") is None:
        raise ValueError(
            "mutants are not installed with phasewire: they stand in its repository, in the folder mutants, and "
            "`make mutants` judges them there"
        )


def _offered_mutants(incomplete: str) -> list[str]:
    """A shell's completions for a mutant."""
    if find_spec("phasewire.hil.conformance.mutants") is None:
        return []
    from ..hil.conformance.mutants.catalogue import MUTANTS

    return among(MUTANTS)(incomplete)


@commands.command(epilog="Example: phasewire conformance --device usb: --allow reset --html report.html")
def conformance(
    context: typer.Context,
    url: DeviceOption = DEFAULT_URL,
    capture: Annotated[
        str | None,
        typer.Option(
            "--capture",
            metavar="emulator|sigrok:FILE|SCHEME:…|none",
            help="What the outputs are seen by: the emulator, a logic analyser's recording of the run, of which the "
            "profile says where each probe sits, what another package offers, or nothing. By default the emulator if "
            "it runs in this process.",
            autocompletion=among((EMULATOR, SIGROK, NONE)),
        ),
    ] = None,
    levers: Annotated[
        list[str] | None,
        typer.Option(
            "--levers",
            metavar="emulator|command:…|SCHEME:…",
            help="What can be done to the device: 'command:power=PROGRAM {}' runs a program that switches its power, "
            "with on or off for {}, and command:cable= one that switches the voltage of its cable; or what another "
            "package offers; may be given again. By default all that the emulator can if it runs in this process.",
            autocompletion=among((EMULATOR, "command:power=", "command:cable=")),
        ),
    ] = None,
    door: Annotated[
        list[str] | None,
        typer.Option(
            "--door",
            metavar="URL",
            help="A further line of the same device, such as 'serial:///dev/ttyUSB0' for the UART of a device on USB: "
            "the rules of safety are tried there too; may be given again. By default the other line of the emulator "
            "if it runs in this process.",
        ),
    ] = None,
    allow: Annotated[
        list[Risk] | None,
        typer.Option(
            "--allow",
            metavar="|".join(Risk),
            help="A risk that is allowed: writing firmware, restarting the device, driving many transducers hard; may "
            "be given again. By default none, and all if the device is emulated in this process.",
        ),
    ] = None,
    profile: Annotated[
        Path | None,
        typer.Option("--profile", metavar="FILE", help="The declaration of the device, in TOML."),
    ] = None,
    known_failures: Annotated[
        Path | None,
        typer.Option("--known-failures", metavar="FILE", help="Cases that are known to fail, and why, in TOML."),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(
            "--only",
            metavar="TEXT",
            help="Run or list only the cases whose group, name, clause or chapter begins so; may be given again.",
        ),
    ] = None,
    mutant: Annotated[
        str | None,
        typer.Option(
            "--mutant",
            metavar="NAME",
            help="Judge this emulated device, which is broken on purpose, to see the suite's verdict.",
            autocompletion=_offered_mutants,
        ),
    ] = None,
    mutants: Annotated[
        bool,
        typer.Option(
            "--mutants",
            help="Judge every such device, each in a process of its own, and list those that are not caught.",
        ),
    ] = False,
    jobs: Annotated[
        int | None,
        typer.Option(
            "--jobs", metavar="N", min=1, help="With --mutants: how many at a time; by default one a core, at most 4."
        ),
    ] = None,
    strict: Annotated[
        bool,
        typer.Option("--strict", help="Fail too if something could not be judged, or breaks a SHOULD."),
    ] = False,
    seed: Annotated[int, typer.Option("--seed", metavar="N", min=0, help="Seed of all random numbers.")] = 1,
    stop_after: Annotated[
        int | None, typer.Option("--stop-after", metavar="N", min=1, help="End the run after so many cases broke.")
    ] = None,
    thorough: Annotated[
        bool,
        typer.Option("--thorough", help="With --mutants: judge each by all cases, even after two have caught it."),
    ] = False,
    table: Annotated[
        Path | None,
        typer.Option("--table", metavar="FILE", help="With --mutants: also write the results as Markdown."),
    ] = None,
    list_cases: Annotated[
        bool,
        typer.Option("--list", help="List the clauses of the specification with their cases, and run nothing."),
    ] = False,
    html: Annotated[
        Path | None, typer.Option("--html", metavar="FILE", help="Also write a page for browsers and printers.")
    ] = None,
    junit_xml: Annotated[
        Path | None, typer.Option("--junit", metavar="FILE", help="Also write JUnit XML, as CI systems read it.")
    ] = None,
    json_target: JsonOption = None,
) -> None:
    """Judge a device by the specification: what it does, what it answers and, if they can be seen, its outputs.

    Each case shows some clauses. It passes, fails, warns if the device breaks a SHOULD, is inconclusive if it cannot be
    judged here, or is not applicable. An inconclusive case never counts as a pass.

    The exit code is 0 if nothing broke, whatever was inconclusive, and 1 if something did. A run that Ctrl-C or SIGTERM
    ends still writes its reports, with the results up to then, and its code is 130 or 143.
    """
    with loading(), needing("conformance", "phasewire conformance"):
        import pytest  # noqa: F401, I001  first, as most lack it
        import cryptography  # noqa: F401
    if mutants:
        _judge_mutants(context, jobs, table, json_target, thorough=thorough)
        return
    for name, chosen in (("--jobs", jobs), ("--thorough", thorough), ("--table", table)):
        if chosen:
            raise ValueError(f"{name} goes with --mutants")
    recording = (capture or "").partition(":")[2]
    inputs = [path for path in (profile, known_failures, Path(recording) if recording else None) if path is not None]
    check_outputs([html, junit_xml, json_target], inputs)
    if list_cases:
        _list(
            json_target,
            tuple(only or ()),
            [name for name, target in (("--html", html), ("--junit", junit_xml)) if target is not None],
        )
        return

    if mutant is not None and given(context, "url"):
        raise ValueError("--mutant brings a device of its own; leave out one of --device and --mutant")
    broken = None if mutant is None else _mutant(mutant)

    with loading():  # the modules of the cases
        from ..hil.conformance.plugin import selected
        from ..hil.conformance.reports.terminal import LiveLine, print_run
        from ..hil.conformance.running import RunOptions, catalogue, run_conformance

        if only:  # a wrong name is told before the device is opened
            selected(catalogue(), tuple(only))

    options = RunOptions(
        url,
        capture,
        tuple(levers or ()),
        frozenset(allow) if allow else None,
        Profile() if profile is None else read_profile(profile),
        {} if known_failures is None else read_known_failures(known_failures),
        tuple(only or ()),
        seed,
        enough=stop_after,
        doors=tuple(door or ()),
    )
    if broken is None:
        note_where_fresh(url)
    with ExitStack() as end:
        with LiveLine(error_console()) as watcher:
            judge = run_conformance if broken is None else partial(_run_mutant, broken)
            run = judge(options, watcher, lambda: end.enter_context(postponing()))
        if strict:
            run = _strictly(run)
        unwritten = _write(run, html, junit_xml, json_target)
        print_run(console_for(json_target), run)
    for error in unwritten:
        complain(message(error))
    if run.signal:
        raise typer.Exit(SIGNALLED + run.signal)
    if not run.passed:
        raise typer.Exit(FAILED)
    if not run.count(Verdict.PASS):
        complain(NOTHING_SHOWN)
        raise typer.Exit(FAILED)
    if unwritten:
        raise typer.Exit(WRONG_USE)


def _strictly(run: Run) -> Run:
    """The run, with trouble if something could not be judged, or breaks a SHOULD."""
    counts = ((Verdict.INCONCLUSIVE, "could not be judged"), (Verdict.WARN, "warned"))
    told = tuple(f"--strict: {run.count(verdict)} {words}" for verdict, words in counts if run.count(verdict))
    return replace(run, trouble=(*run.trouble, *told))


def _mutant(name: str) -> Mutant:
    _check_mutants_are_here()
    from ..hil.conformance.mutants.catalogue import MUTANTS

    if name not in MUTANTS:
        near = get_close_matches(name, MUTANTS)
        nearest = f"; the nearest {'are' if len(near) > 1 else 'is'} {', '.join(near)}" if near else ""
        raise ValueError(f"there is no mutant {name!r}{nearest}; docs/reference/mutants.md lists all")
    return MUTANTS[name]


def _judge_mutants(
    context: typer.Context, jobs: int | None, table: Path | None, json_target: str | None, *, thorough: bool
) -> None:
    """Run the suite against all mutants; exit code 1 if it does not catch one."""
    others = [name for name in context.params if name not in OF_MUTANTS and given(context, name)]
    if others:
        raise ValueError(
            "--mutants brings devices of its own; it goes with --jobs, --thorough, --table and --json alone"
        )
    check_outputs([table, json_target])
    _check_mutants_are_here()

    from ..hil.conformance.mutants.catalogue import MUTANTS
    from ..hil.conformance.mutants.reports import MutantLine, markdown, print_mutants
    from ..hil.conformance.mutants.reports import record as mutants_record
    from ..hil.conformance.mutants.running import DEFAULT_JOBS, run_mutants

    with MutantLine(error_console()) as watcher:
        results = run_mutants(list(MUTANTS.values()), jobs or DEFAULT_JOBS, watcher, thorough=thorough)
    write_json(json_target, mutants_record(results))
    if table is not None:
        write_file(table, markdown(results))
    print_mutants(console_for(json_target), results)
    if not all(result.fate.is_catch for result in results):
        raise typer.Exit(1)


def _run_mutant(broken: Mutant, options: RunOptions, watcher: Watcher, judged: Callable[[], object]) -> Run:
    """The run of a mutant, whose reports say that it is one."""
    from ..hil.conformance.mutants.patching import applied
    from ..hil.conformance.running import run_conformance

    with applied(broken):
        run = run_conformance(replace(options, url=broken.url), watcher, judged)
    device = run.provenance.device | {"mutant": f"{broken.name}: {broken.sentence}"}
    return replace(run, provenance=replace(run.provenance, device=device))


def _list(json_target: str | None, only: tuple[str, ...], meaningless: list[str]) -> None:
    if meaningless:
        raise ValueError(f"--list runs nothing, of which {' and '.join(meaningless)} could tell; leave one of them out")
    from ..hil.conformance.plugin import selected
    from ..hil.conformance.running import catalogue

    matrix = Matrix.of(entry.claim for entry in selected(catalogue(), only))
    if only:
        matrix = matrix.shown()
    print_list(console_for(json_target), matrix.table(), "clause")
    write_json(json_target, {"format": LIST_FORMAT} | matrix.record())


def _write(run: Run, html: Path | None, junit_xml: Path | None, json_target: str | None) -> list[OSError]:
    """Write the requested reports, each one even if another fails; returns the errors."""
    matrix, errors = Matrix.of(run.claims), list[OSError]()
    reports: list[Callable[[], None]] = []
    if html is not None:
        reports.append(lambda: write_file(html, page(run, matrix)))
    if junit_xml is not None:
        reports.append(lambda: write_file(junit_xml, junit(run)))
    if json_target is not None:
        reports.append(lambda: write_json(json_target, record(run, matrix)))
    for write in reports:
        try:
            write()
        except BrokenPipeError:
            raise
        except OSError as error:
            errors.append(error)
    return errors
