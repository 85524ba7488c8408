"""All observation models against golden values by brute force (`oracles.raters`): densities, and moments of draws.

The functions of the first part are all that knows the package's interface.
"""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

from oracles import make_likelihood_goldens, raters
from softness_bayes.likelihood.aggregated import AggregatedModel, RaterSpreads, SpreadModel
from softness_bayes.likelihood.contract import Parameters
from softness_bayes.likelihood.design import Design, LoadErrors, Stated
from softness_bayes.likelihood.error_laws import error_law_named
from softness_bayes.likelihood.individual import IndividualModel
from softness_bayes.likelihood.intervals import CategoryModel
from softness_bayes.likelihood.models import (
    rating_model,
    under_load_errors,
)
from softness_bayes.likelihood.plate import CompressionForces
from softness_bayes.likelihood.scales import FALLS, RISES, scale_named
from softness_bayes.touch.contact import Finger
from softness_bayes.touch.finger_grid import FingerGrid

NODES = {"coarse": (-(3.0**0.5), 3.0**0.5), "fine": (-4.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 4.0)}
"""Further loads at which responses are needed, in standard deviations, for sampling and for the reference."""


def likelihood_of(case):
    """The likelihood of a case, with the accuracy of what is reported but not of the reference."""
    kind, y = case["kind"], np.array(case["y"], float)
    if kind == "forces":
        shape = Finger(radius=case["radius"], poisson_ratio=case["poisson"])
        return CompressionForces(case["indentation"], y, case["participant"], max(case["participant"]) + 1, shape)
    design = Design(case["condition"], case["participant"], case["fabric"], max(case["participant"]) + 1)
    direction = RISES if case["sign"] > 0 else FALLS
    if kind == "spreads":
        return RaterSpreads(y, design, SpreadModel(case["raters"]))
    if kind == "aggregated":
        return AggregatedModel(direction, raters=case["raters"]).observe(y, design)
    if kind == "fingers":
        return IndividualModel(direction, grid=FingerGrid({"b": case["finger_nodes"]})).observe(y, design)
    scale, law, stated = scale_named(case["scale"]), error_law_named(case["law"]), None
    if kind == "categories":
        return CategoryModel(direction, law=law, categories=case["categories"]).observe(y, design)
    if "lists" in case:
        nothing = np.zeros(y.size)
        stated = Stated(y, nothing, nothing, nothing + np.inf, lists=np.array(case["lists"]))
    elif "step" in case:
        step, limit, most = (np.array(case[name]) for name in ("step", "limit", "most"))
        end = 1.0 if kind == "slider" else np.inf
        # ratings at an end are passed as a number between the end and the limit
        y = np.where(y == 0.0, limit / 2, np.where(y == end, (most + 1.0) / 2, y))
        stated = Stated(y, step, limit, most, end)
    exact = stated is None or stated.exact
    if "differ" in case:
        model = rating_model(scale, direction, law, differ=tuple(case["differ"]))
    else:
        model = rating_model(scale, direction, law, exact)
    observed = model.observe(y, design) if exact else model.observe(y, design, stated)
    if "shared" in case:
        return under_load_errors(observed, LoadErrors.of(design, case["load_sd"], case["shared"]))
    if "load_sd" in case:
        return under_load_errors(observed, LoadErrors.of(design, case["load_sd"]))
    return observed


def rate_of(case, nodes="coarse"):
    """Mean rates in the columns that the likelihood expects."""
    if case["kind"] in ("forces", "spreads"):
        return np.empty(0)
    rate = np.array(case["rate"])
    if case["kind"] == "fingers":
        return np.concatenate([rate, *np.array(case["finger_rate"])])
    if "load_slope" in case:
        return np.concatenate([rate, *(rate * np.exp(np.array(case["load_slope"]) * t) for t in NODES[nodes])])
    return rate


def parameters_of(likelihood, p):
    """Parameters in the form that the likelihood takes."""
    return Parameters(**p)


def log_likelihood_reference(case, p):
    """The log density of all ratings by the integrals that everything reported uses."""
    observed = likelihood_of(case)
    nodes = "coarse"
    if case["kind"] in (*raters.LEVELS, "fingers"):
        observed = observed.finer() if case["kind"] != "fingers" else observed
    elif case["kind"] in ("erring loads", "shared loads"):
        observed, nodes = observed.finer(), "fine"
    return float(observed.log_likelihood(rate_of(case, nodes), parameters_of(observed, p)))


def log_likelihood_sampled(case, p):
    """The log density of all ratings as the sampler uses it."""
    observed = likelihood_of(case).for_sampling()
    return float(observed.log_likelihood(rate_of(case), parameters_of(observed, p)))


def log_density_of_rows(case, p):
    """The log density of each rating given all others, (rows,)."""
    observed = likelihood_of(case)
    return observed.left_out(rate_of(case)[None], parameters_of(observed, p)).log_density[0]


def log_density_of_participants(case, p):
    """The log density of each participant's ratings given all others', (participants,)."""
    observed = likelihood_of(case)
    return observed.log_likelihood_participants(rate_of(case)[None], parameters_of(observed, p))[0]


def effects_drawn(case, p, size):
    """Draws of all effects given the ratings, by name, each (size,) or (size, participants or fabrics)."""
    observed, rng = likelihood_of(case), np.random.default_rng(11)
    many = {name: np.full(size, value) for name, value in p.items()}
    rate = np.tile(rate_of(case), (size, 1))
    return vars(observed.draw_effects(rng, rate, parameters_of(observed, many)))


CASES = json.loads(make_likelihood_goldens.FILE.read_text(encoding="utf-8"))
REPORTED, CLOSED = 1e-3, 1e-7
"""Largest errors of what is reported: of all densities by the reference, and of those with a closed form or sum."""
MISSES = json.loads((make_likelihood_goldens.HERE / "likelihood_misses.json").read_text(encoding="utf-8"))
"""Errors of the present code beyond that, and beyond `sampled`, by quantity and case: to be emptied, never to grow.

Of moments, those of means in standard errors, and relative ones of standard deviations.
"""
DRAWS = 1500
DRAWN = (
    "magnitude, exact, normal, omega",
    "magnitude, rounded, normal",
    "slider, rounded, lapses",
)
"""Cases whose effects are drawn in every run of the tests; the others are slow."""


def golden(case, key):
    """The points of a case that have a golden value, each with it."""
    return [(p, values[key]) for p, values in zip(case["points"], case["golden"], strict=True) if key in values]


def having(key):
    return pytest.mark.parametrize("name", [name for name, case in CASES.items() if golden(case, key)])


def is_closed(name):
    """Whether the density of a case is a closed form, or a finite sum."""
    kinds = "ranks", "pairs", "aggregated", "spreads", "load errors", "fingers", "forces"
    return CASES[name]["kind"] in kinds or name in ("magnitude, exact, normal", "magnitude, exact, normal, omega")


def require(quantity, of, name, key):
    """Compare a quantity with its golden values at all points of a case."""
    largest = max(CLOSED if is_closed(name) else REPORTED, MISSES[quantity].get(name, 0.0))
    for p, expected in golden(CASES[name], key):
        assert_allclose(of(CASES[name], p), expected, rtol=0, atol=largest)


@having("log_likelihood")
def test_the_density_of_all_ratings(name):
    require("reference", log_likelihood_reference, name, "log_likelihood")


@having("log_likelihood")
def test_the_density_that_is_sampled(name):
    """But for a constant: an error that all parameters share has no effect on the posterior."""
    case = CASES[name]
    points = golden(case, "log_likelihood")
    errors = np.array([log_likelihood_sampled(case, p) - expected for p, expected in points])
    if errors.size > 1:
        errors = errors - errors.mean()
    assert np.abs(errors).max() <= max(case["sampled"], MISSES["sampled"].get(name, 0.0))


@having("loo")
def test_the_density_of_a_rating_given_the_others(name):
    require("loo", log_density_of_rows, name, "loo")


@having("participants")
def test_the_density_of_a_participant_given_the_others(name):
    require("participants", log_density_of_participants, name, "participants")


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if name in DRAWN else pytest.mark.slow)
        for name, case in CASES.items()
        if golden(case, "moments")
    ],
)
def test_moments_of_draws_of_effects(name):
    """Means to 4.5 of their standard errors, and standard deviations to an eighth."""
    largest, widest = MISSES["moments"].get(name, (4.5, 0.12))
    for p, expected in golden(CASES[name], "moments"):
        drawn = effects_drawn(CASES[name], p, DRAWS)
        for effect, values in expected.items():
            mean, sd = np.transpose(values)
            found, some = drawn[effect].reshape(DRAWS, -1), sd > 1e-6
            error = (found.mean(axis=0) - mean)[some] / sd[some] * DRAWS**0.5
            assert np.abs(error).max(initial=0.0) < largest, effect
            assert_allclose(found.std(axis=0)[some], sd[some], rtol=widest, err_msg=effect)
            assert_allclose(found[:, ~some].std(axis=0), 0.0, atol=1e-6, err_msg=effect)


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_golden_values_are_those_of_the_oracle(name):
    case = CASES[name]
    for p, values in zip(case["points"], case["golden"], strict=True):
        assert_allclose(raters.log_density(case, p), values["log_likelihood"], rtol=1e-9, atol=1e-9)


def without_jacobian(case, low, high):
    return np.zeros(low.size)


def without_lapses(case, low, high):
    return np.full(low.size, -np.inf)


@pytest.mark.parametrize(
    ("name", "part", "broken"),
    [
        ("magnitude, exact, student", "log_jacobian", without_jacobian),
        ("slider, exact, normal", "log_jacobian", without_jacobian),
        ("magnitude, exact, lapses", "log_lapse", without_lapses),
        ("categories, lapses", "log_lapse", without_lapses),
    ],
)
def test_a_missing_term_is_noticed(monkeypatch, name, part, broken):
    """Negative control: the golden value is far from that of a law that lacks a Jacobian, or lapses."""
    case = CASES[name]
    p, expected = golden(case, "log_likelihood")[0]
    monkeypatch.setattr(raters, part, broken)
    assert abs(raters.log_density(case, p) - expected) > 100.0 * REPORTED
    assert abs(log_likelihood_reference(case, p) - raters.log_density(case, p)) > 100.0 * REPORTED


def test_a_wrong_parameter_is_noticed():
    """Negative control: every parameter of a case matters to its golden value, so that none can be ignored."""
    for name in ("magnitude, rounded, lapses, omega", "categories, student", "slider, exact, student, own gamma"):
        case = CASES[name]
        p, expected = golden(case, "log_likelihood")[0]
        for needed in likelihood_of(case).model.needs:
            if needed in p and p[needed] > 0.0:
                other = log_likelihood_reference(case, p | {needed: 1.2 * p[needed]})
                assert abs(other - expected) > 2.0 * REPORTED, (name, needed)
