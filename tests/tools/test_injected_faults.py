"""Every injected fault is found by the check that is named for it, and controls are not."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from scipy.stats import kstest, loggamma, norm

from softness_bayes.errors import NumericalError
from softness_bayes.tools import injected_faults as injected
from support.paths import ROOT

QUICK = 60


def cases():
    """Every fault, slow if its ranks need many replicates."""
    for one in injected.FAULTS:
        long = one.replicates > QUICK and one.check != injected.WALK
        yield pytest.param(one, id=one.what, marks=[pytest.mark.slow] * long)


@pytest.mark.parametrize("fault", list(cases()))
def test_a_fault_is_found(fault):
    assert fault.found()


@pytest.mark.parametrize("control", injected.CONTROLS, ids=lambda one: f"{one.what}: {one.check}")
def test_a_control_is_not(control):
    assert not control._replace(replicates=QUICK).found()


@pytest.mark.slow
@pytest.mark.parametrize("check", [injected.MANY, injected.FEW])
def test_nor_in_as_many_replicates_as_any_fault_needs(check):
    for control in injected.CONTROLS:
        if control.check == check:
            assert not control.found()


def test_patches_end_with_the_check():
    before = {name: injected.RandomEffects.__dict__[name] for name in ("_quadratic", "log_density")}
    fault = injected.FAULTS[0]
    assert fault._replace(replicates=2).found() == ""  # two ranks tell nothing
    assert {name: injected.RandomEffects.__dict__[name] for name in before} == before


def test_draws_on_grids_are_of_the_density(rng):
    """Of a narrow, correlated law in a wide box, against its closed form."""

    def density(z):
        return norm.logpdf(z[:, 0], 0.3, 0.03) + loggamma.logpdf(z[:, 1] - 5.0 * (z[:, 0] - 0.3), 2.0)

    draws = np.concatenate(
        [injected.on_grid(density, np.array([-9.0, -9.0]), np.array([9.0, 9.0]), rng) for _ in range(9)]
    )
    assert kstest(draws[:, 0], norm(0.3, 0.03).cdf).pvalue > 1e-3
    assert kstest(draws[:, 1] - 5.0 * (draws[:, 0] - 0.3), loggamma(2.0).cdf).pvalue > 1e-3
    with pytest.raises(NumericalError, match="could not be computed"):
        injected.on_grid(lambda z: np.full(len(z), np.nan), np.zeros(2), np.ones(2), rng)


def test_the_kept_table_is_of_these_faults():
    with (ROOT / injected.TABLE).open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["fault"], row["check"]) for row in rows] == [
        (one.what, one.check) for one in (*injected.FAULTS, *injected.CONTROLS)
    ]
    found = [row["found"] != "nothing" for row in rows]
    assert found == [True] * len(injected.FAULTS) + [False] * len(injected.CONTROLS)
    assert len(injected.FAULTS) >= 12
