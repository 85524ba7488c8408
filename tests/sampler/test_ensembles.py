"""Steps of ensembles: bitwise those of emcee's sampler, and the same together as alone but in fewer calls."""

import emcee
import numpy as np
import pytest
from emcee.moves import DEMove, MHMove

from softness_bayes.sampler.adaptation import TriangularMap
from softness_bayes.sampler.chains import EnsembleState
from softness_bayes.sampler.ensembles import advance
from softness_bayes.sampler.moves import MOVES, DifferentialEvolution, StudentBlocks

PLANE = TriangularMap.identity(2)


class Counted:
    """A normal density on the plane, with the number of points of every call."""

    names = ("x", "y")

    def __init__(self):
        self.calls = []

    def natural(self, z):
        return z

    def __call__(self, z):
        self.calls.append(len(z))
        return -0.5 * (z**2).sum(axis=-1)

    def draw_start(self, rng, size):
        return rng.standard_normal((size, 2))


def states(*walkers):
    made = []
    for seed, number in enumerate(walkers):
        points = np.random.default_rng(seed).standard_normal((number, 2))
        made.append(EnsembleState(points, Counted()(points), np.random.RandomState(seed).get_state()))
    return made


@pytest.mark.parametrize("moves", [MOVES, ((StudentBlocks(), 2.0), (DifferentialEvolution(0.5), 1.0))])
def test_draws_are_emcees(moves):
    [start] = states(14)
    [(end, segment)] = advance(Counted(), [start], 60, moves, PLANE, 3)
    made = [
        (DEMove(gamma0=one.factor) if isinstance(one, DifferentialEvolution) else MHMove(one), share)
        for one, share in moves
    ]
    sampler = emcee.EnsembleSampler(14, 2, Counted(), moves=made, vectorize=True)
    first = emcee.State(start.coordinates, log_prob=start.log_density, random_state=start.random)
    last = sampler.run_mcmc(first, 20, thin_by=3, skip_initial_state_check=True)
    np.testing.assert_array_equal(segment.coordinates, sampler.get_chain())
    np.testing.assert_array_equal(segment.log_density, sampler.get_log_prob())
    np.testing.assert_array_equal(end.coordinates, last.coords)
    np.testing.assert_array_equal(end.random[1], last.random_state[1])


def test_draws_are_those_of_each_ensemble_alone_in_fewer_calls():
    together, alone = Counted(), Counted()
    both = advance(together, states(12, 20, 16), 40, MOVES, PLANE)
    each = [advance(alone, [state], 40, MOVES, PLANE)[0] for state in states(12, 20, 16)]
    for (end, segment), (own_end, own_segment) in zip(both, each, strict=True):
        np.testing.assert_array_equal(segment.coordinates, own_segment.coordinates)
        np.testing.assert_array_equal(segment.log_density, own_segment.log_density)
        np.testing.assert_array_equal(segment.accepted, own_segment.accepted)
        np.testing.assert_array_equal(end.coordinates, own_end.coordinates)
        np.testing.assert_array_equal(end.random[1], own_end.random[1])
    assert sum(together.calls) == sum(alone.calls)
    # a step has one call or two, and as many together as that ensemble which has most
    assert 40 <= len(together.calls) <= 80 < len(alone.calls)


@pytest.mark.parametrize("stride", [1, 5])
def test_a_cut_between_stored_steps_leaves_every_call_as_it_was(stride):
    """Where a call for several points differs in its last bits, these too are then the same after an interruption."""
    whole, parts = Counted(), Counted()
    advance(whole, states(12, 12), 60, MOVES, PLANE, stride)
    middle = [state for state, _ in advance(parts, states(12, 12), 25, MOVES, PLANE, stride)]
    advance(parts, middle, 35, MOVES, PLANE, stride)
    assert parts.calls == whole.calls
    assert len(set(whole.calls)) > 1
