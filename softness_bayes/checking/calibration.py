"""Ranks of true values among posterior draws: tests of uniformity, coverage, their power, and the verdict.

If prior, likelihood and sampler are consistent, the rank of a true value among independent posterior draws
is uniform, for every quantity of parameters and data (Talts, Betancourt, Simpson, Vehtari and Gelman,
arXiv:1804.06788).

The power is stated from below: it is that of the most powerful single part of the rule against a given fault. A
posterior too narrow by a factor w, or shifted by s of its standard deviations, puts the truth at the normal score
w z + s among its draws, z ~ N(0, 1). The distribution of the rank follows by quadrature; counts of ranks are binomial,
and the mean of many squared normal scores is nearly normal.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import count
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import chdtr, chdtrc, chdtri, ndtr, ndtri
from scipy.stats import binom

from softness_bayes.base.readable import percent
from softness_bayes.checking.quantities import simultaneous_band, uniformity_p_value

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

POWER = 0.9
"""Probability of an alarm for which the detectable fault is reported."""


class Replicate(NamedTuple):
    """Result of one fit of simulated ratings, compared with the true values."""

    names: tuple[str, ...]
    """Ranked quantities, those of `runs.replicate.quantities`."""
    rank: tuple[int, ...]
    """Number of the `DRAWS` posterior draws below the true value."""
    truth: tuple[float, ...]
    """True values, in natural units; 0 for a missing turning point."""
    steps: int
    """Number of steps of each ensemble."""
    tau: float
    """Longest autocorrelation time, in steps."""
    converged: bool
    """True if the run met its goal, so that the draws are nearly independent; otherwise, the draws are those of chains
    through the truth, with which they are exchangeable (`sampler.exchangeable`)."""
    earlier: tuple[tuple[str, str], ...] = ()
    """Settings of its fit, by name, that differ from those of the calibration, if it was taken from an earlier one."""


class Judged(NamedTuple):
    """Tests of the ranks of one quantity."""

    uniform_p: float
    """P-value of uniform ranks, by the simultaneous limits of their distribution function."""
    spread_p: float
    """P-value of the spread of the ranks' normal scores, sensitive to intervals of wrong width."""
    spread: float
    """Root mean square of those scores over its expectation: above 1 the posterior is too narrow."""


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

    Attributes
    ----------
    positions, points
        (rank + 1) / (draws + 1), shape (replicates, quantities), and where its distribution function is evaluated.
    threshold
        P-value below which one of the tests raises the alarm: `FALSE_ALARM` divided among all.
    """

    def __init__(self, names: tuple[str, ...], rank: IndexArray, draws: int = DRAWS, exchangeable: int = 0) -> None:
        self.names, self.rank, self.draws, self.exchangeable = names, rank, draws, exchangeable
        self.points: FloatArray = np.arange(1, draws + 1) / (draws + 1)
        self.positions: FloatArray = (rank + 1) / (draws + 1)
        self.threshold = FALSE_ALARM / (2 * len(names))

    @classmethod
    def of(cls, replicates: Sequence[Replicate]) -> Calibration:
        """Collect the ranks of some replicates of one model."""
        exchangeable = sum(not one.converged for one in replicates)
        return cls(replicates[0].names, np.array([one.rank for one in replicates]), exchangeable=exchangeable)

    def judge(self) -> dict[str, Judged]:
        """Test every quantity."""
        squares, freedom = squared_scores(len(self.rank), self.draws)
        found = {}
        for name, rank, position in zip(self.names, self.rank.T, self.positions.T, strict=True):
            relative = float(squares[rank].mean() / squares.mean())
            spread_p = min(1.0, 2.0 * min(chdtr(freedom, relative * freedom), chdtrc(freedom, relative * freedom)))
            found[name] = Judged(uniformity_p_value(position, self.points), float(spread_p), math.sqrt(relative))
        return found

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

    def faults(self) -> list[str]:
        """Return the quantities that fail a test, with their faults."""
        return [f"{name} ({fault})" for name, fault in self.fault_of().items()]

    @property
    def least_width(self) -> float:
        """Smallest factor of a too narrow posterior that these replicates detect nine times in ten."""
        return self._least("width", 1.0)

    @property
    def least_shift(self) -> float:
        """Smallest shift of a posterior, in its standard deviations, that is detected as often."""
        return self._least("shift", 0.0)

    def _least(self, kind: str, none: float) -> float:
        """Return the smallest fault of a kind, as for `rank_law`, that is detected as often; infinite if none is."""

        def lacks(fault: float) -> float:
            return POWER - power(len(self.rank) - self.exchangeable, self.draws, self.threshold, **{kind: fault})

        return math.inf if lacks(10.0) > 0.0 else float(brentq(lacks, none, 10.0, xtol=1e-3))

    @property
    def enough(self) -> bool:
        """True if posteriors `LARGEST_WIDTH` times too narrow are detected as often; otherwise the test is too weak."""
        return self.least_width <= LARGEST_WIDTH

    @property
    def needed(self) -> int:
        """Replicates, in tens, that would be enough."""
        enough = (size for size in count(10, 10) if power(size, self.draws, self.threshold, LARGEST_WIDTH) >= POWER)
        return next(enough)

    def coverage(self) -> pd.DataFrame:
        """Count how often central intervals contain the truth.

        Returns
        -------
        DataFrame
            For each quantity and mass: quantity, mass, expected (the share of ranks inside), covered (number
            of replicates), share, low and high: 95 % limits of the share if the model is calibrated, and outside: the
            probability that it lies beyond them all the same.
        """
        size = len(self.rank)
        places = np.abs((np.arange(self.draws + 1) + 0.5) / (self.draws + 1) - 0.5)
        inside = {mass: places <= 0.5 * mass + 1e-12 for mass in MASSES}
        rows = [
            (name, mass, inside[mass].mean(), int(inside[mass][self.rank[:, k]].sum()))
            for k, name in enumerate(self.names)
            for mass in MASSES
        ]
        table = pd.DataFrame(rows, columns=["quantity", "mass", "expected", "covered"])
        low, high = binom.ppf([[0.025], [0.975]], size, table["expected"])
        outside = binom.cdf(low - 1, size, table["expected"]) + binom.sf(high, size, table["expected"])
        return table.assign(share=table["covered"] / size, low=low / size, high=high / size, outside=outside)


def squared_scores(size: int, draws: int) -> tuple[FloatArray, float]:
    """Return the squared normal score of every rank, and the degrees of freedom of the matching chi-squared law."""
    squares = ndtri((np.arange(draws + 1) + 0.5) / (draws + 1)) ** 2
    return squares, float(2.0 * size * squares.mean() ** 2 / squares.var())


def rank_law(draws: int, width: float = 1.0, shift: float = 0.0) -> FloatArray:
    """Return the probability of each rank from 0 to `draws` if the posterior is too narrow by a factor, or shifted.

    Parameters
    ----------
    draws
        Posterior draws that a truth is ranked among.
    width
        Ratio of correct to stated standard deviation.
    shift
        Shift of the posterior, in its standard deviations.
    """
    z = np.linspace(-8.0, 8.0, 2001)
    weight = np.exp(-0.5 * z**2)
    # the rank of a truth at one score is binomial
    law = binom.pmf(np.arange(draws + 1)[:, None], draws, ndtr(width * z + shift).clip(1e-12, 1.0 - 1e-12))
    return np.asarray(law @ (weight / weight.sum()))


@lru_cache(maxsize=256)
def power(size: int, draws: int, threshold: float, width: float = 1.0, shift: float = 0.0) -> float:
    """Return a lower limit of the probability that ranks of one quantity with a given fault raise the alarm.

    Parameters
    ----------
    size, draws
        Replicates, and posterior draws that each truth is ranked among.
    threshold
        P-value below which each of the two tests raises the alarm.
    width, shift
        As for `rank_law`.
    """
    if not size:
        return 0.0
    law = rank_law(draws, width, shift)
    low, high = simultaneous_band(size, np.arange(1, draws + 1) / (draws + 1), 1.0 - threshold)
    below, above = np.ceil(low * size), np.floor(high * size)
    counts = binom(size, law.cumsum()[:-1].clip(0.0, 1.0))
    squares, freedom = squared_scores(size, draws)
    mean, sd = float(law @ squares), math.sqrt(float(law @ squares**2 - (law @ squares) ** 2) / size)
    limits = squares.mean() / freedom * chdtri(freedom, np.array([1.0 - 0.5 * threshold, 0.5 * threshold]))
    spread = ndtr((limits[0] - mean) / sd) + ndtr((mean - limits[1]) / sd)
    return float(max(spread, (counts.cdf(below - 1) + counts.sf(above)).max()))


def verdict(calibration: Calibration, size: str, decided: bool) -> str:
    """Return the verdict in one line.

    Parameters
    ----------
    calibration
        The ranks.
    size
        Number of replicates and their outcome, in words.
    decided
        Whether all replicates are finished.
    """
    faults = calibration.faults()
    if faults:
        return f"Not calibrated: {size}: {'; '.join(faults)}."
    kind = ("Calibrated" if calibration.enough else "Too few replicates") if decided else "Not decided"
    worst = min(min(one.uniform_p, one.spread_p) for one in calibration.judge().values())
    width, shift = calibration.least_width, calibration.least_shift
    seen = "No fault would have been detected with a power of 90 %."
    if math.isfinite(width + shift):
        seen = (
            f"A posterior {width:.2f} times too narrow, or shifted by {shift:.2f} of its standard deviations, would "
            "have been detected with a power of at least 90 %; smaller faults may be missed."
        )
    if not calibration.enough:
        seen += f" To find one {LARGEST_WIDTH:g} times too narrow takes about {calibration.needed} replicates."
    return (
        f"{kind}: {size}; no alarm over {len(calibration.names)} quantities ranked among {calibration.draws} "
        f"draws: smallest p-value {worst:.2g}, alarm below {calibration.threshold:.1g} (false alarms in at "
        f"most {percent(FALSE_ALARM)} of calibrations). {seen}"
    )


def coverage_sentence(calibration: Calibration) -> str:
    """Describe how many coverages lie outside their limits, and how many are expected by chance."""
    table = calibration.coverage()
    outside = ((table["share"] < table["low"]) | (table["share"] > table["high"])).sum()
    said = f"{outside} of {len(table)} shares lie outside their own 95 % limits (low, high)"
    return f"{said}; about {table['outside'].sum():.0f} do by chance"
