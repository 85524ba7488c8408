"""Proposals in many dimensions, with and without blocks: ``python -m softness_bayes.tools.benchmark_blocks FILE.csv``.

Runs the shipped ratings, with all moduli uncertain, until they converge: with the moves that are used in so many
dimensions, and with the same moves without blocks. Prints and writes the autocorrelation time at the end, the number of
evaluations of the posterior, pilot included, and the processor time.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path

import softness_bayes
from softness_bayes.data import read_experiment
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.sampler.moves import MANY_DIMENSIONS_MOVES, MOVES, Moves, Student
from softness_bayes.sampler.sampling import Settings, walk
from softness_bayes.sampler.starts import TargetDensity

RATINGS = Path(softness_bayes.__file__).parent.parent / "data" / "ratings.csv"
MODULUS_CV = 0.15
SEEDS = (1,)

WAYS: Mapping[str, Moves] = {
    "without blocks": ((Student(20.0), MOVES[0][1]), *MOVES[1:]),
    "with blocks": MANY_DIMENSIONS_MOVES,
}

COLUMNS = ("moves", "parameters", "seed", "converged", "tau_steps", "evaluations", "processor_s")


def measure(target: TargetDensity, moves: Moves, seed: int, max_steps: int = 20_000) -> tuple[str, ...]:
    """Sample until convergence in this process; return the last five columns of a row."""
    begun = time.process_time()
    settings = Settings(moves=moves, processes=1, max_steps=max_steps)
    end = deque(walk(target, settings, seed), maxlen=1).pop()
    spent, verdict = time.process_time() - begun, end.verdict
    assert verdict is not None, "a walk that has ended was looked at"
    counted = end.nonfinite.evaluations
    return str(seed), str(verdict.converged), f"{verdict.tau.max():.0f}", str(counted), f"{spent:.0f}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a row for each combination of moves and seed, and write all rows."""
    parser = argparse.ArgumentParser(description="Compare moves with and without blocks in many dimensions.")
    parser.add_argument("file", type=Path, metavar="FILE.csv", help="file to write")
    kept = parser.parse_args(arguments).file
    target = build(read_experiment(RATINGS), ModelOptions(modulus_cv=MODULUS_CV)).posterior
    rows = []
    for seed in SEEDS:
        for name, moves in WAYS.items():
            rows.append((name, str(len(target.names)), *measure(target, moves, seed)))
            print(" | ".join(rows[-1]), flush=True)
    with kept.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows])


if __name__ == "__main__":
    main()
