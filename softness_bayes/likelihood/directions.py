"""Readings of the ratings' direction: rising or falling with the response. Light to import, for the command line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from softness_bayes.errors import InputError


@dataclass(frozen=True)
class RatingDirection:
    """A reading of the direction of ratings: they rise (+1) or fall (-1) with the response."""

    name: str
    sign: float
    former: str
    """The name in earlier versions; accepted wherever the name is."""


RISES = RatingDirection("rises-with-firing", +1.0, "softness")
"""The paper's: softness is proportional to the response."""
FALLS = RatingDirection("falls-with-firing", -1.0, "inverse")
"""Ratings of softness as most people give them: receptors fire more on stiffer fabrics."""
FREE = RatingDirection("free", +1.0, "free")
"""Either direction with probability 1/2, told by the sign of the exponent gamma."""
SOFTNESS, INVERSE = RISES, FALLS  # their former names
RATING_DIRECTIONS: Mapping[str, RatingDirection] = MappingProxyType(
    {direction.name: direction for direction in (RISES, FALLS)}
)
"""The readings of the ratings' direction, by name; the first is the default if the data cannot decide."""


def direction_named(name: str) -> RatingDirection:
    """Return a reading by its name, or by its name in earlier versions.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    for direction in (*RATING_DIRECTIONS.values(), FREE):
        if name in (direction.name, direction.former):
            return direction
    raise InputError(f"direction: {name!r} is not known, expected {' or '.join([*RATING_DIRECTIONS, FREE.name])}")
