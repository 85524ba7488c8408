"""What the tests share: the random seed, the reference data beside the project, a firing rate without a membrane."""

from __future__ import annotations

import functools
import gc
import os
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from softness_bayes.results import predictions
from softness_bayes.sampler.sampling import Settings
from softness_bayes.touch import stress_table
from softness_bayes.touch.neuron import fixed_channels, spikes
from softness_bayes.touch.neuron.membrane import Channels
from softness_bayes.touch.neuron.rate import Onset
from softness_bayes.touch.neuron.rate_curve import CurveError, RateCurve
from softness_bayes.touch.parameters import TouchParameters
from softness_bayes.touch.stress_table import StressTable
from support.longer import mark_longer
from support.once import Kept, made_once
from support.paths import SHARED
from support.randomness import SEED, generator_of

# Processes that tests start have a processor each at best: more threads of linear algebra would wait for one another.
os.environ.setdefault("OMP_NUM_THREADS", "1")
# Processes that tests start compile nothing anew, whatever the environment says: that took a third of their time.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False  # or this process hands it on to those that it forks


def pytest_collection() -> None:
    """Look for no garbage while the tests are collected: nearly all that is made stays."""
    gc.disable()


@pytest.hookimpl(tryfirst=True)  # before pytest leaves out what is slow
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests of `longer.txt` as slow."""
    mark_longer(items)


def pytest_collection_finish() -> None:
    """Look for garbage more seldom, and not among what was imported: that took a tenth of the time of all tests."""
    gc.freeze()
    gc.enable()
    gc.set_threshold(20_000, 20, 20)


def pytest_report_header() -> str:
    return f"random seed: {SEED} (set SOFTNESS_BAYES_SEED to change it)"


@pytest.fixture(scope="session", autouse=True)
def one_thread():
    """Keep linear algebra to one thread: there is a process for each processor already."""
    with threadpool_limits(1):
        yield


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """A generator of the test's own: the same numbers whichever tests run beside it."""
    return generator_of(request.node.nodeid)


@pytest.fixture(scope="session")
def once(tmp_path_factory, worker_id) -> Kept:
    """Make what is costly once for all processes of the session."""
    own = tmp_path_factory.getbasetemp()
    return Kept(own if worker_id == "master" else own.parent)


@pytest.fixture(scope="session")
def report_run(once):
    """Return a run of `support.report_runs` by its name."""
    from support.report_runs import RUNS  # imports half of the package, which not every test needs

    return lambda name: once(f"run-{name}", RUNS[name])


@pytest.fixture(scope="session", autouse=True)
def one_membrane(once):
    """Make each rate curve of fixed channels and each example train once, not in every test of something else."""
    curve, train = made_once(once, fixed_channels.known_curve), made_once(once, predictions.spike_times)

    def spike_times(current, channels, membrane, duration, strength, rng, tolerance):
        if strength:
            return spikes.spike_times(current, channels, membrane, duration, strength, rng)
        return train(current, channels, membrane, duration, strength, None, tolerance).copy()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fixed_channels, "exact_curve", made_once(once, fixed_channels.exact_curve))
        patch.setattr(fixed_channels, "known_curve", curve)
        patch.setattr(predictions, "spike_times", spike_times)
        yield


@pytest.fixture(scope="session", autouse=True)
def one_field(once):
    """Make the table of each stress field once: the same loads and fingers are in the scenes of many tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stress_table, "_table", made_once(once, StressTable))
        yield


def pilot_of(steps):
    """Learn in a pilot walk of two stages of so many steps, and run two ensembles."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "softness_bayes.sampler.sampling.Settings",
            functools.partial(Settings, pilot=(steps, steps), optima=1, ensembles=2),
        )
        yield


@pytest.fixture(scope="module")
def brief_pilot():
    """Learn little in the pilot walk: for runs whose draws nobody judges."""
    yield from pilot_of(20)


@pytest.fixture(scope="module")
def short_pilot():
    """Learn less than usual in the pilot walk: for runs whose draws are judged roughly."""
    yield from pilot_of(60)


@pytest.fixture(scope="module")
def few_pictures():
    """Draw one picture for a report: for tests that look at something else of it."""
    from softness_bayes.report import page

    every = page.figures_of
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(page, "figures_of", lambda result: every(result)[:1])
        yield


@pytest.fixture(scope="session")
def births():
    """Three channel vectors of Hodgkin's and Huxley's membrane, its own first, and their onsets: folds of orbits."""
    from support import onsets

    return onsets.births()


@pytest.fixture(scope="session")
def born_onset(births):
    """The onset of Hodgkin's and Huxley's own membrane, a fold of orbits."""
    _, begin = births
    return Onset(*(x[0] for x in begin))


@pytest.fixture(scope="session")
def corner_onset():
    """The onset of `support.onsets.CORNER`, a jump."""
    from support import onsets

    return onsets.corner_onset()


@pytest.fixture(scope="session")
def shared() -> Path:
    if not SHARED.is_dir():
        pytest.skip("the shared reference data are not beside the project")
    return SHARED


@dataclass(frozen=True)
class OneCurve:
    """A source of rate curves that has a single one, chosen by hand."""

    curve: RateCurve

    def curves(self, channels: Channels, alpha: object) -> RateCurve:
        return self.curve


@pytest.fixture(scope="session")
def smooth_firing():
    """Return a firing rate that rises from its rheobase like a root, with a jump there if wanted."""

    def make(rheobase: float = 18.0, onset_rate: float = 0.0) -> OneCurve:
        coefficients = np.array([14.0, 4.0, -0.8, 0.3])
        unmeasured = CurveError(*np.zeros(len(CurveError._fields)))
        return OneCurve(RateCurve(np.array(rheobase), np.array(onset_rate), coefficients, 60.0, unmeasured))

    return make


@pytest.fixture(scope="session")
def paper():
    """Return the medians of the priors as parameters of the chain, with some of them replaced."""

    def make(**changed: float) -> TouchParameters:
        median = TouchParameters(1e5, 2.0, 20.3, 0.6e-3, 9e3, 1.05, 1.16, 1.0, 1.5)
        return median._replace(**changed)

    return make
