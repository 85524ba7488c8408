"""Types of options: numbers within a range, counts, files, and names with values."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from softness_bayes.ranges import Count, Range

Value = TypeVar("Value")
Verb = Callable[..., Any]
Decorator = Callable[[Verb], Verb]

FILE = click.Path(path_type=Path)


class Number(click.FloatRange):
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
    return click.IntRange(count.low, count.high)


def named(
    convert: Callable[[str], Value], check: Callable[[dict[str, Value]], None] | None = None
) -> Callable[..., dict[str, Value]]:
    """Return the click callback that turns repeated `name=value` into a dictionary.

    Parameters
    ----------
    convert
        Converts the text of a value; raises ValueError with the expected form.
    check
        Raises ValueError if names and values are incompatible.
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


def finite(text: str) -> float:
    """Return a text as a finite number.

    Raises
    ------
    ValueError
        If the text is not one.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"expected a finite number, got {text!r}")
    return value
