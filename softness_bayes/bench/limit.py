"""Lower bound on the run time: the forward model's necessary arithmetic operations alone."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.bench.subject import BATCH, Effort, Subject, quickest
from softness_bayes.touch.field import SeveralFields, StressField
from softness_bayes.touch.neuron.surface import FiringSurface
from softness_bayes.touch.population import GAINS
from softness_bayes.touch.resolution import first

Array = NDArray[np.float64]

EXPONENTIALS, ROOTS, DIVISIONS = 1, 1, 3
"""For each node of the rate's gain: expm1(-t²); s; the sigmoid, s / t and the speed."""

TOGETHER = 16
"""Vectors whose bare operations are done in one call: enough for array speed, few enough for the cache."""

SKIN_EXPONENTIALS = 3
"""For each condition, in one step of the search for the skin's modulus: e^w, and softplus with exp and log."""

OF_SERIES = 2
"""Exponentials for each condition where polynomials of the skin's parameters give E_star and the peak stress."""


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
    """Time of these operations alone in NumPy, in place, in blocks that fit the cache; that of matrix products at the
    rate of a large one."""
    flop_seconds: float
    """Time of the multiply-adds alone at the rate of a matrix product."""

    @property
    def over_bare(self) -> float:
        """Ratio of the scene's time to that of the bare operations."""
        return self.seconds / self.bare_seconds


def limit(of: Subject, effort: Effort) -> Limit:
    """Count and time the operations.

    At each node of a condition that fires, the polynomials are those of the stress field's inverse (two passes of
    Horner's rule each order, or three of a Clenshaw recurrence) and of the receptor count, and there is one division,
    1/y. The rate's gain has a polynomial too, and nodes of its own. Conditions beyond saturation share these: it is
    evaluated once for each vector, and again for each condition whose peak is below saturation. Matrix products give
    the coefficients of the rate curves and stress fields and, if they come from polynomials, the contacts.
    """
    scene = of.model.scene
    some = first(of.draws.parameters, BATCH)
    contact, curve = scene.contact(some), scene.rates.curves(some)
    one_finger = [field for field in scene.fields if isinstance(field, StressField)]
    fields = SeveralFields(one_finger, scene.columns, powers=True)
    profile = fields.at(contact.reduced_modulus, contact.radius).whole()
    orders, rates, count = len(profile.shape), curve.coefficients.shape[-1], scene.count.coefficients[0].size
    nodes, conditions = scene.discretisation.nodes, scene.n_conditions
    odds = some.alpha / curve.rheobase - 1.0
    with np.errstate(invalid="ignore"):
        reach = some.beta[:, None] * (profile.peak - some.sigma_0[:, None]) + np.log(odds)[:, None]
    fires, near = ((reach > 0.0) & (reach <= most) for most in (np.inf, scene.discretisation.saturation))
    firing, made = round(float(fires.sum(axis=-1).mean())), 1.0 + float(near.sum(axis=-1).mean())
    lanes, gains = firing * nodes, round(made * (GAINS * nodes + 1))
    of_field = (2 if profile.powers else 3) * orders
    at_lanes, at_gains = of_field + 2 * count, 2 * rates
    series = scene.mechanics.products
    of_curves = scene.rates.table.size if isinstance(scene.rates, FiringSurface) else 0
    products = series + of_curves + round(firing * float(np.mean([part.size for part in fields.series])))
    adds = lanes * (2 * orders + count) + gains * rates + products
    at_conditions = OF_SERIES if series else SKIN_EXPONENTIALS
    exponentials = gains * EXPONENTIALS + firing + conditions * at_conditions
    roots, divisions = gains * ROOTS + round(made * nodes) + 2 * firing, gains * DIVISIONS + lanes
    traffic = 8.0 * (3 * (at_lanes * lanes + at_gains * gains) + 2 * (exponentials + roots + divisions))
    rng = np.random.default_rng(0)
    points = [rng.uniform(0.1, 0.9, (BATCH // TOGETHER, TOGETHER * n)) for n in (lanes, gains, conditions)]
    matrix = rng.uniform(size=(256, 256))
    product = quickest(lambda: matrix @ matrix, effort.repeats) / 256**3
    bare = quickest(partial(_bare, points, at_lanes, at_gains, at_conditions), effort.repeats) / BATCH
    return Limit(
        exponentials,
        roots,
        divisions,
        adds,
        traffic / 1e6,
        quickest(partial(scene.total_rate, some), effort.repeats) / BATCH,
        bare + product * products,
        product * adds,
    )


def _bare(points: list[Array], passes_at_lanes: int, passes_at_gains: int, passes_at_conditions: int) -> None:
    """Run the operations of a batch in blocks that fit in the cache."""
    for x, gain, skin in zip(*points, strict=True):
        y, speed, root = np.empty_like(x), np.empty_like(gain), np.empty_like(skin)
        for _ in range(passes_at_conditions):
            np.exp(skin, out=root)
        for _ in range(EXPONENTIALS):
            np.expm1(gain, out=speed)
        for _ in range(ROOTS):
            np.sqrt(gain, out=speed)
        for _ in range(DIVISIONS):
            np.divide(gain, speed, out=speed)
        _polynomials(gain, speed, passes_at_gains)
        np.divide(1.0, x, out=y)
        _polynomials(x, y, passes_at_lanes)


def _polynomials(x: Array, y: Array, passes: int) -> None:
    for _ in range(passes // 2):
        np.multiply(y, x, out=y)
        np.add(y, x, out=y)
