"""Fabrics, loads, named draws, response curves and turning points, read back from the groups of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.individual import UNCERTAIN
from softness_bayes.checking.inflection import Curves, Inflection
from softness_bayes.parameters.declared import PARAMETERS
from softness_bayes.parameters.fabric_moduli import FABRIC_MODULUS

if TYPE_CHECKING:
    import xarray as xr

    from softness_bayes.data import Fabrics

Array = NDArray[np.float64]


def fabrics_in(constant: xr.Dataset, digest: str) -> Fabrics:
    """Return the fabrics of the data, of the group `constant_data`, with the digest of their table."""
    from softness_bayes.data import Fabrics

    return Fabrics(
        tuple(str(name) for name in constant["fabric"].values),
        effective_modulus=constant["effective_modulus_kpa"].values * 1e3,
        poisson_ratio=constant["poisson_ratio"].values,
        digest=digest,
    )


def named_values(posterior: xr.Dataset, constant: xr.Dataset, size: int | None = None) -> dict[str, Array]:
    """Return every parameter of the model by name, in natural units: draws, or the fixed value.

    Parameters
    ----------
    posterior, constant
        The groups `posterior` and `constant_data`.
    size
        Number of draws, evenly spaced over the run; by default all.
    """
    names = [name for name, variable in posterior.items() if variable.dims == ("chain", "draw")]
    # draws of all chains interleaved in time, so that evenly spaced ones cover the whole run
    columns = {str(name): posterior[name].values.T.ravel() for name in names}
    total = next(iter(columns.values())).size
    pick = np.arange(total) if size is None or size >= total else np.linspace(0, total - 1, size).astype(int)
    columns |= _sampled_moduli(posterior, total)
    held = {str(name): constant[name].values for name in constant.data_vars if name in PARAMETERS}
    return {**held, **{name: column[pick] for name, column in columns.items()}}


def _sampled_moduli(posterior: xr.Dataset, total: int) -> dict[str, Array]:
    """Return the draws of every sampled modulus [kPa] by name, in the order of the draws of parameters."""
    if FABRIC_MODULUS not in posterior:
        return {}
    drawn, names = posterior[FABRIC_MODULUS].values, posterior[UNCERTAIN].values
    flat = drawn.swapaxes(0, 1).reshape(total, -1)
    return {f"{FABRIC_MODULUS}[{name}]": flat[:, k] for k, name in enumerate(names)}


def curves_in(predictions: xr.Dataset) -> Curves:
    """Return the response as a function of E_fab for each draw, from the group `predictions`."""
    stored = predictions.isel(chain=0)
    return Curves(
        stored["e_fab_kpa"].values * 1e3,
        stored["total_rate"].values,
        stored["e_skin_kpa"].values * 1e3,
        stored["contact_force_n"].values,
        stored["contact_radius_mm"].values * 1e-3,
    )


def turning_points_in(stored: xr.Dataset) -> Inflection:
    """Return the turning points stored in a group, with fields of shape (chains, draws, loads)."""
    return Inflection(
        stored["inflection_outcome"].values,
        stored["inflection_e_fab_kpa"].values * 1e3,
        stored["inflection_ratio"].values,
        stored["inflection_force_n"].values,
        stored["inflection_drop"].values,
        stored["inflection_inside"].values.astype(bool),
    )
