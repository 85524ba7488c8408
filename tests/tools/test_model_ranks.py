"""Calibration of every observation model: a few laboratories of each, and what is kept of many."""

import csv

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import norm

from softness_bayes.checking.ranks import Calibration
from softness_bayes.tools.model_ranks import (
    CASES,
    COLUMNS,
    RIGHT,
    calibrations,
    judged,
    laboratory,
    names_of_fits,
    ranked,
)
from support.paths import ROOT

FOLDER = ROOT / "notebooks" / "results" / "model_ranks"

PARAMETERS = ("b", "gamma", "tau", "varsigma", "eps", "nu", "lapse", "tau_gamma", "tau_varsigma")


QUICK = 15
"""Number of a laboratory whose fits are quick in every model."""


def kept():
    with (FOLDER / "ranks.csv").open(encoding="utf-8", newline="") as file:
        return [*csv.DictReader(file)]


@pytest.mark.parametrize("model", CASES)
def test_a_few_laboratories_are_ranked_as_those_kept(model):
    """Ranks depend on the last digits only by the few draws that change their order."""
    old = {int(row["lab"]): row for row in kept() if row["case"] == f"{model} / {RIGHT}"}
    (row,) = ranked(QUICK, f"{model} / {RIGHT}")
    for name in PARAMETERS:
        assert (name in row) == bool(old[QUICK][name]), name
        assert abs(int(row.get(name, 0)) - int(old[QUICK][name] or 0)) <= 25, name


def test_few_laboratories_show_the_wrong_sign():
    """Negative control: the exponent of pairs fitted with the opposite sign."""
    case = "pairs / ratings fall where they rise"
    rows = [row for number in range(6) for row in ranked(number, case)]
    assert Calibration(("log_likelihood",), np.array([[row["log_likelihood"]] for row in rows])).faults()


OWN = "raters' own varsigma"
DEVIATING = "fabrics' deviations, normal"


def test_deviations_that_are_ignored_count_as_noise():
    """Negative control: all draws of the noise lie above the true value; and the right fit ranks deviations too."""
    for number in (0, 7):
        (row,) = ranked(number, f"{DEVIATING} / deviations ignored")
        assert row["varsigma"] == 0
    (right,) = ranked(QUICK, f"{DEVIATING} / {RIGHT}")
    assert {"omega", "fabric_effect", "fabric_spread"} <= {*right}


def test_the_kept_fits_show_every_mistake_and_no_right_model_gives_an_alarm():
    rows = kept()
    assert [*rows[0]] == [*COLUMNS]
    found = calibrations(rows)
    assert {*found} == {*names_of_fits()}
    for case, calibration in found.items():
        if case.endswith(f" / {RIGHT}"):
            assert not calibration.fault_of(), case
            assert len(calibration.rank) >= 200, case
        else:
            assert calibration.faults(), case
            assert len(calibration.rank) >= 10, case


@pytest.mark.parametrize(
    ("model", "first", "least"),
    [(OWN, 1000, 180), (OWN, 2000, 180), (OWN, 3000, 600), ("whole numbers, lapses", 1000, 150)],
)
def test_laboratories_added_because_of_an_alarm_give_none(model, first, least):
    rows = [row for row in kept() if row["case"] == f"{model} / {RIGHT}" and first <= int(row["lab"]) < first + 1000]
    (found,) = calibrations(rows).values()
    assert len(found.rank) >= least
    assert not found.faults()


@pytest.mark.parametrize("number", [25, *(pytest.param(one, marks=pytest.mark.slow) for one in (77, 1041))])
def test_noise_of_raters_is_integrated_where_its_spread_has_an_extreme_rank(number):
    """By sums over dense grids of raters' log noise and of the level, at the true values."""
    made, theta, _ = laboratory(OWN, number)
    observed, true = made.observation, dict(zip(made.names, theta, strict=True))
    drive = observed.drive(made.response(theta[None]), made.rating_parameters(theta[None]))[0]
    left = np.log(observed.values) - drive[observed.design.condition]
    w, tau = np.linspace(-9.0, 9.0, 1201), true["tau"]
    variance = np.square(true["varsigma"] * np.exp(true["tau_varsigma"] * w))
    level = np.linspace(-9.0, 15.0, 6001)
    joint = norm.logpdf(level, np.log(20.0), 3.0) + np.log(level[1] - level[0])
    for rater in range(observed.design.n_participants):
        own = left[observed.design.participant == rater]
        n, squares = own.size, np.square(own - own.mean()).sum()
        between = variance + n * tau**2
        constant = -0.5 * (squares / variance + (n - 1) * np.log(variance) + np.log(between) + n * np.log(2.0 * np.pi))
        constant += norm.logpdf(w) + np.log(w[1] - w[0])
        joint += [logsumexp(constant - 0.5 * n * (own.mean() - mu) ** 2 / between) for mu in level]
    expected = logsumexp(joint) - np.log(observed.values).sum()
    assert made.log_likelihood(theta[None])[0] == pytest.approx(expected, abs=1e-4)


def test_the_kept_verdicts_are_those_of_the_kept_ranks():
    with (FOLDER / "verdicts.csv").open(encoding="utf-8", newline="") as file:
        verdicts = {f"{row['model']} / {row['fit']}": row for row in csv.DictReader(file)}
    some = [row for row in kept() if row["case"] == "ranks / noise 3 times too small"]
    (found,) = judged(some)
    old = verdicts["ranks / noise 3 times too small"]
    assert {name: str(value) for name, value in found.items()} == {name: old[name] for name in found}
    assert {*verdicts} == {*names_of_fits()}
