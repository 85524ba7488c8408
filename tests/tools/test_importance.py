"""Importance sampling, against laws that are known."""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from softness_bayes.tools.importance import TRUSTED, Effort, corrected, weighted

COVARIANCE = np.array([[1.0, 0.9, 0.0], [0.9, 1.0, 0.3], [0.0, 0.3, 0.5]]) * 0.04
MEAN = np.array([0.5, -0.5, 1.0])


class Known:
    """A law of three coordinates, which are natural units, too, with the members of a posterior that are used."""

    names = ("a", "b", "c")
    space = SimpleNamespace(coordinates=np.asarray)
    natural = staticmethod(np.asarray)

    def __init__(self, log_density):
        self._log_density = log_density

    def __call__(self, z):
        return self._log_density(z)

    def draw_start(self, rng, size):
        return rng.standard_normal((size, 3))


def normal(z):
    away = z - MEAN
    return -0.5 * np.einsum("ni,ij,nj->n", away, np.linalg.inv(COVARIANCE), away)


def test_moments_are_those_of_a_normal_law():
    found = weighted(Known(normal), np.random.default_rng(1), {"a": 0.4, "b": 0.0}, Effort(1000, 2000.0))
    assert found.k < TRUSTED
    assert found.effective >= 2000
    z = found.theta
    error = np.sqrt(np.diag(COVARIANCE) / found.effective)
    assert_allclose((found.weight @ z - MEAN) / error, 0.0, atol=4.0)
    assert_allclose(np.cov(z.T, aweights=found.weight), COVARIANCE, atol=5 * 0.04 / np.sqrt(found.effective))


def test_resampled_draws_have_the_weighted_shares():
    found = weighted(Known(normal), np.random.default_rng(2), {})
    draws = found.resampled(np.random.default_rng(3), 1000)
    for k in range(3):
        below = found.weight @ (found.theta[:, k] < MEAN[k])
        assert (draws[:, k] < MEAN[k]).mean() == pytest.approx(below, abs=0.05)


def test_a_law_with_heavier_tails_than_proposals_is_not_trusted():
    found = weighted(Known(lambda z: -0.6 * np.log1p((z**2).sum(axis=1) * 1e4)), np.random.default_rng(1), {})
    assert found.k > TRUSTED


@pytest.mark.parametrize(("away", "trusted"), [(0.03, True), (3.0, False)])
def test_draws_of_a_rough_law_are_corrected(away, trusted):
    """A law whose mean is off by a sixth of a standard deviation is mended; one off by fifteen is not trusted."""
    shifted = SimpleNamespace(log_likelihood=lambda z: normal(z - [away, 0.0, 0.0]))
    rough = Known(shifted.log_likelihood)
    rough.log_likelihood = shifted.log_likelihood
    rng = np.random.default_rng(4)
    found = corrected(weighted(rough, rng, {}), rough, SimpleNamespace(log_likelihood=normal), rng, 2000)
    assert (found.k < TRUSTED) is trusted
    assert found.weight.sum() == pytest.approx(1.0)
    if trusted:
        error = np.sqrt(np.diag(COVARIANCE) / found.effective)
        assert_allclose((found.weight @ found.theta - MEAN) / error, 0.0, atol=4.0)
