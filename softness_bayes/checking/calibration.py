"""Ranks of true values among posterior draws: tests of uniformity, coverage, their power, and the verdict.

If prior, likelihood and sampler are consistent, the rank of a true value among independent posterior draws
is uniform, for every quantity of parameters and data (Talts, Betancourt, Simpson, Vehtari and Gelman,
arXiv:1804.06788).

The power is that of the rule of the calibration, applied to tables of ranks simulated under a given fault. A posterior
too narrow by a factor w, or shifted by s of its standard deviations, puts the truth at the normal score w z + s among
its draws, z ~ N(0, 1). The distribution of the rank follows by quadrature. Tables are drawn from it by inversion of the
same uniform numbers for every w and s, so that the frequency of alarms is smooth in both.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtr, chdtrc, chdtri, gammaln, log_ndtr, ndtri
from scipy.stats import binom

from softness_bayes.checking.uniformity import simultaneous_band, uniformity_p_value
from softness_bayes.readable import percent

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

TABLES = 2000
"""Simulated tables of ranks for the power."""


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
    """P-value of uniform ranks, by the simultaneous limits of their distribution function; exact."""
    spread_p: float
    """P-value of the spread of the ranks' normal scores, sensitive to intervals of wrong width."""
    spread: float
    """Root mean square of those scores over its expectation: above 1 the posterior is too narrow."""


class Least(NamedTuple):
    """The smallest fault that raises the alarm with probability `POWER`; infinite if none does."""

    value: float
    error: float
    """Its standard error, due to the number of simulated tables."""


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
        exchangeable = sum(not one.converged for one in replicates)
        return cls(replicates[0].names, np.array([one.rank for one in replicates]), exchangeable=exchangeable)

    @property
    def points(self) -> FloatArray:
        """Points at which the distribution function of (rank + 1) / (draws + 1) is evaluated."""
        return np.arange(1, self.draws + 1) / (self.draws + 1)

    @property
    def positions(self) -> FloatArray:
        """(rank + 1) / (draws + 1), shape (replicates, quantities)."""
        return (self.rank + 1) / (self.draws + 1)

    @property
    def threshold(self) -> float:
        """P-value below which one of the tests raises the alarm: `FALSE_ALARM` divided among all."""
        return FALSE_ALARM / (2 * len(self.names))

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
    def least_width(self) -> Least:
        """Smallest factor of a too narrow posterior that these replicates detect nine times in ten."""
        return least_fault(self._independent, self.draws, self.threshold, "width")

    @property
    def least_shift(self) -> Least:
        """Smallest shift of a posterior, in its standard deviations, that is detected as often."""
        return least_fault(self._independent, self.draws, self.threshold, "shift")

    @property
    def _independent(self) -> int:
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
    score, rank = width * z + shift, np.arange(draws + 1)[:, None]
    ways = gammaln(draws + 1) - gammaln(rank + 1) - gammaln(draws - rank + 1)
    # the rank of a truth at one score is binomial
    law = np.exp(ways + rank * log_ndtr(score) + (draws - rank) * log_ndtr(-score))
    return np.asarray(law @ (weight / weight.sum()))


@lru_cache(maxsize=64)
def alarm_of(size: int, draws: int, threshold: float) -> Callable[[IndexArray], NDArray[np.bool_]]:
    """Return the rule of a calibration: whether tables of ranks (tables, replicates) raise the alarm, (tables,).

    Its limits take a second to compute.
    """
    band = simultaneous_band(size, np.arange(1, draws + 1) / (draws + 1), 1.0 - threshold)
    low, high = np.rint(band.low * size), np.rint(band.high * size)
    squares, freedom = squared_scores(size, draws)
    narrow, wide = (chdtri(freedom, tail) / freedom for tail in (0.5 * threshold, 1.0 - 0.5 * threshold))

    def raised(rank: IndexArray) -> NDArray[np.bool_]:
        flat = (rank + (draws + 1) * np.arange(len(rank))[:, None]).ravel()
        counts = np.bincount(flat, minlength=(draws + 1) * len(rank)).reshape(len(rank), draws + 1)
        below, spread = counts.cumsum(axis=1)[:, :-1], counts @ squares / squares.mean() / size
        outside = ((below < low) | (below > high)).any(axis=1)
        return np.asarray(outside | (spread > narrow) | (spread < wide))

    return raised


def power(size: int, draws: int, threshold: float, width: float = 1.0, shift: float = 0.0) -> float:
    """Return the share of simulated tables of one quantity with a given fault that raise the alarm.

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
    cumulated = rank_law(draws, width, shift).cumsum()
    uniform = np.random.default_rng(20).random((TABLES, size))
    rank = np.searchsorted(cumulated[:-1], uniform, side="right")
    return float(alarm_of(size, draws, threshold)(rank).mean())


@lru_cache(maxsize=64)
def least_fault(size: int, draws: int, threshold: float, kind: str) -> Least:
    """Return the smallest fault of a kind, width or shift as for `rank_law`, that raises the alarm as `POWER` asks."""
    none, low, high = {"width": (1.0, 1.0, 10.0), "shift": (0.0, 0.0, 10.0)}[kind]

    def power_at(fault: float) -> float:
        return power(size, draws, threshold, **{kind: fault})

    if power_at(high) < POWER:
        return Least(math.inf, 0.0)
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if power_at(middle) >= POWER else (middle, high)
    step = 0.1 * (high - none)
    slope = (power_at(high + step) - power_at(high - step)) / (2.0 * step)
    return Least(high, math.sqrt(POWER * (1.0 - POWER) / TABLES) / slope)


@lru_cache(maxsize=64)
def replicates_needed(draws: int, threshold: float, width: float) -> int:
    """Return the number of replicates, in tens, that detects posteriors too narrow by a factor as `POWER` asks."""
    least, most = 0, 1
    while power(10 * most, draws, threshold, width=width) < POWER:
        least, most = most, 2 * most
    while most - least > 1:
        middle = (least + most) // 2
        found = power(10 * middle, draws, threshold, width=width) >= POWER
        least, most = (least, middle) if found else (middle, most)
    return 10 * most


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
    if math.isfinite(width.value + shift.value):
        narrow, moved = (f"{one.value:.2f} ± {max(one.error, 0.01):.2f}" for one in (width, shift))
        seen = (
            f"A posterior {narrow} times too narrow, or shifted by {moved} of its standard deviations, would have been "
            "detected with a power of 90 %; smaller faults may be missed."
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
    rows, columns = calibration.coverage(), ("low", "share", "high", "outside")
    low, share, high, chance = np.array([[float(row[name]) for name in columns] for row in rows]).T
    outside = ((share < low) | (share > high)).sum()
    said = f"{outside} of {len(rows)} shares lie outside their own 95 % limits (low, high)"
    return f"{said}; about {chance.sum():.0f} do by chance"
