"""Options of the model of an experiment, each declared once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Self

from softness_bayes.defaults import ACCURACY, ERRORS, NOISE, PRIOR_SET
from softness_bayes.kinds import require_kind
from softness_bayes.likelihood.directions import FREE, RATING_DIRECTIONS, RISES, RatingDirection, direction_named
from softness_bayes.likelihood.scales import MAGNITUDE, OWN_SCALES, RATING_SCALES, Scale, name_of_scale, scale_named
from softness_bayes.likelihood.scales import require_name as require_scale
from softness_bayes.options import (
    AUTO,
    ByName,
    Kind,
    Named,
    Names,
    Number,
    Numbers,
    NumbersByName,
    Options,
    Whole,
    described,
    option,
)
from softness_bayes.ranges import (
    ACCURACIES,
    CATEGORIES_RANGE,
    LOAD_ERRORS,
    NOISES,
    RELATIVE_ERRORS,
    RESOLUTIONS,
    SHARED_LOAD_ERRORS,
)
from softness_bayes.supplied import installed

if TYPE_CHECKING:
    from softness_bayes.likelihood.error_laws import ErrorLaw
    from softness_bayes.parameters.priors import Prior
    from softness_bayes.touch.contact import Finger
    from softness_bayes.touch.readings import Readings
    from softness_bayes.touch.scene import Discretisation


class FixedValues(NumbersByName):
    """Values of parameters by name [natural units]."""

    def accept(self, name: str, value: Any) -> Any:
        """Return values by name; `parameter_space` checks them against the parameters of the model."""
        require_kind(name, value, Mapping, "a mapping from names to numbers, such as {'m': 2.0}")
        return dict(value)

    def check(self, values: dict[str, float]) -> None:
        """Raise an error for an unknown parameter, or a value outside its range."""
        from softness_bayes.parameters.choice import require_values

        require_values(values)

    def complete(self, incomplete: str) -> Iterable[str]:
        """Return the names of all parameters."""
        from softness_bayes.parameters.declared import EVERY_PARAMETER

        return [f"{name}=" for name in EVERY_PARAMETER]


class Law(Named):
    """Prior distributions, in written form or as laws."""

    metavar = "PRIOR"

    def accept(self, name: str, value: Any) -> Prior:
        """Return a law."""
        from softness_bayes.parameters.priors import as_prior

        return as_prior(name.replace("_", " "), value)

    def parse(self, text: str) -> Prior:
        """Return the law of a text such as lognormal(100,0.5)."""
        from softness_bayes.parameters.priors import parse_prior

        return parse_prior(text)

    def require_storable(self, name: str, value: Prior) -> None:
        """Raise an error for a law that its written form does not determine."""
        from softness_bayes.parameters.priors import require_storable

        require_storable(f"prior of {name.replace('_', ' ')}", value)


class ModulusLaw(Law):
    """Prior distributions of moduli [kPa]."""

    def accept(self, name: str, value: Any) -> Prior:
        """Return a law of positive numbers."""
        from softness_bayes.parameters.fabric_moduli import require_law

        law = super().accept(name, value)
        require_law(name, law)
        return law

    def parse(self, text: str) -> Prior:
        """Return the law of a text."""
        from softness_bayes.parameters.fabric_moduli import require_law

        law = super().parse(text)
        require_law("distribution of unknown moduli", law)
        return law


class Laws(ByName):
    """Prior distributions of parameters, by name."""

    metavar = "NAME=PRIOR"
    law = Law()

    def accept(self, name: str, value: Any) -> dict[str, Prior]:
        """Return laws by name."""
        from softness_bayes.parameters.priors import as_priors

        return as_priors(value)

    def parse_value(self, text: str) -> Prior:
        """Return one law."""
        return self.law.parse(text)

    def store(self, value: Mapping[str, Prior]) -> dict[str, str]:
        """Return the written forms."""
        return {name: str(law) for name, law in value.items()}

    def restore(self, stored: Mapping[str, str]) -> dict[str, Prior]:
        """Return the laws of written forms."""
        return {name: self.law.parse(text) for name, text in stored.items()}

    def require_storable(self, name: str, value: Mapping[str, Prior]) -> None:
        """Raise an error for a law that its written form does not determine."""
        for parameter, law in value.items():
            self.law.require_storable(parameter, law)


class Priors(Laws):
    """Prior distributions of the parameters of the model."""

    def check(self, values: dict[str, Prior]) -> None:
        """Raise an error for an unknown parameter, or a support outside its range."""
        from softness_bayes.parameters.choice import require_priors

        require_priors(values)

    def complete(self, incomplete: str) -> Iterable[str]:
        """Return the names of all parameters, or of the laws after a name."""
        from softness_bayes.parameters.declared import EVERY_PARAMETER
        from softness_bayes.parameters.priors import LAWS, PRIORS

        name, given, _ = incomplete.partition("=")
        laws = [f"{name}={law}(" for law in (*LAWS, *installed(PRIORS))]
        return laws if given else [f"{parameter}=" for parameter in EVERY_PARAMETER]


class PriorSet(Kind):
    """Names of sets of priors."""

    metavar = "SET"

    def complete(self, incomplete: str) -> Iterable[str]:
        """Return the sets."""
        from softness_bayes.parameters.declared import PRIOR_SETS

        return PRIOR_SETS


class ReadingsByPlace(ByName):
    """Readings of the model's equations: a named set of them, and others by their place."""

    metavar = "PLACE=NAME"

    def accept(self, name: str, value: Any) -> Readings:
        """Return readings."""
        from softness_bayes.touch.readings import Readings

        require_kind(name, value, Readings, "Readings, such as NAMED_READINGS['printed'] or Readings(pressure=...)")
        readings: Readings = value
        return readings

    def parse(self, texts: Sequence[str]) -> Readings:
        """Return the readings of texts such as pressure=hertz; one without = names the set that they change."""
        from softness_bayes.touch.readings import NAMED_READINGS, readings_named

        sets = [text for text in texts if "=" not in text]
        return readings_named([next(iter(NAMED_READINGS)), *sets][-1], super().parse([t for t in texts if "=" in t]))

    def check(self, values: dict[str, str]) -> None:
        """Raise an error for an unknown place, or a reading that it does not have."""
        from softness_bayes.touch.readings import alternative

        for place, name in values.items():
            alternative(place, name)

    def write(self, value: Readings) -> list[str]:
        """Return the name of the default set, and the places with other readings than it has."""
        from softness_bayes.touch.readings import MENDED

        return ["mended", *(f"{place}={name}" for place, name in value.names.items() if name != MENDED.names[place])]

    def store(self, value: Readings) -> dict[str, str]:
        """Return the name of the reading of every place."""
        return value.names

    def restore(self, stored: Mapping[str, str]) -> Readings:
        """Return the readings of names."""
        from softness_bayes.touch.readings import Readings

        return Readings().override(stored)

    def require_storable(self, name: str, value: Readings) -> None:
        """Raise an error for a custom reading without an importable name."""
        value.require_names()

    def sets(self) -> Iterable[str]:
        """Return the named sets."""
        from softness_bayes.touch.readings import NAMED_READINGS

        return NAMED_READINGS

    def complete(self, incomplete: str) -> Iterable[str]:
        """Return the places, or the readings of a place."""
        from softness_bayes.touch.readings import ALTERNATIVES

        place, given, _ = incomplete.partition("=")
        if given and place in ALTERNATIVES:
            return [f"{place}={name}" for name in (*ALTERNATIVES[place], *installed(place))]
        return [f"{name}=" for name in ALTERNATIVES]


class Direction(Named):
    """Directions of ratings with the response."""

    choices = (AUTO, FREE.name, *RATING_DIRECTIONS)

    def accept(self, name: str, value: Any) -> Any:
        """Return a direction."""
        require_kind(name, value, RatingDirection, "RISES, FALLS, FREE or None")
        return value

    def parse(self, text: str) -> RatingDirection | None:
        """Return the direction of a name."""
        return None if text == AUTO else direction_named(text)

    def write(self, value: RatingDirection) -> str:
        """Return the name."""
        return value.name


class FingerValues(NumbersByName):
    """Values of a finger by name, which differ from those of the default finger."""

    def accept(self, name: str, value: Any) -> Finger:
        """Return a finger."""
        from softness_bayes.touch.contact import Finger

        require_kind(name, value, Finger, "a Finger, such as Finger(receptor_depth=0.6e-3)")
        finger: Finger = value
        return finger

    def parse(self, texts: Sequence[str]) -> Finger:
        """Return the finger of texts such as receptor_depth_mm=0.6."""
        return self.restore(super().parse(texts))

    def check(self, values: dict[str, float]) -> None:
        """Raise an error for an unknown name, or a value outside its range."""
        from softness_bayes.model.fingers import require_finger

        require_finger(values)

    def write(self, value: Finger) -> list[str]:
        """Return one text for each value that is not the default one."""
        return super().write(self.store(value))

    def store(self, value: Finger) -> dict[str, float]:
        """Return the values that are not the default ones."""
        from softness_bayes.model.fingers import values_of

        return values_of(value)

    def restore(self, stored: Mapping[str, float]) -> Finger:
        """Return the finger of values by name."""
        from softness_bayes.model.fingers import finger_of

        return finger_of(stored)

    def complete(self, incomplete: str) -> Iterable[str]:
        """Return the names of the values."""
        from softness_bayes.model.fingers import FINGER_VALUES

        return [f"{name}=" for name in FINGER_VALUES]


class Differing(Names):
    """Quantities that differ between raters."""

    def accept(self, name: str, value: Any) -> Any:
        """Return known quantities of one kind."""
        from softness_bayes.model.individual import require_individual

        names = super().accept(name, value)
        require_individual(names)
        return names

    def parse(self, text: str) -> tuple[str, ...]:
        """Return the quantities of a text such as b,sigma_0."""
        return tuple(self.accept("individual", super().parse(text)))


class Errors(Named):
    """Error laws of ratings."""

    choices = (AUTO, *ERRORS)

    def accept(self, name: str, value: Any) -> ErrorLaw:
        """Return an error law."""
        from softness_bayes.likelihood.error_laws import ErrorLaw

        require_kind(name, value, ErrorLaw, "NORMAL, STUDENT, LAPSES or None")
        law: ErrorLaw = value
        return law

    def parse(self, text: str) -> ErrorLaw | None:
        """Return the law of a name."""
        from softness_bayes.likelihood.error_laws import error_law_named

        return None if text == AUTO else error_law_named(text)

    def write(self, value: ErrorLaw) -> str:
        """Return the name."""
        return value.name


class RatingScale(Named):
    """Scales of ratings, custom ones by their importable name."""

    choices = tuple(RATING_SCALES)
    group = OWN_SCALES

    def accept(self, name: str, value: Any) -> Any:
        """Return a scale."""
        require_kind(name, value, Scale, "a Scale, such as SLIDER or CATEGORIES")
        return value

    def parse(self, text: str) -> Scale:
        """Return the scale of a name."""
        return scale_named(text)

    def write(self, value: Scale) -> str:
        """Return the name."""
        return name_of_scale(value)

    def require_storable(self, name: str, value: Scale) -> None:
        """Raise an error for a custom scale without an importable name."""
        require_scale(value)


class Resolution(Kind):
    """Resolutions of the scene, for Python alone."""

    def accept(self, name: str, value: Any) -> Discretisation:
        """Return a resolution."""
        from softness_bayes.touch.scene import Discretisation

        require_kind(name, value, Discretisation, "a Discretisation or None")
        found: Discretisation = value
        return found

    def store(self, value: Discretisation) -> dict[str, Any]:
        """Return the fields."""
        return asdict(value)

    def restore(self, stored: Mapping[str, Any]) -> Discretisation:
        """Return the resolution of fields."""
        from softness_bayes.touch.scene import Discretisation

        return Discretisation(**stored)


class Decided(Kind):
    """Names of options that were chosen from the data."""

    def accept(self, name: str, value: Any) -> frozenset[str]:
        """Return a set of names."""
        return frozenset(value)

    def store(self, value: frozenset[str]) -> list[str]:
        """Return the names in order."""
        return sorted(value)


def _mended() -> Readings:
    from softness_bayes.touch.readings import MENDED

    return MENDED


def _usual_finger() -> Finger:
    from softness_bayes.touch.contact import Finger

    return Finger()


def _unknown_modulus() -> Prior:
    from softness_bayes.parameters.fabric_moduli import UNKNOWN_MODULUS

    return UNKNOWN_MODULUS


@described
@dataclass(frozen=True)
class ModelOptions(Options):
    """Choices that define the model of an experiment.

     Direction of the ratings, error law and discretisation may be left
    open (None). `build` then chooses them and returns a model whose options have them filled in.
    """

    fix: Mapping[str, float] = option(
        FixedValues(), flag="--fix", default_factory=dict, help="Fix a parameter at a value, such as m=2."
    )
    priors: Mapping[str, Any] = option(
        Priors(),
        flag="--prior",
        default_factory=dict,
        help="Prior of a parameter, such as b='lognormal(100,0.5)' (median, sd of the log); 'list priors' shows the "
        "distributions.",
    )
    prior_set: str = option(
        PriorSet(),
        PRIOR_SET,
        "--priors",
        "Named set of priors: default, in-vivo or wide. --prior changes single ones.",
        shown=True,
        spelled=True,
    )
    readings: Readings = option(
        ReadingsByPlace(),
        flag="--reading",
        default_factory=_mended,
        help="Another reading of one equation of the model, such as pressure=hertz, or a custom one, such as "
        "pressure=mymodule:mine; 'list readings' shows them.",
        set_flag="--readings",
        set_help="Named set of readings: mended (the default), printed or hertz. --reading changes single ones.",
        spelled=True,
    )
    direction: RatingDirection | None = option(
        Direction(),
        None,
        "--direction",
        f"Whether ratings rise or fall with the response. auto chooses from the data, or {RISES.name} if they "
        f"do not decide it; {FREE.name} samples both, each with prior probability 1/2.",
        shown=True,
        spelled=True,
        affects_draws=True,
        needs_ratings=True,
    )
    finger: Finger = option(
        FingerValues(),
        flag="--finger",
        default_factory=_usual_finger,
        help="One value of the finger, such as receptor_depth_mm=0.6. Names: radius_mm, receptor_depth_mm, "
        "poisson_ratio, pad_length_mm, pad_width_mm, contact_x_mm or contact_y_mm. A --prior of "
        "radius or receptor_depth samples it instead.",
        affects_draws=True,
    )
    modulus_cv: float | None = option(
        Number(RELATIVE_ERRORS),
        None,
        "--modulus-cv",
        "Relative standard error of moduli for which the fabric table gives none, such as 0.15; 0 means that "
        "they are exact.",
    )
    unknown_modulus: Prior = option(
        ModulusLaw(),
        flag="--unknown-modulus",
        default_factory=_unknown_modulus,
        help="Prior of the moduli [kPa] of fabrics without a modulus in their table; lognormal(100,2) by default.",
    )
    load_cv: float | None = option(
        Number(LOAD_ERRORS),
        None,
        "--load-cv",
        "Relative standard error of loads for which the table gives none, such as 0.05, independent for each "
        "rating; 0 means that they are exact.",
        affects_draws=True,
    )
    shared_load_cv: float | None = option(
        Number(SHARED_LOAD_ERRORS),
        None,
        "--shared-load-cv",
        "Relative standard error that all ratings at a load share, such as 0.03 for a press that is set "
        "once: one factor for each load.",
        affects_draws=True,
    )
    individual: tuple[str, ...] = option(
        Differing(),
        (),
        "--individual",
        "Parameters that differ between raters, each with a sampled spread: for their fingers some of b, m "
        "and sigma_0, such as b,sigma_0; or gamma (a separate exponent for each), varsigma (a separate noise "
        "level for each) or both. By default none.",
        affects_draws=True,
    )
    errors: ErrorLaw | None = option(
        Errors(),
        None,
        "--errors",
        "Distribution of the errors of log ratings: normal, student (Student's t with sampled degrees of "
        "freedom) or lapses (normal, mixed with a share of lapses over the range of the rater). auto chooses "
        "student if the residuals of the table have heavier tails than normal ones.",
        shown=True,
        affects_draws=True,
        needs_ratings=True,
    )
    resolution: float | None = option(
        Number(RESOLUTIONS, "STEP"),
        None,
        "--resolution",
        "Rounding of ratings: 1 for whole numbers; 0 treats ratings as exact numbers. By default the "
        "rounding of each rater is detected.",
        affects_draws=True,
        needs_ratings=True,
    )
    slider_ends: tuple[float, float] = option(
        Numbers(),
        (0.0, 1.0),
        "--slider",
        "Numbers of the two ends of a slider (--ratings slider).",
        shown=True,
        affects_draws=True,
        needs_ratings=True,
    )
    n_categories: int | None = option(
        Whole(CATEGORIES_RANGE, "K"),
        None,
        "--categories",
        "Number of ordered categories (--ratings categories); by default the largest number in the table.",
        affects_draws=True,
        needs_ratings=True,
    )
    accuracy: float = option(
        Number(ACCURACIES),
        ACCURACY,
        "--accuracy",
        "Largest numerical error of the response, relative to its peak and in log(N/N_ref + eps). The "
        "cheapest resolution within this limit over the relevant parameters is used; 'check --cost' shows the "
        "choice.",
        shown=True,
        spelled=True,
        needs_ratings=True,
    )
    scale: Scale = option(
        RatingScale(),
        MAGNITUDE,
        "--ratings",
        f"Whether ratings are {', or '.join(scale.meaning for scale in RATING_SCALES.values())}; or a custom "
        "scale, such as mymodule:SCALE.",
        shown=True,
        spelled=True,
        affects_draws=True,
        needs_ratings=True,
    )
    noise: float = option(
        Number(NOISES, "STRENGTH"),
        NOISE,
        "--noise",
        "White-noise current on every membrane [µA/cm² √ms]. Its mean effect is found by simulation, which "
        "takes minutes. Needs --fix for c_Na, c_K, c_L and c_A.",
        shown=True,
        affects_draws=True,
        needs_ratings=True,
    )
    discretisation: Discretisation | None = option(
        Resolution(),
        help="Resolution of the scene; None to choose the cheapest one that meets the accuracy.",
        affects_draws=True,
    )
    decided: frozenset[str] = option(
        Decided(),
        frozenset(),
        help="Names of the options (direction, errors, discretisation) that were chosen automatically, for the record.",
    )

    def require_storable(self) -> None:
        """Raise an error for readings, scales and priors that could not be restored from a stored run.

        Raises
        ------
        InputError
            With the reason.
        """
        for name, one in self.declared.items():
            one.kind.require_storable(name, getattr(self, name))

    def decide(self, **chosen: Any) -> Self:
        """Return the options with open choices filled in, given by name."""
        return replace(self, **chosen, decided=self.decided | chosen.keys())

    @property
    def kept_accuracy(self) -> float | None:
        """Accuracy met by the discretisation; None if the discretisation was given."""
        given = self.discretisation is not None and "discretisation" not in self.decided
        return None if given else self.accuracy

    def choices(self) -> dict[str, str]:
        """Return the choices that affect the draws besides data and parameters, by name."""
        changed = self.changed()
        return {f"reading of {place}": name for place, name in self.readings.names.items()} | {
            name: changed[name] for name, one in self.declared.items() if one.affects_draws and name in changed
        }
