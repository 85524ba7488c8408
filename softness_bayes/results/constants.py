"""Constants of a result: fixed parameters, fabrics, loads, ratings, and coordinates of the axes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.agreement import RATERS_OF_CELLS
from softness_bayes.checking.check_table import LOO_PIT, PARETO_K
from softness_bayes.checking.checks import LooPit
from softness_bayes.checking.individual import MODULUS_LAW
from softness_bayes.checking.layout import (
    LOAD_GROUP,
    RATING_AS_FILED,
    RATING_HIGH,
    RATING_LINE,
    RATING_LOW,
    RATING_VALUE,
    UNCERTAIN,
)
from softness_bayes.data.columns import EFFECTIVE_MODULUS, GEOMETRIC_SD, LOAD_CV, POISSON_RATIO, RESOLUTION
from softness_bayes.data.ratings import loads_by_column
from softness_bayes.parameters.declared import EVERY_PARAMETER
from softness_bayes.parameters.space import ParameterSpace
from softness_bayes.results.draws import Groups, RatedDraws, Variable
from softness_bayes.touch.neuron.fixed_channels import FixedChannels, make_known
from softness_bayes.touch.neuron.membrane import Channels, Membrane
from softness_bayes.touch.neuron.rate_curve import CurveError, Firing, RateCurve
from softness_bayes.touch.scene import Scene

if TYPE_CHECKING:
    import xarray as xr

COEFFICIENTS = "noise_curve_coefficients"
"""Name of the variable with the coefficients of the curves, in `constant_data`; the others are named in `_UNITS`."""

_UNITS = {
    "noise_curve_rheobase": "µA/cm²",
    "noise_curve_onset_rate": "Hz",
    "noise_curve_max_current": "µA/cm²",
    "noise_curve_error": "Hz",
    "noise_curve_relative_error": "",
    "noise_curve_onset_error": "Hz",
}


def held_parameters(space: ParameterSpace) -> dict[str, Variable]:
    """Return the fixed parameters."""
    return {n: Variable(np.array(value), units=EVERY_PARAMETER[n].unit) for n, value in space.held.items()}


def data_groups(draws: RatedDraws, pit: LooPit) -> Groups:
    """Return the ratings, and constants: fixed parameters, fabrics, loads, participant, fabric and load of each rating.

    Ratings are those of the file; ranks and pairs are as the model has them, as replicates are. Where the model has
    something other than exact numbers, its values in means and the ends of its intervals are among the constants.
    """
    (ratings, fabrics, *_), space, scale = draws.experiment, draws.posterior.space, draws.scale
    modelled, filed, ends, cells = scale.filed(draws.ratings.values), ratings.rating, draws.ratings.ends, ratings.cells
    modelled = np.where(np.isclose(modelled, filed, rtol=1e-12), filed, modelled)  # rounding of shares
    same = np.array_equal(modelled, filed)
    laws = [str(law) for law in (() if space.moduli is None else space.moduli.laws) if law is not None]
    sampled = np.asarray(space.touch(draws.theta).radius)
    radius = float(np.median(sampled)) if sampled.any() else draws.scene.finger.radius
    rows = {
        LOO_PIT: pit.value,
        PARETO_K: pit.pareto_k,
        LOAD_CV.name: ratings.load_cv,
        RESOLUTION.name: ratings.resolution,
        "list_index": ratings.lists,
        GEOMETRIC_SD.name: None if cells is None else cells.geometric_sd,
        RATING_AS_FILED if scale.answer else RATING_VALUE: None if same else filed if scale.answer else modelled,
        RATING_LOW: None if ends is None else scale.filed(ends[0]),
        RATING_HIGH: None if ends is None else scale.filed(ends[1]),
        "participant_index": ratings.participant,
        "fabric_index": ratings.fabric,
        "load_index": ratings.load,
        RATING_LINE: ratings.rows,
    }
    constant = {
        **held_parameters(space),
        "finger_radius_mm": Variable(np.array(radius * 1e3), units="mm"),
        EFFECTIVE_MODULUS.name: Variable(
            draws.scene.fabric_modulus / EFFECTIVE_MODULUS.factor, ("fabric",), EFFECTIVE_MODULUS.unit
        ),
        POISSON_RATIO.name: Variable(fabrics.poisson_ratio, ("fabric",)),
        **stored_curves(draws.scene.firing),
        **{name: Variable(np.asarray(values), ("rating_row",)) for name, values in rows.items() if values is not None},
    }
    for column, held in loads_by_column(ratings.loads).items():
        constant[column.name] = Variable(held / column.factor, ("load",), column.unit)
    if laws:
        constant[MODULUS_LAW] = Variable(np.array(laws), (UNCERTAIN,))
    if cells is not None:
        constant[RATERS_OF_CELLS] = Variable(np.array(cells.raters))
    # chain and draw, in the posterior, of the draws of groups that have only some of them
    for group, size in {"posterior_predictive": draws.replicates, "predictions": draws.curves}.items():
        for what, values in zip(("chain", "draw"), draws.picked(size), strict=True):
            constant[f"{group}_{what}"] = Variable(values, (f"draw_of_{group}",))
    return {
        "observed_data": {"rating": Variable(modelled if scale.answer else filed, ("rating_row",))},
        "constant_data": constant,
    }


def coordinates(draws: RatedDraws, grid: Scene) -> dict[str, NDArray[Any]]:
    """Return the coordinates of the axes; `grid` is the scene of the response curves."""
    ratings, moduli = draws.experiment.ratings, draws.posterior.space.moduli
    axes = {
        "participant": np.array(ratings.participants),
        "fabric": np.array(ratings.fabrics),
        "load": np.array([str(load) for load in ratings.loads]),
        "e_fab_kpa": grid.modulus[: grid.n_conditions // len(grid.loads)] * 1e-3,
    }
    if moduli is not None and moduli.uncertain:
        axes[UNCERTAIN] = np.array([moduli.names[k] for k in moduli.uncertain])
    if draws.load_groups.merged:
        axes[LOAD_GROUP] = np.array(draws.load_groups.names)
    return axes


def stored_curves(firing: Firing) -> dict[str, Variable]:
    """Return the rate curves averaged over noise, whose simulation takes minutes; empty without noise."""
    curves = firing.averaged if isinstance(firing, FixedChannels) else ()
    if not curves:
        return {}
    rows = [(curve.rheobase, curve.onset_rate, curve.max_current, *curve.error) for curve in curves]
    columns = zip(_UNITS.items(), np.array(rows, dtype=float).T, strict=True)
    found = {name: Variable(column, ("noise_curve",), unit) for (name, unit), column in columns}
    coefficients = np.stack([curve.coefficients for curve in curves])
    return {**found, COEFFICIENTS: Variable(coefficients, ("noise_curve", "noise_curve_term"))}


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
