"""Errors of the toolkit, each with its exit code on the command line."""

from __future__ import annotations

LONGEST_QUOTED = 80
"""Largest number of characters of a value in a message."""


def quoted(text: str) -> str:
    """Return a value quoted for a message: on one line, with control characters escaped, and shortened."""
    return repr(text if len(text) <= LONGEST_QUOTED else f"{text[:LONGEST_QUOTED]}…")


class SoftnessError(Exception):
    """Base of all errors that the toolkit raises on purpose."""

    exit_code = 1


class InputError(SoftnessError, ValueError):
    """Invalid file, option or argument; the message gives its name, its location and the expected value."""

    exit_code = 2


class NotConvergedError(SoftnessError):
    """Run that ended before convergence; its draws are saved, and the message reports how far it got."""

    exit_code = 3


class NumericalError(SoftnessError, ArithmeticError):
    """Unreliable result of a computation; the message gives the parameters."""

    exit_code = 4


class LockedError(SoftnessError):
    """The output directory is in use by another run."""

    exit_code = 5


class ResourceError(SoftnessError, RuntimeError):
    """Out of memory; the same computation may succeed with settings that need less."""

    exit_code = 6


class WorkersLostError(ResourceError):
    """Worker processes died repeatedly, even after replacement, or the connection to their cluster was lost."""

    exit_code = 7
