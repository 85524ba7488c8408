"""Options of the model of an experiment, each declared once."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from functools import partial
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Self

from softness_bayes.base import options as kinds
from softness_bayes.base import ranges
from softness_bayes.base.defaults import ACCURACY, ERRORS, NOISE, PRIOR_SET
from softness_bayes.base.errors import InputError
from softness_bayes.base.files.records import parse_json
from softness_bayes.base.options import AUTO, Options, deferred, described, later, option
from softness_bayes.base.supplied import installed
from softness_bayes.likelihood import scales
from softness_bayes.likelihood.scales import require_name as require_scale

if TYPE_CHECKING:
    from softness_bayes.base.laws import Prior
    from softness_bayes.likelihood.error_laws import ErrorLaw
    from softness_bayes.touch.contact import Finger
    from softness_bayes.touch.readings import Readings
    from softness_bayes.touch.scene import Discretisation


_MENDED = "softness_bayes.touch.readings:MENDED"

_FINGER = "softness_bayes.touch.contact:Finger"

_parameter_law = deferred("softness_bayes.parameters.priors:as_prior")


def _parameters(incomplete: str) -> Iterable[str]:
    return [f"{name}=" for name in later("softness_bayes.parameters.declared:EVERY_PARAMETER")]


def _parameters_and_laws(incomplete: str) -> Iterable[str]:
    """Return the names of all parameters, or the laws after a name."""
    from softness_bayes.parameters.priors import LAWS, PRIORS

    name, given, _ = incomplete.partition("=")
    return [f"{name}={law}(" for law in (*LAWS, *installed(PRIORS))] if given else _parameters(incomplete)


def _sets_and_readings(incomplete: str) -> Iterable[str]:
    """Return the named sets and the places, or the readings of a place."""
    from softness_bayes.touch.readings import ALTERNATIVES, NAMED_READINGS

    place, given, _ = incomplete.partition("=")
    if given and place in ALTERNATIVES:
        return [f"{place}={name}" for name in (*ALTERNATIVES[place], *installed(place))]
    return [*NAMED_READINGS, *(f"{name}=" for name in ALTERNATIVES)]


FIXED_VALUES = kinds.ByName(
    such_as="a mapping from names to numbers, such as {'m': 2.0}",
    value=kinds.as_number,
    check=deferred("softness_bayes.parameters.choice:require_values"),
    complete=_parameters,
)
"""Values of parameters by name [natural units]."""

LAWS = kinds.ByName("NAME=PRIOR", "a mapping, such as {'b': 'lognormal(100,0.5)'}", _parameter_law)
"""Prior distributions by name, in written form or as laws."""


class ModulusLaw(kinds.Kind):
    """Prior distributions of moduli [kPa], in written form or as laws."""

    metavar = "PRIOR"

    def accept(self, name: str, value: Any) -> Prior:
        """Return a law of positive numbers."""
        law: Prior = later("softness_bayes.parameters.space:modulus_law")(name.replace("_", " "), value)
        return law

    def parse(self, text: str) -> Prior:
        """Return the law of a text."""
        return self.accept("distribution of unknown moduli", text)


class PriorSet(kinds.Kind):
    """Names of sets of priors."""

    metavar = "SET"

    def complete(self, incomplete: str) -> Iterable[str]:
        """Return the sets."""
        sets: Iterable[str] = later("softness_bayes.parameters.declared:PRIOR_SETS")
        return sets


class ReadingsByPlace(kinds.ByName):
    """Readings of the model's equations: a named set of them, and others by their place."""

    def parse(self, texts: Sequence[str]) -> Readings:
        """Return the readings of texts such as pressure=hertz; one without = names the set that they change."""
        from softness_bayes.touch.readings import readings_named

        named = "mended"
        for text in texts:
            named = named if "=" in text else text
        changed = kinds.ByName().parse([text for text in texts if "=" in text])
        return readings_named(named, changed)

    def write(self, value: Readings) -> list[str]:
        """Return the name of the default set, and the places with other readings than it has."""
        usual = later(_MENDED).names
        return ["mended", *(f"{place}={name}" for place, name in value.names.items() if name != usual[place])]


class GuessRate(kinds.Kind):
    """Guess rates: a number from 0 to 0.9, a fraction, or FREE for one that is sampled."""

    metavar = "RATE"

    def accept(self, name: str, value: Any) -> Any:
        """Return the rate, or the word."""
        if value == scales.FREE.name:
            return value
        ranges.GUESSES.require(name, value)
        return float(value)

    def parse(self, text: str) -> Any:
        """Return the rate of a text such as 1/3."""
        try:
            return text if text == scales.FREE.name else self.accept("guess", float(Fraction(text)))
        except (ValueError, ZeroDivisionError):
            raise InputError(
                f"expected a rate from 0 to 0.9, such as 1/3, or {scales.FREE.name}, got {text!r}"
            ) from None


class Chosen(kinds.Kind):
    """Objects that have a name, out of a few; the word AUTO stands for None.

    Parameters
    ----------
    choices
        Words on the command line.
    such_as
        Examples, for messages.
    of
        MODULE:NAME of the class of the objects.
    named, name_of
        Functions that return the object of a name, and the name of an object.
    group
        Group of entry points from which further objects may come.
    """

    def __init__(
        self,
        choices: tuple[str, ...],
        such_as: str,
        of: str,
        named: Callable[[str], Any],
        name_of: Callable[[Any], str] = attrgetter("name"),
        group: str = "",
    ) -> None:
        self.choices, self.such_as, self.of, self.group = choices, such_as, of, group
        self._named, self.write = named, name_of  # type: ignore[method-assign, assignment]

    def parse(self, text: str) -> Any:
        """Return the object of a name."""
        return None if text == AUTO else self._named(text)


class Resolution(kinds.Kind):
    """Resolutions of the scene, for Python alone."""

    of, such_as = "softness_bayes.touch.scene:Discretisation", "a Discretisation or None"

    def parse(self, text: str) -> Discretisation:
        """Return the resolution of its fields as JSON."""
        resolution: Discretisation = later(self.of)(**parse_json(text))
        return resolution

    def write(self, value: Discretisation) -> str:
        """Return the fields as JSON."""
        return json.dumps(asdict(value))


@described
@dataclass(frozen=True)
class ModelOptions(Options):
    """Choices that define the model of an experiment.

    Direction of the ratings, error law and discretisation may be left
    open (None). `build` then chooses them and returns a model whose options have them filled in.
    """

    fix: Mapping[str, float] = option(
        FIXED_VALUES, flag="--fix", default_factory=dict, help="Fix a parameter at a value, such as m=2."
    )
    priors: Mapping[str, Any] = option(
        kinds.ByName(
            LAWS.metavar,
            LAWS.such_as,
            _parameter_law,
            deferred("softness_bayes.parameters.choice:require_priors"),
            _parameters_and_laws,
        ),
        flag="--prior",
        default_factory=dict,
        help="Prior of a parameter, such as b='lognormal(100,0.5)' (median, sd of the log); 'list priors' shows the "
        "distributions.",
    )
    prior_set: str = option(
        PriorSet(),
        PRIOR_SET,
        "--priors",
        "Named set of priors: default, in-vivo, wide, or recorded (a joint law of skin and transduction learnt from "
        "recorded afferents). --prior changes single ones, but for recorded.",
        shown=True,
        spelled=True,
    )
    readings: Readings = option(
        ReadingsByPlace(
            "SET|PLACE=NAME",
            "Readings, such as NAMED_READINGS['printed'] or Readings(pressure=...)",
            complete=_sets_and_readings,
            of="softness_bayes.touch.readings:Readings",
            made=lambda names: later(_MENDED).override(names),
            parts=attrgetter("names"),
        ),
        flag="--reading",
        default_factory=partial(later, _MENDED),
        help="Named set of readings of the model's equations: mended (the default), printed or hertz; or another "
        "reading of one equation, such as pressure=hertz, or a custom one, such as pressure=mymodule:mine. "
        "'list readings' shows them.",
        set_flag="--readings",
        spelled=True,
    )
    direction: scales.RatingDirection | None = option(
        Chosen(
            (AUTO, scales.FREE.name, *scales.RATING_DIRECTIONS),
            "RISES, FALLS, FREE or None",
            "softness_bayes.likelihood.scales:RatingDirection",
            scales.direction_named,
        ),
        None,
        "--direction",
        "Whether ratings rise or fall with the response. auto chooses from the data, or free if they do not decide it; "
        f"{scales.FREE.name} samples both, each with prior probability 1/2.",
        shown=True,
        spelled=True,
        affects_draws=True,
        needs_ratings=True,
    )
    finger: Finger = option(
        kinds.ByName(
            such_as="a Finger, such as Finger(receptor_depth=0.6e-3)",
            value=kinds.as_number,
            complete=lambda incomplete: [f"{name}=" for name in later("softness_bayes.model.fingers:FINGER_VALUES")],
            of=_FINGER,
            made=deferred("softness_bayes.model.fingers:finger_of"),
            parts=deferred("softness_bayes.model.fingers:values_of"),
        ),
        flag="--finger",
        default_factory=deferred(_FINGER),
        help="One value of the finger, such as receptor_depth_mm=0.6. Names: radius_mm, receptor_depth_mm, "
        "poisson_ratio, pad_length_mm, pad_width_mm, contact_x_mm or contact_y_mm. A --prior of "
        "radius or receptor_depth samples it instead.",
        affects_draws=True,
    )
    modulus_cv: float | None = option(
        kinds.Number(ranges.RELATIVE_ERRORS),
        None,
        "--modulus-cv",
        "Relative standard error of moduli for which the fabric table gives none, such as 0.15; 0 means that "
        "they are exact.",
    )
    shared_modulus_cv: float | None = option(
        kinds.Number(ranges.SHARED_MODULUS_ERRORS),
        None,
        "--shared-modulus-cv",
        "Relative standard error that all moduli share, such as 0.15 for one tester that may read too high or too low: "
        "one factor for each batch of the table of fabrics, sampled as modulus_scale.",
    )
    unknown_modulus: Prior = option(
        ModulusLaw(),
        "lognormal(100,2)",
        "--unknown-modulus",
        "Prior of the moduli [kPa] of fabrics without a modulus in their table; lognormal(100,2) by default.",
    )
    load_cv: float | None = option(
        kinds.Number(ranges.LOAD_ERRORS),
        None,
        "--load-cv",
        "Relative standard error of loads for which the table gives none, such as 0.05, independent for each "
        "rating; 0 means that they are exact.",
        affects_draws=True,
    )
    shared_load_cv: float | None = option(
        kinds.Number(ranges.SHARED_LOAD_ERRORS),
        None,
        "--shared-load-cv",
        "Relative standard error that all ratings at a load share, such as 0.03 for a press that is set "
        "once: one factor for each load.",
        affects_draws=True,
    )
    shared: tuple[str, ...] = option(
        kinds.Names(deferred("softness_bayes.parameters.declared:shareable")),
        (),
        "--shared",
        "Parameters that recorded afferents share with ratings and plates, such as b,m. By default they have their "
        "own, because the nerve of one species says nothing certain of another's skin.",
        affects_draws=True,
    )
    individual: tuple[str, ...] = option(
        kinds.Names(deferred("softness_bayes.model.fingers:require_individual")),
        (),
        "--individual",
        "Parameters that differ between raters, each with a sampled spread: for their fingers some of b, m "
        "and sigma_0, such as b,sigma_0; or gamma (a separate exponent for each), varsigma (a separate noise "
        "level for each) or both. By default none.",
        affects_draws=True,
    )
    errors: ErrorLaw | None = option(
        Chosen(
            (AUTO, *ERRORS),
            "NORMAL, STUDENT, LAPSES or None",
            "softness_bayes.likelihood.error_laws:ErrorLaw",
            deferred("softness_bayes.likelihood.error_laws:error_law_named"),
        ),
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
        kinds.Number(ranges.RESOLUTIONS, "STEP"),
        None,
        "--resolution",
        "Rounding of ratings: 1 for whole numbers; 0 treats ratings as exact numbers. By default the "
        "rounding of each rater is detected.",
        affects_draws=True,
        needs_ratings=True,
    )
    slider_ends: tuple[float, float] = option(
        kinds.Numbers(),
        (0.0, 1.0),
        "--slider",
        "Numbers of the two ends of a slider (--ratings slider).",
        shown=True,
        affects_draws=True,
        needs_ratings=True,
    )
    guess: float | str | None = option(
        GuessRate(),
        None,
        "--guess",
        "Guess rate of pairs with a reference (--ratings pairs): the probability that a clearly harder comparison is "
        "judged softer all the same, such as 1/3 where the task fixes it; free samples it. By default guesses prefer "
        "no side.",
        affects_draws=True,
        needs_ratings=True,
    )
    n_categories: int | None = option(
        kinds.Number(ranges.CATEGORIES_RANGE, "K"),
        None,
        "--categories",
        "Number of ordered categories (--ratings categories); by default the largest number in the table.",
        affects_draws=True,
        needs_ratings=True,
    )
    accuracy: float = option(
        kinds.Number(ranges.ACCURACIES),
        ACCURACY,
        "--accuracy",
        "Largest numerical error of the response, relative to its peak and in log(N/N_ref + eps). The "
        "cheapest resolution within this limit over the relevant parameters is used; 'check --cost' shows the "
        "choice.",
        shown=True,
        spelled=True,
        needs_ratings=True,
    )
    scale: scales.Scale = option(
        Chosen(
            tuple(scales.RATING_SCALES),
            "a Scale, such as SLIDER or CATEGORIES",
            "softness_bayes.likelihood.scales:Scale",
            scales.scale_named,
            scales.name_of_scale,
            scales.OWN_SCALES,
        ),
        scales.MAGNITUDE,
        "--ratings",
        f"Whether ratings are {', or '.join(scale.meaning for scale in scales.RATING_SCALES.values())}; or a custom "
        "scale, such as mymodule:SCALE.",
        shown=True,
        spelled=True,
        affects_draws=True,
        needs_ratings=True,
    )
    noise: float = option(
        kinds.Number(ranges.NOISES, "STRENGTH"),
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
    decided: tuple[str, ...] = option(
        kinds.Names(),
        (),
        help="Names of the options (direction, errors, discretisation) that were chosen automatically, for the record.",
    )

    def require_storable(self) -> None:
        """Raise an error for readings, scales and priors that could not be restored from a stored run.

        Raises
        ------
        InputError
            With the reason.
        """
        from softness_bayes.parameters.priors import require_storable

        for name, prior in {**self.priors, "unknown modulus": self.unknown_modulus}.items():
            require_storable(f"prior of {name}", prior)
        self.readings.require_names()
        require_scale(self.scale)

    def decide(self, **chosen: Any) -> Self:
        """Return the options with open choices filled in, given by name."""
        return replace(self, **chosen, decided=tuple(dict.fromkeys([*self.decided, *chosen])))

    @property
    def fixed(self) -> Mapping[str, float]:
        """The fixed values, a guess rate that is known among them."""
        return self.fix if self.guess in (None, scales.FREE.name) else {**self.fix, "guess": float(self.guess or 0.0)}

    @property
    def slider_width(self) -> float:
        """Distance between the numbers of a slider's two ends, whose model has shares of it; 1 for other scales."""
        return self.slider_ends[1] - self.slider_ends[0]

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
