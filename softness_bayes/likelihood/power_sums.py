"""Sums of narrow intervals' log probabilities, and of their derivatives, over each rater's rows (model.md 9).

The series of `narrow_series` are polynomials whose coefficients depend on the draw alone. Sums of a few products of
powers over a rater's rows thus give the sums of the log probabilities and of all their derivatives.
"""

from __future__ import annotations

from functools import cache
from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood import student
from softness_bayes.likelihood.narrow_series import series
from softness_bayes.likelihood.row_columns import Columns, over_columns

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.intp]


class Power(NamedTuple):
    """A product of z and H to powers `z` and `h`, times p u if it is odd."""

    odd: bool
    h: int
    z: int


_NONE = Power(False, 0, 0)


def power_sums(
    columns: Columns,
    times: FloatArray,
    u: FloatArray,
    square: tuple[FloatArray, FloatArray] | None,
    nu: FloatArray | None,
) -> FloatArray:
    """Return sums over raters' rows of log densities averaged over narrow intervals, and of their derivatives.

    Log densities are relative to that at 0.

    Parameters
    ----------
    columns
        The arrangement of rows.
    times
        Multiplicity of the row at each place, shape (length, columns).
    u
        Middles of the intervals in spreads of the errors, shape (length, columns, draws), of any precision; 0 where
        `times` is.
    square
        Squares of their half-widths in spreads, as two factors, (length, columns, 1 or draws) and (draws,); None for
        exact numbers.
    nu
        Degrees of freedom, shape (draws,); None for normal errors.

    Returns
    -------
    ndarray
        Value and four derivatives, shape (draws, 5, raters).
    """
    t = np.zeros(u.shape[-1]) if nu is None else 1.0 / nu
    powers, of_h, table = _terms(square is not None, nu is None)
    factor, scale = (None, np.ones(1)) if square is None else square
    log, found = _sums(powers, u, factor, nu, None if (times <= 1.0).all() else times[..., None])
    found[-1] = times.sum(axis=0)[:, None]
    each = np.ascontiguousarray(columns.of_raters(found).transpose(2, 0, 1))
    coefficients = np.vander(t, len(table), increasing=True) @ table.reshape(len(table), -1)
    of_scale = np.vander(scale, 1 + of_h.max(), increasing=True)[:, of_h]
    coefficients = coefficients.reshape(t.size, *table.shape[1:]) * of_scale[:, None]
    values = (coefficients.astype(u.dtype) @ each).astype(float)
    values[:, 0] += columns.of_raters(log).T
    return values


@cache
def _terms(rounded: bool, normal: bool) -> tuple[tuple[Power, ...], IndexArray, FloatArray]:
    """Return the products whose sums are needed, their powers of H, and the coefficients of value and derivatives.

    Coefficients have the shape (powers of t, derivatives, products). The last product is 1.
    """
    # normal errors have t = 0, and thus fewer products
    each = [
        (Power(n % 2 == 1, j, k), n, part[: 1 if normal else None, k])
        for n, parts in enumerate(series())
        for j, part in enumerate(parts if rounded else parts[:1])
        for k in range(part.shape[1])
    ]
    each = [one for one in each if one[2].any()]
    powers = [*sorted({power for power, _, _ in each} - {_NONE}), _NONE]
    table = np.zeros((max(values.size for _, _, values in each), len(series()), len(powers)))
    for power, n, values in each:
        table[: values.size, n, powers.index(power)] = values
    return tuple(powers), np.array([one.h for one in powers]), table


def _sums(
    powers: tuple[Power, ...],
    errors: FloatArray,
    square: FloatArray | None,
    nu: FloatArray | None,
    times: FloatArray | None,
) -> tuple[FloatArray, FloatArray]:
    """Return sums over each column of the log density, (columns, draws), and of products, (products, columns, draws).

    The last product is left empty.
    """
    shape, kind = errors.shape[1:], errors.dtype

    def counted(values: FloatArray) -> FloatArray:
        """Return values times multiplicities."""
        return values if times is None else (values.reshape(errors.shape) * times.astype(kind)).reshape(u.shape)

    # long inner axes are faster
    u = errors.reshape(len(errors), -1)
    z, high = u * u, np.zeros((1, 1, 1), kind) if square is None else square
    if nu is None:
        log, q = -0.5 * counted(z).sum(axis=0, dtype=float), u
    else:
        p = z * over_columns((1.0 / nu).astype(kind), shape[0])
        log = counted(student.log_one_plus(p, nu)).sum(axis=0, dtype=float) * over_columns(-0.5 * (nu + 1.0), shape[0])
        p += 1.0
        np.divide(1.0, p, out=p)
        q = u * p
        z *= p
        high = p.reshape(errors.shape) * high
    high = np.broadcast_to(high, errors.shape).reshape(u.shape)
    by_z = [z, z]  # the first has no use
    for _ in range(2, 1 + max(power.z for power in powers)):
        by_z.append(by_z[-1] * z)
    found, base = np.empty((len(powers), u.shape[1]), kind), z
    for (odd, h), group in groupby(enumerate(powers[:-1]), key=lambda item: item[1][:2]):
        fresh = {(False, 0): z, (False, 1): high, (True, 0): q}.get((odd, h))
        base = base * high if fresh is None else counted(fresh)
        for i, power in group:
            k = power.z if odd or h else power.z - 1  # that base is z itself
            if k:
                np.einsum("sx,sx->x", base, by_z[k], out=found[i])
            else:
                np.add.reduce(base, axis=0, out=found[i])
    return log.reshape(shape), found.reshape(-1, *shape)
