"""All settings of a run, apart from its data. Unlike the options themselves, they import NumPy with their defaults."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from softness_bayes.model.options import ModelOptions
from softness_bayes.ranges import require_kind
from softness_bayes.results.run_options import RunOptions

if TYPE_CHECKING:
    from softness_bayes.results.stored import Stored


class Request(NamedTuple):
    """All settings of a run, apart from its data."""

    model: ModelOptions = ModelOptions()
    run: RunOptions = RunOptions()

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
