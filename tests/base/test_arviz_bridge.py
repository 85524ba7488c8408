"""The bridge on whichever line of ArviZ is installed; files read back by either."""

import json
import warnings
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from softness_bayes.base import arviz_bridge
from softness_bayes.base.errors import InputError
from softness_bayes.checking.layout import ratings_in
from softness_bayes.results.data_groups import experiment_of
from support.arviz_types import for_arviz

RNG_SEED = 3


@pytest.fixture
def tree():
    rng = np.random.default_rng(RNG_SEED)
    draws = {"b": rng.lognormal(4, 0.1, (8, 50)), "participant_effect": rng.normal(size=(8, 50, 3))}
    groups = {
        "observed_data": {"rating": np.array([1.0, 2.0])},
        "posterior": draws,
        "log_prior": {"b": rng.normal(size=(8, 50))},
        "sample_stats": {"lp": rng.normal(size=(8, 50))},
        "log_likelihood_joint": {"joint": rng.normal(size=(8, 50))},
        "log_likelihood": {"rating": rng.normal(size=(8, 50, 2))},
        "prior": {"b": rng.lognormal(4, 0.5, (1, 20))},
        "constant_data": {"omega": np.array(0.0)},
    }
    return arviz_bridge.to_tree(
        groups,
        dims={"participant_effect": ["participant"], "rating": ["row"]},
        coords={"participant": ["Änne", "Bo", "Cy"]},
        attrs={"schema": 1, "command": "softness-bayes sample"},
        variable_attrs={"b": {"units": "kPa"}},
    )


def test_files_read_back_identically(tree, tmp_path):
    path = tmp_path / "posterior.nc"
    path.write_bytes(arviz_bridge.netcdf(tree))
    again = arviz_bridge.read_netcdf(path)
    assert again.identical(tree)
    assert [p.name for p in tmp_path.iterdir()] == ["posterior.nc"]
    # reading leaves the file free: it can be replaced while the result is in use
    path.write_bytes(arviz_bridge.netcdf(again))
    assert arviz_bridge.read_netcdf(path).identical(tree)


def test_cached_look_ups_leave_the_file_as_xarray_writes_it(tree):
    assert arviz_bridge.netcdf(tree) == bytes(tree.to_netcdf(None, engine="h5netcdf"))


def test_arviz_itself_reads_the_file_and_works_on_it(tree, tmp_path):
    import arviz

    path = tmp_path / "posterior.nc"
    path.write_bytes(arviz_bridge.netcdf(tree))
    from_file, converted = arviz.from_netcdf(path), for_arviz(tree)
    for data in (from_file, converted):
        np.testing.assert_array_equal(data["posterior"]["b"].values, tree["posterior"]["b"].values)
        np.testing.assert_array_equal(data["log_prior"]["b"].values, tree["log_prior"]["b"].values)
        assert data.attrs["command"] == "softness-bayes sample"
        assert np.isfinite(float(arviz.ess(data)["b"]))


@pytest.mark.parametrize("name", ["ratings", "slider"])
def test_arviz_sees_one_observation_for_each_rating_of_a_run(name, report_run, tmp_path):
    import arviz

    result = report_run(name)
    result.save(tmp_path)
    data = arviz.from_netcdf(tmp_path / "posterior.nc")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the walk is short
        found, compared = arviz.loo(data, pointwise=True, reff=1.0), arviz.compare({"one": data, "other": data})
    alone = result.group("log_likelihood")["rating"].values[0]
    assert found.n_data_points == alone.shape[1] == result.group("observed_data")["rating"].size > 30
    log_weights, _ = arviz_bridge.psis(-alone.T)
    each = np.logaddexp.reduce(log_weights + alone.T, axis=1)
    value = getattr(found, "elpd_loo", None) if hasattr(found, "elpd_loo") else found.elpd
    assert float(value) == pytest.approx(each.sum(), abs=1e-3)
    assert len(compared) == 2
    # negative control: the joint log-likelihood, of which ArviZ makes one observation
    joint = result.group("log_likelihood_joint")
    assert [v.dims for v in joint.data_vars.values()] == [("chain", "draw")]
    if hasattr(data, "to_dataframe"):  # 0.23
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pandas has plans for what ArviZ calls
            columns = data.to_dataframe().columns
        assert ("posterior", "b") in {*columns}
        assert json.loads(Path(data.to_json(str(tmp_path / "all.json"))).read_text())["attrs"]["seed"] == 3


def test_figures_of_arviz_are_drawn(report_run, tmp_path):
    import arviz

    report_run("ratings").save(tmp_path)
    data = arviz.from_netcdf(tmp_path / "posterior.nc")
    of_both = ("plot_trace", "plot_forest", "plot_rank", "plot_ess", "plot_autocorr", "plot_pair")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name in of_both:
            getattr(arviz, name)(data, var_names=["b", "gamma"])
        if hasattr(arviz, "plot_ppc"):
            arviz.plot_ppc(data)
            arviz.plot_loo_pit(data, y="rating")
            arviz.plot_khat(arviz.loo(data, pointwise=True))
        else:
            arviz.plot_ppc_dist(data, var_names=["rating"])
            arviz.plot_loo_pit(data)
    plt.close("all")


def test_ratings_of_a_slider_have_the_numbers_of_its_file(report_run):
    result = report_run("slider")
    filed = experiment_of(result).ratings.rating
    assert filed.max() > 50
    assert {*filed} & {0.0, 100.0}  # at the ends
    assert_array_equal(result.group("observed_data")["rating"], filed)
    again = result.group("posterior_predictive")["rating"].values
    assert 50 < again.max() <= 100
    held = ratings_in(result.tree)
    assert ((held > 0) & (held < 100)).all()
    assert_array_equal(held[(filed > 0) & (filed < 100)], filed[(filed > 0) & (filed < 100)])
    typical = result.predict(draws=50)["typical_rating"]
    assert ((typical > 1) & (typical < 100)).all()
    # a wish in the numbers of the file; negative control: a share of the slider is another wish
    wish = float(typical.median())
    near, far = (result.target(rating, draws=50).table for rating in (wish, wish / 100))
    assert near["p_reachable"].max() > 0.5 > far["p_reachable"].max()
    with pytest.raises(InputError, match="rating is 101"):
        result.target(101.0, draws=50)
    assert "steps of 1 (5)" in result.provenance.rating_model.rating_note


def test_diagnostics_of_independent_draws():
    chains = np.random.default_rng(1).normal(size=(4, 2000))
    assert arviz_bridge.r_hat(chains) < 1.01
    assert arviz_bridge.ess_bulk(chains) == pytest.approx(8000, rel=0.15)
    assert arviz_bridge.mcse(chains, "mean") == pytest.approx(8000**-0.5, rel=0.1)
    assert arviz_bridge.mcse(chains, "sd") == pytest.approx(16000**-0.5, rel=0.1)
    assert arviz_bridge.hdi(chains, 0.9) == pytest.approx((-1.645, 1.645), abs=0.15)
    assert arviz_bridge.hdi(chains, 0.5) == pytest.approx((-0.674, 0.674), abs=0.2)
    # negative control: chains about different means
    assert arviz_bridge.r_hat(chains + np.arange(4)[:, None]) > 1.2


def test_weights_are_smoothed_where_they_have_a_tail():
    rng = np.random.default_rng(2)
    ratios = np.stack([rng.normal(size=2000), 2.5 * rng.exponential(size=2000), np.full(2000, 3.0)])
    log_weights, pareto_k = arviz_bridge.psis(ratios)
    np.testing.assert_allclose(np.exp(log_weights).sum(axis=1), 1)
    assert pareto_k[0] < 0.5 < 0.7 < pareto_k[1]
    assert np.isneginf(pareto_k[2])
    np.testing.assert_allclose(log_weights[2], -np.log(2000))
    raw = ratios - np.logaddexp.reduce(ratios, axis=1, keepdims=True)
    assert np.corrcoef(log_weights[0], raw[0])[0, 1] > 0.99
    assert log_weights[1].max() < raw[1].max()
