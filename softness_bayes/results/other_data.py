"""Plate forces and recorded afferents in the result of a run: replicates, predictions, and agreement of the sources.

Each function draws in a fixed order, so that the seed determines the numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import chdtrc

from softness_bayes.base.files.run_files import RECORDED_RATES
from softness_bayes.base.laws import LogNormal
from softness_bayes.base.readable import number, percent
from softness_bayes.checking.checks import check_exponent
from softness_bayes.checking.provenance import PlateData, RecordedData, attributes_of
from softness_bayes.data import Afferents, Compression, Experiment, Measurements
from softness_bayes.data.columns import CURVATURE, DISTANCE, FORCE, INDENTATION
from softness_bayes.data.ratings import loads_by_column
from softness_bayes.likelihood.contract import NO_RESPONSE, Likelihood, Parameters
from softness_bayes.likelihood.plate import FORCES, CompressionForces
from softness_bayes.model.posterior import Density, Posterior
from softness_bayes.model.recordings.likelihood import RecordedRates
from softness_bayes.parameters.declared import EVERY_PARAMETER, PARAMETERS, PRIOR_SETS, RECORDED, SHAREABLE
from softness_bayes.parameters.space import ParameterSpace
from softness_bayes.results.draws import Groups, Part, Points, Variable, joined
from softness_bayes.sampler.starts import Optimum, climb
from softness_bayes.touch.contact import SkinDisplacement, plate_force
from softness_bayes.touch.parameters import TouchParameters

Array = NDArray[np.float64]

POINTS = 60
"""Number of indentations at which the force of the typical finger is stored."""

PRESSED, RECORDED_ROW = ("force_row",), ("recorded_row",)
"""Axes of variables with one value per plate force, and per recorded response."""

DOUBTFUL = 0.01
"""Probability below which two sources contradict each other."""

MUCH_WORSE = 1.5
"""Ratio of residual sds above which the model is much worse than the table of effects."""

NEAR_ZERO = 1.0
"""Rate [Hz] at which logs of observed rates are cut off, where the fit of the table of effects starts."""


class Agreement(NamedTuple):
    """Agreement of two sources of data about the parameters that one model gives both."""

    first: str
    second: str
    chi_square: float
    """Squared distance of the sources' posterior modes by the sum of their covariances."""
    degrees: int
    """Number of common parameters."""

    @property
    def p_value(self) -> float:
        """Probability of at least this distance if both sources have the same parameters."""
        return float(chdtrc(self.degrees, self.chi_square))

    @property
    def contradicts(self) -> bool:
        """True if `p_value` is below `DOUBTFUL`."""
        return self.p_value < DOUBTFUL

    @property
    def said(self) -> str:
        """The agreement as a sentence."""
        found = f"chi-square {number(self.chi_square)} on {self.degrees} parameters, p = {self.p_value:.2g}"
        if self.contradicts:
            return f"{self.first} and {self.second} contradict each other under this model ({found}): do not pool them"
        return f"{self.first} and {self.second} do not contradict each other ({found})"


class RecordedFindings(NamedTuple):
    """Findings of a run about its recorded afferents."""

    residual_sd: float
    """Residual sd about the posterior mean of the rates [Hz]."""
    additive_sd: float
    """The same about `log_additive_sd`'s table."""
    shifts: Mapping[str, float]
    """As `shifts`."""
    rest: tuple[float, float, float]
    """Current at rest over the rheobase: 5, 50 and 95 % quantiles."""
    fires_at_rest: float
    """Share of draws in which afferents fire without stress."""
    agreements: tuple[Agreement, ...]

    def record(self) -> dict[str, Any]:
        """Return the findings as JSON data."""
        return {**self._asdict(), "shifts": dict(self.shifts), "agreements": [one._asdict() for one in self.agreements]}

    @classmethod
    def recorded(cls, record: Mapping[str, Any]) -> RecordedFindings:
        """Return the findings of a record."""
        agreements = tuple(Agreement(**one) for one in record["agreements"])
        return cls(**{**record, "rest": tuple(record["rest"]), "agreements": agreements})

    @property
    def faults(self) -> tuple[str, ...]:
        """Features that the model does not reproduce, in words."""
        worse = self.residual_sd > MUCH_WORSE * self.additive_sd  # NaN is not
        apart = (f"{one.first} and {one.second} together" for one in self.agreements if one.contradicts)
        return (*(("the recorded rates as well as a table of effects does",) if worse else ()), *apart)

    @property
    def sentences(self) -> tuple[str, ...]:
        """The findings in words."""
        low, middle, high = map(number, self.rest)
        beside = (
            ""
            if np.isnan(self.additive_sd)
            else (
                f"; a table of effects of load, curvature and distance, without skin or receptors, leaves "
                f"{number(self.additive_sd)} Hz"
            )
        )
        moved = ", ".join(f"{name} {value:+.1f}" for name, value in self.shifts.items())
        return (
            f"recorded rates: the model leaves a residual sd of {number(self.residual_sd)} Hz{beside}",
            f"recorded afferents against the paper's values, in sd of their priors: {moved}",
            f"current at rest: {middle} of the rheobase ({low} to {high}, 90 %); firing at rest in "
            f"{percent(self.fires_at_rest)} of draws",
            *(one.said for one in self.agreements),
        )


def other_data(rng: np.random.Generator, data: Experiment | Measurements, density: Density, points: Points) -> Part:
    """Return data, replicates and predictions of plate forces and recorded afferents, of those that a run has.

    Parameters
    ----------
    rng
        Random generator of effects and noise.
    data, density
        The data, and the density that was sampled.
    points
        Draws of the posterior and of the prior.
    """
    recorded, parts = density.term(RECORDED), []
    if data.compression is not None and density.compression is not None:
        parts.append(_plate(rng, data.compression, density, density.compression, points))
    if data.afferents is not None and isinstance(recorded, RecordedRates):
        parts.append(_recorded(rng, data.afferents, density, recorded, points))
    return joined(*parts)


def _plate(
    rng: np.random.Generator, data: Compression, density: Density, term: CompressionForces, points: Points
) -> Part:
    every, few, prior, curves = (_parameters(density, term, theta) for theta in points)
    fingers = term.draw_effects(rng, NO_RESPONSE, every)
    again = term.replicate(rng, term.drive(NO_RESPONSE, few), few, term.draw_effects(rng, NO_RESPONSE, few))
    strangers = term.new_effects(rng, prior, points.prior.shape[:1])
    anew = term.replicate(rng, term.drive(NO_RESPONSE, prior), prior, strangers)
    # from half the smallest to a tenth more than the largest of the data
    depth = np.geomspace(0.5 * data.indentation.min(), 1.1 * data.indentation.max(), POINTS)
    b, m = (np.asarray(value)[:, None] for value in (curves.b, curves.m))
    line, check = plate_force(depth, b, m, displacement=term.model.displacement), check_exponent(term, again)
    groups: Groups = {
        "posterior": {
            "log_b_effect": Variable(fingers.log_b, ("finger",)),
            "m_effect": Variable(fingers.m, ("finger",)),
        },
        "posterior_predictive": {"plate_force_n": Variable(again[None], PRESSED, FORCE.unit)},
        "prior_predictive": {"plate_force_n": Variable(anew[None], PRESSED, FORCE.unit)},
        "predictions": {"typical_force_n": Variable(line[None], ("plate_indentation_mm",), FORCE.unit)},
        "observed_data": {"plate_force_n": Variable(data.force, PRESSED, FORCE.unit)},
        "constant_data": {
            "finger_index": Variable(data.participant, PRESSED),
            "force_indentation_mm": Variable(data.indentation / INDENTATION.factor, PRESSED, INDENTATION.unit),
        },
    }
    coordinates = {
        "finger": np.array(data.participants),
        "force_row": data.rows,
        "plate_indentation_mm": depth / INDENTATION.factor,
    }
    found = PlateData(data.digest, data.n_zero, check.points, check.observed, check.low, check.high, check.p_value)
    return Part(groups, coordinates, attributes_of(found))


def _recorded(rng: np.random.Generator, data: Afferents, density: Density, term: RecordedRates, points: Points) -> Part:
    every, few, prior, curves = (_parameters(density, term, theta) for theta in points)
    effects, rate = term.draw_effects(rng, NO_RESPONSE, few), term.rate(few)
    window = np.where(data.counted, data.window, 1.0)
    again = term.replicate(rng, rate, few, effects) / window
    strangers = term.new_effects(rng, prior, points.prior.shape[:1])
    anew = term.replicate(rng, term.rate(prior), prior, strangers) / window
    expected = term.rate(curves) * term.factors(term.draw_effects(rng, NO_RESPONSE, curves))
    alone = term.left_out(NO_RESPONSE, few).log_density
    groups: Groups = {
        "posterior_predictive": {"recorded_rate_hz": Variable(again[None], RECORDED_ROW, "Hz")},
        "prior_predictive": {"recorded_rate_hz": Variable(anew[None], RECORDED_ROW, "Hz")},
        "predictions": {"expected_rate_hz": Variable(expected[None], RECORDED_ROW, "Hz")},
        "log_likelihood": {"recorded_rate_hz": Variable(alone[None], RECORDED_ROW)},
        "observed_data": {"recorded_rate_hz": Variable(data.observed, RECORDED_ROW, "Hz")},
        "constant_data": {
            "probe_curvature_per_m": Variable(data.curvature, RECORDED_ROW, CURVATURE.unit),
            "probe_distance_mm": Variable(data.distance / DISTANCE.factor, RECORDED_ROW, DISTANCE.unit),
            **{
                f"probe_{column.name}": Variable(values / column.factor, RECORDED_ROW, column.unit)
                for column, values in loads_by_column(data.loads).items()
            },
            "afferent_index": Variable(data.afferent, RECORDED_ROW),
            "averaged_responses": Variable(data.n, RECORDED_ROW),
            "averaged_sd_hz": Variable(data.sd, RECORDED_ROW, "Hz"),
            "count_window_s": Variable(data.window, RECORDED_ROW, "s"),
        },
    }
    coordinates: dict[str, NDArray[Any]] = {"recorded_row": data.rows}
    if data.names:
        factors = term.draw_effects(rng, NO_RESPONSE, every).log_factor
        groups["posterior"] = {"log_rate_effect": Variable(factors, ("afferent",))}
        coordinates["afferent"] = np.array(data.names)
    found = _findings(density, term, data, every, expected, points.every.mean(axis=(0, 1)))
    attributes = attributes_of(RecordedData(data.digest, found.record()))
    return Part(groups, coordinates, attributes, {RECORDED_RATES: _table(data, expected, again)})


def _parameters(density: Density, term: Likelihood, theta: Array) -> Parameters:
    return density.parameters_of(term, theta).each(lambda value: np.broadcast_to(value, theta.shape[:-1]))


def _findings(
    density: Density, term: RecordedRates, data: Afferents, own: Parameters, expected: Array, near: Array
) -> RecordedFindings:
    at = term.model.afferent(own)
    rest, sigma_0 = term.touches.at_rest(at)
    draws = at._replace(sigma_0=sigma_0)._asdict()
    natural = {name: draws[name] / EVERY_PARAMETER[name].si for name in SHAREABLE}
    low, middle, high = np.quantile(rest, [0.05, 0.5, 0.95]).tolist()
    return RecordedFindings(
        float(np.sqrt(np.mean((data.observed - expected.mean(axis=0)) ** 2))),
        log_additive_sd(data),
        shifts(natural, term.touches.readings.skin_displacement),
        (low, middle, high),
        float((rest > 1.0).mean()),
        agreements(density, near),
    )


def log_additive_sd(data: Afferents) -> float:
    """Return the residual sd [Hz] of the table ln rate = load + curvature + distance, fitted to the rates.

    It knows nothing of skin or receptors: a model that explains the data should not be much worse. NaN if the table has
    as many effects as there are rows.
    """
    from scipy.optimize import least_squares  # imported here because it takes a quarter of a second

    texts = np.array([str(load) for load in data.loads]), data.curvature, data.distance
    columns = [np.ones(len(data))]
    for values in texts:
        columns += [(values == level).astype(float) for level in np.unique(values)[1:]]
    design, observed = np.column_stack(columns), data.observed
    if np.linalg.matrix_rank(design) >= len(data):
        return float("nan")
    start = np.linalg.lstsq(design, np.log(np.maximum(observed, NEAR_ZERO)), rcond=None)[0]
    fitted = least_squares(lambda effects: observed - np.exp(np.minimum(design @ effects, 50.0)), start)
    return float(np.sqrt(np.mean(fitted.fun**2)))


def shifts(draws: Mapping[str, Array], displacement: SkinDisplacement) -> dict[str, float]:
    """Return how far each parameter is from its default prior, the paper's values, in that prior's sd.

    A parameter that is defined in no draw is left out: sigma_0 where the current at rest exceeds half of the largest,
    so that it would be negative.

    Parameters
    ----------
    draws
        Posterior draws of `SHAREABLE` parameters as the recordings have them, in natural units.
    displacement
        Reading of the skin, which determines the prior of m.
    """
    usual = PRIOR_SETS["default"].get(displacement, {})
    found = {}
    for name in SHAREABLE:
        prior = usual.get(name, PARAMETERS[name].prior)
        if name in draws and isinstance(prior, LogNormal):
            with np.errstate(invalid="ignore", divide="ignore"):
                logs = np.log(draws[name])
            if np.isfinite(logs).any():
                found[name] = float((np.mean(logs[np.isfinite(logs)]) - np.log(prior.median)) / prior.sd_log)
    return found


def _table(data: Afferents, expected: Array, again: Array) -> pd.DataFrame:
    """Return each response with the median of its expectation and 90 % limits of its replicates."""
    columns: dict[str, Any] = {"recording": data.recording} if data.recording else {}
    columns["afferent"] = [data.names[k] if k >= 0 else "" for k in data.afferent]
    loads = loads_by_column(data.loads).items()
    columns |= {column.name: values / column.factor for column, values in loads if not np.isnan(values).all()}
    columns |= {CURVATURE.name: data.curvature, DISTANCE.name: data.distance / DISTANCE.factor}
    columns["rate_hz"] = data.observed
    columns["expected_hz"] = np.median(expected, axis=0)
    columns["low_hz"], columns["high_hz"] = np.quantile(again, [0.05, 0.95], axis=0)
    return pd.DataFrame(columns, index=pd.Index(data.rows, name="row"))


CHAIN = ("b", "m", "alpha", "beta", "rest", "sigma_0", "spread", "radius", "depth")
"""Parameters of which sources may have a common value, without the suffix of recordings."""

STARTS = 5
"""Prior draws from which a mode is sought, beside the prior's median."""


def agreements(density: Density, near: Array | None = None) -> tuple[Agreement, ...]:
    """Return how well each pair of sources agrees about their common parameters.

    Every source is fitted alone under the run's priors, by its posterior mode and the curvature there; thus a joint run
    cannot hide a contradiction behind wider spreads.

    Parameters
    ----------
    density
        The density of the run.
    near
        A point (dimension,) from which modes are sought too, such as the mean of the run's draws.
    """
    sources = _sources(density)
    modes = [(name, *_mode(one, density.space, near)) for name, one in sources if len(sources) > 1]
    found = []
    for (first, one, here), (second, other, there) in combinations(modes, 2):
        common = [name for name in CHAIN if name in one and name in other]
        if common:
            i, j = ([names.index(name) for name in common] for names in (one, other))
            apart = here.point[i] - there.point[j]
            spread = sum((mode.root @ mode.root.T)[np.ix_(k, k)] for mode, k in ((here, i), (there, j)))
            found.append(Agreement(first, second, float(apart @ np.linalg.solve(spread, apart)), len(common)))
    return tuple(found)


def _sources(density: Density) -> list[tuple[str, Density]]:
    """Return the density of each source alone, by its name."""
    space, found = density.space, list[tuple[str, Density]]()
    others = [term for term in density.terms if term.name in (FORCES, RECORDED)]
    if isinstance(density, Posterior) and density.fingers is None and others:
        rated = tuple(term for term in density.terms if term not in others)
        theirs = {name for term in others for name in term.model.needs} - {*TouchParameters._fields}
        own = tuple(p for p in space.sampled if p.name not in theirs - {n for term in rated for n in term.model.needs})
        # without bent coordinates, those of all sources are logarithms
        alone = replace(space, sampled=own, bent={}, rheobase=None)
        found.append(("ratings", replace(density, space=alone, terms=rated)))
    for term in others:
        if isinstance(term, RecordedRates):
            labels = np.array(term.data.recording or [RECORDED] * len(term.data))
            for label in dict.fromkeys(labels.tolist()):
                name = f"recording {label}" if term.data.recording else "recorded afferents"
                part = term if (labels == label).all() else term.without(labels != label)
                found.append((name, _alone(space, part)))
        else:
            found.append(("plates", _alone(space, term)))
    return found


def _alone(space: ParameterSpace, term: Likelihood) -> Density:
    """Return the density of one source, with its own parameters."""
    needs = {*term.model.needs}
    held = {name: value for name, value in space.held.items() if name in needs}
    return Density(ParameterSpace(tuple(p for p in space.sampled if p.name in needs), held), (term,))


def _mode(density: Density, whole: ParameterSpace, near: Array | None) -> tuple[list[str], Optimum]:
    """Return the names of a source's parameters, without the suffix of recordings, and its posterior's mode."""
    space = density.space
    # a response takes its time
    starts = [
        space.median,
        *space.draw_prior(np.random.default_rng(0), 0 if isinstance(density, Posterior) else STARTS),
    ]
    if near is not None:
        starts.append(np.array([near[whole.names.index(name)] for name in space.names]))
    modes = [climb(density, start) for start in space.coordinates(np.array(starts))]
    return [name.removesuffix("_rec") for name in space.names], max(modes, key=lambda mode: mode.log_density)
