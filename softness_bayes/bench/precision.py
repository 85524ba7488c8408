"""Speed against error of the likelihood: one point for each accuracy, with channels fixed and free.

Times are for one core and a parameter vector of the benchmark's experiment; the shortest of several calls counts, the
one least disturbed by other work. Errors are those of the forward model at draws of the prior, against exact firing
rates and a much finer resolution.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from softness_bayes.base.errors import InputError
from softness_bayes.data import Experiment, Fabrics
from softness_bayes.model.build import ExperimentModel, build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.touch.contact import Indentation
from softness_bayes.touch.neuron.membrane import PAPER_CHANNELS
from softness_bayes.touch.readings import MENDED
from softness_bayes.touch.scene import Discretisation

FABRICS = Fabrics(tuple(f"F{k}" for k in range(1, 13)), effective_modulus=np.geomspace(1e3, 5e6, 12))
LOADS = (Indentation(1e-3), Indentation(2e-3), Indentation(3e-3))

MEDIANS = usual_values(MENDED, given={"sigma_0": 7.0})
"""Parameters in natural units of the simulated ratings, and of the peers' work."""


class Effort(NamedTuple):
    """Amount of work of a benchmark."""

    draws: int
    """Prior draws at which errors are measured with fixed channels."""
    exact: int
    """The same with free channels, each of which needs exact firing rates of its own."""
    repeats: int
    """Number of calls, of which the fastest counts."""
    finest: float
    """Tolerance of the stress fields that errors are measured against."""
    receptors: tuple[int, int]
    """Receptors that peers integrate: side by side, and one after the other."""
    duration: float
    """Time that peers integrate [ms]."""


FULL = Effort(1000, 100, 30, 1e-8, (400, 6), 600.0)
QUICK = Effort(64, 3, 3, 1e-5, (20, 1), 400.0)


class Point(NamedTuple):
    """Time and error of one way to compute the response."""

    way: str
    """`CHANNELS` or the name of a peer."""
    setting: str
    seconds: float
    """For each parameter vector, 36 conditions."""
    error_peak: float
    """Largest error relative to the vector's peak response, over draws and conditions."""
    error_log: float
    """Largest error of log(N/N_ref + eps); NaN for a peer."""
    accuracy: float = np.nan
    """The accuracy that was asked for; NaN for a peer."""


CHANNELS = ("channels held", "channels free")


def model_of(held: bool, **options: Any) -> ExperimentModel:
    """Return the model of 1080 simulated ratings, with channel multipliers fixed or free."""
    return build(simulated(30), ModelOptions(fix=PAPER_CHANNELS._asdict() if held else {}, **options))


def simulated(raters: int, **how: Any) -> Experiment:
    """Return a simulated experiment of 36 touches by some raters; other arguments as for `simulate_ratings`."""
    ratings = simulate_ratings(np.random.default_rng(1), FABRICS, LOADS, MEDIANS, participants=raters, **how).ratings
    return Experiment(ratings, FABRICS, ())


def work_precision(effort: Effort) -> Iterator[Point]:
    """Measure the likelihood at each accuracy that can be reached."""
    for held in (True, False):
        finest = Discretisation(40, 24.0, field_tolerance=effort.finest, rate_nodes=28)
        reference = model_of(held, discretisation=finest)
        space = reference.posterior.space
        theta = space.draw_prior(np.random.default_rng(2), effort.draws if held else effort.exact)
        points = space.draw_prior(np.random.default_rng(0), 64)
        touch, eps = space.touch(theta), space.values(theta)["eps"]
        exact = reference.scene.fired_by(reference.scene.firing.exact()).total_rate(touch)
        peak = exact.max(axis=-1, keepdims=True)
        for accuracy in (a for a in (1e-2, 1e-3, 1e-4, 1e-5, 1e-6) if a >= 10.0 * effort.finest):
            try:
                model = model_of(held, accuracy=accuracy)
            except InputError:
                continue  # this accuracy cannot be reached: `sample` refuses it
            rate = model.scene.total_rate(touch)
            fires = peak[:, 0] > 0
            log, better = (np.log(r / reference.scene.n_receptors + np.reshape(eps, (-1, 1))) for r in (rate, exact))
            yield Point(
                CHANNELS[not held],
                f"accuracy {accuracy:g}",
                quickest(partial(model.posterior.log_likelihood, points), effort.repeats) / len(points),
                float((np.abs(rate - exact)[fires] / peak[fires]).max(initial=0.0)),
                float(np.abs(log - better).max()),
                accuracy,
            )


def quickest(call: Callable[[], Any], repeats: int) -> float:
    """Return the shortest processor time of repeated calls [s]; short calls are repeated for 50 ms each."""
    taken: list[float] = []
    while len(taken) < repeats or (repeats > 1 and sum(taken) < 0.05 * repeats):
        begun = time.process_time()
        call()
        taken.append(time.process_time() - begun)
    return min(taken)
