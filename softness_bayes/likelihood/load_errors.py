"""Errors in the loads of ratings: the distinct touches, and the loads at which responses are needed.

The actual load of a rating is log-normal about the stated one, independently of all others. Mean and variance of the
response under this distribution are computed by Gauss-Hermite quadrature with three nodes: the stated load and one on
either side.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.errors import InputError
from softness_bayes.likelihood.design import Design, IndexArray

FloatArray = NDArray[np.float64]

NODE = float(np.sqrt(3.0))
"""Distance of the outer nodes from the stated load, in standard deviations of its logarithm."""

OUTER = 1.0 / 6.0
"""Weight of each outer node; that of the stated load is 2/3."""


@dataclass(frozen=True)
class LoadErrors:
    """Touches (distinct pairs of a condition and a load error), and the loads at which each needs a response.

    After the mean rates of a scene come those at the lower load of each uncertain touch, then those at the higher load;
    by default there is one of each.

    Parameters
    ----------
    condition, log_sd
        Condition of each touch, and standard deviation of its log load, shape (touches,).
    of_row
        Touch of each rating, shape (rows,).
    n_conditions
        Number of conditions.
    nodes
        The loads other than the stated one, in standard deviations of the log load, lower ones first.
    """

    condition: IndexArray
    log_sd: FloatArray
    of_row: IndexArray
    n_conditions: int
    nodes: tuple[float, ...] = (-NODE, NODE)

    @classmethod
    def of(cls, design: Design, log_sd: ArrayLike) -> LoadErrors:
        """Return the touches of ratings with these standard deviations of their log loads, shape (rows,).

        Raises
        ------
        InputError
            If one is negative or not finite.
        """
        spread = np.broadcast_to(np.asarray(log_sd, float), design.condition.shape)
        if not (np.isfinite(spread) & (spread >= 0)).all():
            raise InputError("load errors: expected finite standard deviations of 0 or above")
        pairs, of_row = np.unique(np.column_stack([design.condition, spread]), axis=0, return_inverse=True)
        return cls(pairs[:, 0].astype(np.intp), pairs[:, 1], of_row.reshape(-1), design.n_conditions)

    @property
    def uncertain(self) -> IndexArray:
        """The touches whose loads have errors."""
        return np.flatnonzero(self.log_sd > 0)

    @property
    def columns(self) -> IndexArray:
        """Column of the mean rates of each touch under lower, stated and higher loads, shape (touches, 1 + nodes)."""
        below = sum(node < 0 for node in self.nodes)
        found, uncertain = np.repeat(self.condition[:, None], 1 + len(self.nodes), axis=1), self.uncertain
        for k in range(len(self.nodes)):
            own = self.n_conditions + k * uncertain.size + np.arange(uncertain.size)
            found[uncertain, k if k < below else k + 1] = own
        return found

    def at_nodes(self, nodes: tuple[float, ...]) -> LoadErrors:
        """Return the same touches with other nodes about the stated loads."""
        return replace(self, nodes=nodes)

    def without(self, rows: NDArray[np.bool_]) -> LoadErrors:
        """Return the touches of the remaining rows."""
        return replace(self, of_row=self.of_row[~rows])
