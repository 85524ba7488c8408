"""Laws of single rows and of single raters given all others, where raters' answers differ (model.md 9).

Given the other raters, the level is approximated as normal. A rater's scale, exponent and noise are then summed over a
grid that covers their law even without any one row. With fabrics' deviations, a row's expectation and its rater's noise
are approximated as normal and independent, and the row's own contribution is divided out, as in `fabric_left_out`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.fabric_laws import averaged_slopes
from softness_bayes.likelihood.interval_law import log_probability, of_rows
from softness_bayes.likelihood.mu_nodes import log_sum
from softness_bayes.likelihood.own_laws import OwnLaw, factor
from softness_bayes.likelihood.quadrature import FINE, ROUGHLY, gauss_hermite
from softness_bayes.likelihood.rater_grids import Part, points_about
from softness_bayes.likelihood.rater_rows import RowParameters
from softness_bayes.likelihood.row_scores import below

FloatArray = NDArray[np.float64]

POINTS = 25
"""Points of each rater's scale, for each node of the exponent and the noise."""

NODES, NOISES = 15, 5
"""Nodes of a row's expectation and of its rater's log noise, with fabrics' deviations."""

_STEP = 0.1  # of the log noise, for differences instead of derivatives
_LEAST_LEFT = 1e-3  # smallest precision without a row, relative to that with it
_LOG_ROOT_TWO_PI = 0.5 * np.log(2.0 * np.pi)


def adaptive_parts(integrals: Any, given: RowParameters) -> Iterator[Part]:
    """Return points of all raters' scales at each node of exponents and noise, with weights given all other raters."""
    law = integrals.normal(given, FINE)
    rest = np.maximum(law.precision - law.information, integrals.sd**-2.0)
    mean, variance = law.mean.level - law.pull / rest, 1.0 / rest + given.tau**2
    assert given.own is not None
    for nodes in integrals.nodes(law, integrals.bends(given, law), ROUGHLY):
        for u, log_weight in zip(nodes.u, nodes.log_weight, strict=True):
            own = integrals.at_node(given, u, nodes.w[0])
            centre = _mode(integrals, own, law.mean.a(given.tau), mean, variance)
            grid = points_about(integrals, own, centre, variance, POINTS)
            log_weight = log_weight - 0.5 * np.log(2.0 * np.pi * variance)
            prior = -0.5 * (grid - mean[:, None]) ** 2 / variance[:, None]
            yield Part(own, grid, prior + np.log(grid[:, 1:2] - grid[:, :1]) + log_weight[:, None])


def _mode(integrals: Any, given: RowParameters, a: FloatArray, mean: FloatArray, variance: FloatArray) -> FloatArray:
    """Return the most probable level plus scale of each rater, (draws, raters)."""
    least = 0.1 * integrals.count / of_rows(given.spread, integrals.first) ** 2
    for _ in range(2):
        _, slope, second = integrals._slopes(given, a)[:3]
        curvature = np.maximum(-second, least)
        a = a + (slope - (a - mean) / variance) / (curvature + 1.0 / variance)
    return a


class _Expectations(NamedTuple):
    """Normal laws of each row's expectation less the drive, and of its log noise; each (draws, rows)."""

    mean: FloatArray
    sd: FloatArray
    mean_without: FloatArray  # without the row
    sd_without: FloatArray
    noise: FloatArray  # mean without the row
    noise_sd: FloatArray  # likewise


def _expectations(search: Any, given: RowParameters) -> _Expectations:
    integrals, own = search.integrals, given.own
    assert own is not None
    law: OwnLaw = search.normal(given, FINE.settled)
    rater, fabric, point = integrals.rater, search.fabric, law.mean
    g, h = factor(own.exponent * point.u)[:, rater], factor(own.noise * point.w)
    felt = given.drive + (given.omega * point.z)[:, fabric]
    expected = point.a(given.tau)[:, rater] + g * felt
    spread = given.spread * h[:, rater]
    here = given._replace(drive=np.zeros_like(given.drive), spread=spread, own=None)
    # a row's expectation follows its rater's scale and exponent, the level, and its fabric's deviation
    lean = np.stack([np.broadcast_to(given.tau, felt.shape), own.exponent * g * felt], axis=-1)
    cov = law.covariance[:, rater]
    within = np.einsum("drk,drkm,drm->dr", lean, cov[..., :2, :2], lean)
    level = 1.0 - (lean * law.to_level[:, rater, :2]).sum(axis=-1)
    along = -np.einsum("drk,drkj->drj", lean, law.to_fabrics[:, rater, :2])
    along -= level[..., None] * law.level_to_fabrics[:, None]
    along[:, np.arange(rater.size), fabric] += given.omega * g
    half = np.linalg.solve(law.root, np.swapaxes(along, -1, -2))
    variance = within + level**2 / law.precision + (half**2).sum(axis=1)
    slope, curvature = averaged_slopes(integrals.law, here, expected, np.maximum(within, 0.0))
    precision = np.maximum(1.0 / variance - curvature, _LEAST_LEFT / variance)
    noise, noise_sd = own.noise * point.w[:, rater], own.noise * np.sqrt(law.covariance[:, rater, 2, 2])
    if integrals.noisy:
        less, middle, more = (
            log_probability(integrals.law, given.rows, expected, spread * factor(np.array(step)), given.parameters)
            for step in (-_STEP, 0.0, _STEP)
        )
        tilt, bend = (more - less) / (2.0 * _STEP), (more - 2.0 * middle + less) / _STEP**2
        inverse = np.maximum(noise_sd**-2.0 + bend, 0.3 * noise_sd**-2.0)
        noise, noise_sd = noise - tilt / inverse, inverse**-0.5
    mean = expected - given.drive
    return _Expectations(mean, np.sqrt(variance), mean - slope / precision, precision**-0.5, noise, noise_sd)


def _noises(search: Any, given: RowParameters, own: _Expectations) -> Iterator[tuple[RowParameters, float]]:
    """Return the parameters at nodes of the raters' noise, with their weights."""
    x, log_weight = gauss_hermite(NOISES if search.integrals.noisy else 1)
    for score, weight in zip(x, np.exp(log_weight - 0.5 * x**2 - _LOG_ROOT_TWO_PI), strict=True):
        yield given._replace(spread=given.spread * factor(own.noise + score * own.noise_sd)), float(weight)


def log_density_left_out(search: Any, given: RowParameters) -> FloatArray:
    """Return the log probability of each row given all others, with fabrics' deviations, shape (draws, rows)."""
    own = _expectations(search, given)
    x, log_weight = gauss_hermite(NODES)
    at = own.mean[:, None] + own.sd[:, None] * x[:, None]
    apart = (at - own.mean_without[:, None]) / own.sd_without[:, None]
    weight = log_weight[:, None] - 0.5 * apart**2 + (np.log(own.sd / own.sd_without) - _LOG_ROOT_TWO_PI)[:, None]
    found = np.full(given.drive.shape, -np.inf)
    for part, share in _noises(search, given, own):
        rows, of_law = part.rows.at_points(), part.parameters.at_points()
        value = log_probability(search.integrals.law, rows, given.drive[:, None] + at, part.spread[:, None], of_law)
        np.logaddexp(found, log_sum(value + weight, axis=1) + np.log(share), out=found)
    return found


def below_left_out(search: Any, given: RowParameters) -> FloatArray:
    """Return the probability below each row given all others, as `row_scores.below`, (draws, rows)."""
    own = _expectations(search, given)
    x, log_weight = gauss_hermite(NODES)
    at = given.drive[:, None] + own.mean_without[:, None] + own.sd_without[:, None] * x[:, None]
    weight = np.exp(log_weight - 0.5 * x**2 - _LOG_ROOT_TWO_PI)[:, None]
    found = np.zeros(given.drive.shape)
    for part, share in _noises(search, given, own):
        rows, of_law = part.rows.at_points(), part.parameters.at_points()
        found += share * (weight * below(search.integrals.law, rows, at, part.spread[:, None], of_law)).sum(axis=1)
    return found
