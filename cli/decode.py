"""The command that explains recorded traffic: ``decode``."""

from __future__ import annotations

import json
import shutil
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryFile
from typing import Annotated, Any, BinaryIO, TextIO

import typer
from rich.console import Console

from ..base.storage import check_outputs, replacing
from ..hil.traffic.recordings import FORMATS, open_recording, read_recording
from ..hil.traffic.traffic import DESCRIBERS, Piece, Traffic, hex_bytes
from ..hil.traffic.usbmon import UsbAddress
from ..protocol.board import COLUMNS
from ..protocol.describe import Description, Violation, describe_request
from ..protocol.pulses import Pulses
from .console import JsonOption, among, console_for

__all__ = ["commands", "explain"]

commands = typer.Typer(rich_markup_mode=None)

PLURALS = {"status": "statuses", "reply": "replies"}


@commands.command(epilog="Example: phasewire decode traffic.pcapng --only-invalid")
def decode(
    source: Annotated[str | None, typer.Argument(metavar="FILE", help="The recording; - is standard input.")] = None,
    hex_text: Annotated[
        str | None, typer.Option("--hex", metavar="TEXT", help="Decode these hex digits instead of a file.")
    ] = None,
    form: Annotated[
        str,
        typer.Option(
            "--format",
            metavar="NAME",
            help=f"What is in the file: {', '.join(FORMATS)}; auto judges by its content.",
            autocompletion=among(("auto", *FORMATS)),
        ),
    ] = "auto",
    usb_address: Annotated[
        str | None,
        typer.Option("--usb-address", metavar="B.D", help="Bus and device to follow in a capture, such as 1.5."),
    ] = None,
    pulses: Annotated[bool, typer.Option("--pulses", help="List the pulses, phase/width, in array order.")] = False,
    only_invalid: Annotated[bool, typer.Option("--only-invalid", help="Show only what is invalid.")] = False,
    json_target: JsonOption = None,
) -> None:
    """Explain recorded traffic, and name the clauses of the specification that it breaks.

    Reads captures of Linux's usbmon (pcap, pcapng), plain blocks and records, hex text and dumps,
    serial lines, firmware images, and messages of the chain.

    The exit code is 0 if all is valid and 1 if something is not.
    """
    if (source is None) == (hex_text is None):
        raise ValueError("what to decode is named once: a file, - for standard input, or --hex")
    address = None if usb_address is None else UsbAddress.parse(usb_address)
    check_outputs([json_target], [] if source in (None, "-") else [Path(str(source))])
    name = {None: "--hex", "-": "standard input"}.get(source, str(source))
    out, totals = console_for(json_target), Totals()
    with ExitStack() as stack:
        if source is None:
            stream: BinaryIO = BytesIO(hex_bytes(str(hex_text)))
        else:
            stream = stack.enter_context(open_recording(source))
        report = stack.enter_context(_report(json_target, name, totals))
        for piece in read_recording(stream, name, form, address):
            description = explain(piece)
            totals.count(description)
            if not (only_invalid and description.valid):
                _print_piece(out, piece, description, pulses)
                report(_record(piece, description, pulses))
    out.print(totals.text, style="bold green" if totals.all_valid else "bold red")
    if not totals.all_valid:
        raise typer.Exit(1)


class Totals:
    """The number of pieces of each kind, and of invalid ones."""

    def __init__(self) -> None:
        self.kinds: Counter[str] = Counter()
        self.invalid = 0

    def count(self, description: Description) -> None:
        """Count one."""
        self.kinds[description.kind] += 1
        self.invalid += not description.valid

    @property
    def all_valid(self) -> bool:
        """Whether all pieces were valid."""
        return self.invalid == 0

    @property
    def text(self) -> str:
        """The totals in a line."""
        kinds = [f"{count} {kind if count == 1 else _plural(kind)}" for kind, count in self.kinds.items()]
        return ", ".join([*kinds, f"{self.invalid} invalid"])


def _plural(kind: str) -> str:
    return PLURALS.get(kind, kind + "s")


def explain(piece: Piece) -> Description:
    """Describe a piece of traffic, and what is wrong with it or with its recording."""
    description = _described(piece)
    if piece.missing:
        finding = Violation("", "", f"{piece.missing} of its bytes were not recorded")
        return replace(description, findings=(finding,))
    if piece.problem:
        return replace(description, findings=(*description.findings, Violation("", "", piece.problem)))
    return description


def _described(piece: Piece) -> Description:
    if piece.traffic is Traffic.REQUEST:
        unknown = piece.stalled or piece.missing or piece.problem
        return describe_request(piece.setup, None if unknown else piece.data, stalled=piece.stalled)
    if piece.problem:
        return Description("transfer", f"of {piece.traffic}s")
    return DESCRIBERS[piece.traffic](piece.data)


def _print_piece(out: Console, piece: Piece, description: Description, list_pulses: bool) -> None:
    """Print a line about a piece, and what is wrong with it below.

    A table of rich would have to know all its rows before the first is printed.
    """
    time = "" if piece.time is None else f"{piece.time:13.6f} s  "
    line = f"{piece.where:<19} {time}{piece.direction or '':<4}{description.kind:<16}{description.summary}"
    out.out(line, style=None if description.valid else "red")
    for finding in description.findings:
        out.out(f"    ✗ {finding.said}", style="red")
    if list_pulses and description.pulses is not None:
        for row in _pulse_rows(description.pulses):
            out.out(f"    {row}")


def _pulse_rows(pulses: Pulses) -> Iterator[str]:
    """The pulses as phase/width, a line for each row of the grid."""
    each = [f"{phase:>2}/{width:<2}" for phase, width in zip(pulses.phase, pulses.width, strict=True)]
    for at in range(0, len(each), COLUMNS):
        yield " ".join(each[at : at + COLUMNS]).rstrip()


def _record(piece: Piece, description: Description, list_pulses: bool) -> dict[str, Any]:
    record: dict[str, Any] = {
        "where": piece.where,
        "time_s": piece.time,
        "direction": piece.direction,
        "kind": description.kind,
        "summary": description.summary,
        "valid": description.valid,
        "findings": [finding._asdict() for finding in description.findings],
        "fields": description.fields,
    }
    if list_pulses and description.pulses is not None:
        record["phase"] = description.pulses.phase.tolist()
        record["width"] = description.pulses.width.tolist()
    return record


@contextmanager
def _report(target: str | None, name: str, totals: Totals) -> Iterator[Callable[[dict[str, Any]], None]]:
    """Write records as JSON, as they come; the complete file replaces its target after the last one."""
    if target is None:
        yield lambda _: None
    elif target == "-":
        with TemporaryFile("w+", encoding="utf-8") as held:
            yield from _document(held, name, totals)
            held.seek(0)
            shutil.copyfileobj(held, sys.stdout)
    else:
        with replacing(Path(target)) as part, part.open("w", encoding="utf-8") as file:
            yield from _document(file, name, totals)


def _document(file: TextIO, name: str, totals: Totals) -> Iterator[Callable[[dict[str, Any]], None]]:
    """A JSON object whose list of pieces may be longer than memory."""
    separator = "\n"

    def write(record: dict[str, Any]) -> None:
        nonlocal separator
        file.write(separator + json.dumps(record, allow_nan=False))
        separator = ",\n"

    file.write(f'{{"format": "phasewire-decode-1",\n"file": {json.dumps(name)},\n"pieces": [')
    yield write
    file.write(f'\n],\n"kinds": {json.dumps(totals.kinds)},\n"invalid": {totals.invalid}}}\n')
