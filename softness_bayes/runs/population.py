"""Populations of fitted tables: chosen parameters of several results, pooled."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import HalfNormal, Prior
from softness_bayes.checking.pooling import Pooled, PopulationPrior, Separate
from softness_bayes.parameters.coordinates import HalfLine, Interval, coordinate_for
from softness_bayes.parameters.declared import EVERY_PARAMETER, Parameter
from softness_bayes.results.result import Result

Array = NDArray[np.float64]

USUAL = ("b", "m", "sigma_0")
"""Parameters that are pooled by default, if sampled: those of the finger."""

DRAWS = 2000
"""Largest number of evenly spaced draws per table that are weighted."""

HARDLY = 0.8
"""Ratio of posterior to prior standard deviation above which the spread is called weakly identified."""


@dataclass(frozen=True)
class PooledParameter:
    """One parameter of several tables and of their population.

    Parameters
    ----------
    parameter
        The parameter.
    prior
        Prior of the population.
    pooled
        The pooled result, on the unconstrained scale.
    """

    parameter: Parameter
    prior: PopulationPrior
    pooled: Pooled

    @property
    def scale(self) -> str:
        """Name of the unconstrained scale, such as 'ln b'."""
        name, kind = self.parameter.name, type(self.prior.scale)
        return {HalfLine: f"ln {name}", Interval: f"the log odds of {name}"}.get(kind, name)

    def natural(self, values: Array) -> Array:
        """Return values in natural units."""
        return self.prior.scale.natural(np.asarray(values, float))

    def sound(self, values: Array | float) -> Array:
        """Return numbers of the population, which are NaN if it is rejected."""
        return np.asarray(values, float) * (np.nan if self.pooled.fault else 1.0)

    def sentence(self) -> str:
        """Describe the result, each number with its interval and Monte-Carlo error, or the reason why there is none."""
        name, found = self.parameter.name, self.pooled
        if found.fault:
            return f"{name}: not pooled: {found.fault}"
        unit = "" if self.parameter.unit == "–" else f" {self.parameter.unit}"
        low, middle, high = (f"{value:.4g}" for value in self.natural(found.mean))
        new_low, _, new_high = (f"{value:.4g}" for value in self.natural(found.new))
        s_low, s_middle, s_high = (f"{value:.2g}" for value in found.spread)
        every = self.prior.spread.quantile((np.arange(2000) + 0.5) / 2000)
        hardly = ""
        if found.spread_sd > HARDLY * np.std(every):
            hardly = f"; the tables say hardly more of the spread than its prior, {self.prior.spread}"
        return (
            f"{name}: population median {middle}{unit} (90 % interval {low} to {high}); spread between tables "
            f"{s_middle} of {self.scale} (90 % interval {s_low} to {s_high}){hardly}; in a further table {name} "
            f"lies between {new_low} and {new_high}{unit} with probability 90 %. Monte-Carlo errors "
            f"{found.mean_mcse:.1g} and {found.spread_mcse:.1g} of {self.scale}."
        )


def pool_results(
    results: Mapping[str, Result | Path], parameters: Sequence[str] = (), spreads: Mapping[str, Prior] | None = None
) -> dict[str, PooledParameter]:
    """Pool parameters of separate results one at a time, with separate priors for all other parameters.

    The population of a parameter is normal on the scale on which it is unconstrained (ln b of a positive one). Its mean
    has the prior of the parameter.

    Parameters
    ----------
    results
        Finished runs, or their directories, by the names of their tables: at least two, all with the same prior of each
        parameter. Directories are read one at a time: thousands of results would not fit into memory.
    parameters
        Names; by default those of `USUAL` that are sampled in all.
    spreads
        Priors of the population's spreads, by name; by default half-normal with the width of the parameter's prior.

    Raises
    ------
    InputError
        If there are fewer than two results, nothing to pool, or a parameter is not sampled in all under the same prior.
    """
    require_parameters((*parameters, *(spreads or {})))
    drawn = {
        table: draws_of(one if isinstance(one, Result) else Result.load(one), parameters)
        for table, one in results.items()
    }
    chosen = tuple(parameters) or tuple(one for one in USUAL if all(one in of_table for of_table in drawn.values()))
    if not chosen:
        raise InputError(f"study: none of {', '.join(USUAL)} is sampled in every table; name parameters to pool")
    if odd := [name for name in spreads or {} if name not in chosen]:
        raise InputError(f"study: a prior for the spread of {odd[0]} is given, but {odd[0]} is not pooled")
    found = {}
    for name in chosen:
        if held := [table for table, of_table in drawn.items() if name not in of_table]:
            raise InputError(f"study: {name} is not sampled in {held[0]}, and cannot be pooled")
        first, prior = next((table, of_table[name][0]) for table, of_table in drawn.items())
        for table, of_table in drawn.items():
            if str(of_table[name][0]) != str(prior):
                raise InputError(
                    f"study: the prior of {name} is {prior} in {first} and {of_table[name][0]} in {table}; a "
                    "population needs the same in all"
                )
        population = population_of(name, prior, (spreads or {}).get(name))
        tables = {table: of_table[name][1] for table, of_table in drawn.items()}
        found[name] = PooledParameter(EVERY_PARAMETER[name], population, Pooled(tables, population))
    return found


def require_parameters(names: Sequence[str]) -> None:
    """Raise an error for a name that is not a parameter.

    Raises
    ------
    InputError
        For an unknown name.
    """
    if unknown := [name for name in names if name not in EVERY_PARAMETER]:
        raise InputError(f"no parameter {unknown[0]!r}; expected some of {', '.join(EVERY_PARAMETER)}")


def population_of(name: str, prior: Prior, spread: Prior | None = None) -> PopulationPrior:
    """Return the population prior of a parameter, given its separate prior.

    Raises
    ------
    InputError
        If the spread may be negative.
    """
    mean = EVERY_PARAMETER[name].cut(prior)
    scale = coordinate_for(mean.support)
    if spread is None:
        low, high = scale.coordinate(mean.quantile(np.array([0.1587, 0.8413])))
        spread = HalfNormal(float(f"{0.5 * (high - low):.3g}"))
    if spread.support[0] < 0:
        raise InputError(
            f"study: spread of {name}: {spread} allows values below 0, expected a law such as halfnormal(0.5)"
        )
    return PopulationPrior(mean, spread, scale)


def draws_of(result: Result, names: Sequence[str] = ()) -> dict[str, tuple[Prior, Separate]]:
    """Return prior and draws of some parameters, by default of `USUAL`, that a result has sampled."""
    posterior, log_prior, found = result.group("posterior"), result.group("log_prior"), {}
    for name in names or USUAL:
        if name in posterior:
            prior, some = result.provenance.priors[name], slice(None, None, -(-posterior[name].size // DRAWS))
            values, density = (group[name].values.ravel()[some] for group in (posterior, log_prior))
            scale = coordinate_for(EVERY_PARAMETER[name].cut(prior).support)
            z = scale.coordinate(values)
            effective = float(result.table.loc[name, "ess_bulk"])  # type: ignore[arg-type]
            found[name] = prior, Separate(z, density + scale.log_slope(z), min(effective, float(z.size)))
    return found
