"""Batches of parameter vectors, split into chunks that fit into the processor's cache."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from softness_bayes.kinds import require_members
from softness_bayes.touch.parameters import TouchParameters, checked_rows

Array = NDArray[np.float64]
Index = NDArray[np.intp]

CHUNK = 1 << 16
"""Number of quadrature nodes evaluated at once: enough for fast array operations, few enough for the cache."""

LEAST_ROWS = 16
"""Vectors that are evaluated at once at least, if there are so many: each load's table is then read for all of them."""


def chunks(
    parameters: TouchParameters, modulus: Array | None, nodes: int
) -> tuple[tuple[int, ...], Iterator[tuple[TouchParameters, Array | None]]]:
    """Cut a batch of parameter vectors into chunks.

    Parameters
    ----------
    parameters
        Arrays of one batch shape (...), or scalars.
    modulus
        E_fab [Pa] of each fabric, shape (..., fabrics), or None.
    nodes
        Number of quadrature nodes per vector.

    Returns
    -------
    shape, chunks
        The batch shape, and the vectors of each chunk along one axis, with their moduli. Chunks are created lazily, so
        that the memory of one is released before the next.

    Raises
    ------
    InputError
        If a parameter is not finite, b, alpha or beta is not positive, or a radius or a depth is negative.
    """
    require_members("parameters", parameters, ("b", "m"), "TouchParameters, as touch_parameters(values) returns")
    if modulus is not None:
        shape = np.broadcast_shapes(*(np.shape(value) for value in parameters), modulus.shape[:-1])
        parameters = TouchParameters(*(np.broadcast_to(value, shape) for value in parameters))
        modulus = np.broadcast_to(modulus, (*shape, modulus.shape[-1])).reshape(-1, modulus.shape[-1])
    shape, flat = checked_rows(parameters)
    rows = max(1, CHUNK // nodes)
    if flat[0].size <= rows:
        return shape, iter([(flat, modulus)])
    parts = (slice(start, start + rows) for start in range(0, max(flat[0].size, 1), rows))
    return shape, (
        (TouchParameters(*(value[k] for value in flat)), None if modulus is None else modulus[k]) for k in parts
    )


def blocks(columns: Sequence[Index], nodes: int) -> list[Index]:
    """Cut conditions into blocks of which `LEAST_ROWS` vectors fit into a chunk, load by load.

    Parameters
    ----------
    columns
        The conditions under each load.
    nodes
        Number of quadrature nodes of a condition.
    """
    together = np.concatenate(columns)
    return np.array_split(together, -(-together.size * nodes * LEAST_ROWS // CHUNK))
