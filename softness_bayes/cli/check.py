"""`softness-bayes check`: validation of data files, and what was understood of them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from softness_bayes.base.errors import InputError
from softness_bayes.cli.options import Force, command
from softness_bayes.model.options import ModelOptions
from softness_bayes.results.run_options import DataFiles

if TYPE_CHECKING:
    from softness_bayes.data import Experiment, Measurements
    from softness_bayes.model.interpretation import Interpretation


@command
def check(
    *,
    files: DataFiles,
    model: ModelOptions,
    design: bool = False,
    cost: bool = False,
    json_: bool = False,
    figure: Path | None = None,
    force: Force = False,
) -> None:
    """Validate data files and show how they are read, how precise the design is and what a run costs.

    The table of ratings has one row per rating: participant, fabric, rating, and indentation_mm or force_n; trial, if
    any. Fabrics have one row each in a separate table, or are columns of the ratings: fabric, and
    effective_modulus_kpa, or bending_rigidity_n_m, or tensile_modulus_mpa and thickness_mm; poisson_ratio where
    known. Compression data have one row per force of a rigid flat plate: participant, indentation_mm, force_n;
    indentor, if the rows of other indentors are to be left out. Recorded afferents have one row per response: force_n
    or indentation_mm, probe_curvature_per_m, distance_mm, and rate_hz or count with window_s. Errors name file, row,
    column and value. E_fab is shown under the chosen reading. For ratings, `check` also reports whether they rise or
    fall with stiffness. With --design it predicts in some seconds, before any sampling, how precisely every parameter
    will be known.

    With --cost, errors are the largest over draws of the prior and conditions: of the response, relative to the peak
    of each draw, and of log(N/N_ref + eps). Costs are the time per parameter vector in batches of 64, measured on this
    machine.

    Parameters
    ----------
    design
        Predict how precise the design is: expected posterior widths, and the changes that would help most.
    cost
        Show how 'sample' would evaluate the model with the same options: stages, nodes, errors and cost.
    json_
        Print all of it as JSON instead of text.
    figure
        Draw data and fabrics beside the response that the prior predicts (.png, .pdf or .svg).
    """
    from softness_bayes.cli import check_text as text
    from softness_bayes.data import Measurements
    from softness_bayes.experiments.understanding import SCHEMA, foreseen, understood, warnings
    from softness_bayes.model.build import ExperimentModel, recorded_terms
    from softness_bayes.model.reach import reach_of
    from softness_bayes.people.free_means import FreeMeans

    if cost and json_:
        raise InputError("check: --cost is printed as text: omit --json")
    if figure is not None:
        _require_figure(figure, files, force)
    experiment = _read_or_answered(files, model)
    if experiment is None:
        return
    recorded_terms(experiment, model)  # raises where a hollow is narrower than the finger
    if isinstance(experiment, Measurements):
        if design or cost or figure is not None:
            raise InputError("check: --design, --cost and --figure need ratings: give --data, or omit them")
        known: dict[str, Any] = {"schema": SCHEMA, **text.understood_measurements(experiment)}
        known["notes"] = list(experiment.notes)
        _echo(known if json_ else [*text.measurement_lines(experiment), *(f"note: {note}" for note in known["notes"])])
        return
    made = ExperimentModel(experiment, model)
    reached = reach_of(made)
    notes = [*experiment.notes, *warnings(made)]
    people = None if model.scale.model is not None else FreeMeans(experiment.ratings, model, made.interpretation)
    known = understood(made, [*([reached] if reached else []), *notes])
    known["design"] = foreseen(experiment, model) if design else None
    known |= text.understood_measurements(experiment)
    if json_:
        means = None if people is None else people.table().astype(object)
        rows = {} if means is None else {"people": means.where(means.notna(), None).to_dict("records")}
        _echo(known | rows)
    else:
        lines = []
        if people is not None:
            moduli = [one["e_fab_kpa"] for one in known["fabrics"]]
            lines = [
                *text.people_lines(people),
                *text.pair_lines(experiment.ratings, moduli, model.fixed.get("guess")),
                "",
            ]
        lines += [f"warning: {reached}\n"] if reached else []
        lines += [*text.table_lines(known, experiment, model), *(f"note: {note}" for note in notes)]
        lines += ["\nWhat do the numbers say?", known["model"]["numbers"], known["model"]["errors_because"]]
        lines += ["\nDo ratings rise or fall with stiffness?", *known["model"]["direction_because"]]
        lines += ["", *text.cost_lines(made)] if cost else []
        lines += ["", *text.design_lines(known["design"]), text.TOUCHES] if design else []
        _echo(lines)
    if figure is not None:
        _draw(figure, experiment, model, made.interpretation)
        click.echo(f"drawn in {figure}", err=True)


def _echo(said: dict[str, Any] | list[str]) -> None:
    click.echo(json.dumps(said, indent=1, ensure_ascii=False) if isinstance(said, dict) else "\n".join(said))


def _read_or_answered(files: DataFiles, model: ModelOptions) -> Experiment | Measurements | None:
    """Return the data of an experiment; of ratings whose fabrics nobody measured, show people's answer instead."""
    from softness_bayes.cli.check_text import people_lines
    from softness_bayes.people.free_means import FreeMeans
    from softness_bayes.people.sentences import needed_sentences

    try:
        return files.read()
    except InputError as error:
        try:
            ratings = files.answers()
        except InputError:
            raise error from None
        if ratings is None:
            raise
    for note in ratings.notes:
        click.echo(f"note: {note}", err=True)
    needed = needed_sentences(ratings.fabrics, bool(ratings.loads))
    _echo([*people_lines(FreeMeans(ratings, model)), "", *needed])
    return None


def _require_figure(figure: Path, files: DataFiles, force: bool) -> None:
    from softness_bayes.base.files.outputs import require_outputs
    from softness_bayes.plotting.style import METADATA

    if figure.suffix.lstrip(".") not in METADATA:
        known = ", ".join(f".{name}" for name in METADATA)
        raise InputError(f"--figure {figure}: expected a name that ends in one of {known}")
    require_outputs(figure.parent, [figure.name], "check", force, files.paths)


def _draw(figure: Path, experiment: Experiment, model: ModelOptions, meaning: Interpretation) -> None:
    """Draw data and fabrics with the response predicted by draws of the prior."""
    import numpy as np

    from softness_bayes.base.files.outputs import write_outputs
    from softness_bayes.experiments.understanding import prior_responses
    from softness_bayes.plotting.rating import design_figure, observed_ratings
    from softness_bayes.plotting.style import files_of
    from softness_bayes.touch.load_groups import groups_of

    ratings = experiment.ratings
    groups = groups_of(ratings.loads)
    grid, response, modulus = prior_responses(experiment, model, groups.at.tolist(), 200)
    pairs, of_rating = np.unique(groups.of[ratings.load] * len(ratings.fabrics) + ratings.fabric, return_inverse=True)
    load, fabric = np.divmod(pairs, len(ratings.fabrics))
    observed = observed_ratings(
        meaning.intervals.values, of_rating, ratings.participant, modulus[fabric], load, scale=model.scale
    )
    drawn = design_figure(grid, response, observed, groups, scale=model.scale)
    suffix = figure.suffix.lstrip(".")
    write_outputs(figure.parent, files_of(drawn, figure.stem, (suffix,)), "check")
