"""Options of the model: parameters, priors, readings, finger and accuracy, and all of a model that is fitted."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from softness_bayes.cli.options import completion
from softness_bayes.cli.options.ratings import AUTO, categories, direction_of_data, errors, resolution, slider
from softness_bayes.cli.options.values import Number, Verb, finite, named
from softness_bayes.defaults import ACCURACY, PRIOR_SET
from softness_bayes.likelihood.directions import direction_named
from softness_bayes.ranges import ACCURACIES, LOAD_ERRORS, RELATIVE_ERRORS, SHARED_LOAD_ERRORS

if TYPE_CHECKING:
    from softness_bayes.model.options import ModelOptions
    from softness_bayes.parameters.priors import Prior
    from softness_bayes.touch.readings import Readings


def _prior(text: str) -> Prior:
    from softness_bayes.parameters.priors import parse_prior

    return parse_prior(text)


def _require_values(values: dict[str, float]) -> None:
    from softness_bayes.parameters.choice import require_values

    require_values(values)


def _require_priors(priors: dict[str, Prior]) -> None:
    from softness_bayes.parameters.choice import require_priors

    require_priors(priors)


def _require_readings(choices: dict[str, str]) -> None:
    from softness_bayes.touch.readings import alternative

    for place, name in choices.items():
        alternative(place, name)


def _require_finger(values: dict[str, float]) -> None:
    from softness_bayes.model.fingers import require_finger

    require_finger(values)


set_values = click.option(
    "--set",
    "values",
    multiple=True,
    callback=named(finite, _require_values),
    shell_complete=completion.parameters,
    metavar="NAME=VALUE",
    help="Value of a parameter, such as b=80; the others are at their medians. Repeatable.",
)
"""Passes `values` to a command: name -> number."""

fix = click.option(
    "--fix",
    "fixed",
    multiple=True,
    callback=named(finite, _require_values),
    shell_complete=completion.parameters,
    metavar="NAME=VALUE",
    help="Fix a parameter at a value, such as m=2. Repeatable.",
)
"""Passes `fixed` to a command: name -> number."""

prior = click.option(
    "--prior",
    "priors",
    multiple=True,
    callback=named(_prior, _require_priors),
    shell_complete=completion.priors,
    metavar="NAME=PRIOR",
    help="Prior of a parameter, such as b='lognormal(100,0.5)' (median, sd of the log); 'priors' lists the "
    "distributions. Repeatable.",
)
"""Passes `priors` to a command: name -> `Prior`."""

spreads = click.option(
    "--spread",
    "spreads",
    multiple=True,
    callback=named(_prior),
    metavar="NAME=PRIOR",
    help="Prior of the spread of a pooled parameter between tables, such as b='halfnormal(0.3)'; by default "
    "half-normal with the width of the prior of the parameter. Repeatable.",
)
"""Passes `spreads` to a command: name -> `Prior`."""

prior_set = click.option(
    "--priors",
    "prior_set",
    default=PRIOR_SET,
    show_default=True,
    shell_complete=completion.prior_sets,
    metavar="SET",
    help="Named set of priors: default, in-vivo or wide. --prior changes single ones.",
)
"""Passes `prior_set` to a command: the name of one of the sets."""

_READING = click.option(
    "--reading",
    "overrides",
    multiple=True,
    callback=named(str, _require_readings),
    shell_complete=completion.readings,
    metavar="PLACE=NAME",
    help="Another reading of one equation of the model, such as pressure=hertz, or a custom one, such as "
    "pressure=mymodule:mine; 'readings' lists them. Repeatable.",
)
_READING_SET = click.option(
    "--readings",
    "reading_set",
    shell_complete=completion.reading_sets,
    metavar="SET",
    help="Named set of readings: mended (the default), printed or hertz. --reading changes single ones.",
)


@dataclass(frozen=True)
class ReadingChoice:
    """The readings requested on the command line."""

    set_name: str | None
    overrides: Mapping[str, str]

    @property
    def is_default(self) -> bool:
        """True if no option was given."""
        return self.set_name is None and not self.overrides

    def resolve(self) -> Readings:
        """Return the readings: those of the named set, or of the default one, with the overrides."""
        from softness_bayes.touch.readings import readings_named

        return readings_named(self.set_name or "mended", self.overrides)


def readings(verb: Verb) -> Verb:
    """Add the options for readings to a command, which receives `choice`, a `ReadingChoice`."""

    @_READING_SET
    @_READING
    @functools.wraps(verb)
    def wrapped(reading_set: str | None, overrides: dict[str, str], **others: Any) -> Any:
        return verb(choice=ReadingChoice(reading_set, overrides), **others)

    return wrapped


finger = click.option(
    "--finger",
    "finger",
    multiple=True,
    callback=named(finite, _require_finger),
    shell_complete=completion.fingers,
    metavar="NAME=VALUE",
    help="One value of the finger, such as receptor_depth_mm=0.6. Names: radius_mm, receptor_depth_mm, "
    "poisson_ratio, pad_length_mm, pad_width_mm, contact_x_mm or contact_y_mm. Repeatable. A --prior of "
    "radius or receptor_depth samples it instead.",
)
"""Passes `finger` to a command: name -> number, from which `model.fingers.finger_of` makes a `Finger`."""


def _law(ctx: click.Context, param: click.Parameter, text: str | None) -> Prior | None:
    from softness_bayes.parameters.fabric_moduli import require_law

    if text is None:
        return None
    try:
        law = _prior(text)
        require_law("distribution of unknown moduli", law)
    except ValueError as error:
        raise click.BadParameter(str(error)) from None
    return law


modulus_cv = click.option(
    "--modulus-cv",
    "modulus_cv",
    type=Number(RELATIVE_ERRORS),
    metavar="X",
    help="Relative standard error of moduli for which the fabric table gives none, such as 0.15; 0 means that "
    "they are exact.",
)
"""Passes `modulus_cv` to a command: a number or None."""

unknown_modulus = click.option(
    "--unknown-modulus",
    "unknown_modulus",
    callback=_law,
    metavar="PRIOR",
    help="Prior of the moduli [kPa] of fabrics without a modulus in their table; lognormal(100,2) by default.",
)
"""Passes `unknown_modulus` to a command: a `Prior` or None."""

load_cv = click.option(
    "--load-cv",
    "load_cv",
    type=Number(LOAD_ERRORS),
    metavar="X",
    help="Relative standard error of loads for which the table gives none, such as 0.05, independent for each "
    "rating; 0 means that they are exact.",
)
"""Passes `load_cv` to a command: a number or None."""

shared_load_cv = click.option(
    "--shared-load-cv",
    "shared_load_cv",
    type=Number(SHARED_LOAD_ERRORS),
    metavar="X",
    help="Relative standard error that all ratings at a load share, such as 0.03 for a press that is set "
    "once: one factor for each load.",
)
"""Passes `shared_load_cv` to a command: a number or None."""


def _individual(context: click.Context, parameter: click.Parameter, text: str | None) -> tuple[str, ...]:
    from softness_bayes.model.individual import require_individual

    names = tuple(name.strip() for name in (text or "").split(",") if name.strip())
    try:
        require_individual(names)
    except ValueError as error:
        raise click.BadParameter(str(error)) from None
    return names


individual = click.option(
    "--individual",
    "individual",
    callback=_individual,
    metavar="NAMES",
    help="Parameters that differ between raters, each with a sampled spread: for their fingers some of b, m "
    "and sigma_0, such as b,sigma_0; or gamma (a separate exponent for each), varsigma (a separate noise "
    "level for each) or both. By default none.",
)
"""Passes `individual` to a command: a tuple of names."""

accuracy = click.option(
    "--accuracy",
    type=Number(ACCURACIES),
    default=ACCURACY,
    show_default=True,
    metavar="X",
    help="Largest numerical error of the response, relative to its peak and in log(N/N_ref + eps). The "
    "cheapest resolution within this limit over the relevant parameters is used; 'plan' shows the "
    "choice.",
)
"""Passes `accuracy` to a command."""


@dataclass(frozen=True)
class ModelChoice:
    """The model to fit, as requested on the command line."""

    fixed: Mapping[str, float]
    priors: Mapping[str, Prior]
    prior_set: str
    choice: ReadingChoice
    direction: str
    """A name, or `AUTO`."""
    accuracy: float
    finger: Mapping[str, float]
    modulus_cv: float | None
    unknown_modulus: Prior | None
    load_cv: float | None
    shared_load_cv: float | None
    individual: tuple[str, ...]
    errors: str = AUTO
    """A name, or `AUTO`."""
    resolution: float | None = None
    slider_ends: tuple[float, float] = (0.0, 1.0)
    n_categories: int | None = None

    def options(self, **others: Any) -> ModelOptions:
        """Return the options of this model and `others`; its resolution is not chosen yet."""
        from softness_bayes.likelihood.error_laws import error_law_named
        from softness_bayes.model.fingers import finger_of
        from softness_bayes.model.options import ModelOptions
        from softness_bayes.parameters.fabric_moduli import UNKNOWN_MODULUS

        return ModelOptions(
            fix=self.fixed,
            priors=self.priors,
            prior_set=self.prior_set,
            readings=self.choice.resolve(),
            direction=None if self.direction == AUTO else direction_named(self.direction),
            accuracy=self.accuracy,
            finger=finger_of(self.finger),
            modulus_cv=self.modulus_cv,
            unknown_modulus=self.unknown_modulus or UNKNOWN_MODULUS,
            load_cv=self.load_cv,
            shared_load_cv=self.shared_load_cv,
            individual=self.individual,
            errors=None if self.errors == AUTO else error_law_named(self.errors),
            resolution=self.resolution,
            slider_ends=self.slider_ends,
            n_categories=self.n_categories,
            **others,
        )


def model_choice(verb: Verb) -> Verb:
    """Add the options of a fitted model to a command, which receives `model`, a `ModelChoice`."""

    @fix
    @prior
    @prior_set
    @readings
    @direction_of_data
    @finger
    @modulus_cv
    @unknown_modulus
    @load_cv
    @shared_load_cv
    @individual
    @errors
    @resolution
    @slider
    @categories
    @accuracy
    @functools.wraps(verb)
    def wrapped(
        fixed: dict[str, float],
        priors: dict[str, Prior],
        prior_set: str,
        choice: ReadingChoice,
        direction: str,
        finger: dict[str, float],
        modulus_cv: float | None,
        unknown_modulus: Prior | None,
        load_cv: float | None,
        shared_load_cv: float | None,
        individual: tuple[str, ...],
        errors: str,
        resolution: float | None,
        slider_ends: tuple[float, float],
        n_categories: int | None,
        accuracy: float,
        **others: Any,
    ) -> Any:
        inexact = modulus_cv, unknown_modulus, load_cv, shared_load_cv, individual
        as_rated = errors, resolution, slider_ends, n_categories
        model = ModelChoice(fixed, priors, prior_set, choice, direction, accuracy, finger, *inexact, *as_rated)
        return verb(model=model, **others)

    return wrapped
