"""One figure of a finished run: what it reads of the run, its content and required data, also of custom figures."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

from softness_bayes.errors import InputError
from softness_bayes.plotting.style import USUAL, Style

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from softness_bayes.checking.inflection import Curves, Inflection
    from softness_bayes.likelihood.scales import Scale
    from softness_bayes.touch.contact import Load

FIRST_LOOK = "first look: not converged"
"""Note on every figure of a run that ended at its first convergence check."""


class Drawable(Protocol):
    """Interface of a finished run that the figures use; `Result` implements it."""

    @property
    def tree(self) -> xr.DataTree:
        """The groups of the result."""

    @property
    def is_first_look(self) -> bool:
        """True if the run ended on purpose before convergence."""

    @property
    def scale(self) -> Scale:
        """The scale of the ratings."""

    @property
    def loads(self) -> tuple[Load, ...]:
        """The loads of the data."""

    def group(self, name: str) -> xr.Dataset:
        """Return one group."""

    def curves(self) -> Curves:
        """Return the response against E_fab for each draw, under each load or group of loads."""

    def typical_ratings(self) -> NDArray[np.float64]:
        """Return the rating that a typical participant gives along these curves, shape (draws, loads, points)."""

    def inflections(self) -> Inflection:
        """Return the turning points of the response for each draw, under the same loads."""


@dataclass(frozen=True)
class VariableSource:
    """A variable of a result that a figure needs."""

    place: str
    """Group and variable, as in ``predictions/total_rate``."""
    absent: str
    """The message if it is missing."""

    def is_in(self, result: Drawable) -> bool:
        """Return True if a result contains the variable."""
        group, name = self.place.split("/")
        return group in result.tree.children and name in result.tree[group].data_vars


@dataclass(frozen=True)
class Drawing:
    """One figure of a finished run: ``drawing(result)`` returns it.

    Parameters
    ----------
    draw
        Function that makes the figure from the stored result.
    shows
        Description of the figure in one line.
    needs
        Variables that the figure needs.
    on_request
        Whether the figure is drawn only on request.
    only
        The rating scale that the figure is limited to; None for any scale.
    """

    draw: Callable[[Drawable, Style], Figure]
    shows: str
    needs: tuple[VariableSource, ...] = ()
    on_request: bool = False
    only: Scale | None = None

    def lacks(self, result: Drawable) -> str:
        """Return the reason why the data of this figure are missing; empty if the result has them."""
        if missing := next((source.absent for source in self.needs if not source.is_in(result)), ""):
            return missing
        wrong = self.only is not None and result.scale != self.only
        return f"its ratings are {result.scale.meaning}" if wrong else ""

    def __call__(self, result: Drawable, style: Style = USUAL) -> Figure:
        """Draw the figure.

        Raises
        ------
        InputError
            If the result lacks the data of the figure.
        """
        if reason := self.lacks(result):
            raise InputError(f"figure: cannot show {self.shows}: {reason}")
        figure = self.draw(result, style)
        if result.is_first_look:
            # a title of the figure, for which the layout makes room
            said = filter(None, (FIRST_LOOK, figure.get_suptitle()))
            figure.suptitle("\n".join(said), fontsize=style.small, color="firebrick")
        return figure


def _require_arguments(name: str, given: Any) -> None:
    """Raise an error unless the function accepts a result and a style; compiled functions are not checked."""
    try:
        of = inspect.signature(given)
    except ValueError:
        return
    try:
        of.bind(None, None)
    except TypeError as error:
        raise InputError(f"figures: {name} takes {of}, expected a function (result, style): {error}") from None


def own_drawing(name: str, given: Any) -> Drawing:
    """Return a custom figure: a `Drawing`, or a function of a result and a style that returns a figure.

    An error in the user's code is replaced by one that names the figure, so that a finished run ends with a message.

    Raises
    ------
    InputError
        If it is neither.
    """
    drawing = given
    if not isinstance(given, Drawing):
        if isinstance(given, type) or not callable(given):
            raise InputError(f"figures: {name} is {given!r:.60}, expected a Drawing, or a function (result, style)")
        _require_arguments(name, given)
        drawing = Drawing(given, (given.__doc__ or "").strip().partition("\n")[0].rstrip(".") or f"the figure {name}")

    def draw(result: Drawable, style: Style) -> Figure:
        from matplotlib.figure import Figure

        try:
            figure = drawing.draw(result, style)
        except Exception as error:
            raise InputError(f"figures: {name} (custom) fails: {type(error).__name__}: {error}") from error
        if not isinstance(figure, Figure):
            raise InputError(f"figures: {name} (custom) returns {figure!r:.60}, expected a matplotlib Figure")
        return figure

    return replace(drawing, draw=draw)
