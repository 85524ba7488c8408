"""`softness-bayes check`: validation of data files, and what was understood of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from softness_bayes.cli.options.model import ReadingChoice, categories, rating_scale, readings, slider
from softness_bayes.cli.options.tables import DataFiles, data_files

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from softness_bayes.data import Compression, Experiment, Ratings
    from softness_bayes.parameters.fabric_moduli import FabricModuli

MOST_LOADS = 12
"""Largest number of loads of a kind that are listed one by one."""


@click.command()
@data_files
@rating_scale
@slider
@categories
@readings
def command(
    files: DataFiles,
    scale: str,
    slider_ends: tuple[float, float],
    n_categories: int | None,
    choice: ReadingChoice,
) -> None:
    """Validate data files and say what was understood.

    Ratings are one row each: participant, fabric, rating, and indentation_mm or force_n; trial if there are
    any. Fabrics are one row each, in their own table, or columns of the ratings: fabric, and
    effective_modulus_kpa, or bending_rigidity_n_m, or tensile_modulus_mpa and thickness_mm; poisson_ratio
    where known. Compression data are one row per force of a rigid flat plate: participant, indentation_mm,
    force_n; indentor, if other rows are to be left out. Errors name file, row, column and value. E_fab is
    shown in the reading that is asked for. With ratings it is also said whether they rise or fall with stiffness.
    """
    import numpy as np

    from softness_bayes.data import Compression
    from softness_bayes.likelihood.scales import RATING_SCALES
    from softness_bayes.model.as_given import as_given
    from softness_bayes.model.build import choose_direction
    from softness_bayes.model.fabric_moduli import fabric_moduli
    from softness_bayes.model.options import ModelOptions

    fabric_modulus = choice.resolve().fabric_modulus
    experiment = files.read()
    if isinstance(experiment, Compression):
        _show_compression(experiment)
        for note in experiment.notes:
            click.echo(f"note: {note}")
        return
    moduli = fabric_moduli(experiment.fabrics, fabric_modulus)
    modulus = np.array(moduli.middle) / 1e3
    for line in (
        *_summary(experiment, modulus, RATING_SCALES[scale].own_units),
        "",
        *_fabric_table(experiment, moduli),
    ):
        click.echo(line)
    if exact := len(moduli.laws) - len(moduli.uncertain):
        click.echo(
            f"warning: {'the' if moduli.known else exact} moduli are given without errors. A run that takes measured "
            "moduli as exact has intervals that are too narrow. Add a column effective_modulus_cv (or thickness_cv, "
            "tensile_modulus_cv, bending_rigidity_cv), or give the run --modulus-cv 0.15; --modulus-cv 0 says that "
            "they are exact"
        )
    if experiment.compression is not None:
        click.echo()
        _show_compression(experiment.compression)
    for note in experiment.notes:
        click.echo(f"note: {note}")
    ratings = experiment.ratings
    readings, of_scale = choice.resolve(), RATING_SCALES[scale]
    asked = ModelOptions(readings=readings, scale=of_scale, slider_ends=slider_ends, n_categories=n_categories)
    given = as_given(ratings, asked)
    click.echo(f"\nWhat do the numbers say?\n{given.note}\n{given.errors_note}")
    click.echo("\nDo ratings rise or fall with stiffness?")
    for line in choose_direction(experiment, asked).evidence.lines:
        click.echo(line)


def _show_compression(compression: Compression) -> None:
    """Print whose fingers were pressed, how deep and how hard."""
    import numpy as np

    lines = {
        "forces": f"{len(compression)}, from {compression.force.min():.3g} to {compression.force.max():.3g} N; "
        f"{compression.n_zero} rows with a force of 0 left out",
        "fingers": f"{_span(compression.participants)}, {_extent(np.bincount(compression.participant))} forces each",
        "indentations": f"{compression.indentation.min() * 1e3:.3g} to {compression.indentation.max() * 1e3:.3g} mm",
    }
    for name, text in lines.items():
        click.echo(f"{name:14}{text}")


def _summary(experiment: Experiment, modulus: NDArray[np.float64], own_units: bool) -> list[str]:
    """Return lines that say who rated what, under which loads; moduli in kPa, scales of the raters' own or not."""
    import numpy as np

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
    if own_units:
        lines["tau"] = (
            "several participants: the spread of their rating scales (tau) can be estimated"
            if len(ratings.participants) > 1
            else "one participant: the spread of rating scales between participants (tau) cannot be estimated"
        )
    if len(conditions.fabric) == 1:
        lines["gamma"] = "one condition: the response does not vary, so skin, receptors and gamma are not identifiable"
    if len(ratings) > 1 and ratings.rating.min() == ratings.rating.max():
        lines["varsigma"] = "all ratings are the same: their spread (varsigma) is not identifiable"
    return [f"{name:14}{text}" for name, text in lines.items()]


def _loads(ratings: Ratings) -> str:
    """Return the loads and their numbers of ratings; of many of a kind, how many there are and how large."""
    import numpy as np

    from softness_bayes.data import LOAD_COLUMNS

    counts, parts = np.bincount(ratings.load), []
    for column, kind, _ in LOAD_COLUMNS:
        own = [i for i, load in enumerate(ratings.loads) if isinstance(load, kind)]
        if len(own) > MOST_LOADS:
            first, last = ratings.loads[own[0]], ratings.loads[own[-1]]
            parts.append(f"{len(own)} different {column.label}s, {first} to {last} ({counts[own].sum()} ratings)")
        else:
            parts += [f"{ratings.loads[i]} ({counts[i]} ratings)" for i in own]
    return ", ".join(parts)


def _fabric_table(experiment: Experiment, moduli: FabricModuli) -> list[str]:
    """Return a table of the fabrics: modulus, its 90 % limits, what it is from, Poisson ratio, number of ratings."""
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
        source = basis or "nothing: it is unknown"
        lines.append(f"{name:{width}}  {modulus / 1e3:11.4g}  {poisson:13g}  {count:7}  {source}{limits}")
    return lines


def _span(names: tuple[str, ...]) -> str:
    """Return the number of names, and the first and last of them."""
    return f"{len(names)} ({' … '.join(dict.fromkeys((names[0], names[-1])))})"


def _extent(counts: NDArray[np.intp]) -> str:
    """Return the least and the greatest of some counts."""
    return " to ".join(dict.fromkeys((str(counts.min()), str(counts.max()))))
