"""Plan of a model's evaluation: resolution for an accuracy, its errors and cost, and computations that are saved."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.model.posterior import Posterior
from softness_bayes.parameters.declared import PARAMETERS
from softness_bayes.parameters.space import ParameterSpace
from softness_bayes.ranges import ACCURACIES
from softness_bayes.runs.run import RunOptions
from softness_bayes.touch.accuracy import (
    COARSEST,
    QUADRATURES,
    RATES_SHARE,
    TOLERANCES,
    Choice,
    Errors,
    choose,
    errors,
    held_rates,
    references,
    sampled_rates,
    thinned,
)
from softness_bayes.touch.firing_sample import FiringSample
from softness_bayes.touch.neuron.fixed_channels import FixedChannels
from softness_bayes.touch.neuron.membrane import Channels
from softness_bayes.touch.neuron.surface import FiringSurface
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.scene import Discretisation, Scene

Array = NDArray[np.float64]

DRAWS = 256
"""Prior draws at which errors are measured; the same for every seed of a run."""

EXACT_DRAWS = 16
"""Those of them whose exact rate curves are made where none are kept, which takes a second or two."""

BATCH, REPEATS = 64, 12
"""Parameter vectors in a timed call, and number of calls, of which the fastest counts."""


class Draws(NamedTuple):
    """Parameter vectors that errors are measured at, and how the rates of each one are known exactly."""

    parameters: TouchParameters
    """Shape (vectors,)."""
    eps: float | None
    """What is added to N/N_ref in the logarithm [Hz], the median where it varies; None where there is no logarithm."""
    usual_channels: bool
    """Whether all channel multipliers vary, under the priors that they have unless others are asked for."""

    def firing(self, scene: Scene) -> Errors:
        """Return the error of a scene's firing-rate surface."""
        assert isinstance(scene.firing, FiringSurface)
        kept = FiringSample.load(scene.firing.design.membrane) if self.usual_channels else None
        if kept is not None:
            return sampled_rates(scene, kept, kept.put_into(self.parameters), self.eps)
        return sampled_rates(scene, scene.firing.exact(), _first(self.parameters, EXACT_DRAWS), self.eps)


def prior_draws(space: ParameterSpace, size: int = DRAWS, seed: int = 0) -> Draws:
    """Return draws of a prior, the same for every run."""
    parameters = space.touch(space.draw_prior(np.random.default_rng(seed), size))
    values = space.values(space.median)
    priors = {p.name: p.prior for p in space.sampled}
    usual = all(priors.get(name) == PARAMETERS[name].prior for name in Channels._fields)
    eps = values.get("eps")
    whole = TouchParameters(*(np.broadcast_to(value, (size,)) for value in parameters))
    return Draws(whole, None if eps is None else float(eps), usual)


def given_draws(values: Mapping[str, ArrayLike], parameters: TouchParameters) -> Draws:
    """Return the parameter vectors of a command that evaluates only these."""
    shape = np.broadcast_shapes(*(np.shape(v) for v in parameters), (1,))
    eps = float(np.median(np.asarray(values["eps"], float))) if "eps" in values else None
    whole = TouchParameters(*(np.broadcast_to(v, shape) for v in parameters))
    return Draws(_first(whole, min(DRAWS, shape[0])), eps, False)


def with_accuracy(
    posterior: Callable[[RunOptions], Posterior], options: RunOptions, accuracy: float
) -> tuple[RunOptions, Choice]:
    """Return the options with the cheapest discretisation of a given accuracy, and the record of the choice.

    Parameters
    ----------
    posterior
        Makes the model of some options.
    options
        What is asked for; their discretisation is replaced.
    accuracy
        Bound of the response's error, relative to its peak and in log(N/N_ref + eps), over draws of the prior.

    Raises
    ------
    InputError
        If the model cannot reach it.
    """
    made: list[Posterior] = []

    def compiled(discretisation: Discretisation) -> Scene:
        made.append(posterior(replace(options, discretisation=discretisation)))
        return scene_in(made[-1])

    choice = _chosen(compiled, lambda: prior_draws(made[-1].space), accuracy, accuracy)
    return replace(options, discretisation=choice.discretisation, accuracy=accuracy), choice


def scene_with_accuracy(
    compiled: Callable[[Discretisation], Scene], draws: Draws, accuracy: float, least: Discretisation = Discretisation()
) -> tuple[Scene, Choice]:
    """Return the scene of given parameter vectors, no coarser than `least`, and how its discretisation was chosen.

    What is evaluated once saves nothing by being coarse.

    Raises
    ------
    InputError
        If the scene cannot reach the accuracy.
    """
    choice = _chosen(compiled, lambda: draws, accuracy, min(accuracy, 1e2 * least.field_tolerance), least)
    return compiled(choice.discretisation), choice


def _chosen(
    compiled: Callable[[Discretisation], Scene],
    draws: Callable[[], Draws],
    accuracy: float,
    reference: float,
    least: Discretisation = COARSEST,
) -> Choice:
    """Choose among settings of a scene that is compiled for the accuracy `reference`; draws are asked for after it."""
    ACCURACIES.require("accuracy", accuracy)
    scenes: list[Scene] = []
    for setting in references(reference):
        scenes.append(compiled(setting))
        rates = held_rates(scenes[-1])
        if enough := rates.largest <= RATES_SHARE * accuracy:
            break
    at, scene = draws(), scenes[-1]
    if isinstance(scene.firing, FiringSurface):
        rates = at.firing(scene)
    elif not enough:
        # the bound holds at every rate, also at those that hardly count: what two curves differ by counts
        one, other = (thinned(s).total_rate(at.parameters) for s in scenes)
        rates = errors(one, other, scene.n_receptors, at.eps).worst()
    return choose(scene, at.parameters, accuracy, at.eps, rates, least)


def scene_in(posterior: Posterior) -> Scene:
    """Return the compiled scene of a model.

    Raises
    ------
    TypeError
        If it has another forward model.
    """
    if not isinstance(posterior.scene, Scene):
        raise TypeError("an accuracy is chosen for a compiled scene")
    return posterior.scene


class Setting(NamedTuple):
    """One setting of one stage, the other stage as chosen: its errors and what a parameter vector costs."""

    stage: str
    discretisation: Discretisation
    errors: Errors
    seconds: float
    """For each parameter vector."""
    chosen: bool


def ladder(choice: Choice, draws: Draws) -> tuple[Setting, ...]:
    """Measure errors and cost of every possible setting."""
    scene, chosen = choice.reference, choice.discretisation
    few = thinned(scene)
    exact = few.total_rate(draws.parameters)
    finest = scene.discretisation.field_tolerance
    every = [("population", replace(chosen, nodes=n, saturation=s)) for n, s in QUADRATURES]
    every += [("field", replace(chosen, field_tolerance=t)) for t in TOLERANCES if t >= finest]
    found = []
    for stage, d in every:
        error = errors(few.coarser(d).total_rate(draws.parameters), exact, few.n_receptors, draws.eps).worst()
        floor = Errors(*np.full((2,), few.field_error))
        found.append(Setting(stage, d, error.plus(floor), seconds(scene.coarser(d), draws.parameters), d == chosen))
    return tuple(found)


def seconds(scene: Scene, parameters: TouchParameters, batch: int = BATCH, repeats: int = REPEATS) -> float:
    """Return the time [s] that a scene takes for each parameter vector of a batch, on one core."""
    from threadpoolctl import threadpool_limits

    some = _first(parameters, batch)
    taken = []
    with threadpool_limits(1):
        for _ in range(repeats):
            begun = time.perf_counter()
            scene.total_rate(some)
            taken.append(time.perf_counter() - begun)
    return min(taken) / np.size(some.alpha)


def left_out(posterior: Posterior) -> tuple[str, ...]:
    """Return the computations that a model's evaluation saves, with the reasons."""
    scene, held = scene_in(posterior), posterior.space.held
    n, loads = scene.n_conditions, np.unique(scene.load).size
    said = [
        "receptors that do not fire: the integral runs from the peak of the stress to where firing starts, and ends "
        "where the sigmoid has saturated",
        f"{n - loads} of {n} stress fields: conditions under one load differ in E_star alone, so that one table over "
        f"E_star serves each of {loads} loads",
    ]
    if scene.n_repeated:
        said.append(f"{scene.n_repeated} of {n} conditions: their fabrics are others' equals under the same load")
    if isinstance(scene.firing, FixedChannels):
        said.append("c_Na, c_K, c_L, c_A: held, so that all parameter vectors share one rate curve")
    if all(name in held for name in TouchParameters._fields):
        said.append("the chain itself: all its parameters are held, so that there is one response for all vectors")
    return tuple(said)


def _first(parameters: TouchParameters, size: int) -> TouchParameters:
    """Return the first parameter vectors, again and again if there are too few."""
    return TouchParameters(*(np.resize(value, (size,)) for value in parameters))
