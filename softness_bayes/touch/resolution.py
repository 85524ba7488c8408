"""Resolution of a scene for a required accuracy, chosen by errors at given parameter vectors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.ranges import ACCURACIES
from softness_bayes.touch.accuracy import (
    COARSEST,
    FIELD_SHARE,
    RATES_SHARE,
    ChosenResolution,
    Errors,
    choose,
    errors,
    held_rates,
    references,
    sampled_rates,
    thinned,
)
from softness_bayes.touch.firing_sample import FiringSample
from softness_bayes.touch.neuron.surface import FiringSurface
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.scene import Discretisation, Scene

Array = NDArray[np.float64]

DRAWS = 256
"""Number of parameter vectors at which errors are measured."""

EXACT_DRAWS = 16
"""Number of these for which exact rate curves are computed if none are stored, which takes a second or two."""


class Draws(NamedTuple):
    """Parameter vectors at which errors are measured, with the source of exact rates for each."""

    parameters: TouchParameters
    """Shape (vectors,)."""
    eps: float | None
    """eps, added to N/N_ref in the logarithm [Hz] (its median if it varies); None if there is no logarithm."""
    usual_channels: bool
    """True if all channel multipliers vary under their default priors."""

    def firing(self, scene: Scene) -> Errors:
        """Return the error of a scene's firing-rate surface."""
        assert isinstance(scene.firing, FiringSurface)
        kept = FiringSample.load(scene.firing.design.membrane) if self.usual_channels else None
        if kept is not None:
            return sampled_rates(scene, kept, kept.put_into(self.parameters), self.eps)
        return sampled_rates(scene, scene.firing.exact(), first(self.parameters, EXACT_DRAWS), self.eps)


def given_draws(values: Mapping[str, ArrayLike], parameters: TouchParameters) -> Draws:
    """Return the parameter vectors of a command that evaluates the model only at these."""
    shape = np.broadcast_shapes(*(np.shape(v) for v in parameters), (1,))
    eps = float(np.median(np.asarray(values["eps"], float))) if "eps" in values else None
    whole = TouchParameters(*(np.broadcast_to(v, shape) for v in parameters))
    return Draws(first(whole, min(DRAWS, shape[0])), eps, False)


def resolution_for(compiled: Callable[[Discretisation], Scene], draws: Draws, accuracy: float) -> ChosenResolution:
    """Return the cheapest discretisation of a scene that meets an accuracy, and the reason for the choice.

    Parameters
    ----------
    compiled
        Function that compiles the scene for a discretisation.
    draws
        Parameter vectors at which errors are measured.
    accuracy
        Bound on the error of the response, relative to its peak and in log(N/N_ref + eps).

    Raises
    ------
    InputError
        If the scene cannot reach it.
    """
    return _chosen(compiled, draws, accuracy, accuracy)


def scene_with_accuracy(
    compiled: Callable[[Discretisation], Scene], draws: Draws, accuracy: float, least: Discretisation = Discretisation()
) -> tuple[Scene, ChosenResolution]:
    """Return the scene for given parameter vectors, no coarser than `least`, and the reason for its discretisation.

    A scene that is evaluated only once gains nothing from a coarse discretisation.

    Raises
    ------
    InputError
        If the scene cannot reach the accuracy.
    """
    choice = _chosen(compiled, draws, accuracy, min(accuracy, least.field_tolerance / FIELD_SHARE), least)
    return compiled(choice.discretisation), choice


def _chosen(
    compiled: Callable[[Discretisation], Scene],
    draws: Draws,
    accuracy: float,
    reference: float,
    least: Discretisation = COARSEST,
) -> ChosenResolution:
    """Choose among the settings of a scene compiled for the accuracy `reference`."""
    ACCURACIES.require("accuracy", accuracy)
    scenes: list[Scene] = []
    for setting in references(reference):
        scenes.append(compiled(setting))
        rates = held_rates(scenes[-1])
        if enough := rates.largest <= RATES_SHARE * accuracy:
            break
    scene = scenes[-1]
    if isinstance(scene.firing, FiringSurface):
        rates = draws.firing(scene)
    elif not enough:
        # the bound holds at every rate, even irrelevant ones; the actual difference between the curves matters
        one, other = (thinned(s).total_rate(draws.parameters) for s in scenes)
        rates = errors(one, other, scene.n_receptors, draws.eps).worst()
    return choose(scene, draws.parameters, accuracy, draws.eps, rates, least)


def first(parameters: TouchParameters, size: int) -> TouchParameters:
    """Return the first `size` parameter vectors, repeated cyclically if there are too few."""
    return TouchParameters(*(np.resize(value, (size,)) for value in parameters))
