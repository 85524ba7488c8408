"""Choice of touches from a run: the levels behind it, its limits and costs, and an experiment that is continued."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

from softness_bayes.base.errors import InputError
from softness_bayes.data import Fabrics
from softness_bayes.experiments import design as module
from softness_bayes.experiments import outlook
from softness_bayes.experiments.adaptive import MOST_IN_A_ROW, Adaptive
from softness_bayes.experiments.design import MOST_REPEATS, Costs, design
from softness_bayes.experiments.outlook import USUAL_CV, Candidates, outlook_of_run
from softness_bayes.likelihood.design import Design
from softness_bayes.touch.contact import Indentation
from support.command_line import call, refused

DRAWS = 400


@pytest.fixture(scope="module")
def result(report_run):
    return report_run("ratings")


@pytest.fixture(autouse=True)
def few_draws(monkeypatch):
    """Few draws, of a run that need not have converged."""
    monkeypatch.setattr(module, "DRAWS", DRAWS)
    monkeypatch.setattr(outlook, "DRAWS", DRAWS)
    monkeypatch.setattr(outlook.outlook_of_run, "__defaults__", (DRAWS,))
    monkeypatch.setattr(outlook, "require_run", lambda result: None)


def test_answers_weight_the_draws_as_the_joint_density_of_all_ratings_does(result, rng):
    """Levels given the ratings, by the closed form of the old and the new ratings together."""
    experiment = Adaptive.start(result, candidates=Candidates(modulus_cv=0.0))
    outlook = experiment.outlook
    observed, theta = outlook.posterior.observation, outlook.theta
    parameters = outlook.posterior.rating_parameters(theta)
    names = outlook.model.data.ratings.participants
    conditions = rng.choice(observed.design.n_conditions, 5)
    scene = outlook.model.scene
    fabrics, loads = outlook.model.data.fabrics.names, scene.loads
    level, drive = outlook.level(None)[0][:, 0], observed.drive(outlook.posterior.mean_rate(theta), parameters)
    ratings = np.exp(np.median(level[:, None] + drive[:, conditions], axis=0) + rng.normal(0, 0.3, 5))
    touches = [(fabrics[scene.fabric[c]], loads[scene.load[c]]) for c in conditions]
    known = [
        k
        for k, touch in enumerate(touches)
        if touch in zip(experiment.expected.table["fabric"], experiment.expected.table["load"], strict=True)
    ]
    assert known
    for k in known:
        experiment.tell(names[k % 2], *touches[k], ratings[k])
    old, d = observed.values, observed.design
    rater = np.array([k % 2 for k in known])
    joint = Design(
        np.append(d.condition, conditions[known]), np.append(d.participant, rater), d.fabric, d.n_participants
    )
    rate = outlook.posterior.mean_rate(theta)
    every = observed.model.observe(np.append(old, ratings[known]), joint)
    # the response is centred over the rated rows in both: a constant that moves the level
    expected = every.log_likelihood(rate, parameters) - observed.log_likelihood(rate, parameters)
    assert (experiment.log_weight - expected).std() < 0.01 * expected.std()
    # the control: a level that is the same at every draw
    stiff = Adaptive.start(result, candidates=Candidates(modulus_cv=0.0))
    for name in {names[k % 2] for k in known}:
        mean, variance = (part[:, 0] for part in stiff.outlook.level(name)[:2])
        stiff._laws[0, name] = np.full_like(mean, mean.mean()), variance
    for k in known:
        stiff.tell(names[k % 2], *touches[k], ratings[k])
    assert (stiff.log_weight - expected).std() > 10 * (experiment.log_weight - expected).std()


def test_what_is_chosen(result):
    plan = design(result, conditions=6)
    assert plan.table.shape[0] == 6
    assert plan.gains["chosen"].max() <= MOST_REPEATS
    assert (plan.table["step_nats"] > 0).all()
    assert plan.bracket.low <= plan.bracket.high
    assert all(0 < ratio < 1.1 for ratio in plan.bracket.sd_ratio.values())
    one = design(result, conditions=1)
    assert one.bracket.low - 4 * one.bracket.se < one.table["gain_nats"][0] < one.bracket.high + 4 * one.bracket.se


def test_errors_of_moduli_are_those_of_the_request(result):
    """Of every candidate; moduli at the draws are equal but for rounding, which is no error that the draws have."""
    outlook = outlook_of_run(result, DRAWS)
    own = outlook.model.data.fabrics
    for cv, expected in ((None, USUAL_CV), (0.3, 0.3), (0.0, 0.0)):
        every = Candidates(loads=("2mm",), modulus_cv=cv).resolved(outlook)
        errors = outlook.ratings(every, None).variance[1]
        assert_allclose(errors, np.log1p(expected**2), atol=1e-12)
    # a table's own errors stand, and a fabric of the same name with another modulus is not the rated one
    other = Fabrics(own.names[:2], effective_modulus=own.effective_modulus[:2] * [1.0, 2.0],
                    effective_modulus_cv=np.array([np.nan, 0.5]))  # fmt: skip
    found = outlook.ratings(Candidates(other, loads=("2mm",), modulus_cv=0.1), None)
    assert found.table["to_obtain"].tolist() == [False, True]
    assert_allclose(found.variance[1, 0], np.log1p(np.array([0.1, 0.5]) ** 2), rtol=1e-6)


def test_a_largest_load_leaves_loads_of_the_other_kind_alone(result):
    plan = design(result, (), Candidates(loads=("1mm", "2 mm", "0.5N"), largest_load="1mm"), conditions=2)
    kept = zip(plan.gains["indentation_mm"].fillna(0.0), plan.gains["force_n"].fillna(0.0), strict=True)
    assert {*kept} == {(1.0, 0.0), (0.0, 0.5)}


def test_errors_of_moduli_lower_the_gain(result):
    exact, wrong = (design(result, ("sigma_0",), Candidates(modulus_cv=cv), conditions=4) for cv in (0.0, 0.3))
    assert wrong.table["step_nats"].sum() < exact.table["step_nats"].sum()
    assert wrong.bracket.sd_ratio["sigma_0"] > exact.bracket.sd_ratio["sigma_0"]


def test_new_raters_tell_less_than_known_ones(result):
    n = len(result.group("log_likelihood_participant")["participant"])
    known, new = design(result, conditions=1), design(result, conditions=1, raters=n)
    best = int(known.gains["chosen"].argmax())
    assert new.gains["gain_nats"][best] < known.gains["gain_nats"][best]


def test_a_budget_pays_for_owned_fabrics_first(result):
    n = len(result.group("log_likelihood_participant")["participant"])
    plan = design(result, conditions=8, costs=Costs(budget=3.0 * n, fabric=1000.0))
    assert len(plan.table) == 3
    assert not plan.table["to_obtain"].any()
    assert plan.table["cost"].sum() == pytest.approx(3.0 * n)
    with pytest.raises(InputError, match="pays for no touch; the cheapest costs"):
        design(result, costs=Costs(budget=0.5))


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"about": ("sigma",)}, "'sigma' is no quantity of this run"),
        ({"about": ("turning@2",)}, "about: turning@: expected a load such as 2mm"),
        ({"candidates": Candidates(loads=("7.9mm",))}, "contact radius exceeds half"),
        ({"candidates": Candidates(loads=("2mm",), largest_load="1e-3mm")}, "every load is larger"),
        ({"candidates": Candidates(loads=("2",))}, "expected a load such as 2mm or 1N, got '2'"),
        ({"candidates": Candidates(moduli=(0.0,))}, "moduli: expected numbers above 0"),
        ({"conditions": 0}, "conditions is 0, expected a whole number from 1"),
        ({"raters": 0}, "raters is 0, expected a whole number from 1"),
    ],
)
def test_what_cannot_be_designed(result, asked, message):
    with pytest.raises(InputError, match=message):
        design(result, **asked)


def test_a_run_that_has_not_converged_is_refused(result, monkeypatch):
    monkeypatch.undo()
    if not result.provenance.ending.converged:
        with pytest.raises(InputError, match="has not converged"):
            design(result)


def test_before_any_rating(result):
    from softness_bayes.results.data_groups import experiment_of
    from softness_bayes.results.fitted import options_of

    plan = design(experiment_of(result), conditions=2, options=options_of(result), raters=10)
    assert plan.new
    assert plan.bracket.high > 0


def test_two_runs_of_one_table_are_told_apart_by_nothing_if_they_are_equal(result):
    plan = design([result, result], ("run",), conditions=2)
    assert abs(plan.bracket.high) < 0.05  # the same draws twice


def test_an_experiment_is_continued_with_the_same_suggestions(result, tmp_path):
    begun = Adaptive.start(result, ("sigma_0",))
    for trial in range(5):
        touch = begun.next("new")
        begun.tell("new", touch.fabric, touch.load, 20.0 + trial)
    shown = [(one.fabric, one.load) for one in begun.session.answers]
    assert all(len(set(shown[k : k + MOST_IN_A_ROW + 1])) > 1 for k in range(len(shown) - MOST_IN_A_ROW))
    begun.tell("other", shown[0][0], Indentation(1.3e-3), 12.0)  # a load that no candidate has
    begun.save(tmp_path / "kept.json")
    again = Adaptive.load(tmp_path / "kept.json", result)
    assert_allclose(again.weight, begun.weight, rtol=1e-10)
    assert again.session.answers == begun.session.answers
    for rater in ("new", "other"):
        assert again.next(rater) == begun.next(rater)
    assert 0 < begun.effective <= 1
    # answers that a new run has are not told again
    assert (begun.refresh(result).session.answers, begun.refresh(result).effective) == ((), pytest.approx(1.0))


def test_answers_on_a_slider_are_numbers_of_its_file(report_run):
    """Whole numbers from 0 to 100 are intervals of 1: a narrower one, of probability in proportion, weights alike."""
    experiment = Adaptive.start(report_run("slider"))
    touch = experiment.next("new")
    experiment.tell("new", touch.fabric, touch.load, 62.0)
    assert experiment.session.answers[0].rating == 62.0
    rows = experiment._rows(62.0)
    assert_allclose(1.0 / (1.0 + np.exp([-rows.low[0], -rows.high[0]])), [0.615, 0.625])
    with pytest.raises(InputError, match="above 0 and below 100, got 100"):
        experiment.tell("new", touch.fabric, touch.load, 100.0)


def test_what_an_experiment_refuses(result, tmp_path):
    experiment = Adaptive.start(result)
    with pytest.raises(InputError, match="is no candidate"):
        experiment.tell("one", "no such cloth", Indentation(1e-3), 3.0)
    fabric = experiment.expected.table["fabric"][0]
    with pytest.raises(InputError, match="'sigma' is no quantity of this run"):
        Adaptive.start(result, ("sigma",))
    with pytest.raises(InputError, match="expected a rating above 0"):
        experiment.tell("one", fabric, Indentation(1e-3), -1.0)
    (tmp_path / "other.json").write_text(json.dumps({"a": 1}))
    with pytest.raises(InputError, match="no adaptive experiment"):
        Adaptive.load(tmp_path / "other.json", result)


def test_candidates_of_a_table(result):
    own = Fabrics(("felt", "mesh"), effective_modulus=np.array([2e4, 3e5]))
    plan = design(result, (), Candidates(own), conditions=2)
    assert set(plan.gains["fabric"]) == {"felt", "mesh"}
    assert plan.gains["to_obtain"].all()


def test_the_command_writes_its_files(result, tmp_path):
    result.save(tmp_path / "run")
    out = tmp_path / "next"
    said = call("design", "--given", tmp_path / "run", "--about", "sigma_0", "--conditions", 3, "--out", out)
    assert "rate next, to learn sigma_0" in said.stdout
    record = json.loads((out / "design.json").read_text())
    assert record["about"] == ["sigma_0"]
    assert record["information"]["low"] <= record["information"]["high"]
    assert {path.name for path in out.iterdir()} >= {"design.csv", "gain.csv", "design.png", "design.pdf"}
    refused(call("design", "--given", tmp_path / "run", "--out", out), "already holds")
    other = "--out", tmp_path / "other"
    refused(call("design", "--given", tmp_path / "run", "--moduli", "3-4", *other), "'--moduli': expected LOW:HIGH:N")
    refused(call("design", *other), "give either --given")
    assert not (tmp_path / "other").exists()
