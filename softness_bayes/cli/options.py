"""Options of commands, made from their declarations, and the few that only commands have."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from softness_bayes.errors import InputError
from softness_bayes.model.options import FixedValues, Laws, ModelOptions
from softness_bayes.options import Flag, Kind, Number, Option, Options, Whole
from softness_bayes.ranges import Count, Range
from softness_bayes.results.run_options import DataFiles, RunOptions

if TYPE_CHECKING:
    from softness_bayes.data import Fabrics
    from softness_bayes.data.tables import Marks
    from softness_bayes.results.result import Result
    from softness_bayes.touch.contact import Load

Verb = Callable[..., Any]
Decorator = Callable[[Verb], Verb]

FILE = click.Path(path_type=Path)


class NumberIn(click.FloatRange):
    """A finite number within a range.

    Parameters
    ----------
    within
        The range.
    """

    def __init__(self, within: Range) -> None:
        super().__init__(within.low, within.high, min_open=within.above)
        self._within = within

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number, or refuse it."""
        number = float(click.FLOAT.convert(value, param, ctx))
        if not self._within.holds(number):
            self.fail(f"expected {self._within}, got {value!r}", param, ctx)
        return number


def whole(count: Count) -> click.IntRange:
    """Return the type of an option that counts."""
    return click.IntRange(count.low, None if count.high == sys.maxsize else count.high)


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


def _callback(one: Option) -> Callable[..., Any]:
    """Return the click callback for all texts of an option that may be given several times."""

    def callback(ctx: click.Context, param: click.Parameter, texts: tuple[str, ...]) -> Any:
        value = _parsed(one.kind, texts, param, ctx)
        return texts if one.set_flag else value  # the flag of a starting point has the other part of the value

    return callback


def _type(kind: Kind, choices: tuple[str, ...]) -> Any:
    """Return the click type of the values of a kind."""
    if isinstance(kind, Number):
        return NumberIn(kind.range)
    if isinstance(kind, Whole):
        return whole(kind.range)
    return _Word(kind, choices) if choices else _Text(kind)


def _completion(words: Callable[[str], Any]) -> Callable[..., list[str]]:
    def complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
        return [word for word in words(incomplete) if word.startswith(incomplete)]

    return complete


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
    choices = tuple(changed.pop("choices", kind.choices))
    given: dict[str, Any] = {"metavar": kind.metavar or None, "shell_complete": _completion(kind.complete)}
    given = {} if choices else given  # click shows and completes these
    if kind.repeated:
        repeated = click.option(
            one.flag, name, multiple=True, callback=_callback(one), help=f"{text} Repeatable.", **given
        )
        return repeated if not one.set_flag else _both(one, repeated)
    if one.shown:
        plain = isinstance(kind, Number | Whole)
        given |= {"default": one.default if plain else one.written(one.default), "show_default": True}
    return click.option(one.flag, name, type=_type(kind, choices), help=text, **given | changed)


def _both(one: Option, changes: Decorator) -> Decorator:
    """Return a decorator that adds the flag of a starting point, and that of the values which change it."""
    start = click.option(
        one.set_flag,
        f"{one.name}_set",
        metavar="SET",
        help=one.set_help,
        shell_complete=_completion(lambda _: one.kind.sets()),
    )

    def decorate(verb: Verb) -> Verb:
        return start(changes(verb))

    return decorate


def collected(passed: str, options: type[Options], *names: str, **changed: Mapping[str, Any]) -> Decorator:
    """Return a decorator that adds declared options to a command, which receives an object of their class.

    Parameters
    ----------
    passed
        Name under which the command receives the object.
    options, names
        The class, and the names of the options to add.
    changed
        What this command says otherwise, by option, as for `flag`.
    """

    def decorate(verb: Verb) -> Verb:
        @functools.wraps(verb)
        def wrapped(**given: Any) -> Any:
            values = {name: given.pop(name) for name in names}
            for name in names:
                one = options.declared[name]
                if one.set_flag:
                    start = given.pop(f"{name}_set")
                    values[name] = one.kind.parse([*([] if start is None else [start]), *values[name]])
            kept = {name: value for name, value in values.items() if value is not None}
            return verb(**{passed: options(**kept)}, **given)

        command: Verb = wrapped
        for name in reversed(names):
            command = flag(options, name, **changed.get(name, {}))(command)
        return command

    return decorate


def flagged(options: type[Options], *without: str) -> tuple[str, ...]:
    """Return the names of all options of a class that have a flag, except some."""
    return tuple(name for name, one in options.declared.items() if one.flag and name not in without)


def typed(*names: str) -> bool:
    """Return whether one of the named options is on the command line."""
    source = click.get_current_context().get_parameter_source
    return any(source(name) not in (None, ParameterSource.DEFAULT) for name in names)


model_options = collected("model", ModelOptions, *flagged(ModelOptions, "noise"))
"""Passes `model` to a command: `ModelOptions`, without noise."""

reading_options = collected("files", DataFiles, *flagged(DataFiles, "data", "compression"))
"""Passes `files` to a command: `DataFiles` without the files of ratings and forces."""


def data_files(verb: Verb) -> Verb:
    """Add the options of the files of an experiment to a command, which receives `files`, a `DataFiles`."""

    @functools.wraps(verb)
    def wrapped(files: DataFiles, **others: Any) -> Any:
        if files.data is None and files.compression is None:
            raise click.UsageError("no data: give ratings with --data, a plate's forces with --compression, or both")
        return verb(files=files, **others)

    return collected("files", DataFiles, *flagged(DataFiles))(wrapped)


def by_name(kind: Kind, flag: str, name: str, text: str) -> Decorator:
    """Return an option for values by name that only commands have, which receive them as `name`."""
    one = Option(name, kind, dict, flag)
    return click.option(
        flag,
        name,
        multiple=True,
        callback=_callback(one),
        shell_complete=_completion(kind.complete),
        metavar=kind.metavar,
        help=text,
    )


set_values = by_name(
    FixedValues(),
    "--set",
    "values",
    "Value of a parameter, such as b=80; the others are at their medians. Repeatable.",
)
"""Passes `values` to a command: name -> number."""

spreads = by_name(
    Laws(),
    "--spread",
    "spreads",
    "Prior of the spread of a pooled parameter between tables, such as b='halfnormal(0.3)'; by default "
    "half-normal with the width of the prior of the parameter. Repeatable.",
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


def _figures(incomplete: str) -> Any:
    from softness_bayes.plotting.figures import every_figure

    return every_figure()


complete_figures = _completion(_figures)
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
    return click.option(
        "--out",
        type=FILE,
        metavar="DIR",
        default=None if default is None else Path(default),
        show_default=default is not None,
        help=text,
    )


def table_out(name: str) -> Decorator:
    """Return the options --out and --force of a command that prints a table, or writes it to a file."""

    def decorate(verb: Verb) -> Verb:
        file = click.option(
            "--out",
            type=click.Path(path_type=Path, dir_okay=False),
            metavar="FILE",
            help="CSV file to write; by default the table is printed, to five digits.",
        )
        again = click.option("--force", is_flag=True, help=f"Replace the file --out if '{name}' wrote it.")
        return file(again(verb))

    return decorate


force = click.option("--force", is_flag=True, help="Replace the files in --out that this command wrote, and no others.")
"""Passes `force` to a command."""


def load_options(text: str) -> Decorator:
    """Return a decorator that adds the two load options, each for any number of loads."""

    def decorate(verb: Verb) -> Verb:
        for name, noun in (("force_n", "Contact force"), ("indentation_mm", "Indentation")):
            one = DataFiles.declared[name]
            unit = one.kind.metavar
            verb = click.option(
                one.flag,
                name,
                type=_Text(one.kind),
                multiple=True,
                metavar=unit,
                help=f"{noun} [{unit}]{text}",
            )(verb)
        return verb

    return decorate


@dataclass(frozen=True)
class Touches:
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

    @property
    def given(self) -> bool:
        """True if any option was given."""
        return bool(self.fabrics or self.columns or self.indentation_mm or self.force_n or self.decimal)

    def read(self) -> tuple[Fabrics, tuple[Load, ...]]:
        """Return the fabrics and the distinct loads.

        Raises
        ------
        InputError
            If no load or no table of fabrics is given.
        """
        if not (self.indentation_mm or self.force_n):
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


def touches(fabrics: str = "", loads: str = "") -> Decorator:
    """Return a decorator that adds the options for fabrics and loads to a command, which receives `touches`.

    Parameters
    ----------
    fabrics, loads
        What they are by default; empty if they must be given.
    """
    table = "Fabric table (CSV, Excel or Parquet)"

    def decorate(verb: Verb) -> Verb:
        @click.option(
            "--fabrics",
            type=FILE,
            metavar="FILE",
            required=not fabrics,
            help=f"{table}; by default {fabrics}." if fabrics else f"{table}.",
        )
        @flag(DataFiles, "columns")
        @flag(DataFiles, "decimal")
        @load_options(f" of the touch. Repeatable{f'; by default {loads}' if loads else ''}.")
        @functools.wraps(verb)
        def wrapped(
            fabrics: Path | None,
            columns: dict[str, str],
            decimal: Marks,
            indentation_mm: tuple[float, ...],
            force_n: tuple[float, ...],
            **others: Any,
        ) -> Any:
            return verb(touches=Touches(fabrics, columns, indentation_mm, force_n, decimal), **others)

        return wrapped

    return decorate
