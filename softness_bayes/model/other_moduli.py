"""Responses and drives for changed moduli of the fabrics, to check the effect of errors in the moduli."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from softness_bayes.likelihood.ratings import RatingParameters
from softness_bayes.model.posterior import Posterior
from softness_bayes.touch.scene import Scene

Array = NDArray[np.float64]


def rates_of_other_moduli(posterior: Posterior, theta: Array, step: float) -> tuple[Array, Array]:
    """Return `Posterior.response` at theta (draws, dimension) with all log moduli lowered, and raised, by a step.

    Raises
    ------
    TypeError
        If the posterior is not that of a compiled scene.
    """
    scene, modulus = posterior.scene, posterior.space.modulus(theta)
    if not isinstance(scene, Scene):
        raise TypeError("only a compiled scene answers for other moduli")
    if modulus is None:
        modulus = np.broadcast_to(scene.fabric_modulus, (len(theta), scene.fabric_modulus.size))
    lower, higher = (posterior.response(theta, modulus * np.exp(side * step)) for side in (-1.0, 1.0))
    return lower, higher


def drive_slope(
    posterior: Posterior, theta: Array, mean_rate: Array, parameters: RatingParameters, step: float
) -> Array:
    """Return the derivative of `Likelihood.drive` with respect to each fabric's log modulus, (draws, conditions).

    Parameters
    ----------
    posterior, theta, step
        As for `rates_of_other_moduli`; the derivative is a central difference over this step.
    mean_rate, parameters
        N/N_ref [Hz] and parameters of the rating model at theta.
    """
    observation = posterior.observation
    lower, higher = (
        observation.drive_at(other[..., : observation.design.n_conditions], mean_rate, parameters)
        for other in rates_of_other_moduli(posterior, theta, step)
    )
    return (higher - lower) / (2.0 * step)
