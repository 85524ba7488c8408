"""Coverage where raters' fingers differ: ``python -m softness_bayes.tools.finger_coverage FILE.csv [--labs N]``.

Simulated laboratories rate the fabrics of `data/` with the parameters of `data/truth.json`, but each rater has an
individual finger. Each table is fitted with fixed channels, once with the typical finger for all raters and once with
individual fingers. The control is the same laboratory with the typical finger for all. Posteriors are
importance-sampled, and sampled by MCMC where the weights cannot be trusted; `--walk` does so in all fits. If fingers
differ in several quantities, draws are made with a coarse grid of fingers, and then weighted by the likelihood with the
usual grid. The file gets a row per laboratory, case and quantity; existing rows are kept.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.finger_check import STEP, check_fingers
from softness_bayes.data import Experiment, Fabrics, Ratings
from softness_bayes.model.build import ExperimentModel, build, design_of
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.other_fingers import skin_slope
from softness_bayes.model.posterior import Posterior
from softness_bayes.model.scenes import scene_of, touch_parameters
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.tools.coverage import LOADS, compared, keep, posterior_draws
from softness_bayes.tools.importance import Effort
from softness_bayes.touch.finger_family import FingerFamily
from softness_bayes.touch.finger_grid import FingerGrid
from softness_bayes.touch.neuron.membrane import Channels
from softness_bayes.touch.readings import MENDED

Array = NDArray[np.float64]

SPREADS: Mapping[str, float] = {"b": 0.3, "m": 0.15, "sigma_0": 0.2}
"""Standard deviations of the logarithms of raters' own values, of those that differ."""

COARSE, COARSE_REACH, COARSE_NODES = {"b": 9, "m": 5, "sigma_0": 9}, 3.0, (10, 6)
"""Nodes and half-width of a coarse grid of fingers, and the resolution of its responses. At draws of the posterior, the
log-likelihood then has an error of about 0.5 (standard deviation)."""

EFFORTS = Effort(300, 300.0), Effort(1000, 800.0)
"""Effort of a fit, and the one spent where its weights cannot be trusted."""

CONTROL, TYPICAL, OWN = "typical fingers", "taken as typical", "own fingers"
CASES = (CONTROL, TYPICAL, OWN)

COLUMNS = ("lab", "case", "quantity", "below", "z", "k", "steps", "finger_p")
"""As in `input_coverage`; `finger_p` is the p-value of the check of fingers."""


def laboratory(folder: Path, number: int, differ: tuple[str, ...]) -> tuple[Ratings, Fabrics, dict[str, float]]:
    """Return ratings of raters whose fingers differ, the fabrics, and the parameters of the typical finger."""
    fabrics = Fabrics.read(folder / "fabrics.csv")
    truth: dict[str, float] = json.loads((folder / "truth.json").read_text(encoding="utf-8"))["truth"]
    rng = np.random.default_rng((20261123, number))
    table = simulate_ratings(rng, fabrics, LOADS, truth, mu=truth["mu"]).ratings
    fabrics = fabrics.take(table.fabrics)
    conditions, people = table.conditions, len(table.participants)
    own = {**truth}
    for name in differ:
        own[name] = truth[name] * np.exp(SPREADS[name] * rng.standard_normal(people))  # type: ignore[assignment]
    scene = scene_of(fabrics, table.loads, truth, MENDED, conditions.fabric, conditions.load)
    at = touch_parameters(own)
    rate = scene.total_rate(type(at)(*np.broadcast_arrays(*at, np.empty(people))[:-1])) / scene.n_receptors
    typical = scene.total_rate(touch_parameters(truth)) / scene.n_receptors
    x, centre = np.log(rate + truth["eps"]), np.log(typical + truth["eps"])
    weight = design_of(Experiment(table, fabrics, ())).weight
    scale = truth["mu"] + truth["tau"] * rng.standard_normal(people)
    expected = scale[:, None] + truth["gamma"] * (x - centre @ weight)
    log_rating = expected[table.participant, conditions.of_rating]
    noise = truth["varsigma"] * rng.standard_normal(log_rating.size)
    return replace(table, rating=np.exp(log_rating + noise)), fabrics, truth


def fitted(
    number: int, case: str, folder: Path, differ: tuple[str, ...], walk: bool = False
) -> Iterator[dict[str, Any]]:
    """Yield a row for each quantity of one fit."""
    ratings, fabrics, truth = laboratory(folder, number, () if case == CONTROL else differ)
    held = {name: truth[name] for name in Channels._fields}
    model = build(Experiment(ratings, fabrics, ()), ModelOptions(fix=held, individual=differ if case == OWN else ()))
    spreads = {f"tau_{name}": SPREADS[name] for name in ("b",) if name in differ}
    spreads |= {"tau_sigma": SPREADS["sigma_0"]} if "sigma_0" in differ else {}
    true = {**truth, **spreads}
    theta, how = posterior_draws(model, number, true, walk, EFFORTS, _rough(model) if case == OWN else None)
    p_value = round(_check(model, theta, np.random.default_rng(number)), 4)
    for found in compared(model, theta, true):
        yield {"lab": number, "case": case, **found, **how, "finger_p": p_value}


def _rough(model: ExperimentModel) -> Posterior | None:
    """Return the posterior with a coarse grid of fingers; None if only one quantity differs."""
    posterior = model.posterior
    assert posterior.fingers is not None
    names = posterior.fingers.grid.names
    if len(names) == 1:
        return None
    grid = FingerGrid({name: COARSE[name] for name in names}, COARSE_REACH)
    return posterior.with_scene(model.scene, None, FingerFamily(model.scene, grid, *COARSE_NODES))


def _check(model: ExperimentModel, theta: Array, rng: np.random.Generator) -> float:
    posterior = model.posterior
    every = 4 if posterior.fingers is None or len(posterior.fingers.grid.names) == 1 else 10
    theta = theta[::every]
    rate, parameters = posterior.response(theta), posterior.rating_parameters(theta)
    effects = posterior.observation.draw_effects(rng, rate, parameters)
    slope = skin_slope(posterior, theta, parameters, STEP)
    return check_fingers(posterior.observation, rate, slope, parameters, effects).p_value


def main() -> None:
    """Fit the laboratories that are missing in the file."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("file", type=Path, help="CSV file of the fits; what it holds is kept")
    parser.add_argument("--labs", type=int, default=200, help="number of laboratories")
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--differ", default="b", help="what differs between fingers, some of b,m,sigma_0")
    parser.add_argument("--cases", default=",".join(CASES), help="the fits, separated by commas; by default all")
    parser.add_argument("--walk", action="store_true", help="sample all posteriors by MCMC")
    parser.add_argument("--data", type=Path, default=Path("data"), help="folder of fabrics.csv and truth.json")
    options = parser.parse_args()
    differ = tuple(options.differ.split(","))
    numbers = range(options.first, options.first + options.labs)
    fit = partial(fitted, folder=options.data, differ=differ, walk=options.walk)
    keep(options.file, COLUMNS, numbers, options.cases.split(","), fit)


if __name__ == "__main__":
    main()
