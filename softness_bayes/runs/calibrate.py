"""Simulation-based calibration: parallel replicates of a problem, with one file each."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes import __version__, ranges
from softness_bayes.checking.calibration import DRAWS, Replicate
from softness_bayes.errors import InputError
from softness_bayes.files.whole import sweep
from softness_bayes.likelihood.directions import RISES
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.posterior import Posterior
from softness_bayes.results.fitted import experiment_of, options_of
from softness_bayes.results.request import Request
from softness_bayes.results.result import Result
from softness_bayes.results.run_options import RunOptions
from softness_bayes.runs.batch import batch
from softness_bayes.runs.calibrated import (
    REPLICATES,
    Calibrated,
    finished_in,
    prepare,
    require_alike,
    take,
    write_manifest,
    write_replicate,
)
from softness_bayes.runs.calibration_scene import CalibrationScene
from softness_bayes.runs.replicate import replicate, true_values
from softness_bayes.sampler.diagnostics import Goal
from softness_bayes.sampler.sampling import Settings
from softness_bayes.sampler.workers import Workers, available_processors, shares_files

TRUTHS = 4000
"""Largest number of posterior draws of a run from which the true values of its replicates are chosen."""

ENSEMBLES = 2
"""Number of independent ensembles per replicate: the smallest number that can disagree."""

RANKED = Goal(lengths=10.0, tau_change=math.inf, r_hat=1.02, ess=4.0 * DRAWS, looks=1)
"""Convergence goal of a replicate: ranks among `DRAWS` draws require that many independent draws after burn-in, but not
the precision of quantiles required in a run."""

REPLICATE = Settings(ensembles=ENSEMBLES, processes=1, optima=1, pilot=(60, 100), round_steps=50, slow=5.0, goal=RANKED)
"""Settings of the sampler for a replicate: a short pilot and an early first check, with many walkers.

A step of many walkers takes little longer than one of few, and the more draws of the pilot, the better the map.
"""

WALKERS = 8
"""Walkers of each ensemble for each dimension, up to `MOST_WALKERS` in all unless the sampler's default is larger."""

MOST_WALKERS = 120

Report = Callable[[int, Replicate], None]
"""Function called with the number of finished replicates and the last of them."""


class Problem(NamedTuple):
    """Work of one replicate of a calibration: parameters drawn, ratings simulated and fitted."""

    posterior: Posterior
    """The model."""
    settings: Settings
    """Settings of the sampler."""
    manifest: dict[str, Any]
    """All settings that affect the ranks, as JSON data."""
    truths: NDArray[np.float64] | None = None
    """Posterior draws from which true values are taken, shape (draws, dimension); None for draws of the prior."""


def calibrate(
    scene: CalibrationScene,
    options: ModelOptions,
    run: RunOptions,
    count: int,
    directory: Path,
    progress: Report | None = None,
    settings: Settings | None = None,
    executor: Executor | None = None,
    earlier: Path | None = None,
) -> Calibrated:
    """Calibrate the model of a scene; replicates that are already in a directory are not repeated.

    A replicate is fast if its posterior is smooth. If a prior draw has very little noise (varsigma of a few hundredths
    or thousandths), the posterior is a thin curved sheet, which takes many times the typical number of steps. A
    replicate that has not converged within the largest number of steps is ranked by chains through the truth, whose
    ranks are uniform all the same but detect less (`sampler.exchangeable`).

    Parameters
    ----------
    scene
        Design of the ratings.
    options
        Choices of the model.
    run
        Seed, processes, and the largest number of steps.
    count
        Number of replicates.
    directory
        Directory in which each replicate writes a file as soon as it is finished.
    progress
        Function called with the number of finished replicates and the last of them.
    settings
        Settings of the sampler; by default `REPLICATE`, with many walkers, up to `run.max_steps`.
    executor
        Executor that runs the replicates instead of local processes, one task per replicate, with the same ranks.
    earlier
        Directory of an earlier calibration of the same problem, whose replicates are taken over. The settings of its
        fits may differ (`runs.calibrated.FITS`); the verdict then says so.

    Raises
    ------
    InputError
        If the directory contains anything but a calibration with the same settings, apart from the numbers of
        replicates and processes, or the earlier calibration is of another problem.
    LockedError
        If another process is calibrating there.
    """
    return replicated(prior_problem(scene, options, run, settings), run, count, directory, progress, executor, earlier)


def calibrate_like(
    result: Result,
    run: RunOptions,
    count: int,
    directory: Path,
    progress: Report | None = None,
    settings: Settings | None = None,
    executor: Executor | None = None,
    earlier: Path | None = None,
) -> Calibrated:
    """Calibrate the inference in the region of the posterior of a finished run (posterior SBC).

    Each replicate draws parameters from the run's posterior, and simulates ratings of new raters in its design: with
    its missing cells, loads and observation model. The model is fitted to the run's ratings and the simulated ones
    together.

    Parameters
    ----------
    result
        A run on ratings that has converged.
    run, count, directory, progress, settings, executor, earlier
        As for `calibrate`.

    Raises
    ------
    InputError
        If the run has not converged, or as for `calibrate`.
    LockedError
        If another process is calibrating there.
    """
    return replicated(posterior_problem(result, run, settings), run, count, directory, progress, executor, earlier)


def prior_problem(
    scene: CalibrationScene, options: ModelOptions, run: RunOptions, settings: Settings | None = None
) -> Problem:
    """Return the problem whose true values are draws of the prior; arguments as for `calibrate`."""
    ranges.PARTICIPANTS.require("calibration: number of participants", scene.participants)
    model, fabrics = scene.model(options), scene.fabrics
    model.posterior.space.require_sampled()
    options = replace(model.options, direction=model.options.direction or RISES)
    design = {
        "participants": scene.participants,
        "fabrics": dict(zip(fabrics.names, fabrics.modulus(options.readings.fabric_modulus).tolist(), strict=True)),
        "poisson_ratio": np.asarray(fabrics.poisson_ratio).tolist(),
        "loads": [str(load) for load in scene.loads],
    }
    return _problem(model.posterior, run, settings, {**options.record(), **design})


def posterior_problem(result: Result, run: RunOptions, settings: Settings | None = None) -> Problem:
    """Return the problem whose true values are draws of the posterior of a run; arguments as for `calibrate_like`."""
    if not result.provenance.ending.converged:
        raise InputError(f"{result.source}: the run has not converged, so its draws do not represent the posterior")
    posterior = build(experiment_of(result), options_of(result)).posterior
    values = result.values(TRUTHS)
    truths = np.stack([np.asarray(values[name]) for name in posterior.names], axis=-1)
    design = {
        "like": hashlib.sha256(truths.tobytes()).hexdigest()[:32],
        "ratings": result.provenance.rating_data.digest_ratings,
        "options": Request.of(result).model.record(),
    }
    return _problem(posterior, run, settings, design)._replace(truths=truths)


def _problem(posterior: Posterior, run: RunOptions, settings: Settings | None, design: dict[str, Any]) -> Problem:
    settings = settings or replicate_settings(run, posterior)
    fits = {name: getattr(settings, name) for name in ("ensembles", "max_steps")} | {"goal": str(settings.goal)}
    return Problem(posterior, settings, {"version": __version__, "seed": run.seed, "draws": DRAWS, **design, **fits})


def replicate_settings(run: RunOptions, posterior: Posterior) -> Settings:
    """Return `REPLICATE` with many walkers for the dimension of a posterior, and the limit of the options."""
    dimension = len(posterior.names)
    walkers = max(min(WALKERS * dimension, MOST_WALKERS), REPLICATE.walkers_for(dimension))
    return replace(REPLICATE, walkers=walkers, max_steps=run.max_steps)


def replicated(
    problem: Problem,
    run: RunOptions,
    count: int,
    directory: Path,
    progress: Report | None = None,
    executor: Executor | None = None,
    earlier: Path | None = None,
) -> Calibrated:
    """Run the replicates of a problem that are missing in a directory; arguments and errors as for `calibrate`."""
    ranges.REPLICATES.require("calibration: number of replicates", count)
    prepare(directory, problem.manifest)
    with batch(directory, count):
        write_manifest(directory, problem.manifest)
        sweep(directory / REPLICATES)
        if earlier is not None:
            draw = problem.posterior, run.seed
            take(earlier, directory, problem.manifest, lambda index: true_values(*draw, index, problem.truths))
        done = finished_in(directory, count)
        missing = [index for index in range(count) if index not in done]
        if missing:
            processes = min(run.processes or available_processors(), len(missing))
            shared = str(directory.resolve()) if shares_files(executor) else None
            with Workers(problem, processes, executor) as workers:
                for index, one in workers.as_finished(_run, [(run.seed, index, shared) for index in missing]):
                    if shared is None:
                        write_replicate(directory, index, one)
                    done[index] = one
                    if progress is not None:
                        progress(len(done), one)
    return Calibrated({index: done[index] for index in range(count)})


def _run(problem: Problem, seed: int, index: int, directory: str | None) -> tuple[int, Replicate]:
    """Run one replicate and write its file, unless the directory is None because this process does not see it."""
    one = replicate(problem.posterior, problem.settings, seed, index, truths=problem.truths)
    if directory is not None:
        write_replicate(Path(directory), index, one)
    return index, one


def finished(problem: Problem, count: int, directory: Path) -> Calibrated:
    """Return the finished replicates of a calibration without running any; it may still be in progress.

    Raises
    ------
    InputError
        If none is finished, or the directory contains anything but a calibration with the same settings.
    """
    require_alike(directory, problem.manifest)
    done = finished_in(directory, count)
    if not done:
        raise InputError(f"{directory}: no finished replicate of a calibration in this directory")
    return Calibrated(done, tuple(index for index in range(count) if index not in done))
