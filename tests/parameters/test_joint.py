"""The joint law that recordings have taught: its density, what fires under it, and what is refused with it."""

import pickle

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import multivariate_normal

from softness_bayes.base.errors import InputError
from softness_bayes.model.scenes import firing_of, touch_parameters, usual_values
from softness_bayes.parameters.choice import parameter_space
from softness_bayes.parameters.joint import JOINT_LAWS, NAMES, coordinates
from softness_bayes.touch.contact import Force
from softness_bayes.touch.readings import MENDED, NAMED_READINGS
from softness_bayes.touch.receptors import receptor_current
from softness_bayes.touch.scene import Scene

LAW = JOINT_LAWS["recorded"]


def at_rest(x):
    """Current without stress over the rheobase, shape (n,)."""
    return receptor_current(0.0, x[:, 2], x[:, 3], x[:, 4]) / LAW.rheobase


def test_the_density_is_that_of_a_normal_law_in_other_coordinates(rng):
    """By the determinant of numerical slopes, which know nothing of the closed form."""
    x = LAW.draw(rng, 20)
    u = coordinates(*x.T, limit=LAW.rheobase)
    step = 1e-5 * x
    slopes = np.stack(
        [
            (coordinates(*(x + s).T, limit=LAW.rheobase) - coordinates(*(x - s).T, limit=LAW.rheobase))
            / (2.0 * step[:, [k]])
            for k in range(5)
            for s in [np.where(np.arange(5) == k, step, 0.0)]
        ],
        axis=-1,
    )
    root = np.array(LAW.root)
    normal = multivariate_normal(LAW.centre, root @ root.T).logpdf(u)
    assert_allclose(LAW.log_density(x).sum(axis=-1), normal + np.linalg.slogdet(slopes)[1], rtol=1e-5, atol=1e-6)
    # r has no slope where half of alpha is the limit, at which two of these pieces meet
    assert 0 < (x[:, 2] < 2.0 * LAW.rheobase).sum() < 20


def test_draws_have_the_stated_moments(rng):
    u = coordinates(*LAW.draw(rng, 40_000).T, limit=LAW.rheobase)
    root = np.array(LAW.root)
    assert_allclose(u.mean(axis=0), LAW.centre, atol=0.02)
    assert_allclose(np.cov(u.T), root @ root.T, atol=0.02)


def test_nothing_fires_at_rest_unless_the_parameters_are_drawn_apart(rng):
    x = LAW.draw(rng, 20_000)
    assert at_rest(x).max() < 1.0
    assert x[:, 4].min() > 0.0
    apart = np.stack([law.draw(rng, 20_000) for law in LAW.marginals.values()], axis=-1)
    assert (at_rest(apart) > 1.0).mean() > 0.3  # so independent priors are not shipped


@pytest.mark.parametrize(("prior_set", "fires"), [("recorded", True), ("in-vivo", False)])
def test_light_touches_are_felt(prior_set, fires):
    """Where the paper's constants on the skin of compression data are silent, 9 to 30 receptors fire."""
    values = usual_values(MENDED, prior_set)
    scene = Scene(np.geomspace(3e4, 1e6, 4), 0.3, [Force(0.1), Force(0.3)], firing_of(values, MENDED.membrane))
    receptors = scene.respond(touch_parameters(values)).responding
    assert ((receptors > 9.0) & (receptors < 30.0)).all() == fires
    assert (receptors == 0.0).all() != fires


def test_the_space_has_the_joint_law(rng):
    space = parameter_space(prior_set="recorded")
    theta = space.draw_prior(rng, 50)
    place = [space.names.index(name) for name in NAMES]
    found = space.log_prior(theta)
    assert_allclose(found[:, place], LAW.log_density(theta[:, place]))
    assert {"c_Na", "c_K", "c_L", "c_A"} <= space.held.keys()
    again = pickle.loads(pickle.dumps(space))
    assert_allclose(again.log_prior(theta), found)
    theta[:, place[4]] = -1.0
    assert np.isneginf(space.log_prior(theta)[:, place[4]]).all()


@pytest.mark.parametrize(
    "given",
    [
        {"fix": {"b": 8.0}},
        {"priors": {"sigma_0": "lognormal(9,1)"}},
        {"priors": {"c_Na": "lognormal(1,0.03,0.1)"}},
        {"absent": ["alpha"]},
    ],
)
def test_single_parameters_of_the_law_cannot_be_changed(given):
    with pytest.raises(InputError, match="prior set 'recorded'"):
        parameter_space(prior_set="recorded", **given)


def test_the_law_belongs_to_the_default_readings():
    with pytest.raises(InputError, match="default reading of pressure"):
        usual_values(NAMED_READINGS["hertz"], "recorded")
