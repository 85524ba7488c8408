"""The machine's limit: time of the forward model's necessary operations alone."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.bench.subject import BATCH, Effort, Subject, quickest
from softness_bayes.model.resolution import first

Array = NDArray[np.float64]

EXPONENTIALS, ROOTS, DIVISIONS = 1, 2, 3
"""For each node: expm1(-t²); s and y; the sigmoid, 1/s and (1 - y)/y."""

TOGETHER = 16
"""Vectors whose bare operations are done in one call: enough for array speed, few enough for the cache."""

SKIN_STEPS, SKIN_EXPONENTIALS = 3, 3
"""Operations of the search for the skin's modulus, for each condition: e^w, and softplus with exp and log."""


class Limit(NamedTuple):
    """Operations of one parameter vector, and their times."""

    exponentials: int
    roots: int
    divisions: int
    multiply_adds: int
    megabytes: float
    """Read and written if every operation is one pass over memory, as NumPy makes it."""
    seconds: float
    """Time of the scene for a vector."""
    bare_seconds: float
    """Time of these operations alone in NumPy, in place, in blocks that fit the cache."""
    flop_seconds: float
    """Time of the multiply-adds alone at the rate of a matrix product."""

    @property
    def over_bare(self) -> float:
        """The scene's time over that of the bare operations."""
        return self.seconds / self.bare_seconds


def limit(of: Subject, effort: Effort) -> Limit:
    """Count and time the operations.

    The polynomials of a node are those of the stress field's inverse (three passes of a Clenshaw recurrence each
    order), of the rate's slope and of the receptor count (two of Horner's).
    """
    scene = of.model.scene
    some = first(of.draws.parameters, BATCH)
    contact = scene.contact(some)
    orders = len(scene.stress_profile(contact).shape)
    rates = scene.firing.curves(some).coefficients.shape[-1]
    count = scene.count.coefficients[0].size
    nodes = scene.discretisation.nodes + 2
    conditions = scene.n_conditions
    lanes = round(float((scene.total_rate(some) > 0).sum(axis=-1).mean()) * nodes)
    passes = 3 * orders + 2 * (rates + count)
    adds = lanes * (2 * orders + rates + count)
    exponentials = lanes * EXPONENTIALS + conditions * SKIN_STEPS * SKIN_EXPONENTIALS
    roots, divisions = lanes * ROOTS, lanes * DIVISIONS
    traffic = 8.0 * (3 * passes * lanes + 2 * (exponentials + roots + divisions))
    rng = np.random.default_rng(0)
    at_nodes, at_conditions = (rng.uniform(0.1, 0.9, (BATCH // TOGETHER, TOGETHER * n)) for n in (lanes, conditions))
    work = partial(_bare, at_nodes, at_conditions, passes)
    matrix = np.random.default_rng(1).uniform(size=(256, 256))
    product = quickest(lambda: matrix @ matrix, effort.repeats)
    return Limit(
        exponentials,
        roots,
        divisions,
        adds,
        traffic / 1e6,
        quickest(partial(scene.total_rate, some), effort.repeats) / BATCH,
        quickest(work, effort.repeats) / BATCH,
        product / 256**3 * adds,
    )


def _bare(at_nodes: Array, at_conditions: Array, passes: int) -> None:
    """Do the operations of a batch, block by block, each of which fits the cache."""
    y, skin = np.empty_like(at_nodes[0]), np.empty_like(at_conditions[0])
    for x, e in zip(at_nodes, at_conditions, strict=True):
        for _ in range(SKIN_STEPS * SKIN_EXPONENTIALS):
            np.exp(e, out=skin)
        for _ in range(EXPONENTIALS):
            np.expm1(x, out=y)
        for _ in range(ROOTS):
            np.sqrt(x, out=y)
        for _ in range(DIVISIONS):
            np.divide(x, y, out=y)
        for _ in range(passes // 2):
            np.multiply(y, x, out=y)
            np.add(y, x, out=y)
