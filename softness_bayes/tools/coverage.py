"""Shared functions of the programs that measure coverage in simulated laboratories."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import multivariate_t

from softness_bayes.arviz_bridge import psis
from softness_bayes.checking.inflection import curve_scene, find_inflection, response_curves, turning_points
from softness_bayes.model.build import ExperimentModel
from softness_bayes.model.posterior import Posterior
from softness_bayes.model.scenes import touch_parameters
from softness_bayes.sampler.sampling import Settings, sample_until
from softness_bayes.touch.contact import Indentation
from softness_bayes.touch.parameters import TouchParameters

Array = NDArray[np.float64]

LOADS = (Indentation(1e-3), Indentation(2e-3), Indentation(3e-3))
DRAWS = 1000
"""Number of posterior draws for quantiles, turning points and checks."""

PROPOSED, ROUNDS, LAST, TAILS, LEAST_EFFECTIVE = 1000, 8, 8, 6.0, 100.0
"""Settings of importance sampling: proposals of each round, number of rounds, factor for the proposals of the last
round, degrees of freedom, and the smallest effective number of draws from which the mean and covariance of a round are
computed."""

PARAMETERS = ("b", "m", "sigma_0", "gamma", "tau_b", "tau_sigma")
"""Parameters whose coverage is counted, where they are sampled."""


def sampled_draws(model: ExperimentModel, seed: int) -> tuple[Array, dict[str, int]]:
    """Return evenly spaced draws of a model's posterior, and the final state of the sampler run."""
    sampled = sample_until(model.posterior, Settings(ensembles=2, processes=1), seed)
    kept = sampled.chains.kept(sampled.verdict.burn_in)
    theta = model.posterior.natural(kept.coordinates).reshape(-1, model.posterior.space.dimension)
    theta = theta[np.linspace(0, len(theta) - 1, DRAWS).astype(int)]
    return theta, {"steps": sampled.verdict.steps, "converged": int(sampled.verdict.converged)}


def weighted_draws(model: ExperimentModel, seed: int, start: Mapping[str, float]) -> tuple[Array, dict[str, float]]:
    """Return draws of a model's posterior by importance sampling, in about a tenth of the time of MCMC.

    Proposals are multivariate t distributions (Cappé and colleagues, J. Comp. Graph. Stat. 13, 907, 2004). The first
    has the prior's spread about `start`; each later one has the mean and covariance of the previous weighted draws.
    Weights are flattened as long as a few draws dominate. The final weights are Pareto-smoothed.

    Returns
    -------
    ndarray, shape (DRAWS, parameters)
        Resampled by their weights.
    dict
        `k`, Pareto's shape: below 0.7 the draws can be trusted.
    """
    rng, posterior = np.random.default_rng((seed, 7)), model.posterior
    at = posterior.space.coordinates(np.array([start.get(name, np.nan) for name in posterior.names])[None])[0]
    prior = posterior.draw_start(rng, PROPOSED)
    mean, covariance = np.where(np.isfinite(at), at, prior.mean(axis=0)), np.cov(prior.T)
    for _ in range(ROUNDS):
        z, log_ratio = _proposed(rng, posterior, mean, covariance, PROPOSED)
        power = 1.0
        while _effective(power * log_ratio) < LEAST_EFFECTIVE:
            power *= 0.8
        weight = np.exp(power * (log_ratio - log_ratio.max()))
        mean, covariance = np.average(z, axis=0, weights=weight), np.cov(z.T, aweights=weight)
    z, log_ratio = _proposed(rng, posterior, mean, covariance, LAST * PROPOSED)
    (log_weight,), (k,) = psis(log_ratio[None])
    weight = np.exp(log_weight - log_weight.max())
    chosen = rng.choice(len(z), DRAWS, p=weight / weight.sum())
    return posterior.natural(z[chosen]), {"k": float(k)}


def _proposed(
    rng: np.random.Generator, posterior: Posterior, mean: Array, covariance: Array, size: int
) -> tuple[Array, Array]:
    """Return draws of the proposal and the log ratios of posterior to proposal density."""
    law = multivariate_t(mean, covariance, df=TAILS)
    z = law.rvs(size, random_state=rng)
    return z, np.concatenate([posterior(part) for part in np.array_split(z, -(-size // 64))]) - law.logpdf(z)


def _effective(log_weight: Array) -> float:
    """Return the effective number of draws with these weights."""
    weight = np.exp(log_weight - log_weight.max())
    return float(weight.sum() ** 2 / (weight**2).sum())


def compared(model: ExperimentModel, theta: Array, truth: Mapping[str, float]) -> Iterator[dict[str, Any]]:
    """Yield the rank of the true value among the draws, for each quantity."""
    for name, (drawn, value) in quantities(model, theta, truth).items():
        known = drawn[np.isfinite(drawn)]
        yield {
            "quantity": name,
            "below": float((known < value).mean()) if known.size else np.nan,
            "z": float((known.mean() - value) / known.std()) if known.size else np.nan,
        }


def quantities(
    model: ExperimentModel, theta: Array, truth: Mapping[str, float], others: Sequence[str] = ()
) -> dict[str, tuple[Array, float]]:
    """Return draws and true values of `PARAMETERS`, other parameters and turning points, as logarithms."""
    names, counted = model.posterior.names, (*PARAMETERS, *others)
    found = {n: (np.log(theta[:, names.index(n)]), float(np.log(truth[n]))) for n in counted if n in names}
    touch = TouchParameters(*(np.broadcast_to(v, len(theta)) for v in model.posterior.space.touch(theta)))
    places = turning_points(model.scene, touch, 0.0).modulus
    own = TouchParameters(*(np.atleast_1d(value) for value in touch_parameters(truth)))
    true = find_inflection(response_curves(curve_scene(model.scene), own), 0.0, (0.0, np.inf)).modulus[0]
    for k, load in enumerate(LOADS):
        if np.isfinite(true[k]):
            found[f"turning point at {load}"] = np.log(places[:, k]), float(np.log(true[k]))
    return found


def keep(
    path: Path,
    columns: Sequence[str],
    labs: Iterable[int],
    cases: Iterable[str],
    fit: Callable[[int, str], Iterable[dict[str, Any]]],
) -> None:
    """Append the rows of all fits to a file, skipping fits that it already contains."""
    done: set[tuple[int, str]] = set()
    if path.is_file():
        with path.open(encoding="utf-8", newline="") as file:
            done = {(int(row["lab"]), row["case"]) for row in csv.DictReader(file)}
    with path.open("a", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        if not done:
            writer.writeheader()
        for number, case in ((number, case) for number in labs for case in cases):
            if (number, case) not in done:
                writer.writerows([*fit(number, case)])
                file.flush()
