"""Tasks on one resident object, in this process or in several; the results do not depend on which."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import forkserver, get_context, parent_process
from types import TracebackType
from typing import Any, Self, TypeVar

from threadpoolctl import threadpool_limits

from softness_bayes.errors import SoftnessError

Result = TypeVar("Result")

_SERVED = sys.platform == "linux"
"""Whether workers are forks of a server that has imported what they need, and nothing else."""

_NEEDED = ("softness_bayes.run", "emcee")
"""Modules that import all that a worker is asked for."""

_CONTEXT = get_context("forkserver" if _SERVED else "spawn")


def prepare() -> None:
    """Begin to import what workers need, in another process, beside whatever comes next."""
    if _SERVED:
        _CONTEXT.set_forkserver_preload([*_NEEDED])
        forkserver.ensure_running()


def available_processors() -> int:
    """Processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Workers:
    """Processes that each hold one object and work on it; a context manager.

    New processes are not forks of this one, for a fork of a process with threads may hang: they are spawned, or
    forked from a server that does nothing else. A script that samples with more than one process therefore needs
    the guard ``if __name__ == "__main__":``.

    Parameters
    ----------
    resident
        What the tasks work on; sent to each process once.
    processes
        Number of processes; with one, the tasks run in this one.
    """

    def __init__(self, resident: Any, processes: int) -> None:
        self._resident, self._pool = resident, None
        if processes > 1:
            prepare()
            self._pool = ProcessPoolExecutor(processes, _CONTEXT, _settle, (resident,))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)

    def map(self, work: Callable[..., Result], tasks: Sequence[tuple[Any, ...]]) -> list[Result]:
        """Return ``work(resident, *task)`` of every task, in order; ``work`` is a function of a module.

        Raises
        ------
        SoftnessError
            If a process died.
        """
        if self._pool is None:
            return [_on_one_thread(work, self._resident, task) for task in tasks]
        try:
            futures = [self._pool.submit(_in_worker, work, task) for task in tasks]
            return [future.result() for future in futures]
        except BrokenProcessPool:
            raise SoftnessError(_DIED) from None

    def start(self, work: Callable[..., Result], *task: Any) -> Callable[[], Result]:
        """Start ``work(resident, *task)`` and return what waits for its result; in this process it runs when asked.

        Raises
        ------
        SoftnessError
            When asked, if the process died.
        """
        if self._pool is None:
            return lambda: _on_one_thread(work, self._resident, task)
        future = self._pool.submit(_in_worker, work, task)

        def finished() -> Result:
            try:
                return future.result()
            except BrokenProcessPool:
                raise SoftnessError(_DIED) from None

        return finished

    def as_finished(self, work: Callable[..., Result], tasks: Sequence[tuple[Any, ...]]) -> Iterator[Result]:
        """Yield ``work(resident, *task)`` of every task as soon as it is there, in any order; otherwise as `map`."""
        if self._pool is None:
            yield from (_on_one_thread(work, self._resident, task) for task in tasks)
            return
        try:
            futures = [self._pool.submit(_in_worker, work, task) for task in tasks]
            for future in as_completed(futures):
                yield future.result()
        except BrokenProcessPool:
            raise SoftnessError(_DIED) from None


_DIED = (
    "a worker process died. In a script, the call must stand under "
    "'if __name__ == \"__main__\":'; with processes=1 no worker is needed"
)


_resident: Any = None


def _settle(resident: Any) -> None:
    global _resident
    _resident = resident
    # whoever waits for the results decides what an interrupt from the keyboard means
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this process when its parent is gone, killed perhaps: nobody would ever send it another task."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)


def _in_worker(work: Callable[..., Result], task: tuple[Any, ...]) -> Result:
    return _on_one_thread(work, _resident, task)


def _on_one_thread(work: Callable[..., Result], resident: Any, task: tuple[Any, ...]) -> Result:
    """Run a task with one BLAS thread: more would compete, and their number could change the last bits."""
    with threadpool_limits(1):
        return work(resident, *task)
