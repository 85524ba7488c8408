"""Check of the standard deviations between raters: p-values under the model, and noise that depends on the cell."""

import numpy as np
import pytest
from scipy.stats import kstest

from softness_bayes.checking.spread_check import SpreadCheck, check_spreads
from softness_bayes.likelihood.contract import NO_RESPONSE
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.ratings import RatingParameters
from softness_bayes.likelihood.spreads import RaterSpreads, SpreadModel

CELLS, RATERS, DRAWS = 20, 12, 40
DESIGN = Design(np.arange(CELLS), np.zeros(CELLS, int), np.arange(CELLS), 1)
TRUE = RatingParameters(0.8, 0.5, 0.3)


def deviations(rng, noise=0.3, raters=RATERS):
    """Standard deviations of the log ratings of one panel in every cell, from the ratings themselves."""
    log = 0.5 * rng.standard_normal((raters, 1)) + noise * rng.standard_normal((raters, CELLS))
    return log.std(axis=0, ddof=1)


def checked(rng, values, parameters=TRUE):
    term = RaterSpreads(values, DESIGN, SpreadModel(RATERS))
    drawn = RatingParameters(*(np.broadcast_to(np.asarray(v, float), DRAWS) for v in parameters))
    return check_spreads(term, np.broadcast_to(NO_RESPONSE, (DRAWS, 0)), drawn, rng)


def test_p_values_are_uniform_under_the_model():
    """At the true parameters, the panel's scatter being drawn given its deviations."""
    rng = np.random.default_rng(3)
    found = [checked(rng, deviations(rng)).p_value for _ in range(120)]
    assert kstest(found, "uniform").pvalue > 0.01


@pytest.mark.parametrize("kind", ["noise grows from cell to cell", "half of the cells have fewer raters"])
def test_cells_that_differ_are_noticed(kind):
    rng = np.random.default_rng(4)
    few = np.arange(CELLS) % 2 == 0

    def made():
        if kind.startswith("noise"):
            return deviations(rng, np.geomspace(0.1, 0.9, CELLS))
        return np.where(few, deviations(rng, raters=3), deviations(rng))

    found = [checked(rng, made()) for _ in range(20)]
    assert np.mean([one.p_value < 0.01 for one in found]) > 0.9
    assert np.mean([one.spread for one in found]) > 1.3
    assert "noise may depend on the fabric" in found[0].sentence


def test_what_is_allowed_is_said():
    assert SpreadCheck(0.4, 1.0).sentence == (
        "spreads: the cells' standard deviations differ no more than the model allows (p = 0.4)"
    )
