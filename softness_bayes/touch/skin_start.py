"""Initial value of the search for the skin's modulus: a polynomial in the skin's parameters (model.md 2).

For given fabrics and loads, w of `log_stiffening` is a smooth function of ln b and ln m. Over the range of a prior, a
polynomial for each condition approximates it so well that the search takes one step instead of three, or none where
the error of the polynomial itself is small enough.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from softness_bayes.touch.neuron.polynomials import TotalDegree
from softness_bayes.touch.skin import ONE_STEP, log_stiffening, upper_bound

Array = NDArray[np.float64]

DEGREES = (6, 8, 10, 12, 14)
"""Total degrees of the polynomials; the first that leaves one step is taken, or the last."""

USEFUL = 0.1
"""Largest error of w from which the search takes fewer steps than from its own start."""


class SkinBox(NamedTuple):
    """Ranges of the skin's parameters, with positive ends."""

    b: tuple[float, float]
    """Modulus at rest [Pa]."""
    m: tuple[float, float]
    """Stiffening exponent, as the reading of the skin's compression has it."""


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
        Largest error of w within the box, multiplied by e^w where that is above 1: also a bound on the relative error
        of the skin's modulus.
    """

    def __init__(self, box: SkinBox, log_scale: Array, p: Array, log_k: Array) -> None:
        self._of = log_scale, p, log_k
        ends = np.log(box)
        self._middle, self._half = ends.mean(axis=1)[:, None], np.maximum(0.5 * np.diff(ends, axis=1), 1e-6)
        grid = np.array(np.meshgrid(*2 * (chebyshev.chebpts2(DEGREES[-1] + 4),))).reshape(2, -1)
        b, m = np.exp(self._middle + self._half * grid)[..., None]
        exact = log_stiffening(log_scale, p, log_k, b, m)
        for degree in DEGREES:
            self._terms = TotalDegree(2, degree)
            basis = self._terms.basis(grid)
            self._coefficients = np.linalg.lstsq(basis, exact, rcond=None)[0]
            error = np.abs(basis @ self._coefficients - exact) * np.maximum(np.exp(exact), 1.0)
            self.error = float(error.max())
            if self.error <= ONE_STEP:
                break

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
        # m may be 0
        x = (np.log([b, np.maximum(m, 1e-300)]) - self._middle) / self._half
        beyond = ~(np.abs(x) <= 1.0)  # NaN is outside
        w = self._terms.basis(np.minimum(np.maximum(x, -1.0), 1.0)) @ self._coefficients
        outside = beyond.any(axis=0)
        if outside.any():
            w[outside] = upper_bound(*self._of, b[outside, None], m[outside, None])
        return w, np.where(outside, np.inf, self.error)
