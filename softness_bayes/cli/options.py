"""Options that several verbs share, each declared once; decorators that hand a verb what they amount to."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from softness_bayes.defaults import ACCURACY, PRIOR_SET, SEED
from softness_bayes.errors import InputError
from softness_bayes.likelihood.directions import RATING_DIRECTIONS, RISES, direction_named
from softness_bayes.likelihood.scales import MAGNITUDE, RATING_SCALES
from softness_bayes.ranges import ACCURACIES, Count, Range

if TYPE_CHECKING:
    from softness_bayes.data import Compression, Experiment, Fabrics
    from softness_bayes.model.options import ModelOptions
    from softness_bayes.parameters.priors import Prior
    from softness_bayes.touch.contact import Load
    from softness_bayes.touch.readings import Readings

Value = TypeVar("Value")
Verb = Callable[..., Any]
Decorator = Callable[[Verb], Verb]


class Number(click.FloatRange):
    """A number within a range; what is not finite is none.

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
    return click.IntRange(count.low, count.high)


def named(
    convert: Callable[[str], Value], check: Callable[[dict[str, Value]], None] | None = None
) -> Callable[..., dict[str, Value]]:
    """Return the click callback that turns repeated `name=value` into a dictionary.

    Parameters
    ----------
    convert
        Makes a value of its text; raises ValueError saying what it expected.
    check
        Raises ValueError where names and values do not suit one another.
    """

    def callback(ctx: click.Context, param: click.Parameter, texts: tuple[str, ...]) -> dict[str, Value]:
        values: dict[str, Value] = {}
        for text in texts:
            name, _, value = (part.strip() for part in text.partition("="))
            if not (name and value):
                raise click.BadParameter(f"expected NAME=VALUE, got {text!r}")
            if name in values:
                raise click.BadParameter(f"{name!r} is given twice")
            try:
                values[name] = convert(value)
            except ValueError as error:
                raise click.BadParameter(f"{name}: {error}") from None
        if check is not None and values:
            try:
                check(values)
            except ValueError as error:
                raise click.BadParameter(str(error)) from None
        return values

    return callback


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"expected a finite number, got {text!r}")
    return value


def _prior(text: str) -> Prior:
    from softness_bayes.parameters.priors import parse_prior

    return parse_prior(text)


def _require_values(values: dict[str, float]) -> None:
    from softness_bayes.parameters.choice import require_values

    require_values(values)


def _require_priors(priors: dict[str, Prior]) -> None:
    from softness_bayes.parameters.choice import require_priors

    require_priors(priors)


def _require_finger(values: dict[str, float]) -> None:
    from softness_bayes.model.fingers import require_finger

    require_finger(values)


def _named_option(flag: str, convert: Callable[[str], Any], metavar: str, text: str) -> Decorator:
    return click.option(flag, multiple=True, callback=named(convert), metavar=metavar, help=text)


_FILE = click.Path(path_type=Path)

_column = click.option(
    "--column",
    "columns",
    multiple=True,
    callback=named(str),
    metavar="NAME=ACTUAL",
    help="What a column is called in the files, as in rating=softness. Repeatable.",
)


decimal = click.option(
    "--decimal",
    type=click.Choice([",", "."]),
    help="What stands before the decimals in the files, where their numbers do not tell; the other groups thousands.",
)
"""Gives a verb `decimal`, a mark or None."""


def _fabrics(required: bool, text: str) -> Decorator:
    return click.option("--fabrics", type=_FILE, metavar="FILE", required=required, help=text)


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
    """The files of an experiment and how to read them, as asked for on the command line."""

    data: Path | None
    fabrics: Path | None
    columns: Mapping[str, str]
    indentation_mm: float | None
    force_n: float | None
    compression: Path | None
    decimal: str | None = None

    @property
    def paths(self) -> tuple[Path, ...]:
        """The files that may be read, the fabrics beside the ratings among them."""
        from softness_bayes.data import FABRICS_BESIDE

        beside = None if self.data is None else self.data.with_name(FABRICS_BESIDE)
        return tuple(path for path in (self.data, self.fabrics, self.compression, beside) if path is not None)

    def read(self) -> Experiment | Compression:
        """Return the ratings, their fabrics and compression data if there are any; or these alone.

        Raises
        ------
        UsageError
            If there is neither table.
        InputError
            If there is an option of ratings without them.
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
            )
        if self.compression is None:
            raise click.UsageError("no data: give ratings with --data, a plate's forces with --compression, or both")
        if not self.fabrics is self.indentation_mm is self.force_n is None:
            raise InputError(
                "--fabrics, --indentation-mm and --force-n are for ratings: give --data, or leave them out"
            )
        return Compression.read(self.compression, columns=self.columns, decimal=self.decimal)


def data_files(verb: Verb) -> Verb:
    """Give a verb the options that name an experiment; it receives `files`, a `DataFiles`."""

    @click.option("--data", type=_FILE, metavar="FILE", help="Table of ratings (CSV).")
    @click.option(
        "--compression",
        type=_FILE,
        metavar="FILE",
        help="Forces of a rigid flat plate on fingerpads (CSV: participant, indentation_mm, force_n), beside "
        "ratings or alone.",
    )
    @_fabrics(False, "Fabric table (CSV); by default columns of the ratings, or a fabrics.csv beside them.")
    @_column
    @decimal
    @load_options(False, " of all ratings, where the table has no column for it.")
    @functools.wraps(verb)
    def wrapped(
        data: Path | None,
        fabrics: Path | None,
        columns: dict[str, str],
        decimal: str | None,
        indentation_mm: float | None,
        force_n: float | None,
        compression: Path | None,
        **others: Any,
    ) -> Any:
        files = DataFiles(data, fabrics, columns, indentation_mm, force_n, compression, decimal)
        return verb(files=files, **others)

    return wrapped


@dataclass(frozen=True)
class Touches:
    """Fabrics and the loads to touch them under, as asked for on the command line."""

    fabrics: Path
    columns: Mapping[str, str]
    indentation_mm: tuple[float, ...]
    force_n: tuple[float, ...]
    decimal: str | None = None

    def read(self) -> tuple[Fabrics, tuple[Load, ...]]:
        """Return the fabrics and the distinct loads.

        Raises
        ------
        InputError
            If no load was asked for.
        """
        from softness_bayes.data import Fabrics, loads_of

        loads = loads_of(self.indentation_mm, self.force_n)
        if not loads:
            raise InputError("no load: give at least one --indentation-mm or --force-n")
        return Fabrics.read(self.fabrics, columns=self.columns, decimal=self.decimal), loads


def touches(verb: Verb) -> Verb:
    """Give a verb the options that name fabrics and loads; it receives `touches`, a `Touches`."""

    @_fabrics(True, "Fabric table (CSV).")
    @_column
    @decimal
    @load_options(True, " of the touch. Repeatable.")
    @functools.wraps(verb)
    def wrapped(
        fabrics: Path,
        columns: dict[str, str],
        decimal: str | None,
        indentation_mm: tuple[float, ...],
        force_n: tuple[float, ...],
        **others: Any,
    ) -> Any:
        return verb(touches=Touches(fabrics, columns, indentation_mm, force_n, decimal), **others)

    return wrapped


set_values = click.option(
    "--set",
    "values",
    multiple=True,
    callback=named(_number, _require_values),
    metavar="NAME=VALUE",
    help="Value of a parameter, as in b=80; the others are the medians of their priors. Repeatable.",
)
"""Gives a verb `values`, name -> number."""

fix = click.option(
    "--fix",
    "fixed",
    multiple=True,
    callback=named(_number, _require_values),
    metavar="NAME=VALUE",
    help="Hold a parameter at a value, as in m=2. Repeatable.",
)
"""Gives a verb `fixed`, name -> number."""

prior = click.option(
    "--prior",
    "priors",
    multiple=True,
    callback=named(_prior, _require_priors),
    metavar="NAME=PRIOR",
    help="Prior of a parameter, as in b='lognormal(100,0.5)' (median, sd of the log). Repeatable.",
)
"""Gives a verb `priors`, name -> `Prior`."""

prior_set = click.option(
    "--priors",
    "prior_set",
    default=PRIOR_SET,
    show_default=True,
    metavar="SET",
    help="Named set of priors that --prior departs from: default, in-vivo or wide.",
)
"""Gives a verb `prior_set`, the name of one of the sets."""

_READING = click.option(
    "--reading",
    "overrides",
    multiple=True,
    callback=named(str),
    metavar="PLACE=NAME",
    help="Another reading of one place of the model, as in pressure=hertz. Repeatable.",
)
_READING_SET = click.option(
    "--readings",
    "reading_set",
    metavar="SET",
    help="Named set of readings that --reading departs from: mended (the default), printed or hertz.",
)


@dataclass(frozen=True)
class ReadingChoice:
    """The readings asked for on the command line."""

    set_name: str | None
    overrides: Mapping[str, str]

    @property
    def is_default(self) -> bool:
        """True if no option was given."""
        return self.set_name is None and not self.overrides

    def resolve(self) -> Readings:
        """Return the readings; without a named set those departed from are the default ones."""
        from softness_bayes.touch.readings import readings_named

        return readings_named(self.set_name or "mended", self.overrides)


def readings(verb: Verb) -> Verb:
    """Give a verb the options that choose readings; it receives `choice`, a `ReadingChoice`."""

    @_READING_SET
    @_READING
    @functools.wraps(verb)
    def wrapped(reading_set: str | None, overrides: dict[str, str], **others: Any) -> Any:
        return verb(choice=ReadingChoice(reading_set, overrides), **others)

    return wrapped


finger = click.option(
    "--finger",
    "finger",
    multiple=True,
    callback=named(_number, _require_finger),
    metavar="NAME=VALUE",
    help="Another finger, as in receptor_depth_mm=0.6: radius_mm, receptor_depth_mm, poisson_ratio, pad_length_mm, "
    "pad_width_mm, contact_x_mm or contact_y_mm. Repeatable.",
)
"""Gives a verb `finger`, name -> number, from which `model.fingers.finger_of` makes a `Finger`."""

accuracy = click.option(
    "--accuracy",
    type=Number(ACCURACIES),
    default=ACCURACY,
    show_default=True,
    metavar="X",
    help="Bound of the response's numerical error, relative to its peak and in log(N/N_ref + eps): the cheapest "
    "resolution that keeps to it over the parameters in question is chosen; 'plan' shows how.",
)
"""Gives a verb `accuracy`."""

AUTO = "auto"


class _Direction(click.Choice[str]):
    """The directions of ratings, by their names or former names."""

    def __init__(self, *also: str) -> None:
        super().__init__([*also, *RATING_DIRECTIONS])

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        former = {one.former: one.name for one in RATING_DIRECTIONS.values()}
        return super().convert(former.get(value, value), param, ctx)


direction = click.option(
    "--direction",
    type=_Direction(),
    default=RISES.name,
    show_default=True,
    help="Whether ratings rise or fall with the response.",
)
"""Gives a verb `direction`, the name of a reading of what is rated."""

_DIRECTION_OF_DATA = click.option(
    "--direction",
    type=_Direction(AUTO),
    default=AUTO,
    show_default=True,
    help="Whether ratings rise or fall with the response; auto takes what the data show, or "
    f"{RISES.name} where they do not tell.",
)


@dataclass(frozen=True)
class ModelChoice:
    """The model to fit, as asked for on the command line."""

    fixed: Mapping[str, float]
    priors: Mapping[str, Prior]
    prior_set: str
    choice: ReadingChoice
    direction: str
    """A name, or `AUTO`."""
    accuracy: float
    finger: Mapping[str, float]

    def options(self, **others: Any) -> ModelOptions:
        """Return the options of this model and `others`; its resolution is not chosen yet."""
        from softness_bayes.model.fingers import finger_of
        from softness_bayes.model.options import ModelOptions

        return ModelOptions(
            fix=self.fixed,
            priors=self.priors,
            prior_set=self.prior_set,
            readings=self.choice.resolve(),
            direction=None if self.direction == AUTO else direction_named(self.direction),
            accuracy=self.accuracy,
            finger=finger_of(self.finger),
            **others,
        )


def model_choice(verb: Verb) -> Verb:
    """Give a verb the options of a model that is fitted; it receives `model`, a `ModelChoice`."""

    @fix
    @prior
    @prior_set
    @readings
    @_DIRECTION_OF_DATA
    @finger
    @accuracy
    @functools.wraps(verb)
    def wrapped(
        fixed: dict[str, float],
        priors: dict[str, Prior],
        prior_set: str,
        choice: ReadingChoice,
        direction: str,
        finger: dict[str, float],
        accuracy: float,
        **others: Any,
    ) -> Any:
        model = ModelChoice(fixed, priors, prior_set, choice, direction, accuracy, finger)
        return verb(model=model, **others)

    return wrapped


rating_scale = click.option(
    "--ratings",
    "scale",
    type=click.Choice([*RATING_SCALES]),
    default=MAGNITUDE.name,
    show_default=True,
    help=f"Whether ratings are {', or '.join(scale.meaning for scale in RATING_SCALES.values())}.",
)
"""Gives a verb `scale`, the name of a reading of the rating scale."""

seed = click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=SEED,
    show_default=True,
    help="Seed of the random numbers: equal seeds, equal results.",
)
"""Gives a verb `seed`."""

out = click.option(
    "--out",
    type=_FILE,
    metavar="DIR",
    default=Path("results"),
    show_default=True,
    help="Directory to write to; one that is not empty is refused.",
)
"""Gives a verb `out`."""

force = click.option("--force", is_flag=True, help="Replace the files in --out that this command wrote, and no others.")
"""Gives a verb `force`."""
