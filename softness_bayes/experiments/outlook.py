"""Ratings that a posterior expects of touches that have not been rated, at its draws, and their errors.

Given the parameters of a draw, a rating of a touch on the additive scale (a log rating, or log odds) is

    y = level of the rater + response of the touch + error of the fabric + error of the rating

The response is relative to the mean response of the rated touches, and the level of a rater is that of the ratings at
this draw: a parameter that moves all responses alike moves the level against them, and is not learnt from a further
rating. Levels and errors of moduli are integrated out. Errors of ratings count as normal ones that tell as much.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import ndtr

from softness_bayes.base.errors import InputError
from softness_bayes.base.ranges import require_kind
from softness_bayes.checking.inflection import CurveShape, turning_points
from softness_bayes.data import Fabrics
from softness_bayes.data.ratings import loads_by_column
from softness_bayes.experiments.design_information import heavier, rounding
from softness_bayes.likelihood.scales import MAGNITUDE, SLIDER
from softness_bayes.model.build import ExperimentModel
from softness_bayes.model.posterior import Posterior
from softness_bayes.model.scenes import fabric_moduli, scene_of
from softness_bayes.parameters.space import FabricModuli
from softness_bayes.results.fitted import Fitted, same_fabrics
from softness_bayes.touch.contact import HERTZ_LIMIT, Load
from softness_bayes.touch.parameters import TouchParameters

Array = NDArray[np.float64]

DRAWS = 4000
"""Number of draws."""

USUAL_CV = 0.15
"""Relative standard error of moduli that a run took as exact."""

MODULUS_STEP = 0.1
"""Step of the log modulus over which the slope of a response is taken."""


@dataclass(frozen=True)
class Touches:
    """Touches that could be rated, at the draws of an outlook."""

    table: pd.DataFrame
    """A row for each touch: fabric, to_obtain, e_fab_kpa (as measured or wanted), indentation_mm, force_n, p_silent
    (share of draws for which no receptor fires), load, modulus_sd (standard deviation of the error of the log modulus)
    and within (true if the contact radius of most draws is at most half the fingertip's radius)."""
    response: Array
    """Response on the additive scale, shape (draws, touches)."""
    slope: Array
    """Derivative of the response in the log modulus, the same shape."""
    deviation: Array
    """Variance of the fabric's own deviation given a draw, the same shape."""

    def take(self, index: Any) -> Touches:
        """Return some of the touches."""
        table = self.table.loc[index].reset_index(drop=True)
        return Touches(table, self.response[:, index], self.slope[:, index], self.deviation[:, index])


def touches_within(
    outlooks: Sequence[Outlook], fabrics: Fabrics, loads: Sequence[Load], modulus_cv: float | None
) -> Touches:
    """Return the touches within the model's range, at the draws of all outlooks; arguments as for `Outlook.touches`.

    Raises
    ------
    InputError
        If there is none.
    """
    parts = [one.touches(fabrics, tuple(loads), modulus_cv) for one in outlooks]
    within = np.all([part.table["within"] for part in parts], axis=0)
    if not within.any():
        raise InputError(
            "design: no candidate is within the model's range: under every load the contact radius exceeds half the "
            "fingertip's radius; choose smaller loads"
        )
    table = parts[0].table.assign(p_silent=np.mean([part.table["p_silent"] for part in parts], axis=0))
    fields = ("response", "slope", "deviation")
    return Touches(table, *(np.concatenate([getattr(part, name) for part in parts]) for name in fields)).take(within)


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
    rated
        True if the draws are given the ratings, False for those of the prior.

    Raises
    ------
    InputError
        If the ratings are not normal about a level and a response.
    """

    model: ExperimentModel
    theta: Array
    named: Mapping[str, Any]
    rated: bool

    def __post_init__(self) -> None:
        options, posterior = self.model.options, self.model.posterior
        if options.scale not in (MAGNITUDE, SLIDER):
            raise InputError(
                f"design: expected magnitude estimates or positions on a slider, got {options.scale.name}: only "
                "these have a level and an error for each touch"
            )
        if posterior.fingers is not None or posterior.other_loads is not None or options.individual:
            raise InputError("design: expected raters with the typical finger and answers, under loads without errors")

    @property
    def posterior(self) -> Posterior:
        """The density of the parameters."""
        return self.model.posterior

    @cached_property
    def touch(self) -> TouchParameters:
        """Parameters of the forward model at the draws [SI], each of shape (draws,)."""
        return self.posterior.space.touch(self.theta).broadcast(len(self.theta))

    @cached_property
    def parameters(self) -> Any:
        """Parameters of the ratings at the draws."""
        return self.posterior.rating_parameters(self.theta)

    @cached_property
    def noise(self) -> Array:
        """Standard deviation of normal errors of ratings that tell as much about a level, shape (draws,)."""
        variance = np.asarray(self.parameters.varsigma, float) ** 2
        variance = variance * heavier(self.posterior.observation.model.error, self.parameters)
        variance = variance + rounding(self.model.interpretation.intervals, self.model.options.scale.additive)
        return np.broadcast_to(np.sqrt(variance), len(self.theta))

    @cached_property
    def levels(self) -> tuple[Array, Array, Array, Array]:
        """Laws of levels given each draw: mean and variance of each rater, (draws, raters), and of new raters' mean."""
        model, posterior, draws = self.model, self.posterior, len(self.theta)
        design, tau2 = posterior.observation.design, self.spread**2
        if not self.rated:
            law = posterior.observation.model.level
            mean, variance = np.full(draws, law.mean), np.full(draws, law.sd**2)
            shape = (draws, design.n_participants)
            every = np.broadcast_to(mean[:, None], shape), np.broadcast_to((variance + tau2)[:, None], shape)
            return *every, mean, variance
        stated = model.interpretation.intervals
        with np.errstate(divide="ignore"):
            low, high = (model.options.scale.additive(end) for end in stated.ends(stated.values))
        middle = np.where(np.isneginf(low), high, np.where(np.isposinf(high), low, 0.5 * (low + high)))
        drive = posterior.observation.drive(posterior.mean_rate(self.theta), self.parameters)
        count = np.bincount(design.participant, minlength=design.n_participants)
        member = np.eye(design.n_participants)[design.participant]
        mean = (middle - drive[:, design.condition]) @ member / count
        own_variance = self.noise[:, None] ** 2 / count
        # the common level, and each rater's drawn towards it
        weight = 1.0 / (tau2[:, None] + own_variance)
        total = weight.sum(axis=1)
        common = (weight * mean).sum(axis=1) / total
        pull = own_variance * weight
        drawn = mean + pull * (common[:, None] - mean)
        return drawn, own_variance * (1.0 - pull) + pull**2 / total[:, None], common, 1.0 / total

    @property
    def spread(self) -> Array:
        """Standard deviation of raters' levels, shape (draws,)."""
        return np.broadcast_to(np.asarray(self.parameters.tau, float), len(self.theta))

    def level(self, rater: str | int | None) -> tuple[Array, Array]:
        """Return mean and variance of a level at each draw.

        Parameters
        ----------
        rater
            Name of a rater, new if the experiment does not have it; the mean level of all raters of the experiment
            (None), or of a number of new ones.
        """
        mean, variance, new_mean, new_variance = self.levels
        names = self.model.data.ratings.participants
        if rater is None:
            return mean.mean(axis=1), variance.mean(axis=1) / len(names)
        if isinstance(rater, str) and rater in names:
            k = names.index(rater)
            return mean[:, k], variance[:, k]
        return new_mean, new_variance + self.spread**2 / (1 if isinstance(rater, str) else rater)

    def touches(self, fabrics: Fabrics, loads: tuple[Load, ...], modulus_cv: float | None) -> Touches:
        """Return all touches of some fabrics under some loads.

        Parameters
        ----------
        fabrics
            The fabrics; those with the name and the modulus of a rated one are the experiment's own.
        loads
            The loads.
        modulus_cv
            Relative standard error of moduli whose errors neither the model nor their table has; `USUAL_CV` if None.
        """
        options, observed = self.model.options, self.posterior.observation
        cv = USUAL_CV if modulus_cv is None else modulus_cv
        laws = fabric_moduli(fabrics, options.readings.fabric_modulus, cv, options.unknown_modulus)
        finger = self.model.scene.finger
        scene = scene_of(fabrics, loads, self.named, options.readings, noise=options.noise, finger=finger, moduli=laws)
        own, own_middle = self.model.data.fabrics.names, self.model.scene.fabric_modulus
        rated = same_fabrics(fabrics.names, scene.fabric_modulus, own, own_middle)
        modulus, modulus_sd = self._moduli_and_errors(laws, rated)
        base = self.posterior.mean_rate(self.theta)
        rates = [
            np.asarray(scene.total_rate(self.touch, modulus * np.exp(step)) / scene.n_receptors)
            for step in (0.0, -MODULUS_STEP, MODULUS_STEP)
        ]
        response, softer, stiffer = (np.asarray(observed.drive_at(rate, base, self.parameters)) for rate in rates)
        count = np.bincount(observed.design.fabric[observed.design.condition], minlength=len(own))
        count = np.where(rated >= 0, count[rated], 0)
        omega2 = np.broadcast_to(np.asarray(getattr(self.parameters, "omega", 0.0), float) ** 2, len(self.theta))
        deviation = omega2[:, None] / (1.0 + omega2[:, None] * count / self.noise[:, None] ** 2)
        radius = np.median(np.asarray(scene.contact(self.touch, modulus).radius), axis=0)
        pressed = [scene.loads[k] for k in scene.load]
        table = pd.DataFrame(
            {
                "fabric": [fabrics.names[k] for k in scene.fabric],
                "to_obtain": rated[scene.fabric] < 0,
                "e_fab_kpa": scene.modulus * 1e-3,
                **{one.name: values / one.factor for one, values in loads_by_column(pressed).items()},
                "p_silent": (rates[0] == 0).mean(axis=0),
                "load": pressed,
                "modulus_sd": modulus_sd[scene.fabric],
                "within": radius <= HERTZ_LIMIT * scene.finger.radius,
            }
        )
        return Touches(table, response, (stiffer - softer) / (2.0 * MODULUS_STEP), deviation[:, scene.fabric])

    def _moduli_and_errors(self, laws: FabricModuli, rated: NDArray[np.intp]) -> tuple[Array, Array]:
        """Return E_fab [Pa] of fabrics at the draws, and standard deviations of errors that the draws do not have.

        Errors of rated fabrics that the model samples are parameters; those of other fabrics are errors of ratings.
        """
        sampled = self.posterior.space.modulus(self.theta)
        own = self.model.moduli
        batch = [own.batch[k] if k >= 0 else one for k, one in zip(rated, laws.batch, strict=True)]
        shared = own.factor(self.named, batch, np.random.default_rng(0))
        modulus = np.broadcast_to(np.array(laws.middle) * shared, (len(self.theta), rated.size))
        # half the width of the middle 68 %: the standard deviation if the law is log-normal
        ends = [np.ones(2) if law is None else law.quantile(ndtr([-1.0, 1.0])) for law in laws.laws]
        errors = 0.5 * np.diff(np.log(ends), axis=1)[:, 0]
        if sampled is None:
            return modulus, errors
        drawn = np.where(rated >= 0, sampled[:, rated], modulus)
        varies = np.ptp(np.log(drawn / shared), axis=0) > 1e-9  # more than by rounding
        return drawn, np.where((rated >= 0) & varies, 0.0, errors)

    def turning(self, load: Load) -> Array:
        """Return the log of E_fab [Pa] at the turning point under a load, (draws,); NaN where there is none."""
        turn = turning_points(self.model.scene, self.touch, 0.0, loads=[load])
        return np.where(turn.outcome == CurveShape.INTERIOR, np.log(turn.modulus), np.nan)[:, 0]


def outlook_of_run(result: Any, draws: int = DRAWS) -> Outlook:
    """Return the outlook of a finished run.

    Raises
    ------
    InputError
        If it is no run on ratings, has not converged, or its ratings are not levels of single touches.
    """
    require_run(result)
    fitted = Fitted(result, draws)
    return Outlook(fitted.model, fitted.theta, fitted.named, rated=True)


def require_run(result: Any) -> None:
    """Raise an error for a run whose draws would mislead the choice: one without ratings, or not converged."""
    from softness_bayes.results.result import Result

    require_kind("design", result, Result, "a Result, two of them, or an Experiment")
    if not result.has_ratings:
        raise InputError(f"{result.source}: a run without ratings cannot tell what ratings would add")
    if result.is_first_look or not result.provenance.ending.converged:
        raise InputError(
            f"{result.source}: the run has not converged, and its draws would mislead the choice; continue it with "
            "'resume'"
        )
