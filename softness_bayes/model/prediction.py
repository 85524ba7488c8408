"""Predictions for touches that were not rated: contact, firing and ratings; and responses if a quantity changes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.contract import Effects, Parameters
from softness_bayes.likelihood.design import Design, IndexArray
from softness_bayes.likelihood.pieces import pieces
from softness_bayes.likelihood.scales import MAGNITUDE, Scale
from softness_bayes.model.fingers import family_of
from softness_bayes.model.posterior import Posterior
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.scene import Response, Scene

if TYPE_CHECKING:
    import pandas as pd

    from softness_bayes.data import Fabrics

Array = NDArray[np.float64]


def prediction_table(
    fabrics: Fabrics,
    scene: Scene,
    parameters: TouchParameters,
    prob: float = 0.9,
    modulus: Array | None = None,
) -> pd.DataFrame:
    """Return the prediction for every condition of a scene.

    Parameters
    ----------
    fabrics
        Fabrics of the scene, for their names.
    scene
        Fabrics × loads.
    parameters
        One parameter vector, or a batch of draws of shape (draws,).
    prob
        Credible mass between the columns `_low` and `_high`, which only a batch has.
    modulus
        E_fab [Pa] of each fabric at each draw, shape (draws, fabrics); by default that of the scene.

    Returns
    -------
    DataFrame
        A row per condition: fabric, indentation_mm, force_n, e_fab_kpa, e_skin_kpa,
        contact_radius_mm, peak_stress_kpa, total_rate_hz, responding, mean_rate_hz,
        mean_interval_ms, log_rate_slope (d ln total_rate_hz / d ln e_fab_kpa); for a batch, the medians, each with
        columns `_low` and `_high`. Mean rate, interval and slope are empty where no receptor fires. The last column,
        readings, lists the readings used.
    """
    import pandas as pd

    response = scene.respond(parameters, modulus)
    touched = scene.modulus if modulus is None else modulus[:, scene.fabric]
    columns: dict[str, object] = {"fabric": [fabrics.names[i] for i in scene.fabric]}
    slope = {"log_rate_slope": log_rate_slope(scene, parameters, modulus)}
    for name, values in (quantities(response, touched) | slope).items():
        if values.ndim == 1:
            columns[name] = values
        else:
            columns[f"{name}_low"], columns[name], columns[f"{name}_high"] = _limits(values, prob)
    columns["readings"] = scene.readings.label
    return pd.DataFrame(columns)


SLOPE_STEP = 0.01
"""Step of differences in ln E_fab."""


def quantities(response: Response, modulus: Array) -> dict[str, Array]:
    """Return the numerical columns of `prediction_table`, each of the shape of the response.

    Parameters
    ----------
    response
        Response of a scene.
    modulus
        E_fab [Pa] of each condition, shape (..., conditions).
    """
    contact = response.contact
    return {
        "indentation_mm": contact.indentation * 1e3,
        "force_n": contact.force,
        "e_fab_kpa": np.broadcast_to(modulus * 1e-3, contact.force.shape),
        "e_skin_kpa": contact.skin_modulus * 1e-3,
        "contact_radius_mm": contact.radius * 1e3,
        "peak_stress_kpa": response.peak_stress * 1e-3,
        "total_rate_hz": response.total_rate,
        "responding": response.responding,
        "mean_rate_hz": response.mean_rate,
        "mean_interval_ms": response.mean_interval * 1e3,
    }


def log_rate_slope(scene: Scene, parameters: TouchParameters, modulus: Array | None = None) -> Array:
    """Return d ln(total rate) / d ln(E_fab) of every condition, shape (..., conditions); NaN where no receptor fires.

    Differences over 2 % in E_fab; arguments as for `prediction_table`.
    """
    middle = scene.fabric_modulus if modulus is None else modulus
    down, up = (scene.total_rate(parameters, middle * np.exp(sign * SLOPE_STEP)) for sign in (-1.0, 1.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.log(up / down) / (2.0 * SLOPE_STEP)
    return np.where(np.isfinite(slope), slope, np.nan)


def _limits(values: Array, prob: float) -> Array:
    """Return lower limit, median and upper limit over draws that are not NaN; NaN if there are none."""
    tail = 0.5 * (1.0 - prob)
    limits = np.full((3, values.shape[1]), np.nan)
    for column in range(values.shape[1]):
        known = values[:, column][~np.isnan(values[:, column])]
        if known.size:
            limits[:, column] = np.quantile(known, [tail, 0.5, 1.0 - tail])
    return limits


NEW_RATERS = 10
"""Number of new raters per posterior draw, sufficient for smooth limits of their ratings."""


class OtherRatings(NamedTuple):
    """Ratings for the conditions of a scene at draws of a posterior [as in the file]."""

    rate: Array
    """Response of the typical finger [spikes/s], shape (draws, conditions)."""
    typical: Array
    """Median rating of the typical rater, same shape."""
    new: Array
    """One rating of each of `NEW_RATERS` new raters, shape (draws, raters, conditions); empty if no raters were
    requested."""
    mean: Array
    """Mean rating of the requested number of new raters, shape (draws, conditions); empty if none were requested."""
    alike: IndexArray
    """Group index of each condition, shape (conditions,). Conditions of a group have the same response and distribution
    of ratings, so that their draws can be pooled."""


@dataclass(frozen=True)
class OtherTouches:
    """Touches with ratings predicted from a posterior.

    Responses are centred as in the likelihood, over the rows that were rated, because the level was inferred relative
    to that centre.

    Parameters
    ----------
    posterior
        The density given ratings.
    scene
        Fabrics and loads that are touched with the same finger.
    known
        Index of each fabric among the rated ones, shape (fabrics,); -1 for new fabrics, whose deviations are drawn if
        the model has any. None to leave out deviations of fabrics.
    scale
        Scale of the ratings, in whose units they are returned.
    """

    posterior: Posterior
    scene: Scene
    known: IndexArray | None
    scale: Scale = MAGNITUDE

    @cached_property
    def _beside(self) -> Posterior:
        """The posterior with the forward model of these touches; moduli are not among its parameters."""
        of, fingers = self.posterior, self.posterior.fingers
        of = of.with_term(of.observation.with_pressed(None))  # new raters have fingers from the common grid
        return replace(
            of,
            space=replace(of.space, sampled=of.space.chain, moduli=None),
            scene=self.scene,
            other_loads=None,
            fingers=None if fingers is None else family_of(self.scene, fingers.grid),
        )

    @cached_property
    def _by_load(self) -> list[tuple[IndexArray, IndexArray | None]]:
        """Conditions of each load, with the rated conditions that they are compared with, if that load was rated."""
        rated = self.posterior.scene
        known = {load: np.flatnonzero(rated.load == k) for k, load in enumerate(rated.loads)}
        columns = (np.flatnonzero(self.scene.load == k) for k in range(len(self.scene.loads)))
        return [(here, known.get(load)) for here, load in zip(columns, self.scene.loads, strict=True) if here.size]

    def ratings(
        self, rng: np.random.Generator, theta: Array, raters: int = 0, modulus: Array | None = None
    ) -> OtherRatings:
        """Return the ratings at some draws.

        Parameters
        ----------
        rng
            Random generator of effects given the data, new raters and noise.
        theta
            Draws of the posterior, shape (draws, dimension).
        raters
            Number of new raters to average; 0 for the typical rater only, as required if deviations of fabrics are left
            out.
        modulus
            E_fab [Pa] of each fabric at each draw, shape (draws, fabrics); by default that of the scene.
        """
        grid = self.posterior.fingers
        columns = (1 if grid is None else 1 + grid.grid.size) * self.scene.n_conditions
        columns += self.posterior.observation.condition_of_rate.size
        parts = [
            self._ratings(rng, theta[k], raters, None if modulus is None else modulus[k])
            for k in pieces(len(theta), columns)
        ]
        *drawn, alike = zip(*parts, strict=True)
        rate, *rated = (np.concatenate(part) for part in drawn)
        typical, new, mean = map(self.scale.filed, rated)
        return OtherRatings(rate, typical, new, mean, _alike(np.stack(alike)))

    def _ratings(self, rng: np.random.Generator, theta: Array, raters: int, modulus: Array | None) -> OtherRatings:
        observed, conditions = self.posterior.observation, self.scene.n_conditions
        model, scale = observed.single, observed.model.scale
        rated, parameters = self.posterior.response(theta), self.posterior.rating_parameters(theta)
        response = self._beside.response(theta[:, : self.posterior.space.n_chain], modulus)
        drive = observed.drive_at(response, rated, parameters)
        effects = observed.draw_effects(rng, rated, parameters)
        fabrics = np.full(self.scene.fabric_modulus.size, -1) if self.known is None else self.known
        others = model.for_others(rng, parameters, effects, 1, fabrics)
        own = None if self.known is None else deviations_of_fabrics(model.named_effects(others))
        stated = drive[..., :conditions]
        touched = stated if own is None else stated + own[..., self.scene.fabric]
        typical = np.empty_like(touched)
        for columns, among in self._by_load:
            typical[..., columns] = observed.typical(rated, parameters, others, touched[..., columns], among)
        design = Design(np.arange(conditions), np.zeros(conditions, np.intp), self.scene.fabric, 1)
        asked = max(raters, NEW_RATERS) if raters else 0
        new, total = np.empty((len(theta), NEW_RATERS if raters else 0, conditions)), np.zeros((len(theta), conditions))
        for k in range(asked):
            rating = self._rating(rng, design, drive, parameters, others)
            if k < NEW_RATERS:
                new[:, k] = rating
            if k < raters:
                with np.errstate(divide="ignore"):  # a rating of 0 makes the geometric mean 0, too
                    total += scale.additive(rating)
        mean = scale.natural(total / raters) if raters else np.empty((len(theta), 0))
        # with deviations of fabrics, rated fabrics differ even at equal responses
        fabric = np.full(conditions, -1) if own is None else fabrics[self.scene.fabric]
        every = response.reshape(len(theta), -1, conditions)  # of raters' own fingers too
        alike = _alike(np.concatenate([fabric[None], every.reshape(-1, conditions)]))
        return OtherRatings(response[..., :conditions] * self.scene.n_receptors, typical, new, mean, alike)

    def _rating(
        self, rng: np.random.Generator, design: Design, drive: Array, parameters: Parameters, others: Effects
    ) -> Array:
        """Return the ratings by one new rater at every draw, shape (draws, conditions)."""
        model = self.posterior.observation.single
        effects = model.for_others(rng, parameters, others, 1, np.arange(self.scene.fabric_modulus.size))
        return np.asarray(model.draw_ratings(rng, design, drive, parameters, effects))


def _alike(columns: NDArray[Any]) -> IndexArray:
    """Return the group index of each column, shape (columns,): equal columns form one group."""
    numbers: dict[bytes, int] = {}
    return np.array([numbers.setdefault(column.tobytes(), len(numbers)) for column in columns.T], np.intp)


def deviations_of_fabrics(effects: Mapping[str, tuple[Array, tuple[str, ...]]]) -> Array | None:
    """Return the total deviation of each fabric, shape (draws, fabrics); None if the model has none."""
    found = [values for values, axes in effects.values() if axes == ("fabric",)]
    return sum(found[1:], found[0]) if found else None


def rates_of_other_moduli(posterior: Posterior, theta: Array, step: float) -> tuple[Array, Array]:
    """Return `Posterior.response` at theta (draws, dimension) with all log moduli lowered, and raised, by a step."""
    modulus = posterior.space.modulus(theta)
    if modulus is None:
        known = posterior.scene.fabric_modulus
        modulus = np.broadcast_to(known, (len(theta), known.size))
    lower, higher = (posterior.response(theta, modulus * np.exp(side * step)) for side in (-1.0, 1.0))
    return lower, higher


def rates_of_other_skins(posterior: Posterior, theta: Array, step: float) -> tuple[Array, Array]:
    """Return `Posterior.mean_rate` at theta (draws, dimension) with ln b lowered, and raised, by a step."""
    touch, modulus = posterior.space.touch(theta), posterior.space.modulus(theta)
    lower, higher = (
        posterior.mean_rate_of(touch._replace(b=touch.b * np.exp(side * step)), modulus) for side in (-1.0, 1.0)
    )
    return lower, higher


def drive_slope(posterior: Posterior, theta: Array, rates: tuple[Array, Array], step: float) -> Array:
    """Return the derivative of the typical finger's `Likelihood.drive`, a central difference, (draws, conditions).

    Parameters
    ----------
    posterior, theta
        The model, and draws (draws, dimension).
    rates
        Responses at the draws with a quantity lowered, and raised, by a step.
    step
        The step.
    """
    observed, here, parameters = posterior.observation, posterior.mean_rate(theta), posterior.rating_parameters(theta)
    shape = len(theta), observed.design.n_conditions
    lower, higher = (
        observed.drive_at(np.broadcast_to(rate[..., : shape[1]], shape), here, parameters) for rate in rates
    )
    return np.asarray((higher - lower) / (2.0 * step))
