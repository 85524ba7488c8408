"""Data of a run as groups of its result, and back: ratings, fabrics, loads, forces and recorded afferents."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.files.records import as_json, parse_json
from softness_bayes.base.laws import LogNormal, LogUniform
from softness_bayes.checking import layout
from softness_bayes.checking.agreement import RATERS_OF_CELLS
from softness_bayes.checking.check_table import LOO_PIT, PARETO_K
from softness_bayes.checking.checks import LooPit
from softness_bayes.checking.individual import MODULUS_LAW, modulus_laws
from softness_bayes.data import Afferents, Compression, Experiment, Fabrics, Ratings
from softness_bayes.data.columns import (
    EFFECTIVE_MODULUS,
    FORCE,
    GEOMETRIC_SD,
    INDENTATION,
    LOAD_CV,
    POISSON_RATIO,
    RESOLUTION,
    Column,
)
from softness_bayes.data.forms import AggregatedCells
from softness_bayes.data.measurements import RESPONSES
from softness_bayes.data.ratings import loads_by_column
from softness_bayes.parameters.declared import EVERY_PARAMETER
from softness_bayes.parameters.space import ParameterSpace
from softness_bayes.results.draws import Groups, RatedDraws, Variable
from softness_bayes.results.stored import Stored
from softness_bayes.touch.contact import loads_at
from softness_bayes.touch.neuron.fixed_channels import FixedChannels, make_known
from softness_bayes.touch.neuron.membrane import Channels
from softness_bayes.touch.neuron.rate_curve import CurveError, Firing, RateCurve
from softness_bayes.touch.scene import Scene

Array = NDArray[np.float64]

NOISE_CURVES = "noise_curves"
"""Attribute with the rate curves averaged over noise, whose simulation takes minutes."""


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
    same, other = np.array_equal(modelled, filed), filed if scale.answer else modelled
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
        layout.RATING_AS_FILED if scale.answer else layout.RATING_VALUE: None if same else other,
        layout.RATING_LOW: None if ends is None else scale.filed(ends[0]),
        layout.RATING_HIGH: None if ends is None else scale.filed(ends[1]),
        "participant_index": ratings.participant,
        "fabric_index": ratings.fabric,
        "load_index": ratings.load,
        layout.RATING_LINE: ratings.rows,
    }
    constant = {
        **held_parameters(space),
        "finger_radius_mm": Variable(np.array(radius * 1e3), units="mm"),
        EFFECTIVE_MODULUS.name: Variable(
            draws.scene.fabric_modulus / EFFECTIVE_MODULUS.factor, ("fabric",), EFFECTIVE_MODULUS.unit
        ),
        POISSON_RATIO.name: Variable(fabrics.poisson_ratio, ("fabric",)),
        **{name: Variable(np.asarray(values), ("rating_row",)) for name, values in rows.items() if values is not None},
    }
    for column, held in loads_by_column(ratings.loads).items():
        constant[column.name] = Variable(held / column.factor, ("load",), column.unit)
    if any(fabrics.batch):
        constant[layout.BATCH] = Variable(np.array(fabrics.batch), ("fabric",))
    if laws:
        constant[MODULUS_LAW] = Variable(np.array(laws), (layout.UNCERTAIN,))
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
        axes[layout.UNCERTAIN] = np.array([moduli.names[k] for k in moduli.uncertain])
    if draws.load_groups.merged:
        axes[layout.LOAD_GROUP] = np.array(draws.load_groups.names)
    return axes


def stored_curves(firing: Firing) -> dict[str, str]:
    """Return the rate curves averaged over noise, as an attribute; empty without noise."""
    curves = firing.averaged if isinstance(firing, FixedChannels) else ()
    rows = [
        (curve.coefficients.tolist(), *map(float, (curve.rheobase, curve.onset_rate, curve.max_current)), curve.error)
        for curve in curves
    ]
    return {NOISE_CURVES: as_json(rows, "rate curves")} if rows else {}


def restore_curves(result: Stored) -> None:
    """Make the averaged curves of a stored run known, if it has any."""
    constant = result.group("constant_data")
    for coefficients, rheobase, onset_rate, limit, error in parse_json(result.attributes.get(NOISE_CURVES, "[]")):
        channels = Channels(*(float(constant[name]) for name in Channels._fields))
        curve = RateCurve(np.array(rheobase), np.array(onset_rate), np.array(coefficients), limit, CurveError(*error))
        make_known(result.provenance.rating_model.noise, channels, result.readings.membrane, curve)


def experiment_of(result: Stored) -> Experiment:
    """Return the data stored in a result: ratings, fabrics by their moduli, and compression data if any.

    Raises
    ------
    InputError
        If the run had no ratings.
    """
    loads, constant, data = result.loads, result.group("constant_data"), result.provenance.rating_data

    def rows(name: str) -> NDArray[Any] | None:
        return constant[name].values if name in constant else None

    filed, fabrics = rows(layout.RATING_AS_FILED), _fabrics_of(result)
    raters = constant.get(RATERS_OF_CELLS)
    ratings = Ratings(
        tuple(str(name) for name in result.group("log_likelihood_participant")["participant"].values),
        fabrics.names,
        loads,
        participant=constant["participant_index"].values,
        fabric=constant["fabric_index"].values,
        load=constant["load_index"].values,
        rating=result.group("observed_data")["rating"].values if filed is None else filed,
        rows=constant[layout.RATING_LINE].values,
        n_missing=data.missing_ratings,
        rating_column=data.rating_column,
        digest=data.digest_ratings,
        load_cv=rows(LOAD_CV.name),
        resolution=rows(RESOLUTION.name),
        lists=rows("list_index"),
        cells=None if raters is None else AggregatedCells(int(raters), rows(GEOMETRIC_SD.name)),
    )
    compression = _compression_of(result) if result.has_compression else None
    return Experiment(ratings, fabrics, (), compression, _afferents_of(result) if result.has_afferents else None)


def _fabrics_of(result: Stored) -> Fabrics:
    """Return the fabrics of a result, with the errors of their moduli."""
    fabrics, laws = result.fabrics, modulus_laws(result.group("constant_data"))
    if not laws:
        return fabrics
    measured, cv, low, high = fabrics.effective_modulus.copy(), *np.full((3, len(fabrics)), np.nan)
    for name, law in laws.items():
        k = fabrics.names.index(name)
        if law == result.provenance.asked.unknown_modulus:
            measured[k] = np.nan
        elif isinstance(law, LogUniform):
            measured[k], low[k], high[k] = np.nan, law.low * 1e3, law.high * 1e3
        else:
            assert isinstance(law, LogNormal)
            cv[k] = np.sqrt(np.expm1(law.sd_log**2))
    return replace(
        fabrics,
        effective_modulus=measured,
        effective_modulus_cv=cv,
        effective_modulus_low=low,
        effective_modulus_high=high,
    )


def _compression_of(result: Stored) -> Compression:
    constant, force = result.group("constant_data"), result.group("observed_data")["plate_force_n"]
    return Compression(
        tuple(str(name) for name in result.group("posterior")["finger"].values),
        constant["finger_index"].values,
        constant["force_indentation_mm"].values * 1e-3,
        force.values,
        force["force_row"].values,
        n_zero=result.provenance.plate.zero_forces,
        digest=result.provenance.plate.digest_compression,
    )


def _afferents_of(result: Stored) -> Afferents:
    constant, observed = result.group("constant_data"), result.group("observed_data")["recorded_rate_hz"]
    posterior, every = result.group("posterior"), {**constant, "recorded_rate_hz": observed}

    def stored(column: Column) -> Any:
        return every[f"recorded_{column.name}"].values * column.factor

    return Afferents(
        tuple(str(name) for name in posterior["afferent"].values) if "afferent" in posterior.dims else (),
        constant["afferent_index"].values,
        loads_at(stored(INDENTATION), stored(FORCE)),
        **{name: stored(column) for name, column in RESPONSES.items()},
        rows=observed["recorded_row"].values,
        digest=result.provenance.recorded.digest_afferents,
    )
