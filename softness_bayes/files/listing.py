"""List of the files that the toolkit wrote in a directory, which distinguishes them from other files."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from softness_bayes.errors import InputError
from softness_bayes.files.json_text import parse_json
from softness_bayes.files.whole import write_whole

LISTING = ".softness-bayes.json"
"""Name of the list in its directory."""

FORMAT = 1
"""Version of its layout; other versions raise an error."""


class Entry(NamedTuple):
    """A file that was written."""

    by: str
    """Command that wrote it."""
    digests: tuple[str, ...]
    """SHA-256 of its content; while it is being replaced, of the old content too."""


@dataclass(frozen=True)
class Listing:
    """Files that the toolkit wrote in a directory.

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
        """Return the list of a directory, or an empty one.

        Raises
        ------
        InputError
            If the file is not such a list.
        """
        path = directory / LISTING
        if path.is_symlink():
            raise InputError(f"{path}: is a symbolic link, expected the list of what was written here")
        try:
            values: Any = parse_json(path.read_bytes())
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
                f"{path}: not the list of what softness-bayes wrote here ({error}); move it away: the other "
                "files are then never overwritten"
            ) from None

    def write(self, directory: Path) -> None:
        """Write the list to its directory, whole or not at all."""
        files = {name: {"by": entry.by, "sha256": entry.digests} for name, entry in sorted(self.files.items())}
        values = {"format": FORMAT, "made": self.made, "files": files}
        write_whole(directory / LISTING, (json.dumps(values, indent=1) + "\n").encode())

    def objection(self, path: Path, by: Collection[str]) -> str | None:
        """Return why a path may not be replaced or removed; None for an unchanged file of the commands `by`.

        Parameters
        ----------
        path
            A path in the directory.
        by
            Commands whose files may be replaced.
        """
        if path.is_symlink():
            return "is a symbolic link"
        if not path.is_file():
            return "is a directory" if path.is_dir() else "is not an ordinary file"
        entry = self.files.get(path.name)
        if entry is None or entry.by not in by:
            return "was not written by this command"
        with open(path, "rb") as file:
            same = hashlib.file_digest(file, "sha256").hexdigest() in entry.digests
        if not same:
            return "was changed since it was written"
        return None


def digest(content: bytes) -> str:
    """Return the SHA-256 of some content, in hexadecimal."""
    return hashlib.sha256(content).hexdigest()
