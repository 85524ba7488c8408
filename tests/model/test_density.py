"""The posterior density of a fake scene: its parts, its coordinates, where it ends."""

import numpy as np
import pytest

from softness_bayes.base.errors import InputError, NumericalError
from support.fake_scene import FakeScene, fake_posterior


@pytest.fixture(scope="module")
def posterior():
    return fake_posterior()


def test_density_is_prior_times_likelihood_times_jacobian(posterior):
    z = posterior.draw_start(np.random.default_rng(1), 20)
    theta = posterior.natural(z)
    expected = posterior.log_prior(theta) + posterior.log_likelihood(theta) + posterior.space.log_jacobian(z)
    np.testing.assert_allclose(posterior(z), expected)
    one_by_one = np.concatenate([posterior(point[None]) for point in z])
    np.testing.assert_allclose(posterior(z), one_by_one, rtol=1e-12)


def test_far_proposals_have_no_density_and_never_reach_the_scene(posterior):
    scene = FakeScene()
    asked = []

    class Watched(FakeScene):
        def total_rate(self, parameters):
            asked.append(np.max(np.abs(np.log(np.broadcast_arrays(*parameters[:9])))))
            return scene.total_rate(parameters)

    watched = fake_posterior(scene=Watched())
    z = watched.draw_start(np.random.default_rng(2), 6)
    asked.clear()
    z[1] += 800
    z[2] -= 800
    z[3, 0] = 1e5
    z[4] += 60
    density = watched(z)
    assert np.isneginf(density[1:5]).all()
    assert np.isfinite(density[[0, 5]]).all()
    assert max(asked) < 40
    assert np.isneginf(watched(z[1:3])).all()


def test_a_likelihood_that_is_no_number_names_the_point():
    class Broken(FakeScene):
        def total_rate(self, parameters):
            rate = super().total_rate(parameters)
            return np.where(np.asarray(parameters.b)[..., None] > 1e5, np.nan, rate)

    broken = fake_posterior(scene=Broken())
    theta = np.tile(broken.space.median, (3, 1))
    assert np.isfinite(broken.log_likelihood(0.9 * theta)).all()
    theta[1, 0] = 123.5
    with pytest.raises(NumericalError, match=r"log-likelihood is nan at b=123\.5, m=2\.0"):
        broken.log_likelihood(theta)


def test_starts_fire_in_three_conditions(posterior):
    rng = np.random.default_rng(3)
    rate = posterior.mean_rate(posterior.natural(posterior.draw_start(rng, 200)))
    assert ((rate > 0).sum(axis=-1) >= 3).all()
    # negative control: plain prior draws do not always
    plain = posterior.mean_rate(posterior.space.draw_prior(rng, 200))
    assert ((plain > 0).sum(axis=-1) < 3).any()


def test_a_prior_that_is_silent_is_refused():
    with pytest.raises(InputError, match="prior draws make receptors fire"):
        fake_posterior(scene=FakeScene(rheobase=1e9)).draw_start(np.random.default_rng(4), 10)


def test_where_the_prior_hardly_fires_starts_are_of_a_wider_one():
    """alpha must exceed its median by a factor of 1.4, 3.4 standard deviations: one prior draw in 3000."""
    posterior = fake_posterior(scene=FakeScene(rheobase=28.5))
    rng = np.random.default_rng(8)
    plain = posterior.mean_rate(posterior.space.draw_prior(rng, 1600))
    assert ((plain > 0).sum(axis=-1) >= 3).sum() < 10
    z = posterior.draw_start(rng, 32)
    assert z.shape == (32, len(posterior.names))
    assert ((posterior.mean_rate(posterior.natural(z)) > 0).sum(axis=-1) >= 3).all()
    assert np.isfinite(posterior(z)).all()
    np.testing.assert_array_equal(*(posterior.draw_start(np.random.default_rng(9), 8) for _ in range(2)), strict=True)
