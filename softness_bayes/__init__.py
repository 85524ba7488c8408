"""Bayesian inference for tactile softness: from fabric mechanics through receptor firing to ratings.

Names are imported when they are first used, so that ``import softness_bayes`` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from softness_bayes.claims import evaluate_claims as evaluate_claims
    from softness_bayes.data import Compression as Compression
    from softness_bayes.data import Experiment as Experiment
    from softness_bayes.data import Fabrics as Fabrics
    from softness_bayes.data import Ratings as Ratings
    from softness_bayes.data import read_experiment as read_experiment
    from softness_bayes.model.build import scene_of as scene_of
    from softness_bayes.model.build import simulate_compression as simulate_compression
    from softness_bayes.model.build import simulate_ratings as simulate_ratings
    from softness_bayes.model.build import touch_parameters as touch_parameters
    from softness_bayes.model.build import usual_values as usual_values
    from softness_bayes.model.prediction import prediction_table as prediction_table
    from softness_bayes.plotting.plots import Plots as Plots
    from softness_bayes.results.result import Result as Result
    from softness_bayes.runs.plate import sample_skin as sample_skin
    from softness_bayes.runs.run import RunOptions as RunOptions
    from softness_bayes.runs.run import sample as sample
    from softness_bayes.touch.contact import Finger as Finger
    from softness_bayes.touch.contact import Force as Force
    from softness_bayes.touch.contact import Indentation as Indentation
    from softness_bayes.touch.neuron.rate import firing_rate as firing_rate
    from softness_bayes.touch.readings import Readings as Readings
    from softness_bayes.touch.scene import Scene as Scene

_HOMES = {
    "Compression": "data",
    "Experiment": "data",
    "Fabrics": "data",
    "Finger": "touch.contact",
    "Force": "touch.contact",
    "Indentation": "touch.contact",
    "Plots": "plotting.plots",
    "Ratings": "data",
    "Readings": "touch.readings",
    "Result": "results.result",
    "RunOptions": "runs.run",
    "Scene": "touch.scene",
    "evaluate_claims": "claims",
    "firing_rate": "touch.neuron.rate",
    "prediction_table": "model.prediction",
    "read_experiment": "data",
    "sample": "runs.run",
    "sample_skin": "runs.plate",
    "scene_of": "model.build",
    "simulate_compression": "model.build",
    "simulate_ratings": "model.build",
    "touch_parameters": "model.build",
    "usual_values": "model.build",
}

__all__ = ["__version__", *_HOMES]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
