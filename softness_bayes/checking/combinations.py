"""Products of powers of parameters about which the data are informative, with the widths of their posteriors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.checking.sensitivity import DETERMINED, INFORMED, Directions
from softness_bayes.parameters.priors import Prior
from softness_bayes.sampler.jackknife import jackknife

FloatArray = NDArray[np.float64]

_LEADING = 0.3  # share of a direction's largest component below which a component is left out of its product
_SLIGHT = 0.1  # share of a product's largest component below which a fitted component is also left out
_SAME = 0.7  # correlation under the prior beyond which a product repeats an earlier one
_LIMITS = (0.05, 0.95)
_PRIOR_DRAWS = 20_000


class Product(NamedTuple):
    """A product of powers of parameters, the first with exponent 1."""

    exponents: FloatArray
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

    def sentence(self, names: Sequence[str]) -> str:
        """Describe how precisely the data determine the product."""
        if self.width > INFORMED:
            return f"not informed: {self.written(names)} (limits {100 * self.width:.0f} % as wide as under the prior)"
        word = "determined" if self.width <= DETERMINED else "informed"
        error = f" ± {self.error:.1g}" if np.isfinite(self.error) else ""
        known = f"within a factor of {self.factor:.4g}{error} (prior: {self.prior_factor:.3g})"
        return f"{word}: {self.written(names)} {known}"


def find_products(priors: Sequence[Prior], theta: FloatArray, directions: Directions) -> list[Product | None]:
    """Return the product that represents each direction; None if the posterior is nearly as wide as the prior.

    Small components of a direction are left out. The exponents of the others are refitted to minimise the posterior
    variance of the product, and rounded to two digits. If this repeats an earlier product, the original exponents of
    the direction are used.

    Parameters
    ----------
    priors
        Prior of each parameter.
    theta
        Draws, shape (draws, parameters), with the chains concatenated.
    directions
        Directions from `find_directions`.
    """
    logs = np.log(theta)
    covariance = np.atleast_2d(np.cov(logs.T))
    uniform = np.random.default_rng(0).uniform(size=(_PRIOR_DRAWS, len(priors)))
    before = np.log(np.stack([prior.quantile(uniform[:, k]) for k, prior in enumerate(priors)], axis=-1))
    found: list[Product | None] = []
    for told, vector in zip(directions.contraction, directions.vectors, strict=True):
        if np.sqrt(max(1.0 - told, 0.0)) > INFORMED:
            found.append(None)
            continue
        order = _leading(vector)
        exponents = _fitted_without_slight(covariance, order, directions.prior_sd)
        scaled = exponents * directions.prior_sd
        if any(_correlation(scaled, one.exponents * directions.prior_sd) > _SAME for one in found if one is not None):
            exponents = _rounded(vector / directions.prior_sd, order)
        found.append(_measured(exponents, order, logs, before))
    return found


def _leading(vector: FloatArray) -> list[int]:
    by_size = np.argsort(-np.abs(vector), kind="stable").tolist()
    return [k for k in by_size if abs(vector[k]) >= _LEADING * abs(vector[by_size[0]])]


def _fitted_without_slight(covariance: FloatArray, order: Sequence[int], prior_sd: FloatArray) -> FloatArray:
    """Fit, drop exponents that are small compared with the others, and repeat until none is dropped."""
    exponents = _fitted(covariance, order)
    scaled = np.abs(exponents * prior_sd)
    kept = [k for k in order if k == order[0] or scaled[k] >= _SLIGHT * scaled.max()]
    return exponents if len(kept) == len(order) else _fitted_without_slight(covariance, kept, prior_sd)


def _fitted(covariance: FloatArray, order: Sequence[int]) -> FloatArray:
    """Return the exponents of least variance: minus the regression of the first logarithm on the others."""
    first, rest = order[0], list(order[1:])
    power = np.zeros(len(covariance))
    power[first] = 1.0
    if rest:
        power[rest] = -np.linalg.lstsq(covariance[np.ix_(rest, rest)], covariance[rest, first])[0]
    return _rounded(power, order)


def _rounded(power: FloatArray, order: Sequence[int]) -> FloatArray:
    """Return the exponents rounded as they are printed."""
    rounded = np.zeros(power.size)
    for k in order:
        rounded[k] = float(f"{power[k] / power[order[0]]:.2g}")
    return rounded


def _correlation(one: FloatArray, other: FloatArray) -> float:
    return float(abs(one @ other) / np.sqrt((one @ one) * (other @ other)))


def _measured(exponents: FloatArray, order: Sequence[int], logs: FloatArray, before: FloatArray) -> Product:
    values = logs @ exponents
    half, prior_half = _half_width(values), _half_width(before @ exponents)
    error = float(jackknife(lambda kept: _half_width(values[kept]), len(values)))
    kept = tuple(k for k in order if exponents[k])
    factor = float(np.exp(half))
    return Product(exponents, kept, factor, factor * error, float(np.exp(prior_half)), half / prior_half)


def _half_width(values: FloatArray) -> float:
    low, high = np.quantile(values, _LIMITS)
    return 0.5 * float(high - low)
