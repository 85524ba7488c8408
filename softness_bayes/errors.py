"""What can go wrong, each with the exit code that the command line gives it."""

from __future__ import annotations

LONGEST_QUOTED = 80
"""Characters of a value that a message quotes."""


def quoted(text: str) -> str:
    """Return a value as a message quotes it: on one line, its control characters as escapes, no longer than a line."""
    return repr(text if len(text) <= LONGEST_QUOTED else f"{text[:LONGEST_QUOTED]}…")


class SoftnessError(Exception):
    """Base of every error that the toolkit raises on purpose."""

    exit_code = 1


class InputError(SoftnessError, ValueError):
    """A file, option or argument is not what was expected; the message says which, where and what was."""

    exit_code = 2


class NotConvergedError(SoftnessError):
    """A run ended before it had converged; what it has is written, and the message says how far it is."""

    exit_code = 3


class NumericalError(SoftnessError, ArithmeticError):
    """A computation gave a value that cannot be trusted; the message names the parameters."""

    exit_code = 4


class LockedError(SoftnessError):
    """Another run holds the output directory."""

    exit_code = 5


class ResourceError(SoftnessError, RuntimeError):
    """The machine gave out: memory, or a worker process that was killed; the same computation may well work again."""

    exit_code = 6
