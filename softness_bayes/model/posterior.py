"""Posterior density of the sampled parameters, for whole batches of points."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self, cast

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.errors import InputError, NumericalError
from softness_bayes.likelihood.contract import RATINGS, Parameters, RatingsLikelihood, Term
from softness_bayes.likelihood.plate import FORCES, CompressionForces
from softness_bayes.parameters.declared import EVERY_PARAMETER
from softness_bayes.parameters.space import ParameterSpace
from softness_bayes.touch.finger_grid import SPREAD_OF, FingerSpreads
from softness_bayes.touch.fingers import FingerFamily
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.scene import Scene

FloatArray = NDArray[np.float64]

LEAST_FIRING = 3
"""Number of conditions (or all, if fewer) in which receptors must fire at a starting point."""

NEGLIGIBLE = -200.0
"""Log prior density of a single parameter below which the density of a point is set to zero."""

_WIDTHS = (1.0, 50), (1.5, 10), (2.0, 10), (3.0, 10), (4.0, 10)  # of priors of starts, and attempts


@dataclass(frozen=True)
class Density:
    """log p(theta | data) = log p(theta) + the sum of log p(data of a term | theta), up to a constant.

    Called with sampler coordinates z, it returns the density in z, including the Jacobian. Without a scene, only terms
    that do not use the response, such as plate forces, are possible.

    Parameters
    ----------
    space
        The parameters.
    terms
        Likelihoods of each kind of data, independent of each other given the parameters; that of ratings may be
        conditional on plate forces of the same people (`likelihood.plate.PressedRaters`). b and m of the typical
        finger are those of the typical rater.
    """

    space: ParameterSpace
    terms: tuple[Term, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the sampled parameters."""
        return self.space.names

    @property
    def n_linear(self) -> int:
        """Number of fabric moduli, the last coordinates, which are nearly linear functions of the others."""
        return self.space.dimension - self.space.n_chain

    def natural(self, z: FloatArray) -> FloatArray:
        """Points theta [natural units] at sampler coordinates ``z``."""
        return self.space.natural(z)

    def log_prior(self, theta: FloatArray) -> FloatArray:
        """Log prior density at points theta (..., dimension), shape (...)."""
        return self.space.log_prior(theta).sum(axis=-1)

    def term(self, name: str) -> Term | None:
        """The likelihood of one kind of data by its name; None if there are no such data."""
        return next((term for term in self.terms if term.name == name), None)

    def with_term(self, term: Term) -> Self:
        """The posterior with the data of the same name replaced."""
        return replace(self, terms=tuple(term if old.name == term.name else old for old in self.terms))

    @cached_property
    def for_sampling(self) -> Self:
        """The density in the form in which it is sampled, `Term.for_sampling`; itself if that is no other."""
        terms = tuple(term.for_sampling() for term in self.terms)
        return self if terms == self.terms else replace(self, terms=terms)

    def mean_rate(self, theta: FloatArray) -> FloatArray:
        """The pad's mean rate N/N_ref [Hz] at points theta, shape (..., conditions); empty without a scene."""
        return np.empty((*theta.shape[:-1], 0))

    def response(self, theta: FloatArray, modulus: FloatArray | None = None) -> FloatArray:
        """Mean rates as used by the likelihoods: `mean_rate`, followed by those of individual fingers, if any."""
        return self.mean_rate(theta)

    def parameters_of(self, term: Term, theta: FloatArray) -> Parameters:
        """Return the parameters of a term's model at points theta, in SI: numbers if fixed, arrays (...) if sampled."""
        known = [name for name in term.model.needs if self.space.knows(name)]
        return Parameters(**{name: self.space.value(name, theta) * EVERY_PARAMETER[name].si for name in known})

    def log_likelihood(self, theta: FloatArray) -> FloatArray:
        """Log density of the data at points theta (..., dimension), shape (...).

        Raises
        ------
        NumericalError
            If it is not finite at a point; the message gives the point.
        """
        value = self._likelihood(theta)
        if not np.isfinite(value).all():
            wrong = ~np.isfinite(value)
            point = ", ".join(f"{n}={x!r}" for n, x in zip(self.names, theta[wrong][0].tolist(), strict=True))
            raise NumericalError(f"the log-likelihood is {value[wrong][0]} at {point}")
        return value

    def _likelihood(self, theta: FloatArray) -> FloatArray:
        """Return the log density of the data, which may not be finite."""
        rate = self.response(theta)
        every = (term.log_likelihood(rate, self.parameters_of(term, theta)) for term in self.terms)
        return np.broadcast_to(sum(every, np.zeros(())), theta.shape[:-1])

    def failing_stage(self, z: FloatArray) -> str:
        """Name of the first stage that is not finite at one point ``z``, shape (dimension,)."""
        theta = self.natural(z)
        if not np.isfinite(theta).all():
            return "coordinates"
        if not np.isfinite(self.log_prior(theta)):
            return "prior"
        if not np.isfinite(self.response(theta)).all():
            return "response"
        return "likelihood"

    def __call__(self, z: FloatArray) -> FloatArray:
        """Log posterior density in sampler coordinates, shape (points,) for ``z`` (points, dimension).

        The likelihood is not evaluated if the prior density of any parameter is below `NEGLIGIBLE`, because proposals
        may lie arbitrarily far outside the range of the model. Minus infinity can only result from the prior; if the
        likelihood is not finite, the density is NaN.
        """
        theta = self.space.natural(z)
        log_prior = self.space.log_prior(theta)
        value = log_prior.sum(axis=-1) + self.space.log_jacobian(z)
        inside = (log_prior > NEGLIGIBLE).all(axis=-1)
        if inside.all():
            return value + _finite(self._likelihood(theta))
        # a NaN prior must not be treated as zero density
        value = np.where(inside, value, np.where(np.isnan(log_prior).any(axis=-1), np.nan, -np.inf))
        if inside.any():
            value[inside] += _finite(self._likelihood(theta[inside]))
        return value

    def draw_start(self, rng: np.random.Generator, size: int) -> FloatArray:
        """Prior draws, in sampler coordinates."""
        return self.space.coordinates(self.space.draw_prior(rng, size))

    @property
    def compression(self) -> CompressionForces | None:
        """The likelihood of plate forces; None if there are none."""
        return cast("CompressionForces | None", self.term(FORCES))


@dataclass(frozen=True)
class Posterior(Density):
    """The posterior given ratings and any other data.

    Parameters
    ----------
    scene
        The forward model of the rated conditions.
    other_loads
        The forward model of the same fabrics at additional loads, if loads have errors (`design.LoadErrors`).
    fingers
        Family of fingers over which the likelihood of the ratings integrates; None if all raters have the typical
        finger.
    approximate
        Whether the sampler may use the terms in another form than what is reported.
    """

    scene: Scene
    other_loads: Scene | None = None
    fingers: FingerFamily | None = None
    approximate: bool = True

    @cached_property
    def for_sampling(self) -> Self:
        """The density in the form in which it is sampled."""
        return super().for_sampling if self.approximate else self

    def mean_rate(self, theta: FloatArray) -> FloatArray:
        """Mean rate N/N_ref [Hz] of the pad at theta, shape (..., conditions), then those at additional loads."""
        # if all parameters of the forward model are fixed, all points share one response
        rate = self.mean_rate_of(self.space.touch(theta), self.space.modulus(theta))
        return np.broadcast_to(rate, (*theta.shape[:-1], rate.shape[-1]))

    def response(self, theta: FloatArray, modulus: FloatArray | None = None) -> FloatArray:
        """Mean rates of the typical finger (`mean_rate`), followed by those of each of `fingers` in every condition.

        Parameters
        ----------
        theta
            Points, shape (..., dimension).
        modulus
            E_fab [Pa] of each fabric, shape (..., fabrics), used instead of the moduli at theta.

        Returns
        -------
        ndarray, shape (..., columns)
        """
        touch, known = self.space.touch(theta), self.space.modulus(theta) if modulus is None else modulus
        rates = [self.mean_rate_of(touch, known)]
        if self.fingers is not None:
            spreads = {name: self.space.value(SPREAD_OF[name], theta) for name in self.fingers.grid.names}
            pressed, names = self.observation.pressed, self.fingers.grid.names
            skins = None if pressed is None else pressed.skins(names, self.rating_parameters(theta))
            own = self.fingers.total_rate(touch, FingerSpreads(**spreads), known, skins) / self.scene.n_receptors
            rates.append(own.reshape(*own.shape[:-2], -1))
        rates = [np.broadcast_to(rate, (*theta.shape[:-1], rate.shape[-1])) for rate in rates]
        return rates[0] if len(rates) == 1 else np.concatenate(rates, axis=-1)

    def mean_rate_of(self, touch: TouchParameters, modulus: FloatArray | None) -> FloatArray:
        """Return `mean_rate` at given parameters of the forward model and, optionally, moduli of the fabrics [Pa]."""
        rates = [
            (scene.total_rate(touch) if modulus is None else scene.total_rate(touch, modulus)) / scene.n_receptors
            for scene in (self.scene, self.other_loads)
            if scene is not None
        ]
        return rates[0] if len(rates) == 1 else np.concatenate(rates, axis=-1)

    def with_scene(self, scene: Scene, others: Scene | None, fingers: FingerFamily | None) -> Posterior:
        """Return the posterior with other forward models and another grid of fingers."""
        of = self
        if fingers is not None:
            of = self.with_term(cast(Any, self.observation).with_grid(fingers.grid))
        return replace(of, scene=scene, other_loads=others, fingers=fingers)

    @property
    def observation(self) -> RatingsLikelihood:
        """The likelihood of the ratings."""
        return cast(RatingsLikelihood, self.term(RATINGS))

    def rating_parameters(self, theta: FloatArray) -> Parameters:
        """Return the parameters of the rating model at points theta."""
        return self.parameters_of(self.observation, theta)

    def draw_start(self, rng: np.random.Generator, size: int) -> FloatArray:
        """Return prior draws that fire in at least `LEAST_FIRING` conditions, in sampler coordinates.

        If such draws are rare, wider priors with the same medians are tried. If these fail as well, draws that fire in
        any condition are used, and the optimisations started there find the region that fits the ratings.

        Raises
        ------
        InputError
            If no receptor fires in any condition, however wide the priors.
        """
        found: list[FloatArray] = []
        some: list[FloatArray] = []
        conditions = replace(self, other_loads=None).mean_rate(self.space.median).shape[-1]
        needed = min(LEAST_FIRING, conditions)
        for width, attempts in _WIDTHS:
            for _ in range(attempts):
                theta = self._drawn(rng, size, width)
                fires = (self.mean_rate(theta)[..., :conditions] > 0).sum(axis=-1)
                found.extend(theta[fires >= needed])
                some.extend(theta[(fires > 0) & (fires < needed)])
                if len(found) >= size:
                    return self.space.coordinates(np.array(found[:size]))
        if not (found or some):
            raise InputError(
                f"only 0 of {size * _WIDTHS[0][1]} prior draws make receptors fire in {needed} of {conditions} "
                f"conditions, and with priors {_WIDTHS[-1][0]:g} times as wide no draw does in any: check the "
                "units of fabrics and loads, and the priors of alpha, beta and sigma_0"
            )
        rest = self.space.draw_prior(rng, size)
        return self.space.coordinates(np.array([*found, *some, *rest][:size]))

    def _drawn(self, rng: np.random.Generator, size: int, width: float) -> FloatArray:
        """Return at most `size` draws with positive density from priors widened in sampler coordinates."""
        theta = self.space.draw_prior(rng, size)
        if width == 1.0:
            return theta
        centre, z = self.space.coordinates(self.space.median), self.space.coordinates(theta)
        # no receptor depends on gamma, which has two signs where the direction is free
        wider = np.where([name == "gamma" for name in self.space.names], 1.0, width)
        theta = self.space.natural(centre + wider * (z - centre))
        return theta[(self.space.log_prior(theta) > NEGLIGIBLE).all(axis=-1)]


def _finite(value: FloatArray) -> FloatArray:
    """Return the values with infinite ones replaced by NaN."""
    return np.where(np.isfinite(value), value, np.nan)
