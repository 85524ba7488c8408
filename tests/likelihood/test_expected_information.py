"""Information of normal observations with common effects, against the dense formula."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.expected_information import EffectGroup, Moments, normal_information


def dense(slopes, effects, variances, sd, sd_slope, groups):
    """J' S^-1 J + tr(S^-1 dS S^-1 dS) / 2, with the covariance written out."""
    n = len(slopes)
    inverse = np.linalg.inv(sd**2 * np.eye(n) + effects @ np.diag(variances) @ effects.T)
    changes = [2 * sd * k * np.eye(n) for k in sd_slope]
    for group in groups:
        own = effects[:, group.columns] @ effects[:, group.columns].T
        changes = [c + 2 * group.sd * k * own for c, k in zip(changes, group.slope, strict=True)]
    traces = [[0.5 * np.trace(inverse @ one @ inverse @ two) for two in changes] for one in changes]
    return slopes.T @ inverse @ slopes + np.array(traces)


@pytest.mark.parametrize("fabrics", [False, True])
def test_information_is_the_dense_one(fabrics, rng):
    design = Design(rng.integers(0, 8, 50), rng.integers(0, 5, 50), np.arange(8) // 2, 5)
    of_condition = rng.normal(size=(8, 6))
    blocks = [np.eye(5)[design.participant]]
    variances, groups = [np.full(5, 0.3**2)], [EffectGroup(slice(0, 5), 0.3, rng.normal(size=6))]
    if fabrics:
        blocks.append(np.eye(4)[design.fabric[design.condition]])
        variances.append(np.full(4, 0.2**2))
        groups.append(EffectGroup(slice(5, 9), 0.2, rng.normal(size=6)))
    effects = np.concatenate([*blocks, np.ones((50, 1))], axis=1)
    variances, sd_slope = np.concatenate([*variances, [9.0]]), rng.normal(size=6)
    moments = Moments.of_design(design, of_condition, fabrics)
    given = variances, 0.4, sd_slope, groups
    found = normal_information(moments, *given)
    assert_allclose(found, dense(of_condition[design.condition], effects, *given), rtol=1e-8)
    rows = Moments.of_rows(effects, of_condition[design.condition])
    assert_allclose(normal_information(rows, *given), found, rtol=1e-9)


def test_effects_without_spread_change_nothing(rng):
    slopes = rng.normal(size=(20, 3))
    effects = np.eye(4)[rng.integers(0, 4, 20)]
    moments = Moments.of_rows(effects, slopes)
    found = normal_information(moments, np.zeros(4), 0.5, np.zeros(3))
    assert_allclose(found, slopes.T @ slopes / 0.25)
