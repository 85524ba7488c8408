"""Responses of many fabrics under one load, as values of one function (model.md 2-5).

Fabric and skin interact only through ln k, k = (1 - nu_fab²) / ((1 - nu_skin²) E_fab): the modulus of the skin depends
on no other property of the fabric, and 1/E_star = (1 - nu_skin²) (1/E_skin + k). For a parameter vector and a load, the
total rate is therefore a function of ln k alone. Above the onset of firing it is smooth. At the onset it rises from 0
like the 3/2 power of the distance (the responding area grows linearly, the rate of a receptor like a square root), or
linearly if the rate starts with a jump. When the responding patch reaches an edge of the pad, the second derivative
jumps.

None of these points needs to be located. The range is divided into panels, each with a Chebyshev series. A panel is
halved if its series has not converged, or if only some of its nodes respond. A panel with no more fabrics than nodes is
evaluated at its fabrics, which limits the cost of a kink. The number of evaluations grows with the logarithm of the
number of fabrics.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from softness_bayes.touch.contact import Fingertip, Fingertips
from softness_bayes.touch.field import StressField
from softness_bayes.touch.finger_field import FingerField, profiles
from softness_bayes.touch.neuron.firing import RateCurve
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.population import Drive, Population
from softness_bayes.touch.skin import SkinDisplacement, skin_modulus

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

MANY = 250
"""Number of fabrics under one load above which interpolation is at least twice as fast as direct evaluation."""

NODES = 11
"""Chebyshev nodes of a panel, including its ends."""

WIDTH = 2.5
"""Largest width of a panel in ln k; the poles of E_star lie about pi from the real axis."""

FAINT = 0.01
"""Rate per receptor [Hz] added to a panel's largest rate to form the scale of its error: a tenth of the typical eps of
the rating model."""

_X = np.polynomial.chebyshev.chebpts2(NODES)
_TO_SERIES = np.linalg.inv(chebyshev.chebvander(_X, NODES - 1)).T


class _Panels(NamedTuple):
    """Panels of single vectors; fields of shape (n,)."""

    vector: Indices
    low: Array
    high: Array

    def take(self, which: NDArray[np.bool_]) -> _Panels:
        return _Panels(self.vector[which], self.low[which], self.high[which])

    def halves(self) -> _Panels:
        middle = 0.5 * (self.low + self.high)
        return _Panels(np.tile(self.vector, 2), np.append(self.low, middle), np.append(middle, self.high))


def interpolated(
    evaluate: Callable[[Indices, Array], Array], batch: int, at: Array, tolerance: float, floor: float
) -> Array:
    """Return the values at many points of a batch of piecewise smooth functions that may vanish on some pieces.

    Parameters
    ----------
    evaluate
        Function of vectors (n,) and points (n, k) that returns each vector's function at its points, shape (n, k).
    batch
        Number of functions.
    at
        Points, strictly increasing, shape (points,).
    tolerance
        Error allowed on a panel, relative to its largest value plus `floor`.
    floor
        Value below which differences do not matter.

    Returns
    -------
    ndarray
        Shape (batch, points).
    """
    found = np.zeros((batch, at.size))
    edges = np.linspace(at[0], at[-1], max(int(np.ceil((at[-1] - at[0]) / WIDTH)), 1) + 1)
    low, high = (np.tile(part, batch) for part in (edges[:-1], edges[1:]))
    panels = _Panels(np.repeat(np.arange(batch), edges.size - 1), low, high)
    while panels.vector.size:
        first = np.searchsorted(at, panels.low, side="left")
        # the last panel includes its right end
        last = np.searchsorted(at, np.where(panels.high >= at[-1], np.inf, panels.high), side="left")
        occupied = last > first
        panels, first, last = panels.take(occupied), first[occupied], last[occupied]
        few = last - first <= NODES
        nodes = panels.low[:, None] + 0.5 * (panels.high - panels.low)[:, None] * (_X + 1.0)
        own = np.minimum(first[:, None] + np.arange(NODES), last[:, None] - 1)
        values = evaluate(panels.vector, np.where(few[:, None], at[own], nodes))
        found[panels.vector[few, None], own[few]] = values[few]
        series = values @ _TO_SERIES
        scale = np.abs(values).max(axis=1, initial=0.0) + floor
        silent = values == 0
        good = np.abs(series[:, -3:]).sum(axis=1) <= tolerance * scale
        good &= (silent.all(axis=1) | ~silent.any(axis=1)) & ~few
        some = good & ~silent.all(axis=1)
        _fill(found, panels.take(some), first[some], last[some], series[some], at)
        panels = panels.take(~few & ~good).halves()
    return found


def _fill(found: Array, panels: _Panels, first: Indices, last: Indices, series: Array, at: Array) -> None:
    """Evaluate the series of panels into `found`; vectors with a common panel share its polynomials."""
    order = np.argsort(first, kind="stable")
    changes = np.flatnonzero(np.diff(first[order])) + 1
    for rows in np.split(order, changes) if order.size else []:
        start, stop, low, high = (part[rows[0]] for part in (first, last, panels.low, panels.high))
        basis = chebyshev.chebvander((2.0 * at[start:stop] - (low + high)) / (high - low), NODES - 1)
        found[panels.vector[rows], start:stop] = np.maximum(series[rows] @ basis.T, 0.0)


class Family:
    """The fabrics under one load.

    Parameters
    ----------
    field
        The load's stress field.
    log_k
        ln k of each fabric, shape (fabrics,); repeated values are evaluated once.
    displacement
        The reading of the skin's compression.
    """

    def __init__(self, field: StressField | FingerField, log_k: Array, displacement: SkinDisplacement) -> None:
        self.field, self.displacement = field, displacement
        self.at, self._of = np.unique(log_k, return_inverse=True)

    def total_rate(
        self, parameters: TouchParameters, curve: RateCurve, population: Population, finger: Fingertip, chunk: int
    ) -> Array:
        """Return the total rates [spikes/s], shape (batch, fabrics).

        Parameters
        ----------
        parameters
            Arrays of shape (batch,).
        curve
            Their rate curves, of batch shape (batch,) or ().
        population
            The pad.
        finger
            The finger that touches; `Fingertips` have the shape (batch, 1).
        chunk
            Number of simultaneous evaluations.
        """
        rows, load = max(chunk // NODES, 1), self.field.load

        def evaluate(vector: Indices, log_k: Array) -> Array:
            blocks = np.split(np.arange(vector.size), np.arange(rows, vector.size, rows))
            return np.concatenate([part(vector[block], log_k[block]) for block in blocks])

        def part(vector: Indices, log_k: Array) -> Array:
            p = TouchParameters(*(value[vector] for value in parameters))
            own_finger = finger.take(vector) if isinstance(finger, Fingertips) else finger
            compression = load.compression(own_finger, self.displacement)
            skin = skin_modulus(*compression, log_k, p.b[:, None], p.m[:, None])
            reduced = 1.0 / ((1.0 - finger.poisson_ratio**2) * (1.0 / skin + np.exp(log_k)))
            columns = [np.arange(log_k.shape[1])]
            profile = profiles([self.field], columns, reduced, load.close(reduced, own_finger).radius, own_finger)
            own = curve.take(vector) if curve.rheobase.ndim else curve
            return population.sums(profile, Drive(p.alpha, p.beta, p.sigma_0, own)).rate

        batch, floor = np.size(parameters.b), FAINT * population.count.total
        return interpolated(evaluate, batch, self.at, self.field.tolerance, floor)[:, self._of]
