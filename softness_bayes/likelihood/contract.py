"""Contract of a likelihood: the members that the posterior, checks, results and figures use, for any kind of data.

Magnitude estimates, z-scores and forces of a plate meet it, and `tests/likelihood/test_contract.py` puts every entry
of `models.LIKELIHOODS` through the same tests. An observation model has two parts: a `Model`, a value that knows no
data (its scale, its error law, its priors), and a `Likelihood`, the model of one table. Batch shapes (...) are those
of the parameters: one point, or any array of draws; members treat each point independently.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.likelihood.design import Design, IndexArray
from softness_bayes.likelihood.error_laws import ErrorLaw
from softness_bayes.likelihood.scales import Scale
from softness_bayes.parameters.priors import Prior

FloatArray = NDArray[np.float64]
Parameters = Any
"""A NamedTuple of numbers and arrays (...): the parameters that a model needs, in SI units."""
Effects = Any
"""A NamedTuple of arrays: those shared by all observations (...), and those of participants or fabrics (..., k)."""

NO_RESPONSE: FloatArray = np.empty(0)
"""The mean rate without conditions, for models without receptors: shape (0,), or (..., 0) with a batch shape."""


class Model(Protocol):
    """An observation model without data: a frozen value."""

    @property
    def scale(self) -> Scale:
        """Scale of the observations, with units, labels, and `Scale.require`, which rejects unsuitable tables."""

    @property
    def error(self) -> ErrorLaw:
        """Law of the errors of single observations about their expectation."""

    @property
    def needs(self) -> tuple[str, ...]:
        """Names of the model's parameters, without those behind the response."""

    @property
    def levels(self) -> Mapping[str, Prior]:
        """Priors of the effects that all observations share, by name; these are drawn after a run."""

    def take(self, values: Mapping[str, ArrayLike]) -> Parameters:
        """Return the model's parameters from values by name [SI], numbers or arrays (...); other names are ignored."""

    def error_sd(self, parameters: Parameters) -> FloatArray:
        """Return the standard deviation of an error's `ErrorLaw.normal_scores`, shape (...), in `Scale.unit`."""

    def typical(self, effects: Effects, drive: FloatArray) -> FloatArray:
        """Return the median observation of a typical participant [as filed], shape (..., k), where `drive` is."""

    def named_effects(self, effects: Effects) -> Mapping[str, tuple[FloatArray, tuple[str, ...]]]:
        """Return effects by their names in files, each with its axes beyond the batch's; shared effects have none.

        Those of fabrics add to the drive.
        """


class Likelihood(ABC):
    """The observations of one table under a model, all effects of participants and fabrics integrated out.

    Densities are those of observations as filed: a density [1/unit] each, or a probability where they are discrete.
    """

    name: ClassVar[str]
    """Name of the data, by which a posterior finds the term."""
    model: Any
    """Its `Model`; of ratings, a `ratings.RatingsModel`."""
    design: Design
    """Participant and condition of each observation."""
    values: FloatArray
    """Observations as filed, shape (rows,)."""

    @property
    def fabric_of_rate(self) -> IndexArray:
        """Fabric of each column of the mean rates, shape (columns,): usually one column for each condition."""
        return self.design.fabric

    @property
    def discrete(self) -> NDArray[np.bool_]:
        """True for observations whose density is a probability, shape (rows,): by default for none."""
        return np.zeros(self.values.size, bool)

    @abstractmethod
    def with_values(self, values: ArrayLike) -> Self:
        """Return the likelihood of other observations of the same rows."""

    @abstractmethod
    def without(self, rows: NDArray[np.bool_]) -> Self:
        """Return the likelihood of the other rows: p(y) = p(others) p(rows | others). Conditions are unchanged."""

    @abstractmethod
    def log_likelihood(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log density of all observations together, shape (...).

        Parameters
        ----------
        mean_rate
            N/N_ref of each condition [Hz], shape (..., conditions), followed by those under other loads where the
            stated ones have errors (`load_errors.LoadErrors`), or by those of raters' own fingers; models without
            receptors use its batch shape alone, as that of `NO_RESPONSE`. Here and elsewhere it is broadcast with the
            parameters'.
        parameters
            From `Model.take`, of batch shape (...).
        """

    @abstractmethod
    def log_likelihood_loo(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log density of each observation given all the others, shape (..., rows)."""

    def log_likelihood_answers(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log density of each answer given all the others, shape (..., answers).

        By default every observation is an answer; several rows are one where a scale has a word for it
        (`Scale.answer`).
        """
        return self.log_likelihood_loo(mean_rate, parameters)

    @abstractmethod
    def below_loo(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the probability of a smaller observation than each one, given all the others, shape (..., rows).

        For discrete observations, half the probability of an equal one is added.
        """

    @abstractmethod
    def log_likelihood_participants(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log density of each participant's observations given all others', (draws, participants)."""

    @abstractmethod
    def drive(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the additive number of each column of the mean rates without effects, in `Scale.unit`."""

    @abstractmethod
    def predictor(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the regressor of the additive numbers, up to a constant, shape (..., conditions).

        Checks estimate participants' slopes on it; a slope is in `Scale.unit` per unit of the regressor.
        """

    @abstractmethod
    def new_effects(
        self,
        rng: np.random.Generator,
        parameters: Parameters,
        shape: tuple[int, ...],
        levels: Mapping[str, ArrayLike] | None = None,
    ) -> Effects:
        """Return draws of all effects from their prior, of batch `shape`; shared ones as given in `levels`, if so."""

    @abstractmethod
    def with_new_participants(self, rng: np.random.Generator, parameters: Parameters, effects: Effects) -> Effects:
        """Return these effects with the same number of new participants."""

    @abstractmethod
    def draw_effects(self, rng: np.random.Generator, mean_rate: FloatArray, parameters: Parameters) -> Effects:
        """Return exact draws of all effects given the observations, one for each point of the batch."""

    @abstractmethod
    def replicate(
        self,
        rng: np.random.Generator,
        drive: FloatArray,
        parameters: Parameters,
        effects: Effects,
        mean_rate: FloatArray | None = None,
    ) -> FloatArray:
        """Return a simulated observation for every row [as filed], shape (..., rows), where `drive` is.

        Where the errors depend on the response, they are those at `mean_rate`, which must be given then.
        """

    @abstractmethod
    def residual(self, mean_rate: FloatArray, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return the error of each observation, shape (..., rows), in `Scale.unit` and as `ErrorLaw.normal_scores`.

        Under the model they are independent and normal with standard deviation `Model.error_sd`.
        """
