"""Docstrings are noun phrases and imperatives: none opens with a question word."""

from __future__ import annotations

import ast
import re

from support.modules import MODULES

QUESTION = re.compile(r"(What|Whether|Where|Which|How|Who|Whose|Whom|Why|When)\b")


def questions(tree: ast.Module) -> list[str]:
    """Return the texts that stand by themselves, as docstrings of modules, functions and constants do, and ask."""
    texts = (node.value.value for node in ast.walk(tree) if isinstance(node, ast.Expr) and is_text(node.value))
    return [text.splitlines()[0] for text in texts if QUESTION.match(text)]


def is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def test_no_docstring_opens_with_a_question():
    assert {name: found for name, tree in MODULES.items() if (found := questions(tree))} == {}
    wrong = """'''How it goes.'''\nN = 1\n'''What it counts.'''\ndef f():\n    '''Return whether.'''\n"""
    assert questions(ast.parse(wrong)) == ["How it goes.", "What it counts."]
