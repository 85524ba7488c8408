"""Predictions of the forward model as a table: one row per fabric and load, with or without credible limits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.data import Fabrics
from softness_bayes.model.scenes import touch_parameters
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.scene import Response, Scene

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]


def prediction_table(
    fabrics: Fabrics,
    scene: Scene,
    parameters: TouchParameters,
    prob: float = 0.9,
    modulus: Array | None = None,
) -> pd.DataFrame:
    """Return the prediction for every condition of a scene.

    Parameters
    ----------
    fabrics
        Fabrics of the scene, for their names.
    scene
        Fabrics × loads.
    parameters
        One parameter vector, or a batch of draws of shape (draws,).
    prob
        Credible mass between the columns `_low` and `_high`, which only a batch has.
    modulus
        E_fab [Pa] of each fabric at each draw, shape (draws, fabrics); by default that of the scene.

    Returns
    -------
    DataFrame
        A row per condition: fabric, indentation_mm, force_n, e_fab_kpa, e_skin_kpa,
        contact_radius_mm, peak_stress_kpa, total_rate_hz, responding, mean_rate_hz,
        mean_interval_ms; for a batch, the medians, each with columns `_low` and `_high`. Mean rate and interval are
        empty where no receptor fires. The last column, readings, lists the readings used.
    """
    import pandas as pd

    response = scene.respond(parameters, modulus)
    touched = scene.modulus if modulus is None else modulus[:, scene.fabric]
    columns: dict[str, object] = {"fabric": [fabrics.names[i] for i in scene.fabric]}
    for name, values in quantities(response, touched).items():
        if values.ndim == 1:
            columns[name] = values
        else:
            columns[f"{name}_low"], columns[name], columns[f"{name}_high"] = _limits(values, prob)
    columns["readings"] = scene.readings.label
    return pd.DataFrame(columns)


def drawn_parameters(values: Mapping[str, ArrayLike]) -> TouchParameters:
    """Return draws of a run as parameters of a scene with a common batch axis, so that their table has limits.

    Parameters
    ----------
    values
        Every parameter by name in natural units: a number if fixed in the run, otherwise draws (draws,). At least one
        must be drawn, as is always true for the rating model.
    """
    batch = np.empty(max(np.size(value) for value in values.values()))
    return TouchParameters(*np.broadcast_arrays(*touch_parameters(values), batch)[:-1])


def quantities(response: Response, modulus: Array) -> dict[str, Array]:
    """Return the numerical columns of `prediction_table`, each of the shape of the response.

    Parameters
    ----------
    response
        Response of a scene.
    modulus
        E_fab [Pa] of each condition, shape (..., conditions).
    """
    contact = response.contact
    return {
        "indentation_mm": contact.indentation * 1e3,
        "force_n": contact.force,
        "e_fab_kpa": np.broadcast_to(modulus * 1e-3, contact.force.shape),
        "e_skin_kpa": contact.skin_modulus * 1e-3,
        "contact_radius_mm": contact.radius * 1e3,
        "peak_stress_kpa": response.peak_stress * 1e-3,
        "total_rate_hz": response.total_rate,
        "responding": response.responding,
        "mean_rate_hz": response.mean_rate,
        "mean_interval_ms": response.mean_interval * 1e3,
    }


def _limits(values: Array, prob: float) -> Array:
    """Return lower limit, median and upper limit over draws that are not NaN; NaN if there are none."""
    tail = 0.5 * (1.0 - prob)
    limits = np.full((3, values.shape[1]), np.nan)
    for column in range(values.shape[1]):
        known = values[:, column][~np.isnan(values[:, column])]
        if known.size:
            limits[:, column] = np.quantile(known, [tail, 0.5, 1.0 - tail])
    return limits
