"""Progress of a run on the terminal."""

from __future__ import annotations

import logging
import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, NoReturn, Self

import click

from softness_bayes.cli import STARTED
from softness_bayes.cli.running import in_numbers, in_time, needed

if TYPE_CHECKING:
    from tqdm import tqdm

    from softness_bayes.sampler.sampling import Progress

LONG = 60.0
"""Remaining time [s] above which a convergence check prints a separate line."""

PATIENCE = 15.0
"""Time [s] until the first check above which it is announced from the speed of the pilot run."""

STAGES = "softness_bayes.results.assembly"
"""Logger of the stages after sampling (`results.assembly.Stage`)."""


class Bar(logging.Handler):
    """Progress on the terminal: steps against the estimate of what it takes to converge, then a line for each stage.

    A context manager: it prints what the logger of the stages logs.

    If the first check is far away, a separate line says so at the beginning of the pilot run. If the remaining time is
    long, another one reports it after the first check, and again if the estimate increases.
    """

    def __init__(self) -> None:
        super().__init__()
        self._bar: tqdm[NoReturn] | None = None
        self.drawing = False
        """True if figures are being drawn, which is the last stage."""
        self._before, self._begun, self._sampled = 0.0, time.monotonic(), 0.0
        self._start: Progress | None = None
        self._told, self._announced = 0.0, False

    def __enter__(self) -> Self:
        logging.getLogger(STAGES).setLevel(logging.INFO)
        logging.getLogger(STAGES).addHandler(self)
        return self

    def __exit__(self, *_: object) -> None:
        logging.getLogger(STAGES).removeHandler(self)
        self.clear()

    def emit(self, record: logging.LogRecord) -> None:
        """Write a line for a stage after the walk."""
        self.clear()
        self.drawing = getattr(record.msg, "name", "") == "FIGURES"
        click.echo(record.getMessage(), err=True)

    def begin(self, before: float) -> None:
        """Begin to measure; `before` is the time [s] that earlier sessions of the run have sampled."""
        self._before, self._begun = before, time.monotonic()
        self._bar = _line("searching for starting points")

    def show(self, progress: Progress) -> None:
        """Update the bar; its length changes when a convergence check changes the estimate."""
        self._sampled = progress.seconds - self._before
        if self._start is None:
            from tqdm import tqdm

            self.clear()
            self._begun = time.monotonic() - self._sampled
            self._bar = tqdm(
                total=1, initial=progress.steps, unit="step", desc="sampling", leave=False, dynamic_ncols=True
            )
        assert self._bar is not None
        self._bar.set_postfix_str(f"pilot run, {progress.pilot} steps left" if progress.pilot else "")
        self._bar.total = progress.steps + progress.missing
        self._bar.update(progress.steps - self._bar.n)
        if progress.verdict is not None:
            self._bar.set_postfix_str(in_numbers(progress.verdict, progress.seconds))
        if note := self._foreseen(progress):
            self._bar.write(note, file=sys.stderr)

    def _foreseen(self, progress: Progress) -> str:
        """Return a note on the time that the run will need, if it is long and was not printed before; else empty."""
        start = self._start
        if start is None or progress.steps <= start.steps:  # measure the speed of the main walk, not of a pilot
            self._start = progress
            if start is None or self._announced or not start.pilot > progress.pilot:
                return ""
            pace = (progress.seconds - start.seconds) / (start.pilot - progress.pilot)
            steps, self._announced = progress.pilot + progress.missing, True
            said = f"the first check of the chains is {steps} steps away, about {in_time(pace * steps)}"
            return said if pace * steps > PATIENCE else ""
        verdict = progress.verdict
        if verdict is None or verdict.converged:
            return ""
        steps, most = verdict.foreseen
        pace = (progress.seconds - start.seconds) / (progress.steps - start.steps)
        if pace * (steps - progress.steps) < LONG or steps <= self._told:
            return ""
        self._told = most if math.isfinite(most) else 1.5 * steps
        return f"after {verdict.steps} steps: {needed(verdict, pace)}"

    def times(self) -> str:
        """Return the total time of the command and the time of each stage, in words."""
        begun, whole = self._begun - STARTED, time.monotonic() - STARTED
        return (
            f"took {whole:.1f} s: {begun:.1f} s to start, {self._sampled:.1f} s to sample, "
            f"{whole - begun - self._sampled:.1f} s for the stages after sampling"
        )

    def clear(self) -> None:
        """Clear the line."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None


@contextmanager
def counting(total: int, unit: str, description: str) -> Iterator[Callable[[int, str], None]]:
    """Show the progress over the parts of a command on the terminal, such as tables or replicates.

    Parameters
    ----------
    total, unit, description
        Number of parts, their name, and what happens to them.

    Yields
    ------
    callable
        Takes the number of finished parts, and a description of the last one.
    """
    from tqdm import tqdm

    # the delay keeps the line away until there is progress, so that input errors are printed without it
    with tqdm(total=total, unit=unit, desc=description, leave=False, dynamic_ncols=True, delay=1e-3) as bar:

        def show(finished: int, last: str) -> None:
            bar.update(finished - bar.n)
            bar.set_postfix_str(last)

        yield show


@contextmanager
def telling(what: str) -> Iterator[None]:
    """Say what is being done; nothing if no terminal shows it."""
    line = _line(what)
    try:
        yield
    finally:
        line.close()


def _line(what: str) -> tqdm[NoReturn]:
    from tqdm import tqdm

    # `disable=None` is without a terminal
    return tqdm(desc=what, bar_format="{desc}", leave=False, disable=None, dynamic_ncols=True)


@contextmanager
def drawing() -> Iterator[Callable[[str, int], None]]:
    """Name the figure that is drawn now; nothing if no terminal shows it.

    Yields
    ------
    callable
        Takes the name of the figure, and the number of all figures.
    """
    with _line("reading the results") as bar:

        def show(name: str, of: int) -> None:
            bar.n += 1
            bar.set_description_str(f"figure {bar.n} of {of}: {name}")

        yield show
