"""`softness-bayes calibrate`: frequency with which posteriors of simulated ratings hold the truth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from softness_bayes.cli.check_text import design_lines
from softness_bayes.cli.interrupts import keeping
from softness_bayes.cli.options import (
    TOUCHES,
    Touches,
    collected,
    dask,
    model_options,
    number,
    out,
    path,
    touches,
    trust_code,
    typed,
)
from softness_bayes.cli.progress import counting
from softness_bayes.cli.running import executor_of, reading, warn_of_unconverged
from softness_bayes.errors import InputError, NotConvergedError, NumericalError
from softness_bayes.model.options import ModelOptions
from softness_bayes.ranges import PARTICIPANTS, REPLICATES
from softness_bayes.readable import some_of
from softness_bayes.results.run_options import RunOptions

if TYPE_CHECKING:
    from softness_bayes.checking.calibration import Replicate
    from softness_bayes.runs.rank_table import Calibrated


@click.command()
@number(
    "--replicates",
    REPLICATES,
    "Number of parameter draws that are simulated and fitted; a later call can ask for more.",
    200,
)
@path(
    "--like",
    "DIR",
    "Calibrate over the posterior of this run instead of the prior, with the design and the model of the run.",
)
@touches("eight fabrics", "those of a small example")
@click.option(
    "--design",
    is_flag=True,
    help="Predict the posterior widths for this design without simulating; nothing is written.",
)
@number("--participants", PARTICIPANTS, "Number of raters.", 20)
@model_options
@collected(
    "run",
    RunOptions,
    *("max_steps", "processes", "seed"),
    max_steps={
        "default": 10_000,
        "help": "Largest number of steps of each ensemble; a replicate that has not converged by then is ranked in "
        "another way (see above).",
    },
    processes={
        "help": "Number of replicates run in parallel; by default one for each core. Ranks do not depend on it."
    },
)
@dask
@path(
    "--from",
    "DIR",
    "Also take the replicates of an earlier calibration of the same problem from this directory, or from the "
    "ranks.csv and manifest.json kept of it; it is only read.",
    "earlier",
)
@click.option(
    "--finished",
    "so_far",
    is_flag=True,
    help="Evaluate the finished replicates and run no more; the verdict stays open and names those that are missing.",
)
@out("calibration", "Directory to write to; a calibration there that was begun with the same options is continued.")
@trust_code
def command(
    replicates: int,
    like: Path | None,
    touches: Touches,
    design: bool,
    participants: int,
    model: ModelOptions,
    run: RunOptions,
    dask: str | None,
    earlier: Path | None,
    so_far: bool,
    out: Path,
) -> None:
    """Test the inference by simulation: whether credible intervals have their stated coverage.

    This is simulation-based calibration. Each replicate draws parameters from the prior, simulates ratings, samples
    the posterior until it has converged, and ranks the true values among its draws. The ranks must be uniform. They
    are tested for every parameter, mu, the log-likelihood, the participants' effects, and, under each load, the
    existence and the place of the turning point. The verdict states which faults this number of replicates can
    detect. Without fabrics and loads a small example is rated. Writes to --out: ranks.csv with a row for every finished
    replicate (an interrupted calibration continues), coverage.csv, ecdf.png and verdict.txt.

    --like DIR draws the parameters from the posterior of a finished run instead. It simulates ratings by new raters
    under the loads of the run, with its missing cells and observation model, and fits them together with the ratings
    of the run.

    --from DIR goes on from a stored result: --replicates 1000 then runs the rest. Design, model, priors and seed must
    be the same, and true values that are drawn again must agree. Where only settings of the fits differ, such as the
    largest number of steps, the verdict says so.

    --design predicts in some seconds, by linearisation, how much a fit would narrow every parameter and which other
    design would help most. Use it before a calibration, which takes hours.

    A replicate that has not converged within --max-steps is ranked by chains through the true values. Its ranks are
    valid, but detect less than others.

    Exit code 3: some replicates are missing; 4: not calibrated.
    """
    from softness_bayes.model.understanding import foreseen
    from softness_bayes.runs.calibrate import (
        USUAL_FABRICS,
        USUAL_LOADS,
        CalibrationScene,
        finished,
        posterior_problem,
        prior_problem,
        replicated,
    )

    if so_far and earlier is not None:
        raise InputError("--from: cannot be combined with --finished, which writes no replicates")
    if like is not None:
        if flags := typed(*TOUCHES, *(name for name in ModelOptions.declared), "design", "participants"):
            raise InputError(f"{flags[0]}: cannot be combined with --like, which takes design and model from the run")
        with reading(like) as (result,):
            warn_of_unconverged(result)
            problem = posterior_problem(result, run)
    else:
        scene = CalibrationScene(*touches.among(USUAL_FABRICS, USUAL_LOADS), participants)
        if design:
            click.echo("\n".join(design_lines(foreseen(*scene.planned(model)))))
            return
        problem = prior_problem(scene, model, run)
    with (
        counting(replicates, "replicate", "calibrating") as show,
        keeping(lambda: _kept(out, replicates)),
        executor_of(None if so_far else dask) as executor,
    ):

        def tell(done: int, one: Replicate) -> None:
            show(done, f"last one {one.steps} steps, autocorrelation time {one.tau:.0f}")

        if so_far:
            calibrated = finished(problem, replicates, out)
        else:
            calibrated = replicated(problem, run, replicates, out, tell, executor, earlier)
    _report(calibrated, out)
    if calibrated.calibration.faults():
        raise NumericalError("not calibrated: see the verdict above")
    if calibrated.unfinished:
        raise NotConvergedError(f"{some_of(len(calibrated.unfinished), replicates, 'replicate')} not finished")


def _report(calibrated: Calibrated, out: Path) -> None:
    """Write tables, figure and verdict, and print coverage and verdict."""
    from softness_bayes.checking.calibration import coverage_sentence
    from softness_bayes.files.outputs import write_outputs
    from softness_bayes.plotting.checks import rank_ecdf_figure
    from softness_bayes.plotting.style import files_of
    from softness_bayes.runs.rank_table import CALIBRATE, FIGURE

    calibrated.save(out)
    calibration = calibrated.calibration
    figure = rank_ecdf_figure(calibration.rank, calibration.draws, calibration.names)
    write_outputs(out, files_of(figure, FIGURE, ("png",)), CALIBRATE)
    table = calibrated.coverage()
    click.echo(table[["expected", "share", "low", "high"]].to_string(float_format=lambda x: f"{x:.3g}"))
    click.echo(f"{coverage_sentence(calibration)}\n\nwritten to {out}")
    click.echo(calibrated.sentence())


def _kept(out: Path, count: int) -> str:
    """Return the number of saved replicates and the command that continues them; empty without replicates."""
    from softness_bayes.runs.rank_table import read_replicates

    finished = len(read_replicates(out))
    if not finished:
        return ""
    return f"{some_of(finished, count, 'replicate')} saved in {out}: the same command runs the others"
