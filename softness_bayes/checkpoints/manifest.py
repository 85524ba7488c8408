"""Manifest of a checkpoint: the valid files in order, with their checksums and that of the manifest.

It names earlier states too, from the last intact one of which a run is recovered after a file was damaged or lost.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from softness_bayes.checkpoints.stored_state import changed, status_in, unpacked
from softness_bayes.errors import InputError
from softness_bayes.files.json_text import as_json, parse_json
from softness_bayes.files.run_files import CHECKPOINT, MANIFEST, MANIFEST_COPY

FORMAT = 3
"""Version of the checkpoint's layout; other versions are rejected."""

_DIGEST = "sha256"

MOST_EARLIER = 8
"""Number of earlier states with the first piece of the last state's chains above which every second one is dropped."""


def sealed(manifest: Mapping[str, Any]) -> bytes:
    """Return a manifest as the bytes of its file, including its checksum.

    Raises
    ------
    InputError
        If it cannot be stored as JSON.
    """
    content = {"format": FORMAT, **manifest}
    return as_json({**content, _DIGEST: _digest(content)}, MANIFEST, indent=1).encode()


def read_manifest(directory: Path, name: str = MANIFEST) -> dict[str, Any]:
    """Return the manifest of the run in a directory of results.

    Parameters
    ----------
    directory
        The directory.
    name
        Name of the manifest's file or of its copy.

    Raises
    ------
    InputError
        If there is none, or it is of another version or damaged.
    """
    path = directory / CHECKPOINT / name
    try:
        manifest = parse_json(path.read_bytes())
    except FileNotFoundError:
        raise InputError(f"{directory}: no run to continue or to report on; expected {path}") from None
    except ValueError as error:
        raise InputError(f"{path}: not a manifest ({error})") from None
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        raise InputError(
            f"{path}: not a checkpoint of format {FORMAT}, the only one that this version reads; continue the "
            "run with the version that began it, or start it again in another directory"
        )
    if manifest.pop(_DIGEST, None) != _digest(manifest):
        raise changed(path)
    return manifest


def _digest(content: Mapping[str, Any]) -> str:
    """Return the SHA-256 of the values, which does not depend on white space between them."""
    return hashlib.sha256(as_json(content, MANIFEST).encode()).hexdigest()


class Whole(NamedTuple):
    """The last intact state of a checkpoint."""

    manifest: dict[str, Any]
    """Manifest of this state."""
    damage: str
    """Damaged files and the resulting loss, as a sentence; empty if nothing is damaged."""


class EarlierState(NamedTuple):
    """An earlier state in a checkpoint."""

    arrays: str
    """Its file."""
    pieces: list[str]
    """Required pieces of the chains, in order."""


def kept_states(earlier: Sequence[EarlierState], pieces: Sequence[str]) -> list[EarlierState]:
    """Return the earlier states to be kept in addition to a state with some pieces.

    States whose chains begin with the same piece as those of this one are kept, but only every second one if there are
    more than `MOST_EARLIER`. Of the others, from before the chains were thinned or restarted, the last state with
    pieces is kept, and the first one without any.
    """
    own = [one for one in earlier if one.pieces and one.pieces[0] == pieces[0]] if pieces else []
    others = [one for one in earlier if one not in own]
    bare, full = [one for one in others if not one.pieces], [one for one in others if one.pieces]
    return [*bare[:1], *full[-1:], *(own[::2] if len(own) > MOST_EARLIER else own)]


def last_whole(directory: Path) -> Whole:
    """Return the last intact state of the run in a directory of results, without changing anything.

    Raises
    ------
    InputError
        If there is no run, or none of its states is intact.
    OSError
        If a file cannot be read for reasons other than damage.
    """
    home, said = directory / CHECKPOINT, []
    try:
        manifest = read_manifest(directory)
    except InputError as error:
        try:
            manifest = read_manifest(directory, MANIFEST_COPY)
        except InputError:
            raise error from None
        said.append(f"{home / MANIFEST}: damaged or missing, and read from its copy")
    digests, broken = manifest["digests"], []
    last = EarlierState(manifest["arrays"], manifest["pieces"])
    for one in (last, *(EarlierState(*entry) for entry in reversed(manifest["earlier"]))):
        names = (*one.pieces, one.arrays)
        wrong = next((name for name in names if name in broken or not _is_whole(home / name, digests[name])), None)
        if wrong is None:
            found = manifest if one == last else _before(manifest, home, one)
            return Whole(found, _sentence(said, manifest, found))
        if wrong not in broken:
            broken.append(wrong)
            said.append(f"{home / wrong}: damaged or missing")
    raise InputError(
        f"{'; '.join(said)}; no intact state is left; restore the files from a copy, or start the run again in "
        "another directory"
    )


def _before(manifest: Mapping[str, Any], home: Path, one: EarlierState) -> dict[str, Any]:
    """Return the manifest as it was at an earlier state."""
    status = status_in(unpacked(home / one.arrays, manifest["digests"][one.arrays]))
    names = [name for name, _ in manifest["earlier"]]
    return {**manifest, "status": status, **one._asdict(), "earlier": manifest["earlier"][: names.index(one.arrays)]}


def _sentence(said: list[str], manifest: Mapping[str, Any], found: Mapping[str, Any]) -> str:
    if not said:
        return ""
    then, now = manifest["status"], found["status"]
    where = "its pilot phase" if now["piloting"] else f"step {now['steps']}"
    same = now["phase"] == then["phase"]
    lost = (
        f"{then['steps'] - now['steps']} steps are lost" if same else f"{then['steps']} steps of a later stage are lost"
    )
    return f"{'; '.join(said)}; the run continues from {where}, the last intact state: {lost}"


def _is_whole(path: Path, digest: str) -> bool:
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest() == digest
    except (FileNotFoundError, IsADirectoryError):
        return False
