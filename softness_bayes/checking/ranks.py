"""Ranks of true values among posterior draws: tests of uniformity, coverage, and their power.

If prior, likelihood and sampler are consistent, the rank of a true value among independent posterior draws
is uniform, for every quantity of parameters and data (Talts, Betancourt, Simpson, Vehtari and Gelman,
arXiv:1804.06788).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtr, chdtrc
from scipy.stats import binom

from softness_bayes.checking.rank_power import Least, least_shift, least_width, replicates_needed, squared_scores
from softness_bayes.checking.uniformity import uniformity_p_value

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]

DRAWS = 99
"""Posterior draws for the rank of a true value: one hundred equally probable ranks."""

MASSES = (0.5, 0.8, 0.9, 0.95)
"""Central intervals whose coverage is counted."""

FALSE_ALARM = 0.01
"""Probability of a false alarm for a correct model, divided among all tests."""

LARGEST_WIDTH = 1.5
"""Factor by which a posterior is too narrow that a sufficient number of replicates must detect.

A 90 % interval of such a posterior contains the truth in 73 % of cases."""


class Replicate(NamedTuple):
    """Result of one fit of simulated ratings, compared with the true values."""

    names: tuple[str, ...]
    """Ranked quantities, those of `runs.ranked_quantities`."""
    rank: tuple[int, ...]
    """Number of the `DRAWS` posterior draws below the true value."""
    truth: tuple[float, ...]
    """True values, in natural units; 0 for a missing turning point."""
    steps: int
    """Number of steps of each ensemble."""
    tau: float
    """Longest autocorrelation time, in steps."""
    converged: bool
    """True if the run met its goal, so that the draws are nearly independent."""
    exchangeable: bool = False
    """True if the run did not, and the draws are exchangeable with the truth instead (`sampler.exchangeable`)."""

    @property
    def valid(self) -> bool:
        """True if a correct model has uniform ranks."""
        return self.converged or self.exchangeable


class Judged(NamedTuple):
    """Tests of the ranks of one quantity."""

    uniform_p: float
    """P-value of uniform ranks, by the simultaneous limits of their distribution function; exact."""
    spread_p: float
    """P-value of the spread of the ranks' normal scores, sensitive to intervals of wrong width."""
    spread: float
    """Root mean square of those scores over its expectation: above 1 the posterior is too narrow."""


@dataclass(frozen=True)
class Calibration:
    """Ranks of true values over many replicates.

    Parameters
    ----------
    names
        Ranked quantities.
    rank
        Ranks from 0 to `draws`, shape (replicates, quantities).
    draws
        Posterior draws for each rank.
    exchangeable
        Number of replicates whose ranks detect little, because their draws are not independent; the power is that of
        the others.
    """

    names: tuple[str, ...]
    rank: IndexArray
    draws: int = DRAWS
    exchangeable: int = 0

    @classmethod
    def of(cls, replicates: Sequence[Replicate]) -> Calibration:
        """Collect the ranks of some replicates of one model."""
        exchangeable = sum(one.exchangeable for one in replicates)
        return cls(replicates[0].names, np.array([one.rank for one in replicates]), exchangeable=exchangeable)

    @property
    def points(self) -> FloatArray:
        """Points at which the distribution function of (rank + 1) / (draws + 1) is evaluated."""
        return np.arange(1, self.draws + 1) / (self.draws + 1)

    @property
    def positions(self) -> FloatArray:
        """(rank + 1) / (draws + 1), shape (replicates, quantities)."""
        return (self.rank + 1) / (self.draws + 1)

    def judge(self) -> dict[str, Judged]:
        """Test every quantity."""
        return {name: self._judge(k) for k, name in enumerate(self.names)}

    def _judge(self, quantity: int) -> Judged:
        squares, freedom = squared_scores(len(self.rank), self.draws)
        relative = float(squares[self.rank[:, quantity]].mean() / squares.mean())
        tails = chdtr(freedom, relative * freedom), chdtrc(freedom, relative * freedom)
        uniform = uniformity_p_value(self.positions[:, quantity], self.points)
        return Judged(uniform, float(min(1.0, 2.0 * min(tails))), math.sqrt(relative))

    @property
    def least_width(self) -> Least:
        """Smallest factor of a too narrow posterior that these replicates detect nine times in ten."""
        return least_width(self._telling, self.draws, self.threshold)

    @property
    def least_shift(self) -> Least:
        """Smallest shift of a posterior, in its standard deviations, that is detected as often."""
        return least_shift(self._telling, self.draws, self.threshold)

    @property
    def _telling(self) -> int:
        """Number of replicates with nearly independent draws."""
        return len(self.rank) - self.exchangeable

    @property
    def enough(self) -> bool:
        """True if posteriors `LARGEST_WIDTH` times too narrow are detected as often; otherwise the test is too weak."""
        return self.least_width.value <= LARGEST_WIDTH

    @property
    def needed(self) -> int:
        """Replicates, in tens, that would be enough."""
        return replicates_needed(self.draws, self.threshold, LARGEST_WIDTH)

    @property
    def threshold(self) -> float:
        """P-value below which one of the tests raises the alarm: `FALSE_ALARM` divided among all."""
        return FALSE_ALARM / (2 * len(self.names))

    def faults(self) -> list[str]:
        """Return the quantities that fail a test, with their faults."""
        return [f"{name} ({fault})" for name, fault in self.fault_of().items()]

    def fault_of(self) -> dict[str, str]:
        """Return the fault of every quantity that fails a test, by name."""
        found = {}
        for (name, judged), position in zip(self.judge().items(), self.positions.T, strict=True):
            if judged.spread_p < self.threshold:
                kind = "narrow" if judged.spread > 1.0 else "wide"
                found[name] = f"too {kind}: scores spread {judged.spread:.2f} times, p = {judged.spread_p:.1g}"
            elif judged.uniform_p < self.threshold:
                side = "high" if position.mean() < 0.5 else "low"
                found[name] = f"too {side}: ranks not uniform, p = {judged.uniform_p:.1g}"
        return found

    def coverage(self) -> list[dict[str, float | str | int]]:
        """Count how often central intervals contain the truth.

        Returns
        -------
        list of dict
            For each quantity and mass: quantity, mass, expected (the share of ranks inside), covered (number
            of replicates), share, low and high: 95 % limits of the share if the model is calibrated, and outside: the
            probability that it lies beyond them all the same.
        """
        size = len(self.rank)
        places = np.abs((np.arange(self.draws + 1) + 0.5) / (self.draws + 1) - 0.5)
        rows: list[dict[str, float | str | int]] = []
        for k, name in enumerate(self.names):
            for mass in MASSES:
                inside = places <= 0.5 * mass + 1e-12
                covered, expected = int(inside[self.rank[:, k]].sum()), float(inside.mean())
                low, high = binom.ppf([0.025, 0.975], size, expected)
                outside = binom.cdf(low - 1, size, expected) + binom.sf(high, size, expected)
                rows.append(
                    {
                        "quantity": name,
                        "mass": mass,
                        "expected": expected,
                        "covered": covered,
                        "share": covered / size,
                        "low": float(low / size),
                        "high": float(high / size),
                        "outside": float(outside),
                    }
                )
        return rows
