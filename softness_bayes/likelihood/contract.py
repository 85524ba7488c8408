"""Contract of a likelihood: the members used by the posterior, checks, results and figures, for any kind of data.

It is met by magnitude estimates, z-scores and plate forces; `tests/likelihood/test_contract.py` applies the same tests
to every entry of `models.LIKELIHOODS`. An observation model has two parts: a `Model`, which does not depend on data
(scale, error law, priors), and a `Likelihood`, the model of one table; `RatingsModel` and `RatingsLikelihood` add what
all ratings have. Batch shapes (...) are those of the parameters: one point, or any array of draws; members treat each
point independently.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple, Protocol, Self

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import Prior
from softness_bayes.likelihood.design import Design, FloatArray, IndexArray, LoadErrors, Stated
from softness_bayes.likelihood.error_laws import ErrorLaw
from softness_bayes.likelihood.scales import RatingDirection, Scale

Shape = tuple[int, ...]
Levels = Mapping[str, ArrayLike] | None
"""Values of effects that all observations share, by name, each of batch shape (...)."""

RATER_SPREADS: Mapping[str, str] = MappingProxyType({"gamma": "tau_gamma", "varsigma": "tau_varsigma"})
"""Name of the parameter for the spread between raters, by the quantity that differs."""

RATER_EFFECTS: Mapping[str, str] = MappingProxyType({"gamma": "rater_log_gamma", "varsigma": "rater_log_varsigma"})
"""Names in files of raters' log deviations from the typical rater, by the quantity that differs."""

RATINGS = "ratings"
"""Name of the ratings among the terms of a posterior."""

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


class Term(ABC):
    """Observations of one table, of any kind, in a posterior: their density with all effects integrated out.

    Densities refer to observations as in the file: a density [1/unit] each, or a probability if they are discrete.
    """

    name: ClassVar[str]
    """Name of the data, which identifies the term in a posterior."""
    model: Any
    """The model, whose `needs` are the names of its parameters, without those behind the response."""

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

    def for_sampling(self) -> Self:
        """Return the likelihood in the form in which it is sampled; far from the data it may be less accurate.

        Proposals that far away are rejected by either.
        """
        return self

    @abstractmethod
    def new_effects(self, rng: Generator, parameters: Parameters, shape: Shape, levels: Levels = None) -> Effects:
        """Return prior draws of all effects, of batch `shape`; shared effects in `levels` are used as given."""

    @abstractmethod
    def draw_effects(self, rng: Generator, mean_rate: FloatArray, parameters: Parameters) -> Effects:
        """Return exact draws of all effects given the observations, one for each point of the batch."""

    @abstractmethod
    def replicate(self, rng: Generator, drive: FloatArray, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return a simulated observation for every row [as in the file] given `drive`, shape (..., rows)."""


class Likelihood(Term):
    """Observations of participants in conditions under a `Model`; for ratings, a `ratings.RatingsModel`."""

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

    def log_likelihood_answers(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log density of each answer given all the others, shape (..., answers).

        By default every observation is an answer; on scales with a `Scale.answer`, such as lists, several rows form one
        answer.
        """
        return self.left_out(mean_rate, parameters).log_density

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

    def with_new_participants(self, rng: Generator, parameters: Parameters, effects: Effects) -> Effects:
        """Return these effects with the same number of new participants; by default no others are needed."""
        return self.new_effects(rng, parameters, effects.first_shape[:-1])

    @abstractmethod
    def residual(self, mean_rate: FloatArray, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return the error of each observation, shape (..., rows), in `Scale.unit` and as `ErrorLaw.normal_scores`.

        Under the model they are independent and normal with standard deviation `Model.error_sd`.
        """


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
        If there is not one rating for each row, or a rating is not a number on the model's scale.
    """

    name: ClassVar[str] = RATINGS
    load_errors: LoadErrors | None = None
    """The additional loads at which responses are needed; None if loads are exact."""
    pressed: Any = None
    """Raters with plate forces (`plate.PressedRaters`), if fingers differ; None without."""

    def __init__(self, ratings: ArrayLike, design: Design, model: Any, over: Design | None = None) -> None:
        self.values = np.array(ratings, dtype=float)
        self.values.flags.writeable = False
        if self.values.shape != (design.n_rows,):
            raise InputError(f"ratings: shape {self.values.shape}, expected one for each of {design.n_rows} rows")
        with np.errstate(divide="ignore", invalid="ignore"):
            wrong = ~np.isfinite(model.scale.additive(self.values))
        if wrong.any():
            raise InputError(
                f"ratings: {wrong.sum()} of {wrong.size} are not {model.scale.suitable} numbers, the first is "
                f"{self.values[wrong][0]}"
            )
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
        eps = np.asarray(parameters.eps, float)[..., None]
        return np.asarray(np.log(mean_rate[..., : self.design.n_conditions] + eps))

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

    def finer(self) -> RatingsLikelihood:
        """Return the reference of a likelihood that approximates in what is reported, too."""
        return self

    def replicate(self, rng: Generator, drive: FloatArray, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return one rating for every row, shape (..., rows)."""
        return np.asarray(self.model.draw_ratings(rng, self.design, drive, parameters, effects))
