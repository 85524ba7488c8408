"""Ranks of short replicates beside those of long ones, from two stored calibrations with the same seed.

Truths and ratings are the same in both, draws are not. Ranks of a truth among two independent sets of draws of one
posterior differ by a mean square of a third of the number of draws, averaged over uniform truths.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from softness_bayes.checking.ranks import DRAWS
from softness_bayes.parameters.declared import PARAMETERS

LONG, SHORT = "calibration_long", "calibration"
"""Folders of the stored calibrations."""

COMPARED = (*PARAMETERS, "log_likelihood")
"""Quantities that are compared, where they are ranked. Effects of participants given the parameters are drawn with the
same random numbers in both, and ranks of turning points are often tied."""

EXPECTED = DRAWS / 3.0
"""Mean square of the difference of ranks among two sets of `DRAWS` independent draws of one posterior."""


class Agreement(NamedTuple):
    """Differences of the ranks of one quantity."""

    quantity: str
    replicates: int
    mean_square: float
    error: float
    """Its standard error."""


def agreements(long: Sequence[Mapping[str, str]], short: Sequence[Mapping[str, str]]) -> list[Agreement]:
    """Return the differences for each quantity, from the rows of two files of ranks.

    Compared are the replicates that have converged in both.
    """
    pairs = _pairs(long, short)
    return [_agreement(name, pairs) for name in COMPARED if name in long[0]]


def steps(long: Sequence[Mapping[str, str]], short: Sequence[Mapping[str, str]]) -> tuple[float, float]:
    """Return the median numbers of steps of the replicates that are compared."""
    one, other = (np.median([int(row["steps"]) for row in rows]) for rows in zip(*_pairs(long, short), strict=True))
    return float(one), float(other)


def _pairs(
    long: Sequence[Mapping[str, str]], short: Sequence[Mapping[str, str]]
) -> list[tuple[Mapping[str, str], Mapping[str, str]]]:
    found = {row["replicate"]: row for row in short if row["converged"] == "True"}
    return [(row, found[row["replicate"]]) for row in long if row["converged"] == "True" and row["replicate"] in found]


def _agreement(name: str, pairs: Sequence[tuple[Mapping[str, str], Mapping[str, str]]]) -> Agreement:
    squares = np.array([(int(one[name]) - int(other[name])) ** 2 for one, other in pairs])
    return Agreement(name, squares.size, float(squares.mean()), float(squares.std(ddof=1) / np.sqrt(squares.size)))
