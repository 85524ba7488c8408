"""Likelihood of recorded afferents, with the sensitivity of each named afferent integrated out.

With lambda the rate of `response.ProbedTouches` and f_j the factor of afferent j (1 in rows that average several),

    mean rates     y = max(0, z), z ~ N(f_j lambda, sd²), sd stated or `sd_rate`
    counts         k ~ law of mean f_j lambda window and variance `fano` times the mean
    factors        ln f_j ~ N(-tau²/2, tau²), tau = `tau_afferent`, of mean 1, with two or more named afferents
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import betainc, gammainc, gammaincc, gammaln, log_ndtr, ndtr

from softness_bayes.base.laws import LOG_TWO_PI
from softness_bayes.data.measurements import Afferents
from softness_bayes.likelihood.contract import Effects, Levels, Parameters, RowsLeftOut, Shape, Term
from softness_bayes.likelihood.pieces import in_pieces, left_out_in_pieces, log_sum
from softness_bayes.likelihood.quadrature import draw_on_nodes
from softness_bayes.model.recordings.response import Afferent, ProbedTouches
from softness_bayes.parameters.declared import RECORDED

Array = NDArray[np.float64]

SILENT = 0.1
"""Rate [Hz] added to that of counts, so that a spike of an afferent predicted to be silent has a finite probability."""

STRAY = 1e-6
"""Share of under-dispersed counts with Poisson's law, whose tails keep the log probability of every count finite."""

_NODES = np.linspace(-7.0, 7.0, 15)  # the trapezoidal rule errs by exp(-2 pi²) for a normal integrand


@dataclass(frozen=True)
class RecordingModel:
    """The model of recorded afferents without data.

    Parameters
    ----------
    needs
        Names of its parameters: those of `RECORDING_PARAMETERS`, and those shared with ratings and plates.
    """

    needs: tuple[str, ...]

    @classmethod
    def of(cls, data: Afferents, shared: tuple[str, ...] = (), freed: tuple[str, ...] = ()) -> RecordingModel:
        """Return the model of a table.

        Parameters
        ----------
        data
            The table, which decides on the parameters of errors.
        shared
            Parameters of the chain, of `SHAREABLE`, that recorded afferents share with ratings and plates.
        freed
            Optional parameters, of `OPTIONAL_RECORDING`, that are sampled.
        """
        chain = tuple(name if name in shared else f"{name}_rec" for name in ("b", "m", "alpha", "beta"))
        threshold = "sigma_0" if "sigma_0" in shared else "rest_rec"
        errors = {
            "sd_rate": bool((~data.counted & np.isnan(data.sd)).any()),
            "tau_afferent": len(data.names) > 1,
            "fano": bool(data.counted.any()),
        }
        return cls((*chain, threshold, *freed, *(name for name, has in errors.items() if has)))

    def afferent(self, parameters: Parameters) -> Afferent:
        """Return the parameters of the response in SI."""
        named = {name.removesuffix("_rec"): getattr(parameters, name) for name in self.needs}
        return Afferent(**{name: named[name] for name in Afferent._fields if name in named})


class _Given(NamedTuple):
    """Sensitivities at nodes about each afferent's mode; arrays (nodes, ..., afferents or named rows)."""

    factor: Array
    """ln f_j."""
    log_weight: Array
    """Log of the joint density of sensitivity and rows, times the distance of nodes."""
    rows: Array
    """Log density of each named row."""


class RecordedRates(Term):
    """Rates and counts of afferents under a `RecordingModel`.

    Parameters
    ----------
    data
        The table.
    touches
        Its probes on a finger, row by row.
    model
        The model.
    """

    name: ClassVar[str] = RECORDED

    def __init__(self, data: Afferents, touches: ProbedTouches, model: RecordingModel) -> None:
        self.data, self.touches, self.model = data, touches, model
        varies = (data.afferent >= 0) & ("tau_afferent" in model.needs)
        self._named, self._single = np.flatnonzero(varies), np.flatnonzero(~varies)
        self._varying = data.take(self._named)
        self._member = np.eye(len(data.names))[self._varying.afferent]

    def with_values(self, rates: ArrayLike) -> Self:
        """Return the likelihood of other rates [Hz] in the same rows; those of counts are divided by their window."""
        return type(self)(replace(self.data, rate=np.asarray(rates, float)), self.touches, self.model)

    def without(self, rows: NDArray[np.bool_]) -> Self:
        """Return the likelihood of the other rows of the same afferents."""
        kept = np.flatnonzero(~rows)
        return type(self)(self.data.take(kept), self.touches.take(kept), self.model)

    def rate(self, parameters: Parameters) -> Array:
        """Return the rate of a typical afferent in every row [Hz], shape (..., rows)."""
        return self.touches.rate(self.model.afferent(parameters))

    def log_likelihood(self, mean_rate: Array, parameters: Parameters) -> Array:
        """Return the log density of all rows together, shape (...)."""
        rate = self.rate(parameters)
        found = self._law(parameters, self.data).log_density(rate)[..., self._single].sum(axis=-1)
        if self._named.size:
            found = found + log_sum(self._given(rate, parameters).log_weight, axis=0).sum(axis=-1)
        return np.asarray(found)

    def left_out(self, mean_rate: Array, parameters: Parameters) -> RowsLeftOut:
        """Return the law of each row given all others, at the observation, arrays (..., rows)."""
        return left_out_in_pieces(self._left_out, 20 * len(self.data), mean_rate, parameters)

    def _left_out(self, mean_rate: Array, parameters: Parameters) -> RowsLeftOut:
        rate = self.rate(parameters)
        law = self._law(parameters, self.data)
        density, below = law.log_density(rate), law.below(rate)
        if self._named.size:
            given, of = self._given(rate, parameters), self.data.afferent[self._named]
            weight = given.log_weight[..., of] - log_sum(given.log_weight, axis=0)[..., of] - given.rows
            named = self._law(parameters, self._varying)
            density[..., self._named] = -log_sum(weight, axis=0)
            shares = np.exp(weight + density[..., self._named])
            below[..., self._named] = (
                shares * named.below(rate[..., self._named] * np.exp(given.factor[..., of]))
            ).sum(0)
        return RowsLeftOut(density, below)

    def new_effects(
        self, rng: np.random.Generator, parameters: Parameters, shape: Shape, levels: Levels = None
    ) -> Effects:
        """Return the sensitivities of new afferents, of batch ``shape``."""
        tau = np.asarray(parameters.tau_afferent if self._named.size else 0.0, float)[..., None]
        return Effects(log_factor=tau * rng.standard_normal((*shape, len(self.data.names))) - 0.5 * tau**2)

    def draw_effects(self, rng: np.random.Generator, mean_rate: Array, parameters: Parameters) -> Effects:
        """Return draws of the sensitivities given the rows, one for each point of the batch."""
        rate = self.rate(parameters)
        if not self._named.size:
            return self.new_effects(rng, parameters, rate.shape[:-1])

        def drawn(rate: Array, parameters: Parameters) -> Array:
            factor, log_weight, _ = (np.moveaxis(value, 0, -1) for value in self._given(rate, parameters))
            return draw_on_nodes(rng, factor, log_weight)

        return Effects(log_factor=in_pieces(drawn, 20 * len(self.data), rate, parameters))

    def replicate(self, rng: np.random.Generator, drive: Array, parameters: Parameters, effects: Effects) -> Array:
        """Return a rate [Hz] for every row at the rates `drive` of a typical afferent, shape (..., rows)."""
        return self._law(parameters, self.data).draw(rng, drive * self.factors(effects))

    def factors(self, effects: Effects) -> Array:
        """Return the factor of every row, shape (..., rows)."""
        found = np.ones((*effects.log_factor.shape[:-1], len(self.data)))
        found[..., self._named] = np.exp(effects.log_factor[..., self.data.afferent[self._named]])
        return found

    def _law(self, parameters: Parameters, data: Afferents) -> _Law:
        """Return the law of some rows."""
        needs, stated = self.model.needs, data.sd / np.sqrt(data.n)
        common, fano = (
            np.asarray(getattr(parameters, name) if name in needs else 1.0, float)[..., None]
            for name in ("sd_rate", "fano")
        )
        return _Law(data, np.where(np.isnan(stated), common, stated), fano)

    def _given(self, rate: Array, parameters: Parameters) -> _Given:
        """Return the sensitivities given the rows at nodes around their mode, found by Fisher's scoring in ln f = u."""
        law, r = self._law(parameters, self._varying), rate[..., self._named]
        tau2 = np.maximum(np.asarray(parameters.tau_afferent, float), 1e-6)[..., None] ** 2
        u = np.zeros((*r.shape[:-1], self._member.shape[1])) - 0.5 * tau2
        for _ in range(12):
            mean = r * np.exp(u @ self._member.T)
            weight = mean / law.variance(mean)
            info = (weight * mean) @ self._member + 1.0 / tau2
            score = (weight * (law.data.rate - mean)) @ self._member - u / tau2 - 0.5
            u = u + np.clip(score / info, -1.0, 1.0)
        width = 1.0 / np.sqrt(info)  # of the law about the mode, and between nodes
        factor = u + np.multiply.outer(_NODES, width)
        rows = law.log_density(r * np.exp(factor @ self._member.T))
        prior = -0.5 * (factor + 0.5 * tau2) ** 2 / tau2 - 0.5 * np.log(tau2) - 0.5 * LOG_TWO_PI
        return _Given(factor, rows @ self._member + prior + np.log(width), rows)


class _Law(NamedTuple):
    """Laws of some rows about their expected rate [Hz]; methods take rates (..., rows)."""

    data: Afferents
    sd: Array
    """Of mean rates [Hz], shape (..., rows)."""
    fano: Array
    """Variance of counts over their mean, shape (..., 1)."""

    def variance(self, rate: Array) -> Array:
        """Return the variance of the observed rates [Hz²]."""
        return np.where(self.data.counted, self.fano * (rate + SILENT) / self.data.window, self.sd**2)

    def log_density(self, rate: Array) -> Array:
        """Return the log density [1/Hz] of mean rates, and the log probability of silence and of counts."""
        observed = self.data.rate
        means = -0.5 * ((observed - rate) / self.sd) ** 2 - np.log(self.sd) - 0.5 * LOG_TWO_PI
        silent = observed == 0.0
        means[..., silent] = log_ndtr(-rate[..., silent] / self.sd[..., silent])
        return self._or_counts(means, rate, log_probability)

    def below(self, rate: Array) -> Array:
        """Return the probability of a smaller observation, half that of an equal one included."""

        def of_counts(count: Array, mean: Array, fano: Array) -> Array:
            return less_probability(count, mean, fano) + 0.5 * np.exp(log_probability(count, mean, fano))

        observed = self.data.rate
        means = np.where(observed > 0.0, 1.0, 0.5) * ndtr((observed - rate) / self.sd)
        return self._or_counts(means, rate, of_counts)

    def draw(self, rng: np.random.Generator, rate: Array) -> Array:
        """Return observed rates [Hz]; those of counts are counts over their window."""
        means = np.maximum(rate + self.sd * rng.standard_normal(rate.shape), 0.0)
        drawn = self._or_counts(means, rate, lambda count, mean, fano: draw_counts(rng, mean, fano))
        return drawn / np.where(self.data.counted, self.data.window, 1.0)

    def _or_counts(self, means: Array, rate: Array, of_counts: Callable[[Array, Array, Array], Array]) -> Array:
        """Return values of mean rates, and those of counts by a function of count, mean and dispersion."""
        rows = np.flatnonzero(self.data.counted)
        if rows.size:
            window, fano = self.data.window[rows], np.broadcast_to(self.fano, (*rate.shape[:-1], 1))
            means[..., rows] = of_counts(self.data.count[rows], (rate[..., rows] + SILENT) * window, fano)
        return means


def log_probability(count: Array, mean: Array, fano: Array) -> Array:
    """Return the log probability of counts with a mean and a ratio of variance to mean; arrays broadcast.

    Above a ratio of 1 the law is negative binomial. Below, spikes come at intervals of a gamma law of shape 1/fano and
    mean 1/mean (Winkelmann, J. Bus. Econ. Stat. 13, 467, 1995), whose counts have that variance, and a mean lower by
    (1 - fano)/2, in long windows; a share `STRAY` is Poisson's. Both are Poisson's law at a ratio of 1.
    """
    excess = np.maximum(fano - 1.0, 1e-9)
    size = mean / excess
    over = gammaln(count + size) - gammaln(size) - gammaln(count + 1) - size * np.log1p(excess)
    over = over + count * (np.log(excess) - np.log1p(excess))
    poisson = count * np.log(mean) - mean - gammaln(count + 1)
    shape = 1.0 / np.minimum(fano, 1.0)
    first, last, x = shape * np.maximum(count, 1e-300), shape * (count + 1), shape * mean
    with np.errstate(divide="ignore"):
        upper, lower = gammaincc(last, x) - gammaincc(first, x), gammainc(first, x) - gammainc(last, x)
        regular = np.log(np.maximum(np.where(x > last, upper, lower), 0.0))
    under = np.logaddexp(np.log1p(-STRAY) + regular, math.log(STRAY) + poisson)
    return np.where(fano > 1.0 + 1e-6, over, under)


def less_probability(count: Array, mean: Array, fano: Array) -> Array:
    """Return the probability of fewer spikes under the law of `log_probability`, without its stray share."""
    some, excess = np.maximum(count, 1.0), np.maximum(fano - 1.0, 1e-6)
    over = betainc(mean / excess, some, 1.0 / (1.0 + excess))
    shape = 1.0 / np.minimum(fano, 1.0)
    return np.where(count > 0, np.where(fano > 1.0, over, gammaincc(shape * some, shape * mean)), 0.0)


def draw_counts(rng: np.random.Generator, mean: Array, fano: Array) -> Array:
    """Draw counts of the law of `log_probability`, without its stray share: the largest with P(fewer) <= u, by bits."""
    found, u = np.zeros(mean.shape), rng.random(mean.shape)
    largest = np.max(mean + 10.0 * np.sqrt(np.maximum(fano, 1.0) * (mean + 1.0)) + 100.0 * fano, initial=1.0)
    for bit in range(int(np.log2(largest)), -1, -1):
        more = found + 2.0**bit
        found = np.where(less_probability(more, mean, fano) <= u, more, found)
    return found
