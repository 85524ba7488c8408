"""The contract of likelihoods: every entry of the table goes through the same tests, and broken ones fail them.

A new likelihood is tested as soon as it is in `LIKELIHOODS`; it needs a `Case` here: a small table of it, and points of
its parameters. `test_golden` compares its densities with its law written out.
"""

import ast
import pickle
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad
from scipy.stats import kstest

import softness_bayes
from softness_bayes.base.errors import InputError
from softness_bayes.likelihood import error_laws, scales
from softness_bayes.likelihood.aggregated import AggregatedModel, AggregatedRatings, RaterSpreads, SpreadModel
from softness_bayes.likelihood.contract import NO_RESPONSE, Likelihood, Parameters, RatingsLikelihood, RowsLeftOut
from softness_bayes.likelihood.design import Design, LoadErrors
from softness_bayes.likelihood.error_laws import LAPSES, NORMAL, STUDENT
from softness_bayes.likelihood.individual import IndividualModel, IndividualRatings
from softness_bayes.likelihood.intervals import CategoryModel, CategoryRatings, IntervalModel, IntervalRatings
from softness_bayes.likelihood.magnitude import LogRatings, RatingModel
from softness_bayes.likelihood.models import LIKELIHOODS, RATING_MODELS, rating_model
from softness_bayes.likelihood.orders import OrderModel, OrderRatings, PairModel, PairRatings
from softness_bayes.likelihood.plate import CompressionForces
from softness_bayes.likelihood.scales import CATEGORIES, FALLS, MAGNITUDE, RATING_SCALES, RISES, scale_named
from softness_bayes.likelihood.uncertain_loads import UncertainLoads
from softness_bayes.likelihood.z_scores import StandardisedModel, StandardisedRatings
from softness_bayes.touch.finger_grid import FingerGrid
from support.points import densities, rated

ROWS = 7
DESIGN = Design([0, 1, 2, 3, 4, 1, 3], [0, 0, 0, 1, 1, 2, 2], [0, 1, 2, 0, 1], 3)
RATES = np.array([[0.0, 3.0, 8.0, 20.0, 31.0], [5.0, 4.0, 2.0, 9.0, 1.0], [0.5, 0.0, 0.0, 12.0, 40.0]])


@dataclass(frozen=True)
class Case:
    """One likelihood in small: its table, mean rates, and three points."""

    observed: Any
    rate: Any
    points: Any
    left_out: float = 0.0
    """Largest error of what is said of some given the others."""
    numbers: Any = None
    """All numbers that an observation may be, where they are discrete."""

    def at(self, k):
        """The k-th point by itself."""
        return self.rate[k], self.points.part(k)


LOAD_SD = np.array([0.1, 0.1, 0.0, 0.2, 0.1, 0.0, 0.2])
"""Of the log loads of the rows: six touches, of which four have errors."""
TOUCHES = LoadErrors.of(DESIGN, LOAD_SD)
FURTHER = np.where(TOUCHES.log_sd > 0.0, np.array([[[0.7]], [[1.4]]]), 1.0) * RATES[:, TOUCHES.condition]
"""Their rates under lower and higher loads, shape (2, points, touches)."""


LOADS, SHARED_SD = np.array([0, 1, 0, 1, 1]), 0.05
SHARED = np.concatenate([RATES, 0.8 * RATES, 1.3 * RATES + 0.2], axis=1)  # under the stated, lower and higher loads


GRID = FingerGrid({"b": 3})
WIDE = np.concatenate([RATES, 2.0 * RATES, RATES + 4.0, RATES[:, ::-1]], axis=1)  # of the typical finger, and of three


DEPTH, FINGER = np.array([0.5, 1.0, 1.5, 2.0, 0.7, 1.2, 1.9]) * 1e-3, np.array([0, 0, 0, 1, 1, 2, 2])


NOISE = np.array([0.3, -1.1, 0.6, 1.4, -0.2, 0.9, -0.7])
RATED = rated(
    np.array([1.0, 0.7, 1.4]),
    np.array([0.8, 0.3, 0.5]),
    np.array([0.3, 0.5, 0.2]),
    np.array([0.4, 0.1, 0.2]),
    np.full(3, 0.1),
    nu=np.array([4.0, 9.0, 30.0]),
    lapse=np.array([0.02, 0.1, 0.01]),
)


SCORED = Parameters(varsigma=np.array([0.5, 0.9, 0.4]))
PRESSED = Parameters(
    b=np.array([8e3, 6e3, 1e4]),
    m=np.array([3.8, 3.0, 4.0]),
    tau_b=np.array([0.3, 0.5, 0.2]),
    tau_m=np.array([0.4, 0.9, 0.3]),
    varsigma_f=np.full(3, 0.2),
)
CASES = {
    "shared errors of loads": Case(
        UncertainLoads(20.0 * np.exp(NOISE), DESIGN, RatingModel(FALLS), LoadErrors.of(DESIGN, SHARED_SD, LOADS)),
        SHARED,
        RATED,
    ),
    LogRatings: Case(LogRatings(20.0 * np.exp(NOISE), DESIGN, RatingModel(FALLS)), RATES, RATED),
    IntervalRatings: Case(
        IntervalRatings(20.0 * np.exp(NOISE), DESIGN, IntervalModel(RISES, law=STUDENT)),
        RATES,
        RATED.replace(omega=np.zeros(3)),
        left_out=1e-5,
    ),
    CategoryRatings: Case(
        CategoryRatings([1, 2, 3, 3, 4, 2, 4], DESIGN, CategoryModel(RISES, categories=4)),
        RATES,
        RATED.replace(
            gamma=np.array([0.4, 0.3, 0.5]),
            omega=np.zeros(3),
            gap_2=np.array([0.6, 0.9, 0.4]),
            gap_3=np.array([0.5, 0.3, 1.0]),
        ),
        left_out=1e-4,
        numbers=(1, 2, 3, 4),
    ),
    OrderRatings: Case(
        OrderRatings([2, 1, 4, 1, 2, 2, 1], DESIGN, OrderModel(RISES)),
        RATES,
        RATED.replace(gamma=np.array([0.1, 0.2, 0.15]), tau=np.zeros(3), omega=np.zeros(3)),
        numbers=(1, 3),
    ),
    PairRatings: Case(
        PairRatings([2, 1, 5, 1, 2, 2, 1], DESIGN, PairModel(RISES, law=LAPSES), lists=np.array([0, 0, 1, 2, 2, 3, 3])),
        RATES,
        RATED.replace(gamma=np.array([0.1, 0.2, 0.15]), tau=np.zeros(3), omega=np.zeros(3)),
        numbers=(1, 3),
    ),
    "pairs with a guess rate": Case(
        PairRatings(
            [2, 1, 5, 1, 2, 2, 1],
            DESIGN,
            PairModel(RISES, law=LAPSES, guesses_given=True),
            lists=np.array([0, 0, 1, 2, 2, 3, 3]),
            reference=np.array([0, 1, 0, 1, 0, 0, 1], bool),
        ),
        RATES,
        RATED.replace(
            gamma=np.array([0.1, 0.2, 0.15]), tau=np.zeros(3), omega=np.zeros(3), guess=np.array([0.3, 0.1, 0.0])
        ),
        numbers=(1, 3),
    ),
    UncertainLoads: Case(
        UncertainLoads(20.0 * np.exp(NOISE), DESIGN, RatingModel(FALLS), TOUCHES),
        np.concatenate([RATES, *FURTHER], axis=1),
        RATED,
    ),
    IndividualRatings: Case(
        IndividualRatings(20.0 * np.exp(NOISE), DESIGN, IndividualModel(RISES, grid=GRID)),
        WIDE,
        RATED.replace(omega=np.zeros(3), tau_b=np.array([0.2, 0.3, 0.4])),
    ),
    "raters who differ": Case(
        IntervalRatings(20.0 * np.exp(NOISE), DESIGN, IntervalModel(RISES, differ=("gamma", "varsigma"))),
        RATES,
        RATED.replace(
            gamma=np.array([0.2, 0.1, 0.15]),
            omega=np.zeros(3),
            tau_gamma=np.array([0.2, 0.4, 0.3]),
            tau_varsigma=np.array([0.3, 0.2, 0.4]),
        ),
        left_out=0.06,
    ),
    "raters who differ, with heavy tails": Case(
        IntervalRatings(20.0 * np.exp(NOISE), DESIGN, IntervalModel(RISES, law=STUDENT, differ=("gamma",))),
        RATES,
        RATED.replace(gamma=np.array([0.2, 0.1, 0.15]), omega=np.zeros(3), tau_gamma=np.array([0.2, 0.4, 0.3])),
        left_out=0.06,
    ),
    AggregatedRatings: Case(
        AggregatedRatings(20.0 * np.exp(NOISE), DESIGN, AggregatedModel(FALLS, raters=9)), RATES, RATED
    ),
    RaterSpreads: Case(
        RaterSpreads(0.6 * np.exp(0.4 * NOISE), DESIGN, SpreadModel(9)),
        np.empty((3, 0)),
        RATED,
        left_out=1e-6,
    ),
    StandardisedRatings: Case(StandardisedRatings(NOISE, DESIGN, StandardisedModel(RISES)), RATES, SCORED),
    CompressionForces: Case(CompressionForces(DEPTH, 0.3 * np.exp(0.4 * NOISE), FINGER, 3), np.empty((3, 0)), PRESSED),
}


CASE_NAMES = [getattr(name, "__name__", name) for name in CASES]


def batched_is_single(case):
    """Every member treats each point by itself."""
    found = densities(case.observed, case.rate, case.points)
    found["drive"] = case.observed.drive(case.rate, case.points)
    for k in range(3):
        rate, point = case.at(slice(k, k + 1))
        alone = {**densities(case.observed, rate, point), "drive": case.observed.drive(rate, point)}
        for name, values in found.items():
            assert_allclose(values[k], alone[name][0], rtol=1e-10, atol=1e-12, err_msg=name)


def conditionals_chain(case):
    """log p(y) is the sum of each row's density given those before it, and blocks chain in the same way."""
    y, total = case.observed, 0.0
    for row in range(1, ROWS):
        rest = y.without(np.arange(ROWS) > row)
        total = total + rest.left_out(case.rate, case.points).log_density[:, row]
    first = y.without(np.arange(ROWS) > 0).log_likelihood(case.rate, case.points)
    assert_allclose(first + total, y.log_likelihood(case.rate, case.points), rtol=1e-9, atol=ROWS * case.left_out)


def left_out_is_without(case):
    """What is said of rows and participants given the others is what the likelihood without them lacks."""
    y = case.observed
    found = densities(y, case.rate, case.points)
    for name, block in (("rows", np.arange(ROWS)), ("participants", y.design.participant)):
        expected = y.log_likelihood_blocks(case.rate, case.points, block)
        assert_allclose(found[name], expected, rtol=1e-8, atol=case.left_out, err_msg=name)
    only = np.arange(ROWS) == 2
    assert_allclose(y.without(only).values, y.values[~only], rtol=0)


def one_left_out_integrates_to_one(case):
    """The law of a rating given the others has mass 1, and the mass below the rating that is stated."""
    y = case.observed
    rate, point = case.at(slice(0, 1))
    scale, row = y.model.scale, 3
    start = float(scale.additive(y.values[row]))
    if case.numbers is not None:
        chance = []
        for number in case.numbers:
            values = y.values.copy()
            values[row] = number
            chance.append(float(np.exp(y.with_values(values).left_out(rate, point).log_density[0, row])))
        below = sum(
            c * (0.5 * (n == y.values[row]) + (n < y.values[row])) for c, n in zip(chance, case.numbers, strict=True)
        )
        assert_allclose(sum(chance), 1.0, atol=case.left_out)
        assert_allclose(below, y.left_out(rate, point).below[0, row], atol=case.left_out)
        return

    def density(additive):
        values = y.values.copy()
        values[row] = scale.natural(additive)
        slope = (scale.natural(additive + 1e-5) - scale.natural(additive - 1e-5)) / 2e-5
        return float(np.exp(y.with_values(values).left_out(rate, point).log_density[0, row]) * slope)

    error = max(1e-8, 0.1 * case.left_out)
    parts = [
        quad(density, *ends, epsabs=error, limit=200)[0] for ends in ((start - 12.0, start), (start, start + 12.0))
    ]
    atol = max(1e-6, case.left_out)
    assert_allclose(sum(parts), 1.0, atol=atol)
    assert_allclose(parts[0], y.left_out(rate, point).below[0, row], atol=atol)


def order_does_not_matter(case):
    """Rows in another order, and participants under other numbers, have the same densities."""
    y, order, people = case.observed, np.array([4, 2, 6, 0, 5, 1, 3]), np.array([2, 0, 1])
    other = shuffled(y, order, people)
    assert_allclose(other.log_likelihood(case.rate, case.points), y.log_likelihood(case.rate, case.points), rtol=1e-10)
    found = other.left_out(case.rate, case.points).log_density
    assert_allclose(found, y.left_out(case.rate, case.points).log_density[:, order], rtol=1e-9, atol=1e-12)
    found = other.log_likelihood_participants(case.rate, case.points)[:, people]
    assert_allclose(found, y.log_likelihood_participants(case.rate, case.points), rtol=1e-9, atol=1e-9)


def shuffled(y, order, people):
    """The same observations in another order, of renamed participants."""
    if hasattr(y, "indentation"):
        return type(y)(y.indentation[order], y.values[order], people[y.finger[order]], y.n_fingers)
    design = Design(y.design.condition[order], people[y.design.participant[order]], y.design.fabric, 3)
    if hasattr(y, "errors"):
        load = (y.load,) if hasattr(y, "load") else ()
        return type(y)(y.values[order], design, y.model, replace(y.errors, of_row=y.errors.of_row[order]), *load)
    own = y._arguments(order) if isinstance(y, OrderRatings) else {}
    return type(y)(y.values[order], design, y.model, **own)


DRAWS = 1600


def many(case):
    """One point many times over."""
    rate, point = case.at(0)
    return np.tile(rate, (DRAWS, 1)), point.each(lambda value: np.full(DRAWS, value))


def of_tables(y, made, ask):
    """What is asked of each replicated table; of those that are equal, as categories often are, once."""
    distinct, place = np.unique(made, axis=0, return_inverse=True)
    return np.array([ask(y.with_values(values)) for values in distinct])[place.ravel()]


def replicates_fit_the_density(case):
    """Tables replicated at one point have its density p: that at another point, q, has a mean ratio q / p of 1."""
    y, rng = case.observed, np.random.default_rng(5)
    rate, points = many(case)
    effects = y.new_effects(rng, points, (DRAWS,))
    made = y.replicate(rng, y.drive(rate, points), points, effects)
    first, point = case.at(slice(0, 1))
    name = next(n for n in ("varsigma", "varsigma_f") if n in y.model.needs)
    # a category tells less of the spread than a number does
    other = point.replace(**{name: (0.9 if case.numbers is None else 0.4) * getattr(point, name)})
    both = Parameters(**{name: np.append(getattr(point, name), value) for name, value in vars(other).items()})
    density = of_tables(y, made[:250], lambda table: table.log_likelihood(np.tile(first, (2, 1)), both))
    weight = np.exp(density[:, 1] - density[:, 0])
    assert abs(weight.mean() - 1.0) < 5.0 * weight.std() / np.sqrt(weight.size)
    assert weight.std() > 0.1  # the other point is told apart


def replicates_have_uniform_places(case):
    """Each row of a replicated table lies uniformly in its law given the other rows."""
    y, rng = case.observed, np.random.default_rng(6)
    rate, points = many(case)
    made = y.replicate(rng, y.drive(rate, points), points, y.new_effects(rng, points, (DRAWS,)))[:140]
    first, point = case.at(slice(0, 1))
    places = of_tables(y, made, lambda table: table.left_out(first, point).below[0])
    if case.numbers is not None:
        chance = np.exp(of_tables(y, made, lambda table: table.left_out(first, point).log_density[0]))
        places = places + (rng.uniform(size=places.shape) - 0.5) * chance
    for row in range(ROWS):
        assert kstest(places[:, row], "uniform").pvalue > 1e-4, row


def residuals_are_errors(case):
    """Residuals of tables made with given effects are normal with the stated spread."""
    y, rng = case.observed, np.random.default_rng(7)
    rate, points = many(case)
    effects = y.new_effects(rng, points, (DRAWS,))
    made = y.replicate(rng, y.drive(rate, points), points, effects)
    first, point = case.at(slice(0, 1))
    residual = np.empty((600, ROWS))
    for k in range(len(residual)):
        own = effects.part(slice(k, k + 1))
        table = y.with_values(made[k])
        if case.numbers is not None:
            table._shares = rng.uniform(size=ROWS)  # drawn once for every table
        residual[k] = table.residual(first, point, own)[0]
    spread = float(y.model.error_sd(point)[0])
    assert kstest(residual.ravel() / spread, "norm").pvalue > 1e-4


def effects_are_drawn_given_the_data(case):
    """Effects of the prior, a table made of them, effects drawn given it: both have the same law (Geweke)."""
    y, rng = case.observed, np.random.default_rng(8)
    rate, points = many(case)
    before = y.new_effects(rng, points, (DRAWS,))
    made = y.replicate(rng, y.drive(rate, points), points, before)
    first, point = case.at(slice(0, 1))
    after = [y.with_values(values).draw_effects(rng, first, point) for values in made[:200]]
    for name, values in vars(before).items():
        known = np.asarray(values).reshape(DRAWS, -1)
        drawn = np.array([np.asarray(vars(effects)[name]).reshape(-1) for effects in after])
        for column in range(known.shape[1]):
            assert kstest(drawn[:, column], known[200:, column]).pvalue > 1e-4, name


CHECKS = (
    batched_is_single,
    conditionals_chain,
    left_out_is_without,
    one_left_out_integrates_to_one,
    order_does_not_matter,
    replicates_fit_the_density,
    replicates_have_uniform_places,
    residuals_are_errors,
    effects_are_drawn_given_the_data,
)


def named(values):
    return {"ids": [value.__name__ for value in values]}


@pytest.mark.parametrize("check", CHECKS, **named(CHECKS))
@pytest.mark.parametrize("case", CASES.values(), ids=CASE_NAMES)
def test_likelihood_meets_the_contract(case, check):
    check(case)


def test_every_likelihood_has_a_case():
    assert {type(case.observed) for case in CASES.values()} == {*LIKELIHOODS}


@pytest.mark.parametrize("case", CASES.values(), ids=CASE_NAMES)
def test_members_and_shapes(case):
    y, model, rng = case.observed, case.observed.model, np.random.default_rng(1)
    assert isinstance(y, Likelihood)
    assert y.name
    effects = y.draw_effects(rng, case.rate, case.points)
    assert y.residual(case.rate, case.points, effects).shape == (3, ROWS)
    assert model.error_sd(case.points).shape == (3,)
    drive = y.drive(case.rate, case.points)
    # behind those of the typical finger, the conditions of raters' own
    assert drive.shape in {(3, y.design.n_conditions), case.rate.shape}
    typical = drive[:, : y.design.n_conditions]
    assert np.broadcast_shapes(y.predictor(case.rate, case.points).shape, typical.shape) == typical.shape
    assert model.typical(effects, drive).shape == drive.shape
    shared = {name for name, (values, axes) in model.named_effects(effects).items() if not axes}
    assert shared == set(model.levels)
    given = y.new_effects(rng, case.points, (3,), dict.fromkeys(shared, 0.25))
    assert all((model.named_effects(given)[name][0] == 0.25).all() for name in shared)
    values = model.scale.natural(model.scale.additive(y.values))
    assert_allclose(values, y.values, rtol=1e-12)


RATED_BY = {name: case for name, case in CASES.items() if isinstance(case.observed, RatingsLikelihood)}


@pytest.mark.parametrize("case", RATED_BY.values(), ids=[getattr(name, "__name__", name) for name in RATED_BY])
def test_other_raters_and_fabrics_are_of_the_population(case):
    """New raters and fabrics have effects of the prior's law; known fabrics and what all share stay as they are."""
    rng = np.random.default_rng(9)
    y, model = case.observed, case.observed.model
    _, points = many(case)
    if "omega" in model.needs:
        points = points.replace(omega=np.full(DRAWS, 0.3))
    before = y.new_effects(rng, points, (DRAWS,))
    others = model.for_others(rng, points, before, 2, np.array([-1, 2, -1, 0]))
    drawn, known = model.named_effects(others), model.named_effects(before)
    for name, (values, axes) in known.items():
        found = drawn[name][0]
        if not axes:
            assert_allclose(found, values, rtol=0, err_msg=name)
        elif axes == ("fabric",):
            assert_allclose(found[:, [1, 3]], values[:, [2, 0]], rtol=0)
            assert all(kstest(found[:, k], values[:, 1]).pvalue > 1e-4 for k in (0, 2))
            assert not (found[:, 0] == found[:, 2]).any()
        else:
            assert found.shape == (DRAWS, 2), name
            assert kstest(found[:, 1], values[:, 0]).pvalue > 1e-4, name
    # a rating for each new touch: both raters, four fabrics under one load, as many fingers as there are
    touches = Design(np.tile(np.arange(4), 2), np.repeat([0, 1], 4), np.arange(4), 2)
    fingers = 1 + model.grid.size if hasattr(model, "grid") else 1
    drive = y.drive_at(np.ones((DRAWS, 4 * fingers)), many(case)[0], points)
    assert model.draw_ratings(rng, touches, drive, points, others).shape == (DRAWS, 8)


class Shared(LogRatings):
    """Points of a batch are not kept apart."""

    def log_likelihood(self, mean_rate, parameters):
        return super().log_likelihood(np.broadcast_to(mean_rate.mean(axis=0), mean_rate.shape), parameters)


class Recentred(LogRatings):
    """Ratings that are left out take the centre of the response with them."""

    def without(self, rows):
        return type(self)(self.values[~rows], self.design.without(rows), self.model)


class Unnormalised(LogRatings):
    """A law of each rating given the others of another mass than 1."""

    def left_out(self, mean_rate, parameters):
        density, below = super().left_out(mean_rate, parameters)
        return RowsLeftOut(density + 1e-4, below)


class Ordered(LogRatings):
    """The first row counts for more."""

    def log_likelihood(self, mean_rate, parameters):
        return super().log_likelihood(mean_rate, parameters) + 1e-3 * np.log(self.values[0])


class Noisy(LogRatings):
    """Replicates with more noise than the density has."""

    def replicate(self, rng, drive, parameters, effects):
        return super().replicate(rng, drive, parameters.replace(varsigma=2.0 * parameters.varsigma), effects)


class Stretched(LogRatings):
    """Residuals that are not errors of the stated spread."""

    def residual(self, mean_rate, parameters, effects):
        return 1.2 * super().residual(mean_rate, parameters, effects)


class Displaced(LogRatings):
    """Effects that are not drawn from their posterior."""

    def draw_effects(self, rng, mean_rate, parameters):
        effects = super().draw_effects(rng, mean_rate, parameters)
        return effects.replace(participant=effects.participant + 0.5)


BROKEN = {
    batched_is_single: Shared,
    conditionals_chain: Recentred,
    left_out_is_without: Recentred,
    one_left_out_integrates_to_one: Unnormalised,
    order_does_not_matter: Ordered,
    replicates_fit_the_density: Noisy,
    replicates_have_uniform_places: Noisy,
    residuals_are_errors: Stretched,
    effects_are_drawn_given_the_data: Displaced,
}


@pytest.mark.parametrize("check", CHECKS, **named(CHECKS))
def test_a_broken_likelihood_fails(check):
    """Negative controls: every check finds a fault that it is there for."""
    right = CASES[LogRatings]
    broken = BROKEN[check](right.observed.values, DESIGN, right.observed.model)
    with pytest.raises(AssertionError):
        check(Case(broken, right.rate, right.points))


def test_models_are_pairs_of_a_scale_and_an_error_law():
    assert {scale.name for scale, _ in RATING_MODELS} == {*RATING_SCALES}
    for scale, error in RATING_MODELS:
        for direction in (RISES, FALLS):
            model = rating_model(scale, direction, error)
            assert (model.scale, model.error, model.direction) == (scale, error, direction)
            values = np.full(ROWS, 1.0 if scale is CATEGORIES else 0.5)
            assert type(model.observe(values, DESIGN)) in LIKELIHOODS
    cauchy = replace(NORMAL, name="cauchy")
    with pytest.raises(InputError, match="no model of magnitude with cauchy errors; expected one of magnitude with n"):
        rating_model(MAGNITUDE, RISES, cauchy)
    with pytest.raises(InputError, match="'likert' is not known, expected magnitude or standardised or slider or c"):
        scale_named("likert")


def test_terms_without_a_response_need_no_rate():
    """Forces alone: one point, and batches by the shape of the empty response or of the parameters."""
    case = CASES[CompressionForces]
    _, point = case.at(0)
    single = case.observed.log_likelihood(NO_RESPONSE, point)
    assert single.shape == ()
    effects = case.observed.draw_effects(np.random.default_rng(1), np.empty((4, 0)), point)
    assert effects.log_b.shape == (4, 3)
    assert_allclose(case.observed.log_likelihood(NO_RESPONSE, case.points)[0], single, rtol=1e-12)


PACKAGE = Path(softness_bayes.__file__).parent
ROOMS = ("checking", "checkpoints", "claims", "results", "runs", "report", "plotting", "cli", "bench")
"""Rooms that must not know which likelihood they are given."""


def trees(*rooms):
    return {path: ast.parse(path.read_text()) for room in rooms for path in sorted((PACKAGE / room).rglob("*.py"))}


def test_scales_laws_and_directions_are_equal_in_other_processes():
    """Workers have copies of them, so that nothing may compare them by identity; a slider keeps its own ends."""
    named = *scales.RATING_SCALES.values(), *error_laws.ERROR_LAWS.values(), error_laws.GUMBEL
    for one in (*named, scales.RISES, scales.FALLS, scales.FREE):
        assert pickle.loads(pickle.dumps(one)) == one
    own = scales.slider_between(0.0, 100.0)
    assert pickle.loads(pickle.dumps(own)).ends == (0.0, 100.0)
    kinds = scales.Scale, error_laws.ErrorLaw, scales.RatingDirection
    places = {**vars(error_laws), **vars(scales)}
    names = {name for name, value in places.items() if isinstance(value, kinds)}
    assert {"SLIDER", "STUDENT", "FREE"} <= names
    for path, tree in trees(*ROOMS, "model", "people", "results", "runs", "report").items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Compare) and isinstance(node.ops[0], (ast.Is, ast.IsNot)):
                compared = ast.unparse(node.comparators[0]).removeprefix("scales.")
                assert compared not in names, f"{path}: line {node.lineno}"
