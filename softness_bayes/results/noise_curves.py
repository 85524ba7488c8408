"""Rate curves averaged over noise, stored with a run: their simulation takes minutes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from softness_bayes.results.groups import Variable
from softness_bayes.touch.neuron.firing import CurveError, RateCurve
from softness_bayes.touch.neuron.fixed_channels import Firing, FixedChannels
from softness_bayes.touch.neuron.membrane import Channels, Membrane
from softness_bayes.touch.neuron.noise import make_known

if TYPE_CHECKING:
    import xarray as xr

COEFFICIENTS = "noise_curve_coefficients"
"""Name of the variable with the coefficients of the curves, in `constant_data`; the others are named in `_UNITS`."""

_AXIS = "noise_curve"
_UNITS = {
    "noise_curve_rheobase": "µA/cm²",
    "noise_curve_onset_rate": "Hz",
    "noise_curve_max_current": "µA/cm²",
    "noise_curve_error": "Hz",
    "noise_curve_relative_error": "",
    "noise_curve_onset_error": "Hz",
}


def stored_curves(firing: Firing) -> dict[str, Variable]:
    """Return the averaged curves of a run; empty without noise."""
    curves = firing.averaged if isinstance(firing, FixedChannels) else ()
    if not curves:
        return {}
    rows = [(curve.rheobase, curve.onset_rate, curve.max_current, *curve.error) for curve in curves]
    columns = zip(_UNITS.items(), np.array(rows, dtype=float).T, strict=True)
    found = {name: Variable(column, (_AXIS,), unit) for (name, unit), column in columns}
    coefficients = np.stack([curve.coefficients for curve in curves])
    return {**found, COEFFICIENTS: Variable(coefficients, (_AXIS, "noise_curve_term"))}


def restore_curves(constant: xr.Dataset, noise: float, membrane: Membrane) -> None:
    """Make the averaged curves of a stored run known, if it has any.

    Parameters
    ----------
    constant
        The group `constant_data`.
    noise
        Strength of the run's white-noise current [µA/cm² sqrt(ms)].
    membrane
        The run's membrane.
    """
    if COEFFICIENTS not in constant:
        return
    channels = Channels(*(float(constant[name]) for name in Channels._fields))
    columns = [constant[name].values for name in _UNITS]
    for coefficients, rheobase, onset_rate, limit, *error in zip(constant[COEFFICIENTS].values, *columns, strict=True):
        curve = RateCurve(np.array(rheobase), np.array(onset_rate), coefficients, float(limit), CurveError(*error))
        make_known(noise, channels, membrane, curve)
