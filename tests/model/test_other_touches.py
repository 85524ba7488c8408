"""Ratings of touches that were not rated: their centre, their spread, and whether their bands hold what is left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from softness_bayes.data import Experiment, Fabrics
from softness_bayes.likelihood.scales import FALLS, MAGNITUDE
from softness_bayes.model import scenes
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.prediction import OtherTouches
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.touch.contact import Indentation
from softness_bayes.touch.readings import MENDED
from softness_bayes.touch.scene import Discretisation
from support.report_runs import quickly

CLOTH = Fabrics(tuple("abcdefghijkl"), effective_modulus=np.geomspace(3e3, 6e5, 12))
LOADS = (Indentation(1.5e-3), Indentation(2.5e-3))
RATED = np.arange(12) % 4 != 2  # the fabrics of a laboratory; the others are left out
RATERS, LEFT_OUT = 15, 5
TRUTH = usual_values(MENDED, given={"sigma_0": 6.0, "varsigma": 0.3, "tau": 0.5, "gamma": 0.9})
DRAWS = 300
SAMPLED = ("gamma", "tau", "varsigma")
COARSE = Discretisation(8, 9.0, 1e-4)


@pytest.fixture(scope="module", autouse=True)
def smooth():
    """A rate curve chosen by hand, in these tests alone."""
    with quickly():
        yield


def laboratory(rng, scale=MAGNITUDE, **values):
    """Ratings of all fabrics by all raters, of which some of both are left out: the whole, and what was rated."""
    # ratings fall with firing, so that a sign that is left out would show
    given = TRUTH | values
    made = simulate_ratings(rng, CLOTH, LOADS, given, participants=RATERS + LEFT_OUT, direction=FALLS, scale=scale)
    whole = made.ratings
    kept = RATED[whole.fabric] & (whole.participant < RATERS)
    names = np.array(whole.fabrics)[RATED]
    place = np.cumsum(RATED) - 1
    ratings = replace(
        whole,
        participants=whole.participants[:RATERS],
        fabrics=tuple(names.tolist()),
        participant=whole.participant[kept],
        fabric=place[whole.fabric[kept]],
        load=whole.load[kept],
        rating=whole.rating[kept],
        rows=whole.rows[kept],
    )
    return whole, kept, Experiment(ratings, CLOTH.take(tuple(names.tolist())), ())


def touches(experiment, absent=(), **options):
    """The posterior of a laboratory whose chain is known, the truth as its draws, and all fabrics under both loads."""
    fix = {name: value for name, value in TRUTH.items() if name not in (*SAMPLED, *absent)}
    given = ModelOptions(fix=fix, direction=FALLS, discretisation=COARSE)
    posterior = build(experiment, replace(given, **options)).posterior
    scene = scenes.scene_of(CLOTH, LOADS, TRUTH, MENDED, discretisation=COARSE)
    theta = np.tile([TRUTH.get(name, 0.5) for name in posterior.names], (DRAWS, 1))
    return OtherTouches(posterior, scene, np.where(RATED, np.cumsum(RATED) - 1, -1)), theta


def covered(found, whole, rows, mass=0.9):
    """Share of some ratings inside the central interval of what new raters say."""
    new = found.reshape(-1, found.shape[-1])
    low, high = np.quantile(new, [0.5 * (1 - mass), 0.5 * (1 + mass)], axis=0)
    at = whole.load[rows] * len(CLOTH) + whole.fabric[rows]
    return ((whole.rating[rows] >= low[at]) & (whole.rating[rows] <= high[at])).mean()


def test_bands_hold_what_is_left_out_and_those_of_the_typical_rater_do_not(rng):
    shares = []
    for _ in range(8):
        whole, _, experiment = laboratory(rng)
        other, theta = touches(experiment)
        found = other.ratings(rng, theta, 4)
        raters, fabrics = whole.participant >= RATERS, ~RATED[whole.fabric]
        row = [covered(found.new, whole, here) for here in (raters, fabrics)]
        shares.append([*row, covered(found.typical[:, None], whole, raters)])
    of_raters, of_fabrics, typical = np.mean(shares, axis=0)
    assert 0.85 <= of_raters <= 0.95
    assert 0.85 <= of_fabrics <= 0.95
    assert typical < 0.6


def test_typical_ratings_follow_the_response_about_the_centre_of_the_rated_rows(rng):
    whole, kept, experiment = laboratory(rng)
    other, theta = touches(experiment)
    found = other.ratings(rng, theta)
    assert found.new.shape == (DRAWS, 0, 24)
    assert found.mean.shape == (DRAWS, 0)
    rate = other.scene.total_rate(scenes.touch_parameters(TRUTH))
    assert_allclose(found.rate, np.tile(rate, (DRAWS, 1)), rtol=1e-9)
    x = np.log(rate / other.scene.n_receptors + TRUTH["eps"])
    log_typical = np.log(found.typical)
    slopes = log_typical - log_typical[:, :1] + TRUTH["gamma"] * (x - x[0])
    assert_allclose(slopes, 0.0, atol=1e-9)
    # over the rated rows typical ratings average to the level that the ratings have
    rows = experiment.ratings
    of = whole.load[kept] * len(CLOTH) + whole.fabric[kept]
    level = log_typical[:, of].mean(axis=1)
    se = np.sqrt(TRUTH["tau"] ** 2 / RATERS + TRUTH["varsigma"] ** 2 / len(rows.rating))
    assert abs(level.mean() - np.log(rows.rating).mean()) < 5 * se / np.sqrt(DRAWS)
    assert_allclose(level.std(), se, rtol=0.2)


def test_deviations_of_known_fabrics_are_those_of_the_data_and_of_others_are_drawn(rng):
    omega = 0.6
    _, _, experiment = laboratory(rng, omega=omega)
    fix = {name: value for name, value in TRUTH.items() if name not in SAMPLED}
    known, theta = touches(experiment, fix=fix | {"omega": omega})
    spread = np.log(known.ratings(rng, theta).typical).std(axis=0).reshape(2, 12)
    assert (spread[:, ~RATED] > 0.8 * omega).all()
    assert (spread[:, RATED] < 0.6 * omega).all()
    strangers = OtherTouches(known.posterior, known.scene, np.full(12, -1))
    assert (np.log(strangers.ratings(rng, theta).typical).std(axis=0) > 0.8 * omega).all()


def test_fingers_of_the_raters_own(rng):
    _, _, experiment = laboratory(rng)
    other, theta = touches(experiment, absent=("omega",), individual=("b",))
    spread = other.posterior.names.index("tau_b")
    found = other.ratings(rng, theta[:40], 5)
    alike, _ = touches(experiment)
    assert_allclose(found.rate, alike.ratings(rng, theta[:40, :3]).rate, rtol=1e-6)
    # fingers of other skin: new raters differ by more than their scales and their errors, made small here
    for name in ("tau", "varsigma"):
        theta[:, other.posterior.names.index(name)] = 0.05
    found = other.ratings(rng, theta[:40], 5)
    theta[:, spread] = 1e-3
    same = other.ratings(rng, theta[:40], 5)
    wide, narrow = (np.log(one.new / one.typical[:, None]).std(axis=(0, 1)) for one in (found, same))
    assert wide.max() > 2 * narrow.max()
