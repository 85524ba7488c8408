"""Simulation-based calibration: a right model passes, and every wrong one that is offered is found out.

The statistics are tested on a normal model whose posterior is drawn exactly; the fits on the fake scene; the
files and the resuming on both.
"""

import json
import math
import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from fake_scene import fake_posterior
from scipy.stats import norm

from softness_bayes.calibrate import CalibrationScene, calibrate
from softness_bayes.cli import main
from softness_bayes.errors import InputError, LockedError
from softness_bayes.inference.calibration import (
    DRAWS,
    LOG_LIKELIHOOD,
    Calibration,
    Replicate,
    independent,
    ranks,
    replicate,
    right,
)
from softness_bayes.inference.chains import Chains
from softness_bayes.inference.diagnostics import Goal, look
from softness_bayes.inference.observation import INVERSE, LogRatings, RatingModel
from softness_bayes.inference.sampling import Sampled, Settings
from softness_bayes.inference.workers import Workers
from softness_bayes.plotting.calibration import rank_ecdf_figure
from softness_bayes.run import RunOptions
from softness_bayes.storage.lock import Lock

# exact posteriors: slope and intercept of a line, known noise


def line(rng, count, noise=1.0, sign=1.0, width=1.0):
    """Ranks of slope ~ N(1, 0.3²) and intercept ~ N(0, 1), whose fit may be wrong about noise, sign or width."""
    x, prior_mean, prior_sd = np.linspace(-1, 1, 12), np.array([1.0, 0.0]), np.array([0.3, 1.0])
    found = []
    for _ in range(count):
        truth = prior_mean + prior_sd * rng.standard_normal(2)
        y = truth[0] * x + truth[1] + rng.standard_normal(x.size)
        columns = np.column_stack([sign * x, np.ones_like(x)])
        precision = columns.T @ columns / noise**2 + np.diag(prior_sd**-2)
        mean = np.linalg.solve(precision, columns.T @ y / noise**2 + prior_mean / prior_sd**2)
        root = np.linalg.cholesky(np.linalg.inv(precision))
        draws = mean + width * rng.standard_normal((DRAWS, 2)) @ root.T

        def log_likelihood(theta, columns=columns, y=y):
            return -0.5 * ((y - theta @ columns.T) ** 2).sum(axis=-1) / noise**2

        everything = np.column_stack([draws, log_likelihood(draws)])
        found.append(ranks(np.append(truth, log_likelihood(truth)), everything, rng))
    return Calibration(("slope", "intercept", LOG_LIKELIHOOD), np.array(found))


def test_a_right_model_passes_nearly_always(rng):
    alarms = [bool(line(rng, 60).faults()) for _ in range(60)]
    assert np.mean(alarms) <= 0.05


@pytest.mark.parametrize(
    ("mistake", "word"),
    [
        ({"width": 0.8}, "too narrow"),
        ({"noise": 0.7}, "too narrow"),
        ({"noise": 1.4}, "too wide"),
        ({"sign": -1.0}, "slope"),
    ],
    ids=["posterior narrowed by 20 %", "variance too small", "variance too large", "wrong sign"],
)
def test_a_wrong_model_does_not(rng, mistake, word):
    found = [line(rng, 200, **mistake).faults() for _ in range(8)]
    assert all(found)
    assert word in " ".join(found[0])


def test_a_prior_of_the_wrong_width_is_found(rng):
    """Truths that spread more than the prior says."""
    calibration = line(rng, 200)
    wide = calibration.rank.copy()
    wide[::3, 0] = np.where(wide[::3, 0] > 50, DRAWS, 0)
    assert replace(calibration, rank=wide).faults()


def test_judgement_of_exact_ranks():
    every = np.repeat(np.arange(DRAWS + 1), 3)[:, None]
    judged = Calibration(("x",), every).judge()["x"]
    assert judged.uniform_p > 0.999
    assert judged.spread == pytest.approx(1)
    assert judged.spread_p > 0.5


def test_resolution_is_the_width_that_raises_the_alarm(rng):
    calibration = Calibration(("x",), rng.integers(DRAWS + 1, size=(400, 1)))
    assert 1.05 < calibration.resolution < 1.15
    z = norm.ppf((np.arange(400) + 0.5) / 400)
    for spread, alarm in ((0.97 * calibration.resolution, False), (1.03 * calibration.resolution, True)):
        rank = np.floor(norm.cdf(spread * z) * (DRAWS + 1)).astype(int)[:, None]
        assert (replace(calibration, rank=rank).judge()["x"].spread_p < calibration.threshold) == alarm
    assert Calibration(("x",), np.zeros((20, 1), int)).resolution > 1.4


def test_coverage_counts_ranks():
    rows = Calibration(("x",), np.repeat(np.arange(DRAWS + 1), 2)[:, None]).coverage()
    assert [(row["mass"], row["expected"]) for row in rows] == [(0.5, 0.5), (0.8, 0.8), (0.9, 0.9), (0.95, 0.96)]
    assert all(row["share"] == row["expected"] for row in rows)
    assert all(row["low"] < row["share"] < row["high"] for row in rows)
    off = Calibration(("x",), np.zeros((50, 1), int)).coverage()
    assert all(row["covered"] == 0 for row in off)


def test_ranks_break_ties_evenly(rng):
    found = [int(ranks(np.array([2.0]), np.array([[1.0], [2.0], [2.0], [3.0]]), rng)[0]) for _ in range(600)]
    assert np.bincount(found, minlength=5).tolist()[0] == 0
    assert np.abs(np.bincount(found, minlength=5)[1:4] - 200).max() < 60
    assert ranks(np.array([2.5, 0.0]), np.array([[1.0, 1.0], [2.0, 1.0]]), rng).tolist() == [2, 0]


def test_draws_are_taken_a_tau_apart(rng):
    steps = np.arange(800.0)
    coordinates = np.tile(steps[None, :, None, None], (2, 1, 10, 1)) + 0.1 * rng.standard_normal((2, 800, 10, 1))
    noise = rng.standard_normal((2, 800, 10, 1)).cumsum(axis=1)
    verdict = look(("x",), noise - noise.mean(axis=1, keepdims=True))
    chains = Chains(coordinates, coordinates[..., 0], np.zeros((2, 10)), 800)
    apart = math.ceil(verdict.tau.max())
    assert apart > 5
    taken = independent(Sampled(chains, verdict), DRAWS, rng)
    assert taken.shape == (DRAWS, 1)
    times = np.unique(taken.round())
    assert (np.diff(times) % apart == 0).all()
    assert times.min() >= verdict.burn_in


# fits of the fake scene


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


class Powered(LogRatings):
    """A likelihood raised to a power: as if the variances were another multiple of what they are."""

    power = 4.0

    def log_likelihood(self, *arguments):
        return self.power * super().log_likelihood(*arguments)


class Narrowed(Powered):
    """Posteriors narrower by 20 %, where the prior says little."""

    power = 0.8**-2


def wrong_variance(observation):
    return Powered(observation.ratings, observation.design, observation.model)


def narrowed(observation):
    return Narrowed(observation.ratings, observation.design, observation.model)


def wrong_sign(observation):
    return LogRatings(observation.ratings, observation.design, RatingModel(INVERSE))


def fits(assume, count, processes=1):
    with Workers(fake_posterior(fix=CHAIN), processes) as workers:
        return Calibration.of(workers.map(replicate, [(QUICK, 5, k, assume) for k in range(count)]))


def test_fits_of_the_fake_scene_are_calibrated_and_mistakes_are_seen():
    calibration = fits(right, 8)
    assert calibration.names == ("gamma", "tau", "varsigma", "mu", LOG_LIKELIHOOD)
    assert calibration.rank.shape == (8, 5)
    assert calibration.faults() == []
    assert any("gamma" in fault for fault in fits(wrong_sign, 5).faults())
    assert fits(wrong_variance, 5).faults()


@pytest.mark.slow
def test_many_fits_of_the_fake_scene():
    processes = os.cpu_count() or 1
    assert fits(right, 150, processes).faults() == []
    for mistake in (narrowed, wrong_variance, wrong_sign):
        assert fits(mistake, 150, processes).faults(), mistake.__name__


# files


@dataclass(frozen=True)
class FakeCalibration(CalibrationScene):
    def posterior(self, options):
        return fake_posterior(fix=CHAIN | {"tau": 0.5, "varsigma": 0.3})


BRIEF = replace(QUICK, pilot=(10,), round_steps=10, max_steps=30)


def run(directory, count, scene=FakeCalibration(), settings=BRIEF, **options):
    finished = []
    done = calibrate(
        scene, RunOptions(**{"processes": 1, **options}), count, directory, lambda n, one: finished.append(n), settings
    )
    return done, finished


def test_an_interrupted_calibration_continues(tmp_path):
    first, finished = run(tmp_path / "a", 2)
    assert finished == [1, 2]
    leftover = tmp_path / "a" / "replicates" / "00002.json.77.part"
    leftover.write_text("{")  # of a process that was killed
    more, finished = run(tmp_path / "a", 3)
    assert finished == [3]
    assert [more.replicates[k] for k in (0, 1)] == [first.replicates[k] for k in (0, 1)]
    # the same as without an interruption, and whatever the number of processes
    whole, _ = run(tmp_path / "b", 3, processes=2)
    assert whole.replicates == more.replicates
    assert len({one.rank for one in whole.replicates.values()}) == 3
    fewer, finished = run(tmp_path / "a", 1)
    assert finished == []
    assert [*fewer.replicates] == [0]


def test_another_calibration_is_not_continued(tmp_path):
    run(tmp_path, 1)
    with pytest.raises(InputError, match="seed was 0 and is now 1"):
        run(tmp_path, 2, seed=1)
    with pytest.raises(InputError, match="participants was 20 and is now 3"):
        run(tmp_path, 2, scene=FakeCalibration(participants=3))
    with pytest.raises(InputError, match="fix was"):
        run(tmp_path, 2, fix={"m": 2.0})
    (tmp_path / "replicates" / "00000.json").write_text('{"names": ["gamma"]}')
    with pytest.raises(InputError, match=r"00000\.json: not the file of a replicate"):
        run(tmp_path, 1)
    (tmp_path / "manifest.json").write_text("no JSON")
    with pytest.raises(InputError, match=r"manifest\.json: not the file of a calibration"):
        run(tmp_path, 1)


def test_a_directory_with_something_else_is_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="holds no calibration"):
        run(tmp_path, 1)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]
    with pytest.raises(InputError, match="expected a whole number from 1 to"):
        run(tmp_path / "new", 0)


def test_what_is_written_says_how_it_went(tmp_path):
    done, _ = run(tmp_path, 2)
    done.save(tmp_path)
    import pandas as pd

    table = pd.read_csv(tmp_path / "ranks.csv", index_col="replicate")
    assert list(table) == [
        *("steps", "autocorrelation_time", "converged", "gamma", "mu", LOG_LIKELIHOOD),
        *("true_gamma", "true_mu", f"true_{LOG_LIKELIHOOD}"),
    ]
    assert table.index.tolist() == [0, 1]
    coverage = pd.read_csv(tmp_path / "coverage.csv", index_col=["quantity", "mass"])
    assert {"expected", "covered", "share", "low", "high", "uniform_p", "spread_p", "spread"} == {*coverage}
    assert len(coverage) == 12
    assert done.unconverged > 0
    said = f"Not decided: 2 replicates (0 ran longer than 2000 steps, {done.unconverged} did not converge)"
    assert (tmp_path / "verdict.txt").read_text().startswith(said)
    assert json.loads((tmp_path / "manifest.json").read_text())["loads"] == ["1.5 mm", "2.5 mm"]


def made_up(rank, converged=True, steps=500):
    return Replicate(("gamma",), (rank,), (1.0,), steps, 5.0, converged)


def test_replicates_that_ran_longer_or_did_not_converge_are_counted_and_kept():
    from softness_bayes.calibrate import Calibrated

    even = {k: made_up(k) for k in range(100)}
    fine = Calibrated(even)
    assert fine.passed
    assert fine.sentence().startswith("Calibrated: 100 replicates (0 ran longer than 2000 steps, 0 did not")
    late = Calibrated(even | {7: made_up(7, steps=9000), 8: made_up(8, converged=False)})
    assert not late.passed
    assert "(1 ran longer than 2000 steps, 1 did not converge)" in late.sentence()
    assert len(late.ranks()) == 100
    # the parameter tau and the autocorrelation time are two columns
    named = Calibrated({0: made_up(3)._replace(names=("tau",))}).ranks()
    assert named.loc[0, ["tau", "autocorrelation_time"]].tolist() == [3, 5.0]
    wrong = Calibrated({k: made_up(99) for k in range(100)})
    assert wrong.sentence().startswith("Not calibrated: 100 replicates")
    assert "gamma (too " in wrong.sentence()


# figure and command


def test_the_figure_shows_the_distribution_function_and_its_band(rng):
    rank = np.column_stack([rng.integers(DRAWS + 1, size=120), np.zeros(120, int)])
    figure = rank_ecdf_figure(rank, DRAWS, ["gamma", "mu"])
    lines = {line.get_gid(): line for axes in figure.axes for line in axes.lines}
    x, y = lines["ecdf/0"].get_data()
    np.testing.assert_allclose(y, [(rank[:, 0] < k).mean() - k / 100 for k in range(1, 100)])
    np.testing.assert_allclose(lines["ecdf/1"].get_ydata(), 1 - x)
    bands = {area.get_gid() for axes in figure.axes for area in axes.collections}
    assert bands == {"band/0", "band/1"}
    for wrong in (rank[:, :1], rank + 5):
        with pytest.raises(InputError, match="calibration figure"):
            rank_ecdf_figure(wrong, DRAWS, ["gamma", "mu"])


def test_the_command_from_end_to_end(tmp_path):
    held = [f"--fix={name}={value}" for name, value in (CHAIN | {"tau": 0.5, "varsigma": 0.3}).items()]
    arguments = ["calibrate", "--replicates", "1", "--max-steps", "20", "--processes", "1", *held]
    done = CliRunner().invoke(main, [*arguments, "--out", str(tmp_path / "out")])
    assert done.exit_code == 3, done.output
    assert "Not decided: 1 replicates" in done.output
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert written == {"manifest.json", "replicates", "ranks.csv", "coverage.csv", "verdict.txt", "ecdf.png"}
    again = CliRunner().invoke(main, [*arguments, "--seed", "4", "--out", str(tmp_path / "out")])
    assert again.exit_code == 2
    assert "seed was 0 and is now 4" in again.output


def test_two_processes_do_not_calibrate_in_one_place(tmp_path):
    run(tmp_path, 1)
    with Lock(tmp_path / "lock"), pytest.raises(LockedError, match="another run"):
        run(tmp_path, 2)
    _, finished = run(tmp_path, 2)
    assert finished == [2]
    assert not (tmp_path / "lock").exists()


def test_the_kept_calibration_says_what_its_ranks_say():
    kept = Path(__file__).resolve().parents[1] / "notebooks" / "results" / "calibration"
    table = pd.read_csv(kept / "ranks.csv", index_col="replicate")
    names = tuple(name for name in table if f"true_{name}" in table)
    found = Calibration(names, table[list(names)].to_numpy())
    verdict = (kept / "verdict.txt").read_text(encoding="utf-8")
    assert len(table) >= 200
    assert table.index.to_list() == list(range(len(table)))
    assert table["converged"].all()
    assert found.faults() == []
    smallest = min(min(one.uniform_p, one.spread_p) for one in found.judge().values())
    assert verdict.startswith(f"Calibrated: {len(table)} replicates")
    assert f"smallest p-value {smallest:.2g}" in verdict
    shares = pd.read_csv(kept / "coverage.csv")["share"].to_numpy()
    np.testing.assert_allclose(shares, [row["share"] for row in found.coverage()])
