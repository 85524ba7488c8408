"""Functions of the skin's parameters over a prior's range as polynomials (model.md 2).

For given fabrics and loads, w of `log_stiffening`, and what follows from it, are smooth functions of ln b and of the
root of m, which needs fewer terms than ln m or m itself. Over the range of a prior, a polynomial for each condition
approximates them so well that the search for the skin's modulus takes one step instead of three, or none where the
error of the polynomial itself is small enough.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from softness_bayes.touch.inversion import values_to_coefficients
from softness_bayes.touch.neuron.polynomials import TotalDegree
from softness_bayes.touch.skin import ONE_STEP, log_stiffening, upper_bound

Array = NDArray[np.float64]

DEGREES = {18: tuple(range(6, 15)), 28: (16, 18, 20, 22, 24)}
"""Total degrees of the polynomials, the first sufficient of which is taken, for each number of nodes in each parameter
to which they are fitted."""

FAR = 1e4
"""Error, relative to the sufficient one, above which polynomials of higher degrees are not tried."""

USEFUL = 0.1
"""Largest error of w from which the search takes fewer steps than from its own start."""


_AT_THE_EDGE = 1e-9  # relative to the box's half-width: allows for rounding at a prior's end


class SkinBox(NamedTuple):
    """Ranges of the skin's parameters, with positive ends."""

    b: tuple[float, float]
    """Modulus at rest [Pa]."""
    m: tuple[float, float]
    """Stiffening exponent, as the reading of the skin's compression has it."""


class SkinSeries:
    """Polynomials in ln b and the root of m, one for each column, fitted to a function over a box.

    Parameters
    ----------
    box
        The range that the polynomials cover.
    function
        Values (points, columns) of skins b and m, each of shape (points, 1).
    enough
        Error at which no higher degree is tried.
    scale
        Function of the values; errors are multiplied by its result.

    Attributes
    ----------
    error
        Largest error at the points to which they were fitted. It was up to 1.5 times that at the box's corners.
    """

    def __init__(
        self,
        box: SkinBox,
        function: Callable[[Array, Array], Array],
        enough: float,
        scale: Callable[[Array], Array] = np.ones_like,
    ) -> None:
        ends = self._coordinates(*np.array(box))
        self._middle, self._half = ends.mean(axis=1)[:, None], np.maximum(0.5 * np.diff(ends, axis=1), 1e-6)
        for nodes, degrees in DEGREES.items():
            grid = np.array(np.meshgrid(*2 * (chebyshev.chebpts1(nodes),), indexing="ij")).reshape(2, -1)
            of_b, of_m = self._middle + self._half * grid
            exact = function(np.exp(of_b)[:, None], of_m[:, None] ** 2)
            to_series = values_to_coefficients(nodes)
            series = np.einsum("ij,kl,jlc->ikc", to_series, to_series, exact.reshape(nodes, nodes, -1), optimize=True)
            for degree in degrees:
                self._terms = TotalDegree(2, degree)
                # in powers, which take less time; what that loses is in the error
                self._coefficients = self._terms.in_powers_of(series[*self._terms.exponents])
                found = self._terms.monomials(grid) @ self._coefficients
                self.error = float((np.abs(found - exact) * scale(exact)).max())
                if self.error <= enough:
                    return
            if self.error > FAR * enough:
                return

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of terms and columns."""
        terms, columns = self._coefficients.shape
        return terms, columns

    @staticmethod
    def _coordinates(b: Array, m: Array) -> Array:
        # a negative m, which is refused later, lies outside any box
        return np.array([np.log(b), np.sqrt(np.maximum(m, 0.0))])

    def __call__(self, b: Array, m: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return the values, shape (batch, columns), and which of the skins b and m (batch,) lie outside the box."""
        x = self._coordinates(b, m)
        x -= self._middle
        x /= self._half
        outside = np.logical_not((np.abs(x) <= 1.0 + _AT_THE_EDGE).all(axis=0))  # NaN is outside
        if outside.any():
            x = np.minimum(np.maximum(x, -1.0), 1.0)
        return self._terms.monomials(x) @ self._coefficients, outside


class SkinStart:
    """Initial values of w for the conditions of a scene.

    Parameters
    ----------
    box
        The range that the polynomials cover; elsewhere the start is `upper_bound`.
    log_scale, p, log_k
        As for `log_stiffening`, shape (conditions,).

    Attributes
    ----------
    error
        Largest error of w, as `SkinSeries` states it, multiplied by e^w where that is above 1: then it is also that of
        the skin's modulus, relative to it.
    """

    def __init__(self, box: SkinBox, log_scale: Array, p: Array, log_k: Array) -> None:
        self._of = log_scale, p, log_k
        self._series = SkinSeries(
            box, partial(log_stiffening, *self._of), ONE_STEP, lambda w: np.maximum(np.exp(w), 1.0)
        )
        self.error = self._series.error

    def __call__(self, b: Array, m: Array) -> tuple[Array, Array]:
        """Return the initial w of the search, and its largest error at each point.

        Parameters
        ----------
        b, m
            As for `log_stiffening`, shape (batch,).

        Returns
        -------
        w, error
            Shapes (batch, conditions) and (batch,); the error is `error` inside the box, and infinite outside.
        """
        w, outside = self._series(b, m)
        if outside.any():
            w[outside] = upper_bound(*self._of, b[outside, None], m[outside, None])
        return w, np.where(outside, np.inf, self.error)
