"""The start of the search for the skin's modulus: close within its box, harmless outside, the same modulus anywhere."""

import numpy as np
import pytest

from softness_bayes.errors import InputError
from softness_bayes.model.scenes import skin_of_priors
from softness_bayes.parameters.choice import parameter_space
from softness_bayes.touch.contact import Finger, Force, Indentation, log_compliance_ratio
from softness_bayes.touch.field import StressField
from softness_bayes.touch.mechanics import SKIN_SHARE
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.scene import Discretisation, Scene
from softness_bayes.touch.skin import DISPLACEMENT, ONE_STEP, STRAIN, log_stiffening, skin_modulus
from softness_bayes.touch.skin_start import USEFUL, SkinBox, SkinStart

FABRICS = np.geomspace(1e2, 1e8, 9)
LOADS = {
    "depth": (Indentation(1e-3), Indentation(3e-3)),
    "force": (Force(0.1), Force(5.0)),
    "both": (Force(0.5), Indentation(2e-3)),
}
PRIORS = SkinBox((18e3, 550e3), (0.7, 5.6))


def conditions(loads, displacement=STRAIN):
    """ln C, p and ln k of every fabric under every load."""
    scale, p = np.repeat([load.compression(Finger(), displacement) for load in loads], FABRICS.size, axis=0).T
    return scale, p, np.tile(log_compliance_ratio(FABRICS, 0.3, Finger()), len(loads))


def within(box, rng, size, share=1.0):
    """Parameters of the skin spread over a share of the logarithmic range of a box, its corners among them."""
    x = share * np.concatenate([rng.uniform(-1, 1, (size, 2)), [[-1, -1], [-1, 1], [1, -1], [1, 1]]]).T
    ends = np.log(box)
    return np.exp(ends.mean(axis=1)[:, None] + 0.5 * np.diff(ends, axis=1) * x)


def scene_at(tolerance, loads, firing):
    return Scene(FABRICS, 0.3, loads, firing, discretisation=Discretisation(6, 8.0, tolerance), skin_box=PRIORS)


def paper_like(b, m):
    """Parameter vectors with these skins and the paper's other values."""
    return TouchParameters(b, m, 20.3, 0.6e-3, 9e3, 1.05, 1.16, 1.0, 1.5)


@pytest.mark.parametrize("loads", LOADS.values(), ids=LOADS)
def test_one_step_suffices_over_the_default_priors(loads, rng):
    of = conditions(loads)
    b, m = within(PRIORS, rng, 400)
    exact = log_stiffening(*of, b[:, None], m[:, None])
    start, stated = SkinStart(PRIORS, *of)(b, m)
    error = np.abs(start - exact) * np.maximum(np.exp(exact), 1.0)
    # the draws lie between the points that the polynomials were fitted at
    assert error.max() <= 2.0 * stated.max() <= 2.0 * ONE_STEP


@pytest.mark.parametrize("displacement", [STRAIN, DISPLACEMENT], ids=str)
@pytest.mark.parametrize("share", [1.0, 3.0])
def test_the_modulus_does_not_depend_on_the_start(displacement, share, rng):
    box = PRIORS if displacement == STRAIN else SkinBox(PRIORS.b, (250.0, 2000.0))
    of = conditions(LOADS["both"], displacement)
    b, m = within(box, rng, 60, share)
    m[0] = 0.0
    start, error = SkinStart(box, *of)(b, m)
    assert not np.isfinite(error[0])  # m = 0 lies outside
    assert np.isfinite(error).any()
    assert np.isfinite(error[1:]).all() == (share == 1.0)
    b, m = b[:, None], m[:, None]
    np.testing.assert_allclose(skin_modulus(*of, b, m, start), skin_modulus(*of, b, m), rtol=1e-13)


def test_too_wide_a_box_costs_steps_and_no_digits(rng):
    box, of = SkinBox((1.0, 1e9), (1e-3, 1e3)), conditions(LOADS["both"])
    b, m = within(box, rng, 100)
    made, exact = SkinStart(box, *of), log_stiffening(*of, b[:, None], m[:, None])
    start, _ = made(b, m)
    assert made.error > USEFUL
    assert np.abs(start - exact).max() > 1e3 * ONE_STEP
    np.testing.assert_allclose(log_stiffening(*of, b[:, None], m[:, None], start), exact, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("tolerance", "error"), [(1e-5, 1e-6), (1e-8, 1e-9)])
def test_scenes_with_and_without_a_box_answer_alike(tolerance, error, smooth_firing, paper, rng):
    of = Discretisation(8, 6.0, tolerance)
    with_box, without = (
        Scene(FABRICS, 0.3, LOADS["both"], smooth_firing(), discretisation=of, skin_box=box) for box in (PRIORS, None)
    )
    parameters = paper(b=1e5 * np.exp(0.8 * rng.normal(size=40)), m=2.0 * np.exp(0.5 * rng.normal(size=40)))
    wanted = without.total_rate(parameters)
    assert wanted.max() > 0
    np.testing.assert_allclose(with_box.total_rate(parameters), wanted, rtol=error, atol=error * wanted.max())
    part, few = with_box.take([3, 11]), without.take([3, 11])
    np.testing.assert_allclose(part.contact(parameters).skin_modulus, few.contact(parameters).skin_modulus, rtol=1e-13)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
def test_coarse_scenes_take_the_polynomial_itself_within_their_tolerance(tolerance, smooth_firing, paper, rng):
    coarse, fine = (Scene(FABRICS, 0.3, LOADS["depth"], smooth_firing(), skin_box=box) for box in (PRIORS, None))
    b, m = within(PRIORS, rng, 40)
    moduli = [
        scene._contacts.moduli(b, m, None, scene.finger, allowed)[0]
        for scene, allowed in ((coarse, SKIN_SHARE * tolerance), (coarse, 0.0), (fine, 0.0))
    ]
    exact = moduli[2]
    # as above, the error is stated at other points
    np.testing.assert_allclose(moduli[0], exact, rtol=2.0 * SKIN_SHARE * tolerance)
    assert np.abs(moduli[0] / exact - 1.0).max() > 1e-10  # no step of the search was taken
    np.testing.assert_allclose(moduli[1], exact, rtol=1e-13)


def test_a_point_does_not_depend_on_others_outside_of_the_box(smooth_firing, rng):
    scene = Scene(FABRICS, 0.3, LOADS["both"], smooth_firing(), skin_box=PRIORS)
    b, m = within(PRIORS, rng, 10)
    alone = scene._contacts.moduli(b, m, None, scene.finger, 1e-4)[0]
    b, m = np.append(b, 10.0 * PRIORS.b[1]), np.append(m, 0.0)
    beside = scene._contacts.moduli(b, m, None, scene.finger, 1e-4)[0]
    np.testing.assert_allclose(beside[:-1], alone, rtol=1e-14)
    exact = scene._contacts.moduli(b, m, None, scene.finger)[0]
    np.testing.assert_allclose(beside[-1], exact[-1], rtol=1e-13)
    assert np.abs(beside[:-1] / exact[:-1] - 1.0).max() > 1e-10  # negative control: the others are not solved


def test_the_box_is_that_of_the_priors():
    space = parameter_space(fix={"m": 2.0})
    box = skin_of_priors(space)
    assert box.m == (2.0, 2.0)
    low, high = np.log(np.array(box.b) / 1e5) / 0.5
    assert -3.5 < low < -3.3
    assert 3.3 < high < 3.5
    assert skin_of_priors(parameter_space(fix={"m": 0.0})) is None
    # a law that reaches down to 0 gives a box with a positive end
    reaching = skin_of_priors(parameter_space(priors={"b": "uniform(0,300)"}))
    assert 0 < reaching.b[0] < 0.02 * reaching.b[1]


@pytest.mark.parametrize("loads", LOADS.values(), ids=LOADS)
@pytest.mark.parametrize("tolerance", [3e-4, 3e-6])
def test_contacts_from_polynomials_are_those_of_the_search(loads, tolerance, smooth_firing, rng):
    """Their error is within the share of the tolerance that is allowed, also between the points of the fit."""
    scene = scene_at(tolerance, loads, smooth_firing())
    assert min(scene.mechanics.polynomials) > 0
    b, m = within(PRIORS, rng, 300)
    found = scene.mechanics.fields(b, m, None, scene.finger)
    exact = scene.contact(paper_like(b, m))
    peak = scene.stress_profile(exact).peak
    np.testing.assert_allclose(found.peak, peak, rtol=2.0 * SKIN_SHARE * tolerance)
    assert np.abs(found.peak / peak - 1.0).max() > 1e-9  # they are polynomials


def test_skins_outside_the_box_are_solved(smooth_firing, rng):
    scene = Scene(
        FABRICS, 0.3, LOADS["both"], smooth_firing(), discretisation=Discretisation(6, 8.0, 1e-4), skin_box=PRIORS
    )
    b, m = within(PRIORS, rng, 20, 3.0)
    m[0] = 0.0
    outside = ~((b >= PRIORS.b[0]) & (b <= PRIORS.b[1]) & (m >= PRIORS.m[0]) & (m <= PRIORS.m[1]))
    assert outside[0]
    assert 1 < outside.sum() < b.size
    found = scene.mechanics.fields(b, m, None, scene.finger).peak
    exact = scene.stress_profile(scene.contact(paper_like(b, m))).peak
    np.testing.assert_allclose(found[outside], exact[outside], rtol=1e-12)
    np.testing.assert_allclose(found[~outside], exact[~outside], rtol=2e-5)


def test_a_tolerance_that_the_polynomials_miss_is_met_by_the_search(smooth_firing, rng):
    wide, of = SkinBox(PRIORS.b, (0.1, 30.0)), Discretisation(6, 8.0, 1e-4)
    fine, exact = (
        Scene(FABRICS, 0.3, LOADS["both"], smooth_firing(), discretisation=of, skin_box=box) for box in (wide, None)
    )
    assert fine.mechanics.polynomials == (0, 0)
    b, m = within(wide, rng, 50)
    found, wanted = (scene.mechanics.fields(b, m, None, scene.finger).peak for scene in (fine, exact))
    np.testing.assert_allclose(found, wanted, rtol=2.0 * SKIN_SHARE * of.field_tolerance)


def test_a_box_beyond_the_tables_has_no_polynomials_and_is_not_inverted_for_them(smooth_firing, monkeypatch):
    beyond = SkinBox((1e5, 5e6), (1.0, 20.0))
    scene = Scene(np.array([1e7, 1e8]), 0.3, (Force(1.0),), smooth_firing(), skin_box=beyond)
    monkeypatch.setattr(StressField, "exact_rows", lambda *_: pytest.fail("inverted"))
    assert scene.mechanics.polynomials == (0, 0)


def test_a_negative_stiffening_is_refused_where_there_is_a_box(smooth_firing):
    scene = scene_at(1e-3, LOADS["depth"], smooth_firing())
    with pytest.raises(InputError, match="m"):
        scene.total_rate(paper_like(np.array([1e5]), np.array([-1.0])))
