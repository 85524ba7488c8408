"""Runs on moduli that are not known exactly, from the data to the files, the report and the command line."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import kstest

from softness_bayes.base.laws import LogNormal
from softness_bayes.checking.layout import layout_of
from softness_bayes.data import Experiment, Fabrics
from softness_bayes.experiments.outlook import Candidates, outlook_of_run
from softness_bayes.likelihood.error_laws import NORMAL
from softness_bayes.likelihood.scales import RISES
from softness_bayes.model.scenes import scene_of, touch_parameters, usual_values
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.report.conclusion import facts_of
from softness_bayes.results.data_groups import experiment_of
from softness_bayes.results.fitted import Fitted
from softness_bayes.runs.run import sample
from softness_bayes.touch.contact import Indentation
from softness_bayes.touch.neuron.membrane import PAPER_CHANNELS
from softness_bayes.touch.readings import MENDED
from support.command_line import call, refused
from support.paths import DATA
from support.report_runs import CLOTH, LOADS, converged, quickly
from support.variants import vague_moduli

NAMES = tuple(f"fabric_modulus[{name}]" for name in CLOTH.names)

SCALES = ("modulus_scale", "modulus_scale_2")


@pytest.fixture(scope="module")
def result(variant_run):
    return variant_run("moduli")


def test_predicted_ratings_have_the_posterior_of_the_moduli(result):
    with quickly():
        fitted = Fitted(result, 50)
        found = fitted.modulus(np.random.default_rng(1), result.fabrics)
        table = result.predict(draws=50)
    for k, name in enumerate(result.fabrics.names):
        own = fitted.named.get(f"fabric_modulus[{name}]")
        assert_allclose(found[:, k], result.fabrics.effective_modulus[k] if own is None else own * 1e3)
    assert (table["typical_rating_low"] < table["typical_rating_high"]).all()
    # as the user names them: an error, a bracket, and one that is known
    given = vague_moduli().fabrics.take(CLOTH.names[:3])
    again = fitted.modulus(np.random.default_rng(1), given)
    place = [result.fabrics.names.index(name) for name in given.names]
    assert_allclose(again, found[:, place])


def test_a_result_holds_the_moduli_that_were_not_known(result):
    posterior = result.group("posterior")
    assert posterior["fabric_modulus"].dims == ("chain", "draw", "uncertain_fabric")
    assert posterior["uncertain_fabric"].values.tolist() == [CLOTH.names[k] for k in (0, 2, 3)]
    laws = result.group("constant_data")["fabric_modulus_law"].values.tolist()
    assert [law.partition("(")[0] for law in laws] == ["lognormal", "loguniform", "lognormal"]
    assert laws[2] == "lognormal(150,1.5)"
    table = result.moduli
    drawn = posterior["fabric_modulus"].values.reshape(-1, 3)
    assert_allclose(table["median"], np.median(drawn, axis=0))
    assert_allclose(table.loc[CLOTH.names[2], "law_median"], 400.0)
    assert (drawn[:, 1] >= 200).all()
    assert (drawn[:, 1] <= 800).all()
    # under a law of unknown moduli that is not the default, only the unknown fabric stays out of the trend
    assert "without 1 fabric of unknown modulus" in result.provenance.direction.direction_note
    assert any(line.startswith("fabric moduli: the ratings narrow") for line in result.learnt())
    assert not result.moduli_assumed
    # the parameters' priors are those of parameters alone
    assert not [name for name in result.provenance.priors if "modulus" in name]
    assert {*NAMES} - {NAMES[1]} <= {*result.summary().index}


def test_an_unknown_fabric_that_no_one_rated_has_the_law_of_unknown_moduli(result):
    """Its modulus has the prior of the run; that of an unknown fabric of the ratings has its posterior."""
    fabrics = Fabrics(("new", CLOTH.names[3], "felt"), effective_modulus=np.array([np.nan, np.nan, 3e4]))
    with quickly():
        fitted = Fitted(result, 2000)
        drawn = np.log(fitted.modulus(np.random.default_rng(3), fabrics) / 1e3)
        rows = result.predict(fabrics, draws=200).groupby("fabric", sort=False).first()
    law = LogNormal(150, 1.5)
    assert kstest(drawn[:, 0], lambda x: law.cumulative(np.exp(x))).pvalue > 1e-3
    # independent of all parameters
    apart = [np.corrcoef(drawn[:, 0], values)[0, 1] for values in fitted.theta.T]
    assert_allclose(apart, 0.0, atol=4.5 / np.sqrt(2000))
    assert_allclose(drawn[:, 1], np.log(fitted.named[NAMES[3]]))
    low, high = law.quantile([0.05, 0.95])
    assert rows.loc["new", "e_fab_kpa_low"] == pytest.approx(low, rel=0.7)
    assert rows.loc["new", "e_fab_kpa_high"] == pytest.approx(high, rel=0.7)
    posterior = np.median(result.values(200)[NAMES[3]])
    assert rows.loc[CLOTH.names[3], "e_fab_kpa"] == pytest.approx(posterior)


def test_fabrics_of_a_batch_are_predicted_with_its_factor_and_those_of_a_new_one_with_a_fresh_draw(variant_run):
    result, size = variant_run("batches"), 400
    names = (CLOTH.names[3], "a", "b", "c", "d", "e")
    modulus = np.array([CLOTH.effective_modulus[3], *[5e4] * 5])
    fabrics = Fabrics(names, effective_modulus=modulus, batch=("", "mill A", "mill B", "mill C", "mill C", ""))
    with quickly():
        fitted = Fitted(result, size)
        factor = fitted.modulus(np.random.default_rng(3), fabrics) / modulus
        table = result.predict(fabrics, draws=50).groupby("fabric", sort=False).first()
    first, second = (fitted.named[name] for name in SCALES)
    # a rated fabric keeps its batch, even if the table does not repeat it
    assert_allclose(factor[:, :3], np.stack([second, first, second], axis=-1))
    assert_allclose(factor[:, 3], factor[:, 4])
    fresh = np.log(factor[:, [3, 5]])
    assert_allclose(fresh.std(axis=0), np.sqrt(np.log1p(0.2**2)), rtol=0.2)
    assert_allclose(
        np.corrcoef(fresh, np.log([first, second]).T, rowvar=False)[np.triu_indices(4, 1)][:5], 0, atol=0.25
    )
    assert (table["e_fab_kpa_low"] < table["e_fab_kpa_high"]).all()
    # the order of fabrics by stiffness is that of the draws, and batches come back from the file
    assert experiment_of(result).fabrics.batch == ("mill A", "mill A", "mill B", "mill B")
    expected = CLOTH.effective_modulus * np.median(np.repeat([result.values()[n] for n in SCALES], 2, axis=0), axis=1)
    layout = layout_of(result.tree)
    assert_allclose(layout.modulus, expected[layout.design.fabric])


def test_a_fabric_to_rate_next_has_the_factor_of_its_batch(variant_run):
    """One of a rated fabric's modulus and batch is felt as that one is, of another batch otherwise."""
    modulus = CLOTH.effective_modulus[3]
    names, batch = (CLOTH.names[3], "same", "mill A's", "new", "new too"), ("", "mill B", "mill A", "mill C", "mill C")
    with quickly():
        outlook = outlook_of_run(converged(variant_run("batches")))
        fabrics = Fabrics(names, effective_modulus=np.full(5, modulus), batch=batch)
        response = Candidates(fabrics, loads=(str(LOADS[0]),)).ratings([outlook], None).response
    assert_allclose(response[:, 0], response[:, 1], rtol=1e-9)
    assert_allclose(response[:, 3], response[:, 4], rtol=1e-9)
    for other in (2, 3):
        assert np.abs(response[:, other] - response[:, 0]).std() > 0.01


def test_a_factor_of_moduli_is_said_with_its_batch(variant_run):
    result = variant_run("batches")
    facts = facts_of(converged(result))
    assert [one.words for one in facts.parameters][-2:] == [
        "common factor of moduli (modulus_scale: mill A)",
        "common factor of moduli, batch 2 (modulus_scale_2: mill B)",
    ]
    assert not any("common to all moduli" in line for line in facts.cautions)
    assert any("--shared-modulus-cv" in line for line in facts_of(variant_run("loads")).cautions)  # the control


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_a_batch_that_reads_25_per_cent_high_is_found_and_other_parameters_are_covered(seed):
    """Undeclared, or as an error of all moduli, b (and, taken as exact, a turning point) is missed."""
    values = usual_values(MENDED, given={"varsigma": 0.2, "tau": 0.4})
    batch, loads = tuple("AAABABBABBBB"), (Indentation(2.5e-3), Indentation(3.5e-3))
    true = Fabrics(tuple("abcdefghijkl"), effective_modulus=np.geomspace(3e4, 2e6, 12))
    rated = simulate_ratings(np.random.default_rng(seed), true, loads, values, participants=40).ratings
    read = np.where(np.array(batch) == "B", 1.25, 1.0) * true.effective_modulus
    curve = np.geomspace(5e4, 2e6, 400)
    grid = scene_of(Fabrics(tuple(map(str, range(400))), effective_modulus=curve), loads, values, MENDED)
    peaks = curve[grid.total_rate(touch_parameters(values)).reshape(2, -1).argmax(axis=1)] / 1e3
    held = {name: values[name] for name in ("m", "alpha", "beta", "tau", "varsigma", "eps", *PAPER_CHANNELS._fields)}

    def covered(batch, **options):
        cloth = replace(true, effective_modulus=read, batch=batch)
        run = sample(
            Experiment(rated, cloth, ()), errors=NORMAL, direction=RISES, fix=held, seed=3, processes=1, **options
        )
        assert run.provenance.ending.converged
        drawn, turn = run.values(), run.inflection()
        low, high = np.quantile(drawn["b"], [0.05, 0.95])
        inside = (turn["e_fab_kpa_low"] < peaks) & (peaks < turn["e_fab_kpa_high"])
        return low < values["b"] < high, inside.to_numpy().all(), drawn

    b, turning, drawn = covered(batch, shared_modulus_cv=0.2)
    assert b
    assert turning
    first, second = (np.quantile(drawn[name], [0.05, 0.95]) for name in SCALES)
    assert first[0] < 1.0 < first[1]
    assert second[0] < 0.8 < second[1]
    low, high = np.quantile(drawn["modulus_scale_2"] / drawn["modulus_scale"], [0.05, 0.95])
    assert low < 0.8 < high < 1.0
    # negative controls
    assert not covered((), shared_modulus_cv=0.2)[0]
    assert covered(())[:2] == (False, False)


@pytest.mark.parametrize(
    ("typed", "problem"),
    [
        (["--modulus-cv", "-1"], "expected"),
        (["--unknown-modulus", "normal(0,1)"], "below 0"),
        (["--unknown-modulus", "thick"], "expected"),
    ],
)
def test_impossible_errors_are_refused(tmp_path, typed, problem):
    refused(call("sample", "--data", DATA / "ratings.csv", *typed, "--out", tmp_path / "run"), problem)
    assert not (tmp_path / "run").exists()


def test_check_and_sample_say_which_batches_share_an_error(tmp_path):
    fabrics = Path(DATA / "fabrics.csv").read_text(encoding="utf-8").splitlines()
    batch = ["batch", *("mill A" if k % 3 else "mill B" for k in range(len(fabrics) - 1))]
    file = tmp_path / "cloth.csv"
    file.write_text("\n".join(f"{row},{one}" for row, one in zip(fabrics, batch, strict=True)), encoding="utf-8")
    typed = ("check", "--data", DATA / "ratings.csv", "--fabrics", file)
    unused = [line for line in call(*typed).stdout.splitlines() if "batch" in line]
    assert unused == [
        "note: the column batch of the fabrics is not used without --shared-modulus-cv, the error that a batch shares"
    ]
    used = [line for line in call(*typed, "--shared-modulus-cv", "0.2").stdout.splitlines() if "batch" in line]
    counts = (batch.count("mill B"), batch.count("mill A"))
    assert used == [
        "note: moduli of a batch share a factor: modulus_scale of 'mill B' ({} fabrics), modulus_scale_2 of 'mill A' "
        "({} fabrics)".format(*counts)
    ]
    file.write_text(file.read_text(encoding="utf-8").replace("mill A", "", 1), encoding="utf-8")
    ended = call(*typed)
    assert ended.returncode == 2
    assert "row 3, column 'batch': expected a name" in ended.stderr
