"""Common base of magnitude estimates for touches with uncertain loads: responses at the stated and other loads."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.likelihood.contract import Parameters
from softness_bayes.likelihood.design import Design, IndexArray
from softness_bayes.likelihood.load_errors import LoadErrors
from softness_bayes.likelihood.magnitude import LogRatings, RatingModel

FloatArray = NDArray[np.float64]


class ErringLoads(LogRatings):
    """Positive ratings under a `RatingModel`, with mean rates at the stated loads and at others about them.

    Parameters
    ----------
    ratings, design, model, over
        As for `LogRatings`.
    errors
        The errors of the loads. Mean rates are given at the stated loads, then at the further loads of `LoadErrors`.
    """

    effect: ClassVar[str]
    """Effect of the errors, for messages."""

    def __init__(
        self,
        ratings: ArrayLike,
        design: Design,
        model: RatingModel,
        errors: LoadErrors,
        over: Design | None = None,
    ) -> None:
        super().__init__(ratings, design, model, over)
        self.errors, self._columns = errors, errors.columns

    @property
    def load_errors(self) -> LoadErrors:
        """The additional loads at which responses are needed."""
        return self.errors

    @property
    def fabric_of_rate(self) -> IndexArray:
        """Fabric of each column of the mean rates."""
        fabric = self.design.fabric
        return np.concatenate(
            [fabric, *[fabric[self.errors.condition[self.errors.uncertain]]] * len(self.errors.nodes)]
        )

    def drive(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the response's contribution in each condition at its stated load, shape (..., conditions)."""
        return super().drive_at(self._stated(mean_rate), self._stated(mean_rate), parameters)

    def drive_at(self, elsewhere: FloatArray, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return `drive` at other mean rates [Hz], shape (..., k)."""
        return super().drive_at(elsewhere, self._stated(mean_rate), parameters)

    def predictor(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return log(N/N_ref + eps) at the stated loads, shape (..., conditions)."""
        return super().predictor(self._stated(mean_rate), parameters)

    def drives(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the drive of each touch under its lower, stated and higher loads, (loads, ..., touches)."""
        return np.moveaxis(self.drive_at(mean_rate, mean_rate, parameters)[..., self._columns], -1, 0)

    def _stated(self, mean_rate: FloatArray) -> FloatArray:
        """Return the mean rates under the stated loads."""
        return mean_rate[..., : self.design.n_conditions]

    def _needed(self, mean_rate: FloatArray | None) -> FloatArray:
        """Return the mean rates.

        Raises
        ------
        TypeError
            If they are None.
        """
        if mean_rate is None:
            raise TypeError(f"errors of loads {self.effect} ratings by the response: expected mean rates")
        return mean_rate
