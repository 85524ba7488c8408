"""Verdicts on pairs: by people where they decided, by the chain only within its reach, otherwise none."""

import numpy as np
import pytest

from softness_bayes.results.ranking import REASONS, decided_sentence, verdicts

NONE = np.full((3, 3), np.nan)
SURE = np.array([[0.0, 0.99, 0.99], [0.01, 0.0, 0.99], [0.01, 0.01, 0.0]])
FREE = [np.zeros(3, bool)] * 4


def because(reason):
    """The reasons of the three pairs, in words."""
    return [REASONS[k] for k in reason[np.triu_indices(3, 1)]]


def test_people_decide_what_the_chain_ties():
    higher, reason = verdicts(SURE, np.zeros((3, 3)), [np.ones(3, bool), *FREE[1:]], True)
    assert higher.tolist() == [[0, 1, 1], [-1, 0, 1], [-1, -1, 0]]
    assert decided_sentence(because(reason)) == "3 of 3 pairs of fabrics are decided (3 by people's own ratings)"


def test_the_chain_speaks_of_others_and_never_against_people():
    people = NONE.copy()
    people[0, 1], people[1, 0] = 0.6, 0.4  # rated, and not decided
    higher, reason = verdicts(people, SURE, FREE, False)
    assert higher[0].tolist() == [0, 0, 1]
    assert because(reason)[:2] == [REASONS[-1], REASONS[1]]


@pytest.mark.parametrize("k", range(4))
def test_beyond_its_reach_the_chain_cannot_decide(k):
    barred = [*FREE]
    barred[k] = np.array([False, False, True])
    higher, reason = verdicts(NONE, SURE, barred, False)
    assert higher.tolist() == [[0, 1, 0], [-1, 0, 0], [0, 0, 0]]
    assert sorted(because(reason)) == sorted([REASONS[1], REASONS[2 + k], REASONS[2 + k]])
    assert f"2 because {REASONS[2 + k]}" in decided_sentence(because(reason))


def test_nothing_rests_on_a_rejected_chain():
    higher, reason = verdicts(NONE, SURE, FREE, True)
    assert not higher.any()
    assert decided_sentence(because(reason)).startswith(
        "0 of 3 pairs of fabrics are decided; 3 pairs are not: 3 because the chain"
    )
