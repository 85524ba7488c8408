"""The law of `random_effects.RandomEffects` for errors with unequal variances.

y_i = v_c(i) + mu + s_p(i) + f_k(i) + e_i with e ~ N(0, variance_c(i)); the other effects are as defined there.
Participants are independent given mu and the effects of fabrics, and the rows of each enter through their
precision-weighted mean and their deviations from it. Sums of squares are computed without cancellation; the cost of an
evaluation grows with the number of pairs of participant and condition.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.effects import Effects
from softness_bayes.likelihood.left_out import given_the_others, summing
from softness_bayes.likelihood.pieces import part_of, pieces
from softness_bayes.likelihood.random_effects import EffectSpreads, LeaveOneOut

Array = NDArray[np.float64]

_LOG_TWO_PI = math.log(2.0 * math.pi)
_REFINED = 3  # Newton steps: the first is exact up to rounding errors, which the others remove
_LEAST_VARIANCE = 1e-100


class EffectLaw(NamedTuple):
    """Expectations, error variances and spreads of effects, each of batch shape (...)."""

    offset: Array
    """v of each condition, shape (..., conditions)."""
    variance: Array
    """Variance of a row's error in each condition, shape (..., conditions)."""
    participant: Array
    """tau, shape (...)."""
    fabric: Array
    """omega, shape (...)."""


class _Weights(NamedTuple):
    """Precisions, for a flat batch of B draws."""

    single: Array  # of a row of each pair, (B, pairs)
    pair: Array  # of the rows of each pair together, (B, pairs)
    person: Array  # of each participant's mean given mu and the participant's effect, (B, people)
    kept: Array  # 1 / (1 + tau² person), (B, people)
    precision: Array  # of each participant's mean given mu alone, (B, people)
    total: Array  # sum of these, (B,)
    shrinkage: Array  # 1 / (1 + sd² total), (B,)


class _Fit(NamedTuple):
    """Residuals at some effects of fabrics."""

    mean: Array  # weighted mean of each participant, (B, people)
    within: Array  # deviation of each pair from it, (B, pairs)
    mu: Array  # most probable mu, (B,)


class _Fabrics(NamedTuple):
    """The law of g (omega g are the effects of fabrics): most probable values, and eigenvectors of the precision."""

    likely: Array  # (B, fabrics)
    root: Array  # V / sqrt(eigenvalues), (B, fabrics, fabrics)
    log_determinant: Array  # (B,)
    share: Array  # of each fabric in a participant's precision, (B, people, fabrics)


class WeightedEffects:
    """The law of the rows with all effects integrated out.

    Parameters
    ----------
    design
        Condition and participant of every row; rows of one condition share their expectation and variance.
    values
        y of every row, shape (rows,).
    mean, sd
        Prior of the common mean mu.
    n_fabrics
        Number of fabrics; those without a condition are allowed.
    """

    def __init__(self, design: Design, values: Array, mean: float, sd: float, n_fabrics: int) -> None:
        self.mean, self.sd, self.n_rows, self.n_fabrics = mean, sd, design.n_rows, n_fabrics
        self.n_participants = design.n_participants
        pairs, self._pair_of_row = np.unique(
            design.participant * design.n_conditions + design.condition, return_inverse=True
        )
        who, self._condition = np.divmod(pairs, design.n_conditions)
        self._present, self._first, self._person = np.unique(who, return_index=True, return_inverse=True)
        self._count = np.bincount(self._pair_of_row).astype(float)
        values = np.asarray(values, dtype=float) - mean
        self._average = np.bincount(self._pair_of_row, values) / self._count
        self._apart = values - self._average[self._pair_of_row]
        self._scatter = np.bincount(self._pair_of_row, self._apart**2)
        fabric = design.fabric[self._condition]
        self._member = np.eye(n_fabrics)[fabric]
        self._kind = summing(self._person * n_fabrics + fabric, self._present.size * n_fabrics)

    @property
    def width(self) -> int:
        """Numbers kept in memory for each draw."""
        return self.n_rows + self._present.size * self.n_fabrics**2

    def log_density(self, law: EffectLaw) -> Array:
        """Return the log density of the rows, shape (...)."""
        shape, flat = _flat(law)
        found = np.empty(len(flat.offset))
        for k in pieces(found.size, self.width if (flat.fabric > 0).any() else self._count.size):
            found[k] = self._log_density(part_of(flat, k))
        return found.reshape(shape)

    def log_density_participants(self, law: EffectLaw) -> Array:
        """Return the log density of all rows of each participant given those of all others, (..., participants)."""
        shape, flat = _flat(law)
        found = np.zeros((len(flat.offset), self.n_participants))
        for k in pieces(len(found), self.width):
            found[k, self._present] = self._given_the_others(part_of(flat, k))
        return found.reshape(*shape, -1)

    def leave_one_out(self, law: EffectLaw) -> LeaveOneOut:
        """Return the law of each row given all the others; memory grows with batch × rows."""
        shape, flat = _flat(law)
        weights, person = self._weights(flat), self._person
        s_squared, single = self.sd**2, weights.single
        others = weights.person[:, person] - single
        tau_squared = flat.participant[:, None] ** 2
        elsewhere = weights.total[:, None] - weights.precision[:, person]
        # K_ii without fabrics: a sum of positive terms, so there is no cancellation
        diagonal = (1.0 + others * tau_squared) * (1.0 + s_squared * elsewhere) + s_squared * others
        diagonal *= single * (weights.kept[:, person] * weights.shrinkage[:, None])
        likely = None
        if (flat.fabric > 0).any():
            fabrics = self._fabrics(flat, weights)
            likely = fabrics.likely
            reach = self._reach(weights, fabrics.share) @ (flat.fabric[:, None, None] * fabrics.root)
            diagonal = diagonal - (reach**2).sum(axis=-1)
        fit = self._fit(flat, weights, likely)
        between = weights.kept * (fit.mean - fit.mu[:, None])
        row = self._pair_of_row
        weighted = single[:, row] * (self._apart + (fit.within + between[:, person])[:, row])
        precision = diagonal[:, row]
        values = self.mean + self._average[row] + self._apart
        mean = values - weighted / precision
        return LeaveOneOut(mean.reshape(*shape, -1), (precision**-0.5).reshape(*shape, -1))

    def draw_effects(self, rng: np.random.Generator, law: EffectLaw) -> Effects:
        """Return exact draws of the effects given the rows: fabrics, then mu, then participants."""
        shape, flat = _flat(law)
        size = len(flat.offset)
        mu, participant = np.empty(size), np.empty((size, self.n_participants))
        fabric = np.zeros((size, self.n_fabrics))
        for k in pieces(size, self.width):
            few = part_of(flat, k)
            weights = self._weights(few)
            g = None
            if (few.fabric > 0).any():
                law_of_g = self._fabrics(few, weights)
                noise = np.asarray(rng.standard_normal(law_of_g.likely.shape))[..., None]
                g = law_of_g.likely + (law_of_g.root @ noise)[..., 0]
                fabric[k] = few.fabric[:, None] * g
            fit = self._fit(few, weights, g)
            mu[k] = fit.mu + self.sd * np.sqrt(weights.shrinkage) * rng.standard_normal(fit.mu.shape)
            expected = np.zeros((len(fit.mu), self.n_participants))
            spread = np.repeat(few.participant[:, None], self.n_participants, axis=1)
            gain = few.participant[:, None] ** 2 * weights.precision
            expected[:, self._present] = gain * (fit.mean - mu[k, None])
            spread[:, self._present] = few.participant[:, None] * np.sqrt(weights.kept)
            participant[k] = expected + spread * rng.standard_normal(expected.shape)
        return Effects(*(v.reshape((*shape, *v.shape[1:])) for v in (self.mean + mu, participant, fabric)))

    def _weights(self, law: EffectLaw) -> _Weights:
        single = (1.0 / law.variance)[:, self._condition]
        pair = self._count * single
        person = self._of_person(pair)
        kept = 1.0 / (1.0 + person * law.participant[:, None] ** 2)
        precision = person * kept
        total = precision.sum(axis=-1)
        return _Weights(single, pair, person, kept, precision, total, 1.0 / (1.0 + self.sd**2 * total))

    def _of_person(self, values: Array) -> Array:
        """Return sums over each participant's pairs, which are adjacent."""
        return np.asarray(np.add.reduceat(values, self._first, axis=-1))

    def _fit(self, law: EffectLaw, weights: _Weights, g: Array | None = None) -> _Fit:
        left = self._average - law.offset[:, self._condition]
        if g is not None:
            left -= law.fabric[:, None] * (g @ self._member.T)
        mean = self._of_person(weights.pair * left) / weights.person
        left -= mean[:, self._person]
        mu = self.sd**2 * weights.shrinkage * (weights.precision * mean).sum(axis=-1)
        return _Fit(mean, left, mu)

    def _log_density(self, law: EffectLaw) -> Array:
        weights, penalty = self._weights(law), np.zeros(len(law.offset))
        variance = law.variance[:, self._condition]
        determinant = (self._count * np.log(variance)).sum(axis=-1) - np.log(weights.kept).sum(axis=-1)
        determinant -= np.log(weights.shrinkage)
        g = None
        if (law.fabric > 0).any():
            fabrics = self._fabrics(law, weights)
            g, determinant = fabrics.likely, determinant + fabrics.log_determinant
            penalty = (g**2).sum(axis=-1)
        fit = self._fit(law, weights, g)
        centre = (weights.precision * fit.mean).sum(axis=-1) / weights.total
        squares = (weights.pair * fit.within**2 + weights.single * self._scatter).sum(axis=-1)
        squares += (weights.precision * (fit.mean - centre[:, None]) ** 2).sum(axis=-1)
        squares += centre**2 * weights.total * weights.shrinkage + penalty
        return -0.5 * (self.n_rows * _LOG_TWO_PI + determinant + squares)

    def _of_fabric(self, values: Array) -> Array:
        """Return sums over the pairs of each participant and fabric, (B, people, fabrics)."""
        return np.asarray((self._kind @ values.T).T).reshape(len(values), self._present.size, self.n_fabrics)

    def _fabrics(self, law: EffectLaw, weights: _Weights) -> _Fabrics:
        """Return the law of g, with precision I + omega² F'KF, a sum of nonnegative terms."""
        omega, weight = law.fabric[:, None], self._of_fabric(weights.pair)
        share = weight / weights.person[..., None]
        within = -np.swapaxes(weight, 1, 2) @ share
        diagonal = np.arange(self.n_fabrics)
        within[:, diagonal, diagonal] = 0.0
        within[:, diagonal, diagonal] = -within.sum(axis=-1)
        centre = (weights.precision[..., None] * share).sum(axis=1) / weights.total[:, None]
        scaled = np.sqrt(weights.precision)[..., None] * (share - centre[:, None])
        common = (weights.total * weights.shrinkage)[:, None, None] * centre[:, :, None] * centre[:, None, :]
        precision = within + np.swapaxes(scaled, 1, 2) @ scaled + common
        size, vectors = np.linalg.eigh(np.eye(self.n_fabrics) + omega[..., None] ** 2 * precision)
        size = np.maximum(size, 1.0)  # its lower bound, which rounding errors may violate
        root = vectors / np.sqrt(size)[:, None, :]
        g = np.zeros((len(size), self.n_fabrics))
        for _ in range(_REFINED):
            fit = self._fit(law, weights, g)
            pull = omega * self._pull(weights, share, fit) - g
            g = g + (root @ (np.swapaxes(root, 1, 2) @ pull[..., None]))[..., 0]
        return _Fabrics(g, root, np.log(size).sum(axis=-1), share)

    def _pull(self, weights: _Weights, share: Array, fit: _Fit) -> Array:
        """Return F'K r, the weighted residuals of each fabric, (B, fabrics)."""
        between = weights.precision * (fit.mean - fit.mu[:, None])
        return (weights.pair * fit.within) @ self._member + (between[..., None] * share).sum(axis=1)

    def _reach(self, weights: _Weights, share: Array) -> Array:
        """Return the rows of K F for each pair, (B, pairs, fabrics)."""
        common = (self.sd**2 * weights.shrinkage)[:, None] * (weights.precision[..., None] * share).sum(axis=1)
        of_person = weights.kept[..., None] * (share - common[:, None]) - share
        return weights.single[..., None] * (self._member + of_person[:, self._person])

    def _given_the_others(self, law: EffectLaw) -> Array:
        weights = self._weights(law)
        g, some = None, bool((law.fabric > 0).any())
        if some:
            fabrics = self._fabrics(law, weights)
            g = fabrics.likely
        fit = self._fit(law, weights, g)
        away = fit.mean - fit.mu[:, None]
        misfit = self._of_person(weights.pair * fit.within**2 + weights.single * self._scatter)
        misfit += weights.precision * away**2
        logs = self._count * (np.log(law.variance[:, self._condition]) + _LOG_TWO_PI)
        misfit += self._of_person(logs) - np.log(weights.kept)
        slope = (weights.precision * away)[..., None]
        basis = np.ones((*away.shape, 1))
        hessian = np.zeros((*away.shape, 1, 1))
        scale = np.full((len(away), 1), self.sd)
        if some:
            weight, size = self._of_fabric(weights.pair), self.n_fabrics + 1
            basis = np.concatenate([basis, fabrics.share], axis=-1)
            hessian = np.zeros((*away.shape, size, size))
            diagonal = np.arange(1, size)
            hessian[..., 1:, 1:] = -weight[..., :, None] * fabrics.share[..., None, :]
            hessian[..., diagonal, diagonal] += weight
            slope = slope * basis
            slope[..., 1:] += self._of_fabric(weights.pair * fit.within)
            scale = np.column_stack([scale, np.repeat(law.fabric[:, None], self.n_fabrics, axis=1)])
        hessian = hessian + weights.precision[..., None, None] * (basis[..., :, None] * basis[..., None, :])
        hessian *= (scale[:, :, None] * scale[:, None, :])[:, None]
        return given_the_others(0.5 * misfit, -scale[:, None] * slope, hessian).log_density


def law_of(offset: Array, variance: Array, spreads: EffectSpreads) -> EffectLaw:
    """Return the law of rows with these expectations and variances; varsigma in `spreads` is not used."""
    participant, _, fabric = (np.asarray(value, float) for value in spreads)
    return EffectLaw(offset, np.maximum(variance, _LEAST_VARIANCE), participant, fabric)


def _flat(law: EffectLaw) -> tuple[tuple[int, ...], EffectLaw]:
    """Return the batch shape, and the law with the batch flattened to one axis."""
    shape = np.broadcast_shapes(law.offset.shape[:-1], law.variance.shape[:-1], law.participant.shape, law.fabric.shape)
    offset, variance = (np.broadcast_to(v, (*shape, v.shape[-1])).reshape(-1, v.shape[-1]) for v in law[:2])
    participant, fabric = (np.broadcast_to(v, shape).reshape(-1) for v in law[2:])
    return shape, EffectLaw(offset, variance, participant, fabric)
