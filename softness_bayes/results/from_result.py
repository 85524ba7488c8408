"""Data and options of a finished run, restored from its result alone."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from softness_bayes.checking.individual import modulus_laws
from softness_bayes.data import Compression, Experiment, Fabrics, Ratings
from softness_bayes.data.columns import GEOMETRIC_SD, LOAD_CV, RESOLUTION
from softness_bayes.data.forms import AggregatedCells
from softness_bayes.defaults import ACCURACY
from softness_bayes.likelihood.error_laws import NORMAL, error_law_named
from softness_bayes.likelihood.scales import name_of_scale
from softness_bayes.model.fingers import values_of
from softness_bayes.model.options import ModelOptions
from softness_bayes.parameters.declared import EVERY_PARAMETER
from softness_bayes.parameters.priors import LogNormal, LogUniform
from softness_bayes.results.constants import RATERS_OF_CELLS, RATING_AS_FILED
from softness_bayes.results.lookup import Named
from softness_bayes.results.stored import Stored
from softness_bayes.touch.scene import Discretisation


def experiment_of(result: Stored) -> Experiment:
    """Return the data stored in a result: ratings, fabrics by their moduli, and compression data if any.

    Raises
    ------
    InputError
        If the run had no ratings.
    """
    loads, constant, found = result.loads, result.group("constant_data"), result.provenance.rating_data
    rating = result.group("observed_data")["rating"]
    fabrics = _fabrics_of(result)
    ratings = Ratings(
        tuple(str(name) for name in result.group("log_likelihood_participant")["participant"].values),
        fabrics.names,
        loads,
        participant=constant["participant_index"].values,
        fabric=constant["fabric_index"].values,
        load=constant["load_index"].values,
        rating=constant[RATING_AS_FILED].values if RATING_AS_FILED in constant else rating.values,
        rows=rating["rating_row"].values,
        n_missing=found.missing_ratings,
        digest=found.digest_ratings,
        load_cv=constant[LOAD_CV.name].values if LOAD_CV.name in constant else None,
        resolution=constant[RESOLUTION.name].values if RESOLUTION.name in constant else None,
        lists=constant["list_index"].values if "list_index" in constant else None,
        cells=_cells_of(constant),
    )
    return Experiment(ratings, fabrics, (), _compression_of(result) if result.has_compression else None)


def _cells_of(constant: Any) -> AggregatedCells | None:
    """Return numbers of raters and standard deviations of cells, if ratings are cell means."""
    if RATERS_OF_CELLS not in constant:
        return None
    known = constant[GEOMETRIC_SD.name].values if GEOMETRIC_SD.name in constant else None
    return AggregatedCells(int(constant[RATERS_OF_CELLS]), known)


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
    found = result.provenance.plate
    return Compression(
        tuple(str(name) for name in result.group("posterior")["finger"].values),
        constant["finger_index"].values,
        constant["force_indentation_mm"].values * 1e-3,
        force.values,
        force["force_row"].values,
        n_zero=found.zero_forces,
        digest=found.digest_compression,
    )


def options_of(result: Stored) -> ModelOptions:
    """Return the options of the model from which a result was sampled."""
    found, constant = result.provenance, result.group("constant_data")
    asked = Named(found.asked.options, "option", f"{result.source}: attribute 'options'")
    taken, priors = found.direction, found.priors
    decided = {
        "direction": not taken.direction_asked,
        "discretisation": asked.get("accuracy") is not None,
        "errors": bool(asked.get("errors_decided")),
    }
    return ModelOptions(
        fix={name: float(constant[name]) for name in EVERY_PARAMETER if name in constant},
        priors={name: priors[name] for name in EVERY_PARAMETER if name in priors},
        prior_set=found.asked.prior_set,
        readings=result.readings,
        direction=taken.direction,
        scale=result.scale,
        finger=result.finger,
        modulus_cv=asked.get("modulus_cv"),
        load_cv=asked.get("load_cv"),
        shared_load_cv=asked.get("shared_load_cv"),
        unknown_modulus=result.provenance.asked.unknown_modulus,
        individual=tuple(asked.get("individual") or ()),
        discretisation=Discretisation(**asked["discretisation"]),
        accuracy=asked.get("accuracy") or ACCURACY,
        errors=error_law_named(found.rating_model.rating_errors),
        resolution=asked.get("resolution"),
        n_categories=asked.get("n_categories"),
        slider_ends=tuple(asked.get("slider_ends") or (0.0, 1.0)),
        noise=found.rating_model.noise,
        decided=frozenset(name for name, so in decided.items() if so),
    )


def differences(results: dict[str, Stored]) -> dict[str, str]:
    """Return, for each result, the readings, scale, direction, priors and fixed values in which its model differs."""
    told = {label: _model(result) for label, result in results.items()}
    every = dict.fromkeys(key for model in told.values() for key in model)
    apart = [key for key in every if len({model.get(key, "–") for model in told.values()}) > 1]
    return {label: ", ".join(f"{key}={model.get(key, '–')}" for key in apart) for label, model in told.items()}


def _model(result: Stored) -> dict[str, str]:
    options = options_of(result)
    return {
        **options.readings.names,
        "ratings": name_of_scale(options.scale),
        "direction": result.provenance.direction.direction.name,
        **({"individual": ",".join(options.individual)} if options.individual else {}),
        **{name: str(prior) for name, prior in options.priors.items()},
        **{name: f"{np.format_float_positional(value, 6, trim='-')}" for name, value in options.fix.items()},
        **{name: f"{value:g}" for name, value in values_of(options.finger).items()},
        **({} if options.errors in (None, NORMAL) else {"errors": options.errors.name}),
        **({} if options.resolution is None else {"resolution": f"{options.resolution:g}"}),
        **({"load_cv": f"{options.load_cv:g}"} if options.load_cv else {}),
        **({"shared_load_cv": f"{options.shared_load_cv:g}"} if options.shared_load_cv else {}),
        **({"compression": result.provenance.plate.digest_compression[:8]} if result.has_compression else {}),
    }
