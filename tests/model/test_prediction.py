"""The forward model as a table: its columns, units, limits and gaps."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from softness_bayes.data import Fabrics
from softness_bayes.model.prediction import prediction_table
from softness_bayes.touch.contact import Force, Indentation, solve_contact
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.scene import Scene

QUANTITIES = [
    "indentation_mm",
    "force_n",
    "e_fab_kpa",
    "e_skin_kpa",
    "contact_radius_mm",
    "peak_stress_kpa",
    "total_rate_hz",
    "responding",
    "mean_rate_hz",
    "mean_interval_ms",
    "log_rate_slope",
]
CLOTH = Fabrics(("gauze", "lawn", "drill"), effective_modulus=np.array([1e3, 8e4, 4e5]))
LOADS = (Indentation(2e-3), Force(0.8))


@pytest.fixture(scope="module")
def scene(smooth_firing):
    return Scene(CLOTH.modulus(), CLOTH.poisson_ratio, LOADS, smooth_firing())


def batch(paper, rng, size):
    columns = {name: np.full(size, value) for name, value in paper()._asdict().items()}
    columns["b"] = 1e5 * rng.lognormal(0, 0.4, size)
    columns["sigma_0"] = 9e3 * rng.lognormal(0, 0.3, size)
    return TouchParameters(**columns)


def test_one_row_for_each_fabric_and_load(scene, paper):
    table = prediction_table(CLOTH, scene, paper())
    assert list(table) == ["fabric", *QUANTITIES, "readings"]
    assert (table["readings"] == "mended").all()
    assert table["fabric"].tolist() == ["gauze", "lawn", "drill"] * 2
    assert_allclose(table["e_fab_kpa"], [1, 80, 400] * 2)
    assert_allclose(table["indentation_mm"][:3], 2)
    assert_allclose(table["force_n"][3:], 0.8)
    for k, load in enumerate(LOADS):
        rows = table.iloc[3 * k : 3 * k + 3]
        contact = solve_contact(CLOTH.modulus(), CLOTH.poisson_ratio, load, paper().b, paper().m)
        assert_allclose(rows["e_skin_kpa"], contact.skin_modulus / 1e3, rtol=1e-9)
        assert_allclose(rows["contact_radius_mm"], contact.radius * 1e3, rtol=1e-9)
        assert_allclose(rows["indentation_mm"], contact.indentation * 1e3, rtol=1e-9)
        assert_allclose(rows["force_n"], contact.force, rtol=1e-9)


def test_rates_and_receptors_agree_with_each_other(scene, paper):
    table = prediction_table(CLOTH, scene, paper(sigma_0=5e3))
    firing = table[table["responding"] > 0]
    assert len(firing) >= 2
    assert_allclose(firing["total_rate_hz"], firing["responding"] * firing["mean_rate_hz"], rtol=1e-9)
    # a mean interval is never below the interval of the mean rate (Jensen)
    assert (firing["mean_interval_ms"] >= 1e3 / firing["mean_rate_hz"] * (1 - 1e-9)).all()
    assert (firing["responding"] <= 249.7).all()
    assert_allclose(table["total_rate_hz"], scene.total_rate(paper(sigma_0=5e3)), rtol=1e-9)


def test_where_nothing_fires_rate_and_interval_are_empty(scene, paper):
    table = prediction_table(CLOTH, scene, paper())
    silent = table["responding"] == 0
    assert 0 < silent.sum() < len(table)
    assert_array_equal(table["total_rate_hz"] == 0, silent)
    for name in QUANTITIES:
        assert_array_equal(table[name].isna(), silent & (name in QUANTITIES[-3:]))
    lines = table.to_csv(index=False).splitlines()
    assert lines[1 + int(np.flatnonzero(silent)[0])].endswith(",0.0,0.0,,,,mended")
    assert "nan" not in "".join(lines)


def test_draws_give_a_median_between_its_limits(scene, paper, rng):
    draws = batch(paper, rng, 200)
    table = prediction_table(CLOTH, scene, draws, prob=0.8)
    expected = [f"{name}{end}" for name in QUANTITIES for end in ("", "_low", "_high")]
    assert next(iter(table)) == "fabric"
    assert sorted(table) == sorted(["fabric", *expected, "readings"])
    for name in QUANTITIES:  # each has its limits beside it
        place = list(table).index(name)
        assert {list(table)[place - 1], list(table)[place + 1]} == {f"{name}_low", f"{name}_high"}
    rate = np.array([scene.total_rate(TouchParameters(*(column[i] for column in draws))) for i in range(200)])
    for end, p in (("_low", 0.1), ("", 0.5), ("_high", 0.9)):
        assert_allclose(table[f"total_rate_hz{end}"], np.quantile(rate, p, axis=0), rtol=1e-9, atol=1e-9)
    assert (table["e_fab_kpa_low"] == table["e_fab_kpa_high"]).all()
    assert (table["e_skin_kpa_low"] < table["e_skin_kpa_high"]).all()


def test_the_slope_is_that_of_the_rates_of_other_moduli(scene, smooth_firing, paper):
    softer, stiffer = (
        prediction_table(CLOTH, Scene(ratio * CLOTH.modulus(), CLOTH.poisson_ratio, LOADS, smooth_firing()), paper())
        for ratio in (0.97, 1.03)
    )
    table = prediction_table(CLOTH, scene, paper())
    fires = softer["total_rate_hz"].to_numpy() > 0
    across = np.log(stiffer["total_rate_hz"] / softer["total_rate_hz"])[fires] / np.log(1.03 / 0.97)
    assert fires.any()
    assert_allclose(table["log_rate_slope"][fires], across, rtol=0.02, atol=0.02)
    assert table["log_rate_slope"][table["total_rate_hz"] == 0].isna().all()
