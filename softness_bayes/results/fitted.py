"""The posterior of a finished run at some of its draws, for predictions of arbitrary touches."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from softness_bayes.data import Fabrics
from softness_bayes.errors import InputError
from softness_bayes.model.build import build
from softness_bayes.model.fabric_moduli import fabric_moduli
from softness_bayes.model.other_touches import OtherTouches
from softness_bayes.model.posterior import Posterior
from softness_bayes.model.scenes import scene_of
from softness_bayes.parameters.choice import require_values
from softness_bayes.parameters.declared import EVERY_PARAMETER
from softness_bayes.parameters.fabric_moduli import FABRIC_MODULUS, KPA, FabricModuli
from softness_bayes.results.from_result import experiment_of, options_of
from softness_bayes.results.stored import Stored
from softness_bayes.touch.contact import Load
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.scene import Scene

Array = NDArray[np.float64]

_SAME = 1e-6  # relative difference of moduli below which a fabric is identified with a rated one


def drawn_values(result: Stored, draws: int, values: Mapping[str, float] | None = None) -> dict[str, Array]:
    """Return evenly spaced draws of every parameter by name, in natural units: numbers for fixed parameters.

    Parameters
    ----------
    result
        The run.
    draws
        Number of draws.
    values
        If any are given, all draws are equal to one point: these values, and posterior medians for all other
        parameters.

    Raises
    ------
    InputError
        If a value is given for a parameter that was not sampled, or is out of range.
    """
    named = result.values(draws)
    if not values:
        return named
    sampled = [name for name, drawn in named.items() if np.ndim(drawn)]
    for name in values:
        if name not in sampled or name not in EVERY_PARAMETER:
            free = ", ".join(one for one in sampled if one in EVERY_PARAMETER)
            raise InputError(f"{name} cannot be set: expected a parameter that the run sampled, one of {free}")
    require_values(values)
    return named | {name: np.full_like(named[name], values.get(name, np.median(named[name]))) for name in sampled}


def moduli_of(result: Stored, fabrics: Fabrics) -> FabricModuli:
    """Return the moduli of some fabrics, unknown ones with the law that the run has for them."""
    unknown = result.provenance.asked.unknown_modulus
    return fabric_moduli(fabrics, result.readings.fabric_modulus, unknown=unknown)


def drawn_moduli(
    result: Stored, named: Mapping[str, Array], fabrics: Fabrics, rng: np.random.Generator
) -> Array | None:
    """Return E_fab [Pa] of each fabric at each draw of `drawn_values`, (draws, fabrics); None if all are known exactly.

    Moduli of rated fabrics come from the posterior; those of other, uncertain fabrics are drawn from their laws.
    """
    moduli, size = moduli_of(result, fabrics), max(np.size(values) for values in named.values())
    drawn: dict[int, Array] = {k: law.draw(rng, size) for k, law in enumerate(moduli.laws) if law is not None}
    for k, known in enumerate(rated_among(result, fabrics)):
        own = named.get(f"{FABRIC_MODULUS}[{fabrics.names[k]}]") if known >= 0 else None
        drawn |= {} if own is None else {k: own}
    if not drawn:
        return None
    found = np.tile(moduli.middle, (size, 1))
    for k, values in drawn.items():
        found[:, k] = values * KPA
    return found


def rated_among(result: Stored, fabrics: Fabrics) -> NDArray[np.intp]:
    """Return the index of each fabric among the rated ones; -1 if none has its name and modulus."""
    rated = result.fabrics
    place = {name: k for k, name in enumerate(rated.names)}
    index = np.array([place.get(name, -1) for name in fabrics.names], np.intp)
    modulus = np.array(moduli_of(result, fabrics).middle)
    same = np.isclose(modulus, rated.effective_modulus[index], rtol=_SAME, atol=0.0)
    return np.where(same, index, -1)


class Fitted:
    """The model of a finished run, rebuilt from the stored result, with draws of its posterior.

    Parameters
    ----------
    result
        The run, on ratings.
    draws
        Number of draws, evenly spaced over the run.
    values
        Values used instead of the draws, as for `drawn_values`.

    Raises
    ------
    InputError
        If the run had no ratings, the result is incomplete, or a value cannot be set.
    """

    def __init__(self, result: Stored, draws: int, values: Mapping[str, float] | None = None) -> None:
        self.result = result
        self.posterior: Posterior = build(experiment_of(result), options_of(result)).posterior
        self.named = drawn_values(result, draws, values)
        drawn = [self.named[name] for name in self.posterior.names]
        self.theta = np.stack(np.broadcast_arrays(*drawn), axis=-1)

    @property
    def touch(self) -> TouchParameters:
        """Parameters of the forward model at the draws [SI], each of shape (draws,)."""
        values = self.posterior.space.touch(self.theta)
        return TouchParameters(*(np.broadcast_to(value, len(self.theta)) for value in values))

    def scene(self, fabrics: Fabrics, loads: tuple[Load, ...]) -> Scene:
        """Return the scene of some fabrics under some loads, with the finger and the readings of the run."""
        result = self.result
        noise, moduli = result.provenance.rating_model.noise, moduli_of(result, fabrics)
        return scene_of(fabrics, loads, self.named, result.readings, noise=noise, finger=result.finger, moduli=moduli)

    def touches(self, fabrics: Fabrics, scene: Scene) -> OtherTouches:
        """Return the touches of a scene with some fabrics, matched to rated ones by `rated_among`."""
        return OtherTouches(self.posterior, scene, rated_among(self.result, fabrics))

    def modulus(self, rng: np.random.Generator, fabrics: Fabrics) -> Array | None:
        """Return E_fab [Pa] of each fabric at each draw, (draws, fabrics); None if all are known, as `drawn_moduli`."""
        return drawn_moduli(self.result, self.named, fabrics, rng)
