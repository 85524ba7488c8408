"""Layout of a table of ratings: who rated which condition, and the additive fit of participants and conditions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import block_array, csr_array, diags_array

from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.pieces import pieces
from softness_bayes.likelihood.scales import MAGNITUDE, Scale

if TYPE_CHECKING:
    from scipy.sparse.linalg import SuperLU

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]


ROUNDING = 1e-12
"""Standard deviation of residuals [-] below which it is treated as zero: rounding errors of log ratings are smaller."""


class Additive(NamedTuple):
    """The additive fit log y = condition + participant + residual of one or many data sets."""

    condition: FloatArray
    """Mean log rating of each condition at the average participant, shape (..., conditions)."""
    participant: FloatArray
    """Deviation of each participant, shape (..., participants); NaN for those without ratings."""
    smallest: FloatArray
    """Smallest of the residuals, shape (...)."""
    largest: FloatArray
    """Largest of them, shape (...)."""
    sd: FloatArray
    """Standard deviation of the residuals, shape (...); NaN without degrees of freedom."""


@dataclass(frozen=True)
class Layout:
    """The design of a data set: participant and condition of each rating, modulus and load of each condition.

    Parameters
    ----------
    design
        Participant and condition of every row; every condition must have a row.
    modulus
        E_fab of each condition [Pa], shape (conditions,).
    load
        Index of each condition's load, shape (conditions,).
    sign
        Whether ratings rise (+1) or fall (-1) with the response.
    scale
        Scale of the ratings, with its transformation to the additive scale.
    """

    design: Design
    modulus: FloatArray
    load: IndexArray
    sign: float = 1.0
    scale: Scale = MAGNITUDE

    @property
    def loads(self) -> IndexArray:
        """Indices of the loads."""
        return np.unique(self.load)

    @cached_property
    def _part(self) -> IndexArray:
        """Connected part of the table of each participant, then of each condition."""
        from scipy.sparse.csgraph import connected_components  # imported here because it takes a third of a second

        people = self.design.n_participants
        size = people + self.design.n_conditions
        edges = self.design.participant, people + self.design.condition
        graph = csr_array((np.ones(self.design.n_rows), edges), shape=(size, size))
        return np.asarray(connected_components(graph, directed=False)[1], np.intp)

    @cached_property
    def _free(self) -> IndexArray:
        """Effects to be estimated: participants with ratings, and conditions but the first of each connected part."""
        people = self.design.n_participants
        present = np.flatnonzero(self.design.cells.sum(axis=1) > 0)
        first = np.unique(self._part[people:], return_index=True)[1]
        return np.concatenate([present, people + np.setdiff1d(np.arange(self.design.n_conditions), first)])

    @cached_property
    def _rows(self) -> csr_array:
        """Effects of each row as a sparse matrix of zeros and ones, shape (rows, participants + conditions)."""
        design, size = self.design, self.design.n_rows
        columns = np.stack([design.participant, design.n_participants + design.condition], axis=1).ravel()
        shape = (size, design.n_participants + design.n_conditions)
        return csr_array((np.ones(2 * size), columns, 2 * np.arange(size + 1)), shape=shape)

    @cached_property
    def _normal(self) -> SuperLU:
        """Factors of the normal equations of the free effects, whose matrix is sparse."""
        from scipy.sparse.linalg import splu  # imported here because it takes a third of a second

        cells = csr_array(self.design.cells)
        counts = (diags_array(self.design.cells.sum(axis=axis)) for axis in (1, 0))
        person, condition = counts
        whole = block_array([[person, cells], [cells.T, condition]]).tocsr()
        return splu(whole[self._free][:, self._free].tocsc())

    @property
    def residual_freedom(self) -> int:
        """Degrees of freedom that the additive fit leaves."""
        return self.design.n_rows - self._free.size

    @property
    def leverage(self) -> FloatArray:
        """Weight of each row in its own fitted value, shape (rows,): a residual's variance is 1 less this."""
        rows, found = self._rows[:, self._free], np.empty(self.design.n_rows)
        for k in pieces(self.design.n_rows, self._free.size):
            some = rows[k].toarray()
            found[k] = (some * self._normal.solve(some.T).T).sum(axis=1)
        return found

    def fit(self, ratings: ArrayLike) -> Additive:
        """Fit log ratings additively by participants and conditions.

        In each connected part of the table the conditions have mean 0, apart from the level of all.

        Parameters
        ----------
        ratings
            Shape (..., rows); positive if they have logarithms.
        """
        design, filed = self.design, np.asarray(ratings, float)
        shape, filed = filed.shape[:-1], filed.reshape(-1, filed.shape[-1])
        people, freedom = design.n_participants, self.residual_freedom
        present = design.cells.sum(axis=1) > 0
        part_of_person, part = self._part[:people], self._part[people:]
        member = np.eye(int(self._part.max()) + 1)[part]
        mean_of_part = member / np.maximum(member.sum(axis=0), 1.0)
        fits = []
        for k in pieces(len(filed), design.n_rows):
            y = self.scale.additive(filed[k])
            effects = np.zeros((len(y), people + design.n_conditions))
            effects[:, self._free] = self._normal.solve((self._rows.T @ y.T)[self._free]).T
            participant, condition = effects[:, :people], effects[:, people:]
            centre = condition @ mean_of_part
            condition, participant = condition - centre[:, part], participant + centre[:, part_of_person]
            residual = y - condition[:, design.condition] - participant[:, design.participant]
            level = participant[:, present].mean(axis=-1, keepdims=True)
            participant = np.where(present, participant - level, np.nan)
            # in complete orders and pairs, every participant has the same mean
            rounding = ROUNDING * np.abs(y).max(axis=-1, keepdims=True)
            participant = np.where(np.abs(participant) < rounding, 0.0, participant)
            sd = np.sqrt((residual**2).sum(axis=-1) / freedom) if freedom > 0 else np.full(len(y), np.nan)
            fits.append((condition + level, participant, residual.min(axis=-1), residual.max(axis=-1), sd))
        return Additive(*(np.concatenate(v).reshape((*shape, *v[0].shape[1:])) for v in zip(*fits, strict=True)))


def merge(layout: Layout, of: IndexArray) -> tuple[Layout, FloatArray]:
    """Return a layout whose conditions are fabrics under groups of loads, and each old condition's share of these.

    Parameters
    ----------
    layout
        Design of the ratings, under single loads.
    of
        Index of each load's group, which replaces the load.

    Returns
    -------
    layout : Layout
    share : ndarray, shape (old conditions, new conditions)
        Shares of the ratings, which sum to 1 over the old conditions.
    """
    design = layout.design
    code = of[layout.load] * design.n_fabrics + design.fabric
    distinct, first, place = np.unique(code, return_index=True, return_inverse=True)
    loads, fabrics = np.divmod(distinct, design.n_fabrics)
    merged = Design(place[design.condition], design.participant, fabrics, design.n_participants)
    share = np.zeros((place.size, distinct.size))
    share[np.arange(place.size), place] = design.cells.sum(axis=0)
    found = replace(layout, design=merged, modulus=layout.modulus[first], load=loads)
    return found, share / share.sum(axis=0)
