"""Populations of separate posteriors: mean and spread of one parameter by importance weights.

Each table j has draws of its own posterior, p_j(x) proportional to L_j(x) pi_j(x), x on an unconstrained scale. Under a
population x_j ~ N(mean, spread²) its marginal likelihood is, up to a constant, the average of N(x; mean, spread²) /
pi_j(x) over these draws. The product over tables is evaluated on a grid of mean and spread, without further sampling.
The weights are reliable if the draws of a table cover its posterior under the population; otherwise the population is
rejected.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, ndtr

from softness_bayes.base import arviz_bridge
from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import Prior
from softness_bayes.checking.exactness import LARGEST_K, largest_pareto_k
from softness_bayes.parameters.coordinates import Coordinate
from softness_bayes.sampler.chain_statistics import GROUPS

Array = NDArray[np.float64]

LEAST_TABLES = 2
"""Smallest number of tables for a population."""

LEAST_EFFECTIVE = 50.0
"""Smallest effective number of weighted draws of each table."""

LARGEST_WEIGHT = 0.01
"""Share of all weight up to which the largest one is harmless (the criterion of Chatterjee and Diaconis, Annals of
Applied Probability 28, 1099, 2018); if it is exceeded, Pareto k, the shape of the tail, is checked."""

LARGEST_ERROR = 1.0 / 3.0
"""Largest Monte-Carlo error of the population's mean and spread, in their own posterior standard deviations."""

LIMITS = (0.05, 0.5, 0.95)
"""Cumulative probabilities of the low end, the median and the high end of every interval."""

NARROWEST = 0.1
"""Narrowest kernel of a table's draws, in their standard deviations: it widens the table's likelihood by 0.5 %, and
keeps enough draws within the kernel where the population's spread is close to 0."""

CELLS = 64
"""Cells of the grid along the mean, and along the spread."""

_COARSE, _PASSES = 32, 3
_MOST = 0.99999  # probability up to the ends of a prior
_LEAST_MASS = 1e-6  # probability of a row of the coarse grid below which the fine grid excludes it
_BLOCK = 1 << 22  # numbers computed at once


class Separate(NamedTuple):
    """Draws of one parameter from the posterior of one table, in the order of its chains."""

    value: Array
    """On the unconstrained scale, shape (draws,)."""
    log_prior: Array
    """Log density of the table's own prior on that scale, shape (draws,)."""
    effective: float
    """Effective number of these draws."""


class PopulationPrior(NamedTuple):
    """Prior of a population: of its mean in natural units, of its spread on the unconstrained scale."""

    mean: Prior
    spread: Prior
    scale: Coordinate


class PopulationGrid(NamedTuple):
    """Cells of equal size over mean and spread, the spread varying fastest, and their log prior, shape (cells²,)."""

    mean: Array
    spread: Array
    log_prior: Array

    @classmethod
    def over(
        cls, population: PopulationPrior, mean: tuple[float, float], spread: tuple[float, float], cells: int
    ) -> PopulationGrid:
        """Return the grid between two limits of each."""
        centres = (np.arange(cells) + 0.5) / cells
        each = (low + (high - low) * centres for low, high in (mean, spread))
        mu, tau = (values.ravel() for values in np.meshgrid(*each, indexing="ij"))
        scale = population.scale
        of_mean = population.mean.log_density(scale.natural(mu)) + scale.log_slope(mu)
        return cls(mu, tau, of_mean + population.spread.log_density(tau))

    def widths(self, table: Separate, least: float = 0.0) -> Array:
        """Return the width of the kernel of each cell about the draws of a table, at least a given one."""
        return np.hypot(self.spread, max(NARROWEST * float(table.value.std()), least))


class Shrunken(NamedTuple):
    """One table's parameter, separately and in its population, on the unconstrained scale."""

    separate: Array
    """Low end, middle and high end."""
    shrunken: Array
    pareto_k: float
    effective: float
    """Effective number of weighted draws."""
    largest: float
    """Share of the largest weight."""


class Pooled:
    """A population on the unconstrained scale; ends and middles in the order of `LIMITS`.

    Parameters
    ----------
    tables
        Draws by name.
    population
        Its prior.

    Attributes
    ----------
    mean, spread, new
        Low end, middle and high end of the population's mean and spread, and of the parameter of a further table; NaN
        if no mean and spread are compatible with all tables.
    mean_sd, spread_sd
        Posterior standard deviations.
    mean_mcse, spread_mcse
        Monte-Carlo errors of their posterior means.
    tables
        Each table's parameter, separately and in the population, by name.
    largest_k
        Largest reliable Pareto k for the number of draws.

    Raises
    ------
    InputError
        If there are fewer than `LEAST_TABLES`.
    """

    def __init__(self, tables: Mapping[str, Separate], population: PopulationPrior) -> None:
        if len(tables) < LEAST_TABLES:
            raise InputError(f"a population needs at least {LEAST_TABLES} fitted tables, got {len(tables)}")
        every = list(tables.values())
        grid = _focused(every, population)
        sums = [_sums(one, grid) for one in every]  # of each table, shape (groups, cells)
        likelihood = [_log(one.sum(axis=0)) for one in sums]
        posterior = _normalised(grid.log_prior + np.sum(likelihood, axis=0))
        self.mean = self.spread = self.new = none = np.full(len(LIMITS), np.nan)
        self.mean_sd = self.spread_sd = self.mean_mcse = self.spread_mcse = np.nan
        self.largest_k, alone = LARGEST_K, {name: _limits(one.value) for name, one in tables.items()}
        self.tables = {name: Shrunken(limits, none, np.inf, 0.0, 1.0) for name, limits in alone.items()}
        if not posterior.any():
            return
        unknowns = np.stack([grid.mean, grid.spread], axis=-1)
        left_out = [_without(one, posterior) @ unknowns for one in sums]
        mass = posterior.reshape(CELLS, CELLS)
        self.mean = _between(grid.mean[::CELLS], mass.sum(axis=1))
        self.spread = _between(grid.spread[:CELLS], mass.sum(axis=0))
        self.new = _of_a_new_table(grid, posterior)
        self.mean_sd, self.spread_sd = np.sqrt(posterior @ (unknowns - posterior @ unknowns) ** 2).tolist()
        errors = np.sqrt(np.sum([(GROUPS - 1) * one.var(axis=0) for one in left_out], axis=0))
        self.mean_mcse, self.spread_mcse = errors.tolist()
        self.largest_k = min(largest_pareto_k(one.value.size) for one in every)
        for (name, one), z in zip(tables.items(), likelihood, strict=True):
            self.tables[name] = _shrunken(one, grid, posterior, z)

    @property
    def failing(self) -> list[str]:
        """Names of the tables whose weights fail."""
        return [
            name
            for name, one in self.tables.items()
            if not (one.largest <= LARGEST_WEIGHT or one.pareto_k <= self.largest_k)
            or not one.effective >= LEAST_EFFECTIVE
        ]

    @property
    def fault(self) -> str:
        """The reason for rejecting the population; empty if there is none."""
        if self.failing:
            worst = min(self.failing, key=lambda name: self.tables[name].effective)
            one = self.tables[worst]
            others = f" and {len(self.failing) - 1} more" if len(self.failing) > 1 else ""
            return (
                f"the weights of {worst}{others} fail ({one.effective:.0f} effective draws, at least "
                f"{LEAST_EFFECTIVE:.0f}; largest weight {one.largest:.2g}, Pareto k {one.pareto_k:.2f}, at "
                f"most {self.largest_k:.2f} where a weight exceeds {LARGEST_WEIGHT:g}): its separate posterior "
                "hardly overlaps with the population; use wider priors for the separate fits"
            )
        for what, error, sd in (("mean", self.mean_mcse, self.mean_sd), ("spread", self.spread_mcse, self.spread_sd)):
            if not error <= LARGEST_ERROR * sd:
                return (
                    f"the Monte-Carlo error of the population's {what}, {error:.2g}, is above a third of its standard "
                    f"deviation, {sd:.2g}: more draws are needed"
                )
        return ""


def _focused(tables: Sequence[Separate], population: PopulationPrior) -> PopulationGrid:
    """Return the grid over the part of the prior retained by coarse grids, whose kernels are as wide as their cells."""
    wide = float(population.spread.quantile(_MOST))
    within = population.scale.coordinate(population.mean.quantile(np.array([1.0 - _MOST, _MOST])))
    mean = (
        float(max(min(one.value.min() for one in tables) - wide, within[0])),
        float(min(max(one.value.max() for one in tables) + wide, within[1])),
    )
    if mean[0] >= mean[1]:  # no draw lies within the prior of the mean; the weights will show this
        mean = (float(within[0]), float(within[1]))
    spread = (0.0, wide)
    for _ in range(_PASSES):
        grid = PopulationGrid.over(population, mean, spread, _COARSE)
        likelihood = [_log(_sums(one, grid, (mean[1] - mean[0]) / _COARSE).sum(axis=0)) for one in tables]
        mass = _normalised(grid.log_prior + np.sum(likelihood, axis=0)).reshape(_COARSE, _COARSE)
        mean, spread = _kept(mean, mass.sum(axis=1)), _kept(spread, mass.sum(axis=0))
    return PopulationGrid.over(population, mean, spread, CELLS)


def _kept(limits: tuple[float, float], mass: Array) -> tuple[float, float]:
    """Return the limits of the cells that have mass, and of one more on either side."""
    low, high = limits
    edges = np.linspace(low, high, mass.size + 1)
    held = np.flatnonzero(mass > _LEAST_MASS)
    if not held.size:
        return limits
    return float(edges[max(held[0] - 1, 0)]), float(edges[min(held[-1] + 2, mass.size)])


def _sums(table: Separate, grid: PopulationGrid, least: float = 0.0) -> Array:
    """Return the sums of weights over groups of consecutive draws in each cell, shape (groups, cells)."""
    width, ratio = grid.widths(table, least), np.exp(table.log_prior.min() - table.log_prior)
    found = np.zeros((GROUPS, width.size))
    for group, rows in enumerate(np.array_split(np.arange(table.value.size), GROUPS)):
        for some in np.array_split(rows, max(1, rows.size * width.size // _BLOCK)):
            deviate = (table.value[some, None] - grid.mean) / width
            found[group] += ratio[some] @ np.exp(-0.5 * deviate**2) / width
    return found


def _without(sums: Array, posterior: Array) -> Array:
    """Return the posterior of the cells without each group of one table's draws, shape (groups, cells)."""
    whole = sums.sum(axis=0)
    left = posterior * np.divide(whole - sums, whole, out=np.zeros_like(sums), where=whole > 0).clip(0.0)
    total = left.sum(axis=1, keepdims=True)
    return np.where(total > 0, left / np.where(total > 0, total, 1.0), posterior)


def _shrunken(table: Separate, grid: PopulationGrid, posterior: Array, log_likelihood: Array) -> Shrunken:
    """Return a table's parameter separately and in its population, cells weighted by the other tables."""
    held = (posterior > _LEAST_MASS * posterior.max()) & np.isfinite(log_likelihood)
    mean, width = grid.mean[held], grid.widths(table)[held]
    others = np.log(posterior[held]) - log_likelihood[held] - np.log(width)
    others = np.exp(others - others.max())
    parts = np.array_split(table.value, max(1, table.value.size * mean.size // _BLOCK))
    density = np.concatenate([np.exp(-0.5 * ((some[:, None] - mean) / width) ** 2) @ others for some in parts])
    ratios = np.log(np.maximum(density, 1e-300)) - table.log_prior
    log_weight, k = arviz_bridge.psis(ratios[None])
    weight = np.exp(log_weight[0])
    effective = table.effective / weight.size / float((weight**2).sum())
    largest = float(np.exp(ratios.max() - logsumexp(ratios)))
    return Shrunken(_limits(table.value), _limits(table.value, weight), float(k[0]), effective, largest)


def _of_a_new_table(grid: PopulationGrid, posterior: Array) -> Array:
    """Return the limits of a mixture of normal laws, one for each cell."""
    mean, spread, weight = (values[posterior > 0] for values in (grid.mean, grid.spread, posterior))
    value = np.linspace((mean - 9.0 * spread).min(), (mean + 9.0 * spread).max(), 4001)
    below = np.concatenate([ndtr((some[:, None] - mean) / spread) @ weight for some in np.array_split(value, 20)])
    return np.interp(LIMITS, below, value)


def _limits(values: Array, weight: Array | None = None) -> Array:
    """Return quantiles, weighted if weights are given, the weight of each value spread evenly to either side of it."""
    weight = np.full(values.size, 1.0 / values.size) if weight is None else weight
    order = np.argsort(values, kind="stable")
    share = np.cumsum(weight[order]) - 0.5 * weight[order]
    return np.interp(LIMITS, share / weight.sum(), values[order])


def _between(centres: Array, mass: Array) -> Array:
    """Return quantiles of a density that is constant within cells of equal size."""
    half = 0.5 * (centres[1] - centres[0])
    edges = np.append(centres - half, centres[-1] + half)
    return np.interp(LIMITS, np.append(0.0, np.cumsum(mass)), edges)


def _normalised(log_density: Array) -> Array:
    """Return probabilities of cells, zeros if no cell has any."""
    if not np.isfinite(log_density).any():
        return np.zeros(log_density.size)
    found: Array = np.exp(log_density - logsumexp(log_density))
    return found


def _log(values: Array) -> Array:
    with np.errstate(divide="ignore"):
        return np.log(values)
