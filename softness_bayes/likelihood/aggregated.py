"""Cell means: geometric means of magnitude estimates over n raters who each rated every cell (model.md 9).

The mean of n log ratings has the distribution of one rater's log rating, with both standard deviations divided by the
square root of n: the mean of the raters' scales is common to all cells of a panel, and the errors are averaged within
each cell. The likelihood of the cells' standard deviations is in `spreads`; given the parameters, it is independent of
that of the means.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from softness_bayes.likelihood.contract import Levels, Parameters, Shape
from softness_bayes.likelihood.design import Design, Stated
from softness_bayes.likelihood.magnitude import Effects, LogRatings, RatingModel
from softness_bayes.likelihood.normal_rows import EffectLaw
from softness_bayes.likelihood.ratings import RatingsLikelihood
from softness_bayes.likelihood.scales import AGGREGATED, Scale

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class AggregatedModel(RatingModel):
    """log m = mu + s_panel ± gamma (x - mean x over the rows) + f_fabric + e, m the geometric mean of n raters.

    s ~ N(0, tau²/n), e ~ N(0, varsigma²/n); mu and f are as for single ratings. A participant of the design is a panel
    of n raters, each of whom rated all cells of the panel once; tau and varsigma refer to single raters and ratings.

    Parameters
    ----------
    raters
        Number n of raters per panel.
    """

    scale: ClassVar[Scale] = AGGREGATED
    raters: int = 20

    @property
    def of_one_rater(self) -> RatingModel:
        """Model of single ratings by raters of the same population."""
        return RatingModel(self.direction, self.centre, self.spread)

    def of_means(self, parameters: Parameters) -> Parameters:
        """Return the parameters with tau and varsigma replaced by those of means over n raters."""
        root = math.sqrt(self.raters)
        return parameters.replace(
            tau=np.asarray(parameters.tau, float) / root, varsigma=np.asarray(parameters.varsigma, float) / root
        )

    def error_sd(self, parameters: Parameters) -> FloatArray:
        """Return the standard deviation of a log mean about its panel's, shape (...)."""
        return super().error_sd(self.of_means(parameters))

    def draw_effects(
        self, rng: Generator, parameters: Parameters, shape: Shape, people: int, fabrics: int, levels: Levels = None
    ) -> Effects:
        """Return effects of new panels and fabrics, of batch ``shape``."""
        drawn: Effects = super().draw_effects(rng, self.of_means(parameters), shape, people, fabrics, levels)
        return drawn

    def observe(self, ratings: ArrayLike, design: Design, stated: Stated | None = None) -> RatingsLikelihood:
        """Return the likelihood of these means under this model."""
        return AggregatedRatings(ratings, design, self)


class AggregatedRatings(LogRatings):
    """Geometric means under an `AggregatedModel`, with mu, panels and fabrics integrated out.

    Arguments are those of `LogRatings`; the participants of the design are panels.
    """

    def _law(self, drive: FloatArray, parameters: Parameters) -> EffectLaw:
        """Return the normal law of the log means."""
        law = super()._law(drive, parameters)
        return law._replace(participant=law.participant / math.sqrt(self.model.raters))

    @property
    def raters(self) -> int:
        """Number of raters of a panel."""
        return int(self.model.raters)

    @property
    def single(self) -> RatingModel:
        """The model of single raters."""
        return self.model.of_one_rater
