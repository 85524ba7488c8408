"""Plate forces and recorded afferents in the result of a run: replicates, predictions, and agreement of the sources.

Each function draws in a fixed order, so that the seed determines the numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from softness_bayes.base.files.run_files import RECORDED_RATES
from softness_bayes.base.laws import LogNormal
from softness_bayes.checking.checks import check_exponent
from softness_bayes.checking.provenance import Agreement, RecordedData, attributes_of
from softness_bayes.data import Afferents, Compression, Experiment, Measurements
from softness_bayes.data.columns import FORCE, INDENTATION
from softness_bayes.likelihood.contract import NO_RESPONSE, Parameters, Term
from softness_bayes.likelihood.plate import FORCES, CompressionForces
from softness_bayes.model.posterior import Density, Posterior
from softness_bayes.model.recordings.likelihood import RecordedRates
from softness_bayes.model.recordings.response import Afferent
from softness_bayes.parameters.declared import EVERY_PARAMETER, PARAMETERS, PRIOR_SETS, RECORDED, SHAREABLE
from softness_bayes.parameters.space import ParameterSpace
from softness_bayes.results.draws import Groups, Part, Variable, joined
from softness_bayes.sampler.starts import climb
from softness_bayes.touch.contact import SkinDisplacement, plate_force
from softness_bayes.touch.parameters import TouchParameters

Array = NDArray[np.float64]

POINTS = 60
"""Number of indentations at which the force of the typical finger is stored."""

PRESSED, RECORDED_ROW = ("force_row",), ("recorded_row",)
"""Axes of variables with one value per plate force, and per recorded response."""

Points = tuple[Array, Array, Array, Array]

NEAR_ZERO = 1.0
"""Rate [Hz] at which logs of observed rates are cut off, where the fit of the table of effects starts."""


def other_data(rng: np.random.Generator, data: Experiment | Measurements, density: Density, points: Points) -> Part:
    """Return data, replicates and predictions of plate forces and recorded afferents, of those that a run has.

    Parameters
    ----------
    rng
        Random generator of effects and noise.
    data, density
        The data, and the density that was sampled.
    points
        Points theta: all draws of the posterior (chains, draws, dimension), those with replicated data, as many of the
        prior, and draws of the posterior with stored curves, each (draws, dimension).
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
    strangers = term.new_effects(rng, prior, points[2].shape[:1])
    anew = term.replicate(rng, term.drive(NO_RESPONSE, prior), prior, strangers)
    # from half the smallest to a tenth more than the largest of the data
    depth = np.geomspace(0.5 * data.indentation.min(), 1.1 * data.indentation.max(), POINTS)
    b, m = (np.asarray(value)[:, None] for value in (curves.b, curves.m))
    line = plate_force(depth, b, m, displacement=term.model.displacement)
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
    return Part(groups, coordinates, attributes_of(check_exponent(term, again, data.digest, data.n_zero)))


def _recorded(rng: np.random.Generator, data: Afferents, density: Density, term: RecordedRates, points: Points) -> Part:
    every, few, prior, curves = (_parameters(density, term, theta) for theta in points)
    again = term.replicate(rng, term.rate(few), few, term.draw_effects(rng, NO_RESPONSE, few))
    strangers = term.new_effects(rng, prior, points[2].shape[:1])
    anew = term.replicate(rng, term.rate(prior), prior, strangers)
    expected = term.rate(curves) * term.factors(term.draw_effects(rng, NO_RESPONSE, curves))
    alone = term.left_out(NO_RESPONSE, few).log_density
    stored = {
        f"recorded_{column.name}": Variable(values / column.factor, RECORDED_ROW, column.unit)
        for column, values in data.columns.items()
    }
    groups: Groups = {
        "posterior_predictive": {"recorded_rate_hz": Variable(again[None], RECORDED_ROW, "Hz")},
        "prior_predictive": {"recorded_rate_hz": Variable(anew[None], RECORDED_ROW, "Hz")},
        "predictions": {"expected_rate_hz": Variable(expected[None], RECORDED_ROW, "Hz")},
        "log_likelihood": {"recorded_rate_hz": Variable(alone[None], RECORDED_ROW)},
        "observed_data": {"recorded_rate_hz": stored.pop("recorded_rate_hz")},
        "constant_data": {**stored, "afferent_index": Variable(data.afferent, RECORDED_ROW)},
    }
    coordinates: dict[str, NDArray[Any]] = {"recorded_row": data.rows}
    if data.names:
        factors = term.draw_effects(rng, NO_RESPONSE, every).log_factor
        groups["posterior"] = {"log_rate_effect": Variable(factors, ("afferent",))}
        coordinates["afferent"] = np.array(data.names)
    found = _findings(density, term, data, every, expected)
    return Part(groups, coordinates, attributes_of(found), {RECORDED_RATES: _table(data, expected, again)})


def _parameters(density: Density, term: Term, theta: Array) -> Parameters:
    return density.parameters_of(term, theta).each(lambda value: np.broadcast_to(value, theta.shape[:-1]))


def _findings(density: Density, term: RecordedRates, data: Afferents, own: Parameters, expected: Array) -> RecordedData:
    at = term.model.afferent(own)
    rest, sigma_0 = term.touches.at_rest(at)
    draws = at._replace(sigma_0=sigma_0)._asdict()
    natural = {name: draws[name] / EVERY_PARAMETER[name].si for name in SHAREABLE}
    low, middle, high = map(float, np.quantile(rest, [0.05, 0.5, 0.95]))
    return RecordedData(
        data.digest,
        float(np.sqrt(np.mean((data.rate - expected.mean(axis=0)) ** 2))),
        log_additive_sd(data),
        shifts(natural, term.touches.readings.skin_displacement),
        low,
        middle,
        high,
        float((rest > 1.0).mean()),
        agreements(density),
    )


def log_additive_sd(data: Afferents) -> float:
    """Return the residual sd [Hz] of the table ln rate = load + curvature + distance, fitted to the rates.

    It knows nothing of skin or receptors: a model that explains the data should not be much worse. NaN if the table has
    as many effects as there are rows.
    """
    from scipy.optimize import least_squares  # imported here because it takes a quarter of a second

    touches = pd.DataFrame({"load": map(str, data.loads), "curvature": data.curvature, "distance": data.distance})
    effects = pd.get_dummies(touches, columns=[*touches], drop_first=True, dtype=float)
    design, observed = effects.assign(every=1.0).to_numpy(), data.rate
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
    for name, values in draws.items():
        prior, known = usual.get(name, PARAMETERS[name].prior), values[values > 0]  # NaN is not
        if known.size and isinstance(prior, LogNormal):
            found[name] = float((np.log(known).mean() - np.log(prior.median)) / prior.sd_log)
    return found


def _table(data: Afferents, expected: Array, again: Array) -> pd.DataFrame:
    """Return each response with the median of its expectation and 90 % limits of its replicates."""
    columns: dict[str, Any] = {"recording": data.recording} if data.recording else {}
    columns["afferent"] = [data.names[k] if k >= 0 else "" for k in data.afferent]
    known = {column: values for column, values in data.columns.items() if not np.isnan(values).all()}
    columns |= {column.name: values / column.factor for column, values in known.items()}
    columns["expected_hz"] = np.median(expected, axis=0)
    columns["low_hz"], columns["high_hz"] = np.quantile(again, [0.05, 0.95], axis=0)
    return pd.DataFrame(columns, index=pd.Index(data.rows, name="row"))


STARTS = 3
"""Prior draws from which a mode is sought, beside the prior's median."""


def agreements(density: Density) -> tuple[Agreement, ...]:
    """Return how well each pair of sources agrees about the parameters that they share, or else those they could share.

    Every source is fitted alone under the run's priors, by its posterior mode and the curvature there; thus a joint run
    cannot hide a contradiction behind wider spreads.
    """
    sources = _sources(density)
    modes = []
    for name, alone in sources if len(sources) > 1 else ():
        starts = [alone.space.coordinates(alone.space.median), *alone.draw_start(np.random.default_rng(0), STARTS)]
        best = max((climb(alone, start) for start in starts), key=lambda optimum: optimum.log_density)
        modes.append((name, alone.names, best))
    found = []
    for (first, one, here), (second, other, there) in combinations(modes, 2):
        shared = [name for name in one if name in other and name.removesuffix("_rec") in Afferent._fields]
        if not shared:
            one, other = (tuple(name.removesuffix("_rec") for name in names) for names in (one, other))
        if common := shared or [name for name in Afferent._fields if name in one and name in other]:
            i, j = ([names.index(name) for name in common] for names in (one, other))
            apart = here.point[i] - there.point[j]
            spread = sum((mode.root @ mode.root.T)[np.ix_(k, k)] for mode, k in ((here, i), (there, j)))
            chi_square = float(apart @ np.linalg.solve(spread, apart))
            found.append(Agreement(first, second, chi_square, tuple(common), bool(shared)))
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


def _alone(space: ParameterSpace, term: Term) -> Density:
    """Return the density of one source, with its own parameters."""
    needs = {*term.model.needs}
    held = {name: value for name, value in space.held.items() if name in needs}
    return Density(ParameterSpace(tuple(p for p in space.sampled if p.name in needs), held), (term,))
