"""phasewire's streaming beside that of autd3 to its emulator by UDP: fresh patterns, each sent and acknowledged.

``make bench-peers``. Each sends patterns for all transducers of one device, another one every time, in an environment
of its own, ``<name>_streaming.py``: to an emulator in a process of its own over loopback, and to one in its own
process. They take turns in several rounds; the table has the medians, and what was slowest and fastest. This driver may
not import a peer.
"""

from __future__ import annotations

import dataclasses
import sys
import time
from collections.abc import Callable, Iterator
from statistics import median
from typing import Any

from environments import QUIET, UnavailableError, enter, environment, finish, machine, options, print_remarks
from throughput import Task

OURS = "phasewire"
PEER = "autd3"
CONTESTANT_SECONDS = 600.0
TASK = Task(seconds=3.0, patterns=256)
ROUNDS = 5
PLACES = {True: "emulator in a process of its own, over loopback", False: "emulator in the process that sends"}


@dataclasses.dataclass(frozen=True)
class Row:
    """One way to send, of one contestant: updates per second and host's seconds per update, for each round."""

    name: str
    way: str
    apart: bool
    rates: list[float]
    host: list[float] | None

    @property
    def rate(self) -> float:
        """The median."""
        return median(self.rates)

    @property
    def mark(self) -> str:
        """~ if the rounds disagree, as they do on a busy machine."""
        return "~" if min(self.rates) < QUIET * max(self.rates) else ""


def compete(task: Task, rounds: int) -> dict[str, list[dict[str, Any]]]:
    """Let both stream, in turns; their records of all rounds."""
    records: dict[str, list[dict[str, Any]]] = {PEER: [], OURS: []}
    for number in range(rounds):
        print(f"round {number + 1} of {rounds} ...", flush=True)
        for name, done in records.items():
            try:
                python = sys.executable if name == OURS else environment(name)
                done.append(enter(f"{name}_streaming.py", python, task.save, CONTESTANT_SECONDS))
            except UnavailableError as error:
                done.append({"unavailable": str(error)})
    return records


def rows(records: dict[str, list[dict[str, Any]]]) -> Iterator[Row]:
    """Every way that could be measured."""
    for name, rounds in records.items():
        done: dict[tuple[str, bool], list[dict[str, Any]]] = {}
        for way in (way for record in rounds for way in record.get("ways", []) if "error" not in way):
            done.setdefault((way["name"], way["apart"]), []).append(way)
        for (way_name, apart), ways in done.items():
            rates = [way["updates"] / way["seconds"] for way in ways]
            spent = [way["processor"] if apart else way["host"] for way in ways]
            host = None if None in spent else [each / way["updates"] for each, way in zip(spent, ways, strict=True)]
            yield Row(name, way_name, apart, rates, host)


def best(table: list[Row], name: str, apart: bool, figure: Callable[[Row], float]) -> float | None:
    """The largest figure of a contestant in a place."""
    return max((figure(row) for row in table if (row.name, row.apart) == (name, apart)), default=None)


def print_table(table: list[Row]) -> None:
    """A line for each way to send."""
    for apart, place in PLACES.items():
        print(f"\n{place:64}{'updates/s':>12}{'(slowest - fastest)':>21}{'µs of host':>12}")
        for row in table:
            if row.apart == apart:
                spread = f"{min(row.rates):,.0f} - {max(row.rates):,.0f}"
                host = "-" if row.host is None else f"{median(row.host) * 1e6:.1f}"
                print(f"  {row.name + ' ' + row.way:62}{row.mark + format(row.rate, ',.0f'):>12}{spread:>21}{host:>12}")


def print_ratios(table: list[Row], records: dict[str, list[dict[str, Any]]]) -> None:
    """The best of each beside each other, place by place."""
    print("\nphasewire's best over autd3's best")
    for apart, place in PLACES.items():
        theirs, ours = (best(table, name, apart, lambda row: row.rate) for name in (PEER, OURS))
        if theirs and ours:
            print(f"  {place:62}{ours / theirs:>11.2f} ×")
    theirs = max((rate for apart in PLACES if (rate := best(table, PEER, apart, lambda row: row.rate))), default=None)
    alone = best(table, OURS, False, lambda row: 1 / median(row.host) if row.host else 0.0)
    if theirs and alone:
        what = f"phasewire's host alone, {alone:,.0f} updates/s, over all of autd3's best"
        print(f"  {what:62}{alone / theirs:>11.2f} ×")
    counts = {name: record["transducers"] for name, rounds in records.items() for record in rounds if "ways" in record}
    if counts.keys() == {OURS, PEER}:
        print(f"  An update is of {counts[PEER]} transducers there, {counts[OURS]} here.")


def remarks(name: str, rounds: list[dict[str, Any]]) -> list[str]:
    """What one must know to read a contestant's numbers."""
    done = [record for record in rounds if "ways" in record]
    failures = [record["unavailable"] for record in rounds if "unavailable" in record]
    failures += [f"{way['name']}: {way['error']}" for record in done for way in record["ways"] if "error" in way]
    about = [f"version {done[0]['versions'].get(name, 'unknown')}.", *done[0]["notes"]] if done else []
    return [*dict.fromkeys(failures), *about]


def main() -> None:
    """Run both, print the table and write the record."""
    parser = options(__doc__, "bench-peers-streaming")
    parser.add_argument("--seconds", type=float, default=TASK.seconds, help="of each way to send in a round")
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    chosen = parser.parse_args()
    task = dataclasses.replace(TASK, seconds=chosen.seconds)
    about, begun = machine(), time.monotonic()
    records = compete(task, chosen.rounds)
    table = list(rows(records))
    print_table(table)
    print_ratios(table, records)
    print("\nremarks")
    print(
        f"  ~: the slowest round had less than {QUIET:.0%} of the rate of the fastest: a busy machine, or a restless "
        "way to send."
    )
    print_remarks({name: remarks(name, each) for name, each in records.items()}, about, 11)
    finish(chosen.json, about, begun, task=dataclasses.asdict(task), rounds=records)


if __name__ == "__main__":
    main()
