"""Fabrics of a wished rating: both solutions of a curve that turns over, and what cannot be reached."""

import io

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

from softness_bayes.data import Fabrics
from softness_bayes.model.prediction import OtherTouches
from softness_bayes.results.fitted import Fitted
from softness_bayes.results.target import Cloth, solutions
from softness_bayes.touch.contact import Force
from softness_bayes.touch.readings import ALTERNATIVES
from support.command_line import call, refused
from support.report_runs import LOADS, quickly

GRID = np.linspace(0.0, np.pi, 1001)


@pytest.fixture(scope="module")
def result(report_run):
    return report_run("ratings")


@pytest.fixture(scope="module")
def wished(result):
    """A rating that some draws reach under both loads."""
    return float(np.median(result.group("predictions")["typical_rating"].values.max(axis=-1)) * 0.8)


@pytest.fixture(scope="module")
def found(result, wished):
    with quickly():
        return result.target(wished, draws=80)


def test_a_curve_that_turns_over_has_two_solutions():
    curves = np.stack([np.sin(GRID) - 0.5, np.sin(GRID) - 2.0, -np.cos(GRID), -np.sin(GRID) + 0.5])
    moduli = solutions(GRID, curves)
    assert {*moduli} == {(True, 0), (False, 0)}
    none = np.nan
    assert_allclose(np.log(moduli[True, 0]), [np.pi / 6, none, np.pi / 2, 5 * np.pi / 6], atol=1e-6)
    assert_allclose(np.log(moduli[False, 0]), [5 * np.pi / 6, none, none, np.pi / 6], atol=1e-6)


def test_further_crossings_are_numbered_from_the_softest_on():
    moduli = solutions(GRID, np.sin(4 * GRID)[None] - 0.5)
    assert {*moduli} == {(True, 0), (False, 0), (True, 1), (False, 1)}
    places = [np.log(moduli[key])[0] for key in ((True, 0), (False, 0), (True, 1), (False, 1))]
    assert_allclose(places, np.array([1, 5, 13, 17]) * np.pi / 24, atol=1e-5)
    # a level stretch at the wished value is no solution, and where it ends is one
    level = np.clip(GRID - 1.0, 0.0, None)
    assert_allclose(np.log(solutions(GRID, level[None])[True, 0]), 1.0, atol=GRID[1])
    assert solutions(GRID, np.zeros((2, GRID.size))) == {}


def test_solutions_have_the_wished_rating_draw_by_draw(result, wished, found):
    with quickly():
        fitted = Fitted(result, 80)
        for load, moduli in found.moduli.items():
            assert moduli, load
            for key, modulus in moduli.items():
                known = np.isfinite(modulus)
                asked = np.where(known, modulus, np.nanmedian(modulus))[:, None]
                cloth = Fabrics(("wished",), effective_modulus=np.median(asked), poisson_ratio=found.poisson_ratio)
                scene = fitted.scene(cloth, (load,))
                again = OtherTouches(fitted.posterior, scene, None)
                # the same generator draws the same effects
                rating = again.ratings(np.random.default_rng(0), fitted.theta, modulus=asked).typical[:, 0]
                assert_allclose(rating[known], wished, rtol=5e-3, err_msg=str((load, key)))


def test_a_grid_of_fabrics_finds_the_same_solutions(result, wished, found):
    """Every crossing of the wished rating along a fine grid of fabrics, in every draw: as many, and there."""
    with quickly():
        fitted = Fitted(result, 80)
        modulus = np.geomspace(*found.span, 701)
        cloth = Fabrics(tuple(map(str, modulus)), effective_modulus=modulus, poisson_ratio=found.poisson_ratio)
        for load, moduli in found.moduli.items():
            touches = OtherTouches(fitted.posterior, fitted.scene(cloth, (load,)), None)
            rating = touches.ratings(np.random.default_rng(0), fitted.theta).typical
            crossed = np.diff(np.sign(rating - wished), axis=1)
            for rises, sign in ((True, 1), (False, -1)):
                there = [modulus[np.flatnonzero(row * sign > 0)] for row in crossed]
                told = np.array([values for (way, _), values in moduli.items() if way is rises])
                for draw, places in enumerate(there):
                    mine = np.sort(told[:, draw][np.isfinite(told[:, draw])]) if told.size else np.empty(0)
                    assert_allclose(np.log(mine), np.log(places), atol=2 * np.log(modulus[1] / modulus[0]))
        # the response turns over: some draws have two
        assert any({True, False} <= {way for way, _ in moduli} for moduli in found.moduli.values())


def test_probabilities_of_the_three_cases_sum_to_one(result, wished, found):
    table = found.table
    assert_allclose(table["p_reachable"] + table["p_too_high"] + table["p_too_low"], 1.0)
    assert (table["least_rating"] < table["largest_rating"]).all()
    assert (table["p_solution"] <= table["p_reachable"]).all()
    assert (table["e_fab_kpa_low"] <= table["e_fab_kpa"]).all()
    for _, rows in table.groupby("load"):
        assert rows["e_fab_kpa"].is_monotonic_increasing
    with quickly():
        never = result.target(1e6 * wished, loads=[Force(1.0)], draws=20).table
        below = result.target(1e-6 * wished, loads=[Force(1.0)], draws=20).table
    assert never["p_too_high"].tolist() == below["p_too_low"].tolist() == [1.0]
    assert never["p_solution"].tolist() == [0.0]
    assert never["e_fab_kpa"].isna().all()
    assert never["remarks"][0] == "no modulus from 2 to 4000 kPa has this rating"


@pytest.mark.parametrize("reading", ALTERNATIVES["fabric_modulus"].values(), ids=lambda reading: reading.name)
def test_thickness_and_tensile_modulus_make_the_modulus(reading):
    modulus = np.array([3e3, 2e5])
    column, thickness = Cloth(tensile_modulus=4e6).sought(modulus, 0.25, reading)
    assert column.name == "thickness_mm"
    same = {"poisson_ratio": np.array([0.25] * 2)}
    made = Fabrics(("a", "b"), tensile_modulus=np.array([4e6] * 2), thickness=thickness, **same)
    assert_allclose(made.modulus(reading), modulus)
    column, tensile = Cloth(thickness=3e-4).sought(modulus, 0.25, reading)
    assert column.name == "tensile_modulus_mpa"
    made = Fabrics(("a", "b"), tensile_modulus=tensile, thickness=np.array([3e-4] * 2), **same)
    assert_allclose(made.modulus(reading), modulus)
    assert Cloth().sought(modulus, 0.25, reading) is None


def test_the_table_has_what_is_asked_for(result, wished, found):
    with quickly():
        thick = result.target(wished, tensile_modulus=4e6, poisson_ratio=0.1, draws=80)
    drawn = [values[np.isfinite(values)] for moduli in thick.moduli.values() for values in moduli.values()]
    thickness = np.sort([np.median(np.cbrt(12 * (1 - 0.1) * values * 1e-9 / 4e6)) for values in drawn]) * 1e3
    assert_allclose(np.sort(thick.table["thickness_mm"]), thickness, rtol=1e-9)
    assert thick.poisson_ratio == 0.1
    assert "thickness_mm" not in found.table
    assert found.poisson_ratio == pytest.approx(0.3)


def test_z_scores_may_be_negative(report_run):
    with quickly():
        table = report_run("z-scores").target(-0.2, draws=20).table
    assert_allclose(table["p_reachable"] + table["p_too_high"] + table["p_too_low"], 1.0)


def test_the_command_line_finds_targets(result, wished, tmp_path):
    run = tmp_path / "run"
    result.save(run)
    with quickly():
        done = call("target", run, "--rating", wished, "--tensile-modulus-mpa", 4)
        filed = call("target", run, "--rating", 1e9, "--force-n", 1, "--out", tmp_path / "table.csv")
        for rating in (0, "nan", "inf"):
            refused(call("target", run, "--rating", rating), "--rating" if rating else "rating is 0, expected one of")
        refused(
            call("target", run, "--rating", 9, "--thickness-mm", -1), "thickness_mm is -1, expected a finite number"
        )
        refused(call("target", run, "--rating", 9, "--poisson-ratio", 2), "poisson_ratio is 2")
        both = ["--thickness-mm", 1, "--tensile-modulus-mpa", 4]
        refused(call("target", run, "--rating", 9, *both), "are both given")
    assert done.returncode == 0, done.stderr
    printed = pd.read_csv(io.StringIO(done.stdout))
    assert printed["load"].unique().tolist() == [str(load) for load in LOADS]
    assert "thickness_mm" in printed
    assert "is reachable with probability" in done.stderr
    assert "; people themselves rated " in done.stderr
    assert "thickness " in done.stderr
    assert filed.returncode == 0, filed.stderr
    assert "the ratings of the typical rater range from" in filed.stderr
    assert pd.read_csv(tmp_path / "table.csv")["p_reachable"].tolist() == [0.0]
