"""Defaults shared by the package and the command line, kept free of imports so that help is fast."""

from __future__ import annotations

import signal
from collections.abc import Sequence

ACCURACY = 1e-3
"""Bound on the numerical error of the response, relative to its peak."""

MAX_STEPS = 100_000
"""Maximum number of steps of each ensemble."""

STEPS_PER_TAU = 10.0
"""Kept steps of each ensemble, in autocorrelation times."""

NOISE = 0.0
"""Strength of the white-noise current of the membranes [µA/cm² sqrt(ms)]."""

ERRORS = ("normal", "student", "lapses")
"""Names of the error laws of ratings (`likelihood.error_laws.ERROR_LAWS`), repeated so that help needs no NumPy."""

LEFT_OUT = ("rating", "participant", "fabric", "condition", "response")
"""Names of the units that a comparison leaves out, as in `runs.left_out.LEAVE`, repeated for the same reason."""

PRIOR_SET = "default"
"""Named set of priors."""

SEED = 0
"""Seed of all random numbers."""

GARBAGE = (20_000, 20, 20)
"""Thresholds of garbage collection in the program and its workers, as for `gc.set_threshold`."""

SIGNALS = tuple(
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP")
    if hasattr(signal, name)  # Windows lacks the last
)
"""Signals that end a command: Ctrl-C, a request to end, and a closed terminal."""

ANSWER_DRAWS = 400
"""Number of posterior draws used for predictions, rankings, targets and the page of sliders."""

LEVELS = (0.5, 0.9)
"""Probabilities of credible bands and regions."""

LIMITS = (0.05, 0.25, 0.5, 0.75, 0.95)
"""Quantiles that bound them, and the median."""

MOST_SHOWN = 12
"""Largest number of loads shown in figures and lists; of more loads, this many are shown, evenly spaced."""


def shown_of(count: int, most: int = MOST_SHOWN) -> list[int]:
    """Return the indices to show out of `count`: all, or at most `most`, evenly spaced and including both ends."""
    if count <= most:
        return list(range(count))
    return [round(k * (count - 1) / (most - 1)) for k in range(most)]


def in_words(names: Sequence[str], joined: str = ", ") -> str:
    """Return the names joined; if there are too many to show, their number, the first and the last."""
    if len(names) <= MOST_SHOWN:
        return joined.join(names)
    return f"{len(names)} loads, {names[0]} to {names[-1]}"
