"""What is left of a run after a file of its checkpoint was damaged, and what that costs."""

import pytest

from softness_bayes.base.errors import InputError
from softness_bayes.runs.checkpoint import Checkpoint
from softness_bayes.sampler.sampling import walk
from support.faults import named
from support.killable import SEED, WHAT, fake_posterior, same, settings

STEPS = 100


@pytest.fixture(scope="module")
def states():
    """The states of a short run."""
    return list(walk(fake_posterior(), settings(STEPS), SEED))


@pytest.fixture
def run(tmp_path, states):
    """A directory with every state of the run but the last."""
    with Checkpoint.create(tmp_path / "run") as checkpoint:
        checkpoint.begin(WHAT)
        for state in states[:-1]:
            checkpoint.keep(state, settings(STEPS), fake_posterior())
    return tmp_path / "run"


def cut(path):
    path.write_bytes(path.read_bytes()[:-100])


def flip(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def continued(directory):
    """Continue a run to its end; return what was said of damage, the state it began with and the last one."""
    with Checkpoint.open(directory, salvage=True) as checkpoint:
        said, begun = checkpoint.damage, checkpoint.begin(WHAT)
        for state in walk(fake_posterior(), settings(STEPS), SEED, begun):
            checkpoint.keep(state, settings(STEPS), fake_posterior())
    assert Checkpoint.open(directory, salvage=True).damage == ""
    return said, begun, state


@pytest.mark.parametrize("damage", [cut, flip, lambda path: path.unlink()], ids=["cut", "flip", "gone"])
@pytest.mark.parametrize("part", [-1, 0], ids=["last", "before"])
def test_a_run_goes_on_from_its_last_whole_state(run, states, part, damage):
    path, home = run / "checkpoint" / named(run)[part], run / "checkpoint"
    damage(path)
    before = {file.name: file.read_bytes() for file in home.iterdir()}
    opened = Checkpoint.open(run, salvage=True)
    assert {file.name: file.read_bytes() for file in home.iterdir()} == before  # looking changes nothing
    if part == 0 or not path.exists():  # the newest that is there is whole
        assert opened.damage == ""
    else:
        assert f"{path}: damaged or missing; the run continues from step {states[-3].steps}" in opened.damage
        assert "the last intact state: the steps after it are lost" in opened.damage
    said, begun, last = continued(run)
    assert said == opened.damage
    same(begun, states[-2 if part == 0 else -3])
    same(last, states[-1])


def test_where_nothing_is_whole_the_run_is_refused_by_name(run):
    for path in (run / "checkpoint").glob("state-*"):
        cut(path)
    with pytest.raises(InputError, match=r"state-\d+\.npz: damaged or missing; no intact state is left") as error:
        Checkpoint.open(run, salvage=True)
    assert all(str(path) in str(error.value) for path in (run / "checkpoint").glob("state-*"))


def test_the_last_two_states_are_kept_and_nothing_else(run):
    assert len(named(run)) == 2
    assert {path.name for path in (run / "checkpoint").iterdir()} == {*named(run), "lock"}
