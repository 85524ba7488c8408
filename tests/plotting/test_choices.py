"""Figures of answers that are no numbers: categories and pairs."""

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from softness_bayes.base.errors import InputError
from softness_bayes.likelihood.scales import CATEGORIES, MAGNITUDE, PAIRS
from softness_bayes.plotting.checks import (
    _draw_answers,
    counts_of,
    wins_of,
)
from softness_bayes.plotting.data import data_of
from softness_bayes.plotting.figures import FIGURES
from softness_bayes.plotting.style import USUAL
from softness_bayes.touch.contact import Indentation
from softness_bayes.touch.load_groups import groups_of

MODULUS = np.array([4e4, 1e4, 2e4])
NAMES = ["felt", "gauze", "lawn"]


def test_categories_are_counted(rng):
    again = rng.integers(1, 5, (200, 40)).astype(float)
    found = counts_of("1 mm", np.arange(1, 5), np.array([1.0, 1.0, 4.0]), again)
    assert found.observed.tolist() == [2, 0, 0, 1]
    assert (found.replicates.sum(axis=1) == 40).all()
    table = data_of(_draw_answers([found], USUAL))
    limits = table[table["element"] == "limits"]
    np.testing.assert_allclose(limits["y"], np.quantile(found.replicates, 0.05, axis=0), rtol=1e-5)
    np.testing.assert_allclose(limits["y_end"], np.quantile(found.replicates, 0.95, axis=0), rtol=1e-5)
    assert table.loc[table["element"] == "observed", "y_end"].tolist() == [2, 0, 0, 1]


def test_answers_are_those_against_the_standard():
    """Lawn is asked about most; which fabric of a pair comes first does not matter."""
    pairs = np.array([[2, 0], [0, 2], [1, 2], [2, 1], [0, 1]])
    observed = np.array([1.0, 1.0, 0.5, 0.0, 1.0])
    again = np.tile(observed, (3, 1))
    found = wins_of("1 mm", NAMES, MODULUS, pairs, observed, again)
    assert found.title == "1 mm, against lawn (4 answers)"
    assert (found.fabrics, found.x.tolist()) == (["gauze", "felt"], [10.0, 40.0])
    np.testing.assert_allclose(found.observed, [0.75, 0.5])
    np.testing.assert_allclose(found.replicates, np.tile([0.75, 0.5], (3, 1)))
    turned = wins_of("1 mm", NAMES, MODULUS, pairs[:, ::-1], 1.0 - observed, 1.0 - again)
    np.testing.assert_allclose(turned.observed, found.observed)
    np.testing.assert_allclose(turned.replicates, found.replicates)


def test_the_standard_of_equal_numbers_of_answers_lies_in_the_middle():
    pairs = np.array([[0, 1], [1, 2], [2, 0]])
    assert wins_of("1 mm", NAMES, MODULUS, pairs, np.ones(3), np.ones((2, 3))).title.startswith("1 mm, against lawn")


def run(scale, rating, **columns):
    """A result as figures know it: four rows under two loads."""
    constant = {
        "load_index": [0, 0, 1, 1], "fabric_index": [0, 1, 1, 2], "participant_index": [0] * 4,
        "list_index": [0, 0, 1, 1],
    } | columns  # fmt: skip
    groups = {
        "constant_data": xr.Dataset(
            {name: ("rating_row", np.array(values)) for name, values in constant.items()}
            | {"effective_modulus_kpa": ("fabric", MODULUS / 1e3)},
            coords={"fabric": NAMES},
        ),
        "observed_data": xr.Dataset({"rating": ("rating_row", np.array(rating, float))}),
        "posterior_predictive": xr.Dataset(
            {
                name: (("chain", "draw", "rating_row"), np.tile(np.array(rating, float), (1, 5, 1)))
                for name in ("rating", "rating_of_new_participants")
            }
        ),
    }
    tree = xr.DataTree.from_dict(groups)
    loads = (Indentation(1e-3), Indentation(2e-3))
    members = {"scale": scale, "loads": loads, "load_groups": groups_of(loads), "group": lambda name: groups[name]}
    return SimpleNamespace(tree=tree, is_first_look=False, **members)


def test_a_run_shows_what_its_scale_has():
    pairs, categories = run(PAIRS, [1, 0, 0, 1]), run(CATEGORIES, [1, 2, 3, 3])
    table = data_of(FIGURES["psychometric"](pairs, USUAL))
    seen = table[table["element"] == "observed"].sort_values("panel")
    assert seen["panel"].tolist() == ["1 mm", "2 mm"]
    table = data_of(FIGURES["category_counts"](categories, USUAL))
    assert table.loc[table["element"] == "observed", "y_end"].tolist() == [1, 1, 0, 0, 0, 2]
    for name, result in (
        ("psychometric", categories),
        ("category_counts", pairs),
        ("category_counts", run(MAGNITUDE, [1] * 4)),
    ):
        with pytest.raises(InputError, match="its ratings are"):
            FIGURES[name](result, USUAL)
