"""Texts that are stored and compared line by line, and what is stored of tables.

With `SOFTNESS_BAYES_GOLDEN=write` in the environment, tests write them again instead.
"""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Callable, Iterable

import pandas as pd
import pytest

from support.paths import ROOT

GOLDEN = ROOT / "tests" / "golden"
WRITE = os.environ.get("SOFTNESS_BAYES_GOLDEN") == "write"
_NUMBER = re.compile(r"(?<![\w.#])[-−+]?(?:\d+(?:\.\d+)?(?:e[-+]?\d+)?|inf|nan)(?![A-Za-z_\d])")
_DIGEST = re.compile(r"\b[0-9a-f]{40,}\b")


def require(name: str, text: str) -> None:
    """Compare a text with the stored one, after writing it if that is asked for."""
    path = GOLDEN / f"{name}.txt"
    if WRITE:
        path.write_text(text, encoding="utf-8")
    stored = path.read_text(encoding="utf-8").splitlines()
    differs = list(difflib.unified_diff(stored, text.splitlines(), f"{name}.txt", "now", lineterm="", n=1))
    if differs:
        pytest.fail("\n".join(differs), pytrace=False)


def masked(text: str) -> str:
    """Return a text with a mark for each number and digest, and single spaces, as their widths differ."""
    text = _NUMBER.sub("#", _DIGEST.sub("DIGEST", text))
    text = re.sub(r"#\.\d+\b", "#", text).replace(" -h' for help", " --help' for help")  # versions, also those of click
    # whether a number is a limit, has an error or is missing depends on the draws
    text = re.sub(r"(?m)[<>]#|# ± #|(?<= )–(?= |$)", "#", text)
    return re.sub(r"[ \t]+", " ", re.sub(r"(?m)[-─━]{2,}(?= |$)", "--", text))


def rounded(text: str) -> str:
    """Return a text with three digits of each number that has more, and single spaces."""

    def three(found: re.Match[str]) -> str:
        number = found.group()
        return f"{float(number):.3g}" if len(re.sub(r"\D", "", number)) > 3 else number

    return re.sub(r"[ \t]+", " ", _NUMBER.sub(three, text))


def verbatim(text: str) -> str:
    """Return the text."""
    return text


Form = Callable[[str], str]
"""A function that leaves out of a text what is not stored."""


def of_table(table: pd.DataFrame) -> Iterable[str]:
    """Yield the columns of a table and its number of rows; of a figure's data, also that of each artist."""
    yield f"{len(table)} rows: {', '.join(table.columns)}"
    if {"element", "panel"} <= {*table.columns}:
        shown = table.dropna(subset="panel").astype({"panel": str}).groupby(["element", "panel"], sort=False)
        for (element, panel), part in shown:
            filled = [name for name in ("x", "y", "x_end", "y_end", "value") if part[name].notna().any()]
            axes = " against ".join(str(part[name].iloc[0]) for name in ("y_axis", "x_axis"))
            yield f"  {element} {panel}: {len(part)} of {', '.join(filled)}; {axes}"
