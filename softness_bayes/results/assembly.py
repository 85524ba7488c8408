"""Assembly of the result of a run, with each group computed as a function of the draws."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from enum import Enum
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.files import run_files
from softness_bayes.checking import individual
from softness_bayes.checking.agreement import fabric_rating_table
from softness_bayes.checking.check_table import check_table
from softness_bayes.checking.checks import loo_pit
from softness_bayes.checking.identifiability import direction_table, information_table
from softness_bayes.checking.inflection import curve_scene
from softness_bayes.checking.layout import PEOPLE_ORDERS
from softness_bayes.checking.provenance import PRIOR, Provenance, family_of
from softness_bayes.data import Experiment, Measurements, Ratings
from softness_bayes.likelihood.contract import RATER_EFFECTS, RATER_SPREADS, RowsLeftOut
from softness_bayes.likelihood.pieces import pieces
from softness_bayes.likelihood.scales import PAIRS
from softness_bayes.model.build import ExperimentModel, SkinModel
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.posterior import Posterior
from softness_bayes.people.free_means import FreeMeans
from softness_bayes.people.psychometric import threshold_table
from softness_bayes.people.ruler import ruler_of_run
from softness_bayes.results import draws as of_run
from softness_bayes.results import predictions
from softness_bayes.results.data_groups import coordinates, data_groups, held_parameters, stored_curves
from softness_bayes.results.draws import (
    ROWS,
    Part,
    RatedDraws,
    Variable,
    evenly,
    joined,
    named,
    replicated_groups,
    sampled_groups,
)
from softness_bayes.results.other_data import other_data
from softness_bayes.results.run_checks import checked, compare_exactly, exactness_stats, numerical_errors
from softness_bayes.results.summary import rater_table, reweighted, summarise, with_covariates
from softness_bayes.sampler.chains import Chains
from softness_bayes.sampler.sampling import Sampled
from softness_bayes.sampler.workers import Workers
from softness_bayes.touch.finger_grid import EFFECT_OF, SPREAD_OF

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    Contents = tuple[xr.DataTree, pd.DataFrame, dict[str, pd.DataFrame]]

Array = NDArray[np.float64]


LEFT_OUT_CHUNK = 50
"""Largest number of draws of which a worker computes each rating given all others in one call."""


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


def assembled(
    model: ExperimentModel | SkinModel,
    sampled: Sampled,
    rng: np.random.Generator,
    workers: Workers,
    attributes: Mapping[str, Any],
    reweight: bool = False,
    exact: bool = True,
    share: float = 1.0,
) -> Contents:
    """Compute the groups of a result, its summary and its other tables from the draws of a run.

    Parameters
    ----------
    model, sampled
        The model, and the end of its walk.
    rng
        Random generator of all quantities drawn after sampling.
    workers
        Processes with the posterior as their resident object, which share the work.
    attributes
        Provenance of the result, apart from what is added here.
    reweight
        Whether summary, predictions and replicates use draws weighted by the exact likelihood.
    exact
        Whether the fast likelihood is compared with the exact one.
    share
        Share of the usual numbers of draws of all quantities.
    """
    posterior, kept = model.posterior, sampled.chains.kept(sampled.verdict.burn_in, int(share * of_run.DRAWS))
    theta = kept.by_walker(posterior.natural(kept.coordinates))
    first = Part(sampled_groups(posterior, kept, theta, _sources(model.data)), attributes=attributes)
    if isinstance(model, ExperimentModel):
        return _rated(model, first, kept, theta, rng, workers, reweight, exact, share)
    Stage.REPLICATES.log()
    prior = posterior.space.draw_prior(rng, of_run.PRIOR_DRAWS)
    some, curves = (theta[evenly(theta.shape, size)] for size in (of_run.REPLICATES, of_run.CURVES))
    held = {"prior": named(posterior.space, prior[None]), "constant_data": held_parameters(posterior.space)}
    others = other_data(rng, model.data, posterior, (theta, some, prior[: of_run.REPLICATES], curves))
    found = joined(first, others, Part(held))
    tree = found.tree
    summary = summarise(posterior.names, _by_ensemble(kept, theta))
    return tree, summary.join(information_table(tree)), {"directions": direction_table(tree), **found.tables}


def _rated(
    model: ExperimentModel,
    first: Part,
    kept: Chains,
    theta: Array,
    rng: np.random.Generator,
    workers: Workers,
    reweight: bool,
    exact: bool,
    share: float,
) -> Contents:
    """Return the contents of the result of a run on ratings; `first` is its part that every run has."""
    import xarray as xr

    Stage.EXACT.log()
    experiment, posterior, options = model.data, model.posterior, model.options
    means = workers.later(_means_of_people, experiment.ratings, options) if options.scale.model is None else None
    scale = Provenance(first.attributes).rating_model.rating_scale
    comparison = compare_exactly(posterior, theta, workers, reweight) if exact else None
    weights = comparison().log_weight if reweight and comparison is not None else None
    draws = RatedDraws(experiment, posterior, scale, kept, theta, rng, workers, share, weights)
    few, curves = draws.subset(draws.replicates), draws.subset(draws.curves)
    noise = rng.spawn(1)[0]
    Stage.REPLICATES.log()
    replicated = Part(replicated_groups(rng, draws))
    others = other_data(rng, experiment, posterior, (theta, few.theta, draws.prior[: draws.replicates], curves.theta))
    Stage.LEFT_OUT.log()
    chunks = [(few.theta[k],) for k in pieces(len(few.theta), 1, LEFT_OUT_CHUNK)]
    of_rows, of_people = zip(*workers.map(_left_out, chunks), strict=True)
    left_out, whole = RowsLeftOut(*map(np.concatenate, zip(*of_rows, strict=True))), np.concatenate(of_people)
    Stage.PREDICTIONS.log()
    errors, grid = numerical_errors(draws), curve_scene(draws.scene, loads=draws.shown_loads)
    predicted = predictions.prediction_group(draws, grid, errors[0])
    turning = predictions.turning_groups(draws, errors[0])
    turn, touched = predicted["inflection_e_fab_kpa"].values[0] * 1e3, draws.subset(predictions.ILLUSTRATED).theta
    shown = predictions.touch_illustration(rng, draws.scene, draws.touch(touched), turn)
    fired = predictions.membrane_illustration(noise, draws.scene, draws.touch(curves.theta))
    Stage.CHECKS.log()
    compared = None if comparison is None else comparison()
    effects = draws.model.named_effects(draws.effects)
    absent = () if "omega" in posterior.names else ("fabric_effect",)
    own: of_run.Groups = {
        "posterior": {name: Variable(*one) for name, one in effects.items() if name not in absent},
        "sample_stats": exactness_stats(compared, theta.shape),
        "log_likelihood": {"rating": Variable(left_out.log_density[None], ROWS)},
        # not named like the rating, which has a different axis
        "log_likelihood_participant": {"ratings_of_participant": Variable(whole[None], ("participant",))},
        "predictions": predicted,
        **turning,
    }
    found = joined(
        first._replace(coordinates=coordinates(draws, grid)),
        Part(own, attributes={**family_of(PRIOR, draws.model.levels), **stored_curves(draws.scene.firing)}),
        replicated,
        Part(data_groups(draws, loo_pit(left_out, draws.ratings.discrete))),
        others,
        shown,
        fired,
        Part({}, attributes=checked(draws, errors, compared)),
    )
    Stage.TABLES.log()
    tree = found.tree
    levels = {name: values for name, (values, dims) in effects.items() if not dims}
    values = np.concatenate([theta, *(one[..., None] for one in levels.values())], axis=-1)
    summary = summarise((*posterior.names, *levels), _by_ensemble(kept, values))
    if draws.log_weight is not None:
        summary = reweighted(summary, values[evenly(theta.shape, of_run.REWEIGHT_DRAWS)], draws.log_weight)
    tables = _tables(draws, tree, turning["inflection"]) | dict(found.tables)
    if means is not None:
        people = means()
        tables[run_files.RULER] = ruler_of_run(people, experiment.ratings, options.scale, tree)
        axes = {draws.load_axis: people.loads, "fabric": people.fabrics, "other_fabric": people.fabrics}
        orders = xr.DataArray(people.p_orders.astype(np.float32), {axis: list(labels) for axis, labels in axes.items()})
        tree[f"constant_data/{PEOPLE_ORDERS}"] = orders
        own_means = people.table().set_index(["load", "fabric"])[["people", "people_low", "people_high", "p_highest"]]
        tables[run_files.FABRIC_RATINGS] = tables[run_files.FABRIC_RATINGS].join(own_means)
    if options.scale == PAIRS and len(thresholds := threshold_table(experiment.ratings, tree)):
        tables[run_files.THRESHOLDS] = thresholds.set_index(["load", "reference", "answers"])
    return tree, summary.join(information_table(tree)), tables


def _by_ensemble(kept: Chains, values: Array) -> Array:
    """Return values (chains, draws, quantities) as (ensembles, draws, walkers, quantities)."""
    ensembles, stored, walkers = kept.log_density.shape
    return values.reshape(ensembles, walkers, stored, -1).swapaxes(1, 2)


def _means_of_people(_: Any, ratings: Ratings, options: ModelOptions) -> FreeMeans:
    return FreeMeans(ratings, options)


def _sources(data: Experiment | Measurements) -> str:
    """Return the name of the joint log-likelihood of all data in a result."""
    others = [name for name in ("compression", "afferents") if getattr(data, name) is not None]
    return "_and_".join([*(["ratings"] if isinstance(data, Experiment) else []), *others])


def _left_out(posterior: Posterior, theta: Array) -> tuple[RowsLeftOut, Array]:
    """Return the law of each rating given all others, and the log density of each participant's ratings."""
    ratings, at = posterior.observation, (posterior.response(theta), posterior.rating_parameters(theta))
    return ratings.left_out(*at), ratings.log_likelihood_participants(*at)


def _tables(draws: RatedDraws, tree: xr.DataTree, inflection: Mapping[str, Variable]) -> dict[str, pd.DataFrame]:
    """Return the tables of a result by name, apart from its summary; `inflection` is the group of that name."""
    ratings = draws.experiment.ratings
    raters = {
        run_files.FINGERS: individual.deviation_table(tree, EFFECT_OF, SPREAD_OF),
        run_files.ANSWERS: individual.deviation_table(tree, RATER_EFFECTS, RATER_SPREADS),
    }
    tables = {
        "directions": direction_table(tree),
        "predictive_checks": check_table(tree),
        run_files.FABRIC_RATINGS: fabric_rating_table(tree),
        run_files.MODULI: individual.modulus_table(tree),
        **{name: None if one is None else with_covariates(one, ratings) for name, one in raters.items()},
        run_files.RATERS: rater_table(tree, ratings),
        run_files.MODULUS_ERRORS: predictions.modulus_shifts(draws, inflection),
    }
    return {name: table for name, table in tables.items() if table is not None}
