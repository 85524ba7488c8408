"""Values that users supply: importable names, and entry points of installed packages."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from types import MappingProxyType, ModuleType
from typing import Any

from softness_bayes.errors import InputError, quoted

GROUP = "softness_bayes"
"""Prefix of groups of entry points, as in ``softness_bayes.pressure``."""
PACKAGE = __name__.partition(".")[0]
FORM = "MODULE:NAME"
"""Form of an importable name."""
SCRIPT = "__main__"


@cache
def installed(group: str) -> Mapping[str, EntryPoint]:
    """Return the entry points of a group in installed packages, by name, without importing them."""
    return MappingProxyType({point.name: point for point in entry_points(group=f"{GROUP}.{group}")})


def is_supplied(group: str, name: str) -> bool:
    """Return whether a name is an importable name or an entry point of a group."""
    return ":" in name or name in installed(group)


def supplied(group: str, name: str) -> Any:
    """Return the value of an importable name, or of an entry point of a group.

    Modules are searched for on Python's path, then in the working directory.

    Raises
    ------
    InputError
        If it cannot be imported, with the reason.
    """
    target = installed(group)[name].value if name in installed(group) else name
    module, _, attribute = (part.strip() for part in target.partition(":"))
    if not (all(part.isidentifier() for part in module.split(".")) and attribute):
        raise InputError(f"{group}: {quoted(name)}, expected {FORM}, such as mypackage.mymodule:mine")
    if "" not in sys.path:
        sys.path.append("")
        importlib.invalidate_caches()
    try:
        found: Any = importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise InputError(
            f"{group}: {quoted(name)}: there is no module {error.name!r}; install its package, or set PYTHONPATH to "
            "the folder that holds it"
        ) from None
    except Exception as error:
        raise InputError(f"{group}: {quoted(name)}: importing it fails: {type(error).__name__}: {error}") from error
    for part in attribute.split("."):
        if not hasattr(found, part):
            raise InputError(f"{group}: {quoted(name)}: the module {module} has no {part!r}")
        found = getattr(found, part)
    return found


def reference(value: Any) -> str | None:
    """Return the importable name of a value; None if no imported module contains it.

    The running script is not searched, because no later command can import it.
    """
    try:
        return _found(value)
    except (LookupError, TypeError):  # not found, or not hashable
        return next(_references(value, _modules()), None)


@cache
def _found(value: Any) -> str:
    """Return the importable name of a hashable value; raise `LookupError`, which is not cached, if it has none."""
    for name in _references(value, _modules()):
        return name
    raise LookupError


def require_reference(what: str, value: Any) -> str:
    """Return the importable name of a value, for a file from which it must be restored.

    Parameters
    ----------
    what
        Description of the value in messages, such as "pressure 'mine'".
    value
        The value.

    Raises
    ------
    InputError
        If the value has no importable name, with the reason.
    """
    if (name := reference(value)) is not None:
        return name
    why = "it is not a named object of a module"
    if next(_references(value, [(SCRIPT, sys.modules[SCRIPT])]), None):
        why = "it is defined in the running script, which later commands cannot import"
    raise InputError(
        f"{what} cannot be stored, because {why}; define it at the top of a module, such as mine.py, and import it "
        "from there"
    )


def _modules() -> list[tuple[str, ModuleType]]:
    return [
        (name, module)
        for name, module in list(sys.modules.items())
        if isinstance(module, ModuleType) and name.partition(".")[0] not in (SCRIPT, "__mp_main__", PACKAGE)
    ]


def _references(value: Any, modules: list[tuple[str, ModuleType]]) -> Iterator[str]:
    """Return the names of a value in some modules; an equal copy, as in a worker process, counts."""
    if isinstance(value, type) or (callable(value) and hasattr(value, "__qualname__")):
        for name, module in modules:
            if name == value.__module__ and _at(module, value.__qualname__) is value:
                yield f"{name}:{value.__qualname__}"
        return
    for exactly in (True, False):
        for name, module in modules:
            for attribute, other in list(vars(module).items()):
                if other is value if exactly else _alike(other, value):
                    yield f"{name}:{attribute}"


def _alike(other: Any, value: Any) -> bool:
    return type(other) is type(value) and is_dataclass(value) and bool(other == value)


def _at(module: ModuleType, path: str) -> Any:
    found: Any = module
    for part in path.split("."):
        found = getattr(found, part, None)
    return found
