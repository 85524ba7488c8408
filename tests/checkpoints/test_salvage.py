"""What is left of a run after a file of its checkpoint was damaged, and what that costs."""

import pytest

from softness_bayes.checkpoints import checkpoint as storage
from softness_bayes.checkpoints.checkpoint import Checkpoint
from softness_bayes.checkpoints.manifest import read_manifest
from softness_bayes.errors import InputError, LockedError
from softness_bayes.files.lock import Lock
from softness_bayes.sampler.sampling import walk
from support.faults import named
from support.killable import SEED, WHAT, fake_posterior, same, settings

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


@pytest.mark.parametrize("damage", [cut, flip, lambda path: path.unlink()], ids=["cut", "flip", "gone"])
@pytest.mark.parametrize("part", ["manifest.json", "last", "second", "first"])
def test_a_run_goes_on_from_its_last_whole_state(run, states, part, damage):
    manifest, home = read_manifest(run), run / "checkpoint"
    files = [name for name, _ in manifest["files"]]
    assert len(files) > 2
    path = home / {"second": files[1], "first": files[0], "last": files[-1]}.get(part, part)
    damage(path)
    before = {file.name: file.read_bytes() for file in home.iterdir()}
    opened = Checkpoint.open(run, salvage=True)
    assert {file.name: file.read_bytes() for file in home.iterdir()} == before  # looking changes nothing
    assert str(path) in opened.damage
    reached, left = manifest["status"]["steps"], opened.status.steps
    assert f"continues from step {left}" in opened.damage
    if part == "first":  # of the last stage nothing is left, of the one before all
        assert opened.status.phase < manifest["status"]["phase"]
        assert f"the last intact state: {reached} steps of a later stage are lost" in opened.damage
    else:
        assert f": {reached - left} steps are lost" in opened.damage
        assert (reached == left) == (part == "manifest.json")
    said, begun, last = continued(run)
    assert said == opened.damage
    assert begun.steps == left
    same(last, states[-1])


def test_several_damaged_files_cost_as_much_as_the_worst(run, states):
    names, home = named(run), run / "checkpoint"
    for name in (names[-1], names[-3], "manifest.json"):
        flip(home / name)
    said, begun, last = continued(run)
    assert all(name in said for name in (names[-1], names[-3], "manifest.json"))
    assert f"continues from step {begun.steps}, the last intact state: the steps after it are lost" in said
    same(last, states[-1])


def test_where_nothing_is_whole_the_run_is_refused_by_name(run):
    home = run / "checkpoint"
    first = read_manifest(run)["files"][0][0]
    for path in home.glob("state-*"):
        cut(path)
    with pytest.raises(InputError, match=r"state-\d+\.npz: damaged or missing; no intact state is left") as error:
        Checkpoint.open(run, salvage=True)
    assert str(home / first) in str(error.value)
    cut(home / "manifest.json")
    with pytest.raises(InputError, match=r"manifest\.json: not a manifest"):
        Checkpoint.open(run, salvage=True)


def test_a_run_that_another_process_holds_is_not_looked_at(run):
    flip(run / "checkpoint" / "manifest.json")
    with Lock(run / "checkpoint" / "lock"), pytest.raises(LockedError):
        Checkpoint.open(run, salvage=True)


def test_every_file_is_named(run):
    assert {path.name for path in (run / "checkpoint").iterdir()} == {*named(run), "manifest.json", "lock"}
