"""Responses of many fingers from one series for each load, against a scene evaluated finger by finger."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from softness_bayes.base.errors import InputError
from softness_bayes.touch.contact import Force, Indentation
from softness_bayes.touch.finger_grid import REACH, FingerGrid, FingerSpreads
from softness_bayes.touch.fingers import FingerFamily
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.readings import MENDED
from softness_bayes.touch.scene import Discretisation, Scene

FABRICS = np.geomspace(2e3, 3e6, 7)
COARSE = Discretisation(nodes=8, saturation=9.0, field_tolerance=1e-4)


DEEP = Indentation(2e-3), Indentation(3e-3)


def scene(firing, loads=DEEP, **readings):
    return Scene(FABRICS, 0.3, loads, firing, readings=MENDED.override(readings), discretisation=COARSE)


def drawn(paper, rng, size=12):
    """Parameter vectors over the range of the priors, with spreads of fingers."""
    b, sigma_0 = (scale * np.exp(sd * rng.standard_normal(size)) for scale, sd in ((1e5, 0.5), (9e3, 0.4)))
    typical = paper(b=b, sigma_0=sigma_0)
    typical = TouchParameters(*(np.broadcast_to(value, size) for value in typical))
    b, m, sigma_0 = np.abs(rng.standard_normal((3, size))) * np.array([[0.3], [0.3], [0.2]])
    return typical, FingerSpreads(b, m, sigma_0)


def one_by_one(of, grid, typical, spreads):
    """The same responses from the scene itself."""
    zero = np.zeros(grid.size)
    z = {name: grid.z.get(name, zero) for name in ("b", "m", "sigma_0")}
    rows = TouchParameters(*(np.broadcast_to(value[:, None], (len(typical.b), grid.size)) for value in typical))
    rows = rows._replace(
        b=rows.b * np.exp(np.outer(spreads.b, z["b"])),
        m=np.maximum(rows.m + np.outer(spreads.m, z["m"]), 0.0),
        sigma_0=rows.sigma_0 * np.exp(np.outer(spreads.sigma_0, z["sigma_0"])),
    )
    return of.total_rate(rows)


CASES = {
    "indentation": {},
    "force": {"loads": (Force(0.5), Force(2.0))},
    "both kinds": {"loads": (Force(1.0), Indentation(2e-3))},
    "hertz": {"pressure": "hertz", "stress_kernel": "axisymmetric"},
    "principal": {"stress_component": "principal"},
    "displacement": {"skin_displacement": "displacement"},
}


@pytest.mark.parametrize("nodes", [{"b": 21}, {"b": 9, "m": 3, "sigma_0": 5}], ids=["b", "all"])
@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_the_fingers_respond_as_in_a_scene_of_their_own(case, nodes, smooth_firing, paper, rng):
    of, grid = scene(smooth_firing(), **case), FingerGrid(nodes)
    typical, spreads = drawn(paper, rng)
    if case.get("skin_displacement") == "displacement":
        typical = typical._replace(m=350.0 * typical.m)
    found = FingerFamily(of, grid, 32, 20).total_rate(typical, spreads)
    expected = one_by_one(of, grid, typical, spreads)
    assert found.shape == (12, grid.size, of.n_conditions)
    assert (expected > 0).any()
    assert (expected == 0).any()
    unit = of.n_receptors
    assert_allclose(np.log(found / unit + 0.1), np.log(expected / unit + 0.1), atol=2e-3)


def test_a_coarser_series_errs_more(smooth_firing, paper, rng):
    of, grid = scene(smooth_firing()), FingerGrid({"b": 21})
    typical, spreads = drawn(paper, rng)
    expected = one_by_one(of, grid, typical, spreads)
    error = [
        np.abs(FingerFamily(of, grid, nodes, 20).total_rate(typical, spreads) - expected).max() for nodes in (6, 12, 24)
    ]
    assert error[0] > 10 * error[1] > 10 * error[2]


def test_other_moduli_and_an_onset_far_below_every_contact(smooth_firing, paper, rng):
    of, grid = scene(smooth_firing()), FingerGrid({"b": 5})
    moduli = FABRICS * np.exp(0.2 * rng.standard_normal((3, FABRICS.size)))
    always = paper(sigma_0=np.array([10.0, 9e3, 9e9]))  # fires at the lightest touch, as usual, never
    found = FingerFamily(of, grid, 40).total_rate(always, FingerSpreads(b=0.1), moduli)
    rows = TouchParameters(*(np.broadcast_to(np.reshape(v, (-1, 1)), (3, 5)) for v in always))
    expected = of.total_rate(rows._replace(b=rows.b * np.exp(0.1 * grid.axis("b"))), moduli[:, None])
    assert_allclose(found, expected, rtol=2e-3, atol=1e-3 * of.n_receptors)
    assert (found[2] == 0).all()


def test_grids():
    grid = FingerGrid({"sigma_0": 5, "b": 7})
    assert (grid.names, grid.size) == (("b", "sigma_0"), 35)
    assert_allclose(np.exp(grid.log_weight).sum(), 1.0)
    for name in grid.names:
        z = grid.z[name]
        assert np.abs(z).max() == REACH
        assert_allclose(np.exp(grid.finer().log_weight) @ grid.finer().z[name] ** 2, 1.0, atol=5e-3)
    assert grid.finer().size == 9 * 13
    assert_allclose(grid.finer().axis("b")[::2], grid.axis("b"))
    with pytest.raises(InputError, match="expected some of b, m, sigma_0, got alpha"):
        FingerGrid({"alpha": 3})
    with pytest.raises(InputError, match="got none"):
        FingerGrid({})
