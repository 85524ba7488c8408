"""`softness-bayes plan`: resolution, error and cost of the model of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from softness_bayes.cli.options.model import ModelChoice, model_choice
from softness_bayes.cli.options.ratings import rating_scale
from softness_bayes.cli.options.tables import DataFiles, data_files
from softness_bayes.errors import InputError

if TYPE_CHECKING:
    from softness_bayes.model.cost import Setting
    from softness_bayes.touch.accuracy import Errors
    from softness_bayes.touch.scene import Discretisation


@click.command()
@data_files
@model_choice
@rating_scale
def command(files: DataFiles, model: ModelChoice, scale: str) -> None:
    """Show how 'sample' would evaluate the model with the same options: stages, nodes, errors and cost.

    Errors are the largest over draws of the prior and conditions: of the response, relative to the peak of each draw,
    and of log(N/N_ref + eps). Costs are the time per parameter vector in batches of 64, measured on this machine.
    """
    from softness_bayes.data import Compression
    from softness_bayes.likelihood.scales import scale_named
    from softness_bayes.model.build import build
    from softness_bayes.model.cost import BATCH, ladder, left_out, seconds
    from softness_bayes.model.scenes import prior_draws
    from softness_bayes.touch.accuracy import DRAWS
    from softness_bayes.touch.scene import Scene

    data = files.read()
    if isinstance(data, Compression):
        raise InputError("plan: a fit of forces alone needs no response, so there is nothing to plan: give --data")
    built = build(data, model.options(scale=scale_named(scale)))
    scene, chosen, draws = built.scene, built.resolution, prior_draws(built.posterior.space)
    assert chosen is not None, "the command line sets an accuracy"
    d = chosen.discretisation
    settings = ladder(scene, draws)
    cost, others = seconds(scene, draws.parameters), built.posterior.other_loads
    cost += seconds(others, draws.parameters) if isinstance(others, Scene) else 0.0
    click.echo(
        f"accuracy {model.accuracy:g}, {scene.n_conditions} conditions, errors over {DRAWS} draws of the prior\n"
    )
    for line in (
        _row("stage", "resolution", "error / peak", "error of log"),
        _row("mechanics", "", *_numbers(chosen.mechanics)),
        _row("  stress field", f"tolerance {d.field_tolerance:.0e}", "", ""),
        _row("  population", f"{d.nodes} nodes, to exp(-{d.saturation:g})", "", ""),
        _row("firing rates", _rates(scene.firing, d), *_numbers(chosen.firing)),
        _row("sum", "", *_numbers(chosen.errors)),
    ):
        click.echo(line.rstrip())
    click.echo(f"\ncost: {1e6 * cost:.1f} µs for each parameter vector, {BATCH} at a time, on one core")
    click.echo("\nleft out:")
    for reason in left_out(built):
        click.echo(f"- {reason}")
    click.echo("\npresets:")
    for setting in settings:
        click.echo(_choice(setting))


def _rates(firing: object, d: Discretisation) -> str:
    from softness_bayes.touch.neuron.fixed_channels import FixedChannels

    if not isinstance(firing, FixedChannels):
        return f"surface, {_terms(d)}"
    return f"curve through {d.rate_nodes} rates, {_terms(d)}"


def _terms(d: Discretisation) -> str:
    return "all terms" if d.rate_terms is None else f"{d.rate_terms} terms"


def _numbers(errors: Errors) -> tuple[str, str]:
    return f"{float(errors.peak):.1e}", f"{float(errors.log):.1e}"


def _row(stage: str, resolution: str, peak: str, log: str) -> str:
    return f"{stage:16} {resolution:28} {peak:>12} {log:>14}"


def _choice(setting: Setting) -> str:
    d = setting.resolution.discretisation
    what = f"{d.nodes} nodes, to exp(-{d.saturation:g}), tolerance {d.field_tolerance:.0e}, {_terms(d)}"
    mark = "  <- chosen" if setting.chosen else ""
    peak, log = _numbers(setting.resolution.errors)
    return f"{what:54} {peak:>9} {log:>9} {1e6 * setting.seconds:9.1f} µs{mark}"
