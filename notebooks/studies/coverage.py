"""Coverage of 90 % intervals where stated moduli or loads are wrong: ``python coverage.py FILE.csv [--labs N]``.

Simulated laboratories rate the fabrics of ``data/`` with the parameters of ``data/truth.json``, but measure each
modulus with a relative error, or all moduli with a common one, or hold each load with one. Each table is fitted with
fixed channels: with the true inputs (control), with the inputs as stated, and with their errors declared. FILE.csv
gets a row for each laboratory, case and quantity: the share of draws below the true value. Existing rows are kept. The
table of the page on results is printed.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from softness_bayes import Experiment, Fabrics, Indentation, ModelOptions, build, simulate_ratings
from softness_bayes.checking.inflection import turning_points
from softness_bayes.model.scenes import touch_parameters
from softness_bayes.runs.replicate import independent
from softness_bayes.sampler.sampling import Settings, sample_until
from softness_bayes.touch.parameters import TouchParameters

DATA = Path(__file__).parents[2] / "data"
DEPTHS = (1e-3, 2e-3, 3e-3)
LOADS = tuple(Indentation(depth) for depth in DEPTHS)
MODULUS_ERROR, COMMON_ERROR, LOAD_ERROR = 0.15, 0.2, 0.05
DRAWS = 1000


class Case(NamedTuple):
    """Inputs of the laboratory that have errors, the meaning, and the options of the fit."""

    wrong: str
    meaning: str
    options: Mapping[str, Any] = {}


CASES = {
    "true moduli": Case("", "exact moduli and loads (control)"),
    "taken as exact": Case("moduli", "moduli off by 15 %, taken as exact"),
    "errors declared": Case("moduli", "moduli off by 15 %, `--modulus-cv 0.15`", {"modulus_cv": MODULUS_ERROR}),
    "common error taken as exact": Case("all moduli", "all moduli off by one factor (sd 20 %), taken as exact"),
    "common error declared": Case(
        "all moduli",
        "all moduli off by one factor (sd 20 %), `--shared-modulus-cv 0.2`",
        {"shared_modulus_cv": COMMON_ERROR},
    ),
    "loads taken as exact": Case("loads", "loads off by 5 %, taken as exact"),
    "load errors declared": Case("loads", "loads off by 5 %, `--shared-load-cv 0.05`", {"shared_load_cv": LOAD_ERROR}),
}


def laboratory(number: int, wrong: str, truth: Mapping[str, float]) -> Experiment:
    """Return the tables of one simulated laboratory, as it states them."""
    rng, fabrics = np.random.default_rng((20261122, number)), Fabrics.read(DATA / "fabrics.csv")
    modulus = fabrics.modulus()
    true = Fabrics(fabrics.names, effective_modulus=modulus, poisson_ratio=fabrics.poisson_ratio)
    factor = np.exp(np.sqrt(np.log1p(MODULUS_ERROR**2)) * rng.standard_normal(modulus.size))
    if wrong == "all moduli":
        factor = np.exp(np.sqrt(np.log1p(COMMON_ERROR**2)) * rng.standard_normal())
    held = LOADS
    if wrong == "loads":
        errors = np.exp(np.sqrt(np.log1p(LOAD_ERROR**2)) * rng.standard_normal(len(LOADS)))
        held = tuple(Indentation(depth * error) for depth, error in zip(DEPTHS, errors.tolist(), strict=True))
    ratings = replace(simulate_ratings(rng, true, held, truth, mu=truth["mu"]).ratings, loads=LOADS)
    stated = replace(true, effective_modulus=modulus * factor) if "moduli" in wrong else true
    return Experiment(ratings, stated.take(ratings.fabrics), ())


def fitted(number: int, name: str) -> Iterator[dict[str, Any]]:
    """Yield the share of draws below the true value of each quantity, for one fit."""
    truth = json.loads((DATA / "truth.json").read_text(encoding="utf-8"))["truth"]
    held = {channel: truth[channel] for channel in ("c_Na", "c_K", "c_L", "c_A")}
    model = build(laboratory(number, CASES[name].wrong, truth), ModelOptions(fix=held, **CASES[name].options))
    posterior = model.posterior
    sampled = sample_until(posterior, Settings(ensembles=2, processes=1), number)
    drawn = independent(sampled, DRAWS, np.random.default_rng(number))
    theta = posterior.natural(drawn)
    # the true values are the last row, so that one scene is compiled for all
    pairs = zip(posterior.space.touch(theta), touch_parameters(truth), strict=True)
    every = TouchParameters(*(np.append(np.broadcast_to(draws, DRAWS), true) for draws, true in pairs))
    turn = turning_points(model.scene, every, 0.0).modulus
    found = {each: (theta[:, posterior.names.index(each)], truth[each]) for each in ("b", "m", "sigma_0", "gamma")}
    found |= {f"turning point at {load}": (turn[:-1, k], turn[-1, k]) for k, load in enumerate(LOADS)}
    for quantity, (draws, true) in found.items():
        known = draws[np.isfinite(draws)]
        if np.isfinite(true) and known.size:
            yield {"lab": number, "case": name, "quantity": quantity, "below": round(float((known < true).mean()), 4)}


def table(rows: pd.DataFrame) -> str:
    """Return the share of 90 % intervals that hold the truth, by case and quantity, in Markdown."""
    inside = rows.assign(inside=rows["below"].between(0.05, 0.95))
    shares = inside.pivot_table("inside", "case", "quantity", sort=False).reindex([*CASES])
    labs = inside.groupby("case")["lab"].nunique()
    head = ["laboratories' inputs", "number", *shares.columns]
    lines = [
        [CASES[name].meaning, str(labs[name]), *(f"{share:.2f}" for share in shares.loc[name])]
        for name in CASES
        if name in labs
    ]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in (head, ["---"] * len(head), *lines))


def main() -> None:
    """Fit the laboratories that are missing in the file, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("file", type=Path, help="CSV file of the fits; what it holds is kept")
    parser.add_argument("--labs", type=int, default=0, help="number of laboratories; 0 only makes the table")
    parser.add_argument("--cases", default=";".join(CASES), help="names of cases, separated by semicolons")
    asked = parser.parse_args()
    rows = pd.read_csv(asked.file) if asked.file.is_file() else pd.DataFrame(columns=["lab", "case"])
    done = {*zip(rows["lab"], rows["case"], strict=True)}
    for number, name in ((number, name) for number in range(asked.labs) for name in asked.cases.split(";")):
        if (number, name) not in done:
            rows = pd.concat([rows, pd.DataFrame(fitted(number, name))], ignore_index=True)
            rows.to_csv(asked.file, index=False)
    print(table(rows))


if __name__ == "__main__":
    main()
