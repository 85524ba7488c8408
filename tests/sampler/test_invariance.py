"""The moves leave a known law as it is: spreads to within their Monte-Carlo error, and a biased move is caught."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from emcee.moves import DESnookerMove

from softness_bayes.sampler.chain_statistics import autocorrelation_time
from softness_bayes.sampler.moves import MOVES, DifferentialEvolution
from softness_bayes.sampler.sampling import Settings, sample_until

DIMENSION = 6


@dataclass(frozen=True)
class CorrelatedNormal:
    """A normal law with unit variances and correlation 0.6 between all coordinates, bent along the first."""

    bend: float = 0.0

    @property
    def names(self):
        return tuple(f"x{k}" for k in range(DIMENSION))

    @property
    def _precision(self):
        return np.linalg.inv(0.4 * np.eye(DIMENSION) + 0.6)

    def natural(self, z):
        """The coordinates in which the law is normal."""
        x = np.array(z, copy=True)
        x[..., 1] = z[..., 1] - self.bend * (z[..., 0] ** 2 - 1.0)
        return x

    def __call__(self, z):
        x = self.natural(z)
        return -0.5 * np.einsum("ni,ij,nj->n", x, self._precision, x)

    def draw_start(self, rng, size):
        return rng.standard_normal((size, DIMENSION))


@dataclass(frozen=True)
class Snooker:
    """emcee's snooker move."""

    in_halves = True

    def __call__(self, y, random, others):
        return DESnookerMove().get_proposal(y, np.array_split(others, 3), random)


def spread_in_errors(target, moves, steps):
    """Largest deviation of the sampled variances from 1, in Monte-Carlo standard errors."""
    settings = Settings(ensembles=2, walkers=32, max_steps=steps, round_steps=steps, processes=1, moves=moves)
    sampled = sample_until(target, settings, seed=11)
    x = target.natural(sampled.chains.coordinates)[:, 200:]
    squares = x**2
    tau = autocorrelation_time(np.moveaxis(squares, -1, 1)).mean(axis=0)
    error = squares.std(axis=(0, 1, 2)) * np.sqrt(tau / squares[..., 0].size)
    return float(np.abs((squares.mean(axis=(0, 1, 2)) - 1.0) / error).max())


@pytest.mark.parametrize("bend", [0.0, 0.3])
def test_moves_leave_a_known_law_as_it_is(bend):
    """Bent more strongly, rare long stays in a tail make the estimated errors too small for so short a run."""
    assert spread_in_errors(CorrelatedNormal(bend), MOVES, 1000) < 4


def test_a_biased_move_is_caught():
    """Negative control: emcee's snooker move up to 3.1.6."""
    import emcee

    if tuple(int(part) for part in emcee.__version__.split(".")[:3]) > (3, 1, 6):
        pytest.skip("the snooker move is mended after emcee 3.1.6")
    moves = ((DifferentialEvolution(), 0.6), (Snooker(), 0.4))
    assert spread_in_errors(CorrelatedNormal(), moves, 1000) > 8
