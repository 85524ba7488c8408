"""Coverage where moduli have errors: ``python -m softness_bayes.tools.input_coverage FILE.csv [--labs N] [--first K]``.

Simulated laboratories rate the fabrics of `data/` with the truth of `data/truth.json`, but know each modulus only with
a relative error. Each table is fitted three times, with held channels: with the true moduli (the control), with the
measured moduli taken as exact, and with their errors declared. The file gets a row per laboratory, case and quantity,
and keeps those that it has: a second call goes on where the first one ended.
"""

from __future__ import annotations

import argparse
import csv
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.checks import check_fabrics
from softness_bayes.checking.inflection import curve_scene, find_inflection, response_curves, turning_points
from softness_bayes.checking.modulus_errors import STEP, check_moduli
from softness_bayes.data import Experiment, Fabrics, Ratings
from softness_bayes.data.fabrics import log_sd
from softness_bayes.model.build import ExperimentModel, build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.other_moduli import drive_slope
from softness_bayes.model.scenes import touch_parameters
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.sampler.sampling import Settings, sample_until
from softness_bayes.touch.contact import Indentation
from softness_bayes.touch.neuron.membrane import Channels
from softness_bayes.touch.parameters import TouchParameters

Array = NDArray[np.float64]

ERROR = 0.15
"""Relative standard error of every modulus."""

CASES: Mapping[str, float | None] = {"true moduli": 0.0, "taken as exact": 0.0, "errors declared": ERROR}
"""What is said of the moduli's errors in each fit."""

LOADS = (Indentation(1e-3), Indentation(2e-3), Indentation(3e-3))
DRAWS = 1000
"""Draws of the posterior that quantiles, turning points and checks are of."""

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
    # ratings list fabrics in the order of their names
    ratings = simulate_ratings(rng, true, LOADS, truth, mu=truth["mu"]).ratings
    return ratings, true.take(ratings.fabrics), measured.take(ratings.fabrics), truth


def fitted(number: int, case: str, folder: Path) -> Iterator[dict[str, Any]]:
    """Yield a row for each quantity of one fit."""
    ratings, true, measured, truth = laboratory(folder, number)
    held = {name: truth[name] for name in Channels._fields}
    experiment = Experiment(ratings, true if case == "true moduli" else measured, ())
    model = build(experiment, ModelOptions(fix=held, modulus_cv=CASES[case]))
    sampled = sample_until(model.posterior, Settings(ensembles=2, processes=1), number)
    kept = sampled.chains.kept(sampled.verdict.burn_in)
    theta = model.posterior.natural(kept.coordinates).reshape(-1, model.posterior.space.dimension)
    theta = theta[np.linspace(0, len(theta) - 1, DRAWS).astype(int)]
    checks = _checks(model, theta, np.random.default_rng(number))
    for name, (drawn, value) in _quantities(model, theta, truth).items():
        known = drawn[np.isfinite(drawn)]
        yield {
            "lab": number,
            "case": case,
            "quantity": name,
            "below": float((known < value).mean()) if known.size else np.nan,
            "z": float((known.mean() - value) / known.std()) if known.size else np.nan,
            "steps": sampled.verdict.steps,
            "converged": int(sampled.verdict.converged),
            **checks,
        }


def _quantities(model: ExperimentModel, theta: Array, truth: Mapping[str, float]) -> dict[str, tuple[Array, float]]:
    """Return draws and truth of parameters and turning points, in logarithms."""
    names = model.posterior.names
    found = {n: (np.log(theta[:, names.index(n)]), float(np.log(truth[n]))) for n in ("b", "m", "sigma_0", "gamma")}
    touch = TouchParameters(*(np.broadcast_to(v, len(theta)) for v in model.posterior.space.touch(theta)))
    places = turning_points(model.scene, touch, 0.0).modulus
    own = TouchParameters(*(np.atleast_1d(value) for value in touch_parameters(truth)))
    true = find_inflection(response_curves(curve_scene(model.scene), own), 0.0, (0.0, np.inf)).modulus[0]
    for k, load in enumerate(LOADS):
        if np.isfinite(true[k]):
            found[f"turning point at {load}"] = np.log(places[:, k]), float(np.log(true[k]))
    return found


def _checks(model: ExperimentModel, theta: Array, rng: np.random.Generator) -> dict[str, float]:
    """Return what the checks of residuals find."""
    posterior = model.posterior
    rate, parameters = posterior.mean_rate(theta), posterior.rating_parameters(theta)
    effects = posterior.observation.draw_effects(rng, rate, parameters)
    slope = drive_slope(posterior, theta, rate, parameters, STEP)
    found = check_moduli(posterior.observation, rate, slope, parameters, effects)
    fabrics = check_fabrics(posterior.observation, rate, parameters, effects)
    p_value = min(fabrics.p_value, fabrics.condition_p_value)
    return {"modulus_p": found.p_value, "fabric_p": p_value}


def main() -> None:
    """Fit the laboratories that the file lacks."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("file", type=Path, help="CSV file of the fits; what it holds is kept")
    parser.add_argument("--labs", type=int, default=200, help="number of laboratories")
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--data", type=Path, default=Path("data"), help="folder of fabrics.csv and truth.json")
    options = parser.parse_args()
    done: set[tuple[int, str]] = set()
    if options.file.is_file():
        with options.file.open(encoding="utf-8", newline="") as file:
            done = {(int(row["lab"]), row["case"]) for row in csv.DictReader(file)}
    with options.file.open("a", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        if not done:
            writer.writeheader()
        for number in range(options.first, options.first + options.labs):
            for case in CASES:
                if (number, case) not in done:
                    writer.writerows([*fitted(number, case, options.data)])
                    file.flush()
                    print(number, case, flush=True)


if __name__ == "__main__":
    main()
