"""Observation models of ratings, by scale and error law, and the list of all likelihoods that meet the contract."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType

from softness_bayes.errors import InputError
from softness_bayes.likelihood.aggregated import AggregatedModel, AggregatedRatings
from softness_bayes.likelihood.categories import CategoryModel, CategoryRatings
from softness_bayes.likelihood.contract import Likelihood
from softness_bayes.likelihood.custom import require_model
from softness_bayes.likelihood.design import LoadErrors
from softness_bayes.likelihood.directions import RISES, RatingDirection
from softness_bayes.likelihood.error_laws import ERROR_LAWS, GUMBEL, LAPSES, NORMAL, STUDENT, ErrorLaw
from softness_bayes.likelihood.individual import IndividualRatings
from softness_bayes.likelihood.intervals import IntervalModel, IntervalRatings, SliderModel
from softness_bayes.likelihood.magnitude import LogRatings, RatingModel
from softness_bayes.likelihood.orders import OrderModel, OrderRatings
from softness_bayes.likelihood.pairs import PairModel, PairRatings
from softness_bayes.likelihood.plate import CompressionForces
from softness_bayes.likelihood.ratings import RatingsLikelihood, RatingsModel
from softness_bayes.likelihood.scales import (
    AGGREGATED,
    CATEGORIES,
    MAGNITUDE,
    PAIRS,
    RANKS,
    SLIDER,
    STANDARDISED,
    Scale,
)
from softness_bayes.likelihood.spreads import RaterSpreads
from softness_bayes.likelihood.uncertain_loads import UncertainLoads
from softness_bayes.likelihood.z_scores import StandardisedModel, StandardisedRatings

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

OF_INTERVALS: Mapping[tuple[Scale, ErrorLaw], Callable[[RatingDirection], RatingsModel]] = MappingProxyType(
    {
        **{
            (scale, law): partial(model, law=law)
            for scale, model in ((MAGNITUDE, IntervalModel), (SLIDER, SliderModel))
            for law in ERROR_LAWS.values()
        },
        (RANKS, GUMBEL): OrderModel,
        **{(PAIRS, law): partial(PairModel, law=law) for law in (NORMAL, LAPSES)},
    }
)
"""The same for ratings that represent intervals, or that are places in lists."""

OF_DIFFERENT_RATERS: Mapping[Scale, Callable[..., RatingsModel]] = MappingProxyType(
    {MAGNITUDE: IntervalModel, SLIDER: SliderModel}
)
"""Constructors of the models in which raters differ in exponents or noise, by scale."""

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
    scale: Scale, direction: RatingDirection = RISES, error: ErrorLaw | None = None, exact: bool = True
) -> RatingsModel:
    """Return the observation model of ratings that are exact numbers or represent intervals.

    The default error law is the first one of the scale.

    Raises
    ------
    InputError
        If there is no model for that scale and error law.
    """
    if scale.model is not None:
        own: RatingsModel = scale.model(direction)
        require_model(scale, own)
        return own
    models = RATING_MODELS if exact else OF_INTERVALS
    error = error or next((law for one, law in models if one == scale), NORMAL)
    if (scale, error) not in models:
        known = ", ".join(f"{one.name} with {law.name} errors" for one, law in models)
        raise InputError(f"ratings: no model of {scale.name} with {error.name} errors; expected one of {known}")
    return models[scale, error](direction)


def model_of_different_raters(
    scale: Scale, differ: tuple[str, ...], direction: RatingDirection = RISES, error: ErrorLaw = NORMAL
) -> RatingsModel:
    """Return the observation model of raters who differ in exponents or noise.

    Parameters
    ----------
    scale, direction, error
        As for `rating_model`.
    differ
        The quantities that differ: gamma, varsigma or both.

    Raises
    ------
    InputError
        If there is no such model for that scale.
    """
    if scale not in OF_DIFFERENT_RATERS:
        known = " and ".join(one.name for one in OF_DIFFERENT_RATERS)
        raise InputError(
            f"individual: raters' own exponents or noise are modelled for {known} ratings, not for {scale.name} ratings"
        )
    return OF_DIFFERENT_RATERS[scale](direction, law=error, differ=differ)


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
