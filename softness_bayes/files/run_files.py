"""Names of the files of a run."""

from __future__ import annotations

POSTERIOR, SUMMARY, NONFINITE = "posterior.nc", "summary.csv", "nonfinite.csv"
"""Files of a run; the last, if there is one, holds the points at which the density could not be computed."""

CHECKPOINT, LOCK = "checkpoint", "lock"
"""Directory of a run's checkpoint inside that of its results, and the file in it that a running process holds."""

RUNS = "runs"
"""Folder of a study, in which each of its runs has a directory."""

MODULI = "fabric_moduli"
"""The table of moduli that were not known exactly, if there are any."""

MODULUS_ERRORS = "modulus_errors"
"""The table of the consequences of errors in moduli that are taken as exact, if there are any."""

FINGERS = "rater_fingers"
"""The table of raters' own fingers, if they differ."""

ANSWERS = "rater_answers"
"""The table of raters' own exponents and noise, if they differ."""

RATERS = "raters"
"""The table of raters with their covariates, if there are any."""

FABRIC_RATINGS = "fabric_ratings"
"""The table of rated and predicted softness of every fabric under every load."""

THRESHOLDS = "thresholds"
"""The table of thresholds and Weber fractions of pairs with a reference, if there are any."""

RULER = "ruler"
"""The table of how much of people's own means the chain keeps."""

RECORDED_RATES = "recorded_rates"
"""The table of recorded firing beside its prediction, if there is any."""

TABLES = (
    "directions",
    "predictive_checks",
    FABRIC_RATINGS,
    RULER,
    THRESHOLDS,
    MODULI,
    MODULUS_ERRORS,
    FINGERS,
    ANSWERS,
    RATERS,
    RECORDED_RATES,
)
"""Further tables of a result by the name of their file."""

FILES = (POSTERIOR, SUMMARY, NONFINITE, *(f"{name}.csv" for name in TABLES))
"""Every file that a run may leave beside its checkpoint."""

RUN = "sample"
"""The verb that they are listed under."""
