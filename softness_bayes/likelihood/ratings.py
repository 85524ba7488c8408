"""Common parts of the likelihoods of ratings: parameters, table, and the contract of a rating model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.errors import InputError
from softness_bayes.likelihood.contract import Effects, Likelihood, Model, Parameters
from softness_bayes.likelihood.design import Design, IndexArray, LoadErrors, Stated
from softness_bayes.likelihood.directions import RatingDirection
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
        """Return `Likelihood.drive` at other mean rates [Hz], shape (..., k), centred over the design's rows."""

    def drive(self, design: Design, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return `Likelihood.drive` of a design's conditions, shape (..., conditions)."""

    def draw_effects(
        self,
        rng: np.random.Generator,
        parameters: Parameters,
        shape: tuple[int, ...],
        n_participants: int,
        n_fabrics: int,
        levels: Mapping[str, ArrayLike] | None = None,
    ) -> Effects:
        """Return effects of the given numbers of new participants and fabrics, as `Likelihood.new_effects` does."""

    def with_new_participants(self, rng: np.random.Generator, parameters: Parameters, effects: Effects) -> Effects:
        """Replace all participants' effects with those of new participants."""

    def for_others(
        self,
        rng: np.random.Generator,
        parameters: Parameters,
        effects: Effects,
        n_participants: int,
        fabric: NDArray[np.intp],
    ) -> Effects:
        """Return effects for a number of new participants and for other fabrics.

        Parameters
        ----------
        rng, parameters, effects, n_participants
            Effects are those of `Likelihood.draw_effects`; effects shared by all ratings are unchanged.
        fabric
            Each fabric's index among those of `effects`, shape (fabrics,); -1 stands for a new fabric, which is drawn.
        """

    def draw_ratings(
        self,
        rng: np.random.Generator,
        design: Design,
        drive: FloatArray,
        parameters: Parameters,
        effects: Effects,
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

    def __init__(self, ratings: ArrayLike, design: Design, model: Any, over: Design | None = None) -> None:
        self.values = np.array(ratings, dtype=float)
        self.values.flags.writeable = False
        if self.values.shape != (design.n_rows,):
            raise InputError(f"ratings: shape {self.values.shape}, expected one for each of {design.n_rows} rows")
        self.design, self.model, self._over = design, model, over or design

    def with_values(self, values: ArrayLike) -> Self:
        """Return the likelihood of other ratings of the same rows."""
        return type(self)(values, self.design, self.model, self._over)

    def without(self, rows: NDArray[np.bool_]) -> Self:
        """Return the likelihood of the other ratings, with x still centred over all rows.

        The joint density factorises as p(y) = p(others) p(rows | others).
        """
        return type(self)(self.values[~rows], self.design.without(rows), self.model, self._over)

    def drive(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the response's contribution in each condition, shape (..., conditions), in `Scale.unit`."""
        return self.drive_at(mean_rate, mean_rate, parameters)

    def drive_at(self, elsewhere: FloatArray, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return `drive` at other mean rates [Hz], shape (..., k)."""
        return np.asarray(self.model.drive_at(elsewhere, self._over, mean_rate, parameters))

    def predictor(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return log(N/N_ref + eps), shape (..., conditions): a slope is an exponent."""
        return log_rate(mean_rate, parameters)

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

    def new_effects(
        self,
        rng: np.random.Generator,
        parameters: Parameters,
        shape: tuple[int, ...],
        levels: Mapping[str, ArrayLike] | None = None,
    ) -> Effects:
        """Return effects of new participants and fabrics, of batch ``shape``."""
        return self.model.draw_effects(
            rng, parameters, shape, self.design.n_participants, self.design.n_fabrics, levels
        )

    def with_new_participants(self, rng: np.random.Generator, parameters: Parameters, effects: Effects) -> Effects:
        """Replace all participants' effects with those of new participants."""
        return self.model.with_new_participants(rng, parameters, effects)

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

    @property
    def load_errors(self) -> LoadErrors | None:
        """The additional loads at which responses are needed; None if loads are exact."""
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

    def finer(self) -> Self:
        """Return the same likelihood with finer numerical integration, where it uses any."""
        return self

    def without_approximation(self) -> Self:
        """Return the same likelihood, of which the sampler uses no approximation."""
        return self

    def replicate(
        self,
        rng: np.random.Generator,
        drive: FloatArray,
        parameters: Parameters,
        effects: Effects,
        mean_rate: FloatArray | None = None,
    ) -> FloatArray:
        """Return one rating for every row, shape (..., rows)."""
        return np.asarray(self.model.draw_ratings(rng, self.design, drive, parameters, effects))
