"""Information that normal observations would give about draws of a posterior [nats].

An observation y of touch c is normal given draw s: its mean is m[s, c], its standard deviation that of the errors of
draw s. The information about everything that the draws hold is I = H(y) - mean over s of H(y | s). The information
about a quantity is H(y) - mean over its bins of H(y | bin): the draws of a bin form a mixture of normal laws. Entropies
of mixtures of one observation come from histograms that are convolved with the errors; those of several observations,
from nested sums over draws, which bracket the true value.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, ndtri
from scipy.stats import rankdata

Array = NDArray[np.float64]
IndexArray = NDArray[np.intp]

BINS = 20
"""Number of rank bins of a quantity; draws without the quantity form a further one."""

LOG_2PI_E = float(np.log(2.0 * np.pi * np.e))

_MARGIN = 6.0  # standard deviations of the errors beyond the outermost means
_CLASSES = 12  # classes of draws with about equal errors
_STEP = 0.5  # width of a cell of the histogram, relative to the smallest error
_MOST_CELLS = 1 << 14


def rank_bins(quantity: Array, bins: int = BINS) -> IndexArray:
    """Return the bin of each draw by the rank of a quantity, shape (draws,).

    Draws without it (NaN) are in a bin of their own. Equal values share a bin, so that two labels, such as those of two
    readings, form two bins.
    """
    there = np.isfinite(quantity)
    found = np.full(quantity.size, bins, np.intp)
    if there.any():
        rank = rankdata(quantity[there], method="average")
        found[there] = np.minimum(((rank - 0.5) * bins / there.sum()).astype(np.intp), bins - 1)
    return np.unique(found, return_inverse=True)[1].astype(np.intp)


def rank_scores(quantity: Array) -> Array:
    """Return the normal scores of the ranks of a quantity, shape (draws,); 0 for draws without it (NaN)."""
    there = np.isfinite(quantity)
    found = np.zeros(quantity.size)
    found[there] = ndtri((rankdata(quantity[there]) - 0.5) / max(there.sum(), 1))
    return found


class Histograms:
    """Histograms of the means of each touch over the draws, from which mixtures of any groups of draws follow.

    Parameters
    ----------
    mean
        Mean of the observation of each touch at each draw, shape (draws, touches).
    sd
        Standard deviation of its errors, the same shape, or (draws, 1).
    weight
        Weights of the draws, shape (draws,); equal by default.
    """

    def __init__(self, mean: Array, sd: Array, weight: Array | None = None) -> None:
        self.mean, self.sd = mean, np.broadcast_to(sd, mean.shape)
        self.weight = np.full(len(mean), 1.0 / len(mean)) if weight is None else weight / weight.sum()
        low, high = (mean - _MARGIN * self.sd).min(axis=0), (mean + _MARGIN * self.sd).max(axis=0)
        cells = float(((high - low) / (_STEP * self.sd.min(axis=0))).max())
        self.n = int(min(2 ** np.ceil(np.log2(max(cells, 64.0))), _MOST_CELLS))
        self.step = (high - low) / (self.n - 1)
        place = (mean - low) / self.step
        cell = np.clip(np.rint(place).astype(np.intp), 1, self.n - 2)
        self._beside = place - cell
        # draws in classes of about equal errors, each with its own convolution
        log_sd = np.log(self.sd)
        least, most = log_sd.min(axis=0), log_sd.max(axis=0)
        width = np.maximum(most - least, 1e-12) / _CLASSES
        self._class = np.minimum(((log_sd - least) / width).astype(np.intp), _CLASSES - 1)
        column = np.arange(mean.shape[1])
        self._cell = (column * _CLASSES + self._class) * self.n + cell
        weighted = self.weight[:, None]
        flat = (column * _CLASSES + self._class).ravel()
        size = column.size * _CLASSES
        mass = np.bincount(flat, np.broadcast_to(weighted, mean.shape).ravel(), size)
        squares = np.bincount(flat, (weighted * self.sd**2).ravel(), size)
        with np.errstate(invalid="ignore"):
            self._variance = np.where(mass > 0, squares / mass, 1.0).reshape(-1, _CLASSES)
        # the quadratic spline that shares a draw between three cells widens its law by step² / 4
        self._kernel_variance = np.maximum(self._variance - self.step[:, None] ** 2 / 4.0, 0.0)

    def entropy(self, some: NDArray[np.bool_] | None = None) -> Array:
        """Return the entropy of each touch's mixture [nats], over all draws or a group of them, shape (touches,)."""
        weight = self.weight if some is None else np.where(some, self.weight, 0.0)
        weight = weight / weight.sum()
        columns = self.mean.shape[1]
        size, every = columns * _CLASSES * self.n, np.broadcast_to(weight[:, None], self.mean.shape)
        shares = 0.5 * (0.5 - self._beside) ** 2, 0.75 - self._beside**2, 0.5 * (0.5 + self._beside) ** 2
        parts = [
            np.bincount((self._cell + k).ravel(), (every * share).ravel(), size)
            for k, share in zip((-1, 0, 1), shares, strict=True)
        ]
        histogram = np.sum(parts, axis=0)
        spectrum = np.fft.rfft(histogram.reshape(columns, _CLASSES, self.n), axis=-1)
        frequency = np.fft.rfftfreq(self.n)[None, None, :] / self.step[:, None, None]
        spectrum *= np.exp(-2.0 * (np.pi * frequency) ** 2 * self._kernel_variance[..., None])
        density = np.fft.irfft(spectrum.sum(axis=1), self.n, axis=-1) / self.step[:, None]
        positive = np.maximum(density, 1e-300)
        return np.asarray(-(np.where(density > 0, density * np.log(positive), 0.0)).sum(axis=-1) * self.step)


def single_gains(histograms: Histograms, bins: IndexArray | None = None) -> Array:
    """Return the information that one observation of each touch gives, shape (touches,).

    Parameters
    ----------
    histograms
        Means and errors of the touches over the draws.
    bins
        Bin of each draw, if the information about one quantity is wanted; by default about all that the draws hold.
    """
    if bins is None:
        return np.asarray(histograms.entropy() - 0.5 * LOG_2PI_E - histograms.weight @ np.log(histograms.sd))
    # the mixture of few draws has too little entropy, also if the bins have nothing to do with the touches
    unrelated = np.random.default_rng(0).permutation(bins)
    return _entropy_within(histograms, unrelated) - _entropy_within(histograms, bins)


def gains_about(histograms: Histograms, quantities: Sequence[IndexArray]) -> Array:
    """Return `single_gains` about the bins of several quantities, summed; about all that the draws hold if none."""
    if not quantities:
        return single_gains(histograms)
    return np.asarray(sum(single_gains(histograms, bins) for bins in quantities))


def _entropy_within(histograms: Histograms, bins: IndexArray) -> Array:
    """Return the mean entropy of each touch's mixture within the bins, shape (touches,)."""
    within = np.zeros(histograms.mean.shape[1])
    for one in range(int(bins.max()) + 1):
        chosen = bins == one
        mass = float(histograms.weight[chosen].sum())
        if mass > 0:
            within += mass * histograms.entropy(chosen)
    return within


def linear_gain(covariance: Array, errors: Array, with_scores: Array | None = None) -> float:
    """Return the information of several observations by the normal law with their covariance.

    Parameters
    ----------
    covariance
        Covariance of the means over the draws, shape (k, k).
    errors
        Covariance of the observations given a draw, shape (k, k).
    with_scores
        Covariances of the means with uncorrelated scores of unit variance, shape (k, scores), if only these are to be
        learnt.
    """
    whole = covariance + errors
    rest = errors if with_scores is None else whole - with_scores @ with_scores.T
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
    mean: Array,
    errors: Array,
    quantities: Mapping[str, Array],
    bins: IndexArray | None = None,
    scores: Array | None = None,
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
    bins, scores
        Bin of each draw, and its uncorrelated scores (draws, scores), if the information about these is wanted.
    outcomes
        Number of outcomes.
    """
    draws, k = mean.shape
    root = np.linalg.cholesky(errors)
    inverse = np.linalg.inv(root)
    log_det = np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
    origin = rng.permutation(draws)
    if bins is not None:  # without the draw that made an outcome, its bin must hold others
        origin = origin[np.bincount(bins)[bins[origin]] > 1]
    origin = origin[:outcomes]
    outcome = mean[origin] + np.einsum("oij,oj->oi", root[origin], rng.standard_normal((origin.size, k)))
    white_mean = np.einsum("sij,sj->si", inverse, mean)
    log_density = np.empty((origin.size, draws))
    for row, y in enumerate(outcome):
        log_density[row] = -0.5 * ((np.einsum("sij,j->si", inverse, y) - white_mean) ** 2).sum(axis=1) - log_det
    itself = origin[:, None] == np.arange(draws)
    marginal = _log_mean(log_density, ~itself), _log_mean(log_density, np.ones_like(itself))
    if bins is None:
        known = -0.5 * k - log_det[origin]
        low, high = known - marginal[1], known - marginal[0]
    else:
        same = bins[origin][:, None] == bins
        low = _log_mean(log_density, same & ~itself) - marginal[1]
        high = _log_mean(log_density, same) - marginal[0]
    control = _normal_excess(mean, errors.mean(axis=0), outcome, None if bins is None else scores, origin)
    control *= np.cov(control, 0.5 * (low + high))[0, 1] / control.var(ddof=1)
    others = np.where(itself, -np.inf, log_density)
    weight = np.exp(others - logsumexp(others, axis=1, keepdims=True))
    ratios = {name: _sd_ratio(weight, values) for name, values in quantities.items()}
    middle = 0.5 * (low + high) - control
    return Bracket(
        float((low - control).mean()),
        float((high - control).mean()),
        float(np.std(middle, ddof=1) / np.sqrt(origin.size)),
        float(np.median(1.0 / (weight**2).sum(axis=1))),
        ratios,
    )


def _log_mean(log_density: Array, chosen: NDArray[np.bool_]) -> Array:
    """Return the log of the mean density over the chosen draws, for each outcome."""
    return np.asarray(logsumexp(np.where(chosen, log_density, -np.inf), axis=1) - np.log(chosen.sum(axis=1)))


def _normal_excess(mean: Array, errors: Array, outcome: Array, scores: Array | None, origin: IndexArray) -> Array:
    """Return each outcome's information under the normal law less its expectation, which is `linear_gain`."""
    centred = outcome - mean.mean(axis=0)
    whole = np.atleast_2d(np.cov(mean.T, bias=True)) + errors
    excess = 0.5 * ((centred @ np.linalg.inv(whole)) * centred).sum(axis=1) - 0.5 * centred.shape[1]
    if scores is None:
        return np.asarray(excess)
    slope = (mean - mean.mean(axis=0)).T @ scores / len(mean)
    rest = centred - scores[origin] @ slope.T
    inverse = np.linalg.inv(whole - slope @ slope.T)
    return np.asarray(excess + 0.5 * rest.shape[1] - 0.5 * ((rest @ inverse) * rest).sum(axis=1))


def _sd_ratio(weight: Array, quantity: Array) -> float:
    """Return the root mean square of the posterior sd over outcomes, relative to that of the draws."""
    there = np.isfinite(quantity)
    value = quantity[there] - quantity[there].mean()
    share = weight[:, there]
    total = share.sum(axis=1)
    mean, square = share @ value / total, share @ value**2 / total
    variance = (total @ (square - mean**2)) / total.sum()
    return float(np.sqrt(variance / value.var())) if value.var() > 0 else 1.0
