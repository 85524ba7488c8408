"""`softness-bayes check`: validation of data files, and what was understood of them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from softness_bayes.cli.design import cost_lines, design_lines
from softness_bayes.cli.options import FILE, collected, data_files, flagged, force
from softness_bayes.defaults import MOST_SHOWN
from softness_bayes.errors import InputError
from softness_bayes.model.options import ModelOptions
from softness_bayes.readable import counted

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from softness_bayes.data import Compression, Experiment, Ratings
    from softness_bayes.model.direction import DirectionChoice
    from softness_bayes.model.interpretation import Interpretation
    from softness_bayes.parameters.space import FabricModuli
    from softness_bayes.results.run_options import DataFiles

CHECK = "check"
"""Command under which the figure is listed in the record of written files."""

PRIOR_DRAWS = 200
"""Number of prior draws for the bands of the response."""


@click.command()
@data_files
@collected("model", ModelOptions, *flagged(ModelOptions))
@click.option(
    "--design",
    is_flag=True,
    help="Predict how precise the design is: expected posterior widths, and the changes that would help most.",
)
@click.option(
    "--cost",
    is_flag=True,
    help="Show how 'sample' would evaluate the model with the same options: stages, nodes, errors and cost.",
)
@click.option("--json", "as_json", is_flag=True, help="Print all of it as JSON instead of text.")
@click.option(
    "--figure",
    type=FILE,
    metavar="FILE",
    help="Draw data and fabrics beside the response that the prior predicts (.png, .pdf or .svg).",
)
@force
def command(
    files: DataFiles, model: ModelOptions, design: bool, cost: bool, as_json: bool, figure: Path | None, force: bool
) -> None:
    """Validate data files and show how they are read, how precise the design is and what a run costs.

    The table of ratings has one row per rating: participant, fabric, rating, and indentation_mm or force_n; trial, if
    any. Fabrics have one row each in a separate table, or are columns of the ratings: fabric, and
    effective_modulus_kpa, or bending_rigidity_n_m, or tensile_modulus_mpa and thickness_mm; poisson_ratio where
    known. Compression data have one row per force of a rigid flat plate: participant, indentation_mm, force_n;
    indentor, if the rows of other indentors are to be left out. Errors name file, row, column and value. E_fab is
    shown under the chosen reading. For ratings, `check` also reports whether they rise or fall with stiffness. With
    --design it predicts in some seconds, before any sampling, how precisely every parameter will be known.

    With --cost, errors are the largest over draws of the prior and conditions: of the response, relative to the peak
    of each draw, and of log(N/N_ref + eps). Costs are the time per parameter vector in batches of 64, measured on this
    machine.
    """
    from softness_bayes.data import Compression
    from softness_bayes.model.build import build, choose_direction
    from softness_bayes.model.interpretation import interpret
    from softness_bayes.model.reach import reach_of
    from softness_bayes.model.understanding import foreseen, understood, warnings

    if cost and as_json:
        raise InputError("check: --cost is printed as text: omit --json")
    if figure is not None:
        _require_figure(figure, files, force)
    experiment = files.read()
    if isinstance(experiment, Compression):
        _forces_alone(experiment, design or cost or figure is not None, as_json)
        return
    reached = reach_of(experiment, model)
    if not as_json:
        if reached:
            click.echo(f"warning: {reached}\n")
        _show_tables(experiment, model)
    meaning = interpret(experiment.ratings, model)
    found = warnings(experiment, model, meaning)
    noted = [*experiment.notes, *([reached] if reached else []), *found]
    direction = choose_direction(experiment, model, meaning)
    expected = foreseen(experiment, model) if design else None
    if as_json:
        every = understood(experiment, model, meaning, direction, noted)
        click.echo(json.dumps(every | {"design": expected}, indent=1, ensure_ascii=False))
    else:
        _show_model(meaning, direction, found)
        for line in [] if expected is None else ["", *design_lines(expected)]:
            click.echo(line)
        for line in ["", *cost_lines(build(experiment, model))] if cost else []:
            click.echo(line)
    if figure is not None:
        _draw(figure, experiment, model, meaning)
        click.echo(f"drawn in {figure}", err=True)


def _show_tables(experiment: Experiment, model: ModelOptions) -> None:
    """Print a description of the data: ratings, fabrics, forces and notes."""
    import numpy as np

    from softness_bayes.model.build import moduli_of

    moduli = moduli_of(experiment, model)
    modulus = np.array(moduli.middle) / 1e3
    for line in (*_summary(experiment, modulus, model), "", *_fabric_table(experiment, moduli)):
        click.echo(line)
    exact = len(moduli.laws) - len(moduli.uncertain)
    if exact and model.modulus_cv is None:
        click.echo(
            f"warning: {'the' if moduli.known else exact} moduli are given without errors. If measured moduli "
            "are treated as exact, the intervals are too narrow. Add a column effective_modulus_cv (or "
            "thickness_cv, tensile_modulus_cv, bending_rigidity_cv), or give the run --modulus-cv 0.15; use "
            "--modulus-cv 0 if they are exact"
        )
    if experiment.compression is not None:
        click.echo()
        _show_compression(experiment.compression)
    for note in experiment.notes:
        click.echo(f"note: {note}")


def _show_model(meaning: Interpretation, direction: DirectionChoice, found: list[str]) -> None:
    """Print warnings, and the meaning and direction of the ratings."""
    for note in found:
        click.echo(f"note: {note}")
    click.echo(f"\nWhat do the numbers say?\n{meaning.note}\n{meaning.errors_note}")
    click.echo("\nDo ratings rise or fall with stiffness?")
    for line in direction.evidence.lines:
        click.echo(line)


def _forces_alone(compression: Compression, more: bool, as_json: bool) -> None:
    """Print what was read of compression data alone."""
    from softness_bayes.model.understanding import SCHEMA, understood_forces

    if more:
        raise InputError("check: --design, --cost and --figure need ratings: give --data, or omit them")
    if as_json:
        known = {"schema": SCHEMA, "forces": understood_forces(compression), "notes": list(compression.notes)}
        click.echo(json.dumps(known, indent=1, ensure_ascii=False))
        return
    _show_compression(compression)
    for note in compression.notes:
        click.echo(f"note: {note}")


def _require_figure(figure: Path, files: DataFiles, force: bool) -> None:
    from softness_bayes.files.outputs import require_outputs
    from softness_bayes.plotting.style import METADATA

    if figure.suffix.lstrip(".") not in METADATA:
        known = ", ".join(f".{name}" for name in METADATA)
        raise InputError(f"--figure {figure}: expected a name that ends in one of {known}")
    require_outputs(figure.parent, [figure.name], CHECK, force, files.paths)


def _draw(figure: Path, experiment: Experiment, model: ModelOptions, meaning: Interpretation) -> None:
    """Draw data and fabrics with the response predicted by the prior."""
    import numpy as np

    from softness_bayes.files.outputs import write_outputs
    from softness_bayes.model.understanding import prior_responses
    from softness_bayes.plotting.rating import design_figure, observed_ratings
    from softness_bayes.plotting.style import files_of
    from softness_bayes.touch.load_groups import groups_of

    ratings = experiment.ratings
    groups = groups_of(ratings.loads)
    grid, response, modulus = prior_responses(experiment, model, groups.at.tolist(), PRIOR_DRAWS)
    pairs, of_rating = np.unique(groups.of[ratings.load] * len(ratings.fabrics) + ratings.fabric, return_inverse=True)
    load, fabric = np.divmod(pairs, len(ratings.fabrics))
    observed = observed_ratings(
        meaning.intervals.values, of_rating, ratings.participant, modulus[fabric], load, scale=model.scale
    )
    drawn = design_figure(grid, response, observed, groups, scale=model.scale)
    suffix = figure.suffix.lstrip(".")
    write_outputs(figure.parent, files_of(drawn, figure.stem, (suffix,)), CHECK)


def _show_compression(compression: Compression) -> None:
    """Print the fingers of the compression data, with ranges of indentation and force."""
    import numpy as np

    lines = {
        "forces": f"{len(compression)}, from {compression.force.min():.3g} to {compression.force.max():.3g} N; "
        f"{counted(compression.n_zero, 'row')} with a force of 0 left out",
        "fingers": f"{_span(compression.participants)}, {_extent(np.bincount(compression.participant))} forces each",
        "indentations": f"{compression.indentation.min() * 1e3:.3g} to {compression.indentation.max() * 1e3:.3g} mm",
    }
    for name, text in lines.items():
        click.echo(f"{name:14}{text}")


def _summary(experiment: Experiment, modulus: NDArray[np.float64], model: ModelOptions) -> list[str]:
    """Return lines on participants, fabrics (moduli in kPa), loads and the rating scale."""
    import numpy as np

    from softness_bayes.model.build import raters_told
    from softness_bayes.model.reach import wide_contacts

    ratings = experiment.ratings
    each = np.bincount(ratings.participant)
    conditions = ratings.conditions
    pairs = len(ratings.fabrics) * len(ratings.loads)
    rated = len(set(zip(ratings.participant.tolist(), conditions.of_rating.tolist(), strict=True)))
    lines = {
        "ratings": f"{len(ratings)}, from {ratings.rating.min():g} to {ratings.rating.max():g}; "
        f"{ratings.n_missing} missing",
        "participants": f"{_span(ratings.participants)}, {_extent(each)} ratings each",
        "fabrics": f"{_span(ratings.fabrics)}, E_fab {modulus.min():.4g} to {modulus.max():.4g} kPa",
        "loads": _loads(ratings),
        "conditions": f"{len(conditions.fabric)} of {pairs} pairs of fabric and load; "
        f"{rated} of {len(ratings.participants) * pairs} with each participant",
    }
    if wide := wide_contacts(ratings.loads, model.finger):
        lines["contact"] = wide
    if model.scale.own_units:
        raters = raters_told(ratings)
        lines["tau"] = (
            f"several {'participants' if ratings.cells is None else 'raters'}: the spread of their rating scales (tau) "
            "can be estimated"
            if raters > 1
            else "means without standard deviations: the spread of raters' scales (tau) cannot be estimated"
            if ratings.cells is not None
            else "one participant: the spread of rating scales between participants (tau) cannot be estimated"
        )
    if len(conditions.fabric) == 1:
        lines["gamma"] = "one condition: the response does not vary, so skin, receptors and gamma are not identifiable"
    if len(ratings) > 1 and ratings.rating.min() == ratings.rating.max():
        lines["varsigma"] = "all ratings are equal: their spread (varsigma) is not identifiable"
    return [f"{name:14}{text}" for name, text in lines.items()]


def _loads(ratings: Ratings) -> str:
    """Return the loads with their numbers of ratings; of many loads of one kind, their number and groups."""
    import numpy as np

    from softness_bayes.data import LOAD_COLUMNS
    from softness_bayes.touch.load_groups import groups_of

    counts, parts = np.bincount(ratings.load), []
    for column, kind, _ in LOAD_COLUMNS:
        own = [i for i, load in enumerate(ratings.loads) if isinstance(load, kind)]
        if len(own) > MOST_SHOWN:
            first, last = ratings.loads[own[0]], ratings.loads[own[-1]]
            parts.append(
                f"{len(own)} different {column.label}s, {first} to {last} ({counted(int(counts[own].sum()), 'rating')})"
            )
        else:
            parts += [f"{ratings.loads[i]} ({counted(int(counts[i]), 'rating')})" for i in own]
    groups = groups_of(ratings.loads)
    if groups.merged:
        sizes = np.bincount(groups.of[ratings.load]).tolist()
        each = ", ".join(f"{name} ({size})" for name, size in zip(groups.names, sizes, strict=True))
        parts.append(f"used as measured; shown and checked in {len(sizes)} groups: {each}")
    return ", ".join(parts)


def _fabric_table(experiment: Experiment, moduli: FabricModuli) -> list[str]:
    """Return a table of the fabrics: modulus, its 90 % limits, its source, Poisson ratio, number of ratings."""
    import numpy as np

    ratings, fabrics = experiment.ratings, experiment.fabrics
    width = max(map(len, ("fabric", *fabrics.names)))
    lines = [f"{'fabric':{width}}  E_fab (kPa)  Poisson ratio  ratings  modulus from"]
    for name, modulus, law, poisson, count, basis in zip(
        fabrics.names,
        moduli.middle,
        moduli.laws,
        fabrics.poisson_ratio,
        np.bincount(ratings.fabric),
        fabrics.basis,
        strict=True,
    ):
        limits = "" if law is None else "; 90 % limits {:.3g} to {:.3g} kPa".format(*law.quantile([0.05, 0.95]))
        source = basis or "nothing (unknown)"
        lines.append(f"{name:{width}}  {modulus / 1e3:11.4g}  {poisson:13g}  {count:7}  {source}{limits}")
    return lines


def _span(names: tuple[str, ...]) -> str:
    """Return the number of names, and the first and last of them."""
    return f"{len(names)} ({' … '.join(dict.fromkeys((names[0], names[-1])))})"


def _extent(counts: NDArray[np.intp]) -> str:
    """Return the range of some counts as text."""
    return " to ".join(dict.fromkeys((str(counts.min()), str(counts.max()))))
