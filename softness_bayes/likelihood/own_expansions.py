"""Expansions of raters' log densities in scale and exponent, from sums over rows, and sums over nodes (model.md 9)."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.log_derivatives import cumulants, weighted
from softness_bayes.likelihood.own_laws import OwnLaw, factor
from softness_bayes.likelihood.rater_rows import RowParameters

FloatArray = NDArray[np.float64]

Moments = list[list[FloatArray]]
"""By order k and power j up to k, the sum over each rater's rows of f^(k) D^j, (draws, raters), where f is a row's log
probability as a function of its expectation."""


class OwnNodes(NamedTuple):
    """One node of w and one or several nodes of u for every rater, each of shape (nodes, draws, raters)."""

    u: FloatArray
    w: FloatArray
    log_weight: FloatArray
    """Log weight of the integral, including the prior densities."""


def recentred(moments: Moments, order: int, moved: FloatArray) -> FloatArray:
    """Return a derivative with respect to a_p where the exponent's factor has moved, (nodes, draws, raters)."""
    every = [moments[k][k - order] for k in range(order, len(moments))]
    found = np.zeros(moved.shape)
    for j in range(len(every) - 1, -1, -1):
        found *= moved
        found /= j + 1.0
        found += every[j]
    return found


def summed_over_nodes(
    value: FloatArray, slope: FloatArray, bend: FloatArray, skew: FloatArray, curl: FloatArray
) -> list[FloatArray]:
    """Return the log density of all raters with four derivatives in the level, each (draws, 1).

    Arguments are those of each node, weights included, (nodes, draws, raters).
    """
    largest = value.max(axis=0)
    share = np.exp(value - largest)
    total = share.sum(axis=0)
    share /= total
    slope, bend, skew, curl = (np.asarray(one, float) for one in (slope, bend, skew, curl))
    terms = [np.log(total) + largest, *cumulants(share, slope, bend, skew, weighted(share, curl))]
    return [one.sum(axis=-1, keepdims=True) for one in terms]


def truncation(given: RowParameters, law: OwnLaw, moments: Moments) -> tuple[FloatArray, FloatArray]:
    """Return the measure `ScaleModes.truncation` over the directions of a_p and of the exponent, each (draws,)."""
    cov, spreads = law.covariance, given.own
    assert spreads is not None
    uu, su, ss = cov[..., 1, 1], cov[..., 0, 1], cov[..., 0, 0]
    of_level = np.abs(1.0 - given.tau * law.to_level[..., 0]) / np.sqrt(law.precision)
    a = np.sqrt(given.tau**2 * np.maximum(ss - su**2 / uu, 0.0) + of_level**2)
    g = factor(spreads.exponent * law.mean.u)
    along = given.tau * su / np.sqrt(uu), spreads.exponent * g * np.sqrt(uu)
    # a search that has not reached the mode: the remaining Newton step of a_p, in standard deviations
    pull = moments[1][0] - (law.mean.a(given.tau) - law.mean.level) / np.maximum(given.tau, 1e-8) ** 2
    curvature = np.maximum(-moments[2][0], 0.0) + 1.0 / np.maximum(given.tau, 1e-8) ** 2
    moved = 1.0 + 0.5 * pull**2 / (curvature * a) ** 2
    return _departure(moments, a, np.zeros_like(a), moved), _departure(moments, *along, moved)


def _departure(moments: Moments, x: FloatArray, y: FloatArray, moved: FloatArray) -> FloatArray:
    third, fourth = (
        np.abs(sum(math.comb(k, j) * moments[k][j] * x ** (k - j) * y**j for j in range(1 + k))) for k in (3, 4)
    )
    return np.asarray(np.square((third + fourth) * moved).sum(axis=-1))


def part_of_moments(moments: Moments, piece: Any) -> Moments:
    """Return some of the draws."""
    return [[one[piece] for one in parts] for parts in moments]


def flattened(values: FloatArray) -> FloatArray:
    """Return values of nodes (nodes, draws, raters) as those of more raters, (draws, nodes raters)."""
    return np.moveaxis(values, 0, 1).reshape(values.shape[1], -1)


MOST_MOVED, MOST_WIDER = 1.0, 2.0
"""Distance of a rater's mean from the mode, in standard deviations, and ratio of variances, beyond which nodes are
placed anew. A density with heavy tails may have several maxima, and the search may end in a narrow one."""

_LEAST = 0.05  # smallest variance that nodes can tell, relative to that of their placing
_ROOM = 1.5  # of a variance, where nodes are placed anew


def placed_anew(law: OwnLaw, every: list[OwnNodes], terms: FloatArray) -> tuple[OwnLaw, NDArray[np.bool_]]:
    """Return the law with means and variances of u and w taken from the nodes where they are far from the mode's.

    Parameters
    ----------
    law, every
        The law, and its nodes.
    terms
        Log terms of all nodes, shape (nodes, draws, raters).

    Returns
    -------
    law
        The law.
    wrong : ndarray, shape (draws,)
        Whether there are such raters.
    """
    share = np.exp(terms - terms.max(axis=0))
    share /= share.sum(axis=0)
    covariance, new, wrong = law.covariance.copy(), {}, np.zeros(terms.shape[1:], bool)
    for k, name in enumerate(("u", "w"), 1):
        old = getattr(law.mean, name)
        nodes = np.concatenate([np.broadcast_to(getattr(one, name), one.u.shape) for one in every])
        mean = weighted(share, nodes)
        variance = weighted(share, (nodes - mean) ** 2)
        before = law.covariance[..., k, k]
        wrong |= ((mean - old) ** 2 > MOST_MOVED**2 * before) | (variance > MOST_WIDER * before)
        new[name] = mean
        covariance[..., k, k] = np.where(variance > _LEAST * before, _ROOM * variance, before)
    covariance = np.where(wrong[..., None, None], covariance, law.covariance)
    covariance[..., 1, 2] = covariance[..., 2, 1] = np.where(wrong, 0.0, covariance[..., 1, 2])
    own = law.mean._replace(**{name: np.where(wrong, mean, getattr(law.mean, name)) for name, mean in new.items()})
    return law._replace(mean=own, covariance=covariance), np.asarray(wrong.any(axis=-1))
