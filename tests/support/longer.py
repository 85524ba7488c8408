"""Tests that take more than about a second, listed in `longer.txt`, and their mark.

They vary or deepen what quicker tests of the same files show, and would take two thirds of the time of all. A test with
parameters is listed by its name alone if all its cases take that long. ``pytest --durations=300`` says which these are.
"""

from __future__ import annotations

from pathlib import Path

import pytest

LIST = Path(__file__).with_suffix(".txt")
_TESTS = LIST.parents[1]


def file_of(item: pytest.Item) -> str:
    """Return the file of a test, below `tests`."""
    return item.path.relative_to(_TESTS).as_posix()


def name_of(item: pytest.Item) -> str:
    """Return the name of a test in the list: its file below `tests`, and its own name."""
    return f"{file_of(item)}::{item.name}"


def without_parameters(name: str) -> str:
    """Return the name of a test without those of its parameters."""
    return name.partition("[")[0]


def mark_longer(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark the listed tests as slow.

    Raises
    ------
    pytest.UsageError
        If a file was collected as a whole and a listed test of it does not exist.
    """
    listed = set(LIST.read_text(encoding="utf-8").splitlines())
    found = {name_of(item): item for item in items}
    for name, item in found.items():
        if listed & {name, without_parameters(name)}:
            item.add_marker(pytest.mark.slow)
    if any("::" in argument for argument in config.args):
        return
    there, files = {without_parameters(name) for name in found}, {name.partition("::")[0] for name in found}
    gone = [one for one in listed if one.partition("::")[0] in files and without_parameters(one) not in there]
    if gone:
        raise pytest.UsageError(f"{LIST.name}: no test {', '.join(sorted(gone))}")
