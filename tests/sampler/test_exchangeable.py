"""Draws exchangeable with a given one: uniform ranks without convergence; and what would not be uniform."""

import numpy as np
import pytest

from softness_bayes.checking.calibration import Calibration
from softness_bayes.sampler.exchangeable import ReversibleKernel, exchangeable_draws

REPEATS, DRAWS = 600, 19
BENT = 0.05
"""Thickness of the test density, a thin bent sheet."""


def sheet(z):
    """Log density of x ~ N(0, 1) and y ~ N(x², BENT²)."""
    return -0.5 * z[:, 0] ** 2 - 0.5 * ((z[:, 1] - z[:, 0] ** 2) / BENT) ** 2


def draws_of(rng, size):
    x = rng.standard_normal(size)
    return np.column_stack([x, x**2 + BENT * rng.standard_normal(size)])


def archive_of(rng):
    """Points as of an unconverged run: a part of the sheet alone, and too thick."""
    return draws_of(rng, 60) * [0.5, 0.25] + 0.1 * rng.standard_normal((60, 2))


def ranks(found):
    """Ranks of given draws among others, for x, y and the density; `found` yields (draw, others)."""
    rank = []
    for draw, others in found:
        both = np.concatenate([draw[None], others])
        each = np.column_stack([both, sheet(both)])
        # chains that never moved are tied
        ties = np.random.default_rng(len(rank)).random(each.shape)
        below = (each[1:] < each[0]) | ((each[1:] == each[0]) & (ties[1:] < ties[0]))
        rank.append(below.sum(axis=0))
    return Calibration(("x", "y", "density"), np.array(rank), DRAWS)


def repeated(others, off=0.0):
    """Yield a draw of the sheet, moved off it by a distance, and other draws for it and an archive, many times."""
    for seed in range(REPEATS):
        rng = np.random.default_rng((7, seed))
        draw = draws_of(rng, 1)[0] + [0.0, off]
        yield draw, others(draw, archive_of(rng), rng)


@pytest.mark.parametrize("steps", [2, 40])
def test_ranks_are_uniform_however_few_the_steps(steps):
    found = repeated(lambda draw, archive, rng: exchangeable_draws(sheet, draw, archive, DRAWS, rng, steps))
    assert ranks(found).faults() == []


def test_chains_from_the_draw_itself_have_other_ranks():
    def forward(draw, archive, rng):
        return ReversibleKernel(sheet, archive).walk(np.repeat(draw[None], DRAWS, axis=0), 40, rng)

    assert ranks(repeated(forward)).faults()


def test_a_draw_of_another_density_is_found_out():
    found = repeated(lambda draw, archive, rng: exchangeable_draws(sheet, draw, archive, DRAWS, rng, 40), BENT)
    assert ranks(found).faults()


def test_many_steps_reach_the_density():
    rng = np.random.default_rng(3)
    found = ReversibleKernel(sheet, draws_of(rng, 200)).walk(draws_of(rng, 1).repeat(2000, axis=0), 400, rng)
    x, off = found[:, 0], (found[:, 1] - found[:, 0] ** 2) / BENT
    for values in (x, off):
        assert abs(values.mean()) < 4.0 / np.sqrt(2000)
        assert abs(values.std() - 1.0) < 4.0 / np.sqrt(4000)
    assert abs(np.corrcoef(x, off)[0, 1]) < 4.0 / np.sqrt(2000)


def test_where_the_density_cannot_be_computed_nothing_moves():
    def density(z):
        return np.where(np.abs(z[:, 0]) < 0.5, sheet(z), np.nan)

    rng = np.random.default_rng(4)
    found = ReversibleKernel(density, draws_of(rng, 100)).walk(np.zeros((50, 2)), 50, rng)
    assert np.abs(found[:, 0]).max() < 0.5
