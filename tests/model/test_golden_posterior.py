"""The log posterior and the response at stored points, half of them near the mode and half from the prior.

`SOFTNESS_BAYES_GOLDEN=write python -m pytest tests/model/test_golden_posterior.py` writes `golden/posteriors.npz`
again: new points, and what the present code says of them. A commit that does so says which model changed and why.
"""

from __future__ import annotations

import json
import os
from functools import cache

import emcee
import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

from softness_bayes.data import Compression, read_experiment
from softness_bayes.likelihood.error_laws import LAPSES, NORMAL, STUDENT
from softness_bayes.likelihood.scales import AGGREGATED, CATEGORIES, FALLS, FREE, PAIRS, RANKS, SLIDER, STANDARDISED
from softness_bayes.model.build import build, build_skin
from softness_bayes.model.options import ModelOptions
from softness_bayes.touch.contact import Finger
from softness_bayes.touch.readings import NAMED_READINGS
from softness_bayes.touch.scene import Discretisation
from support.paths import ROOT

FILE = ROOT / "tests" / "golden" / "posteriors.npz"
WRITE = os.environ.get("SOFTNESS_BAYES_GOLDEN") == "write"
POINTS = 200
EXACT, RESPONSE, INTEGRATED = 1e-8, 1e-6, 1e-3
"""Relative errors of priors and likelihoods with a closed form and of the response, and absolute ones of likelihoods
that are integrated numerically (`likelihood/test_golden.py` has the truth about those)."""

MOST_COLUMNS = 50
"""Number of columns of the response that are stored; the likelihood of a model with more has no check of its own."""

FABRICS = {"silk": 2e1, "lawn": 9e1, "drill": 3e2, "felt": 7e2, "board": 4e3}
RATERS = {"Ada": 0.5, "Bo": -0.4, "Cy": 0.1, "Di": 0.3}
MM, N = "indentation_mm", "force_n"
FINE = Discretisation(nodes=30, saturation=25.0, field_tolerance=1e-7)
"""So fine that responses do not depend on how stress fields are tabulated."""


def noise(size, seed):
    """Numbers like errors, the same for ever."""
    return 1.2 * np.sin(7919.0 * (seed + np.arange(size)) ** 1.5)


def ratings(loads, seed=1, column=MM, **more):
    """A table of ratings of all fabrics under each load by each rater, in shuffled order."""
    rows = [(rater, fabric, load) for rater in RATERS for load in loads for fabric in FABRICS]
    table = pd.DataFrame(rows, columns=["participant", "fabric", column])
    firmness = np.log(table["fabric"].map(FABRICS)) / 5.0 + 0.3 * np.log(table[column])
    table["latent"] = firmness.mean() - firmness + 0.25 * noise(len(table), seed)
    table["rating"] = np.exp(2.5 + table["latent"] + table["participant"].map(RATERS))
    table["effective_modulus_kpa"] = table["fabric"].map(FABRICS)
    for name, values in more.items():
        table[name] = values
    return table.sort_values(["latent"]).reset_index(drop=True)


def forces():
    """A table of plate forces on the fingers of two raters and of somebody else."""
    rows = [(who, depth) for who in ("Ada", "Di", "Eve") for depth in (0.5, 1.0, 1.6)]
    table = pd.DataFrame(rows, columns=["participant", MM])
    table["force_n"] = 0.05 * np.exp(1.9 * table[MM] + 0.2 * noise(len(table), 5))
    return table


def of_scale(scale, loads=(1.0, 2.0)):
    """Ratings on another scale than magnitude estimates."""
    table = ratings(loads, seed=2)
    latent = table["latent"]
    if scale is STANDARDISED:
        table["rating"] = latent / latent.std()
    elif scale is SLIDER:
        table["rating"] = (100.0 / (1.0 + np.exp(-2.0 * latent))).round()
    elif scale is CATEGORIES:
        table["rating"] = np.digitize(latent, np.quantile(latent, [0.2, 0.45, 0.7, 0.9])) + 1
    elif scale is RANKS:
        table["rating"] = latent.groupby([table["participant"], table[MM]]).rank()
    elif scale is PAIRS:
        table = table.sort_values(["participant", MM, "fabric"])
        table = table[table["fabric"] != "felt"].reset_index(drop=True)
        table["list"] = np.arange(len(table)) // 2
        table["rating"] = table["latent"].groupby(table["list"]).rank()
    return table.drop(columns="latent")


def means():
    """Geometric means of twelve raters, and their geometric standard deviations."""
    table = ratings((1.0, 2.0), seed=3)
    table = table[table["participant"] == "Bo"].assign(n=12).reset_index(drop=True)
    table["geometric_sd"] = np.exp(0.5 * np.exp(0.2 * noise(len(table), 9)))
    return table.drop(columns=["latent", "participant"]).rename(columns={"rating": "geometric_mean"})


def brackets():
    """Ratings of fabrics whose moduli are uncertain, known within limits or not at all."""
    table = ratings((1.0, 2.0), seed=4).drop(columns=["latent", "effective_modulus_kpa"])
    cloth = pd.DataFrame({"fabric": list(FABRICS), "effective_modulus_kpa": [20.0, 90.0, 300.0, np.nan, np.nan]})
    cloth["effective_modulus_cv"] = [np.nan, 0.2, np.nan, np.nan, np.nan]
    cloth["effective_modulus_low_kpa"] = [np.nan, np.nan, np.nan, 400.0, np.nan]
    cloth["effective_modulus_high_kpa"] = [np.nan, np.nan, np.nan, 1500.0, np.nan]
    return table, cloth


def channels(**more):
    """Fixed channel multipliers, the paper's."""
    return {"c_Na": 1.05, "c_K": 1.16, "c_L": 1.0, "c_A": 1.5, **more}


def built(table, fabrics=None, compression=None, **options):
    """The posterior of tables under options."""
    table = table.drop(columns="latent", errors="ignore")
    experiment = read_experiment(table, fabrics, compression_path=compression)
    given = {"direction": FALLS, "errors": NORMAL, "resolution": 0.0, "discretisation": FINE} | options
    return build(experiment, ModelOptions(**given)).posterior


MODELS = {
    "magnitude estimates under indentations, free channels": lambda: built(ratings((1.0, 2.0))),
    "under forces, as printed, set in-vivo, omega": lambda: built(
        ratings((0.4, 1.5), column=N),
        readings=NAMED_READINGS["printed"].override({"membrane": "connor-stevens"}),
        prior_set="in-vivo",
        priors={"omega": "halfnormal(0.5)", "gamma": "lognormal(0.8,0.2)"},
        fix=channels(c_L=1.02),
    ),
    "Hertz, a plate's rigidity, a displacement": lambda: built(
        ratings((1.0, 2.0)),
        readings=NAMED_READINGS["hertz"].override({"skin_displacement": "displacement"}),
        fix=channels(),
    ),
    "z-scores, set wide, another finger": lambda: built(
        of_scale(STANDARDISED),
        scale=STANDARDISED,
        prior_set="wide",
        finger=Finger(radius=7e-3, receptor_depth=0.6e-3),
        fix=channels(),
    ),
    "a sampled finger, direction free": lambda: built(
        ratings((1.0, 2.0)),
        priors={"radius": "normal(8,0.1)", "receptor_depth": "uniform(0.65,0.75)"},
        direction=FREE,
        fix=channels(),
    ),
    "own fingers of raters, some pressed by a plate": lambda: built(
        ratings((1.0, 2.0)), compression=forces(), individual=("b",), fix=channels()
    ),
    "errors of loads": lambda: built(
        ratings((0.5, 1.5), column=N), load_cv=0.08, fix=channels(), priors={"omega": "halfnormal(0.3)"}
    ),
    "shared errors of loads": lambda: built(ratings((1.0, 2.0)), shared_load_cv=0.05, fix=channels()),
    "moduli with errors, within limits and unknown": lambda: built(*brackets(), fix=channels()),
    "own exponents of raters": lambda: built(ratings((1.0, 2.0)), individual=("gamma",), fix=channels()),
    "sliders in steps, Student's t": lambda: built(
        of_scale(SLIDER),
        scale=SLIDER,
        errors=STUDENT,
        resolution=1.0,
        slider_ends=(0.0, 100.0),
        fix=channels(),
    ),
    "categories, lapses": lambda: built(
        of_scale(CATEGORIES), scale=CATEGORIES, errors=LAPSES, resolution=None, fix=channels()
    ),
    "ranks": lambda: built(of_scale(RANKS), scale=RANKS, errors=None, resolution=None, fix=channels()),
    "pairs with lapses": lambda: built(of_scale(PAIRS), scale=PAIRS, errors=LAPSES, resolution=None, fix=channels()),
    "means of twelve raters and their spreads": lambda: built(
        means(), scale=AGGREGATED, resolution=None, fix=channels()
    ),
    "forces of a plate alone": lambda: build_skin(Compression.read(forces()), ModelOptions()).posterior,
}
"""Constructors of posteriors by name: all options that change the prior, the response or the likelihood."""


INTEGRATED_ONES = (
    "own exponents of raters",
    "sliders in steps, Student's t",
    "categories, lapses",
    "means of twelve raters and their spreads",
)
"""Models whose likelihood is integrated numerically."""
DRAWN_ONES = ("own exponents of raters",)
"""Models integrated by importance draws, whose error is nearly a constant."""
DRAWN = 5e-3
"""Largest error of such a constant, and of what varies."""


@cache
def posterior(name):
    """The posterior of a model, built once."""
    return MODELS[name]()


def near_mode(density, size):
    """Points about the mode: walkers of a short chain, from the best of many draws of the prior."""
    rng = np.random.default_rng(3)
    start = density.draw_start(rng, 400)
    value = density(start)
    start = start[np.argsort(value)[-2 * start.shape[1] - 20 :]]
    start = start + 1e-3 * rng.standard_normal(start.shape)
    chain = emcee.EnsembleSampler(*start.shape, density, vectorize=True)
    state = emcee.State(start, random_state=np.random.RandomState(4).get_state())
    chain.run_mcmc(state, 300)
    return density.natural(chain.get_chain(flat=True)[-size * 3 :: 3])


def of_terms(density, theta, rate):
    """The log-likelihood at points, given the response there."""
    terms = density.terms
    return sum(term.log_likelihood(rate, density.parameters_of(term, theta)) for term in terms)


def response(density, theta):
    """The response in all columns that the likelihood needs."""
    return density.response(theta)


def recorded():
    """New points of every model, and what the present code says of them; points and rates in single precision."""
    arrays = {}
    for k, name in enumerate(MODELS):
        density = posterior(name)
        prior = density.space.draw_prior(np.random.default_rng(5), POINTS // 2)
        theta = np.concatenate([near_mode(density, POINTS // 2), prior]).astype(np.float32)
        points = theta.astype(float)
        rate = response(density, points)
        if rate.shape[1] <= MOST_COLUMNS:
            rate = rate.astype(np.float32)
        arrays |= {
            f"theta_{k}": theta,
            f"rate_{k}": rate[:, :MOST_COLUMNS].astype(np.float32),
            f"log_prior_{k}": density.log_prior(points),
            f"log_likelihood_{k}": of_terms(density, points, rate.astype(float)),
        }
    order = json.dumps({name: list(posterior(name).names) for name in MODELS})
    return arrays | {"models": np.array(order)}


@pytest.fixture(scope="module")
def stored():
    """The stored arrays, by name; written first if that is asked for."""
    if WRITE:
        np.savez_compressed(FILE, **recorded())
    with np.load(FILE) as arrays:
        return dict(arrays)


def points_of(stored, name):
    """Points of a model in the order of its parameters, and its stored numbers, by name."""
    models = json.loads(str(stored["models"]))
    k, names = list(models).index(name), models[name]
    density = posterior(name)
    assert sorted(density.names) == sorted(names)
    theta = stored[f"theta_{k}"].astype(float)[:, [names.index(one) for one in density.names]]
    return density, theta, {what: stored[f"{what}_{k}"] for what in ("rate", "log_prior", "log_likelihood")}


@pytest.mark.parametrize("name", MODELS)
def test_prior_response_and_likelihood_are_the_stored_ones(name, stored):
    density, theta, numbers = points_of(stored, name)
    rate, expected = numbers["rate"].astype(float), numbers["log_likelihood"]
    assert_allclose(density.log_prior(theta), numbers["log_prior"], rtol=EXACT)
    present = response(density, theta)
    assert_allclose(present[:, :MOST_COLUMNS], rate, rtol=RESPONSE, atol=RESPONSE)
    if present.shape == rate.shape:
        found = of_terms(density, theta, rate)
        near = slice(POINTS // 2)
        if name in DRAWN_ONES:
            assert_allclose(found[near], expected[near], rtol=0, atol=20.0 * DRAWN)
            assert (found - expected)[near].std() < DRAWN
        elif name in INTEGRATED_ONES:
            assert_allclose(found[near], expected[near], rtol=0, atol=INTEGRATED)
        else:
            assert_allclose(found, expected, rtol=EXACT)
    # all parts together, as a sampler calls them
    near = slice(POINTS // 2 if name in (*INTEGRATED_ONES, *DRAWN_ONES) else POINTS)
    whole = density.log_prior(theta) + density.log_likelihood(theta)
    assert_allclose(
        whole[near],
        (numbers["log_prior"] + expected)[near],
        rtol=1e-6,
        atol=20.0 * DRAWN if name in DRAWN_ONES else 2.0 * INTEGRATED,
    )


def test_a_change_of_a_millionth_is_noticed(stored):
    """Negative control: of the response, and of the likelihood by way of a single parameter."""
    density, theta, numbers = points_of(stored, "errors of loads")

    def difference(name, factor):
        moved = theta * np.where(np.array(density.names) == name, factor, 1.0)
        rate = numbers["rate"].astype(float)
        of_rate = np.abs(response(density, moved) - rate) / (RESPONSE + RESPONSE * rate)
        found = of_terms(density, moved, rate) - numbers["log_likelihood"]
        return max(of_rate.max(), (np.abs(found) / (EXACT * np.abs(numbers["log_likelihood"]))).max())

    assert difference("sigma_0", 1.0) < 1.0
    assert difference("sigma_0", 1.0 + 1e-5) > 5.0
    assert difference("varsigma", 1.0 + 1e-6) > 5.0
