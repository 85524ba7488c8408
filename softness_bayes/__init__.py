"""Bayesian inference for tactile softness: from fabric mechanics through receptor firing to ratings.

Names are imported on first use, so that ``import softness_bayes`` is fast.
"""

from __future__ import annotations

import ast
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

__version__ = "1.0.0"

if TYPE_CHECKING:
    from softness_bayes.base.errors import InputError as InputError
    from softness_bayes.base.laws import HalfNormal as HalfNormal
    from softness_bayes.base.laws import LogNormal as LogNormal
    from softness_bayes.base.laws import LogUniform as LogUniform
    from softness_bayes.base.laws import Normal as Normal
    from softness_bayes.base.laws import Truncated as Truncated
    from softness_bayes.base.laws import Uniform as Uniform
    from softness_bayes.claims import evaluate_claims as evaluate_claims
    from softness_bayes.claims.report import claims_table as claims_table
    from softness_bayes.data import Afferents as Afferents
    from softness_bayes.data import Compression as Compression
    from softness_bayes.data import Experiment as Experiment
    from softness_bayes.data import Fabrics as Fabrics
    from softness_bayes.data import Ratings as Ratings
    from softness_bayes.data import read_experiment as read_experiment
    from softness_bayes.experiments.adaptive import Adaptive as Adaptive
    from softness_bayes.experiments.design import Costs as Costs
    from softness_bayes.experiments.design import design as design
    from softness_bayes.experiments.outlook import Candidates as Candidates
    from softness_bayes.likelihood.error_laws import LAPSES as LAPSES
    from softness_bayes.likelihood.error_laws import NORMAL as NORMAL
    from softness_bayes.likelihood.error_laws import STUDENT as STUDENT
    from softness_bayes.likelihood.scales import AGGREGATED as AGGREGATED
    from softness_bayes.likelihood.scales import CATEGORIES as CATEGORIES
    from softness_bayes.likelihood.scales import FALLS as FALLS
    from softness_bayes.likelihood.scales import FREE as FREE
    from softness_bayes.likelihood.scales import MAGNITUDE as MAGNITUDE
    from softness_bayes.likelihood.scales import PAIRS as PAIRS
    from softness_bayes.likelihood.scales import RANKS as RANKS
    from softness_bayes.likelihood.scales import RISES as RISES
    from softness_bayes.likelihood.scales import SLIDER as SLIDER
    from softness_bayes.model.build import build as build
    from softness_bayes.model.options import ModelOptions as ModelOptions
    from softness_bayes.model.prediction import prediction_table as prediction_table
    from softness_bayes.model.scenes import scene_of as scene_of
    from softness_bayes.model.scenes import touch_parameters as touch_parameters
    from softness_bayes.model.scenes import usual_values as usual_values
    from softness_bayes.model.simulation import simulate_afferents as simulate_afferents
    from softness_bayes.model.simulation import simulate_compression as simulate_compression
    from softness_bayes.model.simulation import simulate_ratings as simulate_ratings
    from softness_bayes.parameters.choice import parameter_space as parameter_space
    from softness_bayes.parameters.declared import PARAMETERS as PARAMETERS
    from softness_bayes.plotting.checks import rank_ecdf_figure as rank_ecdf_figure
    from softness_bayes.plotting.figures import Plots as Plots
    from softness_bayes.plotting.style import Style as Style
    from softness_bayes.results.result import Result as Result
    from softness_bayes.results.run_options import RunOptions as RunOptions
    from softness_bayes.runs.calibrate import CalibrationScene as CalibrationScene
    from softness_bayes.runs.calibrate import calibrate as calibrate
    from softness_bayes.runs.comparison import compare as compare
    from softness_bayes.runs.population import pool_results as pool_results
    from softness_bayes.runs.run import sample as sample
    from softness_bayes.runs.study import study as study
    from softness_bayes.touch.contact import Finger as Finger
    from softness_bayes.touch.contact import Force as Force
    from softness_bayes.touch.contact import Indentation as Indentation
    from softness_bayes.touch.contact import solve_contact as solve_contact
    from softness_bayes.touch.neuron.fixed_channels import FixedChannels as FixedChannels
    from softness_bayes.touch.neuron.membrane import PAPER_CHANNELS as PAPER_CHANNELS
    from softness_bayes.touch.neuron.rate import firing_rate as firing_rate
    from softness_bayes.touch.neuron.rate import rheobase as rheobase
    from softness_bayes.touch.neuron.spikes import spike_times as spike_times
    from softness_bayes.touch.readings import ALTERNATIVES as ALTERNATIVES
    from softness_bayes.touch.readings import NAMED_READINGS as NAMED_READINGS
    from softness_bayes.touch.readings import Readings as Readings
    from softness_bayes.touch.receptors import receptor_current as receptor_current
    from softness_bayes.touch.scene import Discretisation as Discretisation
    from softness_bayes.touch.scene import Scene as Scene
    from softness_bayes.touch.stress import stress as stress


def _homes() -> dict[str, str]:
    """Return the module of every public name: those above are the only list."""
    tree = ast.parse(Path(__file__).read_text(encoding="utf-8"))
    imported = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    return {one.asname: str(node.module) for node in imported for one in node.names if one.asname}


_HOMES = _homes()
__all__ = ["__version__", *_HOMES]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
