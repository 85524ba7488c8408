"""Ratings of raters with fingers of their own, beyond the contract of likelihoods."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from softness_bayes.base.errors import InputError
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.individual import IndividualModel
from softness_bayes.likelihood.magnitude import RatingModel
from softness_bayes.likelihood.scales import FALLS
from softness_bayes.touch.finger_grid import FingerGrid
from support.points import densities, rated

PEOPLE, CONDITIONS = 6, 5
DESIGN = Design(
    np.tile(np.arange(CONDITIONS), PEOPLE), np.repeat(np.arange(PEOPLE), CONDITIONS), np.arange(CONDITIONS), PEOPLE
)
GRID = FingerGrid({"b": 9})


def points(size=4, **changed):
    values = {"gamma": 1.0, "tau": 0.4, "varsigma": 0.3, "tau_b": 0.3, **changed}
    return rated(**{name: np.full(size, value) for name, value in values.items()})


def observed(rng, spread=1.0, grid=GRID):
    """Ratings, and responses in which a finger's differ from the typical one's by up to `spread`."""
    typical = np.exp(rng.normal(1.0, 1.0, (4, 1, CONDITIONS)))
    lean = rng.standard_normal((4, 1, CONDITIONS))
    own = typical * np.exp(0.3 * spread * grid.z["b"][:, None] * lean)
    rates = np.concatenate([typical, own], axis=1).reshape(4, -1)
    model, p = IndividualModel(FALLS, grid=grid), points(1)
    drive = model.drive_at(rates[:1], DESIGN, rates[:1], p)
    effects = model.draw_effects(rng, p, (1,), PEOPLE, CONDITIONS, {"mu": 3.0})
    typical = effects.replace(finger=np.full((1, PEOPLE), grid.size // 2))
    return model.observe(model.draw_ratings(rng, DESIGN, drive, p, typical)[0], DESIGN), rates


@pytest.mark.parametrize("tau", [1e-3, 0.05, 0.4, 3.0])
@pytest.mark.parametrize("varsigma", [0.05, 0.3, 2.0])
def test_fingers_that_do_not_differ_give_the_closed_form(rng, tau, varsigma):
    likelihood, rates = observed(rng, spread=0.0)
    p, rates = points(1, tau=tau, varsigma=varsigma), rates[:1]
    closed = RatingModel(FALLS).observe(likelihood.values, DESIGN)
    assert_agree(likelihood, closed, rates, p)
    missing = np.arange(DESIGN.n_rows) % 7 == 3  # now raters differ in what they rated
    assert_agree(likelihood.without(missing), closed.without(missing), rates, p)


def assert_agree(likelihood, closed, rates, p):
    typical = rates[:, :CONDITIONS]
    assert_allclose(likelihood.log_likelihood(rates, p), closed.log_likelihood(typical, p), rtol=1e-11, atol=1e-8)
    expected = densities(closed, typical, p)
    for name, found in densities(likelihood, rates, p).items():
        assert_allclose(found, expected[name], rtol=1e-7, atol=1e-8, err_msg=name)


@pytest.mark.parametrize("varsigma", [0.002, 1e-4])
def test_ratings_almost_without_noise_have_a_density(rng, varsigma):
    """Far from the raters' means the factors between nodes overflow: alone and among points where they do not."""
    likelihood, rates = observed(rng, spread=0.0)
    closed = RatingModel(FALLS).observe(likelihood.values, DESIGN)
    p = points(2, tau=np.array([1e-4, 0.4]), varsigma=np.array([varsigma, 0.3]))
    found = likelihood.log_likelihood(rates[:2], p)
    assert_allclose(found, closed.log_likelihood(rates[:2, :CONDITIONS], p), rtol=1e-9)
    one = p.part(0)
    assert_allclose(likelihood.log_likelihood(rates[0], one), found[0], rtol=1e-12)


def test_the_sum_over_fingers_is_checked_by_a_finer_one(rng):
    """With responses that follow ln b smoothly, halving the distance of nodes changes nothing."""
    coarse, fine = FingerGrid({"b": 33}), FingerGrid({"b": 33}).finer()
    state = rng.bit_generator.state
    found = []
    for grid in (coarse, fine):
        rng.bit_generator.state = state
        likelihood, rates = observed(rng, grid=grid)
        found.append(likelihood.log_likelihood(rates[:1], points(1)))
    assert_allclose(*found, rtol=0, atol=1e-4)
    rng.bit_generator.state = state
    likelihood, rates = observed(rng, grid=FingerGrid({"b": 5}))
    assert np.abs(likelihood.log_likelihood(rates[:1], points(1)) - found[1]).max() > 1e-3  # too few nodes are noticed


def test_raters_without_ratings_keep_their_prior(rng):
    design = Design(DESIGN.condition[:10], DESIGN.participant[:10], np.arange(CONDITIONS), PEOPLE)
    _, rates = observed(rng)
    likelihood = IndividualModel(grid=GRID).observe(np.exp(rng.normal(3.0, 0.5, 10)), design)
    wide = np.tile(rates[:1], (2000, 1))
    effects = likelihood.draw_effects(rng, wide, points(2000))
    idle = GRID.z["b"][effects.finger[:, 5]]
    assert abs(idle.mean()) < 0.12
    assert abs(idle.std() - 1.0) < 0.1
    assert_allclose(likelihood.log_likelihood_participants(rates, points())[:, 2:], 0.0)


def test_responses_of_other_grids_are_refused(rng):
    likelihood, rates = observed(rng)
    with pytest.raises(InputError, match="50 mean rates, expected those of 4 fingers and the typical one in 5"):
        likelihood.with_grid(FingerGrid({"b": 4})).log_likelihood(rates, points())
