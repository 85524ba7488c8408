"""Verdicts on pairs of fabrics: which one is rated higher, by people or by the chain, or that neither can decide."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.readable import counted
from softness_bayes.people.sentences import DECIDED

Array = NDArray[np.float64]
IntArray = NDArray[np.intp]

BY_PEOPLE, BY_CHAIN = "people's own ratings", "the chain"
REASONS = (
    BY_PEOPLE,
    BY_CHAIN,
    "no receptor fires",
    "the contact is beyond Hertz's geometry",
    "the modulus is beyond those rated",
    "the load is beyond those rated",
    "the chain does not follow the ratings",
    "neither order is 95 % sure",
)
"""Reasons of a verdict: the first two decide, all others do not; a pair has the first that holds."""

UNDECIDED = "cannot decide"
WORDS = {"softest": ("softer", "stiffer"), "hardest": ("harder", "softer")}
"""Words for the first fabric of a pair, by what the highest rating means."""


class Verdicts(NamedTuple):
    """Verdicts on all pairs of some fabrics under one load, arrays (fabrics, fabrics)."""

    higher: IntArray
    """1 if the fabric of the row is rated higher than that of the column, -1 if lower, 0 if that cannot be decided."""
    reason: IntArray
    """Index of the reason in `REASONS`."""

    @property
    def counts(self) -> IntArray:
        """Number of pairs by reason."""
        return np.bincount(self.reason[np.triu_indices(len(self.reason), 1)], minlength=len(REASONS))

    def words(self, row: IntArray, column: IntArray, word: str) -> Array:
        """Return the verdict on pairs in words, for what the highest rating means (`FreeMeans.word`)."""
        above, below = WORDS.get(word, ("rated higher", "rated lower"))
        return np.array([UNDECIDED, above, below], object)[self.higher[row, column]]

    def reasons(self, row: IntArray, column: IntArray) -> Array:
        """Return the reason of the verdict on pairs in words."""
        return np.array(REASONS, object)[self.reason[row, column]]


def verdicts(people: Array, chain: Array, barred: Sequence[NDArray[np.bool_]], rejected: bool) -> Verdicts:
    """Return the verdicts on all pairs of fabrics under one load.

    Parameters
    ----------
    people, chain
        Probability that the fabric of the row is rated higher than that of the column, by people's own means (NaN for
        pairs that people did not rate both) and by the chain, shape (fabrics, fabrics).
    barred
        For silence, geometry, modulus and load, in the order of `REASONS`: the fabrics of which the chain cannot speak
        for that reason, each (fabrics,).
    rejected
        True if the chain does not follow the ratings, so that nothing rests on it.
    """
    either = [one[:, None] | one for one in barred]
    known = ~np.isnan(people)
    sure = np.maximum(chain, chain.T) >= DECIDED
    told = known & (np.fmax(people, people.T) >= DECIDED)
    conditions = [told, *(~known & one for one in either), ~known & rejected, ~known & sure]
    reason = np.select(conditions, [0, 2, 3, 4, 5, 6, 1], len(REASONS) - 1)
    probability = np.where(told, people, chain)
    higher = np.where(reason < 2, np.where(probability > 0.5, 1, -1), 0)
    return Verdicts(higher, reason)


def decided_sentence(found: Sequence[Verdicts]) -> str:
    """Return how many pairs are decided under all loads together, by whom, and why not the others."""
    counts = np.sum([one.counts for one in found], axis=0)
    total, decided = int(counts.sum()), int(counts[:2].sum())
    by = [f"{counts[k]} by {REASONS[k]}" for k in range(2) if counts[k]]
    why = [f"{counts[k]} because {REASONS[k]}" for k in range(2, len(REASONS)) if counts[k]]
    return (
        f"{decided} of {counted(total, 'pair')} of fabrics {'is' if decided == 1 else 'are'} decided"
        + (f" ({', '.join(by)})" if by else "")
        + (f"; {counted(total - decided, 'pair is', 'pairs are')} not: {', '.join(why)}" if why else "")
    )
