"""Checks of a fitted model at draws of its posterior: deviations of residuals, leave-one-out ranks, plate forces.

A check of residuals asks whether they deviate together within groups of ratings. With a regressor x_i of each rating,
the discrepancy is

    T = sum over groups of (sum_i x_i r_i)² / sum_i x_i²,

over the ratings i of a group, with residuals r_i at a draw of all parameters and effects. Residuals of replicated
ratings are independent N(0, varsigma²), so that T / varsigma² follows a chi-squared law with one degree of freedom for
each group in which x varies: no replicate needs to be drawn. At a single draw the p-value is uniform under the model;
its mean over draws varies less, which makes the checks conservative.

All that checks need of an observation model is called here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.special import chdtrc, chdtri, ndtri, polygamma

from softness_bayes.base import arviz_bridge
from softness_bayes.checking.provenance import Finding, PlateData
from softness_bayes.checking.quantities import PIT, SUMMARIES
from softness_bayes.likelihood.contract import Effects, Likelihood, Parameters, RowsLeftOut
from softness_bayes.likelihood.layout import Layout
from softness_bayes.likelihood.pieces import pieces
from softness_bayes.likelihood.plate import CompressionForces
from softness_bayes.likelihood.scales import STANDARDISED

Array = NDArray[np.float64]
IndexArray = NDArray[np.intp]

CONDITIONS, FABRICS, LOADS = (
    "deviations of mean ratings",
    "fabrics' own deviations",
    "deviations between a fabric's loads",
)
EXPONENTS, NOISE, DEVIATIONS = "participants' own exponents", "participants' own noise", "standard deviations of cells"
ALONG, SKINS = "deviations along the response's slope", "raters' deviations along the skin's slope"
DRIFT = "drift over trials"
"""Names of the checks in tables."""

SLOPES: Mapping[str, tuple[bool, tuple[str, ...]]] = {
    EXPONENTS: (True, ("--individual gamma",)),
    SKINS: (True, ("--individual b",)),
    ALONG: (False, ("--modulus-cv 0.15", "--shared-modulus-cv 0.3")),
}
"""Checks along slopes of the response: whether within raters (or within fabrics), and what would model them."""

MODULUS_STEP, SKIN_STEP = 0.05, 0.1
"""Changes of a fabric's log modulus (a third of typical errors between laboratories), and of the skin's ln b, over
which slopes of the response are computed."""

FLAT = 1e-6
"""Root mean square of a regressor in a group below which the group carries no information."""

NOTICED = 0.8
"""Power for which the detectable deviation is reported."""

LEVEL = 0.05
"""Predictive p-value below which deviations are considered real."""

CHECKS = len([CONDITIONS, FABRICS, NOISE, DEVIATIONS, DRIFT, PIT, *SLOPES, *SUMMARIES])
"""Number of checks that share this level, for the power of each."""

OMEGA, READINGS = "--prior omega='halfnormal(0.5)'", "another --reading"
"""Remedies for fabrics that deviate each in its own way, and for a response of a wrong shape."""

FEWEST = 3
"""Smallest number of ratings of a rater whose scatter is checked."""


class Residuals:
    """Residuals of ratings at draws of the posterior.

    Parameters
    ----------
    observation
        The ratings.
    mean_rate
        N/N_ref [Hz], shape (draws, ...), as for `Likelihood.residual`.
    parameters, effects
        Draws of the rating model's parameters, shape (draws,), and of the effects given them.

    Attributes
    ----------
    response
        Predictor of the ratings in each condition, shape (draws, conditions).
    sd
        Standard deviation of single residuals, shape (draws,).
    """

    def __init__(self, observation: Likelihood, mean_rate: Array, parameters: Parameters, effects: Effects) -> None:
        self.observation, self.mean_rate, self.parameters, self.effects = observation, mean_rate, parameters, effects
        self.response: Array = observation.predictor(mean_rate, parameters)
        self.sd: Array = np.broadcast_to(observation.model.error_sd(parameters), len(mean_rate))

    def sums(
        self, group: IndexArray, size: int, regressor: Array | None = None, power: int = 1, weight: Array | None = None
    ) -> Array:
        """Return sums of residuals over the ratings of each group, shape (draws, groups).

        Parameters
        ----------
        group
            Index of each rating's group, shape (rows,).
        size
            Number of groups.
        regressor
            Value that multiplies the residuals of each condition, shape (draws, conditions); by default 1.
        power
            Power of the residuals.
        weight
            Value that multiplies each residual, shape (rows,); by default 1.
        """
        rows, condition = group.size, self.observation.design.condition
        member = csr_array((np.ones(rows) if weight is None else weight, (group, np.arange(rows))), shape=(size, rows))
        found = np.empty((len(self.mean_rate), size))
        for k in pieces(len(found), rows):
            values = self.observation.residual(self.mean_rate[k], self.parameters.part(k), self.effects.part(k))
            values = values**power if regressor is None else values * regressor[k][:, condition]
            found[k] = (member @ values.T).T
        return found

    def project(
        self, group: IndexArray, size: int, regressor: Array | None = None, centred: bool = False
    ) -> Projection:
        """Return the projections of the residuals on a regressor within groups of ratings.

        Parameters
        ----------
        group, size, regressor
            As for `sums`.
        centred
            Whether the regressor's mean over each group is subtracted.
        """
        design = self.observation.design
        cells = csr_array((np.ones(design.n_rows), (group, design.condition)), shape=(size, design.n_conditions))
        count, ones = cells.sum(axis=1), np.ones((1, design.n_conditions))
        x = ones if regressor is None else regressor
        weight, along = (cells @ (x**2).T).T, self.sums(group, size, regressor)
        if centred:
            mean = (cells @ x.T).T / np.maximum(count, 1.0)
            weight, along = weight - count * mean**2, along - mean * self.sums(group, size)
        weight = np.where(weight > FLAT**2 * count, weight, 0.0)
        return Projection(along, np.broadcast_to(weight, along.shape), self.sd)


class Projection:
    """Projections of residuals on a regressor within groups.

    Parameters
    ----------
    along, weight
        Sums of x r and of x² over each group, shape (draws, groups); the weight of a group without a slope is 0.
    sd
        Standard deviation of single residuals, shape (draws,).

    Attributes
    ----------
    squares, freedom
        The discrepancy T, and the number of groups with a slope, shape (draws,).
    p_value
        Probability that replicated ratings deviate at least as much; NaN if no group has a slope in any draw.
    deviation
        Standard deviation of the groups' coefficients of x, estimated from the excess of T over noise.
    """

    def __init__(self, along: Array, weight: Array, sd: Array) -> None:
        self.along, self.weight, self.sd = along, weight, sd
        self._scores = np.divide(along**2, weight, out=np.zeros_like(along), where=weight > 0)
        self.squares, self.freedom = self._scores.sum(axis=1), (weight > 0).sum(axis=1).astype(float)
        self.p_value, self.deviation, judged = _p_value(self.squares, self.freedom, sd), 0.0, self.freedom > 0
        if judged.any():
            excess = (self.squares - self.freedom * sd**2)[judged] / weight.sum(axis=1)[judged]
            self.deviation = float(np.sqrt(max(np.median(excess), 0.0)))

    @property
    def gain(self) -> float:
        """Largest gain in the log-likelihood from normal random coefficients of x, mean over draws.

        A coefficient of standard deviation s adds log N(a; 0, sd² + s² w) - log N(a; 0, sd²) for the standardised
        projection a of each group.
        """
        if not (self.freedom > 0).any():
            return np.nan
        scale = self.sd[:, None] ** 2
        score = self._scores / scale
        ratio = np.geomspace(0.01, 1e4, 40)[:, None, None] * self.weight / self.weight.max() / scale * scale.mean()
        return float((0.5 * (score * ratio / (1.0 + ratio) - np.log1p(ratio))).sum(axis=-1).mean(axis=-1).max())


def _p_value(squares: Array, freedom: Array, sd: Array) -> float:
    """Return the probability of a larger sum of squares, averaged over the draws with degrees of freedom."""
    judged = freedom > 0
    return float(chdtrc(freedom[judged], (squares / sd**2)[judged]).mean()) if judged.any() else np.nan


def likeness(modulus: Array, load: IndexArray) -> Array:
    """Return how alike the errors of a response of a wrong shape are, shape (conditions, conditions).

    Their correlation falls as exp(-distance) with the distance of the logs of E_fab, as of a curve with kinks; under
    different loads they are independent.

    Parameters
    ----------
    modulus
        E_fab of each condition, shape (conditions,).
    load
        Index of each condition's load, shape (conditions,).
    """
    place = np.log(modulus)
    return np.exp(-np.abs(place[:, None] - place)) * (load[:, None] == load)


def check_fabrics(
    residuals: Residuals, names: Sequence[str], alike: Array | None = None
) -> tuple[Finding, Finding, Finding]:
    """Compare the variation of residuals between conditions, fabrics, and the loads of a fabric, with noise.

    A condition is a fabric under a load. The sum of squares between conditions is the sum of that between fabrics,
    whose deviations are the same under every load, and that within fabrics, whose deviations differ between loads.
    Fabrics that deviate each in its own way, alike under all loads, need an effect of each. A response of a wrong shape
    makes fabrics of similar moduli deviate alike under one load: where such effects, of one variance too, would gain
    more, another reading is the remedy.

    Parameters
    ----------
    residuals
        Residuals at draws of the posterior.
    names
        Name of each condition.
    alike
        `likeness` of the conditions; None if their moduli are not known.
    """
    design, model = residuals.observation.design, residuals.observation.model
    each = residuals.project(design.condition, design.n_conditions)
    fabrics = residuals.project(design.fabric[design.condition], design.n_fabrics)
    rated = np.flatnonzero(each.weight[0] > 0)
    count, along, sd = each.weight[0, rated], each.along[:, rated], residuals.sd
    errors = (along / np.sqrt(count) / sd[:, None]).mean(axis=0)
    worst = int(np.abs(errors).argmax())
    # a deviation's variance, times n/varsigma², is added to the scale of the law
    scale = chdtri(rated.size, LEVEL / CHECKS) / chdtri(rated.size, NOTICED)
    advice = (OMEGA,) if "omega" in model.needs else ()
    remedy, gain = advice, fabrics.gain
    if alike is not None:
        root = np.sqrt(count)
        size, axes = np.linalg.eigh(root[:, None] * alike[np.ix_(rated, rated)] * root)
        size = np.maximum(size, 0.0)  # rounding may take one that is 0 below it
        bent = Projection(along / root @ axes * np.sqrt(size), np.broadcast_to(size, along.shape), sd).gain
        if bent > gain:
            remedy, gain = (READINGS,), bent
    within = each.freedom - fabrics.freedom
    return (
        Finding(
            CONDITIONS,
            each.p_value,
            each.deviation,
            noticed=float(np.median(sd) * np.sqrt((scale - 1.0) / count.mean())),
            groups=rated.size,
            worst=names[rated[worst]],
            worst_estimate=float((along[:, worst] / count[worst]).mean()),
            worst_errors=float(errors[worst]),
            unit=model.scale.unit,
            advice=remedy,
            gain=gain,
        ),
        Finding(FABRICS, fabrics.p_value, fabrics.deviation, unit=model.scale.unit, advice=advice, gain=fabrics.gain),
        Finding(LOADS, _p_value(np.maximum(each.squares - fabrics.squares, 0.0), within, sd)),
    )


def check_slope(
    residuals: Residuals, name: str, slope: Array, modelled: bool = False, available: bool = True
) -> Finding:
    """Compare residuals along a slope of the response, within raters or fabrics, with noise.

    `EXPONENTS`: along the logarithm of the response (z-scores: the standardised response) about its mean over the
    rater's ratings, which shows differences of exponents. `SKINS`: along the slope in ln b, in the same way. It is
    not proportional to the response, so that neither the rater's scale nor an exponent accounts for such deviations.
    `ALONG`: along the slope in each fabric's log modulus, where wrong moduli move mean ratings by the same relative
    error under every load. The fit absorbs most effects of wrong moduli, so that this check has little power.

    Parameters
    ----------
    residuals
        Residuals at draws of the posterior.
    name
        The check.
    slope
        Value of each condition, shape (draws, conditions): `Residuals.response`, or the derivative of
        `Likelihood.drive`.
    modelled, available
        Whether the model includes such deviations, and whether there is such a model.
    """
    of_raters, advice = SLOPES[name]
    design = residuals.observation.design
    group, size = design.fabric[design.condition], design.n_fabrics
    if of_raters:
        group, size = design.participant, design.n_participants
    found = residuals.project(group, size, slope, centred=of_raters)
    # one rater's slope is no difference
    judged = not of_raters or bool((found.freedom >= 2).any())
    return Finding(
        name,
        found.p_value if judged else np.nan,
        found.deviation if name == EXPONENTS else np.nan,
        modelled=modelled,
        advice=advice if available and not modelled else (),
        gain=found.gain,
    )


def check_drift(residuals: Residuals, order: Array) -> Finding:
    """Compare the slope of the residuals along the order of trials with noise.

    Only the part of the order that raters and conditions do not determine shows a drift: where loads came in blocks,
    the model absorbs the rest. The estimate is the change of ratings from the first to the last trial of a rater.

    Parameters
    ----------
    residuals
        Residuals at draws of the posterior.
    order
        `Ratings.order`.
    """
    design, unit = residuals.observation.design, residuals.observation.model.scale.unit
    alike = np.zeros(design.n_conditions, np.intp)
    found = Layout(design, alike.astype(float), alike, scale=STANDARDISED).fit(order)
    left = order - found.condition[design.condition] - found.participant[design.participant]
    weight = float(left @ left)
    if weight < FLAT * order.size:
        return Finding(DRIFT, np.nan)
    along = residuals.sums(np.zeros(order.size, np.intp), 1, weight=left)[:, 0]
    p_value = float(chdtrc(1.0, along**2 / weight / residuals.sd**2).mean())
    seen = float(np.median(residuals.sd)) / np.sqrt(weight) * (ndtri(1.0 - LEVEL / CHECKS / 2.0) + ndtri(NOTICED))
    gain = float(0.5 * (along**2 / weight / residuals.sd**2 - 1.0).mean())
    return Finding(
        DRIFT, p_value, float(along.mean() / weight), noticed=float(seen), unit=unit, advice=("--drift",), gain=gain
    )


def check_noise(residuals: Residuals, modelled: bool = False, available: bool = True, robust: bool = False) -> Finding:
    """Compare the scatter of raters' residuals with that expected for equal noise.

    The discrepancy is Bartlett's, T = N ln(sum_p S_p / N) - sum_p n_p ln(S_p / n_p), with S_p the sum of squares of
    rater p's n_p residuals. For replicated ratings S_p is chi-squared up to a common factor, which cancels; the law of
    T is drawn once. Raters with fewer than `FEWEST` ratings are left out.

    Parameters
    ----------
    residuals
        Residuals at draws of the posterior.
    modelled, available
        Whether the model has individual noise, and whether there is such a model.
    robust
        Whether the errors already have heavy tails, or lapses.
    """
    design = residuals.observation.design
    rows = design.cells.sum(axis=1)
    judged = rows >= FEWEST
    useful = {
        "--individual varsigma": available and not modelled,
        "--errors lapses or student": not (modelled or robust),
    }
    advice = tuple(option for option, helps in useful.items() if helps)
    if judged.sum() < 2:
        return Finding(NOISE, np.nan, 0.0, modelled=modelled, advice=advice)
    count = rows[judged]
    squares = residuals.sums(design.participant, design.n_participants, power=2)[:, judged].clip(1e-300)
    reference = np.random.default_rng(0).chisquare(count, (4000, count.size))
    law = np.sort(_bartlett(reference, count))
    found = _bartlett(squares, count)
    above = law.size - np.searchsorted(law, found * (1.0 - 1e-12))
    # half of the variance of log S, part of which is due to chance
    log_noise = 0.5 * (np.log(squares / count) - np.log(squares.sum(axis=1) / count.sum())[:, None])
    chance = 0.25 * polygamma(1, 0.5 * count).mean()
    excess = float(np.median(log_noise.var(axis=1, ddof=1))) - float(chance)
    p_value = float(((above + 1.0) / (law.size + 1.0)).mean())
    gain = 0.5 * float((found - law.mean()).mean())  # half the excess of the likelihood ratio
    return Finding(NOISE, p_value, float(np.sqrt(max(excess, 0.0))), modelled=modelled, advice=advice, gain=gain)


def _bartlett(squares: Array, count: Array) -> Array:
    whole = count.sum() * np.log(squares.sum(axis=-1) / count.sum())
    return np.asarray(whole - (count * np.log(squares / count)).sum(axis=-1))


def check_spreads(term: Likelihood, mean_rate: Array, parameters: Parameters, rng: np.random.Generator) -> Finding:
    """Compare the normal scores of the cells' standard deviations with those of replicates.

    The model has the same noise in every cell. If noise depends on the fabric or the load, or not all cells have the
    stated number of raters, the standard deviations of the cells differ by more. The scores of replicates are standard
    normal; the estimate is their root mean square, 1 under the model.

    Parameters
    ----------
    term
        The standard deviations, as `likelihood.aggregated.RaterSpreads`.
    mean_rate
        As for `Likelihood.residual`, shape (draws, ...).
    parameters
        Draws of the parameters of the term's model, shape (draws,).
    rng
        Random generator for the panels' scatter.
    """
    effects = term.draw_effects(rng, mean_rate, parameters)
    squares = term.residual(mean_rate, parameters, effects) ** 2
    p_value = float(chdtrc(squares.shape[-1], squares.sum(axis=-1)).mean())
    return Finding(DEVIATIONS, p_value, float(np.sqrt(squares.mean())))


class LooPit(NamedTuple):
    """LOO-PIT values and their reliability, arrays of shape (rows,)."""

    value: Array
    """Probability of a smaller rating; each is uniform under the model, but they are not independent."""
    pareto_k: Array
    """Pareto k of the importance weights; above 0.7 they are unreliable."""


def loo_pit(left_out: RowsLeftOut, discrete: NDArray[np.bool_]) -> LooPit:
    """Return the probability integral transform of each rating in its leave-one-out predictive distribution.

    With the effects of participants and fabrics integrated out, p(y_i | y_-i, theta) is known in closed
    form. It is averaged over theta with importance weights 1 / p(y_i | y_-i, theta), smoothed by a generalised Pareto
    law, which turn draws given all ratings into draws given the others (Bürkner, Gabry and Vehtari, Computational
    Statistics 36, 1243, 2021). For discrete ratings, the transform is randomised within the probability of the rating
    by a fixed random number.

    Parameters
    ----------
    left_out
        Predictive laws of the ratings at draws of the parameters, arrays of shape (draws, ratings).
    discrete
        True for ratings whose density is a probability, shape (ratings,).
    """
    alone, below = left_out
    if discrete.any():
        below, share = below.copy(), np.random.default_rng(0).uniform(-0.5, 0.5, int(discrete.sum()))
        below[:, discrete] += share * np.exp(alone[:, discrete])
    value, pareto_k = np.empty(alone.shape[1]), np.empty(alone.shape[1])
    for k in pieces(alone.shape[1], len(alone)):
        log_weights, pareto_k[k] = arviz_bridge.psis(-alone[:, k].T)
        value[k] = (np.exp(log_weights) * below[:, k].T).sum(axis=1)
    return LooPit(np.clip(value, 0.0, 1.0), pareto_k)


def check_exponent(forces: CompressionForces, replicated: Array, digest: str, zeros: int) -> PlateData:
    """Compare the exponent of force against indentation with that of replicated forces (draws, rows) [N].

    `digest` is that of the data, and `zeros` its number of forces of 0.
    """
    observed, again = float(forces.exponent(forces.values)), forces.exponent(replicated)
    low, high = np.quantile(again, [0.05, 0.95])
    tail = min(float((again >= observed).mean()), float((again <= observed).mean()))
    each = forces.values.size / forces.n_fingers
    return PlateData(digest, zeros, each, observed, float(low), float(high), min(1.0, 2.0 * tail))
