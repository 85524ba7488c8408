"""Brief runs with awkward names, for the tests of the report: whatever a page must cope with is in one of them."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from softness_bayes.data import Experiment, Fabrics
from softness_bayes.likelihood import uncertain_loads
from softness_bayes.likelihood.scales import SLIDER, STANDARDISED
from softness_bayes.model import scenes
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulation import simulate_compression, simulate_ratings
from softness_bayes.results import draws, predictions, run_checks
from softness_bayes.results.result import Result
from softness_bayes.runs.run import sample
from softness_bayes.sampler.sampling import Settings
from softness_bayes.touch.contact import Force, Indentation
from softness_bayes.touch.neuron import fixed_channels
from softness_bayes.touch.neuron.membrane import PAPER_CHANNELS
from softness_bayes.touch.neuron.rate_curve import CurveError, RateCurve
from softness_bayes.touch.readings import MENDED
from softness_bayes.touch.scene import Discretisation

LOOK = 60
EVIL = "<script>alert('felt')</script>"
PERSON = '"><img src=x onerror=alert(1)>'
CLOTH = Fabrics((EVIL, "lawn", "drill & twill", "gauze"), effective_modulus=np.array([8e4, 2e4, 4e5, 2e5]))
LOADS = (Indentation(2e-3), Force(1.5))
HELD = {"m": 2.0, "beta": 0.6, "tau": 0.5, "eps": 0.1, **PAPER_CHANNELS._asdict()}
COARSE = Discretisation(8, 9.0, 1e-4)
TYPED = "softness-bayes sample --data 'my ratings.csv' --out results --seed 3"
OPTIONS = {
    "fix": HELD, "max_steps": 20, "processes": 1, "seed": 3, "command": TYPED, "discretisation": COARSE,
}  # fmt: skip


@contextmanager
def quickly() -> Iterator[None]:
    """Run two ensembles after a short pilot walk; a curve and a train chosen by hand stand for the membrane's.

    A first look ends after `LOOK` steps.

    Of the prior and of the touches that are stored as examples there are few draws: what a run makes of them, and not
    how it is sampled, is most of the work of a short one.
    """
    curve = RateCurve(
        np.array(18.0), np.array(0.0), np.array([14.0, 4.0, -0.8, 0.3]), 60.0, CurveError(0.01, 1e-5, 1e-4)
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "softness_bayes.sampler.sampling.Settings", functools.partial(Settings, pilot=(8,), optima=1, ensembles=2)
        )
        patch.setattr("softness_bayes.sampler.sampling.FIRST_LOOK", LOOK)
        patch.setattr(fixed_channels, "known_curve", lambda *_: curve)
        patch.setattr(fixed_channels, "averaged_curve", lambda *_: curve)
        patch.setattr(predictions, "spike_times", lambda *_: np.array([12.0, 30.0, 48.0]))
        patch.setattr(predictions, "ILLUSTRATED", 8)
        patch.setattr(uncertain_loads, "FINE_KNOTS", (-2.0, -1.0, 0.0, 1.0, 2.0))  # exact fields take seconds
        patch.setattr(draws, "PRIOR_DRAWS", 200)
        patch.setattr(draws, "REPLICATES", 120)
        patch.setattr(run_checks, "EXACT_DRAWS", 50)
        patch.setattr(run_checks, "FIRST_DRAWS", 25)  # fewer have no tail for ArviZ
        scenes.curve_of_held.cache_clear()  # no curve of the membrane itself, nor this one for whoever comes after
        try:
            yield
        finally:
            scenes.curve_of_held.cache_clear()


def experiment(standardised: bool = False, participants: int = 5) -> Experiment:
    """Return simulated ratings, one participant's name an attack too."""
    values, rng = usual_values(MENDED, given={"sigma_0": 7.0, "varsigma": 0.2}), np.random.default_rng(11)
    scale = {"scale": STANDARDISED} if standardised else {}
    made = simulate_ratings(rng, CLOTH, LOADS, values, participants=participants, **scale)
    people = (PERSON, *made.ratings.participants[1:])
    return Experiment(replace(made.ratings, participants=people), CLOTH, ())


def ratings_run() -> Result:
    """Return a run on ratings that is far from converged."""
    with quickly():
        return sample(experiment(), **OPTIONS)


def z_score_run() -> Result:
    """Return a run on z-scores."""
    held = {name: value for name, value in HELD.items() if name not in ("tau", "eps")}
    with quickly():
        return sample(experiment(standardised=True), **OPTIONS | {"fix": held, "scale": STANDARDISED})


def skin_run() -> Result:
    """Return a run on compression data alone."""
    rng = np.random.default_rng(4)
    made = simulate_compression(rng, usual_values(MENDED, n_fingers=4), fingers=4)
    with quickly():
        return sample(made.compression, max_steps=20, processes=1, seed=3)


def slider_run() -> Result:
    """Return a run on whole numbers from 0 to 100, some of them at the ends of the slider."""
    values, rng = usual_values(MENDED, given={"sigma_0": 7.0, "varsigma": 1.0}), np.random.default_rng(13)
    with quickly():
        made = simulate_ratings(rng, CLOTH, LOADS, values, participants=5, scale=SLIDER).ratings
        filed = replace(made, rating=np.r_[0.0, 100.0, (100.0 * made.rating[2:]).round()])
        return sample(Experiment(filed, CLOTH, ()), **OPTIONS | {"scale": SLIDER, "slider_ends": (0.0, 100.0)})


RUNS = {"ratings": ratings_run, "z-scores": z_score_run, "skin": skin_run, "slider": slider_run}
"""The fixture `report_run` makes each once."""


def converged(result: Result) -> Result:
    """Return a result that says that it has converged."""
    tree = result.tree.copy()
    tree.attrs = {**result.tree.attrs, "converged": 1, "verdict": "Converged, as this test pretends."}
    return replace(result, tree=tree)
