"""Commands made from functions: an option is declared once, in the signature, and explained in the docstring."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import MISSING, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import click
from click.core import ParameterSource

from softness_bayes.base.errors import InputError
from softness_bayes.base.options import FilePath, Flag, Kind, Number, Option, Options, described, option
from softness_bayes.model.options import FIXED_VALUES
from softness_bayes.results.run_options import DataFiles, RunOptions

if TYPE_CHECKING:
    import pandas as pd

    from softness_bayes.data import Fabrics
    from softness_bayes.data.texts import Marks
    from softness_bayes.touch.contact import Load

DOCUMENTED = re.compile(r"^(\w+)(?: : (.+))?\n((?:    .*\n|\n)*)", re.MULTILINE)
"""A parameter in the docstring of a command: its name, the word for its value, and its help."""


class Given:
    """Choice of some options of a class for a command.

    Parameters
    ----------
    names, without
        Names of the options; by default all that have a flag, except some.
    changed
        Attributes of click that differ in this command, by option: `choices`, `default` or `required`.
    """

    def __init__(self, *names: str, without: Collection[str] = (), **changed: Mapping[str, Any]) -> None:
        self.names, self.without, self.changed = names, without, changed

    def of(self, options: type[Options]) -> tuple[str, ...]:
        """Return the names of the options of a class that the command has."""
        return self.names or tuple(k for k, one in options.declared.items() if one.flag and k not in self.without)


class Words(Kind):
    """Texts: some words, or what a function of a begun word completes."""

    def __init__(
        self, *choices: str, metavar: str = "TEXT", complete: Callable[[str], Iterable[str]] = lambda incomplete: ()
    ) -> None:
        self.choices, self.metavar = choices, metavar
        self.complete = complete  # type: ignore[method-assign, assignment]


class Directory(FilePath):
    """Paths of directories."""

    metavar = "DIR"


class Several(Kind):
    """Values of one kind, in the order in which they are given."""

    repeated = True

    def __init__(self, kind: Kind) -> None:
        self.kind, self.metavar, self.complete = kind, kind.metavar, kind.complete  # type: ignore[method-assign]

    def accept(self, name: str, value: Any) -> tuple[Any, ...]:
        """Return a tuple of values."""
        return tuple(self.kind.accept(name, one) for one in value)

    def parse(self, texts: Any) -> tuple[Any, ...]:
        """Return the values of the texts."""
        return tuple(self.kind.parse(text) for text in texts)


class _Word(click.Choice[str]):
    """Values of a kind: a few words, and perhaps installed or importable ones; without words, any text."""

    def __init__(self, kind: Kind, choices: Iterable[str]) -> None:
        super().__init__(tuple(choices))
        self._kind = kind

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        from softness_bayes.base.supplied import is_supplied

        if not isinstance(value, str):
            return value
        known = value in self.choices or not self.choices
        if not known and not (self._kind.group and is_supplied(self._kind.group, value)):
            value = super().convert(value, param, ctx)
        return _parsed(self._kind, value, param, ctx)


def _parsed(kind: Kind, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
    try:
        return kind.parse(value)
    except ValueError as error:
        raise click.BadParameter(str(error), ctx, param) from None


def command(function: Callable[..., None]) -> click.Command:
    """Return the command of a function.

    Positional parameters are arguments, the others options, whose flags are their names. The annotation of a parameter
    tells its kind of values: bool (a flag), a path, a text, a class of `Options` (all its flags: the function receives
    an object of the class), or ``Annotated[type, about]`` with a `Kind`, an `Option` or, for a class of options, a
    `Given`. The section Parameters of the docstring has the help of the options and, after the name, the word for the
    value. What it says of options of a class replaces what the class declares.
    """
    text, _, parameters = inspect.cleandoc(function.__doc__ or "").partition("\n\nParameters\n----------\n")
    said = {name: (word, " ".join(text.split())) for name, word, text in DOCUMENTED.findall(f"{parameters}\n")}
    collected: dict[str, tuple[type[Options], tuple[str, ...]]] = {}
    made: list[click.Parameter] = []
    hints = get_type_hints(function, include_extras=True)
    for name, one in inspect.signature(function).parameters.items():
        about = next(iter(getattr(hints[name], "__metadata__", ())), None)
        kind = hints[name].__origin__ if about is not None else hints[name]
        if isinstance(kind, type) and issubclass(kind, Options):
            part = about or Given()
            collected[name] = kind, part.of(kind)
            made += [_option(kind.declared[k], said, **part.changed.get(k, {})) for k in part.of(kind)]
        elif one.kind is inspect.Parameter.KEYWORD_ONLY:
            made.append(_option(_declared(name, one.default, kind, about), said, required=one.default is one.empty))
        else:
            made.append(_argument(name, one.default, kind, about, said.get(name, ("", ""))[0]))

    def callback(**given: Any) -> None:
        for name, (options, names) in collected.items():
            values = {one: value for one in names if (value := given.pop(one)) is not None}
            given[name] = options(**values)
        function(**{name: value for name, value in given.items() if value is not None})

    return click.Command(function.__name__.rstrip("_"), params=made, callback=callback, help=text)


def _declared(name: str, default: Any, kind: Any, about: Kind | Option | None) -> Option:
    """Return the declaration of an option that only one command has, or that brings its own."""
    default = None if default is inspect.Parameter.empty else default
    shown = not isinstance(default, bool) and default not in (None, "", ())
    if not isinstance(about, Option):
        kind = about or (Flag() if kind is bool else FilePath() if "Path" in str(kind) else Kind())
        about = Option(name, kind, lambda: None, f"--{name.rstrip('_').replace('_', '-')}")
    return replace(about, name=name, make=lambda: default, shown=shown)


def _argument(name: str, default: Any, kind: Any, about: Kind | None, metavar: str) -> click.Argument:
    """Return the argument of a command: paths, or words."""
    made: click.ParamType | None = click.Path(path_type=Path) if "Path" in str(kind) else None
    given: dict[str, Any] = {"nargs": -1, "required": True} if str(kind).startswith("tuple") else {}
    if not given and default is not inspect.Parameter.empty:
        given = {"default": default, "required": False}
    if about is not None:
        made, given["shell_complete"] = click.Choice(about.choices) if about.choices else None, _completion(about)
    return click.Argument([name], type=made, metavar=metavar or None, **given)


def _option(one: Option, said: Mapping[str, tuple[str, str]], **changed: Any) -> click.Option:
    """Return a declared option, with what the docstring of the command says of it and what differs in the command."""
    kind, (metavar, text) = one.kind, said.get(one.name, ("", one.help))
    flags = [*filter(None, (one.flag, one.set_flag)), one.name]
    if isinstance(kind, Flag):
        return click.Option(flags, is_flag=True, help=text)
    given: dict[str, Any] = {"metavar": metavar or kind.metavar, "shell_complete": _completion(kind)}
    if one.shown:
        plain = kind.repeated or isinstance(kind, (Number, FilePath))
        given |= {"default": one.default if plain else one.written(one.default), "show_default": True}
    if kind.repeated:
        given |= {"multiple": True, "callback": lambda ctx, param, texts: _parsed(kind, texts, param, ctx)}
        return click.Option(flags, help=f"{text} Repeatable.", **given | changed | {"required": False})
    if choices := changed.pop("choices", kind.choices):  # click shows and completes them
        del given["metavar"], given["shell_complete"]
    text = f"{text} Accepts {kind.range}." if isinstance(kind, Number) else text
    path = click.Path(path_type=Path) if isinstance(kind, FilePath) else None
    return click.Option(flags, type=path or _Word(kind, choices), help=text, **given | changed)


def _completion(kind: Kind) -> Callable[..., list[str]] | None:
    """Return click's completion of a word that has begun; None leaves it to the type of the values."""
    if isinstance(kind, FilePath) or kind.choices:
        return None

    def complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
        return [word for word in kind.complete(incomplete) if word.startswith(incomplete)]

    return complete


def typed(*names: str) -> list[str]:
    """Return the flags of those of the named options that are on the command line."""
    context = click.get_current_context()
    unseen = (None, ParameterSource.DEFAULT)
    return [
        one.opts[0]
        for one in context.command.params
        if one.name in names and context.get_parameter_source(one.name) not in unseen
    ]


# what several commands have


def _own(flag: str, kind: Kind, text: str) -> Option:
    """Return the declaration of an option of commands; its default is that of the parameter."""
    return Option("", kind, lambda: None, flag, text)


def _figures(incomplete: str) -> Iterable[str]:
    from softness_bayes.plotting.figures import every_figure

    return every_figure()


FIGURES = Several(Words(metavar="NAME", complete=_figures))
"""Names of figures."""

Seed = Annotated[int, RunOptions.declared["seed"]]
Out = Annotated[Path, _own("--out", Directory(), "Directory to write to; it must be empty or not exist.")]
Force = Annotated[bool, _own("--force", Flag(), "Replace the files in --out that this command wrote, and no others.")]
NoFigures = Annotated[bool, _own("--no-figures", Flag(), "Draw no figures.")]
Verbose = Annotated[bool, _own("--verbose", Flag(), "Print all numbers and checks, not only the closing lines.")]
SetValues = Annotated[
    dict[str, float],
    _own("--set", FIXED_VALUES, "Value of a parameter, such as b=80; the others are at their medians."),
]
Dask = Annotated[
    str | None,
    _own(
        "--dask",
        Words(metavar="SCHEDULER"),
        "Run on an existing Dask cluster instead of this machine: the address of its scheduler, such as "
        "tcp://10.0.0.1:8786, or its scheduler file. Workers must have this version, one thread each, and share --out.",
    ),
]
OwnFigures = Annotated[
    tuple[str, ...],
    _own(
        "--figure",
        FIGURES,
        "Also draw this figure: one that 'list figures' shows, or a custom one such as mymodule:mine, a function of a "
        "result and a style. Figures of installed packages are always drawn.",
    ),
]
TrustCode = Annotated[
    bool,
    _own(
        "--trust-code",
        Flag(),
        "Run code that the files of the run name, such as a custom reading or prior MODULE:NAME, because you trust "
        "whoever made them. It is searched for on Python's path (add folders by PYTHONPATH), not in the working "
        "directory.",
    ),
]


def _of_data(name: str, **changed: Any) -> dict[str, Any]:
    """Return the declaration of an option of `DataFiles`, with some of it changed."""
    known = DataFiles.__dataclass_fields__[name]
    made = {"default_factory": known.default_factory} if known.default is MISSING else {"default": known.default}
    return {**known.metadata, **made, **changed}


def _several(name: str, noun: str) -> dict[str, Any]:
    kind = DataFiles.declared[name].kind
    return _of_data(name, default=(), kind=Several(kind), help=f"{noun} [{kind.metavar}] of the touch.")


@described
@dataclass(frozen=True)
class Touches(Options):
    """Fabrics and loads of touches."""

    fabrics: Path | None = option(**_of_data("fabrics", help="Fabric table (CSV, Excel or Parquet)."))
    columns: Mapping[str, str] = option(**_of_data("columns"))
    decimal: Marks = option(**_of_data("decimal"))
    indentation_mm: tuple[float, ...] = option(**_several("indentation_mm", "Indentation"))
    force_n: tuple[float, ...] = option(**_several("force_n", "Contact force"))

    @property
    def inputs(self) -> list[Path]:
        """The files that are read."""
        return [] if self.fabrics is None else [self.fabrics]

    @property
    def loads(self) -> tuple[Load, ...]:
        """The distinct loads."""
        from softness_bayes.data import loads_of

        return loads_of(self.indentation_mm, self.force_n)

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

    def among(self, fabrics: Any, loads: tuple[Load, ...]) -> tuple[Fabrics, tuple[Load, ...]]:
        """Return the fabrics and the distinct loads, by default the given ones.

        Raises
        ------
        InputError
            If columns are named for a table that is not given.
        """
        from softness_bayes.data import Fabrics

        if self.columns and self.fabrics is None:
            raise InputError("--column applies to the fabric table: give --fabrics, or omit --column")
        if self.fabrics is not None:
            fabrics = Fabrics.read(self.fabrics, columns=self.columns, decimal=self.decimal)
        return fabrics, self.loads or loads


Loads = Annotated[Touches, Given("indentation_mm", "force_n")]
Touched = Annotated[Touches, Given(fabrics={"required": True})]


@described
@dataclass(frozen=True)
class TableFile(Options):
    """The CSV file to which a command writes its table, or none to print it."""

    out: Path | None = option(
        FilePath(), None, "--out", "CSV file to write; by default the table is printed, to five digits."
    )
    force: bool = option(Flag(), False, "--force", "Replace the file --out if this command wrote it.")

    def require(self, inputs: Iterable[Path] = ()) -> None:
        """Raise an error if the file cannot be written, or is one of the inputs."""
        from softness_bayes.base.files.outputs import require_outputs

        if self.out is not None:
            require_outputs(self.out.parent, [self.out.name], self._command, self.force, inputs)

    def write(self, table: pd.DataFrame) -> None:
        """Write the table, or print it to five digits."""
        from softness_bayes.base.files.outputs import write_outputs
        from softness_bayes.base.files.spreadsheet import PRINTED, csv_of
        from softness_bayes.base.readable import counted

        if self.out is None:
            click.echo(csv_of(table, index=False, digits=PRINTED), nl=False)
        else:
            write_outputs(self.out.parent, {self.out.name: csv_of(table, index=False)}, self._command)
            click.echo(f"{self.out}: {counted(len(table), 'row')}", err=True)

    @property
    def _command(self) -> str:
        return str(click.get_current_context().info_name)
