"""Replicates of a calibration: their tables, their verdict, and their directory.

The directory holds a manifest, which lists all settings that affect the ranks, and one file per replicate. Replicates
may be taken from an earlier calibration of the same problem whose fits had other settings; each of their files then
names these settings.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from softness_bayes.checking.calibration import DRAWS, Calibration, Replicate, verdict
from softness_bayes.errors import InputError
from softness_bayes.files.json_text import as_json, parse_json
from softness_bayes.files.lock import is_held
from softness_bayes.files.outputs import require_outputs, write_outputs
from softness_bayes.files.records import from_json, to_json
from softness_bayes.files.spreadsheet import csv_of
from softness_bayes.files.whole import write_whole
from softness_bayes.readable import counted
from softness_bayes.runs.batch import ASKED, LOCK, read_asked

if TYPE_CHECKING:
    import pandas as pd

RANKS, COVERAGE, VERDICT, FIGURE = "ranks.csv", "coverage.csv", "verdict.txt", "ecdf"
MANIFEST, REPLICATES = "manifest.json", "replicates"

TRUE = "true_"
"""Prefix of the columns of true values in the table of ranks."""

CALIBRATE = "calibrate"
"""Command under which the files are listed."""

LONG = 2_000
"""Number of steps above which a replicate is counted as long."""

FITS = ("version", "discretisation", "accuracy", "ensembles", "max_steps", "goal")
"""Settings that may differ between a calibration and an earlier one whose replicates it takes.

They change how accurately the posterior is computed. All others change the posterior itself or the meaning of a rank.
"""

AGREEMENT = 1e-3
"""Relative difference up to which a stored true value and the same one computed now agree."""


@dataclass(frozen=True)
class Calibrated:
    """All replicates of a calibration.

    Parameters
    ----------
    replicates
        By index.
    unfinished
        Indices of requested replicates that are missing.
    """

    replicates: Mapping[int, Replicate]
    unfinished: tuple[int, ...] = ()

    @property
    def calibration(self) -> Calibration:
        """Their ranks."""
        return Calibration.of([*self.replicates.values()])

    @property
    def unconverged(self) -> int:
        """Replicates that did not converge within the allowed steps; chains through the truth give their ranks."""
        return sum(not one.converged for one in self.replicates.values())

    @property
    def passed(self) -> bool:
        """True if all are finished, no test raised an alarm, and there are enough to detect a fault.

        Slow replicates differ from others, so none may be missing.
        """
        return not self.unfinished and not self.calibration.faults() and self.calibration.enough

    def ranks(self) -> pd.DataFrame:
        """Return a row per replicate: steps, convergence, other settings of its fit, all ranks and true values."""
        import pandas as pd

        rows = {
            index: {
                "steps": one.steps,
                "autocorrelation_time": one.tau,
                "converged": one.converged,
                "earlier": json.dumps(dict(one.earlier)) if one.earlier else "",
                **dict(zip(one.names, one.rank, strict=True)),
                **{f"{TRUE}{name}": value for name, value in zip(one.names, one.truth, strict=True)},
            }
            for index, one in self.replicates.items()
        }
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("replicate")

    def coverage(self) -> pd.DataFrame:
        """Return how often central intervals contain the true value, with the tests of each quantity."""
        import pandas as pd

        calibration = self.calibration
        judged = pd.DataFrame({name: one._asdict() for name, one in calibration.judge().items()}).T
        return pd.DataFrame(calibration.coverage()).join(judged, on="quantity").set_index(["quantity", "mass"])

    def sentence(self) -> str:
        """Return the verdict in one line: the alarms or, without any, the power."""
        size, every = len(self.replicates), self.replicates.values()
        asked = counted(size, "replicate")
        if self.unfinished:
            asked = f"{size} of {counted(size + len(self.unfinished), 'replicate')}"
        walks = f"{sum(one.steps > LONG for one in every)} ran longer than {LONG} steps, {self.unconverged} did not "
        walks += "converge"
        if self.unconverged:
            walks += f" and {'was' if self.unconverged == 1 else 'were'} ranked by chains through the truth"
        if self.unfinished:
            walks += f"; unfinished: {', '.join(map(str, self.unfinished))}"
        if taken := [one for one in every if one.earlier]:
            names = sorted({name for one in taken for name, _ in one.earlier})
            walks += f"; {counted(len(taken), 'was', 'were')} fitted earlier with other settings of {', '.join(names)}"
        return verdict(self.calibration, f"{asked} ({walks})", not self.unfinished)

    def save(self, directory: Path) -> None:
        """Write ranks, coverage and verdict, either all or none; those of an earlier calibration are replaced."""
        ranks, coverage = csv_of(self.ranks()), csv_of(self.coverage())
        write_outputs(directory, {RANKS: ranks, COVERAGE: coverage, VERDICT: self.sentence() + "\n"}, CALIBRATE)


@dataclass(frozen=True)
class CalibrationProgress:
    """Progress of a calibration, read without interfering with it.

    Parameters
    ----------
    asked, finished, unconverged
        Numbers of requested replicates, of finished ones, and of finished ones that did not converge.
    running
        True if a process is calibrating.
    seconds
        Estimated remaining time [s], from the replicates finished since the last call; nan without any.
    """

    asked: int
    finished: int
    unconverged: int
    running: bool
    seconds: float


def is_calibration(directory: Path) -> bool:
    """Return whether a directory contains a calibration."""
    return (directory / MANIFEST).is_file() and (directory / REPLICATES).is_dir()


def progress_of(directory: Path) -> CalibrationProgress:
    """Return the progress of a calibration."""
    asked = read_asked(directory)
    found = finished_in(directory, asked.fits)
    ended = (path_of(directory, index).stat().st_mtime for index in found)
    unconverged = sum(not one.converged for one in found.values())
    left = asked.seconds_left(ended, asked.fits - len(found))
    return CalibrationProgress(asked.fits, len(found), unconverged, is_held(directory / LOCK), left)


def path_of(directory: Path, index: int) -> Path:
    """Return the path of a replicate's file."""
    return directory / REPLICATES / f"{index:05d}.json"


def write_replicate(directory: Path, index: int, one: Replicate) -> None:
    """Write the file of a replicate."""
    write_whole(path_of(directory, index), (as_json(to_json(one), "replicate", indent=1) + "\n").encode())


def finished_replicates(directory: Path) -> int:
    """Return the number of replicates in a directory."""
    return sum(1 for _ in (directory / REPLICATES).glob("*.json"))


def finished_in(directory: Path, count: int) -> dict[int, Replicate]:
    """Return those of the first replicates that have a file, by index."""
    found = {}
    for index in range(count):
        if (path := path_of(directory, index)).is_file():
            try:
                found[index] = _replicate(_json(path, "replicate"))
            except (AttributeError, TypeError, KeyError, ValueError) as error:
                raise InputError(f"{path}: not the file of a replicate ({error!r})") from None
    return found


def prepare(directory: Path, manifest: Mapping[str, Any]) -> None:
    """Make the directory of a calibration, if necessary, with a folder of replicates.

    Raises
    ------
    InputError
        If it cannot be written to, or contains anything but a calibration with the same settings.
    """
    folder = directory / REPLICATES
    require_alike(directory, manifest)
    require_outputs(directory, (RANKS, COVERAGE, VERDICT, f"{FIGURE}.png"), CALIBRATE)
    if folder.is_symlink():
        raise InputError(f"{folder}: is a symbolic link, and files are not written through links; move it away")
    folder.mkdir(parents=True, exist_ok=True)


def write_manifest(directory: Path, manifest: Mapping[str, Any]) -> None:
    """Write the settings of a calibration, unless the same ones are already there."""
    require_alike(directory, manifest)
    if not (directory / MANIFEST).exists():
        write_whole(directory / MANIFEST, (as_json(manifest, MANIFEST, indent=1) + "\n").encode())


def require_alike(directory: Path, manifest: Mapping[str, Any]) -> None:
    """Raise an error unless a directory is empty or contains a calibration with the same settings."""
    path, manifest = directory / MANIFEST, parse_json(as_json(manifest, MANIFEST))
    if path.is_file():
        before = _json(path, "calibration")
        for name in dict.fromkeys([*before, *manifest]):
            if before.get(name) != manifest.get(name):
                other = f"; --from {directory} takes its replicates to another --out" if name in FITS else ""
                raise InputError(
                    f"{path}: {name} was {before.get(name)} and is now {manifest.get(name)}; choose another "
                    f"--out, or use the earlier value{other}"
                )
    elif directory.is_dir() and any(entry.name not in (ASKED, LOCK, REPLICATES) for entry in directory.iterdir()):
        raise InputError(f"{directory}: is not empty and contains no calibration; choose another --out")


def take(source: Path, directory: Path, manifest: Mapping[str, Any], redraw: Callable[[int], dict[str, float]]) -> None:
    """Copy the replicates of an earlier calibration that a directory lacks.

    They are read from its files, or from its table of ranks, which is all that a stored result contains. The settings
    of its fits may differ (`FITS`), and are written to the files of the replicates. Its true values must be those that
    the present model draws, which shows that design, priors, seed and simulated ratings are the same.

    Parameters
    ----------
    source
        Directory of the earlier calibration, which is only read.
    directory
        Directory of the calibration, with its folder of replicates.
    manifest
        Its settings.
    redraw
        Function that computes the true values of a replicate, by the names of its quantities.

    Raises
    ------
    InputError
        If there is no calibration, or it is of another problem.
    """
    if not (source / MANIFEST).is_file():
        raise InputError(f"{source}: contains no calibration ({MANIFEST} is missing)")
    before, manifest = _json(source / MANIFEST, "calibration"), parse_json(as_json(manifest, MANIFEST))
    for name in [name for name in before if name in manifest and name not in FITS]:
        if before[name] != manifest[name]:
            raise InputError(
                f"{source / MANIFEST}: {name} was {before[name]} and is now {manifest[name]}, so its "
                "replicates are of another problem; use the earlier value"
            )
    last = [int(path.stem) for path in (source / REPLICATES).glob("[0-9]*.json") if path.stem.isdigit()]
    table = dict(_table(source / RANKS)) if (source / RANKS).is_file() else {}
    every = table | finished_in(source, max(last, default=-1) + 1)
    if not every:
        raise InputError(f"{source}: contains no finished replicate, neither in {REPLICATES} nor in {RANKS}")
    new = {}
    for index, one in every.items():
        if not path_of(directory, index).exists():
            _require_same_truth(source, index, one, redraw(index))
            fit = {name: before.get(name) for name in FITS} | dict(one.earlier)
            earlier = [(name, str(value)) for name, value in fit.items() if str(value) != str(manifest.get(name))]
            new[index] = one._replace(earlier=tuple(earlier))
    for index, one in new.items():
        write_replicate(directory, index, one)


def _table(path: Path) -> Iterator[tuple[int, Replicate]]:
    """Yield the replicates of a table of ranks, by index."""
    with path.open(encoding="utf-8", newline="") as file:
        for line, row in enumerate(csv.DictReader(file), start=2):
            names = [name for name in row if f"{TRUE}{name}" in row]
            try:
                found = {
                    "names": names,
                    "rank": [row[name] for name in names],
                    "truth": [row[f"{TRUE}{name}"] for name in names],
                    "steps": row["steps"],
                    "tau": row["autocorrelation_time"],
                    "converged": {"True": True, "False": False}[row["converged"]],
                    "earlier": [*parse_json(row.get("earlier") or "{}").items()],
                }
                yield int(row["replicate"]), _replicate(found)
            except (AttributeError, TypeError, KeyError, ValueError) as error:
                raise InputError(f"{path}, row {line}: not a replicate ({error!r})") from None


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


def _replicate(fields: Mapping[str, Any]) -> Replicate:
    one: Replicate = from_json(Replicate, fields)
    if not len(one.names) == len(one.rank) == len(one.truth):
        raise ValueError(f"{len(one.names)} names, {len(one.rank)} ranks and {len(one.truth)} true values")
    if outside := [rank for rank in one.rank if not 0 <= rank <= DRAWS]:
        raise ValueError(f"rank {outside[0]}, expected 0 to {DRAWS}")
    return one


def _json(path: Path, what: str) -> dict[str, Any]:
    try:
        fields = parse_json(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise InputError(f"{path}: not the file of a {what} ({error})") from None
    if not isinstance(fields, dict):
        raise InputError(f"{path}: not the file of a {what}")
    return fields
