"""Reach of the model: share of touches with firing receptors and a valid contact geometry, and how to increase it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.base.readable import percent
from softness_bayes.data import Fabrics
from softness_bayes.data.ratings import FREE_TOUCH
from softness_bayes.model.build import COARSE, ExperimentModel
from softness_bayes.model.scenes import scene_of, touch_parameters, usual_values
from softness_bayes.parameters.declared import EVERY_PARAMETER, SHAPE_PARAMETERS, TOUCH_FORCE
from softness_bayes.parameters.space import FabricModuli
from softness_bayes.touch.contact import HERTZ_LIMIT, Finger, Force, FreeTouch, Indentation, Load, Loads
from softness_bayes.touch.neuron.membrane import Channels
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.readings import Readings
from softness_bayes.touch.scene import Scene

Array = NDArray[np.float64]

MOST = 0.5
"""Share of touches outside the reach from which a note is given."""

MOST_NAMED = 4
"""Largest number of loads that are named one by one."""

GAIN = 0.1
"""Smallest gain in the share within reach for which a change is recommended."""

DEEP = 0.75
"""Indentation, in radii of the fingertip, from which the geometry is considered invalid."""

OTHER_LOADS: Mapping[type, tuple[Load, ...]] = {
    Force: tuple(map(Force, (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0))),
    Indentation: tuple(map(Indentation, (0.5e-3, 1e-3, 1.5e-3, 2e-3, 3e-3))),
}
"""Loads of each kind that are tried as alternatives."""

SKINS = ("default", "in-vivo")
"""Sets of priors whose skin is tried as an alternative."""


class Reach(NamedTuple):
    """Shares of draws and touches outside the reach, overall and by touch, shape (touches,)."""

    silent: Array
    """No receptor fires."""
    questionable: Array
    """The contact radius exceeds `HERTZ_LIMIT` R."""
    meaningless: Array
    """The contact radius is R or more, or the indentation is `DEEP` R or more."""
    within: Array
    """Receptors fire and the geometry is valid."""


def reach(scene: Scene, parameters: TouchParameters) -> Reach:
    """Return the reach of the model for every touch of a scene.

    Parameters
    ----------
    scene
        Fabrics under loads.
    parameters
        One parameter vector, or draws, shape (draws,).
    """
    contact, radius = scene.contact(parameters), scene.fingertip(parameters).radius
    silent = scene.total_rate(parameters) <= 0
    extent = contact.radius / radius
    beyond = (extent >= 1.0) | (contact.indentation >= DEEP * radius)
    found = (silent, extent > HERTZ_LIMIT, beyond, ~silent & ~beyond)
    return Reach(*(np.mean(np.atleast_2d(each), axis=0) for each in found))


def reach_note(
    scene_under: Callable[[Sequence[Load]], Scene],
    loads: Sequence[Load],
    parameters: TouchParameters,
    others: Mapping[str, TouchParameters],
) -> str:
    """Describe the share of touches outside the model's reach and possible remedies; empty if there is no problem.

    Parameters
    ----------
    scene_under
        Function that returns the scene of all fabrics under some loads.
    loads
        The requested loads.
    parameters
        One parameter vector, or draws.
    others
        Alternative skins, by the option that selects them.
    """
    scene = scene_under(loads)
    here = reach(scene, parameters)
    if here.within.mean() >= MOST:
        return ""
    silent, questionable, meaningless, within = (percent(each.mean()) for each in here)
    said = (
        f"most fabrics and loads are outside the range of the model: of {scene.n_conditions} pairs of fabric "
        f"and load, no receptor fires in {silent}, and the geometry is meaningless (contact radius from R, or "
        f"indentation from {DEEP:g} R, on) in {meaningless} and questionable (contact radius above R/2) in "
        f"{questionable}; {within} are within the range"
    )
    if any(isinstance(load, FreeTouch) for load in loads):  # nobody chose the load, so that none can be advised
        return said
    kinds = [kind for kind in OTHER_LOADS if any(isinstance(load, kind) for load in loads)]
    tried = [load for kind in kinds for load in OTHER_LOADS[kind]]
    wider, changes = scene_under(tried), []
    touches = np.bincount(wider.load)
    for option, skin in {"": parameters, **others}.items():
        share = np.bincount(wider.load, reach(wider, skin).within) / touches
        best = int(share.argmax())
        same = float(reach(scene, skin).within.mean()) if option else -1.0
        load = f"{tried[best]}{f' with {option}' if option else ''}"
        changes.append((same, option) if same >= share[best] - 0.01 else (float(share[best]), load))
    gains = [f"{percent(share)} under {name}" for share, name in changes if share >= here.within.mean() + GAIN]
    if gains:
        return f"{said}. Within the range would be {', '.join(gains)}"
    ends = f"{tried[0]} to {tried[-1]}" if len(kinds) == 1 else "the usual forces and indentations"
    skins = f", with {' or '.join(others)} or without," if others else ""
    return f"{said}. No load from {ends}{skins} brings {percent(GAIN)} more into the range"


def wide_contacts(loads: Sequence[Load], finger: Finger) -> str:
    """Name the indentations at which the contact is too wide for Hertz's geometry; empty if there are none.

    The contact radius sqrt(R d) at an indentation d is independent of all moduli; under a force it is not, and the
    results report how often it is too wide.

    Parameters
    ----------
    loads
        The loads.
    finger
        The finger that touches.
    """
    pressed = sorted(load for load in loads if isinstance(load, Indentation))
    any_modulus = np.ones(1)
    extent = {load: float(Loads(load).radius(any_modulus, finger)[0]) / finger.radius for load in pressed}
    wide = [f"{extent[load]:.2f} R at {load}" for load in pressed if extent[load] > HERTZ_LIMIT]
    if not wide:
        return ""
    told = ", ".join(wide) if len(wide) <= MOST_NAMED else f"{wide[0]} to {wide[-1]}"
    return f"radius {told} (R = {finger.radius * 1e3:g} mm): beyond {HERTZ_LIMIT:g} R Hertz's geometry is questionable"


def reach_of_priors(
    fabrics: Fabrics,
    loads: Sequence[Load],
    readings: Readings,
    prior_set: str = "default",
    given: Mapping[str, float] | None = None,
    finger: Finger = Finger(),
    moduli: FabricModuli | None = None,
) -> str:
    """Return `reach_note` at the prior medians, with the skins of other sets of priors as alternatives.

    Parameters
    ----------
    fabrics, loads, readings, prior_set, given, finger, moduli
        As for `scene_of` and `usual_values`.
    """
    values = usual_values(readings, prior_set, given)

    surface = {name: x for name, x in values.items() if name not in Channels._fields}

    def scene_under(pressed: Sequence[Load]) -> Scene:
        how: dict[str, Any] = {"discretisation": COARSE, "finger": finger, "moduli": moduli}
        try:  # the surface of rates is stored, whereas a curve for particular channels takes a second
            return scene_of(fabrics, tuple(pressed), surface, readings, **how)
        except InputError:
            return scene_of(fabrics, tuple(pressed), values, readings, **how)

    skin = {name: values for name in SKINS if name != prior_set for values in [usual_values(readings, name)]}
    others = {f"--priors {name}": touch_parameters({**values, "b": x["b"], "m": x["m"]}) for name, x in skin.items()}
    return reach_note(scene_under, loads, touch_parameters(values), others)


def reach_of(model: ExperimentModel) -> str:
    """Return `reach_of_priors` for all combinations of the rated fabrics and loads of an experiment."""
    data, options = model.data, model.requested
    known = {name: prior.median for name, prior in options.priors.items()} | dict(options.fix)
    shape = {name: known.pop(name) * parameter.si for name, parameter in SHAPE_PARAMETERS.items() if name in known}
    given = {name: value for name, value in known.items() if name in TouchParameters._fields}
    if FREE_TOUCH in data.ratings.loads:
        given.setdefault(TOUCH_FORCE, EVERY_PARAMETER[TOUCH_FORCE].prior.median)
    finger, readings = replace(options.finger, **shape), options.readings
    return reach_of_priors(data.fabrics, data.ratings.loads, readings, options.prior_set, given, finger, model.moduli)
