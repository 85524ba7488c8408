"""Options of ratings: their scale, the law of their errors, their grid and their direction."""

from __future__ import annotations

from typing import Any

import click

from softness_bayes.cli.options.values import Number, whole
from softness_bayes.defaults import ERRORS
from softness_bayes.likelihood.directions import FREE, RATING_DIRECTIONS, RISES
from softness_bayes.likelihood.scales import MAGNITUDE, RATING_SCALES
from softness_bayes.ranges import CATEGORIES_RANGE, RESOLUTIONS

AUTO = "auto"
"""The choice that leaves an option to the table."""

errors = click.option(
    "--errors",
    "errors",
    type=click.Choice([AUTO, *ERRORS]),
    default=AUTO,
    show_default=True,
    help="Distribution of the errors of log ratings: normal, student (Student's t with sampled degrees of "
    "freedom) or lapses (normal, mixed with a share of lapses over the range of the rater). auto chooses "
    "student if the residuals of the table have heavier tails than normal ones.",
)
"""Passes `errors` to a command: a name or `AUTO`."""

simulated_errors = click.option(
    "--errors",
    "errors",
    type=click.Choice(ERRORS),
    default=ERRORS[0],
    show_default=True,
    help="Distribution of the errors of log ratings: normal, student (Student's t, nu by --set) or lapses "
    "(--set lapse=0.03).",
)
"""Passes `errors` to a command: a name."""

resolution = click.option(
    "--resolution",
    "resolution",
    type=Number(RESOLUTIONS),
    metavar="STEP",
    help="Rounding of ratings: 1 for whole numbers; 0 treats ratings as exact numbers. By default the "
    "rounding of each rater is detected.",
)
"""Passes `resolution` to a command: a number or None."""


class _Direction(click.Choice[str]):
    """The directions of ratings, by their names or former names."""

    def __init__(self, *also: str) -> None:
        super().__init__([*also, *RATING_DIRECTIONS])

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        former = {one.former: one.name for one in RATING_DIRECTIONS.values()}
        return super().convert(former.get(value, value), param, ctx)


direction = click.option(
    "--direction",
    type=_Direction(),
    default=RISES.name,
    show_default=True,
    help="Whether ratings rise or fall with the response.",
)
"""Passes `direction` to a command: the name of a reading of what is rated."""

direction_of_data = click.option(
    "--direction",
    type=_Direction(AUTO, FREE.name),
    default=AUTO,
    show_default=True,
    help=f"Whether ratings rise or fall with the response. auto chooses from the data, or {RISES.name} if they "
    f"do not decide it; {FREE.name} samples both, each with prior probability 1/2.",
)
"""Passes `direction` to a command: a name or `AUTO`."""


def _ends(context: click.Context, parameter: click.Parameter, text: str) -> tuple[float, float]:
    try:
        low, high = (float(part) for part in text.split(","))
    except ValueError:
        raise click.BadParameter(f"{text!r}, expected two numbers, as in 0,100") from None
    if not -1e100 < low < high < 1e100:
        raise click.BadParameter(f"{text!r}, expected the lower end first, as in 0,100")
    return low, high


categories = click.option(
    "--categories",
    "n_categories",
    type=whole(CATEGORIES_RANGE),
    metavar="K",
    help="Number of ordered categories (--ratings categories); by default the largest number in the table.",
)
"""Passes `n_categories` to a command: a number or None."""

slider = click.option(
    "--slider",
    "slider_ends",
    callback=_ends,
    default="0,1",
    show_default=True,
    metavar="LOW,HIGH",
    help="Numbers of the two ends of a slider (--ratings slider).",
)
"""Passes `slider_ends` to a command: two numbers."""


class _Scale(click.Choice[str]):
    """The scales of ratings by their names, and users' own by their importable names."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        from softness_bayes.likelihood.scales import OWN_SCALES, scale_named
        from softness_bayes.supplied import is_supplied

        if not (isinstance(value, str) and value not in self.choices and is_supplied(OWN_SCALES, value)):
            return super().convert(value, param, ctx)
        try:
            scale_named(value)
        except ValueError as error:
            raise click.BadParameter(str(error)) from None
        return value


rating_scale = click.option(
    "--ratings",
    "scale",
    type=_Scale(RATING_SCALES),
    default=MAGNITUDE.name,
    show_default=True,
    help=f"Whether ratings are {', or '.join(scale.meaning for scale in RATING_SCALES.values())}; or a custom "
    "scale, such as mymodule:SCALE.",
)
"""Passes `scale` to a command: the name of a reading of the rating scale."""
