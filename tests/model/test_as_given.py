"""Grids of raters: which are found, and what ratings on them stand for."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from softness_bayes.data import Ratings
from softness_bayes.data.steps import step_of
from softness_bayes.model.as_given import stated
from softness_bayes.touch.contact import Indentation


@pytest.mark.parametrize(
    ("numbers", "step"),
    [
        ([1, 2, 3, 5, 8], 1.0),
        ([0, 1, 2, 3, 5], 1.0),
        ([0.5, 1, 1.5, 3, 7], 0.5),
        ([0.25, 1, 1.75, 3, 7], 0.25),
        ([10, 20, 40, 60], 10.0),
        ([2, 4, 6], 1.0),  # three even numbers may be chance
        ([2, 4, 6, 8, 10, 12, 16], 2.0),
        ([5, 5, 5], 0.0),  # one number tells nothing
        ([0, 0], 0.0),
        ([8.13, 23.41, 15.77, 4.912], 0.0),  # too fine to matter
        ([0.1, 0.3, 0.7, 1.2], 0.1),
    ],
)
def test_steps(numbers, step):
    assert_allclose(step_of(numbers), step)


def test_chance_is_not_a_grid():
    """Exact numbers of random digits are hardly ever taken for a coarse grid, and whole numbers are found."""
    rng = np.random.default_rng(1)
    fine = [step_of(np.round(np.exp(rng.normal(2.0, 0.8, 12)), 2)) for _ in range(300)]
    assert max(fine) <= 0.02
    whole = [step_of(np.maximum(np.round(np.exp(rng.normal(2.0, 0.8, 12))), 1)) for _ in range(300)]
    assert np.mean(np.array(whole) == 1.0) > 0.97


def ratings_of(table, resolution=None):
    made = Ratings.crossed(("P", "Q"), ("a", "b", "c", "d"), (Indentation(1e-3),), np.array(table)[..., None])
    own = None if resolution is None else np.array(resolution, float)
    return Ratings(**{**{name: getattr(made, name) for name in made.__dataclass_fields__}, "resolution": own})


def test_intervals_of_a_grid():
    said = stated(ratings_of([[0.0, 1, 2, 5], [0.5, 1.5, 3.0, 7.5]]))
    assert_allclose(said.step, [1] * 4 + [0.5] * 4)
    assert_allclose(said.values, [0.25, 1, 2, 5, 0.5, 1.5, 3, 7.5])
    low, high = said.ends(said.values)
    assert_allclose(low, [0, 0.5, 1.5, 4.5, 0.25, 1.25, 2.75, 7.25])
    assert_allclose(high, [0.5, 1.5, 2.5, 5.5, 0.75, 1.75, 3.25, 7.75])
    assert not said.exact


def test_zeros_among_exact_numbers_lie_below_the_smallest():
    said = stated(ratings_of([[0.0, 1.234, 2.518, 5.077], [0.511, 1.52, 3.017, 7.533]]))
    assert_allclose(said.step, 0)
    assert_allclose(said.limit, [1.234] * 4 + [0] * 4)
    low, high = said.ends(said.values)
    assert (low[0], high[0]) == (0.0, 1.234)
    assert_allclose(low[1:], high[1:])


def test_a_column_goes_before_an_option_and_an_option_before_what_is_found():
    table = [[1.0, 2, 3, 4], [1, 2, 3, 5]]
    assert_allclose(stated(ratings_of(table), 0.0).step, 0)
    assert stated(ratings_of(table), 0.0).exact
    own = [0.5, np.nan, 0.5, 0.5, 0, 0, 0, 0]
    assert_allclose(stated(ratings_of(table, own)).step, [0.5, 1, 0.5, 0.5, 0, 0, 0, 0])
    assert_allclose(stated(ratings_of(table, own), 0.25).step, [0.5, 0.25, 0.5, 0.5, 0, 0, 0, 0])


def test_numbers_are_put_on_the_grid_they_came_from():
    said = stated(ratings_of([[0.0, 1, 2, 5], [0.5, 1.5, 3.0, 7.5]]))
    low, high = said.ends(said.values)
    rng = np.random.default_rng(2)
    numbers = low + (high - low) * rng.uniform(1e-6, 1 - 1e-6, (50, 8))
    assert_allclose(said.rounded(numbers), np.tile(said.values, (50, 1)))
