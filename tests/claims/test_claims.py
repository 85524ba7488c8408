"""The paper's claims: each criterion on numbers made by hand, the numbers by other ways, and what the readings say."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from oracles.reference import reference_response
from softness_bayes.base.errors import InputError
from softness_bayes.base.files.spreadsheet import table_of
from softness_bayes.checking.inflection import LEAST_DROP
from softness_bayes.claims import CLAIMS, CLOTH, TOUCHES, ClaimVerdict, evaluate_claims
from softness_bayes.claims.numbers import CENTRES, DEPTHS, ERROR, GRID, Bench, Numbers, mean_standardised, pearson
from softness_bayes.claims.report import COLUMNS, claims_table, loads_table, plain
from softness_bayes.cli import main
from softness_bayes.data import Fabrics, Ratings, read_experiment
from softness_bayes.model.scenes import touch_parameters, usual_values
from softness_bayes.parameters.choice import parameter_space
from softness_bayes.touch.contact import Finger, Indentation
from softness_bayes.touch.neuron.fixed_channels import FixedChannels
from softness_bayes.touch.neuron.membrane import CONNOR_STEVENS, PRINTED
from softness_bayes.touch.neuron.rate import firing_rate
from softness_bayes.touch.readings import AS_PRINTED, CLASSICAL, MENDED
from softness_bayes.touch.scene import Scene
from support.paths import ROOT

BY_NAME = {claim.name: claim for claim in CLAIMS}
HELD = "indentation"


@pytest.fixture(scope="module")
def firing():
    return FixedChannels()


@pytest.fixture(scope="module")
def bench(firing):
    return Bench(MENDED, TOUCHES[HELD], CLOTH, firing)


@pytest.fixture(scope="module")
def medians(bench):
    return bench.measure(touch_parameters(usual_values(MENDED)))


@pytest.fixture(scope="module")
def trials(bench, firing):
    """Mended readings and the default priors under indentation control: at the median, and over a few draws."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("softness_bayes.claims.firing_of", lambda *_: firing)
        patch.setattr("softness_bayes.claims.Bench", lambda *_: bench)
        return evaluate_claims({"mended": MENDED}, ["default"], {HELD: TOUCHES[HELD]}, draws=12, seed=3)


# criteria


def numbers(**given):
    """Numbers of one draw under three loads that satisfy every claim, with some of them replaced."""
    usual = {
        "largest": [100, 100, 100],
        "interior": [False, True, True],
        "modulus": [1e9, 5e5, 2e5],
        "ratio": [5e3, 3.0, 1.5],
        "force": [0.8, 1.5, 2.5],
        "radius": [0.3, 0.5, 0.6],
        "drop": [0.0, 0.1, 0.2],
        "levelling": [0.001, 0.002, 0.003],
        "depth_spread": [0.02, 0.05, 0.1],
        "growth": [0.5, 0.5, 0.5],
        "setback": [0.0, 0.0, 1e-4],
        "best_centre": [0.03, 0.03, 0.03],
        "correlation": [-0.6, -0.5, -0.1],
        "slope": [0.8, 0.9, 0.8],
        "slope_needed": [0.58, 0.58, 0.58],
    }
    arrays = {name: np.array([value]) for name, value in {**usual, **given}.items()}
    assert arrays.keys() == set(Numbers._fields)
    return Numbers(**arrays)


SILENT = {name: [np.nan] * 3 for name in Numbers._fields} | {"largest": [0.0] * 3, "interior": [False] * 3}


@pytest.mark.parametrize("name", BY_NAME)
def test_every_claim_can_hold_and_be_silent(name):
    assert BY_NAME[name].verdicts(numbers(), rated=True) == [ClaimVerdict.HOLDS]
    assert BY_NAME[name].verdicts(numbers(**SILENT), rated=True) == [ClaimVerdict.SILENT]
    assert BY_NAME[name].tell(numbers())


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("turn", {"drop": [0.0, 0.049, 0.04]}),
        ("turn", {"interior": [False, False, False]}),
        ("turn", {"levelling": [0.0, 0.01, 0.2]}),
        ("threshold", {"drop": [0.0, 0.049, 0.2]}),
        ("threshold", {"force": [0.8, 0.9, 2.5]}),
        ("threshold", {"force": [0.1, 0.2, 0.3], "drop": [0.0, 0.0, 0.0]}),
        ("threshold", {"drop": [0.0, 0.0, 0.0]}),
        ("place", {"modulus": [1e9, 5e5, 4.6e5]}),
        ("place", {"ratio": [5e3, 3.0, 2.8]}),
        ("place", {"interior": [False, False, True]}),
        ("place", {"drop": [0.0, 0.049, 0.2]}),
        ("centre", {"setback": [0.0, 0.01, 0.0]}),
        ("centre", {"growth": [0.5, -0.1, 0.5]}),
        ("depth", {"depth_spread": [0.01, 0.101, 0.02]}),
        ("linear", {"slope": [0.57, 0.9, 0.9]}),
        ("linear", {"slope": [-0.9, -0.9, -0.9]}),
        ("correlation", {"correlation": [-0.6, -0.5, 0.01]}),
    ],
)
def test_a_claim_fails_by_its_criterion_alone(name, given):
    assert BY_NAME[name].verdicts(numbers(**given), rated=True) == [ClaimVerdict.FAILS]


def test_a_silent_load_does_not_decide():
    gap = {
        field: [np.nan, *getattr(numbers(), field)[0, 1:]]
        for field in Numbers._fields
        if field not in ("largest", "interior")
    }
    some = numbers(**gap, largest=[0.0, 100.0, 100.0])
    assert {claim.name: claim.verdicts(some, rated=True) for claim in CLAIMS} == {
        name: [ClaimVerdict.HOLDS] for name in BY_NAME
    }
    assert "–" in BY_NAME["turn"].tell(some)


def test_without_ratings_a_claim_about_them_is_not_testable():
    assert BY_NAME["linear"].verdicts(numbers()) == [ClaimVerdict.UNTESTED]
    assert [claim.name for claim in CLAIMS if claim.of_ratings] == ["linear"]


def test_draws_are_judged_one_by_one(rng):
    drops = rng.uniform(0, 0.1, (50, 3))
    many = Numbers(*(np.repeat(values, 50, axis=0) for values in numbers()))._replace(drop=drops)
    found = BY_NAME["turn"].verdicts(many)
    assert found == [BY_NAME["turn"].verdicts(numbers(drop=drop))[0] for drop in drops]
    assert {*found} == {ClaimVerdict.HOLDS, ClaimVerdict.FAILS}


# numbers


def test_numbers_at_the_median_by_adaptive_integration(medians, firing):
    """Largest response, drop, depth and correlation again, without a table, on a grid of its own."""
    parameters = touch_parameters(usual_values(MENDED))
    load = TOUCHES[HELD][2]

    def exact(moduli, **finger):
        scene = Scene(moduli, 0.3, [load], firing, finger=Finger(**finger))
        return reference_response(scene, parameters, firing.curve, rtol=1e-6)

    peak = medians.modulus[0, 2]
    beside = exact([0.93 * peak, peak, 1.07 * peak, GRID[-1], 0.1 * GRID[-1]])
    rate = beside.total_rate
    assert rate[1] > max(rate[0], rate[2])
    assert medians.largest[0, 2] == pytest.approx(rate[1], rel=2e-4)
    assert medians.drop[0, 2] == pytest.approx(1 - rate[3] / rate[1], abs=2e-4)
    assert medians.levelling[0, 2] == pytest.approx(abs(rate[3] - rate[4]) / rate[1], abs=1e-4)
    assert medians.force[0, 2] == pytest.approx(beside.contact.force[1], rel=1e-3)
    assert medians.ratio[0, 2] == pytest.approx(peak / beside.contact.skin_modulus[1], rel=1e-3)
    assert medians.radius[0, 2] == pytest.approx(0.5)
    few = np.geomspace(3e4, 1e9, 25)
    depths = np.array([exact(few, receptor_depth=depth).total_rate for depth in DEPTHS])
    spread = np.ptp(depths, axis=0).max() / rate[1]
    assert medians.depth_spread[0, 2] == pytest.approx(spread, abs=3e-3)
    cloth = exact(CLOTH.effective_modulus).total_rate
    assert medians.correlation[0, 2] == pytest.approx(np.corrcoef(cloth, CLOTH.effective_modulus)[0, 1], abs=1e-4)


def test_moving_the_centre_by_adaptive_integration(medians, firing):
    parameters = touch_parameters(usual_values(MENDED))
    rates = []
    for x in (CENTRES[0], medians.best_centre[0, 2], CENTRES[-1]):
        scene = Scene(
            CLOTH.effective_modulus, 0.3, [TOUCHES[HELD][2]], firing, finger=Finger(contact_centre=(x, 10e-3))
        )
        rates.append(reference_response(scene, parameters, firing.curve, rtol=1e-6).total_rate.mean())
    assert medians.growth[0, 2] == pytest.approx(rates[2] / rates[0] - 1, abs=1e-3)
    assert rates[1] > max(rates[0], rates[2])
    assert medians.setback[0, 2] == pytest.approx(1 - rates[2] / rates[1], abs=1e-3)


def test_a_batch_is_its_single_draws(bench, rng):
    values = touch_parameters(usual_values(MENDED))
    many = values._replace(b=1e5 * np.exp(0.5 * rng.normal(size=3)), alpha=np.array([20.3, 17.0, 21.0]))
    together = bench.measure(many)
    assert (together.largest[1] == 0).all()
    for k in range(3):
        alone = bench.measure(values._replace(b=many.b[k], alpha=many.alpha[k]))
        for name, one, two in zip(Numbers._fields, alone, together, strict=True):
            np.testing.assert_allclose(one[0], two[k], rtol=1e-9, atol=1e-12, err_msg=name)


@pytest.mark.parametrize(
    ("readings", "load"), [(MENDED, TOUCHES[HELD][-1]), (CLASSICAL, TOUCHES["force"][-1])], ids=["mended", "hertz"]
)
def test_the_stated_error_is_kept(readings, load, firing):
    scene = Scene(GRID[::8], 0.3, (load,), firing, readings=readings)
    values = touch_parameters(usual_values(readings))
    assert scene.error(values._replace(b=np.array([5e4, 1e5, 3e5]))).max() < ERROR


def test_pearson(rng):
    x, y = rng.normal(size=9), rng.normal(size=(4, 9))
    np.testing.assert_allclose(pearson(x, y), [np.corrcoef(x, row)[0, 1] for row in y], rtol=1e-12)
    assert np.isnan(pearson(x, np.ones((1, 9)))).all()


def test_ratings_are_standardised_by_participant():
    loads, fabrics = (Indentation(1e-3), Indentation(2e-3)), ("a", "b", "c")
    table = np.array([[[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]], [[10.0, 20.0], [30.0, 40.0], [50.0, np.nan]]])
    ratings = Ratings.crossed(["P1", "P2"], fabrics, loads, table)
    first = (table[0] - 3.5) / table[0].std()
    second = (table[1] - 30) / np.nanstd(table[1])
    found = mean_standardised(ratings, loads[::-1], fabrics)
    np.testing.assert_allclose(found, np.nanmean([first, second], axis=0).T[::-1], rtol=1e-12)


def test_ratings_must_be_of_the_fabric_set(firing):
    ratings = Ratings.crossed(["P1"], ("a", "b"), TOUCHES[HELD][:1], np.array([[[1.0], [2.0]]]))
    with pytest.raises(InputError, match="lacks: b"):
        Bench(MENDED, TOUCHES[HELD][:1], Fabrics(("a",), effective_modulus=1e5), firing, ratings)
    two = Fabrics(("a", "b"), effective_modulus=np.array([1e5, 2e5]))
    assert not Bench(MENDED, TOUCHES[HELD][:1], two, firing, ratings).rated  # a slope through two points is none


@pytest.mark.parametrize("nothing", [{"readings": {}}, {"prior_sets": ()}, {"touches": {}}, {"draws": -1}], ids=str)
def test_something_must_be_judged(nothing):
    with pytest.raises(InputError, match=r"at least one|number of draws is -1, expected a whole number from 0"):
        evaluate_claims(**nothing)


# what the readings say


def test_default_readings_at_the_median(medians):
    """The numbers of a prototype written apart from this project, as far as its digits go."""
    np.testing.assert_allclose(medians.drop[0], [0.0, 0.007, 0.09, 0.23], atol=0.005)
    assert medians.interior[0].tolist() == [False, True, True, True]
    np.testing.assert_allclose(medians.modulus[0, 1:], [2349e3, 517e3, 264e3], rtol=0.1)
    np.testing.assert_allclose(medians.depth_spread[0, [0, 2, 3]], [0.06, 0.13, 0.18], atol=0.006)
    assert (medians.growth < -0.5).all()
    assert ((medians.best_centre > 1e-3) & (medians.best_centre < 5e-3)).all()


def test_no_turn_is_claimed_where_theory_has_none(firing):
    """Under indentation control Hertz's response rises with E_fab, whatever the skin (model.md 4)."""
    bench = Bench(CLASSICAL, TOUCHES[HELD][-1:], CLOTH, firing)
    values = touch_parameters(usual_values(CLASSICAL))
    found = bench.measure(values._replace(b=np.geomspace(5e3, 1e6, 9), m=np.linspace(0.5, 4, 9)))
    assert (found.largest > 0).any()
    assert not found.interior.any()
    assert (found.drop[found.largest > 0] <= 3 * ERROR).all()


def silent_everywhere(trials):
    """Assert that the model says nothing on any claim, and reports that as its answer."""
    assert [trial.control for trial in trials] == ["indentation", "force"] * 2
    for trial in trials:
        assert (trial.median.largest == 0).all()
        assert (trial.draws.largest == 0).all()
        for finding in trial.findings:
            expected = ClaimVerdict.UNTESTED if finding.claim.of_ratings else ClaimVerdict.SILENT
            assert finding.verdict is expected
            assert finding.shares[expected] == 1
            assert finding.numbers == ""


def test_printed_readings_never_fire(monkeypatch, smooth_firing):
    """The literal sum of the two membranes is silent at 20.3 µA/cm², and at every largest current of its prior."""
    alpha = parameter_space().draw_prior(np.random.default_rng(0), 300)[:, 2]
    assert np.median(alpha) == pytest.approx(20.3, rel=0.02)
    assert alpha.max() < 36
    assert (firing_rate(np.append(np.linspace(0, 36, 37), [20.3, *alpha[:50]]), membrane=PRINTED) == 0).all()
    assert (firing_rate([20.3, 60.0], membrane=CONNOR_STEVENS) > 0).all()
    monkeypatch.setattr("softness_bayes.claims.firing_of", lambda *_: smooth_firing(rheobase=np.inf))
    silent_everywhere(evaluate_claims({"printed": AS_PRINTED}, draws=300))


@pytest.mark.slow
def test_printed_readings_never_fire_with_the_membrane_itself():
    silent_everywhere(evaluate_claims({"printed": AS_PRINTED}, draws=2000))


def test_the_printed_chain_fires_with_another_membrane(firing):
    """It is the membrane that is silent, not what comes before it."""
    readings = AS_PRINTED.override({"membrane": "connor-stevens"})
    scene = Scene([1e5, 1e6], 0.3, TOUCHES[HELD][1:2], firing, readings=readings)
    assert (scene.total_rate(touch_parameters(usual_values(readings))) > 0).all()


# tables


def test_shares_are_of_all_draws(trials):
    (trial,) = trials
    for finding in trial.findings:
        assert sum(finding.shares.values()) == pytest.approx(1)
    turn = trial.findings[0]
    clear = (trial.draws.interior & (trial.draws.drop >= LEAST_DROP) & (trial.draws.levelling < 0.01)).any(axis=1)
    assert turn.shares[ClaimVerdict.HOLDS] == pytest.approx(clear.mean())
    assert turn.shares[ClaimVerdict.SILENT] == pytest.approx((trial.draws.largest == 0).all(axis=1).mean())


def test_tables(trials):
    (trial,) = trials
    found = claims_table(trials)
    assert found["claim"].tolist() == [*BY_NAME]
    assert found["verdict"].tolist()[:3] == ["holds", "fails", "holds"]
    assert set(found["verdict"]) <= {kind.value for kind in ClaimVerdict}
    assert (found[["p_holds", "p_fails", "p_silent"]].sum(axis=1)[found["verdict"] != "not testable"] == 1).all()
    loads = loads_table(trials)
    assert loads["indentation_mm"].tolist() == pytest.approx([1, 1.5, 2, 3])
    assert loads["force_n"].isna().all()
    np.testing.assert_allclose(loads["e_fab_kpa"], trial.median.modulus[0] * 1e-3)
    assert {column for column, _ in COLUMNS.values()} <= {*loads.columns}
    assert {*COLUMNS, "interior"} == {*Numbers._fields}
    text = plain(trials)
    for claim in CLAIMS:
        assert claim.statement in text
    assert "9.2, 23.3† %" in text


KEPT = ROOT / "notebooks" / "results" / "claims"


def test_the_kept_verdicts_at_the_medians(trials):
    """Readings `mended`, indentation control, default priors: without the shares, which need more draws."""
    kept, found = table_of(KEPT / "claims.csv"), claims_table(trials)
    kept = kept[(kept["readings"] == "mended") & (kept["priors"] == "default") & (kept["control"] == "indentation")]
    for column in ("claim", "verdict", "numbers", "statement", "criterion"):
        assert kept[column].fillna("").tolist() == found[column].tolist()


@pytest.mark.slow
def test_the_kept_claims_are_what_the_command_writes(tmp_path):
    call("claims", "--out", tmp_path)
    assert (KEPT / "claims.md").read_text(encoding="utf-8") == (tmp_path / "claims.md").read_text(encoding="utf-8")
    for name in ("claims.csv", "claims_loads.csv"):
        pd.testing.assert_frame_equal(pd.read_csv(KEPT / name), pd.read_csv(tmp_path / name), rtol=1e-6)


# the command


def call(*arguments):
    with pytest.raises(SystemExit) as end:
        main([str(argument) for argument in arguments], prog_name="softness-bayes")
    return end.value.code or 0


@pytest.fixture
def quick(monkeypatch, firing):
    """One rate curve for every call: making it is half of a short one."""
    monkeypatch.setattr("softness_bayes.claims.firing_of", lambda *_: firing)


SHORT = ("--readings", "mended", "--priors", "default", "--draws", "3")


def test_command_with_ratings(tmp_path, quick, capsys):
    """Simulated ratings of a rising response are found linear in it; loads and fabrics are those of the data."""
    data = ROOT / "data" / "ratings.csv"
    assert call("claims", *SHORT, "--data", data, "--reading", "pressure=hertz", "--out", tmp_path) == 0
    found = pd.read_csv(tmp_path / "claims.csv").set_index("claim")
    assert (found["readings"] == "mended, pressure=hertz").all()
    assert (found["control"] == "indentation").all()
    assert found.loc["linear", "verdict"] in ("holds", "fails")
    assert found.loc["turn", "verdict"] == "fails"
    loads = pd.read_csv(tmp_path / "claims_loads.csv")
    experiment = read_experiment(data)
    assert loads["indentation_mm"].tolist() == pytest.approx([load.depth * 1e3 for load in experiment.ratings.loads])
    assert loads["rating_slope"].between(-1, 1).all()
    # twelve fabrics: the two-sided 5 % point of a correlation
    np.testing.assert_allclose(loads["rating_slope_needed"], 0.576, atol=1e-3)
    printed = capsys.readouterr().out
    assert "holds if" in printed
    assert "3 draws of the prior" in printed


def test_command_takes_loads_and_fabrics(tmp_path, quick):
    arguments = ["--fabrics", ROOT / "data" / "fabrics.csv", "--force-n", "1", "--draws", "0", "--fix", "m=0"]
    assert call("claims", *SHORT[:4], *arguments, "--out", tmp_path) == 0
    found, loads = (pd.read_csv(tmp_path / name) for name in ("claims.csv", "claims_loads.csv"))
    assert found["p_holds"].isna().all()
    assert loads["force_n"].tolist() == [1.0]
    assert loads["indentation_mm"].isna().all()
    markdown_file = (tmp_path / "claims.md").read_text(encoding="utf-8")
    assert "| turn | force |" in markdown_file
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert call("claims", *SHORT[:4], *arguments, "--out", tmp_path) == 2
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--readings", "mine"], "no set 'mine'"),
        (["--prior", "c_K=lognormal(1.16,0.03)"], "channel multipliers are fixed here"),
        (["--fabrics", "nowhere.csv"], "nowhere.csv"),
        (["--column", "fabric=cloth"], "--column"),
        (["--data", ROOT / "data" / "ratings.csv", "--force-n", "1", "--force-n", "2"], "its own loads"),
        (["--draws", "-1"], "--draws"),
    ],
)
def test_command_refuses_and_writes_nothing(tmp_path, capsys, arguments, message):
    assert call("claims", *arguments, "--out", tmp_path / "new") == 2
    written = capsys.readouterr()
    assert message in written.err
    assert written.out == ""
    assert list(tmp_path.iterdir()) == []
