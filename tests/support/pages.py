"""Pages of the package's docs as the tests read them: headings, tables, equations that can be evaluated."""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterator, Mapping
from importlib.resources import files
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

SUPERSCRIPTS = dict(zip("²³⁴⁵", "2345", strict=True))
FUNCTIONS: Mapping[str, Any] = {"exp": np.exp, "sqrt": np.sqrt, "ln": np.log, "log": np.log, "pi": np.pi}
_TOKEN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*|\d+\.?\d*(?:e-?\d+)?|[²³⁴⁵]|[-+/()^]")


class Table(NamedTuple):
    """A table of a page."""

    section: str
    """Number of the section, or nothing before the first."""
    lead: str
    """The paragraph before it, on one line."""
    rows: list[dict[str, str]]
    """Cells by the title of their column."""


def text_of(name: str) -> str:
    """Return a page, as an installed package has it."""
    return (files("softness_bayes") / "docs" / name).read_text(encoding="utf-8")


def headings(name: str) -> dict[str, str]:
    """Return the numbered headings of a page by their numbers."""
    return dict(re.findall(r"^#+ (\d+)\. (.+)$", text_of(name), re.M))


def sections(name: str) -> dict[str, str]:
    """Return the text of each numbered section."""
    parts = re.split(r"^## (\d+)\. .*$", text_of(name), flags=re.M)
    return {"": parts[0], **dict(zip(parts[1::2], parts[2::2], strict=True))}


def paragraphs(text: str) -> list[str]:
    """Return the paragraphs of a text."""
    return [part.strip() for part in text.split("\n\n") if part.strip()]


def tables(name: str) -> Iterator[Table]:
    """Yield the tables of a page in their order."""
    for section, text in sections(name).items():
        lead = ""
        for part in paragraphs(text):
            if part.startswith("|"):
                head, _, *body = [[cell.strip() for cell in row.strip("|").split("|")] for row in part.splitlines()]
                yield Table(section, lead, [dict(zip(head, row, strict=True)) for row in body])
            lead = part.replace("\n", " ")


def table(name: str, section: str, *columns: str) -> list[dict[str, str]]:
    """Return the one table of a section that begins with these columns."""
    (found,) = [t.rows for t in tables(name) if t.section == section and tuple(t.rows[0])[: len(columns)] == columns]
    return found


def plain(cell: str) -> str:
    """Return what stands between the first backticks of a cell."""
    found = re.search(r"`([^`]+)`", cell)
    assert found is not None, cell
    return found[1]


def numbers(cell: str) -> list[float]:
    """Return the numbers at the start of a cell, separated by commas."""
    return [float(re.match(r"-?\d+\.?\d*(?:e-?\d+)?", part.strip())[0]) for part in cell.split(",")]


def in_the_code(path: str) -> Any:
    """Return what a path below the package names: a module's member, a field's default, an element."""
    parts = re.findall(r"\w+|\[[^\]]+\]", path)
    found: Any = importlib.import_module("softness_bayes")
    for part in parts:
        if part.startswith("["):
            key = part[1:-1]
            found = found[int(key) if re.fullmatch(r"-?\d+", key) else key]
        elif isinstance(found, ModuleType) and not hasattr(found, part):
            found = importlib.import_module(f"{found.__name__}.{part}")
        else:
            found = getattr(found, part)
    return found


def equation(text: str) -> tuple[str, str]:
    """Return both sides of an equation."""
    left, _, right = text.partition("=")
    return left, right


def value(text: str, **values: Any) -> Any:
    """Evaluate one side of an equation, written as on paper: a product has no sign, a power is a superscript."""
    code, operand = list[str](), False
    for token in _TOKEN.findall(text):
        begins = token[0].isalnum() or token[0] in "_("
        if token in SUPERSCRIPTS:
            code.append(f"**{SUPERSCRIPTS[token]}")
            continue
        code += ["*"] if operand and begins else []
        code.append("**" if token == "^" else token)
        operand = token == ")" or (token[0].isalnum() and not callable(FUNCTIONS.get(token)))
    return eval("".join(code), {**FUNCTIONS, **values})


def holds(text: str, tolerance: float = 1e-9, **values: Any) -> None:
    """Assert that an equation holds for some values."""
    left, right = equation(text)
    np.testing.assert_allclose(value(left, **values), value(right, **values), rtol=tolerance, err_msg=text)


def blocks(name: str, section: str) -> list[str]:
    """Return the lines of a section that are set apart as equations."""
    return [line.strip() for line in sections(name)[section].splitlines() if line.startswith("    ")]


def starting(name: str, section: str, start: str) -> str:
    """Return the one equation of a section that starts so, up to a comma and spaces."""
    (found,) = [line for line in blocks(name, section) if line.startswith(start)]
    return found.split(",  ")[0]
