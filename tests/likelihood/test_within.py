"""Additive fits and sums of squares within participants: by products alone, as by matrices of the conditions."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import multivariate_normal

from softness_bayes.likelihood import additive_fit
from softness_bayes.likelihood.additive_fit import AdditiveFit
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.random_effects import EffectSpreads, RandomEffects
from softness_bayes.likelihood.within import Dense, Sparse, within_of


def complete() -> np.ndarray:
    return np.ones((3, 40))


def gaps() -> np.ndarray:
    return (np.random.default_rng(1).random((7, 40)) < 0.5).astype(float)


def apart() -> np.ndarray:
    cells = np.zeros((6, 40))
    cells[:3, :20] = 1.0
    cells[3:, 20:] = [np.ones(20), np.arange(20) < 12, np.arange(20) > 4]
    return cells


def repeated() -> np.ndarray:
    return np.random.default_rng(2).poisson(1.0, (5, 30)).astype(float)


def with_a_silent_rater() -> np.ndarray:
    return np.vstack([np.zeros(30), repeated()])


TABLES = (complete, gaps, apart, repeated, with_a_silent_rater)


def design_of(cells: np.ndarray, fabrics: int = 0) -> Design:
    person, condition = np.nonzero(cells)
    number = cells[person, condition].astype(int)
    fabric = np.arange(cells.shape[1]) % (fabrics or cells.shape[1])
    return Design(np.repeat(condition, number), np.repeat(person, number), fabric, len(cells))


def laplacian(cells: np.ndarray) -> np.ndarray:
    return np.diag(cells.sum(axis=0)) - cells.T @ (cells / np.maximum(cells.sum(axis=1), 1.0)[:, None])


@pytest.mark.parametrize("made", TABLES)
def test_the_fit_is_the_pseudoinverse(made, rng):
    cells = made()
    fit, inverse = AdditiveFit(cells), np.linalg.pinv(laplacian(cells), hermitian=True)
    values = rng.standard_normal((2, 3, cells.shape[1]))
    assert_allclose(fit.product(values), values @ inverse, atol=1e-12)
    assert_allclose(fit.diagonal, np.diag(inverse), atol=1e-12)
    assert fit.parts == cells.shape[1] - np.linalg.matrix_rank(laplacian(cells), hermitian=True)


@pytest.mark.parametrize("made", TABLES)
@pytest.mark.parametrize("kind", [Dense, Sparse])
def test_sums_of_squares_are_those_of_the_residuals(made, kind, rng):
    design = design_of(made())
    y, values = rng.standard_normal(design.n_rows), rng.standard_normal((4, design.n_conditions))
    who, rows = design.participant, np.maximum(design.cells.sum(axis=1), 1.0)

    def about(x):
        return x - (np.bincount(who, x, rows.size) / rows)[who]

    expected = [(about(y - one[design.condition]) ** 2).sum() for one in values]
    assert_allclose(kind(design, about(y)).squares(values), expected, rtol=1e-12)


def test_what_does_not_depend_on_the_form(rng, monkeypatch):
    """Density, draws and laws of left-out rows of a table, by either form."""
    design = design_of(gaps(), fabrics=20)
    y, offset = rng.standard_normal(design.n_rows), rng.standard_normal((3, design.n_conditions))

    def all_of_it(omega):
        law, spreads = RandomEffects(design, y, 0.0, 1.0), EffectSpreads(0.5, 0.3, omega)
        drawn = law.draw_effects(np.random.default_rng(0), offset, spreads)
        return [
            law.log_density(offset, spreads),
            *drawn,
            *law.leave_one_out(offset, spreads),
        ]

    dense = [all_of_it(omega) for omega in (0.0, 0.4)]
    assert isinstance(within_of(design, y), Dense)
    monkeypatch.setattr(additive_fit, "MANY_CONDITIONS", 20)
    assert isinstance(within_of(design, y), Sparse)
    for one, other in zip(dense, [all_of_it(omega) for omega in (0.0, 0.4)], strict=True):
        for expected, found in zip(one, other, strict=True):
            assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("made", [complete, gaps])
def test_nothing_is_of_the_size_of_conditions_by_conditions(made):
    """For 4000 conditions such a matrix would have 16 million numbers."""
    design = design_of(np.tile(made(), 100))
    form, fit = Sparse(design, np.zeros(design.n_rows)), AdditiveFit(design.cells)
    for held in (form, fit):
        sizes = [value.size for value in vars(held).values() if isinstance(value, np.ndarray)]
        assert max(sizes) <= design.cells.size


def alike() -> np.ndarray:
    """Seven raters of three kinds, in no order, and two without ratings."""
    kinds = np.random.default_rng(3).poisson(1.0, (3, 12)).astype(float)
    return np.vstack([kinds, np.zeros((1, 12))])[[1, 3, 0, 1, 2, 0, 1, 3, 0]]


@pytest.mark.parametrize("omega", [0.0, 0.3])
def test_raters_of_like_rows_are_grouped_and_every_density_is_that_of_the_rows(omega, rng):
    cells = alike()
    design = design_of(cells, 5)
    values = 3.0 + 0.8 * rng.standard_normal(design.n_rows)
    effects = RandomEffects(design, values, 2.0, 1.5)
    assert effects._alike.number.sum() == len(cells)
    assert sorted(effects._alike.number) == [1, 2, 3, 3]
    offset, tau, varsigma = rng.standard_normal((6, 12)), rng.uniform(0.1, 1.0, 6), rng.uniform(0.1, 1.0, 6)
    found = effects.log_density(offset, EffectSpreads(tau, varsigma, np.full(6, omega)))
    person, fabric = np.eye(len(cells))[design.participant], np.eye(5)[design.fabric[design.condition]]
    for k in range(6):
        covariance = 1.5**2 + tau[k] ** 2 * person @ person.T + omega**2 * fabric @ fabric.T
        covariance += varsigma[k] ** 2 * np.eye(design.n_rows)
        exact = multivariate_normal(2.0 + offset[k, design.condition], covariance).logpdf(values)
        assert found[k] == pytest.approx(exact, rel=1e-10)
