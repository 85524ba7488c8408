"""What `sample` and `resume` share: a run with its checkpoint, its progress, its files and its report."""

from __future__ import annotations

import re
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from softness_bayes.cli.options import DataFiles
from softness_bayes.errors import NotConvergedError, NumericalError

if TYPE_CHECKING:
    from tqdm import tqdm

    from softness_bayes.data import Experiment
    from softness_bayes.inference.diagnostics import Verdict
    from softness_bayes.inference.sampling import Progress
    from softness_bayes.result import Result
    from softness_bayes.run import RunOptions
    from softness_bayes.storage.checkpoint import Checkpoint

_SECONDS = {"": 1, "s": 1, "m": 60, "h": 3600}


def _duration(ctx: click.Context, param: click.Parameter, text: str | None) -> float:
    if text is None:
        return float("inf")
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([smh]?)", text.strip())
    if match is None:
        raise click.BadParameter(f"expected a time such as 90, 90s, 10m or 2h, got {text!r}")
    return float(match[1]) * _SECONDS[match[2]]


max_time = click.option(
    "--max-time",
    callback=_duration,
    metavar="TIME",
    help="Time after which the run ends, converged or not: 90 (seconds), 10m or 2h. By default there is none.",
)
"""Gives a verb `max_time` [s]."""

processes = click.option(
    "--processes",
    type=click.IntRange(min=1),
    metavar="N",
    help="Processes that share the ensembles; by default one for each core. Draws do not depend on it.",
)
"""Gives a verb `processes`."""

no_figures = click.option("--no-figures", is_flag=True, help="Leave out the figures.")
"""Gives a verb `no_figures`."""


def command_line() -> str:
    """Return what was typed, as a shell would take it again."""
    return shlex.join(["softness-bayes", *sys.argv[1:]])


def run(checkpoint: Checkpoint, files: DataFiles, experiment: Experiment, options: RunOptions, figures: bool) -> None:
    """Sample, from the start or from where the checkpoint is, and leave results and a report.

    Raises
    ------
    NotConvergedError
        If a limit was reached first; everything is written all the same.
    """
    from softness_bayes.run import sample

    out = checkpoint.directory
    for note in experiment.notes:
        click.echo(f"note: {note}", err=True)
    with checkpoint:
        checkpoint.request = {"files": _record(files), "options": options.record(), "figures": figures}
        bar = _Bar()
        try:
            result = sample(experiment, options, bar.show, checkpoint)
            result.save(out)
            if figures:
                from softness_bayes.plotting.figures import draw_figures

                draw_figures(result, out / "figures")
            checkpoint.finish()
        except (KeyboardInterrupt, NumericalError, OSError):
            bar.close()
            if checkpoint.status is not None:
                click.echo(
                    f"\nthe run is kept up to step {checkpoint.status.steps}: 'softness-bayes resume {out}' "
                    "continues it",
                    err=True,
                )
            raise
        finally:
            bar.close()
    _report(result, out)
    if not result.attributes["converged"]:
        raise NotConvergedError(
            f"not converged after {result.attributes['steps']} steps; what was drawn is in {out}, for inspection only; "
            f"'softness-bayes resume {out} --more-steps {result.attributes['missing_steps']}' continues"
        )


def in_numbers(verdict: Verdict, seconds: float) -> str:
    """Return what the last look at the chains found, in one line."""
    return (
        f"tau {verdict.tau.max():.0f}, {verdict.lengths:.0f} of {verdict.goal.lengths:.0f} tau, "
        f"R-hat {verdict.r_hat.max():.3f}, ESS {verdict.ess:.0f} ({verdict.ess / max(seconds, 1e-9):.3g}/s)"
    )


def recorded_files(record: dict[str, Any]) -> DataFiles:
    """Return the files that a run was begun with."""
    fabrics = record["fabrics"]
    return DataFiles(**{**record, "data": Path(record["data"]), "fabrics": None if fabrics is None else Path(fabrics)})


def _record(files: DataFiles) -> dict[str, Any]:
    """Return files as JSON holds them, found from wherever the run is continued."""
    return {
        "data": str(files.data.absolute()),
        "fabrics": None if files.fabrics is None else str(files.fabrics.absolute()),
        "columns": dict(files.columns),
        "indentation_mm": files.indentation_mm,
        "force_n": files.force_n,
    }


class _Bar:
    """Progress towards convergence on the terminal: steps against the present estimate of what it takes."""

    def __init__(self) -> None:
        self._bar: tqdm[NoReturn] | None = None

    def show(self, progress: Progress) -> None:
        """Move the bar; its end moves too when a look changes the estimate."""
        if self._bar is None:  # not before there is progress: an input error comes first and stands alone
            from tqdm import tqdm

            self._bar = tqdm(
                total=1, initial=progress.steps, unit="step", desc="sampling", leave=False, dynamic_ncols=True
            )
        self._bar.total = progress.steps + progress.missing
        self._bar.update(progress.steps - self._bar.n)
        if progress.verdict is not None:
            self._bar.set_postfix_str(in_numbers(progress.verdict, progress.seconds))

    def close(self) -> None:
        """Clear the line."""
        if self._bar is not None:
            self._bar.close()


def _report(result: Result, out: Path) -> None:
    """Print summary, inflection, checks and verdict."""
    found = result.attributes
    click.echo(result.summary().to_string(float_format=lambda x: f"{x:.4g}"))
    click.echo("\nwhere the response turns over (probabilities; E_fab in kPa, medians and 90 % limits)")
    columns = ["p_interior", "p_none", "p_silent", "p_inside", "e_fab_kpa_low", "e_fab_kpa", "e_fab_kpa_high"]
    click.echo(result.inflection()[columns].to_string(float_format=lambda x: f"{x:.3g}", na_rep="–"))
    click.echo()
    click.echo(found["fabric_check"])
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
