"""Places and peak stresses from polynomials of the skin: within their share of the tolerance, and solved elsewhere."""

import numpy as np
import pytest

from softness_bayes.model.scenes import skin_of_priors
from softness_bayes.parameters.choice import parameter_space
from softness_bayes.touch.contact import Force, Indentation
from softness_bayes.touch.scene import Discretisation, Scene
from softness_bayes.touch.stress_fields import SKIN_SHARE, SkinBox

FABRICS = np.geomspace(1e2, 1e8, 9)
LOADS = {
    "depth": (Indentation(1e-3), Indentation(3e-3)),
    "force": (Force(0.1), Force(5.0)),
    "both": (Force(0.5), Indentation(2e-3)),
}
PRIORS = SkinBox((18e3, 550e3), (0.7, 5.6))


def within(box, rng, size, share=1.0):
    """Parameters of the skin spread over a share of the logarithmic range of a box, its corners among them."""
    x = share * np.concatenate([rng.uniform(-1, 1, (size, 2)), [[-1, -1], [-1, 1], [1, -1], [1, 1]]]).T
    ends = np.log(box)
    return np.exp(ends.mean(axis=1)[:, None] + 0.5 * np.diff(ends, axis=1) * x)


def scene_at(tolerance, loads, firing, box=PRIORS):
    return Scene(FABRICS, 0.3, loads, firing, discretisation=Discretisation(6, 8.0, tolerance), skin_box=box)


def peaks(scene, b, m):
    """Stress on the axis, and whether it comes from polynomials."""
    return scene.mechanics.fields(b, m, None, scene.finger).peak, scene.mechanics._series is not None


@pytest.mark.parametrize("loads", LOADS.values(), ids=LOADS)
@pytest.mark.parametrize("tolerance", [3e-4, 3e-6])
def test_peaks_from_polynomials_are_those_of_the_search(loads, tolerance, smooth_firing, rng):
    b, m = within(PRIORS, rng, 300)
    found, by_polynomials = peaks(scene_at(tolerance, loads, smooth_firing()), b, m)
    exact, solved = peaks(scene_at(tolerance, loads, smooth_firing(), None), b, m)
    assert by_polynomials
    assert not solved
    # the draws lie between the points that the polynomials were fitted at
    np.testing.assert_allclose(found, exact, rtol=2.0 * SKIN_SHARE * tolerance)
    assert np.abs(found / exact - 1.0).max() > 1e-9  # they are polynomials


def test_skins_outside_the_box_are_solved_and_do_not_change_those_inside(smooth_firing, rng):
    boxed, without = (scene_at(1e-4, LOADS["both"], smooth_firing(), box) for box in (PRIORS, None))
    b, m = within(PRIORS, rng, 20, 3.0)
    m[0] = 0.0
    outside = ~((b >= PRIORS.b[0]) & (b <= PRIORS.b[1]) & (m >= PRIORS.m[0]) & (m <= PRIORS.m[1]))
    assert 1 < outside.sum() < b.size
    found, exact = peaks(boxed, b, m)[0], peaks(without, b, m)[0]
    np.testing.assert_allclose(found[outside], exact[outside], rtol=1e-12)
    np.testing.assert_allclose(found[~outside], exact[~outside], rtol=2e-5)
    np.testing.assert_allclose(found[~outside], peaks(boxed, b[~outside], m[~outside])[0], rtol=1e-13)


def test_the_box_is_that_of_the_priors():
    box = skin_of_priors(parameter_space(fix={"m": 2.0}))
    assert box.m == (2.0, 2.0)
    low, high = np.log(np.array(box.b) / 1e5) / 0.5
    assert -3.5 < low < -3.3
    assert 3.3 < high < 3.5
    assert skin_of_priors(parameter_space(fix={"m": 0.0})) is None
    # a law that reaches down to 0 gives a box with a positive end
    reaching = skin_of_priors(parameter_space(priors={"b": "uniform(0,300)"}))
    assert 0 < reaching.b[0] < 0.02 * reaching.b[1]
