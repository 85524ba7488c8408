"""Simulation-based calibration: scenes, problems, and parallel replicates of these."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes import __version__
from softness_bayes.base import ranges
from softness_bayes.base.errors import InputError
from softness_bayes.base.files.outputs import require_outputs
from softness_bayes.base.files.records import as_json
from softness_bayes.base.files.whole import write_whole
from softness_bayes.checking.calibration import DRAWS, Replicate
from softness_bayes.data import Experiment, Fabrics, Ratings
from softness_bayes.likelihood.models import rating_model
from softness_bayes.likelihood.scales import MAGNITUDE, RISES, SLIDER
from softness_bayes.model.build import COARSE, ExperimentModel, build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.posterior import Posterior
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.results.fitted import Fitted
from softness_bayes.results.result import Result
from softness_bayes.results.run_options import Request, RunOptions
from softness_bayes.runs import rank_table
from softness_bayes.runs.batch import batch, write_asked
from softness_bayes.runs.replicate import replicate, true_values
from softness_bayes.sampler.diagnostics import Goal
from softness_bayes.sampler.sampling import Settings
from softness_bayes.sampler.workers import Workers, available_processors
from softness_bayes.touch.contact import Indentation, Load

USUAL_FABRICS = Fabrics(tuple("abcdefgh"), effective_modulus=np.geomspace(3e3, 6e5, 8))
"""Fabrics from one without firing under a light touch to one beyond the turning point under a firm touch."""

USUAL_LOADS: tuple[Load, ...] = (Indentation(1.5e-3), Indentation(2.5e-3))

TRUTHS = 4000
"""Largest number of posterior draws of a run from which the true values of its replicates are chosen."""

ENSEMBLES = 2
"""Number of independent ensembles per replicate: the smallest number that can disagree."""

RANKED = Goal(r_hat=1.02, ess=4.0 * DRAWS)
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


@dataclass(frozen=True)
class CalibrationScene:
    """The design of every replicate: all participants rate every fabric under every load, once.

    Parameters
    ----------
    fabrics, loads
        Rated fabrics and loads; by default a small scene, so that a replicate takes seconds.
    participants
        Their number.
    """

    fabrics: Fabrics = field(default_factory=lambda: USUAL_FABRICS)
    loads: tuple[Load, ...] = USUAL_LOADS
    participants: int = 20

    def model(self, options: ModelOptions) -> ExperimentModel:
        """Return the model of the scene, built once for all replicates, with placeholder ratings."""
        return build(*self.planned(options))

    def planned(self, options: ModelOptions) -> tuple[Experiment, ModelOptions]:
        """Return the design with placeholder ratings on its scale, and the options with all open choices filled in."""
        options = replace(options, direction=options.direction or RISES)  # there are no data from which to infer it
        if options.scale != MAGNITUDE and options.scale.model is None:
            law = options.errors or rating_model(options.scale).error
            exact = 0.0 if options.scale == SLIDER and options.resolution is None else options.resolution
            options = replace(options, errors=law, resolution=exact)
        return Experiment(self._ratings(options), self.fabrics, ()), options

    def _ratings(self, options: ModelOptions) -> Ratings:
        """Return placeholder ratings: all 1, or simulated ones if these would not be on the scale."""
        if options.scale != MAGNITUDE:
            made = simulate_ratings(
                np.random.default_rng(0),
                self.fabrics,
                self.loads,
                usual_values(options.readings),
                options.readings,
                self.participants,
                scale=options.scale,
                discretisation=COARSE,
                finger=options.finger,
                categories=options.n_categories,
            ).ratings
            # standard deviations between raters are not simulated for each replicate
            return made if made.cells is None else replace(made, cells=made.cells._replace(geometric_sd=None))
        names = [f"P{k}" for k in range(1, self.participants + 1)]
        table = np.ones((self.participants, len(self.fabrics), len(self.loads)))
        return Ratings.crossed(names, self.fabrics.names, self.loads, table)


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
    of: CalibrationScene | Result | Problem,
    options: ModelOptions | None,
    run: RunOptions,
    count: int,
    directory: Path,
    progress: Report | None = None,
    settings: Settings | None = None,
    executor: Executor | None = None,
    earlier: Path | None = None,
) -> rank_table.Calibrated:
    """Calibrate the model of a scene, or of a run; replicates that are already in a directory are not repeated.

    A replicate is fast if its posterior is smooth. If a prior draw has very little noise (varsigma of a few hundredths
    or thousandths), the posterior is a thin curved sheet, which takes many times the typical number of steps. A
    replicate that has not converged within the largest number of steps is ranked by chains through the truth, whose
    ranks are uniform all the same but detect less (`sampler.exchangeable`).

    Parameters
    ----------
    of
        Design of the ratings, with parameters drawn from the prior. Or a run on ratings that has converged, to
        calibrate the inference in the region of its posterior (posterior SBC): each replicate draws parameters from the
        run's posterior, and simulates ratings of new raters in its design: with its missing cells, loads and
        observation model. The model is fitted to the run's ratings and the simulated ones together. Or a problem made
        of either, whose model and settings it has.
    options
        Choices of the model; None for those of a run, or the usual ones.
    run
        Seed, processes, and the largest number of steps.
    count
        Number of replicates.
    directory
        Directory in which each replicate is recorded as soon as it is finished.
    progress
        Function called with the number of finished replicates and the last of them.
    settings
        Settings of the sampler; by default `REPLICATE`, with many walkers, up to `run.max_steps`.
    executor
        Executor that runs the replicates instead of local processes, one task per replicate, with the same ranks.
    earlier
        Directory of an earlier calibration of the same problem, whose replicates are taken over. The settings of its
        fits may differ (`runs.rank_table.FITS`); the verdict then says so.

    Raises
    ------
    InputError
        If the directory contains anything but a calibration with the same settings, apart from the numbers of
        replicates and processes, the earlier calibration is of another problem, or the run has not converged.
    LockedError
        If another process is calibrating there.
    """
    if isinstance(of, Problem):
        problem = of
    elif isinstance(of, Result):
        problem = posterior_problem(of, run, settings)
    else:
        problem = prior_problem(of, options or ModelOptions(), run, settings)
    ranges.REPLICATES.require("calibration: number of replicates", count)
    rank_table.require_alike(directory, problem.manifest)
    require_outputs(
        directory,
        (rank_table.RANKS, rank_table.COVERAGE, rank_table.VERDICT, f"{rank_table.FIGURE}.png"),
        rank_table.CALIBRATE,
    )
    directory.mkdir(parents=True, exist_ok=True)
    with batch(directory):
        if not (directory / rank_table.MANIFEST).exists():
            manifest = as_json(problem.manifest, rank_table.MANIFEST, indent=1) + "\n"
            write_whole(directory / rank_table.MANIFEST, manifest.encode())
        done = rank_table.read_replicates(directory)
        if earlier is not None:

            def redraw(index: int) -> dict[str, float]:
                return true_values(problem.posterior, run.seed, index, problem.truths)

            done |= rank_table.earlier_replicates(earlier, problem.manifest, redraw, done)
            rank_table.write_replicates(directory, done)
        missing = [index for index in range(count) if index not in done]
        before = count - len(missing)
        write_asked(directory, count, before)
        processes = min(run.processes or available_processors(), max(len(missing), 1))
        with Workers(problem, processes, executor) as workers:
            tasks = [(run.seed, index) for index in missing]
            for finished, (index, one) in enumerate(workers.as_finished(_run, tasks), before + 1):
                done[index] = one
                rank_table.write_replicates(directory, done)
                if progress is not None:
                    progress(finished, one)
    return rank_table.Calibrated({index: done[index] for index in range(count)})


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
    """Return the problem whose true values are draws of the posterior of a run; arguments as for `calibrate`."""
    if not result.provenance.ending.converged:
        raise InputError(f"{result.source}: the run has not converged, so its draws do not represent the posterior")
    fitted = Fitted(result, TRUTHS)
    design = {
        "like": hashlib.sha256(fitted.theta.tobytes()).hexdigest()[:32],
        "ratings": result.provenance.rating_data.digest_ratings,
        "options": Request.of(result).model.record(),
    }
    return _problem(fitted.posterior, run, settings, design)._replace(truths=fitted.theta)


def _problem(posterior: Posterior, run: RunOptions, settings: Settings | None, design: dict[str, Any]) -> Problem:
    settings = settings or replicate_settings(run, posterior)
    fits = {name: getattr(settings, name) for name in ("ensembles", "max_steps")} | {"goal": str(settings.goal)}
    return Problem(posterior, settings, {"version": __version__, "seed": run.seed, "draws": DRAWS, **design, **fits})


def replicate_settings(run: RunOptions, posterior: Posterior) -> Settings:
    """Return `REPLICATE` with many walkers for the dimension of a posterior, and the limit of the options."""
    dimension = len(posterior.names)
    walkers = max(min(WALKERS * dimension, MOST_WALKERS), REPLICATE.walkers_for(dimension))
    return replace(REPLICATE, walkers=walkers, max_steps=run.max_steps)


def _run(problem: Problem, seed: int, index: int) -> tuple[int, Replicate]:
    return index, replicate(problem.posterior, problem.settings, seed, index, truths=problem.truths)


def finished(problem: Problem, count: int, directory: Path) -> rank_table.Calibrated:
    """Return the finished replicates of a calibration without running any; it may still be in progress.

    Raises
    ------
    InputError
        If none is finished, or the directory contains anything but a calibration with the same settings.
    """
    rank_table.require_alike(directory, problem.manifest)
    done = {index: one for index, one in rank_table.read_replicates(directory).items() if index < count}
    if not done:
        raise InputError(f"{directory}: no finished replicate of a calibration in this directory")
    return rank_table.Calibrated(done, tuple(index for index in range(count) if index not in done))
