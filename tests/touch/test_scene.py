from __future__ import annotations

import math

import numpy as np
import pytest

from oracles.reference import reference_response
from softness_bayes.base.errors import InputError, NumericalError, SoftnessError
from softness_bayes.touch.contact import Finger, Force, Indentation
from softness_bayes.touch.neuron.fixed_channels import FixedChannels
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.readings import Readings
from softness_bayes.touch.scene import Discretisation, Scene
from softness_bayes.touch.stress_table import StressTable

FABRICS = np.array([2e3, 1.5e4, 6e4, 4e5, 1e7])
POISSON = np.array([0.2, 0.3, 0.35, 0.45, 0.1])
LOADS = (Indentation(1e-3), Force(1.0), Indentation(2.5e-3))


@pytest.fixture(scope="module")
def scene(smooth_firing):
    return Scene(FABRICS, POISSON, LOADS, smooth_firing())


def draws(rng, size, paper):
    return paper(
        b=1e5 * np.exp(0.5 * rng.normal(size=size)),
        m=2.0 * np.exp(0.3 * rng.normal(size=size)),
        alpha=20.3 * np.exp(0.1 * rng.normal(size=size)),
        beta=0.6e-3 * np.exp(0.3 * rng.normal(size=size)),
        sigma_0=9e3 * np.exp(0.4 * rng.normal(size=size)),
    )


def take(parameters, index):
    return TouchParameters(*(np.broadcast_to(v, np.shape(parameters.b))[index] for v in parameters))


def assert_same(found, other, rtol=1e-13):
    np.testing.assert_allclose(found.mean_interval, other.mean_interval, rtol=1e3 * rtol)
    for name in ("total_rate", "responding", "mean_rate", "peak_stress"):
        np.testing.assert_allclose(getattr(found, name), getattr(other, name), rtol=rtol, atol=1e-300, err_msg=name)
    for one, two in zip(found.contact, other.contact, strict=True):
        np.testing.assert_allclose(one, two, rtol=rtol)


def part(response, index):
    """The conditions at an index of a response."""
    contact = response.contact._make(field[..., index] for field in response.contact)
    return response._make([*(field[..., index] for field in response[:-1]), contact])


def test_prior_draws_against_the_reference(scene, rng, paper):
    parameters = draws(rng, 20, paper)
    found = scene.respond(parameters)
    for k in range(20):
        exact = reference_response(scene, take(parameters, k), scene.firing.curve)
        largest = max(exact.total_rate.max(), 1.0)
        np.testing.assert_allclose(found.total_rate[k], exact.total_rate, atol=1e-4 * largest, rtol=0)
        # what the likelihood sees: the logarithm of the pad's mean rate
        seen = [np.log(r / scene.n_receptors + 0.1) for r in (found.total_rate[k], exact.total_rate)]
        np.testing.assert_allclose(*seen, atol=2e-4)
        np.testing.assert_allclose(found.responding[k], exact.responding, atol=2e-3)
        for one, two in zip(part(found, np.s_[:]).contact, exact.contact, strict=True):
            np.testing.assert_allclose(one[k], two, rtol=1e-12)


def test_a_batch_of_any_shape_is_its_single_vectors(scene, rng, paper, monkeypatch):
    parameters = draws(rng, (3, 12), paper)
    together = scene.respond(parameters)
    assert together.total_rate.shape == (3, 12, 15)
    for k in np.ndindex(3, 12):
        contact = together.contact._make(field[k] for field in together.contact)
        one = together._make([*(field[k] for field in together[:-1]), contact])
        assert_same(one, scene.respond(take(parameters, k)))
    np.testing.assert_allclose(scene.total_rate(parameters), together.total_rate, rtol=1e-13)
    # chunks do not show
    monkeypatch.setattr("softness_bayes.touch.scene.CHUNK", 4 * 15 * 12)
    assert_same(scene.respond(parameters), together)
    # nor where the moduli differ between vectors and chunks do not divide the vectors that share rate curves
    monkeypatch.setattr("softness_bayes.touch.scene.WITH_CURVES", 22)
    moduli = FABRICS * np.exp(0.1 * rng.standard_normal((3, 12, 5)))
    for k in ((0, 1), (1, 11), (2, 11)):
        np.testing.assert_allclose(
            scene.total_rate(parameters, moduli)[k], scene.total_rate(take(parameters, k), moduli[k]), rtol=1e-12
        )
    assert scene.respond(paper(b=np.empty(0))).mean_interval.shape == (0, 15)


def test_conditions_in_any_order_and_number(scene, rng, paper):
    parameters = draws(rng, 6, paper)
    full = scene.respond(parameters)
    fabric, load = np.tile(np.arange(5), 3), np.repeat(np.arange(3), 5)
    for chosen in (rng.permutation(15), rng.permutation(15)[:4], np.array([7]), np.array([3, 3, 11, 3])):
        sparse = Scene(FABRICS, POISSON, LOADS, scene.firing, fabric[chosen], load[chosen])
        # the tables cover other ranges of moduli, so they agree to their tolerance only
        wanted = part(full, chosen)
        largest = full.total_rate.max()
        np.testing.assert_allclose(sparse.total_rate(parameters), wanted.total_rate, atol=2e-4 * largest)
        for one, two in zip(sparse.contact(parameters), wanted.contact, strict=True):
            np.testing.assert_allclose(one, two, rtol=1e-13)


def test_a_scene_touched_elsewhere_on_the_pad(smooth_firing, rng, paper):
    parameters = draws(rng, 6, paper)
    fabrics, loads, firing = FABRICS[:4], LOADS[:2], smooth_firing()
    distal = Scene(fabrics, 0.3, loads, firing, finger=Finger(contact_centre=(0.0, 10e-3)))
    for x in (7e-3, 30e-3):
        anew = Scene(fabrics, 0.3, loads, firing, finger=Finger(contact_centre=(x, 10e-3)))
        found, wanted = (s.total_rate(parameters) for s in (distal.take(np.arange(8), (x, 10e-3)), anew))
        np.testing.assert_allclose(found, wanted, rtol=1e-12)


def test_fourteen_decades_of_fabric(smooth_firing, paper):
    wide = Scene(np.geomspace(1e-2, 1e12, 15), 0.3, [Indentation(1e-3), Force(0.5)], smooth_firing())
    for changed in (
        {},
        {"m": 50 / math.sqrt(8e-3 * 1e-3) * 8e-3},
        {"b": 1e10},
        {"b": 1.0, "sigma_0": 0.1, "beta": 50.0},
    ):
        exact = reference_response(wide, paper(**changed), wide.firing.curve)
        found = wide.total_rate(paper(**changed))
        assert exact.total_rate.max() > 0
        np.testing.assert_allclose(found, exact.total_rate, atol=5e-4 * exact.total_rate.max())


def test_error_contains_what_no_refinement_shows(smooth_firing, paper, monkeypatch):
    """Where finer nodes run out both scenes are wrong alike, and the difference between them says nothing."""
    readings = Readings().override({"stress_kernel": "printed", "stress_component": "principal"})
    monkeypatch.setattr("softness_bayes.touch.stress_table.SHAPE_NODES", (21,))
    monkeypatch.setattr("softness_bayes.touch.stress_table._table", StressTable)  # not those of other tests
    coarse = Scene(FABRICS, 0.3, LOADS[2:], smooth_firing(), readings=readings)
    parameters = paper()
    exact = reference_response(coarse, parameters, coarse.firing.curve).total_rate
    found = np.abs(coarse.total_rate(parameters) - exact).max() / exact.max()
    between = np.abs(coarse.total_rate(parameters) - coarse.refined().total_rate(parameters)).max() / exact.max()
    assert between < found < coarse.error(parameters)


@pytest.mark.parametrize("name", TouchParameters._fields)
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_parameters_must_be_finite(scene, paper, name, bad):
    for call in (scene.total_rate, scene.respond, scene.contact):
        with pytest.raises(SoftnessError, match=name):
            call(paper(**{name: np.array([1.0, bad])}))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fabric_modulus": [1e5, 0.0]}, "modulus"),
        ({"fabric_modulus": [1e5, math.nan]}, "modulus"),
        ({"fabric_modulus": [1e5, math.inf]}, "modulus"),
        ({"fabric_poisson": 0.6}, "Poisson"),
        ({"fabric_poisson": math.nan}, "Poisson"),
        ({"loads": []}, "condition"),
        ({"fabric": [0, 2], "load": [0, 0]}, "fabric"),
        ({"fabric": [0, 1], "load": [0, 5]}, "load"),
        ({"fabric": [0, 1], "load": [0]}, "condition"),
        ({"fabric": [], "load": []}, "condition"),
        ({"finger": Finger(receptor_depth=0.0)}, "receptor_depth"),
    ],
    ids=lambda value: str(value)[:40],
)
def test_scenes_that_cannot_be(smooth_firing, change, message):
    usual = {"fabric_modulus": [1e5, 1e6], "fabric_poisson": 0.3, "loads": [Indentation(1e-3)]}
    with pytest.raises(InputError, match=message):
        Scene(**{**usual, **change}, firing=smooth_firing(), discretisation=Discretisation(field_tolerance=1e-3))


def test_a_vector_has_the_same_response_in_any_company():
    """A larger alpha beside it needs a longer rate curve; the vector keeps its own."""
    from softness_bayes.touch.neuron.rate_curve import LARGEST_CURRENT

    scene = Scene(np.geomspace(1e4, 1e6, 4), 0.3, (Indentation(2e-3),), FixedChannels())
    alone = TouchParameters(1e5, 2.0, 20.3, 6e-4, 9e3, 1.05, 1.16, 1.0, 1.5)
    company = alone._replace(alpha=np.array([20.3, 60.0, 149.0]))
    together = scene.total_rate(company)
    np.testing.assert_allclose(together[0], scene.total_rate(alone), rtol=1e-13)
    assert (together[1] > together[0])[1:].all()
    with pytest.raises(NumericalError, match="depolarisation"):
        scene.total_rate(alone._replace(alpha=1.01 * LARGEST_CURRENT))


def test_single_precision_is_computed_in_double(scene, paper):
    rounded = TouchParameters(*(np.float32(value) for value in paper()))
    same = TouchParameters(*(float(value) for value in rounded))
    np.testing.assert_allclose(scene.total_rate(rounded), scene.total_rate(same), rtol=1e-12)


@pytest.mark.parametrize(
    "quiet", [{"alpha": 17.999}, {"alpha": 18.0}, {"sigma_0": 1e9}, {"b": 1e-3, "m": 0.0}, {"sigma_0": 1e300}], ids=str
)
def test_where_all_is_silent_means_are_no_numbers(scene, paper, quiet):
    found = scene.respond(paper(**quiet))
    assert (found.total_rate == 0).all()
    assert (found.responding == 0).all()
    assert np.isnan(found.mean_rate).all()
    assert np.isnan(found.mean_interval).all()
