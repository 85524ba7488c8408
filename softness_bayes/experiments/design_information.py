"""Expected information of a design: predicted contraction of posteriors relative to priors, without sampling.

For each of several true parameter vectors drawn from the prior, the observation model is approximated by a normal law
whose mean and covariance are linear in the parameters, with the effects of participants and fabrics integrated out.
Parameters are expressed as normal scores of their priors, so that the prior is standard normal. Slopes are secants over
the width of the posterior, found by iteration, because tangents would mislead where the response is silent or has a
turning point nearby. The direction of ratings counts as known: of an exponent of either sign, it is the magnitude.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.special import ndtr, ndtri

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import magnitude
from softness_bayes.base.ranges import Range
from softness_bayes.base.readable import number
from softness_bayes.checking.identifiability import prior_moments
from softness_bayes.checking.inflection import CurveShape, turning_points
from softness_bayes.likelihood.contract import Parameters
from softness_bayes.likelihood.design import Design, Stated
from softness_bayes.likelihood.error_laws import STUDENT
from softness_bayes.likelihood.lists import Comparisons
from softness_bayes.likelihood.normal_rows import EffectGroup, normal_information
from softness_bayes.likelihood.orders import OrderModel
from softness_bayes.likelihood.plate import CompressionForces, plate_line
from softness_bayes.likelihood.scales import MAGNITUDE, PAIRS, RANKS, SLIDER, STANDARDISED
from softness_bayes.model.build import ExperimentModel
from softness_bayes.model.posterior import Posterior
from softness_bayes.touch.contact import Force, Indentation, Load, held
from softness_bayes.touch.scene import Scene

Array = NDArray[np.float64]
IndexArray = NDArray[np.intp]

STEPS = (2.0, 4.0, 8.0)
"""Moduli of three further fabrics, as multiples of the stiffest or fractions of the softest."""

HEAVIER, LIGHTER = 1.5, 0.5
"""Factor of a further load relative to the largest or smallest one."""

DEEPEST = Range(1e-6, 8e-3, "m")
"""Allowed indentations of a further load."""


class Planned(NamedTuple):
    """A design with the response in its conditions."""

    name: str
    """Description of the design; empty for that of the experiment."""
    design: Design
    scene: Scene
    """Fabrics and loads of the conditions; fabrics of the experiment come first."""
    n_fabrics: int
    """Number of fabrics of the experiment, whose moduli may be sampled; further fabrics have known moduli."""
    compared: Comparisons | None = None
    """Sets of conditions that are compared with one another; None if ratings are not comparisons."""

    @property
    def n_answers(self) -> int:
        """Number of ratings, places in lists, or answers to pairs."""
        if self.compared is None or not self.compared.paired:
            return self.design.n_rows
        return round(self.compared.times.sum())

    def rate(self, posterior: Posterior, theta: Array) -> Array:
        """Return the pad's mean rate N/N_ref [Hz] in every condition at points (points, d)."""
        touch, known = posterior.space.touch(theta), posterior.space.modulus(theta)
        if known is not None:
            own = self.scene.fabric_modulus[self.n_fabrics :]
            known = np.concatenate([known, np.broadcast_to(own, (*known.shape[:-1], own.size))], axis=-1)
        rate = self.scene.total_rate(touch, known) / self.scene.n_receptors
        return np.broadcast_to(rate, (*theta.shape[:-1], rate.shape[-1]))


def as_it_is(model: ExperimentModel) -> Planned:
    """Return the design of an experiment."""
    design, lists = model.posterior.observation.design, model.interpretation.intervals.lists
    compared = None if lists is None else Comparisons.of_rows(lists, design.condition)
    return Planned("", design, model.scene, len(model.data.fabrics.names), compared)


def others(model: ExperimentModel) -> list[Planned]:
    """Return designs with additional ratings: raters, repeats, a load, stiffer or softer fabrics."""
    now = as_it_is(model)
    d, people = now.design, now.design.n_participants
    twice = Design(np.tile(d.condition, 2), np.append(d.participant, d.participant + people), d.fabric, 2 * people)
    again = Design(np.tile(d.condition, 2), np.tile(d.participant, 2), d.fabric, people)
    double = now.compared and now.compared._replace(times=2.0 * now.compared.times)
    found: list[Planned | None] = [
        now._replace(name="twice as many raters", design=twice, compared=double),
        now._replace(name="every rating twice", design=again, compared=double),
        *(_with_load(now, factor) for factor in (HEAVIER, LIGHTER)),
    ]
    moduli = now.scene.modulus
    stiffer, softer = moduli.max() * np.array(STEPS), moduli.min() / np.array(STEPS)
    found.append(_with_fabrics(now, stiffer, f"three stiffer fabrics, up to {number(stiffer.max() / 1e3)} kPa"))
    found.append(_with_fabrics(now, softer, f"three softer fabrics, down to {number(softer.min() / 1e3)} kPa"))
    return [one for one in found if one is not None]


def _with_load(now: Planned, factor: float) -> Planned | None:
    """Return the design with the same fabrics rated under one more load; None if such a load is out of range."""
    scene, d = now.scene, now.design
    kind = Force if 2 * sum(isinstance(load, Force) for load in scene.loads) > len(scene.loads) else Indentation
    values = [held(load) for load in scene.loads if isinstance(load, kind)]
    value = factor * (max(values) if factor > 1 else min(values))
    if kind is not Force and not DEEPEST.low <= value < DEEPEST.high:
        return None
    load: Load = kind(float(f"{value:.3g}"))
    person, fabric = np.unique(np.stack([d.participant, d.fabric[d.condition]]), axis=1)
    fabrics = np.unique(fabric)
    extra = scene.n_conditions + np.searchsorted(fabrics, fabric)
    new = np.full(fabrics.size, len(scene.loads))
    wider = scene.under((*scene.loads, load), np.append(scene.fabric, fabrics), np.append(scene.load, new))
    compared = now.compared
    if compared and not compared.paired:
        own = Comparisons.of_rows(person, extra)
        compared = compared.with_others(own.members, own.times)
    return _extended(now, f"another load, {load}", wider, person, extra, compared)


def _with_fabrics(now: Planned, moduli: Array, name: str) -> Planned:
    """Return the design with further fabrics of known moduli, rated by all participants under the same loads."""
    scene, d = now.scene, now.design
    person, load = np.unique(np.stack([d.participant, scene.load[d.condition]]), axis=1)
    loads = np.unique(load)
    first = scene.n_conditions + np.arange(moduli.size)[:, None] * loads.size  # condition of each fabric's first load
    fabric = np.repeat(scene.fabric_modulus.size + np.arange(moduli.size), loads.size)
    every = np.append(scene.fabric, fabric), np.append(scene.load, np.tile(loads, moduli.size))
    compared = now.compared
    if compared and not compared.paired:
        # each list is extended by the further fabrics under its load
        further = first.T + np.searchsorted(loads, scene.load[compared.members[:, 0]])[:, None]
        compared = Comparisons(np.concatenate([further, compared.members], axis=1), compared.times)
    extra = first + np.searchsorted(loads, load)
    return _extended(now, name, scene.beside(moduli, *every), np.tile(person, moduli.size), extra.ravel(), compared)


def _extended(
    now: Planned, name: str, scene: Scene, person: IndexArray, condition: IndexArray, compared: Comparisons | None
) -> Planned:
    """Return a design with more rows, given by participant and condition of a scene that has more conditions.

    If ratings are pairs, each participant compares neighbours in a random circle of the conditions under a load. Pairs
    of two old conditions are left out.
    """
    d = now.design
    rows = np.append(d.condition, condition), np.append(d.participant, person)
    if compared and compared.paired:
        for load in np.unique(scene.load[condition]):
            here = scene.load[condition] == load
            new, old = np.unique(condition[here]), np.flatnonzero(now.scene.load == load)
            first, second = np.triu_indices(new.size + old.size, 1)
            every, some = np.append(new, old), first < new.size
            times = np.full(some.sum(), np.unique(person[here]).size * 2.0 / max(every.size - 1, 1))
            compared = compared.with_others(np.stack([every[first[some]], every[second[some]]], axis=1), times)
    return Planned(name, Design(*rows, scene.fabric, d.n_participants), scene, now.n_fabrics, compared)


TRUTHS, DRAWS = 16, 128
"""Number of true parameter vectors (the first is the prior median), and of draws of each expected posterior."""

PLACES, PRIOR_DRAWS = 64, 512
"""Numbers of these posterior draws, and of prior draws, for which turning points are computed."""

FEWEST_TRUTHS, CONDITIONS = 4, 400
"""Number of true vectors used for many conditions, and the number of conditions up to which all are used."""

ROUNDS = 3
"""Iterations of the secants."""

MOST_LOADS = 4
"""Largest number of loads with predicted turning points, evenly spaced among those of the design."""

NOT_FORESEEN = ("nu", "lapse")
"""Parameters of error laws that a normal approximation does not have."""

_REACH = 3.5  # largest normal score that is evaluated


class Expected(NamedTuple):
    """Expected posteriors of a design for several true parameter vectors."""

    names: tuple[str, ...]
    """Sampled parameters with predicted posteriors."""
    ratio: Array
    """Ratio of posterior to prior standard deviation in natural units, shape (truths, names)."""
    bits: Array
    """Expected information gained from prior to posterior [bits], shape (truths,)."""
    loads: tuple[str, ...]
    """Loads with predicted turning points."""
    turns: Array
    """Share of prior draws whose response has a turning point under each load, shape (loads,)."""
    place: Array
    """Ratio of posterior to prior standard deviation of ln E_fab at the turning point, (truths, loads); NaN without
    one."""
    factor: Array
    """Factor between the expected E_fab at the turning point and its 90 % limits, (truths, loads)."""


def foresee(model: ExperimentModel, planned: Planned, truths: Array | None = None) -> Expected:
    """Return the expected posteriors of a design.

    Parameters
    ----------
    model
        The model of the experiment, whose posterior gives parameters and priors.
    planned
        The design: that of the experiment (`as_it_is`), or another one.
    truths
        True parameter vectors theta, shape (truths, d); by default the prior median and prior draws.

    Raises
    ------
    InputError
        If the ratings are categories, raters have individual fingers, or loads have errors.
    """
    posterior = model.posterior
    known = model.options.scale in (MAGNITUDE, SLIDER, STANDARDISED, RANKS, PAIRS)
    if not known or posterior.fingers is not None or posterior.other_loads is not None:
        raise InputError(
            "design: the prediction covers magnitude estimates, sliders, z-scores, ranks and pairs, for the "
            "typical finger under loads without errors"
        )
    return _Foresight(model, planned, truths).found()


class _Foresight:
    """The computation of `foresee`."""

    def __init__(self, model: ExperimentModel, planned: Planned, truths: Array | None) -> None:
        self.model, self.planned = model, planned
        self.posterior: Posterior = model.posterior
        self.space = self.posterior.space
        # widths are alike for either sign of an exponent; a normal law would reach across the gap at 0
        self.priors = [magnitude(p.prior) for p in self.space.sampled]
        self.rounding = rounding(model.interpretation.intervals, model.options.scale.additive)
        rng = np.random.default_rng(0)
        few = TRUTHS * CONDITIONS // max(model.scene.n_conditions, CONDITIONS)
        drawn = self._scores(self.space.draw_prior(rng, TRUTHS - 1))
        self.truths = np.vstack([np.zeros(drawn.shape[1]), drawn])[: max(few, FEWEST_TRUTHS)]
        if truths is not None:
            self.truths = self._scores(truths)
        self.slope = np.r_[ndtri(0.75), np.abs(rng.standard_normal(len(self.truths) - 1))]
        self.noise = rng.standard_normal((DRAWS, drawn.shape[1]))
        self.before = self.space.draw_prior(rng, PRIOR_DRAWS)

    def _scores(self, theta: Array) -> Array:
        columns = zip(self.priors, np.abs(theta.T), strict=True)
        return np.clip(np.stack([ndtri(prior.cumulative(x)) for prior, x in columns], axis=-1), -_REACH, _REACH)

    def _natural(self, scores: Array) -> Array:
        share = ndtr(np.clip(scores, -_REACH, _REACH))
        columns = [
            np.minimum(prior.quantile(share[..., k]), p.largest * (1.0 - 1e-9))
            for k, (p, prior) in enumerate(zip(self.space.sampled, self.priors, strict=True))
        ]
        return np.stack(columns, axis=-1)

    def found(self) -> Expected:
        truths, dimension = self.truths.shape
        covariance = np.broadcast_to(np.eye(dimension), (truths, dimension, dimension))
        for _ in range(ROUNDS):
            root = np.asarray(np.linalg.cholesky(covariance), float)
            centre = self.truths - np.einsum("tij,tj->ti", covariance, self.truths)
            precision: Array = np.eye(dimension) + self._information(centre, root)
            covariance = np.asarray(np.linalg.inv(precision), float)
        centre = self.truths - np.einsum("tij,tj->ti", covariance, self.truths)
        root = np.linalg.cholesky(covariance)
        theta = self._natural(centre[:, None] + np.einsum("tij,nj->tni", root, self.noise))
        kept = [k for k, p in enumerate(self.space.sampled) if p.name not in NOT_FORESEEN]
        prior_sd = np.array([prior_moments(prior)[1] for prior in self.priors])
        # compared with the same normal numbers under the prior, so that their sampling error cancels
        alone = self._natural(self.noise).std(axis=0) / prior_sd
        ratio = theta.std(axis=1) / prior_sd / alone
        bits = -np.log2(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
        turn = self._turning(theta[:, :PLACES])
        return Expected(tuple(self.space.names[k] for k in kept), ratio[:, kept], bits, *turn)

    def _turning(self, theta: Array) -> tuple[tuple[str, ...], Array, Array, Array]:
        """Return the loads, the prior share of turning points, and width ratio and factor of their positions."""
        scene = self.model.scene
        used = np.unique(scene.load)
        shown = used[np.unique(np.linspace(0, used.size - 1, MOST_LOADS).round().astype(int))]
        loads = [scene.loads[k] for k in shown]
        fabrics = np.unique(scene.fabric)
        pairs = np.repeat(fabrics, len(loads)), np.tile(np.arange(len(loads)), fabrics.size)
        small = scene.under(loads, *pairs)
        log_before = self._log_place(small, self.before)
        log_after = self._log_place(small, theta.reshape(-1, theta.shape[-1])).reshape(*theta.shape[:2], -1)
        turns = np.isfinite(log_before).mean(axis=0)
        count = np.isfinite(log_after).sum(axis=1)
        with warnings.catch_warnings(action="ignore"):  # under some loads, few draws or none have a turning point
            width = np.where(count >= 0.5 * PLACES, np.nanstd(log_after, axis=1, ddof=1), np.nan)
            place = width / np.nanstd(log_before, axis=0, ddof=1)
        return tuple(map(str, loads)), turns, place, np.exp(ndtri(0.95) * width)

    def _log_place(self, scene: Scene, theta: Array) -> Array:
        found = turning_points(scene, self.space.touch(theta).broadcast(len(theta)), 0.0)
        return np.where(found.outcome == CurveShape.INTERIOR, np.log(found.modulus), np.nan)

    def _information(self, centre: Array, root: Array) -> Array:
        """Return the information on scores about centres (truths, d), over steps along `root`, (truths, d, d)."""
        steps = np.swapaxes(root, 1, 2)
        points = np.concatenate([centre[:, None], centre[:, None] + steps, centre[:, None] - steps], axis=1)
        theta, back = self._natural(points), np.asarray(np.linalg.inv(root), float)
        compared = self.planned.compared
        found = self._of_ratings(theta, back) if compared is None else self._of_comparisons(compared, theta, back)
        plate = self.posterior.compression
        return found if plate is None else found + self._of_forces(plate, theta, back)

    def _of_comparisons(self, compared: Comparisons, theta: Array, back: Array) -> Array:
        model: OrderModel = self.posterior.observation.model
        parameters, drive = self._driven(theta)
        drive = drive / _at(model.noise_of(parameters), theta)[..., None]
        slopes = np.einsum("tkc,tkd->tcd", _secants(drive), back)
        guesses = _at(model.guesses(parameters), theta)[:, 0]
        parts = zip(drive[:, 0], slopes, guesses, strict=True)
        return np.stack([model.information(compared, *part) for part in parts])

    def _driven(self, theta: Array) -> tuple[Parameters, Array]:
        """Return the rating parameters at points (truths, k, d), and the drives of the design's conditions there."""
        parameters = self.posterior.rating_parameters(theta)
        rate = self.planned.rate(self.posterior, theta.reshape(-1, theta.shape[-1])).reshape(*theta.shape[:2], -1)
        drive = self.posterior.observation.model.drive(self.planned.design, rate, parameters)
        return parameters, np.broadcast_to(drive, (*theta.shape[:2], rate.shape[-1]))

    def _of_ratings(self, theta: Array, back: Array) -> Array:
        model, design = self.posterior.observation.model, self.planned.design
        parameters, drive = self._driven(theta)
        slopes = np.einsum("tkc,tkd->tcd", _secants(drive), back)
        sd = _at(np.sqrt(np.asarray(parameters.varsigma, float) ** 2 * heavier(model.error, parameters)), theta)
        person, fabric, row = design.participant, design.fabric[design.condition], np.arange(design.n_rows)
        people, things = design.n_participants, design.n_fabrics if "omega" in model.needs else 0
        spreads = {"tau": slice(0, people)} | ({"omega": slice(people, people + things)} if things else {})
        columns = [person, *([people + fabric] if things else []), np.full(row.size, people + things)]
        indices = np.tile(row, len(columns)), np.concatenate(columns)
        effects = csr_array((np.ones(indices[0].size), indices), shape=(row.size, people + things + 1))
        found = []
        for t in range(len(theta)):
            error = np.sqrt(sd[t, 0] ** 2 + self.rounding)
            error_slope = _slope(sd, back, t) * sd[t, 0] / error
            if model.scale == STANDARDISED:
                line = np.stack([np.ones(row.size), drive[t, 0, design.condition]], axis=-1)
                along = self.slope[t] * slopes[t, design.condition]
                found.append(normal_information(line, along, np.ones(2), error, error_slope))
            else:
                variances = np.full(effects.shape[1], model.level.sd**2)
                groups = [_group(one, _at(getattr(parameters, name), theta), back, t) for name, one in spreads.items()]
                along = slopes[t, design.condition]
                found.append(normal_information(effects, along, variances, error, error_slope, groups))
        return np.stack(found)

    def _of_forces(self, plate: CompressionForces, theta: Array, back: Array) -> Array:
        skin, n = self.posterior.parameters_of(plate, theta), plate.n_fingers
        skin = skin.each(lambda value: np.broadcast_to(value, theta.shape[:-1]))
        drive = plate.drive(np.empty((*theta.shape[:2], 0)), skin)
        slopes = np.einsum("tkc,tkd->tcd", _secants(drive), back)
        along = plate_line(plate.indentation, plate.model.shape, plate.model.displacement).slope
        member = np.eye(n)[plate.finger]
        effects = np.concatenate([member, member * along[:, None]], axis=1)
        spreads, sd = ((slice(0, n), skin.tau_b), (slice(n, 2 * n), skin.tau_m)), _at(skin.varsigma_f, theta)
        found = []
        for t in range(len(theta)):
            groups = [_group(columns, _at(spread, theta), back, t) for columns, spread in spreads]
            of_noise = sd[t, 0], _slope(sd, back, t)
            found.append(normal_information(effects, slopes[t], np.zeros(2 * n), *of_noise, groups))
        return np.stack(found)


def _slope(values: Array, back: Array, t: int) -> Array:
    """Return the slopes (d,) of a quantity, given at the points of all truths, at one of them."""
    return np.asarray(_secants(values[t : t + 1])[0] @ back[t])


def _group(columns: slice, sd: Array, back: Array, t: int) -> EffectGroup:
    """Return the effects of some columns, with their standard deviation at the points of all truths."""
    return EffectGroup(columns, sd[t, 0], _slope(sd, back, t))


def _secants(values: Array) -> Array:
    """Return half the differences along the steps, (truths, d, ...), of values (truths, 1 + 2 d, ...)."""
    d = (values.shape[1] - 1) // 2
    return 0.5 * (values[:, 1 : 1 + d] - values[:, 1 + d :])


def _at(value: Any, theta: Array) -> Array:
    return np.broadcast_to(np.asarray(value, float), theta.shape[:2])


def heavier(law: Any, parameters: Parameters) -> Any:
    """Return the variance, relative to varsigma², of normal errors with the same information about the mean."""
    if law == STUDENT:
        nu = np.asarray(parameters.nu, float)
        return (nu + 3.0) / (nu + 1.0)
    return 1.0 / (1.0 - np.asarray(parameters.lapse, float)) if law.lapses else 1.0


def rounding(said: Stated, additive: Callable[[Any], Array]) -> float:
    """Return the mean variance, on the additive scale, of ratings within the intervals that they represent."""
    if said.exact:
        return 0.0
    low, high = said.ends(said.values)
    inside = (low > 0) & (high < said.end)
    widths = additive(high[inside]) - additive(low[inside])
    return float((widths**2).mean() / 12.0) if widths.size else 0.0
