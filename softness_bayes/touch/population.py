"""The population's response as a one-dimensional integral for each condition (model.md 6-8).

Let M(sigma) be the number of receptors whose stress exceeds sigma, and nu(I) the firing rate. The
total rate is the integral of nu over the receptors; by parts it is

    N = integral of M(sigma(I)) dnu(I)   from the rheobase to the largest current,

(plus nu just above the rheobase times M there, if the rate starts with a jump). With
u = beta (sigma - sigma_0) and u = u_rheobase + t² the integrand is smooth in t on all of [0, T]:
the substitution removes the square root at the onset of the rate, and M has no singularity at the
peak of the stress. A few nodes therefore suffice for each condition. M is evaluated through the
tabulated field. The range is cut only where the responding patch crosses an edge or corner of the pad.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from softness_bayes.touch.neuron.polynomials import clenshaw, horner
from softness_bayes.touch.neuron.rate_curve import RateCurve
from softness_bayes.touch.receptors import ReceptorCount

Array = NDArray[np.float64]
Index = NDArray[np.intp]


Y_LEAST = 1e-6
"""Least y, at a thousand times the size of the patch: far beyond any pad."""


class Profile(NamedTuple):
    """The field of a batch of touches, ready to be evaluated at any stress."""

    peak: Array
    """Stress on the axis [Pa], shape (...)."""
    shape: Array
    """Coefficients of rho² y / (1 - y) [m²] in T_k(x), shape (order, ...), with x from -1 at `start` to 1 at y = 1."""
    start: float = 0.0
    """Least y at which the profile holds."""

    def among(self, mask: NDArray[np.bool_], near: bool) -> tuple[Index, Profile]:
        """Return indices into the flattened batch of the elements of a mask, and their profile along one axis."""
        at = np.flatnonzero(mask)
        return at, self._replace(
            peak=self.peak.take(at), shape=self.shape.reshape(len(self.shape), -1).take(at, axis=1)
        )

    def squared_distance(self, y: Array) -> Array:
        """Return rho² [m²] where the stress is y^(1/root) of its peak, of the shape of `y`: (..., *batch)."""
        x = (2.0 * y - (1.0 + self.start)) / (1.0 - self.start)
        return clenshaw(self.shape, x) * (1.0 / y - 1.0)


WIDE = 0.02
"""Share of the peak stress below which the edge of a patch makes it wide: the pole of M at stress 0 is then close."""

LEAST = 1e-300
"""Least u - u_rheobase at which the gain is evaluated, which is infinite at 0."""

_SEARCH, _SAME = 60, 1e-14  # maximum number of steps of a search in y, and its convergence tolerance


class Fields(Protocol):
    """Stress fields of a batch of touches, with profiles only where they are asked for."""

    @property
    def peak(self) -> Array:
        """Stress on the axis [Pa], shape (batch, conditions)."""

    def among(self, mask: NDArray[np.bool_], near: bool) -> tuple[Index, Profile]:
        """Return indices into the flattened batch of the elements of a mask, and their profile along one axis.

        If `near`, the profile may hold for stresses from `WIDE` of the peak on alone.
        """


class Drive(NamedTuple):
    """Transduction and firing of a batch of parameter vectors; arrays of shape (batch,)."""

    alpha: Array
    """Largest current [µA/cm²]."""
    beta: Array
    """Steepness [1/Pa]."""
    sigma_0: Array
    """Stress at half the largest current [Pa]."""
    curve: RateCurve
    """The rate curve, of batch shape (batch,), or () where all share one."""

    @property
    def onset(self) -> Array:
        """The stress at which a receptor starts to fire [Pa], shape (batch,); infinite where none can."""
        with np.errstate(divide="ignore", invalid="ignore"):
            odds = self.alpha / np.reshape(self.curve.rheobase, -1) - 1.0
            return np.where(odds > 0, self.sigma_0 - np.log(odds) / self.beta, np.inf)

    def part(self, index: slice | Index) -> Drive:
        """Return the drive of some of the vectors."""
        curve = self.curve.take(index) if self.curve.rheobase.ndim else self.curve
        return Drive(self.alpha[index], self.beta[index], self.sigma_0[index], curve)


class ReceptorSums(NamedTuple):
    """Sums over the receptors of one condition, each of shape (batch, conditions)."""

    rate: Array
    """Total rate [spikes/s]."""
    responding: Array
    """Number of receptors that fire."""
    interval: Array
    """Sum of their inter-spike intervals [s]; 0 where none fires, or if not computed."""


class Population:
    """The receptors of the pad.

    Parameters
    ----------
    root
        The power of sigma / sigma_peak that gives y (see `StressField`).
    count
        Function that counts the receptors within a distance of the axis.
    nodes
        Number of nodes at which the receptors of each condition are counted.
    saturation
        Upper limit of u - u_rheobase. Beyond it the sigmoid is within exp(-saturation) of its limit, and the rest
        of the rate is one term for all receptors.
    """

    def __init__(self, root: float, count: ReceptorCount, nodes: int, saturation: float) -> None:
        self.root, self.count, self.saturation = root, count, saturation
        x, weight = legendre.leggauss(nodes)
        # in Gauss's rule the ends have weight 0; they are kept for the count of responding receptors and for the term
        # beyond saturation
        self.gauss_part = np.concatenate([[0.0], 0.5 * (x + 1.0), [1.0]])
        self.gauss_weight = np.concatenate([[0.0], 0.5 * weight, [0.0]])

    def sums(self, fields: Fields, drive: Drive, intervals: bool = False) -> ReceptorSums:
        """Integrate over the receptors for a batch of parameter vectors and all conditions.

        Parameters
        ----------
        fields
            The stress fields, shape (batch, conditions).
        drive
            Transduction and firing.
        intervals
            True to sum the inter-spike intervals as well, which doubles the time.
        """
        onset = _Onset.of(drive)
        reach = onset.beta[:, None] * (fields.peak - onset.stress[:, None])
        # conditions without firing, often a third of all, are skipped
        lanes, profile = fields.among(reach > 0.0, near=True)
        sums = ReceptorSums(*np.zeros((len(ReceptorSums._fields), *reach.shape)))
        if lanes.size:
            vector, high = lanes // reach.shape[1], reach.take(lanes)
            found, farthest = self._firing(profile, onset, vector, high, intervals)
            wide = (farthest > self.count.kinks[0] ** 2) | (onset.take(vector).stress < WIDE * profile.peak)
            for whole, part in zip(sums, found, strict=True):
                whole.put(lanes, part)
            if wide.any():
                mask = np.zeros(reach.shape, dtype=bool)
                mask.put(lanes[wide], True)
                lanes, profile = fields.among(mask, near=False)
                found = self._wide(profile, onset.take(lanes // reach.shape[1]), reach.take(lanes), intervals)
                for whole, part in zip(sums, found, strict=True):
                    whole.put(lanes, part)
        return sums

    def _firing(
        self, profile: Profile, onset: _Onset, vector: Index, reach: Array, intervals: bool
    ) -> tuple[ReceptorSums, Array]:
        """Integrate the conditions in which receptors fire, flattened to one axis, with the index of each one's vector.

        The sums, which hold for patches inside the first kink, are returned with the squared extents. Arrays over nodes
        have the node axis first, so that NumPy's inner loops run over the conditions, which far outnumber the nodes.
        """
        # conditions whose peak is beyond saturation have the gains of their vector, the others their own
        vectors, near = onset.stress.size, np.flatnonzero(reach <= self.saturation)
        column = vector.copy()
        column[near] = np.arange(vectors, vectors + near.size)
        top = np.sqrt(np.concatenate([np.full(vectors, self.saturation), reach.take(near)]))
        t = top * self.gauss_part[:, None]
        gains = onset.take(np.concatenate([np.arange(vectors), vector.take(near)])).gain(t[1:] ** 2)
        gains[:-1] *= 2.0 * t[1:-1] * top * self.gauss_weight[1:-1, None]
        own = onset.take(vector)
        nodes = t.take(column, axis=1), gains.take(column, axis=1)
        return self._inner(profile, own, reach, *nodes, intervals)

    def _root(self, stress: Array) -> Array:
        """Return stresses to the power `root`; the ratio to its value at the peak is y."""
        positive = np.maximum(stress, 0.0)
        return np.sqrt(positive) if self.root == 0.5 else positive**self.root

    def _y(self, profile: Profile, root: Array) -> Array:
        return np.minimum(np.maximum(root * (1.0 / self._root(profile.peak)), Y_LEAST), 1.0)

    def _inner(
        self,
        profile: Profile,
        onset: _Onset,
        reach: Array,
        t: Array,
        gains: Array,
        intervals: bool,
        responding: Array | None = None,
    ) -> tuple[ReceptorSums, Array]:
        """Integrate from the first node to the peak, for a patch inside the first kink of the receptor count.

        Nodes t have the shape (nodes, n), with the two ends. Gains are those at all nodes but the first, multiplied by
        the weights in u except the last one, whose weight is 0. Beyond saturation the gain falls like exp(-u): the
        receptors there are counted at its mean position, so that the error is of second order. The sums are returned
        with the squared extent of the patch at the first node.
        """
        beyond = np.maximum(reach - self.saturation, 0.0)
        left = np.exp(-beyond)
        mean = np.where(beyond > 0.0, 1.0 - beyond * left / np.maximum(1.0 - left, LEAST), 0.0)
        counted = t.copy()
        counted[-1] = np.sqrt(t[-1] ** 2 + mean)
        extent = profile.squared_distance(self._y(profile, self._root(onset.stress_at(counted))))
        within = self.count(np.minimum(extent, self.count.kinks[0] ** 2))
        responding = within[0] if responding is None else responding
        rest = np.where(beyond > 0.0, within[-1], 0.0)
        if (extent[-1] > self.count.kinks[0] ** 2).any():
            rest = np.where(beyond > 0.0, self.count.anywhere(extent[-1]), 0.0)
        # the integral of the gain from saturation to the peak, up to terms of exp(-2 u)
        tail = gains[-1] * (1.0 + onset.odds * np.exp(-self.saturation)) * (1.0 - left)
        rate = np.einsum("kn,kn->n", gains[:-1], within[1:-1]) + rest * tail + onset.rate_0 * responding
        interval = np.zeros_like(rate)
        if intervals:
            at_top, at_peak = onset.rate(np.stack([t[-1], np.sqrt(reach)]))
            with np.errstate(divide="ignore", invalid="ignore"):
                interval = (gains[:-1] * (responding - within[1:-1]) / onset.rate(t[1:-1]) ** 2).sum(axis=0)
                interval += (responding - rest) / at_top + rest / at_peak
        return ReceptorSums(rate, responding, interval), extent[0]

    def _wide(self, profile: Profile, onset: _Onset, reach: Array, intervals: bool) -> ReceptorSums:
        """Integrate piecewise for a patch that may extend past the first kink of the receptor count."""
        kinks = self.count.kinks
        t_kinks = np.minimum(self._t_at(profile, onset, kinks), np.sqrt(reach))
        responding = self.count.anywhere(profile.squared_distance(self._y(profile, self._root(onset.stress))))
        # the integral ends at saturation if that comes first
        top = np.sqrt(np.minimum(reach, self.saturation))
        bottom = np.minimum(t_kinks[0], top)
        t, weight = self._stretched(onset, bottom, top)
        gains = onset.gain(t[1:] ** 2)
        gains[:-1] *= weight[1:-1]
        inner, _ = self._inner(profile, onset, reach, t, gains, intervals, responding)
        # from the outermost kink inwards; below its t every receptor of the pad fires
        whole = onset.rate(np.minimum(t_kinks[-1], bottom)) - onset.rate_0
        rate = inner.rate + self.count.total * whole
        interval = inner.interval
        for k in range(1, len(kinks)):
            outer, near = np.minimum(t_kinks[k], bottom), np.minimum(t_kinks[k - 1], bottom)
            if not (near > outer).any():
                continue
            # just outside a kink the count grows like a square root, which x² makes smooth
            part = self.gauss_part[:, None]
            t = near - (near - outer) * part**2
            weight = 2.0 * t * (near - outer) * 2.0 * part * self.gauss_weight[:, None]
            extent = profile.squared_distance(self._y(profile, self._root(onset.stress_at(t))))
            within = self.count(np.clip(extent, kinks[k - 1] ** 2, kinks[k] ** 2), k)
            gain = weight * onset.gain(t * t)
            rate = rate + (gain * within).sum(axis=0)
            if intervals:
                with np.errstate(divide="ignore", invalid="ignore"):
                    missing = gain * (responding - within) / onset.rate(t) ** 2
                interval = interval + np.where(weight > 0, missing, 0.0).sum(axis=0)
        return ReceptorSums(rate, responding, interval)

    def _stretched(self, onset: _Onset, bottom: Array, top: Array) -> tuple[Array, Array]:
        """Return nodes t and weights from bottom to top for a wide patch, even in the logarithm of the stress.

        The count has a pole at stress 0, and a wide patch comes close to it. With h² = beta (stress -
        max(onset stress, 0)) the pole is at h = ±i sqrt(beta onset stress) or 0; a sinh map keeps nodes away from it.
        """
        below = onset.beta * np.maximum(-onset.stress, 0.0)
        low, high = (np.sqrt(np.maximum(end**2 - below, 0.0)) for end in (bottom, top))
        scale = np.sqrt(np.maximum(onset.beta * onset.stress, 0.25 * low**2)) + 1e-150
        start, stop = np.arcsinh(low / scale), np.arcsinh(high / scale)
        w = start + (stop - start) * self.gauss_part[:, None]
        height = scale * np.sinh(w)
        t = np.clip(np.sqrt(height**2 + below), bottom, top)
        weight = (stop - start) * self.gauss_weight[:, None] * scale * np.cosh(w)
        return t, 2.0 * weight * height

    def _t_at(self, profile: Profile, onset: _Onset, distance: Array) -> Array:
        """Return t at which the patch reaches some distances from the axis, shape (distances, n); 0 outside the patch.

        In y the condition rho² = d² is Q(y) (1 - y) = d² y, nearly a straight line because Q varies slowly. The
        Illinois variant of false position converges as fast as the secant method and never leaves the bracket.
        """
        squared = distance[:, None] ** 2

        def beyond(y: Array) -> Array:
            return y * (profile.squared_distance(y) - squared)

        shape = (distance.size, profile.peak.size)
        low, high = np.full(shape, Y_LEAST), np.ones(shape)
        at_low, at_high = beyond(low), np.broadcast_to(-squared, shape).copy()
        low_stays = np.ones(shape, dtype=bool)
        y = low
        for _ in range(_SEARCH):
            y, before = high - at_high / (at_high - at_low) * (high - low), y
            if np.abs(y - before).max() <= _SAME:
                break
            at_y = beyond(y)
            up = at_y > 0.0
            # halve the value at an end that stays twice in a row; otherwise that end would never move
            at_high = np.where(up, np.where(low_stays, at_high, 0.5 * at_high), at_y)
            at_low = np.where(up, at_y, np.where(low_stays, 0.5 * at_low, at_low))
            low, high, low_stays = np.where(up, y, low), np.where(up, high, y), ~up
        stress = profile.peak * y ** (1.0 / self.root)
        return np.sqrt(np.maximum(onset.beta * (stress - onset.stress), 0.0))


class _Onset(NamedTuple):
    """Onset of firing, and the rate beyond it, as a function of t or of t² = u - u_rheobase.

    Fields have the shape (batch,), or (1,) if all share one value; coefficients have one more axis, the first.
    """

    beta: Array
    """Steepness of the transduction [1/Pa]."""
    odds: Array
    """alpha / I_rheobase - 1, which is exp(-u) at the rheobase."""
    stress: Array
    """The stress at which a receptor starts to fire [Pa]; infinite where alpha is not above the rheobase."""
    excess: Array
    """alpha - I_rheobase [µA/cm²]."""
    rate_0: Array
    """nu just above the rheobase [Hz]."""
    scale: Array
    """2 / s_max, which makes w = scale s - 1."""
    slope: Array
    """Coefficients of d nu / d s in powers of w."""

    @classmethod
    def of(cls, drive: Drive) -> _Onset:
        curve = drive.curve
        rheobase, rate_0, s_max = (np.reshape(v, -1) for v in (curve.rheobase, curve.onset_rate, curve.s_max))
        odds = drive.alpha / rheobase - 1.0
        fires = odds > 0
        odds, stress = np.where(fires, odds, 1.0), drive.onset
        excess = np.where(fires, drive.alpha - rheobase, 1.0)
        slope = np.ascontiguousarray(np.atleast_2d(curve.slopes).T)
        return cls(drive.beta, odds, stress, excess, rate_0, 2.0 / s_max, slope)

    def take(self, vector: NDArray[np.intp]) -> _Onset:
        """Return the fields for these elements of the batch."""
        return _Onset(*(v if v.shape[-1] == 1 else v.take(vector, axis=-1) for v in self))

    def stress_at(self, t: Array) -> Array:
        """Return the stress [Pa] at t of shape (..., *batch)."""
        return self.stress + t * t / self.beta

    def gain(self, height: Array) -> Array:
        """Return d nu / d u [Hz] at a height u - u_rheobase of shape (..., *batch)."""
        # s² = I - I_rheobase = excess (1 - exp(-h)) / (1 + odds exp(-h)), without cancellation at h -> 0
        change = np.expm1(-np.maximum(height, LEAST))
        left = 1.0 + change
        level = -self.excess / (1.0 + self.odds * left)
        s = np.sqrt(change * level)
        speed = left * level * level / s
        speed *= 0.5 * (1.0 + self.odds) / self.excess
        return speed * horner(self.slope, self.scale * s - 1.0)

    def rate(self, t: Array) -> Array:
        """Return nu [Hz] at t of shape (..., *batch)."""
        lost = -np.expm1(-t * t)
        s = np.sqrt(self.excess * lost / (1.0 + self.odds * (1.0 - lost)))
        # nu = rate_0 + s P(w), and d nu / d s = P + (w + 1) P'
        level = self.slope / np.arange(1, len(self.slope) + 1)[:, None]
        for k in range(len(level) - 2, -1, -1):
            level[k] -= level[k + 1]
        return self.rate_0 + s * horner(level, self.scale * s - 1.0)
