"""Manifest of a checkpoint: the files of its state in order, with their checksums and that of the manifest.

Each file holds the manifest of its own state, from which a run is recovered after later files, or the manifest itself,
were damaged or lost.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from itertools import takewhile
from pathlib import Path
from typing import Any, NamedTuple

from softness_bayes.checkpoints.state_file import changed, digest_of, manifest_in, read_state_file, unpacked
from softness_bayes.errors import InputError
from softness_bayes.files.json_text import as_json, parse_json
from softness_bayes.files.run_files import CHECKPOINT, MANIFEST

FORMAT = 4
"""Version of the checkpoint's layout; other versions are rejected."""

_DIGEST = "sha256"


def name_of(serial: int) -> str:
    """Return the name of a state's file."""
    return f"state-{serial:07d}.npz"


def sealed(manifest: Mapping[str, Any]) -> bytes:
    """Return a manifest as the bytes of its file, including its checksum.

    Raises
    ------
    InputError
        If it cannot be stored as JSON.
    """
    content = {**manifest, "format": FORMAT}
    return as_json({**content, _DIGEST: _digest(content)}, MANIFEST, indent=1).encode()


def read_manifest(directory: Path) -> dict[str, Any]:
    """Return the manifest of the run in a directory of results.

    Raises
    ------
    InputError
        If there is none, or it is of another version or damaged.
    """
    path = directory / CHECKPOINT / MANIFEST
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
    return digest_of(as_json(content, MANIFEST).encode())


class Whole(NamedTuple):
    """The last intact state of a checkpoint."""

    manifest: dict[str, Any]
    """Manifest of this state."""
    damage: str
    """Damaged files and the resulting loss, as a sentence; empty if nothing is damaged."""


def last_whole(directory: Path) -> Whole:
    """Return the last intact state of the run in a directory of results, without changing anything.

    Raises
    ------
    InputError
        If there is no run, or none of its states is intact.
    OSError
        If a file cannot be read for reasons other than damage.
    """
    home, said, lost = directory / CHECKPOINT, [], ""
    try:
        last = read_manifest(directory)
    except InputError:
        said.append(f"{home / MANIFEST}: damaged or missing")
        newest = sorted(home.glob("state-*.npz"), reverse=True)
        *broken, intact = next(((*newest[:k], path) for k, path in enumerate(newest) if _own_manifest(path)), (None,))
        if intact is None:
            raise
        last = _own_manifest(intact)
        said += [f"{path}: damaged" for path in broken]
        lost = "the steps after it are lost" if broken else ""
    for files in (last["files"], last["earlier"]):
        whole = [*takewhile(lambda one: _is_whole(home / one[0], one[1]), files)]
        said += [f"{home / name}: damaged or missing" for name, _ in files[len(whole) : len(whole) + 1]]
        if whole:
            name, digest = whole[-1]
            found = last if whole == last["files"] else manifest_in(read_state_file(home / name, digest))
            return Whole({**found, "files": whole}, _sentence(said, last["status"], found["status"], lost))
    raise InputError(
        f"{'; '.join(said)}; no intact state is left; restore the files from a copy, or start the run again in "
        "another directory"
    )


def _own_manifest(path: Path) -> dict[str, Any]:
    """Return the manifest at the state of a file whose checksum is not known; empty if the file is damaged."""
    content = path.read_bytes()
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:  # it has checksums of its own
            manifest = {} if archive.testzip() else manifest_in(unpacked(content))
    except Exception:  # the bytes may be anything
        return {}
    if path.name != name_of(manifest.get("serial", 0)):
        return {}
    return {**manifest, "files": [*manifest["files"], [path.name, digest_of(content)]]}


def _sentence(said: list[str], then: Mapping[str, Any], now: Mapping[str, Any], lost: str) -> str:
    if not said:
        return ""
    where = "its pilot phase" if now["piloting"] else f"step {now['steps']}"
    if not lost and now["phase"] == then["phase"]:
        lost = f"{then['steps'] - now['steps']} steps are lost"
    lost = lost or f"{then['steps']} steps of a later stage are lost"
    return f"{'; '.join(said)}; the run continues from {where}, the last intact state: {lost}"


def _is_whole(path: Path, digest: str) -> bool:
    try:
        return digest_of(path.read_bytes()) == digest
    except (FileNotFoundError, IsADirectoryError):
        return False
