"""Comparison of sampler moves on several data sets: ``python -m softness_bayes.tools.benchmark_moves [FILE.csv]``.

Prints, for each set of simulated ratings and each combination of moves, the autocorrelation time of the worst quantity
and the effective draws per second of processor time, including the pilot run, after a fixed number of steps. A run
shorter than the `lengths` of `sampler.diagnostics.Goal` underestimates its autocorrelation times: such values are
marked, and their effective draws are upper limits.

emcee's snooker move is excluded: up to emcee 3.1.6 its acceptance uses half the Jacobian's exponent, so it samples the
wrong distribution.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from softness_bayes.data import Experiment, Fabrics
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.sampler.diagnostics import Goal
from softness_bayes.sampler.moves import FIRST_MOVES, MOVES, STRETCH, Moves
from softness_bayes.sampler.sampling import Settings, walk
from softness_bayes.sampler.starts import TargetDensity
from softness_bayes.touch.contact import Force, Indentation, Load
from softness_bayes.touch.readings import MENDED
from softness_bayes.touch.scene import Discretisation

STEPS, ENSEMBLES = 1200, 2


class Way(NamedTuple):
    """A combination of moves."""

    moves: Moves
    pilot: tuple[int, ...] = ()
    """Stages of the pilot walk that learns a map; without one the moves are made in the sampler's coordinates."""


WAYS: Mapping[str, Way] = {
    "stretch": Way(STRETCH),
    "differential evolution": Way(FIRST_MOVES),
    "half stretch, half differential evolution": Way(
        (*((move, 0.5 * share) for move, share in STRETCH), *((move, 0.5 * share) for move, share in FIRST_MOVES))
    ),
    "stretch in the learnt map": Way(STRETCH, Settings().pilot),
    "differential evolution in the learnt map": Way(FIRST_MOVES, Settings().pilot),
    "default: Student and differential evolution in the learnt map": Way(MOVES, Settings().pilot),
}


class Measured(NamedTuple):
    """Efficiency of a combination of moves."""

    tau: float
    """Longest autocorrelation time [steps] of any quantity in any ensemble."""
    lengths: float
    """Kept steps in that time."""
    ess_per_second: float
    """Effective draws of that quantity for each second of processor time."""


def measure(target: TargetDensity, way: Way, steps: int, seed: int = 1) -> Measured:
    """Sample a fixed number of steps in this process."""
    settings = Settings(
        ensembles=ENSEMBLES,
        processes=1,
        pilot=way.pilot,
        relearning=0,
        moves=way.moves,
        min_steps=steps,
        max_steps=steps,
        goal=Goal(lengths=np.inf),
    )
    states = walk(target, settings, seed)
    next(states)  # all combinations start from the same points
    begun = time.process_time()
    verdict = deque(states, maxlen=1).pop().verdict
    spent = time.process_time() - begun
    assert verdict is not None, "a walk that has ended was looked at"
    draws = ENSEMBLES * verdict.walkers * verdict.lengths
    return Measured(float(verdict.tau.max()), verdict.lengths, draws / spent)


def _posterior(
    moduli: tuple[float, ...], loads: tuple[Load, ...], participants: int, options: ModelOptions, **given: float
) -> Callable[[], TargetDensity]:
    """Return a function that builds the posterior of ratings simulated at the priors' medians with some replaced."""

    def make() -> TargetDensity:
        cloth = Fabrics(tuple(f"F{k}" for k in range(len(moduli))), effective_modulus=np.array(moduli))
        values = usual_values(MENDED, options.prior_set, {"sigma_0": 7.0, **given})
        made = simulate_ratings(np.random.default_rng(1), cloth, loads, values, participants=participants)
        return build(Experiment(made.ratings, cloth, ()), options).posterior

    return make


FINE = ModelOptions(discretisation=Discretisation())
"""The usual model, finely resolved."""

_WIDE, _FEW = tuple(np.geomspace(2e3, 2e6, 12)), (4e4, 1e5, 4e5, 2e6)
_DEPTHS = (Indentation(1e-3), Indentation(2e-3), Indentation(3e-3))

DATA: Mapping[str, Callable[[], TargetDensity]] = {
    "12 fabrics, 3 indentations, 30 raters": _posterior(_WIDE, _DEPTHS, 30, FINE),
    "4 fabrics, 1 indentation, 4 raters": _posterior(_FEW, _DEPTHS[2:], 4, FINE),
    "12 fabrics, 2 forces, 20 raters": _posterior(_WIDE, (Force(1.0), Force(3.0)), 20, FINE),
    "12 fabrics, 3 indentations, 30 raters, in-vivo priors": _posterior(
        _WIDE, _DEPTHS, 30, replace(FINE, prior_set="in-vivo"), sigma_0=3.0
    ),
    "8 fabrics, 3 indentations, 60 precise raters": _posterior(_WIDE[2:10], _DEPTHS, 60, FINE, varsigma=0.1),
}


COLUMNS = ("ratings", "way", "too_short", "tau_steps", "effective_draws_per_second")


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a table for each data set, and write all of them to a CSV file if one is given."""
    parser = argparse.ArgumentParser(description="Compare moves of the sampler on simulated ratings.")
    parser.add_argument("file", type=Path, nargs="?", metavar="FILE.csv", help="file to write")
    kept, rows = parser.parse_args(arguments).file, []
    for data, make in DATA.items():
        target = make()
        print(f"\n{data} ({len(target.names)} parameters):\n")
        print("| way to walk | tau [steps] | effective draws / s |\n|---|---|---|")
        for name, way in WAYS.items():
            found = measure(target, way, STEPS)
            short = found.lengths < Goal().lengths
            tau, draws = f"{found.tau:.0f}", f"{found.ess_per_second:.3g}"
            rows.append((data, name, short, tau, draws))
            print(f"| {name} | {'> ' * short}{tau} | {'< ' * short}{draws} |", flush=True)
    if kept is not None:
        with kept.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows])


if __name__ == "__main__":
    main()
