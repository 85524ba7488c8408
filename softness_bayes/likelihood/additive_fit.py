"""Least-squares fit of an additive table, rater plus condition, by solving for the raters.

With A the numbers of rows of each participant and condition, D and R their sums over participants and conditions, the
normal equations of the conditions are ``L x = b`` with ``L = D - A' R⁻¹ A``. For tables with many conditions and fewer
participants, L is never built: the participants' equations have the matrix ``M = R - A D⁻¹ A'``, and
``G = D⁻¹ + D⁻¹ A' M⁺ A D⁻¹`` solves those of the conditions up to a constant for each connected part of the table. The
cost is linear in the number of conditions.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

MANY_CONDITIONS = 200
"""Number of conditions up to which matrices of conditions by conditions cost little."""


def by_participants(cells: FloatArray) -> bool:
    """Return whether a table (participants, conditions) has many conditions, and more of them than participants."""
    return cells.shape[1] > max(MANY_CONDITIONS, cells.shape[0])


class AdditiveFit:
    """The pseudoinverse of L, as products with it.

    Parameters
    ----------
    cells
        Number of rows of each participant and condition, shape (participants, conditions).
    """

    def __init__(self, cells: FloatArray) -> None:
        count = cells.sum(axis=0)
        self._each = np.divide(1.0, count, out=np.zeros_like(count), where=count > 0)
        self._spread = cells * self._each
        matrix = np.diag(cells.sum(axis=1)) - self._spread @ cells.T
        self._inverse = np.linalg.pinv(matrix, hermitian=True)
        self._part = _parts(cells)
        self.parts = int(self._part.max()) + 1
        """Number of connected parts of the table; the rank of L is the number of conditions less this."""
        self._size = np.bincount(self._part).astype(float)

    def product(self, values: FloatArray) -> FloatArray:
        """Return the pseudoinverse of L times vectors, shape (..., conditions)."""
        return self._levelled(self._solved(self._levelled(values)))

    @cached_property
    def diagonal(self) -> FloatArray:
        """Diagonal of the pseudoinverse of L, shape (conditions,)."""
        spread = self._spread
        own = self._each + ((self._inverse @ spread) * spread).sum(axis=0)
        # minus twice the means of G's rows over a part of the table, plus the means of these means
        sums = np.zeros_like(own)
        for part in range(self.parts):
            member = (self._part == part) / self._size[part]
            row = self._solved(member)
            sums += np.where(member > 0, 2.0 * row - (member * row).sum(), 0.0)
        return np.asarray(own - sums)

    def _solved(self, values: FloatArray) -> FloatArray:
        """Return G times vectors."""
        return np.asarray(values * self._each + (values @ self._spread.T) @ self._inverse @ self._spread)

    def _levelled(self, values: FloatArray) -> FloatArray:
        """Return vectors less their means over each part of the table."""
        if self.parts == 1:
            return np.asarray(values - values.mean(axis=-1, keepdims=True))
        flat = values.reshape(-1, values.shape[-1])
        sums = np.stack([np.bincount(self._part, row, self.parts) for row in flat])
        return np.asarray((flat - (sums / self._size)[:, self._part]).reshape(values.shape))


def _parts(cells: FloatArray) -> NDArray[np.intp]:
    """Return the connected part of the table of each condition, shape (conditions,)."""
    from scipy.sparse import csr_array  # imported here because it takes a third of a second
    from scipy.sparse.csgraph import connected_components

    people, conditions = np.nonzero(cells)
    size = sum(cells.shape)
    edges = csr_array((np.ones(people.size), (conditions, cells.shape[1] + people)), shape=(size, size))
    _, part = connected_components(edges, directed=False)
    return np.unique(part[: cells.shape[1]], return_inverse=True)[1]
