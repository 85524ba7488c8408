"""Ratings on ordered categories: intervals of log softness with sampled thresholds (model.md 9)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.likelihood.contract import Effects, Levels, Parameters, Shape
from softness_bayes.likelihood.design import Design, Stated
from softness_bayes.likelihood.intervals import IntervalModel, IntervalRatings
from softness_bayes.likelihood.row_laws import Rows
from softness_bayes.likelihood.scales import CATEGORIES, Scale

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class CategoryModel(IntervalModel):
    """An `IntervalModel` for ratings that are category numbers, from 1.

    The first category ends at 0; each further one except the last has the width of its `gap`; mu ~ N(0, spread²). The
    upper ends of all categories but the last are among the effects, as `threshold` (..., categories - 1).

    Parameters
    ----------
    categories
        Number of categories.
    """

    scale: ClassVar[Scale] = CATEGORIES
    centre: float = 1.0
    categories: int = 7

    @property
    def gaps(self) -> tuple[str, ...]:
        """Names of the parameters for the widths of categories."""
        return tuple(f"gap_{k}" for k in range(2, self.categories))

    @property
    def needs(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the model's parameters."""
        return (*super().needs, *self.gaps)

    def thresholds(self, parameters: Parameters) -> FloatArray:
        """Return the upper thresholds of all categories except the last, shape (..., categories - 1)."""
        shape = parameters.batch_shape()
        gaps = [np.broadcast_to(np.asarray(getattr(parameters, name), float), shape) for name in self.gaps]
        return np.cumsum(np.stack([np.zeros(shape), *gaps], axis=-1), axis=-1)

    def typical(self, effects: Effects, drive: FloatArray) -> FloatArray:
        """Return the category chosen by a typical participant (s = 0) for a response term ``drive``, shape (..., k)."""
        return _category(effects.mu[..., None] + drive, effects.threshold)

    def draw_effects(
        self, rng: Generator, parameters: Parameters, shape: Shape, people: int, fabrics: int, levels: Levels = None
    ) -> Effects:
        """Return effects of new participants, of batch ``shape``; mu from its prior unless in `levels`."""
        drawn = super().draw_effects(rng, parameters, shape, people, fabrics, levels)
        found = self.thresholds(parameters)
        return drawn.replace(threshold=np.broadcast_to(found, (*shape, found.shape[-1])))

    def draw_ratings(
        self,
        rng: Generator,
        design: Design,
        drive: FloatArray,
        parameters: Parameters,
        effects: Effects,
        stated: Stated | None = None,
    ) -> FloatArray:
        """Return one category for every row of a design, shape (..., rows)."""
        found = _category(self.draw_attentive(rng, design, drive, parameters, effects), effects.threshold)
        if not self.law.lapses:
            return found
        lapsed = rng.random(found.shape) < np.asarray(parameters.lapse, float)[..., None]
        return np.where(lapsed, rng.integers(1, self.categories + 1, found.shape), found)

    def observe(self, ratings: ArrayLike, design: Design, stated: Stated | None = None) -> CategoryRatings:
        """Return the likelihood of these categories."""
        return CategoryRatings(ratings, design, self)


class CategoryRatings(IntervalRatings):
    """Categories under a `CategoryModel`, mu and raters' scales integrated out; arguments as for `IntervalRatings`.

    Raises
    ------
    InputError
        If a rating is not the number of a category, or their number is not that of the design's rows.
    """

    model: CategoryModel

    def _understood(self, stated: Stated | None) -> Stated:
        wrong = ~np.isin(self.values, np.arange(1, self.model.categories + 1))
        if wrong.any():
            raise InputError(
                f"ratings: {wrong.sum()} of {wrong.size} are not categories from 1 to {self.model.categories}, the "
                f"first is {self.values[wrong][0]}"
            )
        # a step of 1, so that no rating counts as exact; the thresholds follow from the parameters
        step = np.ones(wrong.size)
        return Stated(self.values, step, 0.5 * step, np.inf * step)

    @property
    def ends(self) -> tuple[FloatArray, FloatArray] | None:
        """None, because the thresholds of categories are sampled."""
        return None

    def _rows_at(self, parameters: Parameters) -> Rows:
        ends = self.model.thresholds(parameters)
        shape = (*ends.shape[:-1], 1)
        ends = np.concatenate([np.full(shape, -np.inf), ends, np.full(shape, np.inf)], axis=-1)
        category = self.values[self._order].astype(np.intp)
        lapse = np.full(category.size, -np.log(self.model.categories))
        return Rows(ends[..., category - 1], ends[..., category], lapse)


def _category(latent: FloatArray, threshold: FloatArray) -> FloatArray:
    """Return the category of latent values (..., k) for thresholds (..., categories - 1)."""
    return 1.0 + (latent[..., None] > threshold[..., None, :]).sum(axis=-1)
