"""Errors of Laplace's method for fabrics' deviations: ``python -m softness_bayes.tools.fabric_errors [FILE.csv]``.

For twelve fabrics under three loads, each observation model is compared with its reference, an average over draws of
the deviations, near the simulated truth and at draws of the prior. Its cost is a ratio of processor times.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.bench.subject import FABRICS, LOADS
from softness_bayes.data import Experiment
from softness_bayes.likelihood.error_laws import LAPSES, NORMAL, STUDENT, ErrorLaw
from softness_bayes.likelihood.scales import CATEGORIES, MAGNITUDE, SLIDER, Scale
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.posterior import Posterior
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.parameters.priors import HalfNormal
from softness_bayes.tools.benchmark_ratings import alternating, write_table
from softness_bayes.touch.readings import MENDED

Array = NDArray[np.float64]

TABLE = Path("notebooks/results/fabric_errors.csv")

OMEGA = 0.3
"""Spread of the fabrics' deviations, and scale of its prior."""

NEAR, FAR, DRAWS, DISTANCE = 32, 40, 400, 300.0
"""Vectors near the truth, draws of the prior, draws among which these are found, and the largest distance of their
log-likelihood from the truth's."""

SCATTER = 0.05
"""Spread of the vectors about the truth, in the sampler's coordinates."""


class Kind(NamedTuple):
    """An observation model, and the number of raters."""

    scale: Scale
    law: ErrorLaw
    step: float
    """Step of the grid of numbers; 0 for exact numbers, and for categories."""
    raters: int

    @property
    def words(self) -> str:
        """Name in the table."""
        if self.scale == CATEGORIES:
            numbers = "seven categories"
        elif self.scale == SLIDER:
            numbers = f"slider in steps of {100.0 * self.step:g} %"
        else:
            numbers = "whole numbers" if self.step else "exact numbers"
        return f"{numbers}, {self.law.name}, {self.raters}"


KINDS = (
    *(Kind(MAGNITUDE, law, 1.0, 30) for law in (NORMAL, STUDENT, LAPSES)),
    *(Kind(MAGNITUDE, law, 0.0, 30) for law in (STUDENT, LAPSES)),
    Kind(SLIDER, NORMAL, 0.05, 30),
    Kind(CATEGORIES, NORMAL, 0.0, 30),
    *(Kind(MAGNITUDE, law, 1.0, 5) for law in (NORMAL, STUDENT, LAPSES)),
)


class Row(NamedTuple):
    """Error and cost of one observation model."""

    ratings: str
    near_median: float
    """Median size of the error near the truth."""
    near_sd: float
    """Standard deviation of the error near the truth: an offset that all vectors share is irrelevant."""
    prior_median: float
    """Median size of the error over draws of the prior within `DISTANCE` of the truth's log-likelihood."""
    prior_largest: float
    prior_draws: int
    """Number of these draws."""
    cost: float
    """Time of a likelihood without the response, over that of ratings without deviations."""


def measured(kind: Kind, near: int = NEAR, far: int = FAR, draws: int = DRAWS, repeats: int = 10) -> Row:
    """Return error and cost of one observation model.

    Parameters
    ----------
    kind
        The model.
    near, far, draws
        Numbers of vectors, as `NEAR`, `FAR` and `DRAWS`.
    repeats
        Number of timed calls.
    """
    posterior, truth = _posterior(kind, OMEGA)
    observed = posterior.observation
    fine: Any = posterior.with_term(observed.finer())
    here = near_truth(posterior, truth, near)
    rate, parameters = posterior.response(here), posterior.rating_parameters(here)
    # ratings of fabrics that do not deviate: with deviations these parameters would be far from the data
    alike, none = _posterior(kind, 0.0)[0].observation, parameters._replace(omega=np.zeros(near))
    own, base = alternating(
        (lambda: observed.log_likelihood(rate, parameters), lambda: alike.log_likelihood(rate, none)), repeats
    )
    there = plausible(posterior, truth, draws)[:far]
    errors, others = (differences(fine, posterior, at) for at in (here, there))
    size = np.abs(others)
    median, sd, usual, largest = (
        float(f"{one:.0e}") for one in (np.median(np.abs(errors)), errors.std(), np.median(size), size.max())
    )
    return Row(kind.words, median, sd, usual, largest, len(there), round(own / base, 1))


def near_truth(posterior: Posterior, truth: Array, count: int) -> Array:
    """Return vectors scattered about the truth."""
    noise = SCATTER * np.random.default_rng(2).standard_normal((count, truth.size))
    return posterior.space.natural(posterior.space.coordinates(truth) + noise)


def plausible(posterior: Posterior, truth: Array, draws: int) -> Array:
    """Return those of some draws of the prior whose log-likelihood is within `DISTANCE` of the truth's."""
    there = posterior.space.draw_prior(np.random.default_rng(3), draws)
    value = np.concatenate([posterior.log_likelihood(part) for part in np.array_split(there, -(-draws // 64))])
    return there[value > posterior.log_likelihood(truth[None])[0] - DISTANCE]


def differences(fine: Any, posterior: Posterior, at: Array) -> Array:
    """Return the log-likelihood of a reference less that of a posterior, one vector at a time."""
    return np.concatenate([fine.log_likelihood(one[None]) - posterior.log_likelihood(one[None]) for one in at])


def _posterior(kind: Kind, omega: float) -> tuple[Posterior, Array]:
    """Return the model of simulated ratings, whose fabrics deviate with a spread `omega`, and the simulated truth."""
    scale, law, step, raters = kind
    given = usual_values(MENDED, given={"sigma_0": 7.0, "omega": omega, "gamma": 1.0 if scale == MAGNITUDE else 0.5})
    made = simulate_ratings(
        np.random.default_rng(1),
        FABRICS,
        LOADS,
        given,
        participants=raters,
        errors=law,
        resolution=step,
        scale=scale,
    )
    options = ModelOptions(
        scale=scale,
        errors=law,
        priors={"omega": HalfNormal(OMEGA)},
        resolution=None if scale == CATEGORIES else step,
    )
    posterior = build(Experiment(made.ratings, FABRICS, ()), options).posterior
    return posterior, np.array([made.truth[name] for name in posterior.names])


def main() -> None:
    """Measure and write the table."""
    write_table(__doc__.partition("\n")[0], TABLE, Row._fields, map(measured, KINDS))


if __name__ == "__main__":
    main()
