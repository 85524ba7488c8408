"""Contacts and stress fields of a scene's conditions; over the range of a prior, from polynomials.

For given fabrics and loads, the reduced modulus and the stress on the axis depend on the skin alone, that is on b and
m. Over the range of a prior, one polynomial each for the modulus's place in the tables of the stress fields and for the
peak stress replaces the search for the skin's modulus, where its error is small enough.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from softness_bayes.touch.contact import Finger, Fingertip
from softness_bayes.touch.contacts import Contacts
from softness_bayes.touch.field import Fields
from softness_bayes.touch.finger_field import FieldsOfLoads
from softness_bayes.touch.several_fields import FieldsAt, SeveralFields
from softness_bayes.touch.skin_start import SkinBox, SkinSeries

Array = NDArray[np.float64]

SKIN_SHARE = 0.03
"""Relative error allowed in the skin's modulus, or error in the place of E_star in a table and in ln of the peak
stress, as a share of the stress fields' tolerance."""


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
        self._several, self._series = fields.several, None
        if box is not None and fields.several is not None and self._covered(box, fields.several):
            series = SkinSeries(box, self._at_points, self._allowed)
            self._series = series if series.error <= self._allowed else None

    @property
    def polynomials(self) -> tuple[int, int]:
        """Numbers of terms and of polynomials, both 0 if there are none."""
        return (0, 0) if self._series is None else self._series.shape

    def fields(self, b: Array, m: Array, modulus: Array | None, finger: Fingertip) -> Fields:
        """Return the stress fields of all conditions; arguments as `Contacts.moduli` takes them."""
        if self._several is not None and self._series is not None and modulus is None and finger is self._finger:
            found, outside = self._series(b, m)
            if outside.any():
                found[outside] = self._solved(b[outside], m[outside])
            conditions = found.shape[1] // 2
            return FieldsAt(self._several, found[:, :conditions], np.exp(found[:, conditions:]))
        _, reduced = self._contacts.moduli(b, m, modulus, finger, self._allowed)
        return self._fields.at(reduced, self._contacts.radius(reduced, finger), finger)

    def _covered(self, box: SkinBox, several: SeveralFields) -> bool:
        """Return whether the tables cover all skins of a box; beyond a table every point is inverted, which is slow."""
        # E_star rises with both b and m
        _, reduced = self._contacts.moduli(np.array(box.b), np.array(box.m), None, self._finger)
        return several.covers(reduced)

    def _solved(self, b: Array, m: Array) -> Array:
        """Return the places in the tables, then ln of the stress on the axis [Pa], shape (batch, 2 × conditions).

        The skins b and m have the shape (batch,).
        """
        assert self._several is not None
        _, reduced = self._contacts.moduli(b, m, None, self._finger)
        fields = self._several.at(reduced, self._contacts.radius(reduced, self._finger))
        return np.concatenate([fields.place, np.log(np.maximum(fields.peak, 1e-300))], axis=1)

    def _at_points(self, b: Array, m: Array) -> Array:
        return self._solved(b[:, 0], m[:, 0])
