"""The terminal: progress of a command, and standard streams that may be closed or full.

`| head` prints no error, and a finished run still succeeds. Names of files cannot control the terminal.
"""

from __future__ import annotations

import errno
import io
import logging
import math
import os
import re
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, NoReturn, Self

import click

from softness_bayes.base.readable import counted

if TYPE_CHECKING:
    from tqdm import tqdm

    from softness_bayes.sampler.diagnostics import Verdict
    from softness_bayes.sampler.sampling import Progress

STARTED = time.monotonic()
"""Time [s] at which the command began, after Python itself had started."""

LONG = 60.0
"""Remaining time [s] above which a convergence check prints a separate line."""

PATIENCE = 15.0
"""Time [s] until the first check above which it is announced from the speed of the pilot run."""

STAGES = "softness_bayes.results.assembly"
"""Logger of the stages after sampling (`results.assembly.Stage`)."""

# keeps line ends, tabs and the carriage returns of progress bars; escapes direction marks and zero-width characters
_UNSEEN = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u061c\u200b-\u200f\u202a-\u202e\u2060-\u2069\ufeff]")


class Tolerant:
    """A text stream that escapes invisible characters, and discards text after its first write error.

    Parameters
    ----------
    stream
        The stream that it writes to.
    """

    def __init__(self, stream: Any) -> None:
        self._stream = stream
        self.failure: OSError | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write, or discard."""
        visible = _UNSEEN.sub(lambda one: one[0].encode("unicode_escape").decode(), text)
        self._try(lambda: self._stream.write(visible))
        return len(text)

    def flush(self) -> None:
        """Flush, or do nothing."""
        self._try(lambda: self._stream.flush())

    def _try(self, act: Callable[[], Any]) -> None:
        try:
            act()
        except OSError as error:
            self.failure = self.failure or error
            with suppress(OSError, ValueError, AttributeError):  # a stream in memory has no file descriptor
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, self._stream.fileno())  # remaining buffered text is discarded too
                os.close(nowhere)
                self._stream.flush()

    @property
    def lost(self) -> str:
        """The write error in words; empty for a closed pipe, which may be on purpose."""
        if self.failure is None or self.failure.errno == errno.EPIPE:
            return ""
        return self.failure.strerror or str(self.failure)


def open_closed_streams() -> None:
    """Open standard streams that were closed at program start; otherwise other files would get their descriptors."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # this takes the lowest free descriptor, which is the closed one
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, "w" if number else "r", encoding="utf-8", closefd=False))


@contextmanager
def tolerant_streams() -> Iterator[Tolerant]:
    """Make standard output and error tolerant and their text visible inside the ``with`` block; yield the output."""
    before = sys.stdout, sys.stderr
    for stream in before:
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    sys.stdout, sys.stderr = out, err = Tolerant(before[0]), Tolerant(before[1])
    try:
        yield out
    finally:
        out.flush()
        err.flush()
        sys.stdout, sys.stderr = before


# progress


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
        self._bar = telling("searching for starting points")

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
            said = f"the first check of the chains is {steps} steps away, the pilot run's included, about "
            said += _in_time(pace * steps)
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


def in_numbers(verdict: Verdict, seconds: float) -> str:
    """Return the numbers of the last convergence check, in one line."""
    slowest = float(verdict.tau.max())
    length = f"{verdict.lengths:.0f} autocorrelation times of {slowest:.0f} steps ({verdict.needed:.0f} needed)"
    if not math.isfinite(slowest):
        length = f"{counted(verdict.stuck, 'walker')} never moved" if verdict.stuck else "autocorrelation times unknown"
    return (
        f"{length}, R-hat {verdict.r_hat.max():.3f}, ESS {verdict.ess:.0f} ({verdict.ess / max(seconds, 1e-9):.3g}/s)"
    )


def needed(verdict: Verdict, pace: float) -> str:
    """Return the total number of steps and the total time of a run in words; `pace` is in seconds per step."""
    steps, most = verdict.foreseen
    if not math.isfinite(most):
        left = _in_time(pace * (steps - verdict.steps))
        return f"the run needs at least about {steps} steps in total ({left} more); it is too short for an upper limit"
    least, longest = (_in_time(pace * (n - verdict.steps)) for n in (steps, most))
    return (
        f"the run needs about {steps} steps in total ({least} more), and probably at most {most:.0f} ({longest} more)"
    )


def _in_time(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} minutes" if seconds < 6000 else f"{seconds / 3600:.1f} hours"


@contextmanager
def counting(total: int, unit: str, description: str) -> Iterator[Callable[[int, str], None]]:
    """Show the progress over the parts of a command, such as tables; yield a function of their number and the last."""
    from tqdm import tqdm

    # the delay keeps the line away until there is progress, so that input errors are printed without it
    with tqdm(total=total, unit=unit, desc=description, leave=False, dynamic_ncols=True, delay=1e-3) as bar:

        def show(finished: int, last: str) -> None:
            bar.update(finished - bar.n)
            bar.set_postfix_str(last)

        yield show


@contextmanager
def drawing() -> Iterator[Callable[[str, int], None]]:
    """Name the figure that is drawn now; yield a function of its name and of the number of all figures."""
    with telling("reading the results") as bar:

        def show(name: str, of: int) -> None:
            bar.n += 1
            bar.set_description_str(f"figure {bar.n} of {of}: {name}")

        yield show


def telling(what: str) -> tqdm[NoReturn]:
    """Return a context in which a line says what is being done; nothing if no terminal shows it."""
    from tqdm import tqdm

    return tqdm(desc=what, bar_format="{desc}", leave=False, disable=None, dynamic_ncols=True)
