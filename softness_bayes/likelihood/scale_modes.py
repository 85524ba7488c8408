"""The joint mode of raters' scales and the level, and the raters' log densities expanded about it (model.md 9)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.interval_law import in_single
from softness_bayes.likelihood.log_derivatives import cumulants, weighted
from softness_bayes.likelihood.quadrature import gauss_hermite
from softness_bayes.likelihood.rater_rows import HasParts

FloatArray = NDArray[np.float64]

_LOG_ROOT_TWO_PI = 0.5 * math.log(2.0 * math.pi)


@dataclass(frozen=True)
class ScaleModes:
    """The joint mode of all raters' scales and the level, and the normal approximation about it."""

    at: FloatArray
    """Point of the derivatives, shape (draws, raters)."""
    slopes: tuple[FloatArray, ...]
    """l_p and its first four or six derivatives there, each (draws, raters)."""
    a: FloatArray
    """Mode of a_p, shape (draws, raters)."""
    pull: FloatArray
    """Slope of l_p there plus curvature times a_p, shape (draws, raters)."""
    curvature: FloatArray
    """Minus the second derivative of l_p, shape (draws, raters)."""
    shrink: FloatArray
    """1 / (1 + tau² curvature), shape (draws, raters)."""
    mu: FloatArray
    """Mode of the level, shape (draws, 1)."""
    sd: FloatArray
    """Standard deviation of the level, shape (draws, 1)."""
    tables: HasParts | None = None
    """Log densities that were tabulated on the way, for further use at the same parameters."""

    def part(self, piece: Any) -> ScaleModes:
        """Return some of the draws."""
        parts = {name: getattr(self, name)[piece] for name in ("at", "a", "pull", "curvature", "shrink", "mu", "sd")}
        tables = None if self.tables is None else self.tables.part(piece)
        return ScaleModes(slopes=tuple(one[piece] for one in self.slopes), tables=tables, **parts)

    @property
    def bend(self) -> FloatArray:
        """Largest change of any rater's l_p by third and fourth derivatives, three standard deviations from its mode.

        Shape (draws,).
        """
        width = self.width
        reach = 3.0 * width + np.abs(self.a - self.at)
        bend = reach * reach * reach * (np.abs(self.slopes[3]) / 6.0 + reach * np.abs(self.slopes[4]) / 24.0)
        return np.asarray(np.where(reach > 6.0 * width, np.inf, bend).max(axis=-1))

    @property
    def truncation(self) -> FloatArray:
        """Measure of the raters' distance from normal laws, shape (draws,).

        Under Student's t, the error of the log density without higher derivatives than the fourth is about a twentieth
        of it: the sixth derivative is about 3 g4² / g2, and its mean effect is 15/720 of that in units of the width.
        With that effect added (`RaterIntegrals`), a quarter of the error remains.
        """
        width = self.width
        moved = np.square((self.a - self.at) / width)
        higher = (np.abs(self.slopes[3]) + np.abs(self.slopes[4]) * width) * (width * width * width)
        return np.asarray(np.square(higher * (1.0 + 0.5 * moved)).sum(axis=-1))

    @cached_property
    def width(self) -> FloatArray:
        """Standard deviation of a_p, the level's included, shape (draws, raters)."""
        return np.sqrt((1.0 - self.shrink) / np.maximum(self.curvature, 1e-300) + (self.shrink * self.sd) ** 2)


def taylor(derivatives: Sequence[FloatArray], t: FloatArray, order: int = 0) -> FloatArray:
    """Return the derivative of a given order of a Taylor series at distances t from its centre.

    Parameters
    ----------
    derivatives
        Value and derivatives at the centre.
    t
        Distances, whose shape the derivatives can be broadcast to.
    order
        Order of the derivative.
    """
    last, *others = [part / math.factorial(k) if k > 1 else part for k, part in enumerate(derivatives[order:])][::-1]
    if not others:
        return np.broadcast_to(last, t.shape)
    found = last * t
    for part in others[:-1]:
        found += part
        found *= t
    found += others[-1]
    return found


def series(modes: ScaleModes) -> Callable[[FloatArray], FloatArray]:
    """Return l_p as a function of a_p, from arrays (draws, ..., raters, nodes) to the same shape."""

    def evaluate(a: FloatArray) -> FloatArray:
        shape = (a.shape[0], *(1,) * (a.ndim - 3), a.shape[-2], 1)
        at, *each = (part.reshape(shape) for part in (modes.at, *modes.slopes))
        return taylor(each, a - at)

    return evaluate


def over_scales(modes: ScaleModes, tau: FloatArray, levels: int, scales: int, single: bool = False) -> FloatArray:
    """Return the sum of all raters' log densities, their scales integrated out, at nodes of the level (draws, levels).

    Parameters
    ----------
    modes
        The modes.
    tau
        Spread of the raters' scales, shape (draws, 1).
    levels, scales
        Numbers of nodes of the level and of each scale.
    single
        True for single precision, with errors of about 1e-6.
    """
    up = (modes.sd * gauss_hermite(levels)[0]).T[:, :, None]
    found = _paths(modes, tau, up, scales, single)
    total = np.log(found.weight.sum(axis=0))
    total += found.largest
    of_raters = modes.slopes[0] + 0.5 * np.log(modes.shrink) - _LOG_ROOT_TWO_PI
    return total.sum(axis=-1, dtype=float).T + of_raters.sum(axis=-1, keepdims=True)


class _Paths(NamedTuple):
    """Nodes of every rater's zeta at some levels, and the exponentials of the log density there; nodes come first."""

    zeta: FloatArray
    d: FloatArray
    """Distance of a_p from the point of the derivatives."""
    slopes: list[FloatArray]
    """Value, which is 0, and derivatives there."""
    weight: FloatArray
    """Weight of each node, relative to the largest."""
    largest: FloatArray
    """Largest exponent."""


def _paths(modes: ScaleModes, tau: FloatArray, up: FloatArray | float, scales: int, single: bool) -> _Paths:
    """Return the nodes at levels that differ from the mode by `up`, broadcast with (draws, raters)."""
    # long inner axes are faster: nodes come first, then those of the level, then draws and raters
    (x, log_weight), shrink = gauss_hermite(scales), modes.shrink
    centre = tau * shrink * modes.pull - tau * shrink * modes.curvature * (modes.mu + up)
    parts = [x, log_weight, centre, up + (modes.mu - modes.at), np.sqrt(shrink), tau, *modes.slopes[1:]]
    if single:
        parts = [in_single(part) for part in parts]
    x, log_weight, centre, away, root, wide, *slopes = parts
    x, log_weight = (one.reshape(-1, *(1,) * centre.ndim) for one in (x, log_weight))
    zeta = root * x + centre
    d = wide * zeta
    d += away
    slopes = [np.zeros(1, d.dtype), *slopes]
    value = taylor(slopes, d)
    value += log_weight
    value -= 0.5 * zeta * zeta
    largest = value.max(axis=0)
    value -= largest
    return _Paths(zeta, d, slopes, np.exp(value, out=value), largest)


def each_over_scales(modes: ScaleModes, tau: FloatArray, scales: int, single: bool = False) -> list[FloatArray]:
    """Return each rater's log density, the scale integrated out, with four derivatives in the level at its mode.

    The nodes of zeta move with the level as in `RaterIntegrals.at_levels`. The derivatives are then joint cumulants,
    over the nodes, of the derivatives of the log density along these paths.

    Parameters
    ----------
    modes
        The modes.
    tau
        Spread of the raters' scales, shape (draws, 1).
    scales
        Number of nodes.
    single
        True for single precision, with errors of about 1e-6.

    Returns
    -------
    list of ndarray
        Value and derivatives, each (draws, raters).
    """
    found = _paths(modes, tau, 0.0, scales, single)
    shrink, own = modes.shrink, tau * modes.shrink * modes.curvature
    if single:
        shrink, own = in_single(shrink), in_single(own)
    slope, bend, skew, curl = (taylor(found.slopes, found.d, order) for order in range(1, 5))
    weight, total = found.weight, found.weight.sum(axis=0)
    weight /= total
    slope *= shrink
    slope += own * found.zeta
    bend *= shrink**2
    skew *= shrink**3
    first, second, third, fourth = cumulants(weight, slope, bend, skew, shrink**4 * weighted(weight, curl))
    value = np.log(total) + found.largest + (modes.slopes[0] + 0.5 * np.log(modes.shrink) - _LOG_ROOT_TWO_PI)
    return [value, first, second - own * own, third, fourth]
