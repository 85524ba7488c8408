"""The posterior density of the sampled parameters, for whole batches of points."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from softness_bayes.errors import InputError, NumericalError
from softness_bayes.inference.compression import CompressionForces, SkinParameters
from softness_bayes.inference.observation import RatingParameters
from softness_bayes.inference.parameters import EVERY_PARAMETER, ParameterSpace
from softness_bayes.touch.parameters import TouchParameters

FloatArray = NDArray[np.float64]

LEAST_FIRING = 3
"""Conditions in which a starting point must fire, or all if there are fewer."""

NEGLIGIBLE = -200.0
"""Log prior density of a single parameter below which a point is taken to have none."""

_ATTEMPTS = 50


class ForwardModel(Protocol):
    """What the posterior asks of a scene."""

    @property
    def n_receptors(self) -> float:
        """Mean number of receptors of the pad."""

    def total_rate(self, parameters: TouchParameters) -> FloatArray:
        """Total rate [spikes/s] of every condition, shape (..., conditions)."""


class Observation(Protocol):
    """What the posterior asks of the ratings."""

    def log_likelihood(self, mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
        """Log density of all ratings, shape (...), from the pad's mean rate [Hz] in every condition."""


@dataclass(frozen=True)
class Density(ABC):
    """log p(theta | data) = log p(theta) + log p(data | theta), up to a constant.

    Called with sampler coordinates z it returns the density in z, Jacobian included.
    """

    space: ParameterSpace

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the sampled parameters."""
        return self.space.names

    def natural(self, z: FloatArray) -> FloatArray:
        """Points theta [natural units] at sampler coordinates ``z``."""
        return self.space.natural(z)

    def log_prior(self, theta: FloatArray) -> FloatArray:
        """Log prior density at points theta (..., dimension), shape (...)."""
        return self.space.log_prior(theta).sum(axis=-1)

    @abstractmethod
    def data_density(self, theta: FloatArray) -> FloatArray:
        """Log density of the data at points theta, as the model computes it."""

    def log_likelihood(self, theta: FloatArray) -> FloatArray:
        """Log density of the data at points theta (..., dimension), shape (...).

        Raises
        ------
        NumericalError
            If it is not a finite number somewhere; the message names the point.
        """
        value = self._likelihood(theta)
        if not np.isfinite(value).all():
            wrong = ~np.isfinite(value)
            point = ", ".join(f"{n}={x!r}" for n, x in zip(self.names, theta[wrong][0].tolist(), strict=True))
            raise NumericalError(f"the log-likelihood is {value[wrong][0]} at {point}")
        return value

    def _likelihood(self, theta: FloatArray) -> FloatArray:
        """Log density of the data, whatever comes out."""
        return np.broadcast_to(self.data_density(theta), theta.shape[:-1])

    def response_is_finite(self, theta: FloatArray) -> bool:
        """Whether the forward model gives numbers at one point theta, shape (dimension,)."""
        return True

    def failing_stage(self, z: FloatArray) -> str:
        """Name of the first stage that gives no finite number at one point ``z``, shape (dimension,)."""
        theta = self.natural(z)
        if not np.isfinite(theta).all():
            return "coordinates"
        if not np.isfinite(self.log_prior(theta)):
            return "prior"
        if not self.response_is_finite(theta):
            return "response"
        return "likelihood"

    def __call__(self, z: FloatArray) -> FloatArray:
        """Log posterior density in sampler coordinates, shape (points,) for ``z`` (points, dimension).

        The likelihood is asked only where no parameter's prior density is `NEGLIGIBLE`: proposals reach
        arbitrarily far, where the chain is not made to be evaluated. Minus infinity comes from the prior
        alone; where the likelihood is not a finite number the density is NaN.
        """
        theta = self.space.natural(z)
        log_prior = self.space.log_prior(theta)
        value = log_prior.sum(axis=-1) + self.space.log_jacobian(z)
        inside = (log_prior > NEGLIGIBLE).all(axis=-1)
        if inside.all():
            return value + _finite(self._likelihood(theta))
        # a prior that is no number is not one without weight
        value = np.where(inside, value, np.where(np.isnan(log_prior).any(axis=-1), np.nan, -np.inf))
        if inside.any():
            value[inside] += _finite(self._likelihood(theta[inside]))
        return value

    def draw_start(self, rng: np.random.Generator, size: int) -> FloatArray:
        """Prior draws, in sampler coordinates."""
        return self.space.coordinates(self.space.draw_prior(rng, size))

    def skin_parameters(self, theta: FloatArray) -> SkinParameters:
        """The skin and how fingers depart from it, in SI, at points theta."""
        values, shape = self.space.values(theta), theta.shape[:-1]
        return SkinParameters(
            *(np.broadcast_to(values[name] * EVERY_PARAMETER[name].si, shape) for name in SkinParameters._fields)
        )


@dataclass(frozen=True)
class SkinPosterior(Density):
    """The posterior of the skin alone, from compression data without ratings."""

    compression: CompressionForces

    def data_density(self, theta: FloatArray) -> FloatArray:
        """Log density of the forces at points theta."""
        return self.compression.log_likelihood(self.skin_parameters(theta))


@dataclass(frozen=True)
class Posterior(Density):
    """The posterior given ratings and, if there are any, compression data.

    Raters and fingers are not matched: the typical finger's b and m are those of the typical rater.
    """

    scene: ForwardModel
    observation: Observation
    compression: CompressionForces | None = None

    def mean_rate(self, theta: FloatArray) -> FloatArray:
        """The pad's mean rate N/N_ref [Hz] at points theta, shape (..., conditions)."""
        # with every parameter of the chain held there is one response for all points
        rate = self.scene.total_rate(self.space.touch(theta)) / self.scene.n_receptors
        return np.broadcast_to(rate, (*theta.shape[:-1], rate.shape[-1]))

    def response_is_finite(self, theta: FloatArray) -> bool:
        """Whether the forward model gives numbers at one point theta, shape (dimension,)."""
        return bool(np.isfinite(self.mean_rate(theta)).all())

    def rating_parameters(self, theta: FloatArray) -> RatingParameters:
        """The parameters of the rating model at points theta; NaN are those that it does not have."""
        values = self.space.values(theta)
        return RatingParameters(*(values.get(name, np.nan) for name in RatingParameters._fields))

    def data_density(self, theta: FloatArray) -> FloatArray:
        """Log density of ratings and forces at points theta."""
        value = self.observation.log_likelihood(self.mean_rate(theta), self.rating_parameters(theta))
        if self.compression is not None:
            value = value + self.compression.log_likelihood(self.skin_parameters(theta))
        return value

    def draw_start(self, rng: np.random.Generator, size: int) -> FloatArray:
        """Prior draws that fire in at least `LEAST_FIRING` conditions, in sampler coordinates.

        Raises
        ------
        InputError
            If the prior hardly ever fires.
        """
        found: list[FloatArray] = []
        for _ in range(_ATTEMPTS):
            theta = self.space.draw_prior(rng, size)
            rate = self.mean_rate(theta)
            needed = min(LEAST_FIRING, rate.shape[-1])
            found.extend(theta[(rate > 0).sum(axis=-1) >= needed])
            if len(found) >= size:
                return self.space.coordinates(np.array(found[:size]))
        raise InputError(
            f"only {len(found)} of {_ATTEMPTS * size} prior draws make receptors fire in {needed} of "
            f"{rate.shape[-1]} conditions: check the units of fabrics and loads, and the priors of alpha, beta and "
            "sigma_0"
        )


def _finite(value: FloatArray) -> FloatArray:
    """The values, NaN where they are infinite."""
    return np.where(np.isfinite(value), value, np.nan)
