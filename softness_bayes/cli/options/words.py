"""Lists of names with explanations, as `readings`, `priors` and `figures` print them."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

WIDTH = 110
"""Width of a line."""


def explained(rows: Sequence[tuple[str, str]]) -> str:
    """Return names beside their explanations, which are wrapped."""
    column = max((len(name) for name, _ in rows), default=0) + 4
    lines = []
    for name, meaning in rows:
        begin = f"  {name}".ljust(column)
        lines.append(textwrap.fill(meaning or "–", WIDTH, initial_indent=begin, subsequent_indent=" " * column))
    return "\n".join(lines)
