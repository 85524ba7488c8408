"""Declaration of options, each in one place: for Python, the command line, and the record of a run.

A class of options is a frozen dataclass derived from `Options`. Each of its fields is declared by `option`, with its
kind of value, its default, its flag and its help. Keywords and checks in Python, options of commands, their help, the
record in results and checkpoints, and the command that repeats a run all follow from this declaration.

This module and the modules that declare options import no numerical library before a value needs it, so that ``--help``
is fast.
"""

from __future__ import annotations

import dataclasses
import math
import numbers as numeric
import os
import re
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Self, TypeVar

from softness_bayes.base.errors import InputError
from softness_bayes.base.ranges import Count, Range, refuse, require_kind

Described = TypeVar("Described", bound="Options")

AUTO = "auto"
"""The word that leaves a choice to the data; in Python and in records it is None."""


def later(place: str) -> Any:
    """Return the object at MODULE:NAME of this package, imported when it is needed, so that help needs no NumPy."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


class Kind:
    """Kind of values of an option: texts, unless a subclass says otherwise.

    A subclass whose values are not texts redefines `parse` and `write`. Records hold numbers as they are, and other
    values in their texts.
    """

    metavar = "TEXT"
    """The value in the help of the command line."""
    repeated = False
    """True if the option may be given several times; `parse` then takes all texts, and `write` returns all."""
    choices: Sequence[str] = ()
    """Words that the value may be, if there are few."""
    group = ""
    """Group of entry points from which a value that is not among the choices may come."""
    of = ""
    """MODULE:NAME of the class of the values, if they are not texts."""
    such_as = "a text"
    """Examples of values, for messages."""

    def accept(self, name: str, value: Any) -> Any:
        """Return a value given in Python in its final form.

        Raises
        ------
        InputError
            Naming the option, if it cannot have this value.
        """
        require_kind(name, value, later(self.of) if self.of else str, self.such_as)
        return value

    def parse(self, text: Any) -> Any:
        """Return the value of a text on the command line, or raise InputError with what was expected."""
        return text

    def write(self, value: Any) -> Any:
        """Return the text of a value on the command line; `parse` is the inverse."""
        return str(value)

    def store(self, value: Any) -> Any:
        """Return a value as JSON data."""
        return value if isinstance(value, (bool, int, float)) else self.write(value)

    def restore(self, stored: Any) -> Any:
        """Return the value of JSON data; the inverse of `store`."""
        return self.parse(stored) if isinstance(stored, (str, list)) else stored

    def complete(self, incomplete: str) -> Iterable[str]:
        """Return the words that a shell may offer."""
        return ()


@dataclass(frozen=True)
class Number(Kind):
    """Numbers in a range; whole numbers if the range is a `Count`."""

    range: Range
    metavar: str = "X"

    def accept(self, name: str, value: Any) -> float:
        """Return a number in the range."""
        self.range.require(name, value)
        return self._type(value)

    def parse(self, text: str) -> float:
        """Return the number of a text, if it is in the range."""
        try:
            value = self._type(text)
        except ValueError:
            value = math.nan
        if not self.range.holds(value):
            raise InputError(f"expected {self.range}, got {text!r}")
        return value

    @property
    def _type(self) -> Callable[[Any], float]:
        return int if isinstance(self.range, Count) else float


class Duration(Kind):
    """Times [s], on the command line in seconds, minutes or hours."""

    metavar = "TIME"

    def accept(self, name: str, value: Any) -> Any:
        """Return a number of seconds; it may be infinite."""
        require_kind(name, value, numeric.Real, "a number of seconds")
        return value

    def parse(self, text: str) -> float:
        """Return the seconds of a text such as 90, 90s, 10m or 2h."""
        match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([smh]?)", text.strip())
        if match is None:
            raise InputError(f"expected a time such as 90, 90s, 10m or 2h, got {text!r}")
        return float(match[1]) * {"": 1, "s": 1, "m": 60, "h": 3600}[match[2]]


class Flag(Kind):
    """True or False; on the command line, the flag alone."""

    def accept(self, name: str, value: Any) -> Any:
        """Return a truth value."""
        return bool(value)


class Numbers(Kind):
    """Two numbers, the lower one first."""

    metavar = "LOW,HIGH"
    _EXPECTED = "two numbers, the lower one first, as in (0, 100)"

    def accept(self, name: str, value: Any) -> tuple[float, float]:
        """Return two numbers in their order."""
        try:
            low, high = (float(end) for end in value)
        except (TypeError, ValueError):
            refuse(name, value, self._EXPECTED)
        if isinstance(value, str) or not -1e100 < low < high < 1e100:
            refuse(name, value, self._EXPECTED)
        return low, high

    def parse(self, text: str) -> tuple[float, float]:
        """Return the numbers of a text such as 0,100."""
        try:
            low, high = (float(part) for part in text.split(","))
        except ValueError:
            raise InputError(f"{text!r}, expected two numbers, as in 0,100") from None
        if not -1e100 < low < high < 1e100:
            raise InputError(f"{text!r}, expected the lower end first, as in 0,100")
        return low, high

    def write(self, value: Sequence[float]) -> str:
        """Return the numbers, separated by a comma."""
        return ",".join(repr(float(number)).removesuffix(".0") for number in value)


def deferred(place: str) -> Callable[..., Any]:
    """Return a function that imports the one at MODULE:NAME when it is called."""
    return lambda *given: later(place)(*given)


class Names(Kind):
    """Several names, separated by commas on the command line.

    Parameters
    ----------
    known
        Function that returns the names in their order, or raises an error for an unknown one; by default all are known.
    """

    metavar = "NAMES"

    def __init__(self, known: Callable[[Sequence[str]], Any] = tuple) -> None:
        self._known = known

    def accept(self, name: str, value: Any) -> Any:
        """Return a tuple of known names."""
        require_kind(name, value, tuple, "a tuple of names, such as ('b',)")
        return self._known(value)

    def parse(self, text: str) -> Any:
        """Return the names of a text such as b,m."""
        return self._known(tuple(name.strip() for name in text.split(",") if name.strip()))

    def write(self, value: Sequence[str]) -> str:
        """Return the names, separated by commas."""
        return ",".join(value)


def as_number(name: str, value: Any) -> Any:
    """Return the value of a name as a number; a text must be a finite one."""
    if not isinstance(value, str):
        return value
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"expected a finite number, got {value!r}")
    return number


class ByName(Kind):
    """Values by name, given as NAME=VALUE, once for each name; in records a mapping.

    Parameters
    ----------
    metavar, such_as
        A value on the command line, and examples in Python.
    value
        Function that returns the value of a name, given as a text or as it is.
    check
        Function that raises an error if the values of a command line do not suit their names.
    complete
        Function that returns the words for an incomplete one.
    of, made, parts
        MODULE:NAME of a class of objects, function that makes one of values by name, and function that returns the
        values of one; by default the mapping is the object.
    """

    repeated = True

    def __init__(
        self,
        metavar: str = "NAME=VALUE",
        such_as: str = "a mapping, as in {'rating': 'softness'}",
        value: Callable[[str, Any], Any] = lambda name, value: value,
        check: Callable[[Any], Any] = dict,
        complete: Callable[[str], Iterable[str]] = lambda incomplete: (),
        of: str = "",
        made: Callable[[Any], Any] = dict,
        parts: Callable[[Any], Any] = dict,
    ) -> None:
        self.metavar, self.such_as, self.of = metavar, such_as, of
        self.complete = complete  # type: ignore[method-assign, assignment]
        self._value, self._check, self._made, self._parts = value, check, made, parts

    def accept(self, name: str, value: Any) -> Any:
        """Return an object of the class, or values by name."""
        if self.of:
            return super().accept(name, value)
        require_kind(name, value, Mapping, self.such_as)
        return self.restore(value)

    def parse(self, texts: Sequence[str]) -> Any:
        """Return the object of texts such as b=80."""
        values: dict[str, Any] = {}
        for text in texts:
            name, _, value = (part.strip() for part in text.partition("="))
            if not (name and value):
                raise InputError(f"expected NAME=VALUE, got {text!r}")
            if name in values:
                raise InputError(f"{name!r} is given twice")
            try:
                values[name] = self._value(name, value)
            except ValueError as error:
                raise InputError(f"{name}: {error}") from None
        if values:
            self._check(values)
        return self._made(values)

    def write(self, value: Any) -> list[str]:
        """Return one text for each name."""
        return [
            f"{name}={one if isinstance(one, str) else repr(float(one))}" for name, one in self.store(value).items()
        ]

    def store(self, value: Any) -> Any:
        """Return numbers and texts by name."""
        return {name: one if isinstance(one, (int, float)) else str(one) for name, one in self._parts(value).items()}

    def restore(self, stored: Any) -> Any:
        """Return the object of numbers and texts by name."""
        return self._made({name: self._value(name, one) for name, one in stored.items()})


class FilePath(Kind):
    """Paths of files."""

    metavar = "FILE"

    def accept(self, name: str, value: Any) -> Path:
        """Return the path."""
        require_kind(name, value, (str, os.PathLike), "a path")
        return Path(value)

    def parse(self, text: str) -> Path:
        """Return the path."""
        return Path(text)


@dataclass(frozen=True)
class Option:
    """Declaration of one option.

    Parameters
    ----------
    name
        Keyword in Python, and name in records.
    kind
        Its values. If the default is None, None is allowed as well.
    make
        Makes the default value, which may need a numerical library.
    flag
        Flag on the command line; empty if the option is for Python alone.
    help
        Description of the option.
    shown
        Whether the help states the default.
    spelled
        Whether a command that repeats a run states the option even where it has the default.
    needs_ratings
        Whether only a model of ratings has the option.
    affects_draws
        Whether the option changes the draws in a way that neither the data nor the parameters of the model show.
    set_flag
        Second flag, which a command that repeats a run uses for a value without a name; empty if there is none.
    """

    name: str
    kind: Kind
    make: Callable[[], Any]
    flag: str = ""
    help: str = ""
    shown: bool = False
    spelled: bool = False
    needs_ratings: bool = False
    affects_draws: bool = False
    set_flag: str = ""

    @cached_property
    def default(self) -> Any:
        """The default value."""
        return None if (value := self.make()) is None else self.kind.accept(self.name, value)

    def accept(self, value: Any) -> Any:
        """Return a value given in Python in its final form, as `Kind.accept`."""
        return None if value is None and self.default is None else self.kind.accept(self.name, value)

    def written(self, value: Any) -> str:
        """Return a value in words."""
        if value is None:
            return AUTO if AUTO in self.kind.choices else ""
        text = self.kind.write(value)
        return text if isinstance(text, str) else ", ".join(text)

    def words(self, value: Any) -> list[str]:
        """Return the words of a command line that give this value."""
        if isinstance(self.kind, Flag):
            return [self.flag] * value
        if value is None:
            return [self.flag, AUTO] if AUTO in self.kind.choices else []
        written = self.kind.write(value)
        texts = [written] if isinstance(written, str) else written
        flags = [self.set_flag if self.set_flag and "=" not in text else self.flag for text in texts]
        return [word for pair in zip(flags, texts, strict=True) for word in pair]


def option(
    kind: Kind,
    default: Any = None,
    flag: str = "",
    help: str = "",
    *,
    default_factory: Callable[[], Any] | None = None,
    **more: Any,
) -> Any:
    """Return a field of a class of options; arguments as for `Option`, and `default_factory` as for a dataclass."""
    declared = {"kind": kind, "flag": flag, "help": help, **more}
    if default_factory is not None:
        return dataclasses.field(default_factory=default_factory, metadata=declared)
    return dataclasses.field(default=default, metadata=declared)


def described(options: type[Described]) -> type[Described]:
    """Collect the declarations of a class of options, and add them to its docstring."""
    declared, indent = {}, " " * 8
    lines = [options.__doc__ or "", "", "    Parameters", "    ----------"]
    for field in dataclasses.fields(options):  # type: ignore[arg-type]
        constant = field.default_factory is dataclasses.MISSING
        make: Any = (lambda value=field.default: value) if constant else field.default_factory
        one = declared[field.name] = Option(field.name, make=make, **field.metadata)
        text = f"{one.help} (`{one.flag}`)" if one.flag else one.help
        lines += [f"    {one.name}", *textwrap.wrap(text, 112, initial_indent=indent, subsequent_indent=indent)]
    options.__doc__ = "\n".join([*lines, "    "])
    options.declared = MappingProxyType(declared)
    options.__repr__ = Options.__repr__  # type: ignore[method-assign]  # that of a dataclass names all fields
    return options


class Options:
    """Base of frozen dataclasses whose fields are declared by `option`; the decorator `described` collects them."""

    declared: ClassVar[Mapping[str, Option]] = MappingProxyType({})
    """The declarations, by name."""

    def __repr__(self) -> str:
        changed = [name for name, one in self.declared.items() if getattr(self, name) != one.default]
        return f"{type(self).__name__}({', '.join(f'{name}={getattr(self, name)!r}' for name in changed)})"

    def __post_init__(self) -> None:
        for name, one in self.declared.items():
            object.__setattr__(self, name, one.accept(getattr(self, name)))

    def record(self) -> dict[str, Any]:
        """Return these options as JSON data; `from_record` is the inverse."""
        values = [(name, one.kind, getattr(self, name)) for name, one in self.declared.items()]
        return {name: None if value is None else kind.store(value) for name, kind, value in values}

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Self:
        """Return the options of a record.

        Raises
        ------
        InputError
            If an option is missing, unknown or invalid.
        """
        options = cls.declared
        if record.keys() != options.keys():
            wrong = sorted(record.keys() ^ options.keys())[0]
            raise InputError(f"options of a run that this version cannot read: {wrong!r} is missing or unknown")
        try:
            values = {
                name: None if value is None else options[name].kind.restore(value) for name, value in record.items()
            }
            return cls(**values)
        except (AttributeError, InputError, KeyError, TypeError, ValueError) as error:
            raise InputError(f"options of a run that this version cannot read: {error}") from None

    def changed(self) -> dict[str, str]:
        """Return the options that differ from their defaults, with their values in words."""
        return {
            name: one.written(value)
            for name, one in self.declared.items()
            if (value := getattr(self, name)) != one.default
        }

    def words(self, *names: str) -> list[str]:
        """Return the words of a command line that give these options, those with their defaults left out.

        Parameters
        ----------
        names
            The options to give; by default all that have a flag.
        """
        values = [(self.declared[name], getattr(self, name)) for name in names or self.declared]
        return [
            word
            for one, value in values
            if one.flag and (one.spelled or value != one.default)
            for word in one.words(value)
        ]
