"""Ratings that a posterior expects of touches that have not been rated, at its draws, and their errors.

Given the parameters of a draw, a rating of a touch on the additive scale (a log rating, or log odds) is

    y = response of the touch + level of the rater + slope x error of the log modulus + deviation of the fabric + error

The response is relative to the mean response of the rated touches, and the level of a rater is that of the ratings at
this draw: a parameter that moves all responses alike moves the level against them, and is not learnt from a further
rating. The level, the error of a modulus and the deviation of a fabric are effects that ratings share, normal at each
draw. Errors of ratings count as normal ones that tell as much.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
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
from softness_bayes.data.columns import PROPERTIES
from softness_bayes.data.ratings import FREE_TOUCH, loads_by_column
from softness_bayes.experiments.design_information import heavier, rounding
from softness_bayes.likelihood.design import FloatArray, IndexArray
from softness_bayes.likelihood.scales import MAGNITUDE, SLIDER
from softness_bayes.model.build import ExperimentModel
from softness_bayes.model.scenes import fabric_moduli, scene_of
from softness_bayes.parameters.space import FabricModuli
from softness_bayes.results.fitted import Fitted, same_fabrics
from softness_bayes.touch.contact import HERTZ_LIMIT, Force, Indentation, Load, held

DRAWS = 4000
"""Number of draws."""

SPREADS = ("tau", "varsigma", "omega", "nu", "lapse")
"""Parameters that are learnt from differences between ratings of one touch, which the plan averages."""

GRID = 12
"""Number of moduli to obtain, over the range of the rated ones."""

USUAL_CV = 0.15
"""Relative standard error of moduli that a run took as exact."""

MODULUS_STEP = 0.1
"""Step of the log modulus over which the slope of a response is taken."""


@dataclass(frozen=True)
class FurtherRatings:
    """Ratings of touches at draws, normal given a draw."""

    table: pd.DataFrame
    """A row for each touch: fabric, to_obtain, e_fab_kpa (as measured or wanted), indentation_mm, force_n, p_silent
    (share of draws for which no receptor fires), load and within (true if the contact radius of most draws is at most
    half the fingertip's radius)."""
    of: NDArray[np.object_]
    """Owner of each effect of each touch, shape (3, touches): the level is a rater's, the others are the fabric's."""
    response: FloatArray
    """Response on the additive scale, shape (draws, touches)."""
    noise: FloatArray
    """Standard deviation of the errors that ratings do not share, the same shape."""
    loading: FloatArray
    """Change of a rating by one unit of an effect, shape (3, draws, touches)."""
    centre: FloatArray
    """Mean of the effects, the same shape."""
    variance: FloatArray
    """Their variance, the same shape."""

    @cached_property
    def mean(self) -> FloatArray:
        """Expected rating of each touch at each draw, shape (draws, touches)."""
        return np.asarray(self.response + (self.loading * self.centre).sum(axis=0))

    @cached_property
    def shared(self) -> FloatArray:
        """Standard deviation that the effects give the ratings, the same shape."""
        return np.sqrt((self.loading**2 * self.variance).sum(axis=0))

    @property
    def sd(self) -> FloatArray:
        """Standard deviation of the ratings, the same shape."""
        return np.hypot(self.noise, self.shared)

    def covariance(self, index: IndexArray) -> FloatArray:
        """Return the covariance of ratings of some touches at each draw, shape (draws, k, k)."""
        sd, of = (self.loading * np.sqrt(self.variance))[..., index], self.of[:, index]
        effects = np.einsum("esi,esj,eij->sij", sd, sd, of[:, :, None] == of[:, None])
        return effects + self.noise[:, index, None] ** 2 * np.eye(index.size)

    def mean_shared(self) -> FloatArray:
        """Return the mean over the draws of the covariance by effects, shape (touches, touches)."""
        sd, same = self.loading * np.sqrt(self.variance), self.of[:, :, None] == self.of[:, None]
        return np.asarray((same * (np.swapaxes(sd, 1, 2) @ sd)).sum(axis=0) / len(self.response))


@dataclass(frozen=True)
class Candidates:
    """Touches that could be rated: fabrics under loads, within the model's range.

    Parameters
    ----------
    fabrics
        Fabrics; those with the name and the modulus of a rated one are owned. By default the rated fabrics and
        `moduli`.
    moduli
        Effective moduli [Pa] of fabrics to obtain; by default `GRID` values over the range of the rated ones, none if
        there are fabrics.
    loads
        Loads in words, such as "2mm" or "1N"; by default those of the experiment.
    largest_load
        Larger loads of its kind, indentations or forces, are left out.
    modulus_cv
        Relative standard error of moduli for which neither the run nor their table has one; by default `USUAL_CV`.
    """

    fabrics: Fabrics | None = None
    moduli: tuple[float, ...] | None = None
    loads: tuple[str, ...] | None = None
    largest_load: str | None = None
    modulus_cv: float | None = None

    def resolved(self, outlook: Outlook) -> Candidates:
        """Return the same with the fabrics and loads of an experiment where none are given.

        Raises
        ------
        InputError
            If a modulus or a load is none, or all loads are larger than the largest.
        """
        base = outlook.model.data.fabrics if self.fabrics is None else self.fabrics
        rated = outlook.model.scene.fabric_modulus
        usual = np.geomspace(rated.min(), rated.max(), GRID if self.fabrics is None else 0)
        wanted = usual if self.moduli is None else np.asarray(self.moduli, float)
        if not ((wanted > 0) & np.isfinite(wanted)).all():
            raise InputError("moduli: expected numbers above 0 [Pa]")
        names = (*base.names, *(f"E_fab {value / 1e3:.3g} kPa" for value in wanted))
        unmeasured = np.full(wanted.size, np.nan)
        properties: dict[str, Any] = {name: np.append(getattr(base, name), unmeasured) for name in PROPERTIES}
        properties["effective_modulus"][len(base) :] = wanted
        loads = [load_named(load) for load in self.loads or outlook.model.data.ratings.loads]
        if self.largest_load is not None:
            largest = load_named(self.largest_load, "largest load: ")
            most = held(largest) * (1.0 + 1e-9)
            # of the other kind, every load stays
            loads = [load for load in loads if type(load) is not type(largest) or held(load) <= most]
            if not loads:
                raise InputError(f"largest load: every load is larger than {largest}; choose a larger one")
        every = replace(base, names=names, rows=(), batch=(*base.batch, *[""] * wanted.size), **properties)
        return Candidates(every, (), tuple(map(str, loads)), modulus_cv=self.modulus_cv)

    def ratings(self, outlooks: Sequence[Outlook], rater: str | int | None) -> FurtherRatings:
        """Return the ratings of the candidates, at the draws of all outlooks; raters are those of `Outlook.level`.

        Raises
        ------
        InputError
            As `resolved` does, or if no candidate is within the model's range.
        """
        parts = [one.ratings(self.resolved(outlooks[0]), rater) for one in outlooks]
        within = np.all([part.table["within"] for part in parts], axis=0)
        if not within.any():
            raise InputError(
                "design: no candidate is within the model's range: under every load the contact radius exceeds half "
                "the fingertip's radius; choose smaller loads"
            )
        table = parts[0].table.assign(p_silent=np.mean([part.table["p_silent"] for part in parts], axis=0))
        arrays = zip(*((p.response, p.noise, p.loading, p.centre, p.variance) for p in parts), strict=True)
        at_draws = (np.concatenate(each, axis=-2)[..., within] for each in arrays)
        return FurtherRatings(table.loc[within].reset_index(drop=True), parts[0].of[:, within], *at_draws)


def load_named(text: Any, what: str = "") -> Load:
    """Return the load of a text such as 2mm or 1N, or as loads are written.

    Raises
    ------
    InputError
        If it is none; the message begins with `what`.
    """
    match = re.fullmatch(r"\s*(\d+\.?\d*(?:e[+-]?\d+)?|\.\d+)\s*(mm|N)\s*", str(text))
    if match is None and str(text) != str(FREE_TOUCH):
        raise InputError(f"{what}expected a load such as 2mm or 1N, got {text!r}")
    if match is None:
        return FREE_TOUCH
    return Indentation(float(match[1]) / 1e3) if match[2] == "mm" else Force(float(match[1]))


class Outlook:
    """A posterior, or a prior, at draws, with the ratings that it expects of further touches.

    Parameters
    ----------
    model
        The model of the experiment.
    theta
        The draws, shape (draws, dimension).
    rated
        True if the draws are given the ratings, False for those of the prior.

    Raises
    ------
    InputError
        If the ratings are not normal about a level and a response.
    """

    def __init__(self, model: ExperimentModel, theta: FloatArray, rated: bool) -> None:
        options, posterior = model.options, model.posterior
        if options.scale not in (MAGNITUDE, SLIDER):
            raise InputError(
                f"design: expected magnitude estimates or positions on a slider, got {options.scale.name}: only "
                "these have a level and an error for each touch"
            )
        if posterior.fingers is not None or posterior.other_loads is not None or options.individual:
            raise InputError("design: expected raters with the typical finger and answers, under loads without errors")
        self.model, self.posterior, self.theta, self.rated = model, posterior, theta, rated
        self.parameters = posterior.rating_parameters(theta)
        """Parameters of the ratings at the draws."""
        self.named: Mapping[str, Any] = posterior.space.values(theta)
        """Every parameter by name in natural units: draws, or a number if it is fixed."""
        self.touch = posterior.space.touch(theta).broadcast(len(theta))
        """Parameters of the forward model at the draws [SI], each of shape (draws,)."""
        self.rate = posterior.mean_rate(theta)
        """Mean rates of the rated touches at the draws, shape (draws, columns)."""
        heavy = np.broadcast_to(heavier(posterior.observation.model.error, self.parameters), len(theta))[:, None]
        rounded = rounding(model.interpretation.intervals, options.scale.additive)
        self.noise = np.sqrt(self._squared("varsigma") * heavy + rounded)
        """Standard deviation of normal errors of ratings that tell as much about a level, shape (draws, 1)."""

    def _squared(self, name: str) -> FloatArray:
        """Return the variance of a parameter that is a spread, shape (draws, 1); 0 if the model lacks it."""
        spread = np.asarray(vars(self.parameters).get(name, 0.0), float)
        return np.broadcast_to(spread**2, len(self.theta))[:, None]

    @cached_property
    def levels(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Laws of levels given each draw: mean and variance of each rater's, (draws, raters), and of their mean's."""
        observed, prior = self.posterior.observation, self.posterior.observation.model.level
        design, noise2, tau2 = observed.design, self.noise**2, self._squared("tau")
        drive = observed.drive(self.rate, self.parameters)
        own = self.model.options.scale.additive(observed.values) - drive[:, design.condition]
        member = self.rated * np.eye(design.n_participants)[design.participant]
        count, total = member.sum(axis=0), own @ member
        weight = 1.0 / (noise2 + tau2 * count)
        variance = 1.0 / (prior.sd**-2 + (count * weight).sum(axis=1, keepdims=True))
        mean = variance * (prior.mean * prior.sd**-2 + (weight * total).sum(axis=1, keepdims=True))
        # each rater's level, drawn towards the mean of all
        of_each = mean + tau2 * weight * (total - count * mean)
        return of_each, tau2 * noise2 * weight + (noise2 * weight) ** 2 * variance, mean, variance

    def level(self, rater: str | int | None) -> tuple[FloatArray, FloatArray, int]:
        """Return mean and variance of a level at each draw, each (draws, 1), and the number of raters.

        Parameters
        ----------
        rater
            Name of a rater, new if the experiment does not have it; the mean level of a number of new raters, or (None)
            of all raters of the experiment, who are new before any rating.
        """
        mean, variance, new_mean, new_variance = self.levels
        names = self.model.data.ratings.participants
        if rater is None and self.rated:
            return mean.mean(axis=1)[:, None], variance.mean(axis=1)[:, None] / len(names), len(names)
        if rater in names:
            k = [names.index(rater)]
            return mean[:, k], variance[:, k], 1
        number = 1 if isinstance(rater, str) else rater or len(names)
        return new_mean, new_variance + self._squared("tau") / number, number

    def ratings(self, candidates: Candidates, rater: str | int | None) -> FurtherRatings:
        """Return the ratings of all touches of resolved candidates by a rater, or the mean ratings of several."""
        assert candidates.fabrics is not None
        fabrics, loads = candidates.fabrics, tuple(map(load_named, candidates.loads or ()))
        options, observed = self.model.options, self.posterior.observation
        cv = USUAL_CV if candidates.modulus_cv is None else candidates.modulus_cv
        laws = fabric_moduli(fabrics, options.readings.fabric_modulus, cv, options.unknown_modulus)
        finger, own = self.model.scene.finger, self.model.data.fabrics
        scene = scene_of(fabrics, loads, self.named, options.readings, noise=options.noise, finger=finger, moduli=laws)
        rated = same_fabrics(fabrics.names, scene.fabric_modulus, own.names, self.model.scene.fabric_modulus)
        modulus, modulus_sd = self._moduli_and_errors(laws, rated)
        rates = [
            np.asarray(scene.total_rate(self.touch, modulus * np.exp(step)) / scene.n_receptors)
            for step in (0.0, -MODULUS_STEP, MODULUS_STEP)
        ]
        response, softer, stiffer = (np.asarray(observed.drive_at(rate, self.rate, self.parameters)) for rate in rates)
        pressed, fabric = [scene.loads[k] for k in scene.load], [fabrics.names[k] for k in scene.fabric]
        radius = np.median(np.asarray(scene.contact(self.touch, modulus).radius), axis=0)
        table = pd.DataFrame(
            {
                "fabric": fabric,
                "to_obtain": rated[scene.fabric] < 0,
                "e_fab_kpa": scene.modulus * 1e-3,
                **{one.name: values / one.factor for one, values in loads_by_column(pressed).items()},
                "p_silent": (rates[0] == 0).mean(axis=0),
                "load": pressed,
                "within": radius <= HERTZ_LIMIT * scene.finger.radius,
            }
        )
        count = np.bincount(observed.design.fabric[observed.design.condition], minlength=len(own))
        told = np.where(rated >= 0, count[rated], 0)[scene.fabric] / self.noise**2
        omega2, (level, variance, number) = self._squared("omega"), self.level(rater)
        effects = [
            ([str(rater)] * len(table), 1.0, level, variance),
            (fabric, (stiffer - softer) / (2.0 * MODULUS_STEP), 0.0, modulus_sd[scene.fabric] ** 2),
            (fabric, 1.0, 0.0, omega2 / (1.0 + omega2 * told)),
        ]
        of, *parts = zip(*effects, strict=True)
        laws_of = (np.stack([np.broadcast_to(one, response.shape) for one in part]) for part in parts)
        noise = np.broadcast_to(self.noise / np.sqrt(number), response.shape)
        return FurtherRatings(table, np.array(of, object), response, noise, *laws_of)

    def _moduli_and_errors(self, laws: FabricModuli, rated: IndexArray) -> tuple[FloatArray, FloatArray]:
        """Return E_fab [Pa] of fabrics at the draws, and standard deviations of errors that the draws do not have.

        Errors of rated fabrics that the model samples are parameters; those of other fabrics are errors of ratings.
        """
        own = self.model.moduli
        batch = [own.batch[k] if k >= 0 else one for k, one in zip(rated, laws.batch, strict=True)]
        shared = own.factor(self.named, batch, np.random.default_rng(0))
        modulus = np.tile(laws.middle, (len(self.theta), 1)) * shared
        sampled = np.array([k >= 0 and own.laws[k] is not None for k in rated])
        drawn = self.posterior.space.modulus(self.theta)
        if drawn is not None:
            modulus[:, sampled] = drawn[:, rated[sampled]]
        # half the width of the middle 68 %: the standard deviation if the law is log-normal
        ends = [np.ones(2) if law is None else law.quantile(ndtr([-1.0, 1.0])) for law in laws.laws]
        return modulus, np.where(sampled, 0.0, 0.5 * np.diff(np.log(ends), axis=1)[:, 0])

    def quantities(self, turning: Mapping[str, Load]) -> dict[str, FloatArray]:
        """Return sampled parameters at the draws (their logs if all are positive), and turning points by name.

        Turning points are the logs of E_fab [Pa] under some loads, NaN where a draw has none.
        """
        names = self.posterior.space.names[: self.posterior.space.n_chain]
        drawn = {name: x for name, x in zip(names, self.theta.T, strict=False) if name not in SPREADS}
        found = {name: np.log(x) if (x > 0).all() else x for name, x in drawn.items()}
        for name, load in turning.items():
            turn = turning_points(self.model.scene, self.touch, 0.0, loads=[load])
            found[name] = np.where(turn.outcome == CurveShape.INTERIOR, np.log(turn.modulus), np.nan)[:, 0]
        return found


def outlook_of_run(result: Any, draws: int = DRAWS) -> Outlook:
    """Return the outlook of a finished run.

    Raises
    ------
    InputError
        If it is no run on ratings, has not converged, or its ratings are not levels of single touches.
    """
    require_run(result)
    fitted = Fitted(result, draws)
    return Outlook(fitted.model, fitted.theta, rated=True)


def require_run(result: Any) -> None:
    """Raise an error for what is no finished run: draws of another would mislead the choice."""
    from softness_bayes.results.result import Result

    require_kind("design", result, Result, "a Result, several of them, or an Experiment")
    if not result.has_ratings:
        raise InputError(f"{result.source}: a run without ratings cannot tell what ratings would add")
    if not result.provenance.ending.converged:
        raise InputError(
            f"{result.source}: the run has not converged, and its draws would mislead the choice; continue it with "
            "'resume'"
        )
