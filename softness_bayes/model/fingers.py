"""Values of a run's finger by name (`radius_mm`, …), and the quantities in which raters differ (model.md 9)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from softness_bayes.base.errors import InputError
from softness_bayes.base.ranges import Range
from softness_bayes.likelihood.contract import RATER_SPREADS
from softness_bayes.parameters.declared import EVERY_PARAMETER, SHAPE_PARAMETERS, TOUCH_FORCE, Parameter
from softness_bayes.touch.contact import Finger, FingerBox
from softness_bayes.touch.finger_grid import SPREAD_OF, FingerGrid
from softness_bayes.touch.fingers import FingerFamily
from softness_bayes.touch.scene import Scene

_MM = 1000.0
"""Millimetres in a metre; division by it preserves the decimal number as written, to the last bit."""


FINGER_VALUES: Mapping[str, Range] = MappingProxyType(
    {
        "radius_mm": Range(1.0, 100.0, "mm"),
        "receptor_depth_mm": Range(0.0, 5.0, "mm"),
        "poisson_ratio": Range(-0.99, 0.5),
        "pad_length_mm": Range(1.0, 200.0, "mm"),
        "pad_width_mm": Range(1.0, 200.0, "mm"),
        "contact_x_mm": Range(0.0, 200.0, "mm"),
        "contact_y_mm": Range(0.0, 200.0, "mm"),
    }
)
"""All values of a finger that can be set, by name, with their ranges; the contact's axis is `contact_x` along the pad
from its tip, and `contact_y` across the pad from its edge."""


def finger_of(values: Mapping[str, float]) -> Finger:
    """Return the default finger with some values replaced.

    Raises
    ------
    InputError
        For an unknown name, a value outside its range, or if the contact's axis misses the pad.
    """
    si = {}
    for name, value in values.items():
        if name not in FINGER_VALUES:
            raise InputError(f"no value '{name}' of a finger; expected one of {', '.join(FINGER_VALUES)}")
        FINGER_VALUES[name].require(name, value)
        si[name.removesuffix("_mm")] = value / _MM if name.endswith("_mm") else value
    usual = Finger()
    x, y = usual.contact_centre
    return replace(usual, contact_centre=(si.pop("contact_x", x), si.pop("contact_y", y)), **si)


def values_of(finger: Finger) -> dict[str, float]:
    """Return the values that differ from those of the default finger, such that `finger_of` restores the finger."""

    def every(one: Finger) -> dict[str, float]:
        si: dict[str, Any] = asdict(one)
        si["contact_x"], si["contact_y"] = si.pop("contact_centre")
        # twelve digits restore the number as written, without rounding errors of the conversion
        return {
            name: float(f"{si[name.removesuffix('_mm')] * (_MM if name.endswith('_mm') else 1.0):.12g}")
            for name in FINGER_VALUES
        }

    usual = every(Finger())
    return {name: value for name, value in every(finger).items() if value != usual[name]}


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


BOXED = {**{name: name for name in SHAPE_PARAMETERS}, TOUCH_FORCE: "force"}
"""Parameters with the fields of `FingerBox` that hold their ranges."""


def box_of_priors(sampled: Sequence[Parameter], finger: Finger) -> FingerBox | None:
    """Return the range of radii, depths and free forces to cover in a run: four standard deviations of each prior.

    Parameters
    ----------
    sampled
        The sampled parameters. Without any of `BOXED` there is a single finger, and the result is None.
    finger
        Finger with the values that are not sampled.
    """
    ends = {p.name: np.asarray(p.prior.quantile(_TAILS)) * _MARGINS for p in sampled if p.name in BOXED}
    return box_of_values(ends, finger)


_TAILS, _MARGINS = (3e-5, 1.0 - 3e-5), (0.999, 1.001)


def box_of_values(values: Mapping[str, ArrayLike], finger: Finger) -> FingerBox | None:
    """Return the range of the `BOXED` among named values in natural units; None if there are none."""
    ranges = {}
    for name, place in BOXED.items():
        own = np.asarray(values[name], float) * EVERY_PARAMETER[name].si if name in values else getattr(finger, place)
        ranges[place] = float(np.min(own)), float(np.max(own))
    return FingerBox(**ranges) if BOXED.keys() & values.keys() else None


NODES: Mapping[int, Mapping[str, int]] = MappingProxyType(
    {
        1: {"b": 33, "m": 17, "sigma_0": 33},
        2: {"b": 25, "m": 9, "sigma_0": 25},
        3: {"b": 21, "m": 7, "sigma_0": 21},
    }
)
"""Nodes per quantity, by the number of quantities that differ; `FingerGrid` states the error of their spacing."""


def require_individual(names: Sequence[str]) -> tuple[str, ...]:
    """Return quantities that differ between raters, of their fingers or of their answers.

    Raises
    ------
    InputError
        Naming what is expected.
    """
    known = {**SPREAD_OF, **RATER_SPREADS}
    if len(set(names)) < len(names) or not known.keys() >= set(names):
        raise InputError(f"individual is {','.join(names)}, expected some of {', '.join(known)}, each once")
    if fingers_of(names) and answers_of(names):
        raise InputError(
            f"individual is {','.join(names)}: raters' own fingers ({', '.join(SPREAD_OF)}) and their own "
            f"answers ({', '.join(RATER_SPREADS)}) cannot be combined; use one kind at a time, and compare the "
            "two runs"
        )
    return tuple(names)


def fingers_of(names: Sequence[str]) -> tuple[str, ...]:
    """Return the quantities among `names` that belong to raters' fingers."""
    return tuple(name for name in names if name in SPREAD_OF)


def answers_of(names: Sequence[str]) -> tuple[str, ...]:
    """Return the quantities among `names` that belong to raters' answers: exponents and noise."""
    return tuple(name for name in RATER_SPREADS if name in names)


def differing(names: Sequence[str]) -> str:
    """Describe the quantities that differ between raters."""
    words = {"gamma": "exponents", "varsigma": "noise"}
    return f"own {' and '.join(words[name] for name in answers_of(names)) or 'fingers'}"


def grid_of(names: Sequence[str]) -> FingerGrid:
    """Return the grid of fingers over which individual fingers are summed."""
    return FingerGrid({name: NODES[len(names)][name] for name in names})


def family_of(scene: Scene, grid: FingerGrid, finer: bool = False) -> FingerFamily:
    """Return the family of fingers of a grid that touch a scene, with errors of about 1e-3 in log(N/N_ref + 0.1 Hz).

    Those of the reference of the exactness check are finer.
    """
    response_nodes, skin_nodes = (40, 24) if finer else (20, 14)
    return FingerFamily(scene, grid, response_nodes, skin_nodes)
