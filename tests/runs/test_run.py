"""A small run from ratings to its file: what it holds, and whether it is what the model says."""

import dataclasses
import functools
import json

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import halfnorm, kstest, lognorm

from softness_bayes.checking.inflection import curve_scene
from softness_bayes.data import Experiment, Fabrics
from softness_bayes.model.build import build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.results import predictions
from softness_bayes.results.result import Result
from softness_bayes.results.run_checks import FIRST_DRAWS
from softness_bayes.results.run_options import Request, RunOptions
from softness_bayes.results.stored import SCHEMA
from softness_bayes.runs.run import sample
from softness_bayes.sampler import sampling
from softness_bayes.sampler.sampling import Settings
from softness_bayes.touch.contact import Force, Indentation
from softness_bayes.touch.neuron import fixed_channels
from softness_bayes.touch.neuron.rate_curve import CurveError, RateCurve
from softness_bayes.touch.neuron.spikes import spike_times
from softness_bayes.touch.readings import MENDED
from support import report_runs
from support.arviz_types import for_arviz
from support.report_runs import COARSE

CLOTH = Fabrics(("felt", "lawn", "drill", "gauze"), effective_modulus=np.array([8e4, 2e4, 4e5, 2e5]))
LOADS = (Indentation(2e-3), Force(1.5))
HELD = {"m": 2.0, "beta": 0.6, "c_Na": 1.05, "c_K": 1.16, "c_L": 1.0, "c_A": 1.5}
SAMPLED = ["b", "alpha", "sigma_0", "gamma", "tau", "varsigma", "eps"]
PRIORS = {
    "b": lognorm(0.5, scale=100),
    "alpha": lognorm(0.1, scale=20.3),
    "sigma_0": lognorm(0.4, scale=9),
    "gamma": lognorm(0.3),
    "tau": halfnorm,
    "varsigma": halfnorm(scale=0.5),
    "eps": lognorm(1, scale=0.1),
}
PARTICIPANTS, ROWS, MISSING = 5, 32, 8


@pytest.fixture(scope="module", autouse=True)
def quickly():
    """Learn little in the pilot walk."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("softness_bayes.sampler.sampling.Settings", functools.partial(Settings, pilot=(20, 20), optima=1))
        patch.setattr(predictions, "spike_times", lambda *_: np.array([12.0, 30.0]))
        yield


@pytest.fixture(scope="module")
def experiment():
    values = usual_values(MENDED, given={"sigma_0": 7.0, "varsigma": 0.2})
    rng = np.random.default_rng(11)
    made = simulate_ratings(rng, CLOTH, LOADS, values, participants=PARTICIPANTS, missing=0.08)
    assert len(made.ratings) == ROWS
    return Experiment(dataclasses.replace(made.ratings, digest="abc"), CLOTH, ())


@pytest.fixture(scope="module")
def options():
    command = "softness-bayes sample --data x"
    return Request(
        ModelOptions(fix=HELD, discretisation=COARSE),
        RunOptions(max_steps=100, processes=1, seed=3, command=command),
    )


@pytest.fixture(scope="module")
def posterior(experiment, options):
    return build(experiment, options.model).posterior


@pytest.fixture(scope="module")
def result(experiment, options):
    return sample(experiment, *options)


@pytest.fixture(scope="module")
def directory(result, tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "results"
    result.save(path)
    return path


def theta_of(dataset, prefix=""):
    return np.stack([dataset[prefix + name].values for name in SAMPLED], axis=-1)


# what the file holds


def test_dimensions_and_coordinates(result):
    """Groups, their variables and these' dimensions are stored in `tests/golden/run.txt`."""
    posterior = result.group("posterior")
    chains, draws = posterior.sizes["chain"], posterior.sizes["draw"]
    assert chains == 4 * 28  # four ensembles of four walkers for each parameter
    ensemble = result.group("sample_stats")["ensemble"].values
    assert ensemble[:, 0].tolist() == [e for e in range(4) for _ in range(28)]
    assert (ensemble == ensemble[:, :1]).all()
    assert posterior["participant"].values.tolist() == ["P1", "P2", "P3", "P4", "P5"]
    for group in ("sample_stats", "log_prior", "log_likelihood_joint"):
        assert dict(result.group(group).sizes) == {"chain": chains, "draw": draws}
    for group in ("posterior_predictive", "prior_predictive", "log_likelihood", "observed_data"):
        assert result.group(group)["rating"].sizes["rating_row"] == ROWS
    rate = result.group("predictions")["total_rate"]
    assert rate["load"].values.tolist() == ["2 mm", "1.5 N"]
    assert_allclose(rate["e_fab_kpa"].values[[0, -1]], [2, 4000])  # a tenth of 20, ten times 400 kPa
    for name, value in {**HELD, "omega": 0.0}.items():
        assert result.group("constant_data")[name] == value


def test_the_data_are_in_the_file(result, experiment):
    ratings, constant = experiment.ratings, result.group("constant_data")
    assert_array_equal(result.group("observed_data")["rating"], ratings.rating)
    fabric = constant["fabric"].values[constant["fabric_index"].values]
    assert fabric.tolist() == [ratings.fabrics[i] for i in ratings.fabric]
    assert_array_equal(constant["participant_index"], ratings.participant)
    assert_allclose(constant["effective_modulus_kpa"], [80, 20, 400, 200])
    assert constant["effective_modulus_kpa"].attrs["units"] == "kPa"
    assert_array_equal(constant["indentation_mm"], [2, np.nan])
    assert_array_equal(constant["force_n"], [np.nan, 1.5])
    assert result.loads == LOADS


def test_provenance(result):
    found = result.attributes
    assert found["schema_version"] == SCHEMA
    assert (found["seed"], found["command"]) == (3, "softness-bayes sample --data x")
    assert (found["digest_ratings"], found["missing_ratings"]) == ("abc", MISSING)
    assert {f"version_{name}" for name in ("numpy", "scipy", "emcee", "arviz", "xarray")} <= {*found}
    assert found["reading_pressure"] == "attenuated"
    assert result.readings == MENDED
    assert found["prior_b"] == "lognormal(100,0.5)"
    assert "prior_m" not in found
    assert found["converged"] == 0
    assert found["verdict"].startswith("Not converged after 100 steps of 4 x 28 walkers")
    assert 0 < found["numerical_error"] < 1e-3
    assert "accuracy" in found
    assert found["discretisation"] == str(COARSE)
    assert result.provenance.held_eps == ""
    assert result.group("constant_data")["finger_radius_mm"] == 8


# whether it is what the model says


def test_log_prior_by_another_library(result):
    for name in SAMPLED:
        expected = PRIORS[name].logpdf(result.group("posterior")[name].values)
        assert_allclose(result.group("log_prior")[name], expected, rtol=1e-10, atol=1e-10)


def test_log_likelihood_is_that_of_the_stored_draws(result, posterior):
    theta = theta_of(result.group("posterior"))
    (stored,) = result.group("log_likelihood_joint").data_vars.values()
    assert_allclose(stored, posterior.log_likelihood(theta), rtol=1e-9)
    assert stored.values.std() > 0.1
    # in natural units, whatever the coordinates of the sampler: negative control, those have another density
    density = posterior.log_prior(theta) + posterior.log_likelihood(theta)
    assert_allclose(result.group("sample_stats")["lp"], density, rtol=1e-9)
    in_coordinates = posterior(posterior.space.coordinates(theta.reshape(-1, len(SAMPLED))))
    # the Jacobian is 1 where b, gamma, eps and the others happen to balance: in hardly any of ten thousand draws
    assert (np.abs(in_coordinates - density.ravel()) > 1e-2).mean() > 0.98


def test_some_draws_say_which_of_the_posterior_they_are(result, posterior):
    loo, constant = result.group("log_likelihood"), result.group("constant_data")
    index = constant["posterior_predictive_chain"].values, constant["posterior_predictive_draw"].values
    theta = theta_of(result.group("posterior"))[index]
    again = posterior.observation.left_out(posterior.mean_rate(theta), posterior.rating_parameters(theta)).log_density
    assert_allclose(loo["rating"].values[0], again, rtol=1e-9)
    curves = result.group("predictions")
    index = constant["predictions_chain"].values, constant["predictions_draw"].values
    assert_array_equal(curves["at_b"].values[0], result.group("posterior")["b"].values[index])


def test_loo_pit_is_stored_for_every_rating(result):
    constant = result.group("constant_data")
    assert constant["loo_pit"].dims == ("rating_row",)
    assert ((constant["loo_pit"] > 0) & (constant["loo_pit"] < 1)).all()
    assert np.isfinite(constant["loo_pareto_k"]).all()
    # higher where the rating lies above what the others predict
    again = result.group("posterior_predictive")["rating"].values[0]
    above = result.group("observed_data")["rating"].values - np.median(again, axis=0)
    assert np.corrcoef(above, constant["loo_pit"])[0, 1] > 0.4


def test_draws_of_the_prior(result):
    for name in SAMPLED:
        assert kstest(result.group("prior")[name].values.ravel(), PRIORS[name].cdf).pvalue > 1e-3


def test_replicates_are_of_the_same_participants_and_new_ones(result):
    observed = np.log(result.group("observed_data")["rating"].values)
    again = np.log(result.group("posterior_predictive")["rating"].values[0])
    assert np.corrcoef(again.mean(axis=0), observed)[0, 1] > 0.8
    others = np.log(result.group("posterior_predictive")["rating_of_new_participants"].values[0])
    people = result.group("constant_data")["participant_index"].values
    means = [[draws[:, people == k].mean(axis=1) for k in range(PARTICIPANTS)] for draws in (again, others)]
    # the mean of one participant moves between replicates only if it is another participant's
    assert np.std(means[1], axis=1).mean() > 1.5 * np.std(means[0], axis=1).mean()
    anew = np.log(result.group("prior_predictive")["rating"].values[0])
    assert anew.std() > 2 * again.std()  # mu has a prior sd of 3
    assert anew.mean() == pytest.approx(np.log(20), abs=5 * 3 / np.sqrt(500))


def test_effects_are_drawn_given_the_ratings(result, experiment):
    effect = result.group("posterior")["participant_effect"].mean(("chain", "draw")).values
    log_rating = np.log(experiment.ratings.rating)
    means = [log_rating[experiment.ratings.participant == k].mean() for k in range(PARTICIPANTS)]
    assert np.corrcoef(effect, means)[0, 1] > 0.95
    mu = result.group("posterior")["mu"].values
    assert mu.mean() == pytest.approx(np.mean(means), abs=0.5)


def test_curves_are_the_scene_on_the_grid_at_their_draws(result, posterior):
    stored = result.group("predictions").isel(chain=0)
    theta = theta_of(stored, "at_")[::37]
    grid = posterior.scene.on_grid(stored["e_fab_kpa"].values * 1e3)
    touch = posterior.space.touch(theta)
    shape = (len(theta), 2, -1)
    rate = grid.total_rate(touch).reshape(shape)
    assert_allclose(stored["total_rate"].values[::37], rate, rtol=1e-5, atol=1e-5)
    contact = grid.contact(touch)
    for name, values in {
        "e_skin_kpa": contact.skin_modulus / 1e3,
        "contact_force_n": contact.force,
        "contact_radius_mm": contact.radius * 1e3,
    }.items():
        assert_allclose(stored[name].values[::37], values.reshape(shape), rtol=1e-6)
    # the rating of a typical participant rises with the response to the power gamma
    eps, gamma = (theta[:, SAMPLED.index(name), None, None] for name in ("eps", "gamma"))
    x = np.log(rate / posterior.scene.n_receptors + eps)
    log_rating = np.log(stored["typical_rating"].values[::37])
    assert_allclose(log_rating - log_rating[..., :1], gamma * (x - x[..., :1]), atol=1e-4)
    mu = result.group("posterior")["mu"].values
    at_data = np.log(stored["typical_rating"].values).mean(axis=0)
    assert at_data.min() < mu.mean() < at_data.max()


def test_probabilities_of_the_inflection(result):
    table = result.inflection()
    assert table.index.tolist() == ["2 mm", "1.5 N"]
    outcomes = table[["p_interior", "p_none", "p_silent"]]
    assert_allclose(outcomes.sum(axis=1), 1)
    assert (table["p_inside"] <= table["p_interior"]).all()
    draws = result.inflections()
    for k, (_, row) in enumerate(table.iterrows()):
        place = draws.modulus[:, k][draws.outcome[:, k] == 1] / 1e3
        assert row["p_interior"] == pytest.approx(np.mean(draws.outcome[:, k] == 1))
        if place.size:
            limits = row[["e_fab_kpa_low", "e_fab_kpa", "e_fab_kpa_high"]].to_numpy(float)
            assert_allclose(limits, np.quantile(place, [0.05, 0.5, 0.95]))
        assert 0 < row["p_interior_mcse"] < 0.1
    stored = result.group("inflection")
    assert 2000 < stored.sizes["chain"] * stored.sizes["draw"] <= 4000
    # the maximum stored beside a curve is that of the curve, within a step of the grid
    curves, beside = result.curves(), result.group("predictions").isel(chain=0)
    draws = draws._replace(outcome=beside["inflection_outcome"].values, modulus=beside["inflection_e_fab_kpa"] * 1e3)
    turns = draws.outcome == 1
    highest = curves.modulus[curves.total_rate.argmax(axis=-1)]
    step = np.log(curves.modulus[1] / curves.modulus[0])
    assert turns.any()
    assert np.abs(np.log(draws.modulus.values / highest))[turns].max() <= 1.5 * step


def test_the_prior_stands_beside_the_probability_of_a_turning_point(result, posterior):
    """From its draws by whole curves: exceeding both ends by 5 % of the maximum."""
    prior = theta_of(result.group("prior"))[0]
    grid = curve_scene(posterior.scene, 321)
    rate = grid.total_rate(posterior.space.touch(prior)).reshape(len(prior), 2, -1)
    top = rate.max(axis=-1)
    assert result.least_drop == 0.05
    clear = (top > 0) & (rate[..., 0] <= 0.95 * top) & (rate[..., -1] <= 0.95 * top)
    found = result.inflection()["prior_p_interior"].to_numpy()
    assert_allclose(found, clear.mean(axis=0), atol=0.005)
    assert ((found > 0.02) & (found < 0.98)).any()


def test_the_summary(result, directory):
    columns = ["mean", "sd", "hdi_low", "hdi_high", "hdi_prob", "ess_bulk", "ess_tail", "r_hat", "mcse_mean"]
    columns.append("mcse_sd")
    written = pd.read_csv(directory / "summary.csv")
    columns += ["prior_mean", "prior_sd", "contraction", "prior_shift", "psens_prior", "psens_likelihood"]
    columns += ["psens_prior_mcse", "psens_likelihood_mcse"]
    assert list(written) == ["parameter", *columns]
    assert written["prior_sd"].iloc[-1] == pytest.approx(3)  # mu's
    assert written["parameter"].tolist() == [*SAMPLED, "mu"]
    table = result.summary()
    for name in (*SAMPLED, "mu"):
        draws = result.group("posterior")[name].values
        row = table.loc[name]
        assert row["mean"] == pytest.approx(draws.mean())
        assert row["sd"] == pytest.approx(draws.std(ddof=1))
        inside = (draws >= row["hdi_low"]) & (draws <= row["hdi_high"])
        assert inside.mean() == pytest.approx(row["hdi_prob"], abs=0.005)
        assert row["hdi_high"] - row["hdi_low"] <= np.diff(np.quantile(draws, [0.05, 0.95]))[0] * (1 + 1e-6)
    # unrounded
    assert_array_equal(written["mean"], table["mean"])
    table.loc["b", "mean"] = 0.0
    assert result.summary().loc["b", "mean"] != 0  # a copy


# in its directory


def test_a_result_reads_back_identically(result, directory):
    assert sorted(path.name for path in directory.iterdir()) == [
        ".softness-bayes.json",
        "directions.csv",
        "fabric_ratings.csv",
        "modulus_errors.csv",
        "posterior.nc",
        "predictive_checks.csv",
        "ruler.csv",
        "summary.csv",
    ]
    for place in (directory, directory / "posterior.nc"):
        again = Result.load(place)
        assert again.tree.identical(result.tree)
        pd.testing.assert_frame_equal(again.table, result.table, check_exact=True)
        for name, table in result.tables.items():
            pd.testing.assert_frame_equal(again.tables[name], table, check_exact=True)
    assert again.loads == result.loads
    pd.testing.assert_frame_equal(again.inflection(), result.inflection())


def test_arviz_works_on_the_file(directory):
    arviz = pytest.importorskip("arviz")
    data = for_arviz(Result.load(directory).tree)
    table = arviz.summary(data, var_names=["b", "mu"], kind="stats")
    assert table.loc["b", "mean"] == pytest.approx(float(data["posterior"]["b"].mean()), rel=1e-2)
    from_file = arviz.from_netcdf(directory / "posterior.nc")
    assert_array_equal(from_file["posterior"]["b"], data["posterior"]["b"])
    assert from_file["posterior"]["b"].attrs["units"] == "kPa"


def test_values_name_every_parameter(result):
    values = result.values(50)
    assert values["b"].shape == (50,)
    assert values["m"] == 2.0
    assert {*usual_values(MENDED)} <= {*values}
    everything = result.values()
    assert everything["b"].size == result.group("posterior")["b"].size
    # a draw stays whole
    pairs = {*zip(everything["b"].tolist(), everything["mu"].tolist(), strict=True)}
    assert {*zip(values["b"].tolist(), values["mu"].tolist(), strict=True)} <= pairs


# what decides the draws


def test_equal_seeds_equal_draws_whatever_the_processes():
    """With the curve and the trains of the membrane itself, as workers have them."""
    curve = fixed_channels.known_curve
    with report_runs.quickly(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(sampling, "Settings", functools.partial(sampling.Settings, together=1))
        patch.setattr(fixed_channels, "known_curve", curve)
        patch.setattr(predictions, "spike_times", spike_times)
        options = [report_runs.OPTIONS | {"processes": count} for count in (1, 2)]
        one, two = (sample(report_runs.experiment(), **asked) for asked in options)
    for group in one.tree.children:
        assert one.tree[group].identical(two.tree[group]), group
    pd.testing.assert_frame_equal(one.table, two.table, check_exact=True)


def test_the_result_says_whether_it_is_exact_enough(result):
    found = result.attributes
    assert found["exactness"].startswith("Exact enough")
    assert 0 < found["exactness_sd"] < 1e-2
    assert found["exactness_efficiency"] > 0.99
    assert 0 < found["firing_error"] < 1e-3
    stored = result.group("sample_stats")["exact_difference"].values
    compared = np.isfinite(stored)
    assert compared.sum() == FIRST_DRAWS  # the answer was certain then
    assert stored[compared].std() == pytest.approx(found["exactness_sd"])


def test_under_noise_the_result_says_what_rates_it_was_compared_with(experiment, options, result, monkeypatch):
    curve = RateCurve(np.array(18.0), np.array(0.0), np.array([14.0, 4.0]), 60.0, CurveError(0.01, 1e-5, 1e-4))
    monkeypatch.setattr(fixed_channels, "averaged_curve", lambda *_: curve)
    noisy = sample(experiment, *options, noise=1.0, max_steps=4)
    assert len(json.loads(noisy.attributes["noise_curves"])) == 2
    assert "compared with the same noise-averaged firing rates and a finer quadrature" in noisy.attributes["exactness"]
    assert "compared with exact firing rates and a finer quadrature" in result.attributes["exactness"]


def test_the_options_in_the_file_repeat_the_run_and_exact_weights_leave_it_as_it_is(experiment, result):
    weighted = sample(experiment, *Request.of(result), exact_reweight=True)
    assert weighted.tree["posterior"].identical(result.tree["posterior"])
    assert weighted.attributes["exact_reweight"] == 1
    table, plain = weighted.summary(), result.summary()
    assert (np.abs(table["mean"] - plain["mean"]) < 0.2 * plain["sd"]).all()
    assert_allclose(table["sd"], plain["sd"], rtol=0.2)
    assert (table["ess_bulk"] <= 1000).all()
    turns = (one.inflection()["p_interior"] for one in (weighted, result))
    assert_allclose(*turns, atol=0.1)
