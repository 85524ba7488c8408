"""The notebooks use the package as its users do: by its public names alone."""

import ast
import json

import pytest

import softness_bayes
from support.paths import ROOT

NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))


def code_of(path):
    """Return the code of a notebook without what IPython alone understands."""
    cells = [cell for cell in json.loads(path.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]
    lines = [line for cell in cells for line in "".join(cell["source"]).splitlines()]
    return ast.parse("\n".join(line for line in lines if not line.startswith(("%", "!"))))


def inner_names(tree):
    """Return what code imports from inside the package."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module.split(".")[0] == "softness_bayes":
            found |= {f"{node.module}.{alias.name}" for alias in node.names if node.module != "softness_bayes"}
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names if alias.name.startswith("softness_bayes.")}
    return found


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_uses_public_names(path):
    tree = code_of(path)
    assert not inner_names(tree)
    public = {
        alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module == "softness_bayes"
        for alias in node.names
    }
    assert public <= {*softness_bayes.__all__}


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_was_executed_in_order_and_stored_without_times(path):
    cells = [cell for cell in json.loads(path.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in cells] == [*range(1, len(cells) + 1)]
    assert not [cell for cell in cells if "execution" in cell["metadata"]]


def test_notebooks_ask_a_question_each_and_are_small():
    """Store figures with few colours: most of a notebook is its figures."""
    stored = [json.loads(path.read_text(encoding="utf-8"))["cells"] for path in NOTEBOOKS]
    assert len(stored) <= 9
    assert sum(len(json.dumps(cell.get("outputs", ""))) for cells in stored for cell in cells) <= 1_000_000
    for cells in stored:
        title, learnt = "".join(cells[0]["source"]).split("\n\n")[:2]
        assert title.endswith("?")
        assert learnt.startswith("You learn")


def test_every_public_name_is_there():
    assert all(getattr(softness_bayes, name) is not None for name in softness_bayes.__all__)
    assert {*softness_bayes.__all__} <= {*dir(softness_bayes)}
