"""Points where the density is no number: never accepted, counted, named, and too many of them end the run."""

import numpy as np
import pytest

from softness_bayes.base.errors import NumericalError
from softness_bayes.sampler.sampling import Settings, progress_of, sample_until, walk
from softness_bayes.sampler.target import KEPT, Failure, Nonfinite, Watched, watching
from support.fake_scene import FakeScene, fake_posterior

SHORT = Settings(ensembles=2, walkers=12, pilot=(20,), round_steps=20, max_steps=60, processes=1, failures=1.0)


class Half:
    """A normal law on the plane that is ``beyond`` where x > 1; ``starts`` draws where walkers may start."""

    names = ("x", "y")

    def __init__(self, beyond, low=-3.0):
        self.beyond, self.low = beyond, low

    def natural(self, z):
        return 10.0 * z

    def __call__(self, z):
        value = -0.5 * (z**2).sum(axis=-1)
        return np.where(z[:, 0] > 1.0, self.beyond, value)

    def draw_start(self, rng, size):
        return rng.uniform(self.low, 3.0, (size, 2))


@pytest.mark.parametrize("beyond", [np.nan, np.inf])
def test_a_chain_never_enters_where_the_density_fails_and_is_that_of_density_zero(beyond):
    *_, failed = walk(Half(beyond), SHORT, 3)
    *_, zero = walk(Half(-np.inf), SHORT, 3)
    np.testing.assert_array_equal(failed.chains.coordinates, zero.chains.coordinates)
    assert np.isfinite(failed.chains.log_density).all()
    assert zero.nonfinite.count == 0
    assert failed.nonfinite.evaluations == zero.nonfinite.evaluations
    assert 0 < failed.nonfinite.count < failed.nonfinite.evaluations
    assert progress_of(failed, SHORT).failures == failed.nonfinite.count
    points = np.array([failure.point for failure in failed.nonfinite.failures])
    assert (points[:, 0] > 1).all()
    assert len(points) == min(failed.nonfinite.count, KEPT)
    # negative control: the walk does ask for points on either side
    assert failed.chains.coordinates[..., 0].max() > 0.8


def test_too_many_failures_end_the_run_with_its_state_in_hand():
    strict = Settings(**{**vars(SHORT), "failures": 1e-3})
    states = []
    with pytest.raises(NumericalError, match=r"stopped after \d+ steps: .* at \d+ of \d+ points, first at x="):
        walk_into(states, Half(np.nan), strict)
    assert states[-1].nonfinite.share > 1e-3
    with pytest.raises(NumericalError, match="could not be computed"):
        sample_until(Half(np.nan), strict, 3)


def walk_into(states, target, settings):
    """Walk, each state put aside as it comes."""
    for state in walk(target, settings, 3):
        states.append(state)


def test_a_start_where_nothing_can_be_computed_is_refused_and_says_where():
    with pytest.raises(NumericalError, match=r"all of 32 starting points have probability zero; .*at 32 of 32 points"):
        sample_until(Half(np.nan, low=1.5), SHORT, 3)


def test_the_processes_count_together():
    alone = [*walk(Half(np.nan), SHORT, 3)][-1].nonfinite
    assert [*walk(Half(np.nan), Settings(**{**vars(SHORT), "processes": 2}), 3)][-1].nonfinite == alone


def test_an_error_at_some_points_is_a_failure_of_those_alone():
    class Raising(Half):
        def __call__(self, z):
            if (z[:, 0] > 1).any():
                raise NumericalError("x is too large")
            return super().__call__(z)

    watched = Watched(Raising(np.nan))
    z = np.array([[0.0, 0.0], [2.0, 0.0], [0.5, 1.0]])
    np.testing.assert_allclose(watched(z), [0.0, -np.inf, -0.625])
    assert watched.found == Nonfinite(3, 1, (Failure((2.0, 0.0), "x is too large"),))
    # other errors are faults of the program, which must not be taken for points without weight
    with pytest.raises(KeyError):
        watching(Raising(np.nan), lambda target: {}["nothing"])


class Broken(FakeScene):
    """No number where b > 1e5."""

    def total_rate(self, parameters):
        rate = super().total_rate(parameters)
        return np.where(np.asarray(parameters.b)[..., None] > 1e5, np.nan, rate)


@pytest.mark.parametrize(
    ("posterior", "stage"),
    [(fake_posterior(scene=Broken()), "response"), (fake_posterior(), "likelihood")],
    ids=["response", "likelihood"],
)
def test_a_posterior_names_the_stage_that_failed(posterior, stage, monkeypatch):
    theta = np.tile(posterior.space.median, (3, 1))
    theta[:, 0] = [50.0, 150.0, 90.0]
    if stage == "likelihood":
        whole = type(posterior.observation).log_likelihood

        def broken(self, rate, parameters):
            value = whole(self, rate, parameters)
            return np.where(np.arange(value.size) == value.size // 2, -np.inf, value)

        monkeypatch.setattr(type(posterior.observation), "log_likelihood", broken)
    z = posterior.space.coordinates(theta)
    assert np.isnan(posterior(z)).tolist() == [False, True, False]
    watched = Watched(posterior)
    assert np.isneginf(watched(z)).tolist() == [False, True, False]
    (failure,) = watched.found.failures
    assert failure.stage == stage
    assert "b=150" in watched.found.sentence(posterior.names, posterior.natural).replace("149.99999999999997", "150")


def test_far_proposals_are_no_failures():
    """Negative control: where the prior has no weight the density is zero, not unknown."""
    posterior = fake_posterior()
    watched = Watched(posterior)
    z = posterior.space.coordinates(posterior.space.median)[None] + np.array([[0.0], [800.0], [-800.0]])
    assert np.isneginf(watched(z)).tolist() == [False, True, True]
    assert watched.found == Nonfinite(3)
