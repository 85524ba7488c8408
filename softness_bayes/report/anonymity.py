"""Anonymous results, without names of participants, for pages that may be shown to anyone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from softness_bayes.results.result import Result

if TYPE_CHECKING:
    import xarray as xr

PEOPLE = ("participant", "finger")
"""Axes and columns with names of people."""


def anonymous(result: Result) -> Result:
    """Return a result in which participants are called P1, P2 and so on, in their order.

    A person with both ratings and plate forces has the same name in both. Names of fabrics and files are kept.
    """
    groups = [group.to_dataset() for group in result.tree.children.values()]
    stored = [group[what].values for what in PEOPLE for group in groups if what in group.coords]
    names = dict.fromkeys(str(name) for values in stored for name in values)
    return renamed(result, {name: f"P{k}" for k, name in enumerate(names, 1)})


def renamed(result: Result, names: Mapping[str, str]) -> Result:
    """Return a result with all names of people replaced.

    Parameters
    ----------
    result
        A finished run.
    names
        New names of participants, by present name.
    """
    import xarray as xr

    groups = {f"/{name}": _renamed(group.to_dataset(), names) for name, group in result.tree.children.items()}
    tree = xr.DataTree.from_dict({"/": xr.Dataset(attrs=result.tree.attrs), **groups})
    tables = dict(result.tables)
    for label, table in tables.items():
        for what in PEOPLE:
            if what in table.index.names:
                tables[label] = table = table.rename(index=dict(names), level=what)
            if what in table:
                column = [names.get(str(name), name) for name in table[what]]
                tables[label] = table = table.assign(**{what: column})
    return replace(result, tree=tree, tables=tables)


def _renamed(group: xr.Dataset, names: Mapping[str, str]) -> xr.Dataset:
    renamed_axes = {
        what: [names.get(str(name), str(name)) for name in group[what].values] for what in PEOPLE if what in group
    }
    return group.assign_coords({what: (what, values) for what, values in renamed_axes.items()})
