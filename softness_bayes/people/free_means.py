"""Free means: the observation model of a table with a mean for each condition in place of the chain (model.md 9.9).

An answer of rater p to condition c has the expectation m_c + s_p, s_p ~ N(0, tau²), with the scale, the intervals and
the error law of the run; the means have a flat law, five times as wide as the ratings. Given the spreads, means and
scales have a normal law about their mode (exact for exact numbers with normal errors); the spreads and the law's own
parameters are drawn from a normal law about the mode of their marginal density by Laplace's method, and weighted.
Nothing here knows a modulus or a load: loads are only names.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import expit, logit, logsumexp

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import Prior
from softness_bayes.data.ratings import Ratings
from softness_bayes.likelihood.scales import PAIRS, RANKS, Scale
from softness_bayes.model.interpretation import Interpretation, interpret
from softness_bayes.model.options import ModelOptions
from softness_bayes.parameters.declared import EVERY_PARAMETER
from softness_bayes.people.answers import Answers, SingleAnswers, Terms, answers_of, told_pairs
from softness_bayes.sampler.starts import climb
from softness_bayes.touch.load_groups import groups_of

Array = NDArray[np.float64]
IntArray = NDArray[np.intp]

SPREADS, DRAWS = 48, 2000
"""Number of vectors of spreads, and of draws of the means."""

SHARES, MOST_LAPSES = frozenset({"lapse", "guess"}), 0.5
"""Parameters that are shares of answers, and their largest value if it is not given."""

FARTHEST = (-7.0, 6.0)
"""Ends of the coordinates between which their mode is sought."""


class FreeMeans:
    """People's own means of a table of ratings.

    Parameters
    ----------
    ratings
        The table; its loads are used as names only.
    options
        Scale, error law, resolution, and priors and fixed values of spreads.
    meaning
        Interpretation of the numbers, if it is known already.

    Attributes
    ----------
    fabrics, loads
        Names of all fabrics, and of the groups of loads.
    fabric, load
        Indices of each condition, shape (conditions,).
    scale
        Scale of the ratings.
    means
        Draws of the mean of each condition over these raters, on the additive scale, shape (draws, conditions).
    rating
        The same as ratings.
    log_density
        Log density of each answer given all others, shape (answers,).
    cluster
        Group of each answer within which errors of a sum are not independent: the fabric; for pairs, the two fabrics;
        for lists, all of whose places by one participant are one answer, the participant.
    ratings_at
        Number of ratings of each condition.
    noise_known
        False if the table does not show how uncertain the means are: then there are no limits and no probabilities.
    word
        What the highest rating means: softest, hardest, or highest rated if the table does not say.

    Raises
    ------
    InputError
        If the ratings do not suit the scale, or it is a custom one, whose means only its own model knows.
    """

    def __init__(
        self, ratings: Ratings, options: ModelOptions = ModelOptions(), meaning: Interpretation | None = None
    ) -> None:
        if options.scale.model is not None:
            raise InputError(f"ratings: people's own means are not known for the custom scale {options.scale.name}")
        meaning = meaning or interpret(ratings, options)
        names, load = groups_of_loads(ratings)
        pairs, condition = np.unique(ratings.fabric * len(names) + load, return_inverse=True)
        alike = np.unique(load, return_inverse=True)[1]
        free, self._same = (answers_of(ratings, meaning, options, index) for index in (condition, alike))
        self.fabrics, self.loads, self.scale = ratings.fabrics, tuple(names), options.scale
        self.fabric, self.load = np.divmod(pairs, len(names))
        self.means, self.log_density, given = _fit(free, options)
        self.rating, self._options = free.natural(self.means, given), options
        self.cluster, self.ratings_at = _clusters(ratings, options.scale), np.bincount(condition)
        self.noise_known = ratings.cells is None or ratings.cells.geometric_sd is not None
        self.word = word_of(ratings.rating_column, options.scale)

    @cached_property
    def log_density_alike(self) -> Array:
        """Log density of each answer given all others with all fabrics alike: one mean for each group of loads."""
        return _fit(self._same, self._options)[1]

    def under(self, load: int) -> IntArray:
        """Return the conditions of one group of loads, from the highest mean down."""
        own = np.flatnonzero(self.load == load)
        return own[np.argsort(-self.means[:, own].mean(axis=0), kind="stable")]

    def p_higher(self, conditions: IntArray) -> Array:
        """Return the probability that the mean of each condition (rows) is higher than that of another (columns)."""
        drawn = self.means[:, conditions]
        return np.stack([_chance((drawn[:, [k]] > drawn).sum(axis=0), len(drawn)) for k in range(conditions.size)])

    @property
    def p_orders(self) -> Array:
        """Probability that people rate the fabric of the row higher than that of the column, (loads, fabrics, fabrics).

        NaN for pairs that they did not rate both, and if the noise is not known.
        """
        found = np.full((len(self.loads), len(self.fabrics), len(self.fabrics)), np.nan)
        for k in range(len(self.loads) if self.noise_known else 0):
            own = self.under(k)
            found[k][np.ix_(self.fabric[own], self.fabric[own])] = self.p_higher(own)
        return found

    def table(self) -> pd.DataFrame:
        """Return a row per load and fabric, the highest first, with 90 % limits and probabilities of the order.

        Columns: load, fabric, ratings (their number), people (the median of the mean rating), people_low, people_high,
        p_highest, and p_higher_than_next, NaN for the last.
        """
        parts = []
        for k, load in enumerate(self.loads):
            own = self.under(k)
            if not own.size:
                continue
            low, middle, high = np.quantile(self.rating[:, own], (0.05, 0.5, 0.95), axis=0)
            top = _chance(np.bincount(self.means[:, own].argmax(axis=1), minlength=own.size), len(self.means))
            columns = {
                "load": load,
                "fabric": [self.fabrics[i] for i in self.fabric[own]],
                "ratings": self.ratings_at[own],
                "people": middle,
                "people_low": low,
                "people_high": high,
                "p_highest": top,
                "p_higher_than_next": np.append(np.diag(self.p_higher(own), 1), np.nan),
            }
            parts.append(pd.DataFrame(columns))
        found = pd.concat(parts, ignore_index=True)
        if not self.noise_known:
            found[["people_low", "people_high", "p_highest", "p_higher_than_next"]] = np.nan
        return found


def _chance(count: IntArray, total: int) -> Array:
    """Return the probability behind a count of draws, which is never 0 or 1 by finitely many of them."""
    return np.asarray((count + 0.5) / (total + 1.0))


def groups_of_loads(ratings: Ratings) -> tuple[list[str], IntArray]:
    """Return the names of the groups of loads, and the group of each rating; one without a name if no load is known."""
    if not ratings.loads:
        return [""], np.zeros(len(ratings), np.intp)
    groups = groups_of(ratings.loads)
    return groups.names, groups.of[ratings.load]


def word_of(title: str, scale: Scale) -> str:
    """Return what the highest rating means, as far as the title of its column or the scale of the ratings says it."""
    title = title.casefold()
    if scale in (RANKS, PAIRS) or "soft" in title:
        return "softest"
    return "hardest" if "hard" in title or "stiff" in title else "highest rated"


def _clusters(ratings: Ratings, scale: Scale) -> IntArray:
    """Return the cluster of each answer, in the order of `Answers`."""
    if scale == RANKS:
        return np.unique(ratings.participant)
    if scale != PAIRS:
        return ratings.fabric
    return np.sort(ratings.fabric[told_pairs(ratings)], axis=1) @ np.array([1, len(ratings.fabrics)])


def _fit(answers: Answers, options: ModelOptions) -> tuple[Array, Array, Mapping[str, Array]]:
    """Return draws of the means, the log density of each answer given the others, and draws of the parameters."""
    space = _Parameters(answers, options)
    centre, root, start = _marginal(answers, space)
    rng = np.random.default_rng(0)
    scores = rng.standard_normal((SPREADS if space.names else 1, len(space.names)))
    points = centre + scores @ root.T
    values, found = space.values(points), _effects(answers, space, points, start)
    weight = found.log_density + 0.5 * (scores**2).sum(axis=1)
    weight = np.minimum(weight, logsumexp(weight) - 0.5 * np.log(len(weight)))  # truncation (Ionides 2008)
    weight = weight - logsumexp(weight)
    left = answers.left_out(found.mode, found.covariance, values)
    log_density = -logsumexp(weight[:, None] - left, axis=0)
    share = np.searchsorted(np.cumsum(np.exp(weight)), (np.arange(DRAWS) + 0.5) / DRAWS).clip(0, len(points) - 1)
    effects = found.mode[share]
    for k in np.unique(share):
        own = share == k
        scatter = rng.standard_normal((int(own.sum()), effects.shape[1]))
        effects[own] += scatter @ np.linalg.cholesky(found.covariance[k]).T
        if isinstance(answers, SingleAnswers):
            for condition in answers.unanimous:
                here = {name: value[[k]] for name, value in values.items()}
                effects[own, condition] = answers.redraw(rng, effects[own], int(condition), here)
    means = effects[:, : answers.conditions]
    if answers.raters:
        means = means + effects[:, answers.conditions :].mean(axis=1, keepdims=True)
    return means, log_density, {name: value[share] for name, value in values.items()}


class _Parameters:
    """Parameters of an observation model in coordinates: logarithms; of shares of answers, log odds."""

    def __init__(self, answers: Answers, options: ModelOptions) -> None:
        self.held = {name: float(options.fixed[name]) for name in answers.needs if name in options.fixed}
        self.names = [name for name in answers.needs if name not in self.held]
        priors = {name: options.priors.get(name, EVERY_PARAMETER[name].prior) for name in self.names}
        self._priors: dict[str, Prior] = priors
        self.start = np.array([_START.get(name, -0.7) for name in self.names])

    def values(self, points: Array) -> dict[str, Array]:
        """Return the parameters, each (points,), at points (points, parameters)."""
        found = {name: np.full(len(points), value) for name, value in self.held.items()}
        for name, x in zip(self.names, points.T, strict=True):
            found[name] = MOST_LAPSES * expit(x) if name in SHARES else np.exp(np.minimum(x, 50.0))
        return found

    def log_prior(self, points: Array) -> Array:
        """Return the log density of the coordinates at points, shape (points,)."""
        total, values = np.zeros(len(points)), self.values(points)
        for name, x in zip(self.names, points.T, strict=True):
            slope = MOST_LAPSES * expit(x) * expit(-x) if name in SHARES else values[name]
            total += self._priors[name].log_density(values[name]) + np.log(slope)
        return total


_START = {"tau": -1.0, "varsigma": 0.0, "nu": 2.0, **dict.fromkeys(SHARES, float(logit(0.03 / MOST_LAPSES)))}


class _Effects(NamedTuple):
    """Normal laws of the effects given the answers, for many points of the parameters."""

    mode: Array
    """Shape (points, effects)."""
    covariance: Array
    log_density: Array
    """Log density of all answers with the effects integrated out by Laplace's method, and of the parameters."""


def _effects(answers: Answers, space: _Parameters, points: Array, start: Array) -> _Effects:
    """Return the laws of the effects at points (points, parameters), by Newton's method from a start (effects,)."""
    given, sizes = space.values(points), (answers.conditions, answers.raters)
    tau = given.get("tau", np.ones(len(points)))
    precision = np.repeat(np.stack([np.full(len(points), answers.wide), tau], axis=-1), sizes, axis=-1) ** -2.0
    middle = np.repeat([answers.centre, 0.0], sizes)

    def at(effects: Array) -> Terms:
        """Return the log density of answers and effects, and its derivatives."""
        terms, apart = answers.terms(effects, given), effects - middle
        prior = 0.5 * (np.log(precision) - precision * apart**2).sum(axis=-1)
        bend = terms.bend + precision[..., None] * np.eye(middle.size)
        return Terms(terms.value + prior, terms.slope - precision * apart, bend)

    effects = np.tile(start, (len(points), 1))
    now = at(effects)
    for _ in range(100):
        step = np.linalg.solve(_convex(now.bend), now.slope[..., None])[..., 0]
        while True:
            new = at(effects + step)
            worse = ~(new.value >= now.value - 1e-9 * np.abs(now.value)) & (np.abs(step).max(axis=-1) > 1e-8)
            if not worse.any():
                break
            step[worse] *= 0.5
        gain, effects, now = np.abs(new.value - now.value), effects + step, new
        if gain.max() < 1e-7 and np.abs(step).max() < 1e-4 * min(1.0, answers.wide):
            break
    bend = _convex(now.bend)
    covariance = np.linalg.inv(bend)
    log_density = now.value - 0.5 * np.linalg.slogdet(bend)[1] + space.log_prior(points)
    return _Effects(effects, 0.5 * (covariance + covariance.swapaxes(-1, -2)), log_density)


def _convex(bend: Array) -> Array:
    """Return minus second derivatives (points, effects, effects), made positive where rows bend the other way."""
    try:
        np.linalg.cholesky(bend)
    except np.linalg.LinAlgError:
        size, axes = np.linalg.eigh(bend)
        size = np.maximum(np.abs(size), 1e-6 * size[:, -1:])
        return (axes * size[:, None]) @ axes.swapaxes(-1, -2)
    return bend


def _marginal(answers: Answers, space: _Parameters) -> tuple[Array, Array, Array]:
    """Return the mode of the parameters' marginal density, the root of its covariance, and effects to begin from."""
    effects = np.repeat([answers.centre, 0.0], [answers.conditions, answers.raters])
    if not space.names:
        return np.zeros(0), np.zeros((0, 0)), effects

    def log_density(points: Array) -> Array:
        nonlocal effects
        found = _effects(answers, space, points, effects)
        effects = found.mode[0]  # from where the search at the next points begins
        return found.log_density

    found = climb(log_density, space.start, [FARTHEST] * len(space.names))
    return found.point, found.root, effects
