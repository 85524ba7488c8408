"""Transduction, density and positions of SAI receptors on the pad, their number within a distance (model.md 6, 8)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit

from softness_bayes.touch.contact import Finger
from softness_bayes.touch.neuron.polynomials import horner

Array = NDArray[np.float64]

DIGITS = 12
"""Decimals to which distances [m] to the pad's edges are rounded, so that rounding errors do not split a kink."""


def receptor_current(stress: ArrayLike, alpha: ArrayLike, beta: ArrayLike, sigma_0: ArrayLike) -> Array:
    """Return I_c = alpha / (1 + exp(beta (sigma_0 - sigma))) [µA/cm²] (paper eq. 3).

    Parameters
    ----------
    stress, sigma_0
        Compressive stress at the receptor, and the stress of half-maximal current [Pa].
    alpha, beta
        Largest current [µA/cm²] and steepness [1/Pa]. All broadcast; no finite input overflows.
    """
    # half the difference cannot overflow; if the product does, expit(infinity) is still correct
    excess = 0.5 * np.asarray(stress, float) - 0.5 * np.asarray(sigma_0, float)
    with np.errstate(over="ignore"):
        return np.asarray(alpha, float) * expit(2.0 * (np.asarray(beta, float) * excess))


@dataclass(frozen=True)
class Density:
    """A reading of the receptor density along the finger (paper eq. 5; model.md 8)."""

    name: str
    at: Callable[[Array], Array]
    """Receptors per area [1/m²] as a function of the distance x [m] from the fingertip's end."""
    meaning: str = field(default="", repr=False, compare=False)
    """Description of the reading, for lists."""


def _consistent(x: Array) -> Array:
    return 1e4 * (7.95 + 62.275 * np.exp(-0.5 * (x / 13.25e-3) ** 2))


def _printed(x: Array) -> Array:
    width_cm = 0.0965
    return 1e4 * (19.9993 + 12.1534 / (width_cm * np.sqrt(2 * np.pi)) * np.exp(-0.5 * (100 * x / width_cm) ** 2))


CONSISTENT = Density(
    "consistent",
    _consistent,
    "the only half-Gaussian with all three of the paper's densities: largest, smallest and mean",
)
PRINTED_DENSITY = Density(
    "printed", _printed, "the paper's printed constants; their mean is 22.0 per cm², not the stated 41.605"
)


def kink_distances(finger: Finger) -> Array:
    """Return the distances [m] from the contact's axis to the pad's edges and corners, increasing, without 0.

    The number of receptors within a distance is smooth between these distances but not at them (model.md 8).
    """
    x, y = finger.contact_centre
    along = np.array([x, finger.pad_length - x])
    across = np.array([y, finger.pad_width - y])
    corners = np.hypot(along[:, None], across[None, :]).ravel()
    distances = np.unique(np.round(np.concatenate([along, across, corners]), DIGITS))
    return distances[distances > 0]


def receptors_within(distance: ArrayLike, finger: Finger, density: Density = CONSISTENT) -> Array:
    """Return the expected number of receptors within `distance` [m] of the contact's axis.

    It is the integral of the density over the part of the disc on the pad, as one integral along the finger. At x = x_c
    + r sin(psi), the pad's sides clip the chord if r cos(psi) exceeds them. The range of psi is divided there, so that
    Gauss quadrature is applied to smooth pieces.
    """
    r = np.atleast_1d(np.asarray(distance, float))
    x_c, y_c = finger.contact_centre
    sides = np.array([y_c, finger.pad_width - y_c])
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.arcsin(np.clip(np.stack([-x_c / r, (finger.pad_length - x_c) / r]), -1, 1))
        clips = np.arccos(np.clip(sides[:, None] / r, 0, 1))
    ends, clips = np.where(r > 0, ends, 0.0), np.where(r > 0, clips, 0.0)
    cuts = np.sort(np.clip(np.concatenate([ends, clips, -clips]), ends[0], ends[1]), axis=0)
    node, weight = np.polynomial.legendre.leggauss(48)
    half = 0.5 * np.diff(cuts, axis=0)[..., None]
    psi = half * node + 0.5 * (cuts[1:] + cuts[:-1])[..., None]
    reach = r[:, None] * np.cos(psi)
    chord = np.minimum(reach, sides[0]) + np.minimum(reach, sides[1])
    integrand = density.at(x_c + r[:, None] * np.sin(psi)) * chord * reach
    return (half * weight * integrand).sum(axis=(0, -1)).reshape(np.shape(distance))


class ReceptorCount:
    """`receptors_within` as polynomials, one for each interval between the pad's kinks.

    On the first interval, the count is the squared distance times a smooth function of it (of the distance itself if
    the axis is on the pad's edge), which preserves relative accuracy for the smallest patches. Beyond a kink at d it is
    smooth in sqrt(r² - d²), because the arc that the edge cuts off grows like a square root.

    Parameters
    ----------
    finger, density
        The pad with its contact centre, and the density reading.
    tolerance
        Truncation error of the series, in receptors. It is reached with forty terms, unless the axis is within a
        millimetre of an edge or corner, where the error is up to 1e-4 receptors.
    """

    def __init__(self, finger: Finger, density: Density, tolerance: float = 1e-9) -> None:
        self.kinks = kink_distances(finger)
        starts = np.concatenate([[0.0], self.kinks[:-1]])
        self.total = float(receptors_within(self.kinks[-1], finger, density))
        x, y = finger.contact_centre
        on_edge = np.round(min(x, y, finger.pad_length - x, finger.pad_width - y), DIGITS) == 0
        self.interval_is_even = tuple(not on_edge and start == 0 for start in starts)
        self.start_squared = starts**2
        self.span = np.sqrt(self.kinks**2 - starts**2)
        self.coefficients: list[Array] = []
        node = chebyshev.chebpts1(41)
        for start, span, even in zip(starts, self.span, self.interval_is_even, strict=True):
            part = 0.5 * (node + 1)
            squared = start**2 + span**2 * (part if even else part**2)
            within = receptors_within(np.sqrt(squared), finger, density)
            # both vanish at the axis; their ratio is smooth and preserves relative accuracy for small patches
            full = np.asarray(chebyshev.chebfit(node, within if start else within / squared, 40))
            tail = np.abs(full)[::-1].cumsum()[::-1] * (1.0 if start else span**2)
            keep = max(int((tail > tolerance).sum()), 1)
            self.coefficients.append(np.asarray(chebyshev.cheb2poly(full[:keep])))

    def __call__(self, squared_distance: Array, interval: int = 0) -> Array:
        """Return the count for squared distances [m²] that lie in the given interval between kinks."""
        if self.interval_is_even[interval]:
            place = squared_distance * (2.0 / self.span[interval] ** 2) - 1.0
        else:
            part = (squared_distance - self.start_squared[interval]) * (1.0 / self.span[interval] ** 2)
            place = 2.0 * np.sqrt(np.maximum(part, 0.0)) - 1.0
        count = horner(self.coefficients[interval], place)
        return count if interval else count * squared_distance

    def anywhere(self, squared_distance: Array) -> Array:
        """Return the count for squared distances [m²] of any size, shape (n,)."""
        if (squared_distance <= self.kinks[0] ** 2).all():
            return self(squared_distance)
        within = np.minimum(squared_distance, self.kinks[-1] ** 2)
        interval = np.searchsorted(self.kinks**2, within)
        count = np.empty_like(within)
        for k in np.unique(interval):
            count[interval == k] = self(within[interval == k], k)
        return count


receptor_count = lru_cache(maxsize=64)(ReceptorCount)
"""The receptor count of a pad, cached for all scenes that share it."""


def draw_receptors(rng: np.random.Generator, finger: Finger = Finger(), density: Density = CONSISTENT) -> Array:
    """Draw the positions of a pad's receptors from a Poisson process of the given density.

    Positions are drawn uniformly at the largest density and thinned in proportion to the local density.

    Parameters
    ----------
    rng
        Random generator.
    finger, density
        The pad and the reading of the receptor density.

    Returns
    -------
    ndarray
        Coordinates along the finger, from its end, and across it [m], shape (receptors, 2).
    """
    highest = float(density.at(np.linspace(0.0, finger.pad_length, 1001)).max())
    extent = np.array([finger.pad_length, finger.pad_width])
    places = rng.uniform(0.0, extent, (rng.poisson(highest * extent.prod()), 2))
    return np.asarray(places[rng.uniform(0.0, highest, len(places)) < density.at(places[:, 0])])
