"""The posterior of a finished run at some of its draws, for touches that need not have been rated."""

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
from softness_bayes.parameters.fabric_moduli import FABRIC_MODULUS, KPA
from softness_bayes.results.from_result import experiment_of, options_of
from softness_bayes.results.stored import Stored
from softness_bayes.touch.contact import Load
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.scene import Scene

Array = NDArray[np.float64]

_SAME = 1e-6  # relative difference of moduli below which a fabric is the one that was rated


def drawn_values(result: Stored, draws: int, values: Mapping[str, float] | None = None) -> dict[str, Array]:
    """Return evenly spaced draws of every parameter by name, in natural units: numbers of those that the run held.

    Parameters
    ----------
    result
        The run.
    draws
        Number of draws.
    values
        If any are given, every draw is one point: these values, and the posterior medians of all others.

    Raises
    ------
    InputError
        If a value is of a parameter that the run did not sample, or out of its range.
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


class Fitted:
    """The model of a finished run, made anew from what the run stores, and draws of its posterior.

    Parameters
    ----------
    result
        The run, on ratings.
    draws
        Number of draws, evenly spaced over the run.
    values
        Values in place of the draws, as `drawn_values` takes them.

    Raises
    ------
    InputError
        If the run had no ratings, or lacks what its model is made from, or a value cannot be set.
    """

    def __init__(self, result: Stored, draws: int, values: Mapping[str, float] | None = None) -> None:
        self.result = result
        self.posterior: Posterior = build(experiment_of(result), options_of(result)).posterior
        self.named = drawn_values(result, draws, values)
        drawn = [self.named[name] for name in self.posterior.names]
        self.theta = np.stack(np.broadcast_arrays(*drawn), axis=-1)

    @property
    def touch(self) -> TouchParameters:
        """The chain's parameters at the draws [SI], each of shape (draws,)."""
        values = self.posterior.space.touch(self.theta)
        return TouchParameters(*(np.broadcast_to(value, len(self.theta)) for value in values))

    def scene(self, fabrics: Fabrics, loads: tuple[Load, ...]) -> Scene:
        """Return the scene of some fabrics under some loads, with the finger and the readings of the run."""
        result = self.result
        noise = result.provenance.rating_model.noise
        return scene_of(fabrics, loads, self.named, result.readings, noise=noise, finger=result.finger)

    def touches(self, fabrics: Fabrics, scene: Scene) -> OtherTouches:
        """Return the touches of a scene of some fabrics, of which those of `known` were rated."""
        return OtherTouches(self.posterior, scene, self.known(fabrics))

    def known(self, fabrics: Fabrics) -> NDArray[np.intp]:
        """Return each fabric's index among those that were rated, -1 where none has its name and its modulus."""
        rated = self.result.fabrics
        place = {name: k for k, name in enumerate(rated.names)}
        index = np.array([place.get(name, -1) for name in fabrics.names], np.intp)
        modulus = fabrics.modulus(self.result.readings.fabric_modulus)
        same = np.isclose(modulus, rated.effective_modulus[index], rtol=_SAME, atol=0.0)
        return np.where(same, index, -1)

    def modulus(self, rng: np.random.Generator, fabrics: Fabrics) -> Array | None:
        """Return E_fab [Pa] of each fabric at each draw, (draws, fabrics); None if all are known exactly.

        Of fabrics that were rated it is that of the posterior; of others with errors of their own it is drawn.
        """
        moduli, size = fabric_moduli(fabrics, self.result.readings.fabric_modulus), len(self.theta)
        drawn: dict[int, Array] = {k: law.draw(rng, size) for k, law in enumerate(moduli.laws) if law is not None}
        for k, known in enumerate(self.known(fabrics)):
            own = self.named.get(f"{FABRIC_MODULUS}[{fabrics.names[k]}]") if known >= 0 else None
            drawn |= {} if own is None else {k: own}
        if not drawn:
            return None
        found = np.tile(moduli.middle, (size, 1))
        for k, values in drawn.items():
            found[:, k] = values * KPA
        return found
