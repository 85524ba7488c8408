"""Comparison of the sampled, fast log-likelihood with one based on exact firing rates, at some draws of a run."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.exactness import EXACT_RATES, SAME_RATES, Exactness, compare_likelihoods
from softness_bayes.errors import InputError
from softness_bayes.model.fingers import finer_family_of
from softness_bayes.model.posterior import Posterior
from softness_bayes.model.scenes import at_other_loads
from softness_bayes.results.draws import REWEIGHT_DRAWS, Variable, evenly
from softness_bayes.sampler.workers import Workers
from softness_bayes.touch.scene import Scene

Array = NDArray[np.float64]

EXACT_DRAWS = 200
"""Largest number of posterior draws at which the log-likelihood is compared with the exact one."""

FIRST_DRAWS = 40
"""Number of draws compared first; the others are used only if the result is then not yet certain."""

EXACT_PARTS = 4
"""Largest number of parallel tasks of the comparison; `FIRST_DRAWS` form one task.

Draws are integrated simultaneously, and small batches take as long as large ones: 40 draws in four tasks take three
times the work of one task.
"""


def exact_log_likelihood(posterior: Posterior, theta: Array) -> Array:
    """Return the log-likelihood at points theta with exact firing rates and a finer quadrature, shape (points,).

    Parameters
    ----------
    posterior
        The density that was sampled.
    theta
        The points, shape (points, dimension).
    """
    exact, fingers = posterior.scene.exact(), posterior.fingers
    finer = None if fingers is None else finer_family_of(exact, fingers.grid.finer())
    finest, others = posterior.with_term(posterior.observation.finer()), None
    if posterior.other_loads is not None:
        try:
            others = _other_loads(exact, finest)
        except InputError:  # a load of the reference is out of range, where those of the run are not
            finest, others = posterior, _other_loads(exact, posterior)
    return finest.with_scene(exact, others, finer).log_likelihood(theta)


def _other_loads(exact: Scene, posterior: Posterior) -> Scene:
    errors = posterior.observation.load_errors
    assert errors is not None, "a posterior with other loads has errors of loads"
    return at_other_loads(exact, errors)


def compare_exactly(
    posterior: Posterior, theta: Array, workers: Workers | None, reweight: bool = False
) -> Callable[[], Exactness]:
    """Begin the comparison of the sampled log-likelihood with its reference at evenly spaced draws.

    The comparison stops after the first draws if these show clearly that the fast likelihood is accurate enough.

    Parameters
    ----------
    posterior
        The density that was sampled.
    theta
        All draws, shape (chains, draws, dimension).
    workers
        Processes with `posterior` as their resident object, which compute the exact likelihood in parallel. None for
        the reference of the integrals over raters' effects, with the same fast response.
    reweight
        Whether to compare at `REWEIGHT_DRAWS` draws, for reweighting, instead of `EXACT_DRAWS`.

    Returns
    -------
    Callable
        Function that waits for the comparison.
    """
    rates = SAME_RATES if posterior.scene.firing.noise else EXACT_RATES
    numbers = (REWEIGHT_DRAWS,) if reweight else (FIRST_DRAWS, EXACT_DRAWS)

    def begin(some: Array) -> list[Callable[[], Array]]:
        if workers is None:
            return [partial(posterior.log_likelihood, some)]
        # the division does not depend on the number of processes, so that results agree to the last bit
        parts = np.array_split(some, min(EXACT_PARTS, -(-len(some) // FIRST_DRAWS)))
        return [workers.later(exact_log_likelihood, part) for part in parts]

    begun = begin(theta[evenly(theta.shape, numbers[0])])

    @cache
    def finish() -> Exactness:
        for number in numbers:
            some = theta[evenly(theta.shape, number)]
            exact = np.concatenate([part() for part in (begun if number == numbers[0] else begin(some))])
            found = compare_likelihoods(
                posterior.names, some, posterior.for_sampling.log_likelihood(some), exact, rates
            )
            if found.certain:
                break
        return found

    return finish


def unchecked() -> Exactness:
    """Return the comparison of no draws."""
    nothing = np.empty(0)
    return compare_likelihoods((), nothing, nothing, nothing)


def exactness_stats(exactness: Exactness, shape: tuple[int, ...]) -> dict[str, Variable]:
    """Return the differences of the log-likelihood and the log weights; NaN at draws that were not compared.

    Parameters
    ----------
    exactness
        The comparison at evenly spaced draws.
    shape
        Shape of all draws, (chains, draws, ...).
    """
    found = {}
    for name in ("difference", "log_weight"):
        everywhere = np.full(shape[:2], np.nan)
        everywhere[evenly(shape, exactness.difference.size)] = getattr(exactness, name)
        found[f"exact_{name}"] = Variable(everywhere)
    return found
