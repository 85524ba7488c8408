"""The learnt map: one-to-one, of known Jacobian, and straight where the draws were bent."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

from softness_bayes.sampler.adaptation import SCORES, TriangularMap, learn
from softness_bayes.sampler.moves import Student


def bent_draws(rng, size):
    """A ridge: the third coordinate follows the square of the first, closely; all of it rotated and scaled."""
    x = rng.standard_normal((size, 4))
    x[:, 2] = 0.5 * x[:, 0] ** 2 + 0.3 * x[:, 0] * x[:, 1] + 0.05 * x[:, 2]
    turn = np.linalg.qr(np.random.default_rng(1).standard_normal((4, 4)))[0]
    return (x @ turn) * [1, 10, 0.1, 1] + [5, 0, -3, 100]


@pytest.fixture(scope="module")
def fitted():
    return TriangularMap.fit(bent_draws(np.random.default_rng(2), 20_000), 1e6)


def test_a_map_is_one_to_one_everywhere(fitted):
    y = 5 * np.random.default_rng(3).standard_normal((3, 50, 4))
    np.testing.assert_allclose(fitted.inverse(fitted.forward(y)), y, atol=1e-6)
    point = fitted.forward(y[0, 0])
    np.testing.assert_allclose(fitted.forward(y)[0, 0], point)


def test_the_jacobian_is_that_of_differences(fitted):
    """Negative controls: without the triangle, and without the straightened residuals, it would not differ."""
    points = 2.0 * np.random.default_rng(4).standard_normal((20, 4))
    step = 1e-5 * np.eye(4)
    slopes = [[(fitted.forward(y + h) - fitted.forward(y - h)) / 2e-5 for h in step] for y in points]
    np.testing.assert_allclose(fitted.log_volume(points), np.linalg.slogdet(slopes)[1], atol=1e-6)
    assert np.ptp(np.array(slopes), axis=0).max() > 0.1
    assert np.ptp(fitted.log_volume(points)) > 0.1


def test_draws_of_a_ridge_become_independent_normal_ones(fitted):
    y = fitted.inverse(bent_draws(np.random.default_rng(5), 5000))
    np.testing.assert_allclose(np.quantile(y, stats.norm.cdf(SCORES), axis=0).T, np.tile(SCORES, (4, 1)), atol=0.15)
    covariance = np.cov(y.T)
    np.testing.assert_allclose(covariance, np.diag(covariance.diagonal()), atol=0.1)
    # each coordinate is uncorrelated with the products of the others; a linear map leaves them all but determined
    straight = TriangularMap.fit(bent_draws(np.random.default_rng(2), 20_000), 1e-9)
    linear = straight.inverse(bent_draws(np.random.default_rng(5), 5000))
    assert unexplained(y) > 0.95
    assert unexplained(linear) < 0.2


def test_a_long_tail_becomes_a_normal_one():
    """The part of a coordinate that the others do not explain may be skewed; few draws hardly show it."""

    def skewed(rng, size):
        x = rng.standard_normal((size, 3))
        return np.column_stack([x[:, 0], np.expm1(x[:, 1]), x[:, 2] + 0.3 * x[:, 0] ** 2])

    draws, fresh = skewed(np.random.default_rng(1), 20_000), skewed(np.random.default_rng(2), 20_000)
    y, few = (TriangularMap.fit(draws, effective).inverse(fresh) for effective in (2000.0, 3.0))
    np.testing.assert_allclose(np.quantile(y, stats.norm.cdf(SCORES), axis=0).T, np.tile(SCORES, (3, 1)), atol=0.15)
    assert np.abs(stats.skew(few)).max() > 1.0 > np.abs(stats.skew(y)).max()


def test_a_cubic_sheet_of_few_draws_becomes_straight():
    def sheet(rng, size, thickness):
        x = rng.standard_normal((size, 3))
        x[:, 2] = 0.3 * x[:, 0] ** 3 - x[:, 0] + 0.3 * x[:, 1] ** 2 + thickness * x[:, 2]
        return x * [5.0, 2.0, 0.1]

    draws = sheet(np.random.default_rng(1), 6000, 0.02)
    fresh = sheet(np.random.default_rng(2), 2000, 0.02)
    y = TriangularMap.fit(draws, 200.0).inverse(fresh)
    np.testing.assert_allclose(y.std(axis=0), 1.0, atol=0.2)
    # what is known to be thin is not shrunk: hardly anything of the last coordinate is left to the others
    terms = np.stack([np.ones(len(y)), *y[:, :2].T, *(y[:, :2] ** 2).T, *(y[:, :2] ** 3).T], axis=-1)
    left = y[:, 2] - terms @ np.linalg.lstsq(terms, y[:, 2])[0]
    assert left.std() > 0.9 * y[:, 2].std()
    # negative control: what 3 independent draws say is shrunk, and much of the sheet's shape stays
    few = TriangularMap.fit(draws, 3.0).inverse(fresh)
    left = few[:, 2] - terms @ np.linalg.lstsq(terms, few[:, 2])[0]
    assert left.std() < 0.5 * few[:, 2].std()


def test_far_from_all_draws_the_map_stays_finite(fitted):
    with np.errstate(all="raise"):
        far = 1e60 * np.random.default_rng(3).standard_normal((50, 4))
        assert np.isfinite(fitted.forward(far)).all()


def unexplained(y):
    """Least share of a coordinate's variance that the products of the others leave."""
    shares = []
    for k in range(y.shape[1]):
        others = np.delete(y, k, axis=1)
        terms = np.stack([np.ones(len(y)), *(others[:, i] * others[:, j] for i in range(3) for j in range(i + 1))], 1)
        left = y[:, k] - terms @ np.linalg.lstsq(terms, y[:, k])[0]
        shares.append(left.var() / y[:, k].var())
    return min(shares)


def test_a_map_of_too_few_or_of_equal_draws_still_maps():
    rng = np.random.default_rng(7)
    flat = rng.standard_normal((50, 4)) * [1, 1, 0, 1]
    for draws in (
        rng.standard_normal((3, 4)),
        np.ones((50, 4)) + 1e-9 * rng.standard_normal((50, 1)),
        flat,
        np.ones((9, 4)),
    ):
        map = TriangularMap.fit(draws, 10.0)
        assert np.isfinite(map.inverse(draws)).all()
        y = rng.standard_normal((5, 4))
        assert np.isfinite(map.forward(y)).all()
        assert np.isfinite(map.inverse(map.forward(y))).all()


def test_walkers_far_below_the_rest_do_not_stretch_the_map():
    rng = np.random.default_rng(8)
    walks = rng.standard_normal((2, 100, 20, 3))
    height = -0.5 * (walks**2).sum(-1)
    walks[0, :, 0], height[0, :, 0] = 50.0, -3000.0
    map = learn(walks, height, 5.0)
    np.testing.assert_allclose(map.axes @ map.axes.T, np.eye(3), atol=0.1)


def test_student_proposals_have_the_density_they_claim():
    """A wrong ratio would bias every run: the ratio of densities against SciPy, the draws against SciPy's law."""
    random = np.random.RandomState(11)
    old = 2.0 * random.standard_normal((4000, 3))
    new, ratio = Student(5.0)(old, random)
    law = stats.multivariate_t(np.zeros(3), np.eye(3), df=5.0)
    np.testing.assert_allclose(ratio, law.logpdf(old) - law.logpdf(new), atol=1e-10)
    assert stats.kstest(new[:, 0], stats.t(5).cdf).pvalue > 1e-3
    # the squared length over the dimension follows Fisher's law only if the coordinates share one spread
    assert stats.kstest((new**2).sum(1) / 3, stats.f(3, 5).cdf).pvalue > 1e-3


def test_last_coordinates_are_curved_in_the_first_ones_alone(rng):
    """A bent ridge of the first two, and three that follow them along curves: the map finds all of it."""
    x = rng.standard_normal((20_000, 2))
    bent = np.column_stack([x[:, 0], x[:, 1] + 0.4 * (x[:, 0] ** 2 - 1.0)])
    lean, bow = rng.standard_normal((2, 2, 3))
    last = bent @ lean + 0.3 * (bent**2 - (bent**2).mean(axis=0)) @ bow + 0.2 * rng.standard_normal((len(x), 3))
    last[:, 2] += 0.5 * last[:, 0]
    draws = np.column_stack([bent, last])
    found = TriangularMap.fit(draws, len(draws), linear=3)
    y = found.inverse(draws)
    assert_allclose(np.cov(y, rowvar=False), np.eye(5), atol=0.05)
    assert_allclose(found.forward(y), draws, atol=1e-9)
    # what is left of each of the last three is its noise: Gaussian, and unrelated to squares of the first two
    for k in (2, 3, 4):
        assert abs(stats.kurtosis(y[:, k])) < 0.2
        for j in (0, 1):
            assert abs(np.corrcoef(y[:, k], y[:, j] ** 2)[0, 1]) < 0.05
    # squares, products and cubes of the last three among each other have no coefficients
    for k, bend in enumerate(found.bends[2:]):
        assert np.count_nonzero(bend) <= 8 + k
    # the bend of the first two is found as without the others
    alone = TriangularMap.fit(bent, len(draws))
    assert_allclose(np.abs(y[:, :2]), np.abs(alone.inverse(bent)), atol=1e-6)
    # a negative control: with all five in straight lines the bend stays
    straight = TriangularMap.fit(draws, len(draws), linear=5).inverse(draws)
    assert abs(np.corrcoef(straight[:, 1], straight[:, 0] ** 2)[0, 1]) > 0.3


def test_a_long_walk_gives_the_map_of_a_part_of_it(rng):
    """What is left out hardly matters, and the number of independent draws is that of the whole walk."""
    x = rng.standard_normal((4, 500, 40, 2))
    x[..., 1] += 0.4 * (x[..., 0] ** 2 - 1.0)
    height = -0.5 * (x[..., 0] ** 2 + (x[..., 1] - 0.4 * (x[..., 0] ** 2 - 1.0)) ** 2)
    found = learn(x, height, 10.0)
    y = found.inverse(x.reshape(-1, 2))
    assert_allclose(np.cov(y, rowvar=False), np.eye(2), atol=0.03)
    whole = TriangularMap.fit(x.reshape(-1, 2), 8000.0)
    assert_allclose(y, whole.inverse(x.reshape(-1, 2)), atol=0.2)


def test_no_points_have_no_images():
    """As of a mode that no walker chooses in a step."""
    map = TriangularMap.identity(3)
    assert map.inverse(map.forward(np.zeros((0, 3)))).shape == (0, 3)
