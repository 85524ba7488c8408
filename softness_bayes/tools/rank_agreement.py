"""Ranks of short replicates beside those of long ones: ``python -m softness_bayes.tools.rank_agreement``.

Runs the first replicates of the stored calibration again, each with the settings of a replicate
(``runs.calibrate.REPLICATE``) and with those before them. Truths and ratings are the same, draws are not: ranks of a
truth among two independent sets of 99 draws of one posterior differ by a mean square of 33 on average over uniform
truths. Writes ``notebooks/results/rank_agreement.csv``, from which ``tools.doc_tables`` makes the table of the page on
calibration. A replicate that is already in the file is not repeated.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from softness_bayes.checking.ranks import DRAWS, Replicate
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.posterior import Posterior
from softness_bayes.results.request import RunOptions
from softness_bayes.runs.calibrate import ENSEMBLES, RANKED, replicate_settings
from softness_bayes.runs.calibration_scene import CalibrationScene
from softness_bayes.runs.replicate import replicate
from softness_bayes.sampler.sampling import Settings

STORED = Path("notebooks/results/calibration/ranks.csv")
TABLE = Path("notebooks/results/rank_agreement.csv")

COUNT, SEED, MOST_STEPS = 8, 1, 5000
"""Number of replicates, the seed of the stored calibration, and the largest number of steps."""

BEFORE = Settings(ensembles=ENSEMBLES, processes=1, max_steps=MOST_STEPS, goal=replace(RANKED, lengths=20.0))
"""Settings of a replicate before: 20 autocorrelation times, pilot and walkers of a run."""

COLUMNS = ("settings", "replicate", "steps", "stored_steps", "converged", "processor_s", "mean_square")

EXPECTED = DRAWS / 3.0
"""Mean square of the difference of ranks among two sets of `DRAWS` independent draws of one posterior."""


def ways(posterior: Posterior) -> Mapping[str, Settings]:
    """Return the settings to compare, by name."""
    now = replicate_settings(RunOptions(max_steps=MOST_STEPS, processes=1, seed=SEED), posterior)
    return {"of a replicate": now, "20 times, pilot and walkers of a run": BEFORE}


def mean_square(one: Replicate, stored: Mapping[str, str]) -> float:
    """Return the mean square of the differences of ranks; those of turning points are often tied, and left out."""
    names = [name for name in one.names if not name.startswith("turn")]
    apart = [one.rank[one.names.index(name)] - int(stored[name]) for name in names]
    return float(np.mean(np.square(apart)))


def main(arguments: Sequence[str] | None = None) -> None:
    """Run what is missing, and append a row for each replicate and way."""
    parser = argparse.ArgumentParser(description="Compare ranks of short replicates with those of stored long ones.")
    parser.add_argument("--count", type=int, default=COUNT, help="number of replicates")
    count = parser.parse_args(arguments).count
    with STORED.open(encoding="utf-8", newline="") as file:
        stored = {int(row["replicate"]): row for row in csv.DictReader(file)}
    done: set[tuple[str, str]] = set()
    if TABLE.exists():
        with TABLE.open(encoding="utf-8", newline="") as file:
            done = {(row["settings"], row["replicate"]) for row in csv.DictReader(file)}
    else:
        TABLE.write_text(",".join(COLUMNS) + "\n", encoding="utf-8")
    posterior = CalibrationScene().model(ModelOptions()).posterior
    for name, settings in ways(posterior).items():
        for index in range(count):
            if (name, str(index)) in done:
                continue
            begun = time.process_time()
            one = replicate(posterior, settings, SEED, index)
            spent, found = time.process_time() - begun, stored[index]
            row = (name, index, one.steps, found["steps"], one.converged, f"{spent:.2f}")
            with TABLE.open("a", encoding="utf-8", newline="") as file:
                csv.writer(file, lineterminator="\n").writerow([*row, f"{mean_square(one, found):.2f}"])


if __name__ == "__main__":
    main()
