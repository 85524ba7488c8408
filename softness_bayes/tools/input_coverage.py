"""Coverage where moduli have errors: ``python -m softness_bayes.tools.input_coverage FILE.csv [--labs N] [--first K]``.

Simulated laboratories rate the fabrics of `data/` with the parameters of `data/truth.json`, but measure each modulus
with a relative error. Each table is fitted three times with fixed channels: with the true moduli (the control), with
the measured moduli taken as exact, and with their errors declared. The file gets a row per laboratory, case and
quantity. Existing rows are kept, so that a second call continues where the first one ended.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.checks import check_fabrics
from softness_bayes.checking.modulus_errors import STEP, check_moduli
from softness_bayes.data import Experiment, Fabrics, Ratings
from softness_bayes.data.fabrics import log_sd
from softness_bayes.model.build import ExperimentModel, build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.other_moduli import drive_slope
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.tools.coverage import LOADS, compared, keep, sampled_draws
from softness_bayes.touch.neuron.membrane import Channels

Array = NDArray[np.float64]

ERROR = 0.15
"""Relative standard error of every modulus."""

CASES: Mapping[str, float | None] = {"true moduli": 0.0, "taken as exact": 0.0, "errors declared": ERROR}
"""Declared relative error of the moduli in each fit."""

COLUMNS = ("lab", "case", "quantity", "below", "z", "steps", "converged", "modulus_p", "fabric_p")
"""`below`: share of draws below the truth; `z`: posterior mean minus truth, in posterior standard deviations."""


def laboratory(folder: Path, number: int) -> tuple[Ratings, Fabrics, Fabrics, dict[str, float]]:
    """Return ratings, the true fabrics, the fabrics as measured, and the parameters of one simulated laboratory."""
    fabrics = Fabrics.read(folder / "fabrics.csv")
    truth: dict[str, float] = json.loads((folder / "truth.json").read_text(encoding="utf-8"))["truth"]
    rng = np.random.default_rng((20261122, number))
    modulus = fabrics.modulus()
    true = Fabrics(fabrics.names, effective_modulus=modulus, poisson_ratio=fabrics.poisson_ratio)
    error = float(log_sd(np.array(ERROR)))
    measured = replace(true, effective_modulus=modulus * np.exp(error * rng.standard_normal(modulus.size)))
    # ratings list fabrics in alphabetical order
    ratings = simulate_ratings(rng, true, LOADS, truth, mu=truth["mu"]).ratings
    return ratings, true.take(ratings.fabrics), measured.take(ratings.fabrics), truth


def fitted(number: int, case: str, folder: Path) -> Iterator[dict[str, Any]]:
    """Yield a row for each quantity of one fit."""
    ratings, true, measured, truth = laboratory(folder, number)
    held = {name: truth[name] for name in Channels._fields}
    experiment = Experiment(ratings, true if case == "true moduli" else measured, ())
    model = build(experiment, ModelOptions(fix=held, modulus_cv=CASES[case]))
    theta, verdict = sampled_draws(model, number)
    checks = _checks(model, theta, np.random.default_rng(number))
    for found in compared(model, theta, truth):
        yield {"lab": number, "case": case, **found, **verdict, **checks}


def _checks(model: ExperimentModel, theta: Array, rng: np.random.Generator) -> dict[str, float]:
    """Return the results of the residual checks."""
    posterior = model.posterior
    rate, parameters = posterior.response(theta), posterior.rating_parameters(theta)
    effects = posterior.observation.draw_effects(rng, rate, parameters)
    slope = drive_slope(posterior, theta, rate, parameters, STEP)
    found = check_moduli(posterior.observation, rate, slope, parameters, effects)
    fabrics = check_fabrics(posterior.observation, rate, parameters, effects)
    p_value = min(fabrics.p_value, fabrics.condition_p_value)
    return {"modulus_p": found.p_value, "fabric_p": p_value}


def main() -> None:
    """Fit the laboratories that are missing in the file."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("file", type=Path, help="CSV file of the fits; what it holds is kept")
    parser.add_argument("--labs", type=int, default=200, help="number of laboratories")
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--data", type=Path, default=Path("data"), help="folder of fabrics.csv and truth.json")
    options = parser.parse_args()
    numbers = range(options.first, options.first + options.labs)
    keep(options.file, COLUMNS, numbers, CASES, lambda number, case: fitted(number, case, options.data))


if __name__ == "__main__":
    main()
