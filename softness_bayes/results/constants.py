"""Constants of a result: fixed parameters, fabrics, loads, ratings, and coordinates of the axes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.agreement import RATERS_OF_CELLS
from softness_bayes.checking.check_table import LOO_PIT, PARETO_K
from softness_bayes.checking.checks import LooPit
from softness_bayes.checking.individual import MODULUS_LAW, UNCERTAIN
from softness_bayes.checking.layout import LOAD_GROUP, RATING_VALUE
from softness_bayes.data.columns import EFFECTIVE_MODULUS, GEOMETRIC_SD, LOAD_CV, POISSON_RATIO, RESOLUTION
from softness_bayes.data.ratings import LOAD_COLUMNS
from softness_bayes.likelihood.scales import Scale
from softness_bayes.parameters.declared import EVERY_PARAMETER
from softness_bayes.parameters.space import FabricModuli, ParameterSpace
from softness_bayes.results.draws import RatedDraws, Variable
from softness_bayes.results.replicates import plate_coordinates
from softness_bayes.touch.neuron.fixed_channels import FixedChannels, make_known
from softness_bayes.touch.neuron.membrane import Channels, Membrane
from softness_bayes.touch.neuron.rate_curve import CurveError, Firing, RateCurve
from softness_bayes.touch.scene import Scene

if TYPE_CHECKING:
    import xarray as xr

RATING_LINE = "rating_line"
"""Name of the variable with the line of each rating in its file; a line of a wide table has several."""

RATING_AS_FILED, RATING_LOW, RATING_HIGH = "rating_as_filed", "rating_low", "rating_high"
"""Names of the variables for ranks and answers as in the file, whose ratings are shares of a list, and for the ends of
the intervals that ratings represent, in the units of the file."""

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


def held_parameters(space: ParameterSpace) -> dict[str, Variable]:
    """Return the fixed parameters."""
    return {n: Variable(np.array(value), units=EVERY_PARAMETER[n].unit) for n, value in space.held.items()}


def _modulus_laws(space: ParameterSpace) -> dict[str, Variable]:
    """Return the prior laws of uncertain moduli [kPa], in written form."""
    if space.moduli is None or not space.moduli.uncertain:
        return {}
    laws = np.array([str(space.moduli.laws[k]) for k in space.moduli.uncertain])
    return {MODULUS_LAW: Variable(laws, (UNCERTAIN,))}


def constant_group(draws: RatedDraws, pit: LooPit, scale: Scale) -> dict[str, Variable]:
    """Return the fixed parameters, the fabrics, the loads, and the participant, fabric and load of each rating."""
    ratings, fabrics = draws.experiment.ratings, draws.experiment.fabrics
    modulus = draws.scene.fabric_modulus / EFFECTIVE_MODULUS.factor
    return {
        **held_parameters(draws.posterior.space),
        **_modulus_laws(draws.posterior.space),
        "finger_radius_mm": Variable(np.array(_finger_radius(draws) * 1e3), units="mm"),
        LOO_PIT: Variable(pit.value, ("rating_row",)),
        PARETO_K: Variable(pit.pareto_k, ("rating_row",)),
        EFFECTIVE_MODULUS.name: Variable(modulus, ("fabric",), EFFECTIVE_MODULUS.unit),
        POISSON_RATIO.name: Variable(fabrics.poisson_ratio, ("fabric",)),
        **{
            column.name: Variable(
                np.array([value(x) / column.factor if isinstance(x, kind) else np.nan for x in ratings.loads]),
                ("load",),
                column.unit,
            )
            for column, kind, value in LOAD_COLUMNS
        },
        **({} if ratings.load_cv is None else {LOAD_CV.name: Variable(ratings.load_cv, ("rating_row",))}),
        **({} if ratings.resolution is None else {RESOLUTION.name: Variable(ratings.resolution, ("rating_row",))}),
        **({} if ratings.lists is None else {"list_index": Variable(ratings.lists, ("rating_row",))}),
        **stored_curves(draws.scene.firing),
        **_of_cells(draws),
        **_in_the_model(draws, scale),
        **{
            f"{what}_index": Variable(getattr(ratings, what), ("rating_row",))
            for what in ("participant", "fabric", "load")
        },
        RATING_LINE: Variable(ratings.rows, ("rating_row",)),
        **_picks(draws),
    }


def _picks(draws: RatedDraws) -> dict[str, Variable]:
    """Return chain and draw, in the posterior, of the draws of groups that have only some of them."""
    found = {}
    for group, size in draws.picks.items():
        for what, values in zip(("chain", "draw"), draws.picked(size), strict=True):
            found[f"{group}_{what}"] = Variable(values, (f"draw_of_{group}",))
    return found


def _of_cells(draws: RatedDraws) -> dict[str, Variable]:
    """Return the numbers of raters and the standard deviations between them, if ratings are cell means."""
    cells = draws.experiment.ratings.cells
    if cells is None:
        return {}
    known = {} if cells.geometric_sd is None else {GEOMETRIC_SD.name: Variable(cells.geometric_sd, ("rating_row",))}
    return {RATERS_OF_CELLS: Variable(np.array(cells.raters)), **known}


def observed(draws: RatedDraws, scale: Scale) -> dict[str, Variable]:
    """Return the ratings as in the file; ranks and pairs as the model has them, as replicates are."""
    filed = draws.experiment.ratings.rating
    return {"rating": Variable(scale.filed(draws.ratings.values) if scale.answer else filed, ("rating_row",))}


def _in_the_model(draws: RatedDraws, scale: Scale) -> dict[str, Variable]:
    """Return what the model has instead of ratings that are no exact numbers: values in means, ends of intervals."""
    ends, filed, values = draws.ratings.ends, draws.experiment.ratings.rating, scale.filed(draws.ratings.values)
    values = np.where(np.isclose(values, filed, rtol=1e-12), filed, values)  # rounding of shares
    other = filed if scale.answer else values
    found = {} if np.array_equal(filed, values) else {RATING_AS_FILED if scale.answer else RATING_VALUE: other}
    found |= {} if ends is None else {RATING_LOW: scale.filed(ends[0]), RATING_HIGH: scale.filed(ends[1])}
    return {name: Variable(values, ("rating_row",)) for name, values in found.items()}


def _finger_radius(draws: RatedDraws) -> float:
    """Return the finger's radius [m], or its posterior median if it is sampled."""
    sampled = np.asarray(draws.posterior.space.touch(draws.theta).radius)
    return float(np.median(sampled)) if sampled.any() else draws.scene.finger.radius


def coordinates(draws: RatedDraws, grid: Scene) -> dict[str, NDArray[Any]]:
    """Return the coordinates of the axes; `grid` is the scene of the response curves."""
    ratings, compression = draws.experiment.ratings, draws.experiment.compression
    points, moduli = grid.n_conditions // len(grid.loads), draws.posterior.space.moduli
    return {
        "participant": np.array(ratings.participants),
        "fabric": np.array(ratings.fabrics),
        **({UNCERTAIN: _uncertain(moduli)} if moduli is not None and moduli.uncertain else {}),
        "load": np.array([str(load) for load in ratings.loads]),
        **({LOAD_GROUP: np.array(draws.load_groups.names)} if draws.load_groups.merged else {}),
        "e_fab_kpa": grid.modulus[:points] * 1e-3,
        **({} if compression is None else plate_coordinates(compression)),
    }


def _uncertain(moduli: FabricModuli) -> NDArray[Any]:
    """Return the names of the fabrics whose modulus is sampled."""
    return np.array([moduli.names[k] for k in moduli.uncertain])


def stored_curves(firing: Firing) -> dict[str, Variable]:
    """Return the rate curves averaged over noise, whose simulation takes minutes; empty without noise."""
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
