"""A normal vector with random effects of participants and with effects that participants share, all integrated out.

y_i = mean + v_c(i) + x_c(i) u + s_p(i) + e_i with u ~ N(0, I), s ~ N(0, tau²) and e ~ N(0, variance_c(i)); c and p are
the condition and participant of row i. The shared effects u are the level, and those of fabrics or loads, if any; each
condition has their weights x, the products of weights that are often the same at all draws and of the effects' standard
deviations. Participants are independent given u: each contributes a quadratic function of u, through
the precision-weighted mean of its rows and their deviations from it. Where all variances are equal, the density of all
rows follows from counts and means over the rows, computed once. Sums of squares are computed about a least-squares fit,
so that digits are not lost.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike
from scipy.sparse import csr_array

from softness_bayes.base.laws import LOG_TWO_PI
from softness_bayes.likelihood.design import Design, FloatArray
from softness_bayes.likelihood.pieces import backward, cholesky, forward, log_determinant, pieces

LEAST_VARIANCE = 1e-20
"""Far below that of any rating."""
_REFINED = 2  # Newton steps: the first is exact up to rounding errors, which the other removes
_SPARSE = 0.2  # below this share of numbers that are not 0, products of sparse matrices are faster
_SWEEPS = 50  # of the least-squares fit; what is left is small, and is allowed for exactly


class EffectLaw(NamedTuple):
    """Expectations, error variances and effects, each of batch shape (...)."""

    offset: FloatArray
    """v of each condition, shape (..., conditions)."""
    variance: FloatArray
    """Variance of a row's error in each condition, shape (..., conditions), or (..., 1) if all are equal."""
    participant: FloatArray
    """tau, shape (...)."""
    shared: FloatArray
    """Weights of the shared effects in each condition, shape (..., conditions, effects): x is their product with `sd`.
    Those without a batch axis are summed over the rows once for all draws."""
    sd: FloatArray
    """Standard deviations of the shared effects, shape (..., effects)."""

    @classmethod
    def of(
        cls, offset: FloatArray, variance: FloatArray, participant: ArrayLike, shared: FloatArray, sd: ArrayLike = 1.0
    ) -> EffectLaw:
        """Return the law with variances of at least `LEAST_VARIANCE`."""
        of_effects = np.asarray(sd, float) * np.ones(shared.shape[-1])
        return cls(offset, np.maximum(variance, LEAST_VARIANCE), np.asarray(participant, float), shared, of_effects)

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """The common batch shape."""
        offset, variance, participant, shared, sd = (value.shape for value in self)
        return np.broadcast_shapes(offset[:-1], variance[:-1], participant, shared[:-2], sd[:-1])


class LeaveOneOut(NamedTuple):
    """Normal law of each row given all the others; arrays of shape (..., rows)."""

    mean: FloatArray
    sd: FloatArray


class SharedLaw(NamedTuple):
    """Normal law of u given all rows."""

    mean: FloatArray
    """Shape (..., effects)."""
    covariance: FloatArray
    """Shape (..., effects, effects)."""


class WithoutOne(NamedTuple):
    """Density of each participant's rows given all others', and the law of u without them."""

    log_density: FloatArray
    """Shape (..., participants)."""
    moved: FloatArray
    """Mean of u without the participant, minus that given all rows, shape (..., participants, effects)."""
    precision: FloatArray
    """Inverse covariance of u without the participant, shape (..., participants, effects, effects)."""


class _Alike(NamedTuple):
    """The rows about a fit by conditions and participants, and groups of participants with the same numbers of rows."""

    rows: FloatArray  # of each participant of a group, (groups,)
    number: FloatArray  # of participants, (groups,)
    shares: FloatArray | csr_array  # of the conditions in the rows, (groups, conditions); sparse if most are 0
    mean: FloatArray  # of the participants' means about the fit, (groups,)
    squares: FloatArray  # sum of the squared deviations of their means from it, (groups,)
    best: FloatArray  # the fit, (conditions,)
    every: FloatArray  # number of rows of each condition, (conditions,)
    slope: FloatArray  # sum of the deviations from the fit within participants, (conditions,)
    constant: float  # sum of their squares


class NormalRows:
    """The law of the rows with all effects integrated out.

    Parameters
    ----------
    design
        Condition and participant of every row; rows of one condition share their expectation and variance.
    values
        y of every row, shape (rows,).
    mean
        Prior mean of the level.
    """

    def __init__(self, design: Design, values: FloatArray, mean: float) -> None:
        self.mean, self.n_rows, self.n_participants = mean, design.n_rows, design.n_participants
        pairs, self.pair_of_row = np.unique(
            design.participant * design.n_conditions + design.condition, return_inverse=True
        )
        who, self.condition = np.divmod(pairs, design.n_conditions)
        self.present, self._first, self.person = np.unique(who, return_index=True, return_inverse=True)
        self.count = np.bincount(self.pair_of_row).astype(float)
        values = np.asarray(values, dtype=float) - mean
        self.average = np.bincount(self.pair_of_row, values) / self.count
        self.apart = values - self.average[self.pair_of_row]
        self.scatter = np.bincount(self.pair_of_row, self.apart**2)
        self._alike = self._grouped(design.cells[self.present])

    def _grouped(self, cells: FloatArray) -> _Alike:
        """Fit conditions and participants to the rows by least squares, and group participants with like rows."""
        conditions, rows = cells.shape[1], cells.sum(axis=1)
        every, best = cells.sum(axis=0), np.zeros(conditions)
        for _ in range(_SWEEPS + 1):
            means = self.of_person(self.count * (self.average - best[self.condition])) / rows
            left = self.average - best[self.condition] - means[self.person]
            slope = np.bincount(self.condition, self.count * left, conditions).astype(float)
            fit, best = best, best + slope / np.maximum(every, 1.0)
        constant = float((self.count * left**2).sum() + self.scatter.sum())
        patterns, group = np.unique(cells, axis=0, return_inverse=True)
        group = group.reshape(-1)
        number, own = np.bincount(group).astype(float), patterns.sum(axis=1)
        mean = np.bincount(group, means) / number
        squares = np.bincount(group, (means - mean[group]) ** 2).astype(float)
        shares = patterns / own[:, None]
        dense = np.count_nonzero(shares) > _SPARSE * shares.size
        shares = shares if dense else csr_array(shares)
        return _Alike(own, number, shares, mean, squares, fit, every, slope, constant)

    def of_person(self, values: FloatArray, axis: int = -1) -> FloatArray:
        """Return sums over each participant's pairs of participant and condition, which are adjacent."""
        return np.asarray(np.add.reduceat(values, self._first, axis=axis))

    def log_density(self, law: EffectLaw) -> FloatArray:
        """Return the log density of the rows, shape (...)."""
        if law.variance.shape[-1] == 1:
            return self._log_density_from_sums(law)
        return self._each(law, lambda given, _: given.log_density())

    def shared(self, law: EffectLaw) -> SharedLaw:
        """Return the law of u given all rows."""

        def packed(given: _Given, _: slice) -> FloatArray:
            inverse = forward(given.root, np.broadcast_to(np.eye(given.root.shape[-1]), given.root.shape))
            return np.concatenate([given.likely[:, None], np.swapaxes(inverse, 1, 2) @ inverse], axis=1)

        found = self._each(law, packed)
        return SharedLaw(found[..., 0, :], found[..., 1:, :])

    def without_participants(self, law: EffectLaw) -> WithoutOne:
        """Return the density of each participant's rows given those of all others."""
        return self._each(law, lambda given, _: given.without_participants(), WithoutOne)

    def leave_one_out(self, law: EffectLaw) -> LeaveOneOut:
        """Return the law of each row given all the others, N(y_i - (K r)_i / K_ii, 1 / K_ii).

        K is the inverse covariance of the rows and r their residual. Memory grows with batch × rows.
        """
        return self._each(law, lambda given, _: given.leave_one_out(), LeaveOneOut)

    def draw(self, rng: Generator, law: EffectLaw) -> tuple[FloatArray, FloatArray]:
        """Return exact draws of u, (..., effects), then of s, (..., participants), given the rows."""
        shape = law.batch_shape
        noise = rng.standard_normal((math.prod(shape), law.shared.shape[-1] + self.n_participants))

        def drawn(given: _Given, draws: slice) -> tuple[FloatArray, FloatArray]:
            of_shared, participant = np.split(noise[draws], [law.shared.shape[-1]], axis=1)
            u = given.likely + backward(given.root, of_shared[..., None])[..., 0]
            tau = given.law.participant[:, None]
            mean, own = tau**2 * given.precision * given.residual(u)[1], tau * participant
            own[:, self.present] = mean + np.sqrt(given.kept) * own[:, self.present]
            return u, own

        return self._each(law, drawn, lambda *both: both)

    def _each(self, law: EffectLaw, work: Callable[[_Given, slice], Any], kind: Callable[..., Any] = np.asarray) -> Any:
        """Return a quantity of every draw, an array or a tuple of arrays, computed in pieces of the batch."""
        shape = law.batch_shape
        draws, conditions = math.prod(shape), law.offset.shape[-1]
        width = self.count.size * law.shared.shape[-1]
        offset, variance = (np.broadcast_to(v, (*shape, conditions)).reshape(draws, -1) for v in law[:2])
        shared = np.broadcast_to(law.shared * law.sd[..., None, :], (*shape, *law.shared.shape[-2:]))
        participant = np.broadcast_to(law.participant, shape).reshape(draws)
        flat = EffectLaw(offset, variance, participant, shared.reshape(draws, conditions, -1), np.ones((draws, 1)))
        found = [work(_Given(self, EffectLaw(*(value[k] for value in flat))), k) for k in pieces(draws, width)]
        several = isinstance(found[0], tuple)
        parts = zip(*found, strict=True) if several else [found]
        return kind(*(np.concatenate(p).reshape((*shape, *p[0].shape[1:])) for p in parts))

    def _log_density_from_sums(self, law: EffectLaw) -> FloatArray:
        """Return the log density if all variances are equal, at a cost that does not grow with the number of rows.

        About the least-squares fit, the sum of squares within participants is ``constant - 2 d' slope + d' L d`` with d
        the expectations less those of the fit, and L = diag(every) less the participants' means, so that L 1 = 0.
        """
        rows, number, shares, mean, squares, best, every, slope, constant = self._alike
        variance, many = law.variance[..., 0], rows * number
        of_sum = variance[..., None] + rows * law.participant[..., None] ** 2
        weight = many / of_sum
        x, sd, away = law.shared, law.sd, law.offset - best
        means, of_group = _turned(_summed(shares, _turned(x))), _summed(shares, away)
        middle = (every @ x)[..., None, :] / self.n_rows
        centred, apart = x - middle, means - middle
        counted, grouped = every[:, None] * centred, many[:, None] * apart
        within = _turned(centred) @ counted - _turned(apart) @ grouped
        information = within / variance[..., None, None] + _turned(means) @ (weight[..., None] * means)
        information = sd[..., None] * information * sd[..., None, :]
        pull = slope @ centred - _times(_turned(counted), away) + _times(_turned(grouped), of_group)
        pull = sd * (pull / variance[..., None] + _times(_turned(means), weight * (mean - of_group)))
        likely, root = _solved(information, lambda u: pull - _times(information, u))
        # at the most probable effects the quadratic form is a sum of squares, so errors enter only squared
        d, of_group = away + _times(x, sd * likely), of_group + _times(means, sd * likely)
        gap, centre = mean - of_group, (d @ every / self.n_rows)[..., None]
        d = d - centre
        quadratic = (constant - 2.0 * d @ slope + d**2 @ every - (of_group - centre) ** 2 @ many) / variance
        quadratic = quadratic + (likely**2).sum(axis=-1) + (weight * gap**2 + rows / of_sum * squares).sum(axis=-1)
        determinant = (self.n_rows - number.sum()) * np.log(variance) + np.log(of_sum) @ number + log_determinant(root)
        return np.asarray(-0.5 * (self.n_rows * LOG_TWO_PI + determinant + quadratic))


class _Given:
    """Weights of the rows and the law of u, for a flat batch of B draws.

    Parameters
    ----------
    rows, law
        The rows, and their law with a variance for each condition, (B, conditions).
    """

    def __init__(self, rows: NormalRows, law: EffectLaw) -> None:
        self.rows, self.law = rows, law
        self.single = (1.0 / law.variance)[:, rows.condition]
        """Precision of a row of each pair of participant and condition, (B, pairs)."""
        self.pair = rows.count * self.single
        self.person = rows.of_person(self.pair)
        """Precision of each participant's mean given u and s, (B, people)."""
        self.kept = 1.0 / (1.0 + self.person * law.participant[:, None] ** 2)
        self.precision = self.person * self.kept
        """The same given u alone."""
        x = law.shared[:, rows.condition]
        self.centre = rows.of_person(self.pair[..., None] * x, axis=1) / self.person[..., None]
        """Mean x of each participant, (B, people, effects)."""
        self.own = x - self.centre[:, rows.person]
        """Deviation of x from it, (B, pairs, effects)."""
        information = _turned(self.own) @ (self.pair[..., None] * self.own)
        information += _turned(self.centre) @ (self.precision[..., None] * self.centre)

        def pull(u: FloatArray) -> FloatArray:
            within, mean = self.residual(u)
            return _times(_turned(self.own), self.pair * within) + _times(_turned(self.centre), self.precision * mean)

        self.likely, self.root = _solved(information, pull)
        self.within, self.mean = self.residual(self.likely)

    def residual(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return each pair's deviation from its participant's mean, and that mean, less their expectations at u."""
        rows = self.rows
        left = rows.average - (self.law.offset + _times(self.law.shared, u))[:, rows.condition]
        mean = rows.of_person(self.pair * left) / self.person
        return left - mean[:, rows.person], mean

    def log_density(self) -> FloatArray:
        """Return the log density of all rows, (B,)."""
        return -self._misfits().sum(axis=-1) - 0.5 * ((self.likely**2).sum(axis=-1) + log_determinant(self.root))

    def _misfits(self) -> FloatArray:
        """Return minus the log density of each participant's rows at the most probable u, (B, people)."""
        rows = self.rows
        logs = rows.count * (np.log(self.law.variance[:, rows.condition]) + LOG_TWO_PI)
        squares = rows.of_person(self.pair * self.within**2 + self.single * rows.scatter + logs)
        return 0.5 * (squares + self.precision * self.mean**2 - np.log(self.kept))

    def without_participants(self) -> WithoutOne:
        """Return the density of each participant's rows given the others, arrays (B, people, ...).

        With q_p(u) minus the log density of participant p, A_p its Hessian and g_p its gradient at u*, the minimum of
        |u|²/2 + sum q_p, and M = I + sum A_p,

            log p(y_p | y_-p) = -q_p(u*) - ½ log |M| + ½ log |M - A_p| - ½ g_p' (M - A_p)^-1 g_p.

        No term suffers from cancellation: q_p is a sum of squared residuals, and M - A_p is summed without A_p.
        """
        weighted = self.pair[..., None] * self.own
        pull = self.rows.of_person(weighted * self.within[..., None], axis=1)
        gradient = -pull - (self.precision * self.mean)[..., None] * self.centre
        hessian = self.rows.of_person(weighted[..., None] * self.own[..., None, :], axis=1)
        hessian += self.precision[..., None, None] * self.centre[..., None] * self.centre[..., None, :]
        misfit, gradient, hessian = (self._of_all(part) for part in (self._misfits(), gradient, hessian))
        before, after = np.zeros_like(hessian), np.zeros_like(hessian)
        before[:, 1:] = np.cumsum(hessian[:, :-1], axis=1)
        after[:, :-1] = np.cumsum(hessian[:, :0:-1], axis=1)[:, ::-1]
        without = np.eye(hessian.shape[-1]) + before + after
        whole = np.linalg.slogdet(without[:, -1] + hessian[:, -1]).logabsdet
        moved = np.asarray(np.linalg.solve(without, gradient[..., None])[..., 0], float)
        change = whole[:, None] - np.linalg.slogdet(without).logabsdet
        return WithoutOne(-misfit - 0.5 * (change + (gradient * moved).sum(axis=-1)), moved, without)

    def _of_all(self, values: FloatArray) -> FloatArray:
        """Return values of participants with rows, (B, people, ...), for all participants: 0 for the others."""
        found = np.zeros((len(values), self.rows.n_participants, *values.shape[2:]))
        found[:, self.rows.present] = values
        return found

    def leave_one_out(self) -> LeaveOneOut:
        """Return the law of each row given all the others."""
        rows, x, condition, person = self.rows, self.law.shared, self.rows.condition, self.rows.person
        tau_squared = self.law.participant[:, None] ** 2
        # K_ii given u: a sum of positive terms, so there is no cancellation
        diagonal = (1.0 + (self.person[:, person] - self.single) * tau_squared) * self.single * self.kept[:, person]
        of_condition = forward(self.root, _turned(x))
        of_person = forward(self.root, _turned((1.0 - self.kept)[..., None] * self.centre))
        effects = range(x.shape[-1])
        loss = sum((of_condition[:, k][:, condition] - of_person[:, k][:, person]) ** 2 for k in effects)
        least = 1.0 / (self.law.variance + tau_squared + (x**2).sum(axis=-1))  # the precision without any other row
        precision = np.maximum(diagonal - self.single**2 * loss, least[:, condition])[:, rows.pair_of_row]
        between = self.kept * self.mean
        away = rows.apart + (self.within + between[:, person])[:, rows.pair_of_row]
        values = rows.mean + rows.average[rows.pair_of_row] + rows.apart
        return LeaveOneOut(values - self.single[:, rows.pair_of_row] * away / precision, precision**-0.5)


def _solved(information: FloatArray, pull: Callable[[FloatArray], FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Return the most probable u, (..., effects), and the lower factor of its precision, I + information.

    `pull` returns the gradient of the log density of the rows at given u.
    """
    root = cholesky(np.eye(information.shape[-1]) + information, 1.0)
    u = np.zeros(root.shape[:-1])
    for _ in range(_REFINED):
        u = u + backward(root, forward(root, (pull(u) - u)[..., None]))[..., 0]
    return u, root


def _summed(weights: FloatArray | csr_array, values: FloatArray) -> FloatArray:
    """Return sums of values (..., columns) with weights (rows, columns), which may be sparse."""
    found = weights @ values.reshape(-1, values.shape[-1]).T
    return np.asarray(found).T.reshape(*values.shape[:-1], -1)


def _turned(matrix: FloatArray) -> FloatArray:
    return np.swapaxes(matrix, -1, -2)


def _times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    # one matrix for all draws is one product of matrices
    return vector @ matrix.T if matrix.ndim == 2 else np.asarray((matrix @ vector[..., None])[..., 0])


class EffectGroup(NamedTuple):
    """Effects with a common standard deviation, which is a parameter."""

    columns: slice
    """Columns of U that belong to the group."""
    sd: float
    slope: FloatArray
    """Derivative of the standard deviation with respect to each of the d parameters, shape (d,)."""


def normal_information(
    effects: FloatArray | csr_array,
    slopes: FloatArray,
    variances: FloatArray,
    sd: float,
    sd_slope: FloatArray,
    groups: Sequence[EffectGroup] = (),
) -> FloatArray:
    """Return the Fisher information about d parameters from normal rows with common effects, shape (d, d).

    y = f(x) + U e + noise, with e ~ N(0, diag D) and noise ~ N(0, s²): f has slopes J, and some columns of U share one
    variance. By Woodbury's identity, only a matrix of the size of the effects is solved.

    Parameters
    ----------
    effects, slopes
        U, shape (rows, q), and J, shape (rows, d).
    variances
        D, the variance of every effect, shape (q,); those of effects in `groups` are ignored.
    sd, sd_slope
        s, and its derivative with respect to each parameter, shape (d,).
    groups
        Effects whose standard deviation is a parameter.
    """
    gram, cross = effects.T @ effects, effects.T @ slopes
    gram = gram if isinstance(gram, np.ndarray) else gram.toarray()
    variance = sd**2
    root = np.sqrt(variances)
    for group in groups:
        root[group.columns] = group.sd
    inner = root[:, None] * np.linalg.solve(variance * np.eye(root.size) + root[:, None] * gram * root, np.diag(root))
    about_mean = (slopes.T @ slopes - cross.T @ inner @ cross) / variance
    # U' S^-1 U and U' S^-2 U, S being the covariance of the rows
    left = np.eye(root.size) - gram @ inner
    once = left @ gram / variance
    twice = left @ gram @ left.T / variance**2
    shrunk = inner @ gram
    trace = (len(slopes) - 2.0 * np.trace(shrunk) + np.sum(shrunk * shrunk.T)) / variance**2
    change = [2.0 * sd * sd_slope, *(2.0 * group.sd * group.slope for group in groups)]
    products = np.zeros((len(change), len(change)))
    products[0, 0] = trace
    for k, one in enumerate(groups, start=1):
        products[0, k] = products[k, 0] = np.trace(twice[one.columns, one.columns])
        for other, two in enumerate(groups, start=1):
            products[k, other] = (once[one.columns, two.columns] ** 2).sum()
    changes = np.stack(change)
    return np.asarray(about_mean + 0.5 * changes.T @ products @ changes)
