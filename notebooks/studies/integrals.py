"""Time and error of the integrals over raters' effects: ``python integrals.py``.

First, tables of 30 raters: time of Laplace's method and of the reference for one parameter vector near the truth, and
the standard deviation there of the difference of log-likelihoods, whose mean has no effect on a posterior. Then small
tables of every kind, three of each: the largest shift of a posterior mean, in posterior standard deviations, where the
draws of a walk that uses Laplace's method are weighted by the reference.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from softness_bayes import CATEGORIES, LAPSES, NORMAL, SLIDER, STUDENT, Fabrics, HalfNormal, ModelOptions, usual_values
from softness_bayes.data import Experiment
from softness_bayes.model.build import build
from softness_bayes.model.posterior import Posterior
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.sampler.sampling import Settings, walk
from softness_bayes.touch.contact import Indentation
from softness_bayes.touch.readings import MENDED

LOADS = tuple(Indentation(depth * 1e-3) for depth in (1.0, 2.0, 3.0))
NUMBERS: Mapping[str, Mapping[str, Any]] = {
    f"{what}, {law.name}": {"errors": law, "resolution": step}
    for what, step in (("whole numbers", 1.0), ("exact", 0.0))
    for law in (NORMAL, STUDENT, LAPSES)
}
KINDS: Mapping[str, Mapping[str, Any]] = {
    **NUMBERS,
    "slider": {"scale": SLIDER, "errors": NORMAL},
    "categories": {"scale": CATEGORIES, "errors": NORMAL},
    "own gamma": {"individual": ("gamma",), "errors": NORMAL, "resolution": 1.0},
    "own varsigma": {"individual": ("varsigma",), "errors": NORMAL, "resolution": 1.0},
    "fabrics' deviations": {"priors": {"omega": HalfNormal(0.3)}, "errors": NORMAL, "resolution": 1.0},
}
"""Tables by name: options of the model, of which those that a simulation has are used there, too."""
OWN = {"tau_gamma": 0.3, "tau_varsigma": 0.3, "omega": 0.2, "sigma_0": 7.0}
POINTS, STEPS = 48, 100


def table(how: Mapping[str, Any], raters: int, fabrics: int, loads: int, seed: int = 1) -> tuple[Posterior, Any]:
    """Return the posterior of a simulated table, and the true values by name."""
    free = {f"tau_{name}" for name in how.get("individual", ())} | {*how.get("priors", {})}
    values = usual_values(MENDED, given={k: v for k, v in OWN.items() if k == "sigma_0" or k in free})
    cloth = Fabrics(tuple(f"F{k}" for k in range(fabrics)), effective_modulus=np.geomspace(3e3, 1e6, fabrics))
    made = {name: how[name] for name in ("scale", "errors", "resolution") if name in how}
    ratings = simulate_ratings(np.random.default_rng(seed), cloth, LOADS[:loads], values, participants=raters, **made)
    return build(Experiment(ratings.ratings, cloth, ()), ModelOptions(**how)).posterior, values


def timed(work: Callable[[], Any]) -> tuple[Any, float]:
    """Return what a function returns for `POINTS` points, and its shortest processor time for one of them [µs]."""
    seconds = []
    for _ in range(3):
        begun = time.process_time()
        found = work()
        seconds.append(time.process_time() - begun)
    return found, 1e6 * min(seconds) / POINTS


def near(posterior: Posterior, values: Mapping[str, float]) -> Any:
    """Return points near the truth, shape (`POINTS`, dimension)."""
    truth = np.array([values.get(name, np.nan) for name in posterior.names])
    truth = np.where(np.isnan(truth), posterior.space.median, truth)
    z = posterior.space.coordinates(truth[None])
    return posterior.natural(z + 0.03 * np.random.default_rng(0).standard_normal((POINTS, z.shape[-1])))


def largest_shift(posterior: Posterior, seed: int) -> float:
    """Return the largest shift of a posterior mean by the reference [posterior standard deviations]."""
    *_, state = walk(posterior, Settings(pilot=(15,), optima=1, max_steps=STEPS, processes=1), seed=seed)
    theta = posterior.natural(np.concatenate([state.map.forward(one.coordinates) for one in state.ensembles]))
    log_weight = posterior.log_likelihood(theta) - posterior.for_sampling.log_likelihood(theta)
    weight = np.exp(log_weight - log_weight.max())
    means = (weight[:, None] * theta).sum(axis=0) / weight.sum()
    return float((np.abs(means - theta.mean(axis=0)) / theta.std(axis=0)).max())


def main() -> None:
    """Print both tables."""
    print("table | ratings of each rater | Laplace [µs] | reference [µs] | sd of the difference")
    for fabrics, loads in ((12, 3), (3, 2)):
        for name, how in NUMBERS.items():
            posterior, values = table(how, 30, fabrics, loads)
            points = near(posterior, values)
            known = posterior.response(points), posterior.rating_parameters(points)
            (fast, quick), (right, slow) = (
                timed(partial(one.observation.log_likelihood, *known)) for one in (posterior.for_sampling, posterior)
            )
            print(f"{name} | {fabrics * loads} | {quick:.0f} | {slow:.0f} | {(fast - right).std():.1g}", flush=True)
    print("table | largest shifts of a posterior mean [sd]")
    for name, how in KINDS.items():
        shifts = [largest_shift(table(how, 8, 5, 2, seed)[0], seed) for seed in (1, 2, 3)]
        print(f"{name} | {', '.join(f'{shift:.3f}' for shift in shifts)}", flush=True)


if __name__ == "__main__":
    main()
