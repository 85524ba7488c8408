"""Vectorised contacts of many conditions (a fabric under a load each) for a batch of skin parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from softness_bayes.touch.contact import (
    Contact,
    Finger,
    Fingertip,
    Load,
    ManyLoads,
    log_compliance_ratio,
    reduced_modulus,
)
from softness_bayes.touch.skin import SkinDisplacement, skin_modulus, stiffened
from softness_bayes.touch.skin_start import USEFUL, SkinBox, SkinStart

Array = NDArray[np.float64]


class Contacts:
    """The contacts of all conditions with one finger, or with fingers that differ from it in radius and depth.

    Parameters
    ----------
    modulus, poisson
        E_fab [Pa] and nu_fab of each condition.
    loads
        The load of each condition.
    finger
        The default finger.
    displacement
        The reading of the skin's compression.
    skin_box
        Expected range of the skin's parameters, if known; it speeds up the solution.
    """

    def __init__(
        self,
        modulus: Array,
        poisson: Array,
        loads: Sequence[Load],
        finger: Finger,
        displacement: SkinDisplacement,
        skin_box: SkinBox | None,
    ) -> None:
        self.modulus, self.poisson = modulus, poisson
        self.finger, self.displacement = finger, displacement
        self.log_k = log_compliance_ratio(modulus, poisson, finger)
        self._closing = ManyLoads(loads)
        of_load = {load: load.compression(finger, displacement) for load in set(loads)}
        self._log_scale, self._skin_power = np.array([of_load[load] for load in loads]).T
        if (self._skin_power == self._skin_power[0]).all():
            self._skin_power = self._skin_power[0]
        start = None if skin_box is None else SkinStart(skin_box, self._log_scale, self._skin_power, self.log_k)
        self._start = start if start is not None and start.error <= USEFUL else None

    def moduli(
        self, b: Array, m: Array, fabric_modulus: Array | None, finger: Fingertip, tolerance: float = 0.0
    ) -> tuple[Array, Array]:
        """Return E_skin and E_star [Pa], shape (batch, conditions).

        Parameters
        ----------
        b, m
            The skin's modulus at rest [Pa] and exponent, shape (batch,).
        fabric_modulus
            E_fab [Pa] that replaces the conditions' moduli, shape (batch, conditions), or None.
        finger
            The default finger, or one for each row.
        tolerance
            Relative error allowed in E_skin.
        """
        if fabric_modulus is None and finger is self.finger and self._start is not None:
            skin = self._from_start(self._start, b, m, tolerance)
            return skin, reduced_modulus(skin, self.modulus, self.poisson, self.finger)
        log_scale, log_k, modulus = self._log_scale, self.log_k, self.modulus
        if finger is not self.finger:
            log_scale = self._closing.log_scales(finger, self.displacement)
        if fabric_modulus is not None:
            modulus, log_k = fabric_modulus, log_k - np.log(fabric_modulus / self.modulus)
        skin = skin_modulus(log_scale, self._skin_power, log_k, b[:, None], m[:, None])
        return skin, reduced_modulus(skin, modulus, self.poisson, self.finger)

    def _from_start(self, start: SkinStart, b: Array, m: Array, tolerance: float) -> Array:
        """Return E_skin [Pa]; the equation is solved only at points where the start is not accurate enough."""
        w, error = start(b, m)
        rough = error > tolerance
        if rough.all():
            return skin_modulus(self._log_scale, self._skin_power, self.log_k, b[:, None], m[:, None], w)
        skin = stiffened(b[:, None], w)
        if rough.any():
            some = b[rough, None], m[rough, None], w[rough]
            skin[rough] = skin_modulus(self._log_scale, self._skin_power, self.log_k, *some)
        return skin

    def radius(self, reduced: Array, finger: Fingertip) -> Array:
        """Return contact radii [m] for E_star [Pa] of shape (batch, conditions)."""
        return self._closing.radius(reduced, finger)

    def close(self, b: Array, m: Array, fabric_modulus: Array | None, finger: Fingertip) -> Contact:
        """Return the contacts, with fields of shape (batch, conditions); arguments as for `moduli`."""
        skin, reduced = self.moduli(b, m, fabric_modulus, finger)
        return Contact(skin, reduced, *self._closing.close(reduced, finger))
