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

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.touch.field import Profile
from softness_bayes.touch.firing import RateCurve
from softness_bayes.touch.polynomials import horner
from softness_bayes.touch.receptors import ReceptorCount

Array = NDArray[np.float64]

WIDE = 0.02
"""A patch that ends at a smaller share of the peak stress is wide: the count's pole at stress 0 comes close."""

_SEARCH, _SAME = 60, 1e-14  # most steps of a search in y, and the step that ends it


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
        # both ends ride along without weight: what fires at all, and what remains beyond saturation
        self.part = np.concatenate([[0.0], 0.5 * (x + 1.0), [1.0]])
        self.weight = np.concatenate([[0.0], 0.5 * weight, [0.0]])

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
        reach = np.where(onset.fires, np.maximum(drive.beta * (profile.peak - onset.stress), 0.0), 0.0)
        # no node is spent where nothing fires: often a third of all conditions
        firing = np.nonzero(reach)
        sums = Sums(*(np.zeros_like(reach) for _ in Sums._fields))
        found = self._firing(
            profile.take(firing),
            onset.take(firing),
            np.broadcast_to(drive.beta, reach.shape)[firing],
            reach[firing],
            intervals,
        )
        for whole, part in zip(sums, found, strict=True):
            whole[firing] = part
        return sums

    def _firing(self, profile: Profile, onset: _Onset, beta: Array, reach: Array, intervals: bool) -> Sums:
        """Integrate conditions in which receptors fire, all arrays along one axis."""
        top = np.sqrt(np.minimum(reach, self.saturation))[:, None]
        nodes = _Nodes(top * self.part, top * self.weight)
        extent, sums = self._inner(profile, onset, beta, reach, nodes, None, intervals)
        wide = np.nonzero((extent > self.count.kinks[0] ** 2) | (onset.stress < WIDE * profile.peak))
        if wide[0].size:
            beyond = self._wide(profile.take(wide), onset.take(wide), beta[wide], reach[wide], intervals)
            for whole, part in zip(sums, beyond, strict=True):
                whole[wide] = part
        return sums

    def _inner(
        self,
        profile: Profile,
        onset: _Onset,
        beta: Array,
        reach: Array,
        nodes: _Nodes,
        responding: Array | None,
        intervals: bool,
    ) -> tuple[Array, Sums]:
        """Integrate from the first node to the peak, where the patch lies within the pad's first kink.

        Returns the squared distance at the first node and the sums; the number of responding receptors
        is that within the distance unless it is known.
        """
        t = nodes.t
        stress = onset.stress[..., None] + t * t / beta[..., None]
        extent = profile.squared_distance(self._y(_over_nodes(profile), stress))
        within = self.count(extent)
        gain = nodes.weight * onset.gain(t)
        saturated, rest = reach > self.saturation, np.zeros_like(reach)
        rest[saturated] = self.count.anywhere(extent[..., -1][saturated])
        at_top, at_peak = np.moveaxis(onset.rate(np.stack([t[..., -1], np.sqrt(reach)], axis=-1)), -1, 0)
        rate = np.einsum("...i,...i", gain, within) + rest * (at_peak - at_top)
        if responding is None:
            responding = within[..., 0]
            rate += onset.rate_0 * responding
        interval = np.zeros_like(rate)
        if intervals:
            with np.errstate(divide="ignore", invalid="ignore"):
                missing = (responding[..., None] - within)[..., 1:-1] / onset.rate(t[..., 1:-1]) ** 2
                interval = np.einsum("...i,...i", gain[..., 1:-1], missing)
                interval += (responding - rest) / at_top + rest / at_peak
        return extent[..., 0], Sums(rate, responding, interval)

    def _y(self, profile: Profile, stress: Array) -> Array:
        relative = np.maximum(stress, 0.0) / profile.peak
        power = np.sqrt(relative) if self.root == 0.5 else relative**self.root
        return np.clip(power, profile.y_least, 1.0)

    def _wide(self, profile: Profile, onset: _Onset, beta: Array, reach: Array, intervals: bool) -> Sums:
        """Integrate where the patch may reach past the pad's first kink, one interval after another."""
        kinks = self.count.kinks
        t_kinks = np.minimum(self._t_at(profile, onset, beta, kinks), np.sqrt(reach)[:, None]).T
        y_onset = self._y(profile, onset.stress)
        responding = self.count.anywhere(profile.squared_distance(y_onset[:, None])[:, 0])
        # where saturation comes first the integral ends there
        top = np.sqrt(np.minimum(reach, self.saturation))
        bottom = np.minimum(t_kinks[0], top)
        nodes = self._stretched(onset, beta, bottom, top)
        _, inner = self._inner(profile, onset, beta, reach, nodes, responding, intervals)
        # from the outermost inwards: below its t every receptor of the pad fires
        whole = onset.rate(np.minimum(t_kinks[-1], bottom)) - onset.rate_0
        rate = inner.rate + onset.rate_0 * responding + self.count.total * whole
        interval = inner.interval
        for k in range(1, len(kinks)):
            outer, near = np.minimum(t_kinks[k], bottom), np.minimum(t_kinks[k - 1], bottom)
            if not (near > outer).any():
                continue
            # just outside a kink the count opens like a square root: x² smooths it
            t = near[:, None] - (near - outer)[:, None] * self.part**2
            weight = (near - outer)[:, None] * 2.0 * self.part * self.weight
            stress = onset.stress[:, None] + t * t / beta[:, None]
            extent = profile.squared_distance(self._y(_over_nodes(profile), stress))
            within = self.count(np.clip(extent, kinks[k - 1] ** 2, kinks[k] ** 2), k)
            gain = weight * onset.gain(t)
            rate = rate + np.einsum("ni,ni->n", gain, within)
            if intervals:
                with np.errstate(divide="ignore", invalid="ignore"):
                    part = gain * (responding[:, None] - within) / onset.rate(t) ** 2
                interval = interval + np.where(weight > 0, part, 0.0).sum(axis=-1)
        return Sums(rate, responding, interval)

    def _stretched(self, onset: _Onset, beta: Array, bottom: Array, top: Array) -> _Nodes:
        """Return nodes from bottom to top for a wide patch, even in the logarithm of the stress.

        The count has a pole at stress 0, to which a wide patch comes close. With h² = beta (stress -
        max(onset stress, 0)) it lies at h = ±i sqrt(beta onset stress) or 0: a sinh map leads away from it.
        """
        below = beta * np.maximum(-onset.stress, 0.0)
        low, high = (np.sqrt(np.maximum(end**2 - below, 0.0)) for end in (bottom, top))
        scale = np.sqrt(np.maximum(beta * onset.stress, 0.25 * low**2)) + 1e-150
        start, stop = np.arcsinh(low / scale), np.arcsinh(high / scale)
        w = start[:, None] + (stop - start)[:, None] * self.part
        height = scale[:, None] * np.sinh(w)
        t = np.clip(np.sqrt(height**2 + below[:, None]), bottom[:, None], top[:, None])
        weight = (stop - start)[:, None] * self.weight * scale[:, None] * np.cosh(w)
        return _Nodes(t, weight * height / np.maximum(t, 1e-300))

    def _t_at(self, profile: Profile, onset: _Onset, beta: Array, distance: Array) -> Array:
        """Return t where the stress is that at some distances from the axis, shape (n, distances); 0 outside the patch.

        In y the condition rho² = d² is Q(y) (1 - y) = d² y, a straight line but for what Q varies: false
        position in Illinois's form gains digits as fast as the secant does and never leaves the bracket.
        """
        squared = distance**2

        def beyond(y: Array) -> Array:
            return y * (profile.squared_distance(y) - squared)

        shape = (profile.peak.size, distance.size)
        low, high = np.broadcast_to(profile.y_least[:, None], shape).copy(), np.ones(shape)
        at_low, at_high = beyond(low), np.broadcast_to(-squared, shape).copy()
        low_stays = np.ones(shape, dtype=bool)
        # where the table ends before the distance its end stands in for the root
        inside = at_low > 0.0
        at_low[~inside] = 1.0
        y = low
        for _ in range(_SEARCH):
            step = np.where(inside, at_high / (at_high - at_low), 0.0)
            y, before = np.where(inside, high - step * (high - low), low), y
            if np.abs(y - before).max() <= _SAME:
                break
            at_y = beyond(y)
            up = at_y > 0.0
            # the end that stays twice in a row counts half, or it would stay for good
            at_high = np.where(up, np.where(low_stays, at_high, 0.5 * at_high), at_y)
            at_low = np.where(up, at_y, np.where(low_stays, 0.5 * at_low, at_low))
            low, high, low_stays = np.where(up, y, low), np.where(up, high, y), ~up
        stress = profile.peak[:, None] * y ** (1.0 / self.root)
        return np.sqrt(np.maximum(beta[:, None] * (stress - onset.stress[:, None]), 0.0))


class _Nodes(NamedTuple):
    """Nodes in t and their weights, with the two ends, which have weight 0."""

    t: Array
    weight: Array


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
    fires: Any
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

    def take(self, rows: tuple[NDArray[np.intp], ...]) -> _Onset:
        """Return some elements of the batch, along one axis."""
        # an axis of length one stands for all; broadcasting first would take as long as the rest
        first = np.zeros_like(rows[0])
        return _Onset(*(v[tuple(r if n > 1 else first for r, n in zip(rows, v.shape, strict=False))] for v in self))

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
