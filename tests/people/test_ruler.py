"""People's answer in words, and how much of it a chain keeps: one that is right, one that is flat, one reversed."""

import re

import numpy as np
import pandas as pd
import pytest

from softness_bayes.checking.provenance import DirectionTaken
from softness_bayes.likelihood.contract import Parameters
from softness_bayes.likelihood.design import Design
from softness_bayes.likelihood.magnitude import LogRatings, RatingModel
from softness_bayes.likelihood.scales import MAGNITUDE, PAIRS, RISES
from softness_bayes.people.free_means import FreeMeans, word_of
from softness_bayes.people.ruler import UNKNOWN, Fit, following, ruler
from softness_bayes.people.sentences import (
    highest_sentences,
    needed_sentences,
    pairs_sentence,
    ruler_sentence,
    untestable_sentence,
)
from softness_bayes.report.conclusion import Facts, conclude
from support.laboratories import FABRICS, RATERS, laboratory

FALLING = np.log(np.outer(np.geomspace(8.0, 0.6, 5), (1.0, 1.3)))
"""Log means that fall steadily with stiffness, as no chain with a threshold repeats them."""


@pytest.fixture(scope="module")
def falling():
    made = laboratory("normal", np.random.default_rng(4), FALLING)
    return made, FreeMeans(made.ratings, made.options)


def chain_density(ratings, means):
    """Return the density of each left-out rating under a chain that predicts these log means, (fabrics, loads).

    Its noise takes up what it misses.
    """
    fabric = np.repeat(np.arange(len(FABRICS)), 2)
    design = Design(ratings.fabric * 2 + ratings.load, ratings.participant, fabric, len(RATERS))
    noise = np.hypot(0.3, np.std(FALLING - means))
    given = Parameters(gamma=1.0, eps=0.0, tau=0.5, varsigma=noise, omega=0.0)
    return LogRatings(ratings.rating, design, RatingModel()).left_out(np.exp(means.ravel()), given).log_density


def test_a_chain_that_is_right_keeps_all_and_a_flat_one_nothing(falling):
    made, found = falling
    right, flat = FALLING, np.tile(FALLING.mean(axis=0), (5, 1))
    whole, nothing, half = (
        ruler(found, chain_density(made.ratings, means), 20.0 * np.exp(means[found.fabric, found.load]))
        for means in (right, flat, 0.5 * (right + flat))
    )
    assert whole["value"]["share"] == pytest.approx(1.0, abs=0.05)
    assert following(whole).keeps is not False
    assert whole["value"]["misfit"] < 0.1
    assert nothing["value"]["share"] == pytest.approx(0.0, abs=0.05)
    assert following(nothing) == (False, True)
    low, share, high = half.loc["share", ["low", "value", "high"]]
    assert 0.1 < share < 0.9
    assert low < share < high
    assert half["value"]["misfit"] == pytest.approx(np.std((right - flat) / 2.0), rel=0.3)


def test_as_many_free_moduli_as_means_are_no_test():
    told = Fit(DirectionTaken(RISES), UNKNOWN, free_moduli=16, means=16)
    assert "tests nothing: 16 moduli are free to follow 16 mean ratings" in untestable_sentence(told)
    assert untestable_sentence(told._replace(free_moduli=15)) == ""


def test_a_reversed_chain_loses_more_than_all(falling):
    made, found = falling
    reverse = 2.0 * FALLING.mean(axis=0) - FALLING
    assert ruler(found, chain_density(made.ratings, reverse), np.ones(10))["value"]["share"] < 0.0


def test_without_differences_there_is_nothing_to_keep():
    made = laboratory("normal", np.random.default_rng(5), np.zeros((5, 2)))
    found = FreeMeans(made.ratings, made.options)
    one = ruler(found, np.zeros(made.ratings.rating.size), np.full(10, 20.0))
    assert np.isnan(one["value"]["share"])
    assert following(one) == UNKNOWN
    table = pd.DataFrame({"value": [np.nan, 0.1], "low": np.nan, "high": np.nan}, index=["share", "misfit"])
    assert "do not tell the fabrics apart" in ruler_sentence(table, MAGNITUDE)


def test_people_s_order_is_said_first_and_whole(falling):
    """On ratings that fall steadily all pairs are decided, and the closing lines begin with who is highest."""
    _, found = falling
    said = highest_sentences(found.table(), found.word, found.scale)
    assert [line.startswith("A is the highest rated at ") for line in said] == [True, True]
    assert "the lowest mean is that of E" in said[0]
    assert pairs_sentence(found.loads, found.p_orders).startswith("10 of 10 pairs of fabrics at 1 mm, 10 of 10 at ")
    table = pd.DataFrame([[0.57, 0.46, 0.67], [0.3, np.nan, np.nan]], ["share", "misfit"], ["value", "low", "high"])
    kept = ruler_sentence(table, MAGNITUDE)
    assert "keeps 57 % (90 % interval 46 % to 67 %)" in kept
    assert "a factor of 1.35" in kept
    assert "the chain keeps all of it;" in ruler_sentence(table + 0.6, MAGNITUDE)
    lines = conclude(Facts(True, 100, people=(*said, kept))).lines
    assert lines[0] == f"People:    {said[0]}"
    assert lines[3].startswith("Trust it?")


def test_a_chain_of_pairs_that_is_right_keeps_all():
    """Errors are clustered by the two fabrics, whichever of them won: by winner there would be none to keep."""
    made = laboratory("pairs", np.random.default_rng(8), FALLING)
    found = FreeMeans(made.ratings, made.options)
    assert np.unique(found.cluster).size == 10
    right = ruler(found, found.log_density, found.rating.mean(axis=0))
    assert right["value"]["share"] == pytest.approx(1.0)
    (line, _) = highest_sentences(found.table(), found.word, found.scale)
    assert line.startswith("A is the softest at 1 mm (probability ")
    assert " of those it met are below it; the lowest mean is that of E" in line


def test_fabrics_that_people_do_not_tell_apart_are_not_ordered():
    made = laboratory("normal", np.random.default_rng(6), np.zeros((5, 2)))
    found = FreeMeans(made.ratings, made.options)
    (line, _) = highest_sentences(found.table(), found.word, found.scale)
    assert line.startswith("the highest rated at 1 mm is ")
    assert re.search(r" [A-E] \([0-9]+ %\) or [A-E] \([0-9]+ %\)", line)
    assert not pairs_sentence(found.loads, found.p_orders).startswith("10 of 10")


@pytest.mark.parametrize(
    ("title", "scale", "word"),
    [
        ("softness", MAGNITUDE, "softest"),
        ("hardness_rating", MAGNITUDE, "hardest"),
        ("rating", MAGNITUDE, "highest rated"),
        ("rating", PAIRS, "softest"),
    ],
)
def test_the_word_for_the_highest_is_the_table_s(title, scale, word):
    assert word_of(title, scale) == word


def test_what_has_to_be_measured_names_no_invented_number():
    lines = needed_sentences(FABRICS, False)
    assert "force_n" in lines[1]
    assert not any(character.isdigit() for line in lines for character in line)
    assert not any("force_n" in line for line in needed_sentences(FABRICS, True))
