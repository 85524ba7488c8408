"""The groups of a result are functions of its draws: none depends on which was made before."""

import numpy as np
import pytest

from softness_bayes.checking.quantities import EXCESS
from softness_bayes.likelihood.scales import MAGNITUDE
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.results import draws as draws_module
from softness_bayes.results.draws import (
    FIRST_SHARE,
    LEAST_REPLICATES,
    REPLICATES,
    RatedDraws,
    replicated_groups,
)
from softness_bayes.results.run_options import Request, RunOptions
from softness_bayes.sampler.chains import Chains
from softness_bayes.sampler.workers import Workers
from support.report_runs import OPTIONS, experiment, quickly


def drawn(share=1.0):
    """Draws of the prior in the place of a walk: 2 ensembles of 3 walkers, 2 steps."""
    rng, data = np.random.default_rng(5), experiment()
    with quickly():
        posterior = build(data, Request(ModelOptions(), RunOptions()).with_options(**OPTIONS).model).posterior
    theta = posterior.space.draw_prior(rng, 12).reshape(6, 2, -1)
    kept = Chains(np.zeros((2, 2, 3, theta.shape[-1])), np.zeros((2, 2, 3)), np.full((2, 3), 0.3), 2, 1)
    with Workers(posterior, 1) as workers:
        return RatedDraws(data, posterior, MAGNITUDE, kept, theta, rng, workers, share)


@pytest.fixture(scope="module")
def draws():
    return drawn()


def arrays(value):
    """Return every array below a value."""
    if isinstance(value, np.ndarray):
        return [value]
    if isinstance(value, dict):
        return [array for inner in value.values() for array in arrays(inner)]
    return [array for inner in value for array in arrays(inner)] if isinstance(value, (tuple, list)) else []


def same(one, other):
    left, right = arrays(one), arrays(other)
    assert len(left) == len(right) > 0
    return all(np.array_equal(a, b, equal_nan=a.dtype.kind == "f") for a, b in zip(left, right, strict=True))


def test_what_is_drawn_depends_on_the_seed_alone(draws):
    first, again, other = (replicated_groups(np.random.default_rng(seed), draws) for seed in (1, 1, 2))
    assert same(first, again)
    assert not same(first, other)
    # the response at its peak shares its noise: where it is not beyond the peak, ratings are the same
    excess = np.abs(first["constant_data"][EXCESS].values)
    assert excess.min() < 1e-9 < excess.max()


def test_a_first_look_stores_fewer_draws(draws):
    first = drawn(FIRST_SHARE)
    assert 4 * first.replicates > REPLICATES > 3 * first.replicates
    assert 4 * first.curves > draws.curves > 3 * first.curves


def test_of_large_tables_fewer_draws_have_replicated_ratings(draws, monkeypatch):
    """As many as fit into the room, between the usual and the least number."""
    assert draws.replicates == REPLICATES
    monkeypatch.setattr(draws_module, "ROOM", 200 * draws.posterior.observation.design.n_rows)
    assert drawn().replicates == 200
    monkeypatch.setattr(draws_module, "ROOM", 1)
    assert drawn().replicates == LEAST_REPLICATES
