"""Observed order of fabrics, for comparison with the order that a model predicts."""

from __future__ import annotations

import numpy as np

from softness_bayes.data.columns import RANK, RATING
from softness_bayes.data.decimals import Marks
from softness_bayes.data.headers import RANKED
from softness_bayes.data.tables import read_table
from softness_bayes.data.workbooks import TableSource
from softness_bayes.errors import InputError


def read_order(path: TableSource, decimal: Marks = None) -> dict[str, float]:
    """Return a rank for each fabric in a table, smaller for softer ones; several rows are averaged.

    Parameters
    ----------
    path
        Table with the columns `fabric`, and `rank` (1 for the softest) or `rating` (higher for softer).
    decimal
        Decimal mark, "," or "."; by default inferred from the file, which is rejected if ambiguous.

    Raises
    ------
    InputError
        If a column or a cell is missing, or there are both ranks and ratings.
    """
    table = read_table(path, RANKED, {}, decimal)
    table.require("fabric")
    given = [column for column in (RANK, RATING) if column.name in table]
    if len(given) != 1:
        raise InputError(f"{table.place}: expected a column {RANK.name!r} or a column {RATING.name!r}, but not both")
    (column,) = given
    values = table.numbers(column)
    for i in np.flatnonzero(np.isnan(values)).tolist():
        table.fault(i, column.name, "is empty")
    labels = np.array(table.labels("fabric"))
    table.check()
    sign = 1.0 if column is RANK else -1.0
    return {str(name): sign * float(values[labels == name].mean()) for name in dict.fromkeys(labels.tolist())}
