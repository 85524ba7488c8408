"""Normal rows with effects of participants and shared ones against the dense normal law of small tables."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import multivariate_normal

from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.normal_rows import EffectLaw, NormalRows

MEAN, SD = 2.0, 1.5


def complete(rng):
    return np.ones((3, 20))


def gaps(rng):
    return (rng.random((5, 20)) < 0.5).astype(float)


def apart(rng):
    """Two groups of participants without a common condition."""
    cells = np.zeros((6, 20))
    cells[:3, :10] = 1.0
    cells[3:, 10:] = [np.ones(10), np.arange(10) < 6, np.arange(10) > 2]
    return cells


def alike(rng):
    """Seven raters of three kinds, in no order, and two without ratings."""
    kinds = rng.poisson(1.0, (3, 12)).astype(float)
    return np.vstack([kinds, np.zeros((1, 12))])[[1, 3, 0, 1, 2, 0, 1, 3, 0]]


def measured(rng):
    """Every touch has a load of its own, so that hardly any cell has a rating."""
    return np.eye(30)[np.arange(6) * 5][:, rng.permutation(30)] + np.repeat(np.eye(6), 5, axis=1)


def single(rng):
    """One rating."""
    return np.eye(1, 6)


def design_of(cells, fabrics=5):
    person, condition = np.nonzero(cells)
    number = cells[person, condition].astype(int)
    return Design(
        np.repeat(condition, number), np.repeat(person, number), np.arange(cells.shape[1]) % fabrics, len(cells)
    )


def level(rng, design):
    return np.full((design.n_conditions, 1), SD)


def fabrics(rng, design):
    """The level, and fabrics with another spread at each draw."""
    of_fabric = rng.uniform(0.1, 1.0, (4, 1, 1)) * np.eye(design.n_fabrics)[design.fabric]
    return np.concatenate([np.broadcast_to(level(rng, design), (4, design.n_conditions, 1)), of_fabric], axis=-1)


def weighted(rng, design):
    """The same fabrics as weights that all draws share, and standard deviations of each draw."""
    weights = np.concatenate([level(rng, design), np.eye(design.n_fabrics)[design.fabric]], axis=-1)
    return weights, np.append(np.ones((4, 1)), rng.uniform(0.1, 1.0, (4, 1)) * np.ones(design.n_fabrics), axis=-1)


def slopes(rng, design):
    return np.concatenate([fabrics(rng, design), rng.standard_normal((4, design.n_conditions, 2))], axis=-1)


def dense(design, law, k):
    """The normal law of all rows at a draw, as mean and covariance."""
    person = np.eye(design.n_participants)[design.participant]
    shared = law.shared * law.sd[..., None, :]
    shared = np.broadcast_to(shared, (4, *shared.shape[-2:]))[k, design.condition]
    covariance = shared @ shared.T + law.participant[k] ** 2 * person @ person.T
    variance = np.broadcast_to(law.variance[k], law.offset[k].shape)
    return MEAN + law.offset[k, design.condition], covariance + np.diag(variance[design.condition])


def given(mean, covariance, values, part):
    """The normal law of some rows given the others."""
    rest = ~part
    gain = np.linalg.solve(covariance[np.ix_(rest, rest)], covariance[np.ix_(rest, part)]).T
    return mean[part] + gain @ (values - mean)[rest], covariance[np.ix_(part, part)] - gain @ covariance[rest][:, part]


@pytest.mark.parametrize("uneven", [False, True])
@pytest.mark.parametrize("effects", [level, fabrics, weighted, slopes])
@pytest.mark.parametrize("table", [complete, gaps, apart, alike, measured, single])
def test_every_density_is_that_of_the_dense_law(rng, table, effects, uneven):
    design = design_of(table(rng))
    values = 3.0 + 0.8 * rng.standard_normal(design.n_rows)
    variance = rng.uniform(0.1, 1.0, (4, design.n_conditions if uneven else 1)) ** 2
    offset = 5.0 + rng.standard_normal((4, design.n_conditions))
    shared = effects(rng, design)
    law = EffectLaw.of(
        offset, variance, np.array([0.0, 0.3, 0.9, 6.0]), *(shared if isinstance(shared, tuple) else (shared,))
    )
    rows = NormalRows(design, values, MEAN)
    density, one, people = rows.log_density(law), rows.leave_one_out(law), rows.without_participants(law).log_density
    for k in range(4):
        mean, covariance = dense(design, law, k)
        assert density[k] == pytest.approx(multivariate_normal(mean, covariance).logpdf(values), rel=1e-10)
        for i in range(0, design.n_rows, 7):
            expected, square = given(mean, covariance, values, np.arange(design.n_rows) == i)
            assert_allclose([one.mean[k, i], one.sd[k, i] ** 2], [expected[0], square[0, 0]], rtol=1e-8)
        for who in range(design.n_participants):
            part = design.participant == who
            found = multivariate_normal(*given(mean, covariance, values, part)).logpdf(values[part]) if any(part) else 0
            assert people[k, who] == pytest.approx(found, abs=1e-8)


def test_the_density_from_sums_is_that_of_single_variances(rng):
    """A variance stated for every condition takes the other way; digits are kept where the fit is almost perfect."""
    design = design_of(apart(rng))
    expected = rng.standard_normal(20)
    for error in (1e-5, 1e-3, 0.3):
        values = MEAN + expected[design.condition] + 0.5 * (design.participant % 2)
        values = values + error * rng.standard_normal(values.size)
        rows = NormalRows(design, values, MEAN)
        law = EffectLaw.of(expected[None], np.full((1, 1), error**2), np.full(1, 0.4), level(rng, design))
        each = law._replace(variance=np.full((1, 20), error**2))
        assert_allclose(rows.log_density(law), rows.log_density(each), rtol=1e-7)
        assert abs(rows.log_density(law._replace(variance=law.variance * 1.2)) - rows.log_density(each)) > 1e-3


def test_nothing_is_of_the_size_of_conditions_by_conditions(rng):
    """For 4000 conditions such a matrix would have 16 million numbers."""
    design = design_of(np.tile(gaps(rng), 200))
    held = vars(NormalRows(design, np.zeros(design.n_rows), MEAN))
    assert max(np.size(value) for value in (*held.values(), *held["_alike"]) if not isinstance(value, tuple)) < 1e5
