"""Joint density of independent priors, with all log-normal ones evaluated in one call."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from softness_bayes.parameters.priors import LogNormal, Prior, log_normal_density

FloatArray = NDArray[np.float64]


class Laws:
    """Independent laws along the last axis of an array, with all log-normal ones evaluated in one call.

    Parameters
    ----------
    priors
        One law for each element of the last axis.
    largest
        Largest value of each element, at which its law is truncated.
    """

    def __init__(self, priors: Sequence[Prior], largest: Sequence[float]) -> None:
        supports = np.array([prior.support for prior in priors]).reshape(-1, 2)
        self._low, self._high = supports[:, 0], np.minimum(supports[:, 1], largest)
        alike = [k for k, prior in enumerate(priors) if isinstance(prior, LogNormal)]
        self._alike = np.array(alike, dtype=int)
        constants = [prior.constants for prior in priors if isinstance(prior, LogNormal)]
        self._constants = tuple(np.array(constants).reshape(-1, 3).T)
        self._others = [(k, prior) for k, prior in enumerate(priors) if not isinstance(prior, LogNormal)]

    def log_density(self, x: FloatArray) -> FloatArray:
        """Return log densities at ``x``, both of shape (..., places); -inf outside the open interval of a support."""
        inside = (x > self._low) & (x < self._high)
        density = np.empty(x.shape)
        density[..., self._alike] = log_normal_density(x[..., self._alike], inside[..., self._alike], *self._constants)
        for k, prior in self._others:
            density[..., k] = np.where(inside[..., k], prior.log_density(x[..., k]), -np.inf)
        return density
