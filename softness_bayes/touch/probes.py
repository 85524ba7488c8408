"""Rigid probes on a fingertip: flats, spheres and hollows, the limit of a fabric as E_fab goes to infinity."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import lambertw

from softness_bayes.base.errors import InputError
from softness_bayes.touch.contact import STRAIN, Contact, Finger, Fingertip, Load, Loads, SkinDisplacement

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Probe:
    """A rigid flat, sphere or hollow, which stands where a fabric may stand.

    Parameters
    ----------
    curvature
        kappa [1/m]: 0 for a flat, the inverse radius of a sphere, negative for a hollow. The relative radius R* of the
        contact follows from 1/R* = 1/R + kappa.
    """

    curvature: float = 0.0

    def under(self, finger: Finger) -> Finger:
        """Return the finger whose contact with a flat is that of this finger with the probe.

        Raises
        ------
        InputError
            If the hollow is narrower than the finger, so that they do not touch at one place.
        """
        if not 1.0 / finger.radius + self.curvature > 0:
            raise InputError(
                f"probe: curvature {self.curvature:g} /m, expected more than {-1.0 / finger.radius:g} /m: a narrower "
                "hollow does not touch the fingertip at one place"
            )
        return replace(finger, radius=1.0 / (1.0 / finger.radius + self.curvature))


def rigid_contact(
    loads: Load | Loads, b: ArrayLike, m: ArrayLike, finger: Fingertip, displacement: SkinDisplacement = STRAIN
) -> Contact:
    """Solve the contact of a finger with rigid flats; for probes, `finger` has their relative radius R*.

    With 1/E_fab = 0 the skin's compression is u = C E^-p (`Loads.compression`), and E = b exp(m u) has the solution
    E = b exp(W(p m C b^-p) / p) with Lambert's W; for p = 0, where the radius is given, E = b exp(m C).

    Parameters
    ----------
    loads
        One load, or one for each place of the last axis.
    b, m
        Skin modulus at rest [Pa] and its exponent, as for `contact.solve_contact`; they broadcast with the loads.
    finger
        The fingertip; radii are R* [m].
    displacement
        Reading of the skin's displacement.
    """
    loads = loads if isinstance(loads, Loads) else Loads(loads)
    b, m = np.asarray(b, float), np.asarray(m, float)
    log_scale, p = loads.compression(finger, displacement)
    with np.errstate(divide="ignore"):
        x = m * np.exp(log_scale - p * np.log(b))
    power = np.where(p > 0, p, 1.0)
    exponent = np.where(p > 0, lambertw(power * x).real / power, x)
    skin = b * np.exp(np.minimum(exponent, 600.0))  # the exponent stays in the range of numbers
    return loads.contact(skin, skin / (1.0 - finger.poisson_ratio**2), finger)
