"""Draws of a run with replicated ratings, and the groups of a result as variables with axes and units."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base import arviz_bridge
from softness_bayes.checking.check_table import NEW_PARTICIPANTS
from softness_bayes.checking.exactness import resample
from softness_bayes.checking.inflection import STORED, Inflection
from softness_bayes.checking.layout import LOAD_GROUP, UNCERTAIN
from softness_bayes.checking.quantities import EXCESS, excess_of_plateau, plateau
from softness_bayes.likelihood.contract import Effects, Parameters, RatingsLikelihood, RatingsModel
from softness_bayes.likelihood.layout import Layout, merge
from softness_bayes.likelihood.pieces import pieces
from softness_bayes.likelihood.scales import FREE, Scale
from softness_bayes.model.posterior import Density, Posterior
from softness_bayes.parameters.declared import FABRIC_MODULUS
from softness_bayes.parameters.space import ParameterSpace
from softness_bayes.sampler.chains import Chains
from softness_bayes.sampler.workers import Workers
from softness_bayes.touch.load_groups import LoadGroups, groups_of
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.scene import Scene

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from softness_bayes.data import Experiment

Array = NDArray[np.float64]

DRAWS = 2000
"""Number of evenly thinned draws stored in the file, about the effective size of a run that has just converged, so that
more would say little; convergence is checked on all draws."""

CURVES = 400
"""Number of posterior draws with stored response curves."""

REPLICATES = 500
"""Number of draws with replicated ratings and with the density of each rating given all the others."""

ROOM, LEAST_REPLICATES = 20_000_000, 100
"""Largest number of replicated ratings; of large tables fewer draws have them, but not fewer than the least number."""

PRIOR_DRAWS = 1000
"""Number of prior draws."""

FIRST_SHARE = 0.3
"""Share of these numbers in a first look."""

REWEIGHT_DRAWS = 1000
"""Number of draws that are weighted if a run uses exact weights."""


CHUNK = 250
"""Largest number of draws whose effects are drawn in one call: responses of individual fingers are large."""


ROWS = ("rating_row",)
"""Axis of variables with one value per rating."""


class Subset(NamedTuple):
    """A subset of the draws, along one axis."""

    theta: Array
    mean_rate: Array
    parameters: Parameters
    effects: Effects


class RatedDraws:
    """The draws of one run on ratings, shared by all groups of its result, with effects given each draw.

    Parameters
    ----------
    experiment, posterior
        The data, and the density that was sampled.
    scale
        Scale of the ratings, with the ends of a slider.
    kept
        The chains without their burn-in, thinned.
    theta
        Their points, shape (chains, draws, dimension).
    rng
        Random generator of the effects and of draws of the prior, in this order.
    workers
        Processes with the posterior, which draw the effects: these may need an integral for each draw.
    share
        Share of the usual numbers of replicates and curves.
    log_weight
        Log weights of `REWEIGHT_DRAWS` evenly spaced draws, if the result is that of weighted draws.

    Attributes
    ----------
    mean_rate
        N/N_ref [Hz] at the draws, shape (chains, draws, conditions).
    prior
        Draws of the prior, shape (`PRIOR_DRAWS`, dimension).
    load_groups, load_axis, shown_loads
        Groups of loads for checks and figures (with few loads, each load is a group), the name of the axis of variables
        stored for each of them, and their representative loads.
    replicates, curves
        Numbers of draws with replicated ratings (as many as fit into `ROOM`), and with stored response curves.
    rises
        Posterior probability that ratings rise with firing, and its Monte-Carlo standard error from the ensembles; NaN
        if only one direction was sampled.
    """

    def __init__(
        self,
        experiment: Experiment,
        posterior: Posterior,
        scale: Scale,
        kept: Chains,
        theta: Array,
        rng: np.random.Generator,
        workers: Workers,
        share: float = 1.0,
        log_weight: Array | None = None,
    ) -> None:
        self.experiment, self.posterior, self.scale, self.kept, self.theta = experiment, posterior, scale, kept, theta
        self.share, self.log_weight = share, log_weight
        self.scene: Scene = posterior.scene
        self.ratings: RatingsLikelihood = posterior.observation
        self.model: RatingsModel = self.ratings.model
        self.mean_rate = posterior.mean_rate(theta)
        flat = theta.reshape(-1, theta.shape[-1])
        chunks = pieces(len(flat), 1, CHUNK)
        parts = workers.map(_effects, [(one, flat[k]) for one, k in zip(rng.spawn(len(chunks)), chunks, strict=True)])
        self.effects = Effects.joined(parts).each(lambda each: each.reshape(*theta.shape[:-1], *each.shape[1:]))
        self.prior = posterior.space.draw_prior(rng, int(share * PRIOR_DRAWS))
        self.load_groups: LoadGroups = groups_of(experiment.ratings.loads)
        self.load_axis = LOAD_GROUP if self.load_groups.merged else "load"
        self.shown_loads = [self.scene.loads[k] for k in self.load_groups.at]
        self.replicates = min(int(share * REPLICATES), max(LEAST_REPLICATES, ROOM // self.ratings.design.n_rows))
        self.curves = int(share * CURVES)
        self.rises = np.nan, np.nan
        if self.model.direction == FREE:
            up = (np.asarray(posterior.space.value("gamma", theta)) > 0).mean(axis=1)
            shares = [up[kept.ensemble == one].mean() for one in np.unique(kept.ensemble)]
            error = float(np.std(shares, ddof=1) / np.sqrt(len(shares))) if len(shares) > 1 else np.nan
            self.rises = float(up.mean()), error
        self._subsets: dict[int, Subset] = {}  # responses of individual fingers take a second

    def picked(self, size: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return chain and draw indices of evenly spaced draws, or of draws resampled by their exact weights."""
        if self.log_weight is None:
            return evenly(self.theta.shape, size)
        chosen = resample(self.log_weight, size)
        chain, draw = evenly(self.theta.shape, REWEIGHT_DRAWS)
        return chain[chosen], draw[chosen]

    def subset(self, size: int) -> Subset:
        """Return the draws at `picked`."""
        if size not in self._subsets:
            index = self.picked(size)
            theta = self.theta[index]
            self._subsets[size] = Subset(
                theta,
                self.posterior.response(theta) if self.posterior.fingers else self.mean_rate[index],
                self.posterior.rating_parameters(theta),
                self.effects.part(index),
            )
        return self._subsets[size]

    def touch(self, theta: Array) -> TouchParameters:
        """Return the parameters of the forward model at theta, fixed ones broadcast to the shape of sampled ones."""
        return self.posterior.space.touch(theta).broadcast(theta.shape[:-1])

    def touches(self, theta: Array) -> tuple[TouchParameters, Array | None]:
        """Return the arguments for a scene at theta: parameters of the forward model, and moduli if uncertain."""
        return self.touch(theta), self.posterior.space.modulus(theta)


def _effects(posterior: Posterior, rng: np.random.Generator, theta: Array) -> Effects:
    return posterior.observation.draw_effects(rng, posterior.response(theta), posterior.rating_parameters(theta))


class Variable(NamedTuple):
    """A variable of a group: values (chain, draw first in groups with draws), further axes, unit."""

    values: NDArray[Any]
    dims: tuple[str, ...] = ()
    units: str = ""


Groups = dict[str, dict[str, Variable]]
"""Variables by group and name; variables of the same name have the same axes and unit in every group."""


class Part(NamedTuple):
    """A part of a result: variables by group, coordinates of their axes, provenance and tables."""

    groups: Groups
    coordinates: Mapping[str, ArrayLike] = {}
    attributes: Mapping[str, Any] = {}
    tables: Mapping[str, pd.DataFrame] = {}

    @property
    def tree(self) -> xr.DataTree:
        """The groups as those of a result."""
        every = {name: variable for group in self.groups.values() for name, variable in group.items()}
        return arviz_bridge.to_tree(
            {group: {name: v.values for name, v in variables.items()} for group, variables in self.groups.items()},
            {name: v.dims for name, v in every.items()},
            self.coordinates,
            self.attributes,
            {name: {"units": v.units} for name, v in every.items() if v.units},
        )


def joined(*parts: Part) -> Part:
    """Return a part with everything of several parts."""
    groups: Groups = {}
    for name, variables in (one for part in parts for one in part.groups.items()):
        groups.setdefault(name, {}).update(variables)

    def every(field: str) -> dict[str, Any]:
        return {name: value for part in parts for name, value in getattr(part, field).items()}

    return Part(groups, *map(every, Part._fields[1:]))


def named(space: ParameterSpace, values: Array, units: Sequence[str] | None = None) -> dict[str, Variable]:
    """Return values at points (..., dimension) by parameter name; those of sampled moduli form one variable.

    Their units are those of the parameters, unless others are given.
    """
    units = [p.unit for p in space.sampled] if units is None else units
    found = {space.names[k]: Variable(values[..., k], units=units[k]) for k in range(space.n_chain)}
    if space.moduli is not None and space.moduli.uncertain:
        found[FABRIC_MODULUS] = Variable(values[..., space.n_chain :], (UNCERTAIN,), units[-1])
    return found


def sampled_groups(density: Density, kept: Chains, theta: Array, data: str) -> Groups:
    """Return the draws of the sampled parameters and their densities.

    Parameters
    ----------
    density
        The sampled density.
    kept, theta
        The draws, and their points theta, shape (chains, draws, dimension).
    data
        Name of the joint log-likelihood in its group.
    """
    log_prior = density.space.log_prior(theta)
    # a density in natural units, not in the sampler's own coordinates
    height = kept.by_walker(kept.log_density - density.space.log_jacobian(kept.coordinates))
    acceptance, ensemble = (np.broadcast_to(v.reshape(-1, 1), height.shape) for v in (kept.accepted, kept.ensemble))
    return {
        "posterior": named(density.space, theta),
        "sample_stats": {
            "lp": Variable(height),
            "acceptance_rate": Variable(acceptance),
            arviz_bridge.ENSEMBLE: Variable(ensemble),
        },
        "log_prior": named(density.space, log_prior, [""] * density.space.dimension),
        "log_likelihood_joint": {data: Variable(height - log_prior.sum(axis=-1))},
    }


def turning_variables(turn: Inflection, shape: tuple[int, int], axis: str) -> dict[str, Variable]:
    """Return turning points of the response as variables along an axis of loads; draws have `shape` (chains, draws)."""
    found, fields = {}, list[NDArray[Any]](turn)
    for (name, factor, unit), values in zip(STORED.values(), fields, strict=True):
        of_draws = values.reshape(*shape, values.shape[-1])
        found[name] = Variable(of_draws.astype(np.int8) if factor is None else of_draws / factor, (axis,), unit)
    return found


def evenly(shape: tuple[int, ...], size: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return chain and draw indices of draws evenly spaced over a run, with the walkers interleaved in time.

    Parameters
    ----------
    shape
        Shape of the run's draws, (chains, draws, ...).
    size
        Number of draws, if the run has enough.
    """
    chains, stored = shape[:2]
    flat = np.linspace(0, chains * stored - 1, min(size, chains * stored)).astype(int)
    return flat % chains, flat // chains


def replicated_groups(rng: np.random.Generator, draws: RatedDraws) -> Groups:
    """Draw replicated ratings of the same and of new participants, and those of the prior.

    Ratings of the same participants are also drawn, with the same noise, for a response that stays at its peak beyond
    the turning point; the excess of their means is stored.
    """
    few, ratings = draws.subset(draws.replicates), draws.ratings
    drive, twin = ratings.drive(few.mean_rate, few.parameters), copy.deepcopy(rng)
    again = _rated(rng, draws, drive, few)
    strangers = ratings.with_new_participants(rng, few.parameters, few.effects)
    anew = _rated(rng, draws, drive, few._replace(effects=strangers))
    layout, groups = rated_layout(draws), draws.load_groups
    # with many loads, single loads have too few fabrics, so levelling is applied to groups of loads
    held = _held_at_peak(draws, replace(layout, load=groups.of[layout.load]))
    level = ratings.drive_at(held, few.mean_rate, few.parameters)
    if level.shape != drive.shape:  # under other loads, the drive of a condition falls by as much
        level = drive + (level - drive[..., : level.shape[-1]])[..., ratings.condition_of_rate]
    grouped = merge(layout, groups.of)[0]
    excess = excess_of_plateau(grouped, again, _rated(twin, draws, level, few))
    theta = draws.prior[: draws.replicates]
    rate, parameters = draws.posterior.response(theta), draws.posterior.rating_parameters(theta)
    before = Subset(theta, rate, parameters, ratings.new_effects(rng, parameters, theta.shape[:1]))
    prior = _rated(rng, draws, ratings.drive(rate, parameters), before)
    filed = draws.scale.filed
    return {
        "posterior_predictive": {
            "rating": Variable(filed(again)[None], ROWS),
            NEW_PARTICIPANTS: Variable(filed(anew)[None], ROWS),
        },
        "constant_data": {EXCESS: Variable(excess[grouped.design.condition], ROWS)},
        "prior": named(draws.posterior.space, draws.prior[None]),
        "prior_predictive": {"rating": Variable(filed(prior)[None], ROWS)},
    }


def rated_layout(draws: RatedDraws) -> Layout:
    """Return the design, with each condition's modulus: of one that is sampled the median of its draws."""
    model, conditions = draws.model, draws.experiment.ratings.conditions
    space, modulus = draws.posterior.space, draws.scene.modulus
    drawn = space.modulus(draws.theta)
    if drawn is not None and space.moduli is not None:
        places = [space.moduli.names.index(name) for name in draws.experiment.ratings.fabrics]
        modulus = np.median(drawn, axis=(0, 1))[places][conditions.fabric]
    rises = draws.rises[0]
    sign = model.direction.sign if np.isnan(rises) else (1.0 if rises >= 0.5 else -1.0)
    return Layout(draws.ratings.design, modulus, conditions.load, sign, model.scale)


def _held_at_peak(draws: RatedDraws, layout: Layout) -> Array:
    """Return the responses at the draws with replicates, held at their peak; those of fingers each at its own."""
    rate, width = draws.subset(draws.replicates).mean_rate, draws.scene.n_conditions
    if draws.posterior.fingers is None:
        return plateau(layout, rate[..., :width])
    return plateau(layout, rate.reshape(len(rate), -1, width)).reshape(rate.shape)


def _rated(rng: np.random.Generator, draws: RatedDraws, drive: Array, some: Subset) -> Array:
    """Return a rating for every row at each of some draws, drawn a few draws at a time."""
    made = np.empty((len(drive), draws.ratings.design.n_rows))
    for k in pieces(*made.shape):
        made[k] = draws.ratings.replicate(rng, drive[k], some.parameters.part(k), some.effects.part(k))
    return made
