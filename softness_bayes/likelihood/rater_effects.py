"""Effects of raters, fabrics and the level on every row, and the log density of rows as their function (model.md 9).

With standard normal zeta, z_p, u_p, v_p and h_k, row i of rater p and fabric k has

    expectation  mu + tau z_p + exp(tau_gamma u_p) (d_i + omega h_k),   mu = centre + spread zeta
    log spread   log varsigma + tau_varsigma v_p

where d_i is the response's contribution. Effects whose spread a model lacks are absent. `Table.sums` is the log density
of every rater's rows given all effects, with the derivatives that Newton's method needs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple, Self

import numpy as np
from scipy.sparse import csr_array

from softness_bayes.base.laws import LOG_TWO_PI
from softness_bayes.likelihood.contract import Parameters
from softness_bayes.likelihood.design import FloatArray, IndexArray
from softness_bayes.likelihood.error_laws import ErrorLaw
from softness_bayes.likelihood.pieces import BLOCK, pieces
from softness_bayes.likelihood.row_laws import RowLaw, Rows


@dataclass(frozen=True)
class Given:
    """Everything but the effects, for a flat batch of draws.

    Parameters
    ----------
    drive
        The response's contribution d to every row, shape (draws, rows), rows sorted by rater.
    rows
        The rows' intervals.
    spread
        varsigma, shape (draws, 1).
    tau
        Spread of raters' scales, shape (draws, 1).
    law_parameters
        Parameters of the error law, each (draws,).
    tau_gamma, tau_varsigma, omega
        Spreads of raters' log exponents and log noise and of fabrics' deviations, each (draws, 1); None if absent.
    """

    drive: FloatArray
    rows: Rows
    spread: FloatArray
    tau: FloatArray
    law_parameters: Parameters
    tau_gamma: FloatArray | None = None
    tau_varsigma: FloatArray | None = None
    omega: FloatArray | None = None
    moments: FloatArray | None = None
    """For `NormalTable`: mean drive of each rater's rows, sums of products of deviations from the means of drive and
    ratings, and of squares of those of drive, shape (draws, raters, 3)."""

    @property
    def effects(self) -> tuple[FloatArray, ...]:
        """Spreads of the effects that each rater has, in the order of `UnitEffects.own`."""
        return tuple(spread for spread in (self.tau, self.tau_gamma, self.tau_varsigma) if spread is not None)

    def part(self, draws: Any) -> Self:
        """Return some of the draws."""
        some = {f.name: getattr(self, f.name) for f in fields(self)}
        chosen = {name: value[draws] for name, value in some.items() if isinstance(value, np.ndarray)}
        parameters = self.law_parameters.part(draws)
        return replace(self, **chosen, rows=self.rows.part(draws), law_parameters=parameters)

    def with_fabrics(self, h: FloatArray, fabric: IndexArray) -> Self:
        """Return the same with known deviations of fabrics, h (draws, fabrics) in units of omega."""
        assert self.omega is not None
        return replace(self, drive=self.drive + self.omega * h[:, fabric], omega=None, moments=None)


class UnitEffects(NamedTuple):
    """Values of all effects in units of their spreads, as views of one array (draws, effects)."""

    level: FloatArray
    """zeta, shape (draws,)."""
    own: FloatArray
    """Each rater's z, then u and v if the model has them, shape (draws, raters, effects)."""
    fabric: FloatArray
    """h, shape (draws, fabrics); without fabrics if omega is absent."""


class Points(NamedTuple):
    """Points of raters' effects; the axis of raters has size 1 if all have the same points."""

    scale: FloatArray
    """mu + tau z, shape (draws, raters, points)."""
    others: FloatArray
    """Further effects in units of their spreads, shape (draws, raters, points, effects - 1)."""
    log_weight: FloatArray
    """Log weight of each point in sums over the effects, shape (draws, raters, points)."""

    @property
    def shared(self) -> bool:
        """True if all raters have the same points."""
        return self.scale.shape[1] == 1


class Sums(NamedTuple):
    """Sums of rows' log densities and of their derivatives with respect to a rater's coordinates.

    A coordinate moves all rows of a rater: the shift of their expectations, and where raters differ in them, the log
    factor of c (a row's expectation without level and scale) and the log spread. Sums are over the rows of each rater,
    or of each rater and fabric if fabrics deviate: their first axes are (draws, raters) or (draws, raters, fabrics).
    """

    value: FloatArray
    """Log density, without further axes."""
    first: FloatArray
    """First derivatives, with an axis of coordinates."""
    second: FloatArray
    """Second derivatives, with two such axes."""
    safe: FloatArray
    """Second derivatives from rows of which none has a positive one; terms that vanish in expectation are left out, as
    in Fisher scoring."""

    @classmethod
    def of(cls, value: FloatArray, first: Sequence[FloatArray], second: Entries, safe: Entries) -> Self:
        """Return the sums from entries of the matrices on and below the diagonal; `safe` has those that differ."""
        whole = _symmetric(second, len(first))
        return cls(value, np.stack(first, axis=-1), whole, _symmetric(second | safe, len(first)) if safe else whole)

    def part(self, draws: Any) -> Self:
        """Return the sums at some of the draws."""
        return type(self)(*(values[draws] for values in self))


Entries = dict[tuple[int, int], FloatArray]
"""Entries of symmetric matrices by row and column, from the diagonal down."""


def _symmetric(entries: Entries, size: int) -> FloatArray:
    found = np.empty((*entries[0, 0].shape, size, size))
    for (i, j), values in entries.items():
        found[..., i, j] = found[..., j, i] = values
    return found


class Table:
    """Rows of all raters under an error law.

    Parameters
    ----------
    law
        Law of the errors.
    rater, fabric
        Rater and fabric of each row, shape (rows,), sorted by rater; raters are numbered without gaps.
    n_fabrics
        Number of fabrics.
    centre, spread
        Prior mean and standard deviation of the level mu.
    trust
        Weight of each row where the search for the mode starts, shape (rows,): less than 1 for an outlier.
    beyond
        Width taken for an interval without an end where the search for the mode starts [spreads of the errors].
    times
        Number of equal observations that each row stands for, shape (rows,); by default 1.
    answer
        Number of each row's answer, shape (rows,), without gaps: rows of one answer have the same contribution and the
        same interval, and are evaluated once where their raters' effects are equal. By default all differ.
    """

    def __init__(
        self,
        law: ErrorLaw,
        rater: IndexArray,
        fabric: IndexArray,
        n_fabrics: int,
        centre: float,
        spread: float,
        trust: FloatArray,
        beyond: float = 3.0,
        times: IndexArray | None = None,
        answer: IndexArray | None = None,
    ) -> None:
        self.law, self.rater, self.fabric, self.n_fabrics = law, rater, fabric, n_fabrics
        self.centre, self.spread, self.trust, self.beyond = centre, spread, trust, beyond
        self.times = np.ones(rater.size, np.float32) if times is None else times.astype(np.float32)
        """Number of observations of each row, in single precision, which rows in single precision keep."""
        self.answer = np.arange(rater.size) if answer is None else answer
        self.answers = np.unique(self.answer, return_index=True)[1]
        """A row of each answer, shape (answers,)."""
        self._times_of_answer = csr_array((self.times.astype(float), (self.answer, rater)))
        self.first = np.flatnonzero(np.diff(rater, prepend=-1))
        self.count = self.by_rater(np.ones(rater.size))
        self._by_fabric = np.argsort(rater * n_fabrics + fabric, kind="stable")
        cell = (rater * n_fabrics + fabric)[self._by_fabric]
        self._first_of_cell = np.flatnonzero(np.diff(cell, prepend=-1))
        self._cells = cell[self._first_of_cell]

    @property
    def n_raters(self) -> int:
        """Number of raters."""
        return self.first.size

    def mu(self, level: FloatArray) -> FloatArray:
        """Return mu for zeta."""
        return self.centre + self.spread * level

    def middles(self, given: Given) -> tuple[FloatArray, FloatArray]:
        """Return middle and width of each interval, (rows,) or (draws, rows), with `beyond` as that of open ones."""
        low, high = given.rows.low, given.rows.high
        if not np.isfinite(high - low).all():
            low, high = (
                np.where(np.isfinite(low), low, high - self.beyond * given.spread),
                np.where(np.isfinite(high), high, low + self.beyond * given.spread),
            )
        return 0.5 * (low + high), high - low

    def effects(self, given: Given, values: FloatArray) -> UnitEffects:
        """Return views of all effects' values, shape (draws, effects): the level, raters' own, then fabrics'."""
        shape = len(values), self.n_raters, len(given.effects)
        last = 1 + shape[1] * shape[2]
        return UnitEffects(values[:, 0], values[:, 1:last].reshape(shape), values[:, last:])

    def expectations(self, given: Given, effects: UnitEffects) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return each row's expectation, its c, and the spread of its errors, each (draws, rows) or (draws, 1)."""
        scale = self.mu(effects.level)[:, None] + given.tau * effects.own[..., 0]
        c, spread, k = given.drive, given.spread, 1
        if given.omega is not None:
            c = c + given.omega * effects.fabric[:, self.fabric]
        if given.tau_gamma is not None:
            c = np.exp(given.tau_gamma * effects.own[..., k])[:, self.rater] * c
            k += 1
        if given.tau_varsigma is not None:
            spread = (spread * np.exp(given.tau_varsigma * effects.own[..., k]))[:, self.rater]
        return scale[:, self.rater] + c, c, spread

    def sums(self, given: Given, effects: UnitEffects) -> Sums:
        """Return the sums over rows given all effects."""
        expected, c, spread = self.expectations(given, effects)
        noise = given.tau_varsigma is not None
        terms = RowLaw(self.law, given.rows, expected, spread, given.law_parameters, np.float32).terms(noise)
        add, mean, bend = self._summing(given), terms.of_mean, terms.of_mean2
        first, second = [add(mean)], {(0, 0): add(bend)}
        safe: Entries = {} if self.law.concave else {(0, 0): add(np.minimum(bend, 0.0))}
        if given.tau_gamma is not None:
            squared = add(bend * c * c)
            first.append(add(mean * c))
            second |= {(1, 0): add(bend * c), (1, 1): squared + first[1]}
            safe[1, 1] = squared
        if given.tau_varsigma is not None:
            k, both = len(first), terms.of_both
            second |= {(k, j): add(both * c if j else both) for j in range(k)} | {(k, k): add(terms.of_noise2)}
            safe |= {(k, j): 0.0 * first[j] for j in range(k)} | {(k, k): add(np.minimum(terms.of_noise2, -0.5))}
            first.append(add(terms.of_noise))
        return Sums.of(add(terms.value), first, second, safe)

    def row_law(self, given: Given, points: Points) -> RowLaw:
        """Return the law of rows at points, (draws, points, rows), without omega.

        Rows are those of `answers` if all raters have the same points.
        """
        rater, some = (slice(None), self.answers) if points.shared else (self.rater, slice(None))

        def of_rows(values: FloatArray) -> FloatArray:
            return np.swapaxes(values, -1, -2)[..., rater]

        c, spread, k = given.drive[:, None, some], given.spread[:, None], 0
        if given.tau_gamma is not None:
            c = np.exp(given.tau_gamma[:, None] * of_rows(points.others[..., k])) * c
            k += 1
        if given.tau_varsigma is not None:
            spread = spread * np.exp(given.tau_varsigma[:, None] * of_rows(points.others[..., k]))
        parameters = given.law_parameters.each(lambda value: value[:, None])
        return RowLaw(self.law, given.rows.take(some).at_points(), of_rows(points.scale) + c, spread, parameters)

    def of_raters(self, given: Given, points: Points) -> FloatArray:
        """Return the log density of each rater's rows at points, (draws, raters, points)."""
        each, rows = [], self.answers.size if points.shared else self.rater.size
        for some in pieces(points.scale.shape[-1], rows * len(points.scale), BLOCK):
            part = Points(points.scale[..., some], points.others[..., some, :], points.log_weight[..., some])
            value = self.row_law(given, part).log_probability()
            if points.shared:
                value = (value.reshape(-1, rows) @ self._times_of_answer).reshape(*value.shape[:2], -1)
            else:
                value = self.by_rater(value)
            each.append(np.swapaxes(value, -1, -2))
        return np.concatenate(each, axis=-1)

    def by_rater(self, values: FloatArray) -> FloatArray:
        """Return the sums over each rater's observations, of rows (..., rows), in double precision, (..., raters)."""
        return np.asarray(np.add.reduceat(values * self.times, self.first, axis=-1, dtype=float))

    def _summing(self, given: Given) -> Any:
        """Return a function that adds rows (draws, rows) by rater, or by rater and fabric if fabrics deviate."""
        if given.omega is None:
            return self.by_rater

        def by_cell(values: FloatArray) -> FloatArray:
            found = np.zeros((len(values), self.n_raters * self.n_fabrics))
            ordered = (values * self.times)[:, self._by_fabric]
            found[:, self._cells] = np.add.reduceat(ordered, self._first_of_cell, axis=-1, dtype=float)
            return found.reshape(len(values), self.n_raters, self.n_fabrics)

        return by_cell

    def start(self, given: Given) -> FloatArray:
        """Return effects near the mode, (draws, effects): those of normal rows, one after the other, fabrics' 0.

        An interval counts as its middle, with the variance that rounding to it adds.
        """
        shape, k, add = (len(given.drive), self.n_raters), 1, self.by_rater
        middle, width = self.middles(given)
        weight = self.trust / (given.spread**2 + width**2 / 12.0)
        precision = add(weight)
        mean = add(weight * (middle - given.drive)) / precision - self.centre
        kept = precision / (1.0 + given.tau**2 * precision)
        level = self.spread * (kept * mean).sum(axis=-1) / (1.0 + self.spread**2 * kept.sum(axis=-1))
        own = np.zeros((*shape, len(given.effects)))
        own[..., 0] = given.tau * kept * (mean - self.spread * level[:, None])
        if len(given.effects) > 1:
            left = middle - given.drive - (self.mu(level)[:, None] + given.tau * own[..., 0])[:, self.rater]
            if (tau := given.tau_gamma) is not None:
                about = given.drive - (add(weight * given.drive) / precision)[:, self.rater]
                own[..., k] = tau * add(weight * left * about) / (1.0 + tau**2 * add(weight * about**2))
                left, k = left - (tau * own[..., k])[:, self.rater] * about, k + 1
            if (tau := given.tau_varsigma) is not None:
                number = add(self.trust)
                excess = np.log((add(weight * left**2) + 1.0) / (number + 1.0))
                own[..., k] = tau * number * excess / (1.0 + 2.0 * tau**2 * number)
        fabric = np.zeros((shape[0], 0 if given.omega is None else self.n_fabrics))
        return np.concatenate([level[:, None], own.reshape(shape[0], -1), fabric], axis=1)


class NormalTable(Table):
    """Exact numbers with normal errors, by sums over each rater's rows that do not depend on the effects.

    With n rows of mean y and mean drive d, and sums of squares and products about them, the sum of squared errors is
    n (y - a - g d)² + S_yy - 2 g S_yd + g² S_dd. Where fabrics deviate, rows are evaluated one by one.
    """

    def __init__(self, *how: Any, values: FloatArray) -> None:
        super().__init__(*how)
        self._mean = self._means(values)
        self._apart = values - self._mean[self.rater]
        self._squares = self.by_rater(self._apart**2)

    def _means(self, values: FloatArray) -> FloatArray:
        return self.by_rater(values) / self.count

    def with_moments(self, given: Given) -> Given:
        """Return the same with `Given.moments`."""
        mean = self._means(given.drive)
        apart = given.drive - mean[:, self.rater]
        products = self.by_rater(apart * self._apart)
        return replace(given, moments=np.stack([mean, products, self.by_rater(apart**2)], axis=-1))

    def sums(self, given: Given, effects: UnitEffects) -> Sums:
        """Return the sums over rows given all effects."""
        if given.moments is None or given.omega is not None:
            return super().sums(given, effects)
        scale = self.mu(effects.level)[:, None] + given.tau * effects.own[..., 0]
        g, noise, left, squares = self._errors(given, scale[..., None], effects.own[..., None, 1:])
        g, noise, left, squares = (value[..., 0] for value in (g, noise, left, squares))
        (d, products, drives), n, precision = np.moveaxis(given.moments, -1, 0), self.count, noise**-2
        mean, bend = n * left * precision, np.broadcast_to(-n * precision, left.shape)
        first, second = [mean], {(0, 0): bend}
        safe: Entries = {}
        if given.tau_gamma is not None:
            c, squared = g * d, -(g**2) * (drives + n * d**2) * precision
            first.append((n * left * c + g * (products - g * drives)) * precision)
            second |= {(1, 0): bend * c, (1, 1): squared + first[1]}
            safe |= {(1, 1): squared}
        if given.tau_varsigma is not None:
            k, noise2 = len(first), -2.0 * squares * precision
            second |= {(k, j): -2.0 * first[j] for j in range(k)} | {(k, k): noise2}
            safe |= {(k, j): 0.0 * first[j] for j in range(k)} | {(k, k): np.minimum(noise2, -0.5 * n)}
            first.append(squares * precision - n)
        value = -0.5 * squares * precision - n * (np.log(noise) + 0.5 * LOG_TWO_PI)
        return Sums.of(value, first, second, safe)

    def of_raters(self, given: Given, points: Points) -> FloatArray:
        """Return the log density of each rater's rows at points, (draws, raters, points)."""
        if given.moments is None:
            return super().of_raters(given, points)
        _, noise, _, squares = self._errors(given, points.scale, points.others)
        return -0.5 * squares / noise**2 - self.count[:, None] * (np.log(noise) + 0.5 * LOG_TWO_PI)

    def _errors(self, given: Given, scale: FloatArray, others: FloatArray) -> tuple[FloatArray, ...]:
        """Return each rater's factor g of the drive, noise, y - a - g d and sum of squared errors, at `Points`."""
        k, g, noise = 0, np.ones(1), given.spread[..., None]
        if given.tau_gamma is not None:
            g, k = np.exp(given.tau_gamma[..., None] * others[..., 0]), 1
        if given.tau_varsigma is not None:
            noise = noise * np.exp(given.tau_varsigma[..., None] * others[..., k])
        d, products, drives = np.moveaxis(np.asarray(given.moments)[..., None], -2, 0)
        left = self._mean[:, None] - scale - g * d
        squares = self.count[:, None] * left**2 + self._squares[:, None] - 2.0 * g * products + g**2 * drives
        return g, noise, left, squares
