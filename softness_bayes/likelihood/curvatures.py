"""Curvatures of raters' log densities, against the expected ones: where rules about the mode fail (model.md 9).

Each row's expected curvature is that of its error law. With noise in a draw that is unlike the residuals, rows have
another one.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood import several_maxima, student
from softness_bayes.likelihood.error_laws import ErrorLaw
from softness_bayes.likelihood.interval_law import Rows, derivatives
from softness_bayes.likelihood.quadrature import MANY_ROWS
from softness_bayes.likelihood.rater_rows import RowParameters
from softness_bayes.likelihood.scale_modes import ScaleModes

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

CONCAVE = 0.7
"""Ratio of the curvature of a rater's log density at the mode to the expected one, below which there may be further
maxima. Over 1000 draws of the prior, with Student's t or lapses, on exact and on whole numbers, errors of more than
8e-4 by rules about the mode had ratios of at most 0.69."""

OTHER_SIXTH = 2e-4
"""Largest error of the log density from sixth derivatives that are not the expected ones, if they differ as much as the
fourth do. Such draws have noise unlike the residuals: by the expected derivatives, errors were up to 2e-3."""


class Scales(several_maxima.Scales, Protocol):
    """The part of `rater_integrals.RaterIntegrals` that is needed here."""

    rater: NDArray[np.intp]
    """Rater of each row."""
    walled: NDArray[np.intp]
    """Raters whose intervals all have an open end."""

    def of_raters(self, values: FloatArray) -> FloatArray:
        """Return the sums of rows by rater."""


def may_have_several_maxima(scales: Scales, given: RowParameters, modes: ScaleModes) -> Mask:
    """Return True for draws at which a rater's density may have several maxima, (draws,).

    The curvature at the mode is then smaller than expected, because many rows are outlying. With few rows (`MANY_ROWS`)
    that happens by chance.
    """
    law = scales.law
    heavy = law.lapses or law.sixth_over_fourth is not None
    if not heavy or scales.count.min() < MANY_ROWS or scales.walled.size:
        return np.zeros(len(given.drive), dtype=bool)
    found = _least(scales, given, modes.curvature) < CONCAVE
    if found.any():
        part = given.part(found)
        bent = _least(scales, part, _without_widths(scales, part, modes.a[found])) < CONCAVE
        found[found] = bent & several_maxima.feasible(scales, part)
    return found


def have_other_sixth(scales: Scales, given: RowParameters, modes: ScaleModes) -> Mask:
    """Return True for draws at which sixth derivatives of a law with heavy tails are not the expected ones, (draws,).

    Fourth derivatives are known, and then differ from the expected ones too.
    """
    ratio = scales.law.sixth_over_fourth
    if ratio is None:
        return np.zeros(len(given.drive), dtype=bool)
    fourth = student.expected_fourth(given.parameters.nu)[:, None] * scales.count / given.spread**4
    return np.abs(effect_of_sixth(ratio(given.parameters), given, modes, modes.slopes[4] - fourth)) > OTHER_SIXTH


def effect_of_sixth(ratio: FloatArray, given: RowParameters, modes: ScaleModes, fourth: FloatArray) -> FloatArray:
    """Return the mean effect of sixth derivatives on the log density, (draws,).

    Parameters
    ----------
    ratio
        Sixth derivatives over fourth ones, in units of the spread, (draws, 1).
    given, modes
        Parameters and modes.
    fourth
        Fourth derivatives of the raters' log densities, (draws, raters).
    """
    square = modes.width * modes.width
    return np.asarray(15.0 / 720.0 * (ratio / given.spread**2 * fourth * square * square * square).sum(axis=-1))


def expected(law: ErrorLaw, given: RowParameters) -> FloatArray:
    """Return the expected curvature of the log density of an exact number, relative to a normal one, (draws,)."""
    share = 1.0 - given.parameters.lapse if law.lapses else np.ones(len(given.drive))
    return share if law.sixth_over_fourth is None else share * student.expected_curvature(given.parameters.nu)


def _least(scales: Scales, given: RowParameters, curvature: FloatArray) -> FloatArray:
    """Return the smallest ratio of raters' curvatures (draws, raters) to the expected ones, (draws,)."""
    each = curvature * given.spread**2 / scales.count
    return np.asarray(each.min(axis=-1) / expected(scales.law, given))


def _without_widths(scales: Scales, given: RowParameters, a: FloatArray) -> FloatArray:
    """Return raters' curvatures at a_p (draws, raters) with intervals replaced by their nearest points, same shape.

    Wide intervals have small curvatures, but further maxima only if they are far away.
    """
    rows, at = given.rows, given.drive + a[:, scales.rater]
    nearest, width = np.clip(at, rows.low, rows.high), rows.high - rows.low
    lapse = rows.lapse - np.log(np.where((width > 0.0) & np.isfinite(width), width, 1.0))
    exact = Rows(nearest, nearest, np.broadcast_to(lapse, nearest.shape))
    return scales.of_raters(-derivatives(scales.law, exact, at, given.spread, given.parameters)[2])
