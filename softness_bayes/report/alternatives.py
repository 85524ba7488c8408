"""Alternative texts for the figures of the page."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from softness_bayes.checking.check_table import doubts, unreproduced_sentence
from softness_bayes.files.run_files import FABRIC_RATINGS
from softness_bayes.parameters.declared import EVERY_PARAMETER
from softness_bayes.readable import chance, number
from softness_bayes.report.words import sentence
from softness_bayes.results.result import Result

RESPONSES, RATINGS = ("response", "response_ratio", "inflection"), ("rating", "rating_ratio")
PARAMETERS = ("corner", "corner_all", "prior", "trace", "rank")


def alternative_text(result: Result, name: str, caption: str) -> str:
    """Return the caption of a figure and a description of its content.

    Parameters
    ----------
    result
        The run.
    name
        Name of the figure; custom figures have only the caption.
    caption
        Caption of the figure.
    """
    return " ".join([caption, *_content(result, name)])


def _content(result: Result, name: str) -> Iterator[str]:
    """Yield sentences on what a figure shows of this run."""
    if name in RESPONSES:
        for load, row in result.inflection().iterrows():
            place = f", at {number(row['e_fab_kpa'])} kPa" if np.isfinite(row["e_fab_kpa"]) else ""
            yield f"{load}: turning point with probability {chance(row['p_interior'])}{place}."
    elif name in RATINGS and FABRIC_RATINGS in result.tables:
        for load, rows in result.tables[FABRIC_RATINGS].groupby(level="load", sort=False):
            rated = rows["rated"].droplevel("load").dropna()
            ends = [f"{number(rated.iloc[k])} ({rated.index[k]})" for k in (int(rated.argmin()), int(rated.argmax()))]
            yield f"{load}: mean ratings from {' to '.join(ends)}."
    elif name == "predictive_checks":
        yield sentence(unreproduced_sentence(doubts(result.tables["predictive_checks"])))
    elif name in PARAMETERS:
        known = [parameter for parameter in EVERY_PARAMETER if parameter in result.group("posterior")]
        yield f"Sampled parameters: {', '.join(known)}."
