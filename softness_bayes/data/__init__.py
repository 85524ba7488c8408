"""Reading of ratings and fabrics from tables, with checks and conversion to SI units, and writing of tables."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from softness_bayes.data.columns import (
    FORCE,
    GEOMETRIC_MEAN,
    GEOMETRIC_SD,
    INDENTATION,
    LOAD_CV,
    MISSING,
    MODULUS_SOURCES,
    RATERS,
    RATING,
    RESOLUTION,
    THICKNESS,
)
from softness_bayes.data.compression import Compression
from softness_bayes.data.fabrics import USUAL_POISSON_RATIO, Fabrics
from softness_bayes.data.faults import TableError, identity, listing, together
from softness_bayes.data.formats import TableSource, has_sheet
from softness_bayes.data.headers import FABRICS, LOADED, PRESSED, RATED, either
from softness_bayes.data.ratings import LOAD_COLUMNS, Ratings, loads_of, with_drift, with_rounded_loads
from softness_bayes.data.reading import check_renames, read_table, with_hints
from softness_bayes.data.shapes import Form
from softness_bayes.data.tables import Marks, Table
from softness_bayes.files.outputs import write_outputs
from softness_bayes.files.spreadsheet import escaped
from softness_bayes.ranges import require_mapping

Read = TypeVar("Read")

__all__ = [
    "LOAD_COLUMNS",
    "USUAL_POISSON_RATIO",
    "Compression",
    "Experiment",
    "Fabrics",
    "Ratings",
    "compression_csv",
    "fabrics_csv",
    "loads_of",
    "ratings_csv",
    "read_answers",
    "read_experiment",
    "write_compression",
    "write_fabrics",
    "write_ratings",
]

SIMULATE, TRUTH = "simulate", "truth.json"
"""The command under which tables written here are listed, and the file of the truth that it writes beside them."""

FABRICS_BESIDE = "fabrics.csv"
"""Name of a fabric table beside the ratings that is used by default."""


class Experiment(NamedTuple):
    """Ratings and their fabrics, in the order of `ratings.fabrics`."""

    ratings: Ratings
    fabrics: Fabrics
    notes: tuple[str, ...]
    """Assumptions, omissions and findings made while reading."""
    compression: Compression | None = None
    """Rigid-plate forces on fingerpads, possibly of other people."""


def read_experiment(
    ratings_path: TableSource,
    fabrics_path: TableSource | None = None,
    *,
    columns: Mapping[str, str] | None = None,
    indentation_mm: float | None = None,
    force_n: float | None = None,
    compression_path: TableSource | None = None,
    decimal: Marks = None,
    drop_zeros: bool = False,
    wide: bool = False,
    round_load: float | None = None,
    drift: bool = False,
) -> Experiment:
    """Read ratings and their fabrics.

    The fabrics are read from `fabrics_path`, from columns of the ratings table itself, from another sheet of its
    workbook, or from a `fabrics.csv` next to it. Only rated fabrics are kept, in the order of their table (sorted by
    name if that is the table of ratings).

    Parameters
    ----------
    ratings_path, fabrics_path
        Text files, Excel workbooks, Parquet files, or DataFrames; their columns are those of `Ratings.read` and
        `Fabrics.read`.
    columns
        Names of columns in the files, by standard name, where they differ.
    indentation_mm, force_n
        The load of every row [mm] or [N], if the table of ratings has no column for it.
    compression_path
        Table of compression data, whose columns are those of `Compression.read`.
    decimal
        Decimal mark of all files, "," or ".", or marks by table, such as {"fabrics": ","}, for ratings, fabrics and
        compression. By default it is inferred from each file; an ambiguous file raises an error.
    drop_zeros
        Whether to leave out ratings of 0.
    wide
        Whether the table of ratings has one column for each fabric, or for each fabric under each load. By default this
        is inferred from the titles.
    round_load
        Step to which loads are rounded, in N and mm; by default loads are used as measured.
    drift
        Whether the scale of a rater may differ between sessions or, without a column of these, quarters of the trials.

    Raises
    ------
    InputError
        Naming file, row, column and value.
    """
    require_mapping("columns", columns or {}, "{'rating': 'softness'}")
    return with_hints(
        lambda renames, wide: _experiment(
            ratings_path,
            fabrics_path,
            renames,
            indentation_mm,
            force_n,
            compression_path,
            decimal,
            drop_zeros,
            wide,
            round_load,
            drift,
        ),
        columns or {},
        wide,
    )


def _experiment(
    ratings_path: TableSource,
    fabrics_path: TableSource | None,
    columns: Mapping[str, str],
    indentation_mm: float | None,
    force_n: float | None,
    compression_path: TableSource | None,
    decimal: Marks,
    drop_zeros: bool,
    wide: bool,
    round_load: float | None,
    drift: bool,
) -> Experiment:
    """Read ratings and their fabrics, as `read_experiment` describes."""
    source, place = _separate_fabrics(ratings_path, fabrics_path, columns)
    sought = RATED if indentation_mm is force_n is None else LOADED
    sought = either(sought, FABRICS) if source is None else sought
    described = None if source is None else cache(partial(read_table, source, FABRICS, columns, decimal))
    form = Form(wide) if described is None else Form(wide, lambda: described().labels("fabric"))
    table = read_table(ratings_path, sought, columns, decimal, form)
    notes: list[str] = []
    fabric_table, own = table, [column.name for column in MODULUS_SOURCES if column.name in table]
    if described is not None and not (own and fabrics_path is None):
        fabric_table = described()
        if own:
            notes.append(
                f"{table.label}: {listing(own)} not used, because properties of fabrics are read from "
                f"{fabric_table.place}"
            )
        elif place:
            notes.append(f"properties of fabrics are read from {fabric_table.place}, found {place}")
    elif not own:
        table.faults.add_general(
            f"the fabrics have no properties: name their table with --fabrics, put a {FABRICS_BESIDE} in the "
            "folder of the ratings, or add to the ratings a column "
            f"{', '.join(column.name for column in MODULUS_SOURCES)} (the last with {THICKNESS.name}); "
            "what people said of them needs no properties: 'softness-bayes check' shows it"
        )
    plate_table = None if compression_path is None else read_table(compression_path, PRESSED, columns, decimal)
    check_renames(columns, table, fabric_table, *([] if plate_table is None else [plate_table]))
    faults: list[TableError] = []
    compression = None if plate_table is None else _tried(faults, partial(Compression.from_table, plate_table))
    fabrics = None
    if own or fabric_table is not table:
        fabrics = _tried(faults, partial(Fabrics.from_table, fabric_table, repeated=fabric_table is table))
    cloth = fabrics or _unmeasured(fabric_table)
    ratings = _tried(faults, partial(Ratings.from_table, table, cloth, indentation_mm, force_n, drop_zeros))
    if faults or fabrics is None or ratings is None:
        raise together(faults)
    if round_load is not None:
        ratings = with_rounded_loads(ratings, round_load)
    ratings = with_drift(ratings) if drift else ratings
    rated = set(ratings.fabrics)
    unrated = [name for name in fabrics.names if name not in rated]
    if unrated:
        notes.append(f"fabrics without a rating, left out: {listing(unrated)}")
    if isinstance(ratings_path, (str, Path)) and _is_simulated(Path(ratings_path), ratings.digest):
        ratings = replace(ratings, simulated=True)
    if compression is not None:
        compression = _with_names_of(compression, ratings.participants)
        notes += compression.notes
    return Experiment(
        ratings,
        fabrics.take(ratings.fabrics),
        tuple(dict.fromkeys((*ratings.notes, *fabrics.notes, *notes))),
        compression,
    )


def read_answers(
    ratings_path: TableSource,
    fabrics_path: TableSource | None = None,
    *,
    columns: Mapping[str, str] | None = None,
    indentation_mm: float | None = None,
    force_n: float | None = None,
    decimal: Marks = None,
    drop_zeros: bool = False,
    wide: bool = False,
    drift: bool = False,
) -> Ratings | None:
    """Read ratings of fabrics of which nothing was measured, under loads that may be unknown.

    Parameters are those of `read_experiment`. None is returned if the modulus of a fabric is known.

    Raises
    ------
    InputError
        Naming file, row, column and value.
    """
    columns = columns or {}
    source, _ = _separate_fabrics(ratings_path, fabrics_path, columns)
    sought = either(RATED if indentation_mm is force_n is None else LOADED, FABRICS)
    table = read_table(ratings_path, sought, columns, decimal, Form(wide))
    described = table if source is None else read_table(source, FABRICS, columns, decimal)
    known = (text for column in MODULUS_SOURCES for text in described.cells.get(column.name, ()))
    if any(text.casefold() not in MISSING for text in known):
        return None
    ratings = Ratings.from_table(table, None, indentation_mm, force_n, drop_zeros, loads_needed=False)
    return with_drift(ratings) if drift else ratings


def _with_names_of(compression: Compression, raters: Sequence[str]) -> Compression:
    """Return compression data in which names are spelt as in the ratings, such as P01 for P1, with a note."""
    people = {identity(name): name for name in raters}
    names = tuple(people.get(identity(name), name) for name in compression.participants)
    changed = [f"{a!a} as {b!a}" for a, b in zip(compression.participants, names, strict=True) if a != b]
    if not changed or len({*names}) < len(names):
        return compression
    note = f"{compression.source}: participants are named as in the ratings: {listing(changed)}"
    return replace(compression, participants=names, notes=(*compression.notes, note))


def _tried(faults: list[TableError], read: Callable[[], Read]) -> Read | None:
    """Return the result of reading, or None after adding the faults of the table to the list."""
    try:
        return read()
    except TableError as error:
        faults.append(error)
        return None


def _unmeasured(table: Table) -> Fabrics | None:
    """Return the fabrics of a table with names only and placeholder moduli; None if it has no fabrics."""
    names = tuple(dict.fromkeys(table.cells.get("fabric", ())))
    return Fabrics(names, effective_modulus=np.ones(len(names)), source=table.place) if names else None


def _is_simulated(path: Path, digest: str) -> bool:
    """Return whether ratings are those of the example, or have the truth beside them that `simulate` writes."""
    example = files("softness_bayes") / "example" / "ratings.csv"
    return path.with_name(TRUTH).is_file() or digest == sha256(example.read_bytes()).hexdigest()


def _separate_fabrics(
    ratings: TableSource, fabrics: TableSource | None, columns: Mapping[str, str]
) -> tuple[TableSource | None, str]:
    """Return the table of fabrics apart from that of the ratings, and where it was found unless the user named it.

    It is the given one, another sheet of the ratings' workbook, or a file next to theirs.
    """
    if fabrics is not None or not isinstance(ratings, (str, Path)):
        return fabrics, ""
    if has_sheet(ratings, FABRICS, columns):
        return ratings, "in the workbook of the ratings"
    beside = Path(ratings).parent / FABRICS_BESIDE
    return (beside, "beside the ratings") if os.path.isfile(beside) else (None, "")


def fabrics_csv(fabrics: Fabrics) -> str:
    """Return a fabric table from which exactly the same values are read."""
    return _csv({"fabric": fabrics.names, **fabrics.cells()})


def ratings_csv(ratings: Ratings, fabrics: Fabrics | None = None) -> str:
    """Return a table of ratings from which exactly the same values are read, with the columns of `fabrics` if given."""
    touches = [ratings.loads[i] for i in ratings.load]
    names = [ratings.fabrics[i] for i in ratings.fabric]
    columns: dict[str, Sequence[str]] = {
        "participant": [ratings.participants[i] for i in ratings.participant],
        "fabric": names,
    }
    for column, kind, value in LOAD_COLUMNS:
        filled = [column.write(value(load)) if isinstance(load, kind) else "" for load in touches]
        if any(filled):
            columns[column.name] = filled
    if ratings.load_cv is not None:
        columns[LOAD_CV.name] = [LOAD_CV.write(value) for value in ratings.load_cv]
    if ratings.resolution is not None:
        columns[RESOLUTION.name] = [RESOLUTION.write(value) for value in ratings.resolution]
    if ratings.lists is not None:
        columns["list"] = [str(number + 1) for number in ratings.lists]
    column = RATING if ratings.cells is None else GEOMETRIC_MEAN
    columns[column.name] = [RATING.write(value) for value in ratings.rating]
    if ratings.cells is not None:
        if ratings.cells.geometric_sd is not None:
            columns[GEOMETRIC_SD.name] = [GEOMETRIC_SD.write(value) for value in ratings.cells.geometric_sd]
        columns[RATERS.name] = [str(ratings.cells.raters)] * len(ratings)
    columns |= {name: [own[i] for i in ratings.participant] for name, own in ratings.covariates.items()}
    if fabrics is not None:
        places = {name: i for i, name in enumerate(fabrics.names)}
        place = [places[name] for name in names]
        columns |= {name: [texts[i] for i in place] for name, texts in fabrics.cells().items()}
    return _csv(columns)


def compression_csv(compression: Compression) -> str:
    """Return a table of compression data from which exactly the same values are read."""
    columns = {
        "participant": [compression.participants[i] for i in compression.participant],
        INDENTATION.name: [INDENTATION.write(value) for value in compression.indentation],
        FORCE.name: [FORCE.write(value) for value in compression.force],
    }
    return _csv(columns)


def write_fabrics(path: str | Path, fabrics: Fabrics) -> None:
    """Write `fabrics_csv` to a file, as `write_ratings` does."""
    _write(path, fabrics_csv(fabrics))


def write_ratings(path: str | Path, ratings: Ratings, fabrics: Fabrics | None = None) -> None:
    """Write `ratings_csv` to a file atomically, replacing only files written by these functions.

    Raises
    ------
    InputError
        If another file is in the way, or one that was changed since it was written.
    """
    _write(path, ratings_csv(ratings, fabrics))


def write_compression(path: str | Path, compression: Compression) -> None:
    """Write `compression_csv` to a file, as `write_ratings` does."""
    _write(path, compression_csv(compression))


def _write(path: str | Path, text: str) -> None:
    path = Path(path)
    write_outputs(path.parent, {path.name: text}, SIMULATE)


def _csv(columns: Mapping[str, Sequence[str]]) -> str:
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(map(escaped, columns))
    writer.writerows([map(escaped, row) for row in zip(*columns.values(), strict=True)])
    return text.getvalue()
