"""`status` and `resume`: an interrupted run at the command line, and what is refused there."""

import json
import os
import shutil
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from softness_bayes.base.files.lock import Lock
from softness_bayes.cli.sample import continued
from softness_bayes.likelihood.magnitude import LogRatings
from softness_bayes.results.result import Result
from softness_bayes.results.run_options import RunOptions
from softness_bayes.runs.checkpoint import Checkpoint
from softness_bayes.runs.saved import Status, read_record, read_status, saved_states
from softness_bayes.sampler.diagnostics import Goal
from softness_bayes.touch import scene
from support.command_line import FIXED, call, few_ratings, refused
from support.faults import rewritten
from support.full_disk import fill_disk
from support.paths import ROOT
from support.report_runs import quickly

STEPS = 300
CAUTIOUS = ["--steps-per-tau", "1000"]  # a run that does not converge
ASKED = [*FIXED, "--seed", "3", "--no-figures", "--accuracy", "0.01", "--max-steps", STEPS, *CAUTIOUS]


IMPORTS = (
    "import atexit, sys, threading; elsewhere = []; "
    "sys.addaudithook(lambda event, args: elsewhere.append(args[0]) if event == 'import' "
    "and threading.current_thread() is not threading.main_thread() else None); "
    "atexit.register(lambda: print('imported in threads:', elsewhere, file=sys.stderr)); "
)
"""What tells of the modules that a process imports outside of its main thread."""


def begin(directory, *more):
    """Start a run in a process of its own, which keeps every state, and wait until it has steps."""
    program = (
        # a shell that runs the tests in the background has interrupts ignored, by its children too
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
        "from softness_bayes.cli import main; "
        f"import sys; sys.path.append({str(ROOT / 'tests')!r}); "
        "from support.report_runs import quickly; made = quickly(); made.__enter__(); "
        "main(prog_name='softness-bayes')"
    )
    arguments = ["sample", "--data", directory / "ratings.csv", "--out", directory / "out", *ASKED, *more]
    process = subprocess.Popen(
        [sys.executable, "-W", "error", "-c", program, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": str(ROOT), "PYTHONUTF8": "1"},
        start_new_session=True,
    )
    while process.poll() is None:
        if saved_states(directory / "out") and read_status(directory / "out").steps:
            return process
        time.sleep(0.02)
    raise AssertionError(process.communicate())


@pytest.fixture(scope="module", autouse=True)
def brief():
    """Run here as `begin` does."""
    with quickly():
        yield


@pytest.fixture(scope="module")
def killed(tmp_path_factory, brief):
    """A directory with the data and a run that was killed with its workers still walking."""
    directory = tmp_path_factory.mktemp("killed")
    few_ratings(directory)
    process = begin(directory, "--processes", "2")
    process.kill()
    process.communicate()
    return directory


@pytest.fixture
def copied(killed, tmp_path):
    """A copy of the killed run and of its data, which it finds from its own place on."""
    shutil.copytree(killed / "out", tmp_path / "out")
    shutil.copy(killed / "ratings.csv", tmp_path)
    return tmp_path / "out"


def test_a_killed_run_is_reported_on_continued_and_draws_what_an_uninterrupted_one_draws(killed, copied):
    kept = read_status(copied)
    assert 0 < kept.steps < STEPS
    assert not kept.running
    assert sorted(path.name for path in copied.iterdir()) == ["checkpoint"]
    said = call("status", copied)
    assert said.returncode == 0
    assert "interrupted, no process is running it" in said.stdout
    assert f"steps: {kept.steps} in" in said.stdout
    refused(call("sample", "--data", killed / "ratings.csv", "--out", copied), "is not empty", "resume")

    done = call("resume", copied, "--processes", "1")
    assert done.returncode == 3, done.stderr
    whole = copied.parent / "whole"
    assert call("sample", "--data", killed / "ratings.csv", "--out", whole, *ASKED, "--processes", "1").returncode == 3
    one, other = Result.load(copied), Result.load(whole)
    for group in other.tree.children:
        assert one.tree[group].identical(other.tree[group]), group
    pd.testing.assert_frame_equal(one.table, other.table, check_exact=True)
    assert one.attributes["discretisation"] == other.attributes["discretisation"] != str(scene.Discretisation())
    assert one.attributes["verdict"] == other.attributes["verdict"]
    assert one.attributes["command"].startswith("softness-bayes")
    assert one.attributes["command"].count("; softness-bayes") == 1

    said = call("status", copied)
    assert "it has ended and its results are written" in said.stdout
    assert other.attributes["verdict"] in said.stdout
    assert "ESS" in said.stdout
    # as if it had converged at its last step: there is nothing to do unless its results were lost
    status = read_record(copied).status
    one_draw = dict.fromkeys(("ess_bulk", "ess_tail", "ess_between"), np.ones(1))
    status = status._replace(verdict=replace(status.verdict, goal=Goal(0.0, 1e9, 0.0), **one_draw))
    rewritten(copied, status=status)
    before = (copied / "posterior.nc").read_bytes()
    again = call("resume", copied)
    assert again.returncode == 0
    assert "Its results are complete; use --more-steps to continue it." in again.stdout
    assert (copied / "posterior.nc").read_bytes() == before
    (copied / "posterior.nc").unlink()
    rewritten(copied, status=status._replace(written=False))  # as if killed before the result was written
    assert "interrupted" in call("status", copied).stdout
    rewritten(copied, status=status)
    again = call("resume", copied, "--processes", "2")
    assert again.returncode == 0
    assert "posterior.nc: no such file; expected the posterior.nc of a run; the results are" in again.stderr
    # all that follows the walk is the same bit for bit, whether one process makes it or workers share it
    two = Result.load(copied)
    for group in {*one.tree.children} - {"illustration_data"}:  # its spike trains are made up here, but not by workers
        assert two.tree[group].identical(one.tree[group]), group
    pd.testing.assert_frame_equal(one.table, two.table, check_exact=True)


def test_limits_let_a_run_go_on():
    status = Status(False, False, 350, 0, 5.0, 0, True, True, 350, None)
    options = RunOptions(max_steps=351)
    # what has ended at its limit gets as many steps again, what was interrupted does not
    assert continued(options, status, None).max_steps == 701
    assert continued(options, status._replace(written=False), None).max_steps == 351
    assert continued(options, status._replace(steps=200), None).max_steps == 351
    more = continued(options, status._replace(steps=200), 50)
    assert (more.min_steps, more.max_steps) == (250, 351)
    assert continued(options, status, 50).max_steps == 400


def test_what_changed_is_named(killed, copied):
    kept, first = {path: path.read_bytes() for path in copied.rglob("*.*")}, read_record(copied).request
    other = copied.parent / "other.csv"
    lines = (killed / "ratings.csv").read_text().splitlines()
    rating = lines[5].split(",")[3]
    other.write_text("\n".join([*lines[:5], lines[5].replace(rating, rating + "1"), *lines[6:]]) + "\n")
    refused(call("resume", copied, "--data", other), "cannot be continued", "begun with ratings ")

    def asked(place, value):
        rewritten(copied, request={**first, "options": {**first["options"], place: value}})
        return call("resume", copied)

    refused(asked("priors", {"gamma": "lognormal(2,0.3)"}), "prior of gamma lognormal(1,0.3) (now lognormal(2,0.3))")
    refused(asked("seed", 4), "seed 3 (now 4)")
    readings = first["options"]["readings"]
    refused(asked("readings", {**readings, "pressure": "hertz"}), "reading of pressure attenuated (now hertz)")
    fixed = first["options"]["fix"]
    del fixed["tau"]
    refused(asked("fix", fixed), "parameters gamma, varsigma (now gamma, tau, varsigma)")
    left = {path: path.read_bytes() for path in copied.rglob("*.*") if path.suffix != ".npz"}  # those written here
    assert kept.items() >= left.items()


def test_another_density_under_the_same_options_is_refused(copied, monkeypatch):
    right = LogRatings.log_likelihood
    monkeypatch.setattr(LogRatings, "log_likelihood", lambda *arguments: 1.001 * right(*arguments))
    refused(call("resume", copied), "the log density at one of its walkers was", "has the software changed")


def test_moved_data_are_asked_for_and_found(killed, copied):
    request = json.loads(json.dumps(read_record(copied).request).replace("ratings.csv", "gone.csv"))
    request["versions"]["version_emcee"] = "2.0"
    rewritten(copied, request=request)
    refused(call("resume", copied), "gone.csv", "note: the run was started with emcee 2.0 (now ")
    done = call("resume", copied, "--data", killed / "ratings.csv", "--max-time", "0s", "--processes", "1")
    assert done.returncode == 3, done.stderr
    assert "continues" in done.stderr


def test_a_run_in_use_is_refused_with_5(copied, killed):
    with Lock(copied / "checkpoint" / "lock"):
        for arguments in (["resume", copied], ["sample", "--data", killed / "ratings.csv", "--out", copied, "--force"]):
            done = call(*arguments)
            assert done.returncode == 5, done.stderr
            assert f"another run is using it (process {os.getpid()})" in done.stderr
        assert "a process is running it" in call("status", copied).stdout
    assert read_status(copied).steps


def test_a_run_begun_in_python_is_continued_there(copied):
    with Checkpoint.open(copied):
        pass
    rewritten(copied, request=None)
    refused(call("resume", copied), "started in Python", "Checkpoint.open(")


def test_a_full_disk_says_how_to_go_on(copied, monkeypatch):
    fill_disk(monkeypatch, 4)
    done = call("resume", copied, "--processes", "1")
    assert done.returncode == 2
    assert "No space left on device" in done.stderr
    assert f"'softness-bayes resume {copied}' continues it" in done.stderr
    monkeypatch.undo()
    assert read_status(copied).steps
    with Checkpoint.open(copied) as checkpoint:
        assert checkpoint.status is not None


def test_too_many_failures_end_a_run_with_4_and_its_state_safe(tmp_path, monkeypatch):
    unbroken = LogRatings.log_likelihood

    def broken(self, rate, parameters):
        return np.where(np.asarray(parameters.gamma) > 0.9, np.nan, unbroken(self, rate, parameters))

    monkeypatch.setattr(LogRatings, "log_likelihood", broken)
    out = tmp_path / "out"
    few_ratings(tmp_path)
    done = call("sample", "--data", tmp_path / "ratings.csv", "--out", out, *ASKED, "--processes", "1")
    assert done.returncode == 4, done.stderr
    assert "the density could not be computed at" in done.stderr
    assert "(likelihood)" in done.stderr
    table = pd.read_csv(out / "nonfinite.csv")
    assert list(table) == ["stage", "gamma", "varsigma"]
    assert (table["gamma"] > 0.9).all()
    assert read_status(out).failures >= len(table)
    assert "in nonfinite.csv" in call("status", out).stdout


@pytest.mark.parametrize("times", [1, pytest.param(20, marks=pytest.mark.slow)])
def test_a_killed_run_is_resumed_by_a_process_every_time(killed, tmp_path, times):
    """ArviZ was imported in a thread, and often only in part when the main thread needed it."""
    shutil.copy(killed / "ratings.csv", tmp_path)
    program = (
        f"{IMPORTS}sys.path.append({str(ROOT / 'tests')!r}); from support.report_runs import quickly; "
        "made = quickly(); made.__enter__(); from softness_bayes.cli import main; main(prog_name='softness-bayes')"
    )
    for k in range(times):
        out = tmp_path / f"out{k}"
        shutil.copytree(killed / "out", out)
        done = subprocess.run(
            [sys.executable, "-c", program, "resume", str(out), "--processes", "2", "--no-figures"],
            capture_output=True,
            text=True,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
            check=False,
        )
        assert done.returncode == 3, done.stderr
        assert "Traceback" not in done.stderr
        assert "imported in threads: []" in done.stderr
        assert read_status(out).written


def test_an_import_in_a_thread_is_noticed():
    program = f"{IMPORTS}one = threading.Thread(target=lambda: __import__('colorsys')); one.start(); one.join()"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert "imported in threads: ['colorsys']" in done.stderr
