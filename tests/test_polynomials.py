"""Sums of polynomials against NumPy's."""

from __future__ import annotations

import numpy as np
import pytest

from softness_bayes.touch.polynomials import chebyshev_values, clenshaw, horner


@pytest.mark.parametrize("order", [1, 2, 9])
def test_chebyshev_values(rng, order):
    x = rng.uniform(-1, 1, (3, 4))
    exact = np.moveaxis(np.polynomial.chebyshev.chebvander(x, order - 1), -1, 0)
    np.testing.assert_allclose(chebyshev_values(x, order), exact, rtol=0, atol=1e-14)


def test_clenshaw(rng):
    coefficients, x = rng.normal(size=(9, 2, 3)), rng.uniform(-1, 1, (5, 2, 3))
    exact = np.polynomial.chebyshev.chebval(x, coefficients[:, None], tensor=False)
    np.testing.assert_allclose(clenshaw(coefficients, x), exact, rtol=1e-12, atol=1e-13)


def test_horner(rng):
    coefficients, x = rng.normal(size=7), rng.uniform(-1, 1, (3, 4))
    np.testing.assert_allclose(horner(coefficients, x), np.polynomial.polynomial.polyval(x, coefficients), rtol=1e-12)
