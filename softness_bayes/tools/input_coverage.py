"""Coverage where moduli or loads have errors: ``python -m softness_bayes.tools.input_coverage FILE.csv [--labs N]``.

Simulated laboratories rate the fabrics of `data/` with the parameters of `data/truth.json`, but measure each modulus
with a relative error, or hold each load with one. Each table is fitted in several ways with fixed channels: with the
true inputs (the control), with the inputs as stated, and with their errors declared. Posteriors are importance-sampled,
and sampled by MCMC where the weights cannot be trusted; `--walk` does so in all fits. The file gets a row per
laboratory, case and quantity. Existing rows are kept, so that a second call continues where the first one ended.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.checks import check_fabrics
from softness_bayes.checking.modulus_errors import STEP, check_moduli
from softness_bayes.data import Experiment, Fabrics
from softness_bayes.data.fabrics import log_sd
from softness_bayes.model.build import ExperimentModel, build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.other_loads import scaled
from softness_bayes.model.other_moduli import drive_slope
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.parameters.priors import HalfNormal
from softness_bayes.tools.coverage import LOADS, compared, keep, posterior_draws
from softness_bayes.touch.contact import Load
from softness_bayes.touch.neuron.membrane import Channels

Array = NDArray[np.float64]

ERROR = 0.15
"""Relative standard error of every modulus, in laboratories that do not know them."""

LOAD_ERROR = 0.05
"""Relative standard error of every load, in laboratories that do not hold them. All ratings at a load share it."""


class Case(NamedTuple):
    """One fit of a laboratory."""

    wrong: str
    """Inputs of the laboratory that have errors: "moduli", "loads", or none."""
    options: Mapping[str, Any]
    """Options of the fit."""


CASES: Mapping[str, Case] = {
    "true moduli": Case("", {}),
    "taken as exact": Case("moduli", {}),
    "omega freed": Case("moduli", {"priors": {"omega": HalfNormal(0.5)}}),
    "errors declared": Case("moduli", {"modulus_cv": ERROR}),
    "loads taken as exact": Case("loads", {}),
    "load errors declared": Case("loads", {"shared_load_cv": LOAD_ERROR}),
}

COLUMNS = ("lab", "case", "quantity", "below", "z", "k", "steps", "modulus_p", "fabric_p")
"""`below`: share of draws below the truth; `z`: posterior mean minus truth, in posterior standard deviations; `k`:
Pareto's shape of the weights; `steps` of MCMC, 0 for weighted draws."""


def laboratory(folder: Path, number: int, wrong: str = "moduli") -> tuple[Experiment, dict[str, float]]:
    """Return the tables of one simulated laboratory, as it states them, and the true parameters.

    Parameters
    ----------
    folder
        That of `fabrics.csv` and `truth.json`.
    number
        Seed. With the same number, ratings under wrong moduli are those under true ones.
    wrong
        As in `Case`.
    """
    fabrics = Fabrics.read(folder / "fabrics.csv")
    truth: dict[str, float] = json.loads((folder / "truth.json").read_text(encoding="utf-8"))["truth"]
    rng = np.random.default_rng((20261122, number))
    modulus = fabrics.modulus()
    true = Fabrics(fabrics.names, effective_modulus=modulus, poisson_ratio=fabrics.poisson_ratio)
    error = float(log_sd(np.array(ERROR)))
    measured = replace(true, effective_modulus=modulus * np.exp(error * rng.standard_normal(modulus.size)))
    held: tuple[Load, ...] = LOADS
    if wrong == "loads":
        factors = np.exp(float(log_sd(np.array(LOAD_ERROR))) * rng.standard_normal(len(LOADS)))
        held = tuple(scaled(load, factor) for load, factor in zip(LOADS, factors.tolist(), strict=True))
    # ratings list fabrics in alphabetical order
    ratings = replace(simulate_ratings(rng, true, held, truth, mu=truth["mu"]).ratings, loads=LOADS)
    stated = measured if wrong == "moduli" else true
    return Experiment(ratings, stated.take(ratings.fabrics), ()), truth


def fitted(number: int, case: str, folder: Path, walk: bool = False) -> Iterator[dict[str, Any]]:
    """Yield a row for each quantity of one fit."""
    experiment, truth = laboratory(folder, number, CASES[case].wrong)
    held = {name: truth[name] for name in Channels._fields}
    model = build(experiment, ModelOptions(fix=held, **CASES[case].options))
    theta, how = posterior_draws(model, number, truth, walk)
    checks = _checks(model, theta, np.random.default_rng(number))
    for found in compared(model, theta, truth):
        yield {"lab": number, "case": case, **found, **how, **checks}


def _checks(model: ExperimentModel, theta: Array, rng: np.random.Generator) -> dict[str, float]:
    """Return the results of the residual checks."""
    posterior, theta = model.posterior, theta[::4]
    rate, parameters = posterior.response(theta), posterior.rating_parameters(theta)
    effects = posterior.observation.draw_effects(rng, rate, parameters)
    slope = drive_slope(posterior, theta, rate, parameters, STEP)
    found = check_moduli(posterior.observation, rate, slope, parameters, effects)
    fabrics = check_fabrics(posterior.observation, rate, parameters, effects)
    p_value = min(fabrics.p_value, fabrics.condition_p_value)
    return {"modulus_p": round(found.p_value, 4), "fabric_p": round(p_value, 4)}


def main() -> None:
    """Fit the laboratories that are missing in the file."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("file", type=Path, help="CSV file of the fits; what it holds is kept")
    parser.add_argument("--labs", type=int, default=200, help="number of laboratories")
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--cases", default=",".join(CASES), help="the fits, separated by commas; by default all")
    parser.add_argument("--walk", action="store_true", help="sample all posteriors by MCMC")
    parser.add_argument("--data", type=Path, default=Path("data"), help="folder of fabrics.csv and truth.json")
    options = parser.parse_args()
    numbers = range(options.first, options.first + options.labs)
    keep(
        options.file,
        COLUMNS,
        numbers,
        options.cases.split(","),
        partial(fitted, folder=options.data, walk=options.walk),
    )


if __name__ == "__main__":
    main()
