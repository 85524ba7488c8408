"""The package's modules as syntax trees."""

import ast
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import softness_bayes

ROOT = Path(softness_bayes.__file__).parent


class Modules(Mapping):
    """Every module below the package itself: dotted name (without the package's) and syntax tree, made when asked."""

    def __init__(self):
        paths = {path.relative_to(ROOT).with_suffix("").parts: path for path in sorted(ROOT.rglob("*.py"))}
        named = {".".join(part for part in parts if part != "__init__"): path for parts, path in paths.items()}
        self._paths = {name: path for name, path in named.items() if name}
        self._trees = {}

    def __getitem__(self, name):
        if name not in self._trees:
            path = self._paths[name]
            self._trees[name] = ast.parse(path.read_text(encoding="utf-8"), str(path))
        return self._trees[name]

    def __iter__(self):
        return iter(self._paths)

    def __len__(self):
        return len(self._paths)

    def __contains__(self, name):
        return name in self._paths


MODULES = Modules()


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
