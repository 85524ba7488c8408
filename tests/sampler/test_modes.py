"""Separate modes: a run ends with their masses right, or not converged; never converged and wrong."""

import numpy as np
import pytest

from softness_bayes.runs.checkpoint import Checkpoint
from softness_bayes.runs.saved import read_last
from softness_bayes.sampler.adaptation import TriangularMap
from softness_bayes.sampler.diagnostics import Starts
from softness_bayes.sampler.modes import labels, learn_modes
from softness_bayes.sampler.moves import Student, StudentModes
from softness_bayes.sampler.sampling import walk
from softness_bayes.sampler.starts import Optimum, separate, worth_starting_from
from support.several_modes import (
    DIMENSION,
    FAR,
    LOCAL,
    NEAR,
    mode_and_banana,
    mode_and_ridge,
    narrow_and_wide,
    narrow_within_wide,
    normal,
    settings,
)


def last(target, seed=0, **changed):
    *_, state = walk(target, settings(**changed), seed)
    return state


def mass_of_the_first(target, state):
    """Share of the draws that are of the target's first mode, and of its error what the verdict states."""
    kept = state.chains.kept(state.verdict.burn_in).coordinates
    error = max(share.error for share in state.verdict.shares)
    return target.responsible(kept.reshape(-1, DIMENSION)).mean(), error


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow), pytest.param(2, marks=pytest.mark.slow)])
def test_a_narrow_mode_and_a_wide_one_of_equal_mass(seed):
    """By height the wide one would be left out: it is 21 lower in log density."""
    target = narrow_and_wide(0.5)
    peaks = target(np.stack([NEAR, FAR]))
    assert peaks[0] - peaks[1] == pytest.approx(21.0, abs=0.1)
    state = last(target, seed)
    assert state.starts == Starts(8, 0, 2)
    assert state.verdict.converged
    found, error = mass_of_the_first(target, state)
    assert abs(found - 0.5) < 4 * error
    assert error < 0.01
    shares = " and ".join(f"{share:.3f} ± {error:.3f}" for share, error in state.verdict.shares)
    assert state.verdict.sentence().endswith(f"2 modes contain {shares} of the draws.")


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize(
    ("target", "mass"),
    [
        (narrow_and_wide(0.9), 0.9),
        (narrow_and_wide(0.1), 0.1),
        (narrow_and_wide(0.99), 0.99),
        (narrow_and_wide(0.01), 0.01),
        (narrow_within_wide(), 0.5),
        (mode_and_ridge(), 0.5),
        (mode_and_banana(), 0.3),
    ],
    ids=["0.9", "0.1", "0.99", "0.01", "within", "ridge", "banana"],
)
def test_masses_come_out_right_or_the_run_has_not_converged(target, mass, seed):
    state = last(target, seed)
    found, error = mass_of_the_first(target, state)
    assert state.verdict.converged
    assert abs(found - mass) < 4 * error
    assert error < 0.02


@pytest.mark.parametrize(
    "target",
    [narrow_and_wide(0.01), pytest.param(narrow_within_wide(), marks=pytest.mark.slow)],
    ids=["apart", "within"],
)
def test_modes_that_no_move_joins_are_not_converged(target):
    """Negative control: the proportions are those of the start, each mode's own times are short, ensembles agree."""
    state = last(target, moves=LOCAL, max_steps=750, relearning=0)
    verdict = state.verdict
    assert verdict.kept > 10 * verdict.own
    assert not verdict.converged
    assert verdict.lengths < 2
    assert verdict.tau[DIMENSION + 1 :].max() > verdict.kept / 2  # of the modes' shares


def test_a_run_with_modes_goes_on_bit_by_bit_from_what_a_checkpoint_holds(tmp_path):
    target = narrow_and_wide(0.5)
    limits = {"pilot": (20, 30), "round_steps": 20, "max_steps": 60, "ensembles": 2, "relearning": 0}
    states = [*walk(target, settings(**limits), 3)]
    assert len(states[-1].modes) == 2
    for state in (states[0], next(s for s in states if s.phase == 2 and not s.steps)):
        with Checkpoint.create(tmp_path / str(state.phase)) as checkpoint:
            checkpoint.begin({})
            checkpoint.keep(state, settings(**limits), target)
        _, again, _ = read_last(tmp_path / str(state.phase))
        assert again.starts == state.starts
        *_, resumed = walk(target, settings(**limits), 3, again)
        np.testing.assert_array_equal(resumed.chains.coordinates, states[-1].chains.coordinates)
        assert resumed.verdict.shares == states[-1].verdict.shares


def optimum(point, height, sd):
    return Optimum(np.asarray(point, float), height, sd * np.eye(2))


def test_optima_are_ranked_by_mass():
    high, broad = optimum([0, 0], 14.0, 1e-3), optimum([5, 5], 0.0, 1.0)
    assert high.log_mass == pytest.approx(14.0 + 2 * np.log(1e-3))
    assert broad.log_mass == pytest.approx(0.0)
    # a hundred-thousandth of the mass could be a thousandth, a ten-millionth not
    close, far = optimum([9, 9], np.log(1e-5), 1.0), optimum([9, 9], np.log(1e-7), 1.0)
    kept = worth_starting_from([[high, broad], [far, close], [far]])
    assert [len(group) for group in kept] == [2, 1, 3]
    # negative control: by height alone the broad one is worthless beside a peak that is this much higher
    higher = optimum([0, 0], 25.0, 1e-6)
    assert worth_starting_from([[higher, broad]]) == [[higher, broad]]


def test_optima_are_one_mode_if_nothing_parts_them():
    def at(target, points):
        return [
            Optimum(np.asarray(p, float), float(target(np.atleast_2d(p))[0]), sd * np.eye(DIMENSION))
            for p, sd in points
        ]

    ridge = normal(NEAR, 1.0, 0.99)
    assert len(separate(ridge, at(ridge, [(NEAR, 0.3), (NEAR + 1.5, 0.3), (NEAR - 2, 0.3)]))) == 1
    apart = narrow_and_wide(0.5)
    assert len(separate(apart, at(apart, [(FAR, 1.0), (NEAR, 0.03), (FAR + 0.5, 1.0)]))) == 2
    # nothing lies between a peak and the hill on which it stands
    within = narrow_within_wide()
    peak = np.eye(DIMENSION)[0]
    line = within(np.linspace(peak, NEAR, 9))
    assert line.min() > line[-1] - 1
    assert len(separate(within, at(within, [(NEAR, 1.0), (peak, 0.03)]))) == 2


def test_proposals_about_modes_have_the_density_that_they_state(rng):
    """On the line by quadrature: of what is proposed the law is the stated one, in bent coordinates of the walkers."""
    bends = (np.zeros(1),)
    walkers = TriangularMap(np.array([1.0]), np.array([[2.0]]), np.array([1.5]), bends)
    own = [TriangularMap.affine(np.array([c]), np.array([[s]])) for c, s in ((-3.0, 0.1), (4.0, 1.0))]
    proposal = StudentModes(Student(), walkers, tuple(own))
    grid = np.linspace(-60, 60, 600_001)[:, None]
    origin, random = np.zeros_like(grid), np.random.RandomState(2)
    density = np.exp(proposal._log_density(grid))
    density /= np.trapezoid(density, grid[:, 0])
    proposed, ratio = proposal(origin, random)
    np.testing.assert_allclose(ratio, proposal._log_density(origin) - proposal._log_density(proposed), rtol=1e-12)
    below = np.cumsum(density) * (grid[1, 0] - grid[0, 0])
    quantiles = np.interp(proposed[:, 0], grid[:, 0], below)
    expected = (np.arange(quantiles.size) + 0.5) / quantiles.size
    assert np.abs(np.sort(quantiles) - expected).max() < 0.004


def test_draws_are_told_apart_and_pieces_of_one_mode_are_joined(rng):
    bent = rng.standard_normal((6000, 3))
    bent[:, 1] = 0.3 * bent[:, 1] + 0.8 * bent[:, 0] ** 2
    other = np.array([0.0, -5.0, 0.0]) + 0.2 * rng.standard_normal((2000, 3))
    draws = np.concatenate([bent, other])[:, None]
    height = np.zeros(draws.shape[:2])
    # normal laws at the top of the bent mode, too short for its arms
    first = [
        TriangularMap.affine(np.zeros(3), np.diag([0.5, 0.3, 1.0])),
        TriangularMap.affine(other[0], 0.2 * np.eye(3)),
    ]
    maps = learn_modes(first, draws, height, 1.0)
    assert len(maps) == 2
    label = labels(maps, draws[:, 0])
    assert (label[:6000] == 0).mean() > 0.999
    assert (label[6000:] == 1).all()
    pieces = [TriangularMap.affine(np.array([x, 0.8 * x**2, 0.0]), 0.3 * np.eye(3)) for x in (-1.0, 1.0)]
    assert len(learn_modes(pieces, bent[:, None], height[:6000], 1.0)) == 1
    # an unvisited mode keeps its map
    far = TriangularMap.affine(np.full(3, 50.0), np.eye(3))
    kept = learn_modes([*first, far], draws, height, 1.0)
    assert kept[2] is far
