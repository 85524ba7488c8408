"""Reading of ratings and fabrics from tables, with checks and conversion to SI units, and writing of tables."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

import numpy as np

from softness_bayes.base.errors import InputError
from softness_bayes.base.files.spreadsheet import csv_of
from softness_bayes.base.ranges import require_kind, require_mapping
from softness_bayes.data.columns import (
    AFFERENTS,
    FABRICS,
    FORCE,
    FORCES_OF_A_PLATE,
    INDENTATION,
    LOADED,
    MODULUS_SOURCES,
    NUMBERS,
    RATINGS,
    Kind,
    Request,
)
from softness_bayes.data.fabrics import USUAL_POISSON_RATIO, Fabrics
from softness_bayes.data.measurements import Afferents, Compression
from softness_bayes.data.ratings import LOAD_COLUMNS, Ratings, loads_by_column, loads_of, with_drift, with_rounded_loads
from softness_bayes.data.reading import check_renames, has_sheet, read_table
from softness_bayes.data.sheets import TableSource
from softness_bayes.data.tables import FloatArray, Table, grouped
from softness_bayes.data.texts import Marks, identity, is_missing, listing

__all__ = [
    "LOAD_COLUMNS",
    "USUAL_POISSON_RATIO",
    "Afferents",
    "Compression",
    "Experiment",
    "Fabrics",
    "Measurements",
    "Ratings",
    "compression_csv",
    "fabrics_csv",
    "loads_of",
    "ratings_csv",
    "read_answers",
    "read_experiment",
    "read_measurements",
]

SIMULATE, TRUTH = "simulate", "truth.json"
"""The command that writes simulated tables, and the file of the truth that it writes beside them."""

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
    afferents: Afferents | None = None
    """Firing recorded from afferents, possibly of another species."""


class Measurements(NamedTuple):
    """Data without ratings: plate forces, recorded afferents, or both."""

    compression: Compression | None = None
    afferents: Afferents | None = None

    @classmethod
    def of(cls, data: Compression | Afferents | Measurements) -> Measurements:
        """Return the data, which may be a single table.

        Raises
        ------
        InputError
            If they are of another kind.
        """
        if isinstance(data, Compression):
            return cls(data)
        kinds = Compression, Afferents, Measurements
        require_kind("data", data, kinds, "Compression or Afferents, as their method read returns them")
        return cls(afferents=data) if isinstance(data, Afferents) else data

    @property
    def notes(self) -> tuple[str, ...]:
        """Assumptions, omissions and findings made while reading."""
        return tuple(note for table in self if table is not None for note in table.notes)


def read_experiment(
    ratings_path: TableSource,
    fabrics_path: TableSource | None = None,
    *,
    columns: Mapping[str, str] | None = None,
    indentation_mm: float | None = None,
    force_n: float | None = None,
    load: str | None = None,
    compression_path: TableSource | None = None,
    afferents_path: TableSource | None = None,
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
        `Fabrics`.
    columns
        Names of columns in the files, by standard name, where they differ.
    indentation_mm, force_n
        The load of every row [mm] or [N], if the table of ratings has no column for it.
    load
        "free" if people pressed as they liked: all ratings share one unknown force, the parameter `touch_force`.
    compression_path
        Table of compression data, whose columns are those of `Compression`.
    afferents_path
        Table of recorded afferents, whose columns are those of `Afferents`.
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
    given = loads_of(indentation_mm, force_n, load)
    if load is not None and round_load is not None:
        raise InputError("--round-load: a free touch (--load free) has no stated load to round; omit one of them")
    request = Request(LOADED if given else RATINGS, columns or {}, decimal, wide)
    table, described, place = _tables(ratings_path, fabrics_path, request)
    own = [column.name for column in MODULUS_SOURCES if column.name in table]
    fabric_table = table if own and fabrics_path is None else described
    notes: list[str] = []
    if fabric_table is table and not own:
        table.refuse(_NO_FABRICS)
    elif fabric_table is not table and own:
        notes.append(
            f"{table.label}: {listing(own)} not used, because properties of fabrics are read from {fabric_table.place}"
        )
    elif fabric_table is not table and place:
        notes.append(f"properties of fabrics are read from {fabric_table.place}, found {place}")
    measured = _measured(request, compression_path, afferents_path)
    check_renames(request.renames, table, fabric_table, *measured.values())
    compression, afferents = _measurements(measured)
    known = own or fabric_table is not table
    fabrics = Fabrics.from_table(fabric_table, repeated=fabric_table is table) if known else None
    ratings = Ratings.from_table(table, fabrics, given, drop_zeros)
    assert fabrics is not None  # the table was refused
    if round_load is not None:
        ratings = with_rounded_loads(ratings, round_load)
    ratings = with_drift(ratings) if drift else ratings
    if unrated := [name for name in fabrics.names if name not in ratings.fabrics]:
        notes.append(f"fabrics without a rating, left out: {listing(unrated)}")
    if isinstance(ratings_path, (str, Path)) and _is_simulated(Path(ratings_path), ratings.digest):
        ratings = replace(ratings, simulated=True)
    if compression is not None:
        compression = _with_names_of(compression, ratings.participants)
    notes += Measurements(compression, afferents).notes
    every = tuple(dict.fromkeys((*ratings.notes, *fabrics.notes, *notes)))
    return Experiment(ratings, fabrics.take(ratings.fabrics), every, compression, afferents)


def read_measurements(
    compression_path: TableSource | None = None,
    afferents_path: TableSource | None = None,
    *,
    columns: Mapping[str, str] | None = None,
    decimal: Marks = None,
) -> Measurements:
    """Read plate forces, recorded afferents, or both; arguments and errors as for `read_experiment`."""
    tables = _measured(Request(AFFERENTS, columns or {}, decimal), compression_path, afferents_path)
    check_renames(columns or {}, *tables.values())
    return _measurements(tables)


def _measured(request: Request, compression: TableSource | None, afferents: TableSource | None) -> dict[Kind, Table]:
    """Return the tables of measurements that are given, by their kind."""
    given = ((FORCES_OF_A_PLATE, compression), (AFFERENTS, afferents))
    return {kind: read_table(path, request._replace(kind=kind)) for kind, path in given if path is not None}


def _measurements(tables: Mapping[Kind, Table]) -> Measurements:
    """Return the measurements of some tables."""
    plate, recorded = tables.get(FORCES_OF_A_PLATE), tables.get(AFFERENTS)
    return Measurements(
        None if plate is None else Compression.from_table(plate),
        None if recorded is None else Afferents.from_table(recorded),
    )


_NO_FABRICS = (
    f"the fabrics have no properties: name their table with --fabrics, put a {FABRICS_BESIDE} in the "
    "folder of the ratings, or add to the ratings a column "
    f"{', '.join(column.name for column in MODULUS_SOURCES)} (the last with thickness_mm); "
    "what people said of them needs no properties: 'softness-bayes check' shows it"
)


def read_answers(
    ratings_path: TableSource,
    fabrics_path: TableSource | None = None,
    *,
    columns: Mapping[str, str] | None = None,
    indentation_mm: float | None = None,
    force_n: float | None = None,
    load: str | None = None,
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
    given = loads_of(indentation_mm, force_n, load)
    request = Request(LOADED if given else RATINGS, columns or {}, decimal, wide)
    table, described, _ = _tables(ratings_path, fabrics_path, request)
    if not all(is_missing(text) for column in MODULUS_SOURCES for text in described.texts(column.name)):
        return None
    ratings = Ratings.from_table(table, None, given, drop_zeros, loads_needed=False)
    if described is not table:  # a column of moduli may have been passed over
        ratings = replace(ratings, notes=(*ratings.notes, *described.origin(described.notes)["notes"]))
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


def _is_simulated(path: Path, digest: str) -> bool:
    """Return whether ratings are those of the example, or have the truth beside them that `simulate` writes."""
    example = files("softness_bayes") / "example" / "ratings.csv"
    return path.with_name(TRUTH).is_file() or digest == sha256(example.read_bytes()).hexdigest()


def _tables(ratings: TableSource, fabrics: TableSource | None, request: Request) -> tuple[Table, Table, str]:
    """Return the table of ratings, that of their fabrics, and where this was found unless the user named it.

    The fabrics are in the given table, another sheet of the ratings' workbook, a file next to theirs, or their table.
    """
    place = ""
    if fabrics is None and isinstance(ratings, (str, Path)):
        beside = Path(ratings).parent / FABRICS_BESIDE
        if has_sheet(ratings, FABRICS, request.renames):
            fabrics, place = ratings, "in the workbook of the ratings"
        elif os.path.isfile(beside):
            fabrics, place = beside, "beside the ratings"
    if fabrics is None:
        table = read_table(ratings, request._replace(kind=request.kind.and_also(FABRICS)))
        return table, table, place
    described = read_table(fabrics, request._replace(kind=FABRICS))
    return read_table(ratings, request._replace(fabrics=described.labels("fabric"))), described, place


def fabrics_csv(fabrics: Fabrics) -> str:
    """Return a fabric table from which exactly the same values are read."""
    return _csv({"fabric": fabrics.names, **fabrics.cells()})


def ratings_csv(ratings: Ratings, fabrics: Fabrics | None = None) -> str:
    """Return a table of ratings from which exactly the same values are read, with the columns of `fabrics` if given."""
    people = [ratings.participants[i] for i in ratings.participant]
    names = [ratings.fabrics[i] for i in ratings.fabric]
    columns: dict[str, Sequence[str]] = {"participant": people, "fabric": names}
    for column, held in loads_by_column(ratings.loads).items():
        filled = [column.write(value) for value in held[ratings.load]]
        if any(filled):
            columns[column.name] = filled
    if ratings.lists is None:
        trial = np.ones(len(ratings), int)
        for rows in grouped(zip(people, names, ratings.load, strict=True)).values():
            trial[rows] = range(1, 1 + len(rows))
        if (trial > 1).any():  # without it, equal ratings could be copies
            columns["trial"] = [*map(str, trial)]
    else:
        columns["list"] = [str(number + 1) for number in ratings.lists]
    cells = ratings.cells
    numbers: dict[str, FloatArray | None] = {
        "load_cv": ratings.load_cv,
        "resolution": ratings.resolution,
        "rating" if cells is None else "geometric_mean": ratings.rating,
        "geometric_sd": None if cells is None else cells.geometric_sd,
        "n": None if cells is None else np.full(len(ratings), float(cells.raters)),
    }
    columns |= {
        name: [NUMBERS[name].write(value) for value in values] for name, values in numbers.items() if values is not None
    }
    columns |= {name: [own[i] for i in ratings.participant] for name, own in ratings.covariates.items()}
    if fabrics is not None:
        place = [fabrics.names.index(name) for name in names]
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


def _csv(columns: Mapping[str, Sequence[str]]) -> str:
    import pandas as pd

    return csv_of(pd.DataFrame(columns, dtype=object), index=False)
