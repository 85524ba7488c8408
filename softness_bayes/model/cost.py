"""Numerical errors and cost of the resolutions of a model, and computations that are avoided."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np

from softness_bayes.model.build import ExperimentModel
from softness_bayes.readable import counted
from softness_bayes.touch.accuracy import PRESETS, ChosenResolution, Draws, first, measured
from softness_bayes.touch.neuron.fixed_channels import FixedChannels
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.scene import Scene

BATCH, REPEATS = 64, 12
"""Parameter vectors per timed call, and number of calls; the fastest one is used."""


class Setting(NamedTuple):
    """One resolution, with its numerical errors and cost per parameter vector."""

    resolution: ChosenResolution
    seconds: float
    """Time of the scene for each parameter vector [s]."""
    chosen: bool


def ladder(scene: Scene, draws: Draws) -> tuple[Setting, ...]:
    """Measure errors and cost of a scene at every preset."""
    found = (measured(scene.at_resolution(preset), draws) for preset in PRESETS)
    return tuple(
        Setting(one, seconds(one.scene, draws.parameters), one.discretisation == scene.discretisation) for one in found
    )


def seconds(scene: Scene, parameters: TouchParameters, batch: int = BATCH, repeats: int = REPEATS) -> float:
    """Return the time [s] per parameter vector that a scene takes for a batch on one core."""
    from threadpoolctl import threadpool_limits

    some = first(parameters, batch)
    taken = []
    with threadpool_limits(1):
        for _ in range(repeats):
            begun = time.perf_counter()
            scene.total_rate(some)
            taken.append(time.perf_counter() - begun)
    return min(taken) / np.size(some.alpha)


def left_out(model: ExperimentModel) -> tuple[str, ...]:
    """Return the computations that the evaluation of a model avoids, with the reasons."""
    scene = model.scene
    n, loads = scene.n_conditions, np.unique(scene.load).size
    tables = len({id(table) for table in scene.tables.values()})
    said = [
        "receptors that do not fire: the integral runs from the peak of the stress to the onset of firing, "
        "and stops where the sigmoid is saturated",
        f"{n - loads} of {n} stress fields: conditions under one load differ only in E_star, so one table over "
        f"E_star is enough for {'the load' if loads == 1 else f'each of {loads} loads'}"
        + (f", and these come from {counted(tables, 'table')} over load and E_star" if tables < loads else ""),
    ]
    if isinstance(scene.firing, FixedChannels):
        said.append("c_Na, c_K, c_L, c_A: fixed, so all parameter vectors share one rate curve")
    if not {*TouchParameters._fields} & {*model.posterior.names}:
        said.append("the whole chain: all its parameters are fixed, so there is one response for all vectors")
    return tuple(said)
