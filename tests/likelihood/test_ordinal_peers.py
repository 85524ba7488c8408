"""Categories and pairs against outside code for the same predictors: statsmodels and psignifit."""

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import norm

from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.error_laws import LAPSES
from softness_bayes.likelihood.intervals import CategoryModel
from softness_bayes.likelihood.orders import PairModel, PairRatings
from support.points import rated

STORED = json.loads((Path(__file__).parents[1] / "reference" / "ordinal.json").read_text())
EPS = 0.1
SURE = 1e-5
"""Standard deviation of a prior that stands for a known mu."""


def ordered(point):
    """The likelihood of one rater's categories, mean rates and parameters where mu is known and tau is 0."""
    x, category = (np.array(STORED["categories"][name]) for name in ("x", "category"))
    rates, condition = np.unique(np.exp(x) - EPS, return_inverse=True)
    design = Design(condition, np.zeros(x.size, int), np.arange(rates.size), 1)
    gaps = {f"gap_{k}": np.float64(gap) for k, gap in enumerate(np.diff(point["ends"]), start=2)}
    at = rated(point["gamma"], 0.0, point["varsigma"], 0.0, EPS, **gaps)
    model = CategoryModel(centre=np.exp(point["mu"]), spread=SURE, categories=1 + len(point["ends"]))
    observed = model.observe(category.astype(float), design)
    return observed, rates, at.each(lambda value: np.float64(value))


@pytest.mark.parametrize("point", STORED["categories"]["points"])
def test_categories_have_the_probabilities_of_an_ordered_probit(point):
    observed, rates, parameters = ordered(point)
    assert_allclose(observed.log_likelihood(rates, parameters), point["log_likelihood"], rtol=1e-7)
    assert_allclose(observed.left_out(rates, parameters).log_density, point["each"], rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("point", STORED["pairs"]["points"])
def test_pairs_have_the_chances_of_a_psychometric_function(point):
    """Guesses are lapses of which half are right: both asymptotes of the outside function are half their share."""
    difference = np.array(STORED["pairs"]["difference"])
    rates = np.append(np.exp(difference), 1.0)
    pairs = np.stack([np.arange(difference.size), np.full(difference.size, difference.size)], axis=1)
    design = Design(pairs.ravel(), np.zeros(pairs.size, int), np.arange(rates.size), 1)
    answers = np.tile([1.0, 0.0], difference.size)
    observed = PairRatings(answers, design, PairModel(law=LAPSES), lists=np.repeat(np.arange(difference.size), 2))
    at = rated(1.0, 0.0, point["unit"] / np.sqrt(2.0), 0.0, 0.0, lapse=point["lapse"])
    found = observed.log_likelihood_answers(rates, at.each(lambda value: np.float64(value)))
    assert_allclose(np.exp(found), point["chance"], rtol=1e-9)


@pytest.mark.slow
def test_stored_values_are_those_of_the_outside_code():
    """Needs statsmodels and psignifit, which nothing else here does."""
    ordinal = pytest.importorskip("statsmodels.miscmodels.ordinal_model")
    sigmoids = pytest.importorskip("psignifit.sigmoids")
    x, category = (np.array(STORED["categories"][name]) for name in ("x", "category"))
    model = ordinal.OrderedModel(category, x[:, None], distr="probit")
    for point in STORED["categories"]["points"]:
        slope, ends = point["gamma"] / point["varsigma"], np.array(point["ends"])
        cut = (ends + point["gamma"] * x.mean() - point["mu"]) / point["varsigma"]
        params = np.r_[slope, cut[0], np.log(np.diff(cut))]
        assert_allclose(model.loglikeobs(params), point["each"], rtol=1e-10)
    for point in STORED["pairs"]["points"]:
        width, half = 2.0 * norm.ppf(0.95) * point["unit"], 0.5 * point["lapse"]
        chance = [sigmoids.Gaussian()(d, 0.0, width, half, half) for d in STORED["pairs"]["difference"]]
        assert_allclose(chance, point["chance"], rtol=1e-10)
