"""The parameters, each declared once, and the space of those that are sampled (model.md 10)."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softness_bayes.errors import InputError
from softness_bayes.parameters.coordinates import Coordinate, Coordinates, coordinate_for
from softness_bayes.parameters.priors import HalfNormal, Laws, LogNormal, Prior
from softness_bayes.ranges import Range
from softness_bayes.touch.contact import DISPLACEMENT, STRAIN, SkinDisplacement
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, Channels, Membrane
from softness_bayes.touch.neuron.surface import FiringSurface
from softness_bayes.touch.neuron.surface_design import DESIGNS
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.scene import LARGEST_CURRENT

FloatArray = NDArray[np.float64]

_ROUNDING = 1e-9
_REDRAWS = 1000


_POSITIVE = Range(1e-6, 1e6)
_MULTIPLIER = Range(0.1, 10.0)
_FROM_ZERO = Range(1e-6, 1e6, zero=True)
_SPREAD = Range(1e-6, 100.0, zero=True)
# less than this is no noise but a surface, and a walk on it never ends
_NOISE = Range(1e-4, 100.0)


@dataclass(frozen=True)
class Parameter:
    """One parameter of the model, as every chain, file, plot, table and help text names it.

    Parameters
    ----------
    name, symbol, unit, meaning
        Name in files and options, LaTeX symbol, natural unit, and what it is.
    si
        SI units (or the neuron's own) in one natural unit.
    prior
        Default prior, in natural units.
    range
        Values that it may be held at, in natural units; at its upper end every prior ends.
    """

    name: str
    symbol: str
    unit: str
    meaning: str
    prior: Prior
    si: float = 1.0
    range: Range = _POSITIVE

    @property
    def largest(self) -> float:
        """Value beyond which the model does not answer, and every prior ends."""
        return self.range.high

    def up_to(self, largest: float) -> Parameter:
        """Return the same parameter with another largest value."""
        return replace(self, range=replace(self.range, high=largest))

    @property
    def label(self) -> str:
        """Symbol with its unit, for an axis."""
        return f"{self.symbol} [{self.unit}]" if self.unit != "–" else self.symbol


PARAMETERS: Mapping[str, Parameter] = MappingProxyType(
    {
        parameter.name: parameter
        for parameter in (
            Parameter("b", r"$b$", "kPa", "skin modulus at rest", LogNormal(100, 0.5), si=1e3),
            Parameter("m", r"$m$", "–", "stiffening of the skin", LogNormal(2, 0.3), range=_FROM_ZERO),
            Parameter(
                "alpha",
                r"$\alpha$",
                "µA/cm²",
                "largest receptor current",
                LogNormal(20.3, 0.1),
                range=Range(1e-6, LARGEST_CURRENT),
            ),
            Parameter("beta", r"$\beta$", "1/kPa", "steepness of transduction", LogNormal(0.6, 0.3), si=1e-3),
            Parameter("sigma_0", r"$\sigma_0$", "kPa", "stress at half current", LogNormal(9, 0.4), si=1e3),
            Parameter(
                "c_Na", r"$c_{Na}$", "–", "sodium conductance multiplier", LogNormal(1.05, 0.03, 0.1), range=_MULTIPLIER
            ),
            Parameter(
                "c_K", r"$c_K$", "–", "potassium conductance multiplier", LogNormal(1.16, 0.03, 0.1), range=_MULTIPLIER
            ),
            Parameter(
                "c_L", r"$c_L$", "–", "leak conductance multiplier", LogNormal(1.0, 0.03, 0.1), range=_MULTIPLIER
            ),
            Parameter(
                "c_A", r"$c_A$", "–", "A-current conductance multiplier", LogNormal(1.5, 0.03, 0.1), range=_MULTIPLIER
            ),
            Parameter("gamma", r"$\gamma$", "–", "exponent of the rating", LogNormal(1, 0.3), range=Range(1e-3, 1e3)),
            Parameter("tau", r"$\tau$", "–", "spread of participants", HalfNormal(1), range=_SPREAD),
            Parameter(
                "varsigma", r"$\varsigma$", "–", "spread of a participant's ratings", HalfNormal(0.5), range=_NOISE
            ),
            Parameter("omega", r"$\omega$", "–", "spread between fabrics", HalfNormal(0.5), range=_SPREAD),
            Parameter("eps", r"$\epsilon$", "Hz", "rate added to a silent fabric's", LogNormal(0.1, 1)),
        )
    }
)
"""Every parameter by name, in the order of files and tables."""

FINGER_PARAMETERS: Mapping[str, Parameter] = MappingProxyType(
    {
        parameter.name: parameter
        for parameter in (
            Parameter("tau_b", r"$\tau_b$", "–", "spread of fingers' log b", HalfNormal(0.5), range=_SPREAD),
            Parameter("tau_m", r"$\tau_m$", "–", "spread of fingers' m", HalfNormal(1), range=_FROM_ZERO),
            Parameter(
                "varsigma_f", r"$\varsigma_F$", "–", "spread of a finger's log forces", HalfNormal(0.3), range=_NOISE
            ),
        )
    }
)
"""What compression data add to the parameters: how fingers and single forces depart from b and m."""

EVERY_PARAMETER: Mapping[str, Parameter] = MappingProxyType({**PARAMETERS, **FINGER_PARAMETERS})
"""All parameters that a run may sample, by name."""

HELD: Mapping[str, float] = MappingProxyType({"omega": 0.0})
"""Parameters that are held at a value unless they are freed or given a prior."""

LEAST_ODDS = 0.01
"""Least alpha / rheobase - 1 in the coordinate of sigma_0, which would have no end otherwise."""

PRIOR_SETS: Mapping[str, Mapping[SkinDisplacement, Mapping[str, Prior]]] = MappingProxyType(
    {
        "default": {STRAIN: {}, DISPLACEMENT: {"m": LogNormal(707, 0.3), "tau_m": HalfNormal(354)}},
        "in-vivo": {
            STRAIN: {"b": LogNormal(7.5, 0.25), "m": LogNormal(3.9, 0.1)},
            DISPLACEMENT: {"b": LogNormal(15.8, 0.2), "m": LogNormal(630, 0.1), "tau_m": HalfNormal(354)},
        },
        # for compression data alone: the others hold what such data are there to tell
        "wide": {
            STRAIN: {"b": LogNormal(30, 1), "m": LogNormal(3, 0.5)},
            DISPLACEMENT: {"b": LogNormal(30, 1), "m": LogNormal(1060, 0.5), "tau_m": HalfNormal(354)},
        },
    }
)
"""Named prior sets: what differs from the parameters' own priors under each reading of the skin."""


@dataclass(frozen=True)
class ParameterSpace:
    """The sampled parameters, in order, and the values of the held ones.

    A point theta is an array in natural units whose last axis runs over `sampled`; z is the same
    point in the coordinates of the sampler, unbounded on every axis.
    """

    sampled: tuple[Parameter, ...]
    held: Mapping[str, float]
    firing: FiringSurface | None = field(default=None, repr=False, compare=False)
    """Where channel multipliers are sampled, the surface that answers for them. Every prior ends at the border of
    its corner, where firing begins at a jump: less than 1e-4 of the default one lies beyond."""
    bent: Mapping[str, Coordinate] = field(default_factory=dict)
    """Coordinates of sampled parameters that differ from what their priors' supports suggest."""
    rheobase: float | None = None
    """Rheobase at the centre of the channels' box, or of the held channels [µA/cm²]. Where it is known sigma_0 walks
    as the stress at which receptors begin to fire, of which the data tell most."""
    _coordinates: Coordinates = field(init=False, repr=False, compare=False)
    _laws: Laws = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "held", MappingProxyType(dict(self.held)))
        object.__setattr__(self, "bent", MappingProxyType(dict(self.bent)))
        coordinates = tuple(self.bent.get(p.name) or coordinate_for(p.prior.support) for p in self.sampled)
        object.__setattr__(self, "_coordinates", Coordinates(coordinates))
        object.__setattr__(self, "_laws", Laws([p.prior for p in self.sampled], [p.largest for p in self.sampled]))

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        # a mapping proxy cannot travel to a worker
        return type(self), (self.sampled, dict(self.held), self.firing, dict(self.bent), self.rheobase)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the sampled parameters."""
        return tuple(p.name for p in self.sampled)

    @property
    def dimension(self) -> int:
        """Number of sampled parameters."""
        return len(self.sampled)

    def require_sampled(self) -> None:
        """Refuse a space without a sampled parameter.

        Raises
        ------
        InputError
            Saying what evaluates the model instead.
        """
        if not self.sampled:
            raise InputError(
                "all parameters are held, there is nothing to sample: free one; 'softness-bayes sample' with all of "
                "them fixed, or softness_bayes.runs.evaluation.evaluate in Python, evaluates the model at that point"
            )

    def natural(self, z: FloatArray) -> FloatArray:
        """Points theta [natural units] at sampler coordinates ``z``, both of shape (..., dimension)."""
        theta = self._coordinates.natural(z)
        shift = self.rheobase_shift(theta)
        if self._walks_along("alpha", self.firing):
            theta[..., self._place["alpha"]] += shift
        if self._walks_along("sigma_0", self.rheobase):
            theta[..., self._place["sigma_0"]] += self._beyond_threshold(theta, shift)
        return theta

    def coordinates(self, theta: FloatArray) -> FloatArray:
        """Sampler coordinates z at points ``theta``, the inverse of `natural`."""
        theta = np.array(theta, dtype=float)
        shift = self.rheobase_shift(theta)
        if self._walks_along("sigma_0", self.rheobase):
            theta[..., self._place["sigma_0"]] -= self._beyond_threshold(theta, shift)
        if self._walks_along("alpha", self.firing):
            theta[..., self._place["alpha"]] -= shift
        return self._coordinates.coordinate(theta)

    def _walks_along(self, name: str, other: object) -> bool:
        """Whether a parameter's coordinate moves along with others that are known: a shear, which keeps volumes."""
        return other is not None and name in self.bent and name in self._place

    def _beyond_threshold(self, theta: FloatArray, shift: FloatArray) -> FloatArray:
        """How far sigma_0 lies above the stress at which receptors begin to fire [kPa], nearly: ln(odds) / beta.

        The odds of the current at the rheobase are kept above `LEAST_ODDS`: it is a coordinate only.
        """
        if self.rheobase is None:
            return np.zeros(theta.shape[:-1])
        odds = self.value("alpha", theta) / (self.rheobase + shift) - 1.0
        # where others have overflowed there is no prior, and must be no NaN
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            beyond = np.log(np.maximum(odds, 0.0) + LEAST_ODDS) / self.value("beta", theta)
        return np.where(np.isnan(beyond), 0.0, beyond)

    def rheobase_shift(self, theta: FloatArray) -> FloatArray:
        """How far the channel multipliers at points theta move the rheobase [µA/cm²], shape (...)."""
        if self.firing is None:
            return np.zeros(theta.shape[:-1])
        return self.firing.rheobase_shift(Channels(*(self.value(name, theta) for name in Channels._fields)))

    def log_jacobian(self, z: FloatArray) -> FloatArray:
        """Log of the volume of theta per volume of z at ``z``, shape (...)."""
        return self._coordinates.log_slope(z).sum(axis=-1)

    def log_prior(self, theta: FloatArray) -> FloatArray:
        """Log prior density of each parameter [1/natural unit], shape (..., dimension).

        It is -inf outside the open interval of a support: the sampler's coordinates never reach the
        ends except by rounding; and of the channel multipliers where firing begins at a jump.
        """
        density = self._laws.log_density(theta)
        if self.firing is not None:
            answered = self._answered(theta)
            if not answered.all():
                channels = [k for k, p in enumerate(self.sampled) if p.name in Channels._fields]
                density[..., channels] = np.where(answered[..., None], density[..., channels], -np.inf)
        return density

    def _answered(self, theta: FloatArray) -> NDArray[np.bool_]:
        """Whether the firing-rate surface answers at points theta, shape (...)."""
        if self.firing is None:
            return np.ones(theta.shape[:-1], dtype=bool)
        return self.firing.answers(Channels(*(self.value(name, theta) for name in Channels._fields)))

    def draw_prior(self, rng: np.random.Generator, size: int) -> FloatArray:
        """Independent draws from the prior, shape (size, dimension).

        Raises
        ------
        InputError
            If all but nothing of a prior lies where the model answers.
        """
        theta = np.empty((size, self.dimension))
        for k, p in enumerate(self.sampled):
            theta[:, k] = _draw(p, rng, size)
        for _ in range(_REDRAWS):
            beyond = np.flatnonzero(~self._answered(theta))
            if not beyond.size:
                return theta
            theta[beyond] = np.stack([_draw(p, rng, beyond.size) for p in self.sampled], axis=-1)
        raise InputError(
            "the priors of the channel multipliers lie where firing begins at a jump, in the corner that the "
            "firing-rate surface leaves out; hold the multipliers"
        )

    @property
    def median(self) -> FloatArray:
        """The point of the priors' medians, shape (dimension,)."""
        return np.array([p.prior.median for p in self.sampled])

    def values(self, theta: FloatArray) -> dict[str, FloatArray | float]:
        """Every parameter of the model by name in natural units: sampled ones of shape (...), held ones a float."""
        known = self.held.keys() | self._place.keys()
        return {name: self.value(name, theta) for name in EVERY_PARAMETER if name in known}

    def value(self, name: str, theta: FloatArray) -> FloatArray | float:
        """One parameter of the model in natural units: a sampled one of shape (...), a held one a float."""
        return self.held[name] if name in self.held else theta[..., self._place[name]]

    def touch(self, theta: FloatArray) -> TouchParameters:
        """The parameters of the forward model in SI at points ``theta``."""
        return TouchParameters(*(self.value(n, theta) * PARAMETERS[n].si for n in TouchParameters._fields))

    @cached_property
    def _place(self) -> dict[str, int]:
        return {p.name: k for k, p in enumerate(self.sampled)}


def parameter_space(
    free: Iterable[str] = (),
    fix: Mapping[str, float] | None = None,
    priors: Mapping[str, Prior] | None = None,
    prior_set: str = "default",
    skin_displacement: SkinDisplacement = STRAIN,
    n_participants: int | None = None,
    absent: Collection[str] = (),
    n_fingers: int | None = None,
    membrane: Membrane = CONNOR_STEVENS,
) -> ParameterSpace:
    """Decide which parameters are sampled, under which priors, and where the others are held.

    Parameters
    ----------
    free
        Parameters to sample that are `HELD` by default.
    fix
        Parameters to hold, with their values in natural units.
    priors
        Priors in place of the declared ones; a `HELD` parameter with a prior is freed.
    prior_set
        A name of `PRIOR_SETS`.
    skin_displacement
        Reading of the skin's displacement, which decides unit and prior of m.
    n_participants
        With one, tau cannot be told from mu and is held at 0.
    absent
        Parameters that the model at hand does not have: neither sampled nor held.
    n_fingers
        Fingers of the compression data; without any there are no `FINGER_PARAMETERS`. With one, the
        spreads between fingers cannot be told from b and m and are held at 0.
    membrane
        Reading of the membrane, whose firing-rate surface limits alpha and the channel multipliers. One that it does
        not have is held.

    Raises
    ------
    InputError
        If a name is unknown or absent, a parameter is both held and sampled, or a value or a prior's support
        leaves the values that a parameter can take.
    """
    fix, priors = dict(fix or {}), dict(priors or {})
    freed = set(free) | set(priors)
    absent = {*absent, *(() if n_fingers else FINGER_PARAMETERS)}
    for name in (*fix, *freed):
        _declared(name)
        if name in absent:
            raise InputError(f"{name}: the model of these data has no such parameter; leave it out")
    if clash := sorted(freed & fix.keys()):
        raise InputError(f"{clash[0]} is both fixed and given a prior or freed; choose one")
    if prior_set not in PRIOR_SETS:
        raise InputError(f"prior set '{prior_set}': expected one of {', '.join(PRIOR_SETS)}")
    if n_participants == 1 and "tau" not in absent:
        if "tau" in freed:
            raise InputError("tau cannot be sampled: there is one participant only, so fix it or leave it out")
        fix.setdefault("tau", 0.0)
    if n_fingers == 1:
        for name in ("tau_b", "tau_m"):
            if name in freed:
                raise InputError(f"{name} cannot be sampled: there is one finger only, so fix it or leave it out")
            fix.setdefault(name, 0.0)
    for name in membrane.without_effect:
        if name in freed:
            raise InputError(
                f"{name} cannot be sampled: the membrane {membrane.name} has no such current; leave it out"
            )
        if name not in absent:
            fix.setdefault(name, PARAMETERS[name].prior.median)
    held = {name: value for name, value in HELD.items() if name not in (*freed, *absent)} | fix
    for name, value in held.items():
        _require_value(EVERY_PARAMETER[name], value)
    chosen = {**PRIOR_SETS[prior_set][skin_displacement], **priors}
    units = dict.fromkeys(("m", "tau_m"), skin_displacement.exponent_unit)
    sampled = tuple(
        replace(p, prior=_suitable(p, chosen.get(name, p.prior)), unit=units.get(name, p.unit))
        for name, p in EVERY_PARAMETER.items()
        if name not in held and name not in absent
    )
    free_channels = any(p.name in Channels._fields for p in sampled)
    # a membrane without a surface has usual values all the same; who asks for its rates is told
    firing = FiringSurface.load(membrane) if free_channels and membrane.name in DESIGNS else None
    return ParameterSpace(sampled if firing is None else _within_surface(sampled, held, firing), held, firing)


def require_values(values: Mapping[str, float]) -> None:
    """Refuse values [natural units] that no model could be held at, whatever its data.

    Raises
    ------
    InputError
        Naming a parameter that does not exist, or the range of one.
    """
    for name, value in values.items():
        _require_value(_declared(name), value)


def require_priors(priors: Mapping[str, Prior]) -> None:
    """Refuse priors of parameters that do not exist, or that these could not take.

    Raises
    ------
    InputError
        Naming the parameter, and the range of its values.
    """
    for name, prior in priors.items():
        _suitable(_declared(name), prior)


def _declared(name: str) -> Parameter:
    if name not in EVERY_PARAMETER:
        raise InputError(f"no parameter '{name}'; expected one of {', '.join(EVERY_PARAMETER)}")
    return EVERY_PARAMETER[name]


def _require_value(parameter: Parameter, value: float) -> None:
    replace(parameter.range, unit=parameter.unit).require(parameter.name, value)


def _within_surface(
    sampled: tuple[Parameter, ...], held: Mapping[str, float], firing: FiringSurface
) -> tuple[Parameter, ...]:
    """The parameters as they are where channel multipliers are sampled: alpha ends with the firing-rate surface.

    Raises
    ------
    InputError
        If the prior of a multiplier, or alpha held at a value, reaches beyond what the surface covers.
    """
    channels = [p for p in sampled if p.name in Channels._fields]
    for p in channels:
        low, high = firing.design.interval(p.name)
        if p.prior.support[0] < low * (1 - _ROUNDING) or p.prior.support[1] > high * (1 + _ROUNDING):
            raise InputError(
                f"prior of {p.name}: {p.prior} reaches beyond {low:g} to {high:g}, where the firing-rate surface ends; "
                f"expected one that ends there, as {PARAMETERS[p.name].prior} does, or {p.name} fixed"
            )
    if held.get("alpha", 0.0) > firing.max_current:
        raise InputError(
            f"alpha is {held['alpha']}, expected at most {firing.max_current:g} µA/cm², where "
            f"the firing-rate surface ends; fix {', '.join(p.name for p in channels)} too for larger ones"
        )
    return tuple(
        replace(p, range=replace(p.range, high=firing.max_current)) if p.name == "alpha" else p for p in sampled
    )


def _suitable(parameter: Parameter, prior: Prior) -> Prior:
    if prior.support[0] < 0:
        raise InputError(
            f"prior of {parameter.name}: {prior} allows negative values, which {parameter.name} cannot take; "
            "expected lognormal, halfnormal or uniform above 0"
        )
    replace(parameter.range, unit=parameter.unit).require(f"prior of {parameter.name}: median of {prior}", prior.median)
    return prior


def _draw(parameter: Parameter, rng: np.random.Generator, size: int) -> FloatArray:
    values = parameter.prior.draw(rng, size)
    for _ in range(_REDRAWS):
        beyond = np.flatnonzero(values >= parameter.largest)
        if not beyond.size:
            return values
        values[beyond] = parameter.prior.draw(rng, beyond.size)
    raise InputError(
        f"prior of {parameter.name}: {parameter.prior} lies beyond {parameter.largest:g} {parameter.unit}, "
        "where the model ends"
    )
