"""Imports of libraries without the optional parts that this package does not use."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def without(*optional: str) -> Iterator[None]:
    """Let this thread's imports of some packages fail inside a ``with`` block, as if these were not installed.

    A library that works without them is then imported sooner. Packages that are imported already remain available,
    and other threads are not affected.

    Parameters
    ----------
    *optional
        Names of packages.
    """
    hidden = _Hidden(optional)
    sys.meta_path.insert(0, hidden)
    try:
        yield
    finally:
        sys.meta_path.remove(hidden)


class _Hidden:
    """Finder that refuses some packages to the thread that made it."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self._names, self._thread = names, threading.get_ident()

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> None:
        if name in self._names and threading.get_ident() == self._thread:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
