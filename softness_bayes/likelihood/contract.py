"""Contract of a likelihood: the members used by the posterior, checks, results and figures, for any kind of data.

It is met by magnitude estimates, z-scores and plate forces; `tests/likelihood/test_contract.py` applies the same tests
to every entry of `models.LIKELIHOODS`. An observation model has two parts: a `Model`, which does not depend on data
(scale, error law, priors), and a `Likelihood`, the model of one table. Batch shapes (...) are those of the parameters:
one point, or any array of draws; members treat each point independently.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple, Protocol, Self

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base.laws import Prior
from softness_bayes.likelihood.design import Design, IndexArray
from softness_bayes.likelihood.error_laws import ErrorLaw
from softness_bayes.likelihood.scales import Scale

FloatArray = NDArray[np.float64]
Shape = tuple[int, ...]
Levels = Mapping[str, ArrayLike] | None
"""Values of effects that all observations share, by name, each of batch shape (...)."""

RATER_SPREADS: Mapping[str, str] = MappingProxyType({"gamma": "tau_gamma", "varsigma": "tau_varsigma"})
"""Name of the parameter for the spread between raters, by the quantity that differs."""

RATER_EFFECTS: Mapping[str, str] = MappingProxyType({"gamma": "rater_log_gamma", "varsigma": "rater_log_varsigma"})
"""Names in files of raters' log deviations from the typical rater, by the quantity that differs."""

NO_RESPONSE: FloatArray = np.empty(0)
"""The mean rate without conditions, for models without receptors: shape (0,), or (..., 0) with a batch shape."""


class Parameters:
    """Parameters of a model by name, in SI units: numbers, or arrays of batch shape (...), as attributes.

    Those that a model lacks are absent: asking for one is an error.
    """

    def __init__(self, **values: ArrayLike) -> None:
        vars(self).update(values)

    def __getattr__(self, name: str) -> Any:
        known = ", ".join(vars(self))
        raise AttributeError(f"these {type(self).__name__.lower()} have no {name!r}, only {known}")

    def replace(self, **values: ArrayLike) -> Self:
        """Return the same with some values replaced or added."""
        return type(self)(**{**vars(self), **values})

    def each(self, change: Callable[[Any], Any]) -> Self:
        """Return the same with a function applied to each value."""
        return type(self)(**{name: change(value) for name, value in vars(self).items()})

    def part(self, draws: Any) -> Self:
        """Return the values at some draws; numbers are unchanged."""
        return self.each(lambda value: np.asarray(value)[draws] if np.ndim(value) else value)

    def batch_shape(self, *first: tuple[int, ...]) -> tuple[int, ...]:
        """Return the common shape of all values and of any other shapes; numbers, which are most, have none."""
        return np.broadcast_shapes(*first, *(shape for v in vars(self).values() if (shape := getattr(v, "shape", ()))))


class Effects(Parameters):
    """Effects of a model by name: those shared by all observations (...), those of participants or fabrics (..., k)."""

    @property
    def first_shape(self) -> Shape:
        """Shape of the first of them: the batch shape, if it is shared by all observations."""
        return np.shape(next(iter(vars(self).values())))

    @classmethod
    def joined(cls, parts: Sequence[Effects]) -> Self:
        """Return the effects of all draws from those of some draws after another."""
        return cls(**{name: np.concatenate([vars(part)[name] for part in parts]) for name in vars(parts[0])})


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

    def error_sd(self, parameters: Parameters) -> FloatArray:
        """Return the standard deviation of an error's `ErrorLaw.normal_scores`, shape (...), in `Scale.unit`."""

    def typical(self, effects: Effects, drive: FloatArray) -> FloatArray:
        """Return the median observation of a typical participant [as in the file] for each `drive`, shape (..., k)."""

    def named_effects(self, effects: Effects) -> Mapping[str, tuple[FloatArray, tuple[str, ...]]]:
        """Return effects by their names in files, each with its axes after the batch axes (none for shared effects).

        Effects of fabrics are added to the drive.
        """


class RowsLeftOut(NamedTuple):
    """Predictive law of each row given all the others, at its observation, each (..., rows)."""

    log_density: FloatArray
    """Log density."""
    below: FloatArray
    """Probability of a smaller observation; of discrete ones, half that of an equal one counts."""


class Likelihood(ABC):
    """Observations of one table under a model, with all effects of participants and fabrics integrated out.

    Densities refer to observations as in the file: a density [1/unit] each, or a probability if they are discrete.
    """

    name: ClassVar[str]
    """Name of the data, which identifies the term in a posterior."""
    model: Any
    """Its `Model`; for ratings, a `ratings.RatingsModel`."""
    design: Design
    """Participant and condition of each observation."""
    values: FloatArray
    """Observations as in the file, shape (rows,)."""

    @property
    def condition_of_rate(self) -> IndexArray:
        """Condition of each column of the mean rates and of the drive, shape (columns,): first one for each condition.

        Those of the same conditions under other loads, or on raters' own fingers, follow.
        """
        return np.arange(self.design.n_conditions)

    @property
    def discrete(self) -> NDArray[np.bool_]:
        """True for observations whose density is a probability, shape (rows,); all False by default."""
        return np.zeros(self.values.size, bool)

    @abstractmethod
    def with_values(self, values: ArrayLike) -> Self:
        """Return the likelihood of other observations in the same rows."""

    @abstractmethod
    def without(self, rows: NDArray[np.bool_]) -> Self:
        """Return the likelihood of the other rows: p(y) = p(others) p(rows | others). Conditions are unchanged."""

    @abstractmethod
    def log_likelihood(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log density of all observations together, shape (...).

        Parameters
        ----------
        mean_rate
            N/N_ref [Hz] of each column (`condition_of_rate`), shape (..., columns). Models without receptors use only
            its batch shape, as that of `NO_RESPONSE`. Here and elsewhere, its batch shape is broadcast with that of the
            parameters.
        parameters
            Those that the model needs, of batch shape (...).
        """

    @abstractmethod
    def left_out(self, mean_rate: FloatArray, parameters: Parameters) -> RowsLeftOut:
        """Return the law of each observation given all the others, at the observation."""

    def log_likelihood_answers(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log density of each answer given all the others, shape (..., answers).

        By default every observation is an answer; on scales with a `Scale.answer`, such as lists, several rows form one
        answer.
        """
        return self.left_out(mean_rate, parameters).log_density

    def for_sampling(self) -> Self:
        """Return the likelihood in the form in which it is sampled; far from the data it may be less accurate.

        Proposals that far away are rejected by either.
        """
        return self

    def log_likelihood_participants(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log density of each participant's observations given all others', (..., participants)."""
        some = self.log_likelihood_blocks(mean_rate, parameters, self.design.participant)
        found = np.zeros((*some.shape[:-1], self.design.n_participants))
        found[..., : some.shape[-1]] = some
        return found

    def log_likelihood_blocks(self, mean_rate: FloatArray, parameters: Parameters, block: IndexArray) -> FloatArray:
        """Return the log density of each block of observations given all others, shape (..., blocks).

        The response is still centred or standardised over all rows: observations are left out, not conditions.

        Parameters
        ----------
        mean_rate, parameters
            As for `log_likelihood`.
        block
            Index of each row's block, shape (rows,).
        """
        whole = np.asarray(self.log_likelihood(mean_rate, parameters))
        found = np.zeros((*whole.shape, int(block.max()) + 1))
        for k in np.unique(block):
            rest = (
                np.zeros(()) if (block == k).all() else self.without(block == k).log_likelihood(mean_rate, parameters)
            )
            found[..., k] = whole - rest
        return found

    @abstractmethod
    def drive(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the response term on the additive scale for each column of the mean rates, in `Scale.unit`."""

    @abstractmethod
    def predictor(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the regressor on the additive scale, up to a constant, shape (..., conditions).

        Checks estimate participants' slopes against it; a slope is in `Scale.unit` per unit of the regressor.
        """

    @abstractmethod
    def new_effects(self, rng: Generator, parameters: Parameters, shape: Shape, levels: Levels = None) -> Effects:
        """Return prior draws of all effects, of batch `shape`; shared effects in `levels` are used as given."""

    def with_new_participants(self, rng: Generator, parameters: Parameters, effects: Effects) -> Effects:
        """Return these effects with the same number of new participants; by default no others are needed."""
        return self.new_effects(rng, parameters, effects.first_shape[:-1])

    @abstractmethod
    def draw_effects(self, rng: Generator, mean_rate: FloatArray, parameters: Parameters) -> Effects:
        """Return exact draws of all effects given the observations, one for each point of the batch."""

    @abstractmethod
    def replicate(self, rng: Generator, drive: FloatArray, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return a simulated observation for every row [as in the file] given `drive`, shape (..., rows)."""

    @abstractmethod
    def residual(self, mean_rate: FloatArray, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return the error of each observation, shape (..., rows), in `Scale.unit` and as `ErrorLaw.normal_scores`.

        Under the model they are independent and normal with standard deviation `Model.error_sd`.
        """
