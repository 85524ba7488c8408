"""Psychometric functions of pairs against maximum likelihood and psignifit; what is wrong with comparisons."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import expit, ndtr, ndtri

from softness_bayes.base.errors import InputError
from softness_bayes.data import Ratings
from softness_bayes.likelihood.error_laws import NORMAL
from softness_bayes.likelihood.scales import PAIRS
from softness_bayes.model.options import ModelOptions
from softness_bayes.people.free_means import FreeMeans
from softness_bayes.people.psychometric import comparison_cautions, psychometric_table, threshold_sentences
from softness_bayes.touch.contact import Force

MODULUS = 100.0 * np.exp(np.linspace(-0.8, 0.8, 10))
NAMES = tuple(f"F{k}" for k in range(10))
TRIALS = 60


def table(won, first, second, who=None, people=("a",)):
    fabric = np.stack([first, second], axis=-1).ravel()
    rating = np.stack([won, ~won], axis=-1).ravel().astype(float)
    who = np.zeros(len(won), np.intp) if who is None else who
    lists = np.repeat(np.arange(len(won)), 2)
    return Ratings(people, NAMES, (Force(1.0),), np.repeat(who, 2), fabric, 0 * fabric, rating, lists + 2, lists=lists)


def constant_stimuli(rng, guess=0.03, lapse=0.05, reference=4, bias=0.1, width=0.3):
    """Return trials against one reference, which softer comparisons beat; and the counts behind them."""
    others = np.repeat(np.delete(np.arange(10), reference), TRIALS)
    x = np.log(MODULUS[others] / MODULUS[reference])
    won = rng.random(others.size) < guess + (1.0 - guess - lapse) * ndtr(-(x - bias) / width)
    return table(won, others, np.full(others.size, reference)), x, won


@pytest.mark.parametrize(("guess", "holds"), [(1.0 / 3.0, True), ("free", True), (None, False)])
def test_free_means_of_pairs_know_the_guess_rate(rng, guess, holds):
    """Differences from the reference on the probit scale; guesses that prefer no side are biased."""
    ratings, x, _ = constant_stimuli(rng, guess=1.0 / 3.0, lapse=0.0, width=0.5)
    found = FreeMeans(ratings, ModelOptions(scale=PAIRS, errors=NORMAL, guess=guess))
    apart = np.delete(found.means - found.means[:, [4]], 4, axis=1)
    truth = -(x.reshape(9, -1)[:, 0] - 0.1) / 0.5
    z = (apart.mean(axis=0) - truth) / apart.std(axis=0)
    assert (np.abs(z[truth < 0.5]).max() < 3.5) == holds, z


def test_a_guess_rate_needs_a_reference(rng):
    first, second = np.array([(a, b) for a in range(5) for b in range(a)]).T
    round_robin = table(first > second, first, second)
    with pytest.raises(InputError, match=r"--guess\) needs pairs of a comparison and a reference.* no references"):
        FreeMeans(round_robin, ModelOptions(scale=PAIRS, guess=0.5))
    with pytest.raises(InputError, match="a guess rate is one of pairs"):
        FreeMeans(replace(round_robin, lists=None), ModelOptions(guess=0.5))
    with pytest.raises(InputError, match="guess"):
        ModelOptions(scale=PAIRS, guess=1.5)


@pytest.mark.parametrize("guess", [None, 1.0 / 3.0])
def test_quantities_are_those_of_a_maximum_likelihood_fit(rng, guess):
    """An independent fit with the priors of guesses and lapses as penalty, its maximum inside the posterior."""
    ratings, x, won = constant_stimuli(rng, guess=0.03 if guess is None else guess)
    (row,) = psychometric_table(ratings, MODULUS, guess=guess).to_dict("records")

    def loss(point):
        low, high = (expit(point[2]) if guess is None else guess), expit(point[3])
        psi = low + (1.0 - low - high) * ndtr(-(x - point[0]) / np.exp(point[1]))
        prior = 9.0 * (np.log1p(-high) + (np.log1p(-low) if guess is None else 0.0))
        return -(np.log(np.where(won, psi, 1.0 - psi)).sum() + prior)

    best = minimize(loss, [0.0, -1.0, -3.0, -3.0], method="Nelder-Mead", options={"maxiter": 4000}).x
    equal, weber = MODULUS[4] * np.exp(best[0]), np.expm1(np.exp(best[1]) * ndtri(0.75))
    assert row["reference"] == "F4"
    assert row["pairs"] == 9 * TRIALS
    for name, value in (("equal", equal), ("weber", weber), ("bias", np.expm1(best[0]))):
        assert row[f"{name}_low"] < value < row[f"{name}_high"], name
        assert abs(row[name] - value) < 0.25 * (row[f"{name}_high"] - row[f"{name}_low"]), name
    # softer comparisons are told: the threshold lies on the softer side
    assert row["threshold"] == pytest.approx(row["equal"] / (1.0 + row["weber"]), rel=0.03)
    if guess is not None:
        assert row["guess_low"] == row["guess_high"] == pytest.approx(guess)
    assert (
        "against F4 at 1 N (540 pairs): judged equal at E_fab"
        in threshold_sentences(psychometric_table(ratings, MODULUS))[0]
    )


@pytest.mark.slow
def test_quantities_are_those_of_psignifit(rng):
    """Within a tenth of the interval, by medians; psignifit also samples overdispersion, which widens its intervals.

    In tables without overdispersion it finds a share of 0.05 to 0.11 all the same, by its prior: its intervals of the
    Weber fraction were 5 to 40 % wider than ours, and where most so its median was off by 0.09 of our interval.
    """
    psignifit = pytest.importorskip("psignifit")
    ratings, x, won = constant_stimuli(rng)
    (row,) = psychometric_table(ratings, MODULUS).to_dict("records")
    places, of = np.unique(-x, return_inverse=True)
    counts = np.stack([places, np.bincount(of, won), np.bincount(of)], axis=-1)
    how = {"experiment_type": "yes/no", "sigmoid": "norm", "estimate_type": "mean"}
    found = psignifit.psignifit(counts, **how)
    equal = MODULUS[4] * np.exp(-found.parameter_estimate["threshold"])
    assert abs(row["equal"] - equal) < 0.1 * (row["equal_high"] - row["equal_low"])
    width, mass = found.parameter_values["width"], np.asarray(found.marginal_posterior_values["width"])
    below = np.append(0.0, np.cumsum(0.5 * (mass[1:] + mass[:-1]) * np.diff(width)))
    low, weber, high = np.expm1(np.interp([0.05, 0.5, 0.95], below / below[-1], width) * ndtri(0.75) / ndtri(0.95) / 2)
    ours = row["weber_high"] - row["weber_low"]
    assert abs(row["weber"] - weber) < 0.1 * ours
    assert 0.6 * (high - low) < ours < 1.05 * (high - low)


@pytest.mark.slow
def test_intervals_cover_the_truth():
    """In 60 simulated tables of one reference, for what psychophysicists report."""
    inside = []
    for seed in range(60):
        ratings, _, _ = constant_stimuli(np.random.default_rng([7, seed]))
        (row,) = psychometric_table(ratings, MODULUS).to_dict("records")
        truth = {"equal": MODULUS[4] * np.exp(0.1), "weber": np.expm1(0.3 * ndtri(0.75)), "lapse": 0.05}
        inside.append([row[f"{name}_low"] <= value <= row[f"{name}_high"] for name, value in truth.items()])
    share = np.mean(inside, axis=0)
    assert (share > 0.78).all(), share


def test_a_round_robin_has_no_reference(rng):
    first, second = np.triu_indices(10, 1)
    assert psychometric_table(table(rng.random(45) < 0.5, first, second), MODULUS).empty


def test_the_chain_s_probabilities_take_the_place_of_answers(rng):
    """A chain twice as sharp as people has half their Weber fraction, whatever was answered."""
    ratings, x, won = constant_stimuli(rng, 0.0, 0.0)
    chance = ndtr(-(x - 0.1) / 0.15)
    (row,) = psychometric_table(ratings, MODULUS, np.where(won, chance, 1.0 - chance)).to_dict("records")
    assert row["weber"] == pytest.approx(np.expm1(0.15 * ndtri(0.75)), rel=0.15)


def test_sets_that_are_not_connected_and_answers_below_chance_are_said(rng):
    first, second = (np.tile(index, 8) for index in np.triu_indices(10, 1))
    who = np.repeat(np.arange(8), 45)
    won = first < second
    people = tuple("abcdefgh")
    assert comparison_cautions(table(won, first, second, who, people)) == []
    (said,) = comparison_cautions(table(won ^ (who == 3), first, second, who, people))
    assert said.startswith("d answers below chance: with the majority of all other answers in 0 of 45 pairs")
    apart = (first < 5) == (second < 5)
    (said,) = comparison_cautions(table(won[apart], first[apart], second[apart], who[apart], people))
    assert "2 sets that are not connected" in said
