"""Assembly of the result of a run on ratings, with each group computed as a function of the draws."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from enum import Enum
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.agreement import TYPICAL, fabric_rating_table
from softness_bayes.checking.check_table import NEW_PARTICIPANTS, check_table
from softness_bayes.checking.checks import (
    MODULUS_STEP,
    SKIN_STEP,
    Residuals,
    check_exponent,
    check_exponents,
    check_fabrics,
    check_fingers,
    check_moduli,
    check_noise,
    check_spreads,
    loo_pit,
)
from softness_bayes.checking.exactness import Exactness
from softness_bayes.checking.identifiability import direction_table
from softness_bayes.checking.individual import answer_table, finger_table, modulus_table
from softness_bayes.checking.inflection import LEAST_DROP, curve_scene
from softness_bayes.checking.sentences import exactness_sentence
from softness_bayes.data import Compression, Experiment
from softness_bayes.files.run_files import ANSWERS, FABRIC_RATINGS, FINGERS, MODULI, MODULUS_ERRORS, RATERS
from softness_bayes.likelihood.effects import RATER_EFFECTS
from softness_bayes.likelihood.error_laws import LAPSES, STUDENT
from softness_bayes.likelihood.models import OF_DIFFERENT_RATERS
from softness_bayes.likelihood.scales import Scale
from softness_bayes.likelihood.spreads import SPREADS
from softness_bayes.model.posterior import Density, Posterior
from softness_bayes.model.prediction import drive_slope, rates_of_other_moduli, rates_of_other_skins
from softness_bayes.parameters.declared import PARAMETERS
from softness_bayes.parameters.space import ParameterSpace
from softness_bayes.provenance import (
    PRIOR,
    Finding,
    NumericalErrors,
    Provenance,
    ResidualChecks,
    Silence,
    attributes_of,
    family_of,
)
from softness_bayes.results.constants import constant_group, coordinates, held_parameters, observed
from softness_bayes.results.draws import (
    CURVES,
    DRAWS_PER_WALKER,
    PRIOR_DRAWS,
    REPLICATES,
    REWEIGHT_DRAWS,
    Groups,
    RatedDraws,
    Variable,
    draws_of,
    draws_per_walker,
    evenly,
    merged,
    named,
    sampled_groups,
    tree_of,
)
from softness_bayes.results.exact import compare_exactly, exactness_stats, unchecked
from softness_bayes.results.predictions import illustration_groups, modulus_shifts, prediction_group, turning_groups
from softness_bayes.results.replicates import (
    Replicates,
    draw_plate,
    draw_replicates,
    plate_attributes,
    plate_coordinates,
    plate_groups,
    predictive_groups,
    prior_groups,
)
from softness_bayes.results.summary import rater_table, reweighted, summarise, with_covariates
from softness_bayes.sampler.chains import Chains
from softness_bayes.sampler.workers import Workers
from softness_bayes.touch.scene import Scene

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

Array = NDArray[np.float64]

ERROR_DRAWS = 32
"""Posterior draws at which the scene is compared with a finer one."""


RATINGS = {
    "posterior_predictive": ("rating", NEW_PARTICIPANTS),
    "prior_predictive": ("rating",),
    "predictions": (TYPICAL, "typical_rating"),
}
"""Variables with ratings, which are stored in the units of the file."""


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

    @property
    def number(self) -> int:
        """Number of the stage, from 1."""
        return [*Stage].index(self) + 1

    def __str__(self) -> str:
        return f"after sampling, {self.number} of {len(Stage)}: {self.value}"

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
    draws = draws_of(experiment, posterior, kept, theta, rng, share)
    exactness = compare_exactly(posterior, theta, workers, reweight) if exact else unchecked()
    if reweight:
        draws = replace(draws, log_weight=exactness.log_weight)
    Stage.REPLICATES.log()
    drawn = draw_replicates(rng, draws)
    error, grid = numerical_error(draws), curve_scene(draws.scene, loads=draws.shown_loads)
    groups = _groups(draws, drawn, error, grid, Provenance(attributes).rating_model.rating_scale)
    turn = groups["predictions"]["inflection_e_fab_kpa"].values[0] * 1e3
    shown, axes = illustration_groups(draws, drawn.receptors, drawn.trains, turn)
    Stage.CHECKS.log()
    plate, plate_found = _plate(draws, drawn)
    found = {
        **_checks(draws, error, exactness),
        **_held_eps(posterior.space),
        **({} if np.isnan(draws.rises) else {"direction_rises": draws.rises, "direction_rises_se": draws.rises_error}),
        **plate_found,
    }
    posterior_groups = merged(_posterior_groups(draws), {"sample_stats": exactness_stats(exactness, theta.shape)})
    tree = tree_of(
        merged(posterior_groups, groups, plate, shown),
        {**coordinates(draws, grid), **axes},
        {**attributes, **family_of(PRIOR, draws.model.levels), **found},
    )
    Stage.TABLES.log()
    shifts = modulus_shifts(draws, groups["inflection"])
    return Assembled(tree, summary_of(draws, exactness), _tables(experiment, tree, shifts))


def _tables(experiment: Experiment, tree: xr.DataTree, shifts: pd.DataFrame | None) -> dict[str, pd.DataFrame]:
    """Return the tables of a result by name, apart from its summary; `shifts` are the effects of errors in moduli."""
    raters = {FINGERS: finger_table(tree), ANSWERS: answer_table(tree)}
    found = {
        "directions": direction_table(tree),
        "predictive_checks": check_table(tree),
        FABRIC_RATINGS: fabric_rating_table(tree),
        MODULI: modulus_table(tree),
        **{name: None if one is None else with_covariates(one, experiment.ratings) for name, one in raters.items()},
        RATERS: rater_table(tree, experiment.ratings),
        MODULUS_ERRORS: shifts,
    }
    return {name: table for name, table in found.items() if table is not None}


def assembled_skin(
    compression: Compression,
    posterior: Density,
    chains: Chains,
    burn_in: int,
    rng: np.random.Generator,
    attributes: Mapping[str, Any],
) -> Assembled:
    """Compute all groups and tables from the draws of a run on compression data alone; arguments as for `assembled`."""
    Stage.REPLICATES.log()
    kept = chains.kept(burn_in, DRAWS_PER_WALKER)
    natural = posterior.natural(kept.coordinates)
    theta = kept.by_walker(natural)
    prior, forces = posterior.space.draw_prior(rng, PRIOR_DRAWS), posterior.compression
    drawn = draw_plate(rng, posterior, theta, theta[evenly(theta.shape, REPLICATES)], prior[:REPLICATES])
    assert forces is not None
    assert drawn is not None
    typical = posterior.skin_parameters(theta[evenly(theta.shape, CURVES)])
    own = {"prior": named(posterior.space, prior[None]), "constant_data": held_parameters(posterior.space)}
    tree = tree_of(
        merged(
            sampled_groups(posterior, kept, theta, "compression"),
            plate_groups(compression, forces, typical, drawn),
            own,
        ),
        plate_coordinates(compression),
        {**attributes, **plate_attributes(compression, check_exponent(forces, drawn.again))},
    )
    return Assembled(tree, summarise(posterior.names, natural), {"directions": direction_table(tree)})


def numerical_error(draws: RatedDraws) -> float:
    """Return the largest numerical error of the response over some draws, relative to the peak of each draw."""
    return float(draws.scene.error(*draws.touches(draws.subset(ERROR_DRAWS).theta)).max())


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


def _groups(draws: RatedDraws, drawn: Replicates, error: float, grid: Scene, scale: Scale) -> Groups:
    """Return all groups except those of the posterior."""
    Stage.LEFT_OUT.log()
    few = draws.subset(draws.replicates)
    left_out = draws.ratings.left_out(few.mean_rate, few.parameters)
    pit = loo_pit(left_out, draws.ratings.discrete)
    predicted = predictive_groups(draws, drawn, left_out.log_density)
    Stage.PREDICTIONS.log()
    groups: Groups = {
        **prior_groups(draws, drawn),
        "predictions": prediction_group(draws, grid, error),
        **turning_groups(draws, error),
    }
    groups = merged(groups, predicted)
    for group, names in RATINGS.items():
        groups[group] |= {n: groups[group][n]._replace(values=scale.filed(groups[group][n].values)) for n in names}
    data: Groups = {"observed_data": observed(draws, scale), "constant_data": constant_group(draws, pit, scale)}
    return merged(groups, data)


def _posterior_groups(draws: RatedDraws) -> Groups:
    data = "ratings" if draws.posterior.compression is None else "ratings_and_compression"
    groups = sampled_groups(draws.posterior, draws.kept, draws.theta, data)
    effects = {n: Variable(v, dims) for n, (v, dims) in draws.model.named_effects(draws.effects).items()}
    if "omega" not in draws.posterior.names:
        effects.pop("fabric_effect", None)
    return merged(groups, {"posterior": effects})


def _plate(draws: RatedDraws, drawn: Replicates) -> tuple[Groups, dict[str, Any]]:
    """Return the groups and the provenance added by compression data; empty without such data."""
    data, forces = draws.experiment.compression, draws.posterior.compression
    if data is None or forces is None or drawn.plate is None:
        return {}, {}
    skin = draws.posterior.skin_parameters(draws.subset(draws.curves).theta)
    attributes = plate_attributes(data, check_exponent(forces, drawn.plate.again))
    return plate_groups(data, forces, skin, drawn.plate), attributes


def _findings(draws: RatedDraws) -> tuple[Finding, ...]:
    """Return the findings of the checks of residuals."""
    few, model = draws.subset(draws.replicates), draws.model
    residuals = Residuals(draws.ratings, few.mean_rate, few.parameters, few.effects)
    moduli, skins = (
        drive_slope(draws.posterior, few.theta, rates_of_others(draws.posterior, few.theta, step), step)
        for rates_of_others, step in ((rates_of_other_moduli, MODULUS_STEP), (rates_of_other_skins, SKIN_STEP))
    )
    effects, available = model.named_effects(few.effects), model.scale in OF_DIFFERENT_RATERS
    modelled = {name for name, effect in RATER_EFFECTS.items() if effect in effects}
    found = [
        *check_fabrics(residuals, _condition_names(draws.experiment)),
        check_exponents(residuals, "gamma" in modelled, available),
        check_noise(residuals, "varsigma" in modelled, available, model.error in (STUDENT, LAPSES)),
        check_moduli(residuals, moduli, draws.posterior.space.moduli is not None),
        check_fingers(residuals, skins, draws.posterior.fingers is not None),
    ]
    term = draws.posterior.term(SPREADS)
    if term is not None:
        parameters = draws.posterior.parameters_of(term, few.theta)
        found.append(check_spreads(term, few.mean_rate, parameters, np.random.default_rng(0)))
    return tuple(found)


def _checks(draws: RatedDraws, error: float, exactness: Exactness) -> dict[str, Any]:
    """Return the provenance of numerical errors, of the checks of residuals and of silence."""
    errors = NumericalErrors(
        numerical_error=error,
        inflection_least_drop=max(LEAST_DROP, 3.0 * error),
        firing_error=_firing_error(draws),
        exactness=exactness_sentence(exactness),
        exactness_sd=exactness.sd,
        exactness_largest=exactness.largest,
        exactness_efficiency=exactness.efficiency,
        exactness_pareto_k=exactness.pareto_k,
        exact_reweight=draws.log_weight is not None,
    )
    return attributes_of(errors, ResidualChecks(_findings(draws)), _silence(draws))


def _condition_names(experiment: Experiment) -> list[str]:
    """Return labels of all conditions, with fabric and load."""
    ratings = experiment.ratings
    at = zip(ratings.conditions.fabric, ratings.conditions.load, strict=True)
    return [f"{ratings.fabrics[fabric]} under {ratings.loads[load]}" for fabric, load in at]


def _firing_error(draws: RatedDraws) -> float:
    """Return a bound on the error of a draw's peak response due to the measured error of the rate curves."""
    touch, modulus = draws.touches(draws.subset(ERROR_DRAWS).theta)
    response = draws.scene.respond(touch, modulus)
    peak = response.total_rate.max(axis=-1)
    hertz = draws.scene.firing.curves(touch.channels, touch.alpha).error.hertz
    fires = peak > 0
    return float((hertz * response.responding.max(axis=-1)[fires] / peak[fires]).max(initial=0.0))


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


def _held_eps(space: ParameterSpace) -> dict[str, str]:
    """Return the note on a fixed eps, as an attribute; empty if eps is sampled or absent."""
    if "eps" not in space.held:
        return {}
    held, prior = space.held["eps"], PARAMETERS["eps"].prior
    return {
        "held_eps": f"eps is fixed at {held:g} Hz: all intervals treat it as known, although it cannot be "
        f"measured; omit '--fix eps={held:g}' to sample it with its prior {prior}"
    }
