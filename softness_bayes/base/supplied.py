"""Values that users supply: importable names, and entry points of installed packages.

A name that the user types is imported (`supplied`). A name in a file is not, because a file may come from anybody:
whatever reads a stored record passes it to `records.require_trusted` before it looks up any name of it.
"""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from types import MappingProxyType, ModuleType
from typing import Any

from softness_bayes.base.errors import InputError, quoted

GROUP = "softness_bayes"
"""Prefix of groups of entry points, as in ``softness_bayes.pressure``."""
PACKAGE = __name__.partition(".")[0]
FORM = "MODULE:NAME"
"""Form of an importable name."""
SCRIPT = "__main__"
_DOTTED = r"[^\W\d]\w*(?:\.[^\W\d]\w*)*"
IMPORTABLE = re.compile(f"({_DOTTED}):({_DOTTED})")


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
    if "" not in sys.path:
        sys.path.append("")
        importlib.invalidate_caches()
    return imported(group, name, installed(group)[name].value if name in installed(group) else name)


def imported(group: str, name: str, target: str) -> Any:
    """Return the value of MODULE:NAME; `group` and `name` are for the message."""
    match = IMPORTABLE.fullmatch(target)
    if match is None:
        raise InputError(f"{group}: {quoted(name)}, expected {FORM}, such as mypackage.mymodule:mine")
    module, attribute = match.groups()
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
    modules = [
        (name, module)
        for name, module in list(sys.modules.items())
        if isinstance(module, ModuleType) and name.partition(".")[0] not in (SCRIPT, "__mp_main__", PACKAGE)
    ]
    return next(_references(value, modules), None)


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


def _references(value: Any, modules: list[tuple[str, ModuleType]]) -> Iterator[str]:
    """Return the names of a value in some modules; an equal copy, as in a worker process, counts."""
    if isinstance(value, type) or (callable(value) and hasattr(value, "__qualname__")):
        for name, module in modules:
            found: Any = module if name == value.__module__ else None
            for part in value.__qualname__.split("."):
                found = getattr(found, part, None)
            if found is value:
                yield f"{name}:{value.__qualname__}"
        return
    for exactly in (True, False):
        for name, module in modules:
            for attribute, other in list(vars(module).items()):
                same = other is value if exactly else type(other) is type(value) and is_dataclass(value)
                if same and (exactly or other == value):
                    yield f"{name}:{attribute}"
