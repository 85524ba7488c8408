"""Rigid probes and the rates of single afferents under them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import least_squares
from scipy.special import lambertw

from softness_bayes.base.errors import InputError
from softness_bayes.data import Afferents
from softness_bayes.model.build import build_skin
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.recordings.response import Afferent, ProbedTouches
from softness_bayes.touch.contact import DISPLACEMENT, STRAIN, Finger, Force, Indentation, Loads, solve_contact
from softness_bayes.touch.neuron.membrane import HODGKIN_HUXLEY, PAPER_CHANNELS
from softness_bayes.touch.neuron.rate import onset
from softness_bayes.touch.probes import RIGID, WRAPPED, Probe
from softness_bayes.touch.readings import CLASSICAL, MENDED
from softness_bayes.touch.stress import stress
from support.command_line import call, refused


def touches_of(table, readings=MENDED):
    loads = [Force(newton) for newton in table.force_n]
    places = table.probe_curvature_per_m.to_numpy(float), table.distance_mm.to_numpy(float) * 1e-3
    return ProbedTouches(loads, *places, readings=readings)


@pytest.mark.parametrize(
    ("curvature", "modulus", "radius", "felt"), [(0.0, 32.753, 3.0238, 9.90), (694.0, 158.6, 0.96, 81.97)]
)
def test_the_rigid_limit_at_two_curvatures(curvature, modulus, radius, felt):
    finger = Probe(curvature).under(Finger())
    contact = solve_contact(RIGID, 0.0, Force(0.1961), 7.5e3, 3.9, finger)
    assert contact.skin_modulus / 1e3 == pytest.approx(modulus, rel=5e-4)
    assert contact.radius * 1e3 == pytest.approx(radius, rel=6e-3 if curvature else 2e-5)
    assert stress(0.0, contact.reduced_modulus, contact.radius, finger) / 1e3 == pytest.approx(felt, rel=5e-4)


@pytest.mark.parametrize("displacement", [STRAIN, DISPLACEMENT])
@pytest.mark.parametrize("load", [Force(0.2), Indentation(1e-3)])
@pytest.mark.parametrize("curvature", [0.0, 300.0, -60.0])
def test_a_probe_is_the_rigid_limit_in_closed_form(displacement, load, curvature):
    """With 1/E_fab = 0, u = C E^-p and E = b exp(m u) has the solution E = b exp(W(p m C b^-p) / p), Lambert's W."""
    finger, b = Probe(curvature).under(Finger()), np.array([2e3, 3e4, 2e5])
    m = np.array([0.0, 3.0, 5.0]) * (1.0 if displacement is STRAIN else 200.0)
    log_scale, p = Loads(load).compression(finger, displacement)
    x = m * np.exp(log_scale - p * np.log(b))
    skin = b * np.exp(lambertw(p * x).real / p if p > 0 else x)
    found = solve_contact(RIGID, 0.0, load, b, m, finger, displacement)
    assert_allclose(found.skin_modulus, skin, rtol=1e-9)
    assert_allclose(found.reduced_modulus, skin / (1.0 - finger.poisson_ratio**2), rtol=1e-9)
    soft = solve_contact(1e16, 0.3, load, b, m, finger, displacement)
    assert_allclose(soft.skin_modulus, skin, rtol=1e-7)


def test_a_hollow_may_be_narrower_than_a_finger_whose_radius_is_sampled():
    """Beyond the closest fit the finger lies against all of it, and the rate stays finite."""
    touches = ProbedTouches([Force(0.2)], np.array([-110.0]), np.zeros(1))
    skin = Afferent(8e3, 4.0, 40.0, 2e-5, rest=0.9, radius=np.array([8e-3, 9.0e-3, 9.2e-3, 20e-3]))
    assert np.isfinite(touches.rate(skin)).all()
    assert_allclose(touches.contacts(skin)[1].radius[2:], 1.0 / WRAPPED)


def test_a_hollow_narrower_than_the_finger_is_refused_before_and_by_a_run(tmp_path):
    table = tmp_path / "recorded.csv"
    table.write_text("force_n,probe_curvature_per_m,distance_mm,rate_hz\n0.1,0,0,30\n0.1,-130,0,20\n")
    told = "row 3, column 'probe_curvature_per_m': expected more than -125, got -130"
    with pytest.raises(InputError, match=told):
        build_skin(Afferents.read(table), ModelOptions())
    refused(call("check", "--afferents", table), told)


def test_tabulated_stress_is_that_of_the_integral():
    loads = [Force(0.1), Force(0.2), Indentation(5e-4), Indentation(2e-3)]
    touches = ProbedTouches(loads, np.array([0.0, 600.0, -50.0, 100.0]), np.array([0.0, 1e-3, 2e-3, 0.0]))
    rng = np.random.default_rng(1)
    skin = Afferent(np.exp(rng.normal(9.0, 1.5, 200)), rng.lognormal(1.0, 0.4, 200), 30.0, 0.1)
    table = touches.stress(skin)
    exact = touches.stress(skin._replace(depth=touches.finger.receptor_depth))
    assert_allclose(table, exact, atol=1e-6 * exact.max(axis=0).max(), rtol=1e-6)
    # a field much narrower than the receptors' depth is a point; a wide one averages over distances
    point = skin._replace(spread=1e-6)
    assert_allclose(touches.stress(point), exact, rtol=1e-4, atol=1e-3)
    assert (touches.stress(skin._replace(spread=1.5e-3))[:, 0] < exact[:, 0]).all()


def test_rest_and_sigma_0_are_two_names_of_one_curve():
    touches = ProbedTouches([Force(0.15)] * 3, np.array([0.0, 200.0, 600.0]), np.zeros(3))
    given = Afferent(8e3, 4.0, np.array([40.0, 60.0]), 2e-5, sigma_0=np.array([1.4e4, 2.5e4]))
    rest, _ = touches.at_rest(given)
    again = given._replace(sigma_0=None, rest=rest)
    assert_allclose(touches.rate(again), touches.rate(given), rtol=1e-9)
    assert_allclose(touches.at_rest(again)[1], given.sigma_0, rtol=1e-9)
    # below the rheobase nothing fires, whatever the stress
    assert not touches.rate(again._replace(alpha=np.array([10.0, 17.0]), rest=0.5)).any()


@pytest.mark.parametrize(
    ("readings", "objective", "sd", "others"),
    [(MENDED, 30.0, 5.76, (40.5, 0.0179, 17.59)), (CLASSICAL, 19.6, 4.47, None)],
)
def test_penalised_fit_of_a_recording(recording_a, readings, objective, sd, others):
    """The fit that found the model: sum of squares over 5 Hz, and squared distances from priors in their sd."""
    touches = touches_of(recording_a, readings)
    observed, middle = recording_a.rate_hz.to_numpy(), np.log([7.5, 3.9, 30.0, 0.1, 9.0])
    width = np.array([0.25, 0.1, 0.5, 1.5, 1.0])

    def rates(logs):
        b, m, alpha, beta, sigma_0 = np.exp(logs)
        return touches.rate(Afferent(b * 1e3, m, alpha, beta * 1e-3, sigma_0=sigma_0 * 1e3))

    def errors(logs):
        return np.append((observed - rates(logs)) / 5.0, (logs - middle) / width)

    start = np.log([7.5, 3.9, 40.0, 0.02, 15.0])
    fitted = least_squares(errors, start, diff_step=1e-5, xtol=1e-10, ftol=1e-10)
    _, _, alpha, beta, sigma_0 = np.exp(fitted.x)
    assert 2.0 * fitted.cost == pytest.approx(objective, abs=0.2)
    assert np.sqrt(np.mean((observed - rates(fitted.x)) ** 2)) == pytest.approx(sd, abs=0.02)
    if others:
        assert (alpha, beta, alpha / (1.0 + np.exp(beta * sigma_0))) == pytest.approx(others, rel=5e-3)


def test_a_membrane_that_cannot_fire_slowly_is_refused(recording_a):
    """At its onset Hodgkin and Huxley's membrane fires at 54 Hz; half of the recorded rates are lower."""
    assert onset(PAPER_CHANNELS, HODGKIN_HUXLEY).rate == pytest.approx(54.4, abs=0.1)
    assert (recording_a.rate_hz < 54.0).mean() > 0.4
    with pytest.raises(InputError, match="cannot fire below 54 Hz"):
        build_skin(Afferents.read(recording_a), ModelOptions(readings=MENDED.override({"membrane": "hodgkin-huxley"})))
