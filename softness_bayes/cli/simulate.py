"""`softness-bayes simulate`: ratings from stated parameters."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from softness_bayes import __version__
from softness_bayes.cli.options import Touches, collected, force, number, out, seed, set_values, touches
from softness_bayes.cli.predict import accurate
from softness_bayes.defaults import ERRORS
from softness_bayes.likelihood.scales import RATING_DIRECTIONS, RISES
from softness_bayes.model.options import ModelOptions
from softness_bayes.ranges import FINGERS, PARTICIPANTS, SLOPES, TYPICAL_RATINGS, Range
from softness_bayes.readable import counted, percent

if TYPE_CHECKING:
    from softness_bayes.model.simulation import Simulation
    from softness_bayes.touch.contact import Load

RATINGS, FABRICS, COMPRESSION, TRUTH = "ratings.csv", "fabrics.csv", "compression.csv", "truth.json"


@click.command()
@touches()
@set_values
@collected(
    "model",
    ModelOptions,
    *("prior_set", "readings", "finger", "load_cv", "errors", "resolution", "n_categories", "scale", "direction"),
    "accuracy",
    errors={
        "choices": ERRORS,
        "default": ERRORS[0],
        "help": "Distribution of the errors of log ratings: normal, student (Student's t, nu by --set) or lapses "
        "(--set lapse=0.03).",
    },
    direction={
        "choices": RATING_DIRECTIONS,
        "default": RISES.name,
        "help": "Whether ratings rise or fall with the response.",
    },
)
@number("--participants", PARTICIPANTS, "Number of raters.", 30)
@number("--missing", Range(0.0, 0.999), "Share of ratings that are missing at random.", 0.0, "SHARE")
@number("--typical-rating", TYPICAL_RATINGS, "exp(mu); by default the centre of its prior.", metavar="Y")
@number("--slope", SLOPES, "c1 of standardised ratings; by default the median of its prior.", metavar="C1")
@number(
    "--fingers",
    FINGERS,
    "Number of fingers pressed by a rigid flat plate to 0.5, 1, 1.5 and 2 mm, for compression.csv.",
    0,
)
@seed
@out()
@force
def command(
    touches: Touches,
    values: dict[str, float],
    model: ModelOptions,
    participants: int,
    missing: float,
    typical_rating: float | None,
    slope: float | None,
    fingers: int,
    seed: int,
    out: Path,
    force: bool,
) -> None:
    """Simulate ratings of fabrics from given parameters.

    Every participant rates every fabric under every load once. Writes ratings.csv (with the columns of the fabrics),
    fabrics.csv and truth.json, which has the true parameters. With --fingers it also writes compression.csv, the
    forces of a rigid flat plate on fingers of the same skin. With --load-cv the load of every rating has an
    independent error, whose size ratings.csv states. With --resolution participants round their answers to multiples
    of this step.
    """
    import numpy as np

    from softness_bayes.data import SIMULATE, fabrics_csv, ratings_csv
    from softness_bayes.files.outputs import require_outputs, write_outputs
    from softness_bayes.model.scenes import scene_of, touch_parameters, usual_values
    from softness_bayes.model.simulation import simulate_ratings
    from softness_bayes.parameters.declared import PLATE_PARAMETERS

    assert model.direction is not None, "simulated ratings have a direction and an error law"
    assert model.errors is not None, "simulated ratings have a direction and an error law"
    names = [RATINGS, FABRICS, TRUTH, *([COMPRESSION] if fingers else [])]
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
        accurate(compiled, usual, touch_parameters(usual), model.accuracy).discretisation,
        model.finger,
        model.load_cv or 0.0,
        model.errors,
        model.resolution or 0.0,
        model.n_categories,
    )
    contents = {RATINGS: ratings_csv(simulation.ratings, fabrics), FABRICS: fabrics_csv(fabrics)}
    story = _truth(simulation, fabrics.names, loads)
    stored = model.record()
    story |= {"seed": seed, "readings": stored["readings"], "ratings": stored["scale"]}
    story |= {"direction": stored["direction"]}
    more = {name: stored[name] for name in ("finger", "load_cv", "errors", "resolution", "n_categories")}
    story |= {name: value for name, value in more.items() if value and value != ERRORS[0]}
    story |= {"version": __version__, "simulated": True}
    pressed = ""
    if fingers:
        contents[COMPRESSION], count, effects = _forces(seed, usual, model, fingers)
        story["truth"] |= {name: usual[name] for name in PLATE_PARAMETERS}
        story |= effects
        pressed = f", and {counted(count, 'force')} on {counted(fingers, 'finger')}"
    write_outputs(out, {**contents, TRUTH: json.dumps(story, indent=1) + "\n"}, SIMULATE)
    click.echo(
        f"{out}: {counted(len(simulation.ratings), 'simulated rating')} of {counted(len(fabrics), 'fabric')}{pressed}"
    )
    silent = float((simulation.total_rate == 0).mean())
    if silent:
        click.echo(f"note: no receptor fires in {percent(silent)} of the conditions", err=True)


def _forces(
    seed: int, values: Mapping[str, float], model: ModelOptions, fingers: int
) -> tuple[str, int, dict[str, Any]]:
    """Return the table of forces on simulated fingers, the number of rows, and the finger effects for JSON."""
    import numpy as np

    from softness_bayes.data import compression_csv
    from softness_bayes.model.simulation import simulate_compression

    # a separate random stream, so that the ratings are the same with and without simulated fingers
    simulation = simulate_compression(
        np.random.default_rng([seed, 1]), values, model.readings, fingers, shape=model.finger
    )
    names = simulation.compression.participants
    effects = {"log_b_effect": simulation.log_b_effect, "m_effect": simulation.m_effect}
    of_each = {name: dict(zip(names, effect.tolist(), strict=True)) for name, effect in effects.items()}
    return compression_csv(simulation.compression), len(simulation.compression), of_each


def _truth(simulation: Simulation, names: tuple[str, ...], loads: tuple[Load, ...]) -> dict[str, Any]:
    """Return the true parameters and total rates behind the simulated ratings, for JSON."""
    return {
        "truth": simulation.truth,
        "total_rate": {
            # rounded to digits that are the same on all machines
            str(load): {name: float(f"{x:.8g}") for name, x in zip(names, simulation.total_rate[:, k], strict=True)}
            for k, load in enumerate(loads)
        },
        "participant_effect": dict(
            zip(simulation.ratings.participants, simulation.participant_effect.tolist(), strict=True)
        ),
    }
