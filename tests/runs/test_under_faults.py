"""Faults of every kind from a seeded list: the same draws or a refusal that names a file, never another state."""

import numpy as np
import pytest

from softness_bayes.base.errors import SoftnessError
from softness_bayes.runs.saved import saved_states
from softness_bayes.sampler.sampling import walk
from support.faults import STOPS, Killed, named, read_back, spoilt, stopped, written
from support.killable import SEED, fake_posterior, same, settings
from support.randomness import SEED as TEST_SEED

STEPS = 60


@pytest.fixture(scope="module")
def states():
    """The states of a short run, its end among them."""
    return list(walk(fake_posterior(), settings(STEPS), SEED))


@pytest.fixture(scope="module")
def run(tmp_path_factory, states):
    """A directory with all states but the last."""
    directory = tmp_path_factory.mktemp("faults") / "run"
    written(directory, states[:-1], STEPS)
    return directory


def place(state):
    return state.phase, state.steps, state.stride


def known(state, states):
    """Assert that a state is one of the run, bit by bit."""
    (one,) = (s for s in states if place(s) == place(state) and s.ended == state.ended)
    same(one, state)


def damaged(run, states, directory, random):
    """Damage some files: a state of the run is found and its loss told, or a damaged file is named."""
    done = spoilt(run, directory, random)
    state, said = read_back(directory)
    if state is None:
        assert str(directory) in said, done
        return "refused"
    known(state, states)
    if place(state) != place(states[-2]):
        if not said:  # without its newest file, a run is an earlier one
            assert ("gone", named(run)[-1]) in done
            return "whole"
        assert any(name in said for _, name in done), (done, said)
        assert "are lost" in said
        return "salvaged"
    return "whole"


def interrupted(how, states, directory, random):
    """Stop the writing of a run somewhere; what is found is a state of it, and the rest can be written."""
    room = int(random.integers(0, 3 * len(states)))
    try:
        with stopped(how, room):
            written(directory, states[:-1], STEPS)
        end = "whole"
    except Killed:
        end = "killed"
    except (OSError, SoftnessError) as error:
        end, told = "told", str(error)
    if end == "told":
        assert str(directory) in told  # says where
        assert not [*directory.rglob("*.part")]  # nothing is left over
    if saved_states(directory):
        state, said = read_back(directory)
        assert state is not None, said
        assert not said, said  # nothing was damaged
        known(state, states)
    written(directory, states[:-1], STEPS)
    state, said = read_back(directory)
    assert place(state) == place(states[-2])
    assert not said
    known(state, states)
    assert {path.name for path in (directory / "checkpoint").iterdir()} == {*named(directory), "lock"}
    return end


def inject(run, states, folder, seed, cases):
    """Make some faults happen; return how each ended."""
    random, ends = np.random.default_rng(seed), []
    for case in range(cases):
        directory, kind = folder / str(case), ("damage", *STOPS)[case % 4]
        if kind == "damage" or case % 8 == 6:
            ends.append(damaged(run, states, directory, random))
        else:
            ends.append(interrupted(kind, states, directory, random))
        if case % 25 == 0 and (state := read_back(directory)[0]) is not None:
            same(list(walk(fake_posterior(), settings(STEPS), SEED, state))[-1], states[-1])
    return ends


def test_thirty_faults_leave_the_same_draws_or_a_refusal(run, states, tmp_path):
    ends = inject(run, states, tmp_path, [TEST_SEED, 0], 30)
    assert {*ends} >= {"salvaged", "told", "killed"}  # else nothing happened


@pytest.mark.slow
@pytest.mark.parametrize("part", range(10))
def test_a_thousand_faults_leave_the_same_draws_or_a_refusal(run, states, tmp_path, part):
    ends = inject(run, states, tmp_path, [TEST_SEED, 1, part], 100)
    assert {*ends} >= {"salvaged", "told", "killed", "whole"}
