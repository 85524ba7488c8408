"""A normal vector with a common mean and random effects of participants and fabrics, all integrated out.

y_i = v_c(i) + mu + s_p(i) + f_k(i) + e_i with mu ~ N(mean, sd²), s ~ N(0, tau²), f ~ N(0, omega²) and
e ~ N(0, varsigma²); c, p and k are the condition, participant and fabric of row i. Every quantity follows from counts
and means over the rows, computed once, so that the cost of one evaluation does not depend on the number of rows. Sums
of squares are computed without cancellation.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.effects import Effects
from softness_bayes.likelihood.pieces import part_of, pieces
from softness_bayes.likelihood.within import Dense, within_of

FloatArray = NDArray[np.float64]

_LEAST_VARIANCE = 1e-100  # far below any spread of ratings, but its inverse square is still finite


class EffectSpreads(NamedTuple):
    """Standard deviations, each a number or an array of the batch shape (...)."""

    participant: ArrayLike
    """tau."""
    row: ArrayLike
    """varsigma."""
    fabric: ArrayLike
    """omega."""


class LeaveOneOut(NamedTuple):
    """Normal law of each row given all the others; arrays of shape (..., rows)."""

    mean: FloatArray
    sd: FloatArray


class _Levels(NamedTuple):
    """Precisions of participants' means given tau and varsigma."""

    precision: FloatArray  # of each participant's mean without mu, (..., participants), or of groups of like ones
    total: FloatArray  # their sum W over the participants, (...)
    shrinkage: FloatArray  # 1 / (1 + sd² W), (...)


class _Alike(NamedTuple):
    """Participants with the same numbers of rows in all conditions, one group for each pattern."""

    rows: FloatArray  # of each participant, (groups,)
    number: FloatArray  # of participants, (groups,)
    shares: FloatArray  # of the conditions in the rows, (groups, conditions)
    mean: FloatArray  # of the participants' means less the prior's, (groups,)
    squares: FloatArray  # sum of the squared deviations of their means from it, (groups,)


class RandomEffects:
    """The law of the rows with all effects integrated out.

    Parameters
    ----------
    design
        Condition and participant of every row.
    values
        y of every row, shape (rows,).
    mean, sd
        Prior of the common mean mu.
    """

    def __init__(self, design: Design, values: FloatArray, mean: float, sd: float) -> None:
        self.design, self.mean, self.sd = design, mean, sd
        self._values = np.array(values, dtype=float)
        cells, rows = design.cells, design.cells.sum(axis=1)
        self._rows = rows
        self._shares = cells / np.maximum(rows, 1.0)[:, None]
        self._means = np.bincount(design.participant, self._values, rows.size) / np.maximum(rows, 1.0)
        self._deviation = self._values - self._means[design.participant]
        self._within = within_of(design, self._deviation)

    @cached_property
    def _alike(self) -> _Alike:
        """Participants whose means have the same law."""
        _, first, group = np.unique(self.design.cells, axis=0, return_index=True, return_inverse=True)
        group, centred = group.reshape(-1), np.where(self._rows > 0, self._means - self.mean, 0.0)
        number = np.bincount(group).astype(float)
        mean = np.bincount(group, centred) / number
        squares = np.bincount(group, (centred - mean[group]) ** 2).astype(float)
        return _Alike(self._rows[first], number, self._shares[first], mean, squares)

    @cached_property
    def _dense(self) -> Dense:
        """The sum of squares within participants by its factor, which effects of fabrics need."""
        return self._within if isinstance(self._within, Dense) else Dense(self.design, self._deviation)

    @cached_property
    def _fabrics(self) -> FloatArray:
        """Indicator of the fabrics, shape (conditions, fabrics)."""
        return np.eye(self.design.n_fabrics)[self.design.fabric]

    @cached_property
    def _fabric_shares(self) -> FloatArray:
        return self._shares @ self._fabrics

    @cached_property
    def _fabric_factors(self) -> tuple[FloatArray, FloatArray]:
        """Basis and triangular factor of the fabrics' part of the sum of squares."""
        basis, root = np.linalg.qr(self._dense.factor.T @ self._fabrics)
        return basis, root

    @property
    def width(self) -> int:
        """Numbers that `leave_one_out` holds for each draw."""
        return self.design.n_rows + self.design.n_participants * self.design.n_fabrics**2

    def log_density(self, offset: FloatArray, spreads: EffectSpreads) -> FloatArray:
        """Return the log density of the rows.

        Parameters
        ----------
        offset
            v of each condition, shape (..., conditions).
        spreads
            Standard deviations of batch shape (...).

        Returns
        -------
        ndarray, shape (...)
        """
        alike, variance = self._alike, _variance(spreads.row)
        of_sum = variance[..., None] + alike.rows * _column(spreads.participant) ** 2
        precision = alike.rows / of_sum
        total = precision @ alike.number
        shrinkage = 1.0 / (1.0 + self.sd**2 * total)
        log_determinant = (
            (self.design.n_rows - self._rows.size) * np.log(variance)
            + np.log(of_sum) @ alike.number
            - np.log(shrinkage)
        )
        penalty: FloatArray | float = 0.0
        omega = np.asarray(spreads.fabric, float)
        if (omega > 0).any():
            root, likely = self._fabric_posterior(offset, spreads, self._levels(spreads))
            diagonal = np.abs(np.diagonal(root, axis1=-2, axis2=-1))
            log_determinant = log_determinant + 2.0 * np.log(diagonal).sum(axis=-1)
            # at the most probable effects the quadratic form is a sum of squares, so errors enter only squared
            penalty = (likely**2).sum(axis=-1)
            offset = offset + (omega[..., None] * likely)[..., self.design.fabric]
        quadratic = self._quadratic(offset, _Levels(precision, total, shrinkage), variance) + penalty
        return -0.5 * (self.design.n_rows * math.log(2.0 * math.pi) + log_determinant + quadratic)

    def draw_effects(self, rng: np.random.Generator, offset: FloatArray, spreads: EffectSpreads) -> Effects:
        """Return exact draws of the effects given the rows: fabrics, then mu, then participants.

        Arguments as in `log_density`; one draw for each point of the batch.
        """
        offset, *broadcast = _broadcast(offset, spreads)
        shape, people = offset.shape[:-1], self.design.n_participants
        offset, spreads = offset.reshape(-1, offset.shape[-1]), EffectSpreads(*(np.ravel(s) for s in broadcast))
        parts = pieces(len(offset), people * self.design.n_fabrics)
        fabric, participant = np.zeros((len(offset), self.design.n_fabrics)), np.empty((len(offset), people))
        mu = np.empty(len(offset))
        if np.any(np.asarray(spreads.fabric) > 0):
            for k in parts:
                few = part_of(spreads, k)
                root, likely = self._fabric_posterior(offset[k], few, self._levels(few))
                noise = np.asarray(rng.standard_normal(likely.shape))[..., None]
                fabric[k] = _column(few.fabric) * (likely + np.linalg.solve(root, noise)[..., 0])
            offset = offset + fabric[:, self.design.fabric]
        for k in parts:
            levels = self._levels(part_of(spreads, k))
            spread = self.sd * np.sqrt(levels.shrinkage)
            pull = spread**2 * (levels.precision * self._residual_means(offset[k])).sum(axis=-1)
            mu[k] = pull + spread * rng.standard_normal(pull.shape)
        for k in parts:
            few = part_of(spreads, k)
            variance, tau_squared = _variance(few.row)[..., None], _column(few.participant) ** 2
            total = variance + self._rows * tau_squared
            expected = tau_squared * self._rows * (self._residual_means(offset[k]) - mu[k, None]) / total
            noise = rng.standard_normal(expected.shape)
            participant[k] = expected + np.sqrt(tau_squared * variance / total) * noise
        return Effects(*(v.reshape((*shape, *v.shape[1:])) for v in (self.mean + mu, participant, fabric)))

    def leave_one_out(self, offset: FloatArray, spreads: EffectSpreads) -> LeaveOneOut:
        """Return the law of each row given all the others, N(y_i - (K r)_i / K_ii, 1 / K_ii).

        K is the inverse covariance of the rows and r their residual. Arguments as in `log_density`;
        memory grows with batch × rows, and with batch × participants × fabrics² if omega is not 0.
        """
        offset, *broadcast = _broadcast(offset, spreads)
        spreads = EffectSpreads(*broadcast)
        levels, variance = self._levels(spreads), _variance(spreads.row)[..., None]
        person, fabric = self.design.participant, self.design.fabric[self.design.condition]
        rows, precision = np.maximum(self._rows, 1.0), levels.precision
        prior = self.sd**-2
        others = prior + levels.total[..., None] - precision
        diagonal = (1.0 - 1.0 / rows) / variance
        diagonal = diagonal + precision / rows**2 * others / (prior + levels.total[..., None])
        diagonal = np.repeat(diagonal[..., None], self.design.n_fabrics, axis=-1)
        if np.any(np.asarray(spreads.fabric) > 0):
            omega = _column(spreads.fabric)
            root, likely = self._fabric_posterior(offset, spreads, levels)
            reach = self._fabric_reach(levels, variance[..., 0])
            flat = reach.reshape(*reach.shape[:-3], -1, reach.shape[-1])
            solved = np.linalg.solve(np.swapaxes(root, -1, -2), np.swapaxes(flat, -1, -2))
            loss = (omega[..., None] * solved) ** 2
            diagonal = diagonal - loss.sum(axis=-2).reshape(diagonal.shape)
            offset = offset + (omega * likely)[..., self.design.fabric]
        means = self._residual_means(offset)
        mu = self.sd**2 * levels.shrinkage * (precision * means).sum(axis=-1)
        # K r = (residual at the most probable effects) / varsigma²: within, then between participants
        within = self._values - self._means[person] - offset[..., self.design.condition]
        within = within + (offset @ self._shares.T)[..., person]
        between = (precision / rows) * (means - mu[..., None])
        weighted = within / variance + between[..., person]
        precision_of_row = diagonal[..., person, fabric]
        return LeaveOneOut(self._values - weighted / precision_of_row, precision_of_row**-0.5)

    def _levels(self, spreads: EffectSpreads) -> _Levels:
        variance = _variance(spreads.row)[..., None]
        precision = self._rows / (variance + self._rows * _column(spreads.participant) ** 2)
        total = precision.sum(axis=-1)
        return _Levels(precision, total, 1.0 / (1.0 + self.sd**2 * total))

    def _residual_means(self, offset: FloatArray) -> FloatArray:
        present = self._rows > 0
        return np.where(present, self._means - self.mean, 0.0) - offset @ self._shares.T

    def _quadratic(self, offset: FloatArray, levels: _Levels, variance: FloatArray) -> FloatArray:
        """Return the quadratic form without effects of fabrics; the levels are of the groups of like participants."""
        alike = self._alike
        means = alike.mean - offset @ alike.shares.T
        centre = (levels.precision * means) @ alike.number / levels.total
        squares = alike.number * (means - centre[..., None]) ** 2 + alike.squares
        between = (levels.precision * squares).sum(axis=-1) + centre**2 * levels.total * levels.shrinkage
        return self._within.squares(offset) / variance + between

    def _fabric_posterior(
        self, offset: FloatArray, spreads: EffectSpreads, levels: _Levels
    ) -> tuple[FloatArray, FloatArray]:
        """Triangular R with R'R = I + omega² F' K F, and g, omega g being the most probable fabric effects.

        F is the fabrics' indicator and K the inverse covariance without them. A least-squares problem in
        g, |g|² + |omega B g - d|², solved by QR: R'R itself would lose positive definiteness to rounding.
        """
        fabric_basis, fabric_root = self._fabric_factors
        omega = np.asarray(spreads.fabric, float)[..., None]
        error = np.sqrt(_variance(spreads.row))[..., None]
        within = (self._dense.target - offset @ self._dense.factor) @ fabric_basis / error
        between = self._whiten(self._residual_means(offset), levels)
        batch = np.broadcast_shapes(omega.shape[:-1], within.shape[:-1], between.shape[:-1])
        blocks = (
            np.eye(self.design.n_fabrics),
            (omega / error)[..., None] * fabric_root,
            omega[..., None] * np.swapaxes(self._whiten(self._fabric_shares.T, levels, extra=1), -1, -2),
        )
        stacked = np.concatenate([np.broadcast_to(b, (*batch, *b.shape[-2:])) for b in blocks], axis=-2)
        basis, root = np.linalg.qr(stacked)
        aims = (np.zeros(self.design.n_fabrics), within, between)
        aim = np.concatenate([np.broadcast_to(a, (*batch, a.shape[-1])) for a in aims], axis=-1)
        projected = np.swapaxes(basis, -1, -2) @ aim[..., None]
        return root, np.linalg.solve(root, projected)[..., 0]

    def _whiten(self, values: FloatArray, levels: _Levels, extra: int = 0) -> FloatArray:
        """Scale participants' values (..., participants) so that their squares sum to the quadratic form."""
        axes = (..., *[None] * extra, slice(None))
        root = np.sqrt(levels.precision)[axes]
        scaled = root * values
        unit = root / np.sqrt(levels.total)[(..., *[None] * (extra + 1))]
        lost = 1.0 - np.sqrt(levels.shrinkage)[(..., *[None] * (extra + 1))]
        return scaled - lost * unit * (unit * scaled).sum(axis=-1, keepdims=True)

    def _fabric_reach(self, levels: _Levels, variance: FloatArray) -> FloatArray:
        """Rows of K F, which depend only on participant and fabric: (..., participants, fabrics, fabrics)."""
        shares, each = self._fabric_shares, levels.precision / np.maximum(self._rows, 1.0)
        common = self.sd**2 * levels.shrinkage
        drawn = common[..., None] * (levels.precision @ shares)
        own = (np.eye(self.design.n_fabrics) - shares[:, None, :]) / variance[..., None, None, None]
        return own + (each[..., None] * (shares - drawn[..., None, :]))[..., None, :]


def _column(values: ArrayLike) -> FloatArray:
    return np.asarray(values, float)[..., None]


def _variance(sd: ArrayLike) -> FloatArray:
    return np.maximum(np.asarray(sd, float) ** 2, _LEAST_VARIANCE)


def _broadcast(offset: FloatArray, spreads: EffectSpreads) -> list[FloatArray]:
    """The arguments broadcast to a common batch shape, so that every point gets independent draws."""
    shape = np.broadcast_shapes(offset.shape[:-1], *(np.shape(s) for s in spreads))
    batch = [np.broadcast_to(np.asarray(s, float), shape) for s in spreads]
    return [np.broadcast_to(offset, (*shape, offset.shape[-1])), *batch]
