"""Ensembles that walk side by side in one process, so that one call of the density serves all of them.

A call for a few dozen points costs little more than one for half as many, because most of its time goes into NumPy's
calls. emcee calls the density from within its steps, so that each ensemble walks in a thread of its own. The threads
take turns: the density is called when all of them wait for values, or for the others at the end of a step. Which points
are evaluated together therefore depends on the steps alone, not on the speed of the threads.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextvars import copy_context
from functools import partial
from queue import SimpleQueue
from threading import Thread
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

Result = TypeVar("Result")

Density = Callable[[FloatArray], FloatArray]

Walk = Callable[[Density, Callable[[], None]], Result]
"""Takes a density, from points (n, dimension) to values (n,), and a function to call at the end of each step."""


def side_by_side(density: Density, walks: Sequence[Walk[Result]]) -> list[Result]:
    """Return the results of walks with a common density, which is called in the current thread.

    Parameters
    ----------
    density
        Log density of points (n, dimension), shape (n,).
    walks
        Walks that make the same number of steps.

    Raises
    ------
    BaseException
        If raised by the density or by a walk; the other walks are then abandoned.
    """
    if len(walks) == 1:
        return [walks[0](density, lambda: None)]
    meeting = _Meeting(walks)
    try:
        while meeting.everyone_waits():
            meeting.answer(density)
    finally:
        meeting.end()
    return meeting.results


class _Abandoned(BaseException):
    """Raised in the thread of a walk whose result is no longer needed."""


class _Meeting:
    """The threads of some walks, and what they wait for."""

    def __init__(self, walks: Sequence[Walk[Any]]) -> None:
        self.results: list[Any] = [None] * len(walks)
        self._asked: SimpleQueue[tuple[int, Any]] = SimpleQueue()
        self._answers = [SimpleQueue[Any]() for _ in walks]
        self._walking = set(range(len(walks)))
        self._waiting: dict[int, FloatArray | None] = {}
        # NumPy's error state belongs to a thread's context
        self._threads = [
            Thread(target=copy_context().run, args=(self._walked, k, walk), daemon=True) for k, walk in enumerate(walks)
        ]
        for thread in self._threads:
            thread.start()

    def _walked(self, k: int, walk: Walk[Any]) -> None:
        """Run a walk in its thread; its end, or its error, is the last thing that it reports."""
        error: BaseException | None = None
        try:
            self.results[k] = walk(partial(self._wait, k), partial(self._wait, k, None))
        except BaseException as raised:
            error = raised
        self._asked.put((k, _End(error)))

    def _wait(self, k: int, points: FloatArray | None) -> Any:
        """Return the values at some points, or None when all others have ended the step as well."""
        self._asked.put((k, points))
        answer = self._answers[k].get()
        if isinstance(answer, _Abandoned):
            raise answer
        return answer

    def everyone_waits(self) -> bool:
        """Let the threads walk until all of them wait; return False when all have ended."""
        while len(self._waiting) < len(self._walking):
            k, said = self._asked.get()
            if isinstance(said, _End):
                self._walking.remove(k)
                if said.error is not None:
                    raise said.error
            else:
                self._waiting[k] = said
        return bool(self._walking)

    def answer(self, density: Density) -> None:
        """Evaluate the points that are waited for or, if there are none, begin the next step."""
        asking = sorted(k for k, points in self._waiting.items() if points is not None)
        if not asking:
            for k in self._waiting:
                self._answers[k].put(None)
            self._waiting.clear()
            return
        points = [self._waiting.pop(k) for k in asking]
        ends = np.cumsum([len(part) for part in points])  # type: ignore[arg-type]
        values = density(np.concatenate(points))  # type: ignore[arg-type]
        for k, part in zip(asking, np.split(values, ends[:-1]), strict=True):
            self._answers[k].put(part)

    def end(self) -> None:
        """End all threads."""
        for k in self._walking:
            self._answers[k].put(_Abandoned())
        for thread in self._threads:
            thread.join()


class _End:
    """The end of a walk, with its error, if any."""

    def __init__(self, error: BaseException | None) -> None:
        self.error = error
