"""The check for deviations between fabrics: uniform under its model, and not under any other."""

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from softness_bayes.inference.checks import NEEDED, FabricCheck, check_fabrics
from softness_bayes.inference.design import Design
from softness_bayes.inference.observation import LogRatings, RatingModel, RatingParameters
from softness_bayes.inference.random_effects import Effects

MODEL = RatingModel()
FABRICS, LOADS = 6, 2
RATE = np.array([0.0, 0.3, 1.2, 2.0, 2.4, 2.1, 0.0, 1.0, 1.9, 2.5, 2.3, 1.8])
PLAIN = RatingParameters(0.9, 0.6, 0.3)
DEVIATING = PLAIN._replace(omega=0.2)


def design(participants=15):
    conditions = FABRICS * LOADS
    return Design(
        np.tile(np.arange(conditions), participants),
        np.repeat(np.arange(participants), conditions),
        np.tile(np.arange(FABRICS), LOADS),
        participants,
    )


def simulate(rng, truth, layout):
    """Ratings of new participants and new fabrics, as the model makes them."""
    effects = MODEL.draw_effects(rng, truth, (), layout.n_participants, layout.n_fabrics)
    return LogRatings(MODEL.draw_ratings(rng, layout, MODEL.drive(layout, RATE, truth), truth, effects), layout, MODEL)


def check(rng, observation, assumed, draws=1):
    """Check a data set at draws of the effects given the parameters that are assumed."""
    rate = np.broadcast_to(RATE, (draws, RATE.size))
    parameters = RatingParameters(*(np.full(draws, value) for value in assumed))
    return check_fabrics(observation, rate, parameters, observation.draw_effects(rng, rate, parameters))


def p_values(rng, truth, assumed, sets=150):
    """One p-value for each of many data sets; of a single draw each, which the theory makes uniform."""
    layout = design()
    return np.array([check(rng, simulate(rng, truth, layout), assumed).p_value for _ in range(sets)])


def off_uniform(values):
    return kstest(values, "uniform").pvalue


@pytest.mark.parametrize("truth", [PLAIN, DEVIATING], ids=["plain", "with an effect per fabric"])
def test_p_is_uniform_under_the_model(rng, truth):
    assert off_uniform(p_values(rng, truth, truth)) > 1e-3


@pytest.mark.parametrize(
    ("truth", "assumed"),
    [
        (DEVIATING, PLAIN),
        (PLAIN._replace(varsigma=0.6), PLAIN),  # noise understated
        (PLAIN._replace(varsigma=0.15), PLAIN),  # noise overstated
        (PLAIN, PLAIN._replace(gamma=1.4)),
    ],
    ids=["fabrics deviate", "noise too small", "noise too large", "another exponent"],
)
def test_p_is_not_uniform_under_another_model(rng, truth, assumed):
    assert off_uniform(p_values(rng, truth, assumed)) < 1e-6


def test_real_deviations_are_found_and_measured(rng):
    layout, shifts = design(30), 0.2 * np.array([1, -1, 1, -1, 1, -1])
    quiet = simulate(rng, PLAIN, layout)
    loud = LogRatings(quiet.ratings * np.exp(shifts[layout.fabric[layout.condition]]), layout, MODEL)
    assert check(rng, quiet, PLAIN, 400).p_value > NEEDED
    assert check(rng, quiet, PLAIN, 400).deviation < 0.06
    found = check(rng, loud, PLAIN, 400)
    assert found.p_value < 1e-4
    assert found.deviation == pytest.approx(0.2, abs=0.05)
    # with the effects in the model nothing is left to explain
    left = check(rng, loud, DEVIATING, 400)
    assert left.p_value > NEEDED
    assert left.deviation < 0.06


def test_p_is_what_the_definition_says(rng):
    """Written out row by row, for an unbalanced design in which a fabric has no rating."""
    rows, fabric = 40, np.array([0, 1, 3, 3])
    layout = Design(rng.integers(4, size=rows), rng.integers(3, size=rows), fabric, 3)
    ratings = rng.lognormal(3, 1, rows)
    rate, draws = rng.gamma(2, 1, (5, 4)), 5
    parameters = RatingParameters(*rng.uniform(0.5, 1.5, (5, draws)))
    effects = Effects(rng.normal(3, 1, draws), rng.normal(size=(draws, 3)), rng.normal(size=(draws, 4)))
    expected, excess = [], []
    for d in range(draws):
        gamma, varsigma, eps = (float(getattr(parameters, n)[d]) for n in ("gamma", "varsigma", "eps"))
        x = np.log(rate[d] + eps)
        centre = np.mean([x[c] for c in layout.condition])
        residual: dict[int, list[float]] = {}
        for i in range(rows):
            c, p = layout.condition[i], layout.participant[i]
            mean = effects.mu[d] + gamma * (x[c] - centre) + effects.participant[d, p]
            residual.setdefault(fabric[c], []).append(np.log(ratings[i]) - mean - effects.fabric[d, fabric[c]])
        between = sum(len(r) * np.mean(r) ** 2 for r in residual.values())
        expected.append(chi2.sf(between / varsigma**2, len(residual)))
        excess.append((between / len(residual) - varsigma**2) / (rows / len(residual)))
    found = check_fabrics(LogRatings(ratings, layout, MODEL), rate, parameters, effects)
    assert found.p_value == pytest.approx(np.mean(expected), rel=1e-9)
    assert found.deviation == pytest.approx(np.sqrt(max(np.median(excess), 0)), rel=1e-9)


def test_the_sentence_says_what_to_do():
    needed = FabricCheck(0.001, 0.21).sentence
    assert "0.21" in needed
    assert "--prior omega='halfnormal(0.5)'" in needed
    assert "--prior" not in FabricCheck(0.4, 0.0).sentence
