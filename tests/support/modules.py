"""The package's modules as syntax trees."""

import ast
from functools import cache
from pathlib import Path

import softness_bayes

ROOT = Path(softness_bayes.__file__).parent


def modules():
    """Return every module below the package itself: dotted name (without the package's) and syntax tree."""
    found = {}
    for path in sorted(ROOT.rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        name = ".".join(part for part in parts if part != "__init__")
        if name:
            found[name] = ast.parse(path.read_text(encoding="utf-8"), str(path))
    return found


MODULES = modules()


@cache
def imports(tree):
    """Return every name that a module imports, anywhere in it, as absolute dotted names."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(names)
