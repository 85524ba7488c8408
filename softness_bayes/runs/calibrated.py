"""All replicates of a calibration: their tables, their verdict, and its files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from softness_bayes.checking.calibration import Calibration, Replicate, verdict
from softness_bayes.files.outputs import write_outputs
from softness_bayes.files.spreadsheet import csv_of
from softness_bayes.readable import counted

if TYPE_CHECKING:
    import pandas as pd

RANKS, COVERAGE, VERDICT, FIGURE = "ranks.csv", "coverage.csv", "verdict.txt", "ecdf"

TRUE = "true_"
"""Prefix of the columns of true values in the table of ranks."""

CALIBRATE = "calibrate"
"""Command under which the files are listed."""

LONG = 2_000
"""Number of steps above which a replicate is counted as long."""


class StoredReplicates(NamedTuple):
    """Replicates taken from an earlier calibration of the same problem."""

    replicates: tuple[int, ...]
    """Their indices."""
    settings: Mapping[str, str]
    """Settings of their fits that differ from those of the other replicates, by name."""


@dataclass(frozen=True)
class Calibrated:
    """All replicates of a calibration.

    Parameters
    ----------
    replicates
        By index.
    unfinished
        Indices of requested replicates that are missing.
    earlier
        Replicates whose fits had other settings.
    """

    replicates: Mapping[int, Replicate]
    unfinished: tuple[int, ...] = ()
    earlier: tuple[StoredReplicates, ...] = ()

    @property
    def calibration(self) -> Calibration:
        """Their ranks."""
        return Calibration.of([*self.replicates.values()])

    @property
    def unconverged(self) -> int:
        """Replicates that did not converge within the allowed steps; their ranks are included."""
        return sum(not one.converged for one in self.replicates.values())

    @property
    def exchangeable(self) -> int:
        """Those of them that are ranked among draws that are exchangeable with the truth."""
        return sum(one.exchangeable for one in self.replicates.values())

    @property
    def invalid(self) -> int:
        """Those of them that are ranked among the draws of their run, by an earlier version of this program."""
        return sum(not one.valid for one in self.replicates.values())

    @property
    def longer(self) -> int:
        """Replicates that ran longer than `LONG` steps."""
        return sum(one.steps > LONG for one in self.replicates.values())

    @property
    def passed(self) -> bool:
        """True if `decided`, no test raised an alarm, and there are enough to detect a fault."""
        return self.decided and not self.calibration.faults() and self.calibration.enough

    @property
    def decided(self) -> bool:
        """True if all are finished with valid ranks; slow replicates differ from others, so none may be missing."""
        return not self.invalid and not self.unfinished

    def ranks(self) -> pd.DataFrame:
        """Return a row per replicate: its fields apart from the names, then all ranks and true values."""
        import pandas as pd

        rows = {}
        for index, one in self.replicates.items():
            found = dict(zip(one.names, one.rank, strict=True))
            true = {f"{TRUE}{name}": value for name, value in zip(one.names, one.truth, strict=True)}
            rows[index] = {
                "steps": one.steps,
                "autocorrelation_time": one.tau,
                "converged": one.converged,
                "exchangeable": one.exchangeable,
                **found,
                **true,
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
        size = len(self.replicates)
        asked = counted(size, "replicate")
        if self.unfinished:
            asked = f"{size} of {counted(size + len(self.unfinished), 'replicate')}"
        left = f"; unfinished: {', '.join(map(str, self.unfinished))}" if self.unfinished else ""
        walks = f"{self.longer} ran longer than {LONG} steps, {self.unconverged} did not converge"
        walks += f"{_ranked(self.exchangeable, self.unconverged)}{left}{self._taken()}"
        return verdict(self.calibration, f"{asked} ({walks})", self.decided)

    def _taken(self) -> str:
        """Describe the replicates whose fits had other settings."""
        taken = {index for one in self.earlier for index in one.replicates} & {*self.replicates}
        names = sorted({name for one in self.earlier for name in one.settings})
        return (
            f"; {counted(len(taken), 'was', 'were')} fitted earlier with other settings of {', '.join(names)}"
            if taken
            else ""
        )

    def save(self, directory: Path) -> None:
        """Write ranks, coverage and verdict, either all or none; those of an earlier calibration are replaced."""
        ranks, coverage = csv_of(self.ranks()), csv_of(self.coverage())
        write_outputs(directory, {RANKS: ranks, COVERAGE: coverage, VERDICT: self.sentence() + "\n"}, CALIBRATE)


def _ranked(exchangeable: int, unconverged: int) -> str:
    """Describe how the unconverged replicates were ranked."""
    if not exchangeable:
        return ""
    which = "and" if exchangeable == unconverged else f"of which {exchangeable}"
    return f" {which} {'was' if exchangeable == 1 else 'were'} ranked by chains through the truth"
