"""Type checks of arguments, with one form of message: the argument, its value and the expected type."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, NoReturn

from softness_bayes.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def require_kind(what: str, value: object, kind: type | tuple[type, ...], such_as: str) -> None:
    """Raise an error for an argument of the wrong type.

    Parameters
    ----------
    what
        Name of the argument.
    value
        The argument.
    kind
        Expected class or classes.
    such_as
        Expected kind of value, with an example.

    Raises
    ------
    InputError
        With name, value and what was expected.
    """
    if not isinstance(value, kind):
        refuse(what, value, such_as)


def require_members(what: str, value: object, members: Iterable[str], such_as: str) -> None:
    """Raise an error for an argument that lacks members; arguments, and what raises, as `require_kind`."""
    if not all(hasattr(value, member) for member in members):
        refuse(what, value, such_as)


def require_mapping(what: str, value: object, such_as: str) -> None:
    """Raise an error for an argument that is not a mapping; arguments, and what raises, as `require_kind`."""
    require_kind(what, value, Mapping, f"a mapping, as in {such_as}")


def numbers(what: str, value: Any, such_as: str = "numbers") -> NDArray[np.float64]:
    """Return an argument as an array of numbers.

    Raises
    ------
    InputError
        If it is not one, as `require_kind`.
    """
    import numpy as np

    try:
        if np.asarray(value).dtype.kind not in "US":  # texts, which NumPy would read as numbers
            return np.asarray(value, float)
    except (TypeError, ValueError):
        pass
    raise InputError(_told(what, value, such_as))


def refuse(what: str, value: object, such_as: str) -> NoReturn:
    """Raise the error of an argument that is not what was expected.

    Raises
    ------
    InputError
        With name, value and what was expected.
    """
    raise InputError(_told(what, value, such_as))


def _told(what: str, value: object, such_as: str) -> str:
    return f"{what}: expected {such_as}, got {value!r:.60} ({type(value).__name__})"
