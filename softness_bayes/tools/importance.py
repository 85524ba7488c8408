"""Importance sampling of posteriors for programs that fit hundreds of simulated laboratories.

Proposals are multivariate t distributions. Each round has the mean and covariance of the weighted draws so far. All
draws of the last rounds are weighted together, with the mixture of the rounds' distributions as their density (adaptive
multiple importance sampling, Cornuet and colleagues, Scand. J. Stat. 39, 798, 2012). This takes about a hundredth of
the time of MCMC for the models of the shipped ratings, also with a modulus sampled for each fabric.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import gammaln

from softness_bayes.arviz_bridge import psis
from softness_bayes.model.posterior import Posterior

Array = NDArray[np.float64]

TAILS = 6.0
"""Degrees of freedom of proposals."""

WINDOW = 6
"""Number of last rounds whose draws are weighted together; earlier proposals are far from the posterior."""

FIRST = 1.0 / 3.0
"""Spread of the first proposal, in that of the prior."""

MOST = 40
"""Largest number of rounds."""

TRUSTED = 0.7
"""Pareto's k above which weighted draws cannot be trusted (Vehtari and colleagues, JMLR 25, 72, 2024)."""

GOOD = 0.6
"""Pareto's k up to which no further round is needed."""

EACH = 8.0
"""Least effective number of draws, for each parameter, of which a round's mean and covariance are computed. As long as
a few draws dominate, weights are flattened."""

BATCH = 500
"""Number of points evaluated together."""


class Effort(NamedTuple):
    """Size of importance sampling."""

    proposals: int = 1000
    """Number in each round."""
    effective: float = 800.0
    """Effective number of draws at which it ends, if Pareto's k is at most `GOOD`."""


USUAL = Effort()


class Weighted(NamedTuple):
    """Weighted draws of a posterior."""

    theta: Array
    """Draws in natural units, shape (draws, parameters)."""
    weight: Array
    """Pareto-smoothed weights, whose sum is 1, shape (draws,)."""
    k: float
    """Pareto's shape of the weights."""
    effective: float
    """Effective number of draws."""

    def resampled(self, rng: np.random.Generator, count: int) -> Array:
        """Return draws of equal weight, in random order, by systematic resampling."""
        at = (np.arange(count) + rng.random()) / count
        place = np.minimum(np.searchsorted(np.cumsum(self.weight), at), self.weight.size - 1)
        return self.theta[rng.permutation(place)]


class _StudentT:
    """A multivariate t distribution."""

    def __init__(self, mean: Array, covariance: Array) -> None:
        self._mean, self._root, size = mean, np.linalg.cholesky(covariance), mean.size
        self._half = 0.5 * (TAILS + size)
        self._constant = gammaln(self._half) - gammaln(0.5 * TAILS) - 0.5 * size * np.log(TAILS * np.pi)
        self._constant -= np.log(np.diag(self._root)).sum()

    @classmethod
    def of(cls, z: Array, weight: Array) -> Self:
        return cls(np.average(z, axis=0, weights=weight), np.atleast_2d(np.cov(z.T, aweights=weight)))

    def draw(self, rng: np.random.Generator, size: int) -> Array:
        scale = np.sqrt(rng.chisquare(TAILS, size) / TAILS)
        return self._mean + (rng.standard_normal((size, self._mean.size)) @ self._root.T) / scale[:, None]

    def log_density(self, z: Array) -> Array:
        apart = solve_triangular(self._root, (z - self._mean).T, lower=True)
        return np.asarray(self._constant - self._half * np.log1p((apart**2).sum(axis=0) / TAILS))


def weighted(
    posterior: Posterior, rng: np.random.Generator, start: Mapping[str, float], effort: Effort = USUAL
) -> Weighted:
    """Return weighted draws of a posterior.

    Parameters
    ----------
    posterior
        The posterior.
    rng
        Random generator.
    start
        Values in natural units at which the first proposal is centred; parameters that are missing or 0 start at the
        centre of their prior. Its spread is `FIRST` times that of the prior.
    effort
        Draws of a round, and effective number at which to end.
    """
    given = np.array([start.get(name, np.nan) for name in posterior.names])
    # a spread of 0, such as a fixed omega, has no finite coordinate
    at = posterior.space.coordinates(np.where(given == 0.0, np.nan, given)[None])[0]
    prior = posterior.draw_start(rng, 1000)
    proposal = _StudentT(np.where(np.isfinite(at), at, prior.mean(axis=0)), FIRST**2 * np.atleast_2d(np.cov(prior.T)))
    laws: list[_StudentT] = []
    drawn: list[Array] = []
    density: list[Array] = []
    for step in range(MOST):
        z = proposal.draw(rng, effort.proposals)
        laws = [*laws, proposal][-WINDOW:]
        drawn = [*drawn, z][-WINDOW:]
        density = [*density, _density(posterior, z)][-WINDOW:]
        z = np.concatenate(drawn)
        mixture = np.logaddexp.reduce([law.log_density(z) for law in laws])
        log_ratio = np.nan_to_num(np.concatenate(density) - mixture, nan=-np.inf)
        if step >= WINDOW:
            # Pareto's fit to the weights of poor proposals overflows, and gives a large k
            with np.errstate(over="ignore", invalid="ignore"):
                (log_weight,), (k,) = psis(log_ratio[None])
            effective = _effective(log_weight)
            if k <= GOOD and effective >= effort.effective:
                break
        power = 1.0
        while _effective(power * log_ratio) < EACH * z.shape[1]:
            power *= 0.8
        proposal = _StudentT.of(z, np.exp(power * (log_ratio - log_ratio.max())))
    weight = np.exp(log_weight - log_weight.max())
    return Weighted(posterior.natural(z), weight / weight.sum(), float(k), effective)


def corrected(
    found: Weighted, rough: Posterior, posterior: Posterior, rng: np.random.Generator, count: int
) -> Weighted:
    """Return draws of a posterior from weighted draws of a rough but cheap approximation of it.

    Parameters
    ----------
    found
        Weighted draws of `rough`.
    rough, posterior
        The approximation, and the posterior; both have the same prior.
    rng
        Random generator.
    count
        Number of draws, resampled from `found`, at which both likelihoods are evaluated.

    Returns
    -------
    Weighted
        Pareto's k is the larger one of both steps; the effective number is the smaller one.
    """
    theta = found.resampled(rng, count)
    ratio = np.concatenate([posterior.log_likelihood(x) - rough.log_likelihood(x) for x in np.array_split(theta, 10)])
    with np.errstate(over="ignore", invalid="ignore"):
        (log_weight,), (k,) = psis(ratio[None])
    effective = min(_effective(log_weight), found.effective)
    return Weighted(theta, np.exp(log_weight), max(found.k, float(k)), effective)


def _density(posterior: Posterior, z: Array) -> Array:
    return np.concatenate([posterior(part) for part in np.array_split(z, -(-len(z) // BATCH))])


def _effective(log_weight: Array) -> float:
    """Return the effective number of draws with these weights."""
    weight = np.exp(log_weight - log_weight.max())
    return float(weight.sum() ** 2 / (weight**2).sum())
