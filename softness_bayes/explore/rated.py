"""Data and posterior of a finished run behind the curves, and the typical rating at any parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from softness_bayes.defaults import ANSWER_DRAWS
from softness_bayes.model.other_touches import deviations_of_fabrics
from softness_bayes.parameters.fabric_moduli import KPA
from softness_bayes.report.curves import Shown, shown
from softness_bayes.results.fitted import Fitted
from softness_bayes.results.result import Result
from softness_bayes.touch.scene import Scene

Array = NDArray[np.float64]

EFFECTS, FEW = ANSWER_DRAWS, 15
"""Draws of the ratings' level given data and parameters, whose median is shown, and as many where each takes integrals
over intervals: an odd number, so that the median of categories is one. They are the draws of `predict` at these values,
and the same each time, so that curves move smoothly."""


class Rated:
    """The model of a finished run on ratings, made once.

    Parameters
    ----------
    result
        The run.

    Raises
    ------
    InputError
        If the run's files lack inputs that its model needs.
    """

    shown: Sequence[Shown]
    """Posterior bands, data and turning point under each load, of many loads under groups of them."""
    load: Sequence[int]
    """Index among the loads of the run of each of these, or of the middle one of a group."""

    def __init__(self, result: Result) -> None:
        fitted = Fitted(result, ANSWER_DRAWS)
        self.shown, self.load = shown(result)["e_fab"], result.load_groups.at.tolist()
        self.source, self.scale, self.posterior = result.source, result.scale, fitted.posterior
        self.medians = {name: float(np.median(values)) for name, values in fitted.named.items()}
        if not isinstance(fitted.posterior.scene, Scene):
            raise TypeError("expected the posterior of a compiled scene")
        self.scene = fitted.posterior.scene
        own = self.posterior.space.modulus(self._theta(self.medians))
        self.moduli = result.fabrics.effective_modulus if own is None else own
        self.span = float(self.moduli.min()) / KPA, float(self.moduli.max()) / KPA

    def _theta(self, values: Mapping[str, float]) -> Array:
        return np.array([values[name] for name in self.posterior.names])

    def typical(self, values: Mapping[str, float], rate: Array, fabric: int | None = None) -> Array:
        """Return the typical rater's rating for given responses [unit of the ratings' file].

        It is the median over the level of the ratings given the data and these parameters.

        Parameters
        ----------
        values
            Every parameter by name, in natural units.
        rate
            Responses [spikes/s], shape (loads, k), one row for each load of `shown`.
        fabric
            Index of the rated fabric in the last column, or None. If the model has fabric deviations, that of this
            fabric is added in the last column.
        """
        posterior, observed = self.posterior, self.posterior.observation
        size = EFFECTS if observed.ends is None else FEW
        theta = np.repeat(self._theta(values)[None], size, axis=0)
        rated = np.repeat(posterior.response(theta[:1]), size, axis=0)
        parameters = posterior.rating_parameters(theta)
        effects = observed.draw_effects(np.random.default_rng(0), rated, parameters)
        one = posterior.rating_parameters(theta[:1])  # the drive is the same for every draw
        drive = observed.drive_at(rate.reshape(1, -1) / self.scene.n_receptors, rated[:1], one)
        drive = np.broadcast_to(drive.reshape(1, *rate.shape), (size, *rate.shape))
        own = None if fabric is None else deviations_of_fabrics(observed.single.named_effects(effects))
        if own is not None:
            drive = np.concatenate([drive[..., :-1], drive[..., -1:] + own[:, None, fabric, None]], axis=-1)
        found = [
            observed.typical(rated, parameters, effects, drive[:, k], np.flatnonzero(self.scene.load == load))
            for k, load in enumerate(self.load)
        ]
        return np.asarray(np.median(np.stack(found, axis=1), axis=0))
