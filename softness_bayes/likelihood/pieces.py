"""Arithmetic over many draws: in chunks, so that memory stays bounded; sums of exponentials; triangular factors."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from softness_bayes.likelihood.contract import Parameters, RowsLeftOut
from softness_bayes.likelihood.design import FloatArray

ROOM = 1_000_000
"""Largest number of elements of an array in a chunk; about a dozen such arrays exist at once."""

BLOCK = 45_000
"""Number of elements of the arrays of a block, which stay in the processor's cache and are used again and again. The
memory of larger arrays is released and allocated anew at each operation, which takes several times as long as the
operation itself."""


def pieces(draws: int, width: int, room: int | None = None) -> list[slice]:
    """Return slices of the draws of about equal size, as few as fit into ``room`` with ``width`` numbers for each.

    The default of ``room`` is `ROOM`.
    """
    size = max(1, (room or ROOM) // max(width, 1))
    size = -(-draws // -(-draws // size)) if draws else size
    return [slice(first, min(first + size, draws)) for first in range(0, draws, size)]


def over_draws(value: Any, shape: tuple[int, ...]) -> FloatArray:
    """Return a number or array for each of the draws of a batch shape, as one axis; without a copy where possible."""
    if not getattr(value, "shape", ()):
        return np.full(math.prod(shape), value, float)
    found = np.asarray(value, float)
    return (found if found.shape == shape else np.broadcast_to(found, shape)).ravel()


def in_pieces(
    work: Callable[[FloatArray, Parameters], FloatArray],
    width: int,
    mean_rate: FloatArray,
    parameters: Parameters,
    room: int | None = None,
) -> FloatArray:
    """Return ``work(mean_rate, parameters)``, of shape (..., columns), computed in chunks.

    Parameters
    ----------
    work
        Function that treats every draw independently.
    width
        Numbers that it keeps in memory for each draw.
    mean_rate
        Shape (..., conditions).
    parameters
        Numbers and arrays of the batch shape (...).
    room
        As for `pieces`.
    """
    shape = parameters.batch_shape(mean_rate.shape[:-1])
    draws = int(np.prod(shape))
    parts = pieces(draws, width, room)
    if len(parts) <= 1:
        return work(mean_rate, parameters)
    rate = np.broadcast_to(mean_rate, (*shape, mean_rate.shape[-1])).reshape(draws, -1)
    flat = parameters.each(lambda value: over_draws(value, shape) if np.ndim(value) else value)
    first = work(rate[parts[0]], flat.part(parts[0]))
    found = np.empty((draws, first.shape[-1]))
    found[parts[0]] = first
    for piece in parts[1:]:
        found[piece] = work(rate[piece], flat.part(piece))
    return found.reshape((*shape, -1))


def left_out_in_pieces(
    work: Callable[[FloatArray, Parameters], RowsLeftOut], width: int, mean_rate: FloatArray, parameters: Parameters
) -> RowsLeftOut:
    """Return ``work(mean_rate, parameters)`` computed in chunks; arguments as for `in_pieces`."""
    both = in_pieces(lambda *some: np.concatenate(work(*some), axis=-1), width, mean_rate, parameters)
    return RowsLeftOut(*np.split(both, 2, axis=-1))


def log_sum(values: FloatArray, axis: int) -> FloatArray:
    """Return the log of the sum of exponentials along an axis; SciPy's takes several times as long."""
    largest = values.max(axis=axis, keepdims=True)
    largest = np.where(np.isfinite(largest), largest, 0.0)
    with np.errstate(divide="ignore"):
        terms = values - largest
        found = np.log(np.exp(terms, out=terms).sum(axis=axis))
    return np.asarray(found + np.squeeze(largest, axis=axis))


def cholesky(matrix: FloatArray, least: float) -> FloatArray:
    """Return lower factors of symmetric matrices (..., k, k), with pivots of at least `least`.

    NumPy's and SciPy's take many small matrices one by one.
    """
    root = np.zeros_like(matrix)
    for j in range(matrix.shape[-1]):
        row = root[..., j, :j]
        pivot = np.sqrt(np.maximum(matrix[..., j, j] - (row**2).sum(axis=-1), least))
        root[..., j, j] = pivot
        below = matrix[..., j + 1 :, j] - (root[..., j + 1 :, :j] * row[..., None, :]).sum(axis=-1)
        root[..., j + 1 :, j] = below / pivot[..., None]
    return root


def forward(root: FloatArray, right: FloatArray) -> FloatArray:
    """Return X with root X = right, for lower factors (..., k, k) and right sides (..., k, columns)."""
    x = np.empty(np.broadcast_shapes(root.shape[:-1], right.shape[:-1]) + right.shape[-1:])
    for j in range(root.shape[-1]):
        left = (root[..., j, :j, None] * x[..., :j, :]).sum(axis=-2)
        x[..., j, :] = (right[..., j, :] - left) / root[..., j, j, None]
    return x


def backward(root: FloatArray, right: FloatArray) -> FloatArray:
    """Return X with root' X = right, for lower factors (..., k, k) and right sides (..., k, columns)."""
    x = np.empty(np.broadcast_shapes(root.shape[:-1], right.shape[:-1]) + right.shape[-1:])
    for j in reversed(range(root.shape[-1])):
        left = (root[..., j + 1 :, j, None] * x[..., j + 1 :, :]).sum(axis=-2)
        x[..., j, :] = (right[..., j, :] - left) / root[..., j, j, None]
    return x


def log_determinant(root: FloatArray) -> FloatArray:
    """Return the log determinant of a matrix from its lower factor, shape (...)."""
    return np.asarray(2.0 * np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1))
