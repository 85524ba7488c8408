"""Space of the sampled parameters: prior, and coordinates of the sampler (model.md 10)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import Prior
from softness_bayes.base.ranges import Range
from softness_bayes.parameters.coordinates import Coordinate, walked
from softness_bayes.parameters.declared import (
    EVERY_PARAMETER,
    FABRIC_MODULUS,
    KPA,
    MODULUS_SCALES,
    PARAMETERS,
    UNKNOWN_MODULUS,
    Parameter,
)
from softness_bayes.parameters.joint import NAMES, JointLaw
from softness_bayes.parameters.priors import as_prior
from softness_bayes.touch.neuron.membrane import Channels
from softness_bayes.touch.neuron.surface import FiringSurface
from softness_bayes.touch.parameters import TouchParameters

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class FabricModuli:
    """Effective modulus of every fabric: central value, and prior law if uncertain.

    Parameters
    ----------
    names
        The fabrics.
    middle
        Measured modulus, or the median of the law [Pa], of each fabric.
    laws
        Law of each modulus [kPa]; None if it is known exactly.
    batch
        Batch of each fabric.
    factors
        Prior of the factor between true and stated moduli that the fabrics of a batch share, by batch; without it the
        factor is 1.
    """

    names: tuple[str, ...]
    middle: tuple[float, ...]
    laws: tuple[Prior | None, ...]
    batch: tuple[str, ...]
    factors: Mapping[str, Prior] = field(default_factory=dict)

    @property
    def uncertain(self) -> tuple[int, ...]:
        """Indices of the fabrics with uncertain moduli."""
        return tuple(k for k, law in enumerate(self.laws) if law is not None)

    @property
    def known(self) -> bool:
        """True if every modulus is known exactly."""
        return not self.uncertain and not self.factors

    @property
    def extent(self) -> tuple[float, float]:
        """Range of moduli [Pa] to cover in a run: four standard deviations of each law."""
        ends = [(middle, middle) for middle in self.middle]
        for k in self.uncertain:
            law = self.laws[k]
            assert law is not None
            low, high = (np.asarray(law.quantile([3e-5, 1.0 - 3e-5])) * KPA).tolist()
            ends[k] = low, high
        of = {one: law.quantile(np.array([3e-5, 1.0 - 3e-5])).tolist() for one, law in self.factors.items()}
        every = np.array(ends) * [of.get(one, (1.0, 1.0)) for one in self.batch]
        return float(every[:, 0].min()), float(every[:, 1].max())

    def at(self, sampled: FloatArray) -> FloatArray:
        """Return E_fab [Pa] of every fabric, shape (..., fabrics), at sampled moduli [kPa], (..., uncertain)."""
        found = np.empty((*sampled.shape[:-1], len(self.middle)))
        found[...] = self.middle
        found[..., list(self.uncertain)] = sampled * KPA
        return found

    def factor(
        self, values: Mapping[str, Any], batch: Sequence[str], rng: np.random.Generator | None = None
    ) -> FloatArray | float:
        """Return the factor between true and stated moduli of fabrics of some batches, shape (..., fabrics).

        `values` are those of the parameters that `scales_of` names. The factor of a batch that these fabrics do not
        have is drawn from the prior, once for each of the values.
        """
        if not self.factors:
            return 1.0
        found = {one: np.asarray(values.get(name, 1.0)) for one, name in scales_of(self.batch).items()}
        shape, law = np.broadcast_shapes(*(one.shape for one in found.values())), next(iter(self.factors.values()))
        for one in dict.fromkeys(batch):
            if one not in found and rng is not None:
                found[one] = law.draw(rng, shape)
        return np.stack([np.broadcast_to(found[one], shape) for one in batch], axis=-1)


def modulus_law(name: str, given: Prior | str) -> Prior:
    """Return the law of a modulus [kPa], given as a law or in written form.

    Raises
    ------
    InputError
        If it is none, or allows negative values.
    """
    law = as_prior(name, given)
    if law.support[0] < 0 or not law.median > 0:
        raise InputError(
            f"{name}: {law} allows moduli below 0, expected a distribution above 0 [kPa], such as {UNKNOWN_MODULUS}"
        )
    return law


def scales_of(batch: Sequence[str]) -> dict[str, str]:
    """Return the parameter of the factor of each batch of moduli, in the order of the fabrics."""
    return dict(zip(dict.fromkeys(batch), MODULUS_SCALES, strict=False))


_REDRAWS = 1000

LEAST_SHARE = 1e-3
"""Smallest share of a prior that has to lie within the range of its parameter."""

_MODULI = Range(1e-12, 1e15, "kPa")

LEAST_ODDS = 0.01
"""Smallest alpha / rheobase - 1 in the coordinate of sigma_0, which would diverge otherwise."""


@dataclass(frozen=True)
class ParameterSpace:
    """The sampled parameters, in order, and the values of the fixed ones.

    A point theta is an array in natural units whose last axis runs over `sampled`; z is the same
    point in the coordinates of the sampler, unbounded on every axis.
    """

    sampled: tuple[Parameter, ...]
    held: Mapping[str, float]
    firing: FiringSurface | None = field(default=None, repr=False, compare=False)
    """The firing-rate surface, if channel multipliers are sampled. Every prior is truncated at the border of its
    corner, where firing starts with a jump: less than 1e-4 of the default prior lies beyond."""
    bent: Mapping[str, Coordinate] = field(default_factory=dict)
    """Coordinates of sampled parameters that are not determined by the supports of their priors."""
    rheobase: float | None = None
    """Rheobase at the centre of the channels' box, or of the fixed channels [µA/cm²]. If given, the coordinate of
    sigma_0 is the stress at which receptors start to fire, which the data determine best."""
    moduli: FabricModuli | None = None
    """The fabrics' moduli, if some are sampled; their parameters are the last of `sampled`."""
    joint: JointLaw | None = None
    """Joint law of some parameters, instead of their own priors, which are its marginals."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "held", dict(self.held))
        object.__setattr__(self, "bent", dict(self.bent))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the sampled parameters."""
        return tuple(p.name for p in self.sampled)

    @property
    def dimension(self) -> int:
        """Number of sampled parameters."""
        return len(self.sampled)

    def require_sampled(self) -> None:
        """Raise an error for a space without a sampled parameter.

        Raises
        ------
        InputError
            The message says how to evaluate the model instead.
        """
        if not self.sampled:
            raise InputError(
                "all parameters are fixed, so there is nothing to sample: free one. 'softness-bayes sample' "
                "with all of them fixed, or softness_bayes.runs.evaluation.Evaluation in Python, evaluates the "
                "model at that point"
            )

    def natural(self, z: FloatArray) -> FloatArray:
        """Return points theta [natural units] at sampler coordinates ``z``, both of shape (..., dimension)."""
        theta = self._each("natural", z)
        shift = self.rheobase_shift(theta)
        if self._walks_along("alpha", self.firing):
            theta[..., self._place["alpha"]] += shift
        if self._walks_along("sigma_0", self.rheobase):
            theta[..., self._place["sigma_0"]] += self._beyond_threshold(theta, shift)
        return theta

    def coordinates(self, theta: FloatArray) -> FloatArray:
        """Return sampler coordinates z at points ``theta``, the inverse of `natural`."""
        theta = np.array(theta, dtype=float)
        shift = self.rheobase_shift(theta)
        if self._walks_along("sigma_0", self.rheobase):
            theta[..., self._place["sigma_0"]] -= self._beyond_threshold(theta, shift)
        if self._walks_along("alpha", self.firing):
            theta[..., self._place["alpha"]] -= shift
        return self._each("coordinate", theta)

    def _each(self, method: str, values: FloatArray) -> FloatArray:
        """Return what a method of every parameter's coordinate returns for its values, both (..., dimension)."""
        found = np.empty(np.shape(values))
        for k, one in enumerate(self._coordinates):
            found[..., k] = getattr(one, method)(values[..., k])
        return found

    def _walks_along(self, name: str, other: object) -> bool:
        """Return whether a parameter's coordinate is shifted by a function of others, which preserves volume."""
        return other is not None and name in self.bent and name in self._place

    def _beyond_threshold(self, theta: FloatArray, shift: FloatArray) -> FloatArray:
        """Return sigma_0 minus the stress at which receptors start to fire [kPa], approximately ln(odds) / beta.

        The odds of the current at the rheobase are kept above `LEAST_ODDS`, which affects only the coordinate.
        """
        if self.rheobase is None:
            return np.zeros(theta.shape[:-1])
        odds = self.value("alpha", theta) / (self.rheobase + shift) - 1.0
        # points at which other coordinates overflow have zero prior density and must not give NaN
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            beyond = np.log(np.maximum(odds, 0.0) + LEAST_ODDS) / self.value("beta", theta)
        return np.where(np.isnan(beyond), 0.0, beyond)

    def rheobase_shift(self, theta: FloatArray) -> FloatArray:
        """Return the change of the rheobase due to the channel multipliers at points theta [µA/cm²], shape (...)."""
        if self.firing is None:
            return np.zeros(theta.shape[:-1])
        return self.firing.rheobase_shift(Channels(*(self.value(name, theta) for name in Channels._fields)))

    def log_jacobian(self, z: FloatArray) -> FloatArray:
        """Return the log of the volume of theta per volume of z at ``z``, shape (...)."""
        return self._each("log_slope", z).sum(axis=-1)

    def log_prior(self, theta: FloatArray) -> FloatArray:
        """Return the log prior density of each parameter [1/natural unit], shape (..., dimension).

        It is -inf outside the open interval of a support, whose ends the sampler's coordinates reach only by rounding,
        and for channel multipliers for which firing starts with a jump.
        """
        density = np.empty(theta.shape)
        for k, p in enumerate(self.sampled):
            x, (low, high) = theta[..., k], p.prior.support
            inside = (x > low) & (x < min(high, p.largest))
            density[..., k] = np.where(inside, p.prior.log_density(x), -np.inf)
        if self.joint is not None:
            density[..., self._jointly] = self.joint.log_density(theta[..., self._jointly])
        if self.firing is not None:
            channels = [k for k, p in enumerate(self.sampled) if p.name in Channels._fields]
            density[..., channels] = np.where(self._answered(theta)[..., None], density[..., channels], -np.inf)
        return density

    def _answered(self, theta: FloatArray) -> NDArray[np.bool_]:
        """Return whether the firing-rate surface covers points theta, shape (...)."""
        if self.firing is None:
            return np.ones(theta.shape[:-1], dtype=bool)
        return self.firing.answers(Channels(*(self.value(name, theta) for name in Channels._fields)))

    def draw_prior(self, rng: np.random.Generator, size: int) -> FloatArray:
        """Return independent draws from the prior, shape (size, dimension).

        Raises
        ------
        InputError
            If almost all of a prior lies outside the range of the model.
        """
        theta = np.empty((size, self.dimension))
        for k, p in enumerate(self.sampled):
            theta[:, k] = _draw(p, rng, size)
        for _ in range(_REDRAWS):
            beyond = np.flatnonzero(~self._answered(theta))
            if not beyond.size:
                if self.joint is not None:
                    theta[:, self._jointly] = self.joint.draw(rng, size)
                return theta
            theta[beyond] = np.stack([_draw(p, rng, beyond.size) for p in self.sampled], axis=-1)
        raise InputError(
            "the priors of the channel multipliers lie in the corner that the firing-rate surface does not "
            "cover, where firing begins with a jump; fix the multipliers"
        )

    @property
    def median(self) -> FloatArray:
        """Return the point of the priors' medians, shape (dimension,)."""
        return np.array([p.prior.median for p in self.sampled])

    def values(self, theta: FloatArray) -> dict[str, FloatArray | float]:
        """Return all parameters by name in natural units: sampled ones of shape (...), fixed ones as floats."""
        return {name: self.value(name, theta) for name in EVERY_PARAMETER if self.knows(name)}

    def knows(self, name: str) -> bool:
        """Return True for the name of a parameter that is sampled or fixed here."""
        return name in self._place or name in self.held

    def value(self, name: str, theta: FloatArray) -> FloatArray | float:
        """Return one parameter in natural units: a sampled one of shape (...), a fixed one as a float."""
        return self.held[name] if name in self.held else theta[..., self._place[name]]

    def touch(self, theta: FloatArray) -> TouchParameters:
        """Return the parameters of the forward model in SI at points ``theta``."""
        return TouchParameters(**{name: self.value(name, theta) * si for name, si in self._of_touch.items()})

    @cached_property
    def _of_touch(self) -> dict[str, float]:
        """Parameters of the forward model, each with its unit in SI."""
        names = [n for n in TouchParameters._fields if n in PARAMETERS or self.knows(n)]
        return {n: EVERY_PARAMETER[n].si for n in names}

    @property
    def chain(self) -> tuple[Parameter, ...]:
        """The sampled parameters without the fabrics' moduli."""
        return self.sampled[: self.n_chain]

    @property
    def n_chain(self) -> int:
        """Number of sampled parameters without the fabrics' moduli, which follow them."""
        return self.dimension - (0 if self.moduli is None else len(self.moduli.uncertain))

    def modulus(self, theta: FloatArray) -> FloatArray | None:
        """Return E_fab [Pa] of every fabric at points ``theta``, shape (..., fabrics); None if all are known."""
        if self.moduli is None:
            return None
        scales = {name: self.value(name, theta) for name in MODULUS_SCALES if self.knows(name)}
        return self.moduli.at(theta[..., self.n_chain :]) * self.moduli.factor(scales, self.moduli.batch)

    def with_moduli(self, moduli: FabricModuli) -> ParameterSpace:
        """Return the space with uncertain moduli among the sampled parameters."""
        if moduli.known:
            return self
        extra = [
            Parameter(
                f"{FABRIC_MODULUS}[{name}]", r"$E_{fab}$", "kPa", f"effective modulus of {name}", law, 1e3, _MODULI
            )
            for name, law in zip(moduli.names, moduli.laws, strict=True)
            if law is not None
        ]
        return replace(self, sampled=(*self.sampled, *extra), moduli=moduli)

    @cached_property
    def _coordinates(self) -> list[Coordinate]:
        return [self.bent.get(p.name) or walked(p.prior) for p in self.sampled]

    @cached_property
    def _jointly(self) -> list[int]:
        return [self._place[name] for name in NAMES]

    @cached_property
    def _place(self) -> dict[str, int]:
        return {p.name: k for k, p in enumerate(self.sampled)}


def _draw(parameter: Parameter, rng: np.random.Generator, size: int) -> FloatArray:
    """Return draws of a prior below the largest value of the parameter."""
    below = float(parameter.prior.cumulative(parameter.largest))
    if below < LEAST_SHARE:
        raise InputError(
            f"prior of {parameter.name}: {parameter.prior} lies beyond {parameter.largest:g} {parameter.unit}, the "
            "range of the model"
        )
    return parameter.prior.quantile(below * rng.uniform(np.finfo(float).tiny, 1.0, size))
