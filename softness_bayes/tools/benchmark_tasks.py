"""Benchmark of many tasks on processes and on a Dask cluster: ``python -m softness_bayes.tools.benchmark_tasks``.

Measures, with one and with two workers on this machine, the processor time of the client and of the scheduler per task,
the efficiency for tasks of known length, and the peak memory of the client. Tasks of known length sleep, so that other
processes on the machine hardly matter; of several passes the fastest counts. Needs ``softness-bayes[dask]``. Writes
``notebooks/results/tasks.csv``, from which ``tools.doc_tables`` makes the table and the paragraph of the page on speed.
"""

from __future__ import annotations

import csv
import io
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from softness_bayes.files.whole import write_whole
from softness_bayes.runs.cluster import cluster
from softness_bayes.sampler.workers import Workers

TABLE = Path("notebooks/results/tasks.csv")

EMPTY, SLEEPING, LENGTH, PASSES = 500, 20, 0.5, 3
"""Number of empty tasks, of sleeping tasks per worker, the length [s] of these, and the number of passes."""

MANY = (100, 4000, 8000)
"""Numbers of empty tasks after which the peak memory of the client is read."""

_KEPT = 4096  # bytes of the resident object, that of all tasks
_STARTED = 60.0  # seconds within which a scheduler and its workers must have started
END = ("--death-timeout", 60)
"""Options of workers that end by themselves [s] once their scheduler is gone."""


def empty(resident: bytes, index: int) -> int:
    """Return the index: a task without work."""
    return index


def sleeping(resident: bytes, index: int, seconds: float) -> int:
    """Sleep and return the index: a task of known length."""
    time.sleep(seconds)
    return index


@contextmanager
def dask_cluster(workers: int) -> Iterator[tuple[Path, int]]:
    """Start a scheduler and workers with one thread each; yield the scheduler's file and its process number."""
    with tempfile.TemporaryDirectory() as home, ExitStack() as stack:
        file = Path(home) / "scheduler.json"

        def started(*command: Any) -> int:
            program = [sys.executable, "-m", "dask", *map(str, command), "--no-dashboard"]
            process = subprocess.Popen(
                program, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=os.environ | {"OMP_NUM_THREADS": "1"}
            )
            stack.callback(process.wait)
            stack.callback(process.kill)
            return process.pid

        scheduler = started("scheduler", "--port", 0, "--scheduler-file", file)
        end = time.monotonic() + _STARTED
        while not file.exists() and time.monotonic() < end:
            time.sleep(0.1)
        for _ in range(workers):
            started("worker", "--scheduler-file", file, "--nthreads", 1, "--no-nanny", *END, "--local-directory", home)
        _await_workers(file, workers, end)
        yield file, scheduler


def _await_workers(file: Path, workers: int, end: float) -> None:
    from distributed import Client

    with Client(scheduler_file=str(file), set_as_default=False) as client:
        client.wait_for_workers(workers, timeout=max(end - time.monotonic(), 1.0))


def _processor_time(process: int) -> float:
    """Return the processor time [s] of another process."""
    import psutil

    times = psutil.Process(process).cpu_times()
    return float(times.user + times.system)


def measure(on: str, workers: int) -> dict[str, str]:
    """Return a row: overhead per empty task, efficiency for sleeping tasks, peak memory of this process."""
    import resource  # missing on Windows, where all other modules import

    with ExitStack() as stack:
        scheduler = 0
        if on == "dask":
            file, scheduler = stack.enter_context(dask_cluster(workers))
            executor: Any = stack.enter_context(cluster(str(file)))
        else:
            executor = stack.enter_context(ProcessPoolExecutor(workers, get_context("forkserver")))
        pool = stack.enter_context(Workers(bytes(_KEPT), workers, executor))
        pool.map(empty, [(k,) for k in range(20 * workers)])  # imports on the workers are no overhead
        passes = [_pass(pool, workers, scheduler) for _ in range(PASSES)]
        walls, clients, schedulers, efficiencies = zip(*passes, strict=True)
        memory = []
        for count in MANY:
            pool.map(empty, [(k,) for k in range(count)])
            memory.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
        return {
            "on": on,
            "workers": str(workers),
            "wall_ms": f"{1e3 * min(walls):.2f}",
            "client_ms": f"{1e3 * min(clients):.2f}",
            "scheduler_ms": f"{1e3 * min(schedulers):.2f}" if scheduler else "",
            "efficiency": f"{max(efficiencies):.3f}",
            "load": f"{os.getloadavg()[0]:.1f}",
            **{f"peak_mb_{count}": f"{peak:.0f}" for count, peak in zip(MANY, memory, strict=True)},
        }


def _pass(pool: Workers, workers: int, scheduler: int) -> tuple[float, float, float, float]:
    """Return, of one pass, wall and processor times of client and scheduler per empty task, and the efficiency."""
    wall, client = time.monotonic(), time.process_time()
    there = _processor_time(scheduler) if scheduler else 0.0
    pool.map(empty, [(k,) for k in range(EMPTY)])
    there = (_processor_time(scheduler) if scheduler else 0.0) - there
    wall, client = time.monotonic() - wall, time.process_time() - client
    begun = time.monotonic()
    pool.map(sleeping, [(k, LENGTH) for k in range(SLEEPING * workers)])
    return wall / EMPTY, client / EMPTY, there / EMPTY, SLEEPING * LENGTH / (time.monotonic() - begun)


def measured() -> list[dict[str, str]]:
    """Return a row for each executor and number of workers, each measured in a process of its own."""
    return [_apart(on, workers) for on in ("processes", "dask") for workers in (1, 2)]


def _apart(on: str, workers: int) -> dict[str, str]:
    """Measure in a new process, whose peak memory is then that of this measurement."""
    program = [sys.executable, "-m", __spec__.name, on, str(workers)]
    said = subprocess.run(program, check=True, stdout=subprocess.PIPE, text=True).stdout
    return next(csv.DictReader(io.StringIO(said)))


def as_csv(rows: Sequence[dict[str, str]]) -> str:
    """Return rows as the text of a table."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def main(arguments: Sequence[str] = tuple(sys.argv[1:])) -> None:
    """Measure everything and write the table; with an executor and a number of workers, print their row alone."""
    if arguments:
        print(as_csv([measure(arguments[0], int(arguments[1]))]), end="")
        return
    text = as_csv(measured())
    write_whole(TABLE, text.encode())
    print(text)


if __name__ == "__main__":
    main()
