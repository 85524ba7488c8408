"""Layout of a table of ratings: who rated which condition, and the additive fit of participants and conditions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array

from softness_bayes.likelihood.design import Design, FloatArray, IndexArray
from softness_bayes.likelihood.pieces import pieces
from softness_bayes.likelihood.scales import MAGNITUDE, Scale

ROUNDING = 1e-12
"""Standard deviation of residuals [-] below which it is treated as zero: rounding errors of log ratings are smaller."""


RELATIVE_RANK = 1e-9
"""Eigenvalues of normal equations below this, relative to the largest, are zero."""


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
    def _count(self) -> FloatArray:
        """Number of each participant's rows, shape (participants,), 1 without rows."""
        return np.asarray(np.maximum(self.design.cells.sum(axis=1), 1.0))

    @cached_property
    def _share(self) -> FloatArray:
        """Share of each participant's rows in each condition, shape (participants, conditions); 0 without rows."""
        return np.asarray(self.design.cells / self._count[:, None])

    @cached_property
    def _inverse(self) -> FloatArray:
        """Generalised inverse of the conditions' normal equations without participants, (conditions, conditions).

        Solutions have the mean 0 in each connected part of the table, because they have no component in the null space.
        """
        cells = self.design.cells
        normal = np.diag(cells.sum(axis=0)) - cells.T @ self._share
        return np.asarray(np.linalg.pinv(normal, rcond=RELATIVE_RANK, hermitian=True), float)

    @cached_property
    def residual_freedom(self) -> int:
        """Degrees of freedom that the additive fit leaves."""
        differences = np.linalg.matrix_rank(self._inverse, tol=RELATIVE_RANK, hermitian=True)
        return int(self.design.n_rows - self._present.sum() - differences)

    @property
    def _present(self) -> NDArray[np.bool_]:
        return np.asarray(self.design.cells.any(axis=1))

    @property
    def leverage(self) -> FloatArray:
        """Weight of each row in its own fitted value, shape (rows,): a residual's variance is 1 less this."""
        person, condition = self.design.participant, self.design.condition
        spread = self._share @ self._inverse
        cells = np.diag(self._inverse) - 2.0 * spread + (spread * self._share).sum(axis=1, keepdims=True)
        return (cells + 1.0 / self._count[:, None])[person, condition]

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
        freedom, present, rows = self.residual_freedom, self._present, np.arange(design.n_rows)
        of_person, of_condition = (
            csr_array((np.ones(rows.size), (rows, index)), shape=(rows.size, size))
            for index, size in ((design.participant, design.n_participants), (design.condition, design.n_conditions))
        )
        fits = []
        for k in pieces(len(filed), design.n_rows):
            y = self.scale.additive(filed[k])
            mean = (y @ of_person) / self._count
            condition = (y @ of_condition - mean @ design.cells) @ self._inverse
            participant = mean - condition @ self._share.T
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
