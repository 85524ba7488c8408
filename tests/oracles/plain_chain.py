"""The whole chain in plain steps, written from the model's equations: it shares no line with the package.

The contact is bisected in extended precision. Stresses are tanh-sinh sums over the line of the contact, and the
population is integrated over the pad in Cartesian coordinates, where the package works along the distance from
the axis: no table, no integration by parts, no Gauss nodes, no arcs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import mpmath
import numpy as np

KAPPA = 2.67e-3
"""Attenuation [N m]."""


@dataclass(frozen=True)
class Touch:
    """A finger on a fabric, in SI; exactly one of indentation [m] and force [N] is given."""

    fabric_modulus: float
    indentation: float | None = None
    force: float | None = None
    fabric_poisson: float = 0.3
    radius: float = 8e-3
    skin_poisson: float = 0.48
    depth: float = 0.7e-3
    length: float = 30e-3
    width: float = 20e-3
    centre: tuple[float, float] = (12e-3, 10e-3)
    pressure: str = "attenuated"


@dataclass(frozen=True)
class RootLaw:
    """nu = jump + s sum_k c_k (2 s / s_max - 1)^k, s the root of the current above the rheobase."""

    rheobase: float = 18.0
    jump: float = 0.0
    coefficients: tuple[float, ...] = (14.0, 4.0, -0.8, 0.3)
    largest: float = 60.0

    def __call__(self, excess):
        s = np.sqrt(excess)
        w = 2 * s / math.sqrt(self.largest - self.rheobase) - 1
        return self.jump + s * sum(c * w**k for k, c in enumerate(self.coefficients))


class State(NamedTuple):
    """E_skin, E_star [Pa] and the contact radius [m]."""

    skin: float
    reduced: float
    radius: float


def contact(touch, b, m, digits=40):
    """Bisection of ln E_skin = ln b + m u(E_skin), whose sides rise and fall."""
    with mpmath.workdps(digits):
        skin_share = 1 - mpmath.mpf(touch.skin_poisson) ** 2
        fabric_share = (1 - mpmath.mpf(touch.fabric_poisson) ** 2) / mpmath.mpf(touch.fabric_modulus)
        big_r = mpmath.mpf(touch.radius)

        def state(log_skin):
            skin = mpmath.exp(log_skin)
            reduced = 1 / (skin_share / skin + fabric_share)
            if touch.force is None:
                radius = mpmath.sqrt(big_r * mpmath.mpf(touch.indentation))
            else:
                radius = mpmath.cbrt(3 * big_r * mpmath.mpf(touch.force) / (4 * reduced))
            return skin, reduced, radius

        def compression(log_skin):
            skin, reduced, radius = state(log_skin)
            return skin_share / skin * reduced / (2 * big_r * radius) * 2 * radius**2

        low = mpmath.log(mpmath.mpf(b))
        high = low + m * compression(low)
        for _ in range(int(3.4 * digits) + 8):
            middle = (low + high) / 2
            if middle < mpmath.log(mpmath.mpf(b)) + m * compression(middle):
                low = middle
            else:
                high = middle
        return State(*(float(value) for value in state(low)))


def double_exponential(step):
    """Nodes on (0, 1) that crowd at both ends, as distances to the left end and to the right end, and weights."""
    t = np.arange(-3.1, 3.1 + 0.5 * step, step)
    left, right = (1 / (1 + np.exp(-sign * np.pi * np.sinh(t))) for sign in (1, -1))
    return left, right, step * np.pi * np.cosh(t) * left * right


def over(cuts, step):
    """Nodes and weights of the sum over consecutive pieces; `cuts` (pieces + 1, ...) rises along its first axis."""
    left, right, weight = double_exponential(step)
    low, high = cuts[:-1, ..., None], cuts[1:, ..., None]
    near = np.where(left < 0.5, low + (high - low) * left, high - (high - low) * right)
    nodes, weights = (np.moveaxis(part, 0, -2) for part in (near, (high - low) * weight))
    shape = (*nodes.shape[:-2], -1)
    return nodes.reshape(shape), weights.reshape(shape)


def stress(distance, touch, state, step=0.16):
    """Vertical stress [Pa] under Johnson's line load, at distances of shape (n,).

    With s = rho + z tan(angle) the influence 2 z³ ds / (pi ((rho - s)² + z²)²) is (2/pi) cos² of the angle.
    """
    distance, a, z = np.asarray(distance, float), state.radius, touch.depth
    amplitude = 2 * state.reduced * a / (math.pi * touch.radius)
    decay = 0.0
    if touch.pressure == "attenuated":
        decay = 4 * state.reduced * a**3 / (3 * touch.radius) * a / KAPPA
    # beyond exp(-60) the attenuated pressure is nothing
    end, inner = a * min(1.0, math.sqrt(60 / max(decay, 1e-9))), a / math.sqrt(1 + decay)
    marks = np.array([-end, 0.0, end] if decay < 4 else [-end, -min(inner, end), 0.0, min(inner, end), end])[:, None]
    angles = np.sort(np.arctan2(np.append(marks - distance, [0 * distance], axis=0), z), axis=0)
    angles = np.clip(angles, np.arctan2(-end - distance, z), np.arctan2(end - distance, z))
    angle, weight = over(angles, step)
    relative = (distance[..., None] + z * np.tan(angle)) / a
    share = np.sqrt(np.maximum(1 - relative, 0) * np.maximum(1 + relative, 0)) * np.exp(-decay * relative**2)
    return amplitude * (weight * share * 2 / np.pi * np.cos(angle) ** 2).sum(axis=-1)


def last_distance(touch, state, needed, farthest):
    """The distance [m] to which the stress is at least `needed`, by bisection of its logarithm."""
    if stress(np.array([farthest]), touch, state)[0] >= needed:
        return farthest
    low, high = 1e-12, farthest
    for _ in range(200):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if stress(np.array([middle]), touch, state)[0] >= needed else (low, middle)
    return low


def density(x):
    """Receptors per m²: the half-Gaussian with the paper's largest, smallest and mean density."""
    return 1e4 * (7.95 + 62.275 * np.exp(-(x**2) / (2 * 13.25e-3**2)))


def total_rate(touch, b, m, alpha, beta, sigma_0, law=RootLaw(), step=0.16):
    """Total rate [spikes/s] of the pad."""
    odds = alpha / law.rheobase - 1
    state = contact(touch, b, m)
    peak = stress(np.zeros(1), touch, state)[0]
    # u = beta (sigma - sigma_0) must exceed -ln(odds) for a current above the rheobase
    if not (odds > 0 and beta * (peak - sigma_0) > -math.log(odds)):
        return 0.0

    def rate(distance):
        u = np.maximum(beta * (stress(distance, touch, state) - sigma_0) + math.log(odds), 0.0)
        # I - I_rh with exp(-u_0) = odds: no cancellation where alpha all but is the rheobase
        excess = law.rheobase * odds * -np.expm1(-u) / (1 + odds * np.exp(-u))
        return np.where(u > 0, law(excess), 0.0)

    (x, y), length, width = touch.centre, touch.length, touch.width
    farthest = max(math.hypot(i, j) for i in (x, length - x) for j in (y, width - y))
    end = last_distance(touch, state, sigma_0 - math.log(odds) / beta, farthest)
    # under shallow receptors the contact's edge is a knee
    rings = sorted({min(state.radius, end), end}) if touch.depth < 0.05 * state.radius else [end]
    sides = (y, width - y)
    turns = [x, *(x + sign * turn for sign in (1, -1) for ring in rings for turn in crossings(ring, sides))]
    along = np.unique(np.clip([0.0, length, *turns], max(0.0, x - end), min(length, x + end)))
    node, weight = (part.ravel() for part in over(along, step))
    total, halves = 0.0, [np.sqrt(np.maximum(ring**2 - (node - x) ** 2, 0.0)) for ring in rings]
    alike = min(sides) >= end
    for side in sides[:1] if alike else sides:
        across, share = over(np.stack([0 * node, *(np.minimum(half, side) for half in halves)]), step)
        distance = np.hypot(across, (node - x)[:, None])
        found = rate(distance.ravel()).reshape(distance.shape)
        total += (weight * density(node)) @ (share * found).sum(axis=-1)
    return float(2 * total if alike else total)


def crossings(ring, sides):
    """Half-widths of a ring at the axis' height, and where it meets the pad's sides."""
    return [ring, *(math.sqrt(ring**2 - side**2) for side in sides if ring > side)]
