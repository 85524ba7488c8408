"""Rigid probes on a fingertip: flats, spheres and hollows, the limit of a fabric as E_fab goes to infinity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from softness_bayes.touch.contact import Fingertip, Fingertips

RIGID = 1e30
"""E_fab [Pa] of a probe: 1 + E_skin / E_fab is then 1 in floating-point numbers, so that it is the rigid limit."""

WRAPPED = 1.0
"""Least relative curvature [1/m]: a hollow that is narrower than the finger lies against all of it."""


@dataclass(frozen=True)
class Probe:
    """Rigid flats, spheres or hollows, which stand where fabrics of modulus `RIGID` may stand.

    Parameters
    ----------
    curvature
        kappa [1/m]: 0 for a flat, the inverse radius of a sphere, negative for a hollow. The relative radius R* of the
        contact follows from 1/R* = 1/R + kappa.
    """

    curvature: ArrayLike = 0.0

    def under(self, finger: Fingertip) -> Fingertips:
        """Return the fingers whose contact with a flat is that of these fingers with the probe."""
        curvature = 1.0 / np.asarray(finger.radius, float) + np.asarray(self.curvature, float)
        radius = 1.0 / np.maximum(curvature, WRAPPED)
        return Fingertips(radius, np.asarray(finger.receptor_depth), finger.poisson_ratio)
