"""One way to run many: executors give the same draws, clusters that cannot be used are refused, the killed go on."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor

import numpy as np
import pytest

from softness_bayes.base.errors import InputError, WorkersLostError
from softness_bayes.checking.provenance import versions
from softness_bayes.claims import TOUCHES, evaluate_claims
from softness_bayes.claims.report import claims_table
from softness_bayes.runs import cluster as clusters
from softness_bayes.runs.cluster import SCHEDULER, Worker, cluster, require_workers, strangers
from softness_bayes.runs.rank_table import RANKS, read_replicates
from softness_bayes.sampler.workers import Workers
from softness_bayes.touch.readings import NAMED_READINGS
from support.command_line import call, refused
from support.paths import ROOT

# executors


def add(resident, number):
    return resident + number


class Shared(ThreadPoolExecutor):
    """An executor that counts what it is given to share, and has a handle for it."""

    def __init__(self):
        super().__init__(2)
        self.shared = []

    def share(self, value):
        self.shared.append(value)
        return ("handle", len(self.shared) - 1)

    def submit(self, work, /, *task):
        values = (self.shared[a[1]] if isinstance(a, tuple) and a[:1] == ("handle",) else a for a in task)
        return super().submit(work, *values)


def test_workers_on_an_executor():
    """Which share their resident once, and leave it open."""
    tasks = [(k,) for k in range(9)]
    with Shared() as executor:
        with Workers(3, 4, executor) as workers:
            assert workers.map(add, tasks) == [3 + k for k in range(9)]
            assert sorted(workers.as_finished(add, tasks)) == [3 + k for k in range(9)]
        assert executor.shared == [3]
        assert executor.submit(add, 1, 2).result() == 3


def fails(resident, number):
    if number == 2:
        raise InputError("no")
    return number


def test_a_failed_task_ends_the_rest():
    with (
        ThreadPoolExecutor(1) as executor,
        Workers(None, 1, executor) as workers,
        pytest.raises(InputError, match="no"),
    ):
        workers.map(fails, [(k,) for k in range(9)])


class Broken(Executor):
    """An executor whose workers have died, before or after the task came."""

    def __init__(self, at_once):
        self.at_once = at_once

    def submit(self, work, /, *task):
        if self.at_once:
            raise BrokenExecutor
        future = Future()
        future.set_exception(BrokenExecutor())
        return future


@pytest.mark.parametrize("at_once", [True, False])
def test_a_broken_executor(at_once):
    with Workers(3, 1, Broken(at_once)) as workers, pytest.raises(WorkersLostError, match="lost its workers"):
        workers.map(add, [(1,)])


def test_equal_data_are_sent_under_one_key():
    """Of the content, not of the object: the scheduler keeps a value that is sent again, by this or another command."""
    sent = {}

    class Client:
        def get_executor(self, pure):
            return self

        def submit(self, work, content, key):
            sent.setdefault(key, []).append(work(content))
            return key

    one, other = (clusters.Cluster(Client()) for _ in range(2))
    ratings = np.arange(3.0)
    assert one.share(ratings) == one.share(ratings.copy()) == other.share(ratings.copy())
    assert one.share(ratings + 1e-12) != one.share(ratings)
    assert len(sent) == 2
    np.testing.assert_array_equal(next(iter(sent.values()))[0], ratings)


def test_claims_on_an_executor():
    touches = {"indentation": TOUCHES["indentation"][:1]}
    readings = {name: NAMED_READINGS[name] for name in ("mended", "hertz")}
    here = claims_table(evaluate_claims(readings, ["default"], touches, draws=0))
    with ThreadPoolExecutor(2) as executor:
        there = claims_table(evaluate_claims(readings, ["default"], touches, draws=0, executor=executor))
    assert there.equals(here)


# clusters that cannot be used

GOOD = Worker(versions(), True, 1)


@pytest.mark.parametrize(
    ("found", "said"),
    [
        ({}, "has no workers"),
        ({"tcp://b": GOOD._replace(versions={**versions(), "version_numpy": "1.0"})}, "b has numpy 1.0"),
        ({"tcp://b": ModuleNotFoundError("softness_bayes")}, "b cannot run softness-bayes"),
        ({"tcp://a": GOOD._replace(threads=4)}, "a has 4 threads"),
        ({SCHEDULER: Worker({}, True, 1), "tcp://a": GOOD}, "the scheduler itself has python None"),
        ({f"tcp://{k}": GOOD._replace(threads=2) for k in range(5)}, "and 2 more"),
    ],
)
def test_workers_that_are_refused(found, said):
    with pytest.raises(InputError, match=said):
        require_workers("tcp://s", found)


def test_workers_that_are_not_refused():
    require_workers("tcp://s", {"tcp://a": GOOD, "tcp://b": GOOD})
    apart = {"tcp://a": GOOD, "tcp://b": GOOD._replace(shares=False)}
    require_workers("tcp://s", apart)
    assert strangers(apart) == ["tcp://b"]


def test_without_dask(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"softness-bayes\[dask\]"), cluster("tcp://127.0.0.1:1"):
        pass


def test_no_scheduler(monkeypatch, tmp_path):
    pytest.importorskip("distributed")
    monkeypatch.setattr(clusters, "TIMEOUT", 0.3)
    for missing, said in (
        (tmp_path / "scheduler.json", "no such scheduler file"),
        ("tcp://127.0.0.1:1", "no scheduler"),
        ("ucx://127.0.0.1:1", "an address that begins with one of tcp://"),
    ):
        refused(call("claims", "--dask", missing, "--draws", 0, "--out", tmp_path / "out"), said)
    assert not (tmp_path / "out").exists()


# a real scheduler and two workers


def started(*command):
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    program = [sys.executable, "-m", *map(str, command)]
    return subprocess.Popen(program, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=ROOT)


def until(what, seconds=240.0):
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end, "it has not come to pass"
        time.sleep(0.05)


@pytest.fixture
def real_cluster(tmp_path):
    pytest.importorskip("distributed")
    file, processes = tmp_path / "scheduler.json", []

    def worker():
        where = ["--scheduler-file", file, "--local-directory", tmp_path / "scratch"]
        processes.append(started("dask", "worker", *where, "--nthreads", 1, "--no-nanny", "--no-dashboard"))
        return processes[-1]

    processes.append(started("dask", "scheduler", "--port", 0, "--no-dashboard", "--scheduler-file", file))
    until(file.exists)
    yield file, worker
    for process in processes:
        process.kill()
        process.wait()


CHANNELS = [f"--fix={name}=1" for name in ("c_Na", "c_K", "c_L", "c_A")]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_calibration_under_kills_at_random_times(real_cluster, tmp_path, seed):
    """Workers and client are killed with -9 and replaced: no finished replicate changes, and the ranks are the same."""
    file, worker = real_cluster
    rng = np.random.default_rng((20261125, seed))
    asked = ["calibrate", "--replicates", 8, "--seed", seed, "--max-steps", 1000, *CHANNELS]
    out, here = tmp_path / "out", tmp_path / "here"

    def client():
        return started("softness_bayes", *asked, "--out", out, "--dask", file)

    workers, running = [worker(), worker()], client()
    until((out / RANKS).exists)
    kills, finished = 0, {}
    while running.poll() != 0:
        if running.poll() is not None:
            # killed here, or it has given up a task whose workers were killed time and again: the same command goes on
            assert running.returncode in (-signal.SIGKILL, WorkersLostError.exit_code)
            running = client()
        time.sleep(rng.uniform(0.3, 2.5))  # short against the seconds that the eight replicates take
        for index, one in read_replicates(out).items():
            assert finished.setdefault(index, one) == one
        one = int(rng.integers(3))
        if kills < 12 and running.poll() is None:
            kills += 1
            if one == 2:
                running.send_signal(signal.SIGKILL)
                running.wait()
            else:
                workers[one].send_signal(signal.SIGKILL)
                workers[one].wait()
                workers[one] = worker()
    assert kills > 2
    assert call(*asked, "--out", here).returncode == 0
    for name in ("ranks.csv", "coverage.csv"):
        assert (out / name).read_bytes() == (here / name).read_bytes(), name
