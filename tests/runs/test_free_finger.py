"""Runs in which the finger's radius and the receptors' depth are sampled, from the options to the files."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from softness_bayes.errors import InputError
from softness_bayes.model.build import build, build_skin
from softness_bayes.model.fingers import finger_of
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulation import simulate_compression
from softness_bayes.parameters.laws import Normal, Uniform
from softness_bayes.report.page import report_page
from softness_bayes.results.exact import exact_log_likelihood
from softness_bayes.results.fitted import options_of
from softness_bayes.runs.run import sample
from softness_bayes.touch.readings import MENDED
from softness_bayes.touch.scene import Discretisation
from support.report_runs import HELD, OPTIONS, experiment, quickly

LAWS = {"radius": Normal(8, 0.5), "receptor_depth": Uniform(0.5, 0.9)}
FINE = Discretisation(16, 14.5, 1e-6)


@pytest.fixture(scope="module")
def result(few_pictures):
    with quickly():
        return sample(experiment(), **OPTIONS | {"discretisation": Discretisation(8, 9.0, 1e-3)}, priors=LAWS)


@pytest.fixture(scope="module")
def held_model():
    return build(experiment(), ModelOptions(fix=HELD, discretisation=FINE))


def test_a_run_reports_them_like_any_other_parameter(result):
    table = result.summary()
    assert {"radius", "receptor_depth"} <= {*table.index}
    drawn = {name: result.group("posterior")[name].values for name in LAWS}
    assert drawn["receptor_depth"].min() > 0.5
    assert drawn["receptor_depth"].max() < 0.9
    assert_allclose(table.loc["radius", "mean"], drawn["radius"].mean())
    assert result.group("posterior")["radius"].attrs["units"] == "mm"
    assert_allclose(result.group("constant_data")["finger_radius_mm"], np.median(drawn["radius"]))
    assert result.provenance.priors["radius"] == LAWS["radius"]
    assert options_of(result).priors["receptor_depth"] == LAWS["receptor_depth"]
    assert "receptor_depth" in report_page(result)


def test_predictions_use_the_sampled_values(result):
    table = result.predict(draws=2000)
    held = table["indentation_mm"].to_numpy() == 2.0
    # under a held indentation the contact radius is sqrt(R delta), which nothing else widens
    assert (table["contact_radius_mm_high"] - table["contact_radius_mm_low"])[held].min() > 0.1
    radius = np.median(result.values()["radius"])
    assert_allclose(table["contact_radius_mm"][held], np.sqrt(2.0 * radius), rtol=5e-3)


@pytest.mark.parametrize(
    "names",
    [
        ("radius", "receptor_depth"),
        *(pytest.param((one,), marks=pytest.mark.slow) for one in ("radius", "receptor_depth")),
    ],
    ids="-".join,
)
def test_a_prior_of_tiny_width_gives_the_likelihood_of_the_held_finger(held_model, names, rng):
    narrow = {"radius": Normal(8, 1e-4), "receptor_depth": Normal(0.7, 1e-5)}
    options = ModelOptions(fix=HELD, discretisation=FINE, priors={name: narrow[name] for name in names})
    free = build(experiment(), options)
    held = held_model.posterior
    theta = np.repeat(held.space.median[None], 6, axis=0) * np.exp(
        0.05 * rng.standard_normal((6, held.space.dimension))
    )
    wider = np.column_stack([theta, *(np.full(6, narrow[name].mean) for name in names)])
    assert free.posterior.names == (*held.names, *names)
    expected = held.log_likelihood(theta)
    error = max(free.scene.field_error, held_model.scene.field_error)
    assert error < 1e-4
    assert_allclose(free.posterior.log_likelihood(wider), expected, atol=50 * error, rtol=50 * error)


def test_the_exactness_check_has_the_fingers_of_the_draws(rng):
    free = build(experiment(), ModelOptions(fix=HELD, discretisation=Discretisation(8, 9.0, 1e-4), priors=LAWS))
    posterior = free.posterior
    theta = np.repeat(posterior.space.median[None], 4, axis=0)
    theta[:, -2:] = [[7.4, 0.55], [8.6, 0.85], [8.0, 0.7], [7.0, 0.88]]
    exact = exact_log_likelihood(posterior, theta)
    assert np.ptp(exact) > 0.5
    assert_allclose(posterior.log_likelihood(theta), exact, atol=0.05)


# what is refused


def test_a_finger_with_two_sources_is_refused():
    for name, value in (("radius", 7.5), ("receptor_depth", 0.6)):
        options = ModelOptions(fix=HELD, priors={name: LAWS[name]}, finger=finger_of({f"{name}_mm": value}))
        with pytest.raises(InputError, match=f"{name} is given both a prior and a value of the finger"):
            build(experiment(), options)


def test_forces_of_a_plate_are_those_of_one_radius():
    rng = np.random.default_rng(1)
    forces = simulate_compression(rng, usual_values(MENDED, n_fingers=3), fingers=3).compression
    rated = experiment()._replace(compression=forces)
    with pytest.raises(InputError, match="radius is given a prior, but the model of compression data"):
        build(rated, ModelOptions(fix=HELD, priors={"radius": LAWS["radius"]}))
    with pytest.raises(InputError, match="radius: the model of these data has no such parameter"):
        build_skin(forces, ModelOptions(priors={"radius": LAWS["radius"]}))
    # the depth does not enter a plate's force
    options = ModelOptions(
        fix=HELD, discretisation=Discretisation(6, 7.0, 1e-2), priors={"receptor_depth": LAWS["receptor_depth"]}
    )
    assert "receptor_depth" in build(rated, options).posterior.names
