"""Ratings, loads and moduli that a result holds, as the layout of a table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.provenance import Provenance
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.layout import Layout, merge
from softness_bayes.parameters.declared import FABRIC_MODULUS
from softness_bayes.parameters.space import scales_of
from softness_bayes.touch.contact import Load, loads_at
from softness_bayes.touch.load_groups import LoadGroups, groups_of

if TYPE_CHECKING:
    import xarray as xr

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]


RATING_VALUE = "rating_value"
"""Variable of `constant_data` with `ratings_in`, where these are not the ratings as filed."""

BATCH = "batch"
"""Variable of `constant_data` with the batch of each fabric, whose moduli share an error."""

UNCERTAIN = "uncertain_fabric"
"""Axis of the fabrics whose modulus is sampled."""

RATING_LINE = "rating_line"
"""Variable with the line of each rating in its file; a line of a wide table has several."""

RATING_AS_FILED, RATING_LOW, RATING_HIGH = "rating_as_filed", "rating_low", "rating_high"
"""Variables with ranks and answers as in the file, whose ratings are shares of a list, and with the ends of the
intervals that ratings represent, in the units of the file."""

PEOPLE_ORDERS = "p_people_higher"
"""Variable of `constant_data` with the probability that people rate one fabric higher than another under a load, or
group of loads, along `fabric` and `other_fabric`."""

LOAD_GROUP = "load_group"
"""Axis of variables stored for groups of many loads; with few loads, the axis is `load`."""


def loads_in(constant: xr.Dataset) -> tuple[Load, ...]:
    """Return the loads of the data, of the group `constant_data`."""
    return loads_at(constant["indentation_mm"].values * 1e-3, constant["force_n"].values)


def groups_in(tree: xr.DataTree) -> LoadGroups:
    """Return the groups of the loads of a result."""
    return groups_of(loads_in(tree["constant_data"].to_dataset()))


def layout_of(tree: xr.DataTree) -> Layout:
    """Return participant and condition of every rating in a result; many loads are merged into groups."""
    constant = tree["constant_data"].to_dataset()
    fabric, load = constant["fabric_index"].values, constant["load_index"].values
    modulus = _moduli(tree)
    codes, condition = np.unique(load * modulus.size + fabric, return_inverse=True)
    fabrics, loads = codes % modulus.size, codes // modulus.size
    people = values_in(tree, "log_likelihood_participant", "participant").size
    design = Design(condition, constant["participant_index"].values, fabrics, people)
    found = Provenance(tree.attrs)
    layout = Layout(design, modulus[fabrics], loads, found.direction.sign, found.rating_model.rating_scale)
    groups = groups_in(tree)
    return merge(layout, groups.of)[0] if groups.merged else layout


def values_in(tree: xr.DataTree, group: str, name: str) -> NDArray[Any]:
    """Return the values of one variable or coordinate of a result."""
    return np.asarray(tree[group].to_dataset()[name].values)


def ratings_in(tree: xr.DataTree) -> FloatArray:
    """Return the numbers that stand for the ratings of a result in means and checks, shape (rows,).

    They are the ratings as filed, but for ratings of 0 and at the ends of a slider, which have no logarithm or log
    odds, and for ranks and answers to pairs.
    """
    held = RATING_VALUE in tree["constant_data"].data_vars
    return values_in(tree, "constant_data", RATING_VALUE) if held else values_in(tree, "observed_data", "rating")


def _moduli(tree: xr.DataTree) -> FloatArray:
    """Return the modulus [Pa] of each fabric (fabrics,): of one that was sampled the median of its draws."""
    constant = tree["constant_data"].to_dataset()
    modulus = np.array(constant["effective_modulus_kpa"].values, float)[:, None, None]
    posterior = tree["posterior"].to_dataset() if "posterior" in tree.children else {}
    if FABRIC_MODULUS in posterior:
        drawn = posterior[FABRIC_MODULUS]
        names = constant["fabric"].values.tolist()
        places = [names.index(name) for name in drawn[drawn.dims[-1]].values.tolist()]
        modulus = np.tile(modulus, (1, *drawn.shape[:2]))
        modulus[places] = np.moveaxis(drawn.values, -1, 0)
    batch = constant[BATCH].values.tolist() if BATCH in constant else [""] * len(modulus)
    factors = {of: posterior[name].values for of, name in scales_of(batch).items() if name in posterior}
    return np.array([np.median(own * factors.get(of, 1.0)) for own, of in zip(modulus, batch, strict=True)]) * 1e3
