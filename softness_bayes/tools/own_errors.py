"""Cost and error of raters' own exponents and noise: ``python -m softness_bayes.tools.own_errors [FILE.csv]``.

For 1080 ratings of 30 raters: twelve fabrics under three loads. Each model is compared with finer integrals, near the
simulated truth and at draws of the prior; with fabrics' deviations, with an average over draws of these. Its cost is a
ratio of processor times.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.bench.ratings import SPREAD
from softness_bayes.bench.subject import FABRICS, LOADS, PARTICIPANTS
from softness_bayes.data import Experiment
from softness_bayes.likelihood.error_laws import LAPSES, NORMAL, STUDENT, ErrorLaw
from softness_bayes.likelihood.own_effects import OWN_ANSWERS
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.posterior import Posterior
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.parameters.priors import HalfNormal
from softness_bayes.tools.benchmark_ratings import alternating, write_table
from softness_bayes.tools.fabric_errors import OMEGA, differences, near_truth, plausible
from softness_bayes.touch.readings import MENDED

Array = NDArray[np.float64]

TABLE = Path("notebooks/results/own_errors.csv")

NEAR, FAR, DRAWS = 16, 16, 200
"""Vectors near the truth, draws of the prior, and draws among which these are found."""

BATCH = 32
"""Number of vectors of a timed call."""


class Kind(NamedTuple):
    """An observation model."""

    law: ErrorLaw
    step: float
    """Step of the grid of numbers; 0 for exact numbers."""
    differ: tuple[str, ...]
    """The quantities that differ between raters."""
    omega: float = 0.0
    """Spread of fabrics' deviations."""

    @property
    def words(self) -> str:
        """Name in the table."""
        numbers = "whole numbers" if self.step else "exact numbers"
        own = " and ".join(self.differ) + (" and omega" if self.omega else "")
        return f"{numbers}, {self.law.name}, {own}"


KINDS = (
    Kind(NORMAL, 0.0, ("gamma",)),
    Kind(NORMAL, 1.0, ("gamma",)),
    Kind(NORMAL, 1.0, ("varsigma",)),
    Kind(NORMAL, 1.0, ("gamma", "varsigma")),
    Kind(STUDENT, 0.0, ("gamma",)),
    Kind(STUDENT, 1.0, ("gamma",)),
    Kind(STUDENT, 1.0, ("varsigma",)),
    Kind(LAPSES, 1.0, ("gamma",)),
    Kind(NORMAL, 1.0, ("gamma",), OMEGA),
    Kind(NORMAL, 1.0, ("varsigma",), OMEGA),
    Kind(STUDENT, 1.0, ("gamma",), OMEGA),
)


class Row(NamedTuple):
    """Cost and error of one observation model."""

    ratings: str
    ms_per_vector: float
    """Processor time of a likelihood without the response [ms]."""
    cost: float
    """The same over that of raters who are alike."""
    near: float
    """Largest error near the truth."""
    near_sd: float
    """Standard deviation of the error near the truth: an offset that all vectors share is irrelevant."""
    prior: float
    """Largest error over draws of the prior within `fabric_errors.DISTANCE` of the truth's log-likelihood."""
    prior_draws: int
    """Number of these draws."""


def measured(kind: Kind, near: int = NEAR, far: int = FAR, draws: int = DRAWS, repeats: int = 10) -> Row:
    """Return cost and error of one observation model.

    Parameters
    ----------
    kind
        The model.
    near, far, draws
        Numbers of vectors, as `NEAR`, `FAR` and `DRAWS`.
    repeats
        Number of timed calls.
    """
    posterior, truth, alike = _posterior(kind)
    fine: Any = posterior.with_term(posterior.observation.finer())
    here = near_truth(posterior, truth, max(near, BATCH))
    rate, parameters = posterior.response(here[:BATCH]), posterior.rating_parameters(here[:BATCH])
    own, base = alternating(
        (
            lambda: posterior.observation.log_likelihood(rate, parameters),
            lambda: alike.observation.log_likelihood(rate, parameters),
        ),
        repeats,
    )
    there = plausible(posterior, truth, draws)[:far]
    errors, others = (differences(fine, posterior, at) for at in (here[:near], there))
    most, sd, usual = (float(f"{one:.0e}") for one in (np.abs(errors).max(), errors.std(), np.abs(others).max()))
    return Row(kind.words, round(1e3 * own / BATCH, 2), round(own / base, 1), most, sd, usual, len(there))


def _posterior(kind: Kind) -> tuple[Posterior, Array, Posterior]:
    """Return the model of simulated ratings, the simulated truth, and the model of raters who are alike."""
    spreads = {OWN_ANSWERS[name]: SPREAD for name in kind.differ}
    given = usual_values(MENDED, given={"sigma_0": 7.0, "omega": kind.omega, **spreads})
    made = simulate_ratings(
        np.random.default_rng(1),
        FABRICS,
        LOADS,
        given,
        participants=PARTICIPANTS,
        errors=kind.law,
        resolution=kind.step,
    )
    priors = {"omega": HalfNormal(OMEGA)} if kind.omega else {}
    both = (
        build(
            Experiment(made.ratings, FABRICS, ()),
            ModelOptions(errors=kind.law, priors=priors, resolution=kind.step, individual=differ),
        ).posterior
        for differ in (kind.differ, ())
    )
    own, alike = both
    return own, np.array([made.truth[name] for name in own.names]), alike


def main() -> None:
    """Measure and write the table."""
    write_table(__doc__.partition("\n")[0], TABLE, Row._fields, map(measured, KINDS))


if __name__ == "__main__":
    main()
