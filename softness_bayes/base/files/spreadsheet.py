"""Cells of CSV files that a spreadsheet does not run as formulas.

A spreadsheet treats text that begins with one of ``= + - @``, a tab or a carriage return as a formula. Such text is
prefixed with an apostrophe, which `unescaped` removes; numbers are unchanged.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd

PRINTED = 5
"""Significant digits of numbers that are printed; files have all."""

_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_FORMULA = "[=+@\\t\\r\\n\uff1d\uff0b\uff0d\uff20-]"  # including the full-width forms
_RUN, _ESCAPED = re.compile(f"'*{_FORMULA}"), re.compile(f"'+{_FORMULA}")


def escaped(text: str) -> str:
    """Return a text as a cell that no spreadsheet runs as a formula; `unescaped` is the inverse."""
    return f"'{text}" if _RUN.match(text) and not _NUMBER.fullmatch(text) else text


def unescaped(text: str) -> str:
    """Return the text of a cell that `escaped` made."""
    return text[1:] if _ESCAPED.match(text) else text


def csv_of(table: pd.DataFrame, index: bool = True, digits: int | None = None) -> str:
    """Return a table as CSV with escaped texts; `table_of` reads it again.

    Parameters
    ----------
    table
        Numbers and texts.
    index
        Whether the index is among the columns.
    digits
        Significant digits of numbers that are not whole; by default all.
    """
    named = _mapped(table.reset_index() if index else table, escaped)
    written = None if digits is None else f"%.{digits}g"
    return named.rename(columns=escaped).to_csv(index=False, lineterminator="\n", float_format=written)


def table_of(source: Any, index: str | list[str] | None = None) -> pd.DataFrame:
    """Return the table that `csv_of` wrote.

    Parameters
    ----------
    source
        Path or open file.
    index
        Columns of the index.
    """
    import pandas as pd

    table = _mapped(pd.read_csv(source).rename(columns=unescaped), unescaped)
    return table if index is None else table.set_index(index)


def _mapped(table: pd.DataFrame, change: Any) -> pd.DataFrame:
    """Return a table with every text changed."""
    table = table.copy()
    for name in table.columns:
        if table[name].dtype.kind not in "biufc":
            table[name] = [change(cell) if isinstance(cell, str) else cell for cell in table[name]]
    return table
