"""Raters whose answers are all in the same open interval: the exactness check must see the error of the integrals."""

import numpy as np
import pytest
from scipy.special import log_ndtr

from softness_bayes.likelihood.categories import CategoryModel
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.ratings import RatingParameters

DESIGN = Design(np.tile(np.arange(6), 3), np.repeat(np.arange(3), 6), np.arange(6), 3)
RATE = np.geomspace(1.0, 40.0, 6)[None]


def parameters(varsigma):
    values = {"gamma": 1.0, "tau": 0.6, "varsigma": varsigma, "eps": 0.1, "gap_2": 1.0, "gap_3": 1.0}
    return CategoryModel(categories=4).take({name: np.array([value]) for name, value in values.items()})


def by_force(observed, given: RatingParameters):
    """The probability that every answer lies in the first category, whose upper end is 0, by sums over mu and zeta."""
    level = observed.model.level
    mu = np.linspace(-8.0, 8.0, 1601)
    zeta = np.linspace(-8.0, 8.0, 1601)
    weight = np.exp(-0.5 * mu**2) / np.exp(-0.5 * mu**2).sum()
    drive = observed.drive(RATE, given)[0]
    a = level.mean + level.sd * mu[:, None] + given.tau[0] * zeta
    log = sum(log_ndtr(-(a + one) / given.varsigma[0]) for one in drive)
    return np.log(((np.exp(log) @ weight) ** 3) @ weight)


@pytest.mark.parametrize("varsigma", [0.5, 0.05])
def test_the_finer_integrals_are_those_by_force(varsigma):
    observed = CategoryModel(categories=4).observe(np.ones(18), DESIGN)
    given = parameters(varsigma)
    expected = by_force(observed, given)
    assert abs(observed.finer().log_likelihood(RATE, given)[0] - expected) < 2e-3
    error = abs(observed.log_likelihood(RATE, given)[0] - expected)
    # the known error of the fast integrals, which the finer ones must reveal
    assert error > 0.1 if varsigma < 0.1 else error < 1.0


def test_other_tables_are_compared_with_expansions():
    values = np.tile([1.0, 1.0, 2.0, 2.0, 3.0, 4.0], 3)
    observed = CategoryModel(categories=4).observe(values, DESIGN)
    assert observed.finer()._quadrature.points > 0
