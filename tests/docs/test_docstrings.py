"""Docstrings are noun phrases and imperatives: none opens with a question word."""

from __future__ import annotations

import ast
import itertools
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import softness_bayes

PACKAGE = Path(softness_bayes.__file__).parent
QUESTION = re.compile(r"(What|Whether|Where|Which|How|Who|Whose|Whom|Why|When)\b")


def docstrings(source: str) -> Iterator[tuple[str, str]]:
    """Yield name and docstring of a module and of every class, function, field and constant in it."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            text = ast.get_docstring(node)
            if text is not None:
                yield getattr(node, "name", "module"), text
        if isinstance(node, (ast.Module, ast.ClassDef)):
            yield from described(node.body)


def described(body: list[ast.stmt]) -> Iterator[tuple[str, str]]:
    """Yield name and docstring of the assignments that a docstring follows."""
    for assigned, text in itertools.pairwise(body):
        if isinstance(assigned, (ast.Assign, ast.AnnAssign)):
            match text:
                case ast.Expr(ast.Constant(str(words))):
                    target = assigned.targets[0] if isinstance(assigned, ast.Assign) else assigned.target
                    yield ast.unparse(target), words


def questions(source: str) -> list[str]:
    """Return the docstrings that open with a question word, by the names of what they are of."""
    return [f"{name}: {text.splitlines()[0]}" for name, text in docstrings(source) if QUESTION.match(text)]


@pytest.mark.parametrize("module", sorted(PACKAGE.rglob("*.py")), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_no_docstring_opens_with_a_question(module):
    assert questions(module.read_text()) == []


def test_a_question_would_be_found():
    source = '''"""How it goes."""
N, M = 1, 2
"""What they count."""
class A:
    """What it is."""
    x: int
    """Whether it is."""
    def f(self):
        """Return whether."""
'''
    found = ["module: How it goes.", "(N, M): What they count.", "A: What it is.", "x: Whether it is."]
    assert sorted(questions(source)) == sorted(found)
