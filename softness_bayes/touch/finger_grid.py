"""Fingers of different skin and sensitivity at the nodes of a grid, over which raters are integrated (model.md 9)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.errors import InputError

Array = NDArray[np.float64]


SPREAD_OF: Mapping[str, str] = MappingProxyType({"b": "tau_b", "m": "tau_m", "sigma_0": "tau_sigma"})
"""Name of the parameter for the spread between fingers, by the quantity that differs."""


EFFECT_OF: Mapping[str, str] = MappingProxyType({"b": "rater_log_b", "m": "rater_m", "sigma_0": "rater_log_sigma_0"})
"""Names in files of raters' deviations from the typical finger, by the quantity that differs."""


AXES = ("sigma_0", "b", "m")
"""Order of the axes of a grid."""


REACH = 4.0
"""Default half-width of a grid, in standard deviations; 6e-5 of the fingers lie outside."""


class SkinLaws(NamedTuple):
    """Normal laws of the deviations of several people's skins from the typical one, arrays (..., people).

    A finger with scores z_b and z_m deviates from the typical one by log_b + b_by_b z_b in ln b, and by m + m_by_b z_b
    + m_by_m z_m in m.
    """

    log_b: Array
    m: Array
    b_by_b: Array
    m_by_b: Array
    m_by_m: Array

    def deviation(self, z_b: Array, z_m: Array) -> tuple[Array, Array]:
        """Return the deviations in ln b and m of fingers with the given scores."""
        return self.log_b + self.b_by_b * z_b, self.m + self.m_by_b * z_b + self.m_by_m * z_m


@dataclass(frozen=True)
class FingerGrid:
    """Fingers at the nodes of a regular grid in standard deviations from the typical one.

    For a smooth integrand, the trapezoidal rule on such a grid has an error of exp(-2 pi² s² / h²), where s is the
    width of the integrand and h the node spacing: 1e-34 for s = 2 h, 3e-9 for s = h, 2e-4 for s = 2/3 h.

    Parameters
    ----------
    nodes
        Number of nodes for each quantity that differs between fingers, of b, m and sigma_0; each odd, at least 3.
    reach
        Half-width of the grid, in standard deviations.

    Raises
    ------
    InputError
        If no quantity is given, or an unknown one.
    """

    nodes: Mapping[str, int]
    reach: float = REACH

    def __post_init__(self) -> None:
        unknown = [name for name in self.nodes if name not in SPREAD_OF]
        if unknown or not self.nodes:
            raise InputError(f"individual: expected some of {', '.join(SPREAD_OF)}, got {', '.join(unknown) or 'none'}")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the quantities that differ between fingers, in the order of `SPREAD_OF`."""
        return tuple(name for name in SPREAD_OF if name in self.nodes)

    def axis(self, name: str) -> Array:
        """Return the nodes of one quantity, in standard deviations; only 0 if it does not differ between fingers."""
        return np.linspace(-self.reach, self.reach, self.nodes[name]) if name in self.nodes else np.zeros(1)

    @property
    def size(self) -> int:
        """Number of fingers."""
        return int(np.prod([*self.nodes.values()]))

    @cached_property
    def z(self) -> Mapping[str, Array]:
        """The fingers: standard deviations from the typical one, shape (fingers,), by the quantity that differs."""
        grids = np.meshgrid(*(self.axis(name) for name in AXES), indexing="ij")
        every = dict(zip(AXES, grids, strict=True))
        return {name: every[name].reshape(-1) for name in self.names}

    @cached_property
    def log_weight(self) -> Array:
        """Log of the share of each finger in the population, shape (fingers,)."""
        weight = np.ones(self.size)
        for z in self.z.values():
            # the end nodes have half weight
            weight = weight * np.exp(-0.5 * z**2) * np.where(np.abs(z) >= self.reach, 0.5, 1.0)
        return np.asarray(np.log(weight / weight.sum()))

    def finer(self) -> FingerGrid:
        """Return the grid with additional nodes halfway between, the reference for the error of this grid."""
        return FingerGrid({name: 2 * size - 1 for name, size in self.nodes.items()}, self.reach)


class FingerSpreads(NamedTuple):
    """Spreads of fingers about the typical one, each of batch shape (...); 0 for quantities that do not differ."""

    b: Any = 0.0
    """Standard deviation of ln b."""
    m: Any = 0.0
    """Standard deviation of m, in the unit of m."""
    sigma_0: Any = 0.0
    """Standard deviation of ln sigma_0."""
