"""Time of a redraw of the page of sliders, and error of its curves.

``python -m softness_bayes.tools.benchmark_explore [RUN]`` moves every slider at random over its whole range, one at a
time, on a page without a window: of the priors' medians, or of a finished run. A redraw is everything from the slider's
event to the last change of the page's document; what a browser needs to draw these comes on top. The error is that of
all curves against exact rates on a finer scene, relative to the highest point of each state's curves.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
from bokeh.document import Document
from numpy.typing import NDArray

from softness_bayes.explore.page import Page
from softness_bayes.explore.picture import picture
from softness_bayes.explore.subject import EXAMPLE_LOADS, State, Subject, example_fabrics, of_priors, of_run
from softness_bayes.model.scenes import touch_parameters
from softness_bayes.results.result import Result

MOVES = 500
"""Moves of sliders whose redraws are timed."""

STATES = 24
"""Random states at which the error is measured, every slider moved; the exact rate curve of each takes a second."""


def redraws(subject: Subject, rng: np.random.Generator, moves: int = MOVES) -> NDArray[np.float64]:
    """Return the time of each redraw [s]."""
    page, taken = Page(subject, Document()), []
    for _ in range(moves):
        span = subject.spans[rng.integers(len(subject.spans))]
        slider: Any = page.sliders[span.name]
        place = rng.uniform(slider.start, slider.end)
        begun = time.perf_counter()
        slider.value = place
        taken.append(time.perf_counter() - begun)
    return np.array(taken)


def errors(subject: Subject, rng: np.random.Generator, states: int = STATES) -> NDArray[np.float64]:
    """Return the largest error of each state's curves, relative to their maximum; states without firing are skipped."""
    exact, found = subject.curves.exact(), []
    for _ in range(states):
        values = {s.name: s.value(rng.uniform(s.place(s.low), s.place(s.high))) for s in subject.spans}
        state = State(values, 0, None, subject.start.modulus_kpa)
        rate = exact.total_rate(touch_parameters(subject.values(state)))
        if rate.max() > 0:
            found.append(np.abs(picture(subject, state).rate.ravel() - rate).max() / rate.max())
    return np.array(found)


def main() -> None:
    """Measure time and error, and print a line for each."""
    reader = argparse.ArgumentParser(description=__doc__)
    reader.add_argument("run", nargs="?", type=Path, help="directory of a finished run")
    run = reader.parse_args().run
    subject = of_priors(example_fabrics(), EXAMPLE_LOADS) if run is None else of_run(Result.load(run))
    rng = np.random.default_rng(0)
    taken = 1e3 * redraws(subject, rng)
    print(
        f"{len(taken)} redraws: median {np.median(taken):.1f} ms, 99 % within {np.quantile(taken, 0.99):.1f} ms, "
        f"longest {taken.max():.1f} ms"
    )
    wrong = errors(subject, rng)
    print(f"error of {len(wrong)} states' curves relative to their peak: median {np.median(wrong):.1g}, "
          f"largest {wrong.max():.1g}")  # fmt: skip


if __name__ == "__main__":
    main()
