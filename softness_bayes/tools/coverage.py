"""Shared functions of the programs that measure coverage in simulated laboratories."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from softness_bayes.checking.inflection import turning_points
from softness_bayes.model.build import ExperimentModel
from softness_bayes.model.posterior import Posterior
from softness_bayes.model.scenes import touch_parameters
from softness_bayes.sampler.sampling import Settings, sample_until
from softness_bayes.tools.importance import TRUSTED, USUAL, Effort, corrected, weighted
from softness_bayes.touch.contact import Indentation
from softness_bayes.touch.parameters import TouchParameters

Array = NDArray[np.float64]

LOADS = (Indentation(1e-3), Indentation(2e-3), Indentation(3e-3))
DRAWS = 1000
"""Number of posterior draws for quantiles, turning points and checks."""

PARAMETERS = ("b", "m", "sigma_0", "gamma", "tau_b", "tau_sigma")
"""Parameters whose coverage is counted, where they are sampled."""

STIFF = 3
"""Rank of the direction whose coverage is counted, from the one in which the posterior is narrowest."""


def sampled_draws(model: ExperimentModel, seed: int) -> tuple[Array, dict[str, int]]:
    """Return evenly spaced draws of a model's posterior, and the final state of the sampler run."""
    sampled = sample_until(model.posterior, Settings(ensembles=2, processes=1), seed)
    kept = sampled.chains.kept(sampled.verdict.burn_in)
    theta = model.posterior.natural(kept.coordinates).reshape(-1, model.posterior.space.dimension)
    theta = theta[np.linspace(0, len(theta) - 1, DRAWS).astype(int)]
    return theta, {"steps": sampled.verdict.steps, "converged": int(sampled.verdict.converged)}


def weighted_draws(model: ExperimentModel, seed: int, start: Mapping[str, float]) -> tuple[Array, dict[str, float]]:
    """Return draws of a model's posterior by importance sampling from proposals that begin at `start`.

    Returns
    -------
    ndarray, shape (DRAWS, parameters)
        Resampled by their weights.
    dict
        `k`, Pareto's shape: below `importance.TRUSTED` the draws can be trusted.
    """
    rng = np.random.default_rng((seed, 7))
    found = weighted(model.posterior, rng, start)
    return found.resampled(rng, DRAWS), {"k": round(found.k, 3)}


def posterior_draws(
    model: ExperimentModel,
    seed: int,
    start: Mapping[str, float],
    walk: bool = False,
    efforts: Sequence[Effort] = (USUAL,),
    rough: Posterior | None = None,
) -> tuple[Array, dict[str, float]]:
    """Return draws of a model's posterior, weighted if these can be trusted, and otherwise of a sampler run.

    Parameters
    ----------
    model, seed, start
        As for `weighted_draws`.
    walk
        True for a sampler run in any case.
    efforts
        Efforts of importance sampling, of which each is tried if the weights of the one before cannot be trusted.
    rough
        Cheap approximation of the posterior, from whose draws those of the posterior are made by weighting.

    Returns
    -------
    ndarray, shape (DRAWS, parameters)
    dict
        `k`, NaN if it was not computed, and the number of `steps` of the sampler, 0 for weighted draws.
    """
    k = np.nan
    for effort in () if walk else efforts:
        rng = np.random.default_rng((seed, 7))
        found = weighted(rough or model.posterior, rng, start, effort)
        if rough is not None:
            found = corrected(found, rough, model.posterior, rng, int(effort.effective))
        k = round(found.k, 3)
        if k <= TRUSTED:
            return found.resampled(rng, DRAWS), {"k": k, "steps": 0}
    theta, ending = sampled_draws(model, seed)
    return theta, {"k": k, "steps": ending["steps"]}


def compared(model: ExperimentModel, theta: Array, truth: Mapping[str, float]) -> Iterator[dict[str, Any]]:
    """Yield the rank of the true value among the draws, for each quantity."""
    for name, (drawn, value) in quantities(model, theta, truth).items():
        known = drawn[np.isfinite(drawn)]
        yield {
            "quantity": name,
            "below": round(float((known < value).mean()), 4) if known.size else np.nan,
            "z": round(float((known.mean() - value) / known.std()), 3) if known.size else np.nan,
        }


def quantities(
    model: ExperimentModel, theta: Array, truth: Mapping[str, float], others: Sequence[str] = ()
) -> dict[str, tuple[Array, float]]:
    """Return draws and true values of `PARAMETERS`, other parameters and turning points, as logarithms.

    The last one is the place along a stiff direction, see `_stiff_direction`.
    """
    names, counted = model.posterior.names, (*PARAMETERS, *others)
    found = {n: (np.log(theta[:, names.index(n)]), float(np.log(truth[n]))) for n in counted if n in names}
    # the true values are the last row, so that one scene is compiled for all
    touch, own = model.posterior.space.touch(theta), touch_parameters(truth)
    every = TouchParameters(*(np.append(np.broadcast_to(v, len(theta)), w) for v, w in zip(touch, own, strict=True)))
    places = turning_points(model.scene, every, 0.0).modulus
    for k, load in enumerate(LOADS):
        if np.isfinite(places[-1, k]):
            found[f"turning point at {load}"] = np.log(places[:-1, k]), float(np.log(places[-1, k]))
    return found | {"third stiffest direction": _stiff_direction(model.posterior, theta, truth)}


def _stiff_direction(posterior: Posterior, theta: Array, truth: Mapping[str, float]) -> tuple[Array, float]:
    """Return draws and true value along the direction in which a posterior is the narrowest but `STIFF` - 1.

    It is a direction in the standardised coordinates of the sampled parameters whose true values are known and are not
    zero. Latent values of fabrics, loads and raters are left out, so that the fits of a laboratory are comparable.
    """
    known = [place for place, name in enumerate(posterior.names) if truth.get(name, 0.0) != 0.0]
    # parameters without a true value have a coordinate too, which is not used
    true = [truth.get(name) or float(middle) for name, middle in zip(posterior.names, theta.mean(axis=0), strict=True)]
    drawn, value = (posterior.space.coordinates(each)[:, known] for each in (theta, np.array([true])))
    direction = np.linalg.eigh(np.cov(drawn.T))[1][:, STIFF - 1]
    # its sign is arbitrary
    direction *= np.sign(direction[np.argmax(np.abs(direction))])
    return drawn @ direction, float(value[0] @ direction)


def rows_of(path: Path) -> list[dict[str, str]]:
    """Return the rows of a kept file; none if there is no such file."""
    if not path.is_file():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def keep(
    path: Path,
    columns: Sequence[str],
    labs: Iterable[int],
    cases: Iterable[str],
    fit: Callable[[int, str], Iterable[dict[str, Any]]],
) -> None:
    """Append the rows of all fits to a file, skipping fits that it already contains."""
    done = {(int(row["lab"]), row["case"]) for row in rows_of(path)}
    # the matrices are small: further threads of linear algebra would mostly wait, with a processor each
    with threadpool_limits(1), path.open("a", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        if not done:
            writer.writeheader()
        for number, case in ((number, case) for number in labs for case in cases):
            if (number, case) not in done:
                writer.writerows([*fit(number, case)])
                file.flush()
