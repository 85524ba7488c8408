"""Docstrings are noun phrases and imperatives: none opens with a question word."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import softness_bayes

PACKAGE = Path(softness_bayes.__file__).parent
QUESTION = re.compile(r"(What|Whether|Where|Which|How|Who|Whose|Whom|Why|When)\b")


def docstrings(source: str) -> Iterator[tuple[str, str]]:
    """Yield name and docstring of a module and of every class and function in it."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            text = ast.get_docstring(node)
            if text is not None:
                yield getattr(node, "name", "module"), text


def questions(source: str) -> list[str]:
    """Return the docstrings that open with a question word, by the names of what they are of."""
    return [f"{name}: {text.splitlines()[0]}" for name, text in docstrings(source) if QUESTION.match(text)]


@pytest.mark.parametrize("module", sorted(PACKAGE.rglob("*.py")), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_no_docstring_opens_with_a_question(module):
    assert questions(module.read_text()) == []


def test_a_question_would_be_found():
    source = '"""How it goes."""\nclass A:\n    """What it is."""\n    def f(self):\n        """Return whether."""\n'
    assert questions(source) == ["module: How it goes.", "A: What it is."]
