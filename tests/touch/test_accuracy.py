"""The choice of a resolution: what is chosen, that its error really stays under the bound, and what is refused."""

import numpy as np
import pytest

from softness_bayes.data import read_experiment
from softness_bayes.errors import InputError
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.scenes import firing_of, prior_draws, touch_parameters, usual_values
from softness_bayes.model.understanding import ladder, left_out
from softness_bayes.parameters.choice import parameter_space
from softness_bayes.touch.accuracy import PRESETS, FiringSample, choose, errors, given_draws, measured, thinned
from softness_bayes.touch.contact import Force, Indentation
from softness_bayes.touch.neuron.firing import exact_curves
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, PAPER_CHANNELS, Channels
from softness_bayes.touch.neuron.rate import firing_rate
from softness_bayes.touch.neuron.surface import FiringSurface
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.readings import MENDED
from softness_bayes.touch.scene import Discretisation, Scene
from support.command_line import call, refused
from support.paths import DATA

RATINGS = DATA / "ratings.csv"
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


def test_errors_are_those_of_their_definitions():
    rate, better = np.array([[1.0, 12.0], [0.0, 0.0]]), np.array([[2.0, 10.0], [0.0, 0.0]])
    found = errors(rate, better, 10.0, 0.1)
    np.testing.assert_allclose(found.peak, [0.2, 0.0])
    np.testing.assert_allclose(found.log, [np.log(0.3 / 0.2), 0.0])
    np.testing.assert_array_equal(errors(rate, better, 10.0, None).log, 0.0)


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


def test_thinning_keeps_the_ends_of_every_load(scenes):
    scene = Scene(np.geomspace(1e3, 1e6, 200), 0.3, LOADS, scenes(PRESETS[0]).firing)
    few = thinned(scene)
    assert few.n_conditions <= 120
    for load in (0, 1):
        some = few.modulus[few.load == load]
        assert {some.min(), some.max()} == {scene.modulus.min(), scene.modulus.max()}
    assert thinned(few) is few


def test_a_run_takes_the_choice_with_it_and_a_record_brings_it_back():
    experiment = read_experiment(RATINGS)
    model = build(experiment, ModelOptions(fix=HELD, accuracy=1e-2))
    options, choice = model.options, model.resolution
    assert options.discretisation == choice.discretisation == PRESETS[0]
    assert options.accuracy == options.kept_accuracy == 1e-2
    assert ModelOptions.from_record(options.record()) == options
    again = build(experiment, options)
    assert model.scene.discretisation == again.scene.discretisation == choice.discretisation
    assert again.resolution is None
    assert any("stress fields" in reason for reason in left_out(model))
    assert any("one rate curve" in reason for reason in left_out(model))
    settings = ladder(model.scene, prior_draws(model.posterior.space, 32))
    assert [setting.resolution.discretisation for setting in settings] == [*PRESETS]
    assert [setting.chosen for setting in settings] == [True, False, False]
    assert all(setting.seconds > 0 for setting in settings)
    found = [setting.resolution.errors.largest for setting in settings]
    assert found[0] > found[1] > found[2]


def test_where_a_bound_on_every_rate_is_too_much_two_curves_are_compared(scenes):
    """A curve may be poor where it is hardly asked: what counts is what it does to the response."""
    values = usual_values(MENDED)
    draws = given_draws(values, touch_parameters(values))
    assert isinstance(draws.parameters, TouchParameters)
    scene = scenes(Discretisation())
    bound = scene.firing.curve.error.relative
    assert measured(scene, draws, 10.0 * bound).firing.peak == bound
    assert measured(scene, draws, bound).firing.peak < bound


def test_plan_prints_stages_errors_cost_and_the_ladder():
    held = [part for name, value in HELD.items() for part in ("--fix", f"{name}={value}")]
    done = call("check", "--cost", "--data", RATINGS, "--accuracy", "1e-2", *held)
    assert done.returncode == 0, done.stderr
    for said in ("stress field", "population", "firing rates", "sum", "µs for each parameter vector", "left out:"):
        assert said in done.stdout
    assert done.stdout.count("<- chosen") == 1
    assert "one rate curve" in done.stdout


def test_plan_refuses_what_is_out_of_reach_or_range():
    refused(
        call("check", "--cost", "--data", RATINGS, "--accuracy", "1e-5"), "accuracy 1e-05 cannot be reached", "fix c_Na"
    )
    assert call("check", "--cost", "--data", RATINGS, "--accuracy", "0.5").returncode == 2
    refused(call("check", "--cost", "--compression", RATINGS.parent / "compression.csv"), "give --data")
