"""Cost of uncertain inputs until convergence: ``python -m softness_bayes.tools.benchmark_uncertain DIR``.

Samples the shipped ratings with all channel multipliers free until they converge: with exact inputs, with all moduli
uncertain, and with an individual `b` for each rater, in turn, each in a process of its own. With ``--other OTHER``, a
directory with the source of an earlier version (as for `tools.benchmark_versions`), also with exact inputs and that
version. The cost of a run is its processor time, or its number of evaluations of the posterior, pilot included, times
the cost of one evaluation. The latter is measured as a ratio of processor times, in alternating calls at the positions
of the walkers after the first stage of the pilot, half an ensemble at a time, as the sampler calls it.

The directory gets the runs (`runs.csv`), whose rows are kept, and the ratios of each round of calls (`calls.csv`),
which are measured anew. `tools.doc_tables` makes the table.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

import softness_bayes
from softness_bayes.data import read_experiment
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.sampler.sampling import Settings, walk
from softness_bayes.sampler.starts import TargetDensity
from softness_bayes.tools.coverage import rows_of

Array = NDArray[np.float64]

HERE = Path(softness_bayes.__file__).parent.parent
RATINGS = HERE / "data" / "ratings.csv"

EXACT = "exact inputs"
CASES: Mapping[str, ModelOptions] = {
    EXACT: ModelOptions(),
    "all moduli uncertain": ModelOptions(modulus_cv=0.15),
    "raters' own `b`": ModelOptions(individual=("b",)),
}
"""Options of the runs by the names of their inputs."""

RUN_COLUMNS = ("inputs", "parameters", "seed", "steps", "tau_steps", "evaluations", "seconds")
CALL_COLUMNS = ("inputs", "points", "round", "microseconds", "ratio")
"""`seconds`: processor time; `points`: number evaluated together; `ratio`: processor time of an evaluation, in that of
exact inputs."""

EARLIER = "exact inputs, earlier version"
"""Inputs of the runs with the other version."""

RUNS, CALLS = "runs.csv", "calls.csv"

_CHILD = """
import json, os, sys
where, ratings, name, seed = sys.argv[1:]
sys.path.insert(0, where)
import softness_bayes
assert softness_bayes.__file__.startswith(where), softness_bayes.__file__
from softness_bayes.data import read_experiment
try:
    from softness_bayes.sampler.sampling import Settings, walk
    from softness_bayes.tools.benchmark_uncertain import CASES, build
    target = build(read_experiment(ratings), CASES[name]).posterior
except ImportError:  # an earlier version keeps them in other places
    from softness_bayes.inference.sampling import Settings, walk
    from softness_bayes.run import RunOptions, posterior_of
    target = posterior_of(read_experiment(ratings), RunOptions())
begun = os.times()
for state in walk(target, Settings(processes=1, max_steps=20_000), int(seed)):
    pass
seconds, verdict = sum(os.times()[:4]) - sum(begun[:4]), state.verdict
assert verdict.converged
found = {"parameters": len(target.names), "steps": verdict.steps, "tau_steps": f"{verdict.tau.max():.1f}"}
print(json.dumps(found | {"evaluations": state.nonfinite.evaluations, "seconds": f"{seconds:.1f}"}))
"""


def run(where: Path, name: str, seed: int) -> dict[str, object]:
    """Sample until convergence with the source in a directory, in another process; return columns of a row of runs."""
    found = subprocess.run(
        [sys.executable, "-c", _CHILD, str(where.resolve()), str(RATINGS), name, str(seed)],
        stdout=subprocess.PIPE,
        text=True,
        check=True,
        cwd=where,
        env=os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    )
    return dict(json.loads(found.stdout))


def positions(target: TargetDensity) -> Array:
    """Return the positions of half an ensemble after the first stage of the pilot."""
    settings = Settings(ensembles=2, processes=1)
    for state in walk(target, settings, 1):
        if state.steps >= settings.pilot[0]:
            break
    found = state.map.forward(state.ensembles[0].coordinates)  # the walk is in the coordinates of the map
    return found[: len(found) // 2]


def calls(targets: Mapping[str, TargetDensity], rounds: int, each: int) -> list[dict[str, object]]:
    """Return the processor times of evaluations in alternating calls, a row for each target and round."""
    points = {name: positions(target) for name, target in targets.items()}
    found: list[dict[str, object]] = []
    for number in range(rounds):
        spent = {}
        for name, target in targets.items():
            begun = time.process_time()
            for _ in range(each):
                target(points[name])
            spent[name] = (time.process_time() - begun) / each / len(points[name])
        for name, seconds in spent.items():
            ratio = seconds / spent[EXACT]
            timed = {"microseconds": f"{1e6 * seconds:.1f}", "ratio": f"{ratio:.3f}"}
            found.append({"inputs": name, "points": len(points[name]), "round": number, **timed})
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Add the missing runs, and time the calls."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("directory", type=Path, help="directory of the two files; the runs in it are kept")
    parser.add_argument("--seeds", default="1,2,3", help="seeds of the runs, separated by commas")
    parser.add_argument("--rounds", type=int, default=20, help="rounds of alternating calls; 0 keeps those in the file")
    parser.add_argument("--other", type=Path, help="directory with the source of an earlier version")
    options = parser.parse_args(arguments)
    options.directory.mkdir(parents=True, exist_ok=True)
    runs = {name: (HERE, name) for name in CASES}
    if options.other:
        runs = {EARLIER: (options.other, EXACT)} | runs
    done = {(row["inputs"], row["seed"]) for row in rows_of(options.directory / RUNS)}
    for seed in options.seeds.split(","):
        for name, (where, case) in runs.items():
            if (name, seed) not in done:
                row = {"inputs": name, "seed": seed, **run(where, case, int(seed))}
                _write(options.directory / RUNS, RUN_COLUMNS, [row], "a" if done else "w")
                done.add((name, seed))
    if options.rounds:
        experiment = read_experiment(RATINGS)
        targets = {name: build(experiment, of).posterior for name, of in CASES.items()}
        with threadpool_limits(1):  # as in the workers of a run
            timed = calls(targets, options.rounds, 5)
        _write(options.directory / CALLS, CALL_COLUMNS, timed, "w")


def _write(path: Path, columns: Sequence[str], rows: Iterable[Mapping[str, object]], mode: str) -> None:
    with path.open(mode, encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        if mode == "w":
            writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main()
