"""Assembly of the result of a run on ratings, with each group computed as a function of the draws."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from enum import Enum
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.agreement import fabric_rating_table
from softness_bayes.checking.check_table import check_table
from softness_bayes.checking.checks import (
    ALONG,
    EXPONENTS,
    MODULUS_STEP,
    SKIN_STEP,
    SKINS,
    Residuals,
    check_drift,
    check_fabrics,
    check_noise,
    check_slope,
    check_spreads,
    loo_pit,
)
from softness_bayes.checking.exactness import Exactness
from softness_bayes.checking.identifiability import direction_table
from softness_bayes.checking.individual import answer_table, finger_table, modulus_table
from softness_bayes.checking.inflection import LEAST_DROP, curve_scene
from softness_bayes.checking.sentences import exactness_sentence
from softness_bayes.data import Experiment, Measurements
from softness_bayes.files.run_files import (
    ANSWERS,
    FABRIC_RATINGS,
    FINGERS,
    MODULI,
    MODULUS_ERRORS,
    RATERS,
    RECORDED_RATES,
)
from softness_bayes.likelihood.aggregated import SPREADS
from softness_bayes.likelihood.error_laws import LAPSES, STUDENT
from softness_bayes.likelihood.intervals import RATER_EFFECTS
from softness_bayes.likelihood.models import OF_DIFFERENT_RATERS
from softness_bayes.likelihood.scales import PAIRS, RANKS
from softness_bayes.model.posterior import Density, Posterior
from softness_bayes.model.prediction import drive_slope, rates_of_other_moduli, rates_of_other_skins
from softness_bayes.provenance import (
    PRIOR,
    Finding,
    NumericalErrors,
    Provenance,
    Silence,
    attributes_of,
    family_of,
    findings_attribute,
)
from softness_bayes.results.constants import coordinates, data_groups, held_parameters
from softness_bayes.results.draws import (
    CURVES,
    DRAWS_PER_WALKER,
    PRIOR_DRAWS,
    REPLICATES,
    REWEIGHT_DRAWS,
    Groups,
    RatedDraws,
    Variable,
    draws_per_walker,
    evenly,
    merged,
    named,
    sampled_groups,
    tree_of,
)
from softness_bayes.results.exact import compare_exactly, exactness_stats, unchecked
from softness_bayes.results.predictions import (
    Trains,
    example_trains,
    illustration_groups,
    modulus_shifts,
    prediction_group,
    turning_groups,
)
from softness_bayes.results.recorded import recorded_results
from softness_bayes.results.replicates import ROWS, plate_results, replicated_groups
from softness_bayes.results.summary import rater_table, reweighted, summarise, with_covariates
from softness_bayes.sampler.chains import Chains
from softness_bayes.sampler.workers import Workers
from softness_bayes.touch.parameters import TouchParameters

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

Array = NDArray[np.float64]

ERROR_DRAWS = 32
"""Posterior draws at which the scene is compared with a finer one."""


class Stage(Enum):
    """A stage after sampling, in order of execution; the value describes it."""

    EXACT = "accuracy of the fast model"
    REPLICATES = "replicated data"
    LEFT_OUT = "each rating given all others (leave-one-out)"
    PREDICTIONS = "predictions and turning points"
    CHECKS = "checks of residuals"
    TABLES = "tables"
    FILES = "files"
    FIGURES = "figures"

    def __str__(self) -> str:
        return f"after sampling, {[*Stage].index(self) + 1} of {len(Stage)}: {self.value}"

    def log(self) -> None:
        """Log the start of the stage with the logger of this module, at the level INFO."""
        logging.getLogger(__name__).info(self)


class Assembled(NamedTuple):
    """The groups of a result and its tables."""

    tree: xr.DataTree
    summary: pd.DataFrame
    tables: dict[str, pd.DataFrame]
    """All other tables by name."""


def assembled(
    experiment: Experiment,
    posterior: Posterior,
    chains: Chains,
    burn_in: int,
    rng: np.random.Generator,
    workers: Workers,
    attributes: Mapping[str, Any],
    reweight: bool = False,
    exact: bool = True,
    share: float = 1.0,
) -> Assembled:
    """Compute all groups and tables from the draws of a run on ratings.

    Parameters
    ----------
    experiment, posterior
        The data, and the density that was sampled.
    chains, burn_in
        The draws, and the number of initial steps to drop.
    rng
        Random generator of all quantities drawn after sampling.
    workers
        Processes with `posterior` as their resident object, which compute the exact likelihood in parallel.
    attributes
        Provenance of the result, apart from what is added here.
    reweight
        Whether summary, predictions and replicates use draws weighted by the exact likelihood.
    exact
        Whether the fast likelihood is compared with the exact one.
    share
        Share of the usual numbers of draws of all quantities.
    """
    Stage.EXACT.log()
    kept = chains.kept(burn_in, draws_per_walker(posterior, chains, share))
    theta = kept.by_walker(posterior.natural(kept.coordinates))
    scale = Provenance(attributes).rating_model.rating_scale
    comparison = compare_exactly(posterior, theta, workers, reweight) if exact else unchecked
    draws = RatedDraws.of(experiment, posterior, scale, kept, theta, rng, share)
    if reweight:
        draws = replace(draws, log_weight=comparison().log_weight)
    trains = workers.later(_trains, rng.spawn(1)[0], draws.touch(draws.subset(draws.curves).theta))
    Stage.REPLICATES.log()
    few, curves = draws.subset(draws.replicates), draws.subset(draws.curves)
    replicated, prior = replicated_groups(rng, draws), draws.prior[: draws.replicates]
    plate, axes, pressed = plate_results(rng, experiment.compression, posterior, theta, few.theta, prior, curves.theta)
    recorded, rows, nerves, rates = recorded_results(
        rng, experiment.afferents, posterior, theta, few.theta, prior, curves.theta
    )
    Stage.LEFT_OUT.log()
    left_out = draws.ratings.left_out(few.mean_rate, few.parameters)
    Stage.PREDICTIONS.log()
    errors, grid = numerical_errors(draws), curve_scene(draws.scene, loads=draws.shown_loads)
    predicted = {"predictions": prediction_group(draws, grid, errors[0]), **turning_groups(draws, errors[0])}
    turn = predicted["predictions"]["inflection_e_fab_kpa"].values[0] * 1e3
    shown, along = illustration_groups(rng, draws, turn, trains())
    Stage.CHECKS.log()
    exactness = comparison()
    sources = ["ratings", *(["compression"] if plate else []), *(["afferents"] if recorded else [])]
    sampled = sampled_groups(posterior, kept, theta, "_and_".join(sources))
    own: Groups = {"posterior": _effects(draws), "sample_stats": exactness_stats(exactness, theta.shape)}
    densities = _densities(draws, left_out.log_density)
    data = data_groups(draws, loo_pit(left_out, draws.ratings.discrete))
    tree = tree_of(
        merged(sampled, own, replicated, densities, predicted, data, plate, recorded, shown),
        {**coordinates(draws, grid), **axes, **rows, **along},
        {
            **attributes,
            **family_of(PRIOR, draws.model.levels),
            **_checks(draws, errors, exactness),
            **pressed,
            **nerves,
        },
    )
    Stage.TABLES.log()
    tables = _tables(draws, tree, predicted["inflection"]) | ({} if rates is None else {RECORDED_RATES: rates})
    return Assembled(tree, summary_of(draws, exactness), tables)


def _trains(posterior: Posterior, rng: np.random.Generator, parameters: TouchParameters) -> Trains:
    return example_trains(rng, posterior.scene, parameters)


def _effects(draws: RatedDraws) -> dict[str, Variable]:
    """Return the effects of participants and fabrics, those of fabrics only if their spread is sampled."""
    named_effects = draws.model.named_effects(draws.effects).items()
    absent = () if "omega" in draws.posterior.names else ("fabric_effect",)
    return {name: Variable(values, dims) for name, (values, dims) in named_effects if name not in absent}


def _densities(draws: RatedDraws, alone: Array) -> Groups:
    """Return the log densities of each rating given all others, and of each participant's ratings."""
    few = draws.subset(draws.replicates)
    whole = draws.ratings.log_likelihood_participants(few.mean_rate, few.parameters)
    return {
        "log_likelihood": {"rating": Variable(alone[None], ROWS)},
        # not named like the rating, which has a different axis
        "log_likelihood_participant": {"ratings_of_participant": Variable(whole[None], ("participant",))},
    }


def _checks(draws: RatedDraws, errors: tuple[float, float], exactness: Exactness) -> dict[str, Any]:
    """Return the provenance of `numerical_errors`, of the checks of residuals, of silence and of the direction."""
    numerical = NumericalErrors(
        numerical_error=errors[0],
        inflection_least_drop=max(LEAST_DROP, 3.0 * errors[0]),
        firing_error=errors[1],
        exactness=exactness_sentence(exactness),
        exactness_sd=exactness.sd,
        exactness_largest=exactness.largest,
        exactness_efficiency=exactness.efficiency,
        exactness_pareto_k=exactness.pareto_k,
        exact_reweight=draws.log_weight is not None,
    )
    direction = dict(zip(("direction_rises", "direction_rises_se"), draws.rises, strict=True))
    return attributes_of(numerical, _silence(draws)) | findings_attribute(_findings(draws)) | direction


def _tables(draws: RatedDraws, tree: xr.DataTree, inflection: Mapping[str, Variable]) -> dict[str, pd.DataFrame]:
    """Return the tables of a result by name, apart from its summary; `inflection` is the group of that name."""
    ratings, raters = draws.experiment.ratings, {FINGERS: finger_table(tree), ANSWERS: answer_table(tree)}
    tables = {
        "directions": direction_table(tree),
        "predictive_checks": check_table(tree),
        FABRIC_RATINGS: fabric_rating_table(tree),
        MODULI: modulus_table(tree),
        **{name: None if one is None else with_covariates(one, ratings) for name, one in raters.items()},
        RATERS: rater_table(tree, ratings),
        MODULUS_ERRORS: modulus_shifts(draws, inflection),
    }
    return {name: table for name, table in tables.items() if table is not None}


def assembled_skin(
    data: Measurements,
    posterior: Density,
    chains: Chains,
    burn_in: int,
    rng: np.random.Generator,
    attributes: Mapping[str, Any],
) -> Assembled:
    """Compute all groups and tables from the draws of a run without ratings; arguments as for `assembled`."""
    Stage.REPLICATES.log()
    kept = chains.kept(burn_in, DRAWS_PER_WALKER)
    natural = posterior.natural(kept.coordinates)
    theta, prior = kept.by_walker(natural), posterior.space.draw_prior(rng, PRIOR_DRAWS)
    some, curves = theta[evenly(theta.shape, REPLICATES)], theta[evenly(theta.shape, CURVES)]
    before = prior[:REPLICATES]
    plate, axes, pressed = plate_results(rng, data.compression, posterior, theta, some, before, curves)
    recorded, rows, nerves, rates = recorded_results(rng, data.afferents, posterior, theta, some, before, curves)
    own: Groups = {"prior": named(posterior.space, prior[None]), "constant_data": held_parameters(posterior.space)}
    sources = [name for name, table in data._asdict().items() if table is not None]
    sampled = sampled_groups(posterior, kept, theta, "_and_".join(sources))
    tree = tree_of(merged(sampled, plate, recorded, own), {**axes, **rows}, {**attributes, **pressed, **nerves})
    tables = {"directions": direction_table(tree)} | ({} if rates is None else {RECORDED_RATES: rates})
    return Assembled(tree, summarise(posterior.names, natural), tables)


def summary_of(draws: RatedDraws, exactness: Exactness) -> pd.DataFrame:
    """Return the summary of the parameters and of common effects, from the retained draws."""
    ensembles, stored, walkers = draws.kept.log_density.shape
    levels = {n: v for n, (v, dims) in draws.model.named_effects(draws.effects).items() if not dims}
    values = np.concatenate([draws.theta, *(v[..., None] for v in levels.values())], axis=-1)
    apart = values.reshape(ensembles, walkers, stored, -1).swapaxes(1, 2)
    table = summarise((*draws.posterior.names, *levels), apart)
    if draws.log_weight is None:
        return table
    return reweighted(table, values[evenly(draws.theta.shape, REWEIGHT_DRAWS)], exactness.log_weight)


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


def _findings(draws: RatedDraws) -> tuple[Finding, ...]:
    """Return the findings of the checks of residuals."""
    few, model, ratings = draws.subset(draws.replicates), draws.model, draws.experiment.ratings
    residuals = Residuals(draws.ratings, few.mean_rate, few.parameters, few.effects)
    moduli, skins = (
        drive_slope(draws.posterior, few.theta, rates_of_others(draws.posterior, few.theta, step), step)
        for rates_of_others, step in ((rates_of_other_moduli, MODULUS_STEP), (rates_of_other_skins, SKIN_STEP))
    )
    effects, available = model.named_effects(few.effects), model.scale in OF_DIFFERENT_RATERS
    modelled = {name for name, effect in RATER_EFFECTS.items() if effect in effects}
    at = zip(ratings.conditions.fabric, ratings.conditions.load, strict=True)
    found = [
        *check_fabrics(residuals, [f"{ratings.fabrics[fabric]} under {ratings.loads[load]}" for fabric, load in at]),
        check_slope(residuals, EXPONENTS, residuals.response, "gamma" in modelled, available),
        check_noise(residuals, "varsigma" in modelled, available, model.error in (STUDENT, LAPSES)),
        check_slope(residuals, ALONG, moduli, draws.posterior.space.moduli is not None),
        check_slope(residuals, SKINS, skins, draws.posterior.fingers is not None),
    ]
    order = draws.experiment.ratings.order
    if order is not None and model.scale not in (RANKS, PAIRS):
        found.append(check_drift(residuals, order))
    term = draws.posterior.term(SPREADS)
    if term is not None:
        parameters = draws.posterior.parameters_of(term, few.theta)
        found.append(check_spreads(term, few.mean_rate, parameters, np.random.default_rng(0)))
    return tuple(found)


def _silence(draws: RatedDraws) -> Silence:
    """Return the shares of silent draws and of contacts outside the range of Hertz's theory."""
    stated = slice(draws.scene.n_conditions)
    prior, posterior = draws.posterior.mean_rate(draws.prior)[..., stated], draws.mean_rate[..., stated]
    beyond = draws.scene.beyond_hertz(*draws.touches(draws.subset(draws.curves).theta))
    return Silence(
        prior_silent_everywhere=float((prior == 0).all(axis=-1).mean()),
        prior_silent_conditions=float((prior == 0).mean()),
        posterior_silent_everywhere=float((posterior == 0).all(axis=-1).mean()),
        posterior_silent_conditions=float((posterior == 0).mean()),
        contact_beyond_half_radius=beyond.questionable,
        contact_beyond_radius=beyond.meaningless,
    )
