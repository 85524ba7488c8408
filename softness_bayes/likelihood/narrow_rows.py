"""Rows with narrow intervals among those of a batch of draws, and sums of their log probabilities (model.md 9)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood import student
from softness_bayes.likelihood.error_laws import NORMAL, ErrorLaw
from softness_bayes.likelihood.interval_law import MOST_OTHERS, in_any_draw
from softness_bayes.likelihood.narrow_series import FLAT, STEEPEST, WIDEST
from softness_bayes.likelihood.power_sums import power_sums
from softness_bayes.likelihood.rater_rows import Kept, RowParameters
from softness_bayes.likelihood.row_columns import Columns
from softness_bayes.likelihood.scale_starts import Start

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

_LEAST_SQUARE = 1e-6  # of a half-width in spreads


class Widths(NamedTuple):
    """Widths of the narrow rows, given which these are."""

    times: FloatArray
    """Multiplicity of the row at each place, shape (length, columns); 0 for other rows."""
    absent: NDArray[np.intp]
    """Places where `times` is 0, as indices of the flattened array."""
    square: FloatArray
    """Square of each interval's half-width over that of the widest one, (length, columns, 1) or (..., draws)."""
    largest: float
    """Square of the half-width of the widest one."""
    log_width: FloatArray
    """Sum over each rater's rows of the log width, (1, raters) or (draws, raters); that of exact numbers is 0."""
    rows: FloatArray
    """Number of each rater's rows, shape (1, raters)."""


class NarrowRows:
    """The rows of one table whose log probability, and its derivatives, are series in the width of their intervals.

    Parameters
    ----------
    law
        Law of the errors, with a series.
    columns
        The arrangement of rows.
    """

    def __init__(self, law: ErrorLaw, columns: Columns) -> None:
        self._law, self._columns = law, columns
        self._known: Kept[Widths] = Kept()

    def slopes(self, given: RowParameters, start: Start, a: FloatArray) -> tuple[FloatArray, Mask] | None:
        """Return sums of log probabilities and four derivatives at a_p over each rater's narrow rows.

        Parameters
        ----------
        given
            Parameters.
        start
            Errors of the rows.
        a
            Raters' scales, near those about which the errors are, shape (draws, raters).

        Returns
        -------
        found, others
            The sums, (5, draws, raters), with respect to the expectation in spreads, and a mask of the other rows. None
            if most rows are others.
        """
        law, columns, parameters = self._law, self._columns, given.parameters
        half = 0.5 * (given.rows.high - given.rows.low)
        widest = WIDEST * law.smooth(parameters)
        others = in_any_draw(half > float((widest * given.spread).min()))
        if others.sum() > MOST_OTHERS * others.size:
            return None
        u = columns.of_columns((a - start.about) / given.spread).astype(start.errors.dtype) - start.errors
        inverse = given.spread[:, 0] ** -2.0
        widths = self._widths(half, others)
        if widths.largest and not (law.steepest(parameters, math.inf) * widest).max() ** 2 <= FLAT:
            steep = self._steep(given, u, widths.square, widths.largest * inverse)
            if steep.any():
                others = others | steep
                widths = self._widths(half, others)
        u.reshape(widths.times.size, -1)[widths.absent] = 0.0  # a view, because u is new
        square = (widths.square.astype(u.dtype), widths.largest * inverse) if widths.largest else None
        nu = None if law == NORMAL else np.maximum(parameters.nu, student.LEAST)
        found = power_sums(columns, widths.times, u, square, nu)
        level = law.log_peak(parameters) - np.log(given.spread)
        found[:, 0] += widths.rows * level + widths.log_width
        return np.ascontiguousarray(found.transpose(1, 0, 2)), others

    def _widths(self, half: FloatArray, others: Mask) -> Widths:
        """Return the widths of the narrow rows, given half-widths (rows,) or (draws, rows)."""
        if half.ndim > 1:
            return self._widths_of(half, others)
        return self._known(np.where(others, np.inf, half), lambda: self._widths_of(half, others))

    def _widths_of(self, half: FloatArray, others: Mask) -> Widths:
        columns = self._columns
        times = np.where(others[columns.rows], 0.0, columns.times)
        square, largest = np.where(others, 0.0, half * half), float(half.max(initial=0.0, where=~others)) ** 2
        return Widths(
            times,
            np.flatnonzero(times == 0.0),
            columns.placed(square) / (largest or 1.0) * (times > 0.0)[..., None],
            largest,
            columns.sums_of(np.log(np.where(square > 0.0, 2.0 * half, 1.0))),
            columns.of_raters(times.sum(axis=0)[:, None]).T,
        )

    def _steep(self, given: RowParameters, u: FloatArray, square: FloatArray, scale: FloatArray) -> Mask:
        """Return True for rows whose log density changes too much over their interval in any draw, shape (rows,)."""
        law, columns = self._law, self._columns
        change = u * u
        # the least width bounds the powers of exact numbers' errors as well
        change *= np.maximum(square.astype(u.dtype) * scale.astype(u.dtype), u.dtype.type(_LEAST_SQUARE))
        if law != NORMAL and change.max() > STEEPEST:
            weight = law.weight(u[..., None], given.parameters)[..., 0]
            change *= weight * weight
        found = np.zeros(given.drive.shape[-1], bool)
        if not change.max() <= STEEPEST:
            found[columns.rows[~(change.max(axis=-1) <= STEEPEST) & (columns.times > 0.0)]] = True
        return found
