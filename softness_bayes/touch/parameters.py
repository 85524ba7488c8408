"""Parameters of the forward model, by name, in SI, of any batch shape."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.touch.neuron.membrane import Channels, rows_of

Array = NDArray[np.float64]


class TouchParameters(NamedTuple):
    """Parameters of the forward model (model.md 10): numbers, or arrays of a common batch shape."""

    b: Any
    """Skin modulus at rest [Pa]."""
    m: Any
    """Stiffening exponent of the skin [-] (under the ``displacement`` reading [1/m])."""
    alpha: Any
    """Largest receptor current [µA/cm²]."""
    beta: Any
    """Steepness of the transduction [1/Pa]."""
    sigma_0: Any
    """Stress at half the largest current [Pa]."""
    c_Na: Any
    """Multiplier of the sodium conductance [-]."""
    c_K: Any
    """Multiplier of the potassium conductance [-]."""
    c_L: Any
    """Multiplier of the leak conductance [-]."""
    c_A: Any
    """Multiplier of the A-current's conductance [-]."""
    radius: Any = 0.0
    """Fingertip radius [m]; 0 to use that of the scene's finger."""
    receptor_depth: Any = 0.0
    """Depth of the receptors [m]; 0 to use that of the scene's finger."""
    touch_force: Any = 1.0
    """Force of free touches [N]; other touches have their loads."""

    @property
    def channels(self) -> Channels:
        """Multipliers of all conductances [-]."""
        return Channels(self.c_Na, self.c_K, self.c_L, self.c_A)

    def broadcast(self, shape: int | tuple[int, ...]) -> TouchParameters:
        """Return the parameters as arrays of one shape, which those that do not vary lack."""
        return TouchParameters(*(np.broadcast_to(value, shape) for value in self))


_POSITIVE = [TouchParameters._fields.index(name) for name in ("b", "alpha", "beta", "touch_force", *Channels._fields)]
_FROM_ZERO = [TouchParameters._fields.index(name) for name in ("radius", "receptor_depth")]

_LEAST = np.full((len(TouchParameters._fields), 1), -np.finfo(float).max)
_LEAST[_POSITIVE], _LEAST[_FROM_ZERO] = np.nextafter(0.0, 1.0), 0.0
"""Least value of each parameter, one per row: the least positive number, 0, or the least number of all."""


def checked_rows(parameters: TouchParameters) -> tuple[tuple[int, ...], TouchParameters]:
    """Check parameter vectors; return their batch shape, and the vectors as one-dimensional arrays.

    Raises
    ------
    InputError
        If a value is not finite or out of range; the message names the first such parameter.
    """
    shape, flat = rows_of(parameters)
    if not ((flat >= _LEAST).all() and (flat < np.inf).all()):  # NaN is not above anything
        for name, value in zip(TouchParameters._fields, flat, strict=True):
            if not np.isfinite(value).all():
                raise InputError(f"parameters: {name} is not finite")
        wrong = [k for k in _POSITIVE if not (flat[k] > 0).all()]
        row = (wrong or [k for k in _FROM_ZERO if not (flat[k] >= 0).all()])[0]
        raise InputError(f"parameters: {TouchParameters._fields[row]} is {flat[row].min()}, expected a positive number")
    return shape, TouchParameters(*flat)
