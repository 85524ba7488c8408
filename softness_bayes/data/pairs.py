"""Tables of pairs, in which each row names two fabrics and the answer as to which was softer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from softness_bayes.data.columns import RATING, SECOND_FABRIC
from softness_bayes.data.tables import MISSING, Table
from softness_bayes.errors import quoted

_OTHER = {"0": "1", "1": "0", "0.5": "0.5", "1.0": "0", "0.0": "1", "": ""}
"""Answer for the second fabric of a pair, by the answer for the first."""


def unpaired(table: Table) -> Table:
    """Return a table of pairs with two rows per pair, which form a list; other tables are returned unchanged."""
    if SECOND_FABRIC not in table:
        return table
    if "list" in table:
        table.faults.add_general(
            f"columns {table.titles[SECOND_FABRIC]!r} and {table.titles['list']!r}: each row is already a "
            "pair, so a list has no meaning; remove one of these columns"
        )
    answers = ["" if text.casefold() in MISSING else text.replace(",", ".") for text in table.cells[RATING.name]]
    for i, text in enumerate(answers):
        if text not in _OTHER:
            table.fault(
                i,
                RATING.name,
                "expected 1 if the first fabric of the pair was softer, 0 if the second was, or 0.5 if neither, got "
                f"{quoted(table.cells[RATING.name][i])}",
            )
        if table.cells["fabric"][i] == table.cells[SECOND_FABRIC][i]:
            table.fault(
                i, SECOND_FABRIC, f"expected two different fabrics, got {quoted(table.cells['fabric'][i])} twice"
            )
    table.labels(SECOND_FABRIC)
    table.check()
    both = table.take(np.repeat(np.arange(len(table)), 2))
    second = {"fabric": table.cells[SECOND_FABRIC], RATING.name: [_OTHER[text] for text in answers]}
    first = {"fabric": table.cells["fabric"], RATING.name: answers}
    cells = {**both.cells, "list": [str(i + 1) for i in range(len(table)) for _ in range(2)]}
    cells |= {name: [text for pair in zip(first[name], second[name], strict=True) for text in pair] for name in first}
    del cells[SECOND_FABRIC]
    titles = {**both.titles, "list": table.titles[SECOND_FABRIC]}
    note = f"rows are pairs: 1 means that {table.titles['fabric']} was softer than {table.titles[SECOND_FABRIC]}"
    return replace(both, cells=cells, titles=titles, notes=(*both.notes, note))
