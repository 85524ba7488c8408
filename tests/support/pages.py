"""Pages of the docs as the tests read them."""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from types import ModuleType
from typing import Any

import softness_bayes
from support.paths import ROOT

DOCS = Path(softness_bayes.__file__).parent / "docs"
PAGES = {
    path.relative_to(DOCS).as_posix(): path.read_text(encoding="utf-8")
    for path in sorted(DOCS.rglob("*.md"))
    if path.parent.name != "reference"  # made while the site is built
} | {"README.md": (ROOT / "README.md").read_text(encoding="utf-8")}
"""Every page by its place in the docs, and the README."""


def text_of(name: str) -> str:
    """Return a page."""
    return PAGES[name]


def blocks(text: str, language: str) -> list[str]:
    """Return the code of a page in one language, without the indentation of lists."""
    found = re.findall(rf"^( *)```{language}\n(.*?)^ *```$", text, re.DOTALL | re.MULTILINE)
    return [re.sub(rf"^{indent}", "", code, flags=re.MULTILINE) for indent, code in found]


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
