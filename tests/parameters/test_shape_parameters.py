"""The finger's radius and the receptors' depth as parameters: absent unless freed, their laws cut at both ends."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from softness_bayes.base.errors import InputError
from softness_bayes.base.laws import LogNormal, Normal, Uniform
from softness_bayes.model.fingers import box_of_priors, box_of_values
from softness_bayes.parameters.choice import parameter_space
from softness_bayes.parameters.declared import SHAPE_PARAMETERS
from softness_bayes.touch.contact import Finger, FingerBox

LAWS = {"radius": Normal(8, 0.5), "receptor_depth": Uniform(0.5, 0.9)}


def test_they_are_absent_unless_they_are_freed(rng):
    usual = parameter_space()
    theta = usual.draw_prior(rng, 3)
    assert not SHAPE_PARAMETERS.keys() & {*usual.names, *usual.held}
    assert usual.touch(theta)[-3:] == (0.0, 0.0, 1.0)
    for free in (
        parameter_space(priors=LAWS),
        parameter_space(priors={name: one.prior for name, one in SHAPE_PARAMETERS.items()}),
    ):
        assert free.names == (*usual.names, "radius", "receptor_depth")
        assert {p.unit for p in free.sampled[-2:]} == {"mm"}
    touch = parameter_space(priors=LAWS).touch(np.column_stack([theta, np.full((3, 2), (8.0, 0.7))]))
    assert_allclose(touch.radius, 8e-3)
    assert_allclose(touch.receptor_depth, 0.7e-3)
    assert_array_equal(touch[:-3], usual.touch(theta)[:-3])


def test_a_normal_law_is_cut_at_both_ends_of_the_range(rng):
    space = parameter_space(priors={"radius": Normal(8, 2.2)})
    theta = np.tile(space.median, (4, 1))
    theta[:, -1] = 0.99, 1.01, 99.0, 100.5
    density = space.log_prior(theta)[:, -1]
    assert_array_equal(np.isfinite(density), [False, True, True, False])
    drawn = space.draw_prior(rng, 4000)[:, -1]
    assert 1 < drawn.min() < 2
    assert_allclose(space.natural(space.coordinates(theta[1:3])), theta[1:3], rtol=1e-12)


def test_laws_that_leave_the_range_are_refused():
    with pytest.raises(InputError, match=r"prior of radius: 0\.081 of normal\(8,5\) lies outside 1 to 100 mm"):
        parameter_space(priors={"radius": Normal(8, 5)})
    with pytest.raises(InputError, match=r"prior of receptor_depth: .* lies outside 0\.05 to 5 mm"):
        parameter_space(priors={"receptor_depth": Normal(-1, 0.1)})
    with pytest.raises(InputError, match=r"prior of b: .* allows negative values"):
        parameter_space(priors={"b": Normal(100, 1)})


def test_box_reaches_four_standard_deviations_and_the_ends_of_a_bounded_law():
    finger = Finger(radius=7e-3, receptor_depth=0.6e-3)
    assert box_of_priors(parameter_space().sampled, finger) is None
    box = box_of_priors(parameter_space(priors=LAWS).sampled, finger)
    assert_allclose(box.radius, (6e-3, 10e-3), rtol=5e-3)
    assert box.receptor_depth[0] < 0.5e-3
    assert box.receptor_depth[1] > 0.9e-3
    alone = box_of_priors(parameter_space(priors={"receptor_depth": LogNormal(0.7, 0.1)}).sampled, finger)
    assert alone.radius == (7e-3, 7e-3)
    drawn = {"b": 1.0, "radius": np.array([8.5, 7.5, 8.0])}
    assert box_of_values(drawn, finger) == FingerBox((7.5e-3, 8.5e-3), (0.6e-3, 0.6e-3))
    assert box_of_values({"b": 1.0}, finger) is None
