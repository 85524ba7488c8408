"""Settings requested for a run, model and limits, in the form recorded by results and checkpoints."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from numbers import Integral, Real
from typing import Any, NamedTuple, Self

from softness_bayes.defaults import MAX_STEPS, SEED
from softness_bayes.errors import InputError
from softness_bayes.kinds import require_kind
from softness_bayes.model.options import ModelOptions
from softness_bayes.results.result import Result
from softness_bayes.sampler.sampling import FIRST_LOOK, Settings


@dataclass(frozen=True)
class RunOptions:
    """Limits of the sampler, and its seed.

    Parameters
    ----------
    max_steps, max_seconds
        Maximum number of steps of each ensemble, and maximum time [s], of the run.
    min_steps
        Minimum number of steps of each ensemble, even if the run has converged earlier.
    processes
        Number of processes for the ensembles; None for one per core. Draws do not depend on it.
    seed
        Seed of all random numbers.
    exact_reweight
        Whether the result uses draws weighted by the exact likelihood.
    command
        The command line, for the record.
    quick
        Whether the run ends unconverged at its first convergence check, without the comparison with the exact model;
        the same run without this option continues from there.
    """

    max_steps: int = MAX_STEPS
    max_seconds: float = math.inf
    min_steps: int = 0
    processes: int | None = None
    seed: int = SEED
    exact_reweight: bool = False
    command: str = ""
    quick: bool = False

    def __post_init__(self) -> None:
        for name, kind, expected in (
            ("max_steps", Integral, "a whole number of steps"),
            ("max_seconds", Real, "a number of seconds"),
            ("min_steps", Integral, "a whole number of steps"),
            ("processes", (Integral, type(None)), "a whole number, or None for one per core"),
            ("seed", Integral, "a whole number"),
            ("command", str, "a text"),
        ):
            require_kind(name, getattr(self, name), kind, expected)
        if self.quick and self.exact_reweight:
            raise InputError("quick: a first look does not use the exact likelihood; omit exact_reweight or quick")

    @property
    def settings(self) -> Settings:
        """Settings of the sampler."""
        return Settings(
            max_steps=min(self.max_steps, FIRST_LOOK) if self.quick else self.max_steps,
            max_seconds=self.max_seconds,
            min_steps=self.min_steps,
            processes=self.processes,
        )


class Request(NamedTuple):
    """All settings of a run, apart from its data."""

    model: ModelOptions = ModelOptions()
    run: RunOptions = RunOptions()

    def record(self) -> dict[str, Any]:
        """Return the request as JSON data; `from_record` is the inverse."""
        run = asdict(self.run)
        if not self.run.quick:
            del run["quick"]  # as in records of versions without first looks
        return {**self.model.record(), **run}

    def with_options(self, **options: Any) -> Self:
        """Return the request with single options of model and run replaced, by name.

        Raises
        ------
        TypeError
            If there is no option of that name.
        """
        require_kind("model", self.model, ModelOptions, "ModelOptions, such as ModelOptions(fix={'m': 2.0})")
        require_kind("run", self.run, RunOptions, "RunOptions, such as RunOptions(seed=1)")
        model, run = (dict.fromkeys(option.name for option in fields(part)) for part in self)
        if unknown := [name for name in options if name not in model | run]:
            raise TypeError(f"no option {unknown[0]!r}; expected one of {', '.join(model | run)}")
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
        try:
            model = ModelOptions.from_record(record)
            of_the_run = {name: value for name, value in record.items() if name not in model.record()}
            return cls(model, RunOptions(**of_the_run))
        except (AttributeError, InputError, KeyError, TypeError) as error:
            raise InputError(f"options of a run that this version cannot read: {error}") from None

    @classmethod
    def of(cls, result: Result) -> Self:
        """Return the request of a finished run.

        Raises
        ------
        InputError
            If its options cannot be read.
        """
        return cls.from_record(result.provenance.asked.options)
