"""Numbers and sentences as the page writes them."""

from __future__ import annotations

from typing import Any

import numpy as np

from softness_bayes.shares import percent

LEAST_PLAIN, MOST_PLAIN = 1e-4, 1e7
"""Ends of the numbers that are written without an exponent."""


def number(value: Any, digits: int = 3) -> str:
    """Return a number in a few digits, without an exponent unless it is very large or small; a dash for none."""
    value = float(value)
    if not np.isfinite(value):
        return "–"
    short = f"{value:.{digits}g}"
    return f"{float(short):.12g}" if LEAST_PLAIN <= abs(value) < MOST_PLAIN else short


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
