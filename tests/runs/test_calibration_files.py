"""Directories of calibrations: they are continued, taken over, judged and reported on; those of others are refused."""

import json
import os
import shutil
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from softness_bayes.base.errors import InputError, LockedError
from softness_bayes.base.files.lock import Lock
from softness_bayes.checking.calibration import Replicate
from softness_bayes.experiments import understanding
from softness_bayes.likelihood.error_laws import STUDENT
from softness_bayes.likelihood.scales import SLIDER
from softness_bayes.model.options import ModelOptions
from softness_bayes.results.run_options import Request, RunOptions
from softness_bayes.runs.batch import ASKED, LOCK, read_asked, write_asked
from softness_bayes.runs.calibrate import (
    RANKED,
    CalibrationScene,
    calibrate,
    finished,
    posterior_problem,
    prior_problem,
)
from softness_bayes.runs.rank_table import (
    MANIFEST,
    RANKS,
    Calibrated,
    rank_table,
    read_replicates,
    write_replicates,
)
from softness_bayes.runs.replicate import (
    LOG_LIKELIHOOD,
    PARTICIPANT,
    PARTICIPANTS,
    replicate,
    true_values,
)
from softness_bayes.sampler.diagnostics import Goal
from softness_bayes.sampler.sampling import Settings
from support.command_line import call, refused
from support.fake_scene import fake_posterior
from support.report_runs import converged, quickly

CHAIN = {"b": 100.0, "m": 2.0, "alpha": 20.3, "beta": 0.6, "sigma_0": 9.0, "tau": 0.5, "varsigma": 0.3}
BRIEF = Settings(ensembles=2, pilot=(10,), optima=1, round_steps=10, max_steps=30, processes=1)
LONGER = replace(BRIEF, max_steps=40)


@dataclass(frozen=True)
class FakeCalibration(CalibrationScene):
    prior: str = ""

    def model(self, options):
        priors = {"gamma": self.prior} if self.prior else {}
        return SimpleNamespace(options=options, posterior=fake_posterior(fix=CHAIN, priors=priors))


def run(directory, count, settings=BRIEF, scene=FakeCalibration(), earlier=None, executor=None, **options):
    """Return the saved calibration, and the number of replicates after each fit."""
    fitted, request = [], Request(ModelOptions(), RunOptions()).with_options(**{"processes": 1, **options})
    show = lambda n, one: fitted.append(n)  # noqa: E731
    done = calibrate(scene, *request, count, directory, show, settings, executor, earlier)
    done.save(directory)
    return done, fitted


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """Directory of three replicates made in one go."""
    path = tmp_path_factory.mktemp("whole") / "out"
    run(path, 3)
    return path


@pytest.fixture(scope="module")
def whole(home):
    return run(home, 3)[0]


@pytest.fixture
def stored(home, tmp_path):
    """The first two of them, as a stored result has them: settings and ranks alone."""
    kept(home, tmp_path / "stored", 0, 1)
    (tmp_path / "stored" / ".softness-bayes.json").unlink()
    return tmp_path / "stored"


def kept(home, directory, *indices):
    """Make a calibration of which some replicates are left, as if it had been interrupted."""
    directory.mkdir()
    shutil.copy(home / MANIFEST, directory)
    write_replicates(directory, {k: one for k, one in read_replicates(home).items() if k in indices})


def test_an_interrupted_calibration_continues(home, whole, tmp_path):
    """To the same ranks, whatever runs them."""
    with ThreadPoolExecutor(2) as executor:
        first, fitted = run(tmp_path, 2, executor=executor)
    assert fitted == [1, 2]
    leftover = tmp_path / f".softness-bayes-{0:032x}.part"
    leftover.write_text("{")  # of a process that was killed
    more, fitted = run(tmp_path, 3, processes=2)
    assert fitted == [3]
    assert not leftover.exists()
    assert more.replicates == whole.replicates
    assert (tmp_path / RANKS).read_bytes() == (home / RANKS).read_bytes()
    assert [more.replicates[k] for k in (0, 1)] == [*first.replicates.values()]
    assert len({one.rank for one in more.replicates.values()}) == 3
    fewer, fitted = run(tmp_path, 1)
    assert (fitted, [*fewer.replicates]) == ([], [0])


def test_another_calibration_is_not_continued(home, tmp_path):
    shutil.copytree(home, tmp_path, dirs_exist_ok=True)
    for options, said in (
        ({"seed": 1}, "seed was 0 and is now 1"),
        ({"scene": FakeCalibration(participants=3)}, "participants was 20 and is now 3"),
        ({"scale": SLIDER}, "scale was"),
        ({"errors": STUDENT}, "errors was"),
        ({"resolution": 1.0}, "resol"),
        ({"settings": LONGER}, "max_steps was 30 and is now 40.*--from"),
    ):
        with pytest.raises(InputError, match=said):
            run(tmp_path, 2, **options)
    (tmp_path / MANIFEST).write_text("no JSON")
    with pytest.raises(InputError, match=r"manifest\.json: not the file of a calibration"):
        run(tmp_path, 1)


def test_a_directory_with_something_else_is_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="contains no calibration"):
        run(tmp_path, 1)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]
    with pytest.raises(InputError, match="expected a whole number from 1 to"):
        run(tmp_path / "new", 0)


def test_two_processes_do_not_calibrate_in_one_place(home):
    with Lock(home / LOCK), pytest.raises(LockedError, match="another run"):
        run(home, 3)
    assert run(home, 3)[1] == []
    assert not (home / LOCK).exists()


def test_what_is_written_says_how_it_went(home, whole):
    table = pd.read_csv(home / RANKS, index_col="replicate")
    assert list(table) == [
        *("steps", "autocorrelation_time", "converged", "earlier"),
        *("gamma", "mu", LOG_LIKELIHOOD, PARTICIPANT, PARTICIPANTS),
        *("true_gamma", "true_mu", f"true_{LOG_LIKELIHOOD}", f"true_{PARTICIPANT}", f"true_{PARTICIPANTS}"),
    ]
    assert table.index.tolist() == [0, 1, 2]
    coverage = pd.read_csv(home / "coverage.csv", index_col=["quantity", "mass"])
    assert {"expected", "covered", "share", "low", "high", "outside", "uniform_p", "spread_p", "spread"} == {*coverage}
    assert len(coverage) == 20
    assert whole.unconverged > 0
    said = f"Too few replicates: 3 replicates (0 ran longer than 2000 steps, {whole.unconverged} did not converge and "
    assert (home / "verdict.txt").read_text().startswith(said)
    assert json.loads((home / MANIFEST).read_text())["loads"] == ["1.5 mm", "2.5 mm"]


# replicates of an earlier calibration


def test_a_stored_calibration_goes_on(stored, whole, tmp_path):
    """To the same replicates as without an interruption, although only the missing ones are fitted."""
    before = {path.name: path.read_bytes() for path in stored.iterdir()}
    done, fitted = run(tmp_path / "out", 3, earlier=stored)
    assert fitted == [3]
    assert done.replicates == whole.replicates
    assert "earlier" not in done.sentence()
    assert {path.name: path.read_bytes() for path in stored.iterdir()} == before
    # more of it than is asked for is kept as well
    fewer, fitted = run(tmp_path / "fewer", 1, earlier=stored)
    assert (fitted, [*fewer.replicates]) == ([], [0])
    assert run(tmp_path / "fewer", 2)[1] == []


def test_replicates_of_other_fits_are_named_in_the_verdict(stored, whole, tmp_path):
    done, fitted = run(tmp_path / "out", 3, LONGER, earlier=stored)
    assert fitted == [3]
    short, long = (("max_steps", "30"),), (("max_steps", "40"),)
    assert [one.earlier for one in done.replicates.values()] == [short, short, ()]
    assert [done.replicates[k]._replace(earlier=()) for k in (0, 1)] == [whole.replicates[k] for k in (0, 1)]
    assert "; 2 were fitted earlier with other settings of max_steps)" in done.sentence()
    # neither a second call nor a third calibration forgets it
    again, fitted = run(tmp_path / "out", 3, LONGER, earlier=stored)
    assert (fitted, again.replicates) == ([], done.replicates)
    fourth, _ = run(tmp_path / "fourth", 3, replace(LONGER, max_steps=50), earlier=tmp_path / "out")
    assert [one.earlier for one in fourth.replicates.values()] == [short, short, long]
    fifth, _ = run(tmp_path / "fifth", 3, BRIEF, earlier=tmp_path / "out")
    assert [one.earlier for one in fifth.replicates.values()] == [(), (), long]


def test_another_problem_is_refused(stored, tmp_path):
    """The manifest of the fake scene does not show its prior: the true values do."""
    with pytest.raises(InputError, match=r"seed was 0 and is now 1, so its replicates are of another problem"):
        run(tmp_path / "a", 3, earlier=stored, seed=1)
    with pytest.raises(InputError, match="the true gamma of replicate 0 was"):
        run(tmp_path / "b", 3, earlier=stored, scene=FakeCalibration(prior="lognormal(3,0.5)"))


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        (RANKS, lambda text: text.replace("\n0,", "\nx,"), r"ranks\.csv, row 2: not a replicate"),
        (RANKS, lambda text: text.replace("False", "perhaps", 1), r"ranks\.csv, row 2: not a replicate"),
        (RANKS, lambda text: text.replace("False,,", "False,,1", 1), "rank 1.*, expected 0 to 99"),
        (RANKS, lambda text: text.splitlines()[0] + "\n", "contains no finished replicate"),
        (MANIFEST, lambda text: text[:20], "not the file of a calibration"),
    ],
)
def test_damaged_results_are_refused(stored, tmp_path, name, change, said):
    before = (stored / name).read_text()
    (stored / name).write_text(change(before))
    assert (stored / name).read_text() != before
    with pytest.raises(InputError, match=said):
        run(tmp_path / "out", 3, earlier=stored)


def test_true_values_are_those_of_the_fit():
    posterior = fake_posterior(fix=CHAIN)
    for truths in (None, posterior.space.draw_prior(np.random.default_rng(1), 5)):
        one = replicate(posterior, BRIEF, 4, 7, truths=truths)
        assert true_values(posterior, 4, 7, truths) == dict(zip(one.names, one.truth, strict=True))


# verdicts


def made_up(rank, converged=True, steps=500):
    return Replicate(("gamma",), (rank,), (1.0,), steps, 5.0, converged)


def test_replicates_that_ran_longer_or_did_not_converge_are_counted_and_kept():
    even = {k: made_up(k) for k in range(100)}
    fine = Calibrated(even)
    assert fine.passed
    said = fine.sentence()
    assert said.startswith("Calibrated: 100 replicates (0 ran longer than 2000 steps, 0 did not")
    assert f"A posterior {fine.calibration.least_width:.2f} times too narrow" in said
    assert f"shifted by {fine.calibration.least_shift:.2f} of its standard deviations" in said
    late = Calibrated(even | {7: made_up(7, steps=9000), 8: made_up(8, converged=False)})
    assert late.passed
    assert "(1 ran longer than 2000 steps, 1 did not converge and was ranked by chains through" in late.sentence()
    assert len(rank_table(late.replicates)) == 100
    # the parameter tau and the autocorrelation time are two columns
    named = rank_table({0: made_up(3)._replace(names=("tau",))})
    assert named.loc[0, ["tau", "autocorrelation_time"]].tolist() == [3, 5.0]
    wrong = Calibrated({k: made_up(99) for k in range(100)})
    assert wrong.sentence().startswith("Not calibrated: 100 replicates")
    assert "gamma (too " in wrong.sentence()
    # the slowest are not like the rest: without them nothing is called calibrated
    assert not replace(fine, unfinished=(100,)).passed


def test_replicates_ranked_through_the_truth_decide_but_give_no_power():
    fine, through = ({k: made_up(k, one) for k in range(100)} for one in (True, False))
    found = Calibrated({**fine, **{100 + k: one for k, one in through.items()}})
    assert found.passed
    # as many replicates with independent draws detect smaller faults
    assert found.calibration.least_width == Calibrated(fine).calibration.least_width
    twice = Calibrated({**fine, **{100 + k: one for k, one in fine.items()}})
    assert twice.calibration.least_width < found.calibration.least_width
    # without any, no fault would have been detected, but they do raise an alarm
    alone = Calibrated(through)
    assert not alone.passed
    assert alone.sentence().startswith("Too few replicates: 100 replicates")
    assert "No fault would have been detected" in alone.sentence()
    assert Calibrated({k: made_up(99, False) for k in range(100)}).calibration.faults()


def test_few_replicates_are_too_few_to_tell():
    """Six of which half lie outside a 90 % interval raise no alarm, and are not called calibrated."""
    found = Calibrated({k: made_up(rank) for k, rank in enumerate((1, 2, 40, 55, 60, 98))})
    assert found.calibration.faults() == []
    assert found.calibration.coverage().set_index("mass")["share"][0.9] == 0.5
    said = found.sentence()
    assert said.startswith("Too few replicates: 6 replicates")
    assert "Calibrated" not in said
    assert f"To find one 1.5 times too narrow takes about {found.calibration.needed} replicates" in said
    assert not found.passed
    # few may be enough to see a gross fault
    assert Calibrated({k: made_up(99) for k in range(12)}).sentence().startswith("Not calibrated: 12 replicates")


def test_what_is_finished_can_be_judged_and_the_rest_is_named(home, whole, tmp_path):
    problem = prior_problem(FakeCalibration(), ModelOptions(), RunOptions(), BRIEF)
    with pytest.raises(InputError, match="no finished replicate of a calibration"):
        finished(problem, 2, tmp_path / "none")
    kept(home, tmp_path / "a", 1)
    found = finished(problem, 3, tmp_path / "a")
    assert found.replicates == {1: whole.replicates[1]}
    assert found.unfinished == (0, 2)
    assert (
        "Not decided: 1 of 3 replicates (0 ran longer than 2000 steps, 1 did not converge and was ranked by chains "
        "through the truth; unfinished: 0, 2)"
    ) in found.sentence()
    other = prior_problem(FakeCalibration(), ModelOptions(), RunOptions(seed=1), BRIEF)
    with pytest.raises(InputError, match="seed was 0 and is now 1"):
        finished(other, 3, tmp_path / "a")


# over the posterior of a run


def test_replicates_like_a_run(report_run, tmp_path):
    brief = replace(BRIEF, max_steps=20, goal=Goal(lengths=1.0))
    result, run = converged(report_run("ratings")), RunOptions(seed=1, processes=1)
    with quickly():
        problem = posterior_problem(result, run, brief)
        found = calibrate(result, None, run, 2, tmp_path / "out", settings=brief)
        again = finished(problem, 3, tmp_path / "out")
    assert problem.posterior.observation.values.size == result.group("observed_data")["rating"].size
    assert {LOG_LIKELIHOOD, *(f"turning_point_kpa[{load}]" for load in result.loads)} <= {*found.calibration.names}
    assert (again.replicates, again.unfinished) == (found.replicates, (2,))
    for name, true in zip(found.replicates[0].names, found.replicates[0].truth, strict=True):
        if name in problem.posterior.names:
            assert true in problem.truths[:, problem.posterior.names.index(name)]


def test_what_is_refused_on_the_command_line(report_run, tmp_path):
    with pytest.raises(InputError, match="has not converged"):
        calibrate(report_run("ratings"), None, RunOptions(), 2, tmp_path / "out")
    report_run("ratings").save(tmp_path / "run")
    for arguments, said in (
        (("--like", tmp_path / "run", "--participants", 3), "--participants: cannot be combined with --like"),
        (("--like", tmp_path / "run", "--out", tmp_path / "out"), "has not converged"),
        (("--like", tmp_path / "none"), "no such file"),
        (("--like", tmp_path, "--design"), "--design: cannot be combined with --like, which takes design and model"),
        (("--from", tmp_path / "no", "--out", tmp_path / "out"), "contains no calibration"),
        (("--from", tmp_path, "--finished", "--out", tmp_path / "out"), "--finished"),
    ):
        refused(call("calibrate", *arguments), said)


# the commands


def test_the_command_from_end_to_end(tmp_path):
    held = [f"--fix={name}={value}" for name, value in CHAIN.items()]
    arguments = ["calibrate", "--replicates", 1, "--max-steps", 20, "--accuracy", 0.01, "--processes", 1, *held]
    done = call(*arguments, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert "Too few replicates: 1 replicate (0 ran longer than 2000 steps, 1 did not converge and was" in done.stdout
    made = {ASKED, MANIFEST, RANKS, "coverage.csv", "verdict.txt", "ecdf.png", ".softness-bayes.json"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == made
    assert json.loads((tmp_path / "out" / MANIFEST).read_text())["goal"] == str(RANKED)
    other = call(*arguments, "--seed", 4, "--out", tmp_path / "out")
    assert other.returncode == 2
    assert "seed was 0 and is now 4" in other.stderr


def test_what_a_design_can_tell_is_said_and_nothing_is_written(tmp_path, monkeypatch):
    asked = []

    def foreseen(experiment, options):
        asked.append((experiment, options))
        ratio = {"sd_ratio": {"b": [0.1, 0.2, 0.3]}}
        return {"truths": 16, "loads": [1, 1], "not_foreseen": ["nu"], "turning_points": [], "others": [], **ratio}

    monkeypatch.setattr(understanding, "foreseen", foreseen)
    out = tmp_path / "out"
    done = call("calibrate", "--design", "--participants", 3, "--ratings", "slider", "--out", out)
    assert done.returncode == 0, done.stderr
    assert "0.20 (0.10 to 0.30)" in done.stdout
    assert "not covered: nu" in done.stdout
    assert not out.exists()
    ((experiment, options),) = asked
    assert len(experiment.ratings.participants) == 3
    assert options.scale is SLIDER
    assert options.direction is not None


@pytest.fixture
def three_of_five(tmp_path):
    """Two from an earlier call, and one that took four seconds."""
    (tmp_path / MANIFEST).write_text("{}")
    write_asked(tmp_path, 5, 2)
    write_replicates(tmp_path, {k: Replicate(("b",), (3,), (1.0,), 400, 5.0, k != 1) for k in range(3)})
    now = time.time()
    os.utime(tmp_path / ASKED, (now, now))
    os.utime(tmp_path / RANKS, (now + 4.0, now + 4.0))
    return tmp_path


def test_status_of_a_calibration(three_of_five):
    with Lock(three_of_five / LOCK):
        said = call("status", three_of_five).stdout
    assert "3 of 5 replicates are finished, 1 did not converge" in said
    assert "a process is running it, about 8 s to go" in said
    interrupted = call("status", three_of_five)
    assert interrupted.returncode == 0
    assert "no process is running it; the same 'softness-bayes calibrate' runs the other 2" in interrupted.stdout
    write_asked(three_of_five, 3, 3)
    said = call("status", three_of_five).stdout
    assert "3 of 3 replicates are finished" in said
    assert "interrupted" not in said
    (three_of_five / ASKED).write_text("{}")
    with pytest.raises(InputError, match="not the number of fits"):
        read_asked(three_of_five)
    refused(call("status", three_of_five), "asked.json: not the number of fits")
