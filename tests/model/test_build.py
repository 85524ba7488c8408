"""Simulated ratings by their moments, and the parameters that they are made of."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from softness_bayes.base.errors import InputError
from softness_bayes.data import Fabrics
from softness_bayes.likelihood.scales import FALLS
from softness_bayes.model import simulation as study
from softness_bayes.model.scenes import scene_of, touch_parameters, usual_values
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.touch.contact import Force, Indentation
from softness_bayes.touch.readings import MENDED

CLOTH = Fabrics(("silk", "lawn", "drill"), effective_modulus=np.array([2e4, 1e5, 4e5]))
LOADS = (Indentation(2e-3), Force(1.5))


@pytest.fixture(autouse=True, scope="module")
def one_scene():
    """Compile the scene once: all simulations here have the same fabrics, loads, channels and readings."""
    with pytest.MonkeyPatch.context() as patch:
        compiled = scene_of(CLOTH, LOADS, usual_values(MENDED), MENDED)
        patch.setattr(study, "scene_of", lambda *_, **__: compiled)
        yield


@pytest.fixture(scope="module")
def values():
    return usual_values(MENDED, given={"sigma_0": 7.0, "gamma": 0.8, "tau": 0.6, "varsigma": 0.3})


def simulate(seed, values, **options):
    return simulate_ratings(np.random.default_rng(seed), CLOTH, LOADS, values, **options)


def grid(simulation, participants):
    """Log ratings, shape (participants, fabrics, loads), NaN where missing."""
    ratings = simulation.ratings
    table = np.full((participants, len(CLOTH), len(LOADS)), np.nan)
    table[ratings.participant, ratings.fabric, ratings.load] = np.log(ratings.rating)
    return table


# parameters


@pytest.mark.parametrize("given", [{"bee": 1.0}, {"b": 0.0}, {"b": -1.0}, {"m": np.nan}])
def test_usual_values_refuse(given):
    with pytest.raises(InputError, match=next(iter(given))):
        usual_values(MENDED, given=given)


def test_parameters_reach_the_scene_in_si():
    named = usual_values(MENDED) | {"b": np.array([80.0, 90.0]), "sigma_0": 7.0, "beta": 0.5}
    touch = touch_parameters(named)
    assert_allclose(touch.b, [8e4, 9e4])
    assert_allclose([touch.sigma_0, touch.beta], [7e3, 5e-4])
    assert_allclose([touch.m, touch.alpha, touch.c_Na, touch.c_A], [2, 20.3, 1.05, 1.5])
    # beta sigma_0 has no unit: neither has it changed
    assert float(touch.beta * touch.sigma_0) == pytest.approx(0.5 * 7.0)


# simulated ratings


@pytest.mark.parametrize(("direction", "sign"), [({}, 1), ({"direction": FALLS}, -1)], ids=["softness", "inverse"])
def test_moments_of_simulated_ratings(values, direction, sign):
    n, mu = 4000, 2.5
    simulation = simulate(1, values, participants=n, mu=mu, **direction)
    rate = np.column_stack(
        [scene_of(CLOTH, (load,), values, MENDED).total_rate(touch_parameters(values)) for load in LOADS]
    )
    receptors = 249.7  # of the pad, as model.md 8 has them
    assert (rate > 0).sum() >= 4
    assert_allclose(simulation.total_rate, rate, atol=2e-5 * rate.max())
    x = np.log(rate / receptors + 0.1)
    expected = mu + sign * 0.8 * (x - x.mean())
    log_rating = grid(simulation, n)
    person = log_rating.mean(axis=(1, 2)) - mu
    # the people's common deviation from mu is the same in all conditions
    deviation = log_rating.mean(axis=0) - expected
    assert abs(deviation.mean()) < 5 * 0.6 / np.sqrt(n)
    assert abs(deviation - deviation.mean()).max() < 5 * 0.3 / np.sqrt(n) + 1e-3
    noise = log_rating - expected - simulation.participant_effect[:, None, None]
    assert noise.std() == pytest.approx(0.3, rel=5 / np.sqrt(2 * noise.size))
    assert simulation.participant_effect.std() == pytest.approx(0.6, rel=5 / np.sqrt(2 * n))
    assert person.std() == pytest.approx(np.sqrt(0.36 + 0.09 / 6), rel=5 / np.sqrt(2 * n))
    assert simulation.truth == values | {"mu": mu}


def test_fabrics_deviate_alike_under_all_loads(values):
    quiet = grid(simulate(2, values, participants=2000), 2000).mean(axis=0)
    loud = grid(simulate(2, values | {"omega": 0.5}, participants=2000), 2000).mean(axis=0)
    change = loud - quiet
    assert change.std() > 0.1
    assert_allclose(change[:, 0], change[:, 1], atol=5 * 0.3 * np.sqrt(2 / 2000))


def test_gaps_are_as_many_as_asked_for_and_anywhere(values):
    n, share = 500, 0.2
    simulation = simulate(4, values, participants=n, missing=share)
    cells = n * 6
    spread = np.sqrt(cells * share * (1 - share))
    assert abs(simulation.ratings.n_missing - share * cells) < 5 * spread
    assert len(simulation.ratings) + simulation.ratings.n_missing == cells
    gaps = np.isnan(grid(simulation, n))
    assert abs(gaps.mean(axis=0) - share).max() < 5 * np.sqrt(share * (1 - share) / n)
    # the other ratings are those without gaps
    full = grid(simulate(4, values, participants=n), n)
    assert_array_equal(grid(simulation, n)[~gaps], full[~gaps])
    assert not np.isnan(full).any()


@pytest.mark.parametrize("wrong", [{"participants": 0}, {"missing": 1.0}, {"missing": -0.1}, {"missing": np.nan}])
def test_nobody_or_nothing_to_rate_is_refused(values, wrong):
    with pytest.raises(InputError, match="simulate: "):
        simulate(1, values, **wrong)
