"""Common parts of the likelihoods of ratings: parameters, table, and the contract of a rating model."""

from __future__ import annotations

from typing import Any, ClassVar, Protocol, Self

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.likelihood.contract import Effects, Levels, Likelihood, Model, Parameters, Shape
from softness_bayes.likelihood.design import Design, IndexArray, LoadErrors, Stated
from softness_bayes.likelihood.scales import RatingDirection
from softness_bayes.touch.finger_grid import SkinLaws

FloatArray = NDArray[np.float64]

RATINGS = "ratings"
"""Name of the ratings among the terms of a posterior."""

SKIN = ("b", "m")
"""Parameters of the forward model that rigid-plate forces depend on, too."""

OF_FORCES = (*SKIN, "varsigma_f")
"""Parameters of plate forces, also needed for ratings by people with plate forces."""


def log_rate(mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
    """Return log(N/N_ref + eps), shape (..., conditions)."""
    return np.asarray(np.log(mean_rate + np.asarray(parameters.eps, float)[..., None]))


class RatingsModel(Model, Protocol):
    """An observation model of ratings, for any design."""

    @property
    def direction(self) -> RatingDirection:
        """Direction of ratings with the response."""

    def drive_at(
        self, elsewhere: FloatArray, design: Design, mean_rate: FloatArray, parameters: Parameters
    ) -> FloatArray:
        """Return `Likelihood.drive` at other mean rates [Hz], shape (..., k), centred over the rows of the design.

        The first columns of `mean_rate` are those of the design's conditions.
        """

    def drive(self, design: Design, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return `Likelihood.drive` for each column of the mean rates, shape (..., columns)."""
        return self.drive_at(mean_rate, design, mean_rate, parameters)

    def draw_effects(
        self, rng: Generator, parameters: Parameters, shape: Shape, people: int, fabrics: int, levels: Levels = None
    ) -> Effects:
        """Return effects of new participants and fabrics, as `Likelihood.new_effects` does.

        The first of them has the batch `shape`; effects of fabrics, if any, are named `fabric`.
        """

    def for_others(
        self, rng: Generator, parameters: Parameters, effects: Effects, people: int, fabric: IndexArray
    ) -> Effects:
        """Return effects for a number of new participants and for other fabrics.

        Parameters
        ----------
        rng, parameters, effects, people
            Effects are those of `Likelihood.draw_effects`; effects shared by all ratings are unchanged.
        fabric
            Each fabric's index among those of `effects`, shape (fabrics,); -1 stands for a new fabric, which is drawn.
        """
        levels = {name: getattr(effects, name) for name in self.levels}
        new = self.draw_effects(rng, parameters, effects.first_shape, people, fabric.size, levels)
        if "fabric" not in vars(new):
            return new
        return new.replace(fabric=np.where(fabric >= 0, effects.fabric[..., fabric], new.fabric))

    def draw_ratings(
        self, rng: Generator, design: Design, drive: FloatArray, parameters: Parameters, effects: Effects
    ) -> FloatArray:
        """Return a rating for every row of a design, shape (..., rows)."""

    def observe(self, ratings: ArrayLike, design: Design, stated: Stated | None = None) -> RatingsLikelihood:
        """Return the likelihood of these ratings; models of intervals also take the intervals that they represent."""


class RatingsLikelihood(Likelihood):
    """Base of likelihoods of ratings, without the densities, which depend on the model.

    Parameters
    ----------
    ratings
        y of every row of the design, shape (rows,).
    design
        Rater and condition of each rating.
    model
        The rating model.
    over
        Design over whose rows the response is centred; by default `design`.

    Raises
    ------
    InputError
        If there is not one rating for each row.
    """

    name: ClassVar[str] = RATINGS
    load_errors: LoadErrors | None = None
    """The additional loads at which responses are needed; None if loads are exact."""

    def __init__(self, ratings: ArrayLike, design: Design, model: Any, over: Design | None = None) -> None:
        self.values = np.array(ratings, dtype=float)
        self.values.flags.writeable = False
        if self.values.shape != (design.n_rows,):
            raise InputError(f"ratings: shape {self.values.shape}, expected one for each of {design.n_rows} rows")
        self.design, self.model, self._over = design, model, over or design

    def _arguments(self, rows: NDArray[np.bool_] | None = None) -> dict[str, Any]:
        """Return further arguments of the constructor: for other values of all rows, or for the values of some."""
        return {}

    def with_values(self, values: ArrayLike) -> Self:
        """Return the likelihood of other ratings of the same rows."""
        return type(self)(values, self.design, self.model, over=self._over, **self._arguments())

    def without(self, rows: NDArray[np.bool_]) -> Self:
        """Return the likelihood of the other ratings, with x still centred over all rows.

        The joint density factorises as p(y) = p(others) p(rows | others).
        """
        left, design = self._arguments(~rows), self.design.without(rows)
        return type(self)(self.values[~rows], design, self.model, over=self._over, **left)

    def drive(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the response's contribution for each column of the mean rates, in `Scale.unit`."""
        return self.drive_at(mean_rate, mean_rate, parameters)

    def drive_at(self, elsewhere: FloatArray, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return `drive` at other mean rates [Hz], shape (..., k)."""
        return np.asarray(self.model.drive_at(elsewhere, self._over, mean_rate, parameters))

    def predictor(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return log(N/N_ref + eps), shape (..., conditions): a slope is an exponent."""
        return log_rate(mean_rate[..., : self.design.n_conditions], parameters)

    def expected(self, mean_rate: FloatArray, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return the typical rating of each condition of the design [as in the file], shape (..., conditions)."""
        drive = self.drive(mean_rate, parameters)[..., : self.design.n_conditions]
        return np.asarray(self.model.typical(effects, drive))

    def typical(
        self,
        mean_rate: FloatArray,
        parameters: Parameters,
        effects: Effects,
        drive: FloatArray,
        among: IndexArray | None = None,
    ) -> FloatArray:
        """Return the typical rating of touches with these drives [as in the file], shape (..., k).

        Parameters
        ----------
        mean_rate, parameters, effects
            N/N_ref of the design's conditions [Hz], parameters and effects, of the same batch.
        drive
            Drives of the touches, shape (..., k).
        among
            If ratings are comparisons, the conditions of the design with which the touches are compared; by default
            all.
        """
        return np.asarray(self.model.typical(effects, drive))

    def new_effects(self, rng: Generator, parameters: Parameters, shape: Shape, levels: Levels = None) -> Effects:
        """Return effects of new participants and fabrics, of batch ``shape``."""
        return self.model.draw_effects(
            rng, parameters, shape, self.design.n_participants, self.design.n_fabrics, levels
        )

    def with_new_participants(self, rng: Generator, parameters: Parameters, effects: Effects) -> Effects:
        """Return these effects with the same number of new participants."""
        fabrics = np.arange(self.design.n_fabrics)
        return self.model.for_others(rng, parameters, effects, self.design.n_participants, fabrics)

    @property
    def raters(self) -> int:
        """Number of raters: that of participants, or that of a panel if the ratings are means."""
        return self.design.n_participants

    @property
    def single(self) -> RatingsModel:
        """The model of ratings by single raters; differs from `model` if the ratings are means of panels."""
        model: RatingsModel = self.model
        return model

    @property
    def ends(self) -> tuple[FloatArray, FloatArray] | None:
        """Ends of the intervals that the ratings represent, each (rows,); None if ratings are exact numbers."""
        return None

    def with_pressed(self, pressed: Any) -> Self:
        """Return the likelihood given plate forces on raters' fingers; unchanged if all raters have the typical finger.

        Parameters
        ----------
        pressed
            `plate.PressedRaters`, or None if there are no plate forces.
        """
        return self

    def of_strangers(self) -> Self:
        """Return the likelihood if nobody had plate forces, with the same columns of mean rates."""
        return self

    def skins_of_pressed(self, parameters: Parameters) -> SkinLaws | None:
        """Return the laws of the raters' skins given their plate forces; None if there are none."""
        return None

    def finer(self) -> RatingsLikelihood:
        """Return the reference of a likelihood that approximates in what is reported, too."""
        return self

    def replicate(self, rng: Generator, drive: FloatArray, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return one rating for every row, shape (..., rows)."""
        return np.asarray(self.model.draw_ratings(rng, self.design, drive, parameters, effects))
