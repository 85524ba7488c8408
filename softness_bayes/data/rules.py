"""The ways in which a table can be odd, each a rule, in the order in which they are looked for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeVar

from softness_bayes.data import contents, shapes
from softness_bayes.data.contents import Table
from softness_bayes.data.shapes import Request
from softness_bayes.data.sheets import Grid, Sheet, headed

ALL = ("ratings", "fabrics", "compression")

Subject = TypeVar("Subject")


class Rule(NamedTuple):
    """One way in which a table can be odd.

    A rule returns the table as a person would understand it, with a note that says so; a table that can be understood
    in several ways is refused, with a message that says which; any other table is returned unchanged.
    """

    name: str
    tables: Sequence[str]
    """The tables in which it is looked for."""
    apply: Callable[..., object]


ROWS = (
    Rule("comments", ALL, shapes.without_comments),
    Rule("lines above the header", ALL, shapes.without_preamble),
    Rule("rows of a survey", ("ratings",), shapes.without_survey_rows),
    Rule("several rows of titles", ALL, shapes.with_one_row_of_titles),
    Rule("remarks below", ("ratings", "compression"), shapes.without_remarks),
)
"""Rules for the rows of a table, before its header is known; they take and return a `Grid`."""

COLUMNS = (
    Rule("JSON in cells", ALL, shapes.with_json_cells),
    Rule("plus-minus", ("fabrics", "compression"), shapes.with_values_alone),
    Rule("no title of names", ("fabrics",), shapes.with_a_title_of_names),
    Rule("directions side by side", ("fabrics",), shapes.with_directions_in_rows),
    Rule("choices", ("ratings",), shapes.with_choices_as_pairs),
    Rule("people in columns", ("ratings",), shapes.with_people_in_rows),
    Rule("fabrics in columns", ("ratings",), shapes.with_fabrics_in_rows),
)
"""Rules for the columns of a table, before all of them are known; they take a `Sheet` and a `Request`."""

CONTENTS = (
    Rule("other columns of the same name", ALL, contents.without_namesakes),
    Rule("percentages", ("ratings",), contents.with_percentages),
    Rule("rows of statistics", ALL, contents.without_statistics),
    Rule("names of one identity", ALL, contents.with_one_spelling),
    Rule("dates as names", ALL, contents.with_dates_named),
    Rule("unknown people", ("ratings", "compression"), contents.with_people_known),
    Rule("copied rows", ("ratings",), contents.without_copies),
    Rule("steps of other numbers", ("ratings",), contents.with_true_steps),
    Rule("reversed signs", ("compression",), contents.with_signs_of_pressing),
    Rule("noise about zero", ("compression",), contents.without_noise),
    Rule("way back", ("compression",), contents.without_unloading),
)
"""Rules for the cells of a table, whose columns are known; they take and return a `Table`."""


def applied(rules: Sequence[Rule], kind: str, subject: Subject, *more: object) -> Subject:
    """Return a table after the rules for tables of its kind."""
    for rule in rules:
        if kind in rule.tables:
            subject = rule.apply(subject, *more)  # type: ignore[assignment]
    return subject


def sheet_of(grid: Grid, kind: str) -> Sheet:
    """Return the sheet of some rows of cells, after the rules for rows."""
    return headed(applied(ROWS, kind, grid))


def as_understood(sheet: Sheet, request: Request) -> Sheet:
    """Return a sheet after the rules for columns."""
    return applied(COLUMNS, request.sought.sheet, sheet, request)


def checked(table: Table, kind: str) -> Table:
    """Return a table after the rules for cells.

    Raises
    ------
    InputError
        If it can be understood in several ways.
    """
    return applied(CONTENTS, kind, table)
