"""Options of commands, made from their declarations, and the few that only commands have."""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from softness_bayes.errors import InputError
from softness_bayes.model.options import FixedValues, Laws, ModelOptions
from softness_bayes.options import Flag, Kind, Number, Options
from softness_bayes.ranges import Count, Range
from softness_bayes.results.run_options import DataFiles, RunOptions

if TYPE_CHECKING:
    import pandas as pd

    from softness_bayes.data import Fabrics
    from softness_bayes.data.decimals import Marks
    from softness_bayes.results.result import Result
    from softness_bayes.touch.contact import Load

Verb = Callable[..., Any]
Decorator = Callable[[Verb], Verb]

FILE = click.Path(path_type=Path)


class _Text(click.ParamType):
    """Values of a kind that has texts of its own."""

    name = "text"

    def __init__(self, kind: Kind) -> None:
        self._kind = kind

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        return _parsed(self._kind, value, param, ctx) if isinstance(value, str) else value


class _Word(click.Choice[str]):
    """Values of a kind that has few words, and perhaps installed or importable ones."""

    def __init__(self, kind: Kind, choices: tuple[str, ...]) -> None:
        super().__init__(choices)
        self._kind = kind

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        from softness_bayes.supplied import is_supplied

        if not isinstance(value, str):
            return value
        custom = self._kind.group and value not in self.choices and is_supplied(self._kind.group, value)
        return _parsed(self._kind, value if custom else super().convert(value, param, ctx), param, ctx)


def _parsed(kind: Kind, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
    try:
        return kind.parse(value)
    except ValueError as error:
        raise click.BadParameter(str(error), ctx, param) from None


def completion(words: Callable[[str], Iterable[str]]) -> Callable[..., list[str]]:
    """Return click's completion of a word that has begun, from a function of it that returns all words."""

    def complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
        return [word for word in words(incomplete) if word.startswith(incomplete)]

    return complete


def number(flag: str, within: Range | Count, text: str, default: float | None = None, metavar: str = "N") -> Decorator:
    """Return an option for a number in a range."""
    return click.option(
        flag,
        type=_Text(Number(within)),
        default=default,
        show_default=default is not None,
        metavar=metavar,
        help=f"{text} Accepts {within}.",
    )


def path(flag: str, metavar: str, text: str, name: str | None = None) -> Decorator:
    """Return an option for the path of a file or a directory, which a command receives as `name`."""
    return click.option(*filter(None, (flag, name)), type=FILE, metavar=metavar, help=text)


def repeated(kind: Kind, flags: Iterable[str], name: str, text: str) -> Decorator:
    """Return an option that may be given several times, of a kind that makes one value of all the texts."""
    return click.option(
        *flags,
        name,
        multiple=True,
        callback=lambda ctx, param, texts: _parsed(kind, texts, param, ctx),
        shell_complete=completion(kind.complete),
        metavar=kind.metavar,
        help=f"{text} Repeatable.",
    )


def flag(options: type[Options], name: str, **changed: Any) -> Decorator:
    """Return a decorator that adds one declared option to a command, which receives its value under its name.

    Parameters
    ----------
    options, name
        The class that declares the option, and its name there.
    changed
        What this command says otherwise: `help`, `default` or `choices`.
    """
    one = options.declared[name]
    kind, text = one.kind, changed.pop("help", one.help)
    if isinstance(kind, Flag):
        return click.option(one.flag, name, is_flag=True, help=text)
    if kind.repeated:
        return repeated(kind, filter(None, (one.flag, one.set_flag)), name, text)
    choices = tuple(changed.pop("choices", kind.choices))
    given: dict[str, Any] = {"metavar": kind.metavar, "shell_complete": completion(kind.complete)}
    given = {} if choices else given  # click shows and completes these
    if one.shown:
        default = one.default if isinstance(kind, Number) else one.written(one.default)
        given |= {"default": default, "show_default": True}
    if isinstance(kind, Number):
        text = f"{text} Accepts {kind.range}."
    kind_of_text = _Word(kind, choices) if choices else _Text(kind)
    return click.option(one.flag, name, type=kind_of_text, help=text, **given | changed)


def collected(
    passed: str, options: type[Options], *names: str, without: Collection[str] = (), **changed: Mapping[str, Any]
) -> Decorator:
    """Return a decorator that adds declared options to a command, which receives an object of their class.

    Parameters
    ----------
    passed
        Name under which the command receives the object.
    options, names, without
        The class, and the names of the options to add; by default all that have a flag, except some.
    changed
        What this command says otherwise, by option, as for `flag`.
    """
    names = names or tuple(name for name, one in options.declared.items() if one.flag and name not in without)

    def decorate(verb: Verb) -> Verb:
        @functools.wraps(verb)
        def wrapped(**given: Any) -> Any:
            values = {name: value for name in names if (value := given.pop(name)) is not None}
            return verb(**{passed: options(**values)}, **given)

        command: Verb = wrapped
        for name in reversed(names):
            command = flag(options, name, **changed.get(name, {}))(command)
        return command

    return decorate


def typed(*names: str) -> list[str]:
    """Return the flags of those of the named options that are on the command line."""
    context = click.get_current_context()
    unseen = (None, ParameterSource.DEFAULT)
    return [
        one.opts[0]
        for one in context.command.params
        if one.name in names and context.get_parameter_source(one.name) not in unseen
    ]


data_files = collected("files", DataFiles)
"""Passes `files` to a command: `DataFiles`."""

model_options = collected("model", ModelOptions, without=("noise",))
"""Passes `model` to a command: `ModelOptions`, without noise."""

set_values = repeated(
    FixedValues(),
    ["--set"],
    "values",
    "Value of a parameter, such as b=80; the others are at their medians.",
)
"""Passes `values` to a command: name -> number."""

spreads = repeated(
    Laws(),
    ["--spread"],
    "spreads",
    "Prior of the spread of a pooled parameter between tables, such as b='halfnormal(0.3)'; by default "
    "half-normal with the width of the prior of the parameter.",
)
"""Passes `spreads` to a command: name -> `Prior`."""

dask = click.option(
    "--dask",
    metavar="SCHEDULER",
    help="Run on an existing Dask cluster instead of this machine: the address of its scheduler, such as "
    "tcp://10.0.0.1:8786, or its scheduler file. Workers must have this version, one thread each, and "
    "share --out.",
)
"""Passes `dask` to a command: an address or a file, or None."""

no_figures = click.option("--no-figures", is_flag=True, help="Draw no figures.")
"""Passes `no_figures` to a command."""

verbose = click.option("--verbose", is_flag=True, help="Print all numbers and checks, not only the closing lines.")
"""Passes `verbose` to a command."""


def _figures(incomplete: str) -> Iterable[str]:
    from softness_bayes.plotting.figures import every_figure

    return every_figure()


complete_figures = completion(_figures)
"""Completes the name of a figure."""

own_figures = click.option(
    "--figure",
    "own_figures",
    multiple=True,
    shell_complete=complete_figures,
    metavar="NAME",
    help="Also draw this figure: one that 'list figures' shows, or a custom one such as mymodule:mine, a function of a "
    "result and a style. Repeatable. Figures of installed packages are always drawn.",
)
"""Passes `own_figures` to a command: names of figures."""

_TRUST = "softness_bayes.trust_code"


def _keep_trust(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    ctx.meta[_TRUST] = value


trust_code = click.option(
    "--trust-code",
    is_flag=True,
    expose_value=False,
    callback=_keep_trust,
    help="Run code that the files of the run name, such as a custom reading or prior MODULE:NAME, because you trust "
    "whoever made them. It is searched for on Python's path (add folders by PYTHONPATH), not in the working directory.",
)
"""Lets a command read files that name code (`trusts_code`)."""


def trusts_code() -> bool:
    """Return whether the user of the present command trusts the code that its files name."""
    return bool(click.get_current_context().meta.get(_TRUST, False))


seed = flag(RunOptions, "seed")
"""Passes `seed` to a command."""


def out(
    default: str | None = "results", text: str = "Directory to write to; it must be empty or not exist."
) -> Decorator:
    """Return the option --out of a command, which receives the directory as `out`."""
    path = None if default is None else Path(default)
    return click.option("--out", type=FILE, metavar="DIR", default=path, show_default=default is not None, help=text)


force = click.option("--force", is_flag=True, help="Replace the files in --out that this command wrote, and no others.")
"""Passes `force` to a command."""


@dataclass(frozen=True)
class TableFile:
    """The CSV file to which a command writes its table, or None to print it."""

    path: Path | None
    command: str
    force: bool

    def require(self, inputs: Iterable[Path] = ()) -> None:
        """Raise an error if the file cannot be written, or is one of the inputs."""
        from softness_bayes.files.outputs import require_outputs

        if self.path is not None:
            require_outputs(self.path.parent, [self.path.name], self.command, self.force, inputs)

    def write(self, table: pd.DataFrame) -> None:
        """Write the table, or print it to five digits."""
        from softness_bayes.files.outputs import write_outputs
        from softness_bayes.files.spreadsheet import PRINTED, csv_of
        from softness_bayes.readable import counted

        if self.path is None:
            click.echo(csv_of(table, index=False, digits=PRINTED), nl=False)
        else:
            write_outputs(self.path.parent, {self.path.name: csv_of(table, index=False)}, self.command)
            click.echo(f"{self.path}: {counted(len(table), 'row')}", err=True)


def table_file(command: str) -> Decorator:
    """Return the options --out and --force of a command with a table, which receives `file`, a `TableFile`."""

    def decorate(verb: Verb) -> Verb:
        @click.option(
            "--out",
            type=click.Path(path_type=Path, dir_okay=False),
            metavar="FILE",
            help="CSV file to write; by default the table is printed, to five digits.",
        )
        @click.option("--force", is_flag=True, help=f"Replace the file --out if '{command}' wrote it.")
        @functools.wraps(verb)
        def wrapped(out: Path | None, force: bool, **others: Any) -> Any:
            return verb(file=TableFile(out, command, force), **others)

        return wrapped

    return decorate


def load_options(text: str) -> Decorator:
    """Return a decorator that adds the two load options, each for any number of loads."""

    def decorate(verb: Verb) -> Verb:
        for name, noun in (("force_n", "Contact force"), ("indentation_mm", "Indentation")):
            one = DataFiles.declared[name]
            words = f"{noun} [{one.kind.metavar}]{text}"
            verb = click.option(
                one.flag, name, type=_Text(one.kind), multiple=True, metavar=one.kind.metavar, help=words
            )(verb)
        return verb

    return decorate


@dataclass(frozen=True)
class Touches:
    """Fabrics and loads of touches, as requested on the command line."""

    fabrics: Path | None
    columns: Mapping[str, str]
    decimal: Marks
    indentation_mm: tuple[float, ...]
    force_n: tuple[float, ...]

    @property
    def inputs(self) -> list[Path]:
        """The files that are read."""
        return [] if self.fabrics is None else [self.fabrics]

    def read(self, needs_load: bool = True) -> tuple[Fabrics, tuple[Load, ...]]:
        """Return the fabrics and the distinct loads, of which there may be none if they are not needed.

        Raises
        ------
        InputError
            If no load or no table of fabrics is given.
        """
        if needs_load and not (self.indentation_mm or self.force_n):
            raise InputError("no load: give at least one --indentation-mm or --force-n")
        if self.fabrics is None:
            raise InputError("no fabrics: give --fabrics")
        return self.among(None, ())

    def of_run(self, result: Result) -> tuple[Fabrics, tuple[Load, ...]]:
        """Return the fabrics and the distinct loads, by default those of a run."""
        return self.among(result.fabrics, result.loads)

    def among(self, fabrics: Any, loads: tuple[Load, ...]) -> tuple[Fabrics, tuple[Load, ...]]:
        """Return the fabrics and the distinct loads, by default the given ones.

        Raises
        ------
        InputError
            If columns are named for a table that is not given.
        """
        from softness_bayes.data import Fabrics, loads_of

        if self.columns and self.fabrics is None:
            raise InputError("--column applies to the fabric table: give --fabrics, or omit --column")
        if self.fabrics is not None:
            fabrics = Fabrics.read(self.fabrics, columns=self.columns, decimal=self.decimal)
        return fabrics, loads_of(self.indentation_mm, self.force_n) or loads


TOUCHES = tuple(field.name for field in fields(Touches))
"""Names of the options of `touches`."""


def touches(fabrics: str = "", loads: str = "") -> Decorator:
    """Return a decorator that adds the options for fabrics and loads to a command, which receives `touches`.

    Parameters
    ----------
    fabrics, loads
        What they are by default; empty if they must be given.
    """

    def decorate(verb: Verb) -> Verb:
        @click.option(
            "--fabrics",
            type=FILE,
            metavar="FILE",
            required=not fabrics,
            help=f"Fabric table (CSV, Excel or Parquet){f'; by default {fabrics}' if fabrics else ''}.",
        )
        @flag(DataFiles, "columns")
        @flag(DataFiles, "decimal")
        @load_options(f" of the touch. Repeatable{f'; by default {loads}' if loads else ''}.")
        @functools.wraps(verb)
        def wrapped(**given: Any) -> Any:
            return verb(touches=Touches(**{name: given.pop(name) for name in TOUCHES}), **given)

        return wrapped

    return decorate
