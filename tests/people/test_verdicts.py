"""Verdicts on pairs: by people where they decided, by the chain only within its reach, otherwise none."""

import numpy as np
import pytest

from softness_bayes.people.verdicts import REASONS, decided_sentence, verdicts

NONE = np.full((3, 3), np.nan)
SURE = np.array([[0.0, 0.99, 0.99], [0.01, 0.0, 0.99], [0.01, 0.01, 0.0]])
FREE = [np.zeros(3, bool)] * 4


def test_people_decide_what_the_chain_ties():
    flat = verdicts(SURE, np.zeros((3, 3)), [np.ones(3, bool), *FREE[1:]], True)
    assert flat.higher.tolist() == [[0, 1, 1], [-1, 0, 1], [-1, -1, 0]]
    assert flat.counts[0] == 3
    assert decided_sentence([flat]) == "3 of 3 pairs of fabrics are decided (3 by people's own ratings)"


def test_the_chain_speaks_of_others_and_never_against_people():
    people = NONE.copy()
    people[0, 1], people[1, 0] = 0.6, 0.4  # rated, and not decided
    found = verdicts(people, SURE, FREE, False)
    assert found.higher[0].tolist() == [0, 0, 1]
    assert found.reasons(np.array([0, 0]), np.array([1, 2])).tolist() == [REASONS[-1], REASONS[1]]


@pytest.mark.parametrize("k", range(4))
def test_beyond_its_reach_the_chain_cannot_decide(k):
    barred = [*FREE]
    barred[k] = np.array([False, False, True])
    found = verdicts(NONE, SURE, barred, False)
    assert found.higher.tolist() == [[0, 1, 0], [-1, 0, 0], [0, 0, 0]]
    assert found.counts.tolist() == [0, 1, *(2 * (j == k) for j in range(4)), 0, 0]
    assert f"2 because {REASONS[2 + k]}" in decided_sentence([found])


def test_nothing_rests_on_a_rejected_chain():
    found = verdicts(NONE, SURE, FREE, True)
    assert not found.higher.any()
    assert decided_sentence([found]).startswith(
        "0 of 3 pairs of fabrics are decided; 3 pairs are not: 3 because the chain"
    )


@pytest.mark.parametrize(
    ("word", "first"), [("softest", "softer"), ("hardest", "harder"), ("highest rated", "rated higher")]
)
def test_words_follow_the_scale(word, first):
    found = verdicts(SURE, SURE, FREE, False)
    assert found.words(np.array([0, 2]), np.array([1, 2]), word).tolist() == [first, "cannot decide"]
