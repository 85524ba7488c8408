"""Problems of tables, collected so that one message names them all."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from softness_bayes.errors import InputError

SHOWN = 20
"""Largest number of problems of a table that a message lists."""


class TableError(InputError):
    """A table has problems; the message names its place and lists them.

    Parameters
    ----------
    place
        The file, and its sheet if it has several.
    problems
        What is wrong, each with its row where it has one.
    """

    def __init__(self, place: str, problems: Sequence[str]) -> None:
        self.place = place
        self.problems = tuple(problems)
        super().__init__(_message(place, self.problems))


def together(errors: Iterable[TableError]) -> InputError:
    """Return one error for those of several tables, each problem of a table once."""
    by_place: dict[str, dict[str, None]] = {}
    for error in errors:
        # of two readings of one table the later one has found more, and has it in order
        by_place[error.place] = dict.fromkeys(error.problems) | by_place.get(error.place, {})
    return InputError("\n".join(_message(place, tuple(problems)) for place, problems in by_place.items()))


def _message(place: str, problems: Sequence[str]) -> str:
    if len(problems) == 1:
        return f"{place}: {problems[0]}"
    shown = f", of which the first {SHOWN} are" if len(problems) > SHOWN else ""
    return "\n  ".join([f"{place}: {len(problems)} problems{shown}:", *problems[:SHOWN]])


class Faults:
    """The problems that have been found in a table."""

    def __init__(self) -> None:
        self._found: dict[tuple[int, str], str] = {}
        self.advised = False
        """Whether a problem says what to do about commas: once is enough."""

    def add(self, row: int, title: str, problem: str) -> None:
        """Add the problem of a cell; the first one of a cell counts."""
        self._found.setdefault((row, title), f"row {row}, column {title!r}: {problem}")

    def add_general(self, problem: str) -> None:
        """Add a problem that is not of one cell."""
        self._found.setdefault((-1, problem), problem)

    def __bool__(self) -> bool:
        return bool(self._found)

    def __contains__(self, cell: tuple[int, str]) -> bool:
        return cell in self._found

    @property
    def rows(self) -> set[int]:
        """The rows that have a problem."""
        return {row for row, _ in self._found}

    @property
    def listed(self) -> list[str]:
        """The problems, general ones first, then by their rows."""
        return [self._found[cell] for cell in sorted(self._found, key=lambda cell: cell[0])]
