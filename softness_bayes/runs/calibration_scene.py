"""The scene of a calibration: a crossed design, and the model of its ratings on any scale."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from softness_bayes.data import Experiment, Fabrics, Ratings
from softness_bayes.likelihood.directions import RISES
from softness_bayes.likelihood.models import rating_model
from softness_bayes.likelihood.scales import MAGNITUDE, SLIDER
from softness_bayes.model.build import COARSE, ExperimentModel, build
from softness_bayes.model.options import ModelOptions
from softness_bayes.model.scenes import usual_values
from softness_bayes.model.simulation import simulate_ratings
from softness_bayes.touch.contact import Indentation, Load

USUAL_FABRICS = Fabrics(tuple("abcdefgh"), effective_modulus=np.geomspace(3e3, 6e5, 8))
"""Fabrics from one without firing under a light touch to one beyond the turning point under a firm touch."""

USUAL_LOADS: tuple[Load, ...] = (Indentation(1.5e-3), Indentation(2.5e-3))


@dataclass(frozen=True)
class CalibrationScene:
    """The design of every replicate: all participants rate every fabric under every load, once.

    Parameters
    ----------
    fabrics, loads
        Rated fabrics and loads; by default a small scene, so that a replicate takes seconds.
    participants
        Their number.
    """

    fabrics: Fabrics = field(default_factory=lambda: USUAL_FABRICS)
    loads: tuple[Load, ...] = USUAL_LOADS
    participants: int = 20

    def model(self, options: ModelOptions) -> ExperimentModel:
        """Return the model of the scene, built once for all replicates, with placeholder ratings."""
        return build(*self.planned(options))

    def planned(self, options: ModelOptions) -> tuple[Experiment, ModelOptions]:
        """Return the design with placeholder ratings on its scale, and the options with all open choices filled in."""
        options = replace(options, direction=options.direction or RISES)  # there are no data from which to infer it
        if options.scale is not MAGNITUDE and options.scale.model is None:
            law = options.errors or rating_model(options.scale).error
            exact = 0.0 if options.scale is SLIDER and options.resolution is None else options.resolution
            options = replace(options, errors=law, resolution=exact)
        return Experiment(self._ratings(options), self.fabrics, ()), options

    def _ratings(self, options: ModelOptions) -> Ratings:
        """Return placeholder ratings: all 1, or simulated ones if these would not be on the scale."""
        if options.scale is not MAGNITUDE:
            made = simulate_ratings(
                np.random.default_rng(0),
                self.fabrics,
                self.loads,
                usual_values(options.readings),
                options.readings,
                self.participants,
                scale=options.scale,
                discretisation=COARSE,
                finger=options.finger,
                categories=options.n_categories,
            ).ratings
            # standard deviations between raters are not simulated for each replicate
            return made if made.cells is None else replace(made, cells=made.cells._replace(geometric_sd=None))
        names = [f"P{k}" for k in range(1, self.participants + 1)]
        table = np.ones((self.participants, len(self.fabrics), len(self.loads)))
        return Ratings.crossed(names, self.fabrics.names, self.loads, table)
