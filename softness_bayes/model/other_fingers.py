"""Sensitivity of the drive to the modulus of the skin, for the check of individual fingers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.ratings import RatingParameters
from softness_bayes.model.posterior import Posterior

Array = NDArray[np.float64]


def skin_slope(posterior: Posterior, theta: Array, parameters: RatingParameters, step: float) -> Array:
    """Return the derivative of `Likelihood.drive` of the typical finger with respect to ln b, (draws, conditions).

    Parameters
    ----------
    posterior, theta
        The model, and draws (draws, dimension).
    parameters
        Parameters of the rating model at theta.
    step
        Half-width, in ln b, of the secant.
    """
    touch, modulus, scene = posterior.space.touch(theta), posterior.space.modulus(theta), posterior.scene
    here = posterior.mean_rate(theta)
    drives = []
    for side in (-1.0, 1.0):
        other = touch._replace(b=touch.b * np.exp(side * step))
        total = scene.total_rate(other) if modulus is None else scene.total_rate(other, modulus)
        rate = np.broadcast_to(total / scene.n_receptors, (*theta.shape[:-1], total.shape[-1]))
        drives.append(posterior.observation.drive_at(rate, here, parameters))
    return np.asarray((drives[1] - drives[0]) / (2.0 * step))
