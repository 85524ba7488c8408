"""The rating model where double precision is too short, and at the ends of floating point."""

import mpmath
import numpy as np
import pytest

from softness_bayes.base.errors import InputError
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.magnitude import LogRatings, RatingModel
from support.points import rated

DEFAULT = RatingModel()


def lab(rng, participants=5, fabrics=4, loads=2, rows=60):
    """Ratings of an unbalanced design, with mean rates some of which are zero."""
    conditions = fabrics * loads
    design = Design(
        rng.integers(conditions, size=rows),
        rng.integers(participants, size=rows),
        np.tile(np.arange(fabrics), loads),
        participants,
    )
    rate = rng.gamma(1, 10, conditions) * (rng.random(conditions) > 0.2)
    ratings = np.exp(rng.normal(3, 1, participants)[design.participant] + rng.normal(0, 0.5, rows))
    return ratings, design, rate


@pytest.mark.parametrize("omega", [0.0, 0.3])
def test_likelihood_where_double_precision_is_too_short_for_the_dense_law(omega):
    ratings, design, rate = lab(np.random.default_rng(1), participants=3, rows=12)
    point = rated(1.0, 20.0, 1e-5, omega)
    x = np.log(rate + point.eps)[design.condition]
    mean = np.log(20) + point.gamma * (x - x.mean())
    fabric, person = design.fabric[design.condition], design.participant
    with mpmath.workdps(50):
        tau, omega_squared = mpmath.mpf(point.tau) ** 2, mpmath.mpf(point.omega) ** 2
        exact = mpmath.mpf(point.varsigma) ** 2 * mpmath.eye(12)
        for i, j in np.ndindex(12, 12):
            exact[i, j] += 9 + tau * bool(person[i] == person[j]) + omega_squared * bool(fabric[i] == fabric[j])
        residual = mpmath.matrix((np.log(ratings) - mean).tolist())
        quadratic = (residual.T * mpmath.lu_solve(exact, residual))[0]
        expected = -(12 * mpmath.log(2 * mpmath.pi) + mpmath.log(mpmath.det(exact)) + quadratic) / 2
    observed = LogRatings(ratings, design).log_likelihood(rate, point) + np.log(ratings).sum()
    assert observed == pytest.approx(float(expected), rel=1e-9)


def test_extreme_spreads_stay_numbers():
    ratings, design, rate = lab(np.random.default_rng(5))
    observed = LogRatings(ratings, design)
    for tau in (0.0, 1e-300, 1e100):
        for varsigma in (1e-300, 1e-8, 1e100):
            for omega in (0.0, 1e-200, 1e3):
                value = observed.log_likelihood(rate, rated(1.0, tau, varsigma, omega))
                assert np.isfinite(value)


@pytest.mark.parametrize("mu", [-1e4, -690.0, 690.0, 1e4])
def test_ratings_beyond_floating_point_are_held_at_its_ends(mu):
    rng = np.random.default_rng(6)
    parameters, design = rated(1.0, 0.5, 100.0), Design(np.arange(4), np.zeros(4, int), np.arange(4), 1)
    effects = DEFAULT.draw_effects(rng, parameters, (500,), 1, 4, {"mu": mu})
    drawn = DEFAULT.draw_ratings(rng, design, np.zeros((500, 4)), parameters, effects)
    for rating in (drawn, DEFAULT.typical(effects, np.zeros((500, 4)))):
        assert np.isfinite(rating).all()
        assert (rating > 0).all()
        np.testing.assert_allclose(np.median(np.log(rating)), np.clip(mu, -700, 700), atol=20)
    assert np.isfinite(LogRatings(drawn[0], design).log_likelihood(np.ones(4), parameters))


def test_drive_elsewhere_shares_the_centre_of_the_rows():
    _, design, rate = lab(np.random.default_rng(12))
    model, point = RatingModel(), rated(np.array([0.5, 2.0]), 0.5, 0.3)
    rates = np.stack([rate, 2 * rate])
    np.testing.assert_allclose(
        model.drive_at(rates[:, ::-1], design, rates, point), model.drive(design, rates, point)[:, ::-1]
    )
    rows = model.drive(design, rates, point)[:, design.condition]
    np.testing.assert_allclose(rows.mean(axis=1), 0, atol=1e-12)


@pytest.mark.parametrize(
    ("ratings", "message"),
    [
        ([1.0, 0.0], "not positive"),
        ([1.0, -2.0], "not positive"),
        ([np.nan, 1.0], "not positive"),
        ([1.0], "shape"),
    ],
)
def test_ratings_that_are_none_are_refused(ratings, message):
    with pytest.raises(InputError, match=message):
        LogRatings(ratings, Design([0, 0], [0, 0], [0], 1))


def test_designs_that_make_no_sense_are_refused():
    with pytest.raises(InputError, match="there are no ratings"):
        Design([], [], [0], 1)
    with pytest.raises(InputError, match="condition index lies outside 0 to 0"):
        Design([1], [0], [0], 1)
    with pytest.raises(InputError, match="participant index lies outside"):
        Design([0], [-1], [0], 1)
