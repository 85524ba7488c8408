"""Integrals over raters' scales on evenly spaced points, for few rows of laws with heavy tails (model.md 9)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood import several_maxima
from softness_bayes.likelihood.mu_nodes import draw_on, log_sum
from softness_bayes.likelihood.quadrature import DENSE, MANY_ROWS, Quadrature, gauss_hermite
from softness_bayes.likelihood.rater_grids import REACH
from softness_bayes.likelihood.rater_integrals import LEVELS, RaterIntegrals
from softness_bayes.likelihood.rater_rows import RowParameters
from softness_bayes.likelihood.several_maxima import for_all, reach_of

FloatArray = NDArray[np.float64]

MOST_POINTS = 1200
"""Largest number of evenly spaced points."""

_LOG_ROOT_TWO_PI = 0.5 * math.log(2.0 * math.pi)


class DenseIntegrals(RaterIntegrals):
    """The integrals over evenly spaced points, for raters with few rows of a law with heavy tails.

    Such a rater's density may have several maxima. If tau is small compared with the errors, the points are values of
    zeta at each level; otherwise they are shared by all raters.
    """

    def log_density(self, given: RowParameters, quadrature: Quadrature) -> FloatArray:
        """Return the log density of all rows, shape (draws,); with many closed intervals, by `several_maxima`."""
        many = self.count.min() >= MANY_ROWS and not self.walled.size
        if many and several_maxima.feasible(self, given).all():
            return several_maxima.log_density(self, given, reference=True)
        return np.concatenate([log_sum(one.joint, axis=-1)[None] for one in self._each(given, quadrature)])

    def law_of_others(self, given: RowParameters) -> tuple[FloatArray, FloatArray]:
        """Equivalent of `RaterIntegrals.law_of_others` without its approximation.

        Shorter sets of points are padded with points of zero weight.
        """
        found = []
        for one in self._each(given, DENSE):
            # (levels, raters), summed without the rater, because a difference of sums loses all digits where the
            # rater's density vanishes
            before, after = (np.cumsum(part, axis=1)[:, :-1] for part in (one.each, one.each[:, ::-1]))
            none = np.zeros((len(one.level), 1))
            rest = np.hstack([none, before]) + np.hstack([none, after])[:, ::-1] + one.log_prior[:, None]
            if one.shared:
                largest = rest.max(axis=0)
                with np.errstate(divide="ignore"):
                    weight = np.log(np.exp(one.law).T @ np.exp(rest - largest)) + largest
                weight = np.maximum(weight, -1e300)
            else:
                weight = (rest[:, None] + one.law[..., None]).reshape(-1, rest.shape[1])
            weight = weight - log_sum(rest, axis=0)
            points = np.broadcast_to(one.points.reshape(-1, 1), weight.shape)
            found.append((points, weight))
        size = max(len(points) for points, _ in found)
        both = [np.full((len(found), size, self.count.size), fill) for fill in (0.0, -1e300)]
        for k, parts in enumerate(found):
            for whole, part in zip(both, parts, strict=True):
                whole[k, : len(part)] = part
        return both[0], both[1]

    def draw(
        self, rng: np.random.Generator, given: RowParameters, quadrature: Quadrature
    ) -> tuple[FloatArray, FloatArray]:
        """Equivalent of `RaterIntegrals.draw`."""
        level, own = np.empty((len(given.drive), 1)), np.empty((len(given.drive), self.count.size))
        for k, one in enumerate(self._each(given, quadrature)):
            mu = draw_on(rng, one.level, one.joint)
            tau = float(given.tau[k, 0])
            points = one.points if one.shared else mu + tau * np.linspace(-REACH, REACH, 4 * LEVELS)
            value = one.values if one.shared else self.values(given.part([k]), for_all(points, self.count.size))[0]
            law = value - 0.5 * ((points - mu) / max(tau, 1e-300))[:, None] ** 2
            level[k], own[k] = mu, draw_on(rng, np.broadcast_to(points, law.T.shape), law.T) - mu
        return level, own

    def _each(self, given: RowParameters, quadrature: Quadrature) -> Iterator[_Dense]:
        """Yield the integrand of one draw after another."""
        x, log_weight = gauss_hermite(quadrature.scales)
        left = given.middle - given.drive
        open_ended = any(np.isinf(end).any() for end in (given.rows.low, given.rows.high))
        for k in range(len(left)):
            one, tau, spread = given.part([k]), float(given.tau[k, 0]), float(given.spread[k, 0])
            narrow = spread / math.sqrt(self.count.max())
            people, alone = self.count.size, self.count.min() == 1
            beyond = spread * reach_of(self.law, given.parameters, k, max(int(self.count.min()) - 1, 1))
            # limits of the prior if a rater's rows, or all but one of them, do not set narrower ones
            beyond += REACH * math.hypot(tau, self.sd if people == 1 or open_ended else tau) * (alone or open_ended)
            ends = left[k].min() - beyond, left[k].max() + beyond
            width = math.sqrt((tau**2 + narrow**2) / people)
            reach = REACH * tau + REACH * width
            middle = float(np.clip(self.mean, *ends))
            reach += 0.0 if people > 1 else abs(middle - self.mean)
            level = _spaced(ends[0] - reach, ends[1] + reach, quadrature.settled * width)
            log_prior = self.log_prior(level) + math.log(level[1] - level[0])
            shared = tau > narrow
            if shared:
                points = _spaced(*ends, quadrature.settled * narrow)
                law = -0.5 * ((points - level[:, None]) / tau) ** 2 - _LOG_ROOT_TWO_PI
                law = law + math.log((points[1] - points[0]) / tau)
                values = self.values(one, for_all(points, people))[0]
                largest = values.max(axis=0)
                with np.errstate(divide="ignore"):
                    each = np.log(np.exp(law) @ np.exp(values - largest)) + largest
            else:
                points = level[:, None] + tau * x
                law = np.broadcast_to(log_weight - 0.5 * x**2 - _LOG_ROOT_TWO_PI, points.shape)
                values = self.values(one, for_all(points.ravel(), people))[0].reshape(*points.shape, people)
                each = log_sum(values + law[..., None], axis=1)
            each = np.maximum(each, -1e300)
            yield _Dense(level, points, law, values, each, each.sum(axis=-1) + log_prior, log_prior, shared)


class _Dense(NamedTuple):
    """The integrand of one draw."""

    level: FloatArray  # (levels,)
    points: FloatArray  # of a_p: (points,) if shared, else (levels, points)
    law: FloatArray  # log weight of the points given the level, (levels, points)
    values: FloatArray  # l_p there, (points, raters), or (levels, points, raters)
    each: FloatArray  # log density of each rater's rows given the level, (levels, raters)
    joint: FloatArray  # of all rows and the level, (levels,)
    log_prior: FloatArray  # of the level, its distance to the next included, (levels,)
    shared: bool


def _spaced(low: float, high: float, step: float) -> FloatArray:
    """Return evenly spaced points, at most `MOST_POINTS`."""
    return np.linspace(low, high, min(max(math.ceil((high - low) / step), 2) + 1, MOST_POINTS))
