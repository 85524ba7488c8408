"""Provenance of a result: typed records of its settings and findings.

Results store it as flat attributes; only this module knows their names and formats. Each section is a frozen dataclass
whose fields are attributes; families of attributes such as ``reading_pressure`` are mappings.
"""

from __future__ import annotations

import platform
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields, replace
from importlib.metadata import version
from typing import Any, Generic, NamedTuple, TypeVar, get_type_hints

import numpy as np
from scipy.special import chdtrc

from softness_bayes.base.errors import InputError
from softness_bayes.base.files.records import as_json, from_json, parse_json, to_json
from softness_bayes.base.laws import Prior
from softness_bayes.base.readable import chance, with_error
from softness_bayes.likelihood.scales import (
    FREE,
    MAGNITUDE,
    SLIDER,
    RatingDirection,
    Scale,
    direction_named,
    name_of_scale,
    scale_named,
    slider_between,
)
from softness_bayes.parameters.declared import PARAMETERS, UNKNOWN_MODULUS
from softness_bayes.parameters.priors import parse_prior
from softness_bayes.touch.readings import ALTERNATIVES, Readings

Section = TypeVar("Section")

CONTRADICTION = 0.01
"""Probability below which two sources contradict each other."""

NOT_ASKED = "none asked for"
"""Attribute that marks a missing number."""

LARGEST_EXACT = 1 << 53
"""Largest integer that a float holds exactly, and every one below; larger ones are written as text."""

PRIOR, READING, VERSION = "prior_", "reading_", "version_"
"""Prefixes of families of attributes, each followed by a name."""


@dataclass(frozen=True)
class Asked:
    """Settings requested for a run."""

    schema_version: int
    command: str
    options: Mapping[str, Any]
    """As recorded in the request of the run."""
    seed: int
    prior_set: str

    @property
    def unknown_modulus(self) -> Prior:
        """Prior law of moduli about which nothing is known [kPa]."""
        return parse_prior(self.options.get("unknown_modulus", str(UNKNOWN_MODULUS)))


@dataclass(frozen=True)
class Ending:
    """State of the chains at the end of the run."""

    verdict: str
    converged: bool
    steps: int
    missing_steps: int
    """Estimated number of further steps until convergence."""
    burn_in: int
    sampling_seconds: float
    evaluations: int
    failures: int
    """Number of evaluations that were not finite."""
    quick: bool = False
    """True if this is a first look, which stops on purpose before convergence."""


@dataclass(frozen=True)
class DirectionTaken:
    """Direction of ratings with the response, and how it was chosen."""

    direction: RatingDirection
    direction_asked: bool = True
    """True if the user chose it, rather than the data or the default."""
    direction_note: str = ""
    firing_rises: float = 1.0
    """Share of prior draws for which firing increases with stiffness across the fabrics."""
    direction_rises: float = np.nan
    """Posterior probability that ratings rise with firing if both directions were sampled, otherwise NaN."""

    direction_rises_se: float = np.nan
    """Its Monte-Carlo standard error, from the ensembles."""

    direction_of_data: str = ""
    """Name of the direction that the data show; empty if they do not decide."""

    @property
    def against_data(self) -> bool:
        """True if the data clearly show the opposite direction."""
        return self.direction != FREE and self.direction_of_data not in ("", self.direction.name)

    @property
    def said(self) -> str:
        """The posterior probability of the direction as a sentence; empty if only one direction was sampled."""
        if np.isnan(self.direction_rises):
            return ""
        up, down = (
            chance(share) if share in (0.0, 1.0) else with_error(100 * share, 100 * self.direction_rises_se, " %")
            for share in (self.direction_rises, 1.0 - self.direction_rises)
        )
        return (
            f"direction: ratings rise with firing with probability {up}, and fall with {down}; the prior gave 1/2 to "
            "each"
        )

    @property
    def sign(self) -> float:
        """+1 if ratings rise with firing, -1 if they fall; the more probable sign if both were sampled."""
        return self.direction.sign if np.isnan(self.direction_rises) else (1.0 if self.direction_rises >= 0.5 else -1.0)


@dataclass(frozen=True)
class RatingSettings:
    """Rating model of a run, apart from its readings, priors and direction."""

    noise: float = 0.0
    rating_scale: Scale = MAGNITUDE
    accuracy: float | None = None
    discretisation: str = ""
    rating_errors: str = "normal"
    """Name of the law of the errors."""
    rating_errors_note: str = ""
    """Reason for the choice of this law."""
    rating_note: str = ""
    """Interpretation of the numbers."""


@dataclass(frozen=True)
class RatingData:
    """The ratings and fabrics of a run."""

    digest_ratings: str = ""
    digest_fabrics: str = ""
    missing_ratings: int = 0
    rating_column: str = "rating"
    """Title of the column of ratings in the file."""
    simulated: bool = False
    """True if `simulate` made the ratings, or if they are those of the example."""


@dataclass(frozen=True)
class NumericalErrors:
    """Numerical errors of the model at draws of the posterior."""

    numerical_error: float
    """Error of the response, relative to its peak."""
    firing_error: float
    """Upper bound of `numerical_error`: every firing rate is given the largest error of its interpolation surface."""
    exactness: str
    exactness_sd: float
    exactness_largest: float
    exactness_efficiency: float
    exactness_pareto_k: float
    exact_enough: bool
    """True if the error of the fast model is known to be negligible; false if it was not compared (sd NaN)."""
    exact_reweight: bool
    inflection_least_drop: float
    """Smallest drop, as a share of the maximum, towards both ends of the range that makes it a turning point."""


@dataclass(frozen=True)
class Finding:
    """Finding of a check of residuals: how likely they are under the model, and how far they deviate.

    Parameters
    ----------
    quantity
        Name of the check in the table of predictive checks.
    p_value
        Probability that replicated ratings deviate at least as much; NaN if the check does not apply.
    estimate
        Standard deviation estimated from the excess over noise; NaN if it is not estimated.
    noticed
        Deviation that would be detected in most tables; NaN if it is not known.
    modelled
        Whether the model includes such deviations, so that the finding is about what remains.
    advice
        Options of the command line that would include them.
    groups
        Number of groups that are compared.
    worst, worst_estimate, worst_errors
        Name of the group that deviates most, its deviation, and the same in standard errors.
    unit
        Unit of the deviations.
    gain
        Estimated gain in the log-likelihood if the model included the deviations; NaN if it is not estimated.
    """

    quantity: str
    p_value: float
    estimate: float = np.nan
    noticed: float = np.nan
    modelled: bool = False
    advice: tuple[str, ...] = ()
    groups: int = 0
    worst: str = ""
    worst_estimate: float = np.nan
    worst_errors: float = np.nan
    unit: str = ""
    gain: float = np.nan


@dataclass(frozen=True)
class Findings:
    """Findings of all checks of residuals."""

    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True)
class Silence:
    """Shares of draws without firing, and of contacts outside the range of Hertz's theory."""

    prior_silent_everywhere: float = np.nan
    prior_silent_conditions: float = np.nan
    posterior_silent_everywhere: float = 0.0
    posterior_silent_conditions: float = 0.0
    contact_beyond_half_radius: float = 0.0
    contact_beyond_radius: float = 0.0


@dataclass(frozen=True)
class PlateData:
    """Compression data of a run, and how its forces grow with indentation."""

    digest_compression: str
    zero_forces: int
    forces_per_finger: float
    """Mean number of forces of each finger."""
    force_exponent: float
    force_exponent_low: float
    force_exponent_high: float
    force_p_value: float


class Agreement(NamedTuple):
    """Agreement of two sources of data about parameters of one model."""

    first: str
    second: str
    chi_square: float
    """Squared distance of the sources' posterior modes by the sum of their covariances."""
    about: tuple[str, ...]
    """The parameters that are compared."""
    shared: bool
    """True if the run gives both sources one value of them."""

    @property
    def p_value(self) -> float:
        """Probability of at least this distance if both sources have the same parameters."""
        return float(chdtrc(len(self.about), self.chi_square))

    @property
    def contradicts(self) -> bool:
        """True if `p_value` is below `CONTRADICTION`."""
        return self.p_value < CONTRADICTION


@dataclass(frozen=True)
class RecordedData:
    """Recorded afferents of a run, and what it says of them."""

    digest_afferents: str
    rate_residual_sd: float
    """Residual sd about the posterior mean of the rates [Hz]."""
    rate_additive_sd: float
    """The same about a table of effects of load, curvature and distance; NaN if it has as many effects as rows."""
    rate_shifts: Mapping[str, Any]
    """Distance of each parameter from the paper's values, in sd of its default prior."""
    rest_low: float
    rest: float
    """Current at rest over the rheobase: median, and 5 and 95 % quantiles."""
    rest_high: float
    fires_at_rest: float
    """Share of draws in which afferents fire without stress."""
    agreements: tuple[Agreement, ...]


class _Part(Generic[Section]):
    """Section of a provenance, read from its attributes when it is asked for."""

    def __init__(self, section: type[Section]) -> None:
        self._section = section

    def __get__(self, provenance: Provenance, owner: type[Provenance]) -> Section:
        values, kinds = dict[str, Any](), get_type_hints(self._section)
        for each in fields(self._section):  # type: ignore[arg-type]
            if each.default is MISSING or each.name in provenance.attributes:
                found = provenance.attributes[each.name]
                try:
                    values[each.name] = _restored(kinds[each.name], found)
                except (KeyError, TypeError, ValueError) as error:
                    raise InputError(f"result: attribute {each.name!r} cannot be {found!r:.60} ({error})") from None
        return self._section(**values)


@dataclass(frozen=True)
class Provenance:
    """Provenance of a result, read from its attributes one section at a time.

    A missing attribute raises a `KeyError`, unless runs without ratings lack it.

    Parameters
    ----------
    attributes
        The attributes.
    """

    attributes: Mapping[Any, Any]

    asked, ending, direction = _Part(Asked), _Part(Ending), _Part(DirectionTaken)
    rating_data, errors, silence = _Part(RatingData), _Part(NumericalErrors), _Part(Silence)
    _found = _Part(Findings)
    plate, recorded, _rating_model = _Part(PlateData), _Part(RecordedData), _Part(RatingSettings)
    """Of runs that use compression data, or recorded afferents."""

    @property
    def priors(self) -> dict[str, Prior]:
        """Priors of all quantities that were sampled, or drawn after sampling, by name."""
        others = {each.name for section in (Asked, Silence) for each in fields(section)}
        return {name: parse_prior(text) for name, text in self._family(PRIOR).items() if PRIOR + name not in others}

    @property
    def readings(self) -> Readings:
        """The readings of the model."""
        return Readings().override({place: str(self.attributes[READING + place]) for place in ALTERNATIVES})

    @property
    def versions(self) -> dict[str, str]:
        """Versions, by name, of Python and of the libraries that affect the numbers."""
        return self._family(VERSION)

    @property
    def verdict(self) -> str:
        """Verdict on convergence as a sentence; empty if not recorded."""
        return str(self.attributes.get("verdict", ""))

    @property
    def rating_model(self) -> RatingSettings:
        """The model of the ratings; the scale of a slider is that of its numbers in the file."""
        found = self._rating_model
        if found.rating_scale != SLIDER:
            return found
        ends = map(float, self.asked.options.get("slider_ends", "0,1").split(","))
        return replace(found, rating_scale=slider_between(*ends))

    @property
    def findings(self) -> dict[str, Finding]:
        """Findings of the checks of residuals, by quantity."""
        return {one.quantity: one for one in self._found.findings}

    @property
    def held_eps(self) -> str:
        """Consequence of a fixed eps, in words; empty if eps was sampled or is not in the model."""
        held = self.asked.options["fix"].get("eps")
        if held is None:
            return ""
        return (
            f"eps is fixed at {held:g} Hz: all intervals treat it as known, although it cannot be measured; omit "
            f"'--fix eps={held:g}' to sample it with its prior {PARAMETERS['eps'].prior}"
        )

    def _family(self, begin: str) -> dict[str, str]:
        found = {str(name): value for name, value in self.attributes.items()}
        return {name.removeprefix(begin): str(value) for name, value in found.items() if name.startswith(begin)}


def attributes_of(*sections: Any) -> dict[str, Any]:
    """Return the attributes that hold sections of a provenance, as `Provenance` reads them."""
    found = {each.name: getattr(section, each.name) for section in sections for each in fields(section)}
    return {name: _stored(value, name) for name, value in found.items()}


def family_of(begin: str, values: Mapping[str, Any]) -> dict[str, str]:
    """Return the attributes of a family (`PRIOR`, `READING` or `VERSION`), keyed by their names without the prefix."""
    return {begin + name: str(value) for name, value in values.items()}


def versions() -> dict[str, str]:
    """Return the versions of all software that the numbers of a result depend on, as attributes."""
    libraries = ("softness-bayes", "numpy", "scipy", "emcee", "arviz", "xarray")
    found = {name.replace("-", "_"): version(name) for name in libraries}
    return family_of(VERSION, {"python": platform.python_version(), **found})


def _stored(value: Any, name: str) -> Any:
    """Return a value as an attribute: a number or a text, which is JSON if the value has parts."""
    if value is None:
        return NOT_ASKED
    if isinstance(value, int) and not isinstance(value, bool) and value > LARGEST_EXACT:
        return str(value)
    if isinstance(value, (bool, int, float)):
        return float(value)  # not an integer, which ArviZ 0.23 cannot write as JSON
    if isinstance(value, Scale):
        return name_of_scale(value)
    if isinstance(value, (str, RatingDirection)):
        return value if isinstance(value, str) else value.name
    return as_json(to_json(value), f"{name} of the run")


def _restored(kind: Any, stored: Any) -> Any:
    """Return the value of an attribute from `_stored`, given its type."""
    if kind in _NAMED:
        return _NAMED[kind](str(stored))
    if kind == float | None:
        return None if stored == NOT_ASKED else float(stored)
    if isinstance(kind, type):
        return kind(stored)
    return from_json(kind, parse_json(str(stored)))


_NAMED = {RatingDirection: direction_named, Scale: scale_named}
"""Functions that read values which are stored by their name, by type."""
