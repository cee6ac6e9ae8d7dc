"""Crews measure the rows of a sweep: this process alone, threads, processes, or a cluster of Dask.

Each row is measured on one thread, by whichever worker: libraries for linear algebra add in another order on several,
and the results would not be the same bits. Workers are as many as cores instead.
"""

from __future__ import annotations

import logging
import os
import re
import signal
import socket
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from itertools import islice
from multiprocessing import resource_tracker
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from threadpoolctl import threadpool_limits

from ...base.errors import ClusterError, ClusterNotFoundError
from ...base.extras import needing
from ...solver import ControlPoints
from .design import Design
from .journal import RowResult
from .measures import measure

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["CREWS", "LIBRARIES", "Crew", "Task", "check_crew", "open_crew"]

SERIAL, THREADS, PROCESSES = CREWS = ("serial", "threads", "processes")
ADDRESS = re.compile(r"(tcp|tls)://[^/\s]+:\d+")
MOST_WORKERS = 256
CONNECT_SECONDS = 10
MOST_AT_ONCE, SHARES = 8, 16
"""Rows that a worker gets at once, because Dask takes some milliseconds for whatever it hands out; but at least so many
shares for each worker, because at the end others wait for the last."""
AHEAD = 4
"""Shares that each worker has waiting: enough that none idles, and few to drop when the sweep is stopped."""
ENVIRONMENT = dict.fromkeys(
    ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"
) | {
    "MALLOC_TRIM_THRESHOLD_": str(2**30),
    "MALLOC_MMAP_THRESHOLD_": str(2**25),
}
"""Of our processes. Dask's own would return memory to the system at once, and the next row needs as much: that costs a
tenth of the time, in page faults."""
LIBRARIES = ("phasewire", "numpy", "scipy", "numba")
"""The results depend on their versions."""
PACKAGES = ("python", *LIBRARIES)
"""What must be the same at every worker."""
DASK_PACKAGES = ("dask", "distributed")


class Task(NamedTuple):
    """A row to measure."""

    row: int
    design: Design
    points: ControlPoints


class Crew(Protocol):
    """Measures rows."""

    workers: int
    """How many rows are measured at a time."""
    link: str | None
    """The address of a page that shows the workers, if there is one."""

    def measured(self, tasks: Sequence[Task]) -> Iterator[tuple[int, RowResult]]:
        """Rows and their results, as they end.

        Raises `ClusterError` if workers are lost, and others cannot do their rows.
        """
        ...


def check_crew(on: str, workers: int | None) -> None:
    """Raise `ValueError` if a crew has no such name or address, or cannot have so many workers."""
    if on not in CREWS and not ADDRESS.fullmatch(on):
        raise ValueError(f"a sweep runs on {', '.join(CREWS)} or an address such as tcp://HOST:8786, not on {on!r}")
    if workers is None:
        return
    if on not in (THREADS, PROCESSES):
        raise ValueError(f"{workers} workers have no effect on {on}; {THREADS} and {PROCESSES} can have so many")
    if not 1 <= workers <= MOST_WORKERS:
        raise ValueError(f"{workers} workers must be from 1 to {MOST_WORKERS}")


@contextmanager
def open_crew(on: str, workers: int | None = None) -> Iterator[Crew]:
    """Start a crew by its name or the address of a scheduler of Dask, such as ``tcp://HOST:8786``, or connect to it.

    Threads and processes have so many workers, by default as many as cores. Raises `ValueError` as `check_crew`,
    `MissingExtraError` if Dask is not installed, `ClusterNotFoundError` if no scheduler answers or it has no workers,
    and `ClusterError` if other versions run there or workers cannot be started.
    """
    check_crew(on, workers)
    if on == SERIAL:
        with threadpool_limits(1):
            yield _Alone()
        return
    with needing("scale", f"a sweep on {on}"):
        from dask.system import CPU_COUNT
        from distributed import Client, LocalCluster
    if on not in CREWS:
        with _connected(on) as client:
            yield _Dask(client, client.dashboard_link)
        return
    count = workers or CPU_COUNT
    with threadpool_limits(1), _told(ENVIRONMENT):
        try:
            with _deaf_to_ctrl_c():
                cluster = LocalCluster(
                    n_workers=count if on == PROCESSES else 1,
                    threads_per_worker=1 if on == PROCESSES else count,
                    processes=on == PROCESSES,
                    protocol="tcp://",
                    host="127.0.0.1",
                    dashboard_address="127.0.0.1:0",
                    memory_limit=None,  # as for the same rows one after the other
                    silence_logs=logging.ERROR,
                )
        except RuntimeError as error:
            raise ClusterError(f"Dask cannot start {count} workers on {on}: {error.__cause__ or error}") from error
        with cluster, Client(cluster) as client:
            yield _Dask(client, f"http://127.0.0.1:{cluster.scheduler.services['dashboard'].port}/status")


class _Alone:
    """One row after the other: the oracle of the others."""

    workers: int = 1
    link: str | None = None

    def measured(self, tasks: Sequence[Task]) -> Iterator[tuple[int, RowResult]]:
        """Rows and their results."""
        return map(_measured, tasks)


class _Dask:
    """Workers of Dask."""

    def __init__(self, client: Client, link: str | None) -> None:
        self.link, self._client = link, client
        self.workers = sum(client.nthreads().values())

    def measured(self, tasks: Sequence[Task]) -> Iterator[tuple[int, RowResult]]:
        """Rows and their results, as they end."""
        from distributed import as_completed
        from distributed.client import FutureCancelledError
        from distributed.scheduler import KilledWorker

        size = min(max(len(tasks) // (SHARES * self.workers), 1), MOST_AT_ONCE)
        waiting = (tasks[first : first + size] for first in range(0, len(tasks), size))
        ahead = [self._submit(share) for share in islice(waiting, AHEAD * self.workers)]
        done: Any = as_completed(ahead)
        del ahead  # a future that is held keeps its result at the worker
        for future in done:
            try:
                results = future.result()
            except KilledWorker as error:
                raise ClusterError(
                    f"a row ended its worker again and again, perhaps for lack of memory: {error}"
                ) from error
            except (FutureCancelledError, OSError) as error:
                raise ClusterError("the cluster is lost: its scheduler does not answer any more") from error
            for share in islice(waiting, 1):
                done.add(self._submit(share))
            yield from results

    def _submit(self, share: Sequence[Task]) -> Any:
        return self._client.submit(_measured_by_worker, share, pure=False)


@contextmanager
def _told(environment: Mapping[str, str]) -> Iterator[None]:
    """Begin worker processes with these variables, which Dask would leave in this process too."""
    import dask

    before = {name: os.environ.get(name) for name in environment}
    with dask.config.set({"distributed.nanny.pre-spawn-environ": dict(environment)}):
        try:
            yield
        finally:
            for name, value in before.items():
                if value is None:
                    os.environ.pop(name, None)
                else:
                    os.environ[name] = value


@contextmanager
def _deaf_to_ctrl_c() -> Iterator[None]:
    """Leave Ctrl-C to this thread: threads and processes that begin in this block, and theirs, do not get it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # it would end the block when it begins
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _connected(address: str) -> Iterator[Client]:
    """A client of a scheduler with at least one worker and our versions."""
    from distributed import Client
    from distributed.versions import VersionMismatchWarning

    log = logging.getLogger("distributed.client")
    before, log.disabled = log.disabled, True  # it prints tracebacks of what becomes one of our errors
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", VersionMismatchWarning)  # which are judged here
            try:
                _await_first_word(address)
                client = Client(address, timeout=CONNECT_SECONDS)
            except Exception as error:  # what answers may be no scheduler, and then Dask raises whatever it likes
                raise ClusterNotFoundError(f"no scheduler of Dask answers at {address}: {error}") from error
        with client:
            try:
                client.wait_for_workers(1, timeout=CONNECT_SECONDS)
            except TimeoutError as error:
                raise ClusterNotFoundError(
                    f"{address} has no workers; start some with `dask worker {address}`"
                ) from error
            _check_versions(address, client.get_versions(packages=list(PACKAGES)))
            yield client
    finally:
        log.disabled = before


def _await_first_word(address: str) -> None:
    """Raise `OSError` if a server says nothing: a scheduler speaks first, and Dask would wait for it without end."""
    scheme, _, place = address.partition("://")
    if scheme == "tcp":  # otherwise the client speaks first
        host, _, port = place.rpartition(":")
        with socket.create_connection((host.strip("[]"), int(port)), CONNECT_SECONDS) as line:
            if not line.recv(1):
                raise OSError("it closes the line")


def _check_versions(address: str, found: Mapping[str, Any]) -> None:
    """Raise `ClusterError` if scheduler or workers have other versions than this process."""
    ours = found["client"]["packages"]
    judged: list[tuple[str, Any, tuple[str, ...]]] = [("the scheduler", found["scheduler"], DASK_PACKAGES)]
    judged += [(f"the worker {name}", each, PACKAGES + DASK_PACKAGES) for name, each in found["workers"].items()]
    for who, each, packages in judged:
        for package in packages:
            theirs = each["packages"].get(package)
            if theirs != ours[package]:
                raise ClusterError(
                    f"{who} at {address} has {package} {theirs or 'not installed'}, but here it is {ours[package]}: "
                    "install the same versions at both"
                )


def _measured(task: Task) -> tuple[int, RowResult]:
    """Measure a row. Whatever is wrong with it becomes its result: the others must not wait for it."""
    try:
        return task.row, RowResult(measure(task.design, task.points))
    except MemoryError:  # it depends on the machine, not on the row
        raise
    except Exception as error:
        return task.row, RowResult(None, f"{type(error).__name__}: {error}")


def _measured_by_worker(share: Sequence[Task]) -> list[tuple[int, RowResult]]:
    _take_one_thread()
    return [_measured(task) for task in share]


@cache
def _take_one_thread() -> None:
    """Let this worker's libraries use one thread for each row, and keep it so: other rows may run beside this one."""
    threadpool_limits(1)
