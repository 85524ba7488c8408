"""Groups of similar measured loads, which are checked and displayed as one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.defaults import MOST_SHOWN
from softness_bayes.base.readable import counted
from softness_bayes.touch.contact import Indentation, Load, held

IntArray = NDArray[np.intp]

NEAR = 1.3
"""Largest ratio of two loads of a group, unless that makes more groups than are shown."""


@dataclass(frozen=True)
class LoadGroup:
    """Several loads of one kind that are checked and displayed as one.

    Parameters
    ----------
    load
        The load nearest to the group's geometric mean; curves are drawn for it.
    name
        The ends of the group, as in `0.93 to 1.06 N`.
    """

    load: Load
    name: str

    def __str__(self) -> str:
        return self.name


class LoadGroups(NamedTuple):
    """The groups of a list of loads; a few loads form one group each."""

    of: IntArray
    """Index (loads,) of each load's group."""
    at: IntArray
    """Index of the load that represents each group, shape (groups,)."""
    called: tuple[Load | LoadGroup, ...]
    """The load or, for several, the `LoadGroup` of each group; its text is the name of the group."""

    @property
    def names(self) -> list[str]:
        """Unique names of the groups."""
        return [str(one) for one in self.called]

    @property
    def merged(self) -> bool:
        """True if any group has several loads."""
        return self.of.size > self.at.size

    @property
    def sentence(self) -> str:
        """A note that loads are grouped; empty if they are not."""
        count = self.at.size
        return f"{self.of.size} loads in {counted(count, 'group')}" if self.merged else ""


def groups_of(loads: Sequence[Load], most: int = MOST_SHOWN) -> LoadGroups:
    """Return one group per load if there are few loads, and groups of neighbouring loads if there are many.

    Each kind of load is clustered in rising order, on a logarithmic scale: members of a group differ by less than
    `NEAR`, or by more if the kind's share of `most` groups requires it.

    Parameters
    ----------
    loads
        Distinct loads, indentations first, each kind in rising order.
    most
        Largest number of groups.
    """
    count = len(loads)
    if count <= most:
        return LoadGroups(np.arange(count), np.arange(count), tuple(loads))
    of = np.empty(count, dtype=np.intp)
    at: list[int] = []
    called: list[Load | LoadGroup] = []
    indented = np.array([isinstance(load, Indentation) for load in loads])
    kinds = [own for own in (np.flatnonzero(indented), np.flatnonzero(~indented)) if own.size]
    for own, groups in zip(kinds, _most_of([own.size for own in kinds], most), strict=True):
        log = np.log([held(loads[k]) for k in own.tolist()])
        members = [own[some] for some in _clusters(log, groups)]
        names = _names([[loads[k] for k in some] for some in members])
        for some, name in zip(members, names, strict=True):
            of[some] = len(at)
            middle = int(some[np.abs(log[some - own[0]] - log[some - own[0]].mean()).argmin()])
            at.append(middle)
            called.append(loads[middle] if some.size == 1 else LoadGroup(loads[middle], name))
    return LoadGroups(of, np.array(at, dtype=np.intp), tuple(called))


def _most_of(counts: Sequence[int], most: int) -> list[int]:
    """Return the largest number of groups of each kind; few loads of one kind stay separate if the other has many."""
    fair = max(1, most // len(counts))
    left = most - sum(count for count in counts if count <= fair)
    many = sum(count > fair for count in counts)
    return [count if count <= fair else max(1, left // many) for count in counts]


def _clusters(log: NDArray[np.float64], most: int) -> list[IntArray]:
    """Return the indices of each cluster of ascending values: a cluster is as wide as `NEAR`, or wider for `most`."""
    width, starts = max(math.log(NEAR), float(np.ptp(log)) / most), [0]
    for k in range(1, log.size):
        if log[k] - log[starts[-1]] >= width:
            starts.append(k)
    return np.split(np.arange(log.size), starts[1:most])


def _names(groups: Sequence[Sequence[Load]]) -> list[str]:
    """Return the range of each group with its unit, with the fewest digits that keep names unique."""
    names: list[str] = []
    for digits in (3, 6, 12):
        ends = [[type(load)(float(f"{held(load):.{digits}g}")) for load in (one[0], one[-1])] for one in groups]
        names = [f"{str(low).rpartition(' ')[0]} to {high}" for low, high in ends]
        if len(set(names)) == len(names):
            break
    return names
