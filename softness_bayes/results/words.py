"""Text of a result that belongs to no single check: its loads, and HTML for notebooks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd


def load_sentence(cv: NDArray[np.float64], given: bool) -> str:
    """Return in one sentence whether loads were taken as exact.

    Parameters
    ----------
    cv
        Relative standard error of each rating's load.
    given
        Whether these errors were stated.
    """
    if cv.any():
        low, high = cv[cv > 0].min(), cv.max()
        size = f"{high:.3g}" if low == high else f"{low:.3g} to {high:.3g}"
        return (
            f"loads: the model includes relative errors of {size}, independent for each rating, for "
            f"{(cv > 0).sum()} of {cv.size} ratings"
        )
    if given:
        return "loads: exact, as stated"
    return (
        "loads: treated as exact, because no errors were given (--load-cv 0.05, or a column load_cv); any "
        "errors become part of the rating noise, which is the same for every touch"
    )


def html_of(said: Sequence[str], tables: Mapping[str, pd.DataFrame]) -> str:
    """Return HTML for a notebook: sentences in bold, and tables below their titles."""
    lines = "".join(f"<p><strong>{escape(line)}</strong></p>" for line in said)
    shown = [
        f"<p>{title}</p>{table.to_html(float_format='{:.4g}'.format, na_rep='–', border=0)}"
        for title, table in tables.items()
    ]
    return "\n".join([lines, *shown])
