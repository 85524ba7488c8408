"""Expected posterior widths of a design, against closed forms and against posteriors that were sampled."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import norm

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import LogNormal, Signed, magnitude
from softness_bayes.checking.identifiability import prior_moments
from softness_bayes.data import Experiment, Fabrics, Ratings
from softness_bayes.experiments.design_information import as_it_is, foresee, others
from softness_bayes.likelihood.error_laws import NORMAL
from softness_bayes.likelihood.scales import CATEGORIES, FREE, MAGNITUDE, PAIRS, RANKS, RISES
from softness_bayes.model.build import COARSE, build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulation import simulate_compression
from softness_bayes.touch.contact import Indentation

CHANNELS = {"c_Na": 1.0, "c_K": 1.0, "c_L": 1.0, "c_A": 1.0}
MODULI = np.geomspace(2e4, 4e6, 6)
CHAIN = {"b": 100.0, "m": 2.0, "alpha": 22.0, "beta": 0.6, "sigma_0": 9.0, "eps": 0.1}


def experiment(rating=None, people=6, compression=None):
    names = tuple(f"F{k}" for k in range(6))
    loads = (Indentation(1e-3), Indentation(2.5e-3))
    if rating is None:
        # never on a grid of numbers, and never the same
        rating = np.exp(np.random.default_rng(1).normal(2.0, 0.7, (people, 6, 2)))
    table = Ratings.crossed(tuple(f"P{k}" for k in range(people)), names, loads, rating)
    return Experiment(table, Fabrics(names, effective_modulus=MODULI), (), compression)


def built(fix=None, priors=None, data=None, **chosen):
    options = ModelOptions(fix={**CHANNELS, **(fix or {})}, priors=priors or {}, discretisation=COARSE, **chosen)
    return build(data or experiment(), options)


@pytest.fixture(scope="module")
def model():
    return built(errors=NORMAL, resolution=0.0)


def test_a_straight_line_has_the_width_of_the_closed_form():
    """With the chain held, log ratings follow the exponent in a straight line."""
    held = {**CHAIN, "tau": 0.3, "varsigma": 0.4}
    model = built(held, {"gamma": LogNormal(0.8, 0.02)}, errors=NORMAL, resolution=0.0)
    assert model.posterior.names == ("gamma",)
    found = foresee(model, as_it_is(model))
    theta = np.array([0.8])
    rate = model.posterior.mean_rate(theta)
    x = np.log(rate + 0.1)
    design = as_it_is(model).design
    x = (x - x.mean())[design.condition]
    people = np.eye(6)[design.participant]
    covariance = 0.4**2 * np.eye(72) + 0.3**2 * people @ people.T + 3.0**2
    information = x @ np.linalg.solve(covariance, x)
    prior = 0.8 * 0.02
    assert found.names == ("gamma",)
    assert_allclose(found.ratio[0, 0], 1.0 / np.sqrt(1.0 + prior**2 * information), rtol=5e-3)
    assert_allclose(found.bits[0], 0.5 * np.log2(1.0 + prior**2 * information), rtol=5e-3)


def test_pairs_have_the_width_of_the_closed_form():
    """Each participant compares neighbours in the order of the table, alike under both loads."""
    table = experiment().ratings
    lists = table.participant * 6 + table.load * 3 + table.fabric // 2
    data = experiment()._replace(ratings=replace(table, lists=lists, rating=(table.fabric % 2).astype(float)))
    held = {**CHAIN, "varsigma": 0.4}
    model = built(held, {"gamma": LogNormal(0.8, 0.02)}, data=data, scale=PAIRS, direction=RISES)
    found, now = foresee(model, as_it_is(model)), as_it_is(model)
    assert (now.n_answers, now.compared.times.tolist()) == (36, [6.0] * 6)
    x = np.log(model.posterior.mean_rate(np.array([0.8])) + 0.1)
    pairs = now.compared.members
    apart = (x[pairs[:, 0]] - x[pairs[:, 1]]) / (np.sqrt(2.0) * 0.4)
    chance = norm.cdf(0.8 * apart)
    information = 6.0 * (norm.pdf(0.8 * apart) ** 2 / (chance * (1.0 - chance)) * apart**2).sum()
    assert_allclose(found.ratio[0, 0], 1.0 / np.sqrt(1.0 + (0.8 * 0.02) ** 2 * information), rtol=5e-3)


def test_an_exponent_of_either_sign_is_as_wide_as_one_of_a_known_sign():
    """Ratings of the same design in a stated direction are the same model, but for the sign."""
    free, risen = (built(errors=NORMAL, resolution=0.0, direction=one) for one in (FREE, RISES))
    truth = risen.posterior.space.median[None]
    k = risen.posterior.names.index("gamma")
    assert isinstance(free.posterior.space.sampled[k].prior, Signed)
    expected = foresee(risen, as_it_is(risen), truth)
    for sign in (1.0, -1.0):
        found = foresee(free, as_it_is(free), np.where(np.arange(truth.size) == k, sign, 1.0) * truth)
        # the prior of an exponent without a direction is wider
        sd = [prior_moments(magnitude(one.posterior.space.sampled[k].prior))[1] for one in (free, risen)]
        assert found.ratio[0, k] * sd[0] == pytest.approx(expected.ratio[0, k] * sd[1], rel=0.1)
        assert_allclose(np.delete(found.ratio, k, 1), np.delete(expected.ratio, k, 1), rtol=0.1)


def test_more_ratings_tell_more(model):
    now = foresee(model, as_it_is(model))
    assert (now.bits > 0).all()
    assert now.ratio.shape == (16, len(now.names))
    wider = others(model)
    assert [one.design.n_rows - 72 for one in wider] == [72, 72, 36, 36, 36, 36]
    for planned in wider[::2]:
        more = foresee(model, planned)
        # secants of a bent response are taken elsewhere, so that a single truth may tell a little less
        assert np.median(more.bits - now.bits) > 0


def test_forces_of_a_plate_tell_of_the_skin(model, rng):
    values = usual_values(model.options.readings, n_fingers=8)
    plate = simulate_compression(rng, values).compression
    with_plate = built(data=experiment(compression=plate), errors=NORMAL, resolution=0.0)
    now, then = (foresee(one, as_it_is(one)) for one in (model, with_plate))
    for name in ("b", "m"):
        before, after = (one.ratio[:, one.names.index(name)] for one in (now, then))
        assert np.median(after) < 0.8 * np.median(before)
    assert np.median(then.ratio[:, then.names.index("tau_b")]) < 0.9


def test_turning_points_are_foreseen_where_there_are_any(model):
    found = foresee(model, as_it_is(model))
    assert found.loads == ("1 mm", "2.5 mm")
    assert found.turns[1] > found.turns[0]
    seen = np.isfinite(found.place[:, 1])
    assert seen.any()
    assert (found.factor[seen, 1] > 1).all()


def test_what_cannot_be_foreseen_is_refused():
    data = experiment(np.random.default_rng(3).integers(1, 8, (6, 6, 2)).astype(float))
    model = built(data=data, scale=CATEGORIES)
    with pytest.raises(InputError, match="design: "):
        foresee(model, as_it_is(model))


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "scale", "factor"), [(3, MAGNITUDE, 1.5), (11, MAGNITUDE, 1.5), (3, RANKS, 1.8)])
def test_foreseen_widths_are_those_of_posteriors(seed, scale, factor):
    """At truths from the prior, ratings are simulated and fitted: widths agree, those of single quantities roughly.

    Ranks tell little of `b`, whose posterior is then far from normal.
    """
    from softness_bayes import RunOptions, sample

    exact = {"errors": NORMAL, "resolution": 0.0} if scale is MAGNITUDE else {"scale": scale}
    model = built(data=experiment(people=20), **exact)
    posterior, rng = model.posterior, np.random.default_rng(seed)
    truth = posterior.space.draw_prior(rng, 1)
    while (posterior.mean_rate(truth) > 0).mean() < 0.5:
        truth = posterior.space.draw_prior(rng, 1)
    rate, parameters = posterior.mean_rate(truth), posterior.rating_parameters(truth)
    seen = posterior.observation
    effects = seen.new_effects(rng, parameters, (1,))
    rating = seen.replicate(rng, seen.drive(rate, parameters), parameters, effects)[0]
    data = model.data._replace(ratings=replace(model.data.ratings, rating=rating))
    result = sample(data, model.options, RunOptions(), seed=1)
    expected = foresee(model, as_it_is(model), truth)
    draws = result.tree["posterior"].to_dataset()
    widths = [float(draws[name].values.std()) for name in expected.names]
    of_prior = {p.name: prior_moments(magnitude(p.prior))[1] for p in posterior.space.sampled}
    apart = np.log(expected.ratio[0] * [of_prior[name] for name in expected.names] / widths)
    assert np.abs(apart).max() < np.log(factor), dict(zip(expected.names, np.exp(apart), strict=True))
    assert np.abs(np.median(apart)) < np.log(1.15)
    assert np.median(np.abs(apart)) < np.log(1.2)
