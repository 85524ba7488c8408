"""Values of a run's finger by name (`radius_mm`, …), in the units of the command line."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from softness_bayes.errors import InputError
from softness_bayes.parameters.declared import SHAPE_PARAMETERS, Parameter
from softness_bayes.ranges import Range
from softness_bayes.touch.contact import Finger, FingerBox

_MM = 1000.0
"""Millimetres in a metre; division by it preserves the decimal number as written, to the last bit."""


@dataclass(frozen=True)
class FingerValue:
    """One value of a finger, with its name on the command line.

    Parameters
    ----------
    name, meaning
        Name including the unit, and description.
    range
        Allowed values, in the unit of the name.
    per_si
        Number of these units in one SI unit.
    """

    name: str
    meaning: str
    range: Range
    per_si: float = _MM


FINGER_VALUES: Mapping[str, FingerValue] = MappingProxyType(
    {
        value.name: value
        for value in (
            FingerValue("radius_mm", "radius of the fingertip", Range(1.0, 100.0, "mm")),
            FingerValue("receptor_depth_mm", "depth of the receptors", Range(0.0, 5.0, "mm")),
            FingerValue("poisson_ratio", "Poisson ratio of the skin", Range(-0.99, 0.5), per_si=1.0),
            FingerValue("pad_length_mm", "extent of the pad along the finger", Range(1.0, 200.0, "mm")),
            FingerValue("pad_width_mm", "extent of the pad across the finger", Range(1.0, 200.0, "mm")),
            FingerValue("contact_x_mm", "contact's axis along the pad, from its tip", Range(0.0, 200.0, "mm")),
            FingerValue("contact_y_mm", "contact's axis across the pad, from its edge", Range(0.0, 200.0, "mm")),
        )
    }
)
"""All values of a finger that can be set, by name."""


def require_finger(values: Mapping[str, float]) -> None:
    """Raise an error for invalid values of a finger.

    Raises
    ------
    InputError
        For an unknown name, or a value outside its range.
    """
    for name, value in values.items():
        if name not in FINGER_VALUES:
            raise InputError(f"no value '{name}' of a finger; expected one of {', '.join(FINGER_VALUES)}")
        FINGER_VALUES[name].range.require(name, value)
    finger_of(values)


def finger_of(values: Mapping[str, float]) -> Finger:
    """Return the default finger with some values replaced.

    Raises
    ------
    InputError
        If the contact's axis misses the pad.
    """
    usual = Finger()
    si = {name: value / FINGER_VALUES[name].per_si for name, value in values.items()}
    x, y = usual.contact_centre
    centre = (si.pop("contact_x_mm", x), si.pop("contact_y_mm", y))
    return replace(usual, contact_centre=centre, **{name.removesuffix("_mm"): value for name, value in si.items()})


def values_of(finger: Finger) -> dict[str, float]:
    """Return the values that differ from those of the default finger, such that `finger_of` restores the finger."""
    return {name: value for name, value in every_value(finger).items() if value != every_value(Finger())[name]}


def require_one_source(names: Iterable[str], finger: Finger) -> None:
    """Raise an error for parameters that have both a prior and a set value of the finger.

    Raises
    ------
    InputError
        Naming the parameter.
    """
    for name in names:
        if name in SHAPE_PARAMETERS and getattr(finger, name) != getattr(Finger(), name):
            raise InputError(f"{name} is given both a prior and a value of the finger ({name}_mm); choose one")


def box_of_priors(sampled: Sequence[Parameter], finger: Finger) -> FingerBox | None:
    """Return the range of radii and depths to cover in a run: four standard deviations of each prior.

    Parameters
    ----------
    sampled
        The sampled parameters. Without any of `SHAPE_PARAMETERS` there is a single finger, and the result is None.
    finger
        Finger with the values that are not sampled.
    """
    ends = {p.name: np.asarray(p.prior.quantile(_TAILS)) * _MARGINS for p in sampled if p.name in SHAPE_PARAMETERS}
    return box_of_values(ends, finger)


_TAILS, _MARGINS = (3e-5, 1.0 - 3e-5), (0.999, 1.001)


def box_of_values(values: Mapping[str, ArrayLike], finger: Finger) -> FingerBox | None:
    """Return the range of the radii and depths among named values in natural units; None if there are none."""
    ranges = {}
    for name, parameter in SHAPE_PARAMETERS.items():
        own = np.asarray(values[name], float) * parameter.si if name in values else np.array(getattr(finger, name))
        ranges[name] = float(own.min()), float(own.max())
    return FingerBox(**ranges) if SHAPE_PARAMETERS.keys() & values.keys() else None


def every_value(finger: Finger) -> dict[str, float]:
    """Return all values of a finger, by the names used in `finger_of`."""
    si: dict[str, Any] = asdict(finger)
    si["contact_x"], si["contact_y"] = si.pop("contact_centre")
    # twelve digits restore the number as written, without rounding errors of the conversion
    return {name: float(f"{si[name.removesuffix('_mm')] * value.per_si:.12g}") for name, value in FINGER_VALUES.items()}
