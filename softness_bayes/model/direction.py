"""Direction of a table's ratings with stiffness, and the direction with the response that agrees with it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, stdtr

from softness_bayes.base.readable import counted, percent
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.layout import Layout
from softness_bayes.likelihood.scales import FALLS, FREE, RISES, RatingDirection

FloatArray = NDArray[np.float64]


WAY = {1: "rise", -1: "fall"}
"""Verbs for the sign of a correlation of ratings with stiffness."""

DRAWS, FEWEST = 256, 16
"""Number of prior draws whose response is examined, and the smallest number whose response must vary with the
fabric."""

SURE = 0.9
"""Share of these draws in which firing must rise (or fall) with stiffness for the ratings to determine the
direction."""

LEVEL = 0.05
"""Two-sided p-value below which ratings are considered to rise or fall."""

FEWEST_FABRICS = 5
"""Smallest number of fabrics for a permutation of whole fabrics; fewer have too few orders to reach `LEVEL`."""

RESAMPLES, SHUFFLES = 500, 1999
"""Number of random weights of the participants, and of random orders of the fabrics if there are too many for all."""

LEVEL_OF_RATERS = 0.01
"""Probability that any rater of a table is reported by chance."""

FEWEST_RATINGS = 5
"""Smallest number of conditions of a rater whose order is compared, and of ratings that may all be the same."""

_SEED = 0  # the same seed for every table, so that the result depends only on the data
_DIGITS = 9  # means closer than this, relative to their range, are tied


class Correlation(NamedTuple):
    """Spearman's rank correlation of mean ratings with E_fab, and its interval over participants."""

    value: float
    """NaN if moduli or means are all the same."""
    low: float
    high: float
    """5 and 95 % limits; NaN with one participant."""

    @classmethod
    def of(cls, values: FloatArray) -> Correlation:
        """Return the first value with its 90 % limits, from the spread of the following ones about their median.

        Weighted means of people are noisier than those of all, so that their correlations lie below that of all: their
        own quantiles would be limits of another quantity, and may leave the estimate out.
        """
        value, known = float(values[0]), values[1:][np.isfinite(values[1:])]
        if not known.size or math.isnan(value):
            return cls(value, math.nan, math.nan)
        low, middle, high = np.quantile(known, (0.05, 0.5, 0.95)).tolist()
        return cls(value, max(value + low - middle, -1.0), min(value + high - middle, 1.0))

    def __str__(self) -> str:
        if math.isnan(self.low):
            return f"{self.value:+.2f}"
        return f"{self.value:+.2f} (90 % interval {self.low:+.2f} to {self.high:+.2f} over participants)"


class Trend(NamedTuple):
    """The trend of a table's ratings with stiffness."""

    loads: tuple[Correlation, ...]
    """Under each load, over its fabrics."""
    fabrics: tuple[int, ...]
    """Fabrics under each load."""
    mean: Correlation
    """Mean over loads with a correlation, weighted by their number of fabrics minus one."""
    p_value: float
    """Two-sided p-value of the mean correlation for a random order of the fabrics."""
    shuffled: str
    """Units permuted for the p-value: whole fabrics or, if there are few, the ratings of each participant."""

    @property
    def sign(self) -> int:
        """+1 if ratings clearly rise with stiffness, -1 if they clearly fall, 0 if the table does not decide."""
        return int(np.sign(self.mean.value)) if self.p_value <= LEVEL else 0


def find_trend(layout: Layout, ratings: FloatArray) -> Trend:
    """Return the rank correlation of the fabrics' mean (log) ratings with their moduli under each load.

    Means are those of the additive fit of participants and conditions. Intervals come from randomly weighted
    participants (the Bayesian bootstrap: Rubin, Annals of Statistics 9, 130, 1981), which leaves no condition without
    ratings. The p-value compares the mean correlation with those of random orders of the fabrics, or of all orders.
    With fewer than `FEWEST_FABRICS` fabrics it permutes each participant's ratings under each load instead, with the
    normal approximation of Spearman's correlation in blocks (Page's test, with gaps and ties).

    Parameters
    ----------
    layout
        Design of the ratings, and the moduli.
    ratings
        Shape (rows,).
    """
    design = layout.design
    weights = np.ones((1, design.n_participants))
    if (design.cells.sum(axis=1) > 0).sum() > 1:
        random = np.random.default_rng(_SEED).exponential(size=(RESAMPLES, design.n_participants))
        weights = np.concatenate([weights, random])
    means = condition_means(layout, ratings, weights)
    each, mean = rank_correlations(layout, means, layout.modulus)
    if np.unique(design.fabric).size >= FEWEST_FABRICS:
        p_value, shuffled = _p_of_fabrics(layout, means[0]), "the order of the fabrics"
    else:
        p_value, shuffled = _p_of_participants(layout, ratings), "the order of each participant's ratings"
    fabrics = tuple(int((layout.load == k).sum()) for k in layout.loads)
    return Trend(tuple(map(Correlation.of, each)), fabrics, Correlation.of(mean), p_value, shuffled)


def condition_means(layout: Layout, ratings: FloatArray, weights: FloatArray) -> FloatArray:
    """Return mean (log) ratings of the conditions over weighted participants, shape (k, conditions).

    Each participant's level is that of the additive fit with equal weights.

    Parameters
    ----------
    layout
        Design of the ratings.
    ratings
        Shape (rows,).
    weights
        Shape (k, participants); every condition needs a participant with a positive one.
    """
    design = layout.design
    level = np.nan_to_num(layout.fit(ratings).participant)
    sums = np.zeros_like(design.cells)
    own = layout.scale.additive(ratings) - level[design.participant]
    np.add.at(sums, (design.participant, design.condition), own)
    return np.asarray((weights @ sums) / (weights @ design.cells))


def rank_correlations(layout: Layout, rows: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return rank correlations over the fabrics of each load, (loads, rows), and their weighted means, (rows,).

    They are NaN where values are all the same; weights are the numbers of fabrics minus one.

    Parameters
    ----------
    layout
        Load of each condition.
    rows, x
        Values to correlate, shapes (rows, conditions) and (conditions,).
    """
    by_load = [layout.load == k for k in layout.loads]
    each = np.stack([_spearman(rows[:, some], x[some]) for some in by_load])
    weight = np.isfinite(each) * np.array([some.sum() - 1.0 for some in by_load])[:, None]
    total, summed = weight.sum(axis=0), (np.nan_to_num(each) * weight).sum(axis=0)
    return each, np.divide(summed, total, out=np.full_like(summed, np.nan), where=total > 0)


class OddRaters(NamedTuple):
    """Indices of unusual raters."""

    against: dict[int, float]
    """Correlation with the means of all others, significantly below 0, by rater."""
    constant: tuple[int, ...]
    """Raters whose ratings are all equal, if those of others are not."""
    copies: tuple[int, ...] = ()
    """Raters who gave the same ratings as an earlier one to all that they rated."""


def odd_raters(layout: Layout, ratings: FloatArray) -> OddRaters:
    """Return the raters with a trend opposite to the others, and those whose ratings are all equal.

    A trend is opposite if the rank correlation between the rater's condition means and those of all other raters is
    significantly below 0 at level `LEVEL_OF_RATERS` divided by the number of raters.

    Parameters
    ----------
    layout
        Rater, fabric and load of each rating.
    ratings
        Shape (rows,).
    """
    design = layout.design
    cells, people = design.cells, np.unique(design.participant)
    against: dict[int, float] = {}
    if people.size < 2 or np.ptp(ratings) == 0:
        return OddRaters(against, ())
    alone, constant = people[:, None] == np.arange(design.n_participants), []
    # tiny weights keep the conditions that only some rated
    own, others = (condition_means(layout, ratings, np.where(who, 1.0, 1e-9)) for who in (alone, ~alone))
    for place, k in enumerate(people.tolist()):
        given = ratings[design.participant == k]
        rated = np.flatnonzero((cells[k] > 0) & (cells.sum(axis=0) > cells[k]))
        if given.size >= FEWEST_RATINGS and np.ptp(given) == 0:
            constant.append(k)
        elif people.size > 2 and rated.size >= FEWEST_RATINGS:
            r = float(np.nan_to_num(_spearman(own[place, rated][None], others[place, rated])[0]))
            n = rated.size
            p_value = float(stdtr(n - 2, r * np.sqrt((n - 2) / max(1.0 - r * r, 1e-12))))
            if r < 0 and p_value * people.size < LEVEL_OF_RATERS:
                against[k] = r
    given = [(ratings[own], design.condition[own]) for own in (design.participant == k for k in people)]
    texts = [tuple(sorted(zip(*one, strict=True))) for one in given]
    copies = [
        k
        for place, (k, one) in enumerate(zip(people.tolist(), texts, strict=True))
        if len({value for value, _ in one}) >= FEWEST_RATINGS and one in texts[:place]
    ]
    return OddRaters(against, tuple(constant), tuple(copies))


class Evidence(NamedTuple):
    """The evidence of a table about the direction of its ratings."""

    trend: Trend
    loads: tuple[str, ...]
    firing: float
    """Share of prior draws for which firing rises with stiffness across these fabrics (`firing_rises`)."""
    left_out: int = 0
    """Number of fabrics left out because nothing is known about their moduli."""

    @property
    def direction(self) -> RatingDirection | None:
        """The direction that predicts the observed trend with stiffness; None if the table does not determine it."""
        firing = int(self.firing >= SURE) - int(self.firing <= 1.0 - SURE)
        return {1: RISES, -1: FALLS}.get(firing * self.trend.sign)

    @property
    def sentence(self) -> str:
        """The trend of the ratings with stiffness over all loads, in one line."""
        mean, sign = self.trend.mean, self.trend.sign
        if not math.isfinite(mean.value):
            return (
                "these ratings contain no information about stiffness: moduli or mean ratings do not differ at any load"
            )
        over = f"over {len(self.loads)} loads" if len(self.loads) > 1 else f"at {self.loads[0]}"
        # none of the random orders drawn was as extreme
        least = "<=" if math.isclose(self.trend.p_value, 1 / (SHUFFLES + 1)) else "="
        numbers = f"rank correlation with E_fab {mean} {over}; p {least} {self.trend.p_value:.2g} if "
        numbers += f"{self.trend.shuffled} were random"
        if self.left_out:
            numbers += f"; without {counted(self.left_out, 'fabric')} of unknown modulus"
        if not sign:
            return f"these ratings neither rise nor fall clearly with stiffness ({numbers})"
        return f"these ratings {WAY[sign]} with stiffness ({numbers})"

    @property
    def model(self) -> str:
        """The model's prediction for firing as a function of stiffness, in a clause."""
        rises = self.firing >= 0.5
        share = self.firing if rises else 1.0 - self.firing
        way = "rises" if rises else "falls"
        return f"firing {way} with stiffness over these fabrics in {percent(share)} of prior draws"

    @property
    def lines(self) -> list[str]:
        """One line for each load, then one for all of them and one for the direction that agrees with the table."""
        lines = []
        for load, one, count in zip(self.loads, self.trend.loads, self.trend.fabrics, strict=True):
            if math.isfinite(one.value):
                sure = one.low * one.high > 0  # NaN does not count as varying
                way = f"ratings {WAY[int(np.sign(one.value))]}" if sure else "no clear order"
                numbers = f"rank correlation of mean rating with E_fab {one}, {count} fabrics"
                lines.append(f"{load}: {way} with stiffness, {numbers}")
        if self.direction is None:
            reading = f"the table cannot decide between {RISES.name} and {FALLS.name}; {self.model}"
        else:
            reading = f"these ratings agree with --direction {self.direction.name}, because {self.model}"
        return [*lines, self.sentence, reading]


class DirectionChoice(NamedTuple):
    """The direction that a run takes, and the evidence of its data."""

    direction: RatingDirection
    asked: bool
    """True if the user chose it; otherwise it is inferred from the data, or left open if these do not decide."""
    evidence: Evidence

    @property
    def against_data(self) -> bool:
        """True if the data clearly show the opposite direction."""
        return self.direction != FREE and self.evidence.direction not in (None, self.direction)

    @property
    def sentence(self) -> str:
        """The chosen direction, the reason, and the option that overrides it."""
        name, found = self.direction.name, self.evidence
        if self.direction == FREE:
            why = "as asked" if self.asked else f"because the table cannot decide between {RISES.name} and {FALLS.name}"
            return (
                f"--direction {name}, {why}: both directions are sampled, each with prior probability 1/2: "
                f"{found.sentence}, and {found.model}"
            )
        other = next(one for one in (RISES, FALLS) if one != self.direction).name
        if self.against_data:
            return (
                f"the direction contradicts the data: with --direction {name} the prediction has the wrong "
                f"sign, because {found.sentence}, and {found.model}; use --direction {other}"
            )
        if self.asked:
            return f"--direction {name}, as asked: {found.sentence}"
        if found.direction is None:
            return (
                f"--direction {name} is used by default: {found.sentence}, and {found.model}; the alternative "
                f"is --direction {other}"
            )
        return (
            f"--direction {name} was chosen from the data: {found.sentence}, and {found.model}; --direction "
            f"{other} overrides it"
        )


def evidence_of(
    layout: Layout,
    ratings: NDArray[np.float64],
    rate: NDArray[np.float64],
    known: NDArray[np.bool_],
    loads: Sequence[str],
) -> Evidence:
    """Return the evidence of a table about the direction of its ratings.

    Only fabrics with known moduli show a trend with stiffness. If fewer than two rated fabrics have one, the medians
    of the priors take their place.

    Parameters
    ----------
    layout
        Design of the ratings.
    ratings
        Shape (rows,).
    rate
        Total rate [spikes/s] at some draws of the prior, shape (draws, conditions).
    known
        True for fabrics whose modulus was measured or bracketed, shape (fabrics,).
    loads
        Names of the loads.
    """
    design, rated = layout.design, np.unique(layout.design.fabric)
    if known[rated].sum() < 2:
        known = np.ones_like(known)
    conditions = known[design.fabric]
    rows, place = conditions[design.condition], np.cumsum(conditions) - 1
    kept = Design(
        place[design.condition[rows]], design.participant[rows], design.fabric[conditions], design.n_participants
    )
    part = replace(layout, design=kept, modulus=layout.modulus[conditions], load=layout.load[conditions])
    return Evidence(
        find_trend(part, ratings[rows]),
        tuple(loads[k] for k in part.loads),
        firing_rises(part, rate[:, conditions]),
        int((~known[rated]).sum()),
    )


def firing_rises(layout: Layout, rate: NDArray[np.float64]) -> float:
    """Return the share of parameter vectors for which firing rises with stiffness across the fabrics.

    The response rises with E_fab up to its turning point and falls beyond it. Only vectors with varying responses are
    counted; a response rises if its mean rank correlation over the loads is positive. If fewer than `FEWEST` vary,
    loads are too light for a turning point, and the share is 1.

    Parameters
    ----------
    layout
        Moduli and loads of the conditions.
    rate
        Total rate [spikes/s], shape (draws, conditions).
    """
    _, found = rank_correlations(layout, rate, layout.modulus)
    varies = found[np.isfinite(found)]
    return float((varies > 0).mean()) if varies.size >= FEWEST else 1.0


def _p_of_fabrics(layout: Layout, mean: FloatArray) -> float:
    """Return the two-sided p-value of the mean correlation under orders of the fabrics, the same under every load."""
    rated, first, place = np.unique(layout.design.fabric, return_index=True, return_inverse=True)
    modulus = layout.modulus[first]
    if math.factorial(rated.size) <= SHUFFLES:
        orders = np.array([*itertools.permutations(range(rated.size))])
    else:
        shuffled = np.random.default_rng(_SEED).permuted(np.tile(np.arange(rated.size), (SHUFFLES, 1)), axis=1)
        orders = np.concatenate([np.arange(rated.size)[None], shuffled])
    statistic = np.abs(rank_correlations(layout, modulus[orders[:, place]], mean)[1])
    # the first order is the observed one, which is included
    return float(np.mean(~(statistic < statistic[0] - 1e-9)))


def _p_of_participants(layout: Layout, ratings: FloatArray) -> float:
    """Return the two-sided p-value of the ranks' products within participants and loads, each permuted separately."""
    design, y = layout.design, layout.scale.additive(ratings)
    block = design.participant * (int(layout.load.max()) + 1) + layout.load[design.condition]
    x, total, variance = layout.modulus[design.condition], 0.0, 0.0
    for k in np.unique(block):
        one, other = (_ranks(values[block == k]) for values in (x, y))
        one, other = one - one.mean(), other - other.mean()
        if one.size > 1:
            total += float(one @ other)
            variance += float(one @ one) * float(other @ other) / (one.size - 1)
    return float(2.0 * ndtr(-abs(total) / math.sqrt(variance))) if variance > 0 else 1.0


def _spearman(rows: FloatArray, x: FloatArray) -> FloatArray:
    """Return the rank correlation of every row, shape (rows, k), with x; NaN if one is constant."""
    rows, x = (_ranks(values) - 0.5 * (values.shape[-1] + 1) for values in (rows, x))
    size = np.sqrt((x @ x) * (rows**2).sum(axis=1))
    return np.divide(rows @ x, size, out=np.full(len(rows), np.nan), where=size > 0)


def _ranks(values: FloatArray) -> FloatArray:
    """Return ranks from 1 along the last axis; ties (up to rounding errors) share their mean rank."""
    import pandas as pd

    values = values - values.min(axis=-1, keepdims=True)
    extent = np.maximum(values.max(axis=-1, keepdims=True), 1e-6)
    rows = pd.DataFrame(np.round(values / extent, _DIGITS).reshape(-1, values.shape[-1]))
    return np.asarray(rows.rank(axis=1), float).reshape(values.shape)
