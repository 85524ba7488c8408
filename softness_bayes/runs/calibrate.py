"""Simulation-based calibration of a scene: parallel replicates, with one file each."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes import __version__, ranges
from softness_bayes.checking.calibration import DRAWS, Replicate
from softness_bayes.errors import InputError
from softness_bayes.files.asked import write_asked
from softness_bayes.files.lock import Lock
from softness_bayes.files.whole import sweep
from softness_bayes.likelihood.directions import RISES
from softness_bayes.model.build import build
from softness_bayes.model.fingers import values_of
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.posterior import Posterior
from softness_bayes.results.fitted import experiment_of, options_of
from softness_bayes.results.request import Request
from softness_bayes.results.result import Result
from softness_bayes.results.run_options import RunOptions
from softness_bayes.runs.calibrated import Calibrated
from softness_bayes.runs.calibration_files import (
    LOCK,
    REPLICATES,
    earlier_of,
    finished_in,
    forget_missing,
    made_folder,
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


def calibrate(
    scene: CalibrationScene,
    options: ModelOptions,
    run: RunOptions,
    count: int,
    directory: Path,
    progress: Callable[[int, Replicate], None] | None = None,
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
        Executor that runs the replicates instead of local processes, one task per replicate, with the same ranks. If
        its workers do not share the directory (see `runs.cluster`), this process writes the replicates.
    earlier
        Directory of an earlier calibration of the same problem, whose replicates are taken over. The settings of its
        fits may differ (`runs.calibration_files.FITS`); the verdict then says so.

    Raises
    ------
    InputError
        If the directory contains anything but a calibration with the same settings, apart from the numbers of
        replicates and processes, or the earlier calibration is of another problem.
    LockedError
        If another process is calibrating there.
    """
    ranges.REPLICATES.require("calibration: number of replicates", count)
    ranges.PARTICIPANTS.require("calibration: number of participants", scene.participants)
    model = scene.model(options)
    model.posterior.space.require_sampled()
    settings = settings or replicate_settings(run, model.posterior)
    manifest = _manifest(scene, Request(model.options, run), settings)
    return _calibrated(
        ReplicateSource(model.posterior), manifest, run, count, directory, progress, settings, executor, earlier
    )


def calibrate_like(
    result: Result,
    run: RunOptions,
    count: int,
    directory: Path,
    progress: Callable[[int, Replicate], None] | None = None,
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
    ranges.REPLICATES.require("calibration: number of replicates", count)
    source, manifest, settings = _like(result, run, settings)
    return _calibrated(source, manifest, run, count, directory, progress, settings, executor, earlier)


def finished_like(
    result: Result, run: RunOptions, count: int, directory: Path, settings: Settings | None = None
) -> Calibrated:
    """Return the finished replicates of `calibrate_like` without running any; otherwise like `finished`."""
    _, manifest, _ = _like(result, run, settings)
    return _so_far(manifest, count, directory)


class ReplicateSource(NamedTuple):
    """Origin of replicates: the model and, if true values are drawn from its posterior, posterior draws."""

    posterior: Posterior
    truths: NDArray[np.float64] | None = None


def _like(
    result: Result, run: RunOptions, settings: Settings | None
) -> tuple[ReplicateSource, dict[str, Any], Settings]:
    """Return the source of replicates for a finished run, all settings that affect the ranks, and the sampler's."""
    if not result.provenance.ending.converged:
        raise InputError(f"{result.source}: the run has not converged, so its draws do not represent the posterior")
    posterior = build(experiment_of(result), options_of(result)).posterior
    settings = settings or replicate_settings(run, posterior)
    values = result.values(TRUTHS)
    truths = np.stack([np.asarray(values[name]) for name in posterior.names], axis=-1)
    manifest = {
        "version": __version__,
        "seed": run.seed,
        "draws": DRAWS,
        "like": hashlib.sha256(truths.tobytes()).hexdigest()[:32],
        "ratings": result.provenance.rating_data.digest_ratings,
        "options": Request.of(result).model.record(),
        "ensembles": settings.ensembles,
        "max_steps": settings.max_steps,
        "goal": str(settings.goal),
    }
    return ReplicateSource(posterior, truths), manifest, settings


def _calibrated(
    source: ReplicateSource,
    manifest: dict[str, Any],
    run: RunOptions,
    count: int,
    directory: Path,
    progress: Callable[[int, Replicate], None] | None,
    settings: Settings,
    executor: Executor | None,
    earlier: Path | None,
) -> Calibrated:
    """Run the replicates missing in a directory."""
    folder = made_folder(directory, manifest)
    with Lock(directory / LOCK) as lock:
        require_alike(directory, manifest)
        write_manifest(directory, manifest)
        sweep(folder)
        if earlier is not None:
            take(earlier, directory, manifest, partial(_true_values, source, run.seed))
        forget_missing(directory)
        write_asked(directory, count)
        done = {index: one for index, one in finished_in(folder, count).items() if one.valid}
        missing = [index for index in range(count) if index not in done]
        if missing:
            processes = min(run.processes or available_processors(), len(missing))
            with Workers(source, processes, executor) as workers:
                shared = str(folder.resolve()) if shares_files(executor) else None
                tasks = [(settings, run.seed, index, shared) for index in missing]
                for index, one in workers.as_finished(_run, tasks):
                    if shared is None:
                        write_replicate(folder, index, one)
                    done[index] = one
                    if progress is not None:
                        progress(len(done), one)
        lock.vanish()
    return Calibrated({index: done[index] for index in range(count)}, earlier=earlier_of(directory))


def _true_values(source: ReplicateSource, seed: int, index: int) -> dict[str, float]:
    return true_values(source.posterior, seed, index, source.truths)


def finished(
    scene: CalibrationScene,
    options: ModelOptions,
    run: RunOptions,
    count: int,
    directory: Path,
    settings: Settings | None = None,
) -> Calibrated:
    """Return the finished replicates of a calibration without running any; it may still be in progress.

    Arguments and errors as for `calibrate`; in addition

    Raises
    ------
    InputError
        If none is finished.
    """
    model = scene.model(options)
    settings = settings or replicate_settings(run, model.posterior)
    return _so_far(_manifest(scene, Request(model.options, run), settings), count, directory)


def _so_far(manifest: dict[str, Any], count: int, directory: Path) -> Calibrated:
    """Return the replicates that are finished."""
    require_alike(directory, manifest)
    done = finished_in(directory / REPLICATES, count)
    if not done:
        raise InputError(f"{directory}: no finished replicate of a calibration in this directory")
    missing = tuple(index for index in range(count) if index not in done)
    return Calibrated(done, missing, earlier_of(directory))


def replicate_settings(run: RunOptions, posterior: Posterior) -> Settings:
    """Return `REPLICATE` with many walkers for the dimension of a posterior, and the limit of the options."""
    dimension = len(posterior.names)
    walkers = max(min(WALKERS * dimension, MOST_WALKERS), REPLICATE.walkers_for(dimension))
    return replace(REPLICATE, walkers=walkers, max_steps=run.max_steps)


def _run(
    source: ReplicateSource, settings: Settings, seed: int, index: int, folder: str | None
) -> tuple[int, Replicate]:
    """Run one replicate and write its file, unless the folder is None because this process does not see it."""
    one = replicate(source.posterior, settings, seed, index, truths=source.truths)
    if folder is not None:
        write_replicate(Path(folder), index, one)
    return index, one


def _manifest(scene: CalibrationScene, request: Request, settings: Settings) -> dict[str, Any]:
    """Return all settings that affect the ranks, as JSON data."""
    fabrics, options = scene.fabrics, request.model
    named = {
        "version": __version__,
        "seed": request.run.seed,
        "draws": DRAWS,
        "participants": scene.participants,
        "fabrics": dict(zip(fabrics.names, fabrics.modulus(options.readings.fabric_modulus).tolist(), strict=True)),
        "poisson_ratio": np.asarray(fabrics.poisson_ratio).tolist(),
        "loads": [str(load) for load in scene.loads],
        "fix": dict(options.fix),
        "priors": {name: str(prior) for name, prior in options.priors.items()},
        "prior_set": options.prior_set,
        "readings": options.readings.names,
        **({"finger": values_of(options.finger)} if values_of(options.finger) else {}),
        "direction": (options.direction or RISES).name,
        "discretisation": str(options.discretisation),
        "ensembles": settings.ensembles,
        "max_steps": settings.max_steps,
        "goal": str(settings.goal),
    }
    # scale, errors, resolution, and all other settings that define the model
    return {**options.record(), **named}
