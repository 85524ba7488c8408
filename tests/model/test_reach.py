"""Touches beyond the model's reach are said before anything else, with what would change it; others are not."""

from __future__ import annotations

import numpy as np
import pytest

from softness_bayes.base.readable import percent
from softness_bayes.data import Experiment, Fabrics
from softness_bayes.model.build import COARSE, ExperimentModel
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.reach import DEEP, reach, reach_note, reach_of, reach_of_priors, wide_contacts
from softness_bayes.model.scenes import scene_of, touch_parameters, usual_values
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.touch.contact import Finger, Force, FreeTouch, Indentation
from softness_bayes.touch.neuron.membrane import Channels
from softness_bayes.touch.readings import MENDED

SOFT = Fabrics(tuple(f"cloth {k}" for k in range(30)), effective_modulus=np.geomspace(300.0, 2.6e5, 30))


def values_of(prior_set="default"):
    """Return medians of the priors but for the channels, so that rates come from their surface."""
    return {name: x for name, x in usual_values(MENDED, prior_set).items() if name not in Channels._fields}


STIFF = Fabrics(("drill", "felt", "board"), effective_modulus=np.array([2e5, 6e5, 2e6]))


@pytest.mark.parametrize("prior_set", ["default", "in-vivo"])
def test_shares_are_those_of_each_touch(prior_set):
    values = usual_values(MENDED, prior_set)
    scene = scene_of(SOFT, (Force(1.0), Indentation(2e-3)), values_of(prior_set), MENDED, discretisation=COARSE)
    found, contact = reach(scene, touch_parameters(values)), scene.contact(touch_parameters(values))
    response, radius = scene.respond(touch_parameters(values)), Finger().radius
    assert (found.silent == (response.responding == 0)).all()
    beyond = (contact.radius >= radius) | (contact.indentation >= DEEP * radius)
    assert (found.meaningless == beyond).all()
    assert (found.within == (response.responding > 0) & ~beyond).all()
    assert found.meaningless[scene.load == 0].any()
    assert not found.meaningless[scene.load == 1].any()


def test_of_free_touches_no_other_load_is_tried():
    """Nobody chose a load, and a run with free touches refuses the scene of another one."""
    parameters, asked = touch_parameters(usual_values(MENDED)), []

    def under(loads):
        asked.append(tuple(loads))
        return scene_of(SOFT, (Force(0.1),), values_of(), MENDED, discretisation=COARSE)

    said = reach_note(under, (FreeTouch(),), parameters, {})
    assert said.startswith("most fabrics and loads are outside the range of the model")
    assert "Within the range would be" not in said
    assert asked == [(FreeTouch(),)]
    # the control: of a load, others are tried
    assert "Within the range would be" in reach_note(
        lambda loads: scene_of(SOFT, tuple(loads), values_of(), MENDED, discretisation=COARSE),
        (Force(0.1),),
        touch_parameters(usual_values(MENDED)),
        {},
    )


def test_soft_cloth_is_out_of_reach_and_the_note_says_by_how_much():
    values = usual_values(MENDED)
    scene = scene_of(SOFT, (Force(0.1),), values_of(), MENDED, discretisation=COARSE)
    here = reach(scene, touch_parameters(values))
    said = reach_of_priors(SOFT, (Force(0.1),), MENDED)
    assert said.startswith("most fabrics and loads are outside the range of the model: of 30 pairs of fabric and load")
    assert f"no receptor fires in {percent(here.silent.mean())}" in said
    assert f"{percent(here.within.mean())} are within the range" in said
    # a larger force is named, and brings what it says
    better = scene_of(SOFT, (Force(1.0),), values_of(), MENDED, discretisation=COARSE)
    share = reach(better, touch_parameters(values)).within.mean()
    assert f"Within the range would be {percent(share)} under 1 N" in said
    thin = Fabrics(("gauze", "tulle"), effective_modulus=np.array([10.0, 20.0]))
    hopeless = reach_of_priors(thin, (Force(1.0),), MENDED)
    assert "No load from 0.05 N to 5 N, with --priors in-vivo or without," in hopeless


def test_stiff_cloth_gets_no_note():
    assert reach_of_priors(STIFF, (Indentation(2e-3),), MENDED) == ""
    made = simulate_ratings(np.random.default_rng(0), STIFF, (Indentation(2e-3),), usual_values(MENDED), participants=3)
    rated = Experiment(made.ratings, STIFF, ())
    assert reach_of(ExperimentModel(rated)) == ""
    # the run's own skin decides
    assert reach_of(ExperimentModel(rated, ModelOptions(fix={"sigma_0": 1e3})))


def test_indentations_with_wide_contacts_are_named():
    """The contact radius over R is the root of the indentation over R."""
    loads = [Indentation(0.5e-3), Indentation(2e-3), Indentation(2.001e-3), Force(5.0)]
    assert wide_contacts(loads[:2], Finger()) == ""
    assert "0.50 R at 2.001 mm (R = 8 mm)" in wide_contacts(loads, Finger())
    many = wide_contacts([Indentation(1e-3 * depth) for depth in (7.0, 3.0, 4.0, 5.0, 6.0)], Finger())
    assert "0.61 R at 3 mm to 0.94 R at 7 mm" in many
