"""Numbers, shares and probabilities in one form for terminal, figures, pages and tables."""

from __future__ import annotations

import math
from typing import Any

LEAST_PLAIN, MOST_PLAIN = 1e-4, 1e7
"""Ends of the numbers that are written without an exponent."""


def number(value: float, digits: int = 3) -> str:
    """Return a number in a few digits, without an exponent unless it is very large or small; a dash for none.

    Parameters
    ----------
    value
        The number.
    digits
        Significant digits.

    Examples
    --------
    >>> [number(value) for value in (1234.5, 0.05, 2e9, float("nan"))]
    ['1230', '0.05', '2e+09', '–']
    """
    value = float(value)
    if not math.isfinite(value):
        return "–"
    short = f"{value:.{digits}g}"
    return f"{float(short):.12g}" if LEAST_PLAIN <= abs(value) < MOST_PLAIN else short


def counted(count: int, one: str, more: str = "") -> str:
    """Return a count with the words for it.

    Parameters
    ----------
    count
        The number.
    one, more
        Words after the number 1 and after any other number; by default, `more` is `one` with an s.

    Examples
    --------
    >>> [counted(count, "run") for count in (0, 1, 2)]
    ['0 runs', '1 run', '2 runs']
    >>> counted(1, "person has", "people have")
    '1 person has'
    """
    return f"{count} {one if count == 1 else more or f'{one}s'}"


def some_of(count: int, total: int, noun: str, one: str = "is", more: str = "are") -> str:
    """Return a part of a total with its noun and its verb.

    Parameters
    ----------
    count, total
        The part and the total.
    noun
        The noun for one; its plural has an s.
    one, more
        The verb after a part of 1 and of any other number.

    Examples
    --------
    >>> [some_of(1, 5, "table"), some_of(2, 5, "table", "has", "have"), some_of(1, 1, "table", "was", "were")]
    ['1 of 5 tables is', '2 of 5 tables have', '1 of 1 table was']
    """
    return f"{count} of {counted(total, noun)} {one if count == 1 else more}"


def percent(share: float | None, digits: int = 0) -> str:
    """Return a share in per cent; only exactly 0 and 1 are shown as 0 % and 100 %.

    Parameters
    ----------
    share
        The share; None or a value that is not finite gives a dash.
    digits
        Digits after the decimal point.

    Examples
    --------
    >>> [percent(share) for share in (0.0, 0.002, 0.5, 0.997, 1.0)]
    ['0 %', '<1 %', '50 %', '>99 %', '100 %']
    >>> percent(0.99999, 1)
    '>99.9 %'
    """
    if share is None or not math.isfinite(share):
        return "–"
    if share in (0.0, 1.0):
        return f"{100 * share:.0f} %"
    least = 10.0 ** -(2 + digits)
    if 0.0 < share < least:
        return f"<{100 * least:.{digits}f} %"
    if 1.0 - least < share < 1.0:
        return f">{100 * (1.0 - least):.{digits}f} %"
    return f"{100 * share:.{digits}f} %"


def chance(probability: float) -> str:
    """Return a probability estimated from draws, in per cent: never 0 % or 100 %, which draws cannot establish.

    Parameters
    ----------
    probability
        The share of draws.

    Examples
    --------
    >>> [chance(share) for share in (0.0, 0.5, 1.0)]
    ['<1 %', '50 %', '>99 %']
    """
    return {0.0: "<1 %", 1.0: ">99 %"}.get(float(probability)) or percent(probability)


def with_error(value: Any, error: Any, unit: str = "") -> str:
    """Return a number with its standard error, which may be missing; a dash for no number.

    Examples
    --------
    >>> with_error(12.345, 0.678, " kPa"), with_error(1.0, float("nan")), with_error(float("nan"), 1.0)
    ('12.3 ± 0.7 kPa', '1', '–')
    """
    if not math.isfinite(value):
        return "–"
    return f"{number(value)}{f' ± {number(error, 1)}' if math.isfinite(error) else ''}{unit}"


def interval(row: Any, name: str) -> str:
    """Return the number of a row under a name with its limits, under NAME_low and NAME_high.

    Examples
    --------
    >>> interval({"b": 81.23, "b_low": 70.0, "b_high": 95.5}, "b")
    '81.2 (70 to 95.5)'
    """
    return f"{number(row[name])} ({number(row[f'{name}_low'])} to {number(row[f'{name}_high'])})"


def sentence(text: str) -> str:
    """Return a text with a capital and one period.

    Examples
    --------
    >>> sentence("moduli: fine")
    'Moduli: fine.'
    """
    return f"{text[:1].upper()}{text[1:].rstrip('.')}."
