"""Options of the model of an experiment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from types import MappingProxyType
from typing import Any, Self

import numpy as np

from softness_bayes.defaults import ACCURACY, NOISE, PRIOR_SET
from softness_bayes.errors import InputError
from softness_bayes.kinds import numbers, refuse, require_kind
from softness_bayes.likelihood.directions import RatingDirection, direction_named
from softness_bayes.likelihood.error_laws import NORMAL, ErrorLaw, error_law_named
from softness_bayes.likelihood.scales import MAGNITUDE, Scale, name_of_scale, require_name, scale_named
from softness_bayes.model.fingers import finger_of, values_of
from softness_bayes.model.individual import answers_of, require_individual
from softness_bayes.parameters.fabric_moduli import UNKNOWN_MODULUS, require_law
from softness_bayes.parameters.priors import Prior, as_prior, as_priors, parse_prior, require_storable
from softness_bayes.ranges import CATEGORIES_RANGE, LOAD_ERRORS, RELATIVE_ERRORS, RESOLUTIONS, SHARED_LOAD_ERRORS
from softness_bayes.touch.contact import Finger
from softness_bayes.touch.readings import MENDED, Readings
from softness_bayes.touch.scene import Discretisation

NUMBER = (int, float, np.number)
KINDS: Mapping[str, tuple[Any, str]] = MappingProxyType(
    {
        "fix": (Mapping, "a mapping from names to numbers, such as {'m': 2.0}"),
        "readings": (Readings, "Readings, such as NAMED_READINGS['printed'] or Readings(pressure=...)"),
        "direction": ((RatingDirection, type(None)), "RISES, FALLS, FREE or None"),
        "scale": (Scale, "a Scale, such as SLIDER or CATEGORIES"),
        "finger": (Finger, "a Finger, such as Finger(receptor_depth=0.6e-3)"),
        "individual": (tuple, "a tuple of names, such as ('b',)"),
        "errors": ((ErrorLaw, type(None)), "NORMAL, STUDENT, LAPSES or None"),
        "noise": (NUMBER, "a number"),
        "accuracy": (NUMBER, "a number, such as 1e-3"),
        "discretisation": ((Discretisation, type(None)), "a Discretisation or None"),
    }
)
"""Options whose type is checked, with a description of the expected type; the others have separate checks."""


@dataclass(frozen=True)
class ModelOptions:
    """Choices that define the model of an experiment.

    Direction of the ratings, error law and discretisation may be left open. `build` then chooses
    them and returns a model whose options have them filled in.

    Parameters
    ----------
    fix, priors, prior_set
        Fixed parameters, priors of single parameters and the named set of priors, as for `parameter_space`. A prior is
        a law, such as ``LogNormal(100, 0.5)``, or its written form, ``"lognormal(100,0.5)"``.
    readings, scale
        Readings of the forward model, and scale of the ratings.
    direction
        Whether ratings rise or fall with the response; None to infer it from the data.
    finger
        The fingertip: radius, pad, depth of the receptors, centre of contact.
    modulus_cv
        Relative standard error of measured moduli that have none in the table; 0 if they are exact. None also takes
        them as exact, but the run reports the possible consequences.
    unknown_modulus
        Prior law for the moduli of fabrics about which nothing is known [kPa].
    load_cv
        Relative standard error of the loads of ratings that have none in the table; 0 or None if loads are exact.
    shared_load_cv
        Relative standard error of each load, shared by all its ratings; 0 or None if there is no such error.
    individual
        Quantities that differ between raters, each with a sampled spread: either some of b, m and sigma_0 (fingers), or
        gamma (exponent), varsigma (noise) or both (answers). By default nothing differs.
    errors
        Error law of the ratings; None to infer it from the residuals of the table.
    resolution
        Grid step of the numbers that raters use, if the table has no such column; 0 for exact numbers. None infers the
        step of each rater.
    slider_ends
        Numbers of the two ends of a slider.
    n_categories
        Number of ordered categories; None for the largest number in the table.
    noise
        Strength of the white-noise current of the membranes [µA/cm² sqrt(ms)]; requires fixed channel multipliers.
    accuracy
        Bound on the numerical error of the response, relative to its peak and in log(N/N_ref + eps): the cheapest
        discretisation that meets it over prior draws is chosen. Ignored if a discretisation is given.
    discretisation
        Resolution of the scene; None to choose one that meets the accuracy.
    decided
        Names of the options ("direction", "errors", "discretisation") that were chosen automatically, for the record.
    """

    fix: Mapping[str, float] = field(default_factory=dict)
    priors: Mapping[str, Any] = field(default_factory=dict)
    prior_set: str = PRIOR_SET
    readings: Readings = MENDED
    direction: RatingDirection | None = None
    scale: Scale = MAGNITUDE
    finger: Finger = Finger()
    modulus_cv: float | None = None
    unknown_modulus: Prior = UNKNOWN_MODULUS
    load_cv: float | None = None
    shared_load_cv: float | None = None
    individual: tuple[str, ...] = ()
    errors: ErrorLaw | None = None
    resolution: float | None = None
    slider_ends: tuple[float, float] = (0.0, 1.0)
    n_categories: int | None = None
    noise: float = NOISE
    accuracy: float = ACCURACY
    discretisation: Discretisation | None = None
    decided: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        for name, (kind, expected) in KINDS.items():
            require_kind(name, getattr(self, name), kind, expected)
        two = "two numbers, the lower one first, as in (0, 100)"
        if numbers("slider_ends", self.slider_ends, two).shape != (2,):
            refuse("slider_ends", self.slider_ends, two)
        if self.modulus_cv is not None:
            RELATIVE_ERRORS.require("modulus_cv", self.modulus_cv)
        object.__setattr__(self, "priors", as_priors(self.priors))
        object.__setattr__(self, "unknown_modulus", as_prior("unknown moduli", self.unknown_modulus))
        require_law("unknown_modulus", self.unknown_modulus)
        if self.load_cv is not None:
            LOAD_ERRORS.require("load_cv", self.load_cv)
        if self.shared_load_cv is not None:
            SHARED_LOAD_ERRORS.require("shared_load_cv", self.shared_load_cv)
        require_individual(self.individual)
        if self.resolution is not None:
            RESOLUTIONS.require("resolution", self.resolution)
        if self.n_categories is not None:
            CATEGORIES_RANGE.require("n_categories", self.n_categories)
        if not (np.isfinite(self.slider_ends).all() and self.slider_ends[0] < self.slider_ends[1]):
            raise InputError(f"slider: ends {self.slider_ends}, expected two numbers, the lower one first")

    def require_storable(self) -> None:
        """Raise an error for readings and priors that could not be restored from a stored run.

        Raises
        ------
        InputError
            With the reason.
        """
        self.readings.require_names()
        require_name(self.scale)
        for name, prior in {**self.priors, "unknown moduli": self.unknown_modulus}.items():
            require_storable(f"prior of {name}", prior)

    def decide(self, **found: Any) -> Self:
        """Return the options with open choices filled in, given by name."""
        return replace(self, **found, decided=self.decided | found.keys())

    @property
    def kept_accuracy(self) -> float | None:
        """Accuracy met by the discretisation; None if the discretisation was given."""
        given = self.discretisation is not None and "discretisation" not in self.decided
        return None if given else self.accuracy

    def record(self) -> dict[str, Any]:
        """Return these options as JSON data; `from_record` is the inverse."""
        return {
            "fix": dict(self.fix),
            "priors": {name: str(prior) for name, prior in self.priors.items()},
            "prior_set": self.prior_set,
            "readings": self.readings.names,
            "direction": None if self.direction is None else self.direction.name,
            "direction_decided": "direction" in self.decided,
            "scale": name_of_scale(self.scale),
            **({"finger": values_of(self.finger)} if self.finger != Finger() else {}),
            **({} if self.modulus_cv is None else {"modulus_cv": self.modulus_cv}),
            **({"unknown_modulus": str(self.unknown_modulus)} if self.unknown_modulus != UNKNOWN_MODULUS else {}),
            **({} if self.load_cv is None else {"load_cv": self.load_cv}),
            **({} if self.shared_load_cv is None else {"shared_load_cv": self.shared_load_cv}),
            **({"individual": list(self.individual)} if self.individual else {}),
            **({} if self.errors is None else {"errors": self.errors.name, "errors_decided": "errors" in self.decided}),
            **({} if self.resolution is None else {"resolution": self.resolution}),
            **({} if self.slider_ends == (0.0, 1.0) else {"slider_ends": list(self.slider_ends)}),
            **({} if self.n_categories is None else {"n_categories": self.n_categories}),
            "noise": self.noise,
            "accuracy": self.kept_accuracy,
            "discretisation": None if self.discretisation is None else _record_of(self.discretisation),
        }

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> Self:
        """Return the options from the output of `record`.

        Raises
        ------
        AttributeError, KeyError, TypeError, InputError
            If an option is missing, or not known to this version.
        """
        accuracy, discretisation = record["accuracy"], record["discretisation"]
        decided = {
            "direction": record["direction_decided"],
            "discretisation": discretisation is not None and accuracy is not None,
            "errors": record.get("errors_decided", False),
        }
        return cls(
            fix=record["fix"],
            priors={name: parse_prior(text) for name, text in record["priors"].items()},
            prior_set=record["prior_set"],
            readings=Readings().override(record["readings"]),
            direction=None if record["direction"] is None else direction_named(record["direction"]),
            scale=scale_named(record["scale"]),
            # absent in records of earlier versions, which had only the default finger
            finger=finger_of(record.get("finger", {})),
            modulus_cv=record.get("modulus_cv"),
            unknown_modulus=parse_prior(record.get("unknown_modulus", str(UNKNOWN_MODULUS))),
            load_cv=record.get("load_cv"),
            shared_load_cv=record.get("shared_load_cv"),
            individual=tuple(record.get("individual", ())),
            errors=error_law_named(record["errors"]) if "errors" in record else None,
            resolution=record.get("resolution"),
            slider_ends=tuple(record.get("slider_ends", (0.0, 1.0))),
            n_categories=record.get("n_categories"),
            noise=record["noise"],
            accuracy=ACCURACY if accuracy is None else accuracy,
            discretisation=None if discretisation is None else Discretisation(**discretisation),
            decided=frozenset(name for name, so in decided.items() if so),
        )

    def choices(self) -> dict[str, str]:
        """Return the choices that affect the draws besides data and parameters, by name."""
        return {
            **{f"reading of {place}": name for place, name in self.readings.names.items()},
            "direction": "of the data" if self.direction is None else self.direction.name,
            "scale of the ratings": name_of_scale(self.scale),
            **({"finger": str(self.finger)} if self.finger != Finger() else {}),
            **({"load_cv": str(self.load_cv)} if self.load_cv else {}),
            **({"shared_load_cv": str(self.shared_load_cv)} if self.shared_load_cv else {}),
            **({f"raters' {_kind(self.individual)}": ", ".join(self.individual)} if self.individual else {}),
            **({} if self.errors in (None, NORMAL) else {"errors": self.errors.name}),
            **({} if self.resolution is None else {"resolution": str(self.resolution)}),
            **({} if self.slider_ends == (0.0, 1.0) else {"slider_ends": str(self.slider_ends)}),
            **({} if self.n_categories is None else {"n_categories": str(self.n_categories)}),
            "noise": str(self.noise),
            "discretisation": str(self.discretisation),
        }


def _kind(names: tuple[str, ...]) -> str:
    return "own answers" if answers_of(names) else "own fingers"


def _record_of(discretisation: Discretisation) -> dict[str, Any]:
    """Return the resolution for the record; like earlier versions without the number of terms if all are used."""
    record = asdict(discretisation)
    if record["rate_terms"] is None:
        del record["rate_terms"]
    return record
