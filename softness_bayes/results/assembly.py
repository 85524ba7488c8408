"""From the draws of a run to its result: predictions, replicates, checks, tables and provenance."""

from __future__ import annotations

import copy
import platform
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes import arviz_bridge
from softness_bayes.checking.check_table import LOO_PIT, NEW_PARTICIPANTS, PARETO_K
from softness_bayes.checking.checks import FabricCheck, check_fabrics
from softness_bayes.checking.exactness import EXACT_RATES, SAME_RATES, Exactness, compare, resample
from softness_bayes.checking.inflection import (
    LEAST_DROP,
    curve_scene,
    find_inflection,
    response_curves,
    turning_points,
)
from softness_bayes.checking.levelled import compare_levelled, levelled
from softness_bayes.checking.misfit import TYPICAL
from softness_bayes.checking.quantities import ExponentCheck, Layout, LooPit, check_exponents, loo_pit
from softness_bayes.checking.reproduction import LEVELLED, LEVELLED_NAMES, SHORTFALL
from softness_bayes.data import Experiment
from softness_bayes.data.columns import EFFECTIVE_MODULUS, POISSON_RATIO
from softness_bayes.data.ratings import LOAD_COLUMNS
from softness_bayes.likelihood.magnitude import RatingParameters
from softness_bayes.likelihood.pieces import part_of, pieces
from softness_bayes.likelihood.scales import ObservedRatings
from softness_bayes.model.posterior import Posterior
from softness_bayes.parameters.declared import EVERY_PARAMETER, PARAMETERS
from softness_bayes.parameters.space import ParameterSpace
from softness_bayes.results.groups import (
    Groups,
    Variable,
    evenly,
    merged,
    named,
    sampled_groups,
    tree_of,
    turning_variables,
)
from softness_bayes.results.pictures import membrane_illustration, touch_illustration
from softness_bayes.results.plate import plate_attributes, plate_coordinates, plate_groups
from softness_bayes.results.summary import reweighted, summarise
from softness_bayes.sampler.chains import Chains
from softness_bayes.sampler.diagnostics import Verdict
from softness_bayes.sampler.workers import Workers
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.scene import Scene

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

Array = NDArray[np.float64]

DRAWS_PER_WALKER = 100
"""Draws of each walker that the file keeps, evenly thinned; convergence is judged on all."""

CURVES = 400
"""Posterior draws whose response curves are stored."""

REPLICATES = 500
"""Draws with replicated ratings, and with what each rating is given all the others."""

PICKED = {"posterior_predictive": REPLICATES, "log_likelihood_loo": REPLICATES, "predictions": CURVES}
"""Groups that hold some of the posterior's draws, and how many; their coordinates say which."""

TURNING = 4000
"""Draws, about, of which turning points are stored: so many of every walker."""

PRIOR_DRAWS = 1000
"""Draws of the prior."""

ILLUSTRATED = 64
"""Posterior draws whose touches are stored in detail."""

EXACT_DRAWS = 200
"""Posterior draws at which the log-likelihood is compared with an exact one."""

EXACT_PARTS = 4
"""Tasks that these comparisons are divided into, for as many processes."""

REWEIGHT_DRAWS = 1000
"""Draws that are weighted where a run asks for exact weights."""

ERROR_DRAWS = 32
"""Posterior draws at which the scene is compared with a finer one."""

LIBRARIES = ("softness-bayes", "numpy", "scipy", "emcee", "arviz", "xarray")


class Draws(NamedTuple):
    """Some draws, one axis for all of them."""

    theta: Array
    mean_rate: Array
    parameters: RatingParameters
    effects: Any
    """As the rating model draws them."""


def exact_log_likelihood(posterior: Posterior, theta: Array) -> Array:
    """Return the log-likelihood at points theta with exact firing rates and a finer quadrature, shape (points,)."""
    if not isinstance(posterior.scene, Scene):
        raise TypeError("the exact likelihood is that of a compiled scene")
    return replace(posterior, scene=posterior.scene.exact()).log_likelihood(theta)


class Assembly:
    """All that is computed from the draws of one run.

    Parameters
    ----------
    experiment, posterior
        The data, and the density that was sampled.
    chains, verdict
        The draws, and whether they have converged.
    rng
        Source of everything drawn afterwards.
    workers
        With `posterior` as their resident: the exact likelihood is computed there, beside everything else.
    reweight
        Whether summary, predictions and replicates are those of draws weighted by the exact likelihood.
    """

    def __init__(
        self,
        experiment: Experiment,
        posterior: Posterior,
        chains: Chains,
        verdict: Verdict,
        rng: np.random.Generator,
        workers: Workers,
        reweight: bool = False,
    ) -> None:
        if not isinstance(posterior.scene, Scene) or not isinstance(posterior.observation, ObservedRatings):
            raise TypeError("a result is assembled from a compiled scene and ratings")
        self.experiment, self.posterior, self.verdict, self.rng = experiment, posterior, verdict, rng
        self.scene, self.ratings = posterior.scene, posterior.observation
        self.kept = chains.kept(verdict.burn_in, DRAWS_PER_WALKER)
        self.theta = self.kept.by_walker(posterior.natural(self.kept.coordinates))
        self.compared = self.theta[evenly(self.theta.shape, REWEIGHT_DRAWS if reweight else EXACT_DRAWS)]
        # in parts that do not depend on the number of processes, nor then do the last bits
        self._exact = [workers.start(exact_log_likelihood, part) for part in np.array_split(self.compared, EXACT_PARTS)]
        self.mean_rate = posterior.mean_rate(self.theta)
        self.parameters = posterior.rating_parameters(self.theta)
        self.effects = self.ratings.draw_effects(rng, self.mean_rate, self.parameters)
        model: Any = self.ratings.model
        self.model = model
        self.grid = curve_scene(self.scene)
        self.prior = posterior.space.draw_prior(rng, PRIOR_DRAWS)
        self.reweight = reweight
        self.error = self._error()

    def tree(self, attributes: Mapping[str, Any]) -> xr.DataTree:
        """Return the groups of the result, with `attributes` as their provenance."""
        check, exponents, pit = self._fabric_check(), self._exponent_check(), self._loo_pit()
        replicated = self._predictive_groups()
        after: Groups = {
            **self._prior_groups(),
            "predictions": self._predictions(),
            **self._turning_groups(),
            "observed_data": {"rating": Variable(self.experiment.ratings.rating, ("rating_row",))},
            "constant_data": self._constants(pit),
        }
        # last of all, for it waits for the exact likelihood
        groups: Groups = {**self._posterior_groups(), **after}
        plate, plate_found = self._plate()
        found = {
            "numerical_error": self.error,
            "inflection_least_drop": max(LEAST_DROP, 3.0 * self.error),
            "fabric_check": check.sentence(self._condition_names()),
            "fabric_p_value": check.p_value,
            "firing_error": self._firing_error(),
            "exactness": self.exactness.sentence(),
            "exactness_sd": self.exactness.sd,
            "exactness_largest": self.exactness.largest,
            "exactness_efficiency": self.exactness.efficiency,
            "exactness_pareto_k": self.exactness.pareto_k,
            "exact_reweight": int(self.reweight),
            "fabric_deviation": check.deviation,
            "condition_p_value": check.condition_p_value,
            "condition_deviation": check.condition_deviation,
            "condition_noticed": check.noticed,
            "exponent_check": exponents.sentence,
            "exponent_p_value": exponents.p_value,
            "exponent_deviation": exponents.deviation,
            **self._shares(),
            **_held_eps(self.posterior.space),
            **plate_found,
        }
        shown, axes = self._illustrations(groups["predictions"]["inflection_e_fab_kpa"].values[0] * 1e3)
        tree = tree_of(
            merged(groups, replicated, plate, shown), {**self._coordinates(), **axes}, {**attributes, **found}
        )
        for group, size in PICKED.items():
            chain, draw = self._picked(size)
            which = {"posterior_chain": ("draw", chain), "posterior_draw": ("draw", draw)}
            tree[group].dataset = tree[group].to_dataset().assign_coords(which)
        return tree

    def summary(self) -> pd.DataFrame:
        """Return the table of the parameters and of what all ratings share, from the draws that are kept."""
        ensembles, stored, walkers = self.kept.log_density.shape
        levels = {n: v for n, (v, dims) in self.model.named_effects(self.effects).items() if not dims}
        draws = np.concatenate([self.theta, np.stack([*levels.values()], axis=-1)], axis=-1)
        apart = draws.reshape(ensembles, walkers, stored, -1).swapaxes(1, 2)
        table = summarise((*self.posterior.names, *levels), apart)
        if not self.reweight:
            return table
        return reweighted(table, draws[evenly(self.theta.shape, REWEIGHT_DRAWS)], self.exactness.log_weight)

    def _picked(self, size: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return chain and draw of evenly spaced draws, or of as many in proportion to their exact weights."""
        if not self.reweight:
            return evenly(self.theta.shape, size)
        chosen = resample(self.exactness.log_weight, size)
        chain, draw = evenly(self.theta.shape, REWEIGHT_DRAWS)
        return chain[chosen], draw[chosen]

    def _pick(self, size: int) -> Draws:
        """Return the draws at `_picked`."""
        index = self._picked(size)
        return Draws(
            self.theta[index],
            self.mean_rate[index],
            self.posterior.rating_parameters(self.theta[index]),
            type(self.effects)(*(effect[index] for effect in self.effects)),
        )

    def _touch(self, theta: Array) -> TouchParameters:
        """Return the chain's parameters at theta, held ones as often as sampled ones."""
        return TouchParameters(*(np.broadcast_to(v, theta.shape[:-1]) for v in self.posterior.space.touch(theta)))

    @cached_property
    def exactness(self) -> Exactness:
        """The exact log-likelihood's difference to the fast one at evenly spaced draws."""
        fast = self.posterior.log_likelihood(self.compared)
        rates = SAME_RATES if self.scene.firing.noise else EXACT_RATES
        exact = np.concatenate([finished() for finished in self._exact])
        return compare(self.posterior.names, self.compared, fast, exact, rates)

    def _exactness_stats(self) -> dict[str, Variable]:
        """Return the differences of the log-likelihood and the log weights; NaN at draws that were not compared."""
        index = evenly(self.theta.shape, self.exactness.difference.size)
        found = {}
        for name, values in (
            ("exact_difference", self.exactness.difference),
            ("exact_log_weight", self.exactness.log_weight),
        ):
            everywhere = np.full(self.theta.shape[:2], np.nan)
            everywhere[index] = values
            found[name] = Variable(everywhere)
        return found

    def _firing_error(self) -> float:
        """Return a bound of what the measured error of the rate curves does to a draw's peak response."""
        draws = self._pick(ERROR_DRAWS)
        response = self.scene.respond(self._touch(draws.theta))
        peak = response.total_rate.max(axis=-1)
        hertz = self.scene.firing.curves(self._touch(draws.theta)).error.hertz
        fires = peak > 0
        return float((hertz * response.responding.max(axis=-1)[fires] / peak[fires]).max(initial=0.0))

    def _error(self) -> float:
        """Return the largest numerical error of the response over some draws, relative to each one's peak."""
        return float(self.scene.error(self._touch(self._pick(ERROR_DRAWS).theta)).max())

    def _fabric_check(self) -> FabricCheck:
        draws = self._pick(REPLICATES)
        return check_fabrics(self.ratings, draws.mean_rate, draws.parameters, draws.effects)

    def _condition_names(self) -> list[str]:
        """Return every condition's fabric and load in words."""
        ratings = self.experiment.ratings
        at = zip(ratings.conditions.fabric, ratings.conditions.load, strict=True)
        return [f"{ratings.fabrics[fabric]} under {ratings.loads[load]}" for fabric, load in at]

    def _exponent_check(self) -> ExponentCheck:
        draws = self._pick(REPLICATES)
        return check_exponents(self.ratings, draws.mean_rate, draws.parameters, draws.effects)

    def _loo_pit(self) -> LooPit:
        draws = self._pick(REPLICATES)
        return loo_pit(self.ratings, draws.mean_rate, draws.parameters)

    def _posterior_groups(self) -> dict[str, dict[str, Variable]]:
        data = "ratings" if self.posterior.compression is None else "ratings_and_compression"
        groups = sampled_groups(self.posterior, self.kept, self.theta, data)
        drawn = {n: Variable(v, dims) for n, (v, dims) in self.model.named_effects(self.effects).items()}
        if "omega" not in self.posterior.names:
            drawn.pop("fabric_effect", None)
        return merged(groups, {"posterior": drawn, "sample_stats": self._exactness_stats()})

    def _plate(self) -> tuple[Groups, dict[str, Any]]:
        """Return what compression data add, if there are any."""
        data, forces = self.experiment.compression, self.posterior.compression
        if data is None or forces is None:
            return {}, {}
        groups, check = plate_groups(
            self.rng,
            data,
            forces,
            self.posterior.skin_parameters,
            self.theta,
            self._pick(REPLICATES).theta,
            self._pick(CURVES).theta,
            self.prior[:REPLICATES],
        )
        return groups, plate_attributes(data, check)

    def _named(self, theta: Array) -> dict[str, Variable]:
        return named(self.posterior.space, theta)

    def _predictive_groups(self) -> dict[str, dict[str, Variable]]:
        """Return replicated ratings of the same and of new participants, and each rating given all the others."""
        few, model = self._pick(REPLICATES), self.model
        drive = model.drive(self.ratings.design, few.mean_rate, few.parameters)
        alone = self.ratings.log_likelihood_loo(few.mean_rate, few.parameters)
        whole = self.ratings.log_likelihood_participants(few.mean_rate, few.parameters)
        twin = copy.deepcopy(self.rng)
        again = self._rated(self.rng, drive, few.parameters, few.effects)
        strangers = model.with_new_participants(self.rng, few.parameters, few.effects)
        anew = self._rated(self.rng, drive, few.parameters, strangers)
        rows = ("rating_row",)
        replicates = {"rating": Variable(again[None], rows), NEW_PARTICIPANTS: Variable(anew[None], rows)}
        return {
            "posterior_predictive": replicates,
            "log_likelihood_loo": {"rating": Variable(alone[None], rows)},
            # by another name than the rating's, which has another axis
            "log_likelihood_participant": {"ratings_of_participant": Variable(whole[None], ("participant",))},
            **self._levelled_groups(few, again, twin),
        }

    def _levelled_groups(self, few: Draws, again: Array, twin: np.random.Generator) -> Groups:
        """Return what tables show of a turning point whose response levels off at its peak, all else being the same.

        `again` are the ratings replicated with the noise of `twin`.
        """
        design, model, ratings = self.ratings.design, self.model, self.experiment.ratings
        layout = Layout(design, self.scene.modulus, ratings.conditions.load, model.direction.sign, model.logarithmic)
        drive = model.drive_at(levelled(layout, few.mean_rate), design, few.mean_rate, few.parameters)
        other = self._rated(twin, drive, few.parameters, few.effects)
        found, shortfall = compare_levelled(layout, again, other)
        shown = np.full((len(LEVELLED_NAMES), len(again), len(ratings.loads)), np.nan)
        shown[..., layout.loads] = found
        tables = zip(LEVELLED_NAMES, shown, strict=True)
        return {
            LEVELLED: {f"levelled_{name}": Variable(values[None], ("load",)) for name, values in tables},
            "constant_data": {SHORTFALL: Variable(shortfall[design.condition], ("rating_row",))},
        }

    def _rated(self, rng: np.random.Generator, drive: Array, parameters: RatingParameters, effects: Any) -> Array:
        """Return a rating for every row at every draw, drawn a few draws at a time."""
        design = self.ratings.design
        made = np.empty((len(drive), design.n_rows))
        for k in pieces(*made.shape):
            some = part_of(parameters, k), part_of(effects, k)
            made[k] = self.model.draw_ratings(rng, design, drive[k], *some)
        return made

    def _prior_groups(self) -> dict[str, dict[str, Variable]]:
        """Return draws of the prior, and ratings that they make of new participants."""
        design, model = self.ratings.design, self.model
        theta = self.prior[:REPLICATES]
        rate, parameters = self.posterior.mean_rate(theta), self.posterior.rating_parameters(theta)
        effects = model.draw_effects(self.rng, parameters, theta.shape[:1], design.n_participants, design.n_fabrics)
        drive = model.drive(design, rate, parameters)
        made = self._rated(self.rng, drive, parameters, effects)
        return {
            "prior": self._named(self.prior[None]),
            "prior_predictive": {"rating": Variable(made[None], ("rating_row",))},
        }

    def _predictions(self) -> dict[str, Variable]:
        """Return response and rating against E_fab under each load, and where they turn over."""
        draws = self._pick(CURVES)
        curves = response_curves(self.grid, self._touch(draws.theta))
        fabrics = float(self.scene.modulus.min()), float(self.scene.modulus.max())
        turn = find_inflection(curves, self.error, fabrics)
        model, shape = self.model, curves.total_rate.shape
        everywhere = curves.total_rate.reshape(shape[0], -1) / self.scene.n_receptors
        drive = model.drive_at(everywhere, self.ratings.design, draws.mean_rate, draws.parameters)
        typical = model.typical(draws.effects, drive).reshape(shape)
        lines = {
            "total_rate": (curves.total_rate, "Hz"),
            "typical_rating": (typical, ""),
            "e_skin_kpa": (curves.skin_modulus * 1e-3, "kPa"),
            "contact_radius_mm": (curves.radius * 1e3, "mm"),
            "contact_force_n": (curves.force, "N"),
        }
        along = ("load", "e_fab_kpa")
        rated = model.typical(draws.effects, model.drive(self.ratings.design, draws.mean_rate, draws.parameters))
        return {
            TYPICAL: Variable(rated[None], ("condition",)),
            **{n: Variable(v[None].astype(np.float32), along, unit) for n, (v, unit) in lines.items()},
            **turning_variables(turn, (1, -1)),
            **{f"at_{n}": v for n, v in self._named(draws.theta[None]).items()},
        }

    def _turning_groups(self) -> Groups:
        """Return where the response turns over in many draws, and in those of the prior."""
        if self.reweight:
            theta = self._pick(REWEIGHT_DRAWS).theta[None]
        else:
            every = -(-self.theta.shape[0] * self.theta.shape[1] // TURNING)
            theta = self.theta[:, ::-1][:, ::every][:, ::-1]
        drawn = {"inflection": theta, "prior_inflection": self.prior[None]}
        found: Groups = {}
        for group, points in drawn.items():
            flat = points.reshape(-1, points.shape[-1])
            found[group] = turning_variables(
                turning_points(self.scene, self._touch(flat), self.error), points.shape[:2]
            )
        return found

    def _illustrations(self, turn: Array) -> tuple[Groups, dict[str, NDArray[Any]]]:
        """Return what the figures of touch and membrane show; `turn` holds E_fab at draws' turning points [Pa]."""
        touched, fired = (self._touch(self._pick(size).theta) for size in (ILLUSTRATED, CURVES))
        touch, along = touch_illustration(self.rng, self.scene, touched, turn)
        membrane, currents = membrane_illustration(self.rng, self.scene, fired)
        return merged(touch, membrane), {**along, **currents}

    def _constants(self, pit: LooPit) -> dict[str, Variable]:
        """Return the held parameters, the fabrics, the loads, and what each rating is of."""
        ratings, fabrics = self.experiment.ratings, self.experiment.fabrics
        held = self.posterior.space.held
        modulus = fabrics.modulus(self.scene.readings.fabric_modulus) / EFFECTIVE_MODULUS.factor
        return {
            **{n: Variable(np.array(value), units=EVERY_PARAMETER[n].unit) for n, value in held.items()},
            "finger_radius_mm": Variable(np.array(self.scene.finger.radius * 1e3), units="mm"),
            LOO_PIT: Variable(pit.value, ("rating_row",)),
            PARETO_K: Variable(pit.pareto_k, ("rating_row",)),
            EFFECTIVE_MODULUS.name: Variable(modulus, ("fabric",), EFFECTIVE_MODULUS.unit),
            POISSON_RATIO.name: Variable(fabrics.poisson_ratio, ("fabric",)),
            **{
                column.name: Variable(
                    np.array([value(x) / column.factor if isinstance(x, kind) else np.nan for x in ratings.loads]),
                    ("load",),
                    column.unit,
                )
                for column, kind, value in LOAD_COLUMNS
            },
            **{
                f"{what}_index": Variable(getattr(ratings, what), ("rating_row",))
                for what in ("participant", "fabric", "load")
            },
        }

    def _coordinates(self) -> dict[str, Array]:
        ratings = self.experiment.ratings
        points = self.grid.n_conditions // len(self.grid.loads)
        return {
            arviz_bridge.ENSEMBLE: self.kept.ensemble,
            "participant": np.array(ratings.participants),
            "fabric": np.array(ratings.fabrics),
            "load": np.array([str(load) for load in ratings.loads]),
            "rating_row": ratings.rows,
            "e_fab_kpa": self.grid.modulus[:points] * 1e-3,
            **({} if self.experiment.compression is None else plate_coordinates(self.experiment.compression)),
        }

    def _shares(self) -> dict[str, float]:
        """Return how often the model is silent, and how often the contact leaves Hertz's range."""
        prior = self.posterior.mean_rate(self.prior)
        beyond = self.scene.beyond_hertz(self._touch(self._pick(CURVES).theta))
        return {
            "prior_silent_everywhere": float((prior == 0).all(axis=-1).mean()),
            "prior_silent_conditions": float((prior == 0).mean()),
            "posterior_silent_everywhere": float((self.mean_rate == 0).all(axis=-1).mean()),
            "posterior_silent_conditions": float((self.mean_rate == 0).mean()),
            "contact_beyond_half_radius": beyond.questionable,
            "contact_beyond_radius": beyond.meaningless,
        }


def _held_eps(space: ParameterSpace) -> dict[str, str]:
    """Return what a run that holds eps says of it, as an attribute; nothing where it is sampled or there is none."""
    if "eps" not in space.held:
        return {}
    held, prior = space.held["eps"], PARAMETERS["eps"].prior
    return {
        "held_eps": f"eps is held at {held:g} Hz: all intervals take it as known, which no measurement makes it; "
        f"leave out '--fix eps={held:g}' to sample it too, under its prior {prior}"
    }


def versions() -> dict[str, str]:
    """Return the versions of what the numbers depend on, as attributes of a result."""
    return {
        "version_python": platform.python_version(),
        **{f"version_{name.replace('-', '_')}": version(name) for name in LIBRARIES},
    }
