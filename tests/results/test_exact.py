"""The comparison with the exact likelihood: it ends when its answer is certain, and not before."""

from types import SimpleNamespace

import numpy as np
import pytest

from softness_bayes.checking import exactness
from softness_bayes.checking.exactness import HARMLESS
from softness_bayes.checking.sentences import exactness_sentence
from softness_bayes.results.draws import evenly
from softness_bayes.results.run_checks import EXACT_DRAWS, FIRST_DRAWS, compare_exactly, exactness_stats
from softness_bayes.sampler.workers import Workers
from support.fake_scene import fake_posterior

SHAPE = (20, 30)


@pytest.fixture
def compare(rng):
    """Compare with an exact likelihood that differs by given amounts at the draws; return where and what was found."""
    posterior = fake_posterior()
    posterior.scene.firing = SimpleNamespace(noise=0)
    theta = np.exp(np.log(posterior.space.median) + 0.01 * rng.standard_normal((*SHAPE, len(posterior.names))))
    asked = []

    def run(difference, reweight=False):
        by_point = dict(zip(map(bytes, theta.reshape(-1, theta.shape[-1])), difference.ravel(), strict=True))

        def different(posterior, points):
            asked.append(len(points))
            return posterior.log_likelihood(points) + [by_point[bytes(point)] for point in points]

        with Workers(posterior, 1) as workers:
            found = compare_exactly(posterior, theta, workers, reweight, different)()
        assert sum(asked) == found.difference.size + (FIRST_DRAWS if found.difference.size == EXACT_DRAWS else 0)
        stored = exactness_stats(found, theta.shape)["exact_difference"].values
        compared = np.isfinite(stored)
        assert compared.sum() == found.difference.size
        np.testing.assert_allclose(stored[compared], difference[compared], atol=1e-9)  # each at its own draw
        return found, compared

    return run


@pytest.mark.parametrize("size", [0.0, 1e-3, 0.02])
def test_a_certain_answer_ends_the_comparison(compare, rng, size):
    found, compared = compare(size * rng.uniform(-1, 1, SHAPE))
    assert found.difference.size == FIRST_DRAWS
    assert found.exact_enough
    assert compared[:, : SHAPE[1] // 2].any()
    assert compared[:, SHAPE[1] // 2 :].any()  # over the whole run


@pytest.mark.parametrize("size", [0.9 * HARMLESS, HARMLESS, 1.0])
def test_an_uncertain_or_bad_answer_needs_all_draws(compare, rng, size):
    found, compared = compare(size * rng.standard_normal(SHAPE))
    assert found.difference.size == EXACT_DRAWS
    assert compared[evenly(SHAPE, EXACT_DRAWS)].all()


def test_one_far_draw_among_the_first_is_no_certain_answer(compare):
    difference = np.zeros(SHAPE)
    chain, draw = evenly(SHAPE, EXACT_DRAWS)
    difference[chain[0], draw[0]] = 10 * HARMLESS
    found, _ = compare(difference)
    assert found.difference.size == EXACT_DRAWS


def test_weights_need_every_draw(compare, rng):
    found, _ = compare(1e-4 * rng.standard_normal(SHAPE), reweight=True)
    assert found.difference.size == np.prod(SHAPE)


def test_the_error_of_the_spread_is_that_of_repetitions(rng):
    spreads = []
    for _ in range(400):
        found = exactness.Exactness(("x",), np.zeros((40, 1)), np.zeros(40), 1e-3 * rng.standard_normal(40))
        spreads.append((found.sd, found.sd_error))
    sd, error = np.array(spreads).T
    assert error.mean() == pytest.approx(sd.std(), rel=0.15)
    assert f"(sd ± {error[-1]:.1g})" in exactness_sentence(found)
