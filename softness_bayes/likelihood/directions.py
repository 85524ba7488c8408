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


RISES = RatingDirection("rises-with-firing", +1.0)
"""Direction in the paper: softness is proportional to the response."""
FALLS = RatingDirection("falls-with-firing", -1.0)
"""Usual direction of softness ratings: stiffer fabrics cause more firing and are rated less soft."""
FREE = RatingDirection("free", +1.0)
"""Either direction with prior probability 1/2, given by the sign of the exponent gamma."""
RATING_DIRECTIONS: Mapping[str, RatingDirection] = MappingProxyType(
    {direction.name: direction for direction in (RISES, FALLS)}
)
"""Directions of ratings by name."""


def direction_named(name: str) -> RatingDirection:
    """Return a direction by its name.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    for direction in (*RATING_DIRECTIONS.values(), FREE):
        if name == direction.name:
            return direction
    raise InputError(f"direction: {name!r} is not known, expected {' or '.join([*RATING_DIRECTIONS, FREE.name])}")
