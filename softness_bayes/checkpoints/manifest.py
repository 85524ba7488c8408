"""Manifest of a checkpoint: the valid files in order, with their checksums and that of the manifest."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from softness_bayes.checkpoints.records import changed
from softness_bayes.errors import InputError
from softness_bayes.files.json_text import as_json, parse_json
from softness_bayes.files.run_files import CHECKPOINT, MANIFEST

FORMAT = 3
"""Version of the checkpoint's layout; other versions are rejected."""

_DIGEST = "sha256"


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
