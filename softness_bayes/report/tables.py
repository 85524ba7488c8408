"""Tables of the page as text, and the commands that repeat the run."""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import zip_longest
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from softness_bayes.base.files.command_line import storable
from softness_bayes.base.files.run_files import FABRIC_RATINGS
from softness_bayes.base.laws import in_short
from softness_bayes.base.options import Flag
from softness_bayes.base.readable import counted, number, percent, with_error
from softness_bayes.checking.check_table import ALL
from softness_bayes.checking.quantities import DROP, FALL, PLACE
from softness_bayes.parameters.declared import EVERY_PARAMETER
from softness_bayes.results.result import Result
from softness_bayes.results.run_options import DataFiles, Request

Row = Mapping[str, Any]
Columns = Mapping[str, Callable[[Row], str]]
"""Heads of columns, and functions that return the text of a cell from a row of numbers."""

PAPER_NAMES = {
    PLACE: "E_fab at the turning point [kPa]",
    DROP: "drop beyond the turning point",
    FALL: "fall beyond the turning point / expected",
}
"""Descriptions of test quantities whose names in files are those of the paper."""

LEVELS = {"mu": "mean log rating of a typical participant", "c0": "intercept", "c1": "slope"}
"""Descriptions of the levels, which are sampled after a run and are not declared as parameters."""

_WHERE = ("load", "fabric", "participant")

MOST_FABRICS = 60
"""Largest number of rows in the table of fabrics; longer tables show only the largest differences."""

NOTABLE = 2.0
"""Number of standard deviations above which a difference is marked."""


class PageTable(NamedTuple):
    """A table of text; the first cell of each row is the row heading."""

    name: str
    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]


def _table(name: str, caption: str, table: pd.DataFrame, columns: Columns) -> PageTable:
    rows: Any = table.reset_index().to_dict("records")
    return PageTable(name, caption, [*columns], [[text(row) for text in columns.values()] for row in rows])


def share(value: Any) -> str:
    """Return a share in per cent, the sign behind a space that no line breaks at; a dash where there is none."""
    return percent(float(value)).replace(" ", "\u00a0")


def _words(name: str) -> Callable[[Row], str]:
    return lambda row: str(row[name])


def _number(name: str, digits: int = 3) -> Callable[[Row], str]:
    return lambda row: number(row[name], digits)


def _interval(low: str, high: str) -> Callable[[Row], str]:
    return lambda row: "–" if np.isnan(row[low]) else f"{number(row[low])} to {number(row[high])}"


def _width(row: Row) -> str:
    """Return the posterior's width relative to that of the prior."""
    return number(np.sqrt(max(1.0 - row["contraction"], 0.0)), 2)


def of_parameters(result: Result) -> PageTable:
    """Return estimates of every parameter."""
    priors, summary = result.provenance.priors, result.summary()
    whole = summary.assign(ess_bulk=summary["ess_bulk"].round(), ess_tail=summary["ess_tail"].round())
    columns = {
        "Parameter": _words("parameter"),
        "Meaning": lambda row: known.meaning if (known := _declared(row)) else LEVELS.get(row["parameter"], "–"),
        "Unit": lambda row: known.unit if (known := _declared(row)) else "–",
        "Prior": lambda row: in_short(law).replace(",", ", ") if (law := priors.get(row["parameter"])) else "–",
        "Mean": _number("mean", 4),
        "Sd": _number("sd"),
        "HDI": _interval("hdi_low", "hdi_high"),
        "Sd / prior’s": _width,
        "Prior’s pull": _number("psens_prior", 2),
        "Data’s pull": _number("psens_likelihood", 2),
        "R-hat": _number("r_hat", 5),
        "ESS bulk": _number("ess_bulk", 6),
        "ESS tail": _number("ess_tail", 6),
        "MCSE of mean": _number("mcse_mean", 2),
    }
    caption = (
        f"Posterior of every parameter. HDI: the narrowest interval with {share(summary['hdi_prob'].iloc[0])}. Sd / "
        "prior’s: width of the posterior relative to the prior; 1 means that nothing was learnt. Pulls: power-scaling "
        "sensitivity, the shift of the posterior per doubling of the power of prior or likelihood."
    )
    return _table("summary", caption, whole.rename_axis("parameter"), columns)


def _declared(row: Row) -> Any:
    return EVERY_PARAMETER.get(row["parameter"])


def of_directions(result: Result) -> PageTable:
    """Return the combinations of parameters, ordered from best to worst constrained."""
    caption = (
        "Independent combinations of the logarithms of the parameters, best determined first: width relative "
        "to the prior, and the corresponding product of parameters. The 90 % limits of the product are its "
        "median multiplied and divided by the factor."
    )
    columns = {"Direction": _words("direction"), "Sd / prior’s": _width, "In words": _words("meaning")}
    return _table("directions", caption, result.tables["directions"].rename_axis("direction"), columns)


def of_turning_points(result: Result) -> PageTable:
    """Return the turning points of the response under each load."""

    def chance(name: str) -> Callable[[Row], str]:
        return lambda row: with_error(100 * row[name], 100 * row[f"{name}_mcse"], "\u00a0%")

    def place(name: str) -> Callable[[Row], str]:
        keys = (f"{name}_low", name, f"{name}_high")

        def text(row: Row) -> str:
            low, middle, high = (with_error(row[key], row[f"{key}_mcse"]) for key in keys)
            return "–" if middle == "–" else f"{middle} ({low} to {high})"

        return text

    def drop(row: Row) -> str:
        limits = f"{share(row['drop_low'])} to {share(row['drop_high'])}"
        return "–" if np.isnan(row["drop"]) else f"{share(row['drop'])} ({limits})"

    columns = {
        "Load": _words("load"),
        "Turns over": chance("p_interior"),
        "under the prior": chance("prior_p_interior"),
        "Does not": chance("p_none"),
        "Silent": chance("p_silent"),
        "Among the fabrics": chance("p_inside"),
        "E_fab [kPa]": place("e_fab_kpa"),
        "E_fab / E_skin": place("ratio"),
        "Force [N]": place("force_n"),
        "Drop beyond": drop,
    }
    low, *_, high = result.group("predictions")["e_fab_kpa"].values
    caption = (
        "Turning points. A turning point is a maximum from which the response falls by at least "
        f"{share(result.least_drop)} towards both {number(low)} and {number(high)} kPa. Columns: its "
        "probability, and that of one within the range of the fabrics’ moduli; then medians and 90 % "
        "intervals over the draws with a turning point. ±: Monte-Carlo standard error."
    )
    if result.load_groups.merged:
        caption += f" Note: {result.load_groups.sentence}; each row is at the middle load of its group."
    return _table("inflection", caption, result.inflection(), columns)


def of_fabrics(result: Result) -> PageTable:
    """Return the rated and predicted softness of every fabric under every load."""
    table = result.tables[FABRIC_RATINGS]
    apart = table["difference_sd"].abs().reset_index(drop=True)
    shown = table.iloc[sorted(apart.sort_values(ascending=False, kind="stable").index[:MOST_FABRICS])]

    def difference(row: Row) -> str:
        value = row["difference_sd"]
        return f"{value:+.1f}{' ✱' if abs(value) >= NOTABLE else ''}" if np.isfinite(value) else "–"

    columns = {
        "Fabric": _words("fabric"),
        "Load": _words("load"),
        "E_fab [kPa]": _number("e_fab_kpa"),
        "Ratings": lambda row: str(int(row["ratings"])),
        "Rated": _number("rated"),
        "Predicted": _number("predicted"),
        "90 % band": _interval("predicted_low", "predicted_high"),
        "Difference [sd]": difference,
    }
    left_out = "" if len(shown) == len(table) else f" Shown are the {len(shown)} with the largest differences."
    caption = (
        f"Rated and predicted softness of {len(table)} pairs of fabric and load: mean ratings, medians and 90 "
        "% bands of replicated means from the fitted model, and the difference in standard deviations of the "
        f"replicates. {counted(int((apart >= NOTABLE).sum()), 'differs', 'differ')} by {NOTABLE:g} or more "
        f"(✱).{left_out}"
    )
    return _table("fabrics", caption, shown, columns)


def of_checks(result: Result) -> PageTable:
    """Return every predictive check of the posterior."""
    columns = {
        "Quantity": lambda row: PAPER_NAMES.get(row["quantity"], row["quantity"]),
        "Of": lambda row: (
            ", ".join(row[k] for k in ("load", "fabric", "participant") if row[k] != ALL) or "all ratings"
        ),
        "Data": _number("observed"),
        "Replicates": _number("replicated"),
        "Limits": _interval("low", "high"),
        "p": _number("p_value", 2),
    }
    caption = (
        "Posterior predictive checks: test quantities of the data and of replicates from the fitted model. "
        "Limits contain 90 % of the replicates, jointly over the rows of a quantity; p is the probability "
        "that a replicate exceeds the data."
    )
    return _table("checks", caption, result.tables["predictive_checks"].loc[["posterior"]], columns)


def of_provenance(result: Result) -> list[PageTable]:
    """Return the provenance of the run: data, model, sampling, numerical errors, versions."""
    provenance, options = result.provenance, Request.of(result).model
    ending, held, digests = provenance.ending, result.group("constant_data"), {}
    model = {"Readings": options.readings.label, **options.readings.names}
    if result.has_ratings:
        data = provenance.rating_data
        digests = {"SHA-256 of ratings": data.digest_ratings, "SHA-256 of fabrics": data.digest_fabrics}
        digests["Missing ratings"] = str(data.missing_ratings)
        model |= {"Ratings": options.scale.name, "Direction": provenance.direction.direction.name}
        model |= {"Noise on the membranes": number(options.noise), "Resolution": str(options.discretisation)}
    if result.has_compression:
        digests["SHA-256 of compression"] = provenance.plate.digest_compression
        digests["Rows without force (dropped)"] = str(provenance.plate.zero_forces)
    if result.has_afferents:
        digests["SHA-256 of afferents"] = provenance.recorded.digest_afferents
    units = {name: f" {one.unit}" if one.unit != "–" else "" for name, one in EVERY_PARAMETER.items()}
    fixed = {f"{name} held at": f"{float(held[name]):.6g}{unit}" for name, unit in units.items() if name in held}
    parts: dict[str, Mapping[str, str]] = {
        "Data": {name: digest or "not recorded: the data were made in Python" for name, digest in digests.items()},
        "Model": {**model, "Set of priors": options.prior_set, **fixed},
        "Sampling": {
            "Seed": str(provenance.asked.seed),
            "Steps of each ensemble": str(ending.steps),
            "of these burn-in": str(ending.burn_in),
            "Points evaluated": str(ending.evaluations),
            "of these, could not be computed": str(ending.failures),
            "Sampling took": f"{ending.sampling_seconds:.0f} s",
        },
        **({"Numerical errors": _errors(result)} if result.has_ratings else {}),
        "Versions": {**provenance.versions, "schema of posterior.nc": str(provenance.asked.schema_version)},
    }
    return [PageTable(caption.split()[-1].lower(), caption, [], [*rows.items()]) for caption, rows in parts.items()]


def _errors(result: Result) -> dict[str, str]:
    errors, silence = result.provenance.errors, result.provenance.silence

    def compared(error: float) -> str:
        return f"{error:.1g}" if math.isfinite(error) else "not checked"

    return {
        "Response, largest error as a share of the peak": number(errors.numerical_error, 2),
        "Firing rates, the same if every receptor had the largest error": number(errors.firing_error, 2),
        "Log-likelihood of draws, sd of its error": compared(errors.exactness_sd),
        "Log-likelihood of draws, largest error": compared(errors.exactness_largest),
        "No firing in any condition, share of the prior": share(silence.prior_silent_everywhere),
        "No firing in any condition, share of the posterior": share(silence.posterior_silent_everywhere),
        "Contact beyond half the fingertip’s radius": share(silence.contact_beyond_half_radius),
        "Contact beyond the fingertip’s radius": share(silence.contact_beyond_radius),
    }


# the run again

PROGRAM = "softness-bayes"
AGAIN = "again/"
"""Directory that the repeated run is written to."""


class Repetition(NamedTuple):
    """Commands that draw the same posterior again."""

    commands: tuple[str, ...]
    """Commands in order of execution."""
    notes: tuple[str, ...]
    """Conditions for identical draws."""


def repetition(result: Result) -> Repetition:
    """Return commands with every option that the draws depend on, the seed included.

    Parameters
    ----------
    result
        A finished run, begun at the command line or in Python.
    """
    attributes, (model, run) = result.attributes, Request.of(result)
    begun, *continued = run.command.split(f"; {PROGRAM} ")
    data, note = _data(result, shlex.split(begun))
    notes, left_out = [note], {"processes", "max_seconds"}
    if not attributes["converged"] and math.isfinite(run.max_seconds):
        run = replace(run, max_steps=int(attributes["steps"]))
        notes.append(f"The run ended at its time limit; --max-steps {run.max_steps} ends it at the same step.")
    if result.has_ratings and model.kept_accuracy is None:
        left_out.add("accuracy")
        notes.append(f"The run was made in Python, with a given resolution: {model.discretisation}.")
    words = [PROGRAM, "sample", *data]
    for options in (model, run):
        kept = {name for name, one in options.declared.items() if result.has_ratings or not one.needs_ratings}
        words += options.words(*(name for name in options.declared if name in kept - left_out))
    counts = [dict(_pairs(shlex.split(one))).get("--more-steps") for one in continued]
    more = [shlex.join([PROGRAM, "resume", AGAIN, "--more-steps", count]) for count in counts if count]
    notes.append(
        "The draws are the same only with the same files (compare their digests) and versions; both are listed above."
    )
    return Repetition((storable(shlex.join([*words, "--out", AGAIN])), *more), tuple(notes))


def _pairs(words: list[str]) -> list[tuple[str, str]]:
    """Return every option of a command with the word that follows it or is tied to it."""
    pairs = []
    for word, after in zip_longest(words, words[1:], fillvalue=""):
        flag, tied, value = word.partition("=")
        if word.startswith("--"):
            pairs.append((flag, value) if tied else (word, after))
    return pairs


def _data(result: Result, begun: list[str]) -> tuple[list[str], str]:
    """Return the options of the files, which only the recorded command line knows, and a note on them."""
    alone = {one.flag: isinstance(one.kind, Flag) for one in DataFiles.declared.values()}
    given = [(flag, value) for flag, value in _pairs(begun) if flag in alone]
    if given:
        note = (
            "Paths are relative to the directory in which the run was started. For a file elsewhere that was given by "
            "its absolute path, only the name is stored."
        )
        return [word for flag, value in given for word in ([flag] if alone[flag] else [flag, value])], note
    names = ["--data", "RATINGS.csv", "--fabrics", "FABRICS.csv"] if result.has_ratings else []
    names += ["--compression", "FORCES.csv"] if result.has_compression else []
    names += ["--afferents", "AFFERENTS.csv"] if result.has_afferents else []
    return (
        names,
        "The run was started in Python, where file names are not recorded: replace the names in capitals by yours.",
    )
