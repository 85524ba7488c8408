"""The accuracy dial: what is chosen, that its error really stays under the bound, and what is refused."""

import dataclasses
import itertools

import numpy as np
import pytest

from softness_bayes.data import read_experiment
from softness_bayes.errors import InputError
from softness_bayes.model.build import build
from softness_bayes.model.cost import ladder, left_out
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.scenes import firing_of, prior_draws, touch_parameters, usual_values
from softness_bayes.parameters.choice import parameter_space
from softness_bayes.touch import resolution
from softness_bayes.touch.accuracy import Errors, choose, errors, references, sampled_rates, thinned
from softness_bayes.touch.contact import Force, Indentation
from softness_bayes.touch.firing_sample import FiringSample
from softness_bayes.touch.neuron.firing import exact_curves
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, PAPER_CHANNELS, Channels
from softness_bayes.touch.neuron.rate import firing_rate
from softness_bayes.touch.neuron.surface import FiringSurface
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.readings import MENDED
from softness_bayes.touch.resolution import given_draws, scene_with_accuracy
from softness_bayes.touch.scene import Discretisation, Scene
from support.command_line import call, refused
from support.paths import DATA

RATINGS = DATA / "ratings.csv"
HELD = PAPER_CHANNELS._asdict()
EPS = 0.1
LOADS = (Indentation(2e-3), Force(1.5))
ACCURACIES = (1e-2, 1e-3, 1e-4)


@pytest.fixture(scope="module")
def scenes():
    """Return a maker of one scene at any discretisation; each is made once."""
    made = {}
    firing = firing_of(HELD, CONNOR_STEVENS, nodes=18)

    def scene(discretisation):
        key = dataclasses.replace(discretisation, rate_nodes=18)
        if key not in made:
            made[key] = Scene(np.geomspace(2e3, 2e6, 6), 0.3, LOADS, firing, discretisation=key)
        return made[key]

    return scene


@pytest.fixture(scope="module")
def choices(scenes):
    draws = prior_draws(parameter_space(fix=HELD))
    none = Errors(np.array(0.0), np.array(0.0))
    return {a: choose(scenes(references(a)[0]), draws.parameters, a, EPS, none) for a in ACCURACIES}


def test_finer_accuracies_choose_finer_stages(choices):
    chosen = [choices[accuracy].discretisation for accuracy in ACCURACIES]
    for coarse, fine in itertools.pairwise(chosen):
        assert coarse.nodes < fine.nodes
        assert coarse.saturation < fine.saturation
        assert coarse.field_tolerance > fine.field_tolerance
    for accuracy in ACCURACIES:
        assert choices[accuracy].errors.largest <= accuracy


@pytest.mark.parametrize("accuracy", ACCURACIES)
def test_the_error_stays_under_the_bound_at_other_draws_and_at_the_worst(accuracy, choices, scenes, rng):
    """Against a scene compiled apart, with closer fields and more nodes than the reference of the choice."""
    space = parameter_space(fix=HELD)
    other = space.touch(space.draw_prior(rng, 1500))
    compiled = scenes(choices[accuracy].discretisation)
    better = scenes(Discretisation(48, 34.0, 3e-7)).total_rate(other)
    found = errors(compiled.total_rate(other), better, compiled.n_receptors, EPS)
    assert (found.peak > 0).any()
    assert found.largest <= accuracy
    # the choice is no finer than it must be: what it measured is a share of the bound, and so is the truth
    assert found.largest > 0.02 * accuracy


def test_a_coarser_choice_breaks_the_finer_bound(choices, scenes, rng):
    """Negative control: the discretisation of 1e-2 does not pass for 1e-3."""
    space = parameter_space(fix=HELD)
    other = space.touch(space.draw_prior(rng, 300))
    coarse, fine = (scenes(choices[a].discretisation).total_rate(other) for a in (1e-2, 1e-4))
    assert errors(coarse, fine, 249.7, EPS).largest > 1e-3


def test_errors_are_those_of_their_definitions():
    rate, better = np.array([[1.0, 12.0], [0.0, 0.0]]), np.array([[2.0, 10.0], [0.0, 0.0]])
    found = errors(rate, better, 10.0, 0.1)
    np.testing.assert_allclose(found.peak, [0.2, 0.0])
    np.testing.assert_allclose(found.log, [np.log(0.3 / 0.2), 0.0])
    np.testing.assert_array_equal(errors(rate, better, 10.0, None).log, 0.0)


def test_a_cut_scene_is_the_one_compiled_so(scenes):
    """The choice rests on scenes that are cut from a finer one; what a run compiles must respond alike."""
    draws = prior_draws(parameter_space(fix=HELD), 200)
    d = Discretisation(8, 9.0, 1e-4)
    cut, compiled = scenes(references(1e-3)[0]).coarser(d), scenes(d)
    apart = errors(cut.total_rate(draws.parameters), compiled.total_rate(draws.parameters), 249.7, EPS)
    assert 0 < apart.largest < 4e-4


def test_what_cannot_be_reached_is_refused_with_what_can(scenes):
    draws = prior_draws(parameter_space(fix=HELD), 64)
    rates = Errors(np.array(2e-5), np.array(1e-5))
    with pytest.raises(
        InputError, match=r"accuracy 1e-05 cannot be reached for these fabrics and loads.*2\.\de-05.*fix c_Na"
    ):
        choose(scenes(references(1e-4)[0]), draws.parameters, 1e-5, EPS, rates)
    for accuracy in (0.0, -1e-3, 2.0, float("nan")):
        with pytest.raises(InputError, match="expected a bound"):
            references(accuracy)


def test_the_kept_curves_are_exact(rng):
    sample = FiringSample.load(CONNOR_STEVENS)
    for i in rng.choice(sample.curve.rheobase.size, 1):
        channels = Channels(*(float(c[i]) for c in sample.channels))
        curve = sample.curve.take(i)
        current = float(curve.rheobase) + np.array([0.3, 2.0, 12.0])
        np.testing.assert_allclose(curve.rate(current), firing_rate(current, channels), rtol=2e-5)


def test_the_surface_is_judged_by_exact_curves():
    """Kept curves and curves made here through exact rates give one error; those of other channels another."""
    space, surface = parameter_space(), FiringSurface.load(CONNOR_STEVENS)
    scene = Scene(np.geomspace(2e3, 2e6, 6), 0.3, LOADS[:1], surface)
    sample = FiringSample.load(CONNOR_STEVENS)
    vectors = sample.put_into(prior_draws(space, 4).parameters)
    channels = Channels(*(getattr(vectors, name) for name in Channels._fields))
    made = FiringSample(channels, exact_curves(channels, CONNOR_STEVENS, vectors.alpha, 18))
    kept, live = (sampled_rates(scene, source, vectors, EPS) for source in (sample, made))
    assert 0 < kept.largest < 2e-4
    assert kept.largest == pytest.approx(live.largest, rel=0.2, abs=1e-6)
    shuffled = vectors._replace(c_K=np.roll(vectors.c_K, 1))
    assert sampled_rates(scene, sample, shuffled, EPS).largest > 1e-2


def test_thinning_keeps_the_ends_of_every_load(scenes):
    scene = Scene(np.geomspace(1e3, 1e6, 200), 0.3, LOADS, scenes(Discretisation(8, 9.0, 1e-4)).firing)
    few = thinned(scene)
    assert few.n_conditions <= 120
    for load in (0, 1):
        some = few.modulus[few.load == load]
        assert {some.min(), some.max()} == {scene.modulus.min(), scene.modulus.max()}
    assert thinned(few) is few


def test_equal_conditions_are_evaluated_once(scenes):
    firing = scenes(Discretisation(8, 9.0, 1e-4)).firing
    modulus, poisson = np.array([1e4, 3e5, 1e4, 1e4]), np.array([0.3, 0.3, 0.3, 0.2])
    scene = Scene(modulus, poisson, LOADS, firing)
    assert scene.n_repeated == 2
    values = prior_draws(parameter_space(fix=HELD), 50).parameters
    rate = scene.total_rate(values).reshape(50, 2, 4)
    np.testing.assert_array_equal(rate[..., 0], rate[..., 2])
    assert np.abs(rate[..., 0] - rate[..., 3]).max() > 0
    np.testing.assert_allclose(rate.reshape(50, 8), scene.respond(values).total_rate, rtol=1e-12)
    assert scene.take([0, 2]).total_rate(values).shape == (50, 2)
    assert scenes(Discretisation(8, 9.0, 1e-4)).n_repeated == 0


def test_a_run_takes_the_choice_with_it_and_a_record_brings_it_back():
    experiment = read_experiment(RATINGS)
    model = build(experiment, ModelOptions(fix=HELD, accuracy=1e-2))
    options, choice = model.options, model.resolution
    assert options.discretisation == choice.discretisation != Discretisation()
    assert options.accuracy == options.kept_accuracy == 1e-2
    assert ModelOptions.from_record(options.record()) == options
    again = build(experiment, options)
    assert model.scene.discretisation == again.scene.discretisation == choice.discretisation
    assert again.resolution is None
    assert any("stress fields" in reason for reason in left_out(model))
    assert any("one rate curve" in reason for reason in left_out(model))
    settings = ladder(choice, prior_draws(model.posterior.space, 32))
    assert {setting.stage for setting in settings} == {"population", "field", "firing rates"}
    assert sum(setting.chosen for setting in settings) == 3
    assert all(setting.seconds > 0 for setting in settings)
    # more nodes leave a smaller error, down to what fields and rate curves leave
    whole = choice._replace(discretisation=dataclasses.replace(choice.discretisation, rate_terms=None))
    finer = ladder(whole, prior_draws(model.posterior.space, 32))
    population = [s.errors.largest for s in finer if s.stage == "population"]
    assert population[0] > population[-1]


def test_a_single_vector_is_never_coarser_than_usual(scenes):
    values = usual_values(MENDED)
    draws = given_draws(values, touch_parameters(values))
    scene, _ = scene_with_accuracy(scenes, draws, 1e-2)
    assert scene.discretisation == dataclasses.replace(Discretisation(), rate_nodes=18)
    assert isinstance(draws.parameters, TouchParameters)


def test_where_a_bound_on_every_rate_is_too_much_two_curves_are_compared(scenes, monkeypatch):
    """A curve may be poor where it is hardly asked: what counts is what it does to the response."""
    values = usual_values(MENDED)
    draws = given_draws(values, touch_parameters(values))
    poor = Errors(np.array(0.5), np.array(0.5))
    monkeypatch.setattr(resolution, "held_rates", lambda scene: poor)
    _, choice = scene_with_accuracy(scenes, draws, 1e-3)
    assert choice.firing.largest == 0.0


def test_plan_prints_stages_errors_cost_and_the_ladder():
    held = [part for name, value in HELD.items() for part in ("--fix", f"{name}={value}")]
    done = call("plan", "--data", RATINGS, "--accuracy", "1e-2", *held)
    assert done.returncode == 0, done.stderr
    for said in ("stress field", "population", "firing rates", "sum", "µs for each parameter vector", "left out:"):
        assert said in done.stdout
    assert done.stdout.count("<- chosen") == 3
    assert "one rate curve" in done.stdout


def test_plan_refuses_what_is_out_of_reach_or_range():
    refused(call("plan", "--data", RATINGS, "--accuracy", "1e-5"), "accuracy 1e-05 cannot be reached", "fix c_Na")
    assert call("plan", "--data", RATINGS, "--accuracy", "0.5").returncode == 2
    refused(call("plan", "--compression", RATINGS.parent / "compression.csv"), "give --data")
