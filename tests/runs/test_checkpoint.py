"""What a checkpoint survives: kills, full disks, a second process, other data; and what a continued run draws."""

import errno
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from softness_bayes.base.errors import InputError, LockedError
from softness_bayes.base.files.lock import Lock, is_held
from softness_bayes.base.files.outputs import write_outputs
from softness_bayes.runs import checkpoint as storage
from softness_bayes.runs.checkpoint import Checkpoint
from softness_bayes.runs.saved import read_status, saved_states, state_path
from softness_bayes.sampler.sampling import walk
from softness_bayes.sampler.target import Failure, Nonfinite
from support.killable import SEED, WHAT, follow, same, settings
from support.killable import fake_posterior as posterior_of_the_fake
from support.paths import ROOT

STEPS = 220


def start(directory, steps=STEPS, processes=1, pause=0.001):
    """Start a run in a process of its own, and wait until it walks."""
    arguments = [sys.executable, "-m", "support.killable", directory, steps, processes, pause]
    process = subprocess.Popen([*map(str, arguments)], stdout=subprocess.PIPE, text=True, cwd=ROOT / "tests")
    return process, process.stdout.readline()


def kill(process):
    process.kill()
    process.communicate()


@pytest.fixture(scope="module")
def states():
    """Every state of an uninterrupted run, which thins what it stores on the way."""
    found = list(walk(posterior_of_the_fake(), settings(STEPS), SEED))
    found = [s for s in found if s.phase > 1 or not s.steps]  # a busy machine yields more states
    assert found[-1].ended
    assert found[-1].stride > 1
    assert [s.phase for s in found[:3]] == [0, 1, 2]
    return found


def keep(directory, kept, target=None):
    """Keep states in a new checkpoint."""
    target = target or posterior_of_the_fake()
    with Checkpoint.create(directory) as checkpoint:
        assert checkpoint.begin(WHAT) is None
        for state in kept:
            checkpoint.keep(state, settings(STEPS), target)


def load(directory, what=WHAT):
    with Checkpoint.open(directory) as checkpoint:
        return checkpoint.begin(what)


# kills


def killed_at_random(directory, times, pause, steps):
    """Kill a run that many times at random instants; return its last state."""
    rng = np.random.default_rng()
    hit = 0
    for _ in range(times):
        process, said = start(directory, steps, pause=pause)
        try:
            process.wait(timeout=rng.uniform(0.0, 0.4))
        except subprocess.TimeoutExpired:
            hit += 1
        kill(process)
        assert said.startswith("walking")
    assert hit >= times / 2
    return list(follow(directory, steps))[-1]


def test_a_run_killed_twice_draws_what_an_uninterrupted_one_draws(tmp_path, states):
    same(killed_at_random(tmp_path / "run", 2, 0.002, STEPS), states[-1])


@pytest.mark.slow
def test_a_run_killed_fifty_times_draws_what_an_uninterrupted_one_draws(tmp_path):
    end = list(walk(posterior_of_the_fake(), settings(2500), SEED))[-1]
    same(killed_at_random(tmp_path / "run", 50, 0.003, 2500), end)


def test_workers_end_with_a_killed_parent(tmp_path):
    if not Path("/proc").is_dir():
        pytest.skip("looks at processes by /proc")
    process, said = start(tmp_path / "run", steps=100_000, processes=2)
    workers = [int(number) for number in said.split()[1:]]
    assert len(workers) == 2
    assert all(alive(worker) for worker in workers)
    kill(process)
    for _ in range(200):
        if not any(alive(worker) for worker in workers):
            break
        time.sleep(0.05)
    assert not any(alive(worker) for worker in workers)
    # nor does any of them still hold the lock
    assert not is_held(tmp_path / "run" / "checkpoint" / "lock")


def alive(number):
    try:
        return Path(f"/proc/{number}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_where_the_density_failed_is_kept_beside_the_results(tmp_path, states):
    target = posterior_of_the_fake()
    point = tuple(target.space.coordinates(target.space.median).tolist())
    failed = Nonfinite(5000, 3, (Failure(point, "response"), Failure(point, "alpha is, as it were, beyond")))
    keep(tmp_path, [states[0], replace(states[1], nonfinite=failed)])
    lines = (tmp_path / "nonfinite.csv").read_text().splitlines()
    assert lines[0] == "stage," + ",".join(target.names)
    np.testing.assert_allclose([float(x) for x in lines[1].split(",")[1:]], target.space.median)
    assert lines[2].startswith('"alpha is, as it were, beyond",')
    assert load(tmp_path).nonfinite == failed
    assert read_status(tmp_path).failures == 3


# one process at a time


def test_a_second_process_is_refused_and_a_dead_one_blocks_nobody(tmp_path):
    process, _ = start(tmp_path / "run", steps=100_000)
    try:
        assert read_status(tmp_path / "run").running
        with pytest.raises(LockedError, match=rf"another run is using it \(process {process.pid}\)"):
            load(tmp_path / "run")
        with pytest.raises(LockedError):
            Checkpoint.create(tmp_path / "run", replace=True)
        assert process.poll() is None
    finally:
        process.send_signal(signal.SIGKILL)
        process.communicate()
    assert not read_status(tmp_path / "run").running
    assert load(tmp_path / "run") is not None


def test_a_lock_is_held_once_and_asking_leaves_no_trace(tmp_path):
    path = tmp_path / "lock"
    assert not is_held(path)
    assert not path.exists()
    path.write_text("123")  # of an earlier process, without its last line break
    with Lock(path):
        before = path.read_bytes(), path.stat().st_mtime_ns
        assert all(is_held(path) for _ in range(100))
        assert (path.read_bytes(), path.stat().st_mtime_ns) == before
        with pytest.raises(LockedError), Lock(path):
            pass
        assert is_held(path)
    assert not is_held(path)
    with Lock(path) as lock:
        lock.vanish()
        with Lock(path):  # another file of that name
            assert is_held(path)


# what is refused, and what is left


def test_a_run_that_was_begun_with_something_else_is_refused_by_name(tmp_path, states):
    keep(tmp_path, states[:4])
    with pytest.raises(InputError, match=r"begun with model the fake scene \(now another\); continue it"):
        load(tmp_path, {"model": "another"})
    with pytest.raises(InputError, match=r"begun with seed not given \(now 3\)"):
        load(tmp_path, {**WHAT, "seed": "3"})
    same(load(tmp_path), states[3])  # which harmed nothing


def flipped(content, rng):
    """Return some bytes with one of their bits the other way round."""
    found = bytearray(content)
    found[rng.integers(len(found))] ^= 1 << rng.integers(8)
    return bytes(found)


def test_no_flipped_bit_of_a_checkpoint_is_taken_for_the_run(tmp_path, states, rng):
    keep(tmp_path, states[:6])
    path = state_path(tmp_path, saved_states(tmp_path)[-1])
    whole, status, sound = path.read_bytes(), read_status(tmp_path), 0
    for _ in range(50):
        path.write_bytes(flipped(whole, rng))
        with pytest.raises(InputError, match=path.name):
            load(tmp_path)
        try:  # the status is read without the arrays
            assert repr(read_status(tmp_path)) == repr(status)
            sound += 1
        except InputError:
            continue
    assert 0 < sound <= 50
    path.write_bytes(whole)
    same(load(tmp_path), states[5])


def test_a_run_that_keeps_nothing_leaves_nothing(tmp_path):
    with Checkpoint.create(tmp_path / "a" / "b") as checkpoint:
        assert (tmp_path / "a" / "b").is_dir()
        assert checkpoint.status is None
        assert read_status(tmp_path / "a" / "b").running
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match="no run to continue"):
        Checkpoint.open(tmp_path)
    with pytest.raises(InputError, match="no run to continue"):
        read_status(tmp_path / "nowhere")


def test_an_earlier_run_goes_when_the_new_one_has_begun(tmp_path, states):
    keep(tmp_path, states[:4])
    write_outputs(tmp_path, {"posterior.nc": b"old"}, "sample")
    write_outputs(tmp_path / "figures", {"a.png": b"old"}, "plot")
    with pytest.raises(InputError, match="'softness-bayes resume' to continue its run, --force to replace it"):
        Checkpoint.create(tmp_path)
    with Checkpoint.create(tmp_path, replace=True) as checkpoint:
        checkpoint.begin(WHAT)
        assert (tmp_path / "posterior.nc").exists()
    same(load(tmp_path), states[3])  # it had not begun
    with Checkpoint.create(tmp_path, replace=True) as checkpoint:
        checkpoint.begin(WHAT)
        checkpoint.keep(states[0], settings(STEPS), posterior_of_the_fake())
        assert [path.name for path in tmp_path.iterdir()] == ["checkpoint"]
    same(load(tmp_path), states[0])


PART = f".softness-bayes-{'0' * 32}.part"


def test_an_interrupt_before_the_first_state_leaves_nothing(tmp_path):
    with Checkpoint.create(tmp_path / "run") as checkpoint:
        (tmp_path / "run" / "checkpoint" / PART).write_bytes(b"half a state")
        checkpoint.leave()  # as a thread does that ends the process
        assert not (tmp_path / "run").exists()
    assert not (tmp_path / "run").exists()


def test_no_room_for_the_first_state_leaves_nothing(tmp_path, states, monkeypatch):

    def full(path, content):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

    monkeypatch.setattr(storage, "write_whole", full)
    with pytest.raises(OSError, match="No space left"):
        keep(tmp_path / "run", states[:1])
    assert list(tmp_path.iterdir()) == []
    # nor does a run that was killed there stand in the way of another
    (tmp_path / "run" / "checkpoint").mkdir(parents=True)
    (tmp_path / "run" / "checkpoint" / PART).write_bytes(b"half")
    monkeypatch.undo()
    keep(tmp_path / "run", states[:1])
    same(load(tmp_path / "run"), states[0])
    assert len([*(tmp_path / "run" / "checkpoint").iterdir()]) == 2


def test_the_status_is_what_was_kept(tmp_path, states):
    keep(tmp_path, states[:1])
    assert read_status(tmp_path).piloting
    with Checkpoint.open(tmp_path) as checkpoint:
        checkpoint.begin(WHAT)
        for state in states[1:]:
            checkpoint.keep(state, settings(STEPS), posterior_of_the_fake())
        status = read_status(tmp_path)
        assert (status.running, status.piloting, status.ended, status.written) == (True, False, True, False)
        assert (status.steps, status.missing, status.max_steps) == (STEPS, 0, STEPS)
        assert status.verdict.sentence() == states[-1].verdict.sentence()
        checkpoint.finish()
    status = read_status(tmp_path)
    assert (status.running, status.written) == (False, True)


def test_a_file_in_the_place_of_the_directory_is_named(tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(InputError, match=r"thesis\.txt: is a file, expected a directory for the results"):
        Checkpoint.create(tmp_path / "thesis.txt")
