"""Coverage of predicted ratings: ``python -m softness_bayes.tools.rating_coverage FILE.csv [--labs N] [--first K]``.

Simulated laboratories rate the fabrics of `data/`. Every fourth fabric and ten of the raters are left out, the rest
is fitted with fixed channels, and the left-out ratings are compared with their predictions. The parameters of each
laboratory are drawn from the prior until receptors fire in half of the conditions and ratings scatter by at least a
tenth. The file gets a row per laboratory, case and kind of left-out ratings; existing rows are kept.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.data import Experiment, Fabrics, Ratings
from softness_bayes.likelihood.directions import RATING_DIRECTIONS
from softness_bayes.likelihood.scales import MAGNITUDE, STANDARDISED, Scale
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.other_touches import OtherRatings, OtherTouches
from softness_bayes.model.scenes import scene_of
from softness_bayes.model.simulation import Simulation, simulate_ratings
from softness_bayes.parameters.choice import parameter_space
from softness_bayes.tools.coverage import LOADS, keep, sampled_draws
from softness_bayes.touch.neuron.membrane import PAPER_CHANNELS
from softness_bayes.touch.readings import MENDED

Array = NDArray[np.float64]

CASES = {scale.name: scale for scale in (MAGNITUDE, STANDARDISED)}
HELD = PAPER_CHANNELS._asdict()
RATERS, LEFT_OUT = 20, 10
"""Number of raters of each laboratory whose ratings are fitted, and number of further raters who are left out."""
EACH = 4
"""One fabric out of this number is left out, in the order of their moduli; the next laboratory omits another one."""
LEAST_FIRING, LEAST_NOISE = 0.5, 0.1

COLUMNS = ("lab", "case", "left_out", "values", "held_50", "held_90", "steps", "converged")
"""`held_90`: number of left-out values that lie in their 90 % interval."""


def laboratory(fabrics: Fabrics, number: int, scale: Scale) -> Simulation:
    """Return the ratings of one simulated laboratory, whose direction is that of its number."""
    rng, space = np.random.default_rng((20261124, number)), parameter_space(fix=HELD)
    direction = [*RATING_DIRECTIONS.values()][number % len(RATING_DIRECTIONS)]
    while True:
        values = {name: float(value) for name, value in space.values(space.draw_prior(rng, 1)[0]).items()}
        mu = float(np.log(20.0) + rng.standard_normal()) if scale is MAGNITUDE else None
        made = simulate_ratings(
            rng, fabrics, LOADS, values, participants=RATERS + LEFT_OUT, mu=mu, direction=direction, scale=scale
        )
        if (made.total_rate > 0).mean() >= LEAST_FIRING and values["varsigma"] >= LEAST_NOISE:
            return made


def without(whole: Ratings, fabrics: NDArray[np.bool_]) -> Ratings:
    """Return the ratings of the first `RATERS` raters and of the fabrics that are kept."""
    kept, place = fabrics[whole.fabric] & (whole.participant < RATERS), np.cumsum(fabrics) - 1
    return replace(
        whole,
        participants=whole.participants[:RATERS],
        fabrics=tuple(name for name, stays in zip(whole.fabrics, fabrics, strict=True) if stays),
        participant=whole.participant[kept],
        fabric=place[whole.fabric[kept]],
        load=whole.load[kept],
        rating=whole.rating[kept],
        rows=whole.rows[kept],
    )


def fitted(number: int, case: str, folder: Path) -> Iterator[dict[str, Any]]:
    """Yield the coverage of the left-out ratings by the predictions of one fit."""
    every = Fabrics.read(folder / "fabrics.csv")
    made = laboratory(every, number, CASES[case])
    whole = made.ratings
    every = every.take(whole.fabrics)
    kept = np.argsort(np.argsort(every.modulus())) % EACH != number % EACH
    ratings = without(whole, kept)
    scale = CASES[case]
    model = build(Experiment(ratings, every.take(ratings.fabrics), ()), ModelOptions(fix=HELD, scale=scale))
    theta, verdict = sampled_draws(model, number)
    scene = scene_of(every, LOADS, HELD, MENDED)
    touches = OtherTouches(model.posterior, scene, np.where(kept, np.cumsum(kept) - 1, -1))
    found = touches.ratings(np.random.default_rng(number), theta, LEFT_OUT)
    for counts in _held(whole, kept, found, scale):
        yield {"lab": number, "case": case, **counts, **verdict}


def _held(whole: Ratings, kept: NDArray[np.bool_], found: OtherRatings, scale: Scale) -> Iterator[dict[str, Any]]:
    """Yield the number of values of each left-out kind, and the number inside their prediction intervals."""
    condition = whole.load * len(whole.fabrics) + whole.fabric
    new_rater, new_fabric = whole.participant >= RATERS, ~kept[whole.fabric]
    single = found.new.reshape(-1, found.new.shape[-1])
    for name, rows in (
        ("fabrics", new_fabric & ~new_rater),
        ("raters", new_rater & ~new_fabric),
        ("fabrics and raters", new_rater & new_fabric),
    ):
        yield {"left_out": name, **_inside(single, whole.rating[rows], condition[rows])}
    every = np.arange(single.shape[1])
    means = [scale.additive(whole.rating[new_rater & (condition == k)]).mean() for k in every]
    yield {"left_out": "means of raters", **_inside(found.mean, scale.natural(np.array(means)), every)}


def _inside(drawn: Array, values: Array, column: NDArray[np.intp]) -> dict[str, int]:
    """Return the number of values, and the number inside the central intervals of their column's draws."""
    ends = np.quantile(drawn, [0.05, 0.25, 0.75, 0.95], axis=0)[:, column]
    inside = (int(((low <= values) & (values <= high)).sum()) for low, high in (ends[1:3], ends[::3]))
    return dict(zip(("values", "held_50", "held_90"), (values.size, *inside), strict=True))


def main() -> None:
    """Fit the laboratories that are missing in the file."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("file", type=Path, help="CSV file of the fits; what it holds is kept")
    parser.add_argument("--labs", type=int, default=20, help="number of laboratories")
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--data", type=Path, default=Path("data"), help="folder of fabrics.csv")
    options = parser.parse_args()
    numbers = range(options.first, options.first + options.labs)
    keep(options.file, COLUMNS, numbers, CASES, lambda number, case: fitted(number, case, options.data))


if __name__ == "__main__":
    main()
