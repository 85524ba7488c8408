"""Coverage with outliers: ``python -m softness_bayes.tools.outlier_coverage FILE.csv [--labs N] [--first K]``.

Each simulated laboratory has the design and the true parameters of the shipped ratings (`data/truth.json`), and 3 % of
its ratings are multiplied by ten, as by a misplaced decimal point. It is fitted with fixed channels: without outliers
under normal errors (the control), then with the outliers under two error laws. The shipped ratings themselves are also
fitted, with outliers at other positions for each laboratory. Posteriors are importance-sampled. The file gets a row per
laboratory, case and quantity. Existing rows are kept, so that a second call continues where the first one ended.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.data import Experiment, Ratings, read_experiment
from softness_bayes.likelihood.error_laws import NORMAL, STUDENT, ErrorLaw
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.tools.coverage import keep, quantities, weighted_draws
from softness_bayes.touch.neuron.membrane import Channels

Array = NDArray[np.float64]

SHARE, FACTOR = 0.03, 10.0
"""Share of the ratings that are outliers, and the number that multiplies them."""


class Case(NamedTuple):
    """One fit of a laboratory."""

    shipped: bool
    """True for the shipped ratings, false for newly simulated ones."""
    outliers: bool
    errors: ErrorLaw


CASES: Mapping[str, Case] = {
    "untouched, normal": Case(False, False, NORMAL),
    "ten-fold, normal": Case(False, True, NORMAL),
    "ten-fold, student": Case(False, True, STUDENT),
    "shipped ten-fold, normal": Case(True, True, NORMAL),
    "shipped ten-fold, student": Case(True, True, STUDENT),
}

OWN = "tau", "alpha", "beta"
"""Parameters that are counted beside `coverage.PARAMETERS`."""

COLUMNS = ("lab", "case", "quantity", "below", "z", "width", "k")
"""`below`: share of draws below the truth; `z`: posterior mean minus truth, in posterior standard deviations; `width`:
of the central 90 % interval, of logarithms; `k`: Pareto's shape of the fit's weights, below 0.7 where it can be
trusted."""


def with_outliers(rng: np.random.Generator, ratings: Ratings) -> Ratings:
    """Return the ratings with `SHARE` of them, drawn at random, multiplied by `FACTOR`."""
    rating = ratings.rating.copy()
    rating[rng.choice(rating.size, round(SHARE * rating.size), replace=False)] *= FACTOR
    return replace(ratings, rating=rating)


def laboratory(folder: Path, number: int, case: Case) -> tuple[Experiment, dict[str, float]]:
    """Return the ratings of one laboratory, and the truth behind them."""
    truth: dict[str, float] = json.loads((folder / "truth.json").read_text(encoding="utf-8"))["truth"]
    found = read_experiment(folder / "ratings.csv")
    if not case.shipped:
        found = found._replace(ratings=_anew(found, truth, np.random.default_rng((20261123, number))))
    if case.outliers:
        found = found._replace(ratings=with_outliers(np.random.default_rng((number, 1)), found.ratings))
    return found, truth


def _anew(shipped: Experiment, truth: Mapping[str, float], rng: np.random.Generator) -> Ratings:
    """Return newly simulated ratings for the same raters, fabrics and loads as the shipped ones."""
    ratings = shipped.ratings
    people = len(ratings.participants)
    made = simulate_ratings(rng, shipped.fabrics, ratings.loads, truth, participants=people, mu=truth["mu"]).ratings
    filed = np.empty((people, len(ratings.fabrics), len(ratings.loads)))
    filed[made.participant, made.fabric, made.load] = made.rating
    return replace(ratings, rating=filed[ratings.participant, ratings.fabric, ratings.load])


def fitted(number: int, case: str, folder: Path) -> Iterator[dict[str, Any]]:
    """Yield a row for each quantity of one fit."""
    experiment, truth = laboratory(folder, number, CASES[case])
    yield from ({"lab": number, "case": case, **row} for row in placed(experiment, truth, CASES[case].errors, number))


def placed(experiment: Experiment, truth: Mapping[str, float], errors: ErrorLaw, seed: int) -> Iterator[dict[str, Any]]:
    """Yield the rank of the true value among the draws of one fit, for each quantity."""
    held = {name: truth[name] for name in Channels._fields}
    model = build(experiment, ModelOptions(fix=held, errors=errors))
    theta, verdict = weighted_draws(model, seed, truth)
    for name, (drawn, value) in quantities(model, theta, truth, OWN).items():
        known = drawn[np.isfinite(drawn)]
        low, high = np.quantile(known, [0.05, 0.95])
        yield {
            "quantity": name,
            "below": float((known < value).mean()),
            "z": round(float((known.mean() - value) / known.std()), 4),
            "width": round(float(high - low), 4),
            "k": round(verdict["k"], 3),
        }


def main() -> None:
    """Fit the laboratories that are missing in the file."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("file", type=Path, help="CSV file of the fits; what it holds is kept")
    parser.add_argument("--labs", type=int, default=30, help="number of laboratories")
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--data", type=Path, default=Path("data"), help="folder of ratings, fabrics and truth.json")
    options = parser.parse_args()
    numbers = range(options.first, options.first + options.labs)
    keep(options.file, COLUMNS, numbers, CASES, lambda number, case: fitted(number, case, options.data))


if __name__ == "__main__":
    main()
