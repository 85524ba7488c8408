"""Direction of ratings with the response: rising or falling. Fast to import, for the command line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from softness_bayes.errors import InputError


@dataclass(frozen=True)
class RatingDirection:
    """Direction of ratings with the response: rising (+1) or falling (-1)."""

    name: str
    sign: float
    former: str
    """Name in earlier versions, still accepted everywhere."""


RISES = RatingDirection("rises-with-firing", +1.0, "softness")
"""Direction in the paper: softness is proportional to the response."""
FALLS = RatingDirection("falls-with-firing", -1.0, "inverse")
"""Usual direction of softness ratings: stiffer fabrics cause more firing and are rated less soft."""
FREE = RatingDirection("free", +1.0, "free")
"""Either direction with prior probability 1/2, given by the sign of the exponent gamma."""
SOFTNESS, INVERSE = RISES, FALLS  # their former names
RATING_DIRECTIONS: Mapping[str, RatingDirection] = MappingProxyType(
    {direction.name: direction for direction in (RISES, FALLS)}
)
"""Directions of ratings by name; the first is the default if the data do not decide."""


def direction_named(name: str) -> RatingDirection:
    """Return a direction by its name, or by its name in earlier versions.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    for direction in (*RATING_DIRECTIONS.values(), FREE):
        if name in (direction.name, direction.former):
            return direction
    raise InputError(f"direction: {name!r} is not known, expected {' or '.join([*RATING_DIRECTIONS, FREE.name])}")
