"""Tables of the page as text: estimates, predictive checks, and provenance."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from softness_bayes.checking.check_table import ALL
from softness_bayes.checking.quantities import DROP, PLACE
from softness_bayes.checking.turning_check import FALL
from softness_bayes.files.run_files import FABRIC_RATINGS
from softness_bayes.parameters.declared import EVERY_PARAMETER
from softness_bayes.parameters.laws import Prior, in_short
from softness_bayes.provenance import NumericalErrors, Silence
from softness_bayes.readable import counted, number, percent, with_error
from softness_bayes.results.request import Request
from softness_bayes.results.result import Result


def share(value: Any) -> str:
    """Return a share in per cent, the sign behind a space that no line breaks at; a dash where there is none."""
    return percent(float(value)).replace(" ", "\u00a0")


class PageTable(NamedTuple):
    """A table of text; the first cell of each row is the row heading."""

    name: str
    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]


TOLD = {
    PLACE: "E_fab at the turning point [kPa]",
    DROP: "drop beyond the turning point",
    FALL: "fall beyond the turning point / expected",
}
"""Descriptions of test quantities whose names in files are those of the paper."""

LEVELS_MEANING = {"mu": "mean log rating of a typical participant", "c0": "intercept", "c1": "slope"}
"""Descriptions of the levels, which are sampled after a run and are not declared as parameters."""


def of_parameters(result: Result) -> PageTable:
    """Return estimates of every parameter."""
    priors = result.provenance.priors
    head = ["Parameter", "Meaning", "Unit", "Prior", "Mean", "Sd", "HDI", "Sd / prior’s"]
    head += ["Prior’s pull", "Data’s pull", "R-hat", "ESS bulk", "ESS tail", "MCSE of mean"]
    rows = []
    for label, row in result.summary().iterrows():
        name = str(label)
        parameter = EVERY_PARAMETER.get(name)
        rows.append(
            [
                name,
                parameter.meaning if parameter else LEVELS_MEANING.get(name, "–"),
                parameter.unit if parameter else "–",
                _prior(priors.get(name)),
                number(row["mean"], 4),
                number(row["sd"]),
                f"{number(row['hdi_low'])} to {number(row['hdi_high'])}",
                number(np.sqrt(max(1.0 - row["contraction"], 0.0)), 2),
                number(row["psens_prior"], 2),
                number(row["psens_likelihood"], 2),
                number(row["r_hat"], 5),
                number(np.rint(row["ess_bulk"]), 6),
                number(np.rint(row["ess_tail"]), 6),
                number(row["mcse_mean"], 2),
            ]
        )
    interval = share(result.summary()["hdi_prob"].iloc[0])
    caption = (
        f"Posterior of every parameter. HDI: the narrowest interval with {interval}. Sd / prior’s: width of "
        "the posterior relative to the prior; 1 means that nothing was learnt. Pulls: power-scaling "
        "sensitivity, the shift of the posterior per doubling of the power of prior or likelihood."
    )
    return PageTable("summary", caption, head, rows)


def _prior(prior: Prior | None) -> str:
    return "–" if prior is None else in_short(prior).replace(",", ", ")


def of_directions(result: Result) -> PageTable:
    """Return the combinations of parameters, ordered from best to worst constrained."""
    table = result.tables["directions"]
    rows = [
        [str(k), number(np.sqrt(max(1.0 - row["contraction"], 0.0)), 2), str(row["meaning"])]
        for k, row in table.iterrows()
    ]
    caption = (
        "Independent combinations of the logarithms of the parameters, best determined first: width relative "
        "to the prior, and the corresponding product of parameters. The 90 % limits of the product are its "
        "median multiplied and divided by the factor."
    )
    return PageTable("directions", caption, ["Direction", "Sd / prior’s", "In words"], rows)


def of_turning_points(result: Result) -> PageTable:
    """Return the turning points of the response under each load."""
    head = ["Load", "Turns over", "under the prior", "Does not", "Silent", "Among the fabrics"]
    head += ["E_fab [kPa]", "E_fab / E_skin", "Force [N]", "Drop beyond"]
    rows = []
    for load, row in result.inflection().iterrows():
        places = [_interval(row, name) for name in ("e_fab_kpa", "ratio", "force_n")]
        names = ("p_interior", "prior_p_interior", "p_none", "p_silent", "p_inside")
        chances = [with_error(100 * row[name], 100 * row[f"{name}_mcse"], "\u00a0%") for name in names]
        drop = "–" if np.isnan(row["drop"]) else f"{share(row['drop'])} ({share(row['drop_low'])} to "
        drop += "" if np.isnan(row["drop"]) else f"{share(row['drop_high'])})"
        rows.append([str(load), *chances, *places, drop])
    low, *_, high = result.group("predictions")["e_fab_kpa"].values
    caption = (
        "Turning points. A turning point is a maximum from which the response falls by at least "
        f"{share(result.least_drop)} towards both {number(low)} and {number(high)} kPa. Columns: its "
        "probability, and that of one within the range of the fabrics’ moduli; then medians and 90 % "
        "intervals over the draws with a turning point. ±: Monte-Carlo standard error."
    )
    if result.load_groups.merged:
        caption += f" Note: {result.load_groups.sentence}; each row is at the middle load of its group."
    return PageTable("inflection", caption, head, rows)


def _interval(row: pd.Series, name: str) -> str:
    low, middle, high = (with_error(row[key], row[f"{key}_mcse"]) for key in (f"{name}_low", name, f"{name}_high"))
    return "–" if middle == "–" else f"{middle} ({low} to {high})"


MOST_FABRICS = 60
"""Largest number of rows in the table of fabrics; longer tables show only the largest differences."""

NOTABLE = 2.0
"""Number of standard deviations above which a difference is marked."""


def of_fabrics(result: Result) -> PageTable:
    """Return the rated and predicted softness of every fabric under every load."""
    table = result.tables[FABRIC_RATINGS].reset_index()
    shown = table
    if len(table) > MOST_FABRICS:
        far = table["difference_sd"].abs().sort_values(ascending=False, kind="stable").index[:MOST_FABRICS]
        shown = table.loc[sorted(far)]
    rows = [
        [
            str(row["fabric"]),
            str(row["load"]),
            number(row["e_fab_kpa"]),
            str(int(row["ratings"])),
            number(row["rated"]),
            number(row["predicted"]),
            f"{number(row['predicted_low'])} to {number(row['predicted_high'])}",
            _signed(row["difference_sd"]),
        ]
        for _, row in shown.iterrows()
    ]
    away = int((table["difference_sd"].abs() >= NOTABLE).sum())
    left_out = "" if len(shown) == len(table) else f" Shown are the {len(shown)} with the largest differences."
    caption = (
        f"Rated and predicted softness of {len(table)} pairs of fabric and load: mean ratings, medians and 90 "
        "% bands of replicated means from the fitted model, and the difference in standard deviations of the "
        f"replicates. {counted(away, 'differs', 'differ')} by {NOTABLE:g} or more (✱).{left_out}"
    )
    head = ["Fabric", "Load", "E_fab [kPa]", "Ratings", "Rated", "Predicted", "90 % band", "Difference [sd]"]
    return PageTable("fabrics", caption, head, rows)


def _signed(value: Any) -> str:
    """Return a difference with its sign, and with a mark if it is large."""
    value = float(value)
    return f"{value:+.1f}{' ✱' if abs(value) >= NOTABLE else ''}" if np.isfinite(value) else "–"


def of_checks(result: Result) -> PageTable:
    """Return every predictive check of the posterior."""
    checks = result.tables["predictive_checks"].reset_index()
    rows = []
    for _, row in checks[checks["law"] == "posterior"].iterrows():
        where = ", ".join(str(row[k]) for k in ("load", "fabric", "participant") if row[k] != ALL)
        limits = "–" if np.isnan(row["low"]) else f"{number(row['low'])} to {number(row['high'])}"
        cells = [number(row["observed"]), number(row["replicated"]), limits, number(row["p_value"], 2)]
        rows.append([TOLD.get(str(row["quantity"]), str(row["quantity"])), where or "all ratings", *cells])
    caption = (
        "Posterior predictive checks: test quantities of the data and of replicates from the fitted model. "
        "Limits contain 90 % of the replicates, jointly over the rows of a quantity; p is the probability "
        "that a replicate exceeds the data."
    )
    return PageTable("checks", caption, ["Quantity", "Of", "Data", "Replicates", "Limits", "p"], rows)


def of_provenance(result: Result) -> list[PageTable]:
    """Return the provenance of the run: data, model, sampling, numerical errors, versions."""
    provenance, options = result.provenance, Request.of(result).model
    ending = provenance.ending
    held = result.group("constant_data")
    model = [("Readings", options.readings.label), *((place, name) for place, name in options.readings.names.items())]
    if result.has_ratings:
        model += [("Ratings", options.scale.name), ("Direction", provenance.direction.direction.name)]
        model += [
            ("Noise on the membranes", number(options.noise)),
            ("Resolution", str(options.discretisation)),
        ]
    model += [("Set of priors", options.prior_set)]
    model += [(f"{name} held at", _value(held, name)) for name in EVERY_PARAMETER if name in held]
    sampling = [
        ("Seed", str(provenance.asked.seed)),
        ("Steps of each ensemble", str(ending.steps)),
        ("of these burn-in", str(ending.burn_in)),
        ("Points evaluated", str(ending.evaluations)),
        ("of these, could not be computed", str(ending.failures)),
        ("Sampling took", f"{ending.sampling_seconds:.0f} s"),
    ]
    versions = [*provenance.versions.items()]
    parts: Iterable[tuple[str, str, list[tuple[str, str]]]] = (
        ("data", "Data", _data(result)),
        ("model", "Model", model),
        ("sampling", "Sampling", sampling),
        *(
            (("errors", "Numerical errors", _errors(provenance.errors, provenance.silence)),)
            if result.has_ratings
            else ()
        ),
        ("versions", "Versions", [*versions, ("schema of posterior.nc", str(provenance.asked.schema_version))]),
    )
    return [PageTable(name, caption, [], rows) for name, caption, rows in parts]


def _value(held: Any, name: str) -> str:
    unit = EVERY_PARAMETER[name].unit
    return f"{float(held[name]):.6g}{f' {unit}' if unit != '–' else ''}"


def _data(result: Result) -> list[tuple[str, str]]:
    rows = []
    if result.has_ratings:
        data = result.provenance.rating_data
        rows += [("SHA-256 of ratings", data.digest_ratings), ("SHA-256 of fabrics", data.digest_fabrics)]
        rows += [("Missing ratings", str(data.missing_ratings))]
    if result.has_compression:
        plate = result.provenance.plate
        rows += [("SHA-256 of compression", plate.digest_compression)]
        rows += [("Rows without force (dropped)", str(plate.zero_forces))]
    if result.has_afferents:
        rows += [("SHA-256 of afferents", result.provenance.recorded.digest_afferents)]
    return [(name, value or "not recorded: the data were made in Python") for name, value in rows]


def _errors(errors: NumericalErrors, silence: Silence) -> list[tuple[str, str]]:
    return [
        ("Response, largest error as a share of the peak", number(errors.numerical_error, 2)),
        ("Firing rates, the same if every receptor had the largest error", number(errors.firing_error, 2)),
        ("Log-likelihood of draws, sd of its error", _compared(errors.exactness_sd)),
        ("Log-likelihood of draws, largest error", _compared(errors.exactness_largest)),
        ("No firing in any condition, share of the prior", share(silence.prior_silent_everywhere)),
        ("No firing in any condition, share of the posterior", share(silence.posterior_silent_everywhere)),
        ("Contact beyond half the fingertip’s radius", share(silence.contact_beyond_half_radius)),
        ("Contact beyond the fingertip’s radius", share(silence.contact_beyond_radius)),
    ]


def _compared(error: float) -> str:
    """Return an error of the log-likelihood; a first look does not measure it."""
    return f"{error:.1g}" if math.isfinite(error) else "not checked"
