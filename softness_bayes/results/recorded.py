"""Groups, table and findings of recorded afferents in the result of a run."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from softness_bayes.data import Afferents
from softness_bayes.data.columns import CURVATURE, DISTANCE
from softness_bayes.data.ratings import loads_by_column
from softness_bayes.likelihood.contract import NO_RESPONSE, Parameters
from softness_bayes.model.posterior import Density
from softness_bayes.parameters.declared import EVERY_PARAMETER, RECORDED, SHAREABLE
from softness_bayes.provenance import RecordedData, attributes_of
from softness_bayes.recordings.findings import RecordedFindings, log_additive_sd, shifts
from softness_bayes.recordings.likelihood import RecordedRates
from softness_bayes.results.agreement import agreements
from softness_bayes.results.draws import Groups, Variable

Array = NDArray[np.float64]

ROW = ("recorded_row",)
"""Axis of variables with one value per recorded response."""


def recorded_results(
    rng: np.random.Generator,
    data: Afferents | None,
    density: Density,
    theta: Array,
    replicates: Array,
    prior: Array,
    curves: Array,
) -> tuple[Groups, dict[str, NDArray[Any]], dict[str, Any], pd.DataFrame | None]:
    """Draw sensitivities and replicated responses; return them, the data, expectations and findings.

    Parameters
    ----------
    rng
        Random generator of effects and noise.
    data, density
        The data, and the density that was sampled.
    theta
        All draws, shape (chains, draws, dimension).
    replicates, prior
        Draws of the posterior and of the prior, shape (draws, dimension), for which responses are simulated.
    curves
        Draws for the expected rates.

    Returns
    -------
    groups, coordinates, attributes, table
        The groups, the coordinates of their axes, the provenance of the data, and each response beside its prediction;
        empty and None without such data.
    """
    term = density.term(RECORDED)
    if data is None or not isinstance(term, RecordedRates):
        return {}, {}, {}, None
    own, given, before, shown = (_parameters(density, term, points) for points in (theta, replicates, prior, curves))
    effects, rate = term.draw_effects(rng, NO_RESPONSE, given), term.rate(given)
    window = np.where(data.counted, data.window, 1.0)
    again = term.replicate(rng, rate, given, effects) / window
    anew = term.new_effects(rng, before, prior.shape[:1])
    made = term.replicate(rng, term.rate(before), before, anew) / window
    expected = term.rate(shown) * term.factors(term.draw_effects(rng, NO_RESPONSE, shown))
    groups: Groups = {
        "posterior_predictive": {"recorded_rate_hz": Variable(again[None], ROW, "Hz")},
        "prior_predictive": {"recorded_rate_hz": Variable(made[None], ROW, "Hz")},
        "predictions": {"expected_rate_hz": Variable(expected[None], ROW, "Hz")},
        "log_likelihood": {"recorded_rate_hz": Variable(term.left_out(NO_RESPONSE, given).log_density[None], ROW)},
        "observed_data": {"recorded_rate_hz": Variable(data.observed, ROW, "Hz")},
        "constant_data": {
            "probe_curvature_per_m": Variable(data.curvature, ROW, CURVATURE.unit),
            "probe_distance_mm": Variable(data.distance / DISTANCE.factor, ROW, DISTANCE.unit),
            **{
                f"probe_{column.name}": Variable(values / column.factor, ROW, column.unit)
                for column, values in loads_by_column(data.loads).items()
            },
            "afferent_index": Variable(data.afferent, ROW),
            "averaged_responses": Variable(data.n, ROW),
            "averaged_sd_hz": Variable(data.sd, ROW, "Hz"),
            "count_window_s": Variable(data.window, ROW, "s"),
        },
    }
    if data.names:
        factors = term.draw_effects(rng, NO_RESPONSE, own).log_factor
        groups["posterior"] = {"log_rate_effect": Variable(factors, ("afferent",))}
    names = {"afferent": np.array(data.names)} if data.names else {}
    found = _findings(density, term, data, own, expected)
    attributes = attributes_of(RecordedData(data.digest, found.record()))
    return groups, {"recorded_row": data.rows, **names}, attributes, _table(data, expected, again)


def _parameters(density: Density, term: RecordedRates, theta: Array) -> Parameters:
    return density.parameters_of(term, theta).each(lambda value: np.broadcast_to(value, theta.shape[:-1]))


def _findings(
    density: Density, term: RecordedRates, data: Afferents, own: Parameters, expected: Array
) -> RecordedFindings:
    at = term.model.afferent(own)
    rest, sigma_0 = term.touches.at_rest(at)
    draws = at._replace(sigma_0=sigma_0)._asdict()
    natural = {name: draws[name] / EVERY_PARAMETER[name].si for name in SHAREABLE}
    low, middle, high = np.quantile(rest, [0.05, 0.5, 0.95]).tolist()
    return RecordedFindings(
        float(np.sqrt(np.mean((data.observed - expected.mean(axis=0)) ** 2))),
        log_additive_sd(data),
        shifts(natural, term.touches.readings.skin_displacement),
        (low, middle, high),
        float((rest > 1.0).mean()),
        agreements(density),
    )


def _table(data: Afferents, expected: Array, again: Array) -> pd.DataFrame:
    """Return each response with the median of its expectation and 90 % limits of its replicates."""
    columns: dict[str, Any] = {"recording": data.recording} if data.recording else {}
    columns["afferent"] = [data.names[k] if k >= 0 else "" for k in data.afferent]
    loads = loads_by_column(data.loads).items()
    columns |= {column.name: values / column.factor for column, values in loads if not np.isnan(values).all()}
    columns |= {CURVATURE.name: data.curvature, DISTANCE.name: data.distance / DISTANCE.factor}
    columns["rate_hz"] = data.observed
    columns["expected_hz"] = np.median(expected, axis=0)
    columns["low_hz"], columns["high_hz"] = np.quantile(again, [0.05, 0.95], axis=0)
    return pd.DataFrame(columns, index=pd.Index(data.rows, name="row"))
