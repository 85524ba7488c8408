"""Orders of lists: the law of Plackett and Luce, ties, and places left out."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.stats import gumbel_r

from softness_bayes.base.errors import InputError
from softness_bayes.checking.checks import loo_pit
from softness_bayes.checking.quantities import uniformity_p_value
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.error_laws import GUMBEL_SD
from softness_bayes.likelihood.intervals import CategoryModel
from softness_bayes.likelihood.lists import MOST_TIED, shares
from softness_bayes.likelihood.orders import OrderModel, OrderRatings
from softness_bayes.likelihood.scales import FALLS
from support.points import rated

RATE = np.array([0.0, 2.0, 7.0, 30.0])
POINT = rated(np.float64(0.8), 0.0, np.float64(1.5), 0.0, np.float64(0.1))
MODEL = OrderModel()


def one_list(places, **options):
    design = Design(np.arange(len(places)), np.zeros(len(places), int), np.arange(len(places)), 1)
    return OrderRatings(places, design, MODEL, **options)


def chance(places):
    """Probability of these places of the first fabrics."""
    return float(np.exp(one_list(places).log_likelihood(RATE[: len(places)], POINT)))


def test_order_of_three_is_an_integral_over_their_noise():
    """P(first < second < third) of latent numbers with Gumbel's noise, by quadrature."""
    scale = 1.5 / GUMBEL_SD
    first, second, third = (gumbel_r(m, scale) for m in 0.8 * np.log(RATE[:3] + 0.1))
    for one, two, three, places in (
        (first, second, third, (1, 2, 3)),
        (third, first, second, (2, 3, 1)),
    ):
        # over the middle one: the first lies below it and the third above
        found, _ = quad(
            lambda y, one=one, two=two, three=three: two.pdf(y) * one.cdf(y) * three.sf(y), -12.0, 40.0, epsabs=1e-7
        )
        assert_allclose(chance(places), found, atol=2e-6)


def test_extreme_worths_stay_finite():
    """Noise of 1e-8 makes an order against the response improbable, not impossible to compute."""
    precise = POINT.replace(varsigma=np.float64(1e-6))
    against = one_list((4, 3, 2, 1))
    assert -1e8 < float(against.log_likelihood(RATE, precise)) < -1e5
    assert_allclose(one_list((1, 2, 3, 4)).log_likelihood(RATE, precise), 0.0, atol=1e-12)
    assert np.isfinite(against.left_out(RATE, precise).log_density).all()
    assert np.isfinite(
        against.residual(RATE, precise, against.draw_effects(np.random.default_rng(0), RATE, precise))
    ).all()


def test_a_place_among_ties_is_left_out_with_them():
    """A lower place than the one that it shares is that below the first fabric."""
    model = one_list((1, 2, 2, 3))
    found = model.left_out(RATE, POINT).log_density
    lower = chance((2, 1, 3, 4))
    total = np.exp(model.without(np.arange(4) == 1).log_likelihood(RATE, POINT))
    expected = lower / total + 0.5 * np.exp(found[1])
    assert_allclose(model.left_out(RATE, POINT).below[1], expected, rtol=1e-10)


def test_replicates_keep_the_places_of_their_list():
    places = np.array([1.0, 2.0, 2.0, 9.0])
    model, rng = one_list(places), np.random.default_rng(1)
    drive = np.broadcast_to(model.drive(RATE, POINT), (500, 4))
    made = model.replicate(rng, drive, POINT, None)
    assert (np.sort(made, axis=1) == places).all()
    # the stiffest fabric's share of last places is the chance of a first choice in Luce's sense
    worth = np.exp(0.8 * np.log(RATE + 0.1) * GUMBEL_SD / 1.5)
    expected = worth[3] / worth.sum()
    assert abs((made[:, 3] == 9.0).mean() - expected) < 4.0 * np.sqrt(expected * (1.0 - expected) / 500)


def test_shares_of_a_list():
    found = shares(np.array([3.0, 1.0, 2.0, 2.0, 8.0]), np.array([0, 0, 0, 0, 1]))
    assert_allclose(found, [1.0, 0.0, 0.5, 0.5, 0.5])


def test_what_is_no_order_is_refused():
    with pytest.raises(InputError, match=f"{MOST_TIED + 1} touches of one list share a place"):
        one_list([1.0] * (MOST_TIED + 1))
    with pytest.raises(InputError, match="1 of 2 are not finite numbers"):
        one_list([1.0, np.nan])
    with pytest.raises(InputError, match="several participants"):
        OrderRatings([1, 2], Design([0, 1], [0, 1], [0, 1], 2), MODEL, lists=np.array([0, 0]))


def crossed(people=40):
    design = Design(np.tile(np.arange(4), people), np.repeat(np.arange(people), 4), np.arange(4), people)
    return design, np.tile(RATE, (60, 1)), rated(*(np.full(60, v) for v in (0.8, 0.4, 0.5, 0.0, 0.1)))


@pytest.mark.parametrize("model", [OrderModel(FALLS), CategoryModel(FALLS, categories=4)], ids=["orders", "categories"])
def test_places_of_discrete_ratings_are_uniform(model):
    """LOO-PIT of tables from the model is uniform, though a category or a place has a probability of its own."""
    design, rate, points = crossed()
    rng = np.random.default_rng(3)
    points = points.replace(gap_2=np.full(60, 0.9), gap_3=np.full(60, 0.9))
    one = points.each(lambda v: np.asarray(v)[:1] if np.ndim(v) else v)
    drive = model.drive(design, rate[:1], one)
    effects = model.draw_effects(rng, one, (1,), design.n_participants, design.n_fabrics, {"mu": 1.0})
    observed = model.observe(model.draw_ratings(rng, design, drive, one, effects)[0], design)
    assert observed.discrete.all()
    assert np.unique(observed.values).size > 3
    found = loo_pit(observed.left_out(rate, points), observed.discrete).value
    assert uniformity_p_value(found, np.linspace(0.05, 0.95, 19)) > 1e-3
    # without the drawn share places heap up
    middle = observed.left_out(rate[:1], one).below[0]
    assert uniformity_p_value(middle, np.linspace(0.05, 0.95, 19)) < 1e-3
