"""Density of one block of ratings given all others, for blocks that are independent given a few common effects.

Let u be the common effects in standard deviations of their prior, and q_g(u) the negative log density of block g, a
quadratic function with Hessian A_g. At u*, the minimum of |u|²/2 + sum q_g, with M = I + sum A_g and g_g the gradient
of q_g there,

    log p(y_g | y_-g) = -q_g(u*) - ½ log |M| + ½ log |M - A_g| - ½ g_g' (M - A_g)^-1 g_g.

No term suffers from cancellation: q_g is a sum of squared residuals, and M - A_g is summed without A_g.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array

from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.pieces import pieces
from softness_bayes.likelihood.random_effects import EffectSpreads

Array = NDArray[np.float64]

_LOG_TWO_PI = float(np.log(2.0 * np.pi))
_REFINED = 3  # Newton steps: the first is exact up to rounding errors, which the others remove


class BlockLaw(NamedTuple):
    """The law of a block given all others, each field of shape (draws, blocks, ...)."""

    log_density: Array
    """log p(y_g | y_-g), shape (draws, blocks)."""
    moved: Array
    """Mean of u without the block, minus u*, shape (draws, blocks, effects)."""
    precision: Array
    """Inverse covariance of u without the block, shape (draws, blocks, effects, effects)."""


def given_the_others(misfit: Array, gradient: Array, hessian: Array) -> BlockLaw:
    """Return the density of each block given the others.

    Parameters
    ----------
    misfit, gradient
        q_g and its gradient at u*, shapes (draws, blocks) and (draws, blocks, effects).
    hessian
        A_g, shape (draws, blocks, effects, effects).
    """
    before, after = np.zeros_like(hessian), np.zeros_like(hessian)
    before[:, 1:] = np.cumsum(hessian[:, :-1], axis=1)
    after[:, :-1] = np.cumsum(hessian[:, :0:-1], axis=1)[:, ::-1]
    without = np.eye(hessian.shape[-1]) + before + after
    whole = np.linalg.slogdet(without[:, -1] + hessian[:, -1]).logabsdet
    moved = np.asarray(np.linalg.solve(without, gradient[..., None])[..., 0], dtype=float)
    pull = (gradient * moved).sum(axis=-1)
    density = -misfit - 0.5 * (whole[:, None] - np.linalg.slogdet(without).logabsdet + pull)
    return BlockLaw(density, moved, without)


def participant_log_density(
    design: Design, values: Array, mean: float, sd: float, offset: Array, spreads: EffectSpreads
) -> Array:
    """Return the log density of all rows of each participant given those of all others.

    The model is that of `random_effects.RandomEffects`; participants share mu and the effects of fabrics.

    Parameters
    ----------
    design
        Condition and participant of every row.
    values
        y of every row, shape (rows,).
    mean, sd
        Prior of mu.
    offset
        v of each condition, shape (draws, conditions).
    spreads
        Standard deviations, each a number or an array (draws,).

    Returns
    -------
    ndarray, shape (draws, participants)
    """
    broadcast = [np.broadcast_to(np.asarray(value, float), offset.shape[:1]) for value in spreads]
    shared = _Shared(design, values - mean, sd, bool((broadcast[2] > 0).any()))
    found = np.empty((len(offset), design.n_participants))
    for piece in pieces(len(offset), design.n_rows + design.n_participants * shared.size**2):
        found[piece] = shared.log_density(offset[piece], EffectSpreads(*(value[piece] for value in broadcast)))
    return found


class _Shared:
    """Participants as blocks, independent given mu and the effects of fabrics, if any."""

    def __init__(self, design: Design, values: Array, sd: float, fabrics: bool) -> None:
        self._design, self._values, self._sd = design, values, sd
        kinds = np.eye(design.n_fabrics)[design.fabric] if fabrics else np.zeros((design.n_conditions, 0))
        self._basis = np.column_stack([np.ones(design.n_conditions), kinds])
        self.size = self._basis.shape[1]
        rows, people = design.cells.sum(axis=1), design.n_participants
        self._rows = rows
        inside = design.cells @ kinds
        self._share = np.column_stack([np.ones(people), inside / np.maximum(rows, 1.0)[:, None]])
        # sums of squares and products of the basis within participants; those of the constant vanish
        self._scatter = np.zeros((people, self.size, self.size))
        self._scatter[:, 1:, 1:] = inside[:, :, None] * (np.eye(self.size - 1) - self._share[:, None, 1:])
        self._of_person = summing(design.participant, people)
        self._of_kind = []
        for k in range(self.size - 1):
            chosen = design.fabric[design.condition] == k
            self._of_kind.append(summing(np.where(chosen, design.participant, people), people))

    def log_density(self, offset: Array, spreads: EffectSpreads) -> Array:
        variance = np.maximum(np.asarray(spreads.row) ** 2, 1e-100)[:, None]
        between = variance + self._rows * np.asarray(spreads.participant)[:, None] ** 2
        precision = self._rows / between
        scale = np.full((len(offset), self.size), self._sd)
        scale[:, 1:] = np.asarray(spreads.fabric)[:, None]
        hessian = self._scatter / variance[..., None, None]
        hessian = hessian + precision[..., None, None] * (self._share[:, :, None] * self._share[:, None, :])
        hessian *= (scale[:, :, None] * scale[:, None, :])[:, None]

        def at(u: Array) -> tuple[Array, Array]:
            left = self._values - (offset + (u * scale) @ self._basis.T)[:, self._design.condition]
            mean = (self._of_person @ left.T).T / np.maximum(self._rows, 1.0)
            left -= mean[:, self._design.participant]
            misfit = 0.5 * ((self._of_person @ (left**2).T).T / variance + precision * mean**2)
            sums = np.stack([np.zeros_like(mean), *((kind @ left.T).T for kind in self._of_kind)], axis=-1)
            slope = sums / variance[..., None] + self._share * (precision * mean)[..., None]
            return misfit, -scale[:, None] * slope

        _, misfit, gradient = minimum(at, hessian)
        determinant = (self._rows - 1.0) * np.log(variance) + np.log(between)
        misfit = misfit + 0.5 * (self._rows * _LOG_TWO_PI + determinant)
        return given_the_others(misfit, gradient, hessian).log_density


def minimum(at: Callable[[Array], tuple[Array, Array]], hessian: Array) -> tuple[Array, Array, Array]:
    """Return u*, shape (draws, effects), with the misfit and gradient of every block there."""
    precision = np.eye(hessian.shape[-1]) + hessian.sum(axis=1)
    u = np.zeros((len(hessian), hessian.shape[-1]))
    for _ in range(_REFINED):
        _, gradient = at(u)
        u = u - np.linalg.solve(precision, (u + gradient.sum(axis=1))[..., None])[..., 0]
    return u, *at(u)


def summing(index: ArrayLike, size: int) -> csr_array:
    """Return the sparse matrix (size, rows) that sums rows by index; indices of ``size`` or more are ignored."""
    index = np.asarray(index)
    row = np.flatnonzero(index < size)
    return csr_array((np.ones(row.size), (index[row], row)), shape=(size, index.size))
