"""Sweeps from designs to a file: the same bytes by every crew, whatever interrupts them."""

from __future__ import annotations

import json
import logging
import os
import random
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from phasewire.base.errors import ClusterError, ClusterNotFoundError, InputFileError
from phasewire.hil.sweep import crews
from phasewire.hil.sweep.design import FIELDS
from phasewire.hil.sweep.files import Sweep, read_sweep
from phasewire.hil.sweep.journal import journal_path
from phasewire.hil.sweep.measures import MEASURES, Measures, measure
from phasewire.hil.sweep.results import read_results
from phasewire.hil.sweep.running import SweepRun, run_sweep
from pyarrow import parquet
from threadpoolctl import threadpool_info

PATIENCE = 60.0
TEXT = """
source = "circle:radius=0.03"
columns = 10
rows = 8
[grid]
quantisation = ["pulses", 4]
method = ["wgs", "min_norm"]
phase_error_deg = [0, 30]
"""


@pytest.fixture
def sweep(tmp_path: Path) -> Sweep:
    (tmp_path / "sweep.toml").write_text(TEXT)
    return read_sweep(tmp_path / "sweep.toml")


@pytest.fixture
def output(tmp_path: Path) -> Path:
    return tmp_path / "r.parquet"


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Measures that take no time, for what does not depend on them."""
    monkeypatch.setattr(crews, "measure", lambda design, _: Measures(design.phase_error_deg, 0.1, 0.2, None, 3, 40.0))


def threads() -> list[int]:
    """Of each library for linear algebra in this process."""
    return [library["num_threads"] for library in threadpool_info()]


def alone(sweep: Sweep, output: Path) -> bytes:
    """The bytes of one row after the other."""
    run_sweep(sweep, output, on="serial")
    data = output.read_bytes()
    output.unlink()
    return data


def test_results_have_the_designs_and_their_measures(sweep: Sweep, output: Path) -> None:
    used: set[int] = set()
    run = run_sweep(sweep, output, on="serial", on_row=lambda *_: used.update(threads()))
    assert run == SweepRun(0, 8, 1)
    assert used == {1}
    assert not journal_path(output).exists()
    results = read_results(output)
    assert list(results.columns) == [*FIELDS, *MEASURES, "problem"]
    for row, design in enumerate(sweep.designs):
        assert {name: results.columns[name][row] for name in FIELDS} == vars(design)
        found = {name: results.columns[name][row] for name in MEASURES}
        assert found == pytest.approx(vars(measure(design, sweep.points[design.source])), rel=1e-9)
    assert results.problems == {}
    assert repr(results) == "Results(8 rows, 0 without measures)"
    schema = parquet.read_schema(output)
    assert schema.field("strength_pa").metadata == {b"unit": b"Pa"}
    assert schema.field("pitch_mm").metadata == {b"unit": b"mm"}
    assert np.isnan(results.numbers("gamma")).all()


def test_threads_end_with_the_bytes_of_one_row_after_the_other_and_have_a_page(sweep: Sweep, output: Path) -> None:
    expected = alone(sweep, output)
    begun: list[crews.Crew] = []
    moved: list[tuple[int, int]] = []
    used: set[int] = set()

    def on_row(done: int, total: int) -> None:
        moved.append((done, total))
        used.update(threads())

    before = threads()
    variables = dict(os.environ)
    run = run_sweep(sweep, output, on="threads", workers=2, on_begin=begun.append, on_row=on_row)
    assert run == SweepRun(0, 8, 2)
    assert output.read_bytes() == expected
    assert moved == [(done, 8) for done in range(1, 9)]
    assert used == {1}
    assert threads() == before
    assert dict(os.environ) == variables
    assert begun[0].link is not None
    assert begun[0].link.startswith("http://127.0.0.1:")


@pytest.mark.usefixtures("quick")
def test_a_whole_journal_only_needs_to_be_written(sweep: Sweep, output: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("phasewire.hil.sweep.running.write_results", full)
        with pytest.raises(OSError, match="No space left"):
            run_sweep(sweep, output, on="serial")
    assert run_sweep(sweep, output) == SweepRun(8, 0, 0)
    assert not journal_path(output).exists()


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("content", ["precious", None])
def test_another_sweep_replaces_neither_results_nor_a_journal(sweep: Sweep, output: Path, content: str | None) -> None:
    if content is None:
        run_sweep(Sweep(sweep.designs[:2], sweep.points), output, on="serial")
    else:
        output.write_text(content)
    before = output.read_bytes()
    with pytest.raises(InputFileError, match="has something else than the results of this sweep"):
        run_sweep(sweep, output, on="serial")
    assert output.read_bytes() == before
    output.unlink()
    journal_path(output).write_text('{"format": "phasewire-sweep-journal-1", "fingerprint": "0", "rows": 8}\n')
    with pytest.raises(InputFileError, match="is not of this sweep"):
        run_sweep(sweep, output, on="serial")


def test_too_little_memory_is_no_property_of_a_row(sweep: Sweep, output: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> Measures:
        raise MemoryError

    monkeypatch.setattr(crews, "measure", fails)
    with pytest.raises(MemoryError):
        run_sweep(sweep, output, on="serial")
    assert not journal_path(output).exists()


@pytest.mark.parametrize(
    ("on", "workers", "says"),
    [
        ("gpu", None, "a sweep runs on serial, threads, processes or an address such as tcp://HOST:8786, not on 'gpu'"),
        ("tcp://nowhere", None, "not on 'tcp://nowhere'"),
        ("serial", 2, "2 workers have no effect on serial; threads and processes can have so many"),
        ("tcp://a:1", 2, "2 workers have no effect on tcp://a:1"),
        ("threads", 0, "0 workers must be from 1 to 256"),
    ],
)
def test_an_impossible_crew_is_refused(on: str, workers: int | None, says: str, sweep: Sweep, output: Path) -> None:
    with pytest.raises(ValueError, match=says):
        run_sweep(sweep, output, on=on, workers=workers)
    assert not journal_path(output).exists()


@pytest.mark.parametrize(
    "answer", [b"HTTP/1.1 400 Bad Request\r\n\r\n" * 4, bytes(64), b""], ids=["HTTP", "zeros", "nothing"]
)
def test_what_answers_and_is_no_scheduler_is_named(
    answer: bytes, sweep: Sweep, output: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another server, or one that says nothing."""
    monkeypatch.setattr(crews, "CONNECT_SECONDS", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as server:
        taken = list[socket.socket]()

        def serve() -> None:
            with suppress(OSError):
                while True:
                    taken.append(server.accept()[0])
                    taken[-1].sendall(answer)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        with pytest.raises(ClusterNotFoundError, match="no scheduler of Dask answers at"):
            run_sweep(sweep, output, on=address)
        server.shutdown(socket.SHUT_RDWR)
    thread.join()
    for each in taken:
        each.close()


@pytest.mark.parametrize(
    ("who", "package", "theirs", "says"),
    [
        ("scheduler", "distributed", "2024.1.0", "the scheduler at tcp://a:1 has distributed 2024.1.0, but here it is"),
        ("workers", "phasewire", "9.9", "the worker tcp://a:2 at tcp://a:1 has phasewire 9.9, but here it is"),
        ("workers", "phasewire", None, "has phasewire not installed, but here it is"),
        ("workers", "numba", "0.1", "has numba 0.1"),
        ("scheduler", "phasewire", None, None),  # a scheduler needs none
    ],
)
def test_other_versions_are_said_plainly(who: str, package: str, theirs: str | None, says: str | None) -> None:
    ours: dict[str, str | None] = {
        name: version(name) for name in (*crews.PACKAGES, *crews.DASK_PACKAGES) if name != "python"
    }
    ours["python"] = sys.version
    each = {name: {"packages": dict(ours)} for name in ("client", "scheduler", "worker")}
    each["worker" if who == "workers" else who]["packages"][package] = theirs
    found = {"client": each["client"], "scheduler": each["scheduler"], "workers": {"tcp://a:2": each["worker"]}}
    if says is None:
        crews._check_versions("tcp://a:1", found)
        return
    with pytest.raises(ClusterError, match=says):
        crews._check_versions("tcp://a:1", found)


# In processes


@pytest.mark.slow
def test_processes_end_with_the_same_bytes_even_if_one_is_killed(sweep: Sweep, output: Path) -> None:
    from distributed import get_client

    expected = alone(sweep, output)
    killed: list[int] = []

    def kill(done: int, total: int) -> None:
        if done == 2:
            killed.append(next(iter(get_client().run(os.getpid).values())))
            os.kill(killed[0], signal.SIGKILL)

    assert run_sweep(sweep, output, on="processes", workers=2, on_row=kill) == SweepRun(0, 8, 2)
    assert killed
    assert output.read_bytes() == expected


@pytest.mark.slow
def test_a_cluster_by_its_address_ends_with_the_same_bytes(sweep: Sweep, output: Path) -> None:
    from distributed import LocalCluster

    expected = alone(sweep, output)
    options = {"dashboard_address": None, "silence_logs": logging.ERROR}
    with LocalCluster(n_workers=2, threads_per_worker=3, processes=True, **options) as cluster:
        run = run_sweep(sweep, output, on=cluster.scheduler_address)
    assert run == SweepRun(0, 8, 6)
    assert output.read_bytes() == expected


@pytest.mark.slow
def test_a_cluster_without_workers_is_named(sweep: Sweep, output: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from distributed import LocalCluster

    monkeypatch.setattr(crews, "CONNECT_SECONDS", 0.5)
    with (
        LocalCluster(n_workers=0, dashboard_address=None, silence_logs=logging.ERROR) as cluster,
        pytest.raises(ClusterNotFoundError, match="has no workers; start some with `dask worker tcp"),
    ):
        run_sweep(sweep, output, on=cluster.scheduler_address)


@pytest.mark.slow
def test_a_scheduler_that_is_lost_ends_the_sweep_and_keeps_its_rows(
    sweep: Sweep, output: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    command = [sys.executable, "-m", "distributed.cli.dask_spec", "--spec"]
    scheduler = {"cls": "distributed.Scheduler", "opts": {"host": "127.0.0.1", "port": 0, "dashboard": False}}
    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen([*command, json.dumps(scheduler)], **quiet) as process:
        try:
            address = next(found[0] for line in process.stderr or () if (found := re.search(r"tcp://[\d.]+:\d+", line)))
            worker = {"cls": "distributed.Worker", "opts": {"nthreads": 2, "dashboard": False}}
            with subprocess.Popen([*command, json.dumps(worker), address], **quiet) as helper:
                try:
                    with pytest.raises(ClusterError, match="the cluster is lost"):
                        run_sweep(sweep, output, on=address, on_row=lambda done, total: process.kill())
                finally:
                    helper.kill()
        finally:
            process.kill()
    assert journal_path(output).read_bytes().count(b"\n") >= 2
    assert "Traceback" not in capfd.readouterr().err


@contextmanager
def started(folder: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    """The command as a process of its own, in a folder with ``sweep.toml``."""
    command = [sys.executable, "-m", "phasewire", "sweep", "sweep.toml", "-o", "r.parquet", *options]
    with subprocess.Popen(
        command,
        cwd=folder,
        text=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def members(session: int) -> list[str]:
    """The processes of a session that have not ended."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            state, _parent, _group, its = (folder / "stat").read_text().rpartition(")")[2].split()[:4]
        except OSError:
            continue
        if int(its) == session and state != "Z":
            found.append((folder / "cmdline").read_text())
    return found


def wait_for(condition: Any) -> None:
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def rows_of(folder: Path) -> int:
    try:
        return (folder / "r.parquet.unfinished").read_bytes().count(b"\n") - 1
    except FileNotFoundError:
        return -1


@pytest.mark.slow
def test_a_sweep_that_is_killed_at_random_ends_with_the_same_bytes(tmp_path: Path, output: Path) -> None:
    (tmp_path / "sweep.toml").write_text(TEXT + "seed = {from = 0, to = 11, count = 12}\n")
    sweep = read_sweep(tmp_path / "sweep.toml")
    expected = alone(sweep, output)
    rng = random.Random()
    on = ["serial", "threads", "processes"]
    rng.shuffle(on)
    for crew in on:
        had = rows_of(tmp_path)
        wanted = max(had, 0) + rng.randint(1 if had < 1 else 0, 6)  # something is kept in the end
        with started(tmp_path, "--on", crew) as process:
            wait_for(lambda wanted=wanted: rows_of(tmp_path) >= wanted)
            time.sleep(rng.uniform(0, 0.05))
            process.kill()
            process.wait()
            wait_for(lambda session=process.pid: members(session) == [])
        assert rows_of(tmp_path) >= had
    assert not output.exists()
    run = run_sweep(sweep, output, on="serial")
    assert 0 < run.kept < len(sweep) == run.kept + run.measured
    assert output.read_bytes() == expected


@pytest.mark.slow
def test_ctrl_c_ends_all_processes_and_says_how_to_go_on(tmp_path: Path) -> None:
    (tmp_path / "sweep.toml").write_text(TEXT + "seed = {from = 0, to = 99, count = 100}\n")
    with started(tmp_path) as process:
        assert process.stderr is not None
        said: list[str] = []
        reader = threading.Thread(target=lambda: said.extend(process.stderr or ()))
        reader.start()
        wait_for(lambda: rows_of(tmp_path) >= 3)
        os.killpg(process.pid, signal.SIGINT)
        assert process.wait(PATIENCE) == 130
        wait_for(lambda: members(process.pid) == [])
        reader.join(PATIENCE)
    text = "".join(said)
    assert "Dask shows the workers at http://127.0.0.1:" in text
    assert "The rows that are done are in r.parquet.unfinished; the same command goes on from there." in text
    assert "Traceback" not in text
    assert not (tmp_path / "r.parquet").exists()
