"""Quadrature nodes for individual exponents and noise of raters, centred at each rater's mode (model.md 9).

A rater's log ratings are mu + s + g d + e with s ~ N(0, tau²), g = exp(tau_gamma u) and e ~ N(0, varsigma² h²),
h = exp(tau_varsigma w); d is the drive of the typical rater, u and w are standard normal. The scale s is integrated in
closed form, u and w by Gauss-Hermite quadrature about the mode of each rater, for all raters and all points of the
batch together. Arrays over nodes have shape (nodes, points, raters).
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.mu_nodes import log_sum

FloatArray = NDArray[np.float64]

ROUNDS, MOST_ROUNDS = 8, 14
"""Newton steps towards the modes: for the many calls of a run, and for exact modes."""

MU_REACH, MU_STEP = 7.0, 0.9
"""Half-width and spacing of the evenly spaced nodes of mu, in standard deviations of mu."""

FEW_RATERS = 10.0
"""Additional half-width, divided by the number of raters: with few raters, the density of mu may not be normal."""

MOST_MU_STEPS = 400
"""Largest number of evenly spaced nodes of mu on either side."""

_LOG_TWO_PI = math.log(2.0 * math.pi)
_LEAST_VARIANCE = 1e-100
_LARGEST_LOG = 150.0  # of a factor of exponents or noise
_LONGEST_STEP = 0.7  # towards a mode, in the logarithm of an exponent or of noise
_LEAST_CURVATURE = 0.3  # of the expected one
_LEAST_SLOPE = 0.1  # relative to the typical rater's, at the start of a search
_TIED = 0.9  # largest correlation of u and w at a mode


class RaterStatistics(NamedTuple):
    """Sufficient statistics of each rater's log ratings."""

    rows: FloatArray
    """Number of rows, shape (raters,); raters without rows keep their prior."""
    mean: FloatArray
    """Mean log rating minus the prior mean of mu, same shape."""
    squares: FloatArray
    """Sum of squares of the log ratings about their mean, same shape."""
    drive: FloatArray
    """Mean drive of the typical rater, shape (points, raters)."""
    drive_squares: FloatArray
    """Sum of squares of the drive about its mean, shape (points, raters)."""
    products: FloatArray
    """Sum of products of drive and log rating about their means, shape (points, raters)."""


class AnswerSpreads(NamedTuple):
    """Spreads, each of shape (points, 1)."""

    scale: FloatArray
    """tau."""
    noise: FloatArray
    """varsigma."""
    exponent: FloatArray
    """tau_gamma."""
    noises: FloatArray
    """tau_varsigma."""


class AnswerModes(NamedTuple):
    """Mode of each rater's u and w given mu, and the curvature at the mode; arrays of shape (points, raters)."""

    u: FloatArray
    w: FloatArray
    uu: FloatArray
    """Elements of the triangular factor L of the negative Hessian, L L'."""
    uw: FloatArray
    ww: FloatArray
    information: FloatArray
    """Precision of mu from this rater alone."""
    pull: FloatArray
    """Derivative of this rater's log density with respect to mu."""
    mu: FloatArray
    """Value of mu for which the modes were found, shape (points, 1)."""


class Terms(NamedTuple):
    """Each rater's density as a sum over nodes of exponentials of quadratics in mu."""

    log_term: FloatArray
    """Without mu, shape (nodes, points, raters)."""
    gap: FloatArray
    """Mean log rating minus the rater's mean drive, same shape."""
    precision: FloatArray
    """Of the gap, same shape."""
    u: FloatArray
    w: FloatArray


def find_modes(
    sums: RaterStatistics, spreads: AnswerSpreads, level: float, rounds: int = ROUNDS, at: FloatArray | None = None
) -> AnswerModes:
    """Return the most probable u and w of each rater; mu is at its most probable value unless given.

    Newton steps alternate between u and w. The modes only place the nodes: an error in them affects the accuracy of a
    finite number of nodes, not the limit for many nodes.

    Parameters
    ----------
    sums, spreads
        The raters' log ratings, and the spreads.
    level
        Prior standard deviation of mu, whose prior is centred.
    rounds
        Number of steps.
    at
        Value of mu, shape (points, 1).
    """
    a, b = spreads.exponent, spreads.noises
    differ_u, differ_w = bool(a.any()), bool(b.any())
    u, w = _start(sums, spreads)
    g, noise = _factor(a * u), _noise(sums, spreads, w)
    for _ in range(rounds):
        mu = _likely_mu(sums, noise, g, level) if at is None else at
        if differ_u:
            telling = sums.drive_squares / noise.variance + sums.drive**2 * noise.precision
            pull = sums.products / noise.variance + sums.drive * noise.precision * (sums.mean - mu)
            slope = a * g * (pull - g * telling)
            expected = 1.0 + (a * g) ** 2 * telling
            u = u + _limited((slope - u) / np.maximum(expected - a * slope, _LEAST_CURVATURE * expected), a)
            g = _factor(a * u)
        if differ_w:
            score = (sums.mean - g * sums.drive - mu) ** 2 * noise.precision
            squares = _squares(sums, g) / noise.variance
            slope = b * (squares - (sums.rows - 1.0) + noise.share * (score - 1.0))
            expected = 1.0 + 2.0 * b**2 * (squares + noise.share**2 * score)
            bent = 2.0 * b**2 * noise.share * (1.0 - noise.share) * (score - 1.0)
            w = w + _limited((slope - w) / np.maximum(expected - bent, _LEAST_CURVATURE * expected), b)
            noise = _noise(sums, spreads, w)
    mu = _likely_mu(sums, noise, g, level) if at is None else at
    return _modes_at(sums, spreads, noise, g, mu, u, w)


class _Noise(NamedTuple):
    """Variances and precisions derived from the raters' noise."""

    variance: FloatArray
    precision: FloatArray  # of a rater's mean log rating
    share: FloatArray  # share of the noise in the variance of that mean


def _noise(sums: RaterStatistics, spreads: AnswerSpreads, w: FloatArray) -> _Noise:
    variance = np.maximum(np.square(spreads.noise * _factor(spreads.noises * w)), _LEAST_VARIANCE)
    total = variance + sums.rows * spreads.scale**2
    return _Noise(variance, sums.rows / total, variance / total)


def _factor(log: FloatArray) -> FloatArray:
    return np.exp(np.minimum(log, _LARGEST_LOG))


def _squares(sums: RaterStatistics, g: FloatArray) -> FloatArray:
    """Return the sum of squares of the log ratings about the rater's regression line."""
    return np.maximum(sums.squares + g * (g * sums.drive_squares - 2.0 * sums.products), 0.0)


def _likely_mu(sums: RaterStatistics, noise: _Noise, g: FloatArray, level: float) -> FloatArray:
    precision = noise.precision
    pull = (precision * (sums.mean - g * sums.drive)).sum(axis=-1, keepdims=True)
    return np.asarray(pull / (np.broadcast_to(precision, g.shape).sum(axis=-1, keepdims=True) + level**-2))


def _modes_at(
    sums: RaterStatistics,
    spreads: AnswerSpreads,
    noise: _Noise,
    g: FloatArray,
    mu: FloatArray,
    u: FloatArray,
    w: FloatArray,
) -> AnswerModes:
    """Return modes at given values of u and w, with the curvature of the log density there."""
    a, b = spreads.exponent, spreads.noises
    gap = sums.mean - g * sums.drive - mu
    score = gap * gap * noise.precision
    within = (sums.products - g * sums.drive_squares) / noise.variance
    between = sums.drive * gap * noise.precision
    telling = sums.drive_squares / noise.variance + sums.drive**2 * noise.precision
    expected = 1.0 + (a * g) ** 2 * telling
    uu = np.maximum(expected - a * a * g * (within + between), _LEAST_CURVATURE * expected)
    expected = 1.0 + 2.0 * b**2 * (_squares(sums, g) / noise.variance + noise.share**2 * score)
    bent = 2.0 * b**2 * noise.share * (1.0 - noise.share) * (score - 1.0)
    ww = np.maximum(expected - bent, _LEAST_CURVATURE * expected)
    largest = _TIED * np.sqrt(uu * ww)
    uw = np.clip(2.0 * a * b * g * (within + noise.share * between), -largest, largest)
    tied_u, tied_w = a * g * sums.drive * noise.precision, 2.0 * b * noise.share * gap * noise.precision
    lost = (ww * tied_u**2 - 2.0 * uw * tied_u * tied_w + uu * tied_w**2) / (uu * ww - uw * uw)
    information = np.clip(noise.precision - lost, _LEAST_CURVATURE * noise.precision, noise.precision)
    root = np.sqrt(uu)
    return AnswerModes(u, w, root, uw / root, np.sqrt(ww - uw * uw / uu), information, gap * noise.precision, mu)


def _start(sums: RaterStatistics, spreads: AnswerSpreads) -> tuple[FloatArray, FloatArray]:
    """Return initial values of the search: each rater's estimates, shrunk towards the typical rater."""
    a, b = spreads.exponent, spreads.noises
    variance = np.maximum(spreads.noise**2, _LEAST_VARIANCE)
    u = w = np.zeros(np.broadcast_shapes(sums.drive.shape, a.shape))
    if a.any():
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = np.where(sums.drive_squares > 0, sums.products / sums.drive_squares, 1.0)
        slope = np.maximum(slope, _LEAST_SLOPE)
        telling = slope**2 * sums.drive_squares / variance
        u = a * telling * np.log(slope) / (1.0 + a * a * telling)
    if b.any():
        ratio = 0.5 * np.log((_squares(sums, _factor(a * u)) / variance + 1.0) / (sums.rows + 1.0))
        w = 2.0 * b * sums.rows * ratio / (1.0 + 2.0 * b**2 * sums.rows)
    return u, w


def _limited(step: FloatArray, spread: FloatArray) -> FloatArray:
    largest = _LONGEST_STEP / np.maximum(spread, 1e-2)
    return np.minimum(np.maximum(step, -largest), largest)


@lru_cache(maxsize=64)
def rule(count: int) -> tuple[FloatArray, FloatArray]:
    """Return Gauss-Hermite nodes in standard deviations, and log weights for an integral without weight function."""
    x, weight = np.polynomial.hermite.hermgauss(count)
    return math.sqrt(2.0) * x, np.log(weight) + x * x + 0.5 * math.log(2.0)


def own_nodes(modes: AnswerModes, count_u: int, count_w: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return u and w at the nodes about each mode, and log weights, each of shape (nodes, points, raters)."""
    (x, weight_x), (z, weight_z) = rule(count_u), rule(count_w)
    x, z = np.repeat(x, count_w)[:, None, None], np.tile(z, count_u)[:, None, None]
    weight = (weight_x[:, None] + weight_z).reshape(-1, 1, 1)
    u, w = at_scores(modes, x, z)
    return u, w, weight - np.log(modes.uu * modes.ww)


def at_scores(modes: AnswerModes, x: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return u and w for scores that are approximately independent and standard normal about the modes."""
    w = z / modes.ww
    return modes.u + (x - modes.uw * w) / modes.uu, modes.w + w


def terms_at(
    sums: RaterStatistics, spreads: AnswerSpreads, u: FloatArray, w: FloatArray, log_weight: FloatArray | float
) -> Terms:
    """Return each rater's density at given nodes, multiplied by their weights."""
    g, noise = _factor(spreads.exponent * u), _noise(sums, spreads, w)
    determinant = sums.rows * np.log(noise.variance) - np.log(noise.share)
    found = u * u + w * w + _squares(sums, g) / noise.variance + determinant
    log_term = -0.5 * (found + (sums.rows + 2.0) * _LOG_TWO_PI) + log_weight
    return Terms(log_term, sums.mean - g * sums.drive, np.broadcast_to(noise.precision, log_term.shape), u, w)


def expanded(
    sums: RaterStatistics, spreads: AnswerSpreads, modes: AnswerModes, counts: tuple[int, int]
) -> tuple[FloatArray, FloatArray]:
    """Return the log density of all raters at one value of mu, with its first four derivatives.

    Parameters
    ----------
    sums, spreads, modes
        The raters, the spreads, and the modes about which nodes are placed.
    counts
        Numbers of nodes of exponents and of noise.

    Returns
    -------
    mu : ndarray, shape (points,)
        The value.
    derivatives : ndarray, shape (5, points)
        The log density and its four derivatives.
    """
    (x, weight_x), (z, weight_z) = rule(counts[0]), rule(counts[1])
    w = modes.w + (z[:, None, None] / modes.ww)
    noise = _noise(sums, spreads, w)
    determinant = sums.rows * np.log(noise.variance) - np.log(noise.share)
    about = sums.mean - modes.mu
    # the exponent is quadratic in g
    square = sums.drive_squares / noise.variance + sums.drive**2 * noise.precision
    slope = sums.products / noise.variance + sums.drive * noise.precision * about
    level = sums.squares / noise.variance + noise.precision * about**2 + determinant + w * w
    level = weight_z[:, None, None] - 0.5 * (level + (sums.rows + 2.0) * _LOG_TWO_PI) - np.log(modes.uu * modes.ww)
    u = (modes.u - modes.uw * (w - modes.w) / modes.uu) + x[:, None, None, None] / modes.uu
    g = _factor(spreads.exponent * u)
    term = g * (slope - 0.5 * g * square)
    term -= 0.5 * u * u
    term += level
    term += weight_x[:, None, None, None]
    term = term.reshape(-1, *term.shape[2:])
    largest = term.max(axis=0)
    term -= largest
    np.exp(term, out=term)
    total = term.sum(axis=0)
    term /= total
    value = (np.log(total) + largest).sum(axis=-1)
    score = noise.precision * (about - g * sums.drive)
    precision = np.broadcast_to(noise.precision, score.shape).reshape(term.shape)
    return modes.mu[:, 0], np.stack([value, *_derivatives(term, score.reshape(term.shape), precision)])


def _derivatives(weight: FloatArray, score: FloatArray, precision: FloatArray) -> list[FloatArray]:
    """Return four derivatives in t, at 0, of the sum over raters of log sum_k weight exp(score t - precision t²/2)."""
    first, least = (weight * score).sum(axis=0), (weight * precision).sum(axis=0)
    s, p = score - first, precision - least
    square, tied = s * s, weight * s
    moments = [(weight * square).sum(axis=0), (tied * (square - 3.0 * p)).sum(axis=0)]
    fourth = (weight * (square * (square - 6.0 * p) + 3.0 * p * p)).sum(axis=0)
    parts = (first, moments[0] - least, moments[1], fourth - 3.0 * moments[0] ** 2)
    return [part.sum(axis=-1) for part in parts]


def over_mu(mu: FloatArray, derivatives: FloatArray, level: float, count: int) -> FloatArray:
    """Return the log of the integral over mu of the raters' expanded density times the prior of mu.

    Parameters
    ----------
    mu, derivatives
        As `expanded` returns them.
    level
        Prior standard deviation of mu.
    count
        Number of Gauss-Hermite nodes.
    """
    value, first, second, third, fourth = derivatives
    prior = level**-2
    information = np.maximum(prior - second, prior)
    shift, sd = (first - prior * mu) / information, information**-0.5
    x, log_weight = (v[:, None] for v in rule(count))
    t = shift + x * sd
    found = t * (first + t * (second / 2.0 + t * (third / 6.0 + t * fourth / 24.0)))
    found += log_weight + np.log(sd) - 0.5 * prior * (mu + t) ** 2
    return log_sum(found, axis=0) + value - math.log(level) - 0.5 * _LOG_TWO_PI


class MuNodes(NamedTuple):
    """Nodes of mu, relative to its prior mean."""

    mu: FloatArray
    """Shape (nodes, points)."""
    log_weight: FloatArray
    """Log weights of the integral, including the prior density, same shape."""


def mu_nodes(modes: AnswerModes, level: float, raters: int) -> MuNodes:
    """Return evenly spaced nodes of mu that remain accurate if any one rater is left out.

    Parameters
    ----------
    modes
        The raters' modes, from which the nodes are placed.
    level
        Prior standard deviation of mu.
    raters
        Number of raters of the whole table.
    """
    information = modes.information.sum(axis=-1) + level**-2
    rest = information - modes.information.max(axis=-1, initial=0.0)
    wide = float(np.sqrt(information / rest).max(initial=1.0))
    moved = np.abs(modes.pull / (information[:, None] - modes.information)).max(axis=-1, initial=0.0)
    reach = (MU_REACH + FEW_RATERS / max(raters, 1)) * wide + float((moved * np.sqrt(information)).max(initial=0.0))
    steps = min(math.ceil(reach / MU_STEP), MOST_MU_STEPS)
    step = reach / steps * information**-0.5
    mu = modes.mu[:, 0] + np.arange(-steps, steps + 1)[:, None] * step
    prior = -0.5 * (mu / level) ** 2 - math.log(level) - 0.5 * _LOG_TWO_PI
    return MuNodes(mu, prior + np.log(step))


def at_mu(terms: Terms, mu: FloatArray) -> FloatArray:
    """Return each rater's log density at nodes of mu (nodes, points), shape (nodes of mu, points, raters)."""
    found = np.empty((len(mu), *terms.gap.shape[1:]))
    weak = -0.5 * terms.precision
    work = np.empty_like(terms.gap)
    for k, value in enumerate(mu):
        np.subtract(terms.gap, value[:, None], out=work)
        np.multiply(work, work, out=work)
        np.multiply(work, weak, out=work)
        np.add(work, terms.log_term, out=work)
        largest = work.max(axis=0)
        np.subtract(work, largest, out=work)
        np.exp(work, out=work)
        np.log(work.sum(axis=0), out=found[k])
        found[k] += largest
    return found
