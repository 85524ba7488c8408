"""Options of the tables that are read: ratings, fabrics, forces, and loads beside them."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from softness_bayes.cli.options.values import FILE, Decorator, Verb, named
from softness_bayes.errors import InputError, quoted

if TYPE_CHECKING:
    from softness_bayes.data import Compression, Experiment, Fabrics
    from softness_bayes.data.tables import Marks
    from softness_bayes.results.result import Result
    from softness_bayes.touch.contact import Load

column = click.option(
    "--column",
    "columns",
    multiple=True,
    callback=named(str),
    metavar="NAME=ACTUAL",
    help="Name of a column in your files, such as rating=softness. Repeatable.",
)
"""Passes `columns` to a command: name -> name in the files."""


def _marks(ctx: click.Context, param: click.Parameter, given: tuple[str, ...]) -> Marks:
    """Return the one mark, or table -> mark."""
    from softness_bayes.data.tables import MARKED, MARKS

    found: dict[str, str] = {}
    for word in given:
        table, _, mark = word.rpartition("=")
        if mark not in MARKS or table not in ("", *MARKED):
            raise click.BadParameter(
                f"expected a comma or a point, or TABLE=MARK for one of {', '.join(MARKED)}, got {quoted(word)}"
            )
        if found.setdefault(table, mark) != mark or ("" in found and len(found) > 1):
            raise click.BadParameter(f"two decimal marks for one table: {' and '.join(given)}")
    return found.get("", found or None)


decimal = click.option(
    "--decimal",
    metavar="[TABLE=]MARK",
    multiple=True,
    callback=_marks,
    help="Decimal mark of the files (, or .), if their numbers do not show it; the other mark then separates "
    "thousands. If tables differ: ratings=, or fabrics=. or compression=, each with its mark.",
)
"""Passes `decimal` to a command: a mark, or table -> mark, or None."""


def _fabrics(required: bool, text: str) -> Decorator:
    return click.option("--fabrics", type=FILE, metavar="FILE", required=required, help=text)


def _load(ctx: click.Context, param: click.Parameter, given: Any) -> Any:
    """Refuse loads [unit of the option's column] out of range."""
    from softness_bayes.data.columns import NUMBERS

    assert param.name is not None
    for value in given if param.multiple else [] if given is None else [given]:
        try:
            NUMBERS[param.name].parse(repr(value))
        except ValueError as error:
            raise click.BadParameter(str(error)) from None
    return given


def load_options(multiple: bool, text: str) -> Decorator:
    """Declare the two load options, for one load or any number of them."""

    def decorate(verb: Verb) -> Verb:
        for flag, noun, unit in (
            ("--force-n", "Contact force", "N"),
            ("--indentation-mm", "Indentation", "mm"),
        ):
            says = f"{noun} [{unit}]{text}"
            verb = click.option(flag, type=float, multiple=multiple, callback=_load, metavar=unit, help=says)(verb)
        return verb

    return decorate


@dataclass(frozen=True)
class DataFiles:
    """The files of an experiment and how to read them, as requested on the command line."""

    data: Path | None
    fabrics: Path | None
    columns: Mapping[str, str]
    indentation_mm: float | None
    force_n: float | None
    compression: Path | None
    decimal: Marks = None
    drop_zeros: bool = False
    wide: bool = False
    round_load: float | None = None

    @property
    def paths(self) -> tuple[Path, ...]:
        """The files that may be read, the fabrics beside the ratings among them."""
        from softness_bayes.data import FABRICS_BESIDE

        beside = None if self.data is None else self.data.with_name(FABRICS_BESIDE)
        return tuple(path for path in (self.data, self.fabrics, self.compression, beside) if path is not None)

    def read(self) -> Experiment | Compression:
        """Return the experiment, with compression data if there are any; or compression data alone.

        Raises
        ------
        UsageError
            If neither table is given.
        InputError
            If an option for ratings is given without ratings.
        """
        from softness_bayes.data import Compression, read_experiment

        if self.data is not None:
            return read_experiment(
                self.data,
                self.fabrics,
                columns=self.columns,
                indentation_mm=self.indentation_mm,
                force_n=self.force_n,
                compression_path=self.compression,
                decimal=self.decimal,
                drop_zeros=self.drop_zeros,
                wide=self.wide,
                round_load=self.round_load,
            )
        if self.compression is None:
            raise click.UsageError("no data: give ratings with --data, a plate's forces with --compression, or both")
        given = (self.fabrics, self.indentation_mm, self.force_n, self.round_load)
        if any(one is not None for one in given) or self.drop_zeros or self.wide:
            raise InputError(
                "--fabrics, --indentation-mm, --force-n, --round-load, --drop-zeros and --wide need ratings: "
                "give --data, or omit them"
            )
        return Compression.read(self.compression, columns=self.columns, decimal=self.decimal)


def data_files(verb: Verb) -> Verb:
    """Add the options for the files of an experiment to a command, which receives `files`, a `DataFiles`."""

    @click.option("--data", type=FILE, metavar="FILE", help="Table of ratings (CSV, Excel or Parquet).")
    @click.option(
        "--compression",
        type=FILE,
        metavar="FILE",
        help="Forces of a rigid flat plate on fingerpads (participant, indentation_mm, force_n), with or "
        "without ratings.",
    )
    @reading_options
    @functools.wraps(verb)
    def wrapped(data: Path | None, compression: Path | None, files: DataFiles, **others: Any) -> Any:
        return verb(files=replace(files, data=data, compression=compression), **others)

    return wrapped


def reading_options(verb: Verb) -> Verb:
    """Add the options for the reading of tables to a command, which receives `files`, a `DataFiles` without ratings."""

    @_fabrics(
        False,
        "Fabric table; by default columns of the ratings, a sheet of their workbook, or a fabrics.csv in the "
        "same folder.",
    )
    @column
    @decimal
    @load_options(False, " of all ratings, if the table has no column for it.")
    @click.option(
        "--round-load",
        type=float,
        metavar="STEP",
        help="Round loads to multiples of STEP (in N and mm) and report which were merged; by default loads "
        "are used as measured.",
    )
    @click.option("--drop-zeros", is_flag=True, help="Leave out ratings of 0 instead of treating them as censored.")
    @click.option(
        "--wide",
        is_flag=True,
        help="The table has one column per fabric, or per fabric and load (cotton_2mm). Needed only if the "
        "headers do not show it.",
    )
    @functools.wraps(verb)
    def wrapped(
        fabrics: Path | None,
        columns: dict[str, str],
        decimal: Marks,
        indentation_mm: float | None,
        force_n: float | None,
        drop_zeros: bool,
        wide: bool,
        round_load: float | None,
        **others: Any,
    ) -> Any:
        loads = indentation_mm, force_n
        files = DataFiles(None, fabrics, columns, *loads, None, decimal, drop_zeros, wide, round_load)
        return verb(files=files, **others)

    return wrapped


@dataclass(frozen=True)
class RequestedTouches:
    """Fabrics and loads of touches, as requested on the command line."""

    fabrics: Path | None
    columns: Mapping[str, str]
    indentation_mm: tuple[float, ...]
    force_n: tuple[float, ...]
    decimal: Marks = None

    @property
    def inputs(self) -> list[Path]:
        """The files that are read."""
        return [] if self.fabrics is None else [self.fabrics]

    def read(self) -> tuple[Fabrics, tuple[Load, ...]]:
        """Return the fabrics and the distinct loads.

        Raises
        ------
        InputError
            If no load is given.
        """
        loads = self._loads()
        if not loads:
            raise InputError("no load: give at least one --indentation-mm or --force-n")
        fabrics = self._fabrics()
        if fabrics is None:
            raise InputError("no fabrics: give --fabrics")
        return fabrics, loads

    def of_run(self, result: Result) -> tuple[Fabrics, tuple[Load, ...]]:
        """Return the fabrics and the distinct loads, by default those of a run.

        Raises
        ------
        InputError
            If columns are named for a table that is not given.
        """
        return self.among(result.fabrics, result.loads)

    @property
    def asked(self) -> bool:
        """True if any option was given."""
        return bool(self.fabrics or self.columns or self.indentation_mm or self.force_n or self.decimal)

    def among(self, fabrics: Fabrics, loads: tuple[Load, ...]) -> tuple[Fabrics, tuple[Load, ...]]:
        """Return the fabrics and the distinct loads, by default the given ones.

        Raises
        ------
        InputError
            If columns are named for a table that is not given.
        """
        if self.columns and self.fabrics is None:
            raise InputError("--column applies to the fabric table: give --fabrics, or omit --column")
        return self._fabrics() or fabrics, self._loads() or loads

    def _fabrics(self) -> Fabrics | None:
        from softness_bayes.data import Fabrics

        return None if self.fabrics is None else Fabrics.read(self.fabrics, columns=self.columns, decimal=self.decimal)

    def _loads(self) -> tuple[Load, ...]:
        from softness_bayes.data import loads_of

        return loads_of(self.indentation_mm, self.force_n)


def touches(verb: Verb) -> Verb:
    """Add the options for fabrics and loads to a command, which receives `touches`, a `RequestedTouches`."""
    return _touches(True, "Fabric table (CSV, Excel or Parquet).", " of the touch. Repeatable.")(verb)


def touches_of_run(verb: Verb) -> Verb:
    """Add the same options to a command; by default fabrics and loads are those of a run."""
    return _touches(
        False,
        "Fabric table (CSV, Excel or Parquet); by default the fabrics of the run.",
        " of the touch. Repeatable; by default as rated.",
    )(verb)


def touches_or_example(verb: Verb) -> Verb:
    """Add the same options to a command; by default fabrics and loads are those of an example."""
    return _touches(
        False,
        "Fabric table (CSV, Excel or Parquet); by default six example fabrics.",
        " of the touch. Repeatable; by default indentations of 1, 2 and 3 mm.",
    )(verb)


def _touches(required: bool, fabrics_help: str, load_help: str) -> Decorator:
    def decorate(verb: Verb) -> Verb:
        @_fabrics(required, fabrics_help)
        @column
        @decimal
        @load_options(True, load_help)
        @functools.wraps(verb)
        def wrapped(
            fabrics: Path | None,
            columns: dict[str, str],
            decimal: Marks,
            indentation_mm: tuple[float, ...],
            force_n: tuple[float, ...],
            **others: Any,
        ) -> Any:
            return verb(touches=RequestedTouches(fabrics, columns, indentation_mm, force_n, decimal), **others)

        return wrapped

    return decorate
