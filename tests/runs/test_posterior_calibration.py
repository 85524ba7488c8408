"""Calibration where the posterior of a run is: a right model passes, injected faults and forgotten data are seen."""

from __future__ import annotations

import math
import os

import numpy as np
import pytest

from softness_bayes.checking.calibration import DRAWS, Calibration
from softness_bayes.errors import InputError
from softness_bayes.likelihood.directions import FALLS
from softness_bayes.likelihood.magnitude import LogRatings, RatingModel
from softness_bayes.parameters.declared import PARAMETERS
from softness_bayes.results.run_options import RunOptions
from softness_bayes.runs import replicate as replicates
from softness_bayes.runs.calibrate import _like, calibrate_like, finished_like
from softness_bayes.runs.calibration_files import MANIFEST
from softness_bayes.runs.ranked_quantities import LOG_LIKELIHOOD, turning_point
from softness_bayes.runs.replicate import independent, ranks, replicate, right
from softness_bayes.sampler.diagnostics import Goal
from softness_bayes.sampler.sampling import Settings, sample_until
from softness_bayes.sampler.workers import Workers
from support.command_line import call, refused
from support.fake_scene import fake_posterior
from support.report_runs import converged, quickly

CHAIN = {"b": 100.0, "m": 2.0, "alpha": 20.3, "beta": 0.6, "sigma_0": 9.0}
QUICK = Settings(
    ensembles=2,
    pilot=(60,),
    optima=1,
    round_steps=60,
    max_steps=1500,
    processes=1,
    goal=Goal(lengths=20.0, tau_change=math.inf, r_hat=1.05, ess=150.0, looks=1),
)
BRIEF = Settings(ensembles=2, pilot=(20,), optima=1, max_steps=20, processes=1, goal=Goal(lengths=1.0, looks=1))


# the statistics, on a normal mean whose posterior is drawn exactly


def of_a_mean(rng, count, forget=False, width=1.0):
    """Ranks of a posterior draw after a second look at the data; the fit may forget the first, or be too narrow."""
    seen, found = 0.7, []
    for _ in range(count):
        truth = 0.5 * seen + math.sqrt(0.5) * rng.standard_normal()  # prior N(0, 1), one look with error 1
        again = truth + rng.standard_normal()
        precision, total = (2.0, again) if forget else (3.0, seen + again)
        draws = total / precision + width / math.sqrt(precision) * rng.standard_normal((DRAWS, 1))
        found.append(ranks(np.array([truth]), draws, rng))
    return Calibration(("mean",), np.array(found))


def test_a_fit_of_both_data_is_calibrated(rng):
    assert of_a_mean(rng, 300).faults() == []


@pytest.mark.parametrize("mistake", [{"forget": True}, {"width": 0.7}], ids=["first data forgotten", "too narrow"])
def test_mistakes_are_seen(rng, mistake):
    assert of_a_mean(rng, 400, **mistake).faults()


# fits of the fake scene


def wrong_sign(observation):
    return LogRatings(observation.values, observation.design, RatingModel(FALLS))


class Powered(LogRatings):
    """A likelihood raised to a power: as if the variances were a quarter of what they are."""

    def log_likelihood(self, *arguments):
        return 4.0 * super().log_likelihood(*arguments)


def wrong_variance(observation):
    return Powered(observation.values, observation.design, observation.model)


@pytest.fixture(scope="module")
def scene():
    """A posterior and draws of it."""
    posterior = fake_posterior(fix=CHAIN, priors={"eps": PARAMETERS["eps"].prior})
    sampled = sample_until(posterior, QUICK, np.random.SeedSequence(3))
    return posterior, posterior.natural(independent(sampled, 400, np.random.default_rng(3)))


def fits(scene, assume, count, processes=1):
    posterior, truths = scene
    with Workers(posterior, processes) as workers:
        return Calibration.of(workers.map(replicate, [(QUICK, 5, k, assume, truths) for k in range(count)]))


def test_fits_where_a_posterior_is(scene):
    calibration = fits(scene, right, 2)
    assert LOG_LIKELIHOOD in calibration.names
    assert calibration.faults() == []
    assert fits(scene, wrong_sign, 3).faults()


def test_the_fit_is_of_both_data(scene, monkeypatch):
    """Of the run's ratings as they are, and of simulated ones of other raters."""
    posterior, truths = scene
    seen = []

    def note(fitted, *_):
        seen.extend(fitted.terms)
        raise InterruptedError

    monkeypatch.setattr(replicates, "sample_until", note)
    with pytest.raises(InterruptedError):
        replicate(posterior, QUICK, 1, 0, truths=truths)
    made, own = seen
    assert own is posterior.observation
    assert made.values.shape == own.values.shape
    assert not np.array_equal(made.values, own.values)


@pytest.mark.slow
def test_many_fits_where_a_posterior_is(scene):
    processes = os.cpu_count() or 1
    assert fits(scene, right, 150, processes).faults() == []
    for mistake in (wrong_variance, wrong_sign):
        assert fits(scene, mistake, 150, processes).faults(), mistake.__name__


# of a run


def test_replicates_like_a_run(report_run, tmp_path):
    result = converged(report_run("ratings"))
    run = RunOptions(seed=1, processes=1)
    with quickly():
        source, _, _ = _like(result, run, BRIEF)
        found = calibrate_like(result, run, 2, tmp_path / "out", settings=BRIEF)
        again = finished_like(result, run, 3, tmp_path / "out", settings=BRIEF)
        with pytest.raises(InputError, match="seed was 1 and is now 2"):
            finished_like(result, RunOptions(seed=2), 3, tmp_path / "out", settings=BRIEF)
    assert source.posterior.observation.values.size == result.group("observed_data")["rating"].size
    assert {LOG_LIKELIHOOD, *map(turning_point, result.loads)} <= {*found.calibration.names}
    assert again.unfinished == (2,)
    assert (tmp_path / "out" / MANIFEST).exists()
    for name, true in zip(found.replicates[0].names, found.replicates[0].truth, strict=True):
        if name in source.posterior.names:
            assert true in source.truths[:, source.posterior.names.index(name)]


def test_what_is_refused(report_run, tmp_path):
    with pytest.raises(InputError, match="has not converged"):
        calibrate_like(report_run("ratings"), RunOptions(), 2, tmp_path / "out")
    report_run("ratings").save(tmp_path / "run")
    refused(
        call("calibrate", "--like", tmp_path / "run", "--participants", 3),
        "--participants: cannot be combined with --like",
    )
    refused(call("calibrate", "--like", tmp_path / "run", "--out", tmp_path / "out"), "has not converged")
    refused(call("calibrate", "--like", tmp_path / "none"), "no such file")
