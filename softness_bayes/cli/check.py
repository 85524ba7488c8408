"""`softness-bayes check`: validation of data files, and what was understood of them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from softness_bayes.cli.design import cost_lines, design_lines
from softness_bayes.cli.options import collected, data_files, force, path
from softness_bayes.cli.people import read_or_answer, show_pairs, show_people
from softness_bayes.defaults import MOST_SHOWN
from softness_bayes.errors import InputError
from softness_bayes.model.options import ModelOptions
from softness_bayes.readable import counted

if TYPE_CHECKING:
    from softness_bayes.data import Afferents, Compression, Experiment, Measurements, Ratings
    from softness_bayes.model.interpretation import Interpretation
    from softness_bayes.people.free_means import FreeMeans
    from softness_bayes.results.run_options import DataFiles

CHECK = "check"
"""Command under which the figure is listed in the record of written files."""


@click.command()
@data_files
@collected("model", ModelOptions)
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
@path("--figure", "FILE", "Draw data and fabrics beside the response that the prior predicts (.png, .pdf or .svg).")
@click.option(
    "--guess",
    metavar="RATE",
    help="For pairs with a reference: the rate of guessing, such as 1/3, if the task fixes it; by default an estimate.",
)
@force
def command(
    files: DataFiles,
    model: ModelOptions,
    design: bool,
    cost: bool,
    as_json: bool,
    figure: Path | None,
    guess: str | None,
    force: bool,
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
    """
    from softness_bayes.data import Measurements
    from softness_bayes.model.build import Parts, build
    from softness_bayes.model.reach import reach_of
    from softness_bayes.model.understanding import SCHEMA, foreseen, understood, warnings
    from softness_bayes.people.free_means import free_means

    if cost and as_json:
        raise InputError("check: --cost is printed as text: omit --json")
    if figure is not None:
        _require_figure(figure, files, force)
    experiment = read_or_answer(files, model)
    if experiment is None:
        return
    if isinstance(experiment, Measurements):
        if design or cost or figure is not None:
            raise InputError("check: --design, --cost and --figure need ratings: give --data, or omit them")
        known: dict[str, Any] = {"schema": SCHEMA, **_understood(experiment), "notes": list(experiment.notes)}
        lines = [*_of_measurements(experiment), *(f"note: {note}" for note in known["notes"])]
        click.echo(json.dumps(known, indent=1, ensure_ascii=False) if as_json else "\n".join(lines))
        return
    parts = Parts(experiment, model)
    meaning, reached = parts.interpretation, reach_of(experiment, model)
    notes = [*experiment.notes, *warnings(parts)]
    people = None if model.scale.model is not None else free_means(experiment.ratings, model, meaning)
    known = understood(parts, [*([reached] if reached else []), *notes])
    known["design"] = foreseen(experiment, model) if design else None
    known |= _understood(experiment)
    if as_json:
        click.echo(json.dumps(known | _people(people), indent=1, ensure_ascii=False))
    else:
        if people is not None:
            show_people(people)
            show_pairs(experiment.ratings, [one["e_fab_kpa"] for one in known["fabrics"]], guess)
            click.echo()
        lines = [f"warning: {reached}\n"] if reached else []
        lines += [*_of_tables(known, experiment, model), *(f"note: {note}" for note in notes)]
        lines += ["\nWhat do the numbers say?", known["model"]["numbers"], known["model"]["errors_because"]]
        lines += ["\nDo ratings rise or fall with stiffness?", *known["model"]["direction_because"]]
        lines += ["", *design_lines(known["design"])] if design else []
        lines += ["", *cost_lines(build(experiment, model))] if cost else []
        click.echo("\n".join(lines))
    if figure is not None:
        _draw(figure, experiment, model, meaning)
        click.echo(f"drawn in {figure}", err=True)


def _people(found: FreeMeans | None) -> dict[str, Any]:
    """Return people's own means as JSON, null where they have no limits."""
    if found is None:
        return {}
    table = found.table().astype(object)
    return {"people": table.where(table.notna(), None).to_dict("records")}


def _require_figure(figure: Path, files: DataFiles, force: bool) -> None:
    from softness_bayes.files.outputs import require_outputs
    from softness_bayes.plotting.style import METADATA

    if figure.suffix.lstrip(".") not in METADATA:
        known = ", ".join(f".{name}" for name in METADATA)
        raise InputError(f"--figure {figure}: expected a name that ends in one of {known}")
    require_outputs(figure.parent, [figure.name], CHECK, force, files.paths)


def _draw(figure: Path, experiment: Experiment, model: ModelOptions, meaning: Interpretation) -> None:
    """Draw data and fabrics with the response predicted by draws of the prior."""
    import numpy as np

    from softness_bayes.files.outputs import write_outputs
    from softness_bayes.model.understanding import prior_responses
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
    write_outputs(figure.parent, files_of(drawn, figure.stem, (suffix,)), CHECK)


def _of_tables(known: dict[str, Any], experiment: Experiment, model: ModelOptions) -> Iterator[str]:
    """Yield lines on ratings, participants, fabrics, loads and forces."""
    from softness_bayes.model.reach import wide_contacts

    ratings, fabrics = known["ratings"], known["fabrics"]
    least, greatest, conditions = ratings["least"], ratings["greatest"], known["conditions"]
    moduli = [one["e_fab_kpa"] for one in fabrics]
    paired = experiment.ratings.paired  # a comparison is one answer, in two rows
    each = [one["ratings"] // (1 + paired) for one in known["participants"]]
    given = f"{sum(each)} comparisons of two fabrics" if paired else f"{sum(each)}, from {least:g} to {greatest:g}"
    lines = {
        "ratings": f"{given}; {ratings['missing']} missing",
        "participants": f"{_span(experiment.ratings.participants)}, "
        f"{_extent(each)} {'comparisons' if paired else 'ratings'} each",
        "fabrics": f"{_span(experiment.ratings.fabrics)}, E_fab {min(moduli):.4g} to {max(moduli):.4g} kPa",
        "loads": _loads(experiment.ratings),
        "conditions": f"{conditions['rated']} of {conditions['possible']} pairs of fabric and load; "
        f"{conditions['by_participants']} of {conditions['possible_by_participants']} with each participant",
    }
    if wide := wide_contacts(experiment.ratings.loads, model.finger):
        lines["contact"] = wide
    if model.scale.own_units:
        lines["tau"] = _about_scales(experiment.ratings)
    if conditions["rated"] == 1:
        lines["gamma"] = "one condition: the response does not vary, so skin, receptors and gamma are not identifiable"
    if ratings["count"] > 1 and least == greatest:
        lines["varsigma"] = "all ratings are equal: their spread (varsigma) is not identifiable"
    yield from (f"{name:14}{text}" for name, text in lines.items())
    width = max(map(len, ("fabric", *(one["name"] for one in fabrics))))
    yield f"\n{'fabric':{width}}  E_fab (kPa)  Poisson ratio  ratings  modulus from"
    for one in fabrics:
        low, high = one["e_fab_low_kpa"], one["e_fab_high_kpa"]
        numbers = f"{one['e_fab_kpa']:11.4g}  {one['poisson_ratio']:13g}  {one['ratings']:7}"
        limits = "" if low is None else f"; 90 % limits {low:.3g} to {high:.3g} kPa"
        yield f"{one['name']:{width}}  {numbers}  {one['modulus_from'] or 'nothing (unknown)'}{limits}"
    exact = sum(one["e_fab_low_kpa"] is None for one in fabrics)
    if exact and model.modulus_cv is None:
        yield (
            f"warning: {'the' if exact == len(fabrics) else exact} moduli are given without errors. If measured moduli "
            "are treated as exact, the intervals are too narrow. Add a column effective_modulus_cv (or "
            "thickness_cv, tensile_modulus_cv, bending_rigidity_cv), or give the run --modulus-cv 0.15; use "
            "--modulus-cv 0 if they are exact"
        )
    if others := _of_measurements(experiment):
        yield from ("", *others)


def _about_scales(ratings: Ratings) -> str:
    """Return whether the spread of rating scales can be estimated."""
    from softness_bayes.model.build import raters_told

    if raters_told(ratings) > 1:
        who = "participants" if ratings.cells is None else "raters"
        return f"several {who}: the spread of their rating scales (tau) can be estimated"
    if ratings.cells is not None:
        return "means without standard deviations: the spread of raters' scales (tau) cannot be estimated"
    return "one participant: the spread of rating scales between participants (tau) cannot be estimated"


def _loads(ratings: Ratings) -> str:
    """Return the loads with their numbers of ratings; of many loads of one kind, their number and groups."""
    import numpy as np

    from softness_bayes.data import LOAD_COLUMNS
    from softness_bayes.touch.load_groups import groups_of

    counts, parts = np.bincount(ratings.load).tolist(), []
    for column, kind, _ in LOAD_COLUMNS:
        some = [(str(load), count) for load, count in zip(ratings.loads, counts, strict=True) if isinstance(load, kind)]
        if len(some) > MOST_SHOWN:
            total = counted(sum(count for _, count in some), "rating")
            parts.append(f"{len(some)} different {column.label}s, {some[0][0]} to {some[-1][0]} ({total})")
        else:
            parts += [f"{load} ({counted(count, 'rating')})" for load, count in some]
    groups = groups_of(ratings.loads)
    if groups.merged:
        sizes = np.bincount(groups.of[ratings.load]).tolist()
        each = ", ".join(f"{name} ({size})" for name, size in zip(groups.names, sizes, strict=True))
        parts.append(f"used as measured; shown and checked in {len(sizes)} groups: {each}")
    return ", ".join(parts)


def _understood(data: Experiment | Measurements) -> dict[str, Any]:
    """Return the interpretation of forces and recorded afferents as JSON data, where there are any."""
    from softness_bayes.model.understanding import understood_afferents, understood_forces

    forces = {} if data.compression is None else {"forces": understood_forces(data.compression)}
    return forces if data.afferents is None else {**forces, "afferents": understood_afferents(data.afferents)}


def _of_measurements(data: Experiment | Measurements) -> list[str]:
    """Return lines on forces and recorded afferents, where there are any."""
    lines = [] if data.compression is None else _of_forces(data.compression)
    return lines if data.afferents is None else [*lines, *_of_afferents(data.afferents)]


def _of_afferents(data: Afferents) -> list[str]:
    """Return lines on recorded afferents: responses, probes, distances and loads."""
    from softness_bayes.model.understanding import understood_afferents

    known = understood_afferents(data)
    low, high = known["least_rate_hz"], known["greatest_rate_hz"]
    who = f"{_span(data.names)} named" if data.names else "none named: every row is a mean of several"
    return [
        f"afferents     {who}{''.join(f'; {name}' for name in data.species)}",
        f"responses     {known['rates']} rates and {known['counts']} counts, {low:.3g} to {high:.3g} Hz",
        f"probes        curvature {known['least_curvature_per_m']:g} to {known['greatest_curvature_per_m']:g} /m "
        f"(0 is flat), {known['least_distance_mm']:g} to {known['greatest_distance_mm']:g} mm from the contact's axis",
        f"probed at     {_span(known['loads'])}",
    ]


def _of_forces(compression: Compression) -> list[str]:
    """Return lines on compression data: forces, fingers and indentations."""
    import numpy as np

    depth, force = compression.indentation * 1e3, compression.force
    zeros, each = counted(compression.n_zero, "row"), _extent(np.bincount(compression.participant).tolist())
    return [
        f"forces        {len(compression)}, from {force.min():.3g} to {force.max():.3g} N; {zeros} with a force of 0 "
        "left out",
        f"fingers       {_span(compression.participants)}, {each} forces each",
        f"indentations  {depth.min():.3g} to {depth.max():.3g} mm",
    ]


def _span(names: Sequence[str]) -> str:
    """Return the number of names, and the first and last of them."""
    return f"{len(names)} ({' … '.join(dict.fromkeys((names[0], names[-1])))})"


def _extent(counts: list[int]) -> str:
    """Return the range of some counts as text."""
    return " to ".join(dict.fromkeys((str(min(counts)), str(max(counts)))))
