"""Agreement of sources of data, each fitted alone: plates, and every recording of afferents."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from softness_bayes.likelihood.contract import Likelihood
from softness_bayes.model.posterior import Density
from softness_bayes.parameters.declared import RECORDED
from softness_bayes.parameters.space import ParameterSpace
from softness_bayes.recordings.findings import Agreement
from softness_bayes.recordings.likelihood import RecordedRates

Array = NDArray[np.float64]

CHAIN = ("b", "m", "alpha", "beta", "rest", "sigma_0", "spread", "radius", "depth")
"""Parameters of which sources may have a common value, without the suffix of recordings."""

STEP = 1e-3
"""Step of differences in the sampler's coordinates, where parameters have sds of about 0.1."""

STARTS = 5
"""Prior draws from which a mode is sought, beside the prior's median."""


class _Mode(NamedTuple):
    """The mode of one source's posterior in the sampler's coordinates, by parameter, and its covariance."""

    source: str
    names: tuple[str, ...]
    place: Array
    covariance: Array


def agreements(density: Density) -> tuple[Agreement, ...]:
    """Return how well each pair of sources agrees about their common parameters.

    Every source is fitted alone under the run's priors, by its posterior mode and the curvature there; thus a joint run
    cannot hide a contradiction behind wider spreads.
    """
    sources = list(_sources(density))
    modes = [_mode(name, _alone(density.space, term)) for name, term in sources] if len(sources) > 1 else []
    found = []
    for one, other in combinations(modes, 2):
        common = [name for name in CHAIN if name in one.names and name in other.names]
        if common:
            i, j = ([mode.names.index(name) for name in common] for mode in (one, other))
            apart = one.place[i] - other.place[j]
            spread = one.covariance[np.ix_(i, i)] + other.covariance[np.ix_(j, j)]
            distance = float(apart @ np.linalg.solve(spread, apart))
            found.append(Agreement(one.source, other.source, distance, len(common)))
    return tuple(found)


def _sources(density: Density) -> list[tuple[str, Likelihood]]:
    found: list[tuple[str, Likelihood]] = [] if density.compression is None else [("plates", density.compression)]
    term = density.term(RECORDED)
    if isinstance(term, RecordedRates):
        labels = np.array(term.data.recording or [RECORDED] * len(term.data))
        for label in dict.fromkeys(labels.tolist()):
            name = f"recording {label}" if term.data.recording else "recorded afferents"
            found.append((name, term if (labels == label).all() else term.without(labels != label)))
    return found


def _alone(space: ParameterSpace, term: Likelihood) -> Density:
    """Return the density of one source, with its own parameters."""
    needs = {*term.model.needs}
    held = {name: value for name, value in space.held.items() if name in needs}
    return Density(ParameterSpace(tuple(p for p in space.sampled if p.name in needs), held), (term,))


def _mode(source: str, density: Density) -> _Mode:
    space = density.space
    starts = np.vstack([space.median, space.draw_prior(np.random.default_rng(0), STARTS)])

    def loss(z: Array) -> Array:
        return -np.nan_to_num(density(z), nan=-1e12, neginf=-1e12)

    n = space.dimension
    ends = [minimize(_both(loss, n), start, jac=True, method="BFGS") for start in space.coordinates(starts)]
    z = min(ends, key=lambda end: float(end.fun)).x
    steps = STEP * np.eye(n)
    pairs = steps[:, None] + steps, steps[:, None] - steps
    points = np.stack([z + pairs[0], z - pairs[0], z + pairs[1], z - pairs[1]]).reshape(-1, n)
    plus, minus, across, back = loss(points).reshape(4, n, n)
    curvature = (plus + minus - across - back) / (4.0 * STEP**2)
    return _Mode(
        source,
        tuple(name.removesuffix("_rec") for name in space.names),
        z,
        np.asarray(np.linalg.pinv(curvature), float),
    )


def _both(loss: Callable[[Array], Array], n: int) -> Callable[[Array], tuple[float, Array]]:
    """Return a function that gives a loss at a point and its gradient by central differences, in one batch."""
    steps = STEP * np.eye(n)

    def both(z: Array) -> tuple[float, Array]:
        values = loss(np.vstack([z, z + steps, z - steps]))
        return float(values[0]), (values[1 : n + 1] - values[n + 1 :]) / (2.0 * STEP)

    return both
