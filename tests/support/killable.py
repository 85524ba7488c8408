"""A run in a process of its own that may be killed.

``python -m support.killable DIRECTORY STEPS PROCESSES PAUSE``, in the folder of the tests, continues what DIRECTORY
holds, writes at every state, and prints a line when it starts walking, with the numbers of its workers.
"""

import multiprocessing
import sys
import time
from pathlib import Path

import numpy as np

from softness_bayes.runs.checkpoint import Checkpoint
from softness_bayes.runs.saved import saved_states
from softness_bayes.sampler.diagnostics import Goal
from softness_bayes.sampler.sampling import Settings, walk
from support.fake_scene import FakeScene, fake_posterior

SEED = 8
WHAT = {"model": "the fake scene"}


class SlowScene(FakeScene):
    """The fake scene, as slow as a larger one."""

    def __init__(self, pause):
        super().__init__()
        self.pause = pause

    def total_rate(self, parameters):
        time.sleep(self.pause)
        return super().total_rate(parameters)


def settings(steps, processes=1):
    return Settings(
        ensembles=2,
        walkers=20,
        pilot=(10, 20),
        optima=1,
        round_steps=25,
        stored=100,
        max_steps=steps,
        processes=processes,
        goal=Goal(lengths=1e9),
    )


def follow(directory, steps, processes=1, pause=0.0):
    """Walk from wherever the directory's run is; yield every state once it is kept."""
    posterior, chosen = fake_posterior(SlowScene(pause)), settings(steps, processes)
    begun = saved_states(Path(directory))
    with Checkpoint.open(directory) if begun else Checkpoint.create(directory) as checkpoint:
        for state in walk(posterior, chosen, SEED, checkpoint.begin(WHAT)):
            checkpoint.keep(state, chosen, posterior)
            yield state


def same(one, other):
    """Assert that two states are bit by bit the same, time apart."""
    for name in ("phase", "steps", "stride", "due", "ended", "relearnt", "slow", "nonfinite"):
        assert getattr(one, name) == getattr(other, name), name
    for a, b in zip(one.ensembles, other.ensembles, strict=True):
        np.testing.assert_array_equal(a.coordinates, b.coordinates)
        np.testing.assert_array_equal(a.log_density, b.log_density)
        assert a.random[0] == b.random[0]
        assert a.random[2:] == b.random[2:]
        np.testing.assert_array_equal(a.random[1], b.random[1])
    for a, b in zip(one.map.bends, other.map.bends, strict=True):
        np.testing.assert_array_equal(a, b)
    for name in ("centre", "axes", "knots"):
        np.testing.assert_array_equal(getattr(one.map, name), getattr(other.map, name))
    if one.steps:
        for name in ("coordinates", "log_density", "accepted"):
            np.testing.assert_array_equal(getattr(one.chains, name), getattr(other.chains, name))
    a, b = one.verdict, other.verdict
    assert (a is None) == (b is None)
    if a is not None:
        assert (a.steps, a.tau_error, a.goal) == (b.steps, b.tau_error, b.goal)
        np.testing.assert_array_equal(a.tau, b.tau)
        np.testing.assert_array_equal(a.ess_between, b.ess_between)


if __name__ == "__main__":
    directory, steps, processes, pause = sys.argv[1:]
    states = follow(directory, int(steps), int(processes), float(pause))
    next(states)
    print("walking", *(worker.pid for worker in multiprocessing.active_children()), flush=True)
    for _ in states:
        pass
