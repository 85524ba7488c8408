"""Ensembles: bitwise continuation, seeds, workers, known targets, and runs that must not converge."""

import itertools
import os
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from softness_bayes.base.errors import InputError, NumericalError, SoftnessError
from softness_bayes.sampler import sampling
from softness_bayes.sampler.adaptation import TriangularMap
from softness_bayes.sampler.chains import Chains, EnsembleState
from softness_bayes.sampler.diagnostics import Goal
from softness_bayes.sampler.ensembles import advance
from softness_bayes.sampler.moves import MOVES
from softness_bayes.sampler.sampling import Settings, sample_until, walk
from softness_bayes.sampler.starts import Optimum, find_optimum, scatter
from softness_bayes.sampler.workers import Workers
from support.fake_scene import fake_posterior

SHORT = Settings(ensembles=2, walkers=12, pilot=(20,), round_steps=20, max_steps=40, processes=1)


class Target:
    """A density on the plane by its logarithm, with wide starts."""

    names = ("x", "y")

    def __init__(self, log_density, spread=3.0):
        self.log_density, self.spread = log_density, spread

    def natural(self, z):
        return z

    def __call__(self, z):
        return self.log_density(z)

    def draw_start(self, rng, size):
        return self.spread * rng.standard_normal((size, 2))


def normal(z):
    """Correlated at 0.95, far from the origin."""
    x, y = (z - [10.0, -5.0]).T
    return -0.5 * (x**2 - 1.9 * x * y + y**2) / (1 - 0.95**2)


def state(target, seed=1, walkers=12):
    points = np.random.default_rng(seed).standard_normal((walkers, 2))
    return EnsembleState(points, target(points), np.random.RandomState(seed).get_state())


def test_numpys_global_generator_is_neither_used_nor_moved():
    target, map = Target(normal), TriangularMap.identity(2)
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    walks = [advance(target, [state(target, seed)], 10, MOVES, map)[0][1].coordinates[-1] for seed in (1, 1, 2)]
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002
    np.testing.assert_array_equal(walks[0], walks[1])
    assert not np.array_equal(walks[0], walks[2])


def test_draws_depend_on_the_seed_and_not_on_the_processes():
    posterior = fake_posterior()
    settings = Settings(ensembles=4, pilot=(10,), round_steps=10, max_steps=20, optima=1, processes=1)
    alone = sample_until(posterior, settings, 5)
    spread = sample_until(posterior, Settings(**{**vars(settings), "processes": 2}), np.random.SeedSequence(5))
    np.testing.assert_array_equal(alone.chains.coordinates, spread.chains.coordinates)
    np.testing.assert_array_equal(alone.chains.log_density, spread.chains.log_density)
    other = sample_until(posterior, settings, 6)
    assert not np.array_equal(alone.chains.coordinates, other.chains.coordinates)
    for first, second in itertools.combinations(alone.chains.coordinates, 2):
        assert not np.intersect1d(first, second).size


def test_a_known_law_is_drawn_and_its_run_converges():
    reports = []
    sampled = sample_until(Target(normal), Settings(processes=1), 3, reports.append)
    chains, verdict = sampled
    assert verdict.converged
    assert reports[-1].verdict == verdict
    assert reports[0].steps == 0
    assert reports[-1].missing == 0
    steps = [r.steps for r in reports if r.steps]  # how often the pilot reports depends on the time it takes
    assert steps == sorted(set(steps))
    x = chains.kept(verdict.burn_in).coordinates
    thinned = x[:, :: int(np.ceil(verdict.tau.max()))]
    assert stats.kstest(thinned[..., 0].ravel(), stats.norm(10, 1).cdf).pvalue > 1e-3
    assert stats.kstest((thinned[..., 0] - thinned[..., 1]).ravel(), stats.norm(15, np.sqrt(0.1)).cdf).pvalue > 1e-3
    # negative control: the same draws do not pass for a law shifted by a tenth of its width
    assert stats.kstest(thinned[..., 0].ravel(), stats.norm(10.1, 1).cdf).pvalue < 1e-3
    expected = -0.5 * 2 + normal(np.array([[10.0, -5.0]]))[0]
    assert chains.kept(verdict.burn_in).log_density.mean() == pytest.approx(expected, abs=0.05)


def test_a_run_without_likelihood_returns_the_prior():
    class Nothing:
        def log_likelihood(self, mean_rate, parameters):
            return np.zeros(np.shape(parameters.gamma))

    prior = replace(fake_posterior(), terms=())
    chains, verdict = sample_until(prior, Settings(processes=1), 4)
    assert verdict.converged
    theta = prior.natural(chains.kept(verdict.burn_in).coordinates)[:, :: int(np.ceil(verdict.tau.max()))]
    for k, parameter in enumerate(prior.space.sampled):
        draws = theta[..., k].ravel()
        assert stats.kstest(draws, parameter.prior.cumulative).pvalue > 1e-4, parameter.name
        assert stats.kstest(1.15 * draws, parameter.prior.cumulative).pvalue < 1e-4, parameter.name


def test_limits_end_a_run_that_has_not_converged():
    chains, verdict = sample_until(Target(normal), SHORT, 1)
    assert not verdict.converged
    assert (verdict.steps, chains.steps, chains.coordinates.shape) == (40, 40, (2, 40, 12, 2))
    hurried = replace(SHORT, max_steps=400, max_seconds=0.0)
    assert sample_until(Target(normal), hurried, 1).verdict.steps == hurried.first_look


@pytest.mark.parametrize(("numbers", "least"), [(100 * 2 * 12 * 3, 1), (1, 100)])
def test_runs_of_many_walkers_and_parameters_are_stored_more_coarsely_too(numbers, least, monkeypatch):
    settings = {**vars(SHORT), "max_steps": 500, "goal": Goal(lengths=1e9), "relearning": 0}
    by_steps = sample_until(Target(normal), Settings(**{**settings, "stored": 100}), 1).chains
    monkeypatch.setattr(sampling, "NUMBERS", numbers)
    monkeypatch.setattr(sampling, "LEAST_STORED", least)
    by_numbers = sample_until(Target(normal), Settings(**settings), 1).chains
    assert by_numbers.stride == by_steps.stride > 1
    np.testing.assert_array_equal(by_numbers.coordinates, by_steps.coordinates)


def limited(**limits):
    """Settings of a run that never converges and whose limits can be changed."""
    unending = {"goal": Goal(lengths=1e9), "max_steps": 10**6, "relearning": 0}
    common = {**vars(SHORT), "pilot": (20, 30), "stored": 60, **unending}
    return Settings(**{**common, **limits})


def last(settings, begin=None):
    *_, state = walk(Target(normal), settings, 4, begin)
    assert state.ended
    return state


def test_a_run_that_reached_a_limit_goes_on_as_if_there_had_been_none():
    whole = last(limited(max_steps=333))
    first = last(limited(max_steps=51))  # between two looks, and before anything is thinned
    then = last(limited(max_steps=214), first)
    again = last(limited(max_steps=333), then)
    assert (first.stride, again.stride) == (1, whole.stride)
    assert whole.stride > 1
    for name in ("coordinates", "log_density", "accepted", "steps"):
        np.testing.assert_array_equal(getattr(again.chains, name), getattr(whole.chains, name))
    assert again.due == whole.due
    np.testing.assert_array_equal(again.verdict.tau, whole.verdict.tau)
    assert first.verdict.steps == 51


def test_a_slow_machine_reports_more_often_and_draws_the_same(monkeypatch):
    quick = [*walk(Target(normal), limited(max_steps=150), 4)]
    monkeypatch.setattr(sampling, "PATIENCE", 0.0)
    monkeypatch.setattr(sampling, "RARELY", 0.0)
    slow = [*walk(Target(normal), limited(max_steps=150), 4)]
    assert len(slow) > 5 * len(quick)
    np.testing.assert_array_equal(slow[-1].chains.coordinates, quick[-1].chains.coordinates)
    looks = [sorted({s.verdict.steps for s in states if s.verdict is not None}) for states in (quick, slow)]
    assert looks[0] == looks[1]
    assert len(looks[0]) > 1


def test_a_converged_run_can_go_on():
    easy = Goal(lengths=5, r_hat=2, ess=1)
    done = last(limited(goal=easy))
    assert done.verdict.converged
    assert last(limited(goal=easy), done).steps == done.steps  # there is nothing to do
    more = last(limited(goal=easy, min_steps=done.steps + 50), done)
    assert more.steps >= done.steps + 50
    straight = last(limited(goal=easy, min_steps=done.steps + 50))
    np.testing.assert_array_equal(more.chains.coordinates, straight.chains.coordinates)


def bent(z):
    """A thin sheet about a parabola, which the map of a short pilot misses."""
    x, y = z.T
    return -0.5 * (x / 5) ** 2 - 0.5 * ((y - 0.02 * x**2) / 0.02) ** 2


def test_a_slow_walk_becomes_one_more_stage_of_the_pilot(monkeypatch):
    monkeypatch.setattr(sampling, "PATIENCE", 1e-3)
    monkeypatch.setattr(sampling, "RARELY", 0.0)
    settings = Settings(ensembles=2, walkers=12, pilot=(4,), round_steps=50, max_steps=800, processes=1)
    states = [*walk(Target(bent), settings, 1)]
    assert 1 < states[-1].phase <= 1 + settings.relearning
    again = next(k for k, state in enumerate(states) if state.phase == 2)
    # its draws are dropped, and so are the looks at them
    assert states[again - 1].verdict.lengths < settings.slow
    assert states[again].steps < states[again - 1].steps
    assert states[again].chains.coordinates.shape[1] == states[again].steps
    assert states[again].verdict is None
    # it is checked as early as the first one, and may be learnt from again only when it is twice as long
    assert states[again].due == settings.first_look
    ends = [a.steps for a, b in itertools.pairwise(states) if b.phase > a.phase >= 1]
    assert all(2 * a <= b for a, b in itertools.pairwise(ends))
    # from there on nothing is learnt but by another look
    later = [state.map for state in states if state.phase == states[-1].phase]
    assert all(map is later[0] for map in later)
    # negative control: the first map is worse
    *_, stubborn = walk(Target(bent), replace(settings, relearning=0), 1)
    assert stubborn.phase == 1
    assert stubborn.verdict.tau.max() > 1.5 * states[-1].verdict.tau.max()
    # wherever the run is continued, at the slow look too, and whatever ended it there
    for k in (again - 1, again):
        *_, resumed = walk(Target(bent), settings, 1, states[k])
        np.testing.assert_array_equal(resumed.chains.coordinates, states[-1].chains.coordinates)
    *_, ended = walk(Target(bent), replace(settings, max_steps=states[again - 1].steps), 1)
    assert ended.phase == 1
    *_, resumed = walk(Target(bent), settings, 1, ended)
    np.testing.assert_array_equal(resumed.chains.coordinates, states[-1].chains.coordinates)


def test_moves_and_sizes_are_described_and_limits_are_not():
    told = Settings().description(3)
    assert told["walkers"] == "20"
    assert "Student(freedom=5.0)" in told["moves"]
    assert Settings(max_steps=7, max_seconds=3.0, min_steps=2, processes=1).description(3) == told
    for other in (Settings(walkers=22), Settings(pilot=(50,)), Settings(moves=MOVES[:1]), Settings(goal=Goal(ess=1))):
        assert other.description(3) != told
    assert sum(Settings(stored=5).description(3)[name] != told[name] for name in told) == 1
    sample_until(Target(normal), SHORT, 1)
    assert Settings().description(3) == told  # a run leaves no trace in its moves


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"ensembles": 1}, "ensembles is 1, expected at least 2"),
        ({"max_steps": 0}, "max_steps"),
        ({"max_seconds": float("nan")}, "max_seconds"),
        ({"pilot": (100, 1)}, "pilot is .* at least 2 steps"),
        ({"processes": 0}, "processes"),
        ({"walkers": 7}, "walkers is 7, expected an even number from 8"),
        ({"walkers": 4}, "walkers"),
    ],
)
def test_settings_that_make_no_sense_are_refused(wrong, message):
    with pytest.raises(InputError, match=message):
        sample_until(Target(normal), Settings(**{"processes": 1, **wrong}), 0)


def test_a_density_that_is_nowhere_positive_is_refused():
    with pytest.raises(NumericalError, match="probability zero"):
        sample_until(Target(lambda z: np.full(len(z), -np.inf)), SHORT, 0)


def test_optima_are_found_and_walkers_spread_about_them():
    target, rng = Target(normal), np.random.default_rng(8)
    optimum = find_optimum(target, rng)
    np.testing.assert_allclose(optimum.point, [10, -5], atol=0.1)
    covariance = np.array([[1, 0.95], [0.95, 1]])
    np.testing.assert_allclose(optimum.root @ optimum.root.T, covariance, atol=0.02)
    points, density = scatter(target, rng, [optimum], 2000)
    np.testing.assert_array_equal(density, target(points))
    np.testing.assert_allclose(np.cov(points.T), 4 * covariance, rtol=0.15)
    modes = [Optimum(np.full(2, side), 0.0, np.eye(2)) for side in (30.0, -30.0)]
    points, density = scatter(Target(lambda z: -0.5 * ((np.abs(z) - 30) ** 2).sum(-1)), rng, modes, 100)
    assert (points[:, 0] > 0).sum() == 50
    assert np.isfinite(density).all()


def test_walkers_that_land_outside_are_drawn_in():
    target = Target(lambda z: np.where(np.abs(z).max(-1) < 0.1, 0.0, -np.inf))
    wide = Optimum(np.zeros(2), 0.0, 50.0 * np.eye(2))
    points, density = scatter(target, np.random.default_rng(9), [wide], 30)
    assert np.isfinite(density).all()
    assert np.unique(points[:, 0]).size == 30


def test_chains_are_thinned_evenly_up_to_the_last_step():
    steps = np.arange(1, 101, dtype=float)
    coordinates = np.tile(steps[None, :, None, None], (2, 1, 3, 1))
    chains = Chains(coordinates, coordinates[..., 0], np.zeros((2, 3)), 100)
    kept = chains.kept(20)
    np.testing.assert_array_equal(kept.coordinates[0, :, 0, 0], np.arange(21, 101))
    thin = chains.kept(20, 150)
    np.testing.assert_array_equal(thin.coordinates[1, :, 2, 0], np.arange(22, 101, 3)[-27:])
    assert thin.stride == 3
    by_walker = thin.by_walker(thin.coordinates)
    assert by_walker.shape == (6, 27, 1)
    np.testing.assert_array_equal(thin.ensemble, [0, 0, 0, 1, 1, 1])


def _fail(resident, what):
    if what == "die":
        os._exit(3)
    raise NumericalError(f"{resident} {what}")


@pytest.mark.parametrize("processes", [1, 2])
def test_an_error_in_a_worker_arrives(processes):
    with Workers("the resident", processes) as workers, pytest.raises(NumericalError, match="the resident broke"):
        workers.map(_fail, [("broke",)])


def test_a_worker_that_dies_is_reported():
    with Workers("the resident", 2) as workers, pytest.raises(SoftnessError, match="a worker process died"):
        workers.map(_fail, [("die",)])


def test_a_target_is_sampled_in_its_form_for_sampling():
    class TwoForms(Target):
        for_sampling = Target(normal)

    def never(z):
        raise AssertionError("the other form was evaluated")

    found, expected = (sample_until(target, SHORT, seed=3) for target in (TwoForms(never), Target(normal)))
    assert np.array_equal(found.chains.coordinates, expected.chains.coordinates)
