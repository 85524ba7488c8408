"""Simulation-based calibration: a right model passes, and every wrong one that is offered is found out.

The statistics are tested on a normal model whose posterior is drawn exactly; the fits on the fake scene.
"""

import math
import os

import numpy as np
import pandas as pd
import pytest

from softness_bayes.base.errors import InputError
from softness_bayes.checking.calibration import (
    DRAWS,
    FALSE_ALARM,
    Calibration,
    coverage_sentence,
    rank_law,
    verdict,
)
from softness_bayes.checking.inflection import LEAST_DROP, curve_scene
from softness_bayes.checking.quantities import simultaneous_band
from softness_bayes.data import Fabrics
from softness_bayes.likelihood.magnitude import LogRatings, RatingModel
from softness_bayes.likelihood.scales import FALLS, RATING_SCALES
from softness_bayes.model.options import ModelOptions
from softness_bayes.parameters.declared import PARAMETERS
from softness_bayes.plotting.checks import rank_ecdf_figure
from softness_bayes.runs import replicate as replicates
from softness_bayes.runs.calibrate import CalibrationScene
from softness_bayes.runs.rank_table import LONG
from softness_bayes.runs.replicate import (
    LOG_LIKELIHOOD,
    PARTICIPANT,
    PARTICIPANTS,
    independent,
    quantities,
    ranks,
    replicate,
)
from softness_bayes.sampler.chains import Chains
from softness_bayes.sampler.diagnostics import Goal, look
from softness_bayes.sampler.sampling import Sampled, Settings, sample_until
from softness_bayes.sampler.workers import Workers
from softness_bayes.touch.neuron.membrane import PAPER_CHANNELS
from softness_bayes.touch.scene import Discretisation
from support.fake_scene import fake_posterior
from support.paths import ROOT

# exact posteriors: slope and intercept of a line, known noise


def right(observation):
    """The model that the ratings were simulated from."""
    return observation


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


@pytest.mark.parametrize(
    ("mistake", "word"),
    [
        ({"width": 0.8}, "too narrow"),
        ({"noise": 0.7}, "too narrow"),
        ({"noise": 1.4}, "too wide"),
        ({"sign": -1.0}, "slope"),
        ({}, ""),
    ],
    ids=["posterior narrowed by 20 %", "variance too small", "variance too large", "wrong sign", "right"],
)
def test_a_wrong_model_raises_the_alarm_and_a_right_one_does_not(rng, mistake, word):
    found = [line(rng, 200, **mistake).faults() for _ in range(8)]
    assert all(found) if mistake else sum(map(bool, found)) <= 1
    assert word in " ".join(found[0])


def test_judgement_of_exact_ranks():
    every = np.repeat(np.arange(DRAWS + 1), 3)[:, None]
    judged = Calibration(("x",), every).judge()["x"]
    assert judged.uniform_p > 0.999
    assert judged.spread == pytest.approx(1)
    assert judged.spread_p > 0.5
    # a density that rises leaves the mean of squared scores as it is
    rising = (100 * np.sqrt((np.arange(300) + 0.5) / 300)).astype(int)[:, None]
    for rank, side in ((rising, "too low: "), (DRAWS - rising, "too high: ")):
        assert Calibration(("x",), rank).fault_of()["x"].startswith(side)


def alarms(rank, threshold):
    """Whether each table of ranks (tables, replicates) of one quantity raises the alarm."""
    judged = Calibration(tuple(map(str, range(len(rank)))), rank.T).judge()
    return np.array([min(one.uniform_p, one.spread_p) < threshold for one in judged.values()])


def test_a_right_model_raises_the_alarm_as_seldom_as_is_said(rng):
    """Whole tables of independent quantities."""
    names, size, tables = 9, 60, 150
    found = alarms(rng.integers(DRAWS + 1, size=(names * tables, size)), FALSE_ALARM / (2 * names))
    assert found.reshape(tables, names).any(axis=1).mean() < FALSE_ALARM + 3 * math.sqrt(FALSE_ALARM / tables)


def ranked(rng, tables, size, width=1.0, shift=0.0):
    """Ranks of a truth among draws of a normal posterior, drawn and counted."""
    truth, draws = rng.standard_normal((tables, size, 1)), rng.standard_normal((tables, size, DRAWS))
    return (draws < width * truth + shift).sum(axis=-1)


def test_the_stated_fault_is_found_nine_times_in_ten(rng):
    """In other tables, made of truths and draws themselves; the stated power is a lower limit, and a close one."""
    size, tables = 60, 200
    calibration = Calibration(("x", "y", "z"), np.zeros((size, 3), int))
    width, shift = calibration.least_width, calibration.least_shift
    assert 1.2 < width < 1.6
    assert 0.3 < shift < 1.0
    for fault in ({"width": width}, {"shift": shift}, {"shift": -shift}):
        found = alarms(ranked(rng, tables, size, **fault), calibration.threshold).mean()
        assert 0.9 - 4 * math.sqrt(0.09 / tables) < found < 0.99
    # half of either is found far less often
    for fault in ({"width": 0.5 + 0.5 * width}, {"shift": 0.5 * shift}):
        assert alarms(ranked(rng, tables, size, **fault), calibration.threshold).mean() < 0.5


def test_the_law_of_ranks(rng):
    np.testing.assert_allclose(rank_law(DRAWS), 1 / (DRAWS + 1), rtol=1e-6)
    found = np.bincount(ranked(rng, 1, 40_000, 1.4, 0.3)[0], minlength=DRAWS + 1) / 40_000
    np.testing.assert_allclose(found, rank_law(DRAWS, 1.4, 0.3), atol=0.004)
    assert np.abs(found - 0.01).max() > 0.01


def test_coverage_counts_ranks():
    rows = Calibration(("x",), np.repeat(np.arange(DRAWS + 1), 2)[:, None]).coverage().to_dict("records")
    assert [(row["mass"], row["expected"]) for row in rows] == [(0.5, 0.5), (0.8, 0.8), (0.9, 0.9), (0.95, 0.96)]
    assert all(row["share"] == row["expected"] for row in rows)
    assert all(row["low"] < row["share"] < row["high"] for row in rows)
    off = Calibration(("x",), np.zeros((50, 1), int)).coverage()
    assert (off["covered"] == 0).all()


def test_shares_outside_their_limits_are_as_many_as_chance_has(rng):
    def outside(rank):
        words = coverage_sentence(Calibration(("x",), rank)).split()
        assert words[2] == "4"
        return int(words[0]), Calibration(("x",), rank).coverage()["outside"].sum()

    found = np.array([outside(rng.integers(DRAWS + 1, size=(70, 1))) for _ in range(400)])
    assert 0.05 < found[0, 1] < 0.2  # of four, at 5 % or less
    assert found[:, 0].mean() == pytest.approx(found[0, 1], abs=4 * found[:, 0].std() / 20)
    # intervals 1.5 times too narrow
    assert outside(ranked(rng, 1, 70, width=1.5).T)[0] >= 3


def test_ranks_break_ties_evenly(rng):
    found = [int(ranks(np.array([2.0]), np.array([[1.0], [2.0], [2.0], [3.0]]), rng)[0]) for _ in range(600)]
    assert np.bincount(found, minlength=5).tolist()[0] == 0
    assert np.abs(np.bincount(found, minlength=5)[1:4] - 200).max() < 60
    assert ranks(np.array([2.5, 0.0]), np.array([[1.0, 1.0], [2.0, 1.0]]), rng).tolist() == [2, 0]
    # so are values that differ by rounding, as a silent model's likelihood of orders, one by one or together
    last = -424.18411610980996
    close = np.full((99, 1), last * (1.0 - 5e-16))
    close[:9] = -500.0
    spread = [int(ranks(np.array([last]), close, rng)[0]) for _ in range(600)]
    assert min(spread) == 9
    assert max(spread) == 99


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
    goal=Goal(r_hat=1.05, ess=150.0),
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
    return Powered(observation.values, observation.design, observation.model)


def narrowed(observation):
    return Narrowed(observation.values, observation.design, observation.model)


def wrong_sign(observation):
    return LogRatings(observation.values, observation.design, RatingModel(FALLS))


POSTERIOR = fake_posterior(fix=CHAIN, priors={"eps": PARAMETERS["eps"].prior})


@pytest.fixture(scope="module")
def truths():
    """Draws of the posterior."""
    sampled = sample_until(POSTERIOR, QUICK, np.random.SeedSequence(3))
    return POSTERIOR.natural(independent(sampled, 400, np.random.default_rng(3)))


def fits(assume, count, truths=None, processes=1):
    with Workers(POSTERIOR, processes) as workers:
        return Calibration.of(workers.map(replicate, [(QUICK, 5, k, assume, truths) for k in range(count)]))


def test_fits_of_the_fake_scene_are_calibrated_and_mistakes_are_seen(truths):
    """Over the prior, and over a posterior."""
    calibration = fits(right, 3)
    assert calibration.names == ("gamma", "tau", "varsigma", "eps", "mu", LOG_LIKELIHOOD, PARTICIPANT, PARTICIPANTS)
    assert calibration.rank.shape == (3, 8)
    assert calibration.faults() == []
    assert any("gamma" in fault for fault in fits(wrong_sign, 4).faults())
    assert fits(wrong_variance, 3).faults()
    assert fits(right, 2, truths).faults() == []
    assert fits(wrong_sign, 3, truths).faults()


@pytest.mark.slow
@pytest.mark.parametrize("over", ["prior", "posterior"])
def test_many_fits_of_the_fake_scene(over, truths):
    drawn, processes = truths if over == "posterior" else None, os.cpu_count() or 1
    assert fits(right, 150, drawn, processes).faults() == []
    for mistake in (wrong_variance, wrong_sign) if over == "posterior" else (narrowed, wrong_variance, wrong_sign):
        assert fits(mistake, 150, drawn, processes).faults(), mistake.__name__


def test_a_fit_over_a_posterior_is_of_both_data(truths, monkeypatch):
    """Of the run's ratings as they are, and of simulated ones of other raters."""
    seen = []

    def note(fitted, *_):
        seen.extend(fitted.terms)
        raise InterruptedError

    monkeypatch.setattr(replicates, "sample_until", note)
    with pytest.raises(InterruptedError):
        replicate(POSTERIOR, QUICK, 1, 0, truths=truths)
    made, own = seen
    assert own is POSTERIOR.observation
    assert made.values.shape == own.values.shape
    assert not np.array_equal(made.values, own.values)


# what is ranked


@pytest.fixture(scope="module")
def pool():
    """All that is ranked at prior draws of a small scene, of which some turn over and some do not."""
    small = CalibrationScene(Fabrics(tuple("abcd"), effective_modulus=np.geomspace(5e3, 1e6, 4)), participants=3)
    posterior = small.model(ModelOptions(fix=PAPER_CHANNELS._asdict(), discretisation=Discretisation())).posterior
    rng = np.random.default_rng(5)
    theta = posterior.space.draw_prior(rng, 1500)
    parameters, rate = posterior.rating_parameters(theta), posterior.mean_rate(theta)
    return posterior, theta, quantities(posterior, theta, posterior.observation.draw_effects(rng, rate, parameters))


def test_turning_points_are_those_of_the_fine_curve(pool):
    posterior, theta, found = pool
    names = ("b", "m", "alpha", "beta", "sigma_0", "gamma", "tau", "varsigma", "eps", "mu", LOG_LIKELIHOOD)
    places = tuple(f"{what}[{load}]" for what in ("turns", "turning_point_kpa") for load in ("1.5 mm", "2.5 mm"))
    assert tuple(found) == (*names, PARTICIPANT, PARTICIPANTS, *places)
    few = slice(0, 40)
    grid = curve_scene(posterior.scene, 801)
    rate = grid.total_rate(posterior.space.touch(theta[few])).reshape(40, 2, 801)[:, 1]
    fine, top = grid.modulus[:801] * 1e-3, rate.argmax(axis=-1)
    turn, place = found["turns[2.5 mm]"][few], found["turning_point_kpa[2.5 mm]"][few]
    assert 5 < turn.sum() < 35
    np.testing.assert_array_equal(place > 0, turn == 1)
    np.testing.assert_allclose(place[turn == 1], fine[top][turn == 1], rtol=0.05)
    drop = 1 - np.maximum(rate[:, 0], rate[:, -1]) / np.maximum(rate.max(axis=-1), 1e-9)
    np.testing.assert_array_equal(turn == 1, (drop >= LEAST_DROP) & (rate.max(axis=-1) > 0))


def test_turns_and_their_places_have_uniform_ranks_where_some_have_none(pool, rng):
    """Truth and draws from one law: whether the truth turns over or not, none is left out."""
    found = pool[2]
    names = [name for name in found if name.startswith(("turn", "participant"))]
    table = np.column_stack([found[name] for name in names])
    picked = [table[rng.choice(len(table), DRAWS + 1, replace=False)] for _ in range(300)]
    rank = np.array([ranks(each[0], each[1:], rng) for each in picked])
    assert Calibration(tuple(names), rank).faults() == []
    # truths without a turning point left out: those that are left are ranked too high
    turn, place = names.index("turns[2.5 mm]"), names.index("turning_point_kpa[2.5 mm]")
    kept = np.array([each[0, turn] == 1 for each in picked])
    assert 50 < kept.sum() < 250
    assert Calibration(("place",), rank[kept][:, [place]]).faults()


# figure


def test_the_figure_shows_the_distribution_function_and_its_band(rng):
    rank = np.column_stack([rng.integers(DRAWS + 1, size=120), np.zeros(120, int)])
    figure = rank_ecdf_figure(rank, DRAWS, ["gamma", "mu"])
    lines = {line.get_gid(): line for axes in figure.axes for line in axes.lines}
    x, y = lines["ecdf/0"].get_data()
    np.testing.assert_allclose(y, [(rank[:, 0] < k).mean() - k / 100 for k in range(1, 100)])
    np.testing.assert_allclose(lines["ecdf/1"].get_ydata(), 1 - x)
    bands = {area.get_gid() for axes in figure.axes for area in axes.collections}
    assert bands == {"band/0", "band/1"}
    assert figure.axes[0].get_title(loc="left") == "gamma"
    assert figure.axes[1].get_title(loc="left") == "mu: too narrow"
    for wrong in (rank[:, :1], rank + 5):
        with pytest.raises(InputError, match="calibration figure"):
            rank_ecdf_figure(wrong, DRAWS, ["gamma", "mu"])


def test_a_curve_leaves_its_band_where_the_verdict_says_so(rng):
    """Ranks at, and just beyond, what the verdict bears: figure and sentence change sides together."""
    sides = []
    for shift in (0.2, 0.45, 0.5, 0.55, 0.9):
        rank = np.column_stack([ranked(np.random.default_rng(3), 1, 100, shift=shift)[0], rng.integers(100, size=100)])
        calibration = Calibration(("b", "m"), rank)
        axes = rank_ecdf_figure(rank, DRAWS, calibration.names).axes[0]
        (curve,) = (line.get_ydata() for line in axes.lines if line.get_gid() == "ecdf/0")
        band = simultaneous_band(100, calibration.points, 1 - calibration.threshold)
        drawn = axes.collections[0].get_datalim(axes.transData)
        np.testing.assert_allclose([drawn.y0, drawn.y1], [min(band.low - band.points), max(band.high - band.points)])
        low, high = band.low - band.points - 1e-9, band.high - band.points + 1e-9
        sides.append(bool(((curve < low) | (curve > high)).any()))
        assert sides[-1] == (calibration.judge()["b"].uniform_p < calibration.threshold)
    assert set(sides) == {False, True}


def test_the_kept_calibration_says_what_its_ranks_say():
    kept = ROOT / "notebooks" / "results" / "calibration"
    table = pd.read_csv(kept / "ranks.csv", index_col="replicate")
    names = tuple(name for name in table if f"true_{name}" in table)
    found = Calibration(names, table[list(names)].to_numpy(), exchangeable=int((~table["converged"]).sum()))
    assert {"eps", PARTICIPANT, PARTICIPANTS, "turns[2.5 mm]", "turning_point_kpa[1.5 mm]"} <= {*names}
    assert len(table) >= 1000
    assert table.index.to_list() == list(range(len(table)))
    # replicates of hardly any noise need longer walks than these, and are neither left out nor hidden
    hard = table[~table["converged"]]
    assert hard["true_varsigma"].max() < 0.05 < table["true_varsigma"].quantile(0.1)
    assert 0 < len(hard) < 0.03 * len(table)
    # nor do they raise the alarm among themselves
    assert Calibration(names, hard[list(names)].to_numpy()).faults() == []
    assert found.faults() == []
    assert found.enough
    walks = (
        f"{(table['steps'] > LONG).sum()} ran longer than {LONG} steps, {len(hard)} did not converge and were ranked"
    )
    said = verdict(found, f"{len(table)} replicates ({walks} by chains through the truth)", decided=True)
    assert said.startswith(f"Calibrated: {len(table)} replicates")
    assert (kept / "verdict.txt").read_text(encoding="utf-8") == said + "\n"
    # a truth without a turning point has none at 0 kPa, and is ranked all the same
    assert ((table["true_turning_point_kpa[2.5 mm]"] > 0) == (table["true_turns[2.5 mm]"] == 1)).all()
    assert 0 < table["true_turns[2.5 mm]"].sum() < len(table)
    shares = pd.read_csv(kept / "coverage.csv")["share"].to_numpy()
    np.testing.assert_allclose(shares, found.coverage()["share"])


@pytest.mark.parametrize("scale", RATING_SCALES.values(), ids=RATING_SCALES)
def test_every_scale_is_calibrated(scale):
    """The model of a design simulates tables of its scale from its own parameters, which its likelihood takes."""
    scene = CalibrationScene(participants=3)
    options = ModelOptions(
        fix={**PAPER_CHANNELS._asdict(), "b": 20.0}, scale=scale, discretisation=Discretisation(8, 9.0, 1e-4)
    )
    posterior = scene.model(options).posterior
    observed, rng = posterior.observation, np.random.default_rng(1)
    truth = posterior.space.draw_prior(rng, 1)
    parameters, rate = posterior.rating_parameters(truth), posterior.response(truth)
    effects = observed.new_effects(rng, parameters, (1,))
    made = observed.replicate(rng, observed.drive(rate, parameters), parameters, effects)[0]
    assert np.isfinite(observed.with_values(made).log_likelihood(rate, parameters)).all()
