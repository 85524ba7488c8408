"""Lower bound on the run time: the forward model's arithmetic operations alone."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.bench.subject import BATCH, Effort, Subject, quickest
from softness_bayes.touch.field import StressField
from softness_bayes.touch.neuron.surface import FiringSurface
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.population import GAINS
from softness_bayes.touch.resolution import first
from softness_bayes.touch.scene import Scene
from softness_bayes.touch.several_fields import SeveralFields

Array = NDArray[np.float64]

TOGETHER = 16
"""Vectors whose bare operations are done in one call: enough for array speed, few enough for the fastest cache."""


class Operations(NamedTuple):
    """Operations at each point of a grid."""

    points: int
    """Number of points for each parameter vector."""
    exponentials: int
    """Logarithms included."""
    roots: int
    divisions: int
    orders: int
    """Multiplications and additions of polynomials, one each for every order."""


class Limit(NamedTuple):
    """Number and duration of the operations for one parameter vector."""

    exponentials: int
    roots: int
    divisions: int
    multiply_adds: int
    megabytes: float
    """Read and written if every operation is one pass over memory, as NumPy makes it."""
    seconds: float
    """Time of the scene for a vector."""
    bare_seconds: float
    """Time of these operations alone in NumPy, in place, `TOGETHER` vectors in a call; that of matrix products at the
    rate of a large one."""
    together_seconds: float
    """The same with all vectors of a batch in one call each, so that the calls themselves take almost no time."""
    flop_seconds: float
    """Time of the multiply-adds alone at the rate of a matrix product."""

    @property
    def over_bare(self) -> float:
        """Ratio of the scene's time to that of the bare operations."""
        return self.seconds / self.bare_seconds


def limit(of: Subject, effort: Effort) -> Limit:
    """Count and time the operations: exponentials, roots, divisions, polynomials and matrix products.

    Single multiplications and additions are not counted, nor are the selection of conditions, copies and calls.
    """
    scene, some = of.model.scene, first(of.draws.parameters, BATCH)
    grids, bases, products = _operations(scene, some)
    exponentials, roots, divisions, orders = (
        sum(one.points * one[kind] for one in grids) for kind in range(1, len(Operations._fields))
    )
    matrix = np.random.default_rng(1).uniform(size=(256, 256))
    product = quickest(lambda: matrix @ matrix, effort.repeats) / 256**3
    bare, together = (
        quickest(partial(_bare, *_blocks(grids, bases, size)), effort.repeats) / BATCH + product * products
        for size in (TOGETHER, BATCH)
    )
    adds = orders + bases + products
    return Limit(
        exponentials,
        roots,
        divisions,
        adds,
        8e-6 * (6 * orders + 3 * bases + 2 * (exponentials + roots + divisions)),
        quickest(partial(scene.total_rate, some), effort.repeats) / BATCH,
        bare,
        together,
        product * adds,
    )


def _operations(scene: Scene, some: TouchParameters) -> tuple[list[Operations], int, int]:
    """Return the operations on every grid, the number of values of polynomial bases, and of multiply-adds with them.

    Conditions beyond saturation share the rate's gain: it is evaluated once for each vector, and again for each
    condition whose peak is below saturation. Matrix products of bases and coefficients give the coefficients of the
    rate curves and of the stress fields and, if they come from polynomials, the contacts.
    """
    curve, contact = scene.rates.curves(some), scene.contact(some)
    one_finger = [field for field in scene.fields if isinstance(field, StressField)]
    fields = SeveralFields(one_finger, scene.columns, fast=True)
    peak = fields.at(contact.reduced_modulus, contact.radius).peak
    with np.errstate(invalid="ignore"):
        reach = some.beta[:, None] * (peak - some.sigma_0[:, None]) + np.log(some.alpha / curve.rheobase - 1.0)[:, None]
    fires, near = ((reach > 0.0) & (reach <= most) for most in (np.inf, scene.discretisation.saturation))
    firing, made = round(float(fires.sum(axis=-1).mean())), 1.0 + float(near.sum(axis=-1).mean())
    nodes, (of_skin, columns) = scene.discretisation.nodes, scene.mechanics.polynomials
    # Clenshaw's recurrence takes three operations for each order
    of_field = fields.order if fields.powers else 3 * fields.order // 2
    grids = [
        # the peak stress, or one step of the search for the skin's modulus (e^w, and softplus with exp and log)
        Operations(scene.n_conditions, 1 if of_skin else 3, 0, 0, 0),
        # the gain beyond saturation, and where; the root of the peak
        Operations(firing, 1, 2, 3, 0),
        # rho², with 1 / y, and the receptors within it
        Operations(firing * nodes, 0, 0, 1, of_field + scene.count.coefficients[0].size),
        # the rate's gain: expm1(-u), the sigmoid, s, ds / du and d nu / d s
        Operations(round(made * (GAINS * nodes + 1)), 1, 1, 2, curve.coefficients.shape[-1]),
        # stresses at the nodes
        Operations(round(made * nodes), 0, 1, 1, 0),
    ]
    of_curves = scene.rates.table if isinstance(scene.rates, FiringSurface) else np.empty((0, 0))
    terms, of_fields = np.mean([(series.shape[1], series.size) for series in fields.series], axis=0)
    bases = of_skin + len(of_curves) + round(firing * terms)
    return grids, bases, of_skin * columns + of_curves.size + round(firing * of_fields)


def _blocks(grids: list[Operations], bases: int, size: int) -> tuple[list[list[Array]], list[Operations], Array]:
    """Return the points of a batch in blocks of some vectors, and the values of the bases of a block."""
    rng = np.random.default_rng(0)
    blocks = [[rng.uniform(0.1, 0.9, size * one.points) for one in grids] for _ in range(BATCH // size)]
    return blocks, grids, rng.uniform(size=size * bases)


def _bare(blocks: list[list[Array]], grids: list[Operations], basis: Array) -> None:
    """Run the operations of a batch, one block after the other."""
    values = np.empty_like(basis)
    for block in blocks:
        np.multiply(basis, basis, out=values)
        for x, work in zip(block, grids, strict=True):
            y = np.empty_like(x)
            for _ in range(work.exponentials):
                np.exp(x, out=y)
            for _ in range(work.roots):
                np.sqrt(x, out=y)
            for _ in range(work.divisions):
                np.divide(1.0, x, out=y)
            for _ in range(work.orders):
                np.multiply(y, x, out=y)
                np.add(y, x, out=y)
