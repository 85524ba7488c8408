"""Standardised ratings against integration by quadrature, dense normal laws and their own simulations."""

import dataclasses
import functools
import json
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import integrate
from scipy.stats import halfnorm, multivariate_normal

from softness_bayes.base.errors import InputError
from softness_bayes.data import Experiment, Fabrics, Ratings
from softness_bayes.likelihood.contract import Parameters
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.models import rating_model
from softness_bayes.likelihood.scales import (
    AGGREGATED,
    CATEGORIES,
    FALLS,
    MAGNITUDE,
    PAIRS,
    RANKS,
    RATING_DIRECTIONS,
    RATING_SCALES,
    RISES,
    STANDARDISED,
)
from softness_bayes.likelihood.z_scores import StandardisedModel, StandardisedRatings
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.plotting.figures import FIGURES
from softness_bayes.plotting.rating import observed_ratings
from softness_bayes.plotting.style import USUAL
from softness_bayes.runs.run import sample
from softness_bayes.sampler.sampling import Settings
from softness_bayes.touch.contact import Indentation
from softness_bayes.touch.readings import MENDED
from softness_bayes.touch.scene import Discretisation
from support.command_line import call, refused
from support.paths import DATA
from support.report_runs import COARSE


def error(varsigma):
    """Parameters of which the model has varsigma alone: the others are not numbers, so that their use shows."""
    return Parameters(varsigma=varsigma)


def lab(rng, rows=20, conditions=6, slope=0.7):
    """Unbalanced ratings, with mean rates some of which are zero."""
    design = Design(rng.integers(conditions, size=rows), rng.integers(4, size=rows), np.arange(conditions) % 3, 4)
    rate = rng.gamma(1, 10, conditions) * (rng.random(conditions) > 0.2)
    x = rate[design.condition]
    ratings = slope * (x - x.mean()) / max(x.std(), 1e-9) + 0.5 * rng.standard_normal(rows)
    return ratings, design, rate


def standardised(rate, design):
    """x of every row, by its definition."""
    x = rate[design.condition]
    return (x - x.mean()) / x.std() if x.std() > 0 else np.zeros_like(x)


def evidence(y, x, varsigma, sign):
    """log p(y) with c0 integrated out by a dense normal law and c1 by quadrature."""
    covariance = 1.0 + varsigma**2 * np.eye(y.size)
    law = multivariate_normal(np.zeros(y.size), covariance)

    def log_joint(c1):
        return law.logpdf(y - sign * c1 * x) + halfnorm.logpdf(c1)

    grid = np.linspace(0, 6, 601)
    best = max(grid, key=log_joint)
    peak = log_joint(best)
    edges = [0.0, *sorted({max(best - 0.5, 0.01), max(best, 0.02), best + 0.5}), 12.0]
    parts = [
        integrate.quad(lambda c: np.exp(log_joint(c) - peak), a, b, epsabs=0, epsrel=1e-11, limit=200)[0]
        for a, b in pairwise(edges)
    ]
    return peak + np.log(sum(parts))


@pytest.mark.parametrize("direction", RATING_DIRECTIONS.values(), ids=RATING_DIRECTIONS)
@pytest.mark.parametrize(
    ("varsigma", "made"),
    [
        *((0.5, {"slope": 0.7}), (0.5, {"slope": -1.0}), (2.0, {"slope": 0.0}), (0.05, {"slope": 1.5})),
        *((0.4, {"rows": rows, "conditions": conditions}) for rows, conditions in ((1, 1), (1, 3), (2, 2), (9, 1))),
    ],
)
def test_likelihood_is_the_integral_over_the_line(direction, varsigma, made):
    """Also of hardly any ratings, and where the slope has the wrong sign, in the tail of the line's prior."""
    ratings, design, rate = lab(np.random.default_rng(1), **made)
    observed = StandardisedRatings(ratings, design, StandardisedModel(direction))
    expected = evidence(ratings, standardised(rate, design), varsigma, direction.sign)
    assert observed.log_likelihood(rate, error(varsigma)) == pytest.approx(expected, rel=1e-8)


def test_a_response_that_does_not_vary_says_nothing():
    ratings, design, _ = lab(np.random.default_rng(3))
    observed = StandardisedRatings(ratings, design)
    covariance = 1.0 + 0.09 * np.eye(design.n_rows)
    expected = multivariate_normal(np.zeros(design.n_rows), covariance).logpdf(ratings)
    # silent everywhere, and the same everywhere but for rounding
    for rate in (np.zeros(6), 17.3 * (1 + 1e-15 * np.arange(6))):
        assert observed.log_likelihood(rate, error(0.3)) == pytest.approx(expected, rel=1e-10)


def test_drive_elsewhere_is_on_the_scale_of_the_rows(rng):
    _, design, rate = lab(rng)
    rates = np.stack([rate, 3 * rate + 1])
    model = StandardisedModel()
    at_rows = model.drive(design, rates, error(0.3))
    assert_allclose(at_rows[0], at_rows[1], atol=1e-12)  # neither gain nor offset of the response is seen
    assert_allclose(model.drive_at(rates[:, ::-1], design, rates, error(0.3)), at_rows[:, ::-1], atol=1e-12)


def test_what_cannot_be_z_scores_is_refused():
    design = Design([0, 0], [0, 0], [0], 1)
    for ratings, message in (([np.inf, 1.0], "not finite"), ([1.0], "shape")):
        with pytest.raises(InputError, match=message):
            StandardisedRatings(ratings, design)


# from the data to the posterior

CLOTH = Fabrics(("felt", "lawn", "drill", "gauze", "voile"), effective_modulus=np.array([8e4, 2e4, 4e5, 2e5, 5e4]))
CHAIN = ("b", "m", "alpha", "beta", "sigma_0", "c_Na", "c_K", "c_L", "c_A")
LOADS = (Indentation(1.5e-3), Indentation(2.5e-3))


@pytest.fixture(scope="module")
def values():
    return usual_values(MENDED, given={"sigma_0": 7.0, "varsigma": 0.4})


def simulated(values, direction=RISES, **options):
    rng = np.random.default_rng(5)
    made = simulate_ratings(rng, CLOTH, LOADS, values, direction=direction, scale=STANDARDISED, **options)
    return made, Experiment(made.ratings, CLOTH, ())


def test_the_model_of_z_scores_has_neither_exponent_nor_participants(values):
    _, experiment = simulated(values, participants=3)
    posterior = build(experiment, ModelOptions(scale=STANDARDISED, discretisation=Discretisation())).posterior
    assert posterior.names == (*CHAIN, "varsigma")
    assert not {"gamma", "tau", "omega", "eps"} & {*posterior.space.held}
    with pytest.raises(InputError, match="gamma: the model of these data has no such parameter"):
        build(experiment, ModelOptions(scale=STANDARDISED, fix={"gamma": 1.0}, discretisation=Discretisation()))


def test_the_scale_is_checked_against_the_data(values):
    _, experiment = simulated(values, participants=3)
    with pytest.raises(InputError, match="--ratings standardised"):
        build(experiment, ModelOptions(discretisation=Discretisation()))
    raw = dataclasses.replace(experiment.ratings, rating=20 + 5 * experiment.ratings.rating, source="my.csv")
    with pytest.raises(InputError, match=r"my\.csv: column 'rating': expected standardised ratings.*got mean 19\.6"):
        build(experiment._replace(ratings=raw), ModelOptions(scale=STANDARDISED, discretisation=Discretisation()))


def test_names_of_scales_and_what_suits_them(values):
    assert [*RATING_SCALES] == ["magnitude", "standardised", "slider", "categories", "ranks", "pairs", "aggregated"]
    for options in ({"mu": 2.0}, {"slope": -1.0}, {"slope": np.nan}):
        with pytest.raises(InputError, match="simulate: "):
            simulated(values, participants=2, **options)
    with pytest.raises(InputError, match="slope is 1"):
        simulate_ratings(np.random.default_rng(1), CLOTH, LOADS, values, slope=1.0)
    assert isinstance(simulated(values, participants=2)[0].ratings, Ratings)


# from end to end


# each scale with one direction, and those with a closed form, which are fast, with the other one too
MADE_FROM = [*((scale, FALLS) for scale in RATING_SCALES.values()), (MAGNITUDE, RISES), (STANDARDISED, RISES)]


@pytest.mark.parametrize(
    ("scale", "direction"),
    # most other tests of runs are of magnitude estimates that rise with the response
    # and runs on categories, which take longest, are also among those of the other scales
    [
        pytest.param(*made, marks=[pytest.mark.slow] * (made in ((MAGNITUDE, RISES), (CATEGORIES, FALLS))))
        for made in MADE_FROM
    ],
    ids=[f"{s.name}-{d.name}" for s, d in MADE_FROM],
)
def test_a_run_says_what_its_ratings_were_made_from(values, monkeypatch, scale, direction):
    """Parameters, replicates and the curve of a typical rating are those of the table."""
    monkeypatch.setattr(
        "softness_bayes.sampler.sampling.Settings", functools.partial(Settings, pilot=(15,), optima=1, ensembles=2)
    )
    given = values | {"sigma_0": 6.0, "alpha": 21.5, "gamma": 0.9, "tau": 0.3}
    rng = np.random.default_rng(6)
    ratings = simulate_ratings(rng, CLOTH, LOADS[1:], given, participants=10, direction=direction, scale=scale).ratings
    held = {name: given[name] for name in (*CHAIN, *(["tau"] if "tau" in rating_model(scale).needs else []))}
    model = ModelOptions(fix=held, direction=direction, scale=scale, discretisation=COARSE)
    model = dataclasses.replace(model, n_categories=7) if scale is CATEGORIES else model
    found = sample(Experiment(ratings, CLOTH, ()), model, max_steps=80, processes=1)
    level = np.log(20) if scale in (MAGNITUDE, AGGREGATED) else 0.0
    truth = {"gamma": 0.9, "varsigma": 0.4, "eps": 0.1, "mu": level}
    truth = {"varsigma": 0.4, "c0": 0, "c1": 0.6745} if scale is STANDARDISED else truth
    if scale in (RANKS, PAIRS):
        del truth["mu"]
    truth |= {f"gap_{k}": 0.5 for k in range(2, 7)} if scale is CATEGORIES else {}
    table = found.summary()
    assert {*table.index} == {*truth}
    for name, value in truth.items():
        assert abs(table.loc[name, "mean"] - value) < 4 * table.loc[name, "sd"], name
    assert (found.attributes["rating_scale"], found.attributes["direction"]) == (scale.name, direction.name)
    again = found.group("posterior_predictive")["rating"].values[0]
    unit = scale.additive
    rated = found.group("observed_data")["rating"].values  # of ranks, shares of their lists
    assert np.corrcoef(unit(again).mean(axis=0), unit(rated))[0, 1] > 0.6
    assert unit(again).std() == pytest.approx(unit(rated).std(), rel=0.15)
    stored = found.group("predictions").isel(chain=0)
    response, typical = (stored[name].values.reshape(-1) for name in ("total_rate", "typical_rating"))
    assert np.corrcoef(response, unit(typical))[0, 1] * direction.sign > 0.8
    assert found.group("log_likelihood")["rating"].shape == (1, 500, len(ratings))
    figure = FIGURES["rating"](found, USUAL)
    assert figure.axes[0].get_yscale() == scale.axis
    assert figure.axes[0].get_ylabel() == scale.label


def test_z_scores_are_averaged_as_they_are():
    """Two fabrics, three participants, one of whom rates the second twice; nobody is shifted."""
    rating = [-1.0, 0.0, 0.4, 1.0, 2.0, -0.5]
    found = observed_ratings(rating, [0, 0, 0, 1, 1, 1], [0, 1, 2, 0, 1, 1], [1e4, 1e5], [0, 0], scale=STANDARDISED)
    second = np.array([1.0, 0.75])  # a participant's repeated ratings count as their mean
    assert_allclose(found.mean, [-0.2, second.mean()])
    assert_allclose(found.high - found.mean, [np.std([-1, 0, 0.4], ddof=1), second.std(ddof=1)])
    assert_allclose(found.mean - found.low, found.high - found.mean)


def test_z_scores_from_the_command_line(tmp_path):
    """Simulated, checked, refused under the other scale with the option that reads them, and their story told."""

    standardised = ("--ratings", "standardised")
    made = ("simulate", "--fabrics", DATA / "fabrics.csv", "--indentation-mm", "2", "--participants", "3")
    done = call(*made, *standardised, "--direction", "falls-with-firing", "--slope", "0.8", "--out", tmp_path / "z")
    assert done.returncode == 0, done.stderr
    story = json.loads((tmp_path / "z" / "truth.json").read_text())
    assert (story["ratings"], story["direction"]) == ("standardised", "falls-with-firing")
    assert (story["truth"]["c0"], story["truth"]["c1"]) == (0.0, 0.8)
    ratings = tmp_path / "z" / "ratings.csv"
    assert call("check", "--data", ratings, *standardised).returncode == 0
    for verb in ("check", "sample"):
        refused(call(verb, "--data", ratings), "--ratings standardised")
    for verb in ("check", "sample"):
        done = call(verb, "--data", DATA / "ratings.csv", *standardised)
        refused(done, "expected standardised ratings, of mean 0")
    refused(call(*made, *standardised, "--typical-rating", "20", "--out", tmp_path / "y"), "mu is")
