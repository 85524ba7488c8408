"""Checks of raters' own noise and exponents: power, silence where raters are alike, and what is said."""

import numpy as np
import pytest

from softness_bayes.checking.exponents import check_exponents
from softness_bayes.checking.noise_check import NoiseCheck, check_noise
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.directions import RISES
from softness_bayes.likelihood.magnitude import LogRatings, RatingModel
from softness_bayes.likelihood.own_answers import OwnAnswersModel
from softness_bayes.likelihood.ratings import RatingParameters

RATERS, CONDITIONS, TABLES = 15, 16, 60
WHO = Design(
    np.tile(np.arange(CONDITIONS), RATERS), np.repeat(np.arange(RATERS), CONDITIONS), np.arange(CONDITIONS) // 2, RATERS
)


def shares(tau_gamma, tau_varsigma, differ=(), tables=TABLES):
    """Shares of tables in which differing noise, and differing exponents, are found."""
    found = []
    for seed in range(tables):
        rng = np.random.default_rng(seed)
        p = RatingParameters(
            *(np.full(1, v) for v in (1.0, 0.5, 0.3, 0.0, 0.1)), tau_gamma=tau_gamma, tau_varsigma=tau_varsigma
        )
        rate = np.exp(rng.normal(1.0, 0.8, (1, CONDITIONS)))
        truth = OwnAnswersModel(RISES, differ=("gamma", "varsigma"))
        effects = truth.draw_effects(rng, p, (1,), RATERS, WHO.n_fabrics)
        y = truth.draw_ratings(rng, WHO, truth.drive(WHO, rate, p), p, effects)[0]
        fitted = OwnAnswersModel(RISES, differ=differ).observe(y, WHO) if differ else LogRatings(y, WHO, RatingModel())
        given = fitted.draw_effects(rng, rate, p)
        found.append([check(fitted, rate, p, given).p_value < 0.05 for check in (check_noise, check_exponents)])
    return np.mean(found, axis=0)


def test_each_check_sees_its_own_kind():
    """Power at a spread of 0.4, and alarms where raters are alike: 5 % with parameters known."""
    noise, exponents = shares(0.0, 0.4)
    assert noise > 0.9
    assert noise - exponents > 0.3  # noise of one's own makes steep slopes by chance, which the other check may see
    noise, exponents = shares(0.3, 0.0)
    assert exponents > 0.9
    alike = shares(0.0, 0.0)
    assert (alike <= 0.15).all()


def test_a_model_of_it_silences_the_check():
    noise, exponents = shares(0.3, 0.4, ("gamma", "varsigma"), 40)
    assert noise <= 0.15
    assert exponents <= 0.15


@pytest.mark.slow
def test_power_over_many_tables():
    """400 tables: 5 % of alarms with raters alike; half of the tables show a spread of about 0.2."""
    assert (np.abs(shares(0.0, 0.0, tables=400) - 0.05) < 0.035).all()
    assert 0.4 < shares(0.0, 0.2, tables=400)[0] < 0.95
    assert shares(0.0, 0.4, tables=400)[0] > 0.97


def test_deviation_is_the_spread():
    rng = np.random.default_rng(1)
    sizes = np.exp(0.5 * rng.standard_normal(60))
    who = Design(np.tile(np.arange(30), 60), np.repeat(np.arange(60), 30), np.arange(30), 60)
    y = np.exp(3.0 + 0.2 * sizes[who.participant] * rng.standard_normal(1800))
    p = RatingParameters(*(np.full(1, v) for v in (1.0, 0.1, 0.2, 0.0, 0.1)))
    observed, rate = LogRatings(y, who, RatingModel()), np.ones((1, 30))
    found = check_noise(observed, rate, p, observed.draw_effects(rng, rate, p))
    assert abs(found.deviation - np.log(sizes).std()) < 0.1
    assert found.p_value < 1e-3


def test_it_says_what_to_do():
    assert "no evidence that raters' noise differs (p = 0.5)" in NoiseCheck(0.5, 0.0).sentence(False, True, False)
    doubt = NoiseCheck(0.001, 0.42).sentence(False, True, False)
    assert "by about 0.42" in doubt
    assert "--individual varsigma" in doubt
    assert "--errors student" in doubt
    assert "--errors" not in NoiseCheck(0.001, 0.42).sentence(False, True, True)
    assert "--individual" not in NoiseCheck(0.001, 0.42).sentence(False, False, False)
    assert "beyond what the model allows" in NoiseCheck(0.001, 0.42).sentence(True, True, False)
    one = Design([0, 1, 2, 0], [0, 0, 0, 1], [0, 1, 2], 2)
    observed, p = LogRatings([1.0, 2.0, 3.0, 4.0], one, RatingModel()), RatingParameters(*[np.ones(1)] * 5)
    rate = np.ones((1, 3))
    effects = observed.draw_effects(np.random.default_rng(0), rate, p)
    assert "cannot be compared" in check_noise(observed, rate, p, effects).sentence(False, True, False)
