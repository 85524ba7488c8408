"""Sums of polynomials against NumPy's."""

from __future__ import annotations

import numpy as np
import pytest

from softness_bayes.touch.neuron.polynomials import (
    chebyshev_values,
    clenshaw,
    horner,
)


@pytest.mark.parametrize("order", [1, 2, 9])
def test_chebyshev_values(rng, order):
    x = rng.uniform(-1, 1, (3, 4))
    exact = np.moveaxis(np.polynomial.chebyshev.chebvander(x, order - 1), -1, 0)
    np.testing.assert_allclose(chebyshev_values(x, order), exact, rtol=0, atol=1e-14)


@pytest.mark.parametrize("order", [1, 2, 9])
def test_clenshaw(rng, order):
    coefficients, x = rng.normal(size=(order, 2, 3)), rng.uniform(-1, 1, (5, 2, 3))
    exact = np.polynomial.chebyshev.chebval(x, coefficients[:, None], tensor=False)
    np.testing.assert_allclose(clenshaw(coefficients, x), exact, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("shape", [(), (1,), (4,)], ids=str)
@pytest.mark.parametrize("order", [1, 2, 7])
def test_horner(rng, order, shape):
    """One polynomial for all points, or one for each of the last axis."""
    coefficients, x = rng.normal(size=(order, *shape)), rng.uniform(-1, 1, (3, 4))
    exact = sum(np.broadcast_to(c, (3, 4)) * x**k for k, c in enumerate(coefficients))
    np.testing.assert_allclose(horner(coefficients, x), exact, rtol=1e-12)
