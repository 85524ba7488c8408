"""Checks of a run at its draws: accuracy of the fast model, residuals, and touches beyond the range of the model."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.checking import checks, exactness, provenance
from softness_bayes.checking.inflection import LEAST_DROP
from softness_bayes.checking.sentences import exactness_sentence
from softness_bayes.likelihood.aggregated import SPREADS, RaterSpreads
from softness_bayes.likelihood.contract import RATER_EFFECTS
from softness_bayes.likelihood.error_laws import LAPSES, STUDENT
from softness_bayes.likelihood.models import OF_DIFFERENT_RATERS
from softness_bayes.likelihood.scales import PAIRS, RANKS
from softness_bayes.model.fingers import family_of
from softness_bayes.model.posterior import Posterior
from softness_bayes.model.prediction import drive_slope, rates_of_other_moduli, rates_of_other_skins
from softness_bayes.model.scenes import at_other_loads
from softness_bayes.results.draws import REWEIGHT_DRAWS, RatedDraws, Variable, evenly, rated_layout
from softness_bayes.sampler.workers import Workers
from softness_bayes.touch.scene import Scene

Array = NDArray[np.float64]

ERROR_DRAWS = 32
"""Posterior draws at which the scene is compared with a finer one."""

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
    finer = None if fingers is None else family_of(exact, fingers.grid.finer(), finer=True)
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
    posterior: Posterior,
    theta: Array,
    workers: Workers,
    reweight: bool = False,
    reference: Callable[[Posterior, Array], Array] = exact_log_likelihood,
) -> Callable[[], exactness.Exactness]:
    """Begin the comparison of the sampled log-likelihood with its reference at evenly spaced draws.

    The comparison stops after the first draws if these show clearly that the fast likelihood is accurate enough.

    Parameters
    ----------
    posterior
        The density that was sampled.
    theta
        All draws, shape (chains, draws, dimension).
    workers
        Processes with `posterior` as their resident object, which compute the exact likelihood in parallel.
    reweight
        Whether to compare at `REWEIGHT_DRAWS` draws, for reweighting, instead of `EXACT_DRAWS`.
    reference
        Function that computes the reference; `Posterior.log_likelihood` for that of the integrals over raters' effects
        alone, with the same fast response.

    Returns
    -------
    Callable
        Function that waits for the comparison.
    """
    rates = exactness.SAME_RATES if posterior.scene.firing.noise else exactness.EXACT_RATES
    numbers = (REWEIGHT_DRAWS,) if reweight else (FIRST_DRAWS, EXACT_DRAWS)

    def begin(some: Array) -> list[Callable[[], Array]]:
        # the division does not depend on the number of processes, so that results agree to the last bit
        parts = np.array_split(some, min(EXACT_PARTS, -(-len(some) // FIRST_DRAWS)))
        return [workers.later(reference, part) for part in parts]

    begun = begin(theta[evenly(theta.shape, numbers[0])])

    @cache
    def finish() -> exactness.Exactness:
        for number in numbers:
            some = theta[evenly(theta.shape, number)]
            exact = np.concatenate([part() for part in (begun if number == numbers[0] else begin(some))])
            found = exactness.Exactness(
                posterior.names, some, posterior.for_sampling.log_likelihood(some), exact, rates
            )
            if found.certain:
                break
        return found

    return finish


def exactness_stats(compared: exactness.Exactness | None, shape: tuple[int, ...]) -> dict[str, Variable]:
    """Return the differences of the log-likelihood and the log weights; NaN at draws that were not compared.

    Parameters
    ----------
    compared
        The comparison at evenly spaced draws.
    shape
        Shape of all draws, (chains, draws, ...).
    """
    found = {}
    for name in ("difference", "log_weight"):
        everywhere = np.full(shape[:2], np.nan)
        if compared is not None:
            everywhere[evenly(shape, compared.difference.size)] = getattr(compared, name)
        found[f"exact_{name}"] = Variable(everywhere)
    return found


def numerical_errors(draws: RatedDraws) -> tuple[float, float]:
    """Return the largest numerical error of the response over some draws, relative to the peak of each.

    The second number is a bound on the part due to the measured error of the rate curves.
    """
    touch, modulus = draws.touches(draws.subset(ERROR_DRAWS).theta)
    response = draws.scene.respond(touch, modulus)
    peak = response.total_rate.max(axis=-1)
    hertz = draws.scene.firing.curves(touch.channels, touch.alpha).error.hertz
    fires = peak > 0
    of_firing = float((hertz * response.responding.max(axis=-1)[fires] / peak[fires]).max(initial=0.0))
    return float(draws.scene.error(touch, modulus).max()), of_firing


def checked(draws: RatedDraws, errors: tuple[float, float], compared: exactness.Exactness | None) -> dict[str, Any]:
    """Return the provenance of `numerical_errors`, of the checks of residuals, of silence and of the direction.

    Silence is the share of silent draws, and of contacts outside the range of Hertz's theory.
    """
    told = {
        f"exactness_{name}": np.nan if compared is None else float(getattr(compared, name))
        for name in ("sd", "largest", "efficiency", "pareto_k")
    }
    numerical = provenance.NumericalErrors(
        numerical_error=errors[0],
        inflection_least_drop=max(LEAST_DROP, 3.0 * errors[0]),
        firing_error=errors[1],
        exactness=exactness_sentence(compared),
        exact_enough=compared is not None and compared.exact_enough,
        exact_reweight=draws.log_weight is not None,
        **told,
    )
    stated = slice(draws.scene.n_conditions)
    prior, posterior = draws.posterior.mean_rate(draws.prior)[..., stated], draws.mean_rate[..., stated]
    beyond = draws.scene.beyond_hertz(*draws.touches(draws.subset(draws.curves).theta))
    silence = provenance.Silence(
        prior_silent_everywhere=float((prior == 0).all(axis=-1).mean()),
        prior_silent_conditions=float((prior == 0).mean()),
        posterior_silent_everywhere=float((posterior == 0).all(axis=-1).mean()),
        posterior_silent_conditions=float((posterior == 0).mean()),
        contact_beyond_half_radius=beyond.questionable,
        contact_beyond_radius=beyond.meaningless,
    )
    direction = dict(zip(("direction_rises", "direction_rises_se"), draws.rises, strict=True))
    found = provenance.Findings(tuple(_findings(draws)))
    return provenance.attributes_of(numerical, silence, found) | direction


def _findings(draws: RatedDraws) -> list[provenance.Finding]:
    """Return the findings of the checks of residuals."""
    few, model, ratings = draws.subset(draws.replicates), draws.model, draws.experiment.ratings
    residuals = checks.Residuals(draws.ratings, few.mean_rate, few.parameters, few.effects)
    others = (rates_of_other_moduli, checks.MODULUS_STEP), (rates_of_other_skins, checks.SKIN_STEP)
    moduli, skins = (
        drive_slope(draws.posterior, few.theta, rates_of(draws.posterior, few.theta, step), step)
        for rates_of, step in others
    )
    effects, available = model.named_effects(few.effects), model.scale in OF_DIFFERENT_RATERS
    modelled = {name for name, effect in RATER_EFFECTS.items() if effect in effects}
    at = zip(ratings.conditions.fabric, ratings.conditions.load, strict=True)
    names = [f"{ratings.fabrics[fabric]} under {ratings.loads[load]}" for fabric, load in at]
    layout = rated_layout(draws)
    found = [
        *checks.check_fabrics(residuals, names, checks.likeness(layout.modulus, draws.load_groups.of[layout.load])),
        checks.check_slope(residuals, checks.EXPONENTS, residuals.response, "gamma" in modelled, available),
        checks.check_noise(residuals, "varsigma" in modelled, available, model.error in (STUDENT, LAPSES)),
        checks.check_slope(residuals, checks.ALONG, moduli, draws.posterior.space.moduli is not None),
        checks.check_slope(residuals, checks.SKINS, skins, draws.posterior.fingers is not None),
    ]
    order = draws.experiment.ratings.order
    if order is not None and model.scale not in (RANKS, PAIRS):
        found.append(checks.check_drift(residuals, order))
    term = draws.posterior.term(SPREADS)
    if isinstance(term, RaterSpreads):
        parameters = draws.posterior.parameters_of(term, few.theta)
        found.append(checks.check_spreads(term, few.mean_rate, parameters, np.random.default_rng(0)))
    return found
