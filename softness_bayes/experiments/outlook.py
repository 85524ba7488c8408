"""Ratings that a posterior expects of touches that have not been rated, at its draws, and their errors.

Given the parameters of a draw, a rating of a touch on the additive scale (a log rating, or log odds) is

    y = level of the rater + response of the touch + error of the fabric + error of the rating

The response is relative to the mean response of the rated touches, and the level of a rater is that of the ratings at
this draw: a parameter that moves all responses alike moves the level against them, and is not learnt from a further
rating. Levels and errors of moduli are integrated out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.inflection import CurveShape, turning_points
from softness_bayes.data import Experiment, Fabrics
from softness_bayes.errors import InputError
from softness_bayes.likelihood.scales import MAGNITUDE, SLIDER
from softness_bayes.model.build import ExperimentModel, build
from softness_bayes.model.design_information import heavier, rounding
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.posterior import Posterior
from softness_bayes.model.scenes import fabric_moduli, scene_of
from softness_bayes.results.fitted import Fitted
from softness_bayes.touch.contact import HERTZ_LIMIT, Load
from softness_bayes.touch.scene import Scene

Array = NDArray[np.float64]
IndexArray = NDArray[np.intp]

DRAWS = 4000
"""Number of draws."""

MODULUS_STEP = 0.1
"""Step of the log modulus over which the slope of a response is taken."""


@dataclass(frozen=True)
class Levels:
    """Normal laws of raters' levels given each draw, on the additive scale."""

    mean: Array
    """Shape (draws, raters)."""
    variance: Array
    """Shape (draws, raters)."""
    new_mean: Array
    """Mean of a new rater's level, shape (draws,)."""
    new_variance: Array
    """Variance of the level that all new raters share, shape (draws,)."""
    spread: Array
    """Standard deviation of raters' levels, shape (draws,)."""

    def of_panel(self, raters: int | None) -> tuple[Array, Array]:
        """Return mean and variance of the mean level of the same raters (None), or of a number of new ones."""
        if raters is None:
            return self.mean.mean(axis=1), self.variance.mean(axis=1) / self.mean.shape[1]
        return self.new_mean, self.new_variance + self.spread**2 / raters


@dataclass(frozen=True)
class Touches:
    """Touches that could be rated, at the draws of an outlook."""

    fabric: tuple[str, ...]
    """Name of each touch's fabric."""
    owned: NDArray[np.bool_]
    """True for fabrics of the experiment."""
    modulus: Array
    """E_fab of each touch as measured or wanted [Pa]."""
    load: tuple[Load, ...]
    """Load of each touch."""
    response: Array
    """Response on the additive scale, shape (draws, touches)."""
    slope: Array
    """Derivative of the response in the log modulus, the same shape."""
    modulus_sd: Array
    """Standard deviation of the error of each touch's log modulus, shape (touches,); errors of a fabric are the same
    under every load."""
    deviation: Array
    """Variance of the fabric's own deviation given a draw, shape (draws, touches)."""
    within: NDArray[np.bool_]
    """True if the contact radius of most draws is at most half the fingertip's radius."""
    silent: Array
    """Share of draws for which no receptor fires, shape (touches,)."""

    def take(self, index: Any) -> Touches:
        """Return some of the touches."""
        index = np.arange(len(self.load))[index]
        return Touches(
            tuple(self.fabric[k] for k in index),
            self.owned[index],
            self.modulus[index],
            tuple(self.load[k] for k in index),
            self.response[:, index],
            self.slope[:, index],
            self.modulus_sd[index],
            self.deviation[:, index],
            self.within[index],
            self.silent[index],
        )


@dataclass(frozen=True)
class Outlook:
    """A posterior, or a prior, at draws, with the ratings that it expects of further touches.

    Parameters
    ----------
    model
        The model of the experiment.
    theta
        The draws, shape (draws, dimension).
    named
        Every parameter by name in natural units: draws, or a number if it is fixed.
    moduli
        Function that returns E_fab [Pa] of some fabrics at each draw, (draws, fabrics); None if they are exact.
    rated
        True if the draws are given the ratings, False for those of the prior.
    """

    model: ExperimentModel
    theta: Array
    named: Mapping[str, Any]
    moduli: Callable[[Fabrics], Array | None]
    rated: bool

    @property
    def posterior(self) -> Posterior:
        """The density of the parameters."""
        return self.model.posterior

    @cached_property
    def noise(self) -> Array:
        """Standard deviation of normal errors of ratings that tell as much about a level, shape (draws,)."""
        parameters, model = self.posterior.rating_parameters(self.theta), self.model
        variance = np.asarray(parameters.varsigma, float) ** 2
        variance = variance * heavier(self.posterior.observation.model.error, parameters)
        variance = variance + rounding(model.interpretation.intervals, model.options.scale.additive)
        return np.broadcast_to(np.sqrt(variance), len(self.theta))

    @cached_property
    def levels(self) -> Levels:
        """Levels of the raters given the ratings at each draw, or those of the prior."""
        return _levels(self)

    def scene(self, fabrics: Fabrics, loads: tuple[Load, ...]) -> Scene:
        """Return the scene of some fabrics under some loads, with the finger and the readings of the model."""
        options = self.model.options
        return scene_of(
            fabrics, loads, self.named, options.readings, noise=options.noise, finger=self.model.scene.finger
        )

    def touches(
        self, fabrics: Fabrics, loads: tuple[Load, ...], modulus_cv: float | None, default_cv: float
    ) -> Touches:
        """Return all touches of some fabrics under some loads.

        Parameters
        ----------
        fabrics
            The fabrics; those with the name of a rated one are the experiment's own.
        loads
            The loads.
        modulus_cv
            Relative standard error of moduli; None for those of the experiment, and `default_cv` where it takes moduli
            as exact.
        default_cv
            See `modulus_cv`.
        """
        scene, posterior = self.scene(fabrics, loads), self.posterior
        own = self.model.experiment.fabrics
        known = {name: k for k, name in enumerate(own.names)}
        owned = np.array([name in known for name in fabrics.names])
        drawn = self.moduli(fabrics)
        at_draws = np.broadcast_to(scene.fabric_modulus, (len(self.theta), len(fabrics))) if drawn is None else drawn
        sampled = at_draws.std(axis=0) > 0
        cv = np.where(sampled, 0.0, default_cv if modulus_cv is None else modulus_cv)
        touch = posterior.space.touch(self.theta).broadcast(len(self.theta))
        parameters, rated = posterior.rating_parameters(self.theta), posterior.mean_rate(self.theta)
        rates = [
            np.asarray(scene.total_rate(touch, at_draws * np.exp(step)) / scene.n_receptors)
            for step in (0.0, -MODULUS_STEP, MODULUS_STEP)
        ]
        drives = [np.asarray(posterior.observation.drive_at(rate, rated, parameters)) for rate in rates]
        omega2 = np.broadcast_to(np.asarray(getattr(parameters, "omega", 0.0), float) ** 2, len(self.theta))
        counts = np.zeros(len(fabrics))
        design = posterior.observation.design
        ratings = np.bincount(design.fabric[design.condition], minlength=len(own))
        counts[owned] = [ratings[known[name]] for name in np.array(fabrics.names)[owned]]
        precision = np.divide(1.0, omega2, out=np.full(omega2.shape, np.inf), where=omega2 > 0)
        deviation = 1.0 / (precision[:, None] + counts / self.noise[:, None] ** 2)
        radius = np.asarray(scene.contact(touch, at_draws).radius)
        return Touches(
            tuple(fabrics.names[k] for k in scene.fabric),
            owned[scene.fabric],
            scene.modulus,
            tuple(scene.loads[k] for k in scene.load),
            drives[0],
            (drives[2] - drives[1]) / (2.0 * MODULUS_STEP),
            np.sqrt(np.log1p(cv**2))[scene.fabric],
            deviation[:, scene.fabric],
            np.median(radius, axis=0) <= HERTZ_LIMIT * scene.finger.radius,
            (rates[0] == 0).mean(axis=0),
        )

    def turning(self, load: Load) -> Array:
        """Return the log of E_fab [Pa] at the turning point under a load, (draws,); NaN where there is none."""
        touch = self.posterior.space.touch(self.theta).broadcast(len(self.theta))
        turn = turning_points(self.model.scene, touch, 0.0, loads=[load])
        return np.where(turn.outcome == CurveShape.INTERIOR, np.log(turn.modulus), np.nan)[:, 0]


def outlook_of_run(result: Any, rng: np.random.Generator, draws: int = DRAWS) -> Outlook:
    """Return the outlook of a finished run.

    Raises
    ------
    InputError
        If the run has no ratings, is unfinished, or its ratings are not levels of single touches.
    """
    fitted = Fitted(result, draws)
    _require(fitted.model)

    def moduli(fabrics: Fabrics) -> Array | None:
        return fitted.modulus(rng, fabrics)

    return Outlook(fitted.model, fitted.theta, fitted.named, moduli, rated=True)


def outlook_of_prior(
    experiment: Experiment, options: ModelOptions, rng: np.random.Generator, draws: int = DRAWS
) -> Outlook:
    """Return the outlook before any rating: draws of the prior, and raters whose levels are unknown.

    Raises
    ------
    InputError
        If the ratings of the experiment are not levels of single touches.
    """
    model = build(experiment, options)
    _require(model)
    space = model.posterior.space
    theta = space.draw_prior(rng, draws)
    sampled = space.modulus(theta)

    def moduli(fabrics: Fabrics) -> Array | None:
        own = {name: k for k, name in enumerate(experiment.fabrics.names)}
        laws = fabric_moduli(fabrics, options.readings.fabric_modulus, unknown=options.unknown_modulus)
        found = np.tile(np.array(laws.middle), (draws, 1))
        for k, name in enumerate(fabrics.names):
            if name in own and sampled is not None:
                found[:, k] = sampled[:, own[name]]
        return found

    return Outlook(model, theta, space.values(theta), moduli, rated=False)


def _require(model: ExperimentModel) -> None:
    """Raise an error for models whose further ratings are not normal about a level and a response."""
    posterior = model.posterior
    if model.options.scale not in (MAGNITUDE, SLIDER):
        raise InputError(
            f"design: expected magnitude estimates or positions on a slider, got {model.options.scale.name}: only "
            "these have a level and an error for each touch"
        )
    if posterior.fingers is not None or posterior.other_loads is not None or model.options.individual:
        raise InputError("design: expected raters with the typical finger and answers, under loads without errors")


def _levels(outlook: Outlook) -> Levels:
    """Return the levels of the raters at each draw, given the ratings or of the prior."""
    model, posterior, draws = outlook.model, outlook.posterior, len(outlook.theta)
    parameters, noise = posterior.rating_parameters(outlook.theta), outlook.noise
    tau = np.broadcast_to(np.asarray(parameters.tau, float), draws)
    level = posterior.observation.model.level
    design = posterior.observation.design
    if not outlook.rated:
        unknown = np.full(draws, level.sd**2)
        every = np.full((draws, design.n_participants), level.mean)
        wide = np.broadcast_to((unknown + tau**2)[:, None], every.shape)
        return Levels(every, wide, every[:, 0], unknown, tau)
    stated = model.interpretation.intervals
    low, high = stated.ends(stated.values)
    scale = model.options.scale
    with np.errstate(divide="ignore"):
        low, high = scale.additive(low), scale.additive(high)
    middle = np.where(np.isneginf(low), high, np.where(np.isposinf(high), low, 0.5 * (low + high)))
    drive = posterior.observation.drive(posterior.mean_rate(outlook.theta), parameters)
    count = np.bincount(design.participant, minlength=design.n_participants)
    member = np.zeros((design.n_rows, design.n_participants))
    member[np.arange(design.n_rows), design.participant] = 1.0
    mean = (middle - drive[:, design.condition]) @ member / count
    own_variance = noise[:, None] ** 2 / count
    # the common level, and each rater's drawn towards it
    weight = 1.0 / (tau[:, None] ** 2 + own_variance)
    total = weight.sum(axis=1)
    common = (weight * mean).sum(axis=1) / total
    pull = own_variance * weight
    drawn = mean + pull * (common[:, None] - mean)
    variance = own_variance * (1.0 - pull) + pull**2 / total[:, None]
    return Levels(drawn, variance, common, 1.0 / total, tau)
