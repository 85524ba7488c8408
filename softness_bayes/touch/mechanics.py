"""Contacts and stress fields of a scene's conditions; over the range of a prior, from polynomials.

For given fabrics and loads, the reduced modulus and the stress on the axis depend on the skin alone, that is on ln b
and ln m. Over the range of a prior, one polynomial each replaces the search for the skin's modulus and the tables of
the peak stress, where its error is small enough.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from softness_bayes.touch.contact import Finger, Fingertip
from softness_bayes.touch.contacts import Contacts
from softness_bayes.touch.field import Fields
from softness_bayes.touch.finger_field import FieldsOfLoads
from softness_bayes.touch.skin_start import SkinBox, SkinSeries

Array = NDArray[np.float64]

SKIN_SHARE = 0.03
"""Relative error allowed in the skin's modulus, or in E_star and the peak stress, as a share of the stress fields'
tolerance."""


class Mechanics:
    """From parameters of the skin to the stress fields of all conditions.

    Parameters
    ----------
    contacts, fields
        The contacts and stress fields.
    finger
        The scene's finger, for which there are polynomials.
    box
        Skins that the polynomials cover; None for no polynomials.
    tolerance
        The tolerance of the stress fields.
    """

    def __init__(
        self, contacts: Contacts, fields: FieldsOfLoads, finger: Finger, box: SkinBox | None, tolerance: float
    ) -> None:
        self._contacts, self._fields, self._finger = contacts, fields, finger
        self._allowed = SKIN_SHARE * tolerance
        self._series = None
        if box is not None and fields.several is not None:
            series = SkinSeries(box, self._logarithms, self._allowed)
            self._series = series if series.error <= self._allowed else None

    @property
    def products(self) -> int:
        """Number of multiply-adds of the polynomials for each vector; 0 if there are none."""
        return 0 if self._series is None else self._series.products

    def fields(self, b: Array, m: Array, modulus: Array | None, finger: Fingertip) -> Fields:
        """Return the stress fields of all conditions; arguments as `Contacts.moduli` takes them."""
        if self._series is not None and modulus is None and finger is self._finger:
            logs, outside = self._series(b, m)
            reduced, peak = np.split(np.exp(logs), 2, axis=1)
            if outside.any():
                reduced[outside], peak[outside] = self._solved(b[outside], m[outside])
            return self._fields.at(reduced, self._contacts.radius(reduced, finger), finger, peak)
        _, reduced = self._contacts.moduli(b, m, modulus, finger, self._allowed)
        return self._fields.at(reduced, self._contacts.radius(reduced, finger), finger)

    def _solved(self, b: Array, m: Array) -> tuple[Array, Array]:
        """Return E_star and the stress on the axis [Pa], shape (batch, conditions), of skins b and m (batch,)."""
        _, reduced = self._contacts.moduli(b, m, None, self._finger)
        return reduced, self._fields.at(reduced, self._contacts.radius(reduced, self._finger), self._finger).peak

    def _logarithms(self, b: Array, m: Array) -> Array:
        return np.log(np.maximum(np.concatenate(self._solved(b[:, 0], m[:, 0]), axis=1), 1e-300))
