"""Ratings as they were given: grids of raters, intervals of ratings, and the law of their errors."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import HalfNormal
from softness_bayes.base.readable import counted
from softness_bayes.data import Experiment, Fabrics, Ratings
from softness_bayes.likelihood.error_laws import LAPSES, NORMAL, STUDENT
from softness_bayes.likelihood.scales import (
    CATEGORIES,
    FALLS,
    FREE,
    MAGNITUDE,
    PAIRS,
    RANKS,
    RISES,
    SLIDER,
    STANDARDISED,
)
from softness_bayes.model.build import build
from softness_bayes.model.interpretation import interpret, stated, step_of
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.parameters.declared import PARAMETERS
from softness_bayes.touch.contact import Indentation
from softness_bayes.touch.readings import MENDED
from softness_bayes.touch.scene import Discretisation


@pytest.mark.parametrize(
    ("numbers", "step"),
    [
        ([1, 2, 3, 5, 8], 1.0),
        ([0, 1, 2, 3, 5], 1.0),
        ([0.5, 1, 1.5, 3, 7], 0.5),
        ([0.25, 1, 1.75, 3, 7], 0.25),
        ([10, 20, 40, 60], 10.0),
        ([2, 4, 6], 1.0),  # three even numbers may be chance
        ([2, 4, 6, 8, 10, 12, 16], 2.0),
        ([5, 5, 5], 0.0),  # one number tells nothing
        ([0, 0], 0.0),
        ([8.13, 23.41, 15.77, 4.912], 0.0),  # too fine to matter
        ([0.1, 0.3, 0.7, 1.2], 0.1),
    ],
)
def test_steps(numbers, step):
    assert_allclose(step_of(numbers), step)


def test_chance_is_not_a_grid():
    """Exact numbers of random digits are hardly ever taken for a coarse grid, and whole numbers are found."""
    rng = np.random.default_rng(1)
    fine = [step_of(np.round(np.exp(rng.normal(2.0, 0.8, 12)), 2)) for _ in range(300)]
    assert max(fine) <= 0.02
    whole = [step_of(np.maximum(np.round(np.exp(rng.normal(2.0, 0.8, 12))), 1)) for _ in range(300)]
    assert np.mean(np.array(whole) == 1.0) > 0.97


def ratings_of(table, resolution=None):
    made = Ratings.crossed(("P", "Q"), ("a", "b", "c", "d"), (Indentation(1e-3),), np.array(table)[..., None])
    own = None if resolution is None else np.array(resolution, float)
    return Ratings(**{**{name: getattr(made, name) for name in made.__dataclass_fields__}, "resolution": own})


def test_intervals_of_a_grid():
    said = stated(ratings_of([[0.0, 1, 2, 5], [0.5, 1.5, 3.0, 7.5]]))
    assert_allclose(said.step, [1] * 4 + [0.5] * 4)
    assert_allclose(said.values, [0.25, 1, 2, 5, 0.5, 1.5, 3, 7.5])
    low, high = said.ends(said.values)
    assert_allclose(low, [0, 0.5, 1.5, 4.5, 0.25, 1.25, 2.75, 7.25])
    assert_allclose(high, [0.5, 1.5, 2.5, 5.5, 0.75, 1.75, 3.25, 7.75])
    assert not said.exact


def test_zeros_among_exact_numbers_lie_below_the_smallest():
    said = stated(ratings_of([[0.0, 1.234, 2.518, 5.077], [0.511, 1.52, 3.017, 7.533]]))
    assert_allclose(said.step, 0)
    assert_allclose(said.limit, [1.234] * 4 + [0] * 4)
    low, high = said.ends(said.values)
    assert (low[0], high[0]) == (0.0, 1.234)
    assert_allclose(low[1:], high[1:])


def test_a_column_goes_before_an_option_and_an_option_before_what_is_found():
    table = [[1.0, 2, 3, 4], [1, 2, 3, 5]]
    assert_allclose(stated(ratings_of(table), 0.0).step, 0)
    assert stated(ratings_of(table), 0.0).exact
    own = [0.5, np.nan, 0.5, 0.5, 0, 0, 0, 0]
    assert_allclose(stated(ratings_of(table, own)).step, [0.5, 1, 0.5, 0.5, 0, 0, 0, 0])
    assert_allclose(stated(ratings_of(table, own), 0.25).step, [0.5, 0.25, 0.5, 0.5, 0, 0, 0, 0])


QUICK = ModelOptions(
    fix={"c_Na": 1.05, "c_K": 1.16, "c_L": 1.0, "c_A": 1.5}, discretisation=Discretisation(6, 6.0, 1e-3)
)
CLOTH = Fabrics(tuple("abcdef"), effective_modulus=np.array([1e3, 1e4, 3e4, 1e5, 1e6, 1e7]))
LOADS = (Indentation(2e-3), Indentation(3e-3))


def simulated(seed=1, participants=12, **options):
    """An experiment with simulated raters of six fabrics under two loads."""
    values = usual_values(MENDED, given=options.pop("values", {}))
    rng, mu = np.random.default_rng(seed), options.pop("mu", 1.5)
    made = simulate_ratings(rng, CLOTH, LOADS, values, participants=participants, mu=mu, **options)
    return Experiment(made.ratings, CLOTH, ()), made


def test_whole_numbers_are_intervals_and_zeros_are_kept():
    experiment, _ = simulated(resolution=1.0)
    assert (experiment.ratings.rating == 0).any()
    assert (experiment.ratings.rating % 1 == 0).all()
    model = build(experiment, QUICK)
    assert model.posterior.observation.ends is not None
    assert "round their answers to steps of 1 (1" in model.interpretation.note
    assert (
        f"{(experiment.ratings.rating == 0).sum()} ratings of 0 are censored: they count as numbers below"
        in model.interpretation.note
    )
    theta = model.posterior.space.draw_prior(np.random.default_rng(1), 20)
    value = model.posterior.log_likelihood(theta)
    assert np.isfinite(value).all()
    assert (value < 0).all()  # probabilities
    exact = build(experiment, replace(QUICK, resolution=0.0))
    assert exact.posterior.observation.ends is not None  # zeros have no exact number
    assert model.posterior.names == exact.posterior.names


def test_the_table_decides_between_normal_and_heavy_tails():
    """Tails of many tables: normal errors are hardly ever taken for heavy ones, clear outliers always are."""
    heavy = normal = 0
    for seed in range(12):
        heavy += interpret(simulated(seed, 20, errors=STUDENT, values={"nu": 2.5})[0].ratings, QUICK).law is STUDENT
        normal += interpret(simulated(seed, 20)[0].ratings, QUICK).law is NORMAL
    assert (heavy, normal) == (12, 12)
    few = simulated(0, 2, errors=STUDENT, values={"nu": 2.5})[0].ratings
    assert interpret(few, QUICK).law is NORMAL
    assert "too few ratings" in interpret(few, QUICK).errors_note


@pytest.mark.parametrize("count", [1, 24])
def test_zeros_are_no_heavy_tails(count):
    """Of ratings that have become 0 it is only known that they are small: any number in their place lies far out."""
    laws = []
    for seed in range(6):
        table = simulated(seed, 20)[0].ratings
        silent = np.zeros(len(table), bool)
        silent[np.random.default_rng(seed).choice(len(table), count, replace=False)] = True
        meaning = interpret(replace(table, rating=np.where(silent, 0.0, table.rating)), replace(QUICK, resolution=0.0))
        assert f"without {counted(count, 'censored rating')}" in meaning.errors_note
        laws.append(meaning.law)
    assert laws == [NORMAL] * 6


def test_conditions_that_hardly_repeat_are_no_heavy_tails():
    """Forces as they were measured: most ratings alone determine their condition, and leave no residual."""
    table, loads = simulated(0, 30)[0].ratings, tuple(Indentation(d) for d in np.linspace(1e-3, 3e-3, 40))
    students = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        own = {"load": rng.integers(len(loads), size=len(table)), "rating": np.exp(rng.normal(2.0, 0.4, len(table)))}
        students += interpret(replace(table, loads=loads, **own), QUICK).law is STUDENT
    assert students == 0


@pytest.mark.parametrize(
    ("scale", "errors"),
    [(MAGNITUDE, STUDENT), (MAGNITUDE, LAPSES), (SLIDER, NORMAL), (SLIDER, STUDENT), (CATEGORIES, LAPSES)],
    ids=lambda of: of.name,
)
def test_fabrics_may_deviate_whatever_the_ratings_are(scale, errors):
    """Whole numbers with zeros, sliders and categories keep their intervals and their error law beside omega."""
    step = {MAGNITUDE.name: {"resolution": 1.0}, SLIDER.name: {"resolution": 0.05}}.get(scale.name, {})
    mu = {} if scale is MAGNITUDE else {"mu": 0.0}
    experiment, _ = simulated(scale=scale, values={"omega": 0.4, "gamma": 0.5}, **step, **mu)
    own = replace(QUICK, scale=scale, errors=errors, priors={"omega": HalfNormal(0.5)})
    model = build(experiment, own)
    assert model.options.errors is errors
    assert "exact" not in model.interpretation.note
    assert "omega" in model.posterior.names
    theta = model.posterior.space.draw_prior(np.random.default_rng(1), 50)
    assert np.isfinite(model.posterior.for_sampling.log_likelihood(theta)).all()  # far from the data, too
    theta = theta[:3]
    noise = model.posterior.names.index("varsigma")
    theta[:, noise] = np.maximum(theta[:, noise], 0.3)  # sums over points take long where noise is far too small
    value = model.posterior.log_likelihood(theta)
    assert np.isfinite(value).all()
    without = theta.copy()
    without[:, model.posterior.names.index("omega")] = 1e-12
    held = build(experiment, replace(own, priors={})).posterior
    rest = np.delete(theta, model.posterior.names.index("omega"), axis=1)
    assert_allclose(model.posterior.log_likelihood(without), held.log_likelihood(rest), rtol=0, atol=1e-4)
    assert (np.abs(value - held.log_likelihood(rest)) > 1e-3).all()


def test_what_has_no_model_is_refused():
    experiment, _ = simulated(resolution=1.0)
    some, _ = simulated()
    loads = replace(QUICK, load_cv=0.05)
    with pytest.raises(InputError, match=r"ratings are 0, and errors of loads \(load_cv\) need ratings above 0"):
        build(experiment, loads)
    with pytest.raises(InputError, match=r"errors of loads \(load_cv\) need exact numbers with normal errors"):
        build(some, replace(loads, errors=STUDENT))
    with pytest.raises(InputError, match=r"raters' own fingers \(--individual\) need exact numbers"):
        build(some, replace(QUICK, individual=("b",), resolution=1.0))
    scores = np.resize([-1.0, 0.5, 1.0], len(some.ratings))
    with pytest.raises(InputError, match="standardised ratings need exact numbers"):
        interpret(replace(some.ratings, rating=scores), ModelOptions(scale=STANDARDISED, errors=LAPSES))
    silent = replace(some.ratings, rating=np.zeros(len(some.ratings)))
    with pytest.raises(InputError, match="expected ratings above 0, got none"):
        interpret(silent, QUICK)
    with pytest.raises(InputError, match=r"simulate: resolution is 1\.0, expected none for standardised ratings"):
        simulated(scale=STANDARDISED, resolution=1.0)


def test_a_free_direction_is_half_of_each():
    """An exponent of either sign: the density is half of that of the direction which the sign tells."""
    experiment, _ = simulated()
    free, rises, falls = (build(experiment, replace(QUICK, direction=d)).posterior for d in (FREE, RISES, FALLS))
    theta = rises.space.draw_prior(np.random.default_rng(2), 8)
    gamma = rises.names.index("gamma")
    for sign, one in ((1.0, rises), (-1.0, falls)):
        other = theta.copy()
        other[:, gamma] *= sign
        assert_allclose(free.log_likelihood(other), one.log_likelihood(theta), rtol=1e-12)
        assert_allclose(free.log_prior(other), one.log_prior(theta) - np.log(2.0), rtol=1e-12)
        z = free.space.coordinates(other)
        assert_allclose(free.natural(z), other, rtol=1e-9)
    drawn = free.space.draw_prior(np.random.default_rng(3), 4000)[:, gamma]
    assert abs((drawn > 0).mean() - 0.5) < 0.03
    record = build(experiment, replace(QUICK, direction=FREE)).options.record()
    assert ModelOptions.from_record(record).direction is FREE
    with pytest.raises(InputError, match="free needs magnitude estimates"):
        build(experiment, replace(QUICK, direction=FREE, scale=STANDARDISED))


def test_places_on_a_slider():
    ratings = ratings_of([[0.0, 12.5, 50.0, 100.0], [3.25, 41.71, 77.3, 96.12]], [1.0] * 4 + [0.0] * 4)
    said = stated(ratings, ends=(0.0, 100.0))
    assert_allclose(said.values, [0.0025, 0.125, 0.5, 0.9975, 0.0325, 0.4171, 0.773, 0.9612])
    low, high = said.ends(said.values)
    assert_allclose(low[:4], [0.0, 0.12, 0.495, 0.995])
    assert_allclose(high[:4], [0.005, 0.13, 0.505, 1.0])
    assert_allclose(low[4:], high[4:])
    with pytest.raises(InputError, match=r"row 3, column 'rating': expected a place on a slider from 0 to 10, got 12"):
        stated(ratings, ends=(0.0, 10.0))
    touched = stated(ratings_of([[0.0, 13.1, 51.7, 100.0], [3.25, 41.71, 77.3, 96.12]], [0.0] * 8), ends=(0, 100))
    assert_allclose(touched.limit, [0.131] * 4 + [0.0] * 4)
    assert_allclose(touched.most, [0.517] * 4 + [1.0] * 4)


def ranked(**options):
    usual = usual_values(MENDED, given={"b": 20.0, "sigma_0": 5.0, "gamma": 0.8, "varsigma": 0.3})
    return simulate_ratings(np.random.default_rng(4), CLOTH, LOADS, usual, participants=8, scale=RANKS, **options)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"lists": np.arange(96)}, "no list has two different ranks, so there is no order"),
        ({"lists": np.zeros(96, int)}, "a list holds the places of several participants"),
        ({"rating": np.ones(96), "lists": np.arange(96) // 12}, r"row 2, column 'rating': 12 touches .* have place 1"),
        ({"resolution": np.ones(96)}, r"ranks have no --resolution \(or a column resolution\); omit it"),
    ],
)
def test_what_is_no_order_is_refused(change, message):
    with pytest.raises(InputError, match=message):
        interpret(replace(ranked().ratings, **change), replace(QUICK, scale=RANKS))


SCALES = {
    SLIDER: ({"resolution": 0.05}, {}, "at the slider's lower end"),
    CATEGORIES: ({"categories": 5}, {"n_categories": 5}, "5 ordered categories"),
    RANKS: ({"direction": FALLS, "missing": 0.1, "mu": None}, {}, "places in 24 lists of"),
    PAIRS: ({"errors": LAPSES, "missing": 0.1, "mu": None}, {"errors": LAPSES}, "answers to"),
}
"""How ratings on each scale are simulated and fitted, and what is said of them."""


@pytest.mark.parametrize("scale", SCALES, ids=lambda scale: scale.name)
def test_every_scale_is_simulated_and_fitted(scale):
    how, chosen, note = SCALES[scale]
    experiment, made = simulated(scale=scale, **how)
    model = build(experiment, replace(QUICK, scale=scale, **chosen))
    assert note in model.interpretation.note
    theta = model.posterior.space.draw_prior(np.random.default_rng(1), 10)
    assert np.isfinite(model.posterior.log_likelihood(theta)).all()
    assert ModelOptions.from_record(model.options.record()) == model.options
    names = {*model.posterior.names, *model.posterior.space.held, "mu"}
    assert {name for name in made.truth if name not in PARAMETERS} <= names
    assert {name for name in names if name.startswith("gap_")} == {name for name in made.truth if name[:4] == "gap_"}


def test_a_slider_in_percent_is_the_same_slider():
    experiment, _ = simulated(scale=SLIDER, resolution=0.05)
    one = build(experiment, replace(QUICK, scale=SLIDER)).posterior
    percent = replace(experiment.ratings, rating=100.0 * experiment.ratings.rating)
    other = build(experiment._replace(ratings=percent), replace(QUICK, scale=SLIDER, slider_ends=(0.0, 100.0)))
    theta = one.space.draw_prior(np.random.default_rng(1), 10)
    assert_allclose(other.posterior.log_likelihood(theta), one.log_likelihood(theta), rtol=1e-9)


def test_numbers_that_are_not_of_the_scale_are_refused():
    fives, pairs = simulated(scale=CATEGORIES, categories=5)[0].ratings, simulated(scale=PAIRS, mu=None)[0].ratings
    lines = np.repeat(np.arange(2, 2 + len(pairs) // 2), 2)
    for table, chosen, message in (
        (
            replace(fives, rating=fives.rating - 1),
            {"scale": CATEGORIES, "n_categories": 5},
            "a category, 1 to 5, got 0",
        ),
        (fives, {"n_categories": 5}, "categories: 5 are given for magnitude ratings"),
        (fives, {"slider_ends": (0.0, 10.0)}, "slider: ends are given for magnitude ratings"),
        (pairs, {"scale": PAIRS, "errors": STUDENT}, "pairs have no --errors"),
        (ranked().ratings, {"scale": PAIRS}, "a list holds 6 touches, expected pairs"),
        (replace(pairs, rows=lines), {}, "which are pairs, not magnitude ratings; add --ratings pairs"),
    ):
        with pytest.raises(InputError, match=message):
            interpret(table, replace(QUICK, **chosen))
