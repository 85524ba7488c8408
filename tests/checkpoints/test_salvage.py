"""What is left of a run after a file of its checkpoint was damaged, and what that costs."""

import json

import pytest

from softness_bayes.checkpoints import checkpoint as storage
from softness_bayes.checkpoints.checkpoint import Checkpoint
from softness_bayes.checkpoints.manifest import MOST_EARLIER, EarlierState, kept_states, read_manifest
from softness_bayes.errors import InputError, LockedError
from softness_bayes.files.lock import Lock
from softness_bayes.sampler.sampling import walk
from support.killable import SEED, WHAT, fake_posterior, settings

STEPS = 100


@pytest.fixture(scope="module")
def states():
    """The states of a short run."""
    return list(walk(fake_posterior(), settings(STEPS), SEED))


@pytest.fixture
def run(tmp_path, states, monkeypatch):
    """A directory with every state of the run but the last."""
    monkeypatch.setattr(storage, "INTERVAL", 0.0)
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


def same_draws(one, other):
    assert one.steps == other.steps
    assert (one.chains.coordinates == other.chains.coordinates).all()
    assert (one.chains.log_density == other.chains.log_density).all()


@pytest.mark.parametrize("damage", [cut, flip, lambda path: path.unlink()], ids=["cut", "flip", "gone"])
@pytest.mark.parametrize("part", ["manifest.json", "arrays", "last piece", "second piece", "first piece"])
def test_a_run_goes_on_from_its_last_whole_state(run, states, part, damage):
    kept, home = read_manifest(run), run / "checkpoint"
    pieces = kept["pieces"]
    assert len(pieces) > 2
    lost = {"second piece": pieces[1], "first piece": pieces[0], "last piece": pieces[-1], "arrays": kept["arrays"]}
    path = home / lost.get(part, part)
    damage(path)
    before = {file.name: file.read_bytes() for file in home.iterdir()}
    opened = Checkpoint.open(run, salvage=True)
    assert {file.name: file.read_bytes() for file in home.iterdir()} == before  # looking changes nothing
    assert str(path) in opened.damage
    reached, left = kept["status"]["steps"], opened.status.steps
    assert f"continues from step {left}" in opened.damage
    if part == "first piece":  # of the last stage nothing is left, of the one before all
        assert opened.status.phase < kept["status"]["phase"]
        assert f"the last intact state: {reached} steps of a later stage are lost" in opened.damage
    else:
        assert f": {reached - left} steps are lost" in opened.damage
        assert (reached == left) == (part == "manifest.json")
    said, begun, last = continued(run)
    assert said == opened.damage
    assert begun.steps == left
    same_draws(last, states[-1])


def test_several_damaged_files_cost_as_much_as_the_worst(run, states):
    kept, home = read_manifest(run), run / "checkpoint"
    earlier = next(name for name, pieces in reversed(kept["earlier"]) if kept["pieces"][-1] not in pieces)
    for name in (kept["pieces"][-1], earlier, "manifest.json"):
        flip(home / name)
    said, _, last = continued(run)
    assert all(name in said for name in (kept["pieces"][-1], earlier, "manifest.json"))
    same_draws(last, states[-1])


def test_where_nothing_is_whole_the_run_is_refused_by_name(run):
    home = run / "checkpoint"
    for path in home.glob("state-*"):
        flip(path)
    with pytest.raises(InputError, match=r"state-\d+\.npz: damaged or missing; no intact state is left") as error:
        Checkpoint.open(run, salvage=True)
    assert str(home / read_manifest(run)["arrays"]) in str(error.value)
    for name in ("manifest.json", "manifest-copy.json"):
        cut(home / name)
    with pytest.raises(InputError, match=r"manifest\.json: not a manifest"):
        Checkpoint.open(run, salvage=True)


def test_a_run_that_another_process_holds_is_not_looked_at(run):
    flip(run / "checkpoint" / "manifest.json")
    with Lock(run / "checkpoint" / "lock"), pytest.raises(LockedError):
        Checkpoint.open(run, salvage=True)


def test_few_earlier_states_are_kept():
    earlier, pieces = [], []
    for k in range(100):
        before, pieces = pieces, [f"piece-{k}"] if k in (10, 60) else [*pieces, f"piece-{k}"] if k else []
        if k:
            earlier = kept_states([*earlier, EarlierState(f"state-{k - 1}", before)], pieces)
        own = [one for one in earlier if one.pieces[:1] == pieces[:1]]
        assert len(own) <= MOST_EARLIER
        assert len(earlier) <= len(own) + 2
        assert all(one.pieces == pieces[: len(one.pieces)] for one in own)
        if k:
            assert earlier[0] == EarlierState("state-0", [])
        if k > 60:  # the first with these pieces, and the last with the ones before
            assert own[0].arrays == "state-60"
            assert earlier[1].arrays == "state-59"


def test_the_copy_is_that_of_the_manifest_and_every_file_is_named(run):
    home = run / "checkpoint"
    assert (home / "manifest-copy.json").read_bytes() == (home / "manifest.json").read_bytes()
    named = {*json.loads((home / "manifest.json").read_bytes())["digests"]}
    assert {path.name for path in home.iterdir()} == {*named, "manifest.json", "manifest-copy.json", "lock"}
