"""Responses to many loads, each fabric's interpolated from few (model.md 8).

For one fabric, the place of the contact in the table of stress fields and the logarithm of the stress on the axis are
smooth functions of the logarithm of the load: polynomials through a few loads, which all fabrics share. Receptors fire
from the load on at which the stress on the axis reaches their threshold. With ln load = (its value there) + s² the
response is s² times a smooth function of s, again a polynomial, through exact responses at places of its own for each
fabric and parameter vector.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from softness_bayes.touch.contact import Finger, Fingertip, Indentation, Load, held
from softness_bayes.touch.neuron.polynomials import horner
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.population import Drive, Population
from softness_bayes.touch.readings import Readings
from softness_bayes.touch.stress_fields import FieldsAt, Mechanics, SkinBox, StressFields
from softness_bayes.touch.stress_table import StressTable

Array = NDArray[np.float64]
Index = NDArray[np.intp]

LOWEST_ONSET = -4.0
"""Least place of an onset below the loads, which are scaled to [-1, 1]; with a lower one, their responses are alike."""

MOST_PLACES = 22
"""Number of places beyond which powers of the place would lose the digits that they are to gain."""

LEAST_SLOPE = 1e-3
"""Least slope of the logarithm of the stress on the axis in the search for the onset."""

NEWTON_STEPS = 4
"""Steps from a straight line, which the stress nearly is, to the onset."""


def places(loads: Sequence[Load], density: float | None) -> int:
    """Return the number of places for responses to loads of one kind; 0 if every touch is to be evaluated.

    For the same error, it grows with the logarithm of the range of the forces, which are in proportion to the
    indentations to the power 1.5.
    """
    power = 1.5 if isinstance(loads[0], Indentation) else 1.0
    nodes = math.ceil((density or 0.0) * (1.5 + power * math.log(held(max(loads)) / held(min(loads)))))
    return nodes if nodes <= MOST_PLACES else 0


class LoadCurves:
    """The responses of some fabrics to many loads of one kind.

    Parameters
    ----------
    table
        The table of stress fields of all these loads.
    loads
        Loads of one kind, between the least and the greatest of which responses are interpolated.
    modulus, poisson
        E_fab [Pa] and nu_fab of all fabrics.
    conditions, fabric, load
        Column of each condition among all responses and index of its fabric, shape (conditions,), and its load.
    finger, readings, box
        The usual finger, the readings, and the skins that polynomials cover, as `Mechanics` takes them.
    population
        The receptors.
    nodes
        Number of exact responses for each fabric. Contacts need half as many.
    """

    def __init__(
        self,
        table: StressTable,
        loads: Sequence[Load],
        modulus: Array,
        poisson: Array,
        conditions: Index,
        fabric: Index,
        load: Sequence[Load],
        finger: Finger,
        readings: Readings,
        box: SkinBox | None,
        population: Population,
        nodes: int,
    ) -> None:
        self.conditions = conditions
        """Their columns among all responses."""
        self._fabrics, fabric = np.unique(fabric, return_inverse=True)
        modulus, poisson = modulus[self._fabrics], poisson[self._fabrics]
        ends = np.log([held(min(loads)), held(max(loads))])
        contacts, self._responses = chebyshev.chebpts1(nodes // 2 + 1), chebyshev.chebpts1(nodes)
        few = [type(loads[0])(float(np.exp(ends.mean() + 0.5 * (ends[1] - ends[0]) * x))) for x in contacts]
        self._population, self._contacts = population, contacts.size
        # from the right, they turn values at these places into coefficients of powers
        both = (np.vander(x, increasing=True) for x in (contacts, self._responses))
        self._of_contacts, self._of_responses = (np.linalg.inv(powers).T for powers in both)
        place = (2.0 * np.log([held(one) for one in load]) - ends.sum()) / (ends[1] - ends[0])
        self._places = [(conditions[fabric == k], place[fabric == k]) for k in range(modulus.size)]
        # the contacts of all fabrics are solved under the few loads; their responses are computed anywhere
        tables, loaded = dict.fromkeys(few, table), few * modulus.size
        of_fabrics, of_poisson = (np.repeat(one, contacts.size) for one in (modulus, poisson))
        fields, displacement = StressFields(tables, loaded, finger), readings.skin_displacement
        self._mechanics = Mechanics(of_fabrics, of_poisson, loaded, finger, displacement, fields, box, table.tolerance)
        self.touches = modulus.size * nodes
        """Number of touches of each parameter vector that are evaluated."""
        self._fields = StressFields(tables, few[:1] * self.touches, finger)

    def rates(
        self, p: TouchParameters, modulus: Array | None, finger: Fingertip, drive: Drive, found: Array
    ) -> NDArray[np.bool_]:
        """Put the total rates [spikes/s] into their columns, and return which vectors they hold for, shape (batch,).

        They hold if the stress on the axis rises with the load.

        Parameters
        ----------
        p
            Parameter vectors, shape (batch,).
        modulus
            E_fab [Pa] that replaces the moduli of all fabrics, shape (batch, fabrics), or None.
        finger
            The usual finger, or one for each vector.
        drive
            Transduction and firing of these vectors.
        found
            Responses of these vectors in all conditions, shape (batch, columns).
        """
        own = None if modulus is None else modulus[:, self._fabrics].repeat(self._contacts, axis=1)
        known = self._mechanics.fields(p.b, p.m, own, finger)
        log_peak = np.log(np.maximum(known.peak, 1e-300))
        values = np.stack([known.along, np.broadcast_to(known.across, log_peak.shape), log_peak])
        values = values.reshape(3, p.b.size, -1, self._contacts)
        series = np.moveaxis(values @ self._of_contacts, -1, 0)
        start = _onset(series[:, 2], drive.onset[:, None])
        low, high = np.sqrt(np.maximum(-1.0 - start, 0.0)), np.sqrt(1.0 - start)
        s = low[..., None] + (0.5 * (high - low))[..., None] * (1.0 + self._responses)
        at = horner(series[..., None], np.broadcast_to(start[..., None] + s * s, (3, *s.shape)))
        along, across, peak = at.reshape(3, p.b.size, -1)
        rate = self._population.sums(FieldsAt(self._fields, along, across, np.exp(peak), known.depth), drive).rate
        smooth = np.divide(rate.reshape(s.shape), s * s, out=np.zeros_like(s), where=s > 0)
        smooth = np.moveaxis(smooth @ self._of_responses, -1, 0)
        scale = 2.0 / np.maximum(high - low, 1e-300)
        first = -1.0 - low * scale
        for k, (conditions, place) in enumerate(self._places):
            squared = np.maximum(place - start[:, k, None], 0.0)
            x = np.sqrt(squared) * scale[:, k, None] + first[:, k, None]
            found[:, conditions] = np.maximum(horner(smooth[:, :, k, None], x) * squared, 0.0)
        return (np.diff(values[2], axis=-1) > 0).all(axis=(1, 2))


def _onset(log_peak: Array, stress: Array) -> Array:
    """Return where the stress on the axis reaches a threshold; at most 1, beyond which there is no load.

    Below -1, it is where the straight line through the lower end reaches it.

    Parameters
    ----------
    log_peak
        Coefficients of the logarithm of the stress in powers of the place, shape (powers, batch, fabrics).
    stress
        Thresholds [Pa], shape (batch, 1).
    """
    slopes, ends = log_peak[1:] * np.arange(1.0, len(log_peak))[:, None, None], np.ones(log_peak.shape[1:])
    first, last = horner(log_peak, -ends), horner(log_peak, ends)
    with np.errstate(divide="ignore"):
        wanted = np.log(np.maximum(stress, 0.0))
    within = np.clip(wanted, first, last)
    x = 2.0 * (within - first) / np.maximum(last - first, LEAST_SLOPE) - 1.0
    for _ in range(NEWTON_STEPS):
        x = np.clip(x - (horner(log_peak, x) - within) / np.maximum(horner(slopes, x), LEAST_SLOPE), -1.0, 1.0)
    below = -1.0 + (wanted - first) / np.maximum(horner(slopes, -ends), LEAST_SLOPE)
    return np.where(wanted < first, np.maximum(below, LOWEST_ONSET), x)
