"""`softness-bayes sample`: ratings in, posterior and credible bands out."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import click

from softness_bayes.cli.options import (
    DataFiles,
    ReadingChoice,
    data_files,
    fix,
    force,
    out,
    prior,
    prior_set,
    readings,
    seed,
)
from softness_bayes.errors import NotConvergedError

if TYPE_CHECKING:
    from tqdm import tqdm

    from softness_bayes.inference.priors import Prior
    from softness_bayes.inference.sampling import Progress
    from softness_bayes.result import Result


@click.command()
@data_files
@fix
@prior
@prior_set
@readings
@click.option(
    "--direction",
    type=click.Choice(["softness", "inverse"]),
    default="softness",
    show_default=True,
    help="Whether ratings rise (softness) or fall (inverse) with the response.",
)
@click.option(
    "--max-steps",
    type=click.IntRange(min=1),
    default=100_000,
    show_default=True,
    help="Steps of each ensemble after which the run ends, converged or not.",
)
@click.option(
    "--processes",
    type=click.IntRange(min=1),
    metavar="N",
    help="Processes that share the ensembles; by default one for each core. Draws do not depend on it.",
)
@click.option("--no-figures", is_flag=True, help="Leave out the figures.")
@seed
@out
@force
def command(
    files: DataFiles,
    fixed: dict[str, float],
    priors: dict[str, Prior],
    prior_set: str,
    choice: ReadingChoice,
    direction: str,
    max_steps: int,
    processes: int | None,
    no_figures: bool,
    seed: int,
    out: Path,
    force: bool,
) -> None:
    """Sample the posterior of skin, transduction and rating parameters given ratings.

    Runs four independent ensembles until they have converged, or to --max-steps, and writes to --out:
    posterior.nc (draws, predictions, provenance), summary.csv, directions.csv, predictive_checks.csv and
    figures/. Prints the summary, what the prior decides, where the response turns over under each load,
    whether the model reproduces it, and a verdict. Exit code 3: not converged.
    """
    from softness_bayes.inference.observation import RATING_DIRECTIONS
    from softness_bayes.result import prepare_directory, require_vacant
    from softness_bayes.run import RunOptions, sample

    experiment = files.read()
    chosen = choice.resolve()
    require_vacant(out, force)
    for note in experiment.notes:
        click.echo(f"note: {note}", err=True)
    options = RunOptions(
        fix=fixed,
        priors=priors,
        prior_set=prior_set,
        readings=chosen,
        direction=RATING_DIRECTIONS[direction],
        max_steps=max_steps,
        processes=processes,
        seed=seed,
        command=shlex.join(["softness-bayes", *sys.argv[1:]]),
    )
    bar = _Bar()
    try:
        result = sample(experiment, options, bar.show)
    finally:
        bar.close()
    # only now: a run that fails leaves no directory behind, and --force no gap
    prepare_directory(out, force)
    result.save(out)
    if not no_figures:
        from softness_bayes.plotting.figures import draw_figures

        draw_figures(result, out / "figures")
    _report(result, out)
    if not result.attributes["converged"]:
        raise NotConvergedError(
            f"not converged at --max-steps {max_steps}; what was drawn is in {out}, for inspection only"
        )


class _Bar:
    """Progress towards convergence on the terminal: steps against the present estimate of what it takes."""

    def __init__(self) -> None:
        self._bar: tqdm[NoReturn] | None = None

    def show(self, progress: Progress) -> None:
        """Move the bar; its end moves too when a look changes the estimate."""
        if self._bar is None:  # not before there is progress: an input error comes first and stands alone
            from tqdm import tqdm

            self._bar = tqdm(total=1, unit="step", desc="sampling", leave=False, dynamic_ncols=True)
        self._bar.total = progress.steps + progress.missing
        self._bar.update(progress.steps - self._bar.n)
        verdict = progress.verdict
        if verdict is not None:
            self._bar.set_postfix_str(
                f"tau {verdict.tau.max():.0f}, {verdict.lengths:.0f} of {verdict.goal.lengths:.0f} tau, "
                f"R-hat {verdict.r_hat.max():.3f}"
            )

    def close(self) -> None:
        """Clear the line."""
        if self._bar is not None:
            self._bar.close()


def _report(result: Result, out: Path) -> None:
    """Print summary, inflection, checks and verdict."""
    from softness_bayes.criticism import check_sentences
    from softness_bayes.learning import learning_sentences

    found, summary = result.attributes, result.summary()
    click.echo(summary.to_string(float_format=lambda x: f"{x:.4g}", na_rep="–"))
    click.echo()
    for sentence in (*learning_sentences(summary), *result.tables["directions"]["meaning"]):
        click.echo(sentence)
    click.echo("\nwhere the response turns over (probabilities; E_fab in kPa, medians and 90 % limits)")
    columns = ["p_interior", "p_none", "p_silent", "p_inside", "e_fab_kpa_low", "e_fab_kpa", "e_fab_kpa_high"]
    click.echo(result.inflection()[columns].to_string(float_format=lambda x: f"{x:.3g}", na_rep="–"))
    click.echo()
    for sentence in (
        *check_sentences(result.tables["predictive_checks"]),
        found["exponent_check"],
        found["fabric_check"],
    ):
        click.echo(sentence)
    click.echo(
        f"silent in every condition: {found['prior_silent_everywhere']:.1%} of the prior, "
        f"{found['posterior_silent_everywhere']:.1%} of the posterior; silent conditions: "
        f"{found['prior_silent_conditions']:.0%} and {found['posterior_silent_conditions']:.0%}"
    )
    if found["contact_beyond_half_radius"]:
        click.echo(
            f"contact radius beyond R/2, where Hertz's geometry is questionable: "
            f"{found['contact_beyond_half_radius']:.0%} of draws and conditions; beyond R, where it is "
            f"meaningless: {found['contact_beyond_radius']:.0%}"
        )
    click.echo(f"numerical error of the response: {found['numerical_error']:.1e} of its peak, at most, over draws")
    click.echo(f"written to {out}")
    click.echo(str(found["verdict"]))
