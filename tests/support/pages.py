"""Pages of the package's docs as the tests read them."""

from __future__ import annotations

import importlib
import re
from importlib.resources import files
from types import ModuleType
from typing import Any


def text_of(name: str) -> str:
    """Return a page, as an installed package has it."""
    return (files("softness_bayes") / "docs" / name).read_text(encoding="utf-8")


def headings(name: str) -> dict[str, str]:
    """Return the numbered headings of a page by their numbers."""
    return dict(re.findall(r"^#+ (\d+)\. (.+)$", text_of(name), re.M))


def in_the_code(path: str) -> Any:
    """Return what a path below the package names: a module, or a member of one."""
    found: Any = importlib.import_module("softness_bayes")
    for part in path.split("."):
        if isinstance(found, ModuleType) and not hasattr(found, part):
            found = importlib.import_module(f"{found.__name__}.{part}")
        else:
            found = getattr(found, part)
    return found
