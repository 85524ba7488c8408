"""Benchmark of estimators of the autocorrelation time, on simulated chains with a known one.

``python -m softness_bayes.tools.benchmark_autocorrelation [FILE.csv]``. A run ends when its slowest quantity has 50
autocorrelation times, so the estimator determines the length of a run. Chains of independent walkers are simulated with
a known autocorrelation time: processes with one time constant, and sums of a fast and a slow process, whose slow part
dominates. For each estimator the table lists the estimate relative to the truth, for one quantity and for the slowest
of several, and the length of a run that ends by this estimator, in true autocorrelation times.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from softness_bayes.sampler.autocorrelation import autocorrelation_time, own_time
from softness_bayes.sampler.diagnostics import Goal, tau_change
from softness_bayes.sampler.schedule import APART

FloatArray = NDArray[np.float64]
Estimator = Callable[[FloatArray], FloatArray]
"""Function from walks of shape (quantities, ensembles, steps, walkers) to a time for each quantity."""

ENSEMBLES, WALKERS, QUANTITIES = 4, 52, 8
"""Size of the walks: that of the main job, with as many independent quantities as its correlated ones amount to."""

GOAL = Goal()
"""The goal of a run."""

LENGTHS = (20, 50, 100)
"""Lengths of the walks, in true times."""

REPLICATES = 12


def _pooled(walks: FloatArray) -> FloatArray:
    return autocorrelation_time(np.concatenate([*np.moveaxis(walks, 1, 0)], axis=-1))


ESTIMATORS: Mapping[str, Estimator] = {
    "each walker's own mean (emcee), worst ensemble": lambda walks: own_time(walks).max(axis=1),
    "mean of an ensemble's walkers, worst ensemble": lambda walks: autocorrelation_time(walks).max(axis=1),
    "mean of the walkers of all ensembles": _pooled,
}
"""The last one is what runs use."""


class Process(NamedTuple):
    """A sum of independent AR(1) processes whose variances add up to 1."""

    times: tuple[float, ...]
    """Autocorrelation time of each [steps]."""
    shares: tuple[float, ...]
    """Variance of each."""

    @property
    def time(self) -> float:
        """Autocorrelation time of the sum [steps]."""
        return float(np.dot(self.times, self.shares))

    def walks(self, rng: np.random.Generator, steps: int) -> FloatArray:
        """Draw stationary walks, shape (quantities, ensembles, steps, walkers)."""
        return np.sum([self._one(rng, steps, *part) for part in zip(self.times, self.shares, strict=True)], axis=0)

    @staticmethod
    def _one(rng: np.random.Generator, steps: int, time: float, share: float) -> FloatArray:
        rho = (time - 1.0) / (time + 1.0)
        noise = rng.standard_normal((QUANTITIES, ENSEMBLES, steps, WALKERS)) * np.sqrt(share * (1.0 - rho**2))
        noise[..., 0, :] /= np.sqrt(1.0 - rho**2)
        return np.asarray(lfilter([1.0], [1.0, -rho], noise, axis=-2))


PROCESSES: Mapping[str, Process] = {
    "one time": Process((12.0,), (1.0,)),
    "quick and slow": Process((6.0, 66.0), (0.9, 0.1)),
}


class Found(NamedTuple):
    """Estimates for walks of one length, divided by the true time."""

    one: float
    """Mean of all quantities."""
    scatter: float
    """Standard deviation between quantities and replicates."""
    slowest: float
    """Mean over the replicates of the slowest quantity."""


def measure(process: Process, lengths: int, estimator: Estimator, replicates: int, seed: int = 1) -> Found:
    """Estimate the autocorrelation time of walks whose length is given in true times."""
    rng = np.random.default_rng(seed)
    steps = round(lengths * process.time)
    said = np.array([estimator(process.walks(rng, steps)) for _ in range(replicates)]) / process.time
    return Found(float(said.mean()), float(said.std()), float(said.max(axis=1).mean()))


def length_at_end(walks: FloatArray, time: float, estimator: Estimator, goal: Goal = GOAL) -> float:
    """Return the length of a walk that ends by the goal's length and stability, in true times; infinite without an end.

    As in a run, the interval between checks is a fraction of the length; the first check is at 0.7 of the goal.
    """
    steps, passed = round(0.7 * goal.lengths * time), 0
    before = np.full(len(walks), np.inf)
    while steps <= walks.shape[-2]:
        said = estimator(walks[..., :steps, :])
        fits = steps >= goal.lengths * said.max() and tau_change(said, before) <= goal.tau_change
        passed = passed + 1 if fits else 0
        if passed == goal.looks:
            return steps / time
        before, steps = said, steps + round(APART * steps)
    return float(np.inf)


COLUMNS = ("walks", "estimator", *(f"at_{n}" for n in LENGTHS), "slowest_at_50", "mean_at_the_end", "least_at_the_end")


def row(name: str, estimator: str, replicates: int = REPLICATES) -> tuple[str, ...]:
    """Return the table row of an estimator for a process."""
    process, of, rng = PROCESSES[name], ESTIMATORS[estimator], np.random.default_rng(2)
    said = [measure(process, n, of, replicates) for n in LENGTHS]
    steps = round(1.8 * GOAL.lengths * process.time)
    at = np.array([length_at_end(process.walks(rng, steps), process.time, of) for _ in range(replicates)])
    each = (f"{one.one:.2f} ± {one.scatter:.2f}" for one in said)
    slowest = said[LENGTHS.index(50)].slowest
    return (name, estimator, *each, f"{slowest:.2f}", f"{at.mean():.1f}", f"{at.min():.1f}")


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, and write it to a CSV file if one is given."""
    parser = argparse.ArgumentParser(description="Compare estimators of the autocorrelation time on known walks.")
    parser.add_argument("file", type=Path, nargs="?", metavar="FILE.csv", help="file to write")
    kept, table = parser.parse_args(arguments).file, [row(*both) for both in product(PROCESSES, ESTIMATORS)]
    for one in (COLUMNS, *table):
        print(" | ".join(one))
    if kept is not None:
        with kept.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([COLUMNS, *table])


if __name__ == "__main__":
    main()
