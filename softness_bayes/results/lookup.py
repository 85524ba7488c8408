"""Look-ups in a result with errors that name the missing item and its location."""

from __future__ import annotations

from typing import Any

import xarray as xr

from softness_bayes.base.errors import InputError


class MissingError(InputError, KeyError):
    """A result lacks an attribute, a group, a variable or a table."""

    def __str__(self) -> str:
        return str(self.args[0])


class Named(dict[str, Any]):
    """Values by name, with an error that names a missing one.

    Parameters
    ----------
    values
        The values.
    what, where
        Kind of values, and their file, for the message.
    """

    def __init__(self, values: Any, what: str, where: str) -> None:
        super().__init__(values)
        self._what, self._where = what, where

    def __missing__(self, name: str) -> Any:
        raise MissingError(f"{self._where}: no {self._what} {name!r}")


class Group(xr.Dataset):
    """A group of a result, with an error that names a missing variable.

    Missing labels of an axis also raise an error; xarray itself would return 0, 1, 2 and so on.
    """

    __slots__ = ()

    @classmethod
    def of(cls, dataset: xr.Dataset, where: str) -> Group:
        """Return a dataset as a group; `where` names file and group."""
        group = cls(dataset.data_vars, dataset.coords, dataset.attrs)
        group.encoding["source"] = where
        return group

    def __getitem__(self, key: Any) -> Any:
        if isinstance(key, str) and key not in self._variables:
            raise MissingError(f"{self.encoding.get('source', 'result')}: no variable {key!r}")
        return super().__getitem__(key)
