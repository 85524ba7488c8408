"""Formatting of numbers and sentences on the page."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from softness_bayes.readable import number, percent


def with_error(value: Any, error: Any, unit: str = "") -> str:
    """Return a number with its standard error, a dash where there is none."""
    if not np.isfinite(value):
        return "–"
    return f"{number(value)}{f' ± {number(error, 1)}' if np.isfinite(error) else ''}{unit}"


def share(value: Any) -> str:
    """Return a share in per cent, the sign behind a space that no line breaks at; a dash where there is none."""
    return percent(float(value)).replace(" ", "\u00a0")


def sentence(text: str) -> str:
    """Return a text with a capital and one period."""
    return f"{text[:1].upper()}{text[1:].rstrip('.')}."


def unbroken(value: Any) -> Any:
    """Return a text with a space before each per-cent sign that no line breaks at, and other values as they are."""
    return re.sub(r"(?<=\d) (?=%)", "\u00a0", value) if type(value) is str else value
