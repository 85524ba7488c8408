"""Numerical errors and cost of the resolutions of a model, and computations that are avoided."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from softness_bayes.model.build import ExperimentModel
from softness_bayes.readable import counted
from softness_bayes.touch.accuracy import (
    QUADRATURES,
    RATE_TERMS,
    TOLERANCES,
    ChosenResolution,
    Errors,
    errors,
    thinned,
)
from softness_bayes.touch.load_field import LoadField
from softness_bayes.touch.neuron.fixed_channels import FixedChannels
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.resolution import Draws, first
from softness_bayes.touch.scene import Discretisation, Scene

BATCH, REPEATS = 64, 12
"""Parameter vectors per timed call, and number of calls; the fastest one is used."""


class Setting(NamedTuple):
    """One setting of one stage, with the other stage as chosen: numerical errors and cost per parameter vector."""

    stage: str
    discretisation: Discretisation
    errors: Errors
    seconds: float
    """Time of the scene for each parameter vector [s]."""
    chosen: bool


def ladder(choice: ChosenResolution, draws: Draws) -> tuple[Setting, ...]:
    """Measure errors and cost of every possible setting."""
    scene, chosen = choice.reference, choice.discretisation
    few = thinned(scene)
    exact = few.total_rate(draws.parameters)
    finest = scene.discretisation.field_tolerance
    every = [("population", replace(chosen, nodes=n, saturation=s)) for n, s in QUADRATURES]
    every += [("field", replace(chosen, field_tolerance=t)) for t in TOLERANCES if t >= finest]
    every += [("firing rates", replace(chosen, rate_terms=terms)) for terms in (*RATE_TERMS, None)]
    found = []
    for stage, d in every:
        error = errors(few.coarser(d).total_rate(draws.parameters), exact, few.n_receptors, draws.eps).worst()
        floor = Errors(*np.full((2,), few.field_error))
        found.append(Setting(stage, d, error.plus(floor), seconds(scene.coarser(d), draws.parameters), d == chosen))
    return tuple(found)


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
    tables = len({id(field.side.of) if isinstance(field, LoadField) else id(field) for field in scene.fields})
    said = [
        "receptors that do not fire: the integral runs from the peak of the stress to the onset of firing, "
        "and stops where the sigmoid is saturated",
        f"{n - loads} of {n} stress fields: conditions under one load differ only in E_star, so one table over "
        f"E_star is enough for {'the load' if loads == 1 else f'each of {loads} loads'}"
        + (f", and these come from {counted(tables, 'table')} over load and E_star" if tables < loads else ""),
    ]
    if scene.n_repeated:
        said.append(f"{scene.n_repeated} of {n} conditions: another fabric with the same properties has the same load")
    if isinstance(scene.firing, FixedChannels):
        said.append("c_Na, c_K, c_L, c_A: fixed, so all parameter vectors share one rate curve")
    if not {*TouchParameters._fields} & {*model.posterior.names}:
        said.append("the whole chain: all its parameters are fixed, so there is one response for all vectors")
    return tuple(said)
