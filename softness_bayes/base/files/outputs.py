"""Output files of a command, which may replace earlier files of the command but never other files.

`require_outputs` checks before anything is computed, `write_outputs` writes. Both use the directory's `Listing` of the
files that the toolkit wrote there, which distinguishes them from other files.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

from filelock import lock_descriptor

from softness_bayes.base.errors import InputError
from softness_bayes.base.files.records import parse_json
from softness_bayes.base.files.whole import discard, is_part, put, staged, write_whole

LISTING = ".softness-bayes.json"
"""Name of the list in its directory."""

FORMAT = 1
"""Version of its layout, the only one that is read."""


Entry = tuple[str, tuple[str, ...]]
"""Command that wrote a file, and SHA-256 of its content; while it is being replaced, of the old content too."""


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
                str(name): (str(entry["by"]), tuple(map(str, entry["sha256"])))
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
        files = {name: {"by": by, "sha256": digests} for name, (by, digests) in sorted(self.files.items())}
        values = {"format": FORMAT, "made": self.made, "files": files}
        write_whole(directory / LISTING, (json.dumps(values, indent=1) + "\n").encode())


def require_outputs(
    directory: Path, names: Iterable[str], by: str, replace: bool = True, inputs: Iterable[Path] = ()
) -> None:
    """Raise an error if some files cannot be written to a directory; nothing is changed there.

    Parameters
    ----------
    directory
        Directory to write to, which need not exist yet.
    names
        The files.
    by
        The command that writes them.
    replace
        Whether files that the command wrote there earlier may be replaced.
    inputs
        Files that are read, which are never replaced.

    Raises
    ------
    InputError
        If the directory cannot be made or written to, or another file is in the way.
    """
    require_directory(directory)
    present = [directory / name for name in names if os.path.lexists(directory / name)]
    _require_ours(directory, present, by, inputs)
    if present and not replace:
        shown = ", ".join(path.name for path in present)
        raise InputError(f"{directory}: already holds {shown}; choose another --out, or add --force to replace")


def write_outputs(directory: Path, contents: Mapping[str, bytes | str], by: str) -> list[Path]:
    """Write files to a directory, created if necessary, and list them there.

    No file is changed before all of them are on the disk.

    Parameters
    ----------
    directory
        Directory of the files.
    contents
        Contents by the files' names; text is written in UTF-8.
    by
        The command that writes them; its earlier files are replaced.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    InputError
        If another file is in the way.
    OSError
        If there is no space or permission; every file is then either unchanged or complete and new.
    """
    data = {directory / name: text.encode() if isinstance(text, str) else text for name, text in contents.items()}
    made = make(directory)
    try:
        with _held(directory) as alone:
            if alone:
                discard(filter(is_part, directory.iterdir()))  # of killed processes
            listing = Listing.read(directory)
            _require_ours(directory, filter(os.path.lexists, data), by)
            _write(directory, data, replace(listing, made=listing.made or directory in made), by)
    except BaseException:
        unmake(made)
        raise
    return list(data)


def _write(directory: Path, data: Mapping[Path, bytes], listing: Listing, by: str) -> None:
    parts: dict[Path, Path] = {}
    new = {path.name: (by, (hashlib.sha256(content).hexdigest(),)) for path, content in data.items()}
    try:
        for path, content in data.items():
            parts[path] = staged(path, content)
        # from here on the list contains old and new digests, so that files are known even after an interruption
        either = {name: (by, listing.files.get(name, (by, ()))[1] + digests) for name, (by, digests) in new.items()}
        replace(listing, files={**listing.files, **either}).write(directory)
    except BaseException:
        discard(parts.values())
        raise
    put(parts)
    with suppress(OSError):
        replace(listing, files={**listing.files, **new}).write(directory)


class Survey(NamedTuple):
    """Contents of a directory."""

    ours: tuple[Path, ...]
    """Unchanged files of some commands, then the directories that they made."""
    others: Mapping[Path, str]
    """All other files, each with the reason why it is not one of ours."""


def survey(directory: Path, by: Collection[str], inputs: Iterable[Path] = (), but: Collection[str] = ()) -> Survey:
    """Return the files of some commands in a directory and in directories made there, and all other files.

    Parameters
    ----------
    directory
        Directory to examine.
    by
        The commands.
    inputs
        Files that are read, which always count as other files.
    but
        Names in the directory that are left out.
    """
    if not directory.is_dir():
        return Survey((), {})
    ours: list[Path] = []
    others: dict[Path, str] = {}
    for path in sorted(directory.iterdir()):
        if path.name in but or path.name == LISTING:
            continue
        if is_part(path):
            ours.append(path)
        elif path.is_dir() and not path.is_symlink() and Listing.read(path).made:
            below = survey(path, by, inputs)
            ours += below.ours
            others |= below.others
            if not below.others:
                ours.append(path)
        else:
            objections = _objections(directory, [path], by, inputs)
            others |= objections
            ours += [] if objections else [path]
    if os.path.lexists(directory / LISTING):
        Listing.read(directory)  # raises an error if the file is not a list
        ours += [] if others else [directory / LISTING]
    return Survey(tuple(ours), others)


def remove(found: Survey) -> None:
    """Remove our files of a directory; files that were added since stay."""
    for path in found.ours:
        with suppress(FileNotFoundError):
            if path.is_dir() and not path.is_symlink():
                with suppress(OSError):  # not empty any more
                    path.rmdir()
            else:
                path.unlink()


def told(others: Mapping[Path, str], most: int = 5) -> str:
    """Describe the files in the way, limited to the first few."""
    shown = [f"{path} {why}" for path, why in list(others.items())[:most]]
    return "; ".join(shown) + (f"; and {len(others) - most} more" if len(others) > most else "")


def require_directory(directory: Path) -> None:
    """Raise an error for a directory that cannot be made or written to, by trying.

    Raises
    ------
    InputError
        If it is a file or lies below one, or there is no permission.
    """
    for place in (directory, *directory.parents):
        if place.exists() and not place.is_dir():
            raise InputError(f"{place}: is a file, expected a directory for the results")
    made: list[Path] = []
    try:
        made = make(directory)
        with tempfile.TemporaryFile(dir=directory):
            pass
    except OSError as error:
        raise InputError(f"{directory}: cannot be written to ({error.strerror})") from None
    finally:
        unmake(made)


def _require_ours(directory: Path, present: Iterable[Path], by: str, inputs: Iterable[Path] = ()) -> None:
    if objections := _objections(directory, present, (by,), inputs):
        raise InputError(f"{told(objections)}; nothing was written: move it away, or choose another --out")


def _objections(
    directory: Path, present: Iterable[Path], by: Collection[str], inputs: Iterable[Path]
) -> dict[Path, str]:
    """Return the paths that may not be replaced or removed, with the reasons; not unchanged files of the commands."""
    files, read = Listing.read(directory).files, [path for path in inputs if path.exists()]
    found = {}
    for path in present:
        if path.name == LISTING:
            found[path] = "is the list of what was written there"
        elif path.exists() and any(os.path.samefile(path, other) for other in read):
            found[path] = "is an input of this command"
        elif path.is_symlink():
            found[path] = "is a symbolic link"
        elif not path.is_file():
            found[path] = "is a directory" if path.is_dir() else "is not an ordinary file"
        elif path.name not in files or files[path.name][0] not in by:
            found[path] = "was not written by this command"
        else:
            with open(path, "rb") as file:
                if hashlib.file_digest(file, "sha256").hexdigest() not in files[path.name][1]:
                    found[path] = "was changed since it was written"
    return found


def make(directory: Path) -> list[Path]:
    """Make a directory and those on the way to it; return the new ones."""
    made: list[Path] = []
    try:
        for place in reversed((directory, *directory.parents)):
            if not place.is_dir():
                place.mkdir()
                made.append(place)
    except OSError:
        unmake(made)
        raise
    return made


def unmake(made: Iterable[Path]) -> None:
    """Remove new directories that are still empty."""
    for place in reversed(list(made)):
        with suppress(OSError):
            place.rmdir()


@contextmanager
def _held(directory: Path) -> Iterator[bool]:
    """Keep other processes from writing outputs to a directory; yield whether the disk supports this."""
    if os.name == "nt":  # on systems where directories cannot be opened
        yield False
        return
    handle = os.open(directory, os.O_RDONLY)
    try:
        try:
            alone = lock_descriptor(handle)
        except OSError:
            alone = False
        yield alone
    finally:
        os.close(handle)
