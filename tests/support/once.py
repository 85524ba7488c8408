"""What is costly to make, made once for all the processes that run the tests."""

import functools
import hashlib
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

from filelock import FileLock


class Kept:
    """Values in a folder that the processes of one test session share; whoever asks first makes one.

    Each is read anew for whoever asks, so that no test sees what another has done to it.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def __call__(self, name: str, make, *arguments: Any) -> Any:
        """Return ``make(*arguments)``, made under this name by the first who asks."""
        path = self._folder / f"{name}.pickle"
        with FileLock(f"{path}.lock"):
            if not path.exists():
                path.write_bytes(pickle.dumps(make(*arguments)))
        return pickle.loads(path.read_bytes())


def made_once(kept: Kept, make: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that makes what ``make`` does, for the same arguments once in a session."""

    @functools.cache
    def found(*arguments):
        try:
            asked = hashlib.sha256(pickle.dumps(arguments)).hexdigest()
        except (AttributeError, pickle.PicklingError):  # a function that a test has made up
            return make(*arguments)
        return kept(f"{make.__name__}-{asked}", make, *arguments)

    return found
