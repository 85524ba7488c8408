"""The choice of a resolution: what is chosen, that its error really stays under the bound, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from softness_bayes.base.errors import InputError
from softness_bayes.model.scenes import firing_of, prior_draws
from softness_bayes.parameters.choice import parameter_space
from softness_bayes.touch.accuracy import PRESETS, FiringSample, choose, errors, measured
from softness_bayes.touch.contact import Force, Indentation
from softness_bayes.touch.neuron.firing import exact_curves
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, PAPER_CHANNELS, Channels
from softness_bayes.touch.neuron.rate import firing_rate
from softness_bayes.touch.neuron.surface import FiringSurface
from softness_bayes.touch.scene import Discretisation, Scene

HELD = PAPER_CHANNELS._asdict()
EPS = 0.1
LOADS = (Indentation(2e-3), Force(1.5))
ACCURACIES = (1e-3, 1e-4, 1e-5)
CHOSEN = dict(zip(ACCURACIES, PRESETS, strict=True))


@pytest.fixture(scope="module")
def scenes():
    """Return a maker of one scene at any discretisation; each is made once."""
    made = {}

    def scene(discretisation):
        if discretisation not in made:
            firing = firing_of(HELD, CONNOR_STEVENS, nodes=discretisation.rate_nodes)
            made[discretisation] = Scene(np.geomspace(2e3, 2e6, 6), 0.3, LOADS, firing, discretisation=discretisation)
        return made[discretisation]

    return scene


@pytest.fixture(scope="module")
def choices(scenes):
    draws = prior_draws(parameter_space(fix=HELD))
    return {accuracy: choose(scenes, draws, accuracy) for accuracy in ACCURACIES}


def test_finer_accuracies_choose_finer_presets(choices):
    assert {accuracy: choice.discretisation for accuracy, choice in choices.items()} == CHOSEN
    assert all(choice.errors.largest <= accuracy for accuracy, choice in choices.items())


@pytest.mark.parametrize("accuracy", ACCURACIES)
def test_the_error_stays_under_the_bound_at_other_draws_and_at_the_worst(accuracy, choices, scenes, rng):
    """Against a scene compiled apart, with closer tables and more nodes than the reference of the choice."""
    space = parameter_space(fix=HELD)
    other = space.touch(space.draw_prior(rng, 1500))
    compiled = scenes(choices[accuracy].discretisation)
    better = scenes(Discretisation(48, 34.0, 1e-7, rate_nodes=28)).total_rate(other)
    found = errors(compiled.total_rate(other), better, compiled.n_receptors, EPS)
    assert (found.peak > 0).any()
    assert found.largest <= accuracy


def test_a_coarser_preset_breaks_the_finer_bound(scenes, rng):
    """Negative control: the preset of 1e-3 does not pass for 1e-4."""
    space = parameter_space(fix=HELD)
    other = space.touch(space.draw_prior(rng, 300))
    coarse, fine = (scenes(preset).total_rate(other) for preset in (PRESETS[0], PRESETS[2]))
    assert errors(coarse, fine, 249.7, EPS).largest > 1e-4


@pytest.mark.parametrize(
    ("kind", "low", "high", "places"), [(Force, 0.3, 2.5, "fewer"), (Indentation, 1e-3, 3e-3, "all")]
)
def test_along_forces_fewer_places_suffice_than_along_indentations(kind, low, high, places):
    loads = [kind(float(x)) for x in np.geomspace(low, high, 80)]
    firing, fabric = firing_of(HELD, CONNOR_STEVENS, nodes=PRESETS[0].rate_nodes), np.arange(80) % 2
    scene = Scene([2e4, 5e5], 0.3, loads, firing, fabric, np.arange(80), discretisation=PRESETS[0])
    found = choose(scene.coarser, prior_draws(parameter_space(fix=HELD)), 2e-3, PRESETS[:1])
    assert (found.discretisation == PRESETS[0]) == (places == "all")
    assert replace(found.discretisation, load_nodes=PRESETS[0].load_nodes) == PRESETS[0]


def test_what_cannot_be_reached_is_refused_with_what_can(scenes):
    space = parameter_space()
    draws = prior_draws(space, 64)
    firing = FiringSurface.load(CONNOR_STEVENS)
    few = Scene(np.geomspace(2e3, 2e6, 6), 0.3, LOADS, firing)
    with pytest.raises(
        InputError, match=r"accuracy 1e-06 cannot be reached for these fabrics and loads.*\de-0\d.*fix c_Na"
    ):
        choose(lambda preset: few.recompiled(discretisation=preset), draws, 1e-6, PRESETS[:2])
    for accuracy in (0.0, -1e-3, 2.0, float("nan")):
        with pytest.raises(InputError, match="accuracy"):
            choose(scenes, draws, accuracy)


def test_the_kept_curves_are_exact(rng):
    sample = FiringSample.load(CONNOR_STEVENS)
    for i in rng.choice(sample.curve.rheobase.size, 1):
        channels = Channels(*(float(c[i]) for c in sample.channels))
        curve = sample.curve.take(i)
        current = float(curve.rheobase) + np.array([0.3, 2.0, 12.0])
        np.testing.assert_allclose(curve.rate(current), firing_rate(current, channels), rtol=2e-5)


def test_the_surface_is_judged_by_exact_curves(monkeypatch):
    """Kept curves and curves made here through exact rates give one error; those of other channels another."""
    space, surface = parameter_space(), FiringSurface.load(CONNOR_STEVENS)
    scene = Scene(np.geomspace(2e3, 2e6, 6), 0.3, LOADS[:1], surface)
    sample = FiringSample.load(CONNOR_STEVENS)
    draws = prior_draws(space, 4)
    vectors = sample.put_into(draws.parameters)
    channels = Channels(*(getattr(vectors, name) for name in Channels._fields))
    made = FiringSample(channels, exact_curves(channels, CONNOR_STEVENS, vectors.alpha, 18))
    kept = measured(scene, draws).firing.largest
    assert 0 < kept < 2e-4
    monkeypatch.setattr(FiringSample, "load", lambda membrane: made)
    assert kept == pytest.approx(measured(scene, draws).firing.largest, rel=0.2, abs=1e-6)
    wrong = FiringSample(channels, made.curve.take(np.roll(np.arange(4), 1)))
    monkeypatch.setattr(FiringSample, "load", lambda membrane: wrong)
    assert measured(scene, draws).firing.largest > 1e-2
