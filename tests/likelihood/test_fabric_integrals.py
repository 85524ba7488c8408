"""Fabrics' own deviations with intervals and heavy tails: Laplace's method against brute force and closed forms."""

from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import logsumexp
from scipy.stats import kstest, norm

from softness_bayes.likelihood.categories import CategoryModel, CategoryRatings
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.directions import RISES
from softness_bayes.likelihood.error_laws import LAPSES, NORMAL, STUDENT
from softness_bayes.likelihood.fabric_integrals import standard_draws
from softness_bayes.likelihood.fabric_laws import FabricLaw, roots
from softness_bayes.likelihood.intervals import IntervalModel, IntervalRatings, SliderModel
from softness_bayes.likelihood.magnitude import RatingModel
from softness_bayes.likelihood.random_effects import Effects
from softness_bayes.likelihood.ratings import RatingParameters
from softness_bayes.likelihood.stated import Stated

LAWS = NORMAL, STUDENT, LAPSES
POINTS = 2
GRID, REACH = 31, 4.5  # points of each fabric's deviation, and their extent in its prior's standard deviations


def design_of(people, fabrics, loads, repeats):
    condition = np.tile(np.repeat(np.arange(fabrics * loads), repeats), people)
    person = np.repeat(np.arange(people), fabrics * loads * repeats)
    return Design(condition, person, np.repeat(np.arange(fabrics), loads), people)


def table(model, step=0.0, seed=1, people=4, fabrics=2, loads=2, repeats=3, omega=0.5, level=1.2):
    """Simulated ratings with their likelihood, mean rates and points near the truth."""
    rng, design = np.random.default_rng(seed), design_of(people, fabrics, loads, repeats)

    def around(value):
        return value * np.exp(0.15 * rng.standard_normal(POINTS))

    # a slider's log odds are small numbers
    small = 0.4 if model.end == 1.0 else 1.0
    named = {"gamma": around(0.8 * small), "tau": around(0.5), "varsigma": around(0.4), "omega": around(omega)}
    named |= {"eps": np.full(POINTS, 0.1), "nu": around(4.0), "lapse": around(0.04)}
    named |= {f"gap_{k}": around(0.7) for k in (2, 3)}
    points = RatingParameters(*(np.broadcast_to(np.asarray(v, float), POINTS) for v in model.take(named)))
    rate = np.geomspace(0.3, 30.0, fabrics * loads) * np.exp(0.1 * rng.standard_normal((POINTS, fabrics * loads)))
    first = RatingParameters(*(v[:1] for v in points))
    effects = model.draw_effects(rng, first, (1,), people, fabrics, {"mu": np.array([level * small])})
    values = model.draw_ratings(rng, design, model.drive(design, rate[:1], first), first, effects)[0]
    none = np.zeros(values.size)
    said = Stated(values, none + step, none + step / 2, none + (model.end - step / 2), model.end)
    values = said.rounded(values) if step else values
    return model.observe(values, design, said if step else None), rate, points


def shifted(observed, shift):
    """The likelihood without deviations, every fabric's expectation shifted by given numbers (draws, fabrics)."""

    class Shifted(type(observed)):
        def drive(self, mean_rate, parameters):
            return super().drive(mean_rate, parameters) + shift[:, self.design.fabric]

    return Shifted(
        observed.values,
        observed.design,
        observed.model,
        observed._over,
        observed._stated,
        observed._quadrature,
        observed._lapses,
    )


def on_grid(observed, rate, points, k):
    """Deviations on a dense grid, (grid, fabrics), and the log of the joint density times the grid's cell."""
    omega = float(points.omega[k])
    axis = np.linspace(-REACH, REACH, GRID) * omega
    size = observed.design.n_fabrics
    f = np.stack(np.meshgrid(*[axis] * size, indexing="ij"), axis=-1).reshape(-1, size)
    one = RatingParameters(*(np.array(v[k]) for v in points))._replace(omega=np.array(0.0))
    # in parts that are not divided any more
    parts = np.array_split(f, 4)
    density = np.concatenate([shifted(observed, part).log_likelihood(rate[k], one) for part in parts])
    return f, density + norm.logpdf(f, 0.0, omega).sum(axis=1) + size * np.log(axis[1] - axis[0])


def brute_force(observed, rate, points):
    return np.array([logsumexp(on_grid(observed, rate, points, k)[1]) for k in range(POINTS)])


MODELS = {
    **{f"whole numbers, {law.name}": (IntervalModel(RISES, law=law), 1.0) for law in LAWS},
    **{f"exact numbers, {law.name}": (IntervalModel(RISES, law=law), 0.0) for law in LAWS},
    "slider": (SliderModel(RISES), 0.05),
    "categories": (CategoryModel(RISES, categories=4), 0.0),
}
LARGEST = {"normal": 0.002, "student": 0.03, "lapses": 0.08, "categories": 0.02}
"""Largest error of Laplace's method at these tables of 24 ratings of each fabric, by error law or scale."""


@pytest.mark.parametrize("case", MODELS)
def test_density_is_that_of_brute_force(case):
    model, step = MODELS[case]
    observed, rate, points = table(model, step)
    if case == "whole numbers, normal":
        assert (observed.values < 0.5).any()  # ratings of 0
    expected = brute_force(observed, rate, points)
    largest = LARGEST.get(case, LARGEST[model.law.name])
    assert_allclose(observed.log_likelihood(rate, points), expected, rtol=0, atol=largest)
    # the reference of the check after each run
    assert_allclose(observed.finer().log_likelihood(rate, points), expected, rtol=0, atol=max(0.2 * largest, 1e-3))
    # deviations matter, so that none of these could be met without them
    without = observed.log_likelihood(rate, points._replace(omega=np.zeros(POINTS)))
    assert (np.abs(without - expected) > 0.3).all()


def wrong_sign(law):
    return law.log_factor + 2.0 * law.log_root


def no_determinant(law):
    return law.log_factor + law.log_root


def no_prior(law):
    return law.log_factor + 0.5 * (law.z**2).sum(axis=-1)


@pytest.mark.parametrize("wrong", [wrong_sign, no_determinant, no_prior])
def test_a_wrong_formula_fails(wrong, monkeypatch):
    """Negative controls of the test by brute force."""
    observed, rate, points = table(*MODELS["whole numbers, normal"])
    expected = brute_force(observed, rate, points)
    law = observed._fabrics.normal(observed._given(rate, points)[0], 0.1)
    error = np.abs(observed.log_likelihood(rate, points) - expected)
    moved = wrong(law) - law.log_factor
    assert (np.abs(moved) > 20.0 * error).all()
    assert (np.abs(moved) > 20.0 * LARGEST["normal"]).all()


MEMBERS = "log_likelihood", "log_likelihood_loo", "below_loo", "log_likelihood_participants"


@pytest.mark.parametrize("case", ["whole numbers, normal", "exact numbers, student", "slider", "categories"])
def test_no_deviations_are_the_limit_of_small_ones(case):
    observed, rate, points = table(*MODELS[case])
    small, none = (points._replace(omega=np.full(POINTS, omega)) for omega in (1e-9, 0.0))
    found = observed.log_likelihood(rate, small)
    assert_allclose(found, observed.log_likelihood(rate, none), rtol=0, atol=1e-10)


def test_exact_numbers_with_normal_errors_are_the_closed_form():
    observed, rate, points = table(*MODELS["exact numbers, normal"], fabrics=3, people=3)
    closed = RatingModel(RISES).observe(observed.values, observed.design)
    for member in MEMBERS:
        found, expected = (getattr(one, member)(rate, points) for one in (observed, closed))
        assert_allclose(found, expected, rtol=0, atol=1e-8, err_msg=member)
    assert_allclose(observed.finer().log_likelihood(rate, points), closed.log_likelihood(rate, points), atol=1e-8)
    effects = observed.draw_effects(np.random.default_rng(2), rate, points)
    assert_allclose(observed.residual(rate, points, effects), closed.residual(rate, points, effects), atol=1e-10)


def test_fine_grids_have_the_closed_form_as_their_limit():
    step = 1e-5
    observed, rate, points = table(IntervalModel(RISES), step, people=3)
    closed = RatingModel(RISES).observe(observed.values, observed.design)
    found = observed.log_likelihood(rate, points) - observed.design.n_rows * np.log(step)
    assert_allclose(found, closed.log_likelihood(rate, points), rtol=0, atol=1e-7)


@pytest.mark.parametrize("case", MODELS)
def test_order_of_rows_and_draws_does_not_matter(case):
    observed, rate, points = table(*MODELS[case], fabrics=3, people=3)
    order = np.random.default_rng(3).permutation(observed.design.n_rows)
    design = Design(observed.design.condition[order], observed.design.participant[order], observed.design.fabric, 3)
    stated = observed._stated.take(order)
    other = type(observed)(observed.values[order], design, observed.model, stated=stated)
    for member in MEMBERS:
        found, expected = (getattr(one, member)(rate, points) for one in (other, observed))
        expected = expected[:, order] if member in MEMBERS[1:3] else expected
        assert_allclose(found, expected, rtol=0, atol=1e-9, err_msg=member)
        last = getattr(observed, member)(rate[1:], RatingParameters(*(v[1:] for v in points)))
        assert_allclose(getattr(observed, member)(rate, points)[1:], last, rtol=0, atol=1e-10, err_msg=member)


ALONE = {"whole numbers, normal": 0.005, "whole numbers, student": 0.04, "exact numbers, lapses": 0.06}


@pytest.mark.parametrize("case", ALONE)
def test_left_out_rows_and_raters_are_those_of_brute_force(case):
    observed, rate, points = table(*MODELS[case])
    whole = brute_force(observed, rate, points)
    rows = np.arange(observed.design.n_rows)
    alone = observed.log_likelihood_loo(rate, points)
    for row in (0, 9):
        rest = brute_force(observed.without(rows == row), rate, points)
        assert_allclose(alone[:, row], whole - rest, rtol=0, atol=ALONE[case])
    person = observed.design.participant == 2
    found = observed.log_likelihood_participants(rate, points)[:, 2]
    assert_allclose(found, whole - brute_force(observed.without(person), rate, points), rtol=0, atol=ALONE[case])


def test_rows_have_places_below_them():
    """The probability below a number, by the densities of all numbers in its place."""
    observed, rate, points = table(*MODELS["whole numbers, normal"])
    row, below, chance = 5, 0.0, []
    for number in range(60):
        values = observed.values.copy()
        values[row] = max(number, 0.25)
        one = np.exp(observed.with_values(values).log_likelihood_loo(rate, points)[:, row])
        below += (0.5 * (values[row] == observed.values[row]) + (values[row] < observed.values[row])) * one
        chance.append(one)
    assert_allclose(np.sum(chance, axis=0), 1.0, atol=0.01)
    assert_allclose(observed.below_loo(rate, points)[:, row], below, atol=0.01)


@pytest.mark.parametrize("case", ["whole numbers, normal", "exact numbers, student", "categories"])
def test_effects_are_drawn_from_their_law(case):
    observed, rate, points = table(*MODELS[case])
    draws = 1000
    same = RatingParameters(*(np.full(draws, v[0]) for v in points))
    effects = observed.draw_effects(np.random.default_rng(4), np.tile(rate[0], (draws, 1)), same)
    f, density = on_grid(observed, rate, points, 0)
    weight = np.exp(density - logsumexp(density))
    mean = weight @ f
    sd = np.sqrt(weight @ (f - mean) ** 2)
    assert_allclose(effects.fabric.mean(axis=0), mean, atol=5.0 * sd.max() / np.sqrt(draws))
    assert_allclose(effects.fabric.std(axis=0), sd, rtol=0.12)
    for k in range(1):
        axis = np.unique(f[:, k])
        own = np.array([weight[f[:, k] == x].sum() for x in axis])
        edges = np.concatenate([axis - 0.5 * (axis[1] - axis[0]), axis[-1:] + 0.5 * (axis[1] - axis[0])])
        law = partial(np.interp, xp=edges, fp=np.concatenate([[0.0], np.cumsum(own)]))
        assert kstest(effects.fabric[:, k], law).pvalue > 1e-3
    # raters and level follow the deviations: conditional on these, they are those of the table without deviations
    order = np.argsort(effects.fabric.sum(axis=1))
    low, high = effects.mu[order[:200]].mean(), effects.mu[order[-200:]].mean()
    assert low > high


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_draws_of_the_prior_have_finite_densities(law):
    """Far from the data, where noise is tiny or all deviations are large, Newton's method ends at a finite point."""
    observed, rate, _ = table(IntervalModel(RISES, law=law), 1.0, people=3)
    rng, draws = np.random.default_rng(5), 40
    named = {"gamma": rng.lognormal(0, 0.5, draws), "tau": np.abs(rng.normal(0, 1, draws)), "eps": np.full(draws, 0.1)}
    named |= {"varsigma": 10 ** rng.uniform(-2, 0.5, draws), "omega": np.abs(rng.normal(0, 2, draws))}
    named |= {"nu": 10 ** rng.uniform(0, 3, draws), "lapse": rng.uniform(0, 0.5, draws)}
    points = RatingParameters(*(np.broadcast_to(np.asarray(v), draws) for v in observed.model.take(named)))
    rates = np.tile(rate[0], (draws, 1))
    found = observed.log_likelihood(rates, points)
    assert np.isfinite(found).all()
    assert np.isfinite(observed.log_likelihood_loo(rates, points)).all()
    # where Newton's method does not converge, the density is not overstated
    assert (found < observed.finer().log_likelihood(rates, points) + 100.0).all()


def test_fabrics_without_ratings_have_deviations_of_the_prior():
    observed, rate, points = table(*MODELS["whole numbers, normal"], fabrics=3, people=3)
    rest = observed.without(observed.design.fabric[observed.design.condition] == 2)
    draws = 400
    same = RatingParameters(*(np.full(draws, v[0]) for v in points))
    drawn = rest.draw_effects(np.random.default_rng(6), np.tile(rate[0], (draws, 1)), same).fabric
    assert kstest(drawn[:, 2] / points.omega[0], "norm").pvalue > 1e-3
    assert drawn[:, 0].std() < 0.9 * points.omega[0]


def test_new_fabrics_and_replicates_have_deviations():
    model = IntervalModel(RISES)
    observed, rate, points = table(model, 1.0)
    draws, rng = 4000, np.random.default_rng(7)
    same = RatingParameters(*(np.full(draws, v[0]) for v in points))
    none = Effects(np.full(draws, 3.0), np.zeros((draws, 4)), np.zeros((draws, 2)))
    new = model.for_others(rng, same, none, 1, np.array([-1, 0]))
    assert_allclose(new.fabric.std(axis=0), [points.omega[0], 0.0], rtol=0.05)
    assert set(model.named_effects(new)) == {"mu", "participant_effect", "fabric_effect"}
    drive = observed.drive(np.tile(rate[0], (draws, 1)), same)
    lifted = none._replace(fabric=np.tile([1.0, 0.0], (draws, 1)))
    rows = observed.design.fabric[observed.design.condition] == 0
    plain, moved = (np.log(observed.replicate(rng, drive, same, e)).mean(axis=0) for e in (none, lifted))
    assert_allclose((moved - plain)[rows], 1.0, atol=0.1)
    assert_allclose((moved - plain)[~rows], 0.0, atol=0.1)


def test_reference_draws_are_standard():
    for size, dimension in ((64, 12), (64, 40)):
        x = standard_draws(size, dimension)
        assert x.shape == (size, dimension)
        assert_allclose(x.mean(axis=0), 0.0, atol=1e-12)
        assert_allclose(standard_draws(size, dimension), x, rtol=0)
    x = standard_draws(64, 12)
    assert_allclose(x.T @ x / 64, np.eye(12), atol=1e-10)


def test_matrices_that_are_not_positive_have_no_root():
    matrices = np.array([[[4.0, 0.0], [0.0, 9.0]], [[1.0, 2.0], [2.0, 1.0]]])
    found, good = roots(matrices)
    assert good.tolist() == [True, False]
    assert_allclose(found[0], np.diag([2.0, 3.0]))
    assert_allclose(found[1], np.eye(2))
    law = FabricLaw(*[np.zeros((1, 2))] * 2, found[:1], *[np.zeros((1, 2))] * 6)
    assert_allclose(law.at(np.array([[[1.0, 1.0]]])), [[[0.5, 1.0 / 3.0]]])
    assert_allclose(law.log_root, np.log(6.0))


def test_categories_keep_their_thresholds():
    observed, rate, points = table(*MODELS["categories"])
    assert type(observed) is CategoryRatings
    assert isinstance(observed, IntervalRatings)
    effects = observed.draw_effects(np.random.default_rng(8), rate, points)
    assert effects.threshold.shape == (POINTS, 3)
    assert (effects.fabric != 0.0).all()
