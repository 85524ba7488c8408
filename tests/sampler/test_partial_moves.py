"""Moves of some coordinates leave a known law in 30 dimensions as it is; without the Hastings ratio they do not."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import multivariate_t

from softness_bayes.sampler import moves as moves_module
from softness_bayes.sampler.adaptation import TriangularMap
from softness_bayes.sampler.chains import EnsembleState
from softness_bayes.sampler.ensembles import advance
from softness_bayes.sampler.moves import (
    MANY_DIMENSIONS_MOVES,
    DifferentialEvolution,
    OneAxis,
    Student,
    StudentBlocks,
    fitted,
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

    of: StudentBlocks | OneAxis

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


def largest_deviation(bend, moves, known=IDENTITY):
    """Change of means, variances and covariances after some steps from exact draws, in standard errors.

    Also the mean squared distance of the walkers from where they started.
    """
    target, begin = Bent(bend), Bent(bend).draws(np.random.default_rng(5), WALKERS)
    state = EnsembleState(known.inverse(begin), target(begin), np.random.RandomState(7).get_state())
    ((end, _),) = advance(target, [state], STEPS, moves, known)
    z = known.forward(end.coordinates)
    x = target.natural(z)
    products = np.stack([x[:, 0] * x[:, k] for k in range(1, DIMENSION)], axis=-1)
    seen = np.concatenate([x, x**2, products], axis=-1)
    true = np.repeat([0.0, 1.0, CORRELATION], [DIMENSION, DIMENSION, DIMENSION - 1])
    deviation = (seen.mean(axis=0) - true) / (seen.std(axis=0) / np.sqrt(WALKERS))
    return np.abs(deviation).max(), ((z - begin) ** 2).mean()


MOVES = {
    "blocks of 5 %": ((StudentBlocks(0.05), 1.0),),
    "blocks of 20 %": ((StudentBlocks(0.2), 1.0),),
    "one axis": ((OneAxis(), 1.0),),
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


@pytest.mark.parametrize("bend", [0.0, 0.5])
@pytest.mark.parametrize("move", [StudentBlocks(0.05), OneAxis()])
def test_without_the_hastings_ratio_the_law_changes(bend, move):
    """Negative control."""
    assert largest_deviation(bend, ((Careless(move), 1.0),))[0] > 12


def test_without_the_probability_of_the_axis_the_law_changes(monkeypatch):
    """Negative control: the axis is chosen by where the walker is, which the ratio takes into account."""
    monkeypatch.setattr(moves_module, "_log_chosen", lambda y, place: np.zeros(len(y)))
    assert largest_deviation(0.0, ((OneAxis(), 1.0),))[0] > 8


def test_one_axis_of_a_map_is_moved_along():
    """The other coordinates of the map's axes stay; those of the map change where they depend on the one."""
    known, rng = learnt(), np.random.RandomState(3)
    begin = known.inverse(Bent(0.5).draws(np.random.default_rng(9), 50))
    (moved, _), each = fitted(((OneAxis(), 1.0),), known, ())[0][0](begin, rng), np.arange(50)
    t = [np.linalg.solve(known.axes, (known.forward(y) - known.centre).T).T for y in (begin, moved)]
    apart = np.abs(t[1] - t[0]) > 1e-9
    assert_allclose(apart.sum(axis=1), 1)
    place = apart.argmax(axis=1)
    assert_allclose((t[1] - t[0])[each, place], (known.scale * (moved - begin))[each, place], rtol=1e-6)


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


@dataclass(frozen=True)
class Rough:
    """Thirty independent coordinates; some have tails that a map cannot remove."""

    names = tuple(f"x{k}" for k in range(DIMENSION))

    def natural(self, z):
        return z

    def __call__(self, z):
        heavy = z[..., : DIMENSION // 3]
        return -0.5 * (z[..., DIMENSION // 3 :] ** 2).sum(axis=-1) - 2.0 * np.log1p(heavy**2 / 3.0).sum(axis=-1)

    def draw_start(self, rng, size):
        return rng.standard_normal((size, DIMENSION))


def test_blocks_shorten_walks_where_some_coordinates_fit_no_map():
    """Autocorrelation of all coordinates at a distance of 20 steps, among walkers from exact draws."""
    rng = np.random.default_rng(2)
    begin = np.hstack([rng.standard_t(3.0, (400, DIMENSION // 3)), rng.standard_normal((400, 2 * DIMENSION // 3))])
    state = EnsembleState(begin, Rough()(begin), np.random.RandomState(4).get_state())

    def left(moves):
        ((end, _),) = advance(Rough(), [state], 20, moves, TriangularMap.identity(DIMENSION))
        return np.mean([np.corrcoef(begin[:, k], end.coordinates[:, k])[0, 1] for k in range(DIMENSION)])

    at_once = ((Student(20.0), 0.6), (DifferentialEvolution(), 0.4))
    assert left(MANY_DIMENSIONS_MOVES) < 0.75 * left(at_once)


def test_a_far_thin_tail_is_left_soon():
    """Walkers ten standard deviations out in one coordinate, where the density is thin but flat."""

    @dataclass(frozen=True)
    class Tailed:
        def __call__(self, z):
            bulk = -0.5 * (z**2).sum(axis=-1)
            return np.logaddexp(bulk, -9.0 - 0.5 * (z[..., 1:] ** 2).sum(axis=-1) - 0.5 * (z[..., 0] / 20.0) ** 2)

    begin = np.random.default_rng(3).standard_normal((400, DIMENSION))
    begin[:, 0] = 10.0
    state = EnsembleState(begin, Tailed()(begin), np.random.RandomState(4).get_state())

    def left(moves):
        ((end, _),) = advance(Tailed(), [state], 60, moves, IDENTITY)
        return (np.abs(end.coordinates[:, 0]) > 5.0).mean()

    assert left(MANY_DIMENSIONS_MOVES) < 0.05
    assert left(tuple(one for one in MANY_DIMENSIONS_MOVES if not isinstance(one[0], OneAxis))) > 0.15


def test_few_dimensions_do_without_them():
    assert all(name not in Settings().description(12)["moves"] for name in ("StudentBlocks", "OneAxis"))
    told = Settings().description(30)["moves"]
    assert "StudentBlocks(share=0.05" in told
    assert "OneAxis(wide=10.0, law=Student(freedom=5.0))" in told
