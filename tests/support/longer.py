"""Tests that take more than about a second, listed in `longer.txt`, and their mark.

They vary or deepen what quicker tests of the same files show, and would take two thirds of the time of all. A test with
parameters is listed by its name alone if all its cases take that long. ``pytest --durations=300`` says which these are.
"""

from __future__ import annotations

from pathlib import Path

import pytest

LIST = Path(__file__).with_suffix(".txt")


def mark_longer(items: list[pytest.Item]) -> None:
    """Mark the listed tests as slow: each line is a file below `tests`, and the name of a test."""
    listed = set(LIST.read_text(encoding="utf-8").splitlines())
    for item in items:
        name = f"{item.path.relative_to(LIST.parents[1]).as_posix()}::{item.name}"
        if listed & {name, name.partition("[")[0]}:
            item.add_marker(pytest.mark.slow)
