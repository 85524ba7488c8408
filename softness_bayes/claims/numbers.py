"""Statistics behind the paper's claims, from its numerical experiments under one set of readings (model.md 11)."""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import stdtrit

from softness_bayes.base.errors import InputError
from softness_bayes.checking.inflection import Curves, find_inflection, response_curves
from softness_bayes.data import USUAL_POISSON_RATIO, Fabrics, Ratings
from softness_bayes.touch.contact import Finger, Load
from softness_bayes.touch.neuron.rate_curve import Firing
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.readings import Readings
from softness_bayes.touch.scene import Scene

Array = NDArray[np.float64]

GRID = np.geomspace(1e2, 1e9, 200)
"""Fabric moduli [Pa] along which the response is followed."""
DECADE = int(np.searchsorted(GRID, 0.1 * GRID[-1] * (1 + 1e-9))) - 1
"""Start of the grid's last decade."""

DEPTHS = (0.5e-3, 0.7e-3, 0.9e-3)
"""Receptor depths [m] between which the response may hardly change; the middle one is the finger's own."""

CENTRES = np.linspace(0.0, 30e-3, 31)
"""Distances of the contact's axis from the fingertip's end [m], distal to proximal."""

ERROR = 1e-4
"""Upper bound of the numerical error of a response here, relative to its largest value."""


class Numbers(NamedTuple):
    """Numbers that decide the claims, each of shape (draws, loads); NaN where no receptor fires."""

    largest: Array
    """Largest total rate along the grid [spikes/s]; 0 where no receptor fires."""
    interior: NDArray[np.bool_]
    """True if the maximum lies inside the grid: above both ends by three times the numerical error."""
    modulus: Array
    """E_fab at the maximum [Pa]; this and the next three are at the grid's end where that is the largest."""
    ratio: Array
    """E_fab / E_skin there [-]."""
    force: Array
    """Hertz's force there [N]."""
    radius: Array
    """Contact radius there as a share of the fingertip's radius [-]; Hertz's geometry is questionable beyond 0.5."""
    drop: Array
    """Fall from the maximum to the grid's stiff end, as a share of the maximum [-]."""
    levelling: Array
    """Change over the grid's last decade, as a share of the maximum [-]."""
    depth_spread: Array
    """Largest difference between receptor depths at one E_fab, as a share of the maximum [-]."""
    growth: Array
    """Change of the fabric set's mean response from the most distal to the most proximal centre, as a share [-]."""
    setback: Array
    """Largest fall on that way, as a share of the largest [-]."""
    best_centre: Array
    """Distance of the centre from the fingertip's end where it is largest [m]."""
    correlation: Array
    """Pearson's correlation of the response with E_fab over the fabric set [-]."""
    slope: Array
    """Standardised slope of the mean standardised rating against the response over the fabrics rated [-]."""
    slope_needed: Array
    """Slope that differs from 0 at the 5 % level, two-sided [-]."""


class Bench:
    """Scenes of the claims' fabrics under some loads, at any depth and contact centre; compiled on first use.

    Parameters
    ----------
    readings, loads
        The model, and the loads, at least one.
    fabrics
        Fabric set of the correlation and of the moving centre.
    firing
        Source of the rate curves.
    ratings
        Ratings of the fabrics under these loads, if there are any.

    Raises
    ------
    InputError
        If a rated fabric is not in the set.
    """

    def __init__(
        self,
        readings: Readings,
        loads: tuple[Load, ...],
        fabrics: Fabrics,
        firing: Firing,
        ratings: Ratings | None = None,
    ) -> None:
        self.readings, self.loads, self.fabrics, self.firing = readings, loads, fabrics, firing
        self.modulus = fabrics.modulus(readings.fabric_modulus)
        self.standardised = np.full((len(loads), len(fabrics)), np.nan)
        if ratings is not None:
            self.standardised = mean_standardised(ratings, loads, fabrics.names)

    @property
    def rated(self) -> bool:
        """True if under some load enough fabrics are rated for a slope."""
        return bool((np.isfinite(self.standardised).sum(axis=1) > 2).any())

    def measure(self, parameters: TouchParameters) -> Numbers:
        """Return the numbers of a batch of parameter vectors, shape (draws,)."""
        values = TouchParameters(*np.broadcast_arrays(*map(np.atleast_1d, parameters)))
        if not (values.alpha > self.firing.curves(values.channels, values.alpha).rheobase).any():
            shape = (values.alpha.size, len(self.loads))
            nothing = Numbers(*(np.full(shape, np.nan) for _ in Numbers._fields))
            return nothing._replace(largest=np.zeros(shape), interior=np.zeros(shape, bool))
        curves = response_curves(self._grid, values)
        found = {**self._along_grid(curves), **self._over_fabrics(values)}
        return Numbers(**found, depth_spread=self._depth_spread(curves, values))

    @cached_property
    def _everything(self) -> Scene:
        """Grid and fabrics at the contact centre farthest from the pad's end; its fields cover all centres."""
        finger = Finger(contact_centre=(0.0, Finger().contact_centre[1]))
        moduli = np.concatenate([GRID, self.modulus])
        poisson = np.concatenate([np.full(GRID.size, USUAL_POISSON_RATIO), self.fabrics.poisson_ratio])
        return Scene(moduli, poisson, self.loads, self.firing, finger=finger, readings=self.readings)

    @cached_property
    def _grid(self) -> Scene:
        scene = self._everything
        return scene.take(np.flatnonzero(scene.fabric < GRID.size), Finger().contact_centre)

    @cached_property
    def _centred(self) -> list[Scene]:
        scene, across = self._everything, Finger().contact_centre[1]
        cloth = np.flatnonzero(scene.fabric >= GRID.size)
        return [scene.take(cloth, (float(x), across)) for x in (*CENTRES, Finger().contact_centre[0])]

    @cached_property
    def _deep(self) -> list[Scene]:
        fingers = [Finger(receptor_depth=depth) for depth in DEPTHS if depth != Finger().receptor_depth]
        return [
            Scene(GRID, USUAL_POISSON_RATIO, self.loads, self.firing, finger=finger, readings=self.readings)
            for finger in fingers
        ]

    def _along_grid(self, curves: Curves) -> dict[str, NDArray[Any]]:
        """Return the statistics of the response along the modulus grid."""
        rate, top = curves.total_rate, curves.total_rate.argmax(axis=-1)[..., None]
        largest = rate.max(axis=-1)
        fires = largest > 0
        turn = find_inflection(curves, ERROR, (GRID[0], GRID[-1]), least_drop=0.0)
        interior = ~np.isnan(turn.modulus)

        def at_top(along: Array, refined: Array) -> Array:
            there = np.take_along_axis(np.broadcast_to(along, rate.shape), top, -1)[..., 0]
            return np.where(fires, np.where(interior, refined, there), np.nan)

        def share(difference: Array) -> Array:
            return np.divide(difference, largest, out=np.full_like(largest, np.nan), where=fires)

        ratio, radius = curves.modulus / curves.skin_modulus, curves.radius / self._grid.finger.radius
        return {
            "largest": largest,
            "interior": interior,
            "modulus": at_top(curves.modulus, turn.modulus),
            "ratio": at_top(ratio, turn.ratio),
            "force": at_top(curves.force, turn.force),
            "radius": at_top(radius, np.take_along_axis(radius, top, -1)[..., 0]),
            "drop": share(largest - rate[..., -1]),
            "levelling": share(np.abs(rate[..., -1] - rate[..., DECADE])),
        }

    def _over_fabrics(self, values: TouchParameters) -> dict[str, NDArray[Any]]:
        """Return the statistics of the fabric set, including those for a moving contact centre."""
        rates = np.stack([scene.total_rate(values) for scene in self._centred], axis=-1)
        rates = rates.reshape(-1, len(self.loads), len(self.fabrics), len(self._centred))
        moving, rate = rates[..., :-1].mean(axis=2), rates[..., -1]
        largest = moving.max(axis=-1)
        fires = largest > 0
        fall = (np.maximum.accumulate(moving, axis=-1) - moving).max(axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            growth, setback = moving[..., -1] / moving[..., 0] - 1.0, fall / largest
        best = np.where(fires, CENTRES[moving.argmax(axis=-1)], np.nan)
        slope, needed = np.full((2, *largest.shape), np.nan)
        for k, rating in enumerate(self.standardised):
            rated = np.isfinite(rating)
            if rated.sum() > 2:
                slope[:, k] = pearson(rating[rated], rate[:, k, rated])
                t = stdtrit(rated.sum() - 2, 0.975)
                needed[:, k] = t / np.hypot(t, np.sqrt(rated.sum() - 2))
        return {
            "growth": growth,
            "setback": setback,
            "best_centre": best,
            "correlation": pearson(self.modulus, rate),
            "slope": slope,
            "slope_needed": needed,
        }

    def _depth_spread(self, curves: Curves, values: TouchParameters) -> Array:
        own = curves.total_rate
        every = np.stack([own, *(scene.total_rate(values).reshape(own.shape) for scene in self._deep)])
        largest = own.max(axis=-1)
        spread = (every.max(axis=0) - every.min(axis=0)).max(axis=-1)
        return np.divide(spread, largest, out=np.full_like(largest, np.nan), where=largest > 0)


def pearson(x: Array, y: Array) -> Array:
    """Return Pearson's correlation of x (n,) with each y (..., n); NaN where one of them is constant."""
    x, y = x - x.mean(), y - y.mean(axis=-1, keepdims=True)
    size = np.sqrt((x**2).sum() * (y**2).sum(axis=-1))
    return np.divide(y @ x, size, out=np.full(size.shape, np.nan), where=size > 0)


def mean_standardised(ratings: Ratings, loads: tuple[Load, ...], fabrics: tuple[str, ...]) -> Array:
    """Return the mean over participants of their ratings, standardised within each participant.

    Returns
    -------
    ndarray, shape (loads, fabrics)
        NaN where a fabric was not rated under a load.

    Raises
    ------
    InputError
        If a rated fabric is not among `fabrics`.
    """
    if missing := [name for name in ratings.fabrics if name not in fabrics]:
        raise InputError(f"claims: rated fabrics that the fabric set lacks: {', '.join(missing)}")
    keys = {"load": np.array(ratings.loads, object)[ratings.load], "fabric": np.array(ratings.fabrics)[ratings.fabric]}
    rows = pd.DataFrame({"rater": ratings.participant, "rating": np.asarray(ratings.rating, float), **keys})
    of_rater = rows.groupby("rater")["rating"]
    rows["score"] = (rows["rating"] - of_rater.transform("mean")) / of_rater.transform("std", ddof=0)
    rows = rows[np.isfinite(rows["score"])]
    return rows.pivot_table("score", "load", "fabric").reindex(index=[*loads], columns=[*fabrics]).to_numpy(float)
