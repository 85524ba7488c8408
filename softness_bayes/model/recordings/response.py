"""Firing of single afferents under rigid probes: contact, stress at the receptive field, current and rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit, logit

from softness_bayes.touch.contact import Contact, Finger, Fingertips, Load, Loads, fingertips, solve_contact
from softness_bayes.touch.neuron.fixed_channels import FixedChannels
from softness_bayes.touch.neuron.membrane import PAPER_CHANNELS
from softness_bayes.touch.neuron.rate_curve import LARGEST_CURRENT, RateCurve
from softness_bayes.touch.probes import RIGID, Probe
from softness_bayes.touch.readings import Readings
from softness_bayes.touch.stress import stress

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

Array = NDArray[np.float64]

KNOTS = np.linspace(np.log(1e1), np.log(1e9), 400)
"""ln E_star [Pa] at which the stress of each row is tabulated. Cubics between them err by less than 1e-6 of the peak;
beyond them, far from all priors of the skin, the stress is held."""

RATE_TERMS = 16
"""Terms of the rate curve, which then errs by less than 0.02 Hz."""

BLUR_NODES = 5
"""Gauss-Hermite nodes of a receptive field along each axis."""


class Afferent(NamedTuple):
    """Parameters of recorded afferents: numbers, or arrays of a common batch shape (...)."""

    b: Any
    """Skin modulus at rest [Pa]."""
    m: Any
    """Stiffening exponent of the skin ([-] or [1/m])."""
    alpha: Any
    """Largest receptor current [µA/cm²]."""
    beta: Any
    """Steepness of the transduction [1/Pa]."""
    rest: Any = None
    """Current at rest over the rheobase [-]; None if `sigma_0` is given."""
    sigma_0: Any = None
    """Stress at half the largest current [Pa]."""
    spread: Any = 0.0
    """Standard deviation of the receptive field along each axis [m]; 0 for a point."""
    radius: Any = 0.0
    """Fingertip radius [m]; 0 for that of the finger."""
    depth: Any = 0.0
    """Depth of the receptors [m]; 0 for that of the finger."""


@dataclass(frozen=True, eq=False)
class ProbedTouches:
    """Rigid probes pressed on one finger, each with an afferent at some distance from the contact's axis.

    Parameters
    ----------
    loads
        Load of each row.
    curvature, distance
        Probe curvature [1/m], and distance of the receptive field from the axis [m], both (rows,).
    finger, readings
        The finger, and the readings of the model. Channels have the paper's multipliers.
    """

    loads: Sequence[Load]
    curvature: Array
    distance: Array
    finger: Finger = Finger()
    readings: Readings = Readings()

    def take(self, rows: NDArray[np.intp]) -> ProbedTouches:
        """Return the touches of some rows."""
        loads = [self.loads[k] for k in rows]
        return replace(self, loads=loads, curvature=self.curvature[rows], distance=self.distance[rows])

    @cached_property
    def firing(self) -> FixedChannels:
        """The source of rate curves."""
        whole = FixedChannels(PAPER_CHANNELS, self.readings.membrane, LARGEST_CURRENT, nodes=28)
        return whole.shortened(RATE_TERMS)

    @cached_property
    def _presses(self) -> tuple[Loads, Probe, NDArray[np.intp]]:
        """Loads and probes of distinct contacts, and the contact of each row."""
        pairs = [*zip(self.loads, self.curvature.tolist(), strict=True)]
        distinct = list(dict.fromkeys(pairs))
        loads, curvature = zip(*distinct, strict=True)
        return Loads(loads), Probe(curvature), np.array([distinct.index(pair) for pair in pairs])

    def contacts(self, at: Afferent) -> tuple[Contact, Fingertips]:
        """Return the contact of each row, fields of shape (..., rows), and fingers with their relative radii R*."""
        loads, probes, of_row = self._presses
        tips = probes.under(fingertips(self.finger, at.radius, at.depth))
        b, m = (np.asarray(value, float)[..., None] for value in (at.b, at.m))
        found = solve_contact(RIGID, 0.0, loads, b, m, tips, self.readings.skin_displacement)
        return Contact(*(value[..., of_row] for value in found)), tips._replace(radius=tips.radius[..., of_row])

    def stress(self, at: Afferent) -> Array:
        """Return the stress at the receptive field [Pa], shape (..., rows).

        For a point at the finger's own radius and depth it is read from a table; otherwise it is integrated.
        """
        found, tips = self.contacts(at)
        if not any(np.any(value) for value in (at.spread, at.radius, at.depth)):
            return self._read(np.log(found.reduced_modulus))
        spread = np.asarray(at.spread, float)[..., None] * np.ones_like(found.radius)
        node, weight = np.polynomial.hermite_e.hermegauss(BLUR_NODES if np.any(spread) else 1)
        half = node >= 0.0  # across the line from the axis; the other half mirrors it
        share = np.outer((weight * (1 + (node > 0.0)))[half], weight).ravel() / weight.sum() ** 2
        along, across = (np.multiply.outer(place.ravel(), spread) for place in np.meshgrid(node, node[half]))
        places = zip(share, np.hypot(self.distance + along, across), strict=True)
        return np.asarray(sum(part * self._integrated(rho, found, tips) for part, rho in places))

    def _integrated(self, rho: ArrayLike, contact: Contact, tips: Fingertips) -> Array:
        readings = self.readings.pressure, self.readings.stress_kernel, self.readings.stress_component
        return stress(rho, contact.reduced_modulus, contact.radius, tips, *readings)

    @cached_property
    def _splines(self) -> list[tuple[NDArray[np.intp], CubicSpline]]:
        """Rows of each contact, and their stress [Pa] through the moduli of `KNOTS`."""
        from scipy.interpolate import CubicSpline  # imported here because it takes a third of a second

        modulus, tips = np.exp(KNOTS)[:, None], Probe(self.curvature).under(self.finger)
        felt = self._integrated(self.distance, Loads(self.loads).contact(modulus, modulus, tips), tips)
        each = (np.flatnonzero(self._presses[2] == k) for k in np.unique(self._presses[2]))
        return [(rows, CubicSpline(KNOTS, felt[:, rows])) for rows in each]

    def _read(self, log_modulus: Array) -> Array:
        """Return the stress at the moduli of each row, held beyond the knots, shape (..., rows)."""
        place, found = np.clip(log_modulus, *KNOTS[[0, -1]]), np.empty(log_modulus.shape)
        for rows, spline in self._splines:
            found[..., rows] = spline(place[..., rows[0]])
        return found

    def curve(self, alpha: ArrayLike) -> RateCurve:
        """Return the rate curve up to currents alpha."""
        return self.firing.curves(PAPER_CHANNELS, alpha)

    def at_rest(self, at: Afferent) -> tuple[Array, Array]:
        """Return the current at rest over the rheobase, and sigma_0 [Pa], from whichever is given; shapes (...).

        sigma_0 is negative where the current at rest is more than half of alpha.
        """
        curve = self.curve(at.alpha)
        start = self._start(at, curve)
        return at.alpha * expit(start) / curve.rheobase, -start / np.asarray(at.beta, float)

    def _start(self, at: Afferent, curve: RateCurve) -> Array:
        """Return the log odds of the current without stress, as a share of alpha."""
        if at.sigma_0 is not None:
            return np.asarray(-np.asarray(at.beta, float) * at.sigma_0)
        return np.asarray(logit(np.minimum(at.rest * curve.rheobase / at.alpha, 1.0 - 1e-12)))

    def rate(self, at: Afferent) -> Array:
        """Return the firing rate [Hz] of each row, shape (..., rows); 0 below the rheobase.

        The current is alpha / (1 + exp(beta (sigma_0 - sigma))). With `rest` it is given by its value without stress,
        rest times the rheobase; where alpha is below that, no stress makes the membrane fire.
        """
        curve = self.curve(at.alpha)
        alpha, beta, start = (np.asarray(v, float)[..., None] for v in (at.alpha, at.beta, self._start(at, curve)))
        return curve.rate(alpha * expit(beta * self.stress(at) + start))
