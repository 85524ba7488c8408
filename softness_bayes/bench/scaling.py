"""Scaling of the cost with conditions and batch size, and the sampler's effective draws per second."""

from __future__ import annotations

import time
from collections import deque
from functools import partial
from typing import NamedTuple

import numpy as np

from softness_bayes.bench.subject import BATCH, LOADS, Effort, Subject, quickest
from softness_bayes.sampler.diagnostics import Goal
from softness_bayes.sampler.sampling import Settings, walk
from softness_bayes.touch.resolution import first
from softness_bayes.touch.scene import Scene

BATCHES = (1, 4, 16, 64, 256, 1024)


class Size(NamedTuple):
    """One size of a scene or of a batch."""

    what: str
    size: int
    conditions: int
    batch: int
    seconds: float
    """For each parameter vector."""
    per_condition: float
    """For each vector and condition [s]."""


def scaling(of: Subject, effort: Effort) -> list[Size]:
    """Time larger scenes with the same number of loads, then larger batches of the usual scene."""
    scene, found = of.model.scene, []
    counts = np.unique(np.geomspace(2, effort.most_fabrics, 8).round().astype(int))
    moduli = np.geomspace(scene.modulus.min(), scene.modulus.max(), effort.most_fabrics)
    large = Scene(moduli, 0.3, LOADS, scene.firing, discretisation=scene.discretisation)
    for count in counts.tolist():
        some = np.linspace(0, effort.most_fabrics - 1, count).round().astype(int)
        found.append(_size("conditions", large.take(np.flatnonzero(np.isin(large.fabric, some))), BATCH, of, effort))
    found += [_size("batch", scene, batch, of, effort) for batch in BATCHES if batch <= effort.most_vectors]
    return found


def _size(what: str, scene: Scene, batch: int, of: Subject, effort: Effort) -> Size:
    n = scene.n_conditions
    some = first(of.draws.parameters, batch)
    # the largest scenes take a second per call
    repeats = max(2, min(effort.repeats, int(effort.repeats * 5e3 / (n * batch))))
    spent = quickest(partial(scene.total_rate, some), repeats) / batch
    return Size(what, n if what == "conditions" else batch, n, batch, spent, spent / n)


class SamplerSpeed(NamedTuple):
    """Speed of the sampler in one process."""

    steps: int
    tau: float
    """Longest autocorrelation time of any quantity [steps]."""
    lengths: float
    """Kept steps in that time."""
    seconds: float
    """Processor time."""
    ess: float
    ess_per_second: float
    """Effective draws of the worst quantity for each second, the learning of the moves included."""


def sampler(of: Subject, effort: Effort) -> SamplerSpeed | None:
    """Time a fixed number of sampler steps on the posterior of simulated ratings."""
    if not effort.sampler_steps:
        return None
    steps = effort.sampler_steps
    forever = Goal(lengths=np.inf)
    settings = Settings(ensembles=2, processes=1, relearning=0, min_steps=steps, max_steps=steps, goal=forever)
    begun = time.process_time()
    state = deque(walk(of.model.posterior, settings, 1), maxlen=1).pop()
    spent = time.process_time() - begun
    verdict = state.verdict
    assert verdict is not None, "a walk that has ended was looked at"
    ess = settings.ensembles * verdict.walkers * verdict.lengths
    return SamplerSpeed(steps, float(verdict.tau.max()), verdict.lengths, spent, ess, ess / spent)
