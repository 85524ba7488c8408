"""Laws of single rows given all others where fabrics have deviations, from a normal approximation (model.md 9).

Under the normal approximation about the mode, a row's expectation is normal. Division by the row's own contribution, of
its slope and curvature there, gives its law without the row; the row's probability is integrated over it (Vehtari and
others, JMLR 17, 103, 2016).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.fabric_integrals import FabricIntegrals
from softness_bayes.likelihood.fabric_laws import averaged_slopes
from softness_bayes.likelihood.interval_law import log_probability
from softness_bayes.likelihood.mu_nodes import log_sum
from softness_bayes.likelihood.quadrature import FINE, gauss_hermite
from softness_bayes.likelihood.rater_rows import RowParameters
from softness_bayes.likelihood.row_scores import below

FloatArray = NDArray[np.float64]

NODES = 21
"""Number of nodes of a row's expectation."""

_LEAST_LEFT = 1e-3  # smallest precision without a row, relative to that with it
_LOG_ROOT_TWO_PI = 0.5 * np.log(2.0 * np.pi)


class Expectations(NamedTuple):
    """Normal law of each row's expectation less the drive, given all rows and without the row; each (draws, rows)."""

    mean: FloatArray
    sd: FloatArray
    mean_without: FloatArray
    sd_without: FloatArray


def expectations(fabrics: FabricIntegrals, given: RowParameters) -> Expectations:
    """Return the laws of all rows' expectations, rows sorted by rater.

    Parameters
    ----------
    fabrics
        The integrals.
    given
        Parameters of the draws.
    """
    normal = fabrics.normal(given, FINE.settled)
    rater, fabric, omega = fabrics.integrals.rater, fabrics.fabric, given.omega
    mean = normal.a[:, rater] + (omega * normal.mean.z)[:, fabric]
    inverse = np.linalg.inv(normal.root)
    covariance = (omega**2)[..., None] * (np.swapaxes(inverse, -1, -2) @ inverse)
    spread = normal.follow @ covariance
    own = np.diagonal(covariance, axis1=-2, axis2=-1)[:, None] - 2.0 * spread
    own = own + (spread * normal.follow).sum(axis=-1, keepdims=True) + normal.variance[..., None]
    variance = own[:, rater, fabric]
    slope, curvature = averaged_slopes(fabrics.integrals.law, given, mean, normal.variance[:, rater])
    precision = np.maximum(1.0 / variance - curvature, _LEAST_LEFT / variance)
    # the slope of the others' log density balances the row's own
    without = mean - slope / precision
    return Expectations(mean, np.sqrt(variance), without, precision**-0.5)


def log_density_left_out(fabrics: FabricIntegrals, given: RowParameters) -> FloatArray:
    """Return the log probability of each row given all others, shape (draws, rows), rows sorted by rater."""
    own = expectations(fabrics, given)
    x, log_weight = gauss_hermite(NODES)
    # nodes about the law with the row, which is where the product of both densities lies
    at = own.mean[:, None] + own.sd[:, None] * x[:, None]
    value = log_probability(
        fabrics.integrals.law,
        given.rows.at_points(),
        given.drive[:, None] + at,
        given.spread[:, None],
        given.parameters.at_points(),
    )
    apart = (at - own.mean_without[:, None]) / own.sd_without[:, None]
    value = value - 0.5 * apart**2 + log_weight[:, None]
    return log_sum(value, axis=1) + np.log(own.sd / own.sd_without) - _LOG_ROOT_TWO_PI


def below_left_out(fabrics: FabricIntegrals, given: RowParameters) -> FloatArray:
    """Return the probability below each row given all others, as `interval_law.below`, (draws, rows)."""
    own = expectations(fabrics, given)
    x, log_weight = gauss_hermite(NODES)
    at = own.mean_without[:, None] + own.sd_without[:, None] * x[:, None]
    share = below(
        fabrics.integrals.law,
        given.rows.at_points(),
        given.drive[:, None] + at,
        given.spread[:, None],
        given.parameters.at_points(),
    )
    weight = np.exp(log_weight - 0.5 * x**2 - _LOG_ROOT_TWO_PI)
    return np.asarray((weight[:, None] * share).sum(axis=1))
