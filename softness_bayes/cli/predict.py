"""`softness-bayes predict` and `softness-bayes simulate`: the forward model as a table, and ratings from it."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click

from softness_bayes import __version__
from softness_bayes.base.defaults import ANSWER_DRAWS, ERRORS, SEED
from softness_bayes.base.errors import InputError
from softness_bayes.base.options import Number
from softness_bayes.base.ranges import FINGERS, PANEL, PARTICIPANTS, SLOPES, TYPICAL_RATINGS, Range
from softness_bayes.base.readable import counted, percent
from softness_bayes.cli.options import (
    Directory,
    Force,
    Given,
    Out,
    Seed,
    SetValues,
    TableFile,
    Touched,
    TrustCode,
    command,
    typed,
)
from softness_bayes.cli.running import rated_run, warn_of_cautions
from softness_bayes.likelihood.scales import RATING_DIRECTIONS, RISES
from softness_bayes.model.options import ModelOptions

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import ArrayLike

    from softness_bayes.data import Fabrics
    from softness_bayes.results.result import Result
    from softness_bayes.touch.accuracy import ChosenResolution
    from softness_bayes.touch.contact import Load
    from softness_bayes.touch.parameters import TouchParameters
    from softness_bayes.touch.scene import Scene

SIMULATED = Given(
    *("prior_set", "readings", "finger", "load_cv", "errors", "resolution", "n_categories", "scale", "direction"),
    "accuracy",
    errors={"choices": ERRORS, "default": ERRORS[0]},
    direction={"choices": RATING_DIRECTIONS, "default": RISES.name},
)
"""Options of the model that simulated ratings have."""


@command
def predict(
    *,
    touches: Touched,
    values: SetValues,
    model: Annotated[ModelOptions, Given("prior_set", "readings", "finger", "accuracy")],
    posterior: Annotated[Path | None, Directory()] = None,
    raters: Annotated[int | None, Number(PANEL, "N")] = None,
    seed: Seed = SEED,
    file: TableFile,
    trust_code: TrustCode = False,
) -> None:
    """Predict contact, stress, firing and ratings for fabrics under loads.

    The table has one row for each fabric and load. By default parameters are the medians of their priors, and --set
    changes single ones. --posterior uses the draws of a run instead; with --set as well, the medians of its posterior.
    Ratings need a run: they are predicted for the typical rater, for a new rater, and as the mean of several, with
    50 and 90 % intervals. The last columns flag rows where no receptor fires, where the contact is too large for
    Hertz's geometry, and where fabric or load lie outside the range that was rated.

    Parameters
    ----------
    indentation_mm
        Indentation [mm] of the touch; by default those of the run, with --posterior.
    force_n
        Contact force [N] of the touch; by default those of the run, with --posterior.
    posterior
        A finished run: parameters are draws of its posterior. Each quantity is given as its median and, in NAME_low and
        NAME_high, its 90 % credible interval. Ratings are predicted too. The accuracy is that of the run, unless
        --accuracy is given.
    raters
        With --posterior: predict the mean rating of N new raters; by default as many as in the run.
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
        scene = _accurate(partial(compiled, finger=model.finger), named, parameters, model.accuracy).scene
        table, scenes = prediction_table(fabrics, scene, parameters), [scene]
        reached = reach_of_priors(fabrics, loads, model.readings, model.prior_set, values, model.finger)
    else:
        if typed("finger", "readings", "prior_set"):
            raise InputError(
                "--posterior has its own readings, priors and finger: omit --finger, --priors and --reading"
            )
        with rated_run(posterior, trust_code) as result:
            table, scenes, parameters, reached = _of_run(result, values, fabrics, loads, model.accuracy, raters, seed)
    if reached:
        click.echo(f"warning: {reached}", err=True)
    file.write(table)
    of = "of the rows" if posterior is None else "of rows and draws"
    # the warning already contains this information
    if not reached and (note := _geometry_note(scenes, parameters, of)):
        click.echo(f"note: {note}", err=True)


def _of_run(
    result: Result,
    values: Mapping[str, float],
    fabrics: Fabrics,
    loads: tuple[Load, ...],
    accuracy: float,
    raters: int | None,
    seed: int,
) -> tuple[pd.DataFrame, list[Scene], TouchParameters, str]:
    """Return the predictions of a finished run, their scenes, the draws, and a note if most are out of reach."""
    from softness_bayes.model.build import COARSE
    from softness_bayes.model.reach import reach_note
    from softness_bayes.results.fitted import Fitted
    from softness_bayes.results.rating_table import predicted
    from softness_bayes.touch.parameters import TouchParameters

    warn_of_cautions(result, fabrics)
    loads = loads or result.loads
    fitted = Fitted(result, ANSWER_DRAWS, values)
    needed = TouchParameters._fields[: -len(TouchParameters._field_defaults)]
    if lacking := [name for name in needed if name not in fitted.named]:
        raise KeyError(lacking[0])  # `rated_run` names the file

    def compiled(some: Fabrics) -> Scene:
        return _accurate(partial(fitted.scene, some, loads), fitted.named, fitted.touch, accuracy).scene

    def under(pressed: Sequence[Load]) -> Scene:
        return fitted.scene(fabrics, tuple(pressed), COARSE)

    table, scenes = predicted(fitted, fabrics, loads, raters, seed, compiled if typed("accuracy") else None)
    few = TouchParameters(*(value[:: ANSWER_DRAWS // 16] for value in fitted.touch))
    return result.labelled(table), scenes, fitted.touch, reach_note(under, loads, few, {})


def _accurate(
    compiled: Callable[..., Scene], named: Mapping[str, ArrayLike], parameters: TouchParameters, accuracy: float
) -> ChosenResolution:
    """Return the scene, as a function makes it of a `discretisation`, at the resolution that an accuracy needs."""
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


@command
def simulate(
    *,
    touches: Touched,
    values: SetValues,
    model: Annotated[ModelOptions, SIMULATED],
    participants: Annotated[int, Number(PARTICIPANTS, "N")] = 30,
    missing: Annotated[float, Number(Range(0.0, 0.999), "SHARE")] = 0.0,
    typical_rating: Annotated[float | None, Number(TYPICAL_RATINGS, "Y")] = None,
    slope: Annotated[float | None, Number(SLOPES, "C1")] = None,
    fingers: Annotated[int, Number(FINGERS, "N")] = 0,
    seed: Seed = SEED,
    out: Out = Path("results"),
    force: Force = False,
) -> None:
    """Simulate ratings of fabrics from given parameters.

    Every participant rates every fabric under every load once. Writes ratings.csv (with the columns of the fabrics),
    fabrics.csv and truth.json, which has the true parameters. With --fingers it also writes compression.csv, the
    forces of a rigid flat plate on fingers of the same skin. With --load-cv the load of every rating has an
    independent error, whose size ratings.csv states. With --resolution participants round their answers to multiples
    of this step.

    Parameters
    ----------
    errors
        Distribution of the errors of log ratings: normal, student (Student's t, nu by --set) or lapses (--set
        lapse=0.03).
    direction
        Whether ratings rise or fall with the response.
    participants
        Number of raters.
    missing
        Share of ratings that are missing at random.
    typical_rating
        exp(mu); by default the centre of its prior.
    slope
        c1 of standardised ratings; by default the median of its prior.
    fingers
        Number of fingers pressed by a rigid flat plate to 0.5, 1, 1.5 and 2 mm, for compression.csv.
    """
    import numpy as np

    from softness_bayes.base.files.outputs import require_outputs, write_outputs
    from softness_bayes.data import SIMULATE, compression_csv, fabrics_csv, ratings_csv
    from softness_bayes.model.scenes import scene_of, touch_parameters, usual_values
    from softness_bayes.model.simulation import simulate_compression, simulate_ratings
    from softness_bayes.parameters.declared import PLATE_PARAMETERS

    assert model.direction is not None, "simulated ratings have a direction and an error law"
    assert model.errors is not None, "simulated ratings have a direction and an error law"
    names = ["ratings.csv", "fabrics.csv", "truth.json", *(["compression.csv"] if fingers else [])]
    require_outputs(out, names, SIMULATE, force, touches.inputs)
    fabrics, loads = touches.read()
    usual = usual_values(model.readings, model.prior_set, values, fingers or None)
    compiled = partial(scene_of, fabrics, loads, usual, model.readings, finger=model.finger)
    simulation = simulate_ratings(
        np.random.default_rng(seed),
        fabrics,
        loads,
        {name: value for name, value in usual.items() if name not in PLATE_PARAMETERS},
        model.readings,
        participants,
        missing,
        None if typical_rating is None else math.log(typical_rating),
        model.direction,
        model.scale,
        slope,
        _accurate(compiled, usual, touch_parameters(usual), model.accuracy).discretisation,
        model.finger,
        model.load_cv or 0.0,
        model.errors,
        model.resolution or 0.0,
        model.n_categories,
    )
    contents = {"ratings.csv": ratings_csv(simulation.ratings, fabrics), "fabrics.csv": fabrics_csv(fabrics)}
    raters, stored, pressed = simulation.ratings.participants, model.record(), ""
    story: dict[str, Any] = {
        "truth": simulation.truth,
        "total_rate": {
            # rounded to digits that are the same on all machines
            str(load): {name: float(f"{x:.8g}") for name, x in zip(fabrics.names, of_load, strict=True)}
            for load, of_load in zip(loads, simulation.total_rate.T, strict=True)
        },
        "participant_effect": dict(zip(raters, simulation.participant_effect.tolist(), strict=True)),
        "seed": seed,
        "readings": stored["readings"],
        "ratings": stored["scale"],
        "direction": stored["direction"],
    }
    more = {name: stored[name] for name in ("finger", "load_cv", "errors", "resolution", "n_categories")}
    story |= {name: value for name, value in more.items() if value and value != ERRORS[0]}
    story |= {"version": __version__, "simulated": True}
    if fingers:
        # a separate random stream, so that the ratings are the same with and without simulated fingers
        plate = simulate_compression(
            np.random.default_rng([seed, 1]), usual, model.readings, fingers, shape=model.finger
        )
        contents["compression.csv"] = compression_csv(plate.compression)
        story["truth"] |= {name: usual[name] for name in PLATE_PARAMETERS}
        for name in ("log_b_effect", "m_effect"):
            story[name] = dict(zip(plate.compression.participants, getattr(plate, name).tolist(), strict=True))
        pressed = f", and {counted(len(plate.compression), 'force')} on {counted(fingers, 'finger')}"
    write_outputs(out, {**contents, "truth.json": json.dumps(story, indent=1) + "\n"}, SIMULATE)
    click.echo(
        f"{out}: {counted(len(simulation.ratings), 'simulated rating')} of {counted(len(fabrics), 'fabric')}{pressed}"
    )
    if silent := float((simulation.total_rate == 0).mean()):
        click.echo(f"note: no receptor fires in {percent(silent)} of the conditions", err=True)
