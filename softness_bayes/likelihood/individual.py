"""Magnitude estimates of raters with individual fingers, integrated over a grid of fingers (model.md 9).

Given the finger, a rater's log ratings follow the model of `magnitude`, with the response of that finger. The finger is
summed over a `FingerGrid`, and the rater's scale is integrated in closed form. All raters share mu; the product of
their densities is integrated over mu by the trapezoidal rule.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from softness_bayes.errors import InputError
from softness_bayes.likelihood.contract import Effects, Parameters
from softness_bayes.likelihood.design import Design, Stated
from softness_bayes.likelihood.individual_effects import IndividualEffects, own_drive
from softness_bayes.likelihood.magnitude import LogRatings, RatingModel
from softness_bayes.likelihood.mu_nodes import RaterLaw, about_mu, at_nodes, draw_index, log_prior, log_sum
from softness_bayes.likelihood.pieces import in_pieces
from softness_bayes.likelihood.plate import PressedRaters
from softness_bayes.likelihood.rater_sums import RaterSums
from softness_bayes.likelihood.ratings import OF_FORCES, SKIN
from softness_bayes.touch.finger_grid import EFFECT_OF, SPREAD_OF, FingerGrid, SkinLaws

FloatArray = NDArray[np.float64]

_LOG_TWO_PI = math.log(2.0 * math.pi)
_LEAST_VARIANCE = 1e-100


@dataclass(frozen=True)
class IndividualModel(RatingModel):
    """A `RatingModel` without deviations of fabrics, in which every rater has an individual finger.

    The response of finger j in condition c is in column (1 + j) conditions + c of the mean rates, after the columns of
    the typical finger, over which x is centred.

    Parameters
    ----------
    grid
        The fingers.
    """

    needs: ClassVar[tuple[str, ...]] = ("gamma", "tau", "varsigma", "eps", *SPREAD_OF.values(), *OF_FORCES)
    grid: FingerGrid = field(default_factory=lambda: FingerGrid({"b": 3}))

    def drive_at(
        self, elsewhere: FloatArray, design: Design, mean_rate: FloatArray, parameters: Parameters
    ) -> FloatArray:
        """As `RatingModel.drive_at`, centred over the typical finger's response."""
        return super().drive_at(elsewhere, design, mean_rate[..., : design.n_conditions], parameters)

    def draw_effects(
        self,
        rng: np.random.Generator,
        parameters: Parameters,
        shape: tuple[int, ...],
        n_participants: int,
        n_fabrics: int,
        levels: Mapping[str, ArrayLike] | None = None,
    ) -> Effects:
        """Effects of new raters of batch ``shape``, their fingers from the grid; mu from its prior unless given."""
        mu = self.draw_level(rng, shape, levels)
        return self._with_raters(rng, parameters, mu, (*shape, n_participants))

    def with_new_participants(self, rng: np.random.Generator, parameters: Parameters, effects: Effects) -> Effects:
        """Replace all raters' effects with those of new raters."""
        return self._with_raters(rng, parameters, effects.mu, effects.participant.shape)

    def for_others(
        self,
        rng: np.random.Generator,
        parameters: Parameters,
        effects: Effects,
        n_participants: int,
        fabric: NDArray[np.intp],
    ) -> Effects:
        """Effects of new raters with fingers from the grid, otherwise as given; fabrics have no effects."""
        return self._with_raters(rng, parameters, effects.mu, (*np.shape(effects.mu), n_participants))

    def _with_raters(
        self, rng: np.random.Generator, parameters: Parameters, mu: FloatArray, shape: tuple[int, ...]
    ) -> Effects:
        participant = np.asarray(parameters.tau, float)[..., None] * rng.standard_normal(shape)
        finger = rng.choice(self.grid.size, size=shape, p=np.exp(self.grid.log_weight))
        return IndividualEffects(mu, participant, finger, self.deviation(finger, parameters))

    def deviation(self, finger: NDArray[np.intp], parameters: Parameters) -> FloatArray:
        """Return the deviations of fingers of the grid from the typical one, shape (..., participants, quantities)."""
        spread = (np.asarray(getattr(parameters, SPREAD_OF[name]), float)[..., None] for name in self.grid.names)
        parts = [tau * self.grid.z[name][finger] for name, tau in zip(self.grid.names, spread, strict=True)]
        return np.stack(parts, axis=-1)

    def draw_ratings(
        self,
        rng: np.random.Generator,
        design: Design,
        drive: FloatArray,
        parameters: Parameters,
        effects: Effects,
    ) -> FloatArray:
        """One rating for every row of a design, shape (..., rows), given the effects and the `drive` of all fingers."""
        log_rating = effects.mu[..., None] + effects.participant[..., design.participant]
        log_rating = log_rating + own_drive(drive, design, effects.finger)
        return self.scatter(rng, log_rating, parameters)

    def named_effects(self, effects: Effects) -> Mapping[str, tuple[FloatArray, tuple[str, ...]]]:
        """Effects by their names in files, each with its axes after the batch axes."""
        own = {EFFECT_OF[name]: (effects.deviation[..., k], ("participant",)) for k, name in enumerate(self.grid.names)}
        return {"mu": (effects.mu, ()), "participant_effect": (effects.participant, ("participant",)), **own}

    def deviation_of_known(self, finger: NDArray[np.intp], known: SkinLaws, parameters: Parameters) -> FloatArray:
        """Return `deviation` for the people in `known`, whose grids are centred on the laws of their own fingers."""
        found, z = self.deviation(finger, parameters), self.grid.z
        nothing = np.zeros(self.grid.size)
        log_b, m = known.deviation(*(z.get(name, nothing)[finger] for name in SKIN))
        for name, own in zip(SKIN, (log_b, m), strict=True):
            if name in self.grid.names:
                found[..., self.grid.names.index(name)] = own
        return found

    def observe(self, ratings: ArrayLike, design: Design, stated: Stated | None = None) -> IndividualRatings:
        """Return the likelihood of these ratings under this model."""
        return IndividualRatings(ratings, design, self)


class IndividualRatings(LogRatings):
    """Positive ratings under an `IndividualModel`, with mu, raters' scales and raters' fingers integrated out.

    Parameters and errors are those of `LogRatings`; the columns of the mean rates are described in `IndividualModel`.
    They are followed, for each person in `pressed`, by the rates of a grid of that person's fingers
    (`FingerFamily.total_rate`).

    Parameters
    ----------
    pressed
        Raters with measured plate forces, given which the density of the ratings is computed.
    """

    model: IndividualModel

    def __init__(
        self,
        ratings: ArrayLike,
        design: Design,
        model: RatingModel,
        over: Design | None = None,
        pressed: PressedRaters | None = None,
    ) -> None:
        super().__init__(ratings, design, model, over)
        self.pressed = pressed
        self._block = np.zeros(design.n_participants, np.intp)
        if pressed is not None:
            among = pressed.rater >= 0
            self._block[pressed.rater[among]] = 1 + np.flatnonzero(among)
        self._centred = self._log - math.log(self.model.centre)
        self._own = RaterSums.of(design, self._centred)
        self._shares = self._own.shares
        self._alike = pressed is None and bool((self._own.cells == self._own.cells[:1]).all())

    @property
    def n_blocks(self) -> int:
        """Number of grids of fingers: the common one, and one for each person with plate forces."""
        return 1 if self.pressed is None else 1 + self.pressed.size

    @property
    def fabric_of_rate(self) -> NDArray[np.intp]:
        """Fabric of each column of the mean rates."""
        return np.tile(self.design.fabric, 1 + self.n_blocks * self.model.grid.size)

    def with_grid(self, grid: FingerGrid) -> IndividualRatings:
        """Return the likelihood of the same ratings over another grid of fingers."""
        model = IndividualModel(self.model.direction, self.model.centre, self.model.spread, grid)
        return type(self)(self.values, self.design, model, self._over, self.pressed)

    def with_pressed(self, pressed: PressedRaters | None) -> Self:
        """Return the likelihood of the same ratings given the plate forces of these people."""
        return type(self)(self.values, self.design, self.model, self._over, pressed)

    def of_strangers(self) -> Self:
        """Return the likelihood if nobody had plate forces, with the same columns of mean rates."""
        return self if self.pressed is None else self.with_pressed(self.pressed.as_strangers())

    def skins_of_pressed(self, parameters: Parameters) -> SkinLaws | None:
        """Return the laws of the raters' skins given their plate forces; None if there are none."""
        return None if self.pressed is None else self.pressed.skins(self.model.grid.names, parameters)

    def with_values(self, values: ArrayLike) -> Self:
        """Return the likelihood of other ratings of the same rows."""
        return type(self)(values, self.design, self.model, self._over, self.pressed)

    def without(self, rows: NDArray[np.bool_]) -> Self:
        """Return the likelihood of the other ratings, with x still centred over all rows."""
        return type(self)(self.values[~rows], self.design.without(rows), self.model, self._over, self.pressed)

    def log_likelihood(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Log density of all ratings together, shape (...); arguments as for `LogRatings.log_likelihood`."""
        law = self._raters_given(mean_rate, parameters)
        found = log_sum(self._at_mu(law), axis=-1) + law.constant.sum(axis=-1)
        return np.asarray(found - self._log.sum())

    def log_likelihood_participants(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Log density of each participant's ratings given those of all others, shape (draws, participants)."""

        def alone(mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
            law = self._raters_given(mean_rate, parameters)
            found = np.zeros((*law.centre.shape, self.design.n_participants))
            everyone = log_sum(self._at_mu(law), axis=-1)
            for k, rater in enumerate(self._own.participant):
                # nodes placed for the other raters: without this rater, mu may lie elsewhere
                term, gap, variance, constant = (np.delete(part, k, axis=-1) for part in law[:4])
                rest = self._placed(RaterLaw(term, gap, variance, constant, law.centre, law.step, alike=law.alike))
                others = log_sum(self._at_mu(rest), axis=-1)
                found[..., rater] = everyone + law.constant[..., k] - others
            return found - np.bincount(self.design.participant, self._log, self.design.n_participants)

        return in_pieces(alone, 3 * self._own.rows.size * self.model.grid.size, mean_rate, parameters)

    def log_likelihood_loo(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Log density of each rating given all the others, shape (..., rows)."""

        def alone(mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
            total, density = [], []
            for weight, score, sd in self._left_out(mean_rate, parameters):
                total.append(log_sum(weight, axis=-2))
                density.append(log_sum(weight - 0.5 * score**2, axis=-2) - np.log(sd))
            ratio = log_sum(np.array(density), axis=0) - log_sum(np.array(total), axis=0)
            return ratio - 0.5 * _LOG_TWO_PI - self._log

        return in_pieces(alone, self._loo_width, mean_rate, parameters)

    def below_loo(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Probability of a smaller rating than the observed one given all the others, shape (..., rows)."""

        def below(mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
            parts = [(weight, ndtr(score)) for weight, score, _ in self._left_out(mean_rate, parameters)]
            largest = np.max([weight.max(axis=-2) for weight, _ in parts], axis=0)[..., None, :]
            total = sum(np.exp(weight - largest).sum(axis=-2) for weight, _ in parts)
            return np.asarray(sum((np.exp(weight - largest) * share).sum(axis=-2) for weight, share in parts) / total)

        return in_pieces(below, self._loo_width, mean_rate, parameters)

    def predictor(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return log(N/N_ref + eps) of the typical finger, shape (..., conditions)."""
        return super().predictor(mean_rate[..., : self.design.n_conditions], parameters)

    def draw_effects(self, rng: np.random.Generator, mean_rate: FloatArray, parameters: Parameters) -> Effects:
        """Draws of mu, raters' fingers and scales given the ratings, one for each point of the batch.

        Fingers are drawn given a node of mu, then mu and the scales exactly given the fingers.
        """
        law = self._raters_given(mean_rate, parameters)
        shape, people = law.centre.shape, self.design.n_participants
        node = draw_index(rng, np.moveaxis(self._at_mu(law), -1, 0))
        mu = law.centre + (node - law.steps) * law.step
        term = law.log_term - 0.5 * (law.gap - mu[..., None, None]) ** 2 / law.variance[..., None, :]
        own = draw_index(rng, np.moveaxis(term, -2, 0))
        finger = rng.choice(self.model.grid.size, size=(*shape, people), p=np.exp(self.model.grid.log_weight))
        finger[..., self._own.participant] = own
        gap = np.take_along_axis(law.gap, own[..., None, :], axis=-2)[..., 0, :]
        precision = (1.0 / law.variance).sum(axis=-1) + self.model.spread**-2
        mu = (gap / law.variance).sum(axis=-1) / precision + rng.standard_normal(shape) / np.sqrt(precision)
        tau, noise = (np.asarray(v, float)[..., None] ** 2 for v in (parameters.tau, parameters.varsigma))
        participant = np.sqrt(tau) * rng.standard_normal((*shape, people))
        expected = tau * (gap - mu[..., None]) / law.variance
        width = np.sqrt(tau * noise / self._own.rows / law.variance)
        participant[..., self._own.participant] = expected + width * rng.standard_normal(expected.shape)
        deviation = self._deviation_of(finger, parameters)
        finger = finger + self._block * self.model.grid.size
        return IndividualEffects(mu + math.log(self.model.centre), participant, finger, deviation)

    def residual(self, mean_rate: FloatArray, parameters: Parameters, effects: Effects) -> FloatArray:
        """Return the residual of each log rating given the effects, shape (..., rows)."""
        own = own_drive(self.drive(mean_rate, parameters), self.design, effects.finger)
        expected = effects.mu[..., None] + own + effects.participant[..., self.design.participant]
        return self.model.error.normal_scores(self._log - expected, parameters)

    @property
    def _loo_width(self) -> int:
        return 20 * self.design.n_rows * self.model.grid.size

    def _deviation_of(self, finger: NDArray[np.intp], parameters: Parameters) -> FloatArray:
        """Return the deviations of each rater's finger in the grid of that rater, (..., participants, quantities)."""
        deviation, pressed = self.model.deviation(finger, parameters), self.pressed
        if pressed is None:
            return deviation
        # people who are not raters have index -1, the last column, which is dropped
        known = pressed.skins(self.model.grid.names, parameters)
        own = self.model.deviation_of_known(finger[..., pressed.rater], known, parameters)
        among = pressed.rater >= 0
        deviation[..., pressed.rater[among], :] = own[..., among, :]
        return deviation

    def _drives(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the drive of every finger in every condition, shape (..., grids, fingers, conditions)."""
        width, size = self.design.n_conditions, self.model.grid.size
        if mean_rate.shape[-1] != width * (1 + self.n_blocks * size):
            raise InputError(
                f"ratings: {mean_rate.shape[-1]} mean rates, expected those of {self.n_blocks * size} fingers and the "
                f"typical one in {width} conditions"
            )
        drive = self.drive(mean_rate, parameters)[..., width:]
        return drive.reshape(*drive.shape[:-1], -1, size, width)

    def _of_raters(self, values: FloatArray, weights: FloatArray, raters: NDArray[np.intp]) -> FloatArray:
        """Return weighted sums over conditions for each rater's grid of fingers, shape (..., fingers, raters).

        Parameters
        ----------
        values
            Values for each finger and condition, shape (..., grids, fingers, conditions).
        weights
            Weights of conditions for each rater, shape (raters, conditions).
        raters
            The raters, indices of participants.
        """
        found = values[..., 0, :, :] @ weights.T
        for k in np.flatnonzero(self._block[raters]):
            found[..., k] = values[..., self._block[raters[k]], :, :] @ weights[k]
        return found

    def _raters_given(self, mean_rate: FloatArray, parameters: Parameters) -> RaterLaw:
        drive = self._drives(mean_rate, parameters)
        row = np.maximum(np.asarray(parameters.varsigma, float) ** 2, _LEAST_VARIANCE)[..., None]
        tau = np.asarray(parameters.tau, float)[..., None] ** 2
        who = self._own.participant
        some = slice(1) if self._alike else slice(None)  # one rater stands for all
        mean = self._of_raters(drive, self._shares[some], who[some])
        sums = self._of_raters(drive, self._own.sums, who)
        own = self._of_raters(drive * drive, self._own.cells[some], who[some])
        squares = self._own.squares - 2.0 * sums + own - self._own.rows * mean**2
        log_term = self.model.grid.log_weight[:, None] - 0.5 * squares / row[..., None, :]
        variance = row / self._own.rows + tau
        determinant = (self._own.rows - 1.0) * np.log(row) + np.log(row + self._own.rows * tau)
        constant = -0.5 * (self._own.rows * _LOG_TWO_PI + determinant)
        shape = drive.shape[:-3]
        variance, constant = (np.broadcast_to(v, (*shape, self._own.rows.size)) for v in (variance, constant))
        gap, nothing = self._own.means - mean, np.zeros(shape)
        return self._placed(RaterLaw(log_term, gap, variance, constant, nothing, nothing, alike=self._alike))

    def _placed(self, law: RaterLaw) -> RaterLaw:
        """Return the law with the nodes of mu placed."""
        return about_mu(law, self.model.spread, self._own.rows.size)

    def _at_mu(self, law: RaterLaw) -> FloatArray:
        """Return the log of the joint density of mu and all ratings, times the node spacing, at the nodes of mu."""
        return log_prior(law, self.model.spread) + at_nodes(law).sum(axis=-1)

    def _left_out(
        self, mean_rate: FloatArray, parameters: Parameters
    ) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
        """Yield the predictive law of each row given all others, at one node of mu after another.

        Each item holds the log weight of each finger and the row's score under it, (..., fingers, rows), and the unit
        of the scores, (..., rows).
        """
        at, condition = self._own.of_row, self.design.condition
        block = self._block[self.design.participant]
        law = self._raters_given(mean_rate, parameters)
        drive = np.moveaxis(self._drives(mean_rate, parameters), -2, 0)[..., block, condition]
        drive = np.moveaxis(drive, 0, -2)  # of each row's rater, (..., fingers, rows)
        row = np.maximum(np.asarray(parameters.varsigma, float) ** 2, _LEAST_VARIANCE)[..., None]
        tau = np.asarray(parameters.tau, float)[..., None] ** 2
        log_raters = at_nodes(law)
        joint = log_prior(law, self.model.spread) + log_raters.sum(axis=-1)
        rest = joint[..., None] - log_raters[..., at]  # of the other raters, (..., nodes, rows)
        rows = self._own.rows[at]
        left = np.maximum(rows - 1.0, 1.0)
        # the rater's law without this row, finger by finger: (..., fingers, rows)
        within = self._own.deviation - drive + (self._own.means[at] - law.gap[..., at])
        gap = law.gap[..., at] - within / left
        term = law.log_term[..., at] + 0.5 * within**2 * (rows / left) / row[..., None, :]
        alone = rows == 1
        variance = row / left + tau
        gap = np.where(alone, 0.0, gap)
        term = np.where(alone, self.model.grid.log_weight[:, None], term)
        precision = np.where(alone, 0.0, 1.0 / variance)
        # the row given finger, mu and the rater's other rows
        shrunk = (tau * precision)[..., None, :]
        sd = np.sqrt(row + tau * (1.0 - tau * precision))[..., None, :]
        base = self._centred - drive - shrunk * gap
        for q in range(2 * law.steps + 1):
            mu = (law.centre + (q - law.steps) * law.step)[..., None, None]
            weight = rest[..., q, None, :] + term - 0.5 * (gap - mu) ** 2 * precision[..., None, :]
            yield weight, (base - mu * (1.0 - shrunk)) / sd, sd[..., 0, :]
