"""Raters whose answers all lie in intervals with an open end: the integrals are those by brute force."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import log_ndtr, logsumexp

from softness_bayes.data import Fabrics
from softness_bayes.likelihood import box_integrals, intervals, walled_integrals
from softness_bayes.likelihood.categories import CategoryModel
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.error_laws import LAPSES, NORMAL, STUDENT
from softness_bayes.likelihood.intervals import IntervalModel, SliderModel
from softness_bayes.likelihood.quadrature import DENSE, FINEST
from softness_bayes.likelihood.rater_integrals import RaterIntegrals
from softness_bayes.likelihood.scale_starts import Starts
from softness_bayes.likelihood.stated import Stated
from softness_bayes.likelihood.walled_integrals import Resolution, WalledIntegrals, Walls
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.scenes import usual_values
from softness_bayes.runs.calibration_scene import CalibrationScene
from softness_bayes.runs.replicate import simulate
from softness_bayes.touch.readings import MENDED

FABRICS, TAU = 12, 0.6
RATE = np.geomspace(1.0, 40.0, FABRICS)[None]
MODELS = {"categories": CategoryModel, "whole numbers": IntervalModel, "slider": SliderModel}
NOISES = 0.5, 0.1, 0.05, 0.02, 0.006


def design_of(people):
    return Design(
        np.tile(np.arange(FABRICS), people), np.repeat(np.arange(people), FABRICS), np.arange(FABRICS), people
    )


def table(kind, people, walled, varsigma, law=NORMAL):
    """Simulated ratings, of which those of the first raters are all in the first interval, or in the last."""
    rng, design = np.random.default_rng(0), design_of(people)
    model = MODELS[kind](law=law, **({"categories": 4} if kind == "categories" else {}))
    values = {"gamma": 0.7, "tau": TAU, "varsigma": varsigma, "eps": 0.1, "nu": 4.0, "lapse": 0.03}
    given = model.take({k: np.array([v]) for k, v in (values | {"gap_2": 0.6, "gap_3": 0.7}).items()})
    own = (1.5 if kind == "whole numbers" else 0.8) + TAU * rng.standard_normal(people)
    latent = own[design.participant] + model.drive(design, RATE, given)[0][design.condition]
    latent += varsigma * rng.standard_normal(latent.size)
    first, last = design.participant < walled, (design.participant == walled - 1) & (walled > 1)
    if kind == "categories":
        category = 1.0 + (latent[:, None] > [0.0, 0.6, 1.3]).sum(axis=1)
        # an answer in between, so that no other rater's answers are all in the end categories
        category[~first & (design.condition == 4)] = 2.0
        return model.observe(np.where(last, 4.0, np.where(first, 1.0, category)), design), given
    none = np.zeros(latent.size)
    if kind == "whole numbers":
        numbers = np.where(first, 0.25, np.maximum(np.round(np.exp(latent)), 1.0))
        return model.observe(numbers, design, Stated(numbers, none + 1.0, none + 0.5, none + np.inf)), given
    shares = np.clip(np.round(50.0 / (1.0 + np.exp(-latent))) / 50.0, 0.02, 0.98)
    shares = np.where(last, 0.995, np.where(first, 0.005, shares))
    return model.observe(shares, design, Stated(shares, none + 0.02, none + 0.01, none + 0.99, 1.0)), given


def log_between(low, high):
    flip = low + high > 0  # differences in the tail in which both are small
    low, high = np.where(flip, -high, low), np.where(flip, -low, high)
    with np.errstate(divide="ignore"):
        return log_ndtr(high) + np.log1p(-np.exp(log_ndtr(low) - log_ndtr(high)))


def by_force(observed, given):
    """Log probability of all answers, by sums over the level and every a_p whose spacing resolves all edges."""
    tau, varsigma, level = given.tau[0], given.varsigma[0], observed.model.level
    rows = observed._rows_at(given).take(observed._back)
    drive = observed.drive(RATE, given)[0][observed.design.condition]
    low, high = (end.reshape(-1, drive.size)[0] - drive for end in (rows.low, rows.high))
    edges = np.unique(np.concatenate([low, high])[np.isfinite(np.concatenate([low, high]))])
    ends = min(level.mean - 8 * level.sd, edges[0] - 5), max(level.mean + 8 * level.sd, edges[-1] + 5)
    cuts = np.concatenate([np.arange(*ends, 0.2), (edges[:, None] + varsigma * np.arange(-9, 9.1, 0.75)).ravel()])
    cuts = np.unique(cuts)
    x, weight = np.polynomial.legendre.leggauss(6)
    half = 0.5 * np.diff(cuts)[:, None]
    a, weight = (cuts[:-1, None] + half * (1.0 + x)).ravel(), (half * weight).ravel()
    mu = np.arange(*ends, 0.05)
    normal = np.exp(-0.5 * ((a - mu[:, None]) / TAU) ** 2) / (tau * np.sqrt(2.0 * np.pi))
    total = -0.5 * ((mu - level.mean) / level.sd) ** 2 - np.log(level.sd * np.sqrt(2.0 * np.pi)) + np.log(0.05)
    for rater in range(observed.design.n_participants):
        value = np.zeros(a.size)
        for k in np.flatnonzero(observed.design.participant == rater):
            value += log_between((low[k] - a) / varsigma, (high[k] - a) / varsigma)
        with np.errstate(divide="ignore"):
            total += np.log(normal @ (weight * np.exp(value - value.max()))) + value.max()
    return logsumexp(total)


@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize(
    ("people", "walled", "noises"),
    [
        (5, 0, (0.1, 0.02, 0.006)),
        (5, 1, (0.5, 0.05, 0.006)),
        (5, 3, (0.5, 0.05, 0.006)),
        (3, 3, NOISES),
        (1, 1, NOISES),
    ],
    ids=["none", "one", "several", "all", "alone"],
)
def test_integrals_are_those_by_force(kind, people, walled, noises, monkeypatch):
    for varsigma in noises:
        observed, given = table(kind, people, walled, varsigma)
        expected = by_force(observed, given)
        assert abs(observed.log_likelihood(RATE, given)[0] - expected) < 2e-4, varsigma
        assert abs(observed.finer().log_likelihood(RATE, given)[0] - expected) < 2e-4, varsigma
        if walled == people and varsigma == 0.02:
            # negative control: expansions about the modes
            monkeypatch.setattr(intervals, "WalledIntegrals", RaterIntegrals)
            wrong = observed.with_quadrature(FINEST)
            assert abs(wrong.log_likelihood(RATE, given)[0] - expected) > 0.05, varsigma
            monkeypatch.undo()
        if walled == 0 and varsigma == 0.02 and kind == "categories":
            # negative control: expansions about the modes, of intervals much wider than the noise
            monkeypatch.setattr(box_integrals, "WIDE", np.inf)
            assert abs(observed.log_likelihood(RATE, given)[0] - expected) > 0.05
            monkeypatch.undo()


@pytest.mark.parametrize(("law", "most"), [(STUDENT, 0.01), (LAPSES, 0.02)])
@pytest.mark.parametrize("kind", ["categories", "whole numbers"])
def test_other_laws_are_those_on_evenly_spaced_points(law, most, kind):
    for varsigma in (0.5, 0.1):
        observed, given = table(kind, 3, 3, varsigma, law)
        expected = observed.with_quadrature(DENSE).log_likelihood(RATE, given)[0]
        assert abs(observed.log_likelihood(RATE, given)[0] - expected) < most, varsigma


def test_search_from_far_beyond_a_wall(monkeypatch):
    """With heavy tails, the search for the modes began 40 000 error spreads off, and did not come back."""
    moduli, usual = np.geomspace(3e3, 6e5, 12), usual_values(MENDED)
    scene = CalibrationScene(Fabrics(tuple("abcdefghijkl"), effective_modulus=moduli), participants=5)
    held = {name: usual[name] for name in ("m", "alpha", "beta", "sigma_0", "c_Na", "c_K", "c_L", "c_A")}
    posterior = scene.model(ModelOptions(fix=held, errors=STUDENT, resolution=1.0)).posterior
    rng = np.random.default_rng((20261123, 1))
    observed, _ = simulate(posterior.observation, posterior, posterior.space.draw_prior(rng, 1)[0], rng)
    posterior = posterior.with_term(observed)
    assert observed._integrals.walled.size == 2
    theta = np.array([[124.4, 2.25, 1.84, 0.0726, 0.645, 95.9], [103.4, 2.93, 1.67, 0.0819, 1.58, 75.9]])
    given = posterior.response(theta), posterior.rating_parameters(theta)
    expected = observed.with_quadrature(DENSE).log_likelihood(*given)
    assert (expected < 0.0).all()  # probabilities of whole numbers
    assert_allclose(observed.log_likelihood(*given), expected, atol=3e-4)
    assert_allclose(observed.finer().log_likelihood(*given), expected, atol=3e-4)
    begin = Starts.near

    def far_off(self, steps, given, single):
        found = begin(self, steps, given, single)
        found.a[:, steps.walled] = -2900.0
        return found

    monkeypatch.setattr(Starts, "near", far_off)
    assert_allclose(observed.log_likelihood(*given), expected, atol=3e-4)
    # negative control: the curvature that is assumed of other raters
    monkeypatch.setattr(WalledIntegrals, "least_curvature", RaterIntegrals.least_curvature)
    assert (np.abs(observed.log_likelihood(*given) - expected) > 100.0).all()


@pytest.mark.parametrize("law", [NORMAL, STUDENT])
def test_raters_with_equal_rows_are_integrated_once(law, monkeypatch):
    observed, given = table("categories", 5, 5, 0.3, law)
    rows = observed._given(RATE, given)[0]
    walls = observed._integrals._walls(rows)
    assert walls.kind.tolist() == [0, 0, 0, 0, 1]  # the last one's answers are in the other end category
    assert walls.distinct().rows.size == 2
    found = observed.log_likelihood(RATE, given)
    monkeypatch.setattr(Walls, "distinct", lambda self: self)
    monkeypatch.setattr(walled_integrals, "_numbered", lambda laws: np.arange(len(laws)))
    assert_allclose(found, observed.log_likelihood(RATE, given), atol=3e-5)


def test_raters_of_other_fabrics_are_of_another_kind():
    design = Design(np.array([0, 1, 2, 0, 1, 3]), np.array([0, 0, 0, 1, 1, 1]), np.arange(4), 2)
    observed = CategoryModel(categories=4).observe(np.ones(6), design)
    given = table("categories", 1, 1, 0.3)[1]
    walls = observed._integrals._walls(observed._given(RATE[:, ::3], given)[0])
    assert walls.kind.tolist() == [0, 1]


def test_finer_integrals_reveal_an_error_at_the_walls(monkeypatch):
    observed, given = table("whole numbers", 5, 2, 0.05)
    finer = observed.finer()
    assert abs((finer.log_likelihood(RATE, given) - observed.log_likelihood(RATE, given))[0]) < 1e-4
    # negative control: panels too few for the wall
    coarse = Resolution(walled_integrals.USUAL.at[::8], 2, 1)
    monkeypatch.setattr(walled_integrals, "USUAL", coarse)
    monkeypatch.setattr(WalledIntegrals._walls, "__defaults__", (coarse,))
    assert abs((finer.log_likelihood(RATE, given) - observed.log_likelihood(RATE, given))[0]) > 0.01


@pytest.mark.parametrize("walled", [1, 2, 3])
def test_effects_and_answers_left_out(walled):
    """Draws and left-out densities agree with those on evenly spaced points."""
    observed, given = table("categories", 3, walled, 0.1)
    dense, n = observed.with_quadrature(DENSE), 500
    many, rate = type(given)(*(np.repeat(one, n) if np.ndim(one) else one for one in given)), np.repeat(RATE, n, axis=0)
    own = observed.draw_effects(np.random.default_rng(1), rate, many)
    other = dense.draw_effects(np.random.default_rng(2), rate, many)
    for one, two in ((own.mu[:, None], other.mu[:, None]), (own.participant, other.participant)):
        error = two.std(axis=0) * np.sqrt(2.0 / n)
        assert (np.abs(one.mean(axis=0) - two.mean(axis=0)) < 4.0 * error).all()
        assert_allclose(one.std(axis=0), two.std(axis=0), rtol=0.16)
    if walled == 3:
        return  # without a rater's own answers the level is far from normal, as left-out densities assume
    found, expected = (one.log_likelihood_participants(RATE, given) for one in (observed, dense))
    assert_allclose(found, expected, atol=0.1)
    found, expected = (one.log_likelihood_loo(RATE, given) for one in (observed, dense))
    assert_allclose(found, expected, atol=0.1)


def test_a_batch_is_its_points():
    observed, given = table("slider", 4, 2, 0.05)
    noise = np.array([0.4, 0.05, 0.02])
    whole = type(given)(*(np.repeat(one, 3) if np.ndim(one) else one for one in given))._replace(varsigma=noise)
    found = observed.log_likelihood(np.repeat(RATE, 3, axis=0), whole)
    each = [observed.log_likelihood(RATE, given._replace(varsigma=noise[k : k + 1]))[0] for k in range(3)]
    assert_allclose(found, each, rtol=1e-5)


def test_other_tables_keep_the_expansions():
    observed = CategoryModel(categories=4).observe(np.tile([1.0, 1.0, 2.0, 2.0, 3.0, 4.0], 6), design_of(3))
    assert type(observed._integrals) is RaterIntegrals
    assert type(table("categories", 5, 1, 0.1)[0]._integrals) is WalledIntegrals
