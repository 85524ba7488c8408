"""The order of the layers: a module imports only downwards, and heavy libraries only where they belong."""

from __future__ import annotations

import ast
import subprocess
import sys
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import softness_bayes
from support.modules import MODULES, imports
from support.paths import ROOT

LAYERS = (
    {"base"},
    {"touch.neuron"},
    {"sampler", "touch"},
    {"data", "likelihood", "parameters"},
    {"model.recordings"},
    {"checking", "model"},
    {"bench", "claims", "people", "plotting"},
    {"results"},
    {"experiments", "report", "runs"},
    {"report.explore"},
    {"cli", "tools"},
    {"__main__"},
)
"""The rooms, from the bottom up: folders, and folders in them that the others do not need or that need no other."""
RANK = {name: rank for rank, names in enumerate(LAYERS) for name in names}
HOMES = {
    "arviz": {"base.arviz_bridge"},
    "bokeh": {
        "report.explore.charts",
        "report.explore.page",
        "report.explore.server",
        "report.charts",
    },
    "dask": {"runs.cluster"},
    "distributed": {"runs.cluster"},
    "emcee": {"bench.tables", "sampler.moves"},
    "jinja2": {"report.page"},
    "openpyxl": {"data.sheets"},
    "tornado": {"report.explore.server"},
}
"""Modules outside of which a library may not be imported."""
PROGRAMS = {
    "tools.rooms",
    "tools.surface_build",
}
"""Run with ``python -m``, beside the command line: they may print, and nothing imports them."""


@cache
def own_imports(tree):
    """Return the modules of this package that a module imports."""
    names = {name.removeprefix("softness_bayes.") for name in imports(tree) if name.startswith("softness_bayes.")}
    return frozenset(next((n for n in (name, name.rpartition(".")[0]) if n in MODULES), name) for name in names)


def room(name):
    """Return the room of a module: the innermost folder that LAYERS names, or the module itself."""
    while name not in RANK:
        assert "." in name, f"{name} has no place in LAYERS"
        name = name.rpartition(".")[0]
    return name


def named_modules(tree):
    """Return the modules of this package that a module's strings name, as what is imported later is named."""
    texts = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    dotted = {text.removeprefix("softness_bayes.") for text in texts if text.startswith("softness_bayes.")}
    return dotted & MODULES.keys()


def test_modules_import_only_downwards():
    """And from where things are: through the package's public names a room could reach one above it."""
    for name, tree in MODULES.items():
        assert own_imports(tree) - {"__version__"} <= MODULES.keys(), name
        for other in own_imports(tree) | named_modules(tree):
            if other in MODULES and room(other) != room(name):
                assert RANK[room(other)] < RANK[room(name)], f"{name} imports {other}"


def test_no_circles():
    graph = {name: own_imports(tree) & MODULES.keys() - {name} for name, tree in MODULES.items()}
    assert len(list(TopologicalSorter(graph).static_order())) >= len(MODULES)


@pytest.mark.parametrize("library", HOMES)
def test_library_stays_at_home(library):
    users = {name for name, tree in MODULES.items() if any(n.split(".")[0] == library for n in imports(tree))}
    assert users <= HOMES[library]


def test_forward_model_needs_numpy_and_scipy_only():
    allowed = sys.stdlib_module_names | {"numpy", "scipy", "softness_bayes"}
    for name, tree in MODULES.items():
        if name.split(".")[0] == "touch" and name not in PROGRAMS:
            assert {n.split(".")[0] for n in imports(tree)} <= allowed, name


@pytest.mark.parametrize(
    ("room", "never"),
    [
        ("sampler", {"touch", "parameters", "likelihood", "data"}),
        ("parameters", {"data"}),
        ("likelihood", {"data"}),
        ("checking", {"data"}),
        ("plotting", {"results", "runs"}),
        ("bench", {"runs"}),
        ("report", {"sampler", "runs"}),
    ],
)
def test_a_room_knows_nothing_of(room, never):
    for name, tree in MODULES.items():
        if name.split(".")[0] == room:
            assert not never & {other.split(".")[0] for other in own_imports(tree)}, name


def test_only_programs_print_or_exit():
    for name, tree in MODULES.items():
        calls = {ast.unparse(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
        if name not in {*PROGRAMS, "__main__"} and name.split(".")[0] != "cli":
            assert not calls & {"print", "exit", "quit", "sys.exit", "os._exit", "click.echo"}, name


def test_only_the_command_line_uses_click():
    for name, tree in MODULES.items():
        if name.split(".")[0] != "cli":
            assert not any(n.split(".")[0] == "click" for n in imports(tree)), name


@pytest.mark.parametrize(
    ("module", "also"),
    [
        ("softness_bayes", "pandas"),
        ("softness_bayes.touch.scene", "pandas"),
        ("softness_bayes.touch.profiles", "pandas"),
        ("softness_bayes.runs.run", "scipy.stats"),
        ("softness_bayes.plotting", "pandas"),
        ("softness_bayes.plotting", "scipy"),
    ],
)
def test_import_is_cheap(module, also):
    heavy = ["arviz", "emcee", "matplotlib", "xarray", "h5py", also]
    code = f"import sys, {module}; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


# the tests themselves

TESTS = {path.relative_to(ROOT / "tests"): path for path in (ROOT / "tests").rglob("*.py")}


def test_folders_of_tests_are_folders_of_the_package():
    folders = {path.parent for path in TESTS if path.name.startswith("test_")}
    assert [folder for folder in folders if not (Path(softness_bayes.__file__).parent / folder).is_dir()] == []


def test_no_test_imports_another_test():
    """What two tests need is in `support`, or a fixture of conftest.py."""
    tests = {path.stem for path in TESTS if path.name.startswith("test_") or path.stem == "conftest"}
    for name, path in TESTS.items():
        named = imports(ast.parse(path.read_text(encoding="utf-8")))
        assert not tests & {part for one in named for part in one.split(".")}, name
