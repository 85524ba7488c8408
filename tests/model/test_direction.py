"""Which way ratings run with stiffness: rank correlations by another way, chance levels, and what must not be said."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import page_trend_test, spearmanr

from softness_bayes.data import Experiment, Fabrics, Ratings
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.error_laws import NORMAL
from softness_bayes.likelihood.layout import Layout
from softness_bayes.likelihood.scales import FALLS, FREE, RISES
from softness_bayes.model.build import ExperimentModel, build
from softness_bayes.model.direction import LEVEL, condition_means, find_trend, odd_raters, rank_correlations
from softness_bayes.model.options import ModelOptions
from softness_bayes.touch.contact import Indentation
from softness_bayes.touch.scene import Discretisation


def layout_of(participants, modulus, loads=1, keep=None):
    """Everyone rates every fabric under every load, or the rows of those that are kept."""
    fabrics = len(modulus)
    conditions = fabrics * loads
    rows = np.arange(participants * conditions)
    rows = rows if keep is None else rows[keep]
    condition_fabric, load = np.divmod(np.arange(conditions), loads)
    design = Design(rows % conditions, rows // conditions, condition_fabric, participants)
    return Layout(design, np.asarray(modulus, float)[condition_fabric], load)


def ratings_of(rng, layout, slope, noise=0.3, spread=1.0):
    """Log ratings with a slope on log E_fab, moduli of the participants' own and noise."""
    d = layout.design
    x = np.log(layout.modulus)
    log = 3 + slope * (x - x.mean())[d.condition] + spread * rng.standard_normal(d.n_participants)[d.participant]
    return np.exp(log + noise * rng.standard_normal(d.n_rows))


def test_correlations_of_a_whole_table_are_those_of_scipy(rng):
    layout = layout_of(9, np.geomspace(1e3, 1e6, 7), 3)
    ratings = ratings_of(rng, layout, -0.02)
    found = find_trend(layout, ratings)
    mean = np.log(ratings).reshape(9, 7, 3).mean(axis=0)
    expected = [spearmanr(np.arange(7), mean[:, k]).statistic for k in range(3)]
    assert_allclose([one.value for one in found.loads], expected)
    assert found.mean.value == pytest.approx(np.mean(expected))
    assert found.fabrics == (7, 7, 7)
    for one in (*found.loads, found.mean):
        assert one.low <= one.value <= one.high


def test_the_interval_of_a_correlation_holds_the_estimate(rng):
    """Correlations of randomly weighted people lie below that of all, so that their quantiles may miss it."""
    missed = 0
    for _ in range(20):
        layout = layout_of(6, np.geomspace(1e3, 1e6, 8))
        ratings = ratings_of(rng, layout, 0.12, noise=0.8)
        found = find_trend(layout, ratings).mean
        assert found.low <= found.value <= found.high
        weights = rng.exponential(size=(200, 6))
        others = rank_correlations(layout, condition_means(layout, ratings, weights), layout.modulus)[1]
        missed += not np.quantile(others, 0.05) <= found.value <= np.quantile(others, 0.95)
    assert missed  # negative control


def test_gaps_do_not_bend_the_means(rng):
    """The softest fabric is rated by those who give small numbers alone: plain means would have ratings rise."""
    layout = layout_of(6, np.geomspace(1e3, 1e6, 6))
    d = layout.design
    keep = ~((d.condition == 0) & (d.participant >= 2))
    few = layout_of(6, np.geomspace(1e3, 1e6, 6), keep=keep)
    log = -0.1 * np.log(few.modulus)[few.design.condition] + 3.0 * (few.design.participant >= 2)
    found = find_trend(few, np.exp(log))
    assert found.mean.value == pytest.approx(-1.0)
    # by least squares over participants and conditions
    rows = np.zeros((few.design.n_rows, 12))
    rows[np.arange(few.design.n_rows), few.design.participant] = 1
    rows[np.arange(few.design.n_rows), 6 + few.design.condition] = 1
    assert_allclose(np.diff(np.linalg.lstsq(rows, log)[0][6:]), np.diff(-0.1 * np.log(few.modulus)), atol=1e-9)


def test_fewer_fabrics_than_tell_anything_shuffle_each_participant(rng):
    """Page's test, whose normal law SciPy gives for one side."""
    layout = layout_of(12, [1e3, 1e4, 1e5])
    ratings = ratings_of(rng, layout, 0.03, noise=0.5)
    found = find_trend(layout, ratings)
    page = page_trend_test(ratings.reshape(12, 3), method="asymptotic")
    one_sided = min(page.pvalue, 1 - page.pvalue)
    assert found.p_value == pytest.approx(2 * one_sided, rel=1e-6)


@pytest.mark.parametrize(
    ("fabrics", "participants"),
    [(8, 12), (2, 15), *(pytest.param(*few, marks=pytest.mark.slow) for few in ((3, 12), (6, 1)))],
)
def test_chance_is_called_a_trend_as_often_as_it_may(rng, fabrics, participants):
    layout = layout_of(participants, np.geomspace(1e3, 1e6, fabrics), 2)
    signs = [find_trend(layout, ratings_of(rng, layout, 0.0)).sign for _ in range(100)]
    assert np.mean(np.abs(signs)) < LEVEL + 3 * np.sqrt(LEVEL * (1 - LEVEL) / 100)


def test_a_rater_against_all_others_is_named_and_no_other(rng):
    """Ranks against the others' means, with gaps; a rater of one number is another case."""
    keep = np.sort(rng.choice(12 * 15, 150, replace=False))
    layout = layout_of(12, np.geomspace(1e3, 1e6, 15), keep=keep)
    who = layout.design.participant
    alike = np.log(ratings_of(rng, layout, 0.4))
    assert odd_raters(layout, np.exp(alike)) == ({}, (), ())
    whole = layout_of(12, np.geomspace(1e3, 1e6, 15))
    copied = ratings_of(rng, whole, 0.4)
    copied[60:75] = copied[45:60]
    assert odd_raters(whole, copied).copies == (4,)
    turned = np.where(who == 3, -alike, alike)
    turned[who == 5] = 1.0
    found = odd_raters(layout, np.exp(turned))
    assert [*found.against] == [3]
    assert found.against[3] < -0.8
    assert found.constant == (5,)


# the direction of a run

CLOTH = np.geomspace(2e4, 6e5, 6)

QUICK = ModelOptions(discretisation=Discretisation(8, 9.0, 1e-4))


def table(rng, slope, modulus=CLOTH, depth=2e-3, participants=8, noise=0.2):
    layout = layout_of(participants, modulus)
    ratings = ratings_of(rng, layout, slope, noise=noise).reshape(participants, len(modulus), 1)
    names = [f"f{k}" for k in range(len(modulus))]
    people = [f"p{k}" for k in range(participants)]
    filed = Ratings.crossed(people, names, (Indentation(depth),), ratings)
    return Experiment(filed, Fabrics(tuple(names), effective_modulus=np.asarray(modulus)), ())


@pytest.mark.parametrize(("slope", "direction"), [(0.4, RISES), (-0.4, FALLS)])
def test_the_data_decide(rng, slope, direction):
    experiment = table(rng, slope)
    found = ExperimentModel(experiment, ModelOptions()).direction
    assert (found.direction, found.asked, found.against_data) == (direction, False, False)
    assert found.evidence.firing == 1.0
    assert f"--direction {direction.name} was chosen from the data" in found.sentence
    decided = build(experiment, QUICK).options
    assert (decided.direction, decided.decided) == (direction, ("errors", "direction"))
    again = ModelOptions.from_record(decided.record())
    assert again == decided
    assert not ExperimentModel(experiment, again).direction.asked


def with_unknown(experiment, *places):
    """The same ratings, of which some fabrics have no modulus."""
    modulus = experiment.fabrics.effective_modulus.copy()
    modulus[[*places]] = np.nan
    return experiment._replace(fabrics=Fabrics(experiment.fabrics.names, effective_modulus=modulus))


def test_fabrics_of_unknown_modulus_have_no_place_in_the_trend(rng):
    """Their prior median would place them somewhere: here the stiffest ones among the softest."""
    whole = table(rng, 0.4)
    found, every = (
        ExperimentModel(one, ModelOptions()).direction.evidence for one in (with_unknown(whole, 5, 2), whole)
    )
    assert (found.left_out, every.left_out) == (2, 0)
    assert found.trend.fabrics == (4,)
    assert "; without 2 fabrics of unknown modulus" in found.sentence
    assert "unknown" not in every.sentence
    kept = np.array([0, 1, 3, 4])
    layout = layout_of(8, CLOTH[kept])
    rating = whole.ratings.rating.reshape(8, 6)[:, kept].ravel()
    assert_allclose(found.trend.mean.value, find_trend(layout, rating).mean.value)
    # with one known modulus, or none, there is no trend to be had, and the medians of the priors take their place
    assert ExperimentModel(with_unknown(whole, 1, 2, 3, 4, 5), ModelOptions()).direction.evidence.left_out == 0


def test_what_is_asked_for_is_taken_and_said_to_be_wrong(rng):
    experiment = table(rng, -0.4)
    found = ExperimentModel(experiment, ModelOptions(direction=RISES)).direction
    assert (found.direction, found.asked, found.against_data) == (RISES, True, True)
    assert found.sentence.startswith(
        "the direction contradicts the data: with --direction rises-with-firing the prediction"
    )
    asked = dataclasses.replace(QUICK, direction=RISES, errors=NORMAL)
    assert build(experiment, asked).options == asked
    right = ExperimentModel(experiment, ModelOptions(direction=FALLS)).direction
    assert not right.against_data
    assert right.sentence.startswith("--direction falls-with-firing, as asked: these ratings fall")


@pytest.mark.parametrize("modulus", [CLOTH, CLOTH[:1]])
def test_where_the_table_cannot_tell_both_directions_are_sampled(modulus):
    experiment = table(np.random.default_rng(3), 0.0, modulus)
    found = ExperimentModel(experiment, ModelOptions()).direction
    assert (found.direction, found.evidence.direction, found.against_data) == (FREE, None, False)
    assert "--direction free, because the table cannot decide between" in found.sentence
    # without an exponent there is no sign to sample
    assert ExperimentModel(experiment, ModelOptions(fix={"gamma": 1.0})).direction.direction is RISES
    assert not ExperimentModel(experiment, ModelOptions(direction=FALLS)).direction.against_data


def test_beyond_the_turn_falling_ratings_rise_with_firing(rng):
    """Fabrics so stiff that firing falls with stiffness: the same falling ratings are the other reading's."""
    stiff = np.geomspace(1e6, 2e7, 6)
    found = ExperimentModel(table(rng, -0.4, stiff, depth=3e-3), ModelOptions()).direction
    assert found.evidence.trend.sign == -1
    assert found.evidence.firing < 0.1
    assert found.direction == RISES
