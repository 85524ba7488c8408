"""Free means: the observation model of a table with a mean for each condition in place of the chain (model.md 9.9).

An answer of rater p to condition c has the expectation m_c + s_p, s_p ~ N(0, tau²), with the scale, the intervals and
the error law of the run; the means have a flat law, five times as wide as the ratings. Given the spreads, means and
scales have a normal law about their mode (exact for exact numbers with normal errors); the spreads and the law's own
parameters are drawn from a normal law about the mode of their marginal density by Laplace's method, and weighted.
Nothing here knows a modulus or a load: loads are only names.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize
from scipy.special import expit, logit, logsumexp

from softness_bayes.data.ratings import Ratings
from softness_bayes.errors import InputError
from softness_bayes.likelihood.scales import PAIRS, RANKS, Scale
from softness_bayes.model.interpretation import Interpretation, interpret
from softness_bayes.model.options import ModelOptions
from softness_bayes.parameters.declared import EVERY_PARAMETER
from softness_bayes.parameters.laws import Prior
from softness_bayes.people.answers import Answers, SingleAnswers, answers_of, told_pairs
from softness_bayes.touch.load_groups import groups_of

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]
IntArray = NDArray[np.intp]

SPREADS, DRAWS = 48, 2000
"""Number of vectors of spreads, and of draws of the means."""

SHARES, MOST_LAPSES = frozenset({"lapse", "guess"}), 0.5
"""Parameters that are shares of answers, and their largest value if it is not given."""

FARTHEST = (-7.0, 6.0)
"""Ends of the coordinates between which their mode is sought."""


class _Mode(NamedTuple):
    """The normal law of the effects for given parameters."""

    effects: Array
    covariance: Array
    log_density: float
    """Log density of all answers with the effects integrated out by Laplace's method, and of the parameters."""


@dataclass(frozen=True)
class FreeMeans:
    """People's own means.

    Parameters
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
    log_density, log_density_alike
        Log density of each answer given all others, with free means and with all fabrics alike (one mean for each
        group of loads), shape (answers,).
    cluster
        Group of each answer within which errors of a sum are not independent: the fabric; for pairs, the two fabrics;
        for lists, all of whose places by one participant are one answer, the participant.
    ratings_at
        Number of ratings of each condition.
    noise_known
        False if the table does not show how uncertain the means are: then there are no limits and no probabilities.
    word
        What the highest rating means: softest, hardest, or highest rated if the table does not say.
    """

    fabrics: tuple[str, ...]
    loads: tuple[str, ...]
    fabric: IntArray
    load: IntArray
    scale: Scale
    means: Array
    rating: Array
    log_density: Array
    log_density_alike: Array
    cluster: IntArray
    ratings_at: IntArray
    noise_known: bool
    word: str

    def under(self, load: int) -> IntArray:
        """Return the conditions of one group of loads, from the highest mean down."""
        own = np.flatnonzero(self.load == load)
        return own[np.argsort(-self.means[:, own].mean(axis=0), kind="stable")]

    def p_higher(self, conditions: IntArray) -> Array:
        """Return the probability that the mean of each condition (rows) is higher than that of another (columns)."""
        drawn = self.means[:, conditions]
        return np.stack([_chance((drawn[:, [k]] > drawn).sum(axis=0), len(drawn)) for k in range(conditions.size)])

    def table(self) -> pd.DataFrame:
        """Return a row per load and fabric, the highest first, with 90 % limits and probabilities of the order.

        Columns: load, fabric, ratings (their number), people (the median of the mean rating), people_low, people_high,
        p_highest, and p_higher_than_next, NaN for the last.
        """
        import pandas as pd

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


def free_means(
    ratings: Ratings, options: ModelOptions = ModelOptions(), meaning: Interpretation | None = None
) -> FreeMeans:
    """Return people's own means of a table of ratings.

    Parameters
    ----------
    ratings
        The table; its loads are used as names only.
    options
        Scale, error law, resolution, and priors and fixed values of spreads.
    meaning
        Interpretation of the numbers, if it is known already.

    Raises
    ------
    InputError
        If the ratings do not suit the scale, or it is a custom one, whose means only its own model knows.
    """
    if options.scale.model is not None:
        raise InputError(f"ratings: people's own means are not known for the custom scale {options.scale.name}")
    meaning = meaning or interpret(ratings, options)
    names, load = groups_of_loads(ratings)
    pairs, condition = np.unique(ratings.fabric * len(names) + load, return_inverse=True)
    fabric_of, load_of = np.divmod(pairs, len(names))
    alike = np.unique(load, return_inverse=True)[1]
    free, same = (answers_of(ratings, meaning, options, index) for index in (condition, alike))
    means, density, given = _fit(free, options)
    return FreeMeans(
        ratings.fabrics,
        tuple(names),
        fabric_of,
        load_of,
        options.scale,
        means,
        free.natural(means, given),
        density,
        _fit(same, options)[1],
        _clusters(ratings, options.scale),
        np.bincount(condition),
        ratings.cells is None or ratings.cells.geometric_sd is not None,
        word_of(ratings.rating_column, options.scale),
    )


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
    modes: dict[str, _Mode] = {}

    def mode(point: Array) -> _Mode:
        start = (
            modes["last"].effects if modes else np.repeat([answers.centre, 0.0], [answers.conditions, answers.raters])
        )
        found = _mode(answers, space.values(point), start, space.log_prior(point))
        modes["last"] = found
        return found

    centre, root = _marginal(mode, space)
    rng = np.random.default_rng(0)
    scores = rng.standard_normal((SPREADS if space.names else 1, len(space.names)))
    points = centre + scores @ root.T
    found = [mode(point) for point in points]
    weight = np.array([one.log_density for one in found]) + 0.5 * (scores**2).sum(axis=1)
    weight = np.minimum(weight, logsumexp(weight) - 0.5 * np.log(len(weight)))  # truncation (Ionides 2008)
    weight = weight - logsumexp(weight)
    values = [space.values(point) for point in points]
    left = np.stack([answers.left_out(one.effects, one.covariance, v) for one, v in zip(found, values, strict=True)])
    log_density = -logsumexp(weight[:, None] - left, axis=0)
    share = np.searchsorted(np.cumsum(np.exp(weight)), (np.arange(DRAWS) + 0.5) / DRAWS).clip(0, len(points) - 1)
    draws = []
    for k, count in enumerate(np.bincount(share, minlength=len(points))):
        shape = int(count), found[k].effects.size
        drawn = found[k].effects + rng.standard_normal(shape) @ np.linalg.cholesky(found[k].covariance).T
        if isinstance(answers, SingleAnswers):
            for condition in answers.open_ended:
                drawn[:, condition] = answers.redraw(rng, drawn, int(condition), values[k])
        draws.append(drawn)
    effects = np.concatenate(draws)
    means = effects[:, : answers.conditions]
    if answers.raters:
        means = means + effects[:, answers.conditions :].mean(axis=1, keepdims=True)
    given = {name: np.array([values[k][name] for k in share]) for name in values[0]}
    return means, log_density, given


class _Parameters:
    """Parameters of an observation model in coordinates: logarithms; of shares of answers, log odds."""

    def __init__(self, answers: Answers, options: ModelOptions) -> None:
        self.held = {name: float(options.fixed[name]) for name in answers.needs if name in options.fixed}
        self.names = [name for name in answers.needs if name not in self.held]
        priors = {name: options.priors.get(name, EVERY_PARAMETER[name].prior) for name in self.names}
        self._priors: dict[str, Prior] = priors
        self.start = np.array([_START.get(name, -0.7) for name in self.names])

    def values(self, point: Array) -> dict[str, float]:
        """Return the parameters at a point (parameters,)."""
        found = {name: float(np.exp(min(x, 50.0))) for name, x in zip(self.names, point, strict=True)}
        for name in SHARES & found.keys():
            found[name] = MOST_LAPSES * float(expit(point[self.names.index(name)]))
        return self.held | found

    def log_prior(self, point: Array) -> float:
        """Return the log density of the coordinates at a point."""
        total, values = 0.0, self.values(point)
        for name, x in zip(self.names, point, strict=True):
            slope = np.log(values[name]) if name not in SHARES else np.log(MOST_LAPSES * expit(x) * expit(-x))
            total += float(self._priors[name].log_density(np.array(values[name]))) + float(slope)
        return total


_START = {"tau": -1.0, "varsigma": -1.0, "nu": 2.0, **dict.fromkeys(SHARES, float(logit(0.03 / MOST_LAPSES)))}


def _mode(answers: Answers, given: Mapping[str, float], start: Array, log_prior: float) -> _Mode:
    """Return the normal law of the effects for given parameters, by Newton's method from a start."""
    scales = np.repeat([answers.wide, given.get("tau", 1.0)], [answers.conditions, answers.raters])
    precision, middle = scales**-2.0, np.repeat([answers.centre, 0.0], [answers.conditions, answers.raters])

    def density(effects: Array, value: float) -> float:
        return value - 0.5 * float((precision * (effects - middle) ** 2).sum()) + float(0.5 * np.log(precision).sum())

    effects, terms = start, answers.terms(start, given)
    now = density(effects, terms.value)
    for _ in range(100):
        root = _root(terms.bend + np.diag(precision))
        step = cho_solve(root, terms.slope - precision * (effects - middle))
        share = 1.0
        while True:
            new = answers.terms(effects + share * step, given)
            after = density(effects + share * step, new.value)
            if after >= now - 1e-9 * abs(now) or share < 1e-6:
                break
            share *= 0.5
        effects, terms, gain, now = effects + share * step, new, after - now, after
        if abs(gain) < 1e-7 and np.abs(share * step).max() < 1e-4 * min(1.0, answers.wide):
            break
    root = _root(terms.bend + np.diag(precision))
    covariance = cho_solve(root, np.eye(effects.size))
    log_det = 2.0 * float(np.log(np.diag(root[0])).sum())
    return _Mode(effects, 0.5 * (covariance + covariance.T), now - 0.5 * log_det + log_prior)


def _root(bend: Array) -> tuple[Array, bool]:
    """Return the Cholesky factor of minus second derivatives, enlarged where rows far out bend the other way."""
    ridge = 0.0
    while True:
        try:
            return cho_factor(bend + ridge * np.diag(np.abs(np.diag(bend)) + 1.0))
        except np.linalg.LinAlgError:
            ridge = max(2.0 * ridge, 0.1)


def _marginal(mode: Callable[[Array], _Mode], space: _Parameters) -> tuple[Array, Array]:
    """Return the mode of the parameters' marginal density, and the root of the covariance about it."""
    d = len(space.names)
    if not d:
        return np.zeros(0), np.zeros((0, 0))

    def loss(point: Array) -> float:
        return -mode(point).log_density

    best = minimize(loss, space.start, method="L-BFGS-B", bounds=[FARTHEST] * d, options={"eps": 1e-4, "gtol": 3e-2}).x
    h, bend = 0.1, np.zeros((d, d))
    shift, middle = h * np.eye(d), loss(best)
    up, down = (np.array([loss(best + sign * one) for one in shift]) for sign in (1.0, -1.0))
    for k in range(d):
        for j in range(k + 1):
            both = loss(best + shift[k] + shift[j]) + loss(best - shift[k] - shift[j])
            bend[k, j] = bend[j, k] = (both - up[k] - down[k] - up[j] - down[j] + 2.0 * middle) / (2.0 * h * h)
    size, axes = np.linalg.eigh(bend)
    return best, axes / np.sqrt(np.maximum(size, 0.25))
