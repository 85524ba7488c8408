"""Execution of tasks on a resident object, in this process, in several or on an executor, with identical results."""

from __future__ import annotations

import gc
import logging
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, as_completed
from contextlib import AbstractContextManager, contextmanager, suppress
from multiprocessing import get_context, parent_process, resource_tracker
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

from threadpoolctl import threadpool_limits

from softness_bayes.base.defaults import GARBAGE, SIGNALS
from softness_bayes.base.errors import InputError, WorkersLostError

Result = TypeVar("Result")

RENEWALS = 1
"""Number of times that dead processes are replaced without progress before the computation is aborted."""


_OF_A_TERMINAL = [number for number in SIGNALS if number != signal.SIGTERM]


@contextmanager
def _shielded() -> Iterator[None]:
    """Start processes that ignore the signals of a terminal, which are handled by the waiting process."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _OF_A_TERMINAL)
    try:
        resource_tracker.ensure_running()
        signal.pthread_sigmask(signal.SIG_BLOCK, _OF_A_TERMINAL)  # again, because its start lets some of them through
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def available_processors() -> int:
    """Return the number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def shares_files(executor: Executor | None) -> bool:
    """Return whether the workers of an executor see the files of this process.

    They do unless the executor has an attribute `shares_files` that is False.
    """
    return bool(getattr(executor, "shares_files", True))


def require_guard() -> None:
    """Raise an error in a script that new processes cannot import without starting its work again.

    Raises
    ------
    InputError
        If it has no ``if __name__ == "__main__":``, or is no file.
    """
    path = getattr(sys.modules.get("__main__"), "__file__", None)
    if path is None:
        return  # an interactive session or a notebook
    remedy = "or run in this process alone, with processes=1"
    if not os.path.isfile(path):
        raise InputError(
            "processes: worker processes cannot read a script from standard input: save it as a file, with its work "
            f'under if __name__ == "__main__":, {remedy}'
        )
    try:
        script = Path(path).read_text(encoding="utf-8")
    except (OSError, ValueError):
        return  # a program of another kind
    if "__name__" not in script and "parent_process" not in script:
        raise InputError(
            f"processes: every worker process would run all of {path} again: put its work under "
            f'if __name__ == "__main__":, {remedy}'
        )


class Workers:
    """Context manager for worker processes, each with a copy of one resident object.

    New processes are spawned: a fork of a process with threads may hang. A script that samples with more than one
    process therefore needs the guard ``if __name__ == "__main__":``.

    Parameters
    ----------
    resident
        The object used by all tasks; sent to each process once.
    processes
        Number of processes; with one, tasks run in the current process.
    executor
        Executor that runs the tasks instead, in other processes or on other machines; it is not shut down. If it
        has a method ``share(value)``, which returns a reference that a task receives as the value itself, the resident
        object is sent once, otherwise with every task.

    Raises
    ------
    InputError
        If new processes would run the user's script again.
    """

    def __init__(self, resident: Any, processes: int, executor: Executor | None = None) -> None:
        self._resident, self._processes, self._renewed = resident, processes, 0
        self._pool, self._given, self._sent = executor, executor is not None, None
        if executor is not None:
            self._sent = executor.share(resident) if hasattr(executor, "share") else resident
        elif processes > 1:
            require_guard()
            self._pool = self._new_pool()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._pool is None or self._given:
            return
        if kind is None or issubclass(kind, Exception):
            self._pool.shutdown(wait=True, cancel_futures=True)
            return
        # an interrupt: the results are no longer needed
        running = [*(getattr(self._pool, "_processes", None) or {}).values()]
        self._pool.shutdown(wait=False, cancel_futures=True)
        for process in running:
            process.kill()

    def _new_pool(self) -> ProcessPoolExecutor:
        with _shielded():  # its semaphores start the process that removes them
            return ProcessPoolExecutor(self._processes, get_context("spawn"), _settle, (self._resident,))

    def _begun(self, work: Callable[..., Result], tasks: Mapping[int, tuple[Any, ...]]) -> dict[Future[Result], int]:
        """Submit tasks, as long as no process has died, and return the index of each one."""
        running: dict[Future[Result], int] = {}
        with suppress(BrokenExecutor), _shielded():
            for k, task in tasks.items():
                assert self._pool is not None
                running[self._pool.submit(_on_one_thread, work, task, self._sent)] = k
        return running

    def _renew(self) -> None:
        """Replace all processes after one of them has died, which breaks the pool.

        Raises
        ------
        WorkersLostError
            If this has happened too often, or a given executor has lost its workers.
        """
        if self._given:
            raise WorkersLostError("the executor lost its workers: they were killed, or memory ran out") from None
        if self._pool is None or self._renewed == RENEWALS:
            raise WorkersLostError(_DIED) from None
        self._renewed += 1
        self._pool.shutdown(wait=False, cancel_futures=True)
        self._pool = self._new_pool()

    def _finished(self, work: Callable[..., Result], tasks: Sequence[tuple[Any, ...]]) -> Iterator[tuple[int, Result]]:
        """Begin tasks, and return index and result of every one as it finishes; those whose process died repeat."""
        left = dict(enumerate(tasks))
        if self._pool is None:
            return ((k, _on_one_thread(work, task, self._resident)) for k, task in left.items())
        return self._collected(work, left, self._begun(work, left))

    def _collected(
        self, work: Callable[..., Result], left: dict[int, tuple[Any, ...]], running: dict[Future[Result], int]
    ) -> Iterator[tuple[int, Result]]:
        while left:
            running = running or self._begun(work, left)  # the processes may be new ones, for the sake of another task
            if not running:
                self._renew()
            try:
                done = as_completed(list(running))
                while running:
                    future = next(done)
                    k, result = running.pop(future), future.result()
                    self._renewed = 0
                    del left[k], future  # and with it the result
                    yield k, result
            except BrokenExecutor:
                if self._given:
                    self._renew()
                running.clear()
            finally:
                if self._given:
                    for future in running:
                        future.cancel()

    def map(self, work: Callable[..., Result], tasks: Sequence[tuple[Any, ...]]) -> list[Result]:
        """Return ``work(resident, *task)`` of every task, in order; ``work`` is a function of a module.

        Raises
        ------
        WorkersLostError
            If processes died repeatedly.
        """
        found = dict(self._finished(work, tasks))
        return [found[k] for k in range(len(tasks))]

    def later(self, work: Callable[..., Result], *task: Any) -> Callable[[], Result]:
        """Begin ``work(resident, *task)``, and return a function that waits for its result; otherwise like `map`."""
        finished = self._finished(work, [task])
        return lambda: next(finished)[1]

    def as_finished(self, work: Callable[..., Result], tasks: Sequence[tuple[Any, ...]]) -> Iterator[Result]:
        """Yield ``work(resident, *task)`` of every task as soon as it finishes, in any order; otherwise like `map`."""
        return (result for _, result in self._finished(work, tasks))


_DIED = (
    "a worker process died, and its replacement died too: they were killed, perhaps by the system because "
    "memory ran out. Use fewer processes (--processes 1 needs no worker). In a script, the call must be under "
    "'if __name__ == \"__main__\":'"
)


_resident: Any = None


def _settle(resident: Any) -> None:
    global _resident
    _resident = resident
    import scipy.linalg  # noqa: F401  # `one_thread` finds only libraries that are loaded

    # as in the waiting process: without a handler, libraries print their warnings
    if not logging.getLogger().handlers:
        logging.getLogger().addHandler(logging.NullHandler())
    # the process that waits for the results handles what a terminal sends to all of its processes
    for number in _OF_A_TERMINAL:
        signal.signal(number, signal.SIG_IGN)
    # imported objects are never garbage; scanning them repeatedly takes a fifth of the time of a figure
    gc.freeze()
    gc.set_threshold(*GARBAGE)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this process when its parent has ended, because no further task can arrive."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)


def _on_one_thread(work: Callable[..., Result], task: tuple[Any, ...], resident: Any = None) -> Result:
    with one_thread():
        return work(_resident if resident is None else resident, *task)


def one_thread() -> AbstractContextManager[Any]:
    """Use one BLAS thread: more threads would compete with the workers, and could change the last bits of results."""
    return threadpool_limits(limits=1)
