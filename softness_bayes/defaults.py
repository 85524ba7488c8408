"""Defaults that the package and the command line share; the command line's help needs them without the libraries."""

from __future__ import annotations

ACCURACY = 1e-3
"""Bound of the response's numerical error, relative to its peak."""

MAX_STEPS = 100_000
"""Steps of each ensemble after which a run ends."""

NOISE = 0.0
"""Strength of the membranes' white current [µA/cm² sqrt(ms)]."""

ERRORS = ("normal", "student", "lapses")
"""Names of the error laws of ratings, `likelihood.error_laws.ERROR_LAWS`: listed here so that help needs no NumPy."""
PRIOR_SET = "default"
"""Named set of priors."""

SEED = 0
"""Seed of all random numbers."""
