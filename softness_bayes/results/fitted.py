"""Data, options and model of a finished run, restored from its result alone, with draws of its posterior."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.data import Fabrics
from softness_bayes.data.ratings import FREE_TOUCH
from softness_bayes.likelihood.scales import name_of_scale
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.posterior import Posterior
from softness_bayes.model.prediction import OtherTouches
from softness_bayes.model.scenes import fabric_moduli, scene_of
from softness_bayes.parameters import joint
from softness_bayes.parameters.choice import require_values
from softness_bayes.parameters.declared import EVERY_PARAMETER, FABRIC_MODULUS, KPA
from softness_bayes.parameters.space import FabricModuli
from softness_bayes.results.data_groups import experiment_of
from softness_bayes.results.run_options import Request
from softness_bayes.results.stored import Stored
from softness_bayes.touch.contact import Load
from softness_bayes.touch.neuron.membrane import Channels
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.scene import Discretisation, Scene

Array = NDArray[np.float64]

_SAME = 1e-6  # relative difference of moduli below which a fabric is identified with a rated one


def moduli_of(result: Stored, fabrics: Fabrics) -> FabricModuli:
    """Return the moduli of some fabrics, unknown ones with the law that the run has for them."""
    unknown = result.provenance.asked.unknown_modulus
    return fabric_moduli(fabrics, result.readings.fabric_modulus, unknown=unknown)


def rated_among(result: Stored, fabrics: Fabrics) -> NDArray[np.intp]:
    """Return the index of each fabric among the rated ones; -1 if none has its name and modulus."""
    rated, modulus = result.fabrics, np.array(moduli_of(result, fabrics).middle)
    return same_fabrics(fabrics.names, modulus, rated.names, rated.effective_modulus)


def same_fabrics(names: Sequence[str], modulus: Array, among: Sequence[str], their_modulus: Array) -> NDArray[np.intp]:
    """Return the index of each fabric among others by name and modulus [Pa]; -1 for none."""
    place = {name: k for k, name in enumerate(among)}
    index = np.array([place.get(name, -1) for name in names], np.intp)
    return np.where(np.isclose(modulus, their_modulus[index], rtol=_SAME, atol=0.0) & (index >= 0), index, -1)


class Fitted:
    """The model of a finished run, rebuilt from the stored result, with draws of its posterior.

    Parameters
    ----------
    result
        The run, on ratings.
    draws
        Number of draws, evenly spaced over the run.
    values
        If any are given, all draws are equal to one point: these values in natural units, by name, and posterior
        medians for all other sampled parameters.

    Raises
    ------
    InputError
        If the run had no ratings, the result is incomplete, or a value is given for a parameter that was not sampled
        or is out of range.
    """

    def __init__(self, result: Stored, draws: int, values: Mapping[str, float] | None = None) -> None:
        self.result = result
        self.named: dict[str, Array] = result.values(draws)
        """Every parameter by name, in natural units: draws, or a number if it was fixed."""
        if values:
            sampled = [name for name, drawn in self.named.items() if np.ndim(drawn)]
            free = [name for name in sampled if name in EVERY_PARAMETER]
            for name in values:
                if name not in free:
                    known = ", ".join(free)
                    raise InputError(f"{name} cannot be set: expected a parameter that the run sampled, one of {known}")
            require_values(values)
            self.named |= {
                name: np.full_like(self.named[name], values.get(name, np.median(self.named[name]))) for name in sampled
            }
        self.model = build(experiment_of(result), options_of(result))
        """The model of the run's experiment."""
        self.posterior: Posterior = self.model.posterior
        drawn = [self.named[name] for name in self.posterior.names]
        self.theta = np.stack(np.broadcast_arrays(*drawn), axis=-1)

    @property
    def touch(self) -> TouchParameters:
        """Parameters of the forward model at the draws [SI], each of shape (draws,)."""
        return self.posterior.space.touch(self.theta).broadcast(len(self.theta))

    def scene(self, fabrics: Fabrics, loads: tuple[Load, ...], discretisation: Discretisation | None = None) -> Scene:
        """Return the scene of some fabrics under some loads, with the finger and the readings of the run.

        Its resolution is that of the run unless another is given.

        Raises
        ------
        InputError
            If the run has free touches, of unknown force, and the loads are others.
        """
        if FREE_TOUCH in self.result.loads and {*loads} != {FREE_TOUCH}:
            raise InputError(
                "loads: people touched freely in this run, with an unknown force, so that it predicts only such "
                "touches; omit the loads"
            )
        return scene_of(
            fabrics,
            loads,
            self.named,
            self.result.readings,
            discretisation=discretisation or self.posterior.scene.discretisation,
            noise=self.result.provenance.rating_model.noise,
            finger=self.result.finger,
            moduli=moduli_of(self.result, fabrics),
        )

    def touches(self, fabrics: Fabrics, scene: Scene) -> OtherTouches:
        """Return the touches of a scene with some fabrics, matched to rated ones by `rated_among`."""
        return OtherTouches(self.posterior, scene, rated_among(self.result, fabrics), self.result.scale)

    def modulus(self, rng: np.random.Generator, fabrics: Fabrics) -> Array | None:
        """Return E_fab [Pa] of each fabric at each draw, (draws, fabrics); None if all are known exactly.

        Moduli of rated fabrics come from the posterior; those of other, uncertain fabrics are drawn from their laws, as
        is the factor of a batch of which none was rated.
        """
        moduli, size = moduli_of(self.result, fabrics), len(self.theta)
        drawn = {k: law.draw(rng, size) for k, law in enumerate(moduli.laws) if law is not None}
        batch, own = [*fabrics.batch], self.model.moduli
        for k, rated in enumerate(rated_among(self.result, fabrics)):
            batch[k] = own.batch[rated] if rated >= 0 else batch[k]
            name = f"{FABRIC_MODULUS}[{fabrics.names[k]}]"
            if rated >= 0 and name in self.named:
                drawn[k] = self.named[name]
        if not drawn and not own.factors:
            return None
        found = np.tile(moduli.middle, (size, 1))
        for k, values in drawn.items():
            found[:, k] = values * KPA
        return found * own.factor(self.named, batch, rng)


def options_of(result: Stored) -> ModelOptions:
    """Return the options of the model from which a result was sampled, with all its priors and fixed values."""
    constant, priors, asked = result.group("constant_data"), result.provenance.priors, Request.of(result).model
    jointly = {*joint.NAMES, *Channels._fields} if asked.prior_set in joint.JOINT_LAWS else set()
    return replace(
        asked,
        fix={name: float(constant[name]) for name in EVERY_PARAMETER if name in constant and name not in jointly},
        priors={name: priors[name] for name in EVERY_PARAMETER if name in priors and name not in jointly},
    )


def differences(results: dict[str, Stored]) -> dict[str, str]:
    """Return, for each result, the readings, scale, direction, priors and fixed values in which its model differs."""
    models = {label: _model(result) for label, result in results.items()}
    every = dict.fromkeys(key for model in models.values() for key in model)
    apart = [key for key in every if len({model.get(key, "–") for model in models.values()}) > 1]
    return {label: ", ".join(f"{key}={model.get(key, '–')}" for key in apart) for label, model in models.items()}


def _model(result: Stored) -> dict[str, str]:
    """Return the choices of a model in words, by name."""
    options = options_of(result)
    told = ("readings", "scale", "direction", "priors", "prior_set", "fix")
    chosen = {
        **options.readings.names,
        "ratings": name_of_scale(options.scale),
        **({"direction": result.provenance.direction.direction.name} if result.has_ratings else {}),
        **{name: str(prior) for name, prior in options.priors.items()},
        **{name: f"{np.format_float_positional(value, 6, trim='-')}" for name, value in options.fix.items()},
        **{name: text for name, text in options.changed().items() if name not in (*told, "discretisation", "decided")},
    }
    return chosen | ({"compression": result.provenance.plate.digest_compression[:8]} if result.has_compression else {})
