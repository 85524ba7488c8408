"""Ensembles that walk side by side: the same draws in fewer calls, whatever the threads do, and every error arrives."""

import threading
import time

import numpy as np
import pytest

from softness_bayes.sampler.adaptation import TriangularMap
from softness_bayes.sampler.moves import MOVES
from softness_bayes.sampler.sampling import EnsembleState, Settings, advance, walk
from softness_bayes.sampler.side_by_side import side_by_side

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


def walking():
    """The number of threads of this process."""
    return threading.active_count()


def test_draws_are_those_of_each_ensemble_alone_in_fewer_calls():
    together, alone, before = Counted(), Counted(), walking()
    both = advance(together, states(12, 20, 16), 40, MOVES, PLANE)
    each = [advance(alone, [state], 40, MOVES, PLANE)[0] for state in states(12, 20, 16)]
    for (end, segment), (own_end, own_segment) in zip(both, each, strict=True):
        np.testing.assert_array_equal(segment.coordinates, own_segment.coordinates)
        np.testing.assert_array_equal(segment.log_density, own_segment.log_density)
        np.testing.assert_array_equal(segment.accepted, own_segment.accepted)
        np.testing.assert_array_equal(end.coordinates, own_end.coordinates)
        np.testing.assert_array_equal(end.random[1], own_end.random[1])
    assert sum(together.calls) == sum(alone.calls)
    # a step has one call or two, and as many side by side as that ensemble which has most
    assert 40 <= len(together.calls) <= 80 < len(alone.calls)
    assert walking() == before


@pytest.mark.parametrize("stride", [1, 5])
def test_a_cut_between_stored_steps_leaves_every_call_as_it_was(stride):
    """Where a call for several points differs in its last bits, these too are then the same after an interruption."""
    whole, parts = Counted(), Counted()
    advance(whole, states(12, 12), 60, MOVES, PLANE, stride)
    middle = [state for state, _ in advance(parts, states(12, 12), 25, MOVES, PLANE, stride)]
    advance(parts, middle, 35, MOVES, PLANE, stride)
    assert parts.calls == whole.calls
    assert len(set(whole.calls)) > 1


def test_points_are_those_that_all_wait_for_however_long_a_thread_takes():
    def called(pause):
        seen = []

        def density(points):
            seen.append(points[:, 0].tolist())
            return points[:, 0]

        def walk_of(k):
            def walked(evaluate, stepped):
                total = 0.0
                for step in range(4):
                    for call in range(1 + (step + k) % 2):
                        time.sleep(pause * k)
                        total += evaluate(np.array([[100.0 * k + 10.0 * step + call]]))[0]
                    stepped()
                return total

            return walked

        return side_by_side(density, [walk_of(k) for k in range(3)]), seen

    quick, slow = called(0.0), called(0.002)
    assert quick == slow
    assert quick[1][:3] == [[0.0, 100.0, 200.0], [101.0], [10.0, 110.0, 210.0]]
    assert quick[0][0] == sum(10.0 * s + c for s in range(4) for c in range(1 + s % 2))


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_an_error_of_the_density_arrives_and_no_thread_stays(error):
    def density(points):
        raise error("out of order")

    before = walking()
    with pytest.raises(error, match="out of order"):
        side_by_side(density, [lambda evaluate, stepped: evaluate(np.zeros((1, 2)))] * 3)
    assert walking() == before


def test_an_error_of_one_walk_arrives_and_the_others_are_given_up():
    def patient(evaluate, stepped):
        while True:
            evaluate(np.zeros((1, 2)))
            stepped()

    def failing(evaluate, stepped):
        evaluate(np.zeros((1, 2)))
        raise ValueError("lost its way")

    before = walking()
    with pytest.raises(ValueError, match="lost its way"):
        side_by_side(Counted(), [patient, failing, patient])
    assert walking() == before


def test_walks_keep_the_error_state_of_numpy():
    def divided(evaluate, stepped):
        return np.ones(1) / np.zeros(1)

    with np.errstate(divide="raise"), pytest.raises(FloatingPointError):
        side_by_side(Counted(), [divided, divided])
    with np.errstate(divide="ignore"):
        assert np.isposinf(side_by_side(Counted(), [divided, divided])).all()


def test_settings_say_how_many_walk_together():
    def drawn(together):
        target, settings = (
            Counted(),
            Settings(
                ensembles=3, together=together, walkers=12, pilot=(20,), round_steps=20, max_steps=40, processes=1
            ),
        )
        *_, state = walk(target, settings, 1)
        return state.chains.coordinates, len(target.calls)

    alone, pairs, all_three = (drawn(number) for number in (1, 2, 3))
    np.testing.assert_array_equal(alone[0], pairs[0])
    np.testing.assert_array_equal(alone[0], all_three[0])
    assert alone[1] > pairs[1] > all_three[1]
