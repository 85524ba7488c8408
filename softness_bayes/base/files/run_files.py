"""Names of the files of a run."""

from __future__ import annotations

from collections.abc import Mapping

POSTERIOR, SUMMARY, NONFINITE = "posterior.nc", "summary.csv", "nonfinite.csv"
"""Files of a run; the last is there only if points were not finite."""

CHECKPOINT, LOCK = "checkpoint", "lock"
"""Directory of a run's checkpoint inside that of its results, and the file in it that a running process holds."""

RUNS = "runs"
"""Folder of a study, in which each of its runs has a directory."""

FABRIC_RATINGS, RULER, THRESHOLDS = "fabric_ratings", "ruler", "thresholds"
MODULI, MODULUS_ERRORS = "fabric_moduli", "modulus_errors"
FINGERS, ANSWERS, RATERS = "rater_fingers", "rater_answers", "raters"
RECORDED_RATES = "recorded_rates"

TABLES: Mapping[str, str] = {
    "directions": "combinations of parameters, the best known first",
    "predictive_checks": "test quantities of the ratings and of replicates",
    FABRIC_RATINGS: "rated and predicted softness of every fabric under every load",
    RULER: "how much of people's own means the chain keeps",
    THRESHOLDS: "thresholds and Weber fractions of pairs with a reference",
    MODULI: "moduli that were not known exactly",
    MODULUS_ERRORS: "what errors would change in moduli that are taken as exact",
    FINGERS: "raters' own fingers, with `--individual`",
    ANSWERS: "raters' own exponents and noise, with `--individual`",
    RATERS: "raters with their covariates",
    RECORDED_RATES: "recorded firing beside its prediction",
}
"""Further tables of a result by the name of their file, each if the run has its data."""

FILES: Mapping[str, str] = {
    POSTERIOR: "the whole result: draws, predictions, tables, options and checksums",
    SUMMARY: "mean, sd, interval, convergence and contraction of every parameter",
    NONFINITE: "points at which the density could not be computed",
    **{f"{name}.csv": holds for name, holds in TABLES.items()},
}
"""Every file that a run may leave beside its checkpoint."""

RUN = "sample"
"""The verb that they are listed under."""
