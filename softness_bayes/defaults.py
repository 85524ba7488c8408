"""Defaults that the package and the command line share; the command line's help needs them without the libraries."""

from __future__ import annotations

from collections.abc import Sequence

ACCURACY = 1e-3
"""Bound of the response's numerical error, relative to its peak."""

MAX_STEPS = 100_000
"""Steps of each ensemble after which a run ends."""

NOISE = 0.0
"""Strength of the membranes' white current [µA/cm² sqrt(ms)]."""

ERRORS = ("normal", "student", "lapses")
"""Names of the error laws of ratings, `likelihood.error_laws.ERROR_LAWS`: listed here so that help needs no NumPy."""

LEFT_OUT = ("rating", "participant", "fabric", "condition")
"""Names of the units that a comparison leaves out, `runs.left_out.LEAVE`; likewise."""

PRIOR_SET = "default"
"""Named set of priors."""

SEED = 0
"""Seed of all random numbers."""

GARBAGE = (20_000, 20, 20)
"""How seldom the program and its workers look for garbage, as `gc.set_threshold` takes it."""

ANSWER_DRAWS = 400
"""Posterior draws of a run behind what it answers: predictions, rankings, targets, the page of sliders."""

MOST_SHOWN = 12
"""Loads that figures draw and lists name one by one; of more, as many are shown, evenly spread."""


def shown_of(count: int, most: int = MOST_SHOWN) -> list[int]:
    """Return the indices that are shown of so many: all of them, or some evenly spread, the ends among them."""
    if count <= most:
        return list(range(count))
    return [round(k * (count - 1) / (most - 1)) for k in range(most)]


def in_words(names: Sequence[str], joined: str = ", ") -> str:
    """Return names joined; of more than are shown, their number and the first and the last."""
    if len(names) <= MOST_SHOWN:
        return joined.join(names)
    return f"{len(names)} loads, {names[0]} to {names[-1]}"
