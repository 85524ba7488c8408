"""Time and error of the numerically integrated likelihoods, compared with the closed form."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.bench.subject import BATCH, FABRICS, LOADS, PARTICIPANTS, Effort, Subject, quickest
from softness_bayes.data import Experiment
from softness_bayes.likelihood.error_laws import ERROR_LAWS, NORMAL, ErrorLaw
from softness_bayes.likelihood.own_effects import OWN_ANSWERS
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.posterior import Posterior
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.touch.readings import MENDED

Array = NDArray[np.float64]

SPREAD = 0.25
"""Spread of raters' log exponents and log noise, where they have their own."""


class Integrated(NamedTuple):
    """One observation model of the same ratings."""

    model: str
    seconds: float
    """Time of a whole likelihood for each vector, including the response [s]."""
    ratio: float
    """The same relative to the time of the closed form."""
    largest_error: float
    """Largest error of the log-likelihood, against finer integrals, over vectors near the simulated truth."""
    prior_error: float
    """The same over draws of the prior whose log-likelihood lies within a thousand of the truth's."""


def rating_models(subject: Subject, effort: Effort) -> list[Integrated]:
    """Return time and error of exact and of rounded ratings under every error law, and with rater-specific parameters.

    Parameters
    ----------
    subject
        The closed form, with simulated exact ratings.
    effort
        Amount of work: number of repetitions of each call.
    """
    closed = subject.model.posterior
    seconds = quickest(lambda: closed.log_likelihood(subject.theta), effort.repeats) / BATCH
    found = [Integrated("exact, normal (closed form)", seconds, 1.0, 0.0, 0.0)]
    for law in ERROR_LAWS.values():
        for step in (0.0, 1.0):
            if step or law is not NORMAL:
                found.append(_measured(subject, law, step, seconds, effort))
    for differ in (("gamma",), ("varsigma",), ("gamma", "varsigma")):
        found.append(_measured(subject, NORMAL, 0.0, seconds, effort, differ))
    return found


class Rated(NamedTuple):
    """The posterior of simulated ratings under one observation model, and vectors near the simulated truth."""

    posterior: Posterior
    truth: Array
    """Shape (parameters,)."""
    near: Array
    """Shape (BATCH, parameters)."""


def rated(options: ModelOptions, law: ErrorLaw, step: float, differ: tuple[str, ...] = ()) -> Rated:
    """Return the model of simulated ratings.

    Parameters
    ----------
    options
        Options of the model; error law and individual answers are replaced.
    law, step
        Error law, and step of the grid of numbers; 0 for exact numbers.
    differ
        Parameters of the answers that differ between raters.
    """
    spreads = {OWN_ANSWERS[name]: SPREAD for name in differ}
    given = usual_values(MENDED, given={"sigma_0": 7.0, **spreads})
    made = simulate_ratings(
        np.random.default_rng(1), FABRICS, LOADS, given, participants=PARTICIPANTS, errors=law, resolution=step
    )
    options = replace(options.decide(errors=law), individual=differ)
    posterior = build(Experiment(made.ratings, FABRICS, ()), options).posterior
    rng, space = np.random.default_rng(2), posterior.space
    truth = np.array([made.truth[name] for name in posterior.names])
    near = space.natural(space.coordinates(truth) + 0.02 * rng.standard_normal((BATCH, truth.size)))
    return Rated(posterior, truth, near)


def name_of(law: ErrorLaw, step: float, differ: tuple[str, ...] = ()) -> str:
    """Return the name of an observation model in the tables."""
    numbers = "whole numbers" if step else "exact"
    return f"{numbers}, own {' and '.join(differ)}" if differ else f"{numbers}, {law.name}"


def _measured(
    subject: Subject, law: ErrorLaw, step: float, closed: float, effort: Effort, differ: tuple[str, ...] = ()
) -> Integrated:
    posterior, truth, near = rated(subject.model.options, law, step, differ)
    seconds = quickest(lambda: posterior.log_likelihood(near), effort.repeats) / BATCH
    finer = posterior.with_term(posterior.observation.finer())
    far = posterior.space.draw_prior(np.random.default_rng(3), effort.draws)
    value = posterior.log_likelihood(far)
    far = far[value > posterior.log_likelihood(truth[None])[0] - 1000.0]
    errors = [np.abs(posterior.log_likelihood(one) - finer.log_likelihood(one)).max(initial=0.0) for one in (near, far)]
    return Integrated(name_of(law, step, differ), seconds, seconds / closed, *map(float, errors))
