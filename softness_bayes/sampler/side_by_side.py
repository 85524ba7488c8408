"""Ensembles that walk side by side in one process, so that one call of the density serves all of them.

A call for a few dozen points costs little more than one for half as many, because most of its time goes into NumPy's
calls. emcee calls the density from within its steps, so that each ensemble walks in a thread of its own. The threads
take turns: when all of them wait, for values or for the others at the end of a step, the last to arrive calls the
density. Which points are evaluated together therefore depends on the steps alone, not on the speed of the threads.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextvars import copy_context
from functools import partial
from queue import SimpleQueue
from threading import Lock, Thread
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

Result = TypeVar("Result")

Density = Callable[[FloatArray], FloatArray]

Walk = Callable[[Density, Callable[[], None]], Result]
"""Takes a density, from points (n, dimension) to values (n,), and a function to call at the end of each step."""


def side_by_side(density: Density, walks: Sequence[Walk[Result]]) -> list[Result]:
    """Return the results of walks with a common density; the last walk is made in the current thread.

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
    meeting = _Meeting(density, walks)
    # NumPy's error state belongs to a thread's context
    threads = [Thread(target=copy_context().run, args=(meeting.walk, k), daemon=True) for k in range(len(walks) - 1)]
    for thread in threads:
        thread.start()
    meeting.walk(len(walks) - 1)
    for thread in threads:
        thread.join()
    if meeting.errors:
        raise meeting.errors[0]
    return meeting.results


class _Abandoned(BaseException):
    """Raised in the thread of a walk whose result is no longer needed."""


class _Meeting:
    """Threads of some walks, of which the last to arrive evaluates the density for all that wait."""

    def __init__(self, density: Density, walks: Sequence[Walk[Any]]) -> None:
        self.results: list[Any] = [None] * len(walks)
        self.errors: list[BaseException] = []
        self._density, self._walks, self._lock = density, walks, Lock()
        self._walking = set(range(len(walks)))
        self._waiting: dict[int, FloatArray | None] = {}
        self._answers = [SimpleQueue[Any]() for _ in walks]

    def walk(self, k: int) -> None:
        """Make a walk in the current thread, and keep its result or its error."""
        try:
            self.results[k] = self._walks[k](partial(self._ask, k), partial(self._ask, k, None))
            with self._lock:
                self._walking.remove(k)
                self._serve()
        except _Abandoned:
            pass
        except BaseException as error:
            with self._lock:
                self.errors.append(error)
                for answers in self._answers:
                    answers.put(_Abandoned())

    def _ask(self, k: int, points: FloatArray | None) -> Any:
        """Return the values at some points, or None when all others have ended the step as well."""
        with self._lock:
            self._waiting[k] = points
            self._serve()
        answer = self._answers[k].get()
        if isinstance(answer, _Abandoned):
            raise answer
        return answer

    def _serve(self) -> None:
        """If all walks wait, answer those that have points, or else begin the next step; the lock must be held."""
        if self.errors or len(self._waiting) < len(self._walking):
            return
        asking = {k: points for k, points in sorted(self._waiting.items()) if points is not None}
        answered: dict[int, FloatArray | None] = dict.fromkeys(self._waiting)
        if asking:
            ends = np.cumsum([len(points) for points in asking.values()])
            values = self._density(np.concatenate([*asking.values()]))
            answered = dict(zip(asking, np.split(values, ends[:-1]), strict=True))
        for k, answer in answered.items():
            del self._waiting[k]
            self._answers[k].put(answer)
