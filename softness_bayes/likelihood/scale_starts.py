"""Points near the modes of raters' scales, from which their search starts, and every row's error there (model.md 9)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfcx

from softness_bayes.likelihood.error_laws import NORMAL, ErrorLaw
from softness_bayes.likelihood.interval_law import clipped
from softness_bayes.likelihood.midpoints import lapse_density, weights
from softness_bayes.likelihood.pieces import blocks
from softness_bayes.likelihood.rater_rows import LawParameters, RowParameters, WidthGroup
from softness_bayes.likelihood.row_columns import ROOM, Columns, over_columns
from softness_bayes.likelihood.scale_modes import ScaleModes

FloatArray = NDArray[np.float64]

_FAR = -1e3  # spreads beyond an end
_ROOT_TWO_OVER_PI = math.sqrt(2.0 / math.pi)
_NO_WEIGHT = 1e-3  # replaces the total weight 0 of a rater without narrow intervals as a divisor
_LEAST_BEND = 0.3  # of the curvature, relative to the total weight


class Start(NamedTuple):
    """Points near the modes, and the errors of rows about other points, which are somewhat farther."""

    a: FloatArray
    """Points, shape (draws, raters)."""
    about: FloatArray
    """Other points, of the same shape."""
    errors: FloatArray
    """Middles of the intervals less their expectations at these, in spreads, shape (length, columns, draws); 0 at
    places without a row."""

    def part(self, piece: Any) -> Start:
        """Return some of the draws."""
        return Start(self.a[piece], self.about[piece], self.errors[..., piece])


class Steps(Protocol):
    """The part of `rater_integrals.RaterIntegrals` that is needed here."""

    walled: NDArray[np.intp]

    def step(self, given: RowParameters, a: FloatArray, slope: FloatArray, curvature: FloatArray) -> ScaleModes:
        """Return a Newton step from points a_p (draws, raters)."""

    def least_curvature(self, given: RowParameters, a: FloatArray, slope: FloatArray) -> FloatArray:
        """Return the smallest curvature of a rater's log density for such a step."""


class Starts:
    """Points from which Newton's method starts, for one table of ratings.

    Parameters
    ----------
    law
        Law of the errors.
    columns
        The arrangement of rows.
    weight
        Weight of each row's midpoint, (rows,); 0 if an end of its interval is infinite.
    certain
        Factor of the weight that depends on the interval alone.
    open_ended
        Groups of the rows with weight 0.
    """

    def __init__(
        self,
        law: ErrorLaw,
        columns: Columns,
        weight: FloatArray,
        certain: FloatArray,
        open_ended: Sequence[WidthGroup],
    ) -> None:
        self._law, self._columns, self._open = law, columns, open_ended
        self._weight, self._certain = (columns.placed(one)[..., 0] * columns.times for one in (weight, certain))
        self._whole = columns.of_raters(self._weight.sum(axis=0)[:, None])[:, 0]

    def near(self, steps: Steps, given: RowParameters, single: bool) -> Start:
        """Return points near the modes: from midpoints of intervals first, then with those that have one end added.

        Parameters
        ----------
        steps
            Newton's method.
        given
            Parameters.
        single
            True for errors of single precision.
        """
        draws, columns = len(given.drive), self._columns
        about, slope, curvature = (np.empty((draws, self._whole.size)) for _ in range(3))
        errors = np.empty((*columns.rows.shape, draws), np.float32 if single else float)
        for block in blocks(draws, columns.rows.size, ROOM):
            part = given.part(block)
            left = columns.placed(part.drive)
            np.subtract(columns.placed(part.middle), left, out=left)
            mean = columns.of_raters(np.einsum("sc,scd->cd", self._weight, left)).T
            mean = mean / np.maximum(self._whole, _NO_WEIGHT)
            flat = self._whole / part.spread**2
            here = steps.step(part, mean, np.zeros(mean.shape), flat).a
            left -= columns.of_columns(here)
            left *= 1.0 / part.spread[:, 0]
            left.reshape(columns.times.size, -1)[columns.empty] = 0.0
            errors[..., block] = left
            if self._law == NORMAL:
                pull, bent = (mean - here) * flat, flat
            else:
                pull, bent = self.pulls(errors[..., block], part)
                pull, bent = pull / part.spread, bent / part.spread**2
            about[block], slope[block], curvature[block] = here, pull, bent
        if self._open:
            pull, bent = self.pulls_of_ends(given, about)
            slope += pull / given.spread
            curvature += bent / given.spread**2
            own = steps.walled  # raters without other rows
            if own.size:
                least = steps.least_curvature(given, about, pull / given.spread)
                curvature[:, own] = np.maximum(curvature, least)[:, own]
        return Start(steps.step(given, about, slope, curvature).a, about, errors)

    def pulls(self, errors: FloatArray, given: RowParameters) -> tuple[FloatArray, FloatArray]:
        """Return slopes and curvatures of raters' log densities at midpoints, in spreads, each (draws, raters)."""
        law, columns, kind, (length, width, _) = self._law, self._columns, errors.dtype, errors.shape
        # draws stand in columns, and an axis for rows, of length 1, follows them
        parameters: Any = LawParameters(*(over_columns(one.astype(kind), width) for one in given.parameters))
        lapsed: Any = 0.0
        if law.lapses:
            scale = given.spread[:, 0] * np.exp(-law.log_peak(given.parameters))
            lapsed = columns.placed(lapse_density(given.rows)) * (given.parameters.lapse * scale)
            lapsed = lapsed.astype(kind).reshape(length, -1, 1)
        both = weights(law, errors.reshape(length, -1, 1), parameters, lapsed)
        weight, bend = (part.reshape(errors.shape) for part in both)
        weight *= self._certain[..., None].astype(kind)
        total = weight.sum(axis=0)
        pull, bent = (np.einsum("scd,scd->cd", weight, one) for one in (errors, bend))
        total, pull, bent = (columns.of_raters(one).T for one in (total, pull, bent))
        return pull, np.maximum(bent, _LEAST_BEND * total)

    def pulls_of_ends(self, given: RowParameters, a: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the same of rows with one finite end, or none, at points a_p (draws, raters).

        The normal law is near enough to others here.
        """
        slope, curvature = np.zeros(a.shape), np.zeros(a.shape)
        for group in self._open:
            low, high = given.rows.low[..., group.rows], given.rows.high[..., group.rows]
            side = np.where(np.isinf(low), 1.0, -1.0)
            x = np.where(side > 0.0, high, low) - given.drive[:, group.rows]
            x = clipped(side * (x - group.of_rows(a)) / given.spread)
            # the inverse Mills ratio; far out its digits cancel in the curvature, which is 1 there
            ratio = _ROOT_TWO_OVER_PI / erfcx(-x / math.sqrt(2.0))
            slope[:, group.raters] -= group.of_raters(side * ratio)
            curvature[:, group.raters] += group.of_raters(np.where(x < _FAR, 1.0, ratio * (ratio + x)))
        return slope, curvature
