"""Errors of the toolkit, each with its exit code on the command line."""

from __future__ import annotations

LONGEST_QUOTED = 80
"""Largest number of characters of a value in a message."""


def quoted(text: str) -> str:
    """Return a value quoted for a message: on one line, with control characters as escapes, and shortened."""
    return repr(text if len(text) <= LONGEST_QUOTED else f"{text[:LONGEST_QUOTED]}…")


class SoftnessError(Exception):
    """Base of all errors that the toolkit raises on purpose."""

    exit_code = 1


class InputError(SoftnessError, ValueError):
    """A file, option or argument is invalid; the message names it, its place and the expected value."""

    exit_code = 2


class NotConvergedError(SoftnessError):
    """A run ended before it converged; its draws are written, and the message says how far it is."""

    exit_code = 3


class NumericalError(SoftnessError, ArithmeticError):
    """A computation gave a value that cannot be trusted; the message names the parameters."""

    exit_code = 4


class LockedError(SoftnessError):
    """Another run holds the output directory."""

    exit_code = 5


class ResourceError(SoftnessError, RuntimeError):
    """Memory ran out; the same computation may work with less of it."""

    exit_code = 6


class WorkersLostError(ResourceError):
    """Worker processes died and died again after they were replaced, or their cluster was lost."""

    exit_code = 7
