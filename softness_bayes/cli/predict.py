"""`softness-bayes predict`: the forward model as a table."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from softness_bayes.cli.options import (
    FILE,
    Touches,
    collected,
    seed,
    set_values,
    table_out,
    touches,
    trust_code,
    typed,
    whole,
)
from softness_bayes.cli.running import reading, warn_of_unconverged
from softness_bayes.defaults import ANSWER_DRAWS
from softness_bayes.errors import InputError
from softness_bayes.model.options import ModelOptions
from softness_bayes.ranges import PANEL
from softness_bayes.readable import counted, percent

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import ArrayLike

    from softness_bayes.data import Fabrics
    from softness_bayes.touch.contact import Load
    from softness_bayes.touch.parameters import TouchParameters
    from softness_bayes.touch.scene import Scene

PREDICT = "predict"

REACHED = 16
"""Number of posterior draws for judging which ratings the model can reach."""


@click.command()
@touches()
@set_values
@collected("model", ModelOptions, "prior_set", "readings", "finger", "accuracy")
@click.option(
    "--posterior",
    type=FILE,
    metavar="DIR",
    help="A finished run: parameters are draws of its posterior. Each quantity is given as its median and, in "
    "NAME_low and NAME_high, its 90 % credible interval. Ratings are predicted too.",
)
@click.option(
    "--raters",
    type=whole(PANEL),
    metavar="N",
    help="With --posterior: predict the mean rating of N new raters; by default as many as in the run.",
)
@seed
@table_out("predict")
@trust_code
def command(
    touches: Touches,
    values: dict[str, float],
    model: ModelOptions,
    posterior: Path | None,
    raters: int | None,
    seed: int,
    out: Path | None,
    force: bool,
) -> None:
    """Predict contact, stress, firing and ratings for fabrics under loads.

    The table has one row for each fabric and load. By default parameters are the medians of their priors, and --set
    changes single ones. --posterior uses the draws of a run instead; with --set as well, the medians of its posterior.
    Ratings need a run: they are predicted for the typical rater, for a new rater, and as the mean of several, with
    50 and 90 % intervals. The last columns flag rows where no receptor fires, where the contact is too large for
    Hertz's geometry, and where fabric or load lie outside the range that was rated.
    """
    from softness_bayes.files.outputs import require_outputs, write_outputs
    from softness_bayes.files.spreadsheet import PRINTED, csv_of
    from softness_bayes.model.prediction import prediction_table
    from softness_bayes.model.reach import reach_of_priors
    from softness_bayes.model.scenes import scene_of, touch_parameters, usual_values

    if out is not None:
        require_outputs(out.parent, [out.name], PREDICT, force, touches.inputs)
    fabrics, loads = touches.read()
    if posterior is None:
        if raters is not None:
            raise InputError(
                "--raters needs --posterior, because only a finished run predicts ratings: give "
                "--posterior, or omit --raters"
            )
        named = usual_values(model.readings, model.prior_set, values)
        parameters, compiled = touch_parameters(named), partial(scene_of, fabrics, loads, named, model.readings)
        scene = _accurate(partial(compiled, finger=model.finger), named, parameters, model.accuracy)
        table, scenes = prediction_table(fabrics, scene, parameters), [scene]
        reached = reach_of_priors(fabrics, loads, model.readings, model.prior_set, values, model.finger)
    else:
        if typed("finger", "readings", "readings_set", "prior_set"):
            raise InputError(
                "--posterior has its own readings, priors and finger: omit --finger, --priors and --reading"
            )
        table, scenes, parameters, reached = _of_run(posterior, values, fabrics, loads, model.accuracy, raters, seed)
    if reached:
        click.echo(f"warning: {reached}", err=True)
    if out is None:
        click.echo(csv_of(table, index=False, digits=PRINTED), nl=False)
    else:
        write_outputs(out.parent, {out.name: csv_of(table, index=False)}, PREDICT)
        click.echo(f"{out}: {counted(len(table), 'row')}", err=True)
    of = "of the rows" if posterior is None else "of rows and draws"
    # the warning already contains this information
    if not reached and (note := _geometry_note(scenes, parameters, of)):
        click.echo(f"note: {note}", err=True)


def _of_run(
    directory: Path,
    values: Mapping[str, float],
    fabrics: Fabrics,
    loads: tuple[Load, ...],
    accuracy: float,
    raters: int | None,
    seed: int,
) -> tuple[pd.DataFrame, list[Scene], TouchParameters, str]:
    """Return the predictions of a finished run, their scenes, the draws, and a note if most are out of reach.

    Raises
    ------
    InputError
        If there is no run, or it had no ratings, or a value cannot be set.
    """
    from softness_bayes.model.build import COARSE
    from softness_bayes.model.reach import reach_note
    from softness_bayes.parameters.declared import SHAPE_PARAMETERS
    from softness_bayes.results.fitted import Fitted
    from softness_bayes.results.rating_table import predicted
    from softness_bayes.touch.parameters import TouchParameters

    with reading(directory) as (result,):
        warn_of_unconverged(result)
        if not result.has_ratings:
            raise InputError(f"{directory}: this run has no ratings, so it does not inform the receptors; give --set")
        fitted = Fitted(result, ANSWER_DRAWS, values)
        if lacking := [n for n in TouchParameters._fields if n not in fitted.named and n not in SHAPE_PARAMETERS]:
            raise KeyError(lacking[0])  # `reading` names the file
        parameters = fitted.touch

        def compiled(some: Fabrics) -> Scene:
            return _accurate(partial(fitted.scene, some, loads), fitted.named, parameters, accuracy)

        def under(pressed: Sequence[Load]) -> Scene:
            return fitted.scene(fabrics, tuple(pressed), COARSE)

        table, scenes = predicted(fitted, fabrics, loads, raters, seed, compiled)
        few = TouchParameters(*(value[:: max(1, ANSWER_DRAWS // REACHED)] for value in parameters))
        return result.labelled(table), scenes, parameters, reach_note(under, loads, few, {})


def _accurate(
    compiled: Callable[..., Scene], named: Mapping[str, ArrayLike], parameters: TouchParameters, accuracy: float
) -> Scene:
    """Return the scene at the resolution that the accuracy needs."""
    from softness_bayes.touch.accuracy import PRESETS, choose, given_draws

    draws = given_draws(named, parameters)
    # a scene that is evaluated only once gains nothing from the coarsest
    return choose(lambda discretisation: compiled(discretisation=discretisation), draws, accuracy, PRESETS[1:]).scene


def _geometry_note(scenes: Sequence[Scene], parameters: TouchParameters, of: str) -> str:
    """Return a note on how often the contact is outside the range of Hertz's geometry (model.md 3)."""
    found = [scene.beyond_hertz(parameters) for scene in scenes]
    weight = [scene.n_conditions / sum(scene.n_conditions for scene in scenes) for scene in scenes]
    questionable, meaningless = (
        sum(w * share for w, share in zip(weight, shares, strict=True)) for shares in zip(*found, strict=True)
    )
    if not questionable:
        return ""
    return (
        f"the contact radius exceeds R/2, where Hertz's geometry is questionable, in {percent(questionable, 1)} "
        f"{of}, and R, where it is meaningless, in {percent(meaningless, 1)}"
    )
