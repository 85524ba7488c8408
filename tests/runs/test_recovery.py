"""Whether credible intervals cover the truth as often as they say, and whether this test would notice if not.

Data are simulated at draws of the prior and fitted; pooled over all parameters, the truth must lie in its
90 % interval about nine times out of ten. A wrong likelihood must fail the same criterion.
"""

import math
import os
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from softness_bayes.data import Experiment, Fabrics
from softness_bayes.likelihood.magnitude import LogRatings, RatingModel
from softness_bayes.likelihood.scales import FALLS
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.posterior import LEAST_FIRING, Posterior
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.sampler.sampling import sample_until
from softness_bayes.sampler.workers import Workers
from softness_bayes.touch.contact import Indentation
from softness_bayes.touch.neuron.membrane import PAPER_CHANNELS
from softness_bayes.touch.readings import MENDED
from softness_bayes.touch.scene import Discretisation
from support.coverage import ENOUGH, MASS, REPLICATES, Case, coverage_holds, covered

SEED = 20261121

CLOTH = Fabrics(tuple("abcdefgh"), effective_modulus=np.geomspace(3e3, 6e5, 8))
LOADS = tuple(Indentation(depth * 1e-3) for depth in (1.5, 2.5))
PARTICIPANTS = 20


class Overweighted(LogRatings):
    """Negative control: every rating counts four times, as if the variances were a quarter of what they are."""

    def log_likelihood(self, *arguments: Any) -> NDArray[np.float64]:
        return 4.0 * super().log_likelihood(*arguments)


def overweighted(right: LogRatings) -> LogRatings:
    return Overweighted(right.values, right.design, right.model)


def wrong_sign(right: LogRatings) -> LogRatings:
    """Negative control: ratings that fall with the response."""
    return LogRatings(right.values, right.design, RatingModel(FALLS))


def unchanged(right: LogRatings) -> LogRatings:
    return right


class Replicate(NamedTuple):
    """What one fit said of the truth."""

    names: tuple[str, ...]
    position: NDArray[np.float64]
    """Share of the draws below the truth, for each parameter and mu."""
    converged: bool


def replicate(posterior: Posterior, case: Case, seed: int) -> Replicate:
    """Simulate at a draw of the prior that fires in enough conditions, fit, and compare.

    Space, scene and design are those of `posterior`, which all replicates share.
    """
    rng = np.random.default_rng(np.random.SeedSequence(SEED, spawn_key=(seed,)))
    space = posterior.space
    while True:
        truth = space.draw_prior(rng, 1)[0]
        if (posterior.mean_rate(truth) > 0).sum() >= LEAST_FIRING:
            break
    values = {name: float(value) for name, value in space.values(truth).items()}
    mu = math.log(20.0) + 3.0 * rng.standard_normal()
    made = simulate_ratings(rng, CLOTH, LOADS, values, participants=PARTICIPANTS, mu=mu)
    assert isinstance(posterior.observation, LogRatings)
    # the design is that of all replicates: everyone rated everything
    observation = case.mistake(LogRatings(made.ratings.rating, posterior.observation.design))
    fitted = Posterior(space, (observation,), posterior.scene)
    sampled = sample_until(fitted, case.settings, seed)
    kept = sampled.chains.kept(sampled.verdict.burn_in, 8000)
    theta = fitted.natural(kept.coordinates).reshape(-1, space.dimension)
    effects = observation.draw_effects(rng, fitted.mean_rate(theta), fitted.rating_parameters(theta))
    draws = np.column_stack([theta, effects.mu])
    return Replicate((*space.names, "mu"), (draws < np.append(truth, mu)).mean(axis=0), sampled.verdict.converged)


def fit(case: Case, replicates: int, processes: int) -> list[Replicate]:
    """Fit the first replicates, side by side."""
    anyone = simulate_ratings(np.random.default_rng(0), CLOTH, LOADS, usual_values(MENDED), participants=PARTICIPANTS)
    posterior = build(
        Experiment(anyone.ratings, CLOTH, ()),
        ModelOptions(fix=PAPER_CHANNELS._asdict(), discretisation=Discretisation()),
    ).posterior
    with Workers(posterior, processes) as workers:
        return workers.map(replicate, [(case, seed) for seed in range(replicates)])


# the criterion itself: fast


def test_the_criterion_accepts_exact_intervals_and_refuses_wrong_ones(rng):
    shape = (REPLICATES, 10)
    right = [coverage_holds(rng.uniform(size=shape)) for _ in range(200)]
    assert np.mean(right) > 0.98
    # intervals half as wide as they should be: positions of z in a normal law of half the width
    z = rng.standard_normal((200, *shape))
    narrow = 0.5 * (1 + np.vectorize(math.erf)(2 * z / math.sqrt(2)))
    assert not any(coverage_holds(positions) for positions in narrow)
    # and twice as wide
    wide = 0.5 * (1 + np.vectorize(math.erf)(0.5 * z / math.sqrt(2)))
    assert not any(coverage_holds(positions) for positions in wide)


# the fits: slow


@pytest.mark.slow
def test_intervals_cover_the_truth_as_often_as_they_say():
    found = fit(Case(unchanged, ENOUGH), REPLICATES, processes=os.cpu_count() or 1)
    positions = np.array([one.position for one in found])
    report = dict(zip(found[0].names, (np.abs(positions - 0.5) <= 0.5 * MASS).sum(axis=0).tolist(), strict=True))
    assert sum(one.converged for one in found) >= 0.8 * REPLICATES
    assert coverage_holds(positions), f"covered, of {REPLICATES}: {report}"


@pytest.mark.slow
@pytest.mark.parametrize("mistake", [overweighted, wrong_sign])
def test_intervals_of_a_wrong_likelihood_do_not(mistake):
    found = fit(Case(mistake, replace(ENOUGH, max_steps=1500)), REPLICATES, processes=os.cpu_count() or 1)
    positions = np.array([one.position for one in found])
    assert covered(positions) < MASS * positions.size
    assert not coverage_holds(positions)
