"""The population's response as a one-dimensional integral for each condition (model.md 6-8).

Let M(sigma) be the number of receptors whose stress exceeds sigma, and nu(I) the firing rate. The
total rate is the integral of nu over the receptors; by parts it is

    N = integral of M(sigma(I)) dnu(I)   from the rheobase to the largest current,

(plus nu just above the rheobase times M there, where the rate starts with a jump). With
u = beta (sigma - sigma_0) and u = u_rheobase + t² the integrand is smooth in t on all of [0, T]:
the square root in which the rate starts is gone, and M has no singularity at the peak of the
stress. So a few Gauss nodes suffice for each condition. M is evaluated through the tabulated
field; only where the responding patch crosses an edge or corner of the pad is the range cut.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.touch.field import Profile
from softness_bayes.touch.firing import RateCurve
from softness_bayes.touch.receptors import ReceptorCount, horner

Array = NDArray[np.float64]


class Drive(NamedTuple):
    """Transduction and firing of a batch of parameter vectors; arrays of shape (batch, 1)."""

    alpha: Array
    """Largest current [µA/cm²]."""
    beta: Array
    """Steepness [1/Pa]."""
    sigma_0: Array
    """Stress of half response [Pa]."""
    curve: RateCurve
    """The rate curve, of batch shape (batch,), or () where all share one."""


class Sums(NamedTuple):
    """Sums over the receptors of one condition, each of shape (batch, conditions)."""

    rate: Array
    """Total rate [spikes/s]."""
    responding: Array
    """Number of receptors that fire."""
    interval: Array
    """Sum of the inter-spike intervals of those [s]; 0 where none fires or not asked for."""


class Population:
    """The receptors of the pad.

    Parameters
    ----------
    root
        The power of sigma / sigma_peak that gives y (see `StressField`).
    count
        Receptors within a distance.
    nodes
        Gauss nodes in t for each condition.
    saturation
        The largest u - u_rheobase to integrate to. Beyond it the sigmoid has saturated to
        exp(-saturation) and what rate remains is given to all receptors in one term.
    """

    def __init__(self, root: float, count: ReceptorCount, nodes: int, saturation: float) -> None:
        self.root, self.count, self.saturation = root, count, saturation
        x, weight = np.polynomial.legendre.leggauss(nodes)
        self.part, self.weight = 0.5 * (x + 1.0), 0.5 * weight

    def sums(self, profile: Profile, drive: Drive, intervals: bool = False) -> Sums:
        """Integrate over the receptors for a batch of parameter vectors and all conditions.

        Parameters
        ----------
        profile
            The stress fields, shape (batch, conditions).
        drive
            Transduction and firing.
        intervals
            Whether the sum of inter-spike intervals is wanted, which costs half as much again.
        """
        onset = _Onset.of(drive, profile.peak)
        reach = np.maximum(drive.beta * (profile.peak - onset.stress), 0.0)
        reach = np.where(onset.fires, reach, 0.0)
        top = np.sqrt(np.minimum(reach, self.saturation))
        silent = top == 0
        y_onset = self._y(profile, onset.stress)
        extent = profile.squared_distance(y_onset[..., None])[..., 0]
        crossing = (extent > self.count.kinks[0] ** 2) & ~silent
        responding = np.where(silent, 0.0, self.count(np.minimum(extent, self.count.kinks[0] ** 2)))
        bottom = np.zeros_like(top)
        if crossing.any():
            beyond = self._beyond(profile, drive, onset, top, crossing, intervals)
            bottom[crossing], responding[crossing] = beyond.bottom, beyond.sums.responding
        t = bottom[..., None] + (top - bottom)[..., None] * self.part
        weight = (top - bottom)[..., None] * self.weight
        within = self._count(profile, drive, onset, t)
        gain = weight * onset.gain(t)
        at_top, at_peak = onset.rate(top), onset.rate(np.sqrt(reach))
        rest = np.where(
            reach > self.saturation, self._count(profile, drive, onset, top[..., None])[..., 0], 0.0
        )
        rate = np.einsum("...i,...i", gain, within)
        rate += onset.rate_0 * responding + rest * (at_peak - at_top)
        interval = np.zeros_like(rate)
        if intervals:
            with np.errstate(divide="ignore", invalid="ignore"):
                missing = responding[..., None] - within
                interval = np.einsum("...i,...i", gain, missing / onset.rate(t) ** 2)
                interval += (responding - rest) / at_top + rest / at_peak
        if crossing.any():
            rate[crossing] += beyond.sums.rate
            interval[crossing] += beyond.sums.interval
        return Sums(*(np.where(silent, 0.0, value) for value in (rate, responding, interval)))

    def _y(self, profile: Profile, stress: Array) -> Array:
        relative = np.maximum(stress, 0.0) / profile.peak
        power = np.sqrt(relative) if self.root == 0.5 else relative**self.root
        return np.clip(power, profile.y_least, 1.0)

    def _count(self, profile: Profile, drive: Drive, onset: _Onset, t: Array) -> Array:
        """Receptors above the stress at t, on the pad's inner interval."""
        stress = onset.stress[..., None] + t * t / drive.beta[..., None]
        return self.count(profile.squared_distance(self._y(_over_nodes(profile), stress)))

    def _beyond(
        self, profile: Profile, drive: Drive, onset: _Onset, top: Array, crossing: Array, intervals: bool
    ) -> _Beyond:
        """Integrate over t where the patch reaches past the pad's first kink, one interval after another."""
        rows = np.nonzero(crossing)
        picked = profile.take(rows)
        onset = onset.take(rows, crossing.shape)
        beta = np.broadcast_to(drive.beta, crossing.shape)[rows]
        t_kinks = [self._t_at(picked, onset, beta, distance) for distance in self.count.kinks]
        responding = np.full(rows[0].size, self.count.total)
        for k, t_outer in list(enumerate(t_kinks))[:0:-1]:
            inside = t_outer <= 0
            y = self._y(picked, onset.stress)[inside, None]
            extent = picked.take((np.flatnonzero(inside),)).squared_distance(y)[:, 0]
            responding[inside] = self.count(
                np.clip(extent, self.count.kinks[k - 1] ** 2, self.count.kinks[k] ** 2), k
            )
        bottom = np.minimum(t_kinks[0], top[rows])
        rate, interval = np.zeros_like(bottom), np.zeros_like(bottom)
        # from the outermost inwards: below its t every receptor of the pad fires
        rate += self.count.total * (onset.rate(np.minimum(t_kinks[-1], bottom)) - onset.rate_0)
        for k in range(1, len(t_kinks)):
            outer, inner = np.minimum(t_kinks[k], bottom), np.minimum(t_kinks[k - 1], bottom)
            # just outside a kink the count opens like a square root: x² smooths it
            t = inner[:, None] - (inner - outer)[:, None] * self.part**2
            weight = (inner - outer)[:, None] * 2.0 * self.part * self.weight
            stress = onset.stress[:, None] + t * t / beta[:, None]
            y = self._y(_over_nodes(picked), stress)
            low, high = self.count.kinks[k - 1] ** 2, self.count.kinks[k] ** 2
            within = self.count(np.clip(picked.squared_distance(y), low, high), k)
            gain = weight * onset.gain(t)
            rate += np.einsum("ni,ni->n", gain, within)
            if intervals:
                with np.errstate(divide="ignore", invalid="ignore"):
                    part = gain * (responding[:, None] - within) / onset.rate(t) ** 2
                interval += np.where(weight > 0, part, 0.0).sum(axis=-1)
        return _Beyond(bottom, Sums(rate, responding, interval))

    def _t_at(self, profile: Profile, onset: _Onset, beta: Array, distance: float) -> Array:
        """Return t where the stress is that at `distance` from the axis; 0 if the patch does not reach it."""
        low, high = profile.y_least.copy(), np.ones_like(profile.peak)
        for _ in range(48):
            middle = 0.5 * (low + high)
            outside = profile.squared_distance(middle[:, None])[:, 0] > distance**2
            low, high = np.where(outside, middle, low), np.where(outside, high, middle)
        stress = profile.peak * (0.5 * (low + high)) ** (1.0 / self.root)
        return np.sqrt(np.maximum(beta * (stress - onset.stress), 0.0))


def _over_nodes(profile: Profile) -> Profile:
    """Return the profile with a last axis for nodes in peak and range."""
    return Profile(profile.peak[..., None], profile.shape, profile.y_least[..., None])


class _Onset(NamedTuple):
    """Where firing starts, and the rate beyond it as a function of t (u = u_rheobase + t²).

    Fields have the shape (batch, conditions) or broadcast with it; coefficients one axis more.
    """

    odds: Array
    """alpha / I_rheobase - 1, which is exp(-u) at the rheobase."""
    stress: Array
    """The stress at which a receptor starts to fire [Pa]."""
    fires: Array
    """Whether alpha exceeds the rheobase."""
    excess: Array
    """alpha - I_rheobase [µA/cm²]."""
    rate_0: Array
    """nu just above the rheobase [Hz]."""
    scale: Array
    """2 / s_max, which makes w = scale s - 1."""
    level: Array
    """Coefficients of P in nu = rate_0 + s P(w)."""
    slope: Array
    """Coefficients of d nu / d s."""

    @classmethod
    def of(cls, drive: Drive, like: Array) -> _Onset:
        curve = drive.curve
        batch = np.broadcast_shapes(curve.rheobase.shape, (1,))

        def column(values: Array) -> Array:
            return np.reshape(values, batch)[..., None]

        rheobase = column(curve.rheobase)
        odds = drive.alpha / rheobase - 1.0
        fires = odds > 0
        odds = np.where(fires, odds, 1.0)
        stress = np.broadcast_to(drive.sigma_0 - np.log(odds) / drive.beta, like.shape)
        excess = np.where(fires, drive.alpha - rheobase, 1.0)
        c = curve.coefficients.reshape(*batch, 1, -1)
        following = np.concatenate([c[..., 1:], np.zeros_like(c[..., :1])], axis=-1)
        # dnu/ds = P + (w + 1) P'
        slope = np.arange(1, c.shape[-1] + 1) * (c + following)
        return cls(odds, stress, fires, excess, column(curve.onset_rate), 2.0 / column(curve.s_max), c, slope)

    def take(self, rows: tuple[NDArray[np.intp], ...], shape: tuple[int, ...]) -> _Onset:
        """Return the elements of a boolean choice from the batch of the given shape."""
        flat = (np.broadcast_to(value, shape)[rows] for value in self[:6])
        deep = (np.broadcast_to(value, (*shape, value.shape[-1]))[rows] for value in self[6:])
        return _Onset(*flat, *deep)

    def _over(self, t: Array) -> _Onset:
        """Return the onset with an axis for nodes, if `t` has one more than the batch."""
        if t.ndim == self.stress.ndim:
            return self
        return _Onset(*(v[..., None] for v in self[:6]), *(v[..., None, :] for v in self[6:]))

    def gain(self, t: Array) -> Array:
        """Return d nu / d t [Hz] at t of the batch's shape, or with one axis more."""
        at = self._over(t)
        left = np.exp(-t * t)
        below = 1.0 / (1.0 + at.odds * left)
        # I - I_rheobase = excess (1 - exp(-t²)) / (1 + odds exp(-t²)), without cancellation at t -> 0
        s = np.sqrt(at.excess * -np.expm1(-t * t) * below)
        speed = at.excess * (1.0 + at.odds) * left * t * below * below / np.maximum(s, 1e-300)
        return speed * horner(at.slope, at.scale * s - 1.0)

    def rate(self, t: Array) -> Array:
        """Return nu [Hz] at t of the batch's shape, or with one axis more."""
        at = self._over(t)
        lost = -np.expm1(-t * t)
        s = np.sqrt(at.excess * lost / (1.0 + at.odds * (1.0 - lost)))
        return at.rate_0 + s * horner(at.level, at.scale * s - 1.0)


class _Beyond(NamedTuple):
    """What lies past the pad's first kink."""

    bottom: Array
    """t at the first kink, where the inner interval starts."""
    sums: Sums
