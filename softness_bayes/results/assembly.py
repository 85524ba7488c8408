"""Assembly of the result of a run, with each group computed as a function of the draws."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from enum import Enum
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.files import run_files
from softness_bayes.checking import individual
from softness_bayes.checking.agreement import fabric_rating_table
from softness_bayes.checking.check_table import check_table
from softness_bayes.checking.checks import loo_pit
from softness_bayes.checking.exactness import Exactness
from softness_bayes.checking.identifiability import direction_table
from softness_bayes.checking.inflection import curve_scene
from softness_bayes.checking.provenance import PRIOR, Provenance, family_of
from softness_bayes.data import Experiment, Measurements
from softness_bayes.likelihood.contract import RowsLeftOut
from softness_bayes.likelihood.pieces import pieces
from softness_bayes.model.posterior import Density, Posterior
from softness_bayes.results import draws as of_run
from softness_bayes.results import predictions
from softness_bayes.results.data_groups import coordinates, data_groups, held_parameters, stored_curves
from softness_bayes.results.draws import Part, Points, RatedDraws, Variable, evenly, joined, named, sampled_groups
from softness_bayes.results.other_data import other_data
from softness_bayes.results.replicates import ROWS, replicated_groups
from softness_bayes.results.run_checks import checked, compare_exactly, exactness_stats, numerical_errors, unchecked
from softness_bayes.results.summary import rater_table, reweighted, summarise, with_covariates
from softness_bayes.sampler.chains import Chains
from softness_bayes.sampler.workers import Workers
from softness_bayes.touch.parameters import TouchParameters

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

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
    kept = chains.kept(burn_in, int(share * of_run.DRAWS))
    theta = kept.by_walker(posterior.natural(kept.coordinates))
    scale = Provenance(attributes).rating_model.rating_scale
    comparison = compare_exactly(posterior, theta, workers, reweight) if exact else unchecked
    draws = RatedDraws.of(experiment, posterior, scale, kept, theta, rng, workers, share)
    if reweight:
        draws = replace(draws, log_weight=comparison().log_weight)
    few, curves = draws.subset(draws.replicates), draws.subset(draws.curves)
    trains = workers.later(_trains, rng.spawn(1)[0], draws.touch(curves.theta))
    Stage.REPLICATES.log()
    replicated = Part(replicated_groups(rng, draws))
    others = other_data(
        rng, experiment, posterior, Points(theta, few.theta, draws.prior[: draws.replicates], curves.theta)
    )
    Stage.LEFT_OUT.log()
    chunks = [(few.theta[k],) for k in pieces(len(few.theta), 1, LEFT_OUT_CHUNK)]
    of_rows, of_people = zip(*workers.map(_left_out, chunks), strict=True)
    left_out, whole = RowsLeftOut(*map(np.concatenate, zip(*of_rows, strict=True))), np.concatenate(of_people)
    Stage.PREDICTIONS.log()
    errors, grid = numerical_errors(draws), curve_scene(draws.scene, loads=draws.shown_loads)
    predicted = predictions.prediction_group(draws, grid, errors[0])
    turning = predictions.turning_groups(draws, errors[0])
    turn = predicted["inflection_e_fab_kpa"].values[0] * 1e3
    shown = predictions.illustrations(rng, draws, turn, trains())
    Stage.CHECKS.log()
    compared = comparison()
    own: of_run.Groups = {
        "posterior": _effects(draws),
        "sample_stats": exactness_stats(compared, theta.shape),
        "log_likelihood": {"rating": Variable(left_out.log_density[None], ROWS)},
        # not named like the rating, which has a different axis
        "log_likelihood_participant": {"ratings_of_participant": Variable(whole[None], ("participant",))},
        "predictions": predicted,
        **turning,
    }
    found = joined(
        Part(sampled_groups(posterior, kept, theta, _sources(experiment)), coordinates(draws, grid), attributes),
        Part(own, attributes={**family_of(PRIOR, draws.model.levels), **stored_curves(draws.scene.firing)}),
        replicated,
        Part(data_groups(draws, loo_pit(left_out, draws.ratings.discrete))),
        others,
        shown,
        Part({}, attributes=checked(draws, errors, compared)),
    )
    Stage.TABLES.log()
    tree = found.tree
    tables = _tables(draws, tree, turning["inflection"]) | dict(found.tables)
    return Assembled(tree, summary_of(draws, compared), tables)


def _sources(data: Experiment | Measurements) -> str:
    """Return the name of the joint log-likelihood of all data in a result."""
    others = [name for name in ("compression", "afferents") if getattr(data, name) is not None]
    return "_and_".join([*(["ratings"] if isinstance(data, Experiment) else []), *others])


def _left_out(posterior: Posterior, theta: NDArray[np.float64]) -> tuple[RowsLeftOut, NDArray[np.float64]]:
    """Return the law of each rating given all others, and the log density of each participant's ratings."""
    ratings, at = posterior.observation, (posterior.response(theta), posterior.rating_parameters(theta))
    return ratings.left_out(*at), ratings.log_likelihood_participants(*at)


def _trains(posterior: Posterior, rng: np.random.Generator, parameters: TouchParameters) -> predictions.Trains:
    return predictions.example_trains(rng, posterior.scene, parameters)


def _effects(draws: RatedDraws) -> dict[str, Variable]:
    """Return the effects of participants and fabrics, those of fabrics only if their spread is sampled."""
    named_effects = draws.model.named_effects(draws.effects).items()
    absent = () if "omega" in draws.posterior.names else ("fabric_effect",)
    return {name: Variable(values, dims) for name, (values, dims) in named_effects if name not in absent}


def _tables(draws: RatedDraws, tree: xr.DataTree, inflection: Mapping[str, Variable]) -> dict[str, pd.DataFrame]:
    """Return the tables of a result by name, apart from its summary; `inflection` is the group of that name."""
    ratings = draws.experiment.ratings
    raters = {run_files.FINGERS: individual.finger_table(tree), run_files.ANSWERS: individual.answer_table(tree)}
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
    kept = chains.kept(burn_in, of_run.DRAWS)
    natural = posterior.natural(kept.coordinates)
    theta, prior = kept.by_walker(natural), posterior.space.draw_prior(rng, of_run.PRIOR_DRAWS)
    some, curves = (theta[evenly(theta.shape, size)] for size in (of_run.REPLICATES, of_run.CURVES))
    own: of_run.Groups = {
        "prior": named(posterior.space, prior[None]),
        "constant_data": held_parameters(posterior.space),
    }
    found = joined(
        Part(sampled_groups(posterior, kept, theta, _sources(data)), attributes=attributes),
        other_data(rng, data, posterior, Points(theta, some, prior[: of_run.REPLICATES], curves)),
        Part(own),
    )
    tree = found.tree
    tables = {"directions": direction_table(tree), **found.tables}
    return Assembled(tree, summarise(posterior.names, natural), tables)


def summary_of(draws: RatedDraws, compared: Exactness) -> pd.DataFrame:
    """Return the summary of the parameters and of common effects, from the retained draws."""
    ensembles, stored, walkers = draws.kept.log_density.shape
    levels = {n: v for n, (v, dims) in draws.model.named_effects(draws.effects).items() if not dims}
    values = np.concatenate([draws.theta, *(v[..., None] for v in levels.values())], axis=-1)
    apart = values.reshape(ensembles, walkers, stored, -1).swapaxes(1, 2)
    table = summarise((*draws.posterior.names, *levels), apart)
    if draws.log_weight is None:
        return table
    return reweighted(table, values[evenly(draws.theta.shape, of_run.REWEIGHT_DRAWS)], compared.log_weight)
