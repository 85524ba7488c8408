"""Information that normal observations would give about draws of a posterior [nats].

An observation y of touch c is normal given draw s: its mean is m[s, c], its standard deviation that of the errors of
draw s. The information about everything that the draws hold is I = H(y) - mean over s of H(y | s). The information
about a quantity is H(y) - mean over its bins of H(y | bin): the draws of a bin form a mixture of normal laws. Entropies
of mixtures of one observation are sums over a grid of y; those of several observations, nested sums over draws, which
bracket the true value.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, ndtri, xlogy
from scipy.stats import multivariate_normal, rankdata

from softness_bayes.likelihood.design import FloatArray, IndexArray

BINS = {1: 20, 2: 5, 3: 3}
"""Number of rank bins of each quantity, by the number of quantities; two if there are more."""

LEAST_EFFECTIVE = 20.0
"""Effective number of draws below which expected standard deviations are those of the normal law."""

_REACH = 6.0  # standard deviations of the errors beyond the outermost means
_ROOT_TWO_PI = float(np.sqrt(2.0 * np.pi))
_CELLS = 320  # largest number of cells of a grid, which otherwise are at most one smallest error wide


def rank_shares(quantity: FloatArray) -> FloatArray:
    """Return the share of draws below each draw of a quantity, half of itself counting; NaN where it is NaN."""
    return (rankdata(quantity, nan_policy="omit") - 0.5) / max(np.isfinite(quantity).sum(), 1)


def rank_bins(*quantities: FloatArray) -> IndexArray:
    """Return the bin of each draw by the rank of a quantity, or of several, each with fewer bins; shape (draws,).

    Draws without it (NaN) are in a bin of their own. Equal values share a bin, so that two labels, such as those of two
    readings, form two bins.
    """
    number = BINS.get(len(quantities), 2)
    bins = np.stack([np.floor(np.nan_to_num(rank_shares(one), nan=1.0) * number) for one in quantities])
    return np.unique(bins, axis=1, return_inverse=True)[1].astype(np.intp).ravel()


def rank_scores(quantity: FloatArray) -> FloatArray:
    """Return the normal scores of the ranks of a quantity, shape (draws,); 0 for draws without it (NaN)."""
    return np.nan_to_num(ndtri(rank_shares(quantity)))


def told_of_mean(centred: FloatArray, wanted: Sequence[FloatArray]) -> FloatArray:
    """Return centred means (draws, touches) as a linear law predicts them from the wanted quantities.

    It takes the scores of the quantities and whether draws have them; without quantities, all is known.
    """
    if not wanted:
        return centred
    scores = np.stack([*map(rank_scores, wanted), *map(np.isfinite, wanted)], axis=1)
    scores = scores - scores.mean(axis=0)
    return np.asarray(scores @ np.linalg.lstsq(scores, centred, rcond=1e-6)[0])


def single_gains(
    mean: FloatArray, sd: FloatArray, quantities: Sequence[IndexArray] = (), weight: FloatArray | None = None
) -> FloatArray:
    """Return the information that one observation of each touch gives, shape (touches,).

    The sum over a grid with steps of one standard deviation errs by less than 1e-6. Where the range of the means has
    more steps than the grid may have, errors below a step count as a step, which understates the information.

    Parameters
    ----------
    mean
        Mean of the observation of each touch at each draw, shape (draws, touches).
    sd
        Standard deviation of its errors, the same shape, or (draws, 1) or (1, 1).
    quantities
        Bins of the draws (draws,) by the quantities of interest, whose information is summed; by default the
        information is about all that the draws hold.
    weight
        Weights of the draws, shape (draws,); equal by default.
    """
    draws, touches = mean.shape
    share = np.full(draws, 1.0 / draws) if weight is None else weight / weight.sum()
    # the mixture of few draws has too little entropy, also if the bins have nothing to do with the touches
    unrelated = [np.random.default_rng(0).permutation(bins) for bins in quantities]
    groups = [*quantities, *unrelated] or [np.zeros(draws, np.intp)]
    member = np.concatenate([np.eye(int(bins.max()) + 1)[bins] for bins in groups], axis=1)
    mass = share @ member
    sign = np.repeat([-1.0] * len(quantities) + [1.0] * (len(unrelated) or 1), [bins.max() + 1 for bins in groups])
    found = np.empty(touches)
    for k, (m, s) in enumerate(zip(mean.T, np.broadcast_to(sd, mean.shape).T, strict=True)):
        low, high = (m - _REACH * s).min(), (m + _REACH * s).max()
        at, step = np.linspace(low, high, int(min((high - low) / s.min(), _CELLS)) + 2, retstep=True)
        s = np.maximum(s, step)
        density = np.exp(-0.5 * ((at[:, None] - m) / s) ** 2) @ (member * (share / s)[:, None]) / _ROOT_TWO_PI
        mixed = density / np.maximum(mass, 1e-300)
        entropy = -xlogy(mixed, mixed).sum(axis=0) * step
        found[k] = (sign * mass) @ entropy
        if not quantities:
            found[k] -= share @ np.log(s * _ROOT_TWO_PI) + 0.5
    return found


def linear_gain(whole: FloatArray, rest: FloatArray) -> float:
    """Return the information of several observations by a normal law.

    Parameters
    ----------
    whole
        Covariance of the observations, shape (k, k).
    rest
        Their covariance once that which is to be learnt is known.
    """
    return float(0.5 * (np.linalg.slogdet(whole)[1] - np.linalg.slogdet(rest)[1]))


class Bracket(NamedTuple):
    """Information of a batch of observations between two nested estimates [nats]."""

    low: float
    high: float
    se: float
    """Monte-Carlo standard error of both."""
    effective: float
    """Median effective number of draws that explain a simulated outcome."""
    sd_ratio: dict[str, float]
    """Expected posterior sd relative to the present one, of each quantity."""


def nested_gain(
    rng: np.random.Generator,
    mean: FloatArray,
    errors: FloatArray,
    quantities: Mapping[str, FloatArray],
    about: Sequence[str] = (),
    outcomes: int = 256,
) -> Bracket:
    """Return the information of several observations together, by outcomes simulated at some of the draws.

    The density of an outcome is a mean over draws. With the draw that made the outcome, it is too large; without it,
    too small (on average, of its logarithm): the information lies between both. The same sums under the normal law of
    `linear_gain`, whose mean is known, remove the part of their sampling error that is correlated with them.

    Parameters
    ----------
    rng
        Random generator of outcomes.
    mean
        Means of the observations at each draw, shape (draws, k).
    errors
        Their covariance at each draw, shape (draws, k, k).
    quantities
        Quantities by name, each (draws,), NaN where a draw has none.
    about
        Names of those about which information is wanted; none for all that the draws hold.
    outcomes
        Number of outcomes.
    """
    draws, k = mean.shape
    wanted = [quantities[name] for name in about]
    bins = rank_bins(*wanted) if wanted else np.arange(draws)
    root = np.linalg.cholesky(errors)
    inverse = np.linalg.inv(root)
    log_det = np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
    origin = rng.permutation(draws)[:outcomes]
    outcome = mean[origin] + np.einsum("oij,oj->oi", root[origin], rng.standard_normal((origin.size, k)))
    white_mean = np.einsum("sij,sj->si", inverse, mean)
    squares = [((np.einsum("sij,j->si", inverse, y) - white_mean) ** 2).sum(axis=1) for y in outcome]
    log_density = -0.5 * np.stack(squares) - log_det
    itself, alike = origin[:, None] == np.arange(draws), bins[origin][:, None] == bins
    # a draw that is alone in its bin is known once its bin is
    others_alike = alike & (~itself | (alike.sum(axis=1) == 1)[:, None])
    high = _log_mean(log_density, alike) - _log_mean(log_density, ~itself)
    low = _log_mean(log_density, others_alike) - _log_mean(log_density, np.ones_like(itself))
    centred = mean - mean.mean(axis=0)
    known, whole = told_of_mean(centred, wanted), centred.T @ centred / draws + errors.mean(axis=0)
    rest = whole - known.T @ known / draws
    from_mean = outcome - mean.mean(axis=0)
    control = multivariate_normal.logpdf(from_mean - known[origin], cov=rest) - linear_gain(whole, rest)
    control -= multivariate_normal.logpdf(from_mean, cov=whole)
    control *= np.cov(control, 0.5 * (low + high))[0, 1] / (control.var(ddof=1) or 1.0)
    others = np.where(itself, -np.inf, log_density)
    weight = np.exp(others - logsumexp(others, axis=1, keepdims=True))
    effective = float(np.median(1.0 / (weight**2).sum(axis=1)))
    if effective < LEAST_EFFECTIVE:
        slopes = {name: centred.T @ rank_scores(values) / draws for name, values in quantities.items()}
        explained = {name: slope @ np.linalg.solve(whole, slope) for name, slope in slopes.items()}
        sd_ratio = {name: float(np.sqrt(max(1.0 - share, 0.0))) for name, share in explained.items()}
    else:
        sd_ratio = {name: _sd_ratio(weight, values) for name, values in quantities.items()}
    middle = 0.5 * (low + high) - control
    se = float(np.std(middle, ddof=1) / np.sqrt(origin.size))
    return Bracket(float((low - control).mean()), float((high - control).mean()), se, effective, sd_ratio)


def _log_mean(log_density: FloatArray, chosen: NDArray[np.bool_]) -> FloatArray:
    """Return the log of the mean density over the chosen draws, for each outcome."""
    return np.asarray(logsumexp(np.where(chosen, log_density, -np.inf), axis=1) - np.log(chosen.sum(axis=1)))


def _sd_ratio(weight: FloatArray, quantity: FloatArray) -> float:
    """Return the root mean square of the posterior sd over outcomes, relative to that of the draws."""
    there = np.isfinite(quantity)
    value, share = quantity[there], weight[:, there]
    total = share.sum(axis=1)  # of an outcome, the probability that the quantity exists
    if not (total.sum() > 0 and np.ptp(value) > 0):
        return 1.0
    value = (value - value.mean()) / value.std()
    share = share / np.where(total > 0, total, 1.0)[:, None]
    # few effective draws spread too little about their own mean
    spread = (share @ value**2 - (share @ value) ** 2) / np.maximum(1.0 - (share**2).sum(axis=1), 1e-9)
    return float(np.sqrt(total @ spread / total.sum()))
