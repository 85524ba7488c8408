"""First state of a run: walkers scattered about several optima, each found from a different prior draw.

A local optimum is weighted by its mass in the Laplace approximation, a normal law of the same height and curvature. The
height alone is not informative, because a narrow mode can be much higher than a wide one of the same mass.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.errors import NumericalError
from softness_bayes.sampler.adaptation import TriangularMap
from softness_bayes.sampler.chains import EnsembleState, RunState, random_state
from softness_bayes.sampler.diagnostics import Starts
from softness_bayes.sampler.target import Nonfinite, TargetDensity, watching
from softness_bayes.sampler.workers import Workers

FloatArray = NDArray[np.float64]

CANDIDATES = 32
"""Number of prior draws from which the start of an optimisation is chosen."""

NEGLIGIBLE_MASS = 1e-3
"""Smallest mass, relative to the largest one, of an optimum at which walkers start."""

_STEP = 1e-3  # step of the gradient, in sampler coordinates: a thousandth of a parameter's value
_CURVATURE_STEP = 2e-2
_ITERATIONS = 40
_TOLERANCE = 1e-5  # relative tolerance: hundredths in a log density of thousands, less than the spread of walkers
_WIDEN = 2.0  # width of the starting points relative to that given by the curvature
_LEAST_CURVATURE = 0.25  # smallest curvature, that of a factor of e²
_DEPTH = 20.0  # depth below its optimum, plus ten per parameter, at which a walker is moved towards it
_LAPLACE_ERROR = 7.0  # error of a log mass: on the shipped data, optima on one ridge differ by up to five
_BARRIER = 5.0  # depth of a dip in log density that separates two modes
_ON_THE_WAY = np.linspace(0.0, 1.0, 9)[1:-1, None]


class Optimum(NamedTuple):
    """A local maximum of a density and its width."""

    point: FloatArray
    log_density: float
    root: FloatArray
    """Square root of the inverse curvature: point + root @ noise is a draw of the matching normal law."""

    @property
    def log_volume(self) -> float:
        """Logarithm of the volume of the matching normal law, up to a constant: log |det root|."""
        return float(np.linalg.slogdet(self.root)[1])

    @property
    def log_mass(self) -> float:
        """Logarithm of the mass of the matching normal law, up to the same constant."""
        return self.log_density + self.log_volume


def find_optimum(
    target: TargetDensity, seed: np.random.Generator | np.random.SeedSequence, best: bool = True
) -> Optimum:
    """Return the optimum reached from one of `CANDIDATES` starting draws.

    Parameters
    ----------
    target
        The density.
    seed
        Random generator of the starting draws, or its seed.
    best
        Whether to start from the most probable draw or from the first one of positive density. The best of many draws
        is rarely near a narrow mode.

    Raises
    ------
    NumericalError
        If all those draws have density zero.
    """
    candidates = target.draw_start(np.random.default_rng(seed), CANDIDATES)
    density = target(candidates)
    if not np.isfinite(density).any():
        raise NumericalError(f"all of {CANDIDATES} starting points have probability zero")
    order = np.where(np.isfinite(density), density, -np.inf) if best else np.isfinite(density)
    # within one and a half times the range of the candidates, because a line search is not limited by the prior
    low, high = candidates.min(axis=0), candidates.max(axis=0)
    bounds = list(zip(low - 0.5 * (high - low), high + 0.5 * (high - low), strict=True))
    return climb(target, candidates[order.argmax()], bounds, {"maxiter": _ITERATIONS, "ftol": _TOLERANCE})


def climb(
    target: Callable[[FloatArray], FloatArray], start: FloatArray, bounds: Any = None, options: Any = None
) -> Optimum:
    """Return the optimum uphill from a point; bounds and options as for L-BFGS-B of `scipy.optimize.minimize`."""
    from scipy.optimize import minimize  # imported here because it takes a quarter of a second

    steps = _STEP * np.eye(start.size)
    offsets = np.vstack([np.zeros(start.size), steps, -steps])

    def downhill(z: FloatArray) -> tuple[float, FloatArray]:
        values = np.maximum(target(z + offsets), -1e12)  # finite, so that a line search can return from zero density
        forward, backward = np.split(values[1:], 2)
        return -values[0], (backward - forward) / (2.0 * _STEP)

    found = minimize(downhill, start, jac=True, bounds=bounds, method="L-BFGS-B", options=options)
    size, vectors = np.linalg.eigh(_curvature(target, found.x))
    return Optimum(found.x, -float(found.fun), vectors / np.sqrt(np.maximum(size, _LEAST_CURVATURE)))


def scatter(
    target: TargetDensity, rng: np.random.Generator, optima: Sequence[Optimum], walkers: int
) -> tuple[FloatArray, FloatArray]:
    """Spread walkers about optima in equal numbers, at twice the width given by the curvature.

    A walker of very low density is moved towards its optimum.

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
    """Drop local optima of negligible mass; an ensemble left without any uses those of all ensembles.

    An optimum is retained if its mass may be `NEGLIGIBLE_MASS` of the largest one, within the error of the Laplace
    approximation.
    """
    groups = [list(group) for group in optima]
    least = max(o.log_mass for group in groups for o in group) + np.log(NEGLIGIBLE_MASS) - _LAPLACE_ERROR
    kept = [[o for o in group if o.log_mass > least] for group in groups]
    everyone = [o for group in kept for o in group]
    return [group or everyone for group in kept]


def separate(target: TargetDensity, optima: Iterable[Optimum]) -> list[Optimum]:
    """Return the optimum of largest mass of each mode, ordered by decreasing mass.

    Two optima belong to one mode if the log density along the line between them dips by less than `_BARRIER` below
    both, and their log volumes differ by less than that: a narrow peak on a wide hill is a separate mode.
    """
    modes: list[Optimum] = []
    left = sorted(optima, key=lambda o: -o.log_mass)
    while left:
        first, *rest = left
        modes.append(first)
        left = [o for o in rest if not _joined(target, first, o)]
    return modes


def _joined(target: TargetDensity, one: Optimum, other: Optimum) -> bool:
    if abs(one.log_volume - other.log_volume) > _BARRIER:
        return False
    between = target(one.point + _ON_THE_WAY * (other.point - one.point))
    return bool(between.min() > min(one.log_density, other.log_density) - _BARRIER)


def _curvature(target: Callable[[FloatArray], FloatArray], point: FloatArray) -> FloatArray:
    """Minus the Hessian of the log density by central differences, shape (dimension, dimension)."""
    steps = _CURVATURE_STEP * np.eye(point.size)
    pairs = steps[:, None] + steps, steps[:, None] - steps
    corners = np.concatenate([p.reshape(-1, point.size) for p in (pairs[0], pairs[1], -pairs[1], -pairs[0])])
    values = np.maximum(target(point + corners), -1e12).reshape(4, point.size, point.size)
    curvature = (values[1] + values[2] - values[0] - values[3]) / (4.0 * _CURVATURE_STEP**2)
    return 0.5 * (curvature + curvature.T)


def place_walkers(
    workers: Workers, seed: np.random.SeedSequence, ensembles: int, walkers: int, optima: int, first_look: int
) -> RunState:
    """Return the state from which a run starts.

    Parameters
    ----------
    workers
        Processes with the target as their resident object.
    seed
        Seed of all random numbers; each ensemble and each optimisation uses a child of it.
    ensembles, walkers, optima
        Numbers of ensembles, of walkers per ensemble, and of optimised points about which these start.
    first_look
        Step of the first convergence check.

    Raises
    ------
    NumericalError
        If the density is zero at all starting points.
    """
    # children by key, not by spawn(), whose result depends on how often it was called before
    seeds = [
        [np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, e, k)) for k in range(optima + 2)]
        for e in range(ensembles)
    ]
    climbs, failed = watched(
        workers, [(find_optimum, climb, k == 0) for own in seeds for k, climb in enumerate(own[2:])]
    )
    groups = worth_starting_from(climbs[e * optima : (e + 1) * optima] for e in range(ensembles))
    hopeful = {id(o): o for group in groups for o in group}
    (modes,), compared = watched(workers, [(separate, list(hopeful.values()))])
    maps = tuple(TriangularMap.affine(mode.point, mode.root) for mode in modes)
    tasks = [(_place, *own[:2], group, walkers) for own, group in zip(seeds, groups, strict=True)]
    placed, lost = watched(workers, tasks)
    return RunState(
        phase=0,
        steps=0,
        stride=1,
        due=first_look,
        ensembles=tuple(placed),
        map=TriangularMap.identity(placed[0].coordinates.shape[1]),
        parts=tuple(() for _ in placed),
        modes=maps if len(maps) > 1 else (),
        starts=Starts(len(climbs), len(climbs) - len(hopeful), len(maps)),
        nonfinite=failed + compared + lost,
    )


def watched(workers: Workers, tasks: list[tuple[Any, ...]]) -> tuple[list[Any], Nonfinite]:
    """Return the results of tasks (work, argument, ...), and the points at which the density could not be computed."""
    done = workers.map(watching, tasks)
    return [value for value, _ in done], sum((found for _, found in done), Nonfinite())


def _place(
    target: TargetDensity,
    seed: np.random.SeedSequence,
    walking: np.random.SeedSequence,
    optima: list[Optimum],
    walkers: int,
) -> EnsembleState:
    points, density = scatter(target, np.random.default_rng(seed), optima, walkers)
    if not np.isfinite(density).any():
        raise NumericalError("every walker starts where the probability is zero")
    return EnsembleState(points, density, random_state(np.random.RandomState(np.random.MT19937(walking))))
