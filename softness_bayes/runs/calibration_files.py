"""Directory of a calibration: its settings, one file per replicate, and replicates taken from an earlier directory."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from softness_bayes.checking.calibration import DRAWS, Replicate
from softness_bayes.errors import InputError
from softness_bayes.files.asked import read_asked
from softness_bayes.files.json_text import parse_json
from softness_bayes.files.lock import is_held
from softness_bayes.files.outputs import require_outputs
from softness_bayes.files.whole import write_whole
from softness_bayes.likelihood.directions import direction_named
from softness_bayes.runs.calibrated import CALIBRATE, COVERAGE, FIGURE, RANKS, TRUE, VERDICT, StoredReplicates

MANIFEST, REPLICATES, LOCK, EARLIER = "manifest.json", "replicates", "lock", "earlier.json"

FITS = ("version", "discretisation", "accuracy", "ensembles", "max_steps", "goal")
"""Settings that may differ between a calibration and an earlier one whose replicates it takes.

They change how accurately the posterior is computed. All others change the posterior itself or the meaning of a rank.
"""

AGREEMENT = 1e-3
"""Relative difference up to which a stored true value and the same one computed now agree."""

Redraw = Callable[[int], dict[str, float]]
"""Computes the true values of a replicate again, by the names of its quantities."""


def path_of(folder: Path, index: int) -> Path:
    """Return the path of a replicate's file."""
    return folder / f"{index:05d}.json"


def write_replicate(folder: Path, index: int, one: Replicate) -> None:
    """Write the file of a replicate."""
    write_whole(path_of(folder, index), (json.dumps(one._asdict(), indent=1) + "\n").encode())


def finished_in(folder: Path, count: int) -> dict[int, Replicate]:
    """Return the replicates with a file, by index."""
    return {index: _read(path) for index in range(count) if (path := path_of(folder, index)).is_file()}


def finished_replicates(directory: Path) -> int:
    """Return the number of replicates in a directory."""
    return sum(1 for _ in (directory / REPLICATES).glob("*.json"))


class CalibrationProgress(NamedTuple):
    """Progress of a calibration, read without interfering with it."""

    asked: int
    """Number of requested replicates; 0 if an earlier version began it."""
    finished: int
    """Number of finished replicates among them."""
    unconverged: int
    """Number of finished replicates that did not converge."""
    running: bool
    """True if a process is calibrating."""
    seconds: float
    """Estimated remaining time [s], from the replicates finished since the last call; nan without any."""


def is_calibration(directory: Path) -> bool:
    """Return whether a directory contains a calibration."""
    return (directory / MANIFEST).is_file() and (directory / REPLICATES).is_dir()


def progress_of(directory: Path) -> CalibrationProgress:
    """Return the progress of a calibration."""
    asked, begun = read_asked(directory)
    found = finished_in(directory / REPLICATES, asked or finished_replicates(directory))
    times = (path_of(directory / REPLICATES, index).stat().st_mtime for index in found)
    since = [when for when in times if when > begun]
    each = (max(since) - begun) / len(since) if since and asked else math.nan
    unconverged = sum(not one.converged for one in found.values())
    return CalibrationProgress(asked, len(found), unconverged, is_held(directory / LOCK), each * (asked - len(found)))


def made_folder(directory: Path, manifest: dict[str, Any]) -> Path:
    """Return the folder of the replicates, created if necessary, in a writable directory."""
    folder = directory / REPLICATES
    require_alike(directory, manifest)
    require_outputs(directory, (RANKS, COVERAGE, VERDICT, f"{FIGURE}.png"), CALIBRATE)
    if folder.is_symlink():
        raise InputError(f"{folder}: is a symbolic link, and files are not written through links; move it away")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def write_manifest(directory: Path, manifest: dict[str, Any]) -> None:
    """Write the settings of a calibration, unless they are already there."""
    if not (directory / MANIFEST).exists():
        write_whole(directory / MANIFEST, (json.dumps(manifest, indent=1) + "\n").encode())


def require_alike(directory: Path, manifest: dict[str, Any]) -> None:
    """Raise an error unless a directory is empty or contains a calibration with the same settings."""
    manifest = parse_json(json.dumps(manifest))
    path = directory / MANIFEST
    if path.is_file():
        before = _settings(path)
        for name in dict.fromkeys([*before, *manifest]):
            if before.get(name) != manifest.get(name):
                other = f"; --from {directory} takes its replicates to another --out" if name in FITS else ""
                raise InputError(
                    f"{path}: {name} was {before.get(name)} and is now {manifest.get(name)}; choose another "
                    f"--out, or use the earlier value{other}"
                )
    elif directory.is_dir() and any(entry.name not in (LOCK, REPLICATES) for entry in directory.iterdir()):
        raise InputError(f"{directory}: is not empty and contains no calibration; choose another --out")


class _Origin(NamedTuple):
    """An earlier calibration."""

    directory: Path
    settings: dict[str, Any]
    replicates: dict[int, Replicate]


def take(source: Path, directory: Path, manifest: dict[str, Any], redraw: Redraw) -> None:
    """Copy the replicates of an earlier calibration that a directory lacks, apart from those without valid ranks.

    They are read from its files, or from its table of ranks, which is all that a stored result contains. The settings
    of its fits may differ (`FITS`) and are recorded. Its true values must be those that the present model draws, which
    shows that design, priors, seed and simulated ratings are the same.

    Parameters
    ----------
    source
        Directory of the earlier calibration, which is only read.
    directory
        Directory of the calibration, with its folder of replicates.
    manifest
        Its settings.
    redraw
        Function that computes the true values of a replicate.

    Raises
    ------
    InputError
        If there is no calibration, or it is of another problem.
    """
    origin = _origin(source)
    differ = _require_same_problem(origin, parse_json(json.dumps(manifest)))
    folder = directory / REPLICATES
    valid = {index: one for index, one in origin.replicates.items() if one.valid}
    new = {index: one for index, one in valid.items() if not path_of(folder, index).exists()}
    for index, one in new.items():
        _require_same_truth(origin.directory, index, one, redraw(index))
    # before the replicates: these must never appear as ones of this calibration's own fits
    _record(directory, [*earlier_of(source), StoredReplicates((*new,), differ)], {*new}, manifest)
    for index, one in new.items():
        write_replicate(folder, index, one)


def _record(directory: Path, origins: Iterable[StoredReplicates], new: set[int], manifest: dict[str, Any]) -> None:
    """Record which new replicates have other settings, each under the first of the origins that contains it."""
    found = [one._replace(replicates=tuple(k for k in one.replicates if k not in new)) for one in earlier_of(directory)]
    for one in origins:
        other = {name: value for name, value in one.settings.items() if value != str(manifest.get(name))}
        found.append(StoredReplicates(tuple(k for k in one.replicates if k in new), other))
        new = new - {*one.replicates}
    _write_origins(directory, found)


def _write_origins(directory: Path, origins: Iterable[StoredReplicates]) -> None:
    kept = [one._asdict() for one in origins if one.replicates and one.settings]
    if kept:
        write_whole(directory / EARLIER, (json.dumps(kept, indent=1) + "\n").encode())
    else:
        (directory / EARLIER).unlink(missing_ok=True)


def forget_missing(directory: Path) -> None:
    """Remove from the list of earlier replicates those without a file, before they are fitted here.

    A process that is killed while it takes an earlier calibration has listed replicates that it never wrote.
    """
    folder, before = directory / REPLICATES, earlier_of(directory)
    now = [one._replace(replicates=tuple(k for k in one.replicates if path_of(folder, k).exists())) for one in before]
    if [*before] != now:
        _write_origins(directory, now)


def earlier_of(directory: Path) -> tuple[StoredReplicates, ...]:
    """Return which replicates of a calibration come from earlier ones with other settings of the fits."""
    path = directory / EARLIER
    if not path.is_file():
        return ()
    try:
        found = parse_json(path.read_text(encoding="utf-8"))
        return tuple(StoredReplicates(tuple(map(int, one["replicates"])), dict(one["settings"])) for one in found)
    except (ValueError, TypeError, KeyError) as error:
        raise InputError(f"{path}: not the list of earlier replicates ({error!r})") from None


def _origin(source: Path) -> _Origin:
    if not (source / MANIFEST).is_file():
        raise InputError(f"{source}: contains no calibration ({MANIFEST} is missing)")
    stored = dict(_stored(source / RANKS)) if (source / RANKS).is_file() else {}
    last = [int(path.stem) for path in (source / REPLICATES).glob("[0-9]*.json") if path.stem.isdigit()]
    replicates = stored | finished_in(source / REPLICATES, max(last, default=-1) + 1)
    if not replicates:
        raise InputError(f"{source}: contains no finished replicate, neither in {REPLICATES} nor in {RANKS}")
    return _Origin(source, _settings(source / MANIFEST), dict(sorted(replicates.items())))


def _stored(path: Path) -> Iterator[tuple[int, Replicate]]:
    """Yield the replicates of a table of ranks, by index."""
    with path.open(encoding="utf-8", newline="") as file:
        for line, row in enumerate(csv.DictReader(file), start=2):
            names = tuple(name for name in row if f"{TRUE}{name}" in row)
            try:
                found = {
                    "names": names,
                    "rank": [int(row[name]) for name in names],
                    "truth": [float(row[f"{TRUE}{name}"]) for name in names],
                    "steps": row["steps"],
                    "tau": row["autocorrelation_time"],
                    "converged": {"True": True, "False": False}[row["converged"]],
                    "exchangeable": {"True": True, "False": False}[row.get("exchangeable", "False")],
                }
                yield int(row["replicate"]), _replicate(found)
            except (TypeError, KeyError, ValueError) as error:
                raise InputError(f"{path}, row {line}: not a replicate ({error!r})") from None


def _require_same_problem(origin: _Origin, manifest: dict[str, Any]) -> dict[str, str]:
    """Return the earlier settings of the fits that differ; settings that an earlier version lacks are not compared."""
    before = origin.settings
    for name in before:
        if name not in FITS and before[name] != manifest.get(name):
            raise InputError(
                f"{origin.directory / MANIFEST}: {name} was {before[name]} and is now {manifest.get(name)}, so its "
                "replicates are of another problem; use the earlier value"
            )
    return {name: str(before[name]) for name in FITS if name in before and before[name] != manifest.get(name)}


def _require_same_truth(directory: Path, index: int, one: Replicate, now: dict[str, float]) -> None:
    if one.names != (*now,):
        differ = sorted({*one.names} ^ {*now})
        raise InputError(f"{directory}: replicate {index} ranks other quantities ({', '.join(differ) or 'reordered'})")
    for name, then in zip(one.names, one.truth, strict=True):
        if not np.isclose(then, now[name], rtol=AGREEMENT, atol=1e-9):
            raise InputError(
                f"{directory}: the true {name} of replicate {index} was {then:.6g} and is now {now[name]:.6g}, so its "
                "replicates are of another problem: their model or priors differ"
            )


def _read(path: Path) -> Replicate:
    try:
        return _replicate(_json(path, "replicate"))
    except (TypeError, KeyError, ValueError) as error:
        raise InputError(f"{path}: not the file of a replicate ({error!r})") from None


def _replicate(fields: dict[str, Any]) -> Replicate:
    one = Replicate(
        names=tuple(fields["names"]),
        rank=tuple(fields["rank"]),
        truth=tuple(fields["truth"]),
        steps=int(fields["steps"]),
        tau=float(fields["tau"]),
        converged=bool(fields["converged"]),
        exchangeable=bool(fields.get("exchangeable", False)),
    )
    if not len(one.names) == len(one.rank) == len(one.truth):
        raise ValueError(f"{len(one.names)} names, {len(one.rank)} ranks and {len(one.truth)} true values")
    if outside := [rank for rank in one.rank if not 0 <= rank <= DRAWS]:
        raise ValueError(f"rank {outside[0]}, expected 0 to {DRAWS}")
    return one


def _settings(path: Path) -> dict[str, Any]:
    """Return the settings of a calibration, under their present names."""
    found = _json(path, "calibration")
    if "direction" in found:
        found["direction"] = direction_named(str(found["direction"])).name
    return found


def _json(path: Path, what: str) -> dict[str, Any]:
    try:
        fields = parse_json(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise InputError(f"{path}: not the file of a {what} ({error})") from None
    if not isinstance(fields, dict):
        raise InputError(f"{path}: not the file of a {what}")
    return fields
