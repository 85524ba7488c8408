"""Data shown for one setting of the sliders, and the command that repeats them, computed independently of the page."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.defaults import ACCURACY
from softness_bayes.base.readable import number, percent
from softness_bayes.checking.inflection import CurveShape, Inflection, find_inflection, response_curves
from softness_bayes.data import Fabrics, fabrics_csv
from softness_bayes.data.ratings import load_column
from softness_bayes.model.fingers import finger_of, values_of
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.prediction import quantities
from softness_bayes.model.scenes import touch_parameters
from softness_bayes.parameters.declared import KPA, SHAPE_PARAMETERS
from softness_bayes.plotting.panels import title
from softness_bayes.touch.contact import HERTZ_LIMIT
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.profiles import touch_profiles
from softness_bayes.touch.receptors import kink_distances

if TYPE_CHECKING:
    from softness_bayes.report.explore.subject import State, Subject

Array = NDArray[np.float64]


class Picture(NamedTuple):
    """All displayed quantities that depend on the state, in the units of the axes."""

    modulus: Array
    """E_fab of the curves [kPa], shape (points,)."""
    rate: Array
    """Response [spikes/s], shape (loads, points)."""
    rating: Array | None
    """Typical rating, same shape; None without a run."""
    turn: Array
    """E_fab at the turning point under each load [kPa], NaN where there is none."""
    fabric: str
    """The fabric that is touched, in words."""
    chosen: Mapping[str, float]
    """Quantities of its touch under the chosen load, as `predict` names them, and with a run the typical rating."""
    distance: Array
    """From the contact's axis [mm], shape (distances,)."""
    stress: Array
    """Stress at the receptors' depth there [kPa]."""
    firing: Array
    """Firing rate of a receptor there [Hz]."""
    receptors: Array
    """Firing rate of each receptor of the pad [Hz]."""
    sentences: tuple[str, ...]
    """Sentences about the response and about limits of validity."""
    command: str
    """The lines that repeat the quantities of the touch."""


def picture(subject: Subject, state: State) -> Picture:
    """Return the picture of a state.

    Raises
    ------
    InputError
        If the model cannot evaluate one of the values.
    """
    values = subject.values(state)
    one = TouchParameters(*(np.atleast_1d(value) for value in touch_parameters(values)))
    curves, touch = response_curves(subject.curves, one), subject.touch(state)
    fabrics = subject.fabrics.effective_modulus
    turning = find_inflection(curves, ACCURACY, (float(fabrics.min()), float(fabrics.max())), subject.least_drop)
    name = "a fabric without a name" if state.fabric is None else subject.fabrics.names[state.fabric]
    moduli = np.append(fabrics, state.modulus_kpa * KPA)[None]
    response = touch.respond(one, moduli)
    columns = quantities(response, moduli[:, touch.fabric])
    chosen = {quantity: float(column[0, 0]) for quantity, column in columns.items()}
    rating = None
    if subject.rated is not None:
        every = np.tile(chosen["total_rate_hz"], (len(subject.loads), 1))
        touched = np.concatenate([curves.total_rate[0], every], axis=1)
        both = subject.rated.typical(values, touched, state.fabric)
        rating, chosen["typical_rating"] = both[:, :-1], float(both[state.load, -1])
    # from the contact's axis to the pad's farthest corner, closer together near the axis
    distance = kink_distances(subject.finger)[-1] * np.linspace(0.0, 1.0, 201) ** 1.5
    profiles = touch_profiles(touch, one, distance, moduli)
    away = np.hypot(*(subject.receptors - subject.finger.contact_centre).T)
    return Picture(
        curves.modulus / KPA,
        curves.total_rate[0],
        rating,
        turning.modulus[0] / KPA,
        f"{name}, {chosen['e_fab_kpa']:.4g} kPa",
        chosen,
        distance * 1e3,
        profiles.stress[0, 0] / KPA,
        profiles.rate[0, 0],
        np.interp(away, distance, profiles.rate[0, 0]),
        (_response_in_words(subject, state, turning), *_reach(subject, values, chosen)),
        repeating(subject, state),
    )


def _response_in_words(subject: Subject, state: State, turning: Inflection) -> str:
    load = title(subject.loads[state.load])
    match CurveShape(int(turning.outcome[0, state.load])):
        case CurveShape.SILENT:
            return f"{load}: no receptor fires at any modulus."
        case CurveShape.INTERIOR:
            return f"{load}: the response turns over at E_fab = {turning.modulus[0, state.load] / KPA:.4g} kPa."
    return (
        f"{load}: the response has no turning point: its maximum does not exceed both ends of the range of moduli by "
        f"{percent(subject.least_drop)}."
    )


def _reach(subject: Subject, values: Mapping[str, float], chosen: Mapping[str, float]) -> list[str]:
    """Return notes: no receptor fires, Hertz's geometry is questionable, or the modulus is outside the rated range."""
    notes = []
    if not chosen["total_rate_hz"]:
        notes.append(
            "No receptor fires under this fabric: the model cannot distinguish it from other fabrics without firing."
        )
    tip = values.get("radius", subject.finger.radius * 1e3)
    extent = chosen["contact_radius_mm"] / tip
    if extent > HERTZ_LIMIT:
        word, limit = ("meaningless", "R") if extent >= 1.0 else ("questionable", "R/2")
        notes.append(
            f"Out of range: the contact radius of {chosen['contact_radius_mm']:.3g} mm exceeds {limit}, with R "
            f"= {tip:.3g} mm, where Hertz's geometry is {word}."
        )
    if subject.rated is not None:
        low, high = subject.rated.span
        if not low * (1 - 1e-6) <= chosen["e_fab_kpa"] <= high * (1 + 1e-6):
            notes.append(f"This modulus is outside the rated range, {number(low)} to {number(high)} kPa.")
    return notes


def repeating(subject: Subject, state: State) -> str:
    """Return the lines that reproduce the touch of a state: a table of its fabric, and the prediction for it."""
    load = subject.loads[state.load]
    column = load_column(load).column.name
    words = ["softness-bayes", "predict", "--fabrics", "explored.csv"]
    words += [f"--{column.replace('_', '-')}", str(load).partition(" ")[0]]
    values = subject.values(state)
    if subject.rated is not None:
        # finger, readings, noise and the medians of parameters without a slider come from the run
        touch: Mapping[str, float] = state.values
        words += ["--posterior", subject.rated.source]
    else:
        touch = {n: values[n] for n in TouchParameters._fields if n in values and n not in SHAPE_PARAMETERS}
        shape = {f"{name}_mm": values[name] for name in SHAPE_PARAMETERS if name in values}
        finger = finger_of(values_of(subject.finger) | shape)
        words += ModelOptions(readings=subject.readings, finger=finger).words("readings", "finger")
    words += [word for name, value in touch.items() for word in ("--set", f"{name}={value:.15g}")]
    rows = fabrics_csv(_touched(subject, state)).splitlines()
    return f"printf '%s\\n' {' '.join(map(shlex.quote, rows))} > explored.csv\n{shlex.join(words)}"


def _touched(subject: Subject, state: State) -> Fabrics:
    """Return the fabric of a state alone."""
    if state.fabric is None:
        name, modulus, poisson = "explored", state.modulus_kpa * KPA, subject.poisson_ratio
    else:
        fabrics, k = subject.fabrics, state.fabric
        name, modulus, poisson = fabrics.names[k], fabrics.effective_modulus[k], fabrics.poisson_ratio[k]
    return Fabrics((name,), effective_modulus=np.array([modulus]), poisson_ratio=np.array([poisson]))
