"""Exact inverse of the stress field: the distance from the axis at which the stress has some value (model.md 5).

With the depth as the unit of length, the field depends on only two numbers: the contact radius and the decay of the
pressure. If the stress falls like rho^-n far away, then with y = (sigma / sigma_peak)^(2/n)

    rho² = Q(y) (1 - y) / y

and Q has no singularity at either end of y.
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

_ROUNDING = 1e-11  # change of ln y below which no slope follows from it


@dataclass(frozen=True)
class Inversion:
    """The stress field of any contact radius and decay, inverted by the secant method.

    Parameters
    ----------
    depth
        Depth of the receptors [m].
    farthest
        Largest distance from the axis that matters [m].
    readings
        Readings of kernel and component.
    tolerance
        Error allowed in Q, relative to its maximum.
    """

    depth: float
    farthest: float
    readings: Readings
    tolerance: float

    @property
    def root(self) -> float:
        """2/n, the power of sigma / sigma_peak that gives y."""
        component, kernel = self.readings.stress_component, self.readings.stress_kernel
        return 2.0 / (component.far_power or kernel.far_power)

    def unit(self, rho: Array, radius: Array, decay: Array) -> Array:
        """Return the stress at distances [m] under a pressure of amplitude 1; all broadcast."""
        density = GAUSS_DENSITY if self.tolerance < 1e-7 else 0.5 * GAUSS_DENSITY
        kernel, component = self.readings.stress_kernel, self.readings.stress_component
        return unit_stress(rho, self.depth, radius, decay, kernel, component, density)

    def y_least(self, radius: Array, decay: Array) -> Array:
        """Return y at the farthest distance, with a margin, shape (n,)."""
        peak = self.unit(np.zeros_like(radius), radius, decay)
        return 0.95 * self._relative_root(np.full(radius.size, self.farthest), radius, decay, peak)

    def size(self, radius: Array, decay: Array) -> Array:
        """Return the scale of Q [m²]: the sum of the squared depth and the squared width of the loaded patch."""
        return self.depth**2 + radius**2 / (1.0 + decay)

    def rows(self, radius: Array, decay: Array, shape_nodes: int, y_least: float, guess: Array | None = None) -> Array:
        """Return [unit peak, coefficients of Q / size in T_k(y)] of contacts, shape (n, 1 + shape_nodes).

        The coefficients are those of y scaled from [`y_least`, 1] to [-1, 1]; `guess` as in `values`.
        """
        x, coefficients = chebyshev.chebpts1(shape_nodes), values_to_coefficients(shape_nodes).T
        blocks = np.array_split(np.arange(radius.size), -(-radius.size // BLOCK))
        values = (
            self.values(radius[block], decay[block], x, y_least, None if guess is None else guess[block])
            for block in blocks
        )
        return np.concatenate([np.column_stack([peak, shape @ coefficients]) for peak, shape in values])

    def values(
        self, radius: Array, decay: Array, x: Array, y_least: float, guess: Array | None = None
    ) -> tuple[Array, Array]:
        """Return unit peaks (n,) and Q / size (n, len(x)), x being y scaled to [-1, 1].

        Parameters
        ----------
        radius, decay
            The contacts, shape (n,).
        x
            Places.
        y_least
            y at x = -1.
        guess
            Approximate coefficients of Q / size, shape (n, terms), from which the search starts. Whole tables then
            need 8 to 52 % fewer evaluations (readings by name, four loads, tolerances 1e-4 and 1e-6), and state the
            same error.
        """
        y = 0.5 * (1 + y_least) + 0.5 * (1 - y_least) * x
        size, peak = self.size(radius, decay), self.unit(np.zeros_like(radius), radius, decay)
        start = None if guess is None else _start(guess, x, y, y_least, size)
        if start is None:
            start = self._interpolated(y, radius, decay, peak)
        shape = self._distance(y, radius, decay, peak, *start) ** 2 * (y / (1 - y)) / size[:, None]
        return peak, shape

    def _relative_root(self, rho: Array, radius: Array, decay: Array, peak: Array) -> Array:
        return (self.unit(rho, radius, decay) / peak) ** self.root

    def _interpolated(self, y: Array, radius: Array, decay: Array, peak: Array) -> tuple[Array, Array]:
        """Return ln rho and its slope in ln y, shape (n, len(y)), from splines through the field on a grid of rho."""
        radius, decay, peak = radius[:, None], decay[:, None], peak[:, None]
        depth = self.depth
        # from near the axis to where the field follows its power law, and finely across the edge of the contact
        everywhere = np.geomspace(1e-4 * (depth + radius), 10.0 * (self.farthest + radius), 70, axis=-1)[:, 0]
        edge = radius + depth * np.sinh(np.linspace(-1, 1, 51) * np.arcsinh(0.9 * radius / depth))
        grid = np.sort(np.concatenate([everywhere, edge], axis=-1), axis=-1)
        log_grid, known = np.log(grid), np.log(self._relative_root(grid, radius, decay, peak))
        log_y = np.log(y)
        log_rho, slope = np.empty((radius.size, y.size)), np.empty((radius.size, y.size))
        for row in range(radius.size):
            falling = np.concatenate([np.diff(known[row]) < -1e-13, [True]])
            inverse = CubicSpline(known[row][falling][::-1], log_grid[row][falling][::-1])
            log_rho[row], slope[row] = inverse(log_y), inverse(log_y, 1)
        return log_rho, slope

    def _distance(self, y: Array, radius: Array, decay: Array, peak: Array, log_rho: Array, slope: Array) -> Array:
        """Invert the field: distances [m] at which it is y^(1/root) of its peak; (n, len(y)) from (n,).

        The secant method starts at `log_rho`, with a `slope` of ln rho in ln y, both of shape (n, len(y)).
        """
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


def _start(guess: Array, x: Array, y: Array, y_least: float, size: Array) -> tuple[Array, Array] | None:
    """Return ln rho and its slope in ln y from approximate coefficients of Q / size; None if they do not fall in y."""
    shape, rise = chebyshev.chebval(x, guess.T), chebyshev.chebval(x, chebyshev.chebder(guess.T))
    if not (shape > 0.0).all():
        return None
    slope = 0.5 * (y * (2.0 / (1.0 - y_least)) * rise / shape - y / (1.0 - y) - 1.0)
    if not (slope < 0.0).all():
        return None
    return 0.5 * np.log(size[:, None] * shape * (1.0 - y) / y), slope


def values_to_coefficients(order: int) -> Array:
    """Return the matrix from values at the Chebyshev nodes of the first kind to coefficients."""
    matrix = np.asarray(chebyshev.chebvander(chebyshev.chebpts1(order), order - 1).T * (2.0 / order), float)
    matrix[0] *= 0.5
    return matrix
