"""Sums of squares within participants, as a function of values of the conditions.

The sum over rows of the squared residuals ``y - v[condition]``, each less its participant's mean, is
``constant + d' L d`` with d the values less those of the best fit. `Dense` factorises L, a matrix of conditions by
conditions; `Sparse` sums over the distinct cells, whose number grows no faster than that of the rows.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.additive_fit import AdditiveFit, by_participants
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.pieces import pieces

FloatArray = NDArray[np.float64]


class Within(Protocol):
    """Sum of squares within participants."""

    def squares(self, values: FloatArray) -> FloatArray:
        """Return the sum for values of the conditions, shapes (..., conditions) and (...)."""


class Dense:
    """The sum of squares by a factor of L.

    Parameters
    ----------
    design
        Condition and participant of every row.
    deviation
        y of every row less its participant's mean, shape (rows,).
    """

    def __init__(self, design: Design, deviation: FloatArray) -> None:
        cells = design.cells
        shares = cells / np.maximum(cells.sum(axis=1), 1.0)[:, None]
        laplacian = np.diag(cells.sum(axis=0)) - cells.T @ shares
        size, vectors = np.linalg.eigh(laplacian)
        kept = size > design.n_rows * size.size * np.finfo(float).eps
        self.factor = vectors[:, kept] * np.sqrt(size[kept])
        by_condition: FloatArray = np.bincount(design.condition, deviation, design.n_conditions).astype(float)
        best = vectors[:, kept] @ ((by_condition @ vectors[:, kept]) / size[kept])
        self.target = best @ self.factor
        left = deviation - best[design.condition] + (shares @ best)[design.participant]
        self._constant = float(left @ left)

    def squares(self, values: FloatArray) -> FloatArray:
        """Return the sum for values of the conditions."""
        return np.asarray(self._constant + ((values @ self.factor - self.target) ** 2).sum(axis=-1))


class Sparse:
    """The sum of squares over the distinct cells; participants who rated the same conditions share theirs.

    Arguments are those of `Dense`.
    """

    def __init__(self, design: Design, deviation: FloatArray) -> None:
        cells = design.cells
        distinct, pattern, people = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
        rows = distinct.sum(axis=1)
        distinct, people = distinct[rows > 0], people[rows > 0]
        place = (np.cumsum(rows > 0) - 1)[pattern.ravel()]
        self._pattern, self._condition = np.nonzero(distinct)
        number = distinct[self._pattern, self._condition]
        self._weight = number * people[self._pattern]
        self._share = number / rows[rows > 0][self._pattern]
        self._start = np.searchsorted(self._pattern, np.arange(len(distinct)))
        by_condition: FloatArray = np.bincount(design.condition, deviation, design.n_conditions).astype(float)
        self._best = AdditiveFit(cells).product(by_condition)
        mean = np.add.reduceat(self._best[self._condition] * self._share, self._start)
        left = deviation - self._best[design.condition] + mean[place[design.participant]]
        self._constant = float(left @ left)
        # 0 apart from the rounding of the best fit
        self._gradient = np.bincount(design.condition, left, design.n_conditions)

    def squares(self, values: FloatArray) -> FloatArray:
        """Return the sum for values of the conditions."""
        away = np.asarray(values - self._best)
        flat = away.reshape(-1, away.shape[-1])
        found = np.empty(len(flat))
        for k in pieces(len(flat), self._condition.size):
            each = flat[k][:, self._condition]
            each -= np.add.reduceat(each * self._share, self._start, axis=-1)[:, self._pattern]
            found[k] = (each**2) @ self._weight - 2.0 * (flat[k] @ self._gradient)
        return self._constant + found.reshape(away.shape[:-1])


def within_of(design: Design, deviation: FloatArray) -> Within:
    """Return the sum of squares of rows, in the form that costs less; arguments as for `Dense`."""
    return (Sparse if by_participants(design.cells) else Dense)(design, deviation)
