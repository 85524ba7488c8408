"""Observation models of ratings, by scale and error law, and the list of all likelihoods that meet the contract.

Custom models are found by name, and tested before a run so that none fails after it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from softness_bayes.base.errors import InputError
from softness_bayes.likelihood.aggregated import AggregatedModel, AggregatedRatings, RaterSpreads
from softness_bayes.likelihood.contract import Likelihood, Parameters, RatingsLikelihood, RatingsModel
from softness_bayes.likelihood.design import FloatArray, LoadErrors
from softness_bayes.likelihood.error_laws import ERROR_LAWS, GUMBEL, LAPSES, NORMAL, STUDENT, ErrorLaw
from softness_bayes.likelihood.individual import IndividualRatings
from softness_bayes.likelihood.intervals import (
    CategoryModel,
    CategoryRatings,
    IntervalModel,
    IntervalRatings,
    SliderModel,
)
from softness_bayes.likelihood.magnitude import LogRatings, RatingModel
from softness_bayes.likelihood.orders import OrderModel, OrderRatings, PairModel, PairRatings
from softness_bayes.likelihood.plate import CompressionForces
from softness_bayes.likelihood.scales import (
    AGGREGATED,
    CATEGORIES,
    MAGNITUDE,
    PAIRS,
    RANKS,
    RISES,
    SLIDER,
    STANDARDISED,
    RatingDirection,
    Scale,
)
from softness_bayes.likelihood.uncertain_loads import UncertainLoads
from softness_bayes.likelihood.z_scores import StandardisedModel, StandardisedRatings

MEMBERS = (
    "scale", "error", "needs", "levels", "direction", "error_sd", "typical", "named_effects", "drive",
    "drive_at", "draw_effects", "for_others", "draw_ratings", "observe",
)  # fmt: skip
"""Required members of a model of ratings."""

RATING_MODELS: Mapping[tuple[Scale, ErrorLaw], Callable[[RatingDirection], RatingsModel]] = MappingProxyType(
    {
        (MAGNITUDE, NORMAL): RatingModel,
        (MAGNITUDE, STUDENT): partial(IntervalModel, law=STUDENT),
        (MAGNITUDE, LAPSES): partial(IntervalModel, law=LAPSES),
        (STANDARDISED, NORMAL): StandardisedModel,
        (AGGREGATED, NORMAL): AggregatedModel,
        **{(CATEGORIES, law): partial(CategoryModel, law=law) for law in ERROR_LAWS.values()},
        **{(SLIDER, law): partial(SliderModel, law=law) for law in ERROR_LAWS.values()},
        (RANKS, GUMBEL): OrderModel,
        **{(PAIRS, law): partial(PairModel, law=law) for law in (NORMAL, LAPSES)},
    }
)
"""Constructors of observation models, which take a direction, by scale of the ratings and error law."""

OF_DIFFERENT_RATERS: Mapping[Scale, Callable[..., RatingsModel]] = MappingProxyType(
    {MAGNITUDE: IntervalModel, SLIDER: SliderModel}
)
"""Constructors of the models of intervals in which raters may differ in exponents or noise, by scale."""

LIKELIHOODS: tuple[type[Likelihood], ...] = (
    LogRatings,
    IntervalRatings,
    CategoryRatings,
    OrderRatings,
    PairRatings,
    UncertainLoads,
    IndividualRatings,
    StandardisedRatings,
    AggregatedRatings,
    RaterSpreads,
    CompressionForces,
)
"""All likelihoods; each is covered by the tests of the contract."""


def rating_model(
    scale: Scale,
    direction: RatingDirection = RISES,
    error: ErrorLaw | None = None,
    exact: bool = True,
    differ: tuple[str, ...] = (),
) -> RatingsModel:
    """Return the observation model of ratings.

    Parameters
    ----------
    scale, direction
        Scale of the ratings, and their direction with the response.
    error
        Error law; by default the first one of the scale.
    exact
        False if ratings represent intervals.
    differ
        Quantities in which raters differ: gamma, varsigma or both.

    Raises
    ------
    InputError
        If there is no model for that scale and error law, or of raters who differ on that scale.
    """
    if scale.model is not None:
        own: RatingsModel = scale.model(direction)
        require_model(scale, own)
        return own
    error = error or next((law for one, law in RATING_MODELS if one == scale), NORMAL)
    if differ and scale not in OF_DIFFERENT_RATERS:
        known = " and ".join(one.name for one in OF_DIFFERENT_RATERS)
        raise InputError(
            f"individual: raters' own exponents or noise are modelled for {known} ratings, not for {scale.name} ratings"
        )
    if (scale, error) not in RATING_MODELS:
        known = ", ".join(f"{one.name} with {law.name} errors" for one, law in RATING_MODELS)
        raise InputError(f"ratings: no model of {scale.name} with {error.name} errors; expected one of {known}")
    if differ or (not exact and scale == MAGNITUDE):
        return OF_DIFFERENT_RATERS[scale](direction, law=error, differ=differ)
    return RATING_MODELS[scale, error](direction)


def under_load_errors(observed: RatingsLikelihood, errors: LoadErrors) -> RatingsLikelihood:
    """Return the likelihood of ratings whose loads have errors.

    Raises
    ------
    InputError
        If there is no such likelihood for the scale of the ratings.
    """
    model = observed.model
    if model.scale != MAGNITUDE:
        name = "load_cv" if errors.load is None else "shared_load_cv"
        raise InputError(
            f"ratings: errors of loads ({name}) are not modelled for {model.scale.name} ratings, only for "
            f"{MAGNITUDE.name}"
        )
    return UncertainLoads(observed.values, observed.design, model, errors)


def require_model(scale: Scale, model: Any) -> None:
    """Raise an error for a value that is not a model of ratings on a scale.

    Raises
    ------
    InputError
        Naming what is missing or wrong.
    """
    own = f"ratings: the model of {scale.name}"
    if missing := [name for name in MEMBERS if not hasattr(model, name)]:
        raise InputError(f"{own} has no {missing[0]!r}, expected all that likelihood.contract.RatingsModel has")
    if model.scale != scale:
        raise InputError(f"{own} has the scale {model.scale.name}, expected {scale.name} itself")
    if model.error not in ERROR_LAWS.values():
        raise InputError(f"{own} has an unknown error law, expected one of {', '.join(ERROR_LAWS)}")


def try_likelihood(observed: RatingsLikelihood, mean_rate: FloatArray, values: Mapping[str, ArrayLike]) -> None:
    """Call every member of a custom likelihood that a run needs, and check the shapes of the results.

    Parameters
    ----------
    observed
        Ratings under the model.
    mean_rate
        N/N_ref [Hz] of each condition at some parameters, shape (draws, conditions).
    values
        Parameters of the model by name, each (draws,).

    Raises
    ------
    InputError
        Names the member that fails or returns an invalid value.
    """
    model, rng = observed.model, np.random.default_rng(0)
    draws, rows = len(mean_rate), observed.design.n_rows
    conditions, people = observed.design.n_conditions, observed.design.n_participants
    own = f"ratings: the model of {model.scale.name}: "

    def tried(name: str, call: Callable[[], Any], shape: tuple[int, ...] | None = None) -> Any:
        try:
            found = call()
        except Exception as error:
            raise InputError(f"{own}{name} fails: {type(error).__name__}: {error}") from error
        if shape is not None and np.shape(found) != shape:
            raise InputError(f"{own}{name} has shape {np.shape(found)}, expected {shape}")
        return found

    p = Parameters(**values)
    tried("error_sd", lambda: model.error_sd(p), (draws,))
    tried("log_likelihood", lambda: observed.log_likelihood(mean_rate, p), (draws,))
    tried("left_out", lambda: tuple(observed.left_out(mean_rate, p)), (2, draws, rows))
    tried("log_likelihood_participants", lambda: observed.log_likelihood_participants(mean_rate, p), (draws, people))
    drive = tried("drive", lambda: observed.drive(mean_rate, p), (draws, conditions))
    tried("predictor", lambda: observed.predictor(mean_rate, p), (draws, conditions))
    effects = tried("draw_effects", lambda: observed.draw_effects(rng, mean_rate, p))
    tried("new_effects", lambda: observed.new_effects(rng, p, (draws,)))
    others = tried("with_new_participants", lambda: observed.with_new_participants(rng, p, effects))
    tried("typical", lambda: model.typical(effects, drive), (draws, conditions))
    tried("draw_ratings", lambda: observed.replicate(rng, drive, p, others), (draws, rows))
    for name, (effect, axes) in tried("named_effects", lambda: dict(model.named_effects(effects))).items():
        if np.ndim(effect) != 1 + len(axes):
            raise InputError(f"{own}named_effects: {name} has {np.ndim(effect)} axes, expected {1 + len(axes)}")
    tried("residual", lambda: observed.residual(mean_rate, p, effects), (draws, rows))
    tried("with_values", lambda: observed.with_values(observed.values))
    if rows > 1:
        tried("without", lambda: observed.without(np.arange(rows) == 0))
    fabric = np.array([0, -1])
    tried("for_others", lambda: model.for_others(rng, p, effects, 2, fabric))
