"""What another eps would change: weights and first derivative against a law whose answer is known."""

import numpy as np
import pytest

from softness_bayes.inference.curves import Inflection, Outcome
from softness_bayes.inference.observation import RatingParameters
from softness_bayes.silence import FACTORS, INTERIOR, PLACE, Weights, eps_sentence, eps_table

DRAWS = 4000


class Leaning:
    """Ratings of which x is N(slope ln(eps / 0.1), 1) a posteriori."""

    def __init__(self, slope):
        self.slope = slope

    def log_likelihood(self, mean_rate, parameters):
        return -0.5 * (mean_rate[:, 0] - self.slope * np.log(parameters.eps / 0.1)) ** 2


def table_of(slope, rng):
    x = rng.standard_normal(DRAWS)
    indifferent = rng.standard_normal(DRAWS)
    outcome = np.where(np.stack([x > 0, x < 9], axis=1), Outcome.INTERIOR, Outcome.NONE)
    modulus = np.where(outcome == Outcome.INTERIOR, 1e5 * np.exp(0.1 * x)[:, None], np.nan)
    modulus[:, 1] = np.nan
    turn = Inflection(outcome, modulus, *(np.full((DRAWS, 2), np.nan),) * 3, np.zeros((DRAWS, 2), bool))
    parameters = RatingParameters(1.0, 1.0, 1.0, eps=0.1)
    named = {"b": x, "m": indifferent, "held": np.ones(DRAWS)}
    return eps_table(Leaning(slope), x[:, None], parameters, named, turn, ["1 mm", "2 mm"])


def test_shifts_are_those_of_the_posterior_under_the_other_eps(rng):
    table = table_of(0.4, rng)
    assert table["usable"].all()
    for factor in FACTORS:
        rows = table.loc[0.1 * factor]
        assert rows.loc["b", "shift"] == pytest.approx(0.4 * np.log(factor), abs=0.08)
        assert abs(rows.loc["m", "shift"]) < 0.1
        assert rows.loc["held", "shift"] == 0
    # the probability of x > 0 under N(d, 1), and the effective number of draws, exp(-d²) of them
    moved, d = table.loc[0.4], 0.4 * np.log(4)
    assert moved.loc[INTERIOR + "1 mm", "other_mean"] == pytest.approx(0.7104, abs=0.03)
    assert moved.loc[INTERIOR + "1 mm", "shift"] == pytest.approx(0.2104, abs=0.03)
    assert moved["ess"].iloc[0] == pytest.approx(DRAWS * np.exp(-(d**2)), rel=0.1)
    assert moved.loc[PLACE + "1 mm", "shift"] > 0
    assert np.isnan(moved.loc[PLACE + "2 mm", "shift"])
    said = eps_sentence(table)
    assert "moves means by up to" in said
    assert "(b)" in said
    assert "uneven" not in said


def test_what_weights_cannot_reach_is_said_and_the_derivative_remains(rng):
    table = table_of(9.0, rng)
    assert not table["usable"].any()
    assert table["per_doubling"].loc[0.2, "b"] == pytest.approx(9.0 * np.log(2), rel=0.05)
    assert abs(table["per_doubling"].loc[0.2, "m"]) < 0.5
    said = eps_sentence(table)
    assert "too uneven" in said
    assert "--fix eps" in said
    assert "doubling it" in said


def test_a_response_that_is_never_silent_feels_no_eps(rng):
    table = table_of(0.0, rng)
    np.testing.assert_allclose(table["shift"].dropna(), 0.0, atol=1e-12)
    np.testing.assert_allclose(table["ess"], DRAWS)
    assert Weights.of(np.zeros(100)).ess == pytest.approx(100)
