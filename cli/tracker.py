"""The command that finds sources of hands and problems with them: ``tracker``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from ..base.plugins import entries
from ..base.storage import check_outputs
from ..host.finding.tracker_checks import TRACKER_CHECKS, Watched, examine_tracker, watch
from ..host.hands.placing import PlacedHands
from ..host.hands.pose import Pose
from ..host.hands.recording import HandRecorder
from ..host.hands.sources import SCHEMES, files_of, open_hands, schemes
from .completion import hand_urls
from .console import JsonOption, console_for, print_list, write_json
from .telling import as_record, count, failed, tell

__all__ = ["commands"]

commands = typer.Typer(rich_markup_mode=None)

CHECK_FAILED = 1
FORMAT = "phasewire-tracker-1"
LEAST_SECONDS, MOST_SECONDS = 0.1, 60.0


@commands.command(epilog="Example: phasewire tracker leap: --seconds 10")
def tracker(
    source: Annotated[
        str | None,
        typer.Argument(
            metavar="[SOURCE]",
            help="A source of hands, such as leap:, camera:0?model=FILE, recording:FILE or gesture:grasp; without one, "
            "the command lists all sources.",
            show_default=False,
            autocompletion=hand_urls,
        ),
    ] = None,
    seconds: Annotated[
        float,
        typer.Option(
            min=LEAST_SECONDS, max=MOST_SECONDS, help="How long to watch, or how much of a recording to read, in s."
        ),
    ] = 3.0,
    pose: Annotated[
        Path | None,
        typer.Option(
            "--pose", metavar="FILE", help="A .toml file with the tracker's position; see docs/how-to/hands.md."
        ),
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option("--record", metavar="FILE", help="Write what the source gives to a recording of hands."),
    ] = None,
    json_target: JsonOption = None,
) -> None:
    """List the sources of hands and which can be used, or watch one and check it.

    It checks whether frames are news, their rate, missing ones, their delay, and the number, size and place of hands.
    Exit code 1 if a check failed, 3 if there is no such source, 4 if it was lost.
    """
    inputs = [] if source is None else files_of(source)
    check_outputs([json_target, record], inputs if pose is None else [*inputs, pose])
    if source is None:
        if pose is not None or record is not None:
            raise ValueError("--pose and --record need a source of hands, such as leap:")
        _list_sources(json_target)
        return
    watched = _watch(source, seconds, None if pose is None else Pose.load(pose), record)
    findings = []
    for finding in examine_tracker(watched):
        findings.append(finding)
        tell(finding, TRACKER_CHECKS, json_target)
    console_for(json_target).print(count(findings))
    if record is not None:
        console_for(json_target).print(f"{record}: {len(watched.frames)} frames")
    write_json(json_target, {"format": FORMAT, "source": source} | _measured(watched) | as_record(findings))
    if watched.lost is not None:
        raise watched.lost
    if failed(findings):
        raise typer.Exit(CHECK_FAILED)


def _list_sources(json_target: str | None) -> None:
    """List the sources, and whether each could be opened."""
    known = schemes()
    table = Table("source", "what", "usable", "found")
    sources = []
    for name in sorted(entries(SCHEMES)):
        if name in known:
            scheme, ready = known[name], known[name].probe()
            listed = {"form": scheme.form, "help": scheme.help, "ready": ready.ready, "says": ready.says}
        else:
            listed = {"form": f"{name}:", "help": "", "ready": False, "says": "it cannot be loaded; install it again"}
        table.add_row(str(listed["form"]), str(listed["help"]), "yes" if listed["ready"] else "no", str(listed["says"]))
        sources.append({"scheme": name} | listed)
    print_list(console_for(json_target), table, "source")
    write_json(json_target, {"format": FORMAT, "sources": sources})


def _watch(url: str, seconds: float, pose: Pose | None, record: Path | None) -> Watched:
    """Watch a source with the same processing as touch, and record its hands."""
    with PlacedHands(open_hands(url), pose) as source:
        if record is None:
            return watch(source, seconds)
        with HandRecorder(record, source.rate, source.name, pose) as recorder:
            return watch(source, seconds, recorder.write)


def _measured(watched: Watched) -> dict[str, Any]:
    """The measurements as JSON; null without any."""
    return {
        "seconds": watched.seconds,
        "live": watched.live,
        "frames": len(watched.frames),
        "rate_hz": watched.rate,
        "longest_gap_s": watched.longest_gap,
        "missing": watched.missing,
        "stale": sum(watched.stale.values()),
        "latency_s": None if watched.latency is None else watched.latency._asdict(),
        "frames_with_hands": sum(bool(frame.hands) for frame in watched.frames),
        "palm": watched.palm if watched.hands else None,
        "middle_m": np.median(watched.centres, axis=0).tolist() if watched.hands else None,
    }
