"""`softness-bayes predict`: the forward model as a table."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

from softness_bayes.cli.options.model import (
    ReadingChoice,
    accuracy,
    finger,
    prior_set,
    readings,
    set_values,
)
from softness_bayes.cli.options.tables import Touches, touches
from softness_bayes.cli.running import reading
from softness_bayes.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from softness_bayes.touch.parameters import TouchParameters
    from softness_bayes.touch.scene import Scene

PREDICT = "predict"

DRAWS = 400
"""Posterior draws that a table of credible limits is made of."""


@click.command()
@touches
@set_values
@prior_set
@readings
@finger
@accuracy
@click.option(
    "--posterior",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="A finished run: parameters are draws of its posterior, and each quantity gets its median and, as "
    "NAME_low and NAME_high, the limits of its 90 % credible interval.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="CSV file to write; by default the table is printed.",
)
@click.option("--force", is_flag=True, help="Replace an --out that 'predict' wrote.")
def command(
    touches: Touches,
    values: dict[str, float],
    prior_set: str,
    choice: ReadingChoice,
    finger: dict[str, float],
    accuracy: float,
    posterior: Path | None,
    out: Path | None,
    force: bool,
) -> None:
    """Predict contact, stress and firing for fabrics under loads.

    One row for each fabric and load. Parameters are the medians of their priors; --set changes single
    ones, --posterior takes the draws of a run instead.
    """
    from softness_bayes.files.outputs import require_outputs, write_outputs
    from softness_bayes.files.spreadsheet import csv_of
    from softness_bayes.model.fingers import finger_of
    from softness_bayes.model.prediction import drawn_parameters, prediction_table
    from softness_bayes.model.resolution import given_draws, scene_with_accuracy
    from softness_bayes.model.scenes import scene_of, touch_parameters, usual_values

    if out is not None:
        require_outputs(out.parent, [out.name], PREDICT, force, [touches.fabrics])
    fabrics, loads = touches.read()
    named: Mapping[str, ArrayLike]
    if posterior is None:
        chosen = choice.resolve()
        named, noise, touching = usual_values(chosen, prior_set, values), 0.0, finger_of(finger)
    else:
        if values or finger or not choice.is_default or prior_set != "default":
            raise InputError("--posterior brings its own parameters, readings and finger: leave out --set and others")
        with reading(posterior) as (result,):
            if not result.has_ratings:
                raise InputError(f"{posterior}: a run without ratings, which says nothing of the receptors; give --set")
            chosen, named, noise = result.readings, result.values(DRAWS), result.provenance.rating_model.noise
            touching = result.finger
            drawn_parameters(named)
    parameters = touch_parameters(named) if posterior is None else drawn_parameters(named)
    scene, _ = scene_with_accuracy(
        lambda discretisation: scene_of(
            fabrics, loads, named, chosen, discretisation=discretisation, noise=noise, finger=touching
        ),
        given_draws(named, parameters),
        accuracy,
    )
    table = prediction_table(fabrics, scene, parameters)
    text = csv_of(table, index=False)
    if out is None:
        click.echo(text, nl=False)
    else:
        write_outputs(out.parent, {out.name: text}, PREDICT)
        click.echo(f"{out}: {len(table)} rows", err=True)
    if note := _geometry_note(scene, parameters, "of the rows" if posterior is None else "of rows and draws"):
        click.echo(f"note: {note}", err=True)


def _geometry_note(scene: Scene, parameters: TouchParameters, of: str) -> str:
    """Say in which share, and of what, the contact leaves the range of Hertz's geometry (model.md 3)."""
    beyond = scene.beyond_hertz(parameters)
    if not beyond.questionable:
        return ""
    return (
        f"the contact radius exceeds R/2, where Hertz's geometry is questionable, in {beyond.questionable:.1%} "
        f"{of}, and R, where it is meaningless, in {beyond.meaningless:.1%}"
    )
