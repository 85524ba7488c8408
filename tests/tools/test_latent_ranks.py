"""Ranks of true values where inputs are uncertain: kept ones, and a few made anew."""

import numpy as np
import pytest

from softness_bayes.tools.coverage import rows_of
from softness_bayes.tools.importance import TRUSTED
from softness_bayes.tools.latent_labs import KINDS, LOADS, RATERS, laboratory, model_of
from softness_bayes.tools.latent_ranks import CONTROL, HOW, calibration_of, fitted, table
from support.paths import ROOT

RESULTS = ROOT / "notebooks" / "results" / "latent_ranks"
PAGE = ROOT / "softness_bayes" / "docs" / "calibration.md"


def far(rows):
    """Return the share of true moduli in the outer tenth of their ranks, which is a tenth if all is right."""
    ranks = np.array([[rank for name, rank in row.items() if name.startswith("fabric_modulus")] for row in rows])
    return ((ranks < 5) | (ranks >= 95)).mean()


def test_the_page_has_the_table_of_the_kept_ranks():
    text = PAGE.read_text(encoding="utf-8")
    for line in table(RESULTS):
        assert line in text


@pytest.mark.parametrize("name", KINDS)
def test_kept_ranks_are_uniform_and_those_of_the_control_are_not(name):
    rows, control = (rows_of(RESULTS / f"{name}{end}.csv") for end in ("", f"_{CONTROL}"))
    if not (rows and control):
        pytest.skip("no ranks of this kind are kept")
    assert np.mean([float(row["k"]) > TRUSTED for row in rows]) < 0.05
    found = calibration_of(rows)
    assert not found.faults()
    assert calibration_of(control).faults()
    inside = [float(row["share"]) for row in found.coverage() if row["mass"] == 0.9]
    assert len(inside) == len(found.names)
    assert len(rows) >= 200
    assert 0.845 < min(inside) <= max(inside) < 0.955  # of 200, with a standard error of 0.02


def test_ranks_made_anew_are_even_and_those_of_the_control_are_not():
    """Where the true errors are twice those declared, 41 % of the moduli that ratings do not inform lie far out."""
    kind = KINDS["moduli"]
    right, wrong = ([fitted(kind, number, control) for number in range(300, 306)] for control in (False, True))
    assert {*HOW} < {*right[0]}
    assert all(row["k"] < TRUSTED for row in (*right, *wrong))
    assert far(right) < 0.25 < far(wrong)


@pytest.mark.parametrize("name", ["plates", "shared_loads", "unknown"])
def test_laboratories_are_those_of_the_model(name):
    """With the true effects, residuals of simulated ratings have the true scatter."""
    kind = KINDS[name]
    model = model_of(kind)
    made = laboratory(kind, model, 3, control=False)
    posterior = made.posterior(model.posterior)
    theta = np.repeat(made.theta[None], 40, axis=0)
    rate, parameters = posterior.response(theta), posterior.rating_parameters(theta)
    observation = posterior.observation
    effects = observation.draw_effects(np.random.default_rng(1), rate, parameters)
    residual = observation.residual(rate, parameters, effects)
    assert residual.shape[-1] == RATERS * len(LOADS) * 8
    assert residual.std() == pytest.approx(made.start["varsigma"], rel=0.12)
    for take, true in made.effects.values():
        assert abs(take(effects).mean() - true) < 5 * take(effects).std()


def test_an_exponent_that_would_be_negative_is_zero():
    """Some raters of this laboratory would have an own m below 0, where the model has skin that does not stiffen."""
    kind = KINDS["own_m"]
    model = model_of(kind)
    made = laboratory(kind, model, 3, control=False)
    assert made.start["m"] < made.start["tau_m"]
    assert np.isfinite(made.posterior(model.posterior).log_likelihood(made.theta[None])).all()
