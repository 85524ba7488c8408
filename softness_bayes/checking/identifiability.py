"""Identifiability of the parameters of a run: contraction, sensitivity, and combinations that the data inform."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, ndtri, xlog1py

from softness_bayes.base.arviz_bridge import SAMPLE_DIMS
from softness_bayes.base.laws import Prior, Signed
from softness_bayes.checking.provenance import Provenance
from softness_bayes.parameters.declared import EVERY_PARAMETER
from softness_bayes.sampler.chain_statistics import jackknife

if TYPE_CHECKING:
    import xarray as xr


SENSITIVE = 0.05
"""Power-scaling sensitivity above which a posterior is sensitive to prior or likelihood."""

DETERMINED, INFORMED = 1 / 3, 0.8
"""Ratios of posterior to prior width up to which the data determine a quantity, or partly inform it.

In a normal model the data then carry at least 8 times, or 0.56 times, as much information as the prior.
"""

SURPRISING = 2.5
"""Distance of a posterior mean from its prior's median, in prior standard deviations on the prior's own scale, from
which data and prior are said to disagree: a draw of a normal prior lies that far in 1.2 % of cases."""

POWERS = (0.99, 1.01)
"""Powers of prior and likelihood."""


def prior_moments(prior: Prior, of: Callable[[Array], Array] = np.asarray) -> tuple[float, float]:
    """Return mean and standard deviation of a function of a quantity under its prior.

    The integral is a trapezium rule over the standard normal deviate of the quantile, exponentially accurate for
    smooth laws.

    Parameters
    ----------
    prior
        The law of the quantity x.
    of
        The function; by default x itself.
    """
    deviate = np.linspace(-8.0, 8.0, 641)
    weight = np.exp(-0.5 * deviate**2)
    weight /= weight.sum()
    values = of(prior.quantile(ndtr(deviate)))
    mean = float(weight @ values)
    return mean, float(np.sqrt(weight @ (values - mean) ** 2))


def contraction(prior_sd: ArrayLike, sd: ArrayLike) -> Array:
    """Return 1 - (sd / prior_sd)²: 0 without information, near 1 with much, below 0 if the posterior is wider."""
    return 1.0 - (np.asarray(sd, float) / np.asarray(prior_sd, float)) ** 2


def power_scaling(draws: ArrayLike, log_component: ArrayLike) -> tuple[float, float]:
    """Return the sensitivity of a quantity's posterior to the power of one component, per doubling of the power.

    It is the mean of the larger distance of x and -x (`distances`) over |log2 power|, for a slightly larger and a
    slightly smaller power.

    Parameters
    ----------
    draws
        Posterior draws of the quantity in order of the chains, shape (draws,).
    log_component
        Joint log prior density, or joint log-likelihood, of the same draws, shape (draws,).

    Returns
    -------
    sensitivity : float
    error : float
        Its Monte-Carlo standard error, from leaving out groups of draws (`jackknife`).
    """
    draws, log_component = np.asarray(draws, float), np.asarray(log_component, float)
    order = np.argsort(draws)
    x, component = draws[order], log_component[order]

    def without(kept: NDArray[np.bool_]) -> float:
        left = kept[order]
        return _rate(x[left], component[left], POWERS[1:])  # one power has the same error as both

    return _rate(x, component), float(jackknife(without, draws.size))


def _rate(x: Array, log_component: Array, powers: Sequence[float] = POWERS) -> float:
    """Return the sensitivity from draws in rising order."""
    centred = log_component - log_component.mean()
    rates = []
    for power in powers:
        weights = np.exp((power - 1.0) * centred)
        rates.append(max(distances(x, weights / weights.sum())) / abs(np.log2(power)))
    return float(np.mean(rates))


def distances(x: Array, weights: Array) -> tuple[float, float]:
    """Return the cumulative Jensen-Shannon distances, from 0 to 1, of weighted draws of x and of -x from equal weights.

    sqrt((D(P, M) + D(Q, M)) / ∫ (P + Q)), P and Q the distribution functions without and with weights, M their mean,
    D(F, M) = ∫ F log2(F / M) dx + ∫ (M - F) dx / ln 2. Those of -x are 1 - P and 1 - Q. With u = (Q - P) / (Q + P),
    both divergences together are ∫ M h(u) dx / ln 2, h(u) = (1 + u) ln(1 + u) + (1 - u) ln(1 - u); their terms without
    a logarithm cancel.

    Parameters
    ----------
    x, weights
        Draws in rising order and their weights, which sum to 1, shape (draws,).
    """
    width = np.diff(x)
    plain = np.arange(1, x.size) / x.size
    weighted = np.cumsum(weights)[:-1]
    half, middle = 0.5 * (weighted - plain), 0.5 * (weighted + plain)

    def distance_from(middle: Array) -> float:
        u = (half / middle).clip(-1.0, 1.0)  # beyond by rounding
        divergence = width @ (middle * (xlog1py(1.0 + u, u) + xlog1py(1.0 - u, -u))) / np.log(2.0)
        total = 2.0 * (width @ middle)
        return float(np.sqrt(max(divergence, 0.0) / total)) if total > 0 else 0.0

    return distance_from(middle), distance_from(1.0 - middle)


Array = NDArray[np.float64]


class Directions(NamedTuple):
    """Principal directions of the posterior, best informed first, in logarithms of the parameters."""

    contraction: Array
    """1 - posterior variance / prior variance along each direction, shape (directions,)."""
    vectors: Array
    """Unit vectors, one row per direction, in units of each log parameter's prior sd."""
    prior_sd: Array
    """Prior standard deviation of each log parameter, shape (parameters,)."""


class Product(NamedTuple):
    """A product of powers of parameters, the first with exponent 1."""

    exponents: Array
    """Exponents as printed, shape (parameters,); 0 for parameters that are not in the product."""
    order: tuple[int, ...]
    """Parameters in the product, the one with exponent 1 first."""
    factor: float
    """Factor between the median and the 90 % limits."""
    error: float
    """Monte-Carlo standard error of the factor."""
    prior_factor: float
    """The same factor under the prior."""
    width: float
    """Width of the 90 % limits of the logarithm, relative to that under the prior."""

    def written(self, names: Sequence[str]) -> str:
        """Return the product as text, such as b · m^0.7."""
        return " · ".join(
            names[k] if self.exponents[k] == 1.0 else f"{names[k]}^{self.exponents[k]:g}" for k in self.order
        )

    def meaning(self, names: Sequence[str]) -> str:
        """Describe how precisely the data determine the product."""
        if self.width > INFORMED:
            return f"not informed: {self.written(names)} (limits {100 * self.width:.0f} % as wide as under the prior)"
        word = "determined" if self.width <= DETERMINED else "informed"
        error = f" ± {self.error:.1g}" if np.isfinite(self.error) else ""
        known = f"within a factor of {self.factor:.4g}{error} (prior: {self.prior_factor:.3g})"
        return f"{word}: {self.written(names)} {known}"


def find_directions(priors: Sequence[Prior], theta: Array) -> Directions:
    """Return principal directions of the posterior in logarithms, scaled by the priors' standard deviations.

    Under the prior every direction has variance 1. The posterior variance is much smaller along stiff directions and
    almost unchanged along sloppy ones.

    Parameters
    ----------
    priors
        Prior of each parameter, which must be positive.
    theta
        Draws, shape (draws, parameters).
    """
    prior_sd = np.array([prior_moments(prior, np.log)[1] for prior in priors])
    scaled = np.log(theta) / prior_sd
    variance, vectors = np.linalg.eigh(np.atleast_2d(np.cov(scaled.T)))
    vectors = vectors.T
    leading = np.take_along_axis(vectors, np.abs(vectors).argmax(axis=1)[:, None], axis=1)
    return Directions(1.0 - variance, vectors * np.sign(leading), prior_sd)


def find_products(priors: Sequence[Prior], theta: Array, directions: Directions) -> list[Product | None]:
    """Return the product that represents each direction; None if the posterior is nearly as wide as the prior.

    Components below 0.3 of a direction's largest are left out. The exponents of the others are refitted to minimise the
    posterior variance of the product, and rounded to two digits. If this repeats an earlier product (correlation under
    the prior above 0.7), the original exponents of the direction are used.

    Parameters
    ----------
    priors
        Prior of each parameter.
    theta
        Draws, shape (draws, parameters), with the chains concatenated.
    directions
        Directions from `find_directions`.
    """
    logs, prior_sd = np.log(theta), directions.prior_sd
    covariance = np.atleast_2d(np.cov(logs.T))
    uniform = np.random.default_rng(0).uniform(size=(20_000, len(priors)))
    prior_logs = np.log(np.stack([prior.quantile(uniform[:, k]) for k, prior in enumerate(priors)], axis=-1))
    found: list[Product | None] = []
    for share, vector in zip(directions.contraction, directions.vectors, strict=True):
        if np.sqrt(max(1.0 - share, 0.0)) > INFORMED:
            found.append(None)
            continue
        by_size = np.argsort(-np.abs(vector), kind="stable")
        order = by_size[np.abs(vector[by_size]) >= 0.3 * np.abs(vector).max()]
        exponents = _least_varying(covariance, order, prior_sd)
        earlier = [one.exponents * prior_sd for one in found if one is not None]
        scaled = exponents * prior_sd / np.linalg.norm(exponents * prior_sd)
        if any(abs(scaled @ other) > 0.7 * np.linalg.norm(other) for other in earlier):
            exponents = _rounded(vector / prior_sd, order)
        named = tuple(k for k in order.tolist() if exponents[k])
        half, error = _half_width(logs @ exponents)
        prior_half, _ = _half_width(prior_logs @ exponents)
        factor = float(np.exp(half))
        found.append(Product(exponents, named, factor, factor * error, float(np.exp(prior_half)), half / prior_half))
    return found


def _least_varying(covariance: Array, order: NDArray[np.intp], prior_sd: Array) -> Array:
    """Return the exponents of least variance: minus the regression of the first logarithm on the others.

    Exponents below a tenth of the largest, in prior standard deviations, are dropped until none is.
    """
    first, rest = order[0], order[1:]
    power = np.zeros(len(covariance))
    power[first] = 1.0
    if rest.size:
        power[rest] = -np.linalg.lstsq(covariance[np.ix_(rest, rest)], covariance[rest, first])[0]
    exponents = _rounded(power, order)
    size = np.abs(exponents * prior_sd)
    kept = np.array([k for k in order if k == first or size[k] >= 0.1 * size.max()])
    return exponents if kept.size == order.size else _least_varying(covariance, kept, prior_sd)


def _rounded(power: Array, order: NDArray[np.intp]) -> Array:
    """Return the exponents rounded as they are printed."""
    rounded = np.zeros(power.size)
    for k in order:
        rounded[k] = float(f"{power[k] / power[order[0]]:.2g}")
    return rounded


def _half_width(values: Array) -> tuple[float, float]:
    """Return half the width of the 90 % limits of draws in order of the chains, and its standard error."""

    def half_width(kept: NDArray[np.bool_]) -> float:
        return 0.5 * float(np.subtract(*np.quantile(values[kept], (0.95, 0.05))))

    return half_width(np.ones(values.size, dtype=bool)), float(jackknife(half_width, values.size))


def information_table(tree: xr.DataTree) -> pd.DataFrame:
    """Return each parameter's posterior contraction, and its sensitivity to prior and likelihood.

    Parameters
    ----------
    tree
        The groups of a result: `posterior`, `log_prior` and `log_likelihood_joint`, and the priors' written
        forms in its attributes.

    Returns
    -------
    DataFrame
        A row per parameter that has a prior: prior_mean, prior_sd (natural units), contraction, prior_shift,
        psens_prior, psens_likelihood, and Monte-Carlo standard errors of the last two, psens_prior_mcse and
        psens_likelihood_mcse.
        prior_shift is the mean of the normal scores of the draws under the prior (of its logarithm, for a log-normal
        prior), so that 0 is the prior's median and 1 a standard deviation. mu, which is drawn after the run, has no
        sensitivities, because it is integrated out of the power-scaled likelihood.
    """
    posterior, priors = _draws(tree, "posterior"), _draws(tree, "log_prior")
    log_prior, log_likelihood = (_log_density(tree, group) for group in ("log_prior", "log_likelihood_joint"))
    rows = {}
    for name, prior in Provenance(tree.attrs).priors.items():
        if name not in posterior:
            continue
        draws, (mean, sd) = posterior[name], prior_moments(prior)
        rows[name] = {
            "prior_mean": mean,
            "prior_sd": sd,
            "contraction": float(contraction(sd, draws.std(ddof=1))),
            "prior_shift": float(ndtri(prior.cumulative(draws).clip(1e-15, 1.0 - 1e-15)).mean()),
            "psens_prior": np.nan,
            "psens_likelihood": np.nan,
            "psens_prior_mcse": np.nan,
            "psens_likelihood_mcse": np.nan,
        }
        for kind, component in (("prior", log_prior), ("likelihood", log_likelihood)):
            if name in priors:
                sensitivity, error = power_scaling(draws, component)
                rows[name] |= {f"psens_{kind}": sensitivity, f"psens_{kind}_mcse": error}
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("parameter")


def direction_table(tree: xr.DataTree) -> pd.DataFrame:
    """Return principal directions of the posterior, best informed first, in logarithms of the sampled parameters.

    Parameters
    ----------
    tree
        The groups of a result.

    Returns
    -------
    DataFrame
        A row per direction (index ``direction``, from 1): contraction along it; for each parameter the
        component of the unit vector, in units of the log parameter's prior sd; then the product of parameters that
        represents it, if the data narrow it (product; factor_90, factor_90_mcse, prior_factor_90: factor between its
        median and its 90 % limits; width: width of the limits relative to that under the prior); and its meaning in
        words.
    """
    priors, posterior = Provenance(tree.attrs).priors, _draws(tree, "posterior")
    # an exponent that may be negative has no logarithm, and its magnitude belongs to no product
    names = [name for name in _draws(tree, "log_prior") if not isinstance(priors[name], Signed)]
    theta = np.stack([posterior[name] for name in names], axis=-1)
    laws = [EVERY_PARAMETER[name].cut(priors[name]) for name in names]
    found = find_directions(laws, theta)
    table = pd.DataFrame(found.vectors, columns=names)
    table.insert(0, "contraction", found.contraction)
    products = find_products(laws, theta, found)
    for column, of in (
        ("product", lambda one: one.written(names)),
        ("factor_90", lambda one: one.factor),
        ("factor_90_mcse", lambda one: one.error),
        ("prior_factor_90", lambda one: one.prior_factor),
        ("width", lambda one: one.width),
    ):
        table[column] = [None if one is None else of(one) for one in products]
    width = 100.0 * np.sqrt(np.maximum(1.0 - found.contraction, 0.0))
    table["meaning"] = [
        f"not informed: {share:.0f} % as wide as under the prior" if one is None else one.meaning(names)
        for one, share in zip(products, width, strict=True)
    ]
    table.index = pd.RangeIndex(1, len(names) + 1, name="direction")
    return table


def _log_density(tree: xr.DataTree, group: str) -> Array:
    """Return the sum of the log densities of a group, shape (draws,); those of sampled moduli have a further axis."""
    each = (v.values.reshape(*v.shape[:2], -1).sum(axis=-1) for v in tree[group].data_vars.values())
    return np.sum([*each], axis=0).ravel()


def _draws(tree: xr.DataTree, group: str) -> dict[str, Array]:
    """Return the scalar variables of a group, with the draws of all chains on one axis."""
    dataset = tree[group].to_dataset()
    return {str(name): v.values.ravel() for name, v in dataset.items() if v.dims == SAMPLE_DIMS}
