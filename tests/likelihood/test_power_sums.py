"""Sums over raters' rows of the series of narrow intervals, against sums of the same series row by row."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from softness_bayes.likelihood import student
from softness_bayes.likelihood.narrow_intervals import averaged
from softness_bayes.likelihood.narrow_series import series
from softness_bayes.likelihood.power_sums import power_sums
from softness_bayes.likelihood.row_columns import in_columns

SIZES = {
    "equal": np.full(6, 9),
    "unequal": np.array([40, 2, 1, 7]),
    "one rater": np.array([12]),
    "one row": np.array([1]),
}
DRAWS = 5


def made(sizes, folded, rng):
    """Raters of rows, their multiplicities, middles (draws, rows) and squares of half-widths (rows,)."""
    rater = np.repeat(np.arange(sizes.size), sizes)
    times = rng.integers(0, 4, rater.size).astype(float) if folded else np.ones(rater.size)
    times[np.cumsum(sizes) - sizes] = 2.0 if folded else 1.0
    return rater, times, rng.standard_normal((DRAWS, rater.size)), rng.uniform(0.0, 0.2, rater.size)


def placed(columns, values, kind=float):
    """Values at their places, 0 at empty ones."""
    found = columns.placed(np.broadcast_to(values, (DRAWS, values.shape[-1]))).astype(kind)
    found[columns.times == 0.0] = 0.0
    return found


def by_row(rater, times, errors, square, nu):
    """The same sums row by row, less the log density at 0."""
    each = averaged(errors, None if square is None else np.broadcast_to(square, errors.shape), nu)
    at_zero = -0.5 * np.log(2.0 * np.pi) if nu is None else student.log_constant(nu)
    each = each[0] - at_zero, *each[1:]
    return np.stack([[np.bincount(rater, times * one) for one in part] for part in each], axis=1)


@pytest.mark.parametrize("folded", [False, True], ids=["rows once", "rows with multiplicity"])
@pytest.mark.parametrize("sizes", SIZES.values(), ids=list(SIZES))
def test_sums_are_those_of_the_rows(sizes, folded):
    rng = np.random.default_rng(1)
    rater, times, errors, square = made(sizes, folded, rng)
    columns = in_columns(rater, times)
    for nu in (np.array([0.5, 2.0, 4.0, 9.0, 1e6]), None):
        wide = None if nu is None else nu[:, None]
        scale = np.linspace(0.5, 2.0, DRAWS)
        factor = placed(columns, square / scale[:, None])
        found = power_sums(columns, columns.times, placed(columns, errors), (factor, scale), nu)
        wanted = by_row(rater, times, errors, square, wide)
        assert_allclose(found[:, : wanted.shape[1]], wanted, rtol=1e-11, atol=1e-10)
        if nu is None:  # row by row, normal errors have fewer derivatives
            limit = by_row(rater, times, errors, square, np.full((DRAWS, 1), 1e9))
            assert_allclose(found, limit, rtol=1e-5, atol=1e-5)
        single = power_sums(
            columns, columns.times, placed(columns, errors, np.float32), (factor.astype(np.float32), scale), nu
        )
        error = np.abs(single - found).max(axis=(0, 2)) / np.maximum(np.abs(found).max(axis=(0, 2)), 1e-9)
        assert (error < [2e-6, 1e-5, 1e-5, 1e-4, 1e-4]).all()
        assert (error > 1e-12).any()  # the precision is in fact lower
    exact = power_sums(columns, columns.times, placed(columns, errors), None, np.full(DRAWS, 3.0))
    assert_allclose(exact, by_row(rater, times, errors, None, np.full((DRAWS, 1), 3.0)), rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("sizes", SIZES.values(), ids=list(SIZES))
def test_every_row_has_a_place(sizes):
    rater, times, errors, _ = made(sizes, True, np.random.default_rng(2))
    columns = in_columns(rater, times)
    assert sorted(columns.rows[columns.times > 0.0]) == list(np.flatnonzero(times))
    assert (rater[columns.rows] == columns.rater)[columns.times > 0.0].all()
    wanted = np.stack([np.bincount(rater, times * one) for one in errors])
    assert_allclose(columns.sums_of(errors), wanted, atol=1e-12)
    assert_allclose(columns.sums_of(errors[0]), wanted[:1], atol=1e-12)
    scales = np.random.default_rng(3).standard_normal((DRAWS, sizes.size))
    assert_allclose(columns.of_columns(scales), scales.T[columns.rater])
    assert columns.rows.size < 1.6 * (times > 0.0).sum()  # few places stay empty


def test_coefficients_are_derivatives_of_one_another():
    """In steps of u, at the highest power of H that two successive derivatives share."""
    parts, u, h2, t, step = series((3, 3, 3, 3, 3)), np.linspace(-2.0, 2.0, 9), 0.04, 0.3, 1e-5

    def at(n, u):
        p = 1.0 / (1.0 + t * u * u)
        powers = t ** np.arange(max(len(part) for part in parts[n]))
        each = [np.polynomial.polynomial.polyval(p * u * u, powers[: len(part)] @ part) for part in parts[n]]
        found = sum((p * h2) ** j * part for j, part in enumerate(each))
        return found * p * u if n % 2 else found + (n == 0) * (1.0 + t) / (2.0 * t) * np.log(p)

    for n in range(1, 5):
        difference = (at(n - 1, u + step) - at(n - 1, u - step)) / (2.0 * step)
        assert_allclose(at(n, u), difference, rtol=1e-7, atol=1e-7)
