"""Free touches, of one unknown force: the mechanics under every force, their parameter, and what is refused."""

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

from softness_bayes.base.errors import InputError
from softness_bayes.data import ratings_csv, read_experiment
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.scenes import firing_of, touch_parameters, usual_values
from softness_bayes.parameters.declared import TOUCH_FORCE
from softness_bayes.touch.contact import Finger, FingerBox, Force, FreeTouch, loads_at
from softness_bayes.touch.readings import NAMED_READINGS
from softness_bayes.touch.scene import Discretisation, Scene
from tests.support.paths import DATA

FINGER, CLASSICAL = Finger(), NAMED_READINGS["hertz"]
FORCES = np.array([0.7, 1.0, 1.6])


@pytest.fixture(scope="module")
def table():
    rated = pd.read_csv(DATA / "ratings.csv")
    return rated[rated["indentation_mm"] == rated["indentation_mm"].max()].drop(columns="indentation_mm")


@pytest.fixture(scope="module")
def free(table):
    return read_experiment(table, DATA / "fabrics.csv", load="free")


@pytest.mark.parametrize("readings", [CLASSICAL, pytest.param(NAMED_READINGS["mended"], marks=pytest.mark.slow)])
def test_a_free_touch_is_one_of_its_force(readings):
    """The paper's pressure is not the same function at every force, so that no rescaling of moduli would do."""
    moduli, coarse = np.geomspace(2e4, 4e5, 5), Discretisation(field_tolerance=1e-5)
    box = FingerBox((FINGER.radius,) * 2, (FINGER.receptor_depth,) * 2, (0.5, 2.0))
    how = {"readings": readings, "discretisation": coarse}
    values = usual_values(readings)
    usual_touch, firing = touch_parameters(values), firing_of(values, readings.membrane)
    parameters = usual_touch._replace(touch_force=FORCES)
    freely = Scene(moduli, 0.3, [FreeTouch()], firing, finger_box=box, **how).respond(parameters)
    for k, force in enumerate(FORCES):
        known = Scene(moduli, 0.3, [Force(force)], firing, **how).respond(usual_touch)
        assert known.total_rate.max() > 100.0
        assert_allclose(freely.total_rate[k], known.total_rate, rtol=1e-3, atol=0.1)
        assert_allclose(freely.contact.force[k], force)
    assert not np.allclose(freely.total_rate[0], freely.total_rate[2], rtol=0.1)  # or the force would not matter


def test_the_force_is_one_more_parameter(free):
    model = build(free, ModelOptions(readings=CLASSICAL, accuracy=0.01))
    space = model.posterior.space
    assert free.ratings.loads == (FreeTouch(),)
    assert str(dict(zip(space.names, space.sampled, strict=True))[TOUCH_FORCE].prior) == "lognormal(1,0.7)"
    theta = space.draw_prior(np.random.default_rng(1), 3)
    assert np.isfinite(model.posterior(space.coordinates(theta))).all()


def test_a_fixed_force_is_a_stated_load(table, free):
    options = ModelOptions(readings=CLASSICAL, accuracy=0.01, fix={TOUCH_FORCE: 1.6})
    stated = read_experiment(table, DATA / "fabrics.csv", force_n=1.6)
    one, other = (build(data, options if data is free else ModelOptions(readings=CLASSICAL, accuracy=0.01)) for data in
                  (free, stated))  # fmt: skip
    assert one.posterior.names == other.posterior.names
    theta = one.posterior.space.draw_prior(np.random.default_rng(2), 8)
    rates = (model.posterior.mean_rate(theta) for model in (one, other))
    assert_allclose(*rates, rtol=0.02, atol=1.0)


def test_loads_survive_their_columns(free):
    assert loads_at([np.nan, np.nan, 2e-3], [1.5, np.nan, np.nan])[1] == FreeTouch()
    assert "force_n" not in ratings_csv(free.ratings)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"load_cv": 0.1}, "force of a free touch is unknown"),
        ({"shared_load_cv": 0.1}, "force of a free touch is unknown"),
        ({"individual": ("b",)}, "own fingers and a free touch"),
        ({"priors": {TOUCH_FORCE: "lognormal(1,3)"}}, "outside 0.05 to 20 N"),
    ],
)
def test_refused_with_free_touches(free, options, said):
    with pytest.raises(InputError, match=said):
        build(free, ModelOptions(readings=CLASSICAL, accuracy=0.01, **options))


def test_refused_tables(table, free):
    stated = read_experiment(table, DATA / "fabrics.csv", force_n=1.0)
    with pytest.raises(InputError, match="touch_force: the model of these data has no such parameter"):
        build(stated, ModelOptions(priors={TOUCH_FORCE: "lognormal(1,0.5)"}))
    with pytest.raises(InputError, match="--load apply only to tables without a load column"):
        read_experiment(DATA / "ratings.csv", DATA / "fabrics.csv", load="free")
    with pytest.raises(InputError, match="expected 'free'"):
        read_experiment(table, DATA / "fabrics.csv", load="light")
    with pytest.raises(InputError, match="--load free"):
        read_experiment(table, DATA / "fabrics.csv")
    with pytest.raises(InputError, match="no stated load to round"):
        read_experiment(table, DATA / "fabrics.csv", load="free", round_load=0.1)
