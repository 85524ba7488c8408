"""Options of a run beside its model: its files and its limits, each declared once."""

from __future__ import annotations

import math
import numbers
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from softness_bayes.base import defaults
from softness_bayes.base import options as kinds
from softness_bayes.base.defaults import MAX_STEPS, SEED
from softness_bayes.base.errors import InputError, quoted
from softness_bayes.base.options import Options, described, option
from softness_bayes.base.ranges import LOAD_STEPS, PROCESSES, SEEDS, STEPS, STEPS_PER_TAU, Count, require_kind
from softness_bayes.model.options import ModelOptions

if TYPE_CHECKING:
    from softness_bayes.data import Experiment, Measurements, Ratings
    from softness_bayes.data.texts import Marks
    from softness_bayes.results.stored import Stored
    from softness_bayes.sampler.sampling import Settings


@described
@dataclass(frozen=True)
class RunOptions(Options):
    """Limits of the sampler, and its seed."""

    exact_reweight: bool = option(
        kinds.Flag(),
        False,
        "--exact-reweight",
        "Weight the draws by the exact likelihood (Pareto-smoothed); summary and predictions use the weighted draws.",
        needs_ratings=True,
    )
    max_steps: int = option(
        kinds.Number(STEPS, "N"),
        MAX_STEPS,
        "--max-steps",
        "Largest number of steps of each ensemble; the run then ends even if it has not converged.",
        shown=True,
        spelled=True,
    )
    steps_per_tau: float = option(
        kinds.Number(STEPS_PER_TAU, "N"),
        defaults.STEPS_PER_TAU,
        "--steps-per-tau",
        "Least number of kept steps of each ensemble, in autocorrelation times; 50 is a usual caution for a single "
        "ensemble.",
        shown=True,
    )
    quick: bool = option(
        kinds.Flag(),
        False,
        "--quick",
        "A first look: the run ends at the first check of the chains, converged or not, with few "
        "figures and without the comparison with the exact model. 'resume' continues it to the full run.",
    )
    max_seconds: float = option(
        kinds.Duration(),
        math.inf,
        "--max-time",
        "Longest time of the run, such as 90 (seconds), 10m or 2h; it then ends even if it has not "
        "converged. By default no limit.",
    )
    processes: int | None = option(
        kinds.Number(PROCESSES, "N"),
        None,
        "--processes",
        "Processes that share the ensembles; by default one for each core. Draws do not depend on it.",
    )
    seed: int = option(
        kinds.Number(SEEDS, "N"),
        SEED,
        "--seed",
        "Seed of the random numbers: the same seed gives the same results.",
        shown=True,
        spelled=True,
    )
    min_steps: int = option(
        kinds.Number(Count(0, STEPS.high)),
        0,
        help="Smallest number of steps of each ensemble, even if the run has converged earlier.",
    )
    command: str = option(kinds.Kind(), "", help="The command line, for the record.")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.quick and self.exact_reweight:
            raise InputError("quick: a first look does not use the exact likelihood; omit exact_reweight or quick")

    @property
    def settings(self) -> Settings:
        """Settings of the sampler."""
        from softness_bayes.sampler.diagnostics import Goal
        from softness_bayes.sampler.sampling import FIRST_LOOK, Settings

        return Settings(
            goal=Goal(lengths=self.steps_per_tau),
            max_steps=min(self.max_steps, FIRST_LOOK) if self.quick else self.max_steps,
            max_seconds=self.max_seconds,
            min_steps=self.min_steps,
            processes=self.processes,
        )


class Load(kinds.Kind):
    """A load of all ratings, in the unit of the column that tables may have for it."""

    def __init__(self, column: str, unit: str) -> None:
        self.column, self.metavar = column, unit

    def accept(self, name: str, value: Any) -> Any:
        """Return a number in the range of the column."""
        from softness_bayes.data.columns import NUMBERS

        require_kind(name, value, numbers.Real, "a number")
        NUMBERS[self.column].parse(repr(float(value)))
        return value

    def parse(self, text: str) -> float:
        """Return a number in the range of the column."""
        try:
            return float(self.accept(self.column, float(text)))
        except ValueError as error:
            invalid = "could not convert" in str(error)
            raise InputError(f"{text!r} is not a valid float." if invalid else str(error)) from None


class Free(kinds.Kind):
    """The word for touches of unknown force."""

    choices = ("free",)


class DecimalMarks(kinds.Kind):
    """The decimal mark of all tables, or marks by table."""

    metavar = "[TABLE=]MARK"
    repeated = True

    def accept(self, name: str, value: Any) -> Any:
        """Return the mark or the marks; the readers of tables check them."""
        return value

    def parse(self, texts: Sequence[str]) -> Marks:
        """Return the one mark, or table -> mark."""
        from softness_bayes.data.texts import MARKED, MARKS

        marks: dict[str, str] = {}
        for text in texts:
            table, _, mark = text.rpartition("=")
            if mark not in MARKS or table not in ("", *MARKED):
                raise InputError(
                    f"expected a comma or a point, or TABLE=MARK for one of {', '.join(MARKED)}, got {quoted(text)}"
                )
            if marks.setdefault(table, mark) != mark or ("" in marks and len(marks) > 1):
                raise InputError(f"two decimal marks for one table: {' and '.join(texts)}")
        return marks.get("", marks or None)

    def write(self, value: Marks) -> list[str]:
        """Return the one mark, or a text for each table."""
        return [f"{table}={mark}" for table, mark in value.items()] if isinstance(value, Mapping) else [str(value)]


@described
@dataclass(frozen=True)
class DataFiles(Options):
    """The files of an experiment, and how to read them."""

    data: Path | None = option(kinds.FilePath(), None, "--data", "Table of ratings (CSV, Excel or Parquet).")
    compression: Path | None = option(
        kinds.FilePath(),
        None,
        "--compression",
        "Forces of a rigid flat plate on fingerpads (participant, indentation_mm, force_n), with or without ratings.",
    )
    afferents: Path | None = option(
        kinds.FilePath(),
        None,
        "--afferents",
        "Firing recorded from afferents under rigid probes (force_n or indentation_mm, probe_curvature_per_m, "
        "distance_mm, and rate_hz or count and window_s), with or without other data.",
    )
    fabrics: Path | None = option(
        kinds.FilePath(),
        None,
        "--fabrics",
        "Fabric table; by default columns of the ratings, a sheet of their workbook, or a fabrics.csv in the "
        "same folder.",
        needs_ratings=True,
    )
    columns: Mapping[str, str] = option(
        kinds.ByName("NAME=ACTUAL"),
        flag="--column",
        default_factory=dict,
        help="Name of a column in your files, such as rating=softness.",
    )
    decimal: Marks = option(
        DecimalMarks(),
        None,
        "--decimal",
        "Decimal mark of the files (, or .), if their numbers do not show it; the other mark then separates "
        "thousands. If tables differ: ratings=, or fabrics=. or compression=, or afferents=, each with its mark.",
    )
    indentation_mm: float | None = option(
        Load("indentation_mm", "mm"),
        None,
        "--indentation-mm",
        "Indentation [mm] of all ratings, if the table has no column for it.",
        needs_ratings=True,
    )
    force_n: float | None = option(
        Load("force_n", "N"),
        None,
        "--force-n",
        "Contact force [N] of all ratings, if the table has no column for it.",
        needs_ratings=True,
    )
    load: str | None = option(
        Free(),
        None,
        "--load",
        "free: people pressed as they liked. All ratings then share one unknown force, sampled as touch_force; its "
        "prior is lognormal(1,0.7) in N, which --prior changes.",
        needs_ratings=True,
    )
    round_load: float | None = option(
        kinds.Number(LOAD_STEPS, "STEP"),
        None,
        "--round-load",
        "Round loads to multiples of STEP (in N and mm) and report which were merged; by default loads "
        "are used as measured.",
        needs_ratings=True,
    )
    drop_zeros: bool = option(
        kinds.Flag(),
        False,
        "--drop-zeros",
        "Leave out ratings of 0 instead of treating them as censored.",
        needs_ratings=True,
    )
    drift: bool = option(
        kinds.Flag(),
        False,
        "--drift",
        "Let the scale of a rater drift: one for each session (column session) or, without these, for each quarter of "
        "the trials (column trial).",
        needs_ratings=True,
    )
    wide: bool = option(
        kinds.Flag(),
        False,
        "--wide",
        "The table has one column per fabric, or per fabric and load (cotton_2mm). Needed only if the "
        "headers do not show it.",
        needs_ratings=True,
    )

    @property
    def paths(self) -> tuple[Path, ...]:
        """The files that may be read, the fabrics beside the ratings among them."""
        from softness_bayes.data import FABRICS_BESIDE

        beside = None if self.data is None else self.data.with_name(FABRICS_BESIDE)
        return tuple(
            path for path in (self.data, self.fabrics, self.compression, self.afferents, beside) if path is not None
        )

    def read(self) -> Experiment | Measurements:
        """Return the experiment, with other data if there are any; or data without ratings.

        Raises
        ------
        InputError
            If no table is given, or an option for ratings without ratings.
        """
        from softness_bayes.data import read_experiment, read_measurements

        if self.data is not None:
            how = {name: getattr(self, name) for name in DataFiles.declared}
            del how["data"]
            others = {f"{name}_path": how.pop(name) for name in ("compression", "afferents")}
            return read_experiment(self.data, how.pop("fabrics"), **others, **how)
        if self.compression is None and self.afferents is None:
            raise InputError(
                "no data: give ratings with --data, a plate's forces with --compression, or recorded afferents with "
                "--afferents"
            )
        require_no_ratings_needed(self)
        return read_measurements(self.compression, self.afferents, columns=self.columns, decimal=self.decimal)

    def answers(self) -> Ratings | None:
        """Return ratings of fabrics of which nothing was measured (`data.read_answers`); None for other data."""
        from softness_bayes.data import read_answers

        if self.data is None:
            return None
        how = {
            name: getattr(self, name)
            for name in DataFiles.declared
            if name not in ("compression", "afferents", "round_load")
        }
        return read_answers(how.pop("data"), how.pop("fabrics"), **how)

    def record_in(self, directory: Path) -> dict[str, Any]:
        """Return a record with paths relative to a directory, so that a run and its files can move together."""
        home, record = directory.resolve(), self.record()
        for name, path in self._files().items():
            # the file may be a link; the table of fabrics is in the directory of the link
            record[name] = os.path.relpath(path.parent.resolve() / path.name, home)
        return record

    @classmethod
    def recorded_in(cls, directory: Path, record: Mapping[str, Any]) -> Self:
        """Return the files of a record with paths relative to a directory."""
        files, home = cls.from_record(record), directory.resolve()
        here: dict[str, Any] = {name: os.path.normpath(home / path) for name, path in files._files().items()}
        return replace(files, **here)

    def _files(self) -> dict[str, Path]:
        paths = {name: getattr(self, name) for name in ("data", "compression", "afferents", "fabrics")}
        return {name: path for name, path in paths.items() if path is not None}


def require_no_ratings_needed(*given: Options) -> None:
    """Raise an error for options that only a model of ratings has, if they differ from their defaults.

    Raises
    ------
    InputError
        Naming their flags.
    """
    flags = [
        one.flag
        for options in given
        for name, one in options.declared.items()
        if one.needs_ratings and getattr(options, name) != one.default
    ]
    if flags:
        needs, them = ("needs", "it") if len(flags) == 1 else ("need", "them")
        raise InputError(f"{' and '.join(flags)} {needs} ratings: give --data, or omit {them}")


class Request(NamedTuple):
    """All settings of a run, apart from its data."""

    model: ModelOptions
    run: RunOptions

    def record(self) -> dict[str, Any]:
        """Return the request as JSON data; `from_record` is the inverse."""
        return {**self.model.record(), **self.run.record()}

    def with_options(self, **options: Any) -> Self:
        """Return the request with single options of model and run replaced, by name.

        Raises
        ------
        TypeError
            If there is no option of that name.
        """
        require_kind("model", self.model, ModelOptions, "ModelOptions, such as ModelOptions(fix={'m': 2.0})")
        require_kind("run", self.run, RunOptions, "RunOptions, such as RunOptions(seed=1)")
        model, run = ModelOptions.declared, RunOptions.declared
        if unknown := [name for name in options if name not in {**model, **run}]:
            raise TypeError(f"no option {unknown[0]!r}; expected one of {', '.join({**model, **run})}")
        return self._replace(
            model=replace(self.model, **{name: value for name, value in options.items() if name in model}),
            run=replace(self.run, **{name: value for name, value in options.items() if name in run}),
        )

    def choices(self) -> dict[str, str]:
        """Return the choices that affect the draws besides data, parameters and the sampler, by name."""
        return {**self.model.choices(), "seed": str(self.run.seed)}

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Self:
        """Return the request of a `record`.

        Raises
        ------
        InputError
            If an option is missing, or not known to this version.
        """
        of_run = {name: value for name, value in record.items() if name in RunOptions.declared}
        of_model = {name: value for name, value in record.items() if name not in of_run}
        return cls(ModelOptions.from_record(of_model), RunOptions.from_record(of_run))

    @classmethod
    def of(cls, result: Stored) -> Self:
        """Return the request of a finished run."""
        return cls.from_record(result.provenance.asked.options)
