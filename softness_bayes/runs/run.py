"""Runs from data to result: model, sampling, predictions from the draws, and the files of the result."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import numpy as np

from softness_bayes.base import arviz_bridge
from softness_bayes.base.files.command_line import storable
from softness_bayes.base.ranges import require_kind
from softness_bayes.checking import provenance
from softness_bayes.checking.exactness import HARMLESS, LARGEST_K, Exactness
from softness_bayes.data import Afferents, Compression, Experiment, Measurements
from softness_bayes.data.fabrics import warn_of_moduli
from softness_bayes.likelihood.scales import direction_named
from softness_bayes.model.build import ExperimentModel, SkinModel, model_of
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.posterior import Posterior
from softness_bayes.results.assembly import Stage, assembled
from softness_bayes.results.draws import FIRST_SHARE
from softness_bayes.results.result import Result
from softness_bayes.results.run_checks import compare_exactly
from softness_bayes.results.run_options import Request, RunOptions
from softness_bayes.results.stored import SCHEMA
from softness_bayes.runs.checkpoint import Checkpoint
from softness_bayes.runs.identity import identity, require_density
from softness_bayes.sampler.chains import RunState
from softness_bayes.sampler.sampling import Progress, Sampled, progress_of, sampled_of, walk
from softness_bayes.sampler.workers import Workers, one_thread

Report = Callable[[Progress], None]
"""Function called at least every few seconds while a run is sampled."""

MANY_RATINGS = 5000
"""Number of ratings above which each ensemble walks alone: the time of a call then grows with its points, and ensembles
that walk together would leave processors without work."""

WIDE = ModelOptions(prior_set="wide")
"""Options of a model of compression data alone, with weakly informative priors of the skin."""


def sample(
    data: Experiment | Compression | Afferents | Measurements,
    model: ModelOptions | None = None,
    run: RunOptions = RunOptions(),
    progress: Report | None = None,
    checkpoint: Checkpoint | None = None,
    **options: Any,
) -> Result:
    """Sample the posterior of some data and predict from it.

    The same data, options and seed give the same draws as ``softness-bayes sample``. Without ratings, the result has no
    response curves and no turning point, but replicated forces and rates.

    Parameters
    ----------
    data
        Ratings and fabrics, with other data if there are any; or forces of a rigid plate on fingerpads, recorded
        afferents, or both.
    model
        Choices of the model; those about ratings are not used without them. By default `WIDE` for data with plate
        forces and without ratings.
    run
        How long to run.
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
    kinds = Experiment, Compression, Afferents, Measurements
    require_kind("data", data, kinds, "an Experiment, as read_experiment returns it, Compression or Afferents")
    if model is None:
        alone = not isinstance(data, (Experiment, Afferents)) and Measurements.of(data).compression is not None
        model = WIDE if alone else ModelOptions()
    model, run = Request(model, run).with_options(**options)
    model.require_storable()
    begun = None if checkpoint is None else checkpoint.description.get("direction")
    if model.direction is None and begun is not None:
        model = model.decide(direction=direction_named(begun))
    built = model_of(data, model)
    if isinstance(built, ExperimentModel):
        warn_of_moduli(built.data.fabrics)
    return sample_model(built, run, progress, checkpoint)


def sample_model(
    model: ExperimentModel | SkinModel,
    run: RunOptions,
    progress: Report | None = None,
    checkpoint: Checkpoint | None = None,
    workers: Workers | None = None,
) -> Result:
    """Sample a given model; other arguments and errors as for `sample`.

    Parameters
    ----------
    workers
        Processes with the posterior, which are not closed; by default new ones.
    """
    asked = requested(model, run)
    arviz_bridge.require_storable({**asked, **labels_of(model.data)})
    with (
        one_thread(),
        nullcontext(workers) if workers is not None else run.settings.workers(model.posterior) as workers,
    ):
        state = walked(model, run, progress, checkpoint, workers)
        sampled, attributes = sampled_of(state), {**asked, **outcome(state, run)}
        # a separate key makes the draws after sampling independent of the ensembles
        rng = np.random.default_rng(np.random.SeedSequence(run.seed, spawn_key=(1 << 20,)))
        integrals = _integrals(model, sampled, workers) if sampled.verdict.converged and not run.quick else None
        if integrals is None or integrals.exact_enough or integrals.pareto_k <= LARGEST_K:
            reweight = run.exact_reweight or (integrals is not None and integrals.sd > HARMLESS)
            share = FIRST_SHARE if run.quick and isinstance(model, ExperimentModel) else 1.0
            return Result(*assembled(model, sampled, rng, workers, attributes, reweight, not run.quick, share))
    # importance weights fail: the walk is repeated without the approximation
    assert isinstance(model, ExperimentModel), "without ratings there are no integrals over raters' effects"
    return sample_model(replace(model, approximate=False), run, progress)


def sample_kept(
    checkpoint: Checkpoint,
    model: ExperimentModel | SkinModel,
    run: RunOptions,
    own_figures: Sequence[str] | None,
    progress: Report | None = None,
) -> Result:
    """Sample a model until convergence or a limit, from the state of a checkpoint, and write its files next to it.

    Parameters
    ----------
    checkpoint
        The checkpoint of the run, whose lock is held.
    model, run
        The model, and how long to run.
    own_figures
        Figures to draw in addition to those of every run, custom or built-in; None to draw no figures at all.
    progress
        Function called at least every few seconds.

    Raises
    ------
    InputError, NumericalError
        As for `sample`.
    """
    with run.settings.workers(model.posterior) as workers:
        result = sample_model(model, run, progress, checkpoint, workers)
        Stage.FILES.log()
        result.save(checkpoint.directory)
        if own_figures is not None:
            from softness_bayes.runs.drawing import draw_run_figures  # imports the plotting libraries

            Stage.FIGURES.log()
            draw_run_figures(result, checkpoint.directory, workers, own_figures)
    checkpoint.finish()
    return result


def walked(
    model: ExperimentModel | SkinModel,
    run: RunOptions,
    progress: Report | None,
    checkpoint: Checkpoint | None,
    workers: Workers,
) -> RunState:
    """Sample until convergence or a limit, from the start or from a checkpoint; arguments as for `sample_model`."""
    data, density = model.data, model.posterior
    density.space.require_sampled()
    settings, begin = run.settings, None
    if isinstance(data, Experiment) and len(data.ratings) > MANY_RATINGS:
        settings = replace(settings, together=1)
    if checkpoint is not None:
        begin = checkpoint.begin(identity(data, density, settings, Request(model.options, run).choices()))
        if begin is not None:
            require_density(density, begin)
    for state in walk(density, settings, run.seed, begin, workers):
        if checkpoint is not None:
            checkpoint.keep(state, settings, density)
        if progress is not None:
            progress(progress_of(state, settings))
    return state


def labels_of(data: Experiment | Measurements) -> dict[str, Sequence[str]]:
    """Return the names of participants, fabrics, fingers and afferents in some data, by the axis of a result."""
    found: dict[str, Sequence[str]] = {} if data.compression is None else {"finger": data.compression.participants}
    if data.afferents is not None:
        found["afferent"] = data.afferents.names
    if isinstance(data, Measurements):
        return found
    return {"participant": data.ratings.participants, "fabric": data.ratings.fabrics, **found}


def requested(model: ExperimentModel | SkinModel, run: RunOptions) -> dict[str, Any]:
    """Return the part of the provenance known before the first step: the requested settings, and how data are read.

    Raises
    ------
    InputError
        If an option cannot be stored as JSON.
    """
    options, request = model.options, Request(model.options, run)
    options.require_storable()
    found = {
        **provenance.attributes_of(
            provenance.Asked(SCHEMA, storable(run.command), request.record(), run.seed, options.prior_set)
        ),
        **provenance.family_of(provenance.PRIOR, {one.name: one.prior for one in model.posterior.space.chain}),
        **provenance.family_of(provenance.READING, options.readings.names),
        **provenance.versions(),
    }
    if isinstance(model, SkinModel):
        return found
    chosen, ratings = model.direction, model.data.ratings
    return found | provenance.attributes_of(
        provenance.DirectionTaken(
            chosen.direction,
            chosen.asked,
            chosen.sentence,
            chosen.evidence.firing,
            direction_of_data="" if chosen.evidence.direction is None else chosen.evidence.direction.name,
        ),
        provenance.RatingSettings(
            options.noise,
            options.scale,
            options.kept_accuracy,
            str(options.discretisation),
            model.interpretation.law.name,
            model.interpretation.errors_note,
            model.interpretation.note,
        ),
        provenance.RatingData(
            ratings.digest,
            model.data.fabrics.digest,
            ratings.n_missing,
            ratings.rating_column,
            ratings.simulated,
        ),
    )


def outcome(state: RunState, run: RunOptions) -> dict[str, Any]:
    """Return the part of the provenance about the end of the run."""
    verdict = sampled_of(state).verdict
    said = verdict.sentence()
    return provenance.attributes_of(
        provenance.Ending(
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


def _integrals(model: ExperimentModel | SkinModel, sampled: Sampled, workers: Workers) -> Exactness | None:
    """Return the comparison of the integrals that the sampler used with their reference; None if they are the same."""
    posterior = model.posterior
    if not isinstance(posterior, Posterior) or posterior.for_sampling is posterior:
        return None
    kept = sampled.chains.kept(sampled.verdict.burn_in)
    theta = kept.by_walker(posterior.natural(kept.coordinates))
    return compare_exactly(posterior, theta, workers, reference=Posterior.log_likelihood)()
