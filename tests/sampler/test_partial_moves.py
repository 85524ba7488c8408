"""Moves of some coordinates leave a known law in 30 dimensions as it is; without the Hastings ratio they do not."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import multivariate_t

from softness_bayes.sampler.adaptation import TriangularMap
from softness_bayes.sampler.chains import EnsembleState
from softness_bayes.sampler.ensembles import advance
from softness_bayes.sampler.moves import (
    MANY_DIMENSIONS_MOVES,
    OneParameter,
    Student,
    StudentBlocks,
)
from softness_bayes.sampler.sampling import Settings

DIMENSION, WALKERS, STEPS = 30, 1000, 40
CORRELATION = 0.3


@dataclass(frozen=True)
class Bent:
    """Normal with unit variances and equal correlations in x, where x_1 = z_1 - bend (z_0² - 1): a banana in z."""

    bend: float

    def natural(self, z):
        """The coordinates in which the law is normal."""
        x = np.array(z, copy=True)
        x[..., 1] -= self.bend * (z[..., 0] ** 2 - 1.0)
        return x

    def __call__(self, z):
        x = self.natural(z)
        total = x.sum(axis=-1)
        # inverse of (1 - c) I + c 11'
        pull = CORRELATION / (1.0 - CORRELATION + CORRELATION * DIMENSION)
        return -0.5 * ((x**2).sum(axis=-1) - pull * total**2) / (1.0 - CORRELATION)

    def draws(self, rng, size):
        """Independent exact draws of z."""
        own = rng.standard_normal((size, DIMENSION))
        z = np.sqrt(1.0 - CORRELATION) * own + np.sqrt(CORRELATION) * rng.standard_normal((size, 1))
        z[:, 1] += self.bend * (z[:, 0] ** 2 - 1.0)
        return z


@dataclass(frozen=True)
class Careless:
    """A move without its Hastings ratio."""

    of: StudentBlocks

    in_halves = False

    def __call__(self, y, random, others):
        proposed, ratio = self.of(y, random)
        return proposed, np.zeros_like(ratio)


IDENTITY = TriangularMap.identity(DIMENSION)


@cache
def learnt():
    """A map of rotated, bent and straight axes."""
    return TriangularMap.fit(Bent(0.5).draws(np.random.default_rng(1), 4000), 4000.0, linear=10)


def identity():
    return IDENTITY


def largest_deviation(bend, moves, known=IDENTITY, steps=STEPS):
    """Change of means, variances and covariances after some steps from exact draws, in standard errors.

    Also the mean squared distance of the walkers from where they started.
    """
    target, begin = Bent(bend), Bent(bend).draws(np.random.default_rng(5), WALKERS)
    state = EnsembleState(known.inverse(begin), target(begin), np.random.RandomState(7).get_state())
    ((end, _),) = advance(target, [state], steps, moves, known)
    z = known.forward(end.coordinates)
    x = target.natural(z)
    products = np.stack([x[:, 0] * x[:, k] for k in range(1, DIMENSION)], axis=-1)
    seen = np.concatenate([x, x**2, products], axis=-1)
    true = np.repeat([0.0, 1.0, CORRELATION], [DIMENSION, DIMENSION, DIMENSION - 1])
    deviation = (seen.mean(axis=0) - true) / (seen.std(axis=0) / np.sqrt(WALKERS))
    return np.abs(deviation).max(), ((z - begin) ** 2).mean()


MOVES = {
    "blocks of 20 %": ((StudentBlocks(0.2), 1.0),),
    "one parameter": ((OneParameter(), 1.0),),
    "all": MANY_DIMENSIONS_MOVES,
}


@pytest.mark.parametrize("known", [identity, learnt], ids=["identity", "learnt map"])
@pytest.mark.parametrize("bend", [0.0, 0.5])
@pytest.mark.parametrize("moves", MOVES.values(), ids=MOVES)
def test_moves_of_some_coordinates_leave_a_known_law_as_it_is(bend, moves, known):
    """Walkers that start from exact draws stay distributed like them, and move far."""
    deviation, moved = largest_deviation(bend, moves, known())
    assert deviation < 4.5
    assert moved > 0.5


class Uneven(TriangularMap):
    """A map whose Jacobian the sampler is not told."""

    def log_volume(self, y):
        return np.zeros(y.shape[:-1])


def test_a_map_of_uneven_jacobian_leaves_a_known_law_as_it_is():
    """Negative control: without the Jacobian the law changes."""
    knots = np.tile([-3.0, -1.0, 0.0, 0.5, 0.9], (DIMENSION, 1))
    right, wrong = (kind(*vars(replace(IDENTITY, knots=knots)).values()) for kind in (TriangularMap, Uneven))
    assert largest_deviation(0.0, MANY_DIMENSIONS_MOVES, right)[0] < 4.5
    assert largest_deviation(0.0, MANY_DIMENSIONS_MOVES, wrong)[0] > 12


@pytest.mark.parametrize("bend", [0.0, 0.5])
@pytest.mark.parametrize(("move", "times"), [(StudentBlocks(0.05), 1), (OneParameter(IDENTITY), 2)])
def test_without_the_hastings_ratio_the_law_changes(bend, move, times):
    """Negative control; moves of one parameter alone need more steps."""
    assert largest_deviation(bend, ((Careless(move), 1.0),), steps=times * STEPS)[0] > 12


def test_the_hastings_ratio_is_that_of_the_coordinates_that_moved():
    """Against SciPy's density, in the dimension of each block."""
    move, rng = StudentBlocks(0.3, Student(4.0)), np.random.RandomState(3)
    before = rng.standard_normal((200, 6))
    after, ratio = move(before, rng)
    moved = after != before
    assert moved.any(axis=1).all()
    assert len(set(moved.sum(axis=1))) > 3
    for one, other, block, found in zip(before, after, moved, ratio, strict=True):
        law = multivariate_t(np.zeros(block.sum()), df=4.0)
        assert_allclose(found, law.logpdf(one[block]) - law.logpdf(other[block]), rtol=1e-9, atol=1e-9)


def test_few_dimensions_do_without_them():
    assert "StudentBlocks" not in Settings().description(12)["moves"]
    told = Settings().description(30)["moves"]
    assert "0.25 OneParameter()" in told
