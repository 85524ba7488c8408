"""Provenance of a result: what was asked for and what was found, typed.

Results keep it as flat attributes; this module alone knows how these are named and written. A section is a frozen
dataclass whose fields are its attributes, and families such as ``reading_pressure`` are mappings.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, field, fields
from typing import Any, TypeVar

import numpy as np

from softness_bayes.errors import InputError
from softness_bayes.likelihood.magnitude import RatingDirection, direction_named
from softness_bayes.likelihood.scales import MAGNITUDE, RATING_SCALES, RatingScale
from softness_bayes.parameters.priors import Prior, parse_prior
from softness_bayes.touch.readings import ALTERNATIVES, Readings

Section = TypeVar("Section")

NO_ACCURACY = "none asked for"
"""Attribute of runs whose resolution was given."""

FORMER_LEAST_DROP = 0.02
"""`NumericalErrors.inflection_least_drop` of results that do not record it."""

PRIOR, READING, VERSION = "prior_", "reading_", "version_"
"""Beginnings of attributes that belong together, each followed by a name."""

MOST_INTEGER = 1 << 63
"""NetCDF has no integer from here on: a larger seed is written as text."""


def _stored(read: Callable[[Any], Any], write: Callable[[Any], Any], default: Any = MISSING) -> Any:
    """Return a field that is read from an attribute and written to one; results without it have the default."""
    return field(default=default, metadata={"read": read, "write": write})


def _text(default: Any = MISSING) -> Any:
    return _stored(str, str, default)


def _number(default: Any = MISSING) -> Any:
    return _stored(float, float, default)


def _count(default: Any = MISSING) -> Any:
    return _stored(int, int, default)


def _yes(default: Any = MISSING) -> Any:
    return _stored(bool, int, default)


@dataclass(frozen=True)
class Asked:
    """What was asked for."""

    schema_version: int = _count()
    command: str = _text()
    options: Mapping[str, Any] = _stored(lambda text: json.loads(str(text)), lambda options: json.dumps(options))
    seed: int = _stored(int, lambda seed: seed if seed < MOST_INTEGER else str(seed))
    prior_set: str = _text()


@dataclass(frozen=True)
class Ending:
    """How the walk ended."""

    verdict: str = _text()
    converged: bool = _yes()
    steps: int = _count()
    missing_steps: int = _count()
    burn_in: int = _count()
    sampling_seconds: float = _number()
    evaluations: int = _count()
    failures: int = _count()


@dataclass(frozen=True)
class DirectionTaken:
    """Which way ratings run with the response, and why."""

    direction: RatingDirection = _stored(lambda name: direction_named(str(name)), lambda direction: direction.name)
    direction_asked: bool = _yes(True)
    """Whether it was asked for, and not taken from the data or by default."""
    direction_note: str = _text("")
    firing_rises: float = _number(1.0)
    """Share of prior draws under which firing rises with stiffness over the fabrics."""


@dataclass(frozen=True)
class RatingModel:
    """What the model of a run on ratings is, beyond readings, priors and direction."""

    noise: float = _number(0.0)
    rating_scale: RatingScale = _stored(lambda name: RATING_SCALES[str(name)], lambda scale: scale.name, MAGNITUDE)
    accuracy: float | None = _stored(
        lambda found: None if found == NO_ACCURACY else float(found),
        lambda accuracy: NO_ACCURACY if accuracy is None else accuracy,
        None,
    )
    discretisation: str = _text("")


@dataclass(frozen=True)
class RatingData:
    """Which ratings and fabrics a run was on."""

    digest_ratings: str = _text("")
    digest_fabrics: str = _text("")
    missing_ratings: int = _count(0)


@dataclass(frozen=True)
class NumericalErrors:
    """Numerical errors of the model at draws of the posterior."""

    numerical_error: float = _number()
    """Of the response, relative to its peak."""
    inflection_least_drop: float = _number(FORMER_LEAST_DROP)
    firing_error: float = _number()
    """As `numerical_error`, if every receptor's firing rate had the largest error of its surface."""
    exactness: str = _text()
    exactness_sd: float = _number()
    exactness_largest: float = _number()
    exactness_efficiency: float = _number()
    exactness_pareto_k: float = _number()
    exact_reweight: bool = _yes(False)


@dataclass(frozen=True)
class ResidualChecks:
    """Checks of the residuals of fabrics, conditions and participants."""

    fabric_check: str = _text("")
    fabric_p_value: float = _number(np.nan)
    fabric_deviation: float = _number(np.nan)
    condition_p_value: float = _number(np.nan)
    condition_deviation: float = _number(np.nan)
    condition_noticed: float = _number(np.nan)
    exponent_check: str = _text("")
    exponent_p_value: float = _number(np.nan)
    exponent_deviation: float = _number(np.nan)


@dataclass(frozen=True)
class Silence:
    """How often the model is silent, and how often the contact leaves Hertz's range, as shares."""

    prior_silent_everywhere: float = _number(np.nan)
    prior_silent_conditions: float = _number(np.nan)
    posterior_silent_everywhere: float = _number(0.0)
    posterior_silent_conditions: float = _number(np.nan)
    contact_beyond_half_radius: float = _number(0.0)
    contact_beyond_radius: float = _number(0.0)


@dataclass(frozen=True)
class PlateData:
    """Compression data of a run, and how its forces grow with indentation."""

    digest_compression: str = _text()
    zero_forces: int = _count()
    force_check: str = _text()
    force_exponent: float = _number()
    force_exponent_low: float = _number()
    force_exponent_high: float = _number()
    force_p_value: float = _number()


@dataclass(frozen=True)
class Provenance:
    """Provenance of a result, read from its attributes.

    Parameters
    ----------
    attributes
        The attributes; one that is missing is an InputError where it is read.
    """

    attributes: Mapping[str, Any]

    @property
    def asked(self) -> Asked:
        """What was asked for."""
        return self._section(Asked)

    @property
    def priors(self) -> dict[str, Prior]:
        """The priors of what was sampled or drawn afterwards, by name."""
        others = {each.name for each in fields(Asked)} | {each.name for each in fields(Silence)}
        return {name: parse_prior(text) for name, text in self._family(PRIOR).items() if PRIOR + name not in others}

    @property
    def readings(self) -> Readings:
        """The readings of the model."""
        return Readings().override({place: str(self.attributes[READING + place]) for place in ALTERNATIVES})

    @property
    def versions(self) -> dict[str, str]:
        """Versions of Python and of the libraries that the numbers depend on, by name."""
        return self._family(VERSION)

    @property
    def ending(self) -> Ending:
        """How the walk ended."""
        return self._section(Ending)

    @property
    def direction(self) -> DirectionTaken:
        """Which way ratings run with the response."""
        return self._section(DirectionTaken)

    @property
    def rating_model(self) -> RatingModel:
        """What the model of the ratings is."""
        return self._section(RatingModel)

    @property
    def rating_data(self) -> RatingData:
        """Which ratings and fabrics the run was on."""
        return self._section(RatingData)

    @property
    def errors(self) -> NumericalErrors:
        """Numerical errors of the model."""
        return self._section(NumericalErrors)

    @property
    def residuals(self) -> ResidualChecks:
        """Checks of the residuals."""
        return self._section(ResidualChecks)

    @property
    def silence(self) -> Silence:
        """How often the model is silent."""
        return self._section(Silence)

    @property
    def plate(self) -> PlateData:
        """Compression data, of a run that had some."""
        return self._section(PlateData)

    @property
    def held_eps(self) -> str:
        """What it means that eps was held; empty where it was sampled or there is none."""
        return str(self.attributes.get("held_eps", ""))

    def _family(self, begin: str) -> dict[str, str]:
        found = {str(name): value for name, value in self.attributes.items()}
        return {name.removeprefix(begin): str(value) for name, value in found.items() if name.startswith(begin)}

    def _section(self, section: type[Section]) -> Section:
        values = {}
        for each in fields(section):  # type: ignore[arg-type]
            if each.name not in self.attributes and each.default is not MISSING:
                continue
            found = self.attributes[each.name]
            try:
                values[each.name] = each.metadata["read"](found)
            except (KeyError, TypeError, ValueError) as error:
                raise InputError(
                    f"result: attribute {each.name!r} is {found!r:.60}, which cannot be ({error})"
                ) from None
        return section(**values)


def attributes_of(section: Any) -> dict[str, Any]:
    """Return the attributes that hold a section of a provenance, as `Provenance` reads them."""
    return {each.name: each.metadata["write"](getattr(section, each.name)) for each in fields(section)}
