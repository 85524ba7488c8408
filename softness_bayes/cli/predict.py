"""`softness-bayes predict`: the forward model as a table."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from softness_bayes.cli.options import (
    TableFile,
    Touches,
    collected,
    number,
    path,
    seed,
    set_values,
    table_file,
    touches,
    trust_code,
    typed,
)
from softness_bayes.cli.running import rated_run, warn_of_cautions
from softness_bayes.defaults import ANSWER_DRAWS
from softness_bayes.errors import InputError
from softness_bayes.model.options import ModelOptions
from softness_bayes.ranges import PANEL
from softness_bayes.readable import percent

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import ArrayLike

    from softness_bayes.data import Fabrics
    from softness_bayes.touch.accuracy import ChosenResolution
    from softness_bayes.touch.contact import Load
    from softness_bayes.touch.parameters import TouchParameters
    from softness_bayes.touch.scene import Scene


@click.command()
@touches(loads="those of the run, with --posterior")
@set_values
@collected("model", ModelOptions, "prior_set", "readings", "finger", "accuracy")
@path(
    "--posterior",
    "DIR",
    "A finished run: parameters are draws of its posterior. Each quantity is given as its median and, in "
    "NAME_low and NAME_high, its 90 % credible interval. Ratings are predicted too.",
)
@number(
    "--raters", PANEL, "With --posterior: predict the mean rating of N new raters; by default as many as in the run."
)
@seed
@table_file("predict")
@trust_code
def command(
    touches: Touches,
    values: dict[str, float],
    model: ModelOptions,
    posterior: Path | None,
    raters: int | None,
    seed: int,
    file: TableFile,
) -> None:
    """Predict contact, stress, firing and ratings for fabrics under loads.

    The table has one row for each fabric and load. By default parameters are the medians of their priors, and --set
    changes single ones. --posterior uses the draws of a run instead; with --set as well, the medians of its posterior.
    Ratings need a run: they are predicted for the typical rater, for a new rater, and as the mean of several, with
    50 and 90 % intervals. The last columns flag rows where no receptor fires, where the contact is too large for
    Hertz's geometry, and where fabric or load lie outside the range that was rated.
    """
    from softness_bayes.model.prediction import prediction_table
    from softness_bayes.model.reach import reach_of_priors
    from softness_bayes.model.scenes import scene_of, touch_parameters, usual_values

    file.require(touches.inputs)
    fabrics, loads = touches.read(needs_load=posterior is None)
    if posterior is None:
        if raters is not None:
            raise InputError(
                "--raters needs --posterior, because only a finished run predicts ratings: give "
                "--posterior, or omit --raters"
            )
        named = usual_values(model.readings, model.prior_set, values)
        parameters, compiled = touch_parameters(named), partial(scene_of, fabrics, loads, named, model.readings)
        scene = accurate(partial(compiled, finger=model.finger), named, parameters, model.accuracy).scene
        table, scenes = prediction_table(fabrics, scene, parameters), [scene]
        reached = reach_of_priors(fabrics, loads, model.readings, model.prior_set, values, model.finger)
    else:
        if typed("finger", "readings", "prior_set"):
            raise InputError(
                "--posterior has its own readings, priors and finger: omit --finger, --priors and --reading"
            )
        table, scenes, parameters, reached = _of_run(posterior, values, fabrics, loads, model.accuracy, raters, seed)
    if reached:
        click.echo(f"warning: {reached}", err=True)
    file.write(table)
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
    from softness_bayes.results.fitted import Fitted
    from softness_bayes.results.rating_table import predicted
    from softness_bayes.touch.parameters import TouchParameters

    with rated_run(directory) as result:
        warn_of_cautions(result, fabrics)
        loads = loads or result.loads
        fitted = Fitted(result, ANSWER_DRAWS, values)
        needed = TouchParameters._fields[: -len(TouchParameters._field_defaults)]
        if lacking := [name for name in needed if name not in fitted.named]:
            raise KeyError(lacking[0])  # `rated_run` names the file
        parameters = fitted.touch

        def compiled(some: Fabrics) -> Scene:
            return accurate(partial(fitted.scene, some, loads), fitted.named, parameters, accuracy).scene

        def under(pressed: Sequence[Load]) -> Scene:
            return fitted.scene(fabrics, tuple(pressed), COARSE)

        table, scenes = predicted(fitted, fabrics, loads, raters, seed, compiled)
        few = TouchParameters(*(value[:: ANSWER_DRAWS // 16] for value in parameters))
        return result.labelled(table), scenes, parameters, reach_note(under, loads, few, {})


def accurate(
    compiled: Callable[..., Scene], named: Mapping[str, ArrayLike], parameters: TouchParameters, accuracy: float
) -> ChosenResolution:
    """Return the scene at the resolution that the accuracy needs.

    Parameters
    ----------
    compiled
        Function from a `discretisation` to the scene.
    named, parameters
        Parameters by name, in natural units, and those of the touch.
    accuracy
        Largest numerical error of the response, relative to its peak.
    """
    from softness_bayes.touch.accuracy import PRESETS, choose, given_draws

    draws = given_draws(named, parameters)
    # a scene that is evaluated only once gains nothing from the coarsest
    return choose(lambda discretisation: compiled(discretisation=discretisation), draws, accuracy, PRESETS[1:])


def _geometry_note(scenes: Sequence[Scene], parameters: TouchParameters, of: str) -> str:
    """Return a note on how often the contact is outside the range of Hertz's geometry (model.md 3)."""
    import numpy as np

    shares, sizes = [scene.beyond_hertz(parameters) for scene in scenes], [scene.n_conditions for scene in scenes]
    questionable, meaningless = np.average(shares, axis=0, weights=sizes)
    if not questionable:
        return ""
    return (
        f"the contact radius exceeds R/2, where Hertz's geometry is questionable, in {percent(questionable, 1)} "
        f"{of}, and R, where it is meaningless, in {percent(meaningless, 1)}"
    )
