"""Check that a run may write to a directory, and removal of an earlier run."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from pathlib import Path

from softness_bayes.errors import InputError
from softness_bayes.files.json_text import parse_json
from softness_bayes.files.outputs import Survey, remove, survey, told
from softness_bayes.files.run_files import CHECKPOINT, LOCK, MANIFEST, RUN
from softness_bayes.files.whole import is_part

OF_A_RUN = (RUN, "plot", "report", "rank")
"""Commands whose files are removed together with a replaced run."""

_STATE = re.compile(r"state-[0-9]{7,}\.npz")


def require_vacant(directory: Path, replace: bool, inputs: Iterable[Path] = ()) -> None:
    """Raise an error for a directory to which a run may not write; nothing is changed.

    Parameters
    ----------
    directory
        Directory for the run.
    replace
        Whether an earlier run there may be removed; only unchanged files of that run are.
    inputs
        Files that the run reads, which are never removed.

    Raises
    ------
    InputError
        If it is a file or is below one; or if it is not empty and `replace` is False, or not all files belong to an
        earlier run.
    """
    for place in (directory, *directory.parents):
        if place.exists() and not place.is_dir():
            raise InputError(f"{place}: is a file, expected a directory for the results")
    states, beside = _states(directory / CHECKPOINT), survey(directory, OF_A_RUN, inputs, but=(CHECKPOINT,))
    others = {**states.others, **beside.others}
    if replace and others:
        raise InputError(
            f"{directory}: --force replaces only an earlier run, but {told(others)}; move it away, or choose "
            "another --out"
        )
    # a run killed before its first state leaves a checkpoint without a manifest
    begun = (directory / CHECKPOINT / MANIFEST).exists()
    if not replace and (begun or others or beside.ours):
        instead = "'softness-bayes resume' to continue its run" if begun else "--force to replace an earlier run"
        also = ", --force to replace it" if begun else ""
        raise InputError(f"{directory}: is not empty; choose another --out, or {instead}{also}")


def remove_run(directory: Path, inputs: Iterable[Path] = ()) -> None:
    """Remove an earlier run except for the lock, its manifest first, so that no incomplete run can be continued."""
    remove(_states(directory / CHECKPOINT))
    remove(survey(directory, OF_A_RUN, inputs, but=(CHECKPOINT,)))


def is_state_file(path: Path) -> bool:
    """Return whether a file has the name of a state's file in a checkpoint, staged or not."""
    return is_part(path) or (_STATE.fullmatch(path.name) is not None and path.is_file() and not path.is_symlink())


def _states(home: Path) -> Survey:
    """Return the files of a checkpoint, its manifest first, and all other files in its directory."""
    if home.is_symlink() or not home.is_dir():
        return Survey((), {home: "is not the directory of a checkpoint"} if os.path.lexists(home) else {})
    ours: list[Path] = []
    others: dict[Path, str] = {}
    for path in sorted(home.iterdir(), key=lambda path: (path.name != MANIFEST, path.name)):
        if is_state_file(path):
            ours.append(path)
        elif path.name == MANIFEST and path.is_file() and not path.is_symlink():
            if _is_manifest(path):
                ours.append(path)
            else:
                others[path] = "is not the manifest of a run"
        elif path.name != LOCK or path.is_symlink() or not path.is_file():
            others[path] = "was not written by this command"
    return Survey(tuple(ours), others)


def _is_manifest(path: Path) -> bool:
    try:
        return isinstance(parse_json(path.read_bytes())["serial"], int)
    except (OSError, ValueError, KeyError, TypeError):
        return False
