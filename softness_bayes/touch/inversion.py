"""Exact inverse of the stress field: the distance from the axis at which the stress has some value (model.md 5).

With the depth as the unit of length, the field depends on only two numbers: the contact radius A and the decay q of
the pressure. If the stress falls like rho^-n far away, then with y = (sigma / sigma_peak)^(2/n)

    rho² = (1 + A² / (1 + q)) S(y) (1 - y) / y

and S has no singularity at either end of y. The factor is the sum of the squared depth and the squared width of the
loaded patch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from softness_bayes.touch.readings import Readings
from softness_bayes.touch.stress import GAUSS_DENSITY, unit_stress

Array = NDArray[np.float64]

BLOCK = 4
"""Number of contacts inverted at once; arrays of more contacts do not fit into the cache."""

FARTHEST = 500.0
"""End of the grid on which the search begins, in sizes of the patch; beyond it the field follows its power law."""

_ROUNDING = 1e-11  # change of ln y below which no slope follows from it


@dataclass(frozen=True)
class Inversion:
    """The stress field of any contact radius and decay, inverted by the secant method.

    Parameters
    ----------
    readings
        Readings of kernel and component.
    tolerance
        Error allowed in S, relative to its maximum.
    """

    readings: Readings
    tolerance: float

    @property
    def root(self) -> float:
        """2/n, the power of sigma / sigma_peak that gives y."""
        component, kernel = self.readings.stress_component, self.readings.stress_kernel
        return 2.0 / (component.far_power or kernel.far_power)

    def unit(self, rho: Array, radius: Array, decay: Array) -> Array:
        """Return the stress at distances rho under a pressure of amplitude 1; all broadcast."""
        density = GAUSS_DENSITY if self.tolerance < 1e-7 else 0.5 * GAUSS_DENSITY
        kernel, component = self.readings.stress_kernel, self.readings.stress_component
        return unit_stress(rho, 1.0, radius, decay, kernel, component, density)

    def rows(self, radius: Array, decay: Array, nodes: int) -> Array:
        """Return [unit peak, coefficients of S in T_k(2 y - 1)] of contacts A and q (n,), shape (n, 1 + nodes)."""
        found = self.values(radius, decay, 0.5 * (chebyshev.chebpts1(nodes) + 1.0))
        found[:, 1:] = found[:, 1:] @ values_to_coefficients(nodes).T
        return found

    def values(self, radius: Array, decay: Array, y: Array) -> Array:
        """Return [unit peak, S at each y] of contacts A and q (n,), shape (n, 1 + len(y))."""
        found = np.empty((radius.size, 1 + y.size))
        for start in range(0, radius.size, BLOCK):
            some = slice(start, start + BLOCK)
            a, q = radius[some], decay[some]
            found[some, 0] = peak = self.unit(np.zeros_like(a), a, q)
            squared = self._distance(y, a, q, peak) ** 2 / (1.0 + a**2 / (1.0 + q))[:, None]
            found[some, 1:] = squared * (y / (1.0 - y))
        return found

    def _relative_root(self, rho: Array, radius: Array, decay: Array, peak: Array) -> Array:
        return (self.unit(rho, radius, decay) / peak) ** self.root

    def _interpolated(self, y: Array, radius: Array, decay: Array, peak: Array) -> tuple[Array, Array]:
        """Return ln rho and its slope in ln y, shape (n, len(y)), from splines through the field on a grid of rho."""
        radius, decay, peak = radius[:, None], decay[:, None], peak[:, None]
        # from near the axis to where the field follows its power law, and finely across the edge of the contact
        everywhere = np.geomspace(1e-4 * (1.0 + radius), FARTHEST * (1.0 + radius), 70, axis=-1)[:, 0]
        edge = radius + np.sinh(np.linspace(-1, 1, 51) * np.arcsinh(0.9 * radius))
        grid = np.sort(np.concatenate([everywhere, edge], axis=-1), axis=-1)
        log_grid, known = np.log(grid), np.log(self._relative_root(grid, radius, decay, peak))
        log_y = np.log(y)
        log_rho, slope = np.empty((radius.size, y.size)), np.empty((radius.size, y.size))
        for row in range(radius.size):
            falling = np.concatenate([np.diff(known[row]) < -1e-13, [True]])
            inverse = CubicSpline(known[row][falling][::-1], log_grid[row][falling][::-1])
            log_rho[row], slope[row] = inverse(log_y), inverse(log_y, 1)
        return log_rho, slope

    def _distance(self, y: Array, radius: Array, decay: Array, peak: Array) -> Array:
        """Invert the field by the secant method: distances at which it is y^(1/root) of its peak; (n, len(y))."""
        log_rho, slope = self._interpolated(y, radius, decay, peak)
        radius, decay, peak, log_y = radius[:, None], decay[:, None], peak[:, None], np.log(y)
        before, step, last = 0.0, np.zeros_like(log_rho), np.zeros_like(log_rho)
        for _ in range(12):  # each step usually gains about three digits
            gap = np.log(self._relative_root(np.exp(log_rho), radius, decay, peak)) - log_y
            change = gap - last
            known = (np.abs(change) > _ROUNDING) & (step * change < 0.0)
            slope = np.where(known, step / np.where(known, change, 1.0), slope)
            excess = slope * gap
            step, last = -np.clip(excess, -1.0, 1.0), gap
            log_rho = log_rho + step
            found = float(np.abs(excess).max())
            # the error shrinks by a similar factor at every step, estimated from two steps; ten times that is safe
            shrinks = min(1.0, 10.0 * found / before) if before else 1.0
            if found * shrinks < 1e-2 * self.tolerance:
                break
            before = found
        return np.exp(log_rho)


def values_to_coefficients(order: int) -> Array:
    """Return the matrix from values at the Chebyshev nodes of the first kind to coefficients."""
    matrix = np.asarray(chebyshev.chebvander(chebyshev.chebpts1(order), order - 1).T * (2.0 / order), float)
    matrix[0] *= 0.5
    return matrix
