"""Responses to many loads, interpolated along the loads of each fabric, against every touch by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from softness_bayes.touch.accuracy import errors
from softness_bayes.touch.contact import FingerBox, Force, Indentation
from softness_bayes.touch.readings import Readings
from softness_bayes.touch.scene import Discretisation, Scene
from softness_bayes.touch.stress_fields import SkinBox

MODULI = np.geomspace(1e4, 3e6, 3)
MANY = 90
CLOSE = Discretisation(20, 14.0, 1e-4, load_nodes=3.9)
KINDS = {"force": (Force, 0.25, 2.5), "indentation": (Indentation, 0.8e-3, 3e-3)}
EPS = 0.1


def scene_of(firing, kind="force", others=(), **changed):
    """Each fabric under loads of its own, none twice, in an order without sense; other loads on the first fabric."""
    make, low, high = KINDS[kind]
    loads = [*others, *(make(float(x)) for x in np.geomspace(low, high, MANY))]
    fabric = np.append(np.zeros(len(others), int), np.arange(MANY) % len(MODULI))
    order = np.random.default_rng(1).permutation(len(loads))
    box = SkinBox((2e4, 5e5), (0.5, 6.0))
    how = {"discretisation": CLOSE, "skin_box": box} | changed
    return Scene(MODULI, 0.3, loads, firing, fabric[order], np.arange(len(loads))[order], **how)


def draws(paper, rng, size=60):
    """Vectors under which all, some or no loads make receptors fire, a few with thresholds below zero."""
    sigma_0 = 9e3 * np.exp(0.8 * rng.normal(size=size))
    sigma_0[:4] = [-2e4, 0.0, 100.0, 1e6]
    return paper(b=1e5 * np.exp(0.5 * rng.normal(size=size)), sigma_0=sigma_0)


def by_itself(scene):
    """The scene that evaluates every touch."""
    return scene.coarser(replace(scene.discretisation, load_nodes=None))


def worst(scene, nodes, parameters):
    """Largest errors of the interpolation with some number of nodes."""
    found = scene.coarser(replace(scene.discretisation, load_nodes=nodes)).total_rate(parameters)
    return errors(found, by_itself(scene).total_rate(parameters), scene.n_receptors, EPS).largest


@pytest.mark.parametrize("kind", KINDS)
def test_the_curve_is_each_touch_by_itself_and_few_nodes_show(kind, smooth_firing, paper, rng):
    scene, parameters = scene_of(smooth_firing(), kind), draws(paper, rng)
    exact = by_itself(scene).total_rate(parameters)
    fires = exact > 0
    assert fires.all(axis=1).any()
    assert (fires.any(axis=1) & ~fires.all(axis=1)).any()
    assert not fires.all(axis=1)[3]
    every = [worst(scene, nodes, parameters) for nodes in (1.0, 1.8, 2.6, 3.9)]
    assert every[0] > 1e-2  # too few, and the measure says so
    assert every[2] < 1e-3
    assert every[3] < 1e-4
    assert (np.diff(every) < 0).all()


def test_the_error_is_part_of_what_a_scene_states(smooth_firing, paper, rng):
    scene, parameters = scene_of(smooth_firing()), draws(paper, rng, 20)
    few = scene.coarser(replace(CLOSE, load_nodes=1.0))
    assert few.error(parameters).max() > 1e-2 > scene.error(parameters).max()
    part = np.arange(0, MANY, 7)
    assert_allclose(few.take(part).total_rate(parameters), few.total_rate(parameters)[:, part], rtol=1e-9, atol=1e-9)


def test_other_moduli_and_fingers_and_a_load_of_another_kind(smooth_firing, paper, rng):
    box = FingerBox((6.5e-3, 10e-3), (0.5e-3, 0.9e-3))
    parameters = draws(paper, rng, 12)
    moduli = MODULI * np.exp(0.2 * rng.normal(size=(12, MODULI.size)))
    odd = Indentation(1.7e-3)
    known = scene_of(smooth_firing(), others=[odd])
    felt = scene_of(smooth_firing(), others=[odd], finger_box=box)
    own = parameters._replace(radius=rng.uniform(*box.radius, 12), receptor_depth=rng.uniform(*box.receptor_depth, 12))
    for scene, p in ((known, parameters), (felt, own)):
        for modulus in (None, moduli):
            exact = by_itself(scene).total_rate(p, modulus)
            found = scene.total_rate(p, modulus)
            assert_allclose(found, exact, atol=1e-4 * exact.max())
            under = [scene.loads[k] == odd for k in scene.load]
            assert_allclose(found[:, under], exact[:, under], rtol=1e-9)
    assert_allclose(known.total_rate(parameters), known.total_rate(parameters, np.tile(MODULI, (12, 1))), rtol=1e-4)


def test_where_stress_falls_with_the_load_every_touch_is_evaluated(smooth_firing, paper, rng):
    scene = scene_of(smooth_firing(), readings=Readings().override({"pressure": "printed"}))
    parameters = draws(paper, rng, 10)._replace(sigma_0=10.0)
    exact = by_itself(scene).total_rate(parameters)
    assert exact.max() > 0
    assert_allclose(scene.total_rate(parameters), exact, rtol=1e-12)


def test_few_touches_of_each_fabric_are_evaluated_one_by_one(smooth_firing, paper, rng):
    loads = [Force(float(x)) for x in np.linspace(0.4, 1.5, 30)]
    scene = Scene(np.geomspace(1e4, 1e6, 30), 0.3, loads, smooth_firing(), range(30), range(30), discretisation=CLOSE)
    parameters = draws(paper, rng, 5)
    assert_array_equal(scene.total_rate(parameters), by_itself(scene).total_rate(parameters))
