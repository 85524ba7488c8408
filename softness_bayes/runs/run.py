"""One run from data to result: model, sampling, and all predictions from the draws."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from softness_bayes import arviz_bridge
from softness_bayes.checking.agreement import fabric_rating_table
from softness_bayes.checking.check_table import check_table
from softness_bayes.checking.exactness import HARMLESS, LARGEST_K, Exactness
from softness_bayes.checking.identifiability import direction_table, information_table
from softness_bayes.checking.individual import answer_table, finger_table, modulus_table
from softness_bayes.checkpoints.checkpoint import Checkpoint
from softness_bayes.checkpoints.identity import identity, require_density
from softness_bayes.data import Compression, Experiment
from softness_bayes.files.command_line import storable
from softness_bayes.files.run_files import ANSWERS, FABRIC_RATINGS, FINGERS, MODULI, MODULUS_ERRORS, RATERS, RULER
from softness_bayes.likelihood.directions import direction_named
from softness_bayes.model.build import ExperimentModel, build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.posterior import Density, Posterior
from softness_bayes.people.of_run import people_tables
from softness_bayes.provenance import (
    PRIOR,
    READING,
    Asked,
    DirectionTaken,
    Ending,
    RatingData,
    RatingSettings,
    attributes_of,
    family_of,
    versions,
)
from softness_bayes.results.assembly import FigureDrawing, Listener, Stage, assembled, no_listener
from softness_bayes.results.draws import FIRST_SHARE
from softness_bayes.results.exact import compare_integrals
from softness_bayes.results.request import Request
from softness_bayes.results.result import Result
from softness_bayes.results.result_file import SCHEMA
from softness_bayes.results.run_options import RunOptions
from softness_bayes.results.summary import rater_table, with_covariates
from softness_bayes.sampler.chains import RunState
from softness_bayes.sampler.sampling import Progress, Sampled, progress_of, sampled_of, walk
from softness_bayes.sampler.workers import Workers, one_thread

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

BY_REFERENCE = (
    "; effects of raters are summed over points in every step, because Laplace's method is too rough for this table"
)
"""Addition to the note on the errors of a run whose integrals by Laplace's method could not be corrected by weights."""
MANY_RATINGS = 5000
"""Number of ratings above which each ensemble walks alone: the time of a call then grows with its points, and ensembles
that walk together would leave processors without work."""


def walked(
    data: Experiment | Compression,
    density: Density,
    request: Request,
    progress: Callable[[Progress], None] | None,
    checkpoint: Checkpoint | None,
    workers: Workers | None = None,
) -> RunState:
    """Sample until convergence or a limit, from the start or from a checkpoint; arguments as for `sample`."""
    density.space.require_sampled()
    settings, begin = request.run.settings, None
    if isinstance(data, Experiment) and len(data.ratings) > MANY_RATINGS:
        settings = replace(settings, together=1)
    if checkpoint is not None:
        begin = checkpoint.begin(identity(data, density, settings, request.choices()))
        if begin is not None:
            require_density(density, begin)
    try:
        for state in walk(density, settings, request.run.seed, begin, workers):
            if checkpoint is not None:
                checkpoint.keep(state, settings, density)
            if progress is not None:
                progress(progress_of(state, settings))
    finally:
        if checkpoint is not None:
            checkpoint.flush()
    return state


def rng_after(run: RunOptions) -> np.random.Generator:
    """Return the random generator for all draws after sampling; a separate key makes it independent of ensembles."""
    return np.random.default_rng(np.random.SeedSequence(run.seed, spawn_key=(1 << 20,)))


def labels_of(data: Experiment | Compression) -> dict[str, Sequence[str]]:
    """Return the names of participants, fabrics and fingers in some data, by the axis of a result."""
    if isinstance(data, Compression):
        return {"finger": data.participants}
    fingers = {} if data.compression is None else labels_of(data.compression)
    return {"participant": data.ratings.participants, "fabric": data.ratings.fabrics, **fingers}


def requested(density: Density, request: Request) -> dict[str, Any]:
    """Return the part of the provenance known before the first step: the requested settings.

    Raises
    ------
    InputError
        If an option cannot be stored as JSON.
    """
    model, run = request
    model.require_storable()
    return {
        **attributes_of(Asked(SCHEMA, storable(run.command), request.record(), run.seed, model.prior_set)),
        **family_of(PRIOR, {one.name: one.prior for one in density.space.chain}),
        **family_of(READING, model.readings.names),
        **versions(),
    }


def outcome(state: RunState, run: RunOptions) -> dict[str, Any]:
    """Return the part of the provenance about the end of the run."""
    verdict = sampled_of(state).verdict
    said = verdict.sentence()
    return attributes_of(
        Ending(
            verdict=f"A first look (quick), no result. {said}" if run.quick else said,
            converged=verdict.converged,
            steps=verdict.steps,
            missing_steps=verdict.more_steps,
            burn_in=verdict.burn_in,
            sampling_seconds=state.seconds,
            evaluations=state.nonfinite.evaluations,
            failures=state.nonfinite.count,
            quick=run.quick,
        )
    )


def sample(
    experiment: Experiment,
    model: ModelOptions = ModelOptions(),
    run: RunOptions = RunOptions(),
    progress: Callable[[Progress], None] | None = None,
    checkpoint: Checkpoint | None = None,
    **options: Any,
) -> Result:
    """Sample the posterior of an experiment and predict from it.

    The same data, options and seed give the same draws as ``softness-bayes sample``.

    Parameters
    ----------
    experiment
        Ratings and fabrics.
    model, run
        Choices of the model, and how long to run.
    progress
        Function called at least every few seconds.
    checkpoint
        Checkpoint in which the run is saved, and from which it is continued if it contains one, with the same draws as
        an uninterrupted run with the same seed. Its lock must be held (``with Checkpoint.create(directory) as
        checkpoint``).
    **options
        Single options that replace those of `model` and `run`, by name: ``sample(experiment, fix={"m": 2}, seed=1)``.

    Raises
    ------
    TypeError
        If there is no option of a name.
    InputError
        If data and options do not make a model, prior draws almost never fire, the result file cannot store a name or
        an option, or the checkpoint belongs to another run.
    NumericalError
        If no starting point has a finite density, or too many points have none.
    """
    model, run = Request(model, run).with_options(**options)
    model.require_storable()
    if checkpoint is not None:
        model = _as_begun(model, checkpoint)
    return sample_model(build(experiment, model), run, progress, checkpoint)


def _as_begun(options: ModelOptions, checkpoint: Checkpoint) -> ModelOptions:
    """Return options with the direction of the run in a checkpoint, unless one is requested."""
    kept = checkpoint.description.get("direction")
    if options.direction is not None or kept is None:
        return options
    return options.decide(direction=direction_named(kept))


def sample_model(
    model: ExperimentModel,
    run: RunOptions,
    progress: Callable[[Progress], None] | None = None,
    checkpoint: Checkpoint | None = None,
    listener: Listener = no_listener,
    workers: Workers | None = None,
    figures: FigureDrawing | None = None,
) -> Result:
    """Sample a given model; other arguments and errors as for `sample`.

    Parameters
    ----------
    listener
        Function called at the start of each stage after sampling.
    workers
        Processes with the posterior, which are not closed; by default new ones.
    figures
        Figures, started as soon as their data are available.
    """
    experiment, posterior, options, chosen = model.experiment, model.posterior, model.options, model.direction
    request = Request(options, run)
    asked = {
        **requested(posterior, request),
        **attributes_of(
            DirectionTaken(
                chosen.direction,
                chosen.asked,
                chosen.sentence,
                chosen.evidence.firing,
                direction_of_data="" if chosen.evidence.direction is None else chosen.evidence.direction.name,
            ),
            RatingSettings(
                options.noise,
                options.scale,
                options.kept_accuracy,
                str(options.discretisation),
                model.interpretation.law.name,
                model.interpretation.errors_note,
                model.interpretation.note,
            ),
            RatingData(
                experiment.ratings.digest,
                experiment.fabrics.digest,
                experiment.ratings.n_missing,
                experiment.ratings.rating_column,
            ),
        ),
    }
    arviz_bridge.require_storable(asked, labels_of(experiment))
    with one_thread(), nullcontext(workers) if workers is not None else run.settings.workers(posterior) as workers:
        state = walked(experiment, posterior, request, progress, checkpoint, workers)
        sampled = sampled_of(state)
        ended = sampled.verdict.converged and not run.quick
        integrals = _integrals(posterior, sampled) if ended else None
        if integrals is None or integrals.exact_enough or integrals.pareto_k <= LARGEST_K:
            weighed = run.exact_reweight or (integrals is not None and integrals.sd > HARMLESS)
            return _assembled(model, run, asked, state, workers, weighed, listener, figures)
    # importance weights fail: the walk is repeated without the approximation
    interpretation = model.interpretation._replace(errors_note=f"{model.interpretation.errors_note}{BY_REFERENCE}")
    observation = posterior.observation.without_approximation()
    sure = replace(model, interpretation=interpretation, posterior=posterior.with_term(observation))
    return sample_model(sure, run, progress, None, listener, None, figures)


def _integrals(posterior: Posterior, sampled: Sampled) -> Exactness | None:
    """Return the comparison of the integrals that the sampler used with their reference; None if they are the same."""
    if posterior.observation.for_sampling() is posterior.observation:
        return None
    kept = sampled.chains.kept(sampled.verdict.burn_in)
    return compare_integrals(posterior, kept.by_walker(posterior.natural(kept.coordinates)))


def _assembled(
    model: ExperimentModel,
    run: RunOptions,
    asked: dict[str, Any],
    state: RunState,
    workers: Workers,
    reweight: bool,
    listener: Listener,
    figures: FigureDrawing | None,
) -> Result:
    """Return the result of a walk that has ended, from draws that are weighted by the exact likelihood if asked."""
    sampled = sampled_of(state)
    tree, summary, shifts = assembled(
        model.experiment,
        model.posterior,
        sampled.chains,
        sampled.verdict.burn_in,
        rng_after(run),
        workers,
        {**asked, **outcome(state, run)},
        reweight,
        listener,
        figures,
        exact=not run.quick,
        share=FIRST_SHARE if run.quick else 1.0,
    )
    listener(Stage.TABLES)
    return Result(tree, summary.join(information_table(tree)), tables_of(model, tree, shifts))


def tables_of(model: ExperimentModel, tree: xr.DataTree, shifts: pd.DataFrame | None) -> dict[str, pd.DataFrame]:
    """Return the tables of a result by name, apart from its summary; `shifts` are the effects of errors in moduli."""
    experiment = model.experiment
    tables = {"directions": direction_table(tree), "predictive_checks": check_table(tree)}
    tables[FABRIC_RATINGS] = fabric_rating_table(tree)
    if model.options.scale.model is None:
        people, tables[RULER] = people_tables(experiment.ratings, model.options, tree)
        tables[FABRIC_RATINGS] = tables[FABRIC_RATINGS].join(people)
    if (moduli := modulus_table(tree)) is not None:
        tables[MODULI] = moduli
    if (fingers := finger_table(tree)) is not None:
        tables[FINGERS] = with_covariates(fingers, experiment.ratings)
    if (answers := answer_table(tree)) is not None:
        tables[ANSWERS] = with_covariates(answers, experiment.ratings)
    if (raters := rater_table(tree, experiment.ratings)) is not None:
        tables[RATERS] = raters
    if shifts is not None:
        tables[MODULUS_ERRORS] = shifts
    return tables
