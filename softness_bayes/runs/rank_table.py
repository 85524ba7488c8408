"""Replicates of a calibration: their table, which records them as they finish, and their verdict.

The directory of a calibration holds a manifest, which lists all settings that affect the ranks, and the table of ranks,
which is replaced whenever a replicate is finished. Replicates may be taken from an earlier calibration of the same
problem whose fits had other settings; their rows then name these settings.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from softness_bayes.base.errors import InputError
from softness_bayes.base.files.outputs import write_outputs
from softness_bayes.base.files.records import as_json, from_json, parse_json
from softness_bayes.base.files.spreadsheet import csv_of
from softness_bayes.base.readable import counted
from softness_bayes.checking.calibration import DRAWS, Calibration, Replicate, verdict
from softness_bayes.runs.batch import ASKED, LOCK

if TYPE_CHECKING:
    import pandas as pd

MANIFEST, RANKS, COVERAGE, VERDICT, FIGURE = "manifest.json", "ranks.csv", "coverage.csv", "verdict.txt", "ecdf"

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

    def coverage(self) -> pd.DataFrame:
        """Return how often central intervals contain the true value, with the tests of each quantity."""
        import pandas as pd

        calibration = self.calibration
        judged = pd.DataFrame({name: one._asdict() for name, one in calibration.judge().items()}).T
        return calibration.coverage().join(judged, on="quantity").set_index(["quantity", "mass"])

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
        """Write coverage and verdict, both or none; those of an earlier calibration are replaced."""
        write_outputs(directory, {COVERAGE: csv_of(self.coverage()), VERDICT: self.sentence() + "\n"}, CALIBRATE)


def rank_table(replicates: Mapping[int, Replicate]) -> pd.DataFrame:
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
        for index, one in sorted(replicates.items())
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("replicate")


def write_replicates(directory: Path, replicates: Mapping[int, Replicate]) -> None:
    """Write the table of all finished replicates of a calibration."""
    write_outputs(directory, {RANKS: csv_of(rank_table(replicates))}, CALIBRATE)


def read_replicates(directory: Path) -> dict[int, Replicate]:
    """Return the finished replicates of a calibration, by index.

    Raises
    ------
    InputError
        Naming the row that is not one of a replicate.
    """
    path, found = directory / RANKS, {}
    if not path.is_file():
        return {}
    with path.open(encoding="utf-8", newline="") as file:
        for line, row in enumerate(csv.DictReader(file), start=2):
            try:
                found[int(row["replicate"])] = _replicate(row)
            except (AttributeError, TypeError, KeyError, ValueError) as error:
                raise InputError(f"{path}, row {line}: not a replicate ({error!r})") from None
    return found


def _replicate(row: Mapping[str, str]) -> Replicate:
    names = [name for name in row if f"{TRUE}{name}" in row]
    values = {
        "names": names,
        "rank": [row[name] for name in names],
        "truth": [row[f"{TRUE}{name}"] for name in names],
        "steps": row["steps"],
        "tau": row["autocorrelation_time"] or "nan",
        "converged": {"True": True, "False": False}[row["converged"]],
        "earlier": [*parse_json(row.get("earlier") or "{}").items()],
    }
    one: Replicate = from_json(Replicate, values)
    if outside := [rank for rank in one.rank if not 0 <= rank <= DRAWS]:
        raise ValueError(f"rank {outside[0]}, expected 0 to {DRAWS}")
    return one


def require_alike(directory: Path, manifest: Mapping[str, Any]) -> None:
    """Raise an error unless a directory is empty or contains a calibration with the same settings."""
    path = directory / MANIFEST
    if path.is_file():
        before, now = _manifests(path, manifest)
        for name in dict.fromkeys([*before, *now]):
            if before.get(name) != now.get(name):
                other = f"; --from {directory} takes its replicates to another --out" if name in FITS else ""
                raise InputError(
                    f"{path}: {name} was {before.get(name)} and is now {now.get(name)}; choose another --out, or use "
                    f"the earlier value{other}"
                )
    elif directory.is_dir() and any(entry.name not in (ASKED, LOCK) for entry in directory.iterdir()):
        raise InputError(f"{directory}: is not empty and contains no calibration; choose another --out")


def _manifests(path: Path, manifest: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the settings in the file of an earlier manifest and those of a manifest, as JSON values."""
    try:
        return dict(parse_json(path.read_text(encoding="utf-8"))), dict(parse_json(as_json(manifest, MANIFEST)))
    except (ValueError, TypeError) as error:
        raise InputError(f"{path}: not the file of a calibration ({error})") from None


def earlier_replicates(
    source: Path, manifest: Mapping[str, Any], redraw: Callable[[int], dict[str, float]], known: Mapping[int, Replicate]
) -> dict[int, Replicate]:
    """Return the replicates of an earlier calibration that a calibration lacks, with the settings that differ.

    The settings of its fits may differ (`FITS`). Its true values must be those that the present model draws, which
    shows that design, priors, seed and simulated ratings are the same.

    Parameters
    ----------
    source
        Directory of the earlier calibration, with its manifest and its table of ranks; it is only read.
    manifest
        Settings of the present calibration.
    redraw
        Function that computes the true values of a replicate, by the names of its quantities.
    known
        Replicates of the present calibration.

    Raises
    ------
    InputError
        If there is no calibration, or it is of another problem.
    """
    path = source / MANIFEST
    if not path.is_file():
        raise InputError(f"{source}: contains no calibration ({MANIFEST} is missing)")
    before, fits = _manifests(path, manifest)
    for name in before:
        if name in fits and name not in FITS and before[name] != fits[name]:
            raise InputError(
                f"{path}: {name} was {before[name]} and is now {fits[name]}, so its replicates are of another problem; "
                "use the earlier value"
            )
    if not (every := read_replicates(source)):
        raise InputError(f"{source}: contains no finished replicate in {RANKS}")
    new = {}
    for index in every.keys() - known.keys():
        one = every[index]
        _require_same_truth(source, index, one, redraw(index))
        settings = {name: str(before.get(name)) for name in FITS} | dict(one.earlier)
        other = tuple((name, value) for name, value in settings.items() if value != str(fits.get(name)))
        new[index] = one._replace(earlier=other)
    return new


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
