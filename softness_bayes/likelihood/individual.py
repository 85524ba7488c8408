"""Magnitude estimates of raters with individual fingers, integrated over a grid of fingers (model.md 9).

Given the finger, a rater's log ratings follow the model of `magnitude`, with the response of that finger. The finger is
summed over a `FingerGrid`, and the rater's scale is integrated in closed form. All raters share mu; the product of
their densities is integrated over mu by the trapezoidal rule.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import LOG_TWO_PI
from softness_bayes.likelihood.contract import Effects, Levels, Parameters, RowsLeftOut, Shape
from softness_bayes.likelihood.design import Design, FloatArray, IndexArray, Stated
from softness_bayes.likelihood.magnitude import LogRatings, RatingModel
from softness_bayes.likelihood.pieces import BLOCK, in_pieces, left_out_in_pieces, log_sum
from softness_bayes.likelihood.plate import OF_FORCES, SKIN, PressedRaters
from softness_bayes.likelihood.quadrature import LevelNodes
from softness_bayes.touch.finger_grid import EFFECT_OF, SPREAD_OF, FingerGrid

_LEAST_VARIANCE = 1e-20

MU_REACH, MU_STEP = 7.0, 0.9
"""Half-width of the nodes of mu about its mean, in standard deviations of mu, and their largest spacing, in standard
deviations of mu given the fingers."""
FEW_RATERS = 20.0
"""Additional half-width, to be divided by the number of raters: with few raters, the density of mu may not be normal,
and may shift if a row or a rater is left out."""
MOST_MU_STEPS = 64
"""Largest number of nodes of mu on either side of its mean."""


@dataclass(frozen=True)
class IndividualModel(RatingModel):
    """A `RatingModel` without deviations of fabrics, in which every rater has an individual finger.

    The response of finger j in condition c is in column (1 + j) conditions + c of the mean rates, after the columns of
    the typical finger, over which x is centred. Effects are mu (...), deviations of log ratings as `participant`
    (..., participants), each rater's `finger`, an index into `FingerGrid.z`, same shape, and its `deviation` from the
    typical one, shape (..., participants, quantities) as `FingerGrid.names`.

    Parameters
    ----------
    grid
        The fingers.
    """

    needs: ClassVar[tuple[str, ...]] = ("gamma", "tau", "varsigma", "eps", *SPREAD_OF.values(), *OF_FORCES)
    grid: FingerGrid = field(default_factory=lambda: FingerGrid({"b": 3}))

    def draw_effects(
        self, rng: Generator, parameters: Parameters, shape: Shape, people: int, fabrics: int, levels: Levels = None
    ) -> Effects:
        """Return effects of new raters of batch ``shape``, their fingers from the grid; fabrics have no effects."""
        participant = np.asarray(parameters.tau, float)[..., None] * rng.standard_normal((*shape, people))
        finger = rng.choice(self.grid.size, size=participant.shape, p=np.exp(self.grid.log_weight))
        mu, deviation = self.draw_level(rng, shape, levels), self.deviation(finger, parameters)
        return Effects(mu=mu, participant=participant, finger=finger, deviation=deviation)

    def felt(self, design: Design, drive: FloatArray, effects: Effects) -> FloatArray:
        """Return the drive of every row on its rater's finger, from that of all fingers, shape (..., rows)."""
        column = (1 + effects.finger[..., design.participant]) * design.n_conditions + design.condition
        shape = np.broadcast_shapes(drive.shape[:-1], column.shape[:-1])
        drive, column = (np.broadcast_to(v, (*shape, v.shape[-1])) for v in (drive, column))
        return np.take_along_axis(drive, column, axis=-1)

    def deviation(self, finger: NDArray[np.intp], parameters: Parameters) -> FloatArray:
        """Return the deviations of fingers of the grid from the typical one, shape (..., participants, quantities)."""
        spread = (np.asarray(getattr(parameters, SPREAD_OF[name]), float)[..., None] for name in self.grid.names)
        parts = [tau * self.grid.z[name][finger] for name, tau in zip(self.grid.names, spread, strict=True)]
        return np.stack(parts, axis=-1)

    def named_effects(self, effects: Effects) -> Mapping[str, tuple[FloatArray, tuple[str, ...]]]:
        """Return effects by their names in files, each with its axes after the batch axes."""
        own = {EFFECT_OF[name]: (effects.deviation[..., k], ("participant",)) for k, name in enumerate(self.grid.names)}
        return {"mu": (effects.mu, ()), "participant_effect": (effects.participant, ("participant",)), **own}

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
        every = design.cells.sum(axis=1)
        self._present = np.flatnonzero(every)
        """Participants with ratings: the axis "raters" of arrays below."""
        self._of_row = np.searchsorted(self._present, design.participant)
        self._count, self._cells = every[self._present], design.cells[self._present]
        self._means = np.bincount(self._of_row, self._centred) / self._count
        self._apart = self._centred - self._means[self._of_row]
        self._squares = np.bincount(self._of_row, self._apart**2)
        self._sums = np.zeros_like(self._cells)  # of these deviations in each condition
        np.add.at(self._sums, (self._of_row, design.condition), self._apart)

    @property
    def n_blocks(self) -> int:
        """Number of grids of fingers: the common one, and one for each person with plate forces."""
        return 1 if self.pressed is None else 1 + self.pressed.size

    @property
    def condition_of_rate(self) -> IndexArray:
        """Condition of each column of the mean rates."""
        return np.tile(super().condition_of_rate, 1 + self.n_blocks * self.model.grid.size)

    def with_grid(self, grid: FingerGrid) -> IndividualRatings:
        """Return the likelihood of the same ratings over another grid of fingers."""
        model = IndividualModel(self.model.direction, self.model.centre, self.model.spread, grid)
        return type(self)(self.values, self.design, model, self._over, self.pressed)

    def _arguments(self, rows: NDArray[np.bool_] | None = None) -> dict[str, Any]:
        """Return the people with plate forces."""
        return {"pressed": self.pressed}

    def with_pressed(self, pressed: PressedRaters | None) -> Self:
        """Return the likelihood of the same ratings given the plate forces of these people."""
        return type(self)(self.values, self.design, self.model, self._over, pressed)

    def log_likelihood(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log density of all ratings together, shape (...)."""

        def whole(mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
            levels = self._levels(self._raters_given(mean_rate, parameters))
            return levels.log_density[..., None]

        width = 2 * math.ceil(MU_REACH / MU_STEP) * self.model.grid.size * self._count.size
        return in_pieces(whole, width, mean_rate, parameters, BLOCK)[..., 0] - self._log.sum()

    def log_likelihood_participants(self, mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
        """Return the log density of each participant's ratings given all others', shape (..., participants)."""

        def alone(mean_rate: FloatArray, parameters: Parameters) -> FloatArray:
            levels = self._levels(self._raters_given(mean_rate, parameters), without_one=True)
            found = np.zeros((*levels.mu.shape[:-1], self.design.n_participants))
            found[..., self._present] = levels.given_others
            return found - np.bincount(self.design.participant, self._log, self.design.n_participants)

        return in_pieces(alone, 40 * self._count.size * self.model.grid.size, mean_rate, parameters)

    def left_out(self, mean_rate: FloatArray, parameters: Parameters) -> RowsLeftOut:
        """Return the law of each rating given all the others at its observation, arrays of shape (..., rows)."""
        width = 20 * self.design.n_rows * self.model.grid.size
        return left_out_in_pieces(self._left_out, width, mean_rate, parameters)

    def draw_effects(self, rng: Generator, mean_rate: FloatArray, parameters: Parameters) -> Effects:
        """Return draws of mu, raters' fingers and scales given the ratings, one for each point of the batch.

        Fingers are drawn given a node of mu, then mu and the scales exactly given the fingers.
        """
        law = self._raters_given(mean_rate, parameters)
        levels = self._levels(law)
        shape, people = levels.mu.shape[:-1], self.design.n_participants
        node = (levels.joint + rng.gumbel(size=levels.joint.shape)).argmax(axis=-1)
        mu = np.take_along_axis(levels.mu, node[..., None], axis=-1)[..., None]
        term = law.log_term - 0.5 * (law.gap - mu) ** 2 / law.variance[..., None, :]
        own = (term + rng.gumbel(size=term.shape)).argmax(axis=-2)
        finger = rng.choice(self.model.grid.size, size=(*shape, people), p=np.exp(self.model.grid.log_weight))
        finger[..., self._present] = own
        gap = np.take_along_axis(law.gap, own[..., None, :], axis=-2)[..., 0, :]
        precision = (1.0 / law.variance).sum(axis=-1) + self.model.spread**-2
        mu = (gap / law.variance).sum(axis=-1) / precision + rng.standard_normal(shape) / np.sqrt(precision)
        tau, noise = (np.asarray(v, float)[..., None] ** 2 for v in (parameters.tau, parameters.varsigma))
        participant = np.sqrt(tau) * rng.standard_normal((*shape, people))
        expected = tau * (gap - mu[..., None]) / law.variance
        width = np.sqrt(tau * noise / self._count / law.variance)
        participant[..., self._present] = expected + width * rng.standard_normal(expected.shape)
        deviation = self._deviation_of(finger, parameters)
        finger = finger + self._block * self.model.grid.size
        mu = mu + math.log(self.model.centre)
        return Effects(mu=mu, participant=participant, finger=finger, deviation=deviation)

    def _deviation_of(self, finger: NDArray[np.intp], parameters: Parameters) -> FloatArray:
        """Return the deviations of each rater's finger in the grid of that rater, (..., participants, quantities)."""
        deviation, pressed = self.model.deviation(finger, parameters), self.pressed
        if pressed is None:
            return deviation
        # people who are not raters have index -1, the last column, which is dropped; grids are centred on own fingers
        grid, among = self.model.grid, pressed.rater >= 0
        own, nothing = finger[..., pressed.rater], np.zeros(grid.size)
        known = pressed.skins(grid.names, parameters).deviation(*(grid.z.get(name, nothing)[own] for name in SKIN))
        for name, values in zip(SKIN, known, strict=True):
            if name in grid.names:
                deviation[..., pressed.rater[among], grid.names.index(name)] = values[..., among]
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

    def _of_raters(self, values: FloatArray, weights: FloatArray) -> FloatArray:
        """Return weighted sums over conditions for each rater's grid of fingers, shape (..., fingers, raters).

        Parameters
        ----------
        values
            Values for each finger and condition, shape (..., grids, fingers, conditions).
        weights
            Weights of conditions for each rater, shape (raters, conditions).
        """
        found = values[..., 0, :, :] @ weights.T
        block = self._block[self._present]
        for k in np.flatnonzero(block):
            found[..., k] = values[..., block[k], :, :] @ weights[k]
        return found

    def _raters_given(self, mean_rate: FloatArray, parameters: Parameters) -> RaterLaw:
        drive, count = self._drives(mean_rate, parameters), self._count
        row, tau = _variances(parameters)
        mean = self._of_raters(drive, self._cells / count[:, None])
        own = self._of_raters(drive * drive, self._cells) - count * mean**2
        squares = self._squares - 2.0 * self._of_raters(drive, self._sums) + own
        constant = count * LOG_TWO_PI + (count - 1.0) * np.log(row) + np.log(row + count * tau)
        log_term = self.model.grid.log_weight[:, None] - 0.5 * (squares / row[..., None, :] + constant[..., None, :])
        variance = np.broadcast_to(row / count + tau, (*drive.shape[:-3], count.size))
        return RaterLaw(log_term, self._means - mean, variance)

    def _levels(self, law: RaterLaw, without_one: bool = False) -> LevelNodes:
        """Return the raters' densities at nodes of mu, placed as if each of them were normal in mu.

        If `without_one`, the nodes also reach where mu lies without any one of the raters.
        """
        variance, spread = law.variance, self.model.spread
        share = np.exp(law.log_term - law.log_term.max(axis=-2, keepdims=True))
        share /= share.sum(axis=-2, keepdims=True)
        mean = (share * law.gap).sum(axis=-2)
        wider = variance + (share * (law.gap - mean[..., None, :]) ** 2).sum(axis=-2)
        precision = spread**-2 + (1.0 / wider).sum(axis=-1)
        narrow = spread**-2 + (1.0 / variance).sum(axis=-1)
        centre = ((mean / wider).sum(axis=-1) / precision)[..., None]
        reach = MU_REACH + FEW_RATERS / self._count.size
        if without_one:
            rest = precision[..., None] - 1.0 / wider
            reach += float((np.abs(mean - centre) / wider / rest * np.sqrt(precision)[..., None]).max())
        steps = min(math.ceil(float(np.sqrt(narrow / precision).max()) * reach / MU_STEP), MOST_MU_STEPS)
        offset = np.arange(-steps, steps + 1) * (reach / steps * precision**-0.5)[..., None]
        # the exponent of a finger is quadratic in mu, and its square is common to all fingers
        slope = (law.gap - centre[..., None]) / variance[..., None, :]
        at_centre = law.log_term - 0.5 * slope**2 * variance[..., None, :]
        lines = np.stack([at_centre, slope], axis=-3)  # as functions of the offset, (..., 2, fingers, raters)
        nodes = np.stack([np.ones_like(offset), offset], axis=-1)
        fingers = nodes @ lines.reshape(*lines.shape[:-2], -1)
        fingers = fingers.reshape(*offset.shape, *slope.shape[-2:])
        of_raters = log_sum(fingers, axis=-2) - 0.5 * offset[..., None] ** 2 / variance[..., None, :]
        return LevelNodes.of(centre + offset, np.swapaxes(of_raters, -1, -2), 0.0, spread)

    def _left_out(self, mean_rate: FloatArray, parameters: Parameters) -> RowsLeftOut:
        """Return the law of each row given all others: a mixture of normal laws over mu and fingers."""
        at, condition = self._of_row, self.design.condition
        block = self._block[self.design.participant]
        law = self._raters_given(mean_rate, parameters)
        levels = self._levels(law)
        drive = np.moveaxis(self._drives(mean_rate, parameters), -2, 0)[..., block, condition]
        drive = np.moveaxis(drive, 0, -2)  # of each row's rater, (..., fingers, rows)
        row, tau = _variances(parameters)
        rest = np.swapaxes(levels.without_one, -1, -2)[..., at]  # of the other raters, (..., nodes, rows)
        rows = self._count[at]
        left = np.maximum(rows - 1.0, 1.0)
        # the rater's law without this row, finger by finger: (..., fingers, rows)
        within = self._apart - drive + (self._means[at] - law.gap[..., at])
        gap = law.gap[..., at] - within / left
        term = law.log_term[..., at] + 0.5 * within**2 * (rows / left) / row[..., None, :]
        alone = rows == 1
        gap = np.where(alone, 0.0, gap)
        term = np.where(alone, self.model.grid.log_weight[:, None], term)
        precision = np.where(alone, 0.0, 1.0 / (row / left + tau))
        # the row given finger, mu and the rater's other rows
        shrunk = tau * precision
        sd = np.sqrt(row + tau * (1.0 - shrunk))
        mu = levels.mu[..., None, None]
        apart = (gap[..., None, :, :] - mu) ** 2 * precision[..., None, None, :]
        weight = rest[..., None, :] + (term[..., None, :, :] - 0.5 * apart)
        base = self._centred - drive - shrunk[..., None, :] * gap
        score = (base[..., None, :, :] - mu * (1.0 - shrunk[..., None, None, :])) / sd[..., None, None, :]
        weight, score = (part.reshape(*part.shape[:-3], -1, part.shape[-1]) for part in (weight, score))
        weight = weight - log_sum(weight, axis=-2)[..., None, :]
        density = log_sum(weight - 0.5 * score**2, axis=-2) - np.log(sd) - 0.5 * LOG_TWO_PI - self._log
        return RowsLeftOut(density, (np.exp(weight) * ndtr(score)).sum(axis=-2))


class RaterLaw(NamedTuple):
    """Densities of raters with ratings given mu: sums over fingers of exponentials of quadratic functions of mu."""

    log_term: FloatArray  # of each finger, without mu, (..., fingers, raters)
    gap: FloatArray  # mean log rating minus the finger's mean drive and the prior mean of mu, same shape
    variance: FloatArray  # of that gap, (..., raters)


def _variances(parameters: Parameters) -> tuple[FloatArray, FloatArray]:
    """Return the variances of a log rating's error and of raters' scales, each (..., 1)."""
    row, tau = (np.asarray(value, float)[..., None] ** 2 for value in (parameters.varsigma, parameters.tau))
    return np.maximum(row, _LEAST_VARIANCE), tau
