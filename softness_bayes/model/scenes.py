"""Scenes from named parameters: values in natural units, rate curves of the channels, and fabrics under loads."""

from __future__ import annotations

from collections.abc import Mapping, Sized
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import LEAST_WIDTH, LogNormal, LogUniform, Prior
from softness_bayes.base.ranges import RELATIVE_ERRORS, require_kind, require_mapping
from softness_bayes.data.fabrics import log_sd
from softness_bayes.data.ratings import load_column
from softness_bayes.likelihood.design import LoadErrors
from softness_bayes.model.fingers import box_of_values
from softness_bayes.parameters import declared
from softness_bayes.parameters.choice import parameter_space, require_values
from softness_bayes.parameters.joint import JOINT_LAWS
from softness_bayes.parameters.space import FabricModuli, ParameterSpace
from softness_bayes.touch.accuracy import DRAWS, Draws
from softness_bayes.touch.contact import FabricModulus, Finger, FingerBox, Load
from softness_bayes.touch.neuron.fixed_channels import FixedChannels
from softness_bayes.touch.neuron.membrane import Channels, Membrane
from softness_bayes.touch.neuron.rate_curve import Firing
from softness_bayes.touch.neuron.surface import FiringSurface
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.readings import MENDED, Readings
from softness_bayes.touch.scene import Discretisation, Scene
from softness_bayes.touch.stress_fields import SkinBox

if TYPE_CHECKING:
    from softness_bayes.data import Fabrics

IndexArray = NDArray[np.intp]


def touch_parameters(values: Mapping[str, ArrayLike]) -> TouchParameters:
    """Convert named values in natural units to the parameters of a `Scene`, in SI.

    Parameters
    ----------
    values
        Numbers or arrays of one batch shape, by name; names outside the forward model are ignored. Without
        `SHAPE_PARAMETERS`, the finger is that of the scene; `touch_force` is needed for free touches alone.
    """
    require_mapping("values", values, "usual_values(readings)")
    names = [name for name in TouchParameters._fields if name in values or name not in TouchParameters._field_defaults]
    if missing := [name for name in names if name not in values]:
        raise InputError(f"values: no {missing[0]}, expected all that usual_values(readings) returns")
    return TouchParameters(**{n: np.asarray(values[n], float) * declared.EVERY_PARAMETER[n].si for n in names})


def require_readings(prior_set: str, readings: Readings) -> None:
    """Raise an error for a joint law of priors, which was learnt under the default readings, with other ones.

    Raises
    ------
    InputError
        Naming the reading.
    """
    felt = ("skin_displacement", "pressure", "stress_kernel", "stress_component", "membrane")
    changed = [place for place in felt if getattr(readings, place) != getattr(MENDED, place)]
    if prior_set in JOINT_LAWS and changed:
        raise InputError(
            f"prior set '{prior_set}': it was learnt from recordings under the default reading of {changed[0]}; omit "
            f"--reading, or choose other priors"
        )


def usual_values(
    readings: Readings,
    prior_set: str = "default",
    given: Mapping[str, ArrayLike] | None = None,
    n_fingers: int | None = None,
) -> dict[str, Any]:
    """Return the values of all parameters in natural units: given values, otherwise prior medians.

    Given values may be arrays, for a batch of parameter vectors; they are returned as such. If a number of fingers is
    given, the parameters of compression data are included.

    Raises
    ------
    InputError
        If a given name is unknown, or its value is out of range.
    """
    require_kind("readings", readings, Readings, "Readings, such as Readings() or NAMED_READINGS['printed']")
    require_mapping("given", given or {}, '{"b": 80}')
    require_readings(prior_set, readings)
    many = {name: np.asarray(value, float) for name, value in (given or {}).items() if isinstance(value, Sized)}
    # the ends of an array stand for all of it
    require_values({name: float(values.min()) for name, values in many.items()})
    fixed: Any = {**(given or {}), **{name: float(values.max()) for name, values in many.items()}}
    space = parameter_space(
        fix=fixed,
        prior_set=prior_set,
        skin_displacement=readings.skin_displacement,
        n_fingers=n_fingers,
        membrane=readings.membrane,
        of_errors=declared.ERROR_PARAMETERS.keys() & (given or {}).keys(),
        spreads=declared.ANSWER_PARAMETERS.keys() & (given or {}).keys(),
    )
    return {name: float(value) for name, value in space.values(space.median).items()} | many


curve_of_held = lru_cache(maxsize=8)(FixedChannels)
"""Rate curves of fixed channels, cached because each takes a second to compute."""


def firing_of(
    values: Mapping[str, ArrayLike],
    membrane: Membrane,
    noise: float = 0.0,
    nodes: int = Discretisation().rate_nodes,
) -> Firing:
    """Return the rate curve of the channel multipliers in `values`, or the surface if one is missing or varies.

    Parameters
    ----------
    values
        Named parameters.
    membrane
        Reading of the membrane.
    noise
        Strength of the white-noise current [µA/cm² sqrt(ms)] over which the rate curve is averaged.
    nodes
        Number of exact rates that the curve of fixed channels interpolates.

    Raises
    ------
    InputError
        If a multiplier varies and there is noise, or no surface is stored for the membrane.
    """
    varying = [name for name in Channels._fields if np.ndim(values.get(name, [])) > 0]
    if varying and noise:
        raise InputError(
            "noise needs fixed channel multipliers, because the noise-averaged rate is simulated only once: "
            f"fix {', '.join(varying)}"
        )
    if varying:
        return FiringSurface.load(membrane)
    channels = Channels(*(float(np.asarray(values[name])) for name in Channels._fields))
    return curve_of_held(channels, membrane, noise=noise, nodes=nodes)


def scene_of(
    fabrics: Fabrics,
    loads: tuple[Load, ...],
    values: Mapping[str, ArrayLike],
    readings: Readings,
    fabric: ArrayLike | None = None,
    load: ArrayLike | None = None,
    discretisation: Discretisation = Discretisation(),
    noise: float = 0.0,
    finger: Finger = Finger(),
    moduli: FabricModuli | None = None,
    finger_box: FingerBox | None = None,
    skin_box: SkinBox | None = None,
) -> Scene:
    """Compile the scene of some fabrics under some loads.

    Parameters
    ----------
    fabrics, loads
        Fabrics that are touched, and the loads.
    values
        Named parameters that do not vary. If all channel multipliers are given, they are fixed in the scene; if a
        radius or a depth of the receptors is given, the scene covers these fingers.
    readings
        Readings of the model.
    fabric, load
        Indices of the conditions; by default all pairs.
    discretisation
        Resolution.
    noise
        Strength of the white-noise current, as for `firing_of`.
    finger
        The fingertip that touches.
    moduli
        Moduli of the fabrics, possibly uncertain; by default the measured ones.
    finger_box
        Radii and receptor depths that the scene covers; by default those among `values`.
    skin_box
        Parameters of the skin that most calls have, as `Scene` takes them.
    """
    modulus = fabrics.modulus(readings.fabric_modulus) if moduli is None else np.array(moduli.middle)
    firing = firing_of(values, readings.membrane, noise, discretisation.rate_nodes)
    return Scene(
        modulus,
        fabrics.poisson_ratio,
        loads,
        firing,
        fabric,
        load,
        finger=finger,
        readings=readings,
        discretisation=discretisation,
        modulus_range=None if moduli is None or moduli.known else moduli.extent,
        finger_box=finger_box or box_of_values(values, finger),
        skin_box=skin_box,
    )


_TAILS = np.array([3e-4, 1.0 - 3e-4])  # of the priors, about 3.4 standard deviations of a normal law
_LEAST_SHARE = 0.01  # of the largest value


def skin_of_priors(space: ParameterSpace) -> SkinBox | None:
    """Return the skin's parameters that a run usually meets, in SI; None where its exponent is held at 0."""
    priors = {p.name: p.prior for p in space.sampled}

    def ends(name: str) -> tuple[float, float]:
        low, high = 2 * [space.held[name]] if name in space.held else priors[name].quantile(_TAILS)
        # laws that reach down to 0 have no logarithm there
        low, si = max(float(low), _LEAST_SHARE * float(high)), declared.EVERY_PARAMETER[name].si
        return si * low, si * float(high)

    box = SkinBox(ends("b"), ends("m"))
    return box if min(box.b[0], box.m[0]) > 0.0 else None


def prior_draws(space: ParameterSpace, size: int = DRAWS) -> Draws:
    """Return prior draws at which the errors of a scene are measured, the same for every seed of a run."""
    parameters = space.touch(space.draw_prior(np.random.default_rng(0), size))
    values = space.values(space.median)
    priors = {p.name: p.prior for p in space.sampled}
    usual = all(priors.get(name) == declared.PARAMETERS[name].prior for name in Channels._fields)
    eps = values.get("eps")
    return Draws(parameters.broadcast(size), None if eps is None else float(eps), usual)


def fabric_moduli(
    fabrics: Fabrics, reading: FabricModulus, cv: float | None = None, unknown: Prior = declared.UNKNOWN_MODULUS
) -> FabricModuli:
    """Return the moduli of some fabrics.

    A measured modulus E with relative standard error c is log-normal with median E and sd(log E)² = log(1 + c²). A
    bracket is uniform in the logarithm.

    Parameters
    ----------
    fabrics
        The measured properties and their errors.
    reading
        Formula of the rigidity from tensile modulus and thickness.
    cv
        Relative standard error of measured moduli that state none; None or 0 if these are exact.
    unknown
        Prior law of moduli about which nothing is known [kPa].

    Raises
    ------
    InputError
        If a modulus or the error is out of range.
    """
    if cv is not None:
        RELATIVE_ERRORS.require("modulus_cv", cv)
    middle = fabrics.modulus(reading, unknown=unknown.median * declared.KPA)
    own = fabrics.modulus_cv()
    errors = log_sd(np.where(np.isnan(own), cv or 0.0, own))
    low, high = (side / declared.KPA for side in (fabrics.effective_modulus_low, fabrics.effective_modulus_high))
    laws: list[Prior | None] = []
    for k, basis in enumerate(fabrics.basis):
        if not basis:
            laws.append(unknown)
        elif np.isfinite(low[k]) and np.isnan(fabrics.effective_modulus[k]):
            laws.append(LogUniform(float(low[k]), float(high[k])))
        elif errors[k] > LEAST_WIDTH:
            laws.append(LogNormal(float(middle[k] / declared.KPA), float(errors[k])))
        else:
            laws.append(None)
    return FabricModuli(fabrics.names, tuple(middle.tolist()), tuple(laws), fabrics.batch)


def at_other_loads(stated: Scene, errors: LoadErrors) -> Scene:
    """Return the scene of the lower and higher loads of all touches, in the order of their columns.

    Parameters
    ----------
    stated
        The conditions at their stated loads.
    errors
        Errors of the loads.

    Raises
    ------
    InputError
        If such a load is out of range.
    """
    condition = errors.condition
    every = [
        scaled(stated.loads[load], float(np.exp(node * spread)))
        for node in errors.further
        for load, spread in zip(stated.load[condition], errors.log_sd, strict=True)
    ]
    loads = tuple(dict.fromkeys(every))
    place = {load: k for k, load in enumerate(loads)}
    fabric = np.tile(stated.fabric[condition], len(errors.further))
    return stated.under(loads, fabric, [place[load] for load in every])


def scaled(load: Load, factor: float) -> Load:
    """Return a load of the same kind, multiplied by a factor."""
    _, kind, value = load_column(load)
    return kind(value(load) * factor)
