"""`softness-bayes sample`: ratings in, posterior and credible bands out."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import click
from click.core import ParameterSource

from softness_bayes.cli import STARTED
from softness_bayes.cli.interrupts import keeping
from softness_bayes.cli.options.model import ModelChoice, model_choice
from softness_bayes.cli.options.ratings import rating_scale
from softness_bayes.cli.options.run import force, max_time, no_figures, out, own_figures, processes, seed
from softness_bayes.cli.options.tables import DataFiles, data_files
from softness_bayes.cli.options.values import Number, whole
from softness_bayes.cli.running import command_line, in_numbers, record_of
from softness_bayes.defaults import MAX_STEPS, NOISE, shown_of
from softness_bayes.errors import InputError, NotConvergedError
from softness_bayes.ranges import NOISES, STEPS

if TYPE_CHECKING:
    from tqdm import tqdm

    from softness_bayes.checking.misfit import Fit
    from softness_bayes.checkpoints.checkpoint import Checkpoint
    from softness_bayes.data import Compression, Experiment
    from softness_bayes.model.build import ExperimentModel
    from softness_bayes.model.options import ModelOptions
    from softness_bayes.results.request import Request
    from softness_bayes.results.result import Result
    from softness_bayes.results.stages import Stage
    from softness_bayes.sampler.sampling import Progress


@click.command()
@data_files
@model_choice
@rating_scale
@click.option(
    "--noise",
    type=Number(NOISES),
    default=NOISE,
    show_default=True,
    metavar="STRENGTH",
    help="White current on every membrane [µA/cm² √ms], averaged over by simulation, which takes minutes; needs --fix "
    "of c_Na, c_K, c_L and c_A.",
)
@click.option(
    "--exact-reweight",
    is_flag=True,
    help="Weight draws by the exact likelihood (Pareto-smoothed); summary and predictions are those of weighted draws.",
)
@click.option(
    "--max-steps",
    type=whole(STEPS),
    default=MAX_STEPS,
    show_default=True,
    help="Steps of each ensemble after which the run ends, converged or not.",
)
@max_time
@processes
@no_figures
@own_figures
@seed
@out
@force
def command(
    files: DataFiles,
    model: ModelChoice,
    scale: str,
    noise: float,
    exact_reweight: bool,
    max_steps: int,
    max_time: float,
    processes: int | None,
    no_figures: bool,
    own_figures: tuple[str, ...],
    seed: int,
    out: Path,
    force: bool,
) -> None:
    """Sample the posterior of skin, transduction and rating parameters given ratings.

    Runs four independent ensembles until they have converged, or to --max-steps or --max-time, and writes to
    --out: posterior.nc (draws, predictions, provenance), summary.csv, directions.csv, predictive_checks.csv
    and figures/. Prints the summary, what the prior decides, where the response turns over under each load,
    whether the model reproduces it, and a verdict. Exit code 3: not converged.

    --compression adds the forces of a rigid flat plate on fingerpads, which say what b and m are. Without
    --data the run is on these alone: no response curves, no turning point, but how force grows with indentation.

    With all parameters fixed there is nothing to sample: the log-likelihood at that point is printed, and where the
    response turns over under each load; nothing is written.

    The run is kept in --out all along: 'status' says how far it is, and 'resume' continues it, interrupted or
    ended, to the draws of a run that was never interrupted.
    """
    from softness_bayes.sampler import workers

    if processes != 1:
        workers.prepare("softness_bayes.runs.run")  # they import what they need while this process does
    from softness_bayes.checkpoints.checkpoint import Checkpoint
    from softness_bayes.data import Compression
    from softness_bayes.likelihood.scales import scale_named
    from softness_bayes.results.request import Request, RunOptions

    data = files.read()
    if isinstance(data, Compression):
        model = _model_of_forces(model)
    options = model.options(scale=scale_named(scale), noise=noise)
    if _evaluated(data, options):
        return
    how = RunOptions(
        exact_reweight=exact_reweight,
        max_steps=max_steps,
        max_seconds=max_time,
        processes=processes,
        seed=seed,
        command=command_line(),
    )
    drawn = None if no_figures else own_figures
    require_drawn(drawn)
    run(Checkpoint.create(out, force, inputs=files.paths), files, data, Request(options, how), drawn)


def require_drawn(own: Sequence[str] | None) -> None:
    """Raise an error for figures of the user's own that cannot be drawn; None if no figure is wanted.

    Raises
    ------
    InputError
        If one cannot be imported, or is not a figure.
    """
    if own is None:
        return
    from softness_bayes.plotting.figures import OWN_FIGURES, require_figures
    from softness_bayes.supplied import installed

    if own or installed(OWN_FIGURES):
        require_figures([*own, *installed(OWN_FIGURES)])


def _model_of_forces(model: ModelChoice) -> ModelChoice:
    """Return the model of compression data alone: with wide priors unless others were asked for.

    Raises
    ------
    InputError
        If an option of ratings was given.
    """
    source = click.get_current_context().get_parameter_source
    of_ratings = ("scale", "direction", "accuracy", "noise", "exact_reweight", "errors", "resolution")
    if any(source(name) is not ParameterSource.DEFAULT for name in of_ratings):
        raise InputError(
            "--ratings, --direction, --accuracy, --noise, --exact-reweight, --errors and --resolution are for ratings: "
            "give --data, or leave them out"
        )
    if source("prior_set") is not ParameterSource.DEFAULT:
        return model
    click.echo("note: without ratings --priors is wide, which says little of the skin beforehand", err=True)
    return replace(model, prior_set="wide")


def _evaluated(data: Experiment | Compression, options: ModelOptions) -> bool:
    """Evaluate and print a model without sampled parameters; return False for any other model."""
    from softness_bayes.data import Compression
    from softness_bayes.model.build import build, build_skin, moduli_of, space_of
    from softness_bayes.runs.evaluation import evaluate

    said = [f"note: {note}" for note in data.notes]
    if isinstance(data, Compression):
        skin = build_skin(data, options).posterior
        found = None if skin.space.sampled else evaluate(skin)
    elif space_of(data, options).sampled or not moduli_of(data, options).known:
        found = None
    else:
        model = build(data, options)
        said.append(_direction_note(model))
        assert model.resolution is not None, "the command line asks for an accuracy"
        found = evaluate(model.posterior, float(model.resolution.errors.peak))
    if found is None:
        return False
    for line in (*said, *found.sentences()):
        click.echo(line)
    click.echo("nothing is written; 'softness-bayes predict' shows contact, stress and firing at these values")
    return True


def _direction_note(model: ExperimentModel) -> str:
    """Return the sentence on the direction of the ratings, marked as a note or a warning."""
    return f"{'warning' if model.direction.against_data else 'note'}: {model.direction.sentence}"


def run(
    checkpoint: Checkpoint,
    files: DataFiles,
    data: Experiment | Compression,
    request: Request,
    own_figures: Sequence[str] | None,
) -> None:
    """Build the model and sample it, from the start or from where the checkpoint is; write and print the results.

    Figures of the user's own are drawn beside the others; None for `own_figures` draws none at all.

    Raises
    ------
    NotConvergedError
        If a limit was reached first; everything is written all the same.
    """
    from softness_bayes.model.build import ExperimentModel
    from softness_bayes.model.reach import reach_of
    from softness_bayes.results.versions import versions
    from softness_bayes.runs.kept import model_of, sample_kept

    out, (options, how) = checkpoint.directory, request
    model = model_of(data, options)
    for note in data.notes:
        click.echo(f"note: {note}", err=True)
    if isinstance(model, ExperimentModel):
        if said := reach_of(model.experiment, model.options):
            click.echo(f"warning: {said}", err=True)
        click.echo(_direction_note(model), err=True)
        for said in (model.given.note, model.given.errors_note):
            click.echo(f"note: {said}", err=True)
    bar = _Bar()
    with keeping(lambda: _kept(checkpoint, bar.drawing)), checkpoint:
        decided = request._replace(model=model.options)
        asked = {"files": record_of(files, out), "options": decided.record(), "figures": own_figures is not None}
        asked |= {"own_figures": list(own_figures)} if own_figures else {}
        checkpoint.request = {**asked, "versions": versions()}
        bar.begin(0.0 if checkpoint.status is None else checkpoint.status.seconds)
        try:
            result = sample_kept(checkpoint, model, how, own_figures, bar.show, bar.stage)
        finally:
            bar.close()
    _report(result, out, bar.times())
    ending = result.provenance.ending
    if not ending.converged:
        raise NotConvergedError(
            f"not converged after {ending.steps} steps; what was drawn is in {out}, for inspection only; "
            f"'softness-bayes resume {out}' continues the run"
        )


def _kept(checkpoint: Checkpoint, drawing: bool = False) -> str:
    """Say how far a run is kept and how to continue it; `drawing` says that only figures are missing."""
    status = checkpoint.status
    if drawing:
        out = checkpoint.directory
        return f"the results are written to {out}: 'softness-bayes plot {out}' draws the figures, and {_again(out)}"
    if status is None:
        return "nothing was kept, because sampling had not begun: start the run again"
    until = "in its pilot walk" if status.piloting else f"up to step {status.steps}"
    return f"the run is kept {until}: {_again(checkpoint.directory)}"


def _again(directory: Path) -> str:
    return f"'softness-bayes resume {directory}' continues it"


class _Bar:
    """Progress on the terminal: steps against the estimate of what it takes to converge, then a line for each stage."""

    def __init__(self) -> None:
        self._bar: tqdm[NoReturn] | None = None
        self._stage: Stage | None = None
        self.begin(0.0)

    def begin(self, before: float) -> None:
        """Begin to measure; `before` is the time [s] that earlier sessions of the run have sampled."""
        self._before, self._begun, self._sampled = before, time.monotonic(), 0.0

    def stage(self, stage: Stage) -> None:
        """Write a line for a stage after the walk."""
        self.close()
        self._stage = stage
        click.echo(str(stage), err=True)

    @property
    def drawing(self) -> bool:
        """True if figures are being drawn, which is the last stage."""
        return self._stage is not None and self._stage.number == len(type(self._stage))

    def show(self, progress: Progress) -> None:
        """Move the bar; its end moves too when a look changes the estimate."""
        self._sampled = progress.seconds - self._before
        if self._bar is None:  # not before there is progress: an input error comes first and stands alone
            from tqdm import tqdm

            self._begun = time.monotonic() - self._sampled
            self._bar = tqdm(
                total=1, initial=progress.steps, unit="step", desc="sampling", leave=False, dynamic_ncols=True
            )
        self._bar.total = progress.steps + progress.missing
        self._bar.update(progress.steps - self._bar.n)
        if progress.verdict is not None:
            self._bar.set_postfix_str(in_numbers(progress.verdict, progress.seconds))

    def times(self) -> str:
        """Say how long the command took, and what for."""
        begun, whole = self._begun - STARTED, time.monotonic() - STARTED
        return (
            f"took {whole:.1f} s: {begun:.1f} s to start, {self._sampled:.1f} s to sample, "
            f"{whole - begun - self._sampled:.1f} s for all that follows"
        )

    def close(self) -> None:
        """Clear the line."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None


def _report(result: Result, out: Path, times: str = "") -> None:
    """Print summary, turning points, checks and verdict, the time taken, and the conclusion in three lines."""
    from softness_bayes.checking.misfit import fit_of
    from softness_bayes.report.conclusion import conclude, facts_of

    found, summary = result.provenance, result.summary()
    fit = fit_of(result.tree) if result.has_ratings else None
    faults = [] if fit is None else [f"the fit has failed: {fault}" for fault in fit.faults]
    for fault in faults:
        click.echo(fault)
    left_out = ("contraction", "psens_prior_mcse", "psens_likelihood_mcse")  # said in words, or kept in the file
    shown = summary.drop(columns=[*left_out])
    shown.insert(list(shown).index("prior_sd") + 1, "sd/prior_sd", summary["sd"] / summary["prior_sd"])
    click.echo(shown.to_string(float_format=lambda x: f"{x:.4g}", na_rep="–"))
    click.echo()
    for sentence in result.learnt():
        click.echo(sentence)
    if result.has_compression:
        click.echo(f"\n{found.plate.force_check}")
    if fit is not None:
        _report_ratings(result, fit)
    click.echo(f"written to {out}; 'softness-bayes report {out}' makes one page of it")
    click.echo(found.verdict)
    if fit is not None and fit.silence_note:
        click.echo(fit.silence_note)
    if times:
        click.echo(times)
    click.echo()
    for line in conclude(facts_of(result), str(out)).lines:
        click.echo(line)


def _turning(result: Result) -> str:
    """Return where the response turns over, with what counts as that, the prior's probability and sampling errors."""
    from softness_bayes.checking.turning_points import with_errors

    columns = ["p_interior", "prior_p_interior", "p_inside", "p_none", "p_silent"]
    columns += ["e_fab_kpa_low", "e_fab_kpa", "e_fab_kpa_high"]
    table = result.inflection()
    shown = shown_of(len(table))
    left_out = f"\n({len(shown)} of {len(table)} loads)" if len(shown) < len(table) else ""
    low, *_, high = (f"{float(f'{end:.3g}'):,.10g}" for end in result.group("predictions")["e_fab_kpa"].values)
    return (
        "turning point of the response: a maximum (the paper's inflection) that exceeds the response at both ends of\n"
        f"the range, {low} and {high} kPa, by {result.least_drop:.0%} of itself. Columns: its probability "
        "(p_interior), the same under the\nprior, the probabilities of one among the fabrics' moduli (p_inside), of "
        "none and of no firing; then E_fab at the\nturning point [kPa], median and 90 % limits. Each number ± its "
        "Monte-Carlo standard error.\n"
        f"{with_errors(table.iloc[shown], columns).to_string()}{left_out}"
    )


def _report_ratings(result: Result, fit: Fit) -> None:
    """Print turning points and checks of what the ratings say."""
    from softness_bayes.checking.check_table import check_sentences
    from softness_bayes.provenance import NOT_ASKED

    found = result.provenance
    errors, residuals, silence, model = found.errors, found.residuals, found.silence, found.rating_model
    click.echo(f"\n{_turning(result)}\n")
    for sentence in (
        fit.sentence,
        *([found.direction.said] if found.direction.said else []),
        *check_sentences(result.tables["predictive_checks"]),
        *([] if fit.choice.against_data else residuals.sentences),
        *([] if fit.choice.against_data else result.said_of_moduli()),
        *([result.said_of_loads()] if result.load_cv.any() else []),
        *(said for said in (found.rating_model.rating_note, found.rating_model.rating_errors_note) if said),
    ):
        click.echo(sentence)
    click.echo(
        f"no receptor fires in any condition: {silence.prior_silent_everywhere:.1%} of prior draws, "
        f"{silence.posterior_silent_everywhere:.1%} of posterior draws; in an average condition: "
        f"{silence.prior_silent_conditions:.0%} and {silence.posterior_silent_conditions:.0%}"
    )
    if silence.contact_beyond_half_radius:
        click.echo(
            f"contact radius above R/2, where Hertz's geometry is questionable: "
            f"{silence.contact_beyond_half_radius:.0%} of draws and conditions; above R, where it is "
            f"meaningless: {silence.contact_beyond_radius:.0%}"
        )
    if found.held_eps:
        click.echo(found.held_eps)
    click.echo(
        f"numerical error of the response: at most {errors.numerical_error:.1e} of its peak over the draws; "
        f"accuracy: {NOT_ASKED if model.accuracy is None else model.accuracy}"
    )
    click.echo(
        f"error of the firing rates: at most {errors.firing_error:.1e} of the peak, if every receptor had the "
        "largest error of its surface; their effect on the posterior:"
    )
    click.echo(errors.exactness)
