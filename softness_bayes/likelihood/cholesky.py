"""Triangular factors of many small symmetric matrices at once; SciPy's and NumPy's take the matrices one by one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def cholesky(matrix: FloatArray, least: float) -> FloatArray:
    """Return lower factors of symmetric matrices (..., k, k), with pivots of at least `least`."""
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
