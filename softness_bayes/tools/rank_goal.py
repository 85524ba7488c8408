"""Ranks from walks as short as those of a calibration, simulated: ``python -m softness_bayes.tools.rank_goal``.

A replicate of ``calibrate`` ends earlier than a run, at the goal ``runs.calibrate.RANKED``. Here walks with a known law
and known autocorrelation times are simulated until they meet this goal, checked as in a run, and a truth drawn from the
law is ranked among draws chosen as in a replicate: ranks must be uniform. All walkers of all ensembles start at the
same place, ten standard deviations away, which no comparison of ensembles can notice. As a negative control, the same
walks end at their first check and keep their start. Writes ``notebooks/results/rank_goal.csv``, from which
``tools.doc_tables`` makes the table of the page on calibration.
"""

from __future__ import annotations

import csv
import io
import math
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from softness_bayes.checking.ranks import DRAWS, Calibration
from softness_bayes.files.whole import write_whole
from softness_bayes.runs.calibrate import ENSEMBLES, RANKED, REPLICATE
from softness_bayes.runs.replicate import independent, ranks
from softness_bayes.sampler.chains import Chains
from softness_bayes.sampler.diagnostics import Goal, Verdict, look
from softness_bayes.sampler.sampling import Sampled
from softness_bayes.sampler.schedule import APART, PARTS

FloatArray = NDArray[np.float64]

TABLE = Path("notebooks/results/rank_goal.csv")

REPLICATES, WALKERS, START = 100, 32, 10.0
"""Walks of each kind, walkers of an ensemble, and the distance of their start in standard deviations."""

WALKS: Mapping[str, tuple[float, ...]] = {"fast": (8.0,), "slow": (60.0,), "fast and slow together": (8.0, 100.0)}
"""Autocorrelation times [steps] of the parts of every quantity; a second part has a fifth of the variance."""

GOALS: Mapping[str, Goal] = {
    "of a replicate": RANKED,
    "first check, start kept": replace(RANKED, lengths=0.0, r_hat=math.inf, ess=0.0, burn_in=0.0),
}
"""The goals by name; the second is the negative control."""

QUANTITIES = ("x1", "x2", "x3")
"""Names of the independent quantities of a walk."""

_CHUNK = 500  # steps simulated at a time
_LONGEST = 20_000


class _Simulated:
    """Walks that can be continued: sums of first-order autoregressive processes with unit total variance."""

    def __init__(self, rng: np.random.Generator, times: tuple[float, ...]) -> None:
        shares = (0.8, 0.2) if len(times) == 2 else (1.0,)
        self._rng, self.values = rng, np.empty((ENSEMBLES, 0, WALKERS, len(QUANTITIES)))
        self._parts = [((tau - 1.0) / (tau + 1.0), math.sqrt(share)) for tau, share in zip(times, shares, strict=True)]
        start = np.full((ENSEMBLES, 1, WALKERS, len(QUANTITIES)), START)
        self._last = [scale * start for _, scale in self._parts]

    def until(self, steps: int) -> FloatArray:
        """Return the values since the start, shape (ensembles, steps, walkers, quantities)."""
        while self.values.shape[1] < steps:
            new = np.zeros((ENSEMBLES, _CHUNK, WALKERS, len(QUANTITIES)))
            for k, (rho, scale) in enumerate(self._parts):
                noise = scale * math.sqrt(1.0 - rho**2) * self._rng.standard_normal(new.shape)
                walked, _ = lfilter([1.0], [1.0, -rho], noise, axis=1, zi=rho * self._last[k])
                self._last[k] = walked[:, -1:]
                new += walked
            self.values = np.concatenate([self.values, new], axis=1)
        return self.values[:, :steps]


def walked(times: tuple[float, ...], goal: Goal, rng: np.random.Generator) -> tuple[FloatArray, Verdict]:
    """Simulate walks until a check finds that they meet a goal, with the checks of a run."""
    simulated, every = _Simulated(rng, times), REPLICATE.round_steps
    steps, before = 3 * every, None
    while True:
        values = simulated.until(steps)
        before = look(QUANTITIES, values, before=before, goal=goal)
        if before.converged or steps >= _LONGEST:
            return values, before
        apart = every // PARTS
        steps = apart * math.ceil(max(steps * (1.0 + APART), steps + apart) / apart)


def ranked(times: tuple[float, ...], goal: Goal, index: int) -> tuple[tuple[int, ...], Verdict]:
    """Return the ranks of a truth among draws of simulated walks, and the verdict at their end."""
    rng = np.random.default_rng(index)
    truth = rng.standard_normal(len(QUANTITIES))
    values, verdict = walked(times, goal, rng)
    chains = Chains(values, values[..., 0], np.zeros((ENSEMBLES, WALKERS)), values.shape[1])
    draws = independent(Sampled(chains, verdict), DRAWS, rng)
    return tuple(map(int, ranks(truth, draws, rng))), verdict


def row(walk: str, goal: str, replicates: int = REPLICATES) -> dict[str, str]:
    """Return the outcome of many walks of one kind: their length, the smallest p-value, and alarms."""
    begun = time.process_time()
    found, verdicts = zip(*(ranked(WALKS[walk], GOALS[goal], index) for index in range(replicates)), strict=True)
    calibration = Calibration(QUANTITIES, np.array(found))
    judged = calibration.judge().values()
    return {
        "goal": goal,
        "walks": walk,
        "times": " and ".join(f"{tau:.0f}" for tau in WALKS[walk]),
        "replicates": str(replicates),
        "steps": f"{np.median([one.steps for one in verdicts]):.0f}",
        "least_p": f"{min(min(one.uniform_p, one.spread_p) for one in judged):.2g}",
        "alarm_below": f"{calibration.threshold:.1g}",
        "alarms": str(len(calibration.faults())),
        "spread": f"{max((one.spread for one in judged), key=lambda spread: abs(spread - 1.0)):.2f}",
        "detectable": f"{calibration.least_width.value:.2f}",
        "seconds": f"{time.process_time() - begun:.0f}",
    }


def measured() -> Iterator[dict[str, str]]:
    """Yield a row for each goal and kind of walk."""
    for goal in GOALS:
        for walk in WALKS:
            yield row(walk, goal)


def main() -> None:
    """Measure and write the table."""
    rows, text = list(measured()), io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_whole(TABLE, text.getvalue().encode())
    sys.stdout.write(text.getvalue())


if __name__ == "__main__":
    main()
