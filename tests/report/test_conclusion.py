"""The three lines that end a run, for results that are good, unfinished, failed, doubtful, or of the skin alone."""

from __future__ import annotations

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest

from softness_bayes.checking.agreement import HighestRated
from softness_bayes.cli.running import print_result
from softness_bayes.data import Experiment, Fabrics
from softness_bayes.likelihood.error_laws import NORMAL
from softness_bayes.likelihood.scales import FALLS
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.people.ruler import Following
from softness_bayes.report.conclusion import Facts, Learnt, Turn, conclude, facts_of
from softness_bayes.runs.run import sample
from softness_bayes.touch.contact import Force
from softness_bayes.touch.neuron.membrane import PAPER_CHANNELS
from softness_bayes.touch.readings import CLASSICAL, MENDED
from support.report_runs import converged

TOLD = Turn("1 mm", 0.98, 60.0, 85.0, 120.0, 0.8, 1.1, True)
UNTOLD = Turn("2 mm", 0.5, 300.0, 700.0, 4000.0, 3.0, 40.0, None)
GOOD = Facts(True, 900, turns=(TOLD,), fabrics=(1.0, 500.0))


UNIT = "data and prior disagree about b (12)"
ODD = "the scale of P3 was reversed"


def good(**changed):
    """Facts of a run that passes, with some of them replaced."""
    return GOOD._replace(**changed)


def without(*words):
    """Return the pattern of a sentence in which no such word is."""
    return f"^(?!.*({'|'.join(map(re.escape, words))}))"


def doubted(**changed):
    """Facts of a run that fails a check and has remedies."""
    return good(unreproduced=("noise",), remedies=("--drift (estimated gain: 40)", "--individual gamma"), **changed)


AGAINST = {"other_direction": "falls-with-firing"}
FLAT = TOLD._replace(probability=0.02)
PEOPLE = {"people": ("felt is the softest",)}
KNOWN = (Learnt("b", 70.0, 90.0, True, "kPa"), Learnt("m", 1.0, 4.0, False))
LOOK = {"quick": True, "settled": True}
CASES = [
    (good(), "^Yes: ", r"^at 1 mm the response turns over at E_fab = 85 kPa \(90 % interval 60 to 120 kPa, E_fab / "
     r"E_skin 0.8 to 1.1\)\.$",
     r"^read the page that 'softness-bayes report results' writes\.$"),
    (good(turns=(TOLD, UNTOLD)), "", r"at 2 mm the data do not show whether the response turns over \(probability: 50",
     "ratings at 2 mm of fabrics stiffer than 500 kPa would help to decide"),
    (good(turns=(UNTOLD,), fabrics=(1.0, 5000.0)), "", "", "more fabrics around 700 kPa"),
    (good(turns=(UNTOLD,), fabrics=(800.0, 5000.0)), "", "", "fabrics softer than 800 kPa"),
    (good(turns=(TOLD._replace(reproduced=None),)), "", "the ratings at this load alone cannot show it", ""),
    (good(turns=(FLAT,)), "", r"at 1 mm the response does not turn over \(probability of a turning point: 2 %", ""),
    (good(turns=(TOLD._replace(low=500.0, middle=600.0, high=700.0),)), "", "an extrapolation beyond the fabrics", ""),
    (good(), "", without("extrapolation", "if the model holds"), ""),
    # not converged, or against the data
    (good(converged=False, steps=40), "^Not yet: .*after 40 steps", without("85"), "'softness-bayes resume results'"),
    (good(**AGAINST), "^No: .*opposite direction", "nothing about skin or receptors", "--direction falls-with-firing"),
    (good(converged=False, **AGAINST), "^No: ", "nothing about skin or receptors", without("units")),
    (good(**LOOK), r"^Not yet: this is a first look after 900 steps\. The fast model was not compared with the exact",
     "", ""),
    (good(converged=False, **LOOK), "The chains have not converged", "", ""),
    (good(follows=Following(False, False), **LOOK), r"The chain loses some of what people agree on\.$", "", ""),
    # checks that fail
    (good(unreproduced=("LOO-PIT",), turns=(TOLD._replace(reproduced=False),)),
     "^In part: .*the turning point at 1 mm and LOO-PIT", "the ratings contradict the model's turning point",
     r"predictive_checks\.csv"),
    (good(turns=(FLAT._replace(reproduced=False),)), "",
     r"at 1 mm the ratings turn over, and the response does not \(probability of a turning point: 2 %", ""),
    (good(unreproduced=("fabrics' own deviations",)), "", "if the model holds, at 1 mm the response turns over", ""),
    (good(exact=False), "^With care: ", "if the model holds, at 1 mm the response turns over", "--exact-reweight"),
    (good(exact=False, turns=(FLAT,)), "", "if the model holds, at 1 mm the response does not", ""),
    (good(silent=True), "no receptor fires", "", ""),
    (good(silent=True, follows=Following(False, True)), "^No: ", "", "units of moduli and loads"),
    # what the chain loses of what people say
    (good(follows=Following(True, False), **PEOPLE), "^Yes: ", "", ""),
    (good(follows=Following(False, False), **PEOPLE), "^In part: ", "if the model holds", ""),
    (good(follows=Following(False, True), **PEOPLE), "^No: ", "^nothing about skin", "--prior omega"),
    (good(follows=Following(None, False), **PEOPLE), "^As far as these ratings tell: ", "", ""),
    (good(follows=Following(True, False), surprise=UNIT),
     rf"^With care: the chains have converged, but {re.escape(UNIT)}\.$", "", ""),
    # forces of a plate alone
    (Facts(True, 500, rated=False, parameters=KNOWN), "",
     r"^learnt \(90 % intervals\): skin modulus at rest \(b\) 70 to 90 kPa; not learnt, as wide as their priors: "
     r"stiffening of the skin \(m\)\.$", "would narrow m"),
    # what would gain most; a wrong unit is found before an approximation is improved
    (doubted(), "", "", r"^repeat the run with --drift \(estimated gain: 40\); or with --indiv"),
    (doubted(surprise=UNIT), "", "", "^check the units of moduli and loads; then repeat the run with --drift"),
    (doubted(surprise="data and prior disagree about varsigma (1.5)", noisy=True), "", "", "^repeat the run with --"),
    (good(surprise="data and prior disagree about varsigma (1.5)", noisy=True), "", "", "^look for guesses and outlie"),
    (good(surprise=UNIT, exact=False), "", "", "^check the units of moduli and loads"),
    (doubted(odd=ODD), "", "", "^check whether the scale of P3 was reversed, and leave these rows out"),
    (good(odd=ODD, copied=True), "", "", "^check whether the scale of P3 was reversed, and leave these rows out"),
    (good(odd=ODD, remedies=("--drift",)), "", "", without("reversed", "--drift")),  # the control
    (good(direction="direction: ratings rise with firing with probability 60 %"), "",
     "^direction: ratings rise with firing with probability 60 %; at 1 mm", ""),
]  # fmt: skip


@pytest.mark.parametrize(("facts", "trust", "learnt", "next_step"), CASES)
def test_each_fact_has_its_words(facts, trust, learnt, next_step):
    found = conclude(facts, "results")
    for pattern, said in zip((trust, learnt, next_step), (found.trust, found.learnt, found.next_step), strict=True):
        assert re.search(pattern, said), said


def test_every_combination_of_facts_gives_three_sentences_and_trust_only_where_all_is_well():
    names = ("converged", "silent", "differ", "exact")
    for values in itertools.product((True, False), repeat=len(names)):
        flag = dict(zip(names, values, strict=True))
        for checks in ((), ("LOO-PIT",)):
            found = conclude(GOOD._replace(**flag, unreproduced=checks), "results")
            assert all(said.endswith(".") for said in (found.trust, found.learnt, found.next_step))
            assert not any("\n" in line for line in found.lines)
            well = flag["converged"] and flag["exact"] and not (flag["silent"] or checks)
            assert found.trust.startswith("Yes") == well


FORCES, MODULI, SOFT = (0.5, 1.5), np.geomspace(8e3, 6e5, 10), np.geomspace(1e2, 4e3, 10)


def drifting(rng, made):
    """Every rater's numbers rise by a factor of 3 over the trials."""
    order = np.concatenate([rng.permutation(20) for _ in range(12)]) / 20
    return {"rating": made.rating * np.exp(1.2 * order), "order": order}


def outlying(rng, made):
    far = rng.random(len(made)) < 0.05
    return {"rating": made.rating * np.where(far, rng.choice([0.1, 10.0], len(made)), 1.0)}


def reversed_quarter(_, made):
    log = np.log(made.rating)
    return {"rating": np.exp(np.where(made.participant < 3, 2.0 * log.mean() - log, log))}


def guessed(rng, made):
    guess = np.exp(rng.uniform(*np.log([made.rating.min(), made.rating.max()]), len(made)))
    return {"rating": np.where(rng.random(len(made)) < 0.25, guess, made.rating)}


def copied(_, made):
    own = made.rating.reshape(12, -1)
    return {"rating": np.concatenate([own[:9], own[:3]]).ravel()}


def falling(rng, made):
    """Ratings fall with stiffness, over fabrics so soft that no receptor fires."""
    level, error = 0.4 * rng.standard_normal(12), 0.3 * rng.standard_normal(len(made))
    return {"rating": 20.0 * (SOFT[made.fabric] / 1e3) ** -0.3 * np.exp(level[made.participant] + error)}


UNITS = "^check the units of moduli and loads"
FAULTS = {
    "none": ({}, without("another --reading", "units", "check whether", "lapses", "--drift")),
    "drift": ({"rate": drifting}, "^repeat the run with --drift"),
    "wrong direction": ({"direction": FALLS}, "^repeat the run with --direction rises-with-firing"),
    "moduli ten times too high": ({"moduli": 10.0 * MODULI}, UNITS),
    "outliers": ({"rate": outlying}, "--errors lapses or student"),
    "a reversed quarter": ({"rate": reversed_quarter}, "^check whether the scale of P01, P02 and P03 was reversed"),
    "a quarter guessed": ({"rate": guessed}, "--errors lapses or student"),
    "silent cloth": (
        {"rate": falling, "moduli": SOFT, "fix": {"m": 2.0, "alpha": 20.3, "beta": 0.6}},
        rf"{UNITS} \('softness-bayes check'\), then try --priors in-vivo",
    ),
    "loads in kgf": ({"loads": tuple(Force(force / 9.81) for force in FORCES)}, UNITS),
    "copied raters": ({"rate": copied}, "^check whether the answers of P10, P11 and P12 are copies"),
    "another reading": ({"readings": CLASSICAL}, "^repeat the run with another --reading"),
}


@pytest.mark.slow
@pytest.mark.parametrize(("fault", "words"), FAULTS.values(), ids=FAULTS)
def test_the_next_step_names_the_fault_of_a_simulated_table(fault, words):
    """Whole runs of a laboratory with one fault each; and without, as the control."""
    rng, fabrics = np.random.default_rng(1), Fabrics(tuple("abcdefghij"), effective_modulus=MODULI)
    values, loads = usual_values(MENDED, given={"varsigma": 0.3, "tau": 0.4}), tuple(map(Force, FORCES))
    made = simulate_ratings(rng, fabrics, loads, values, fault.get("readings", MENDED), participants=12).ratings
    rated = fault["rate"](rng, made) if "rate" in fault else {}
    data = Experiment(
        replace(made, loads=fault.get("loads", loads), **rated),
        replace(fabrics, effective_modulus=fault.get("moduli", MODULI)),
        (),
    )
    fix = {**PAPER_CHANNELS._asdict(), "eps": 0.1, **fault.get("fix", {})}
    options = {"fix": fix, "max_steps": 6000, "seed": 3, "processes": 1}
    facts = facts_of(sample(data, errors=NORMAL, direction=fault.get("direction"), **options))
    assert facts.converged
    assert re.search(words, conclude(facts).next_step)


@pytest.fixture(scope="module")
def runs(report_run):
    return {name: report_run(name) for name in ("ratings", "skin")}


@pytest.mark.parametrize("name", ["ratings", "skin"])
def test_what_sample_prints_ends_with_the_three_lines_of_the_results_values(runs, name, capsys, tmp_path):
    result = runs[name]
    for one, ended in ((result, False), (converged(result), True)):
        facts = facts_of(one)
        assert facts.converged is ended
        assert facts.rated is (name == "ratings")
        assert [turn.load for turn in facts.turns] == ([*map(str, one.loads)] if name == "ratings" else [])
        print_result(one, tmp_path, "took 1 s", verbose=False)
        closing = capsys.readouterr().out.splitlines()
        assert len(closing) <= 3 + 15
        print_result(one, tmp_path, "took 1 s")
        assert bool(facts.people) is (name == "ratings")
        lines = conclude(facts, str(tmp_path)).lines
        assert tuple(closing[-len(lines) :]) == lines
        everything = capsys.readouterr().out.splitlines()
        assert tuple(everything[-len(lines) :]) == lines
        assert len(everything) > 2 * len(closing)  # negative control: verbose says more


def test_what_the_chain_predicts_stands_beside_what_people_say_under_each_load(runs, monkeypatch):
    first, second = map(str, runs["ratings"].loads)
    found = (HighestRated(first, "gauze", 0.93, 0.02, 4), HighestRated(second, "lawn", 0.53, 0.02, 4))
    monkeypatch.setattr("softness_bayes.report.conclusion.highest_rated", lambda _: found)
    result = converged(runs["ratings"])
    clear, unclear, *others = facts_of(result).people
    assert f" at {first} " in clear
    assert clear.endswith("; chain: gauze (93 ± 2 %)")
    # more probable than not by less than its error
    assert unclear.endswith("; chain: none clear, lawn (53 ± 2 %)")
    assert not any("; chain: " in line for line in others)
    # negative controls: a run that has not converged, or whose direction contradicts the data, says nothing of it
    against = result.tree.copy()
    against.attrs = {**result.tree.attrs, "direction": "falls-with-firing", "direction_asked": 1}
    for silent in (runs["ratings"], replace(result, tree=against)):
        people = facts_of(silent).people
        assert not any("; chain: " in line for line in people)
        assert "; the lowest mean is that of " in people[0]


@pytest.mark.parametrize(
    ("sign", "title", "asked"),
    [(1, "rating", True), (1, "softness", True), (0, "rating", False), (-1, "softness", False), (1, "hardness", False)],
)
def test_where_stiffer_cloth_is_called_softer_the_scale_is_asked_about(runs, sign, title, asked):
    result = runs["ratings"]
    tree, table = result.tree.copy(), result.tables["fabric_ratings"].copy()
    tree.attrs = {**tree.attrs, "rating_column": title}
    # ranks 1, 3, 4, 2 do not rise clearly
    table["rated"] = sign * table["e_fab_kpa"] if sign else table["e_fab_kpa"].map({20: 1, 80: 3, 200: 4, 400: 2})
    said = facts_of(replace(result, tree=tree, tables={**result.tables, "fabric_ratings": table})).cautions
    assert ("stiffer fabrics get the higher ratings: does higher mean softer on this scale?" in said) == asked


def test_no_highest_fabric_is_named_where_people_do_not_tell_them_apart(runs):
    result = runs["ratings"]
    assert any("highest rated" in line or "softest" in line for line in facts_of(result).people)  # the control
    ruler = result.tables["ruler"].copy()
    ruler.loc["share"] = np.nan
    people = facts_of(replace(result, tables={**result.tables, "ruler": ruler})).people
    assert "do not tell the fabrics apart" in people[-1]
    assert not any("highest rated" in line or "softest" in line for line in people)


def test_facts_follow_the_values_of_the_result(runs):
    result = converged(runs["ratings"])
    table = result.tables["predictive_checks"].copy()
    table.loc[("posterior", "LOO-PIT"), "p_adjusted"] = 0.0
    doubtful = facts_of(replace(result, tables={**result.tables, "predictive_checks": table}))
    assert "LOO-PIT" in doubtful.unreproduced
    table.loc[("posterior", "LOO-PIT"), "p_adjusted"] = 1.0
    assert "LOO-PIT" not in facts_of(replace(result, tables={**result.tables, "predictive_checks": table})).unreproduced
    tree = result.tree.copy()
    tree.attrs = {**tree.attrs, "direction": "falls-with-firing", "direction_asked": 1}
    assert facts_of(replace(result, tree=tree)).other_direction == "rises-with-firing"
