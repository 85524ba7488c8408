"""A normal vector with a common mean and random effects of participants and fabrics, all integrated out.

y_i = v_c(i) + mu + s_p(i) + f_k(i) + e_i with mu ~ N(mean, sd²), s ~ N(0, tau²), f ~ N(0, omega²) and
e ~ N(0, variance_c(i)); c, p and k are the condition, participant and fabric of row i. Participants are independent
given mu and the effects of fabrics, and the rows of each enter through their precision-weighted mean and their
deviations from it. Where all variances are equal, the density of all rows follows from counts and means over the rows,
computed once. Sums of squares are computed about a least-squares fit, so that digits are not lost.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array

from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.effects import Effects
from softness_bayes.likelihood.pieces import backward, cholesky, forward, part_of, pieces

FloatArray = NDArray[np.float64]

LEAST_VARIANCE = 1e-20
"""Far below that of any rating."""
_LOG_TWO_PI = math.log(2.0 * math.pi)
_REFINED = 3  # Newton steps: the first is exact up to rounding errors, which the others remove
_SWEEPS = 50  # of the least-squares fit; what is left is small, and is allowed for exactly


class EffectLaw(NamedTuple):
    """Expectations, error variances and spreads of effects, each of batch shape (...)."""

    offset: FloatArray
    """v of each condition, shape (..., conditions)."""
    variance: FloatArray
    """Variance of a row's error in each condition, shape (..., conditions), or (..., 1) if all are equal."""
    participant: FloatArray
    """tau, shape (...)."""
    fabric: FloatArray
    """omega, shape (...)."""

    @classmethod
    def of(cls, offset: FloatArray, variance: FloatArray, participant: ArrayLike, fabric: ArrayLike) -> EffectLaw:
        """Return the law with variances of at least `LEAST_VARIANCE`."""
        tau, omega = np.asarray(participant, float), np.asarray(fabric, float)
        return cls(offset, np.maximum(variance, LEAST_VARIANCE), tau, omega)


class LeaveOneOut(NamedTuple):
    """Normal law of each row given all the others; arrays of shape (..., rows)."""

    mean: FloatArray
    sd: FloatArray


class _Alike(NamedTuple):
    """Participants with the same numbers of rows in all conditions, one group for each pattern."""

    rows: FloatArray  # of each participant, (groups,)
    number: FloatArray  # of participants, (groups,)
    shares: FloatArray  # of the conditions in the rows, (groups, conditions)
    mean: FloatArray  # of the participants' means about the fit, (groups,)
    squares: FloatArray  # sum of the squared deviations of their means from it, (groups,)
    within: FloatArray  # products of fabrics' indicators about participants' means, summed over rows


class _Weights(NamedTuple):
    """Precisions, for a flat batch of B draws."""

    single: FloatArray  # of a row of each pair of participant and condition, (B, pairs)
    pair: FloatArray  # of the rows of each pair together, (B, pairs)
    person: FloatArray  # of each participant's mean given mu and the participant's effect, (B, people)
    kept: FloatArray  # 1 / (1 + tau² person), (B, people)
    precision: FloatArray  # of each participant's mean given mu alone, (B, people)
    total: FloatArray  # sum of these, (B,)
    shrinkage: FloatArray  # 1 / (1 + sd² total), (B,)


class _Fabrics(NamedTuple):
    """The law of g, omega g being the effects of fabrics."""

    likely: FloatArray  # most probable values, (..., fabrics)
    root: FloatArray  # lower factor of the precision, (..., fabrics, fabrics)
    share: FloatArray  # of each fabric in a participant's precision, (..., people, fabrics)

    @property
    def log_determinant(self) -> FloatArray:
        """Log determinant of the precision, shape (...)."""
        return np.asarray(2.0 * np.log(np.diagonal(self.root, axis1=-2, axis2=-1)).sum(axis=-1))


class _Fit(NamedTuple):
    """Residuals at the most probable effects of fabrics, or at given ones."""

    mean: FloatArray  # weighted mean of each participant, (B, people)
    within: FloatArray  # deviation of each pair from it, (B, pairs)
    mu: FloatArray  # most probable mu, (B,)


class NormalRows:
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
        Number of fabrics, by default that of the design; those without a condition are allowed.
    """

    def __init__(
        self, design: Design, values: FloatArray, mean: float, sd: float, n_fabrics: int | None = None
    ) -> None:
        self.mean, self.sd, self.n_rows = mean, sd, design.n_rows
        self.n_fabrics, self.n_participants = n_fabrics or design.n_fabrics, design.n_participants
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
        self._member = np.eye(self.n_fabrics)[fabric]
        self._kind = summing(self._person * self.n_fabrics + fabric, self._present.size * self.n_fabrics)
        self._set_fit(design)

    def _set_fit(self, design: Design) -> None:
        """Fit conditions and participants to the rows by least squares, and group participants with like rows."""
        cells = design.cells[self._present]
        rows, every = cells.sum(axis=1), np.maximum(cells.sum(axis=0), 1.0)
        best = np.zeros(design.n_conditions)
        for _ in range(_SWEEPS + 1):
            means = self._of_person(self._count * (self._average - best[self._condition])) / rows
            left = self._average - best[self._condition] - means[self._person]
            slope = np.bincount(self._condition, self._count * left, design.n_conditions)
            best = best + slope / every
        best = best - slope / every  # the last step is not taken: `left` belongs to the fit before it
        self._best, self._slope, self._every = best, slope, cells.sum(axis=0)
        self._constant = float((self._count * left**2).sum() + self._scatter.sum())
        patterns, group = np.unique(cells, axis=0, return_inverse=True)
        group = group.reshape(-1)
        number = np.bincount(group).astype(float)
        mean = np.bincount(group, means) / number
        squares = np.bincount(group, (means - mean[group]) ** 2).astype(float)
        own = patterns.sum(axis=1)
        self._fabric = np.eye(self.n_fabrics)[design.fabric]
        kinds = patterns @ self._fabric
        within = _about_means((number[:, None] * kinds)[None], (kinds / own[:, None])[None])[0]
        self._alike = _Alike(own, number, patterns / own[:, None], mean, squares, within)

    @property
    def width(self) -> int:
        """Numbers kept in memory for each draw."""
        return self.n_rows + self._present.size * self.n_fabrics**2

    def log_density(self, law: EffectLaw) -> FloatArray:
        """Return the log density of the rows, shape (...)."""
        if law.variance.shape[-1] == 1:
            return self._log_density_from_sums(law)
        shape, flat = _flat(law)
        found = np.empty(len(flat.offset))
        for k in pieces(found.size, self.width if (flat.fabric > 0).any() else self._count.size):
            found[k] = self._log_density(part_of(flat, k))
        return found.reshape(shape)

    def log_density_participants(self, law: EffectLaw) -> FloatArray:
        """Return the log density of all rows of each participant given those of all others, (..., participants)."""
        shape, flat = _flat(law)
        found = np.zeros((len(flat.offset), self.n_participants))
        for k in pieces(len(found), self.width):
            found[k, self._present] = self._given_the_others(part_of(flat, k))
        return found.reshape(*shape, -1)

    def leave_one_out(self, law: EffectLaw) -> LeaveOneOut:
        """Return the law of each row given all the others, N(y_i - (K r)_i / K_ii, 1 / K_ii).

        K is the inverse covariance of the rows and r their residual. Memory grows with batch × rows.
        """
        shape, flat = _flat(law)
        weights, person = self._weights(flat), self._person
        s_squared, single = self.sd**2, weights.single
        others = weights.person[:, person] - single
        tau_squared = flat.participant[:, None] ** 2
        elsewhere = weights.total[:, None] - weights.precision[:, person]
        # K_ii without fabrics: a sum of positive terms, so there is no cancellation
        diagonal = (1.0 + others * tau_squared) * (1.0 + s_squared * elsewhere) + s_squared * others
        diagonal *= single * (weights.kept[:, person] * weights.shrinkage[:, None])
        fabrics = self._fabrics(flat, weights)
        if fabrics is not None:
            loss = self._loss(weights, fabrics)[:, person * self.n_fabrics + self._member.argmax(axis=1)]
            diagonal = diagonal - (flat.fabric[:, None] * single) ** 2 * loss
        fit = self._fit(flat, weights, fabrics and fabrics.likely)
        between = weights.kept * (fit.mean - fit.mu[:, None])
        row = self._pair_of_row
        weighted = single[:, row] * (self._apart + (fit.within + between[:, person])[:, row])
        precision = diagonal[:, row]
        mean = self.mean + self._average[row] + self._apart - weighted / precision
        return LeaveOneOut(mean.reshape(*shape, -1), (precision**-0.5).reshape(*shape, -1))

    def draw_effects(self, rng: np.random.Generator, law: EffectLaw) -> Effects:
        """Return exact draws of the effects given the rows: fabrics, then mu, then participants."""
        shape, flat = _flat(law)
        size = len(flat.offset)
        mu, participant, g_noise = (
            np.asarray(rng.standard_normal(s)) for s in (size, (size, self.n_participants), (size, self.n_fabrics))
        )
        fabric = np.zeros((size, self.n_fabrics))
        for k in pieces(size, self.width):
            few = part_of(flat, k)
            weights = self._weights(few)
            fabrics, g = self._fabrics(few, weights), None
            if fabrics is not None:
                g = fabrics.likely + backward(fabrics.root, g_noise[k][..., None])[..., 0]
                fabric[k] = few.fabric[:, None] * g
            fit = self._fit(few, weights, g)
            mu[k] = fit.mu + self.sd * np.sqrt(weights.shrinkage) * mu[k]
            tau = few.participant[:, None]
            spread, expected = np.repeat(tau, self.n_participants, axis=1), np.zeros((len(tau), self.n_participants))
            spread[:, self._present] = tau * np.sqrt(weights.kept)
            expected[:, self._present] = tau**2 * weights.precision * (fit.mean - mu[k, None])
            participant[k] = expected + spread * participant[k]
        return Effects(*(v.reshape((*shape, *v.shape[1:])) for v in (self.mean + mu, participant, fabric)))

    def _log_density_from_sums(self, law: EffectLaw) -> FloatArray:
        """Return the log density if all variances are equal, at a cost that does not grow with the number of rows.

        About the least-squares fit, the sum of squares within participants is ``constant + d' L d`` with d the
        expectations less those of the fit, and L from the numbers of rows.
        """
        alike, variance, away = self._alike, law.variance[..., 0], law.offset - self._best
        of_sum = variance[..., None] + alike.rows * law.participant[..., None] ** 2
        precision = alike.rows / of_sum
        weight = alike.number * precision
        total = weight.sum(axis=-1)
        shrinkage = 1.0 / (1.0 + self.sd**2 * total)
        determinant = (self.n_rows - self._present.size) * np.log(variance) - np.log(shrinkage)
        determinant = determinant + np.log(of_sum) @ alike.number
        penalty = np.zeros(())
        if (law.fabric > 0).any():
            share, omega = alike.shares @ self._fabric, law.fabric[..., None]

            def pull(g: FloatArray) -> FloatArray:
                now = away + (omega * g) @ self._fabric.T
                means = now @ alike.shares.T
                steep = self._slope - self._every * now + (alike.rows * alike.number * means) @ alike.shares
                means = alike.mean - means
                mu = self.sd**2 * shrinkage * (weight * means).sum(axis=-1)
                between = weight * (means - mu[..., None])
                return np.asarray(steep @ self._fabric / variance[..., None] + between @ share)

            within = alike.within / variance[..., None, None]
            fabrics = self._law_of_fabrics(omega, within, weight, share, shrinkage, pull)
            determinant = determinant + fabrics.log_determinant
            penalty = (fabrics.likely**2).sum(axis=-1)
            away = away + (omega * fabrics.likely) @ self._fabric.T
        # at the most probable effects the quadratic form is a sum of squares, so errors enter only squared
        means = away @ alike.shares.T
        squares = self._constant - 2.0 * (away @ self._slope)
        squares = squares + (away**2) @ self._every - (means**2) @ (alike.rows * alike.number)
        means = alike.mean - means
        centre = (weight * means).sum(axis=-1) / total
        between = (weight * (means - centre[..., None]) ** 2 + precision * alike.squares).sum(axis=-1)
        quadratic = squares / variance + between + centre**2 * total * shrinkage + penalty
        return np.asarray(-0.5 * (self.n_rows * _LOG_TWO_PI + determinant + quadratic))

    def _weights(self, law: EffectLaw) -> _Weights:
        single = (1.0 / law.variance)[:, self._condition]
        pair = self._count * single
        person = self._of_person(pair)
        kept = 1.0 / (1.0 + person * law.participant[:, None] ** 2)
        precision = person * kept
        total = precision.sum(axis=-1)
        return _Weights(single, pair, person, kept, precision, total, 1.0 / (1.0 + self.sd**2 * total))

    def _of_person(self, values: FloatArray) -> FloatArray:
        """Return sums over each participant's pairs, which are adjacent."""
        return np.asarray(np.add.reduceat(values, self._first, axis=-1))

    def _fit(self, law: EffectLaw, weights: _Weights, g: FloatArray | None) -> _Fit:
        left = self._average - law.offset[:, self._condition]
        if g is not None:
            left -= law.fabric[:, None] * (g @ self._member.T)
        mean = self._of_person(weights.pair * left) / weights.person
        left -= mean[:, self._person]
        mu = self.sd**2 * weights.shrinkage * (weights.precision * mean).sum(axis=-1)
        return _Fit(mean, left, mu)

    def _log_density(self, law: EffectLaw) -> FloatArray:
        weights, penalty = self._weights(law), 0.0
        determinant = (self._count * np.log(law.variance[:, self._condition])).sum(axis=-1)
        determinant -= np.log(weights.kept).sum(axis=-1) + np.log(weights.shrinkage)
        fabrics = self._fabrics(law, weights)
        if fabrics is not None:
            determinant += fabrics.log_determinant
            penalty = (fabrics.likely**2).sum(axis=-1)
        fit = self._fit(law, weights, fabrics and fabrics.likely)
        centre = (weights.precision * fit.mean).sum(axis=-1) / weights.total
        squares = (weights.pair * fit.within**2 + weights.single * self._scatter).sum(axis=-1)
        squares += (weights.precision * (fit.mean - centre[:, None]) ** 2).sum(axis=-1)
        squares += centre**2 * weights.total * weights.shrinkage + penalty
        return -0.5 * (self.n_rows * _LOG_TWO_PI + determinant + squares)

    def _of_fabric(self, values: FloatArray) -> FloatArray:
        """Return sums over the pairs of each participant and fabric, (B, people, fabrics)."""
        return np.asarray((self._kind @ values.T).T).reshape(len(values), self._present.size, self.n_fabrics)

    def _fabrics(self, law: EffectLaw, weights: _Weights) -> _Fabrics | None:
        """Return the law of g; None if omega is 0."""
        if not (law.fabric > 0).any():
            return None
        weight = self._of_fabric(weights.pair)
        share = weight / weights.person[..., None]

        def pull(g: FloatArray) -> FloatArray:
            fit = self._fit(law, weights, g)
            between = weights.precision * (fit.mean - fit.mu[:, None])
            return (weights.pair * fit.within) @ self._member + (between[..., None] * share).sum(axis=1)

        within = _about_means(weight, share)
        return self._law_of_fabrics(law.fabric[:, None], within, weights.precision, share, weights.shrinkage, pull)

    def _law_of_fabrics(
        self,
        omega: FloatArray,
        within: FloatArray,
        weight: FloatArray,
        share: FloatArray,
        shrinkage: FloatArray,
        pull: Callable[[FloatArray], FloatArray],
    ) -> _Fabrics:
        """Return the law of g, with precision I + omega² F'KF, a sum of nonnegative terms; F is fabrics' indicator.

        Parameters
        ----------
        omega
            Spread of fabrics' effects, shape (..., 1).
        within
            The part of F'KF within participants, shape (..., fabrics, fabrics).
        weight, share
            Precisions of participants or of groups of them, (..., people), and the fabrics' shares of these.
        shrinkage
            As in `_Weights`.
        pull
            Function that returns F'K r, the weighted residuals of each fabric, (..., fabrics), at given g.
        """
        total = weight.sum(axis=-1)
        centre = (weight[..., None] * share).sum(axis=-2) / total[..., None]
        scaled = np.sqrt(weight)[..., None] * (share - centre[..., None, :])
        common = (total * shrinkage)[..., None, None] * centre[..., :, None] * centre[..., None, :]
        precision = within + np.swapaxes(scaled, -1, -2) @ scaled + common
        root = cholesky(np.eye(self.n_fabrics) + omega[..., None] ** 2 * precision, 1.0)
        g = np.zeros(root.shape[:-1])
        for _ in range(_REFINED):
            g = g + backward(root, forward(root, (omega * pull(g) - g)[..., None]))[..., 0]
        return _Fabrics(g, root, share)

    def _loss(self, weights: _Weights, fabrics: _Fabrics) -> FloatArray:
        """Return what g takes from the precision of a row of precision 1, (B, people × fabrics).

        It is the square of the row of K F, which depends on participant and fabric, in units of g's precision.
        """
        common = (weights.precision[..., None] * fabrics.share).sum(axis=1)
        common *= (self.sd**2 * weights.shrinkage)[:, None]
        of_person = weights.kept[..., None] * (fabrics.share - common[:, None]) - fabrics.share
        reach = (np.eye(self.n_fabrics) + of_person[:, :, None]).reshape(len(common), -1, self.n_fabrics)
        return np.asarray((forward(fabrics.root, np.swapaxes(reach, 1, 2)) ** 2).sum(axis=1))

    def _given_the_others(self, law: EffectLaw) -> FloatArray:
        weights = self._weights(law)
        fabrics = self._fabrics(law, weights)
        fit = self._fit(law, weights, fabrics and fabrics.likely)
        away = fit.mean - fit.mu[:, None]
        misfit = self._of_person(weights.pair * fit.within**2 + weights.single * self._scatter)
        misfit += weights.precision * away**2
        logs = self._count * (np.log(law.variance[:, self._condition]) + _LOG_TWO_PI)
        misfit += self._of_person(logs) - np.log(weights.kept)
        # effects shared by all: mu and, if they differ, the fabrics' g
        size = 1 if fabrics is None else 1 + self.n_fabrics
        basis = np.ones((*away.shape, size))
        hessian = np.zeros((*away.shape, size, size))
        slope = np.repeat((weights.precision * away)[..., None], size, axis=-1)
        scale = np.full((len(away), size), self.sd)
        if fabrics is not None:
            basis[..., 1:] = fabrics.share
            weight, diagonal = self._of_fabric(weights.pair), np.arange(1, size)
            hessian[..., 1:, 1:] = -weight[..., :, None] * fabrics.share[..., None, :]
            hessian[..., diagonal, diagonal] += weight
            slope *= basis
            slope[..., 1:] += self._of_fabric(weights.pair * fit.within)
            scale[:, 1:] = law.fabric[:, None]
        hessian = hessian + weights.precision[..., None, None] * (basis[..., :, None] * basis[..., None, :])
        hessian *= (scale[:, :, None] * scale[:, None, :])[:, None]
        return given_the_others(0.5 * misfit, -scale[:, None] * slope, hessian).log_density


class BlockLaw(NamedTuple):
    """The law of a block given all others, each field of shape (draws, blocks, ...)."""

    log_density: FloatArray
    """log p(y_g | y_-g), shape (draws, blocks)."""
    moved: FloatArray
    """Mean of u without the block, minus u*, shape (draws, blocks, effects)."""
    precision: FloatArray
    """Inverse covariance of u without the block, shape (draws, blocks, effects, effects)."""


def given_the_others(misfit: FloatArray, gradient: FloatArray, hessian: FloatArray) -> BlockLaw:
    """Return the density of each block of rows given the others, for blocks that are independent given common effects.

    Let u be these effects in standard deviations of their prior, and q_g(u) the negative log density of block g, a
    quadratic function with Hessian A_g. At u*, the minimum of |u|²/2 + sum q_g, with M = I + sum A_g and g_g the
    gradient of q_g there,

        log p(y_g | y_-g) = -q_g(u*) - ½ log |M| + ½ log |M - A_g| - ½ g_g' (M - A_g)^-1 g_g.

    No term suffers from cancellation: q_g is a sum of squared residuals, and M - A_g is summed without A_g.

    Parameters
    ----------
    misfit, gradient
        q_g and its gradient at u*, shapes (draws, blocks) and (draws, blocks, effects).
    hessian
        A_g, shape (draws, blocks, effects, effects).
    """
    before, after = np.zeros_like(hessian), np.zeros_like(hessian)
    before[:, 1:] = np.cumsum(hessian[:, :-1], axis=1)
    after[:, :-1] = np.cumsum(hessian[:, :0:-1], axis=1)[:, ::-1]
    without = np.eye(hessian.shape[-1]) + before + after
    whole = np.linalg.slogdet(without[:, -1] + hessian[:, -1]).logabsdet
    moved = np.asarray(np.linalg.solve(without, gradient[..., None])[..., 0], dtype=float)
    pull = (gradient * moved).sum(axis=-1)
    density = -misfit - 0.5 * (whole[:, None] - np.linalg.slogdet(without).logabsdet + pull)
    return BlockLaw(density, moved, without)


def _about_means(weight: FloatArray, share: FloatArray) -> FloatArray:
    """Return sums of products of fabrics' indicators about participants' means, (B, fabrics, fabrics).

    Parameters
    ----------
    weight, share
        Weight of each fabric's rows, (B, people, fabrics), and its share in the participant's.
    """
    found = -np.swapaxes(weight, 1, 2) @ share
    diagonal = np.arange(found.shape[-1])
    found[:, diagonal, diagonal] = 0.0
    found[:, diagonal, diagonal] = -found.sum(axis=-1)  # the rows sum to 0
    return found


def summing(index: ArrayLike, size: int) -> csr_array:
    """Return the sparse matrix (size, rows) that sums rows by index."""
    index = np.asarray(index)
    return csr_array((np.ones(index.size), (index, np.arange(index.size))), shape=(size, index.size))


def _flat(law: EffectLaw) -> tuple[tuple[int, ...], EffectLaw]:
    """Return the batch shape, and the law with the batch flattened to one axis and a variance for each condition."""
    shape = np.broadcast_shapes(law.offset.shape[:-1], law.variance.shape[:-1], law.participant.shape, law.fabric.shape)
    width = law.offset.shape[-1]
    offset, variance = (np.broadcast_to(v, (*shape, width)).reshape(-1, width) for v in law[:2])
    participant, fabric = (np.broadcast_to(v, shape).reshape(-1) for v in law[2:])
    return shape, EffectLaw(offset, variance, participant, fabric)
