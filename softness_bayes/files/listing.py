"""The list of what the toolkit wrote in a directory: by it a file of ours is told from anybody else's."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from softness_bayes.errors import InputError
from softness_bayes.files.whole import write_whole

LISTING = ".softness-bayes.json"
"""Name of the list in the directory that it is of."""

FORMAT = 1
"""Version of its layout; another one is refused."""


class Entry(NamedTuple):
    """A file that was written."""

    by: str
    """Verb that wrote it."""
    digests: tuple[str, ...]
    """SHA-256 of what it holds; of what it held too, while it is being replaced."""


@dataclass(frozen=True)
class Listing:
    """What the toolkit wrote in a directory.

    Parameters
    ----------
    files
        The files by name.
    made
        Whether it made the directory.
    """

    files: Mapping[str, Entry] = field(default_factory=dict)
    made: bool = False

    @classmethod
    def read(cls, directory: Path) -> Listing:
        """Return the list of a directory, an empty one where there is none.

        Raises
        ------
        InputError
            If a file of that name is no such list.
        """
        path = directory / LISTING
        if path.is_symlink():
            raise InputError(f"{path}: is a symbolic link, expected the list of what was written here")
        try:
            values: Any = json.loads(path.read_bytes())
            if values["format"] != FORMAT:
                raise ValueError(f"format {values['format']}, expected {FORMAT}")
            files = {
                str(name): Entry(str(entry["by"]), tuple(map(str, entry["sha256"])))
                for name, entry in values["files"].items()
            }
            return cls(files, bool(values["made"]))
        except (FileNotFoundError, NotADirectoryError):
            return cls()
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise InputError(
                f"{path}: not the list of what softness-bayes wrote here ({error}); move it away, and the files "
                "beside it count as yours"
            ) from None

    def write(self, directory: Path) -> None:
        """Write the list to its directory, whole or not at all."""
        files = {name: {"by": entry.by, "sha256": entry.digests} for name, entry in sorted(self.files.items())}
        values = {"format": FORMAT, "made": self.made, "files": files}
        write_whole(directory / LISTING, (json.dumps(values, indent=1) + "\n").encode())

    def objection(self, path: Path, by: Collection[str]) -> str | None:
        """Return why a path may not be replaced or removed; none for a file of the verbs `by`, as they left it.

        Parameters
        ----------
        path
            What stands in the directory.
        by
            Verbs whose files are meant.
        """
        if path.is_symlink():
            return "is a symbolic link"
        if not path.is_file():
            return "is a directory" if path.is_dir() else "is no ordinary file"
        entry = self.files.get(path.name)
        if entry is None or entry.by not in by:
            return "was not written by this command"
        with open(path, "rb") as file:
            same = hashlib.file_digest(file, "sha256").hexdigest() in entry.digests
        if not same:
            return "was changed since it was written"
        return None


def digest(content: bytes) -> str:
    """The SHA-256 of some content, in hexadecimal."""
    return hashlib.sha256(content).hexdigest()
