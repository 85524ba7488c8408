"""Densities of raters at nodes of their common mean log rating mu.

Given mu, raters are independent. Each rater's density is a sum, over fingers, of exponentials of quadratic functions of
mu; the product over raters is integrated over mu by the trapezoidal rule.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

MU_REACH, MU_STEP = 7.5, 0.8
"""Half-width of the nodes of mu about its mean, in standard deviations of mu, and their largest spacing, in standard
deviations of mu given the fingers."""

FEW_RATERS = 20.0
"""Additional half-width, to be divided by the number of raters: with few raters, the density of mu may not be normal,
and may shift if a row is left out."""

MOST_MU_STEPS = 64
"""Largest number of nodes of mu on either side of its mean."""

_LOG_TWO_PI = math.log(2.0 * math.pi)
_LARGEST_STEP = 80.0  # largest change of a log term between nodes of mu; beyond it, a term vanishes at the centre


class RaterLaw(NamedTuple):
    """Raters' densities given mu; raters without ratings are left out."""

    log_term: FloatArray  # of each finger, without mu and constants, (..., fingers, raters)
    gap: FloatArray  # mean log rating minus the finger's mean drive and the prior mean of mu, same shape
    variance: FloatArray  # of that gap, (..., raters)
    constant: FloatArray  # of each rater's log density, (..., raters)
    centre: FloatArray  # mean of mu, (...)
    step: FloatArray  # distance of its nodes, (...)
    steps: int = 0  # nodes to either side of the mean
    alike: bool = False  # all raters have the same variance, and a finger shifts all their gaps by the same amount


def about_mu(law: RaterLaw, spread: float, raters: int) -> RaterLaw:
    """Return the law with nodes of mu, placed as if each rater's density were normal in mu.

    Parameters
    ----------
    law
        The raters' densities.
    spread
        Prior standard deviation of mu.
    raters
        Number of raters in the whole table, including any that the law leaves out.
    """
    prior = np.full(law.centre.shape, spread**-2)
    share = np.exp(law.log_term - law.log_term.max(axis=-2, keepdims=True))
    share /= share.sum(axis=-2, keepdims=True)
    mean, scatter = _moments(law, share)
    variance = law.variance + scatter
    precision = prior + (1.0 / variance).sum(axis=-1)
    narrow = prior + (1.0 / law.variance).sum(axis=-1)
    ratio = float(np.sqrt(narrow / precision).max(initial=1.0))
    reach = MU_REACH + FEW_RATERS / max(raters, 1)
    steps = min(int(np.ceil(ratio * reach / MU_STEP)), MOST_MU_STEPS)
    step = reach / steps * precision**-0.5
    return law._replace(centre=(mean / variance).sum(axis=-1) / precision, step=step, steps=steps)


def _moments(law: RaterLaw, share: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance of each rater's gap over fingers with these shares, each (..., raters)."""
    if law.alike:
        shift, typical = _shifts(law)
        powers = np.stack([shift, shift * shift], axis=-2)
        first, second = np.moveaxis(powers @ share, -2, 0)
        return typical + first, np.maximum(second - first**2, 0.0)
    mean = (share * law.gap).sum(axis=-2)
    return mean, (share * (law.gap - mean[..., None, :]) ** 2).sum(axis=-2)


def _shifts(law: RaterLaw) -> tuple[FloatArray, FloatArray]:
    """Return the gap of each finger, (..., fingers), beyond those of the middle finger, (..., raters)."""
    typical = law.gap[..., law.gap.shape[-2] // 2, :]
    return law.gap[..., 0] - typical[..., :1], typical


def log_prior(law: RaterLaw, spread: float) -> FloatArray:
    """Return the log of the prior density of mu times the node spacing, at the nodes, shape (..., nodes).

    The prior is normal with mean 0 and the given standard deviation.
    """
    step = law.step[..., None]
    mu = law.centre[..., None] + np.arange(-law.steps, law.steps + 1) * step
    return -0.5 * (mu / spread) ** 2 - math.log(spread) - 0.5 * _LOG_TWO_PI + np.log(step)


def at_nodes(law: RaterLaw) -> FloatArray:
    """Return each rater's log density at the nodes of mu, up to a constant, shape (..., nodes, raters).

    The term of a finger is the exponential of a quadratic in mu: from one node to the next, it changes by a factor
    specific to the finger times a factor common to all fingers. If the raters are alike, these factors are the same for
    all of them. If they overflow (far from the raters' means with very little noise), each term is computed separately.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        found = _of_raters_alike(law) if law.alike else _by_factors(law)
        failed = ~(np.isfinite(found.sum(axis=-1)).any(axis=-1) & (found < np.inf).all(axis=(-2, -1)))
    if failed.any():
        arrays = {name: getattr(law, name)[failed] for name in law._fields[:6]}
        found[failed] = _one_by_one(law._replace(**arrays))
    return found


def _one_by_one(law: RaterLaw) -> FloatArray:
    """Compute `at_nodes` separately at each node."""
    offset = np.arange(-law.steps, law.steps + 1) * law.step[..., None]
    nodes = np.moveaxis(law.centre[..., None] + offset, -1, 0)[..., None, None]
    inverse = 0.5 / law.variance[..., None, :]
    return np.stack([log_sum(law.log_term - (law.gap - mu) ** 2 * inverse, axis=-2) for mu in nodes], axis=-2)


def _by_factors(law: RaterLaw) -> FloatArray:
    """Compute `at_nodes` by recursion from one node to the next."""
    gap = law.gap - law.centre[..., None, None]
    inverse = 1.0 / law.variance[..., None, :]
    exponent = law.log_term - 0.5 * gap * gap * inverse
    largest = exponent.max(axis=-2, keepdims=True)
    middle = np.exp(exponent - largest)
    step = law.step[..., None, None]
    change = np.clip(gap * (step * inverse), -_LARGEST_STEP, _LARGEST_STEP)
    sums = np.empty((*law.centre.shape, 2 * law.steps + 1, law.variance.shape[-1]))
    sums[..., law.steps, :] = middle.sum(axis=-2)
    for side in (-1, 1):
        factor, term = np.exp(side * change), middle.copy()
        for k in range(1, law.steps + 1):
            term *= factor
            sums[..., law.steps + side * k, :] = term.sum(axis=-2)
    shared = -0.5 * (np.arange(-law.steps, law.steps + 1)[:, None] * step) ** 2 * inverse
    with np.errstate(divide="ignore"):
        return np.log(sums) + shared + largest


def _of_raters_alike(law: RaterLaw) -> FloatArray:
    """Compute `at_nodes` for raters who are alike, as one matrix product over fingers."""
    shift, typical = _shifts(law)
    inverse = 1.0 / law.variance[..., :1]
    exponent = law.log_term - 0.5 * (law.gap - law.centre[..., None, None]) ** 2 * inverse[..., None]
    largest = exponent.max(axis=-2, keepdims=True)
    offset = np.arange(-law.steps, law.steps + 1) * law.step[..., None]
    factors = np.exp((offset * inverse)[..., None] * shift[..., None, :])
    sums = factors @ np.exp(exponent - largest)
    shared = offset[..., None] * ((typical - law.centre[..., None])[..., None, :] - 0.5 * offset[..., None])
    with np.errstate(divide="ignore"):
        return np.log(sums) + shared * inverse[..., None] + largest


def log_sum(values: FloatArray, axis: int) -> FloatArray:
    """Return the log of the sum of exponentials along an axis."""
    largest = values.max(axis=axis, keepdims=True)
    largest = np.where(np.isfinite(largest), largest, 0.0)
    with np.errstate(divide="ignore"):
        found = np.log(np.exp(values - largest).sum(axis=axis))
    return np.asarray(found + np.squeeze(largest, axis=axis))


def draw_index(rng: np.random.Generator, log_weight: FloatArray) -> NDArray[np.intp]:
    """Return indices along the first axis, drawn in proportion to weights, of the shape of the other axes."""
    weight = np.exp(log_weight - log_weight.max(axis=0))
    cumulative = np.cumsum(weight, axis=0)
    at = rng.random(log_weight.shape[1:]) * cumulative[-1]
    return np.minimum((cumulative <= at).sum(axis=0), len(log_weight) - 1)


def draw_on(rng: np.random.Generator, points: FloatArray, log_density: FloatArray) -> FloatArray:
    """Return a draw from each density along the last axis, piecewise linear between evenly spaced points."""
    weight = np.exp(log_density - log_density.max(axis=-1, keepdims=True))
    cumulative = np.cumsum(0.5 * (weight[..., 1:] + weight[..., :-1]), axis=-1)
    at = rng.random(cumulative.shape[:-1])[..., None] * cumulative[..., -1:]
    k = np.minimum((cumulative <= at).sum(axis=-1), cumulative.shape[-1] - 1)[..., None]
    before = np.where(k > 0, np.take_along_axis(cumulative, np.maximum(k - 1, 0), axis=-1), 0.0)
    left, right = (np.take_along_axis(weight, k + j, axis=-1) for j in (0, 1))
    area = at - before
    # the root of left f + (right - left) f²/2 = area, in the form without cancellation
    total = left + np.sqrt(np.maximum(left**2 + 2.0 * (right - left) * area, 0.0))
    part = np.clip(np.divide(2.0 * area, total, out=np.full_like(area, 0.5), where=total > 0), 0.0, 1.0)
    low, high = (np.take_along_axis(points, k + j, axis=-1) for j in (0, 1))
    return np.asarray((low + part * (high - low))[..., 0])
