"""Where walkers start: spread about several optimised points, each reached from a prior draw of its own."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from softness_bayes.errors import NumericalError

FloatArray = NDArray[np.float64]

CANDIDATES = 32
"""Prior draws of which the most probable one is optimised."""

_STEP = 1e-3  # of the gradient, in sampler coordinates: a thousandth of a parameter's value
_CURVATURE_STEP = 2e-2
_ITERATIONS = 40
_TOLERANCE = 1e-5  # relative: hundredths in a log density of thousands, and walkers start wider than that
_WIDEN = 2.0  # walkers start this much wider than the curvature says
_LEAST_CURVATURE = 0.25  # no direction is taken to be wider than a prior's factor of e²
_DEPTH = 20.0  # a local optimum this far below the best, in log density, is no mode that matters


class Target(Protocol):
    """A density to sample, in coordinates that are unbounded on every axis."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""

    def natural(self, z: FloatArray) -> FloatArray:
        """Parameters [natural units] at coordinates ``z``, both of shape (..., dimension)."""

    def __call__(self, z: FloatArray) -> FloatArray:
        """Log density, shape (points,), at ``z`` of shape (points, dimension)."""

    def draw_start(self, rng: np.random.Generator, size: int) -> FloatArray:
        """Dispersed points of finite density from which optima may be sought, shape (size, dimension)."""


class Optimum(NamedTuple):
    """A local maximum of a density and how far it reaches."""

    point: FloatArray
    log_density: float
    root: FloatArray
    """Square root of the inverse curvature: point + root @ noise is a draw of the matching normal law."""


def find_optimum(target: Target, rng: np.random.Generator) -> Optimum:
    """Climb from the best of `CANDIDATES` starting draws.

    Raises
    ------
    NumericalError
        If all those draws have density zero.
    """
    candidates = target.draw_start(rng, CANDIDATES)
    density = target(candidates)
    if not np.isfinite(density).any():
        raise NumericalError(f"all of {CANDIDATES} starting points have probability zero")
    offsets = _STEP * np.vstack([np.zeros(len(target.names)), np.eye(len(target.names)), -np.eye(len(target.names))])

    def downhill(z: FloatArray) -> tuple[float, FloatArray]:
        values = np.maximum(target(z + offsets), -1e12)  # a line search must come back from where density ends
        forward, backward = np.split(values[1:], 2)
        return -values[0], (backward - forward) / (2.0 * _STEP)

    best = candidates[np.where(np.isfinite(density), density, -np.inf).argmax()]
    # no farther than the candidates reach, and half as much again: a line search knows no prior
    low, high = candidates.min(axis=0), candidates.max(axis=0)
    bounds = list(zip(low - 0.5 * (high - low), high + 0.5 * (high - low), strict=True))
    options = {"maxiter": _ITERATIONS, "ftol": _TOLERANCE}
    found = minimize(downhill, best, jac=True, bounds=bounds, method="L-BFGS-B", options=options)
    return Optimum(found.x, -float(found.fun), _inverse_root(_curvature(target, found.x)))


def scatter(
    target: Target, rng: np.random.Generator, optima: Sequence[Optimum], walkers: int
) -> tuple[FloatArray, FloatArray]:
    """Spread walkers about optima in equal numbers, twice as wide as the curvature says.

    A walker that lands where the density is hopeless is drawn towards its optimum.

    Returns
    -------
    points, log_density : ndarray, shapes (walkers, dimension) and (walkers,)
    """
    dimension = len(target.names)
    home = [optima[k % len(optima)] for k in range(walkers)]
    centre = np.array([optimum.point for optimum in home])
    noise = rng.standard_normal((walkers, dimension))
    step = _WIDEN * np.array([optimum.root @ e for optimum, e in zip(home, noise, strict=True)])
    floor = np.array([optimum.log_density for optimum in home]) - 10.0 * dimension - _DEPTH
    density = target(centre + step)
    for _ in range(60):
        lost = ~(density > floor)
        if not lost.any():
            break
        step[lost] /= 2.0
        density[lost] = target(centre[lost] + step[lost])
    return centre + step, density


def worth_starting_from(optima: Iterable[Sequence[Optimum]]) -> list[list[Optimum]]:
    """Leave out local optima far below the best of all; an ensemble left with none takes everyone's."""
    groups = [list(group) for group in optima]
    best = max(o.log_density for group in groups for o in group)
    kept = [[o for o in group if o.log_density > best - _DEPTH] for group in groups]
    everyone = [o for group in kept for o in group]
    return [group or everyone for group in kept]


def _curvature(target: Target, point: FloatArray) -> FloatArray:
    """Minus the Hessian of the log density by central differences, shape (dimension, dimension)."""
    steps = _CURVATURE_STEP * np.eye(point.size)
    pairs = steps[:, None] + steps, steps[:, None] - steps
    corners = np.concatenate([p.reshape(-1, point.size) for p in (pairs[0], pairs[1], -pairs[1], -pairs[0])])
    values = np.maximum(target(point + corners), -1e12).reshape(4, point.size, point.size)
    return (values[1] + values[2] - values[0] - values[3]) / (4.0 * _CURVATURE_STEP**2)


def _inverse_root(curvature: FloatArray) -> FloatArray:
    size, vectors = np.linalg.eigh(0.5 * (curvature + curvature.T))
    return vectors / np.sqrt(np.maximum(size, _LEAST_CURVATURE))
