"""Fabrics with a desired rating: their effective moduli, and thickness or tensile modulus."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from softness_bayes.base.defaults import ANSWER_DRAWS
from softness_bayes.base.errors import InputError
from softness_bayes.base.readable import number
from softness_bayes.checking.inflection import RANGE_FACTOR
from softness_bayes.data import Fabrics
from softness_bayes.data.columns import POISSON_RATIO, TENSILE_MODULUS, THICKNESS, Column
from softness_bayes.model.prediction import OtherTouches
from softness_bayes.parameters.declared import KPA
from softness_bayes.results.fitted import Fitted
from softness_bayes.results.rating_table import limits, reasons
from softness_bayes.results.stored import Stored
from softness_bayes.touch.contact import PLATE_LENGTH, FabricModulus, Load

Array = NDArray[np.float64]

POINTS = 401
"""Number of moduli of the curve to be inverted, with interpolation linear in the log modulus."""

BRANCHES = {True: "rises", False: "falls"}
"""Direction of the rating with E_fab at a solution."""


class Cloth(NamedTuple):
    """Given properties of the desired fabric."""

    tensile_modulus: float | None = None
    """E_ten [Pa], if the thickness is requested."""
    thickness: float | None = None
    """h [m], if the tensile modulus is requested."""
    poisson_ratio: float | None = None
    """nu_fab [-]; by default the median of the rated fabrics."""

    def require(self) -> None:
        """Raise an error for values out of range, or if nothing is left to be found.

        Raises
        ------
        InputError
            Naming the value.
        """
        for column, value in zip((TENSILE_MODULUS, THICKNESS, POISSON_RATIO), self, strict=True):
            if value is not None and not column.holds(value):
                shown = column.write(value) or "nan"
                raise InputError(f"target: {column.name} is {shown}, expected {column.expected()}")
        if self.tensile_modulus is not None and self.thickness is not None:
            raise InputError(
                f"target: {TENSILE_MODULUS.name} and {THICKNESS.name} are both given, which fixes the modulus: "
                "give one of them to find the other"
            )

    def sought(self, modulus: Array, poisson_ratio: float, reading: FabricModulus) -> tuple[Column, Array] | None:
        """Return the column requested besides E_fab, and its values [SI] for effective moduli [Pa]."""
        rigidity, nu = modulus * PLATE_LENGTH**3, np.array(poisson_ratio)
        if self.tensile_modulus is not None:
            return THICKNESS, np.cbrt(rigidity / reading.rigidity(np.array(self.tensile_modulus), np.array(1.0), nu))
        if self.thickness is not None:
            return TENSILE_MODULUS, rigidity / reading.rigidity(np.array(1.0), np.array(self.thickness), nu)
        return None


@dataclass(frozen=True)
class Target:
    """Fabrics with a desired rating.

    Parameters
    ----------
    table
        A row per load and solution, the softest first; also loads without solutions (docs/files.md 11).
    moduli
        E_fab [Pa] of the solutions under each load, as `solutions` returns them.
    span
        Range of moduli that was searched [Pa].
    poisson_ratio
        Poisson ratio of the fabric.
    """

    table: pd.DataFrame
    moduli: Mapping[Load, Mapping[tuple[bool, int], Array]]
    span: tuple[float, float]
    poisson_ratio: float


def target(
    result: Stored, rating: float, loads: tuple[Load, ...], cloth: Cloth, draws: int = ANSWER_DRAWS, seed: int = 0
) -> Target:
    """Find the fabrics for which the typical rater gives a desired rating, under each of some loads.

    Moduli are searched from a tenth of the smallest rated one to ten times the largest. If the response has a turning
    point, a softer and a stiffer fabric have the same rating: both are solutions. Deviations of fabrics, if in the
    model, are taken as 0.

    Parameters
    ----------
    result
        The run, on ratings.
    rating
        The desired rating [as in the file].
    loads
        The loads.
    cloth
        Given properties of the fabric.
    draws
        Number of posterior draws for which solutions are found.
    seed
        Seed of quantities drawn given the posterior draws.

    Raises
    ------
    InputError
        If the rating is not on the scale of the run, or a property of the fabric is out of range.
    """
    cloth.require()
    with np.errstate(invalid="ignore", divide="ignore"):
        wished = float(result.scale.additive(np.array(rating, float)))
    if not np.isfinite(wished):
        raise InputError(f"target: rating is {rating:g}, expected one of the run's scale: {result.scale.meaning}")
    fitted, known = Fitted(result, draws), result.fabrics
    rated = float(known.effective_modulus.min()), float(known.effective_modulus.max())
    span = rated[0] / RANGE_FACTOR, rated[1] * RANGE_FACTOR
    grid = np.geomspace(*span, POINTS)
    nu = float(np.median(known.poisson_ratio)) if cloth.poisson_ratio is None else cloth.poisson_ratio
    names = tuple(f"{modulus:.6g} Pa" for modulus in grid)
    scene = fitted.scene(Fabrics(names, effective_modulus=grid, poisson_ratio=np.full(POINTS, nu)), loads)
    found = OtherTouches(fitted.posterior, scene, None, result.scale).ratings(np.random.default_rng(seed), fitted.theta)
    why = reasons(fitted, scene, found.rate)
    none = {None: np.array([np.nan])}
    beyond = f"no modulus from {number(span[0] / KPA)} to {number(span[1] / KPA)} kPa has this rating"
    every: dict[Load, Mapping[tuple[bool, int], Array]] = {}
    rows: list[dict[str, object]] = []
    for k, load in enumerate(loads):
        here = np.flatnonzero(scene.load == k)
        curve = found.typical[:, here]
        least, largest = curve.min(axis=1), curve.max(axis=1)
        moduli = every[load] = solutions(np.log(grid), result.scale.additive(curve) - wished)
        solved = {key: values[np.isfinite(values)] for key, values in moduli.items()}
        reached = np.any([np.zeros(len(curve), bool), *map(np.isfinite, moduli.values())], axis=0)
        shared = {
            "load": str(load),
            "rating": rating,
            "p_reachable": float(reached.mean()),
            "p_too_high": float((largest < rating).mean()),
            "p_too_low": float((least > rating).mean()),
            "least_rating": float(np.median(least)),
            "largest_rating": float(np.median(largest)),
        }
        for key, values in sorted((solved or none).items(), key=lambda one: float(np.median(one[1]))):
            row = {"with_modulus": "", "p_solution": 0.0, "p_inside": np.nan}
            if key is not None:
                inside = float(((values >= rated[0]) & (values <= rated[1])).mean())
                row = {"with_modulus": BRANCHES[key[0]], "p_solution": values.size / len(curve), "p_inside": inside}
            near = int(np.abs(np.log(grid / np.median(values))).argmin())
            remark = beyond if key is None else str(why["remarks"][here[near]])
            sought = cloth.sought(values, nu, result.readings.fabric_modulus)
            columns = {"e_fab_kpa": values / KPA}
            if sought is not None:
                columns[sought[0].name] = sought[1] / sought[0].factor
            ends = {
                f"{name}{end}": float(at[0])
                for name, one in columns.items()
                for end, at in limits(one[:, None]).items()
            }
            rows.append({**shared, **row, **ends, "remarks": remark})
    return Target(pd.DataFrame(rows), every, span, nu)


def solutions(log_modulus: Array, beyond: Array) -> dict[tuple[bool, int], Array]:
    """Return the zero crossings of curves for each draw.

    Parameters
    ----------
    log_modulus
        Grid of ln E_fab, shape (points,).
    beyond
        Ratings on the additive scale minus the desired one, shape (draws, points).

    Returns
    -------
    dict
        E_fab of each crossing, shape (draws,), NaN for draws without such a crossing. The keys give the direction of
        the curve, and the index of the crossing among those of that direction, from 0.
    """
    above = beyond > 0
    draw, left = np.nonzero(above[:, 1:] != above[:, :-1])
    low, high = beyond[draw, left], beyond[draw, left + 1]
    share = low / (low - high)
    place = np.exp(log_modulus[left] + share * (log_modulus[left + 1] - log_modulus[left]))
    rises = high > low
    found: dict[tuple[bool, int], Array] = {}
    for direction in (True, False):
        of, at = draw[rises == direction], place[rises == direction]
        # crossings of a draw are ordered from the softest on
        first = np.searchsorted(of, of, side="left")
        number = np.arange(of.size) - first
        for k in range(int(number.max(initial=-1)) + 1):
            values = np.full(len(beyond), np.nan)
            values[of[number == k]] = at[number == k]
            found[direction, k] = values
    return found
