"""From the response to ratings: magnitude estimates as a log-linear model with free moduli (model.md 9)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from softness_bayes.errors import InputError
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.left_out import participant_log_density
from softness_bayes.likelihood.pieces import in_pieces
from softness_bayes.likelihood.random_effects import Effects, LeaveOneOut, RandomEffects, Spreads
from softness_bayes.parameters.priors import Normal, Prior

FloatArray = NDArray[np.float64]

LARGEST_LOG_RATING = 700.0
"""Largest log rating, up or down, that is drawn or predicted: floating point ends at 709.78."""

_LOG_ROOT_TWO_PI = 0.5 * math.log(2.0 * math.pi)


class RatingParameters(NamedTuple):
    """The parameters of the rating model, each a number or an array of the batch shape (...)."""

    gamma: ArrayLike
    """Exponent of the rating [-]."""
    tau: ArrayLike
    """Standard deviation of participants' log moduli [-]."""
    varsigma: ArrayLike
    """Standard deviation of a rating's log about its participant's [-]."""
    omega: ArrayLike = 0.0
    """Standard deviation of fabrics' own deviations in the log [-]."""
    eps: ArrayLike = 0.1
    """Rate added to a silent fabric's [Hz]."""


@dataclass(frozen=True)
class RatingDirection:
    """A reading of what is rated: ratings rise (+1) or fall (-1) with the response."""

    name: str
    sign: float
    former: str
    """What earlier versions called it; accepted wherever the name is."""


RISES = RatingDirection("rises-with-firing", +1.0, "softness")
"""The paper's: softness is proportional to the response."""
FALLS = RatingDirection("falls-with-firing", -1.0, "inverse")
"""What most people's softness does: receptors fire more on stiffer fabrics."""
SOFTNESS, INVERSE = RISES, FALLS  # their former names
RATING_DIRECTIONS: Mapping[str, RatingDirection] = MappingProxyType(
    {direction.name: direction for direction in (RISES, FALLS)}
)
"""The readings of the rating's direction, by name; the first is taken where the data do not tell."""


def direction_named(name: str) -> RatingDirection:
    """Return a reading by its name, or by what earlier versions called it.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    for direction in RATING_DIRECTIONS.values():
        if name in (direction.name, direction.former):
            return direction
    raise InputError(f"direction: {name!r} is not known, expected {' or '.join(RATING_DIRECTIONS)}")


@dataclass(frozen=True)
class RatingModel:
    """log y = mu + s_participant ± gamma (x - mean x over the rows) + f_fabric + e, x = log(N/N_ref + eps).

    s ~ N(0, tau²), f ~ N(0, omega²), e ~ N(0, varsigma²), mu ~ N(log centre, spread²). N/N_ref is the pad's
    mean rate [Hz], the total rate over the number of receptors.

    Parameters
    ----------
    direction
        The sign of gamma.
    centre, spread
        Median of the prior of exp mu, and the standard deviation of mu.
    """

    logarithmic: ClassVar[bool] = True
    direction: RatingDirection = RISES
    centre: float = 20.0
    spread: float = 3.0

    @property
    def level(self) -> Normal:
        """The prior of mu."""
        return Normal(math.log(self.centre), self.spread)

    def drive(self, design: Design, mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
        """What the response adds to the log rating in each condition of a design.

        Parameters
        ----------
        design
            Who rated what: the rows over which x is centred.
        mean_rate
            N/N_ref [Hz] of each condition, shape (..., conditions).
        parameters
            Values of batch shape (...).

        Returns
        -------
        ndarray, shape (..., conditions)
        """
        return self.drive_at(mean_rate, design, mean_rate, parameters)

    def drive_at(
        self, elsewhere: FloatArray, design: Design, mean_rate: FloatArray, parameters: RatingParameters
    ) -> FloatArray:
        """As `drive`, at other mean rates [Hz], shape (..., k), centred as the rows of the design are."""
        eps = np.asarray(parameters.eps, float)[..., None]
        centre = (np.log(mean_rate + eps) @ design.weight)[..., None]
        gamma = np.asarray(parameters.gamma, float)[..., None]
        return self.direction.sign * gamma * (np.log(elsewhere + eps) - centre)

    def draw_effects(
        self,
        rng: np.random.Generator,
        parameters: RatingParameters,
        shape: tuple[int, ...],
        n_participants: int,
        n_fabrics: int,
        mu: ArrayLike | None = None,
    ) -> Effects:
        """Effects of new participants and new fabrics, of batch ``shape``; mu from its prior unless given."""
        if mu is None:
            mu = math.log(self.centre) + self.spread * rng.standard_normal(shape)
        tau, omega = (np.asarray(value, float)[..., None] for value in (parameters.tau, parameters.omega))
        participant = tau * rng.standard_normal((*shape, n_participants))
        fabric = omega * rng.standard_normal((*shape, n_fabrics))
        return Effects(np.broadcast_to(np.asarray(mu, float), shape), participant, fabric)

    def with_new_participants(
        self, rng: np.random.Generator, parameters: RatingParameters, effects: Effects
    ) -> Effects:
        """These effects with as many participants drawn anew."""
        tau = np.asarray(parameters.tau, float)[..., None]
        return effects._replace(participant=tau * rng.standard_normal(effects.participant.shape))

    def draw_ratings(
        self,
        rng: np.random.Generator,
        design: Design,
        drive: FloatArray,
        parameters: RatingParameters,
        effects: Effects,
    ) -> FloatArray:
        """One rating for every row of a design, shape (..., rows), given the effects and `drive`."""
        log_rating = effects.mu[..., None] + (drive + effects.fabric[..., design.fabric])[..., design.condition]
        log_rating = log_rating + effects.participant[..., design.participant]
        noise = rng.standard_normal(log_rating.shape)
        return _rating(log_rating + np.asarray(parameters.varsigma, float)[..., None] * noise)

    def typical(self, effects: Effects, drive: FloatArray) -> FloatArray:
        """Median rating of a typical participant (s = 0) where the response drives it by ``drive``, shape (..., k)."""
        return _rating(effects.mu[..., None] + drive)

    def named_effects(self, effects: Effects) -> Mapping[str, tuple[FloatArray, tuple[str, ...]]]:
        """Effects by their names in files, each with its axes beyond the batch's."""
        return {
            "mu": (effects.mu, ()),
            "participant_effect": (effects.participant, ("participant",)),
            "fabric_effect": (effects.fabric, ("fabric",)),
        }

    @property
    def levels(self) -> Mapping[str, Prior]:
        """Priors of what is drawn after a run and shared by all ratings, by name."""
        return {"mu": self.level}

    def observe(self, ratings: ArrayLike, design: Design) -> LogRatings:
        """These ratings under this model."""
        return LogRatings(ratings, design, self)


class LogRatings:
    """Positive ratings under a `RatingModel`, with mu, participants and fabrics integrated out.

    All densities are of the ratings as filed, not of their logarithms (- log y for each).

    Parameters
    ----------
    ratings
        y of every row of the design, shape (rows,).
    design
        Who rated what.
    model
        The rating model.
    over
        Design over whose rows the response is centred, if not over those of `design`.

    Raises
    ------
    InputError
        If a rating is not a positive finite number, or their number is not that of the design's rows.
    """

    def __init__(
        self,
        ratings: ArrayLike,
        design: Design,
        model: RatingModel = RatingModel(),
        over: Design | None = None,
    ) -> None:
        self.ratings = np.array(ratings, dtype=float)
        self.ratings.flags.writeable = False
        if self.ratings.shape != (design.n_rows,):
            raise InputError(f"ratings: shape {self.ratings.shape}, expected one for each of {design.n_rows} rows")
        wrong = ~(np.isfinite(self.ratings) & (self.ratings > 0))
        if wrong.any():
            raise InputError(
                f"ratings: {wrong.sum()} of {wrong.size} are not positive numbers, the first is "
                f"{self.ratings[wrong][0]}; magnitude estimates have no zeros or negatives"
            )
        self.design, self.model, self._over = design, model, over or design
        self._log = np.log(self.ratings)
        self._effects = RandomEffects(design, self._log, math.log(model.centre), model.spread)

    def log_likelihood(self, mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
        """Log density of all ratings together.

        Parameters
        ----------
        mean_rate
            N/N_ref [Hz] of each condition, shape (..., conditions).
        parameters
            Values of batch shape (...).

        Returns
        -------
        ndarray, shape (...)
        """
        drive = self.model.drive(self._over, mean_rate, parameters)
        return self._effects.log_density(drive, _spreads(parameters)) - self._log.sum()

    def leave_one_out(self, mean_rate: FloatArray, parameters: RatingParameters) -> LeaveOneOut:
        """The normal law of each log rating given all the others, arrays of shape (..., rows)."""
        drive = self.model.drive(self._over, mean_rate, parameters)
        return self._effects.leave_one_out(drive, _spreads(parameters))

    def log_likelihood_loo(self, mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
        """Log density of each rating given all the others, shape (..., rows)."""

        def alone(mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
            mean, sd = self.leave_one_out(mean_rate, parameters)
            return -0.5 * ((self._log - mean) / sd) ** 2 - np.log(sd) - _LOG_ROOT_TWO_PI - self._log

        return in_pieces(alone, self._effects.width, mean_rate, parameters)

    def below_loo(self, mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
        """Probability of a rating smaller than each one, given all the others, shape (..., rows)."""

        def below(mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
            mean, sd = self.leave_one_out(mean_rate, parameters)
            return np.asarray(ndtr((self._log - mean) / sd))

        return in_pieces(below, self._effects.width, mean_rate, parameters)

    def log_likelihood_participants(self, mean_rate: FloatArray, parameters: RatingParameters) -> FloatArray:
        """Log density of all ratings of each participant given everybody else's, shape (draws, participants)."""
        drive, model, person = self.model.drive(self._over, mean_rate, parameters), self.model, self.design.participant
        level = math.log(model.centre), model.spread
        density = participant_log_density(self.design, self._log, *level, drive, _spreads(parameters))
        return density - np.bincount(person, self._log, self.design.n_participants)

    def draw_effects(self, rng: np.random.Generator, mean_rate: FloatArray, parameters: RatingParameters) -> Effects:
        """Exact draws of mu, participants and fabrics given the ratings, one for each point of the batch."""
        drive = self.model.drive(self._over, mean_rate, parameters)
        return self._effects.draw_effects(rng, drive, _spreads(parameters))

    def residual(self, mean_rate: FloatArray, parameters: RatingParameters, effects: Effects) -> FloatArray:
        """What noise must explain of the log of each rating, shape (..., rows)."""
        drive, design = self.model.drive(self._over, mean_rate, parameters), self.design
        expected = effects.mu[..., None] + (drive + effects.fabric[..., design.fabric])[..., design.condition]
        return self._log - expected - effects.participant[..., design.participant]

    def without(self, rows: NDArray[np.bool_]) -> LogRatings:
        """The other ratings alone, x still centred over all rows: p(y) = p(others) p(rows | others)."""
        return LogRatings(self.ratings[~rows], self.design.without(rows), self.model, self._over)


def _rating(log_rating: FloatArray) -> FloatArray:
    """Return exp of log ratings, held at `LARGEST_LOG_RATING`: no rating of the model is 0 or infinite."""
    return np.exp(np.clip(log_rating, -LARGEST_LOG_RATING, LARGEST_LOG_RATING))


def _spreads(parameters: RatingParameters) -> Spreads:
    return Spreads(parameters.tau, parameters.varsigma, parameters.omega)
