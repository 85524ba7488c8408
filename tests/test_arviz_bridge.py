"""The bridge on whichever line of ArviZ is installed; files read back by either."""

import numpy as np
import pytest

from softness_bayes import arviz_bridge

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
        "log_likelihood": {"joint": rng.normal(size=(8, 50))},
        "log_likelihood_loo": {"rating": rng.normal(size=(8, 50, 2))},
        "prior": {"b": rng.lognormal(4, 0.5, (1, 20))},
        "constant_data": {"omega": np.array(0.0)},
    }
    return arviz_bridge.to_tree(
        groups,
        dims={"participant_effect": ["participant"], "rating": ["row"]},
        coords={"participant": ["Änne", "Bo", "Cy"], "ensemble": np.repeat([0, 1], 4)},
        attrs={"schema": 1, "command": "softness-bayes sample"},
        variable_attrs={"b": {"units": "kPa"}},
    )


def test_a_tree_has_the_groups_in_the_order_of_the_file_with_their_coordinates(tree):
    assert list(tree.children) == [g for g in arviz_bridge.GROUPS if g in tree.children]
    assert tree["posterior"]["b"].dims == ("chain", "draw")
    assert tree["posterior"]["b"].attrs["units"] == tree["prior"]["b"].attrs["units"] == "kPa"
    assert tree["posterior"]["participant_effect"].sel(participant="Änne").shape == (8, 50)
    assert tree["posterior"]["b"].coords["ensemble"].values.tolist() == [0] * 4 + [1] * 4
    assert tree["observed_data"]["rating"].dims == ("row",)
    assert "ensemble" not in tree["prior"].coords  # its one chain is no walker's
    assert tree["constant_data"]["omega"].dims == ()


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
    from_file, converted = arviz.from_netcdf(path), arviz_bridge.for_arviz(tree)
    for data in (from_file, converted):
        np.testing.assert_array_equal(data["posterior"]["b"].values, tree["posterior"]["b"].values)
        np.testing.assert_array_equal(data["log_prior"]["b"].values, tree["log_prior"]["b"].values)
        assert data.attrs["command"] == "softness-bayes sample"
        assert np.isfinite(float(arviz.ess(data)["b"]))


def test_diagnostics_of_independent_draws():
    chains = np.random.default_rng(1).normal(size=(4, 2000))
    assert arviz_bridge.r_hat(chains) < 1.01
    assert arviz_bridge.ess_bulk(chains) == pytest.approx(8000, rel=0.15)
    assert arviz_bridge.mcse_mean(chains) == pytest.approx(8000**-0.5, rel=0.1)
    assert arviz_bridge.mcse_sd(chains) == pytest.approx(16000**-0.5, rel=0.1)
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
