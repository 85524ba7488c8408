"""Scales of observations, such as magnitude estimates and z-scores, and the direction of ratings (model.md 9).

A scale describes the observations; an `error_laws.ErrorLaw` describes their errors. `models` contains the observation
model for each combination. For a fast command line, this module imports NumPy only on first use.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

from softness_bayes.base.errors import InputError, quoted
from softness_bayes.base.readable import some_of
from softness_bayes.base.supplied import FORM, installed, is_supplied, reference, require_reference, supplied

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

LARGEST_LOG_RATING = 700.0
"""Largest absolute log rating that is drawn or predicted; exp overflows at 709.78."""

LARGEST_LOG_ODDS = 30.0
"""Largest absolute log odds of a share that is drawn or predicted: 1 - 1e-13 is still distinct from 1."""

STANDARDISED_MEAN, STANDARDISED_SD = 1.0, 3.0
"""Largest absolute mean, and largest standard deviation, of ratings that can be z-scores."""


def _accept(table: Any) -> None:
    """Accept every table: forces are checked while they are read, and sliders by the ends of their scale."""


@dataclass(frozen=True)
class Scale:
    """Scale of observations.

    Effects of fabrics and participants are additive after the transformation `additive`: here, of the observations
    themselves; in the subclasses, of logarithms or log odds.

    Parameters
    ----------
    name
        Name in files and options.
    meaning
        Meaning of an observation, for tables and help.
    suitable
        Requirement on observations, in one word.
    unit, short
        Unit of the transformed observations, in sentences and in small figures.
    label
        Label of an axis of observations.
    mean
        Name of the mean that averages transformed observations, such as geometric mean.
    axis
        Scale of such an axis: log or linear.
    drawn
        Smallest and largest observation that such an axis can show, with margins and ticks.
    own_units
        True if participants have individual rating scales, which tables and figures remove.
    require
        Raises `InputError`, naming file, row, column and value, for a table (`data.Ratings`) that is not on this scale.
    """

    name: str
    meaning: str
    suitable: str
    unit: str
    short: str
    label: str
    mean: str
    axis: Literal["log", "linear"]
    drawn: tuple[float, float]
    own_units: bool = False
    require: Callable[[Any], None] = _accept
    answer: str = ""
    """Word for several rows that form one answer; empty if each row is an answer."""
    model: Callable[[Any], Any] | None = None
    """Constructor of the observation model, which takes a direction, for custom scales and models."""
    ends: tuple[float, float] = (0.0, 1.0)
    """Numbers in the file of the ends of a bounded scale, whose observation model has shares of it."""

    def additive(self, values: Any) -> NDArray[np.float64]:
        """Return the transformation of observations to the additive scale, of any shape."""
        import numpy as np

        return np.asarray(values, float)

    def natural(self, values: Any) -> NDArray[np.float64]:
        """Return observations from their values on the additive scale, the inverse of `additive`."""
        return self.additive(values)

    def log_slope(self, values: Any) -> NDArray[np.float64]:
        """Return the log of the derivative of `natural`, at observations."""
        return 0.0 * self.additive(values)

    def filed(self, observations: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return observations of the observation model, of any shape, in the units of the file."""
        low, high = self.ends
        return observations if self.ends == (0.0, 1.0) else low + (high - low) * observations


@dataclass(frozen=True)
class LogScale(Scale):
    """Scale of positive observations, whose logarithms are additive."""

    def additive(self, values: Any) -> NDArray[np.float64]:
        """Return logarithms."""
        import numpy as np

        return np.asarray(np.log(values))

    def natural(self, values: Any) -> NDArray[np.float64]:
        """Return exponentials, clipped at `LARGEST_LOG_RATING`, so that no observation is 0 or infinite."""
        import numpy as np

        return np.exp(np.clip(values, -LARGEST_LOG_RATING, LARGEST_LOG_RATING))

    def log_slope(self, values: Any) -> NDArray[np.float64]:
        """Return logarithms."""
        return self.additive(values)


@dataclass(frozen=True)
class LogOddsScale(Scale):
    """Scale between two `ends`; the log odds of an observation's share of the way between them are additive."""

    def additive(self, values: Any) -> NDArray[np.float64]:
        """Return log odds."""
        import numpy as np

        share = self._share(values)
        return np.log(share) - np.log1p(-share)

    def natural(self, values: Any) -> NDArray[np.float64]:
        """Return observations from log odds, clipped at `LARGEST_LOG_ODDS`, so that none lies at an end."""
        import numpy as np

        low, high = self.ends
        return low + (high - low) / (1.0 + np.exp(-np.clip(values, -LARGEST_LOG_ODDS, LARGEST_LOG_ODDS)))

    def log_slope(self, values: Any) -> NDArray[np.float64]:
        """Return the log of the derivative of the share."""
        import numpy as np

        share = self._share(values)
        return np.log(share) + np.log1p(-share)

    def _share(self, values: Any) -> NDArray[np.float64]:
        import numpy as np

        low, high = self.ends
        return (np.asarray(values, float) - low) / (high - low)


def slider_between(low: float, high: float) -> Scale:
    """Return the scale of a slider whose ends have these numbers in the file."""
    if (low, high) == SLIDER.ends:
        return SLIDER
    return replace(SLIDER, label=f"rating [{low:g} to {high:g}]", drawn=(low, high), ends=(low, high))


def _require_positive(table: Any) -> None:
    """Raise an error for negative ratings: magnitude estimates are 0 or above (model.md 9)."""
    import numpy as np

    wrong = np.flatnonzero(table.rating < 0)
    if not wrong.size and not (table.rating > 0).any():
        raise InputError(
            f"{table.source}: column {table.rating_column!r}: expected ratings above 0, got none: all "
            f"{table.rating.size} are 0"
        )
    if wrong.size:
        i = wrong[0]
        found = quoted(table.not_positive or f"{table.rating[i]:.15g}")
        raise InputError(
            f"{table.source}: row {table.rows[i]}, column {table.rating_column!r}: expected a magnitude "
            f"estimate of 0 or above, got {found} ({some_of(wrong.size, table.rating.size, 'rating')} negative); "
            "leave the cell of a missing rating empty; if these are z-scores, use --ratings "
            f"{STANDARDISED.name}"
        )


def _require_standardised(table: Any) -> None:
    """Raise an error for ratings that cannot be z-scores: `STANDARDISED_MEAN` and `STANDARDISED_SD` (model.md 9)."""
    mean, sd = float(table.rating.mean()), float(table.rating.std())
    if abs(mean) > STANDARDISED_MEAN or sd > STANDARDISED_SD:
        raise InputError(
            f"{table.source}: column {table.rating_column!r}: expected standardised ratings, of mean 0 and "
            f"standard deviation 1, got mean {mean:.3g} and standard deviation {sd:.3g}; standardise them, or "
            "omit --ratings if they are magnitude estimates"
        )


MAGNITUDE = LogScale(
    name="magnitude",
    meaning="magnitude estimates, above 0",
    suitable="positive",
    unit="log rating",
    short="log",
    label="rating",
    mean="geometric mean",
    axis="log",
    drawn=(1e-200, 1e200),
    own_units=True,
    require=_require_positive,
)
AGGREGATED = replace(
    MAGNITUDE,
    name="aggregated",
    meaning="geometric means of the magnitude estimates of n raters, with their standard deviations",
    label="rating (geometric mean)",
)
STANDARDISED = Scale(
    name="standardised",
    meaning="z-scores",
    suitable="finite",
    unit="z-score",
    short="sd",
    label="rating [sd]",
    mean="mean",
    axis="linear",
    drawn=(float("-inf"), float("inf")),
    require=_require_standardised,
)
SLIDER = LogOddsScale(
    name="slider",
    meaning="positions on a slider",
    suitable="inner",
    unit="log odds of the rating",
    short="log odds",
    label="rating [share of the slider]",
    mean="mean of log odds",
    axis="linear",
    drawn=(0.0, 1.0),
    own_units=True,
)
CATEGORIES = replace(
    STANDARDISED,
    name="categories",
    meaning="ordered categories, numbered from 1",
    suitable="whole",
    unit="category",
    short="category",
    label="category",
    own_units=True,
    require=_accept,
)
RANKS = replace(
    STANDARDISED,
    name="ranks",
    meaning="ranks of fabrics that a participant put in order, the largest number for the softest",
    unit="place",
    short="share",
    label="place [share of the list below]",
    answer="list",
    drawn=(0.0, 1.0),
    require=_accept,
)
PAIRS = replace(
    RANKS,
    name="pairs",
    meaning="paired comparisons, the larger number for the softer touch",
    label="answer [share of pairs won]",
    answer="pair",
)
RATING_SCALES: Mapping[str, Scale] = MappingProxyType(
    {scale.name: scale for scale in (MAGNITUDE, STANDARDISED, SLIDER, CATEGORIES, RANKS, PAIRS, AGGREGATED)}
)
"""Rating scales by name; the first is the default."""


OWN_SCALES = "ratings"
"""Entry-point group of scales, with their models, in installed packages."""


def scale_named(name: str) -> Scale:
    """Return a scale of ratings by its name.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    if name in RATING_SCALES:
        return RATING_SCALES[name]
    if not is_supplied(OWN_SCALES, name):
        known = " or ".join([*RATING_SCALES, *installed(OWN_SCALES)])
        raise InputError(f"ratings: scale {name!r} is not known, expected {known}, or {FORM} for a custom scale")
    found = supplied(OWN_SCALES, name)
    if not isinstance(found, Scale) or found.model is None:
        raise InputError(f"ratings: {name} is of the kind {type(found).__name__}, expected a Scale with a 'model'")
    return found


def name_of_scale(scale: Scale) -> str:
    """Return the name of a scale in files and options; for a custom scale, its importable name if it has one."""
    return scale.name if RATING_SCALES.get(scale.name) == scale else reference(scale) or scale.name


def require_name(scale: Scale) -> None:
    """Raise an error for a scale that a stored run could not find again by its name.

    Raises
    ------
    InputError
        With the reason.
    """
    if RATING_SCALES.get(scale.name) == scale:
        return
    if scale.model is None:
        known = ", ".join(RATING_SCALES)
        raise InputError(f"ratings: the scale {quoted(scale.name)} has no 'model' of its own; expected one, or {known}")
    require_reference(f"ratings: the scale {quoted(scale.name)}", scale)


PLATE_FORCE = replace(
    MAGNITUDE,
    name="plate-force",
    meaning="forces of a rigid plate, above 0 [N]",
    unit="log force",
    label="force [N]",
    own_units=False,
    require=_accept,
)
"""Scale of rigid-plate forces on a fingerpad; not a scale of ratings."""

LOG_SD = replace(
    MAGNITUDE,
    name="log-sd",
    meaning="standard deviations of log ratings between raters",
    unit="log standard deviation",
    label="standard deviation of log ratings",
    own_units=False,
    require=_accept,
)
"""Scale of standard deviations between raters; not a scale of ratings."""


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
