"""The readings of the scale that ratings are filed on (model.md 9)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from softness_bayes.likelihood.magnitude import LogRatings, RatingDirection, RatingModel, RatingParameters
from softness_bayes.likelihood.z_scores import StandardisedModel, StandardisedRatings

ObservationModel = RatingModel | StandardisedModel
"""What a scale makes of a direction."""
ObservedRatings = LogRatings | StandardisedRatings
"""Ratings under one of these models."""


@dataclass(frozen=True)
class RatingScale:
    """A reading of the scale of ratings, and with it their observation model."""

    name: str
    model: Callable[[RatingDirection], ObservationModel]
    """Makes the observation model of a direction."""
    parameters: tuple[str, ...]
    """Those of the rating's parameters that the model has."""
    positive: bool
    """Whether ratings have logarithms."""


MAGNITUDE = RatingScale("magnitude", RatingModel, RatingParameters._fields, True)
STANDARDISED = RatingScale("standardised", StandardisedModel, ("varsigma",), False)
RATING_SCALES: Mapping[str, RatingScale] = MappingProxyType({scale.name: scale for scale in (MAGNITUDE, STANDARDISED)})
"""The readings of the rating scale, by name; the first is the default."""
